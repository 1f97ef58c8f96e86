//! What a render's samples depend on: what a checkpoint is refused for, and shards must have in common.

use super::Options;
use super::settings::{Methods, Settings};
use crate::info;
use dapple_job::checkpoint::Identity;
use dapple_scene::Scene;

/// The pair that tells shards of one image apart.
pub(crate) const SHARD: &str = "shard";
/// The pair with what makes the image of the samples: of shards alone.
pub(crate) const FILTER: &str = "filter";
/// The pair with the words that make the same image again; not compared.
pub(crate) const WORDS: &str = "words";

/// Everything but the budget, which may be raised, and the number of threads, which changes nothing. `digest` is of all
/// files of the scene.
pub(super) fn identity(
    options: &Options,
    settings: &Settings,
    methods: &Methods,
    scene: &Scene,
    digest: &str,
) -> Identity {
    let frame = &settings.frame;
    let [[w, h], [x, y], [cw, ch]] = [frame.resolution(), frame.origin(), frame.size()];
    let without: Vec<&str> = settings.without.iter().map(|e| e.name()).collect();
    let mut pairs = vec![
        ("version", env!("CARGO_PKG_VERSION").to_owned()),
        ("scene", scene.name.clone()),
        ("scene files", digest.to_owned()),
        ("sampler", methods.sampler_described.clone()),
        ("points", settings.points_described.clone()),
        ("seed", settings.seed.to_string()),
        ("light choice", options.light_choice().name().to_owned()),
        ("pixel filter", info::pixel_filter(&scene.film.pixel_filter)),
        ("max depth", scene.max_depth.map_or("none".into(), |d| d.to_string())),
        ("without", without.join(",")),
        ("resolution", format!("{w}x{h}")),
        ("window", format!("{x},{y},{},{}", x + cw, y + ch)),
        ("samples per pixel", format!("{} to {}", settings.limits.min_spp, settings.limits.max_spp)),
    ];
    if let Some(shard) = options.shard {
        // A checkpoint may end under another filter; one image has one.
        pairs.push((FILTER, methods.filter.describe()));
        pairs.push((SHARD, shard.to_string()));
        pairs.push((WORDS, words(options)));
    }
    Identity::new(pairs)
}

/// The words after `dapple render` that make the same samples, and the same image of them, as a list in JSON.
fn words(options: &Options) -> String {
    let mut words = vec![options.scene.display().to_string()];
    let mut say = |name: &str, value: String| words.extend([format!("--{name}"), value]);
    say("sampler", options.sampler.clone());
    say("points", options.points.clone());
    say("filter", options.filter.clone());
    say("seed", options.seed.to_string());
    say("light-choice", options.light_choice().name().to_owned());
    say("min-spp", options.min_spp.to_string());
    let pixel_filter = match options.pixel_filter {
        super::options::PixelShape::Scene => "scene",
        super::options::PixelShape::Box => "box",
    };
    say("pixel-filter", pixel_filter.to_owned());
    if let Some(spp) = options.spp {
        say("spp", spp.to_string());
    }
    if let Some(spp) = options.max_spp {
        say("max-spp", spp.to_string());
    }
    if let Some(depth) = options.max_depth {
        say("max-depth", depth.to_string());
    }
    if let Some([w, h]) = options.resolution {
        say("resolution", format!("{w}x{h}"));
    }
    if let Some([x0, y0, x1, y1]) = options.crop {
        say("crop", format!("{x0},{y0},{x1},{y1}"));
    }
    options.without.iter().for_each(|effect| say("without", effect.name().to_owned()));
    if options.allow_unsupported {
        words.push("--allow-unsupported".to_owned());
    }
    // Text cannot fail.
    serde_json::to_string(&words).unwrap_or_default()
}
