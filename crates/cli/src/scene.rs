//! Scenes by name: files, or the bundled ones.

use crate::output::{bytes, warn};
use crate::{Failure, Result};
use dapple_renderer::World;
use dapple_scene::Scene;
use dapple_scene::bundled::{self, Bundle};
use dapple_scene::files::{Disk, Files};
use dapple_scene::pbrt::ReadOptions;
use dapple_scene::{AnyOptions, Called, Effects, read_any_from};
use dapple_study::Digest;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The bundled scene that a name means: where it is no file's.
fn bundle(name: &Path) -> Option<Bundle> {
    name.to_str().filter(|_| !name.is_file()).and_then(bundled::files)
}

/// Reads a scene: a pbrt-v4 file, a model, or a bundled one.
pub(crate) fn read(name: &Path, allow_unsupported: bool) -> Result<Scene> {
    read_from(&Disk, name, allow_unsupported)
}

/// The same, no single file being longer than `most` bytes: it would not fit.
pub(crate) fn read_within(name: &Path, allow_unsupported: bool, most: u64) -> Result<Scene> {
    read_from(&Bounded { most }, name, allow_unsupported)
}

/// The same, with a digest of every byte that was read for it, wherever it lies.
pub(crate) fn read_digested(name: &Path, allow_unsupported: bool, most: u64) -> Result<(Scene, String)> {
    let files = Recorder { files: Bounded { most }, read: RefCell::default() };
    let scene = read_from(&files, name, allow_unsupported)?;
    let mut digest = Digest::new();
    for (name, bytes) in bundle(name).iter().flat_map(|bundle| &bundle.files) {
        digest.text(name);
        digest.add(bytes);
    }
    let folder = name.parent().unwrap_or(Path::new(""));
    for (file, bytes) in files.read.into_inner() {
        digest.text(&file.strip_prefix(folder).unwrap_or(&file).to_string_lossy());
        digest.text(&bytes);
    }
    Ok((scene, digest.hex()))
}

/// The disk, but for what is longer than the memory that there is: files are read whole.
struct Bounded {
    most: u64,
}

impl Files for Bounded {
    fn read(&self, path: &Path) -> std::io::Result<Vec<u8>> {
        let length = std::fs::metadata(path)?.len();
        if length > self.most {
            let (length, most) = (bytes(length), bytes(self.most));
            let what = format!("it is {length} long, and the limit of memory is {most} (--memory)");
            return Err(std::io::Error::new(std::io::ErrorKind::OutOfMemory, what));
        }
        Disk.read(path)
    }
}

/// Files, with a digest of each that is read.
struct Recorder {
    files: Bounded,
    read: RefCell<BTreeMap<PathBuf, String>>,
}

impl Files for Recorder {
    fn read(&self, path: &Path) -> std::io::Result<Vec<u8>> {
        let bytes = self.files.read(path)?;
        self.read.borrow_mut().insert(path.to_owned(), Digest::of(&bytes).hex());
        Ok(bytes)
    }
}

fn read_from(files: &impl Files, name: &Path, allow_unsupported: bool) -> Result<Scene> {
    let scene = match bundle(name) {
        Some(bundle) => bundle.read(),
        None if !name.exists() => {
            let (name, known) = (name.display(), bundled::names().join(", "));
            return Err(Failure::new(format!(
                "{name}: there is no such file, and no such bundled scene: those are {known}"
            )));
        }
        None => {
            let options = ReadOptions::default().with_allow_unsupported(allow_unsupported);
            read_any_from(files, name, &AnyOptions::default().with_scene(options))
        }
    };
    // The library knows no options; here its advice has a name.
    scene.map_err(|e| Failure::lines(&e.to_string().replace("allow unsupported directives", "--allow-unsupported")))
}

/// Lists what was read otherwise than written. What a bundled scene's text says to other renderers is no
/// news to its user.
pub(crate) fn warn_of(scene: &Scene, name: &Path) {
    if bundle(name).is_some() {
        return;
    }
    for notice in &scene.notices {
        warn(format!("{}: {}", notice.source, notice.message));
    }
}

/// Says where a path tracer will not find the light.
pub(crate) fn warn_of_chance(scene: &Scene) {
    if let Some(called) = Effects::found_by_chance(scene) {
        warn(format!("{}: {}", called.source, chance(&called)));
    }
}

/// What light found by chance means, as a sentence.
pub(crate) fn chance(called: &Called) -> String {
    let others = match called.objects {
        1 => String::new(),
        2 => " (and one more light like it)".into(),
        n => format!(" (and {} more lights like it)", n - 1),
    };
    format!(
        "{}{others}: what arrives through it is found by chance only, as specks that many samples do not smooth",
        called.because
    )
}

/// Makes the scene ready for rays.
pub(crate) fn build(scene: &Scene, resolution: [u32; 2]) -> Result<World> {
    World::with_resolution(scene, resolution).map_err(|e| Failure::lines(&e))
}
