//! Shapes, objects made of shapes, instances of objects, and the media on both sides of shapes.

use super::{MaterialId, Scalar, Source, Texture, TextureId, texture_mean};
use glam::{DAffine3, DVec3};
use std::collections::HashMap;
use std::sync::Arc;

/// A shape: geometry, material, emission and media.
///
/// The shape emits on the side to which its geometric normal points. As in pbrt-v4, this normal follows from three rules:
/// * In the shape's own space, it is `(p1 - p0) x (p2 - p0)` for a triangle, outwards for a sphere, +z for a disk.
/// * The inverse transpose of the transform maps it to world space; mirroring does not reverse it. Then
///   [`reversed`](Self::reversed) negates it. The vertex normals of a mesh are mapped and negated likewise.
/// * In a mesh with vertex normals, a triangle's geometric normal is negated where it points away from the interpolated
///   vertex normal.
#[derive(Clone, Debug)]
pub struct Shape {
    /// Geometry in the shape's own space.
    pub geometry: Geometry,
    /// The transform from the shape's space to world space, or to the object's space for a shape of an [`Object`].
    pub to_world: DAffine3,
    /// The transform `to_world` at the end of the motion (see [`Scene::motion_times`](super::Scene::motion_times)); `None`
    /// if the shape does not move. Shapes of objects cannot move; instances can.
    pub moves_to: Option<DAffine3>,
    /// The index of the shape's material.
    pub material: MaterialId,
    /// The emitted light; `None` if the shape emits none.
    pub emission: Option<Emission>,
    /// Opacity from 0 (a hole) to 1; `None` is 1 everywhere.
    pub alpha: Option<Scalar>,
    /// The media on both sides of the surface; for `None`, both sides have the medium that surrounds the shape.
    pub media: Option<MediumInterface>,
    /// True if the file reversed the shape's orientation (`ReverseOrientation`).
    pub reversed: bool,
    /// File and line of the shape, for messages.
    pub source: Source,
}

impl Shape {
    /// Makes a shape that does not move, emits no light and is opaque.
    pub fn new(geometry: Geometry, to_world: DAffine3, material: MaterialId, source: Source) -> Self {
        let (moves_to, emission, alpha, media) = (None, None, None, None);
        Self { geometry, to_world, moves_to, material, emission, alpha, media, reversed: false, source }
    }
}

/// The geometry of a shape.
#[derive(Clone, Debug)]
pub enum Geometry {
    /// A triangle mesh.
    Mesh(Arc<MeshData>),
    /// A whole sphere around the origin.
    Sphere {
        /// The sphere's radius, in the shape's own space.
        radius: f64,
    },
    /// A whole disk (or ring) around the z axis, facing +z.
    Disk {
        /// The z coordinate of the disk.
        height: f64,
        /// The disk's outer radius.
        radius: f64,
        /// Radius of the hole in the disk; 0 for no hole.
        inner_radius: f64,
    },
}

impl Geometry {
    /// Returns a short name of the geometry, such as "sphere", for messages.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Mesh(_) => "mesh",
            Self::Sphere { .. } => "sphere",
            Self::Disk { .. } => "disk",
        }
    }
}

/// Index of an object in [`Scene::objects`](super::Scene::objects).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct ObjectId(pub u32);

/// A group of shapes that instances place in the world.
#[derive(Clone, Debug)]
pub struct Object {
    /// The object's name in the file.
    pub name: String,
    /// The object's shapes. None of them emits light.
    pub shapes: Vec<Shape>,
    /// File and line of the object, for messages.
    pub source: Source,
}

/// An instance: one placement of an object in the world.
#[derive(Clone, Debug)]
pub struct Instance {
    /// The index of the placed object.
    pub object: ObjectId,
    /// The transform from the object's space to world space.
    pub to_world: DAffine3,
    /// The transform `to_world` at the end of the motion (see [`Scene::motion_times`](super::Scene::motion_times)); `None`
    /// if the instance does not move.
    pub moves_to: Option<DAffine3>,
    /// File and line of the instance, for messages.
    pub source: Source,
}

impl MeshData {
    /// Checks that positions, normals, texture coordinates and colours are finite, and that all vertex indices exist.
    /// There must be as many normals as positions, or none, and likewise for texture coordinates and colours. Triangles of
    /// area 0 are allowed.
    ///
    /// # Errors
    /// Returns the first fault found.
    pub fn check(&self) -> Result<(), MeshFault> {
        let vertices = self.positions.len();
        self.check_positions()?;
        let counts =
            [("normals", self.normals.len()), ("texture coordinates", self.uvs.len()), ("colours", self.colors.len())];
        for (of, count) in counts {
            if count != 0 && count != vertices {
                let what = format!("there are {count} {of} for {vertices} vertices; use one per vertex, or none");
                return Err(MeshFault(what));
            }
        }
        let normal = self.normals.iter().position(|n| n.iter().any(|c| !c.is_finite())).map(|v| ("normal", v));
        let uv = || self.uvs.iter().position(|uv| uv.iter().any(|c| !c.is_finite()));
        let color = || self.colors.iter().position(|rgb| rgb.iter().any(|c| !c.is_finite()));
        let found = normal.or_else(|| Some(("texture coordinate", uv()?))).or_else(|| Some(("colour", color()?)));
        if let Some((of, vertex)) = found {
            return Err(MeshFault(format!("the {of} of vertex {vertex} is not finite; repair the mesh")));
        }
        let beyond = |corner: &u32| *corner as usize >= vertices;
        if let Some(at) = self.triangles.as_flattened().iter().position(beyond) {
            let (corner, last) = (self.triangles.as_flattened()[at], vertices.saturating_sub(1));
            let what = format!("triangle {} has vertex index {corner}", at / 3);
            return Err(MeshFault(what + &format!("; indices are whole numbers from 0 to {last}")));
        }
        if self.triangles.is_empty() { Err(MeshFault("the mesh has no triangles; remove it".into())) } else { Ok(()) }
    }

