//! Reads scenes in the format of pbrt-v4 [Pharr et al. 2023; pbrt-v4 input file format], and of pbrt-v3 and v2
//! [Pharr et al. 2016; 2010] as far as what they say can be rendered.
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
//! Files of pbrt-v2 and pbrt-v3 are read by the rules of their version, which is told by the words of the
//! file that is named (not of those that it includes): see `version`. Names of materials, media and objects
//! may be made after their use, as in pbrt-v4, and are settled at the end (`settle`).
//!
//! Colours are linear sRGB. A spectrum of a surface or a medium is seen under D65; one of a light counts, in
//! pbrt-v4, by its colour at luminance 1, as does a temperature, and `scale`, `power` or `illuminance` say how
//! bright it is; in pbrt-v2 and v3 as it is. Named metals and glasses are what `spectra` lists. Cylinders,
//! parts of spheres and disks, curved bilinear patches and subdivision surfaces become triangles, with a
//! notice where that is not exact.
//!
//! A file that was cut off is noticed where something is then missing: a value, a bracket, an
//! `AttributeEnd`, the camera, all shapes, all lights, or the last line's end. A cut between two
//! directives that leaves a complete scene behind cannot be told from a shorter scene.

mod colorimetry;
mod directive;
mod environments;
mod images;
mod lights;
mod materials;
mod media;
mod objects;
mod old_materials;
mod options;
mod params;
mod reader;
mod report;
mod settle;
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

pub use report::{Problem, ReadError};

use crate::Scene;
use crate::files::{Disk, Files};
use std::path::Path;

/// How a scene is read.
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct ReadOptions {
    /// Whether what the renderer cannot do is left out and listed as a notice, rather than an error:
    /// an unknown material becomes diffuse, an unknown texture grey, other objects are dropped.
    pub allow_unsupported: bool,
}

impl ReadOptions {
    /// These options with [`allow_unsupported`](Self::allow_unsupported) as said.
    pub fn with_allow_unsupported(mut self, allow: bool) -> Self {
        self.allow_unsupported = allow;
        self
    }
}

/// Reads a scene from disk.
///
/// # Errors
/// Everything wrong with it.
pub fn read_scene(path: impl AsRef<Path>, options: &ReadOptions) -> Result<Scene, ReadError> {
    read_scene_from(&Disk, path, options)
}

/// Reads a scene from `files`. The names of other files are relative to the folder of `path`, wherever they
/// are mentioned, as in pbrt.
///
/// # Errors
/// Everything wrong with it.
pub fn read_scene_from(
    files: &(impl Files + ?Sized),
    path: impl AsRef<Path>,
    options: &ReadOptions,
) -> Result<Scene, ReadError> {
    // A wrapper makes a trait object of whatever `Files` is, sized or not.
    struct Any<'f, F: ?Sized>(&'f F);
    impl<F: Files + ?Sized> Files for Any<'_, F> {
        fn read(&self, path: &Path) -> std::io::Result<Vec<u8>> {
            self.0.read(path)
        }
    }
    reader::Reader::new(&Any(files), path.as_ref(), options).read()
}
