//! A scene as its file describes it: plain data, nothing built, every object with its line.
//!
//! Readers make it, [`Effects::of`](crate::Effects) walks it once, and
//! [`World`](crate::World) builds what rays need from it.

use crate::image::Picture;
use glam::{DAffine3, DVec3};
use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;

/// Where in a file something was said.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Source {
    /// The file, as it was named.
    pub file: Arc<PathBuf>,
    /// The line, from 1; 0 where there is none (made by a program).
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

/// Something the reader did otherwise than the file says, or thinks worth saying.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Notice {
    /// Where.
    pub source: Source,
    /// What, as one sentence.
    pub message: String,
}

/// Everything a scene file says. All lengths are the file's; transforms lead to its world space.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// The file's stem, or the bundled scene's name.
    pub name: String,
    /// The camera.
    pub camera: Camera,
    /// Resolution, window and pixel filter.
    pub film: FilmSettings,
    /// Most scattering events between camera and light, as pbrt-v4 counts; `None` is unlimited.
    pub max_depth: Option<u32>,
    /// Shapes, in the file's order.
    pub shapes: Vec<Shape>,
    /// Materials; shapes refer to them by number.
    pub materials: Vec<Material>,
    /// Textures; materials refer to them by number.
    pub textures: Vec<Texture>,
    /// Lights that are no shapes.
    pub lights: Vec<Light>,
    /// What was read otherwise than written: advice not followed, warnings.
    pub notices: Vec<Notice>,
}

/// A perspective camera.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// From camera space (x right, y up, z forward, as pbrt has it) to world space. May mirror.
    pub to_world: DAffine3,
    /// Full angle of view along the shorter side of the frame, degrees.
    pub fov: f64,
    /// Width over height, where the file fixes it; else the resolution's.
    pub aspect: Option<f64>,
    /// Window on the screen plane (x0, x1, y0, y1), where the file fixes it.
    pub screen_window: Option<[f64; 4]>,
    /// Radius of the lens in units of camera space, as pbrt-v4 has it; 0 is a pinhole.
    pub lens_radius: f64,
    /// Distance of the plane in focus, in units of camera space.
    pub focal_distance: f64,
    /// Where the file says so.
    pub source: Source,
}

impl Default for Camera {
    fn default() -> Self {
        Self {
            to_world: DAffine3::IDENTITY,
            fov: 90.0,
            aspect: None,
            screen_window: None,
            lens_radius: 0.0,
            focal_distance: 1e6,
            source: Source::default(),
        }
    }
}

/// What the film section says.
#[derive(Clone, Debug, PartialEq)]
pub struct FilmSettings {
    /// Width and height in pixels.
    pub resolution: [u32; 2],
    /// Window in pixels: x0, y0, x1, y1.
    pub crop: Option<[u32; 4]>,
    /// The pixel filter; importance-sampled, so each sample still belongs to one pixel.
    pub pixel_filter: PixelFilter,
    /// The file name that the scene suggests for its picture.
    pub file_name: Option<String>,
    /// Samples per pixel that the scene suggests.
    pub spp: Option<u32>,
}

impl Default for FilmSettings {
    fn default() -> Self {
        Self { resolution: [1280, 720], crop: None, pixel_filter: PixelFilter::default(), file_name: None, spp: None }
    }
}

/// The shape of a pixel, radii in pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PixelFilter {
    /// Constant over `2 rx x 2 ry`.
    Box {
        /// Half width and half height.
        radius: [f64; 2],
    },
    /// A tent.
    Triangle {
        /// Half width and half height.
        radius: [f64; 2],
    },
    /// A Gaussian, shifted to be 0 at the radius.
    Gaussian {
        /// Half width and half height.
        radius: [f64; 2],
        /// Standard deviation.
        sigma: f64,
    },
}

impl Default for PixelFilter {
    fn default() -> Self {
        Self::Box { radius: [0.5, 0.5] }
    }
}

