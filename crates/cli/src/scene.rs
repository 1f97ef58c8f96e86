//! Scenes by name: files, or the bundled ones.

use crate::{Failure, Result};
use dapple_renderer::pbrt::{ReadOptions, read_scene};
use dapple_renderer::scene::Scene;
use dapple_renderer::{World, bundled};
use std::path::Path;

/// Reads a scene: a pbrt-v4 file, or a bundled scene where its name is no file's.
pub(crate) fn read(name: &Path, allow_unsupported: bool) -> Result<Scene> {
    let bundle = name.to_str().filter(|_| !name.is_file()).and_then(bundled::files);
    let scene = match bundle {
        Some(bundle) => bundle.read(),
        None if !name.exists() => {
            let (name, known) = (name.display(), bundled::names().join(", "));
            return Err(Failure::new(format!(
                "{name}: there is no such file, and no such bundled scene: those are {known}"
            )));
        }
        None => read_scene(name, &ReadOptions::default().with_allow_unsupported(allow_unsupported)),
    };
    scene.map_err(|e| Failure::lines(&e))
}

/// Makes the scene ready for rays.
pub(crate) fn build(scene: &Scene, resolution: [u32; 2]) -> Result<World> {
    World::with_resolution(scene, resolution).map_err(|e| Failure::lines(&e))
}
