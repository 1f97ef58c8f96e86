//! A scene as its file describes it: plain data, nothing built, every object with its line.
//!
//! Readers make it, [`Effects::of`](crate::Effects) walks it once, and
//! [`World`](crate::World) builds what rays need from it.

mod camera;
mod light;
pub(crate) mod light_power;
mod material;
mod medium;
mod shape;
mod texture_mean;
mod without;

pub use camera::{Camera, FilmSettings, PixelFilter, Projection};
pub use light::{EnvironmentRadiance, Light, LightKind, SpotFalloff};
pub use material::{
    Coating, Color, ConductorFresnel, Material, MaterialId, MaterialKind, Roughness, SMOOTH_ALPHA, Scalar, Texture,
    TextureId, TextureKind, Wrap, effectively_smooth, roughness_to_alpha,
};
pub use medium::{Medium, MediumId, MediumInterface};
pub use shape::{Emission, Geometry, Instance, MeshData, MeshFault, Object, ObjectId, Shape};
pub use without::{Albedo, WithoutError};

use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;

/// A place in a file, for messages.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Source {
    /// The file, as it was named.
    pub file: Arc<PathBuf>,
    /// The line, from 1; 0 for the whole file, or for a scene made by a program.
    pub line: u32,
}

impl fmt::Display for Source {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.line {
            0 => write!(f, "{}", self.file.display()),
            line => write!(f, "{}:{line}", self.file.display()),
        }
    }
}

/// A deviation of the reader from the file, or a warning, with its place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Notice {
    /// File and line.
    pub source: Source,
    /// The kind of deviation.
    pub kind: NoticeKind,
    /// The message, one sentence.
    pub message: String,
}

/// The kind of a notice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum NoticeKind {
    /// The image may differ from the one that the file describes.
    Warning,
    /// A setting that Dapple leaves to its user, such as the sampler, was ignored.
    IgnoredSetting,
}

impl Notice {
    /// Makes a notice of kind [`NoticeKind::Warning`].
    pub fn warning(source: Source, message: impl Into<String>) -> Self {
        Self { source, kind: NoticeKind::Warning, message: message.into() }
    }
}

/// A scene: everything that its file describes. All lengths are the file's; transforms lead to its world space.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// The file's stem, or the bundled scene's name.
    pub name: String,
    /// The camera.
    pub camera: Camera,
    /// Resolution, window and pixel filter.
    pub film: FilmSettings,
    /// The largest number of scattering events on a path from camera to light, as in pbrt-v4; `None` is unlimited.
    pub max_depth: Option<u32>,
    /// Shapes placed directly in the world, in the file's order.
    pub shapes: Vec<Shape>,
    /// Groups of shapes that appear only through [`Scene::instances`].
    pub objects: Vec<Object>,
    /// Placed objects. Many instances share one object in memory.
    pub instances: Vec<Instance>,
    /// Materials, which shapes reference by index.
    pub materials: Vec<Material>,
    /// Textures, which materials reference by index.
    pub textures: Vec<Texture>,
    /// Lights that are not shapes.
    pub lights: Vec<Light>,
    /// Media, which shapes and the camera reference by index.
    pub media: Vec<Medium>,
    /// The times of the two poses `to_world` and `moves_to` of moving things, which rest before and after. `[0, 0]`
    /// means the same as `[0, 1]`.
    pub motion_times: [f64; 2],
    /// Deviations from the file (ignored settings) and warnings.
    pub notices: Vec<Notice>,
}
