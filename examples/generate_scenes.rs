//! Writes the bundled scenes to `examples/scenes`, or to a given folder. A test compares the committed files with the
//! result.
//!
//! ```sh
//! cargo run --example generate_scenes -- [FOLDER]
//! ```

use dapple_scene::bundled;
use std::path::PathBuf;
use std::{env, fs, io};

fn main() -> io::Result<()> {
    let default = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/scenes");
    let folder = env::args_os().nth(1).map_or_else(|| PathBuf::from(default), PathBuf::from);
    for bundle in bundled::names().iter().filter_map(|name| bundled::files(name)) {
        let folder = folder.join(bundle.name);
        fs::create_dir_all(&folder)?;
        for (name, bytes) in &bundle.files {
            fs::write(folder.join(name), bytes)?;
        }
    }
    Ok(())
}
