//! One machine's share of an image, as a file.

use super::Options;
use super::identity::{FILTER, SHARD, WORDS};
use crate::output::{tell, warn};
use crate::{Failure, Result};
use dapple_core::{Film, Frame, Shard, ShardFilm};
use dapple_job::checkpoint::{Contents, Identity, Kind};
use dapple_renderer::light::LightSelection;
use dapple_scene::image::{check_writable, write_file};
use std::path::{Path, PathBuf};

/// Where the share goes, known to be writable; `None` without `--shard`.
pub(super) fn file(options: &Options, scene: &str, frame: &Frame) -> Result<Option<PathBuf>> {
    let Some(shard) = options.shard else { return Ok(None) };
    if options.light_choice() == LightSelection::Learned {
        return Err(Failure::new(
            "--light-choice learned cannot be split into shards, since it learns from the whole image; give power or uniform",
        ));
    }
    let rows = frame.size()[1];
    if shard.of() > rows {
        return Err(Failure::new(format!("--shard {shard}: a window of {rows} rows has {rows} shards at most")));
    }
    let named = || PathBuf::from(format!("{scene}-{}-of-{}.shard", shard.index() + 1, shard.of()));
    let path = options.outputs.first().cloned().unwrap_or_else(named);
    check_writable(&path).map_err(Failure::new)?;
    Ok(Some(path))
}

/// Writes a share that is whole.
pub(super) fn write(path: &Path, shard: Shard, film: &Film, identity: Identity, quiet: bool) -> Result<()> {
    if film.record().interrupted {
        warn(format!("shard {shard} was interrupted, and is not written"));
        return Ok(());
    }
    let body = ShardFilm::new(shard, film).map_err(Failure::new)?.to_bytes();
    let contents = Contents { kind: Kind::Shard, identity, body };
    let bytes = contents.to_bytes().map_err(Failure::new)?;
    write_file(path, &bytes).map_err(Failure::new)?;
    if quiet {
        return Ok(());
    }
    let samples = film.record().samples;
    tell(format!("{}: shard {shard}, {samples} samples; dapple merge makes the image of all", path.display()))
}

/// What shards of one image have in common.
pub(crate) fn common(identity: &Identity) -> Identity {
    let pairs = identity.pairs().iter().filter(|(name, _)| name != SHARD && name != WORDS);
    Identity::new(pairs.cloned())
}

/// What their samples have in common with those of a render that is no shard.
pub(crate) fn samples(identity: &Identity) -> Identity {
    let common = common(identity);
    Identity::new(common.pairs().iter().filter(|(name, _)| name != FILTER).cloned())
}
