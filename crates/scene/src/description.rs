//! A scene description: plain data as read from a scene file, every object with its file and line.
//!
//! Readers create it, and [`Effects::of`](crate::Effects::of) reports the effects that it uses. A renderer derives its own
//! data for ray tracing from it.

mod camera;
mod light;
mod material;
mod shape;
mod texture;

pub use camera::{Camera, FilmSettings, PixelFilter, Projection};
pub use light::{EnvironmentRadiance, Light, LightKind, SpotFalloff};
pub use material::{
    ClearCoat, Coating, ConductorFresnel, Material, MaterialId, MaterialKind, Roughness, SMOOTH_ALPHA,
    effectively_smooth, roughness_to_alpha,
};
pub(crate) use material::{Lobe, Parameter};
pub use shape::{
    Emission, Geometry, Instance, Medium, MediumId, MediumInterface, MeshData, MeshFault, Object, ObjectId, Shape,
};
pub(crate) use texture::texture_mean;
pub use texture::{Color, Scalar, Texture, TextureId, TextureKind, Wrap};

use glam::DAffine3;
use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;

/// The file and line of an object, for messages.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Source {
    /// The path by which the file was opened.
    pub file: Arc<PathBuf>,
    /// The line, from 1; 0 stands for the whole file, or for a scene made by a program.
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

/// A message from a scene reader: a warning, or a note about an ignored setting.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Notice {
    /// The file and line that the message is about.
    pub source: Source,
    /// The kind of message: warning or ignored setting.
    pub kind: NoticeKind,
    /// The message, one sentence.
    pub message: String,
}

/// The kind of a [`Notice`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum NoticeKind {
    /// A warning: the image may differ from the one that the file describes.
    Warning,
    /// A setting of the file that is ignored, such as the sampler, since the user of Dapple chooses it.
    IgnoredSetting,
}

impl Notice {
    /// Makes a notice of kind [`NoticeKind::Warning`].
    pub fn warning(source: Source, message: impl Into<String>) -> Self {
        Self { source, kind: NoticeKind::Warning, message: message.into() }
    }
}

/// A scene as its file describes it. Lengths are in the file's units; transforms map to the file's world space.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// The file name without its extension, or the name of a bundled scene.
    pub name: String,
    /// The camera: its pose, projection, lens and shutter.
    pub camera: Camera,
    /// Resolution, crop window and pixel filter.
    pub film: FilmSettings,
    /// The largest number of scattering events on a path from camera to light, as in pbrt-v4; `None` is unlimited.
    pub max_depth: Option<u32>,
    /// Shapes placed directly in the world, in the file's order.
    pub shapes: Vec<Shape>,
    /// Groups of shapes that appear only through [`Scene::instances`].
    pub objects: Vec<Object>,
    /// Placed copies of [`Scene::objects`]. Instances of the same object share its memory.
    pub instances: Vec<Instance>,
    /// Materials, which shapes reference by index.
    pub materials: Vec<Material>,
    /// Textures, which materials reference by index.
    pub textures: Vec<Texture>,
    /// Lights that are not shapes: points, spots, distant lights and environments.
    pub lights: Vec<Light>,
    /// Media, which shapes and the camera reference by index.
    pub media: Vec<Medium>,
    /// The start and the end of all motion. A moving object has the pose `to_world` until the start, and `moves_to` from the
    /// end on. Equal times mean `[0, 1]`.
    pub motion_times: [f64; 2],
    /// Messages of the reader: warnings and ignored settings.
    pub notices: Vec<Notice>,
}

impl Scene {
    /// The times at which motion starts and ends: [`motion_times`](Self::motion_times), or `[0, 1]` if both are equal.
    pub fn motion(&self) -> [f64; 2] {
        match self.motion_times {
            [first, second] if first == second => [0.0, 1.0],
            times => times,
        }
    }

    /// Adds a material; returns its index.
    pub fn add_material(&mut self, material: Material) -> MaterialId {
        self.materials.push(material);
        MaterialId(self.materials.len() as u32 - 1)
    }

    /// Adds a texture; returns its index.
    pub fn add_texture(&mut self, name: impl Into<String>, kind: TextureKind, source: &Source) -> TextureId {
        self.textures.push(Texture { name: name.into(), kind, source: source.clone() });
        TextureId(self.textures.len() as u32 - 1)
    }

    /// Adds a texture, the product of `color` and a mesh's vertex colours, and returns it as a colour.
    pub(crate) fn vertex_color(&mut self, color: Color, source: &Source) -> Color {
        let vertex = self.add_texture("vertex colours", TextureKind::VertexColor, source);
        if color == Color::Constant([1.0; 3]) {
            return Color::Texture(vertex);
        }
        let kind = TextureKind::Product { factors: [color, Color::Texture(vertex)] };
        Color::Texture(self.add_texture("product", kind, source))
    }

    /// Returns every shape placed in the world, directly or by an instance, and its transform to world space at the start of
    /// motion.
    pub(crate) fn placed(&self) -> impl Iterator<Item = (&Shape, DAffine3)> {
        let of_instance = |instance: &'_ Instance| {
            let (object, to_world) = (self.objects.get(instance.object.0 as usize), instance.to_world);
            object.into_iter().flat_map(|o| &o.shapes).map(move |shape| (shape, to_world * shape.to_world))
        };
        self.shapes.iter().map(|shape| (shape, shape.to_world)).chain(self.instances.iter().flat_map(of_instance))
    }

    /// Returns all shapes; the shapes of objects come first.
    pub(crate) fn shapes_mut(&mut self) -> impl Iterator<Item = &mut Shape> {
        self.objects.iter_mut().flat_map(|object| &mut object.shapes).chain(&mut self.shapes)
    }

    /// Adds a notice of kind [`NoticeKind::Warning`].
    pub fn warn(&mut self, source: &Source, message: impl Into<String>) {
        self.notices.push(Notice::warning(source.clone(), message));
    }
}
