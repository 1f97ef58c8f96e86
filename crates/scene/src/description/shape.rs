//! Shapes, objects made of them, and instances of objects.

use super::{MaterialId, MediumInterface, Scalar, Source};
use glam::{DAffine3, DVec3};
use std::sync::Arc;

/// A shape: geometry, material, emission and media.
///
/// The shape emits on the side of its geometric normal, which follows pbrt-v4:
/// * In the shape's own space it is `(p1 - p0) x (p2 - p0)` for a triangle, outwards for a sphere, +z for a disk.
/// * The inverse transpose of the transform brings it to world space, so that a mirroring transform does not reverse
///   it. Then it is negated if [`reversed`](Self::reversed).
/// * Normals of a mesh are transformed and negated in the same way. A triangle's geometric normal is negated if it
///   points away from the interpolated mesh normal, so that shading normals select the side.
#[derive(Clone, Debug)]
pub struct Shape {
    /// Geometry in the shape's own space.
    pub geometry: Geometry,
    /// The transform from the shape's space to world space, or to the object's space for a shape of an [`Object`].
    pub to_world: DAffine3,
    /// The transform `to_world` at the second of [`Scene::motion_times`](super::Scene::motion_times); `None` if the
    /// shape does not move. Shapes of objects cannot move; instances can.
    pub moves_to: Option<DAffine3>,
    /// The index of the shape's material.
    pub material: MaterialId,
    /// The emitted light; `None` if the shape emits none.
    pub emission: Option<Emission>,
    /// Opacity from 0 (a hole) to 1; `None` is 1 everywhere.
    pub alpha: Option<Scalar>,
    /// The media on both sides of the surface; `None` keeps the medium that surrounds the shape.
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
    /// The transform `to_world` at the second of [`Scene::motion_times`](super::Scene::motion_times); `None` if the
    /// instance does not move.
    pub moves_to: Option<DAffine3>,
    /// File and line of the instance, for messages.
    pub source: Source,
}

impl MeshData {
    /// Checks that positions, normals and texture coordinates are finite, and that all vertex indices exist. There must
    /// be as many normals as positions, or none, and likewise for texture coordinates. Triangles of area 0 are allowed.
    ///
    /// # Errors
    /// Returns the first fault found.
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

    /// Sets normals that are NaN or infinite to 0, so that the geometric normal stands for them. Returns their number,
    /// `None` if there are none.
    pub(crate) fn mend_normals(&mut self) -> Option<usize> {
        let count = self.normals.iter().filter(|n| n.iter().any(|c| !c.is_finite())).count();
        if count > 0 {
            self.normals.iter_mut().filter(|n| n.iter().any(|c| !c.is_finite())).for_each(|n| *n = [0.0; 3]);
        }
        (count > 0).then_some(count)
    }

    /// The mesh of some of its triangles, with the vertices that these use.
    pub(crate) fn part(&self, mut triangles: Vec<[u32; 3]>) -> Self {
        let mut place = vec![u32::MAX; self.positions.len()];
        let mut part = Self::default();
        for corner in triangles.iter_mut().flatten() {
            let old = *corner as usize;
            if place[old] == u32::MAX {
                place[old] = part.positions.len() as u32;
                part.positions.push(self.positions[old]);
                part.normals.extend(self.normals.get(old));
                part.uvs.extend(self.uvs.get(old));
            }
            *corner = place[old];
        }
        part.triangles = triangles;
        part
    }
}

/// A fault of a mesh. Indices of vertices and triangles count from 0.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum MeshFault {
    /// The mesh has no triangles.
    #[error("the mesh has no triangles; remove it")]
    Empty,
    /// A position is NaN or infinite.
    #[error("the position of vertex {vertex} is not finite; mend the mesh")]
    Position {
        /// Index of the vertex.
        vertex: usize,
    },
    /// A normal or texture coordinate is NaN or infinite in single precision.
    #[error("the {of} of vertex {vertex} is not finite; mend the mesh")]
    Attribute {
        /// Name of the attribute: normal or texture coordinate.
        of: &'static str,
        /// Index of the vertex.
        vertex: usize,
    },
    /// The number of normals or texture coordinates differs from the number of vertices.
    #[error("there are {count} {of} for {vertices} vertices; give one for each, or none")]
    Count {
        /// Name of the attribute: normals or texture coordinates.
        of: &'static str,
        /// Number of values of the attribute.
        count: usize,
        /// Number of vertices.
        vertices: usize,
    },
    /// A triangle refers to a vertex that does not exist.
    #[error("triangle {triangle} has vertex index {corner}; indices are whole numbers from 0 to {}", vertices.saturating_sub(1))]
    Corner {
        /// Index of the triangle.
        triangle: usize,
        /// The index of the missing vertex.
        corner: u32,
        /// Number of vertices.
        vertices: usize,
    },
}

/// Indexed triangles. `normals` and `uvs` are each empty or as long as `positions`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MeshData {
    /// Vertex positions in the shape's own space.
    pub positions: Vec<DVec3>,
    /// Shading normals of any length, one per vertex; empty if the mesh has none.
    pub normals: Vec<[f32; 3]>,
    /// Texture coordinates, one pair per vertex; empty if the mesh has none.
    pub uvs: Vec<[f32; 2]>,
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
}
