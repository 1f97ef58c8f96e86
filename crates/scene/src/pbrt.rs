//! Reads scenes in the format of pbrt-v4 [Pharr et al. 2023; pbrt-v4 input file format], and of pbrt-v3 and v2 [Pharr
//! et al. 2016; 2010] as far as Dapple can render them.
//!
//! [`read_scene`] reads from disk, [`read_scene_from`] from any [`Files`]. Either returns the whole [`Scene`] or every
//! problem found, each with file and line; nothing is left out silently. Deviations from the file (ignored samplers,
//! unknown parameters, features left out by [`ReadOptions::allow_unsupported`]) are listed in [`Scene::notices`].
//!
//! A file is text: directives with their arguments. `tokens` splits the text, `directive` reads one directive at a
//! time, and `reader` executes each on a graphics state. The other modules interpret each kind of directive. A new
//! directive is a line in `directive::FORMS` and an arm in `Reader::execute`. A new shape, material, texture or light
//! is an arm in its module.
//!
//! Files of pbrt-v2 and pbrt-v3 are read by the rules of their version, which is derived from the directives of the
//! main file (not of included files): see `legacy`. Names of materials, media and objects may be defined after their
//! use, as in pbrt-v4: see `names`.
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

mod colorimetry;
mod diagnostics;
mod directive;
mod images;
mod legacy;
mod lights;
mod materials;
mod media;
mod names;
mod options;
mod params;
mod reader;
mod shapes;
mod spectra;
mod state;
mod subdivide;
mod tessellate;
mod textures;
mod tokens;
mod transforms;

use crate::files::{Disk, Files};
use crate::readers::{AnyOptions, SceneReader, Unsized};
use crate::{ReadError, Scene};
use std::path::Path;

/// Options of the pbrt reader.
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct ReadOptions {
    /// True to leave unsupported features out with a notice, false to report an error. An unknown material becomes
    /// diffuse, an unknown texture grey; other objects are dropped.
    pub allow_unsupported: bool,
    /// The memory in bytes that subdivision surfaces may take; `None` for some 300 MB. More is an error, before it is taken.
    pub memory: Option<u64>,
}

impl ReadOptions {
    /// Sets [`memory`](Self::memory), the bytes that subdivision surfaces may take.
    pub fn with_memory(mut self, bytes: Option<u64>) -> Self {
        self.memory = bytes;
        self
    }

    /// Sets [`allow_unsupported`](Self::allow_unsupported), which leaves unsupported features out with a notice.
    pub fn with_allow_unsupported(mut self, allow: bool) -> Self {
        self.allow_unsupported = allow;
        self
    }
}

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
    reader::Reader::new(&Unsized(files), path.as_ref(), options).read()
}

/// The [`SceneReader`] of pbrt scenes.
#[derive(Clone, Copy, Debug, Default)]
pub struct PbrtReader;

impl SceneReader for PbrtReader {
    fn name(&self) -> &'static str {
        "pbrt"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["pbrt", ""]
    }

    fn recognizes(&self, content: &[u8]) -> bool {
        directive::begins_a_scene(content)
    }

    fn read(&self, files: &dyn Files, path: &Path, options: &AnyOptions) -> Result<Scene, ReadError> {
        read_scene_from(files, path, &options.scene)
    }
}