/// One shape with what it is made of.
///
/// Its geometric normal, which tells the side that shines, is as in pbrt-v4:
/// * In the shape's own space: `(p1 - p0) x (p2 - p0)` of a triangle, outwards of a sphere, +z of a disk.
/// * It is brought to world space as a normal (by the inverse transpose), so that a transform that mirrors
///   does not turn it around; then it is negated if [`reversed`](Self::reversed).
/// * Where a mesh has normals, they are transformed and negated the same way, and a triangle's geometric
///   normal is negated where it points away from their interpolation: shading normals decide on the side.
#[derive(Clone, Debug)]
pub struct Shape {
    /// Its geometry, in its own space.
    pub geometry: Geometry,
    /// From its space to world space.
    pub to_world: DAffine3,
    /// Its material.
    pub material: MaterialId,
    /// The light it gives off.
    pub emission: Option<Emission>,
    /// Whether the file turned its orientation around (`ReverseOrientation`).
    pub reversed: bool,
    /// Where the file says so.
    pub source: Source,
}

/// The geometry of a shape.
#[derive(Clone, Debug)]
pub enum Geometry {
    /// Triangles.
    Mesh(Arc<MeshData>),
    /// A whole sphere around the origin.
    Sphere {
        /// Its radius.
        radius: f64,
    },
    /// A whole disk (or ring) around the z axis, facing +z.
    Disk {
        /// Its z.
        height: f64,
        /// Outer radius.
        radius: f64,
        /// Radius of the hole; 0 for none.
        inner_radius: f64,
    },
}

impl MeshData {
    /// Whether positions, normals and texture coordinates are finite and as many as they should be, and
    /// all corners exist. Triangles without area are no fault.
    ///
    /// # Errors
    /// The first fault found.
    pub fn check(&self) -> Result<(), MeshFault> {
        let vertices = self.positions.len();
        if let Some(vertex) = self.positions.iter().position(|p| !p.is_finite()) {
            return Err(MeshFault::Position { vertex });
        }
        for (of, count) in [("normals", self.normals.len()), ("texture coordinates", self.uvs.len())] {
            if count != 0 && count != vertices {
                return Err(MeshFault::Count { of, count, vertices });
            }
        }
        if let Some(vertex) = self.normals.iter().position(|n| n.iter().any(|c| !c.is_finite())) {
            return Err(MeshFault::Attribute { of: "normal", vertex });
        }
        if let Some(vertex) = self.uvs.iter().position(|uv| uv.iter().any(|c| !c.is_finite())) {
            return Err(MeshFault::Attribute { of: "texture coordinate", vertex });
        }
        let beyond = |corner: &&u32| **corner as usize >= vertices;
        for (triangle, corners) in self.triangles.iter().enumerate() {
            if let Some(&corner) = corners.iter().find(beyond) {
                return Err(MeshFault::Corner { triangle, corner, vertices });
            }
        }
        if self.triangles.is_empty() { Err(MeshFault::Empty) } else { Ok(()) }
    }
}

/// What is wrong with a mesh. Vertices and triangles count from 0.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum MeshFault {
    /// There is nothing to see.
    #[error("the mesh has no triangles: remove it")]
    Empty,
    /// A vertex is nowhere.
    #[error("the position of vertex {vertex} is not finite: mend the mesh")]
    Position {
        /// Which.
        vertex: usize,
    },
    /// A normal or texture coordinate is NaN or infinite, in single precision.
    #[error("the {of} of vertex {vertex} is not finite: mend the mesh")]
    Attribute {
        /// What.
        of: &'static str,
        /// Whose.
        vertex: usize,
    },
    /// Not one per vertex.
    #[error("there are {count} {of} for {vertices} vertices: give one for each, or none")]
    Count {
        /// Of what.
        of: &'static str,
        /// How many there are.
        count: usize,
        /// How many there should be.
        vertices: usize,
    },
    /// A corner that is no vertex.
    #[error("triangle {triangle} has corner {corner}: corners are whole numbers from 0 to {}", vertices.saturating_sub(1))]
    Corner {
        /// Whose.
        triangle: usize,
        /// Which.
        corner: u32,
        /// How many there are.
        vertices: usize,
    },
}

/// Indexed triangles. `normals` and `uvs` are empty or as long as `positions`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MeshData {
    /// Corners.
    pub positions: Vec<DVec3>,
    /// Shading normals, one per corner; need not be unit length.
    pub normals: Vec<[f32; 3]>,
    /// Texture coordinates, one per corner.
    pub uvs: Vec<[f32; 2]>,
    /// Three corner numbers a triangle.
    pub triangles: Vec<[u32; 3]>,
}

/// Diffuse emission of a shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Emission {
    /// Radiance, linear RGB, every scale and power factor multiplied in.
    pub radiance: [f32; 3],
    /// Whether it shines from both sides; else from the side its normal points to.
    pub two_sided: bool,
}

