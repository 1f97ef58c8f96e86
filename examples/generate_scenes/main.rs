//! Writes the computed files of the bundled scenes to `crates/scene/src/bundled`, or to a given folder.
//!
//! ```sh
//! cargo run --example generate_scenes -- [FOLDER]
//! ```
//!
//! These are meshes, images, and the two scene files with many repeated objects, `grass` and `many-lights`. The handwritten
//! first part of these scene files is kept; all other scene files are written by hand. The bytes are the same on every machine:
//! all arithmetic is `+ - * /` and `sqrt` on `f64`, whose rounding IEEE 754 defines, and Rust neither fuses nor reorders these
//! operations. A test compares the committed files with the result.

mod arithmetic;
mod files;
mod patterns;
mod teapot;
mod terrain;

use std::path::{Path, PathBuf};
use std::{env, fs, io};

/// `SCENE/NAME` and the bytes of each file.
type Assets = Vec<(String, Vec<u8>)>;

fn main() -> io::Result<()> {
    let default = concat!(env!("CARGO_MANIFEST_DIR"), "/crates/scene/src/bundled");
    let folder = env::args_os().nth(1).map_or_else(|| PathBuf::from(default), PathBuf::from);
    let committed = |name: &str| fs::read_to_string(Path::new(default).join(name));
    let patterns = [
        ("grass/scene.pbrt", patterns::grass(&committed("grass/scene.pbrt")?).into_bytes()),
        ("many-lights/scene.pbrt", patterns::many_lights(&committed("many-lights/scene.pbrt")?).into_bytes()),
        ("glass/leaf.tga", patterns::leaf_image()),
        ("zone-plate/rings.tga", patterns::rings_image()),
    ];
    let mut files: Assets = patterns.map(|(name, bytes)| (name.to_owned(), bytes)).into();
    files.extend(teapot::assets());
    files.extend(terrain::assets());
    for (name, bytes) in files {
        let path = folder.join(name);
        path.parent().map_or(Ok(()), fs::create_dir_all)?;
        fs::write(path, bytes)?;
    }
    Ok(())
}
