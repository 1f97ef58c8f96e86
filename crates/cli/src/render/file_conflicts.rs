//! Each file of a render has one role: no output is written over an input, or over another output.

use super::RenderArgs;
use crate::{Failure, Result};
use dapple_job::output::FileIdentity;
use dapple_job::{LoadedScene, OutputFiles};
use std::path::Path;

/// The option that names a file, and the file.
type Named<'a> = (&'static str, &'a Path);

/// Checks all files that a render reads and writes.
///
/// # Errors
///
/// A failure with a line for each file that two options name, or that the scene reads and an option writes.
pub(super) fn check(args: &RenderArgs, loaded: &LoadedScene, files: &OutputFiles) -> Result<()> {
    let images = files.paths().map(|path| ("--output", path));
    let maps = args.maps.as_deref();
    let images = images.map(|(option, path)| match maps {
        Some(folder) if path.parent() == Some(folder) && !args.outputs.iter().any(|o| o == path) => ("--maps", path),
        _ => (option, path),
    });
    let mut written: Vec<Named<'_>> = images.collect();
    written.extend(args.preview.as_deref().map(|path| ("--preview", path)));
    written.extend(args.checkpoint.as_deref().map(|path| ("--checkpoint", path)));
    let spec = args.spec.as_deref().map(|path| ("--spec", path));
    check_inputs(loaded, spec, written.iter().copied())?;
    // `--resume` and `--checkpoint` may name the same file, which is overwritten only if it is a checkpoint.
    let resumed = args.resume.as_deref().filter(|path| args.checkpoint.as_deref() != Some(path));
    written.extend(resumed.map(|path| ("--resume", path)));
    // The folder of maps would take the name of a file.
    written.extend(maps.map(|folder| ("--maps", folder)));
    let identities: Vec<FileIdentity> = written.iter().map(|(_, path)| FileIdentity::of(path)).collect();
    let mut wrong = Vec::new();
    for (i, (option, path)) in written.iter().enumerate() {
        let first = (0..i).find(|&j| identities[j].is_same(&identities[i]) && !is_resumption(written[j].0, option));
        wrong.extend(first.map(|j| {
            let (other, first, path) = (written[j].0, written[j].1.display(), path.display());
            format!("{option} {path}: {other} {first} is the same file; choose different files")
        }));
    }
    if wrong.is_empty() { Ok(()) } else { Err(Failure(wrong)) }
}

/// Returns `true` for the pair of options that may name the same file.
fn is_resumption(first: &str, second: &str) -> bool {
    [first, second] == ["--checkpoint", "--resume"]
}

/// Checks that no output file is also an input of the scene, or `other`.
///
/// # Errors
///
/// A failure with a line for each input file that would be overwritten.
pub(super) fn check_inputs<'a>(
    loaded: &LoadedScene,
    other: Option<Named<'a>>,
    written: impl Iterator<Item = Named<'a>>,
) -> Result<()> {
    let scene = loaded.files.iter().map(|path| ("the scene", path.as_path()));
    let inputs: Vec<_> = scene.chain(other).map(|(who, path)| (who, path, FileIdentity::of(path))).collect();
    let mut wrong = Vec::new();
    for (option, path) in written {
        let identity = FileIdentity::of(path);
        let input = inputs.iter().find(|(_, _, input)| input.is_same(&identity));
        wrong.extend(input.map(|(who, input, _)| {
            let (path, input) = (path.display(), input.display());
            format!("{option} {path}: {who} reads this file ({input}); write to another file")
        }));
    }
    if wrong.is_empty() { Ok(()) } else { Err(Failure(wrong)) }
}