/// Number of a material in [`Scene::materials`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct MaterialId(pub u32);

/// Number of a texture in [`Scene::textures`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct TextureId(pub u32);

/// A named or anonymous material.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Its name, or a made-up one.
    pub name: String,
    /// What it does.
    pub kind: MaterialKind,
    /// Where the file says so.
    pub source: Source,
}

/// What a material does. Parameters as pbrt-v4 has them.
#[derive(Clone, Debug, PartialEq)]
pub enum MaterialKind {
    /// Lambert.
    Diffuse {
        /// Share of light reflected.
        reflectance: Color,
    },
    /// A metal, smooth or rough (Trowbridge-Reitz).
    Conductor {
        /// Its index of refraction.
        fresnel: ConductorFresnel,
        /// Its microfacets.
        roughness: Roughness,
    },
    /// A dielectric coat over a diffuse base.
    CoatedDiffuse {
        /// The base's reflectance.
        reflectance: Color,
        /// The coat's microfacets.
        roughness: Roughness,
        /// The coat's index of refraction.
        eta: f32,
        /// The coat's thickness.
        thickness: f32,
        /// Scattering albedo within the coat.
        albedo: Color,
        /// Henyey-Greenstein asymmetry within the coat.
        g: f32,
        /// Most events of the walk between the layers.
        max_depth: u32,
        /// Walks per evaluation.
        samples: u32,
    },
}

/// How a metal's Fresnel term is given.
#[derive(Clone, Debug, PartialEq)]
pub enum ConductorFresnel {
    /// Complex index of refraction, per channel.
    EtaK {
        /// Real part.
        eta: [f32; 3],
        /// Imaginary part.
        k: [f32; 3],
    },
    /// The reflectance at normal incidence, `eta` being 1.
    Reflectance(Color),
}

/// Microfacet roughness along the two tangents.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Roughness {
    /// Along u.
    pub u: f32,
    /// Along v.
    pub v: f32,
    /// Whether `alpha = sqrt(roughness)`; else `alpha = roughness`.
    pub remap: bool,
}

/// A colour: constant, or looked up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Color {
    /// Linear RGB.
    Constant([f32; 3]),
    /// A texture.
    Texture(TextureId),
}

/// A texture with its name and line.
#[derive(Clone, Debug)]
pub struct Texture {
    /// Its name.
    pub name: String,
    /// What it does.
    pub kind: TextureKind,
    /// Where the file says so.
    pub source: Source,
}

/// What a texture does.
#[derive(Clone, Debug)]
pub enum TextureKind {
    /// Squares in texture space.
    Checkerboard {
        /// u and v are scaled by this, then shifted.
        scale: [f32; 2],
        /// Shift of u and v.
        shift: [f32; 2],
        /// Where `floor(u) + floor(v)` is even, and where it is odd.
        colors: [Color; 2],
    },
    /// A picture, repeated, bilinear. `v = 0` is its bottom edge, `u = 0` its left one.
    Image {
        /// Decoded to linear RGB, top row first.
        picture: Arc<Picture>,
        /// u and v are scaled by this, then shifted.
        scale: [f32; 2],
        /// Shift of u and v.
        shift: [f32; 2],
        /// Every value is multiplied by this.
        factor: f32,
        /// Whether every value is then subtracted from 1; what falls below 0 becomes 0.
        invert: bool,
    },
}

/// A light that is no shape.
#[derive(Clone, Debug)]
pub struct Light {
    /// What it is.
    pub kind: LightKind,
    /// From its space to world space.
    pub to_world: DAffine3,
    /// Where the file says so.
    pub source: Source,
}

/// What a light is.
#[derive(Clone, Debug)]
pub enum LightKind {
    /// Radiance from everywhere beyond the scene.
    Infinite {
        /// What it looks like.
        radiance: EnvironmentRadiance,
    },
}

/// What an environment looks like.
#[derive(Clone, Debug)]
pub enum EnvironmentRadiance {
    /// The same in all directions, linear RGB.
    Constant([f32; 3]),
    /// A latitude-longitude picture: with `u = (column + .5) / width`, `v = (row + .5) / height`, row 0
    /// on top, `theta = pi v`, `phi = 2 pi u`, the direction in the light's frame is
    /// `(sin theta cos phi, sin theta sin phi, cos theta)`.
    LatLong {
        /// Linear RGB, top row first.
        picture: Arc<Picture>,
        /// Every value is multiplied by this.
        scale: f32,
    },
}
