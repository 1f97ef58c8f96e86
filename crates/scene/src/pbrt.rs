//! Reads scenes in the format of pbrt-v4 [Pharr et al. 2023; pbrt-v4 input file format], and, in part, of pbrt-v3 and v2
//! [Pharr et al. 2016; 2010].
//!
//! [`read_scene`] reads from disk, [`read_scene_from`] from any [`Files`]. Either returns the whole [`Scene`] or every
//! problem found, each with file and line; nothing is left out silently. Deviations from the file (ignored samplers,
//! unknown parameters, features left out by [`ReadOptions::allow_unsupported`]) are listed in [`Scene::notices`].
//!
//! A file is text: directives with their arguments. `tokens` splits the text, `directive` reads one directive at a time, and
//! `execute` runs each on the state of the `reader`. The other modules each interpret one kind of directive. Modules that
//! need the scene so far use the `reader`; the others need only parameters. Only `execute` runs directives. A new directive
//! is a word in `directive::FORMS` and an arm in `Reader::execute`. A new shape, material, texture or light is an arm in its
//! module.
//!
//! Files of pbrt-v2 and pbrt-v3 are read by the rules of their version, which is derived from the directives of the
//! main file (not of included files): see `legacy`. Names of materials, media and objects may be defined
//! after their use, as in pbrt-v4: see `names`.
//!
//! Colours are linear sRGB. A spectrum of a surface or a medium is converted under illuminant D65. In pbrt-v4, a
//! light's spectrum or temperature gives only the light's colour, at luminance 1; `scale`, `power` or `illuminance` set
//! the brightness. In pbrt-v2 and v3 a light's spectrum is converted without scaling. `spectra` lists the named metals
//! and glasses. Cylinders, parts of spheres and disks, curved bilinear patches and subdivision surfaces become
//! triangles, with a notice where that is not exact.
//!
//! A truncated file is detected if something is missing: a value, a bracket, an `AttributeEnd`, the camera, all shapes,
//! all lights, or the line break of the last line. A cut between two directives that leaves a complete scene is not
//! detected.

mod directive;
mod execute;
mod images;
mod legacy;
mod lights;
mod log;
mod material_directives;
mod materials;
mod names;
mod objects;
mod options;
mod params;
mod reader;
mod shapes;
mod spectra;
mod subdivide;
mod tessellate;
mod textured;
mod textures;
mod tokens;
mod transforms;
mod version;

pub use crate::scene_reader::ReadOptions;

use crate::Scene;
use crate::files::{Disk, Files};
use crate::scene_reader::{ReadError, SceneReader};
use std::path::Path;

/// Reads a pbrt scene from disk.
///
/// # Errors
/// Returns all problems of the file, each with its line.
pub fn read_scene(path: impl AsRef<Path>, options: &ReadOptions) -> Result<Scene, ReadError> {
    read_scene_from(&Disk, path, options)
}

/// Reads a pbrt scene from `files`. Names of other files are relative to the folder of `path`, even in included files,
/// as in pbrt.
///
/// # Errors
/// Returns all problems of the file, each with its line.
pub fn read_scene_from(
    files: &(impl Files + ?Sized),
    path: impl AsRef<Path>,
    options: &ReadOptions,
) -> Result<Scene, ReadError> {
    reader::Reader::new(&files, path.as_ref(), options).read()
}

/// The reader of pbrt scenes.
pub(crate) const READER: SceneReader = SceneReader {
    name: "pbrt",
    extensions: &["pbrt", ""],
    recognizes: directive::begins_a_scene,
    read: |files, path, options| read_scene_from(files, path, &options.scene),
};
