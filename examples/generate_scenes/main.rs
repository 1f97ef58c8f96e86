//! Writes the bundled scenes to `crates/scene/src/bundled`, or to a given folder.
//!
//! ```sh
//! cargo run --example generate_scenes -- [FOLDER]
//! ```
//!
//! Each scene is a pbrt-v4 file, made from a template `NAME.pbrt` with `{holes}` for computed values, and the meshes and
//! images that it names. The bytes are the same on every machine: all arithmetic is `+ - * /` and `sqrt` on `f64`,
//! which IEEE 754 rounds in one way, and Rust neither fuses nor reorders these operations. A test compares the committed
//! files with the result.

mod cabin;
mod chess;
mod cornell;
mod directions;
mod door;
mod glass;
mod grass;
mod images;
mod lens;
mod many_lights;
mod mesh;
mod motion;
mod noise;
mod plates;
mod revolved;
mod room;
mod tea;
mod teapot;
mod terrain;
mod zone_plate;

use std::path::PathBuf;
use std::{env, fs, io};

/// Name and bytes of each file of a scene besides its scene file: meshes and images.
type Assets = Vec<(String, Vec<u8>)>;

/// Returns the name, the scene file's text and the other files of each scene.
fn scenes() -> Vec<(&'static str, String, Assets)> {
    let mut scenes: Vec<_> = [
        ("cornell", cornell::scene()),
        ("furnace", include_str!("furnace.pbrt").to_owned()),
        ("plates", plates::scene()),
        ("lens", lens::scene()),
        ("motion", motion::scene()),
        ("room", room::scene()),
        ("grass", grass::scene()),
        ("door", door::scene()),
        ("tea", tea::scene()),
        ("cabin", cabin::scene()),
        ("many-lights", many_lights::scene()),
        ("caustic", include_str!("caustic.pbrt").to_owned()),
        ("chess", chess::scene()),
        ("penumbra", include_str!("penumbra.pbrt").to_owned()),
    ]
    .map(|(name, text)| (name, text, Assets::new()))
    .into();
    let with_assets = [
        ("teapot", teapot::scene()),
        ("terrain", terrain::scene()),
        ("glass", glass::scene()),
        ("zone-plate", zone_plate::scene()),
    ];
    scenes.extend(with_assets.map(|(name, (text, assets))| (name, text, assets)));
    scenes
}

fn main() -> io::Result<()> {
    let default = concat!(env!("CARGO_MANIFEST_DIR"), "/crates/scene/src/bundled");
    let folder = env::args_os().nth(1).map_or_else(|| PathBuf::from(default), PathBuf::from);
    for (scene, text, assets) in scenes() {
        let folder = folder.join(scene);
        fs::create_dir_all(&folder)?;
        fs::write(folder.join("scene.pbrt"), text)?;
        for (name, bytes) in assets {
            fs::write(folder.join(name), bytes)?;
        }
    }
    Ok(())
}
