//! The bundled scenes: files in the folder beside this module, compiled into the library.
//!
//! Each is a pbrt-v4 scene file with the meshes and images that it names, so that a program can render a scene without files
//! on disk. Scene files are written by hand; `cargo run --example generate_scenes` computes the other files, bit-identical on
//! every machine. Tests compare all files with their checksums, and the computed ones with the generator's output.
//!
//! | name | contents | effects |
//! |---|---|---|
//! | `teapot` | Newell's teapot in gold on a glossy tiled floor | environment, rough metal, coat, image texture |
//! | `terrain` | fractal mountains about a river plain | 2^17 triangles, soft shadows, coat, environment |
//! | `cornell` | the Cornell box | interreflection, one area light |
//! | `furnace` | the inside of a glowing sphere, whose exact image is known | interreflection, spheres |
//! | `plates` | four rough metal plates under four sphere lights | multiple importance sampling, checkerboard |
//! | `lens` | a row of balls, one in focus, before distant lights | depth of field, many lights |
//! | `motion` | a mill that turns, a ball that rolls, dice that fall | motion blur, instances |
//! | `glass` | balls of glass, dye and mist, a pane, a twig | refraction, media, alpha, instances |
//! | `room` | two rooms and eight small lights, each visible from few places | many local lights, interreflection, coat |
//! | `grass` | a meadow of 27,000 blades under a light and the sky | geometry smaller than a pixel, instances |
//! | `door` | a room lit through a door ajar, three pots on a table | almost only indirect lighting, metal, glass |
//! | `tea` | a glass of tea before tiles, a ball on a chessboard | detail in refraction and reflection, absorption |
//! | `cabin` | an aeroplane's cabin at night | 68 small lights, screens, dark and glossy surfaces |
//! | `many-lights` | ten thousand small lights over columns and blocks | many lights, each of local effect |
//! | `caustic` | a glass ball over a floor, under a tiny light | light focused by glass |
//! | `chess` | chess pieces near, in focus and far | depth of field, direct light only |
//! | `zone-plate` | rings that become finer than pixels; the plate's mean is known | image texture, noise only within pixels |
//! | `penumbra` | a floor half hidden from an area light, whose exact image is known | soft shadow, direct light only |
//!
//! Departures from pbrt-v4: environment maps are latitude-longitude images (z up; see
//! [`EnvironmentRadiance::LatLong`](crate::EnvironmentRadiance::LatLong)), where pbrt-v4 itself
//! requires equal-area squares.
//!
//! ```
//! use dapple_scene::bundled;
//!
//! let bundle = bundled::files(bundled::DEFAULT).expect("the default scene is bundled");
//! let text = bundle.file(&bundle.main).expect("its main file is in the bundle");
//! assert!(text.starts_with(b"# "));
//! let scene = bundle.read().expect("it can be read");
//! assert_eq!(scene.name, "teapot");
//! ```

use crate::files::Files;
use crate::pbrt::{ReadOptions, read_scene_from};
use crate::{ReadError, Scene};
use std::io;
use std::path::Path;

/// The name of the default scene.
pub const DEFAULT: &str = "teapot";

/// A bundled scene: its scene file and every other file that it needs, in memory.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Bundle {
    /// The bundled scene's name.
    pub name: &'static str,
    /// Name of the scene file among [`files`](Self::files).
    pub main: String,
    /// Name (relative to the scene file's folder) and bytes of each file. The scene file comes first.
    pub files: Vec<(String, Vec<u8>)>,
}

impl Bundle {
    /// Returns the bytes of the bundle's file called `name`; `None` for an unknown name.
    pub fn file(&self, name: &str) -> Option<&[u8]> {
        self.files.iter().find(|(file, _)| file == name).map(|(_, bytes)| bytes.as_slice())
    }

    /// Reads the scene from the bundle's files. The returned scene has the bundle's name.
    ///
    /// # Errors
    /// Never fails for a bundle returned by [`bundled::files`](files).
    pub fn read(&self) -> Result<Scene, ReadError> {
        let mut scene = read_scene_from(self, &self.main, &ReadOptions::default())?;
        self.name.clone_into(&mut scene.name);
        Ok(scene)
    }
}

impl Files for Bundle {
    fn read(&self, path: &Path) -> io::Result<Vec<u8>> {
        let found = path.to_str().and_then(|name| self.file(name));
        found.map(<[u8]>::to_vec).ok_or_else(|| io::Error::new(io::ErrorKind::NotFound, "not in the bundle"))
    }
}

/// Declares the bundled scenes: each with its files, the scene file first.
macro_rules! scenes {
    ($($scene:literal: $($file:literal),*;)*) => {
        const NAMES: &[&str] = &[$($scene),*];

        /// The names of each scene's files, and their bytes.
        static FILES: &[&[(&str, &[u8])]] =
            &[$(&[$(($file, include_bytes!(concat!("bundled/", $scene, "/", $file)))),*]),*];
    };
}

scenes! {
    "teapot": "scene.pbrt", "teapot.ply", "studio.pfm", "tiles.tga";
    "terrain": "scene.pbrt", "grass.ply", "rock.ply", "snow.ply", "sky.pfm";
    "cornell": "scene.pbrt";
    "furnace": "scene.pbrt";
    "plates": "scene.pbrt";
    "lens": "scene.pbrt";
    "motion": "scene.pbrt";
    "glass": "scene.pbrt", "leaf.tga";
    "room": "scene.pbrt";
    "grass": "scene.pbrt";
    "door": "scene.pbrt";
    "tea": "scene.pbrt";
    "cabin": "scene.pbrt";
    "many-lights": "scene.pbrt";
    "caustic": "scene.pbrt";
    "chess": "scene.pbrt";
    "zone-plate": "scene.pbrt", "rings.tga";
    "penumbra": "scene.pbrt";
}

/// Returns the names of the bundled scenes, [`DEFAULT`] first.
pub fn names() -> &'static [&'static str] {
    NAMES
}

/// Returns the bundled scene called `name`; `None` for an unknown name.
pub fn files(name: &str) -> Option<Bundle> {
    let number = NAMES.iter().position(|known| *known == name)?;
    let files: Vec<_> = FILES[number].iter().map(|(file, bytes)| ((*file).to_owned(), bytes.to_vec())).collect();
    Some(Bundle { name: NAMES[number], main: files[0].0.clone(), files })
}
