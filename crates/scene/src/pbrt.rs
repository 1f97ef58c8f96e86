//! Reads scenes in the format of pbrt-v4 [Pharr et al. 2023; pbrt-v4 input file format], and of pbrt-v3 and v2
//! [Pharr et al. 2016; 2010] as far as Dapple can render them.
//!
//! [`read_scene`] reads from disk, [`read_scene_from`] from any [`Files`]. Either gives the whole
//! [`Scene`] or every problem found, each with file and line; nothing is left out silently. What is read
//! otherwise than written (advice on samplers, unknown parameters, what [`ReadOptions::allow_unsupported`]
//! leaves out) is listed in [`Scene::notices`].
//!
//! A file is text: directives with their arguments. `tokens` cuts it up, `directive` reads one
//! directive at a time, `reader` carries them out one by one on a graphics state; the other modules hold
//! what each kind of directive means. A new directive is a line in `directive::FORMS` and an arm in
//! `Reader::execute`; a new shape, material, texture or light an arm in its module.
//!
//! Files of pbrt-v2 and pbrt-v3 are read by the rules of their version, which is derived from the directives of the
//! named file (not of those that it includes): see `version`. Names of materials, media and objects
//! may be made after their use, as in pbrt-v4, and are settled at the end (`late_names`).
//!
//! Colours are linear sRGB. A spectrum of a surface or a medium is seen under D65; one of a light counts, in
//! pbrt-v4, by its colour at luminance 1, as does a temperature, and `scale`, `power` or `illuminance` set
//! its brightness; in pbrt-v2 and v3 as it is. Named metals and glasses are what `spectra` lists. Cylinders,
//! parts of spheres and disks, curved bilinear patches and subdivision surfaces become triangles, with a
//! notice where that is not exact.
//!
//! A file that was cut off is noticed where something is then missing: a value, a bracket, an
//! `AttributeEnd`, the camera, all shapes, all lights, or the last line's end. A cut between two
//! directives that leaves a complete scene behind looks like a shorter scene.

mod colorimetry;
mod diagnostics;
mod directive;
mod environments;
mod images;
mod late_names;
mod lights;
mod materials;
mod media;
mod objects;
mod old_materials;
mod options;
mod params;
mod reader;
mod shapes;
mod spectra;
mod spectrum_files;
mod state;
mod subdivide;
mod tessellate;
mod textures;
mod tokens;
mod transforms;
mod version;

use crate::files::{Disk, Files};
use crate::readers::{AnyOptions, SceneReader, Unsized};
use crate::{ReadError, Scene};
use std::path::Path;

/// Options of the pbrt reader.
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct ReadOptions {
    /// Leaves unsupported features out with a notice, instead of an error:
    /// an unknown material becomes diffuse, an unknown texture grey, other objects are dropped.
    pub allow_unsupported: bool,
}

impl ReadOptions {
    /// Sets [`allow_unsupported`](Self::allow_unsupported).
    pub fn with_allow_unsupported(mut self, allow: bool) -> Self {
        self.allow_unsupported = allow;
        self
    }
}

/// Reads a scene from disk.
///
/// # Errors
/// All problems of the file, each with its line.
pub fn read_scene(path: impl AsRef<Path>, options: &ReadOptions) -> Result<Scene, ReadError> {
    read_scene_from(&Disk, path, options)
}

/// Reads a scene from `files`. Names of other files are relative to the folder of `path`, even in included files, as in
/// pbrt.
///
/// # Errors
/// All problems of the file, each with its line.
pub fn read_scene_from(
    files: &(impl Files + ?Sized),
    path: impl AsRef<Path>,
    options: &ReadOptions,
) -> Result<Scene, ReadError> {
    reader::Reader::new(&Unsized(files), path.as_ref(), options).read()
}

/// The reader of pbrt scenes.
#[derive(Clone, Copy, Debug, Default)]
pub struct PbrtReader;

impl SceneReader for PbrtReader {
    fn name(&self) -> &'static str {
        "pbrt"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["pbrt", ""]
    }

    fn read(&self, files: &dyn Files, path: &Path, options: &AnyOptions) -> Result<Scene, ReadError> {
        read_scene_from(files, path, &options.scene)
    }
}
