//! `dapple merge`.

use crate::render::{self, identity, shard};
use crate::{Failure, Outcome, Result};
use clap::Parser;
use dapple_core::{ShardFilm, merge};
use dapple_job::checkpoint::{Contents, Identity, Kind};
use std::path::{Path, PathBuf};

/// Make the image of shards that several machines rendered
///
/// The image is bit for bit that of one machine with the same words (and --light-choice power, as shards have it). The scene is read again, from where the shards' words
/// say or from --scene: a filter may look at it, and it must be the one that was rendered.
#[derive(clap::Args)]
#[command(after_help = AFTER)]
pub(crate) struct Options {
    /// The files of all shards, in any order
    #[arg(value_name = "SHARD", required = true)]
    shards: Vec<PathBuf>,

    /// An image, by extension: .exr, .pfm or .png; may be given again [default: as dapple render has it]
    #[arg(short, long = "output", value_name = "OUT")]
    outputs: Vec<String>,

    /// Where the scene lies now, if it is not where it was
    #[arg(long, value_name = "SCENE")]
    scene: Option<PathBuf>,

    /// Make PNG files brighter by this many powers of two
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_negative_numbers = true)]
    exposure: f32,

    /// Threads to use; 0 is one per core
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u16).range(..=1024))]
    threads: u16,

    /// Print one line of JSON rather than a summary: of all machines together, but "cpu"
    #[arg(long)]
    json: bool,

    /// No summary; warnings remain
    #[arg(short, long, conflicts_with = "json")]
    quiet: bool,
}

const AFTER: &str = "\
Example (docs/SHARDS.md has one for job arrays):
  dapple render scene.pbrt --sampler uniform --spp 256 --shard 1/2 -o 1.shard
  dapple render scene.pbrt --sampler uniform --spp 256 --shard 2/2 -o 2.shard
  dapple merge 1.shard 2.shard -o scene.exr";

pub(crate) fn run(options: &Options) -> Result<Outcome> {
    let (parts, identity) = read(&options.shards)?;
    let film = merge(&parts).map_err(Failure::new)?;
    drop(parts);
    let words = words(options, &identity)?;
    let render = render::Words::try_parse_from(words).map_err(|e| {
        Failure::new(format!("the words in the shards are not understood: {}", e.to_string().trim_end()))
    })?;
    render::show(&render.options, film, &shard::samples(&identity))
}

/// The shards, all of one image, and the first one's identity.
fn read(paths: &[PathBuf]) -> Result<(Vec<ShardFilm>, Identity)> {
    let mut parts = Vec::new();
    let mut first: Option<(&Path, Identity)> = None;
    let mut troubles = Vec::new();
    for path in paths {
        let contents = match Contents::read(path, Kind::Shard) {
            Ok(contents) => contents,
            Err(e) => {
                troubles.push(e.to_string());
                continue;
            }
        };
        match ShardFilm::from_bytes(&contents.body) {
            Ok(part) => parts.push(part),
            Err(e) => troubles.push(format!("{}: {e}", path.display())),
        }
        match &first {
            None => first = Some((path, contents.identity)),
            Some((of, identity)) => {
                let differ = shard::common(identity).differences(&shard::common(&contents.identity));
                let of = of.display();
                troubles.extend(differ.into_iter().map(|d| format!("{}: beside {of}: {d}", path.display())));
            }
        }
    }
    match first {
        Some((_, identity)) if troubles.is_empty() => Ok((parts, identity)),
        _ => Err(Failure(troubles)),
    }
}

/// The words that the shards were rendered with, and what is asked for now.
fn words(options: &Options, identity: &Identity) -> Result<Vec<String>> {
    let known = identity.value(identity::WORDS).unwrap_or_default();
    let mut words: Vec<String> = serde_json::from_str(known)
        .map_err(|e| Failure::new(format!("the words in the shards are not understood: {e}")))?;
    if let (Some(scene), Some(first)) = (&options.scene, words.first_mut()) {
        *first = scene.display().to_string();
    }
    for output in &options.outputs {
        words.extend(["--output".to_owned(), output.clone()]);
    }
    words.push(format!("--exposure={}", options.exposure));
    words.push(format!("--threads={}", options.threads));
    for (asked, word) in [(options.json, "--json"), (options.quiet, "--quiet")] {
        if asked {
            words.push(word.to_owned());
        }
    }
    Ok(words)
}