    /// Checks that positions are finite.
    pub(crate) fn check_positions(&self) -> Result<(), MeshFault> {
        match self.positions.iter().position(|p| !p.is_finite()) {
            Some(vertex) => Err(MeshFault(format!("the position of vertex {vertex} is not finite; repair the mesh"))),
            None => Ok(()),
        }
    }

    /// Sets colours that are NaN or infinite to white. Returns their number, `None` if there are none.
    pub(crate) fn mend_colors(&mut self) -> Option<usize> {
        let bad = self.colors.iter_mut().filter(|rgb| rgb.iter().any(|c| !c.is_finite()));
        let count = bad.map(|rgb| *rgb = [1.0; 3]).count();
        (count > 0).then_some(count)
    }

    /// Gives each triangle its own colour. Vertices between triangles of different colours are doubled.
    pub(crate) fn color_triangles(&mut self, colors: &[[f32; 3]]) {
        let bits = |color: [f32; 3]| color.map(f32::to_bits);
        let mut taken: Vec<Option<[u32; 3]>> = vec![None; self.positions.len()];
        let mut doubled: HashMap<(u32, [u32; 3]), u32> = HashMap::new();
        self.colors = vec![[1.0; 3]; self.positions.len()];
        for (triangle, &color) in self.triangles.iter_mut().zip(colors) {
            for corner in triangle {
                let old = *corner as usize;
                if *taken[old].get_or_insert(bits(color)) == bits(color) {
                    self.colors[old] = color;
                    continue;
                }
                *corner = *doubled.entry((*corner, bits(color))).or_insert_with(|| {
                    self.positions.push(self.positions[old]);
                    self.normals.extend(self.normals.get(old).copied());
                    self.uvs.extend(self.uvs.get(old).copied());
                    self.colors.push(color);
                    self.positions.len() as u32 - 1
                });
            }
        }
    }

    /// Sets normals that are NaN or infinite to 0, so that the geometric normal is used instead. Returns their number, `None`
    /// if there are none.
    pub(crate) fn mend_normals(&mut self) -> Option<usize> {
        let bad = self.normals.iter_mut().filter(|n| n.iter().any(|c| !c.is_finite()));
        let count = bad.map(|n| *n = [0.0; 3]).count();
        (count > 0).then_some(count)
    }
}

/// A fault of a mesh, with its remedy. Indices of vertices and triangles count from 0.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct MeshFault(String);

/// Indexed triangles. `normals`, `uvs` and `colors` are each empty or as long as `positions`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MeshData {
    /// Vertex positions in the shape's own space.
    pub positions: Vec<DVec3>,
    /// Shading normals, one vector of any length per vertex; empty if the mesh has none.
    pub normals: Vec<[f32; 3]>,
    /// Texture coordinates, one pair per vertex; empty if the mesh has none.
    pub uvs: Vec<[f32; 2]>,
    /// Colours, linear RGB, one per vertex; empty if the mesh has none. Only materials with the texture
    /// [`VertexColor`](super::TextureKind::VertexColor) show them.
    pub colors: Vec<[f32; 3]>,
    /// Three vertex indices per triangle.
    pub triangles: Vec<[u32; 3]>,
}

/// Diffuse emission of a shape: the same radiance in all directions of the emitting side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Emission {
    /// Radiance, linear RGB, with all scale and power factors applied.
    pub radiance: [f32; 3],
    /// True for emission from both sides, false for the side that the normal points to.
    pub two_sided: bool,
    /// A texture that multiplies the radiance at each point; `None` is 1 everywhere.
    pub texture: Option<TextureId>,
}

impl Emission {
    /// Makes an emission that is constant over the shape.
    pub fn even(radiance: [f32; 3], two_sided: bool) -> Self {
        Self { radiance, two_sided, texture: None }
    }

    /// Returns the emission with its texture replaced by the texture's mean.
    pub(crate) fn mean(self, textures: &[Texture]) -> Self {
        let mean = self.texture.map_or([1.0; 3], |id| texture_mean(textures, id));
        Self::even(std::array::from_fn(|c| self.radiance[c] * mean[c]), self.two_sided)
    }
}

/// Index of a medium in [`Scene::media`](super::Scene::media).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct MediumId(pub u32);

/// A homogeneous participating medium.
#[derive(Clone, Debug, PartialEq)]
pub struct Medium {
    /// The medium's name in the file.
    pub name: String,
    /// Absorption coefficient per unit of the file's world space, linear RGB.
    pub absorption: [f32; 3],
    /// Scattering coefficient per unit of the file's world space, linear RGB.
    pub scattering: [f32; 3],
    /// Asymmetry of the Henyey-Greenstein phase function, -1 to 1 (exclusive).
    pub g: f32,
    /// File and line of the medium, for messages.
    pub source: Source,
}

/// The media on both sides of a shape. A side that is `None` is vacuum.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MediumInterface {
    /// The medium on the side opposite to the normal.
    pub inside: Option<MediumId>,
    /// The medium on the side of the normal.
    pub outside: Option<MediumId>,
}
