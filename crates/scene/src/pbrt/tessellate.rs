//! Triangulation of round shapes and bilinear patches, which the scene description lacks.

use crate::MeshData;
use glam::DVec3;
use std::f64::consts::TAU;

/// Number of steps around a full turn. The triangles deviate from the shape by less than 1e-4 of the radius.
const AROUND: u32 = 256;
/// Number of steps from pole to pole of a sphere.
const ALONG: u32 = 128;

/// A part of a sphere, cylinder or disk around the z axis. `sweep` is the covered angle in degrees.
#[derive(Clone, Copy, Debug)]
pub(super) enum Round {
    Sphere { radius: f64, low: f64, high: f64, sweep: f64 },
    Cylinder { radius: f64, low: f64, high: f64, sweep: f64 },
    Disk { height: f64, radius: f64, inner_radius: f64, sweep: f64 },
}

impl Round {
    fn sweep(&self) -> f64 {
        let (Self::Sphere { sweep, .. } | Self::Cylinder { sweep, .. } | Self::Disk { sweep, .. }) = *self;
        sweep.clamp(0.0, 360.0) / 360.0
    }

    /// Returns the position and the normal at the texture coordinates (u, v), parametrised as in pbrt.
    fn at(&self, u: f64, v: f64) -> (DVec3, DVec3) {
        let (sin, cos) = (u * self.sweep() * TAU).sin_cos();
        match *self {
            Self::Sphere { radius, low, high, .. } => {
                let polar = |z: f64| (z / radius).clamp(-1.0, 1.0).acos();
                let (sin_theta, cos_theta) = (polar(low) + (polar(high) - polar(low)) * v).sin_cos();
                let normal = DVec3::new(sin_theta * cos, sin_theta * sin, cos_theta);
                (normal * radius, normal)
            }
            Self::Cylinder { radius, low, high, .. } => {
                (DVec3::new(radius * cos, radius * sin, low + (high - low) * v), DVec3::new(cos, sin, 0.0))
            }
            Self::Disk { height, radius, inner_radius, .. } => {
                let r = radius + (inner_radius - radius) * v;
                (DVec3::new(r * cos, r * sin, height), DVec3::Z)
            }
        }
    }

    /// Returns the triangle mesh of the shape.
    pub(super) fn mesh(&self) -> MeshData {
        let around = ((f64::from(AROUND) * self.sweep()).ceil() as u32).max(4);
        let along = if matches!(self, Self::Sphere { .. }) { ALONG } else { 1 };
        let mut mesh = MeshData::default();
        for row in 0..=along {
            for column in 0..=around {
                let (u, v) = (f64::from(column) / f64::from(around), f64::from(row) / f64::from(along));
                let (position, normal) = self.at(u, v);
                mesh.positions.push(position);
                mesh.normals.push(normal.as_vec3().to_array());
                mesh.uvs.push([u as f32, v as f32]);
            }
        }
        grid_triangles(&mut mesh, 0, around, along);
        mesh
    }
}

/// Appends the triangles of a grid of `columns x rows` cells whose vertices start at `first`, row by row. The winding
/// is counter-clockwise with u to the right and v upwards.
pub(super) fn grid_triangles(mesh: &mut MeshData, first: u32, columns: u32, rows: u32) {
    let corner = |column: u32, row: u32| first + row * (columns + 1) + column;
    for row in 0..rows {
        for column in 0..columns {
            let [a, b] = [corner(column, row), corner(column + 1, row)];
            let [c, d] = [corner(column + 1, row + 1), corner(column, row + 1)];
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
}

/// Bilinear patches with shared vertices. Each patch has four vertex indices in the order (0,0), (1,0), (0,1), (1,1) of
/// (u, v).
pub(super) struct Patches {
    pub(super) positions: Vec<DVec3>,
    /// Normals, one per position; may be empty.
    pub(super) normals: Vec<[f32; 3]>,
    /// Texture coordinates, one per position; may be empty.
    pub(super) uvs: Vec<[f32; 2]>,
    pub(super) corners: Vec<[u32; 4]>,
}

/// The largest number of cells along each side of a curved patch. Scenes with many patches use fewer cells.
const PATCH_CELLS: u32 = 16;
/// The approximate limit on triangles of all curved patches of a shape together. As each patch has at least 8
/// triangles, more than `PATCH_TRIANGLES / 8` patches exceed it.
const PATCH_TRIANGLES: u32 = 1 << 19;

impl Patches {
    /// Returns the triangle mesh, and the number of curved patches. A flat patch (a parallelogram) has exactly two
    /// triangles.
    pub(super) fn mesh(&self) -> (MeshData, usize) {
        let curved = self.corners.iter().filter(|c| !self.is_flat(c)).count();
        let cells = ((PATCH_TRIANGLES / 2) as f64 / curved.max(1) as f64).sqrt() as u32;
        let cells = cells.clamp(2, PATCH_CELLS);
        let smooth = curved > 0 || !self.normals.is_empty();
        let mut mesh = MeshData::default();
        for corners in &self.corners {
            let cells = if self.is_flat(corners) { 1 } else { cells };
            let first = mesh.positions.len() as u32;
            for row in 0..=cells {
                for column in 0..=cells {
                    let at = [column, row].map(|i| f64::from(i) / f64::from(cells));
                    self.push_corner(&mut mesh, corners, at, smooth);
                }
            }
            grid_triangles(&mut mesh, first, cells, cells);
        }
        (mesh, curved)
    }

    fn push_corner(&self, mesh: &mut MeshData, corners: &[u32; 4], [u, v]: [f64; 2], smooth: bool) {
        let p = corners.map(|c| self.positions[c as usize]);
        mesh.positions.push(p[0].lerp(p[1], u).lerp(p[2].lerp(p[3], u), v));
        let blend = |value: [f32; 4]| {
            let [a, b, c, d] = value.map(f64::from);
            let low = a + (b - a) * u;
            (low + (c + (d - c) * u - low) * v) as f32
        };
        if !self.normals.is_empty() {
            let n = corners.map(|c| self.normals[c as usize]);
            mesh.normals.push(std::array::from_fn(|i| blend(n.map(|n| n[i]))));
        } else if smooth {
            let along_u = (p[1] - p[0]).lerp(p[3] - p[2], v);
            let along_v = (p[2] - p[0]).lerp(p[3] - p[1], u);
            // Normalized in double precision, since squares of tiny lengths underflow in single precision.
            let normal = along_u.cross(along_v);
            mesh.normals.push(normal.normalize_or_zero().as_vec3().to_array());
        }
        mesh.uvs.push(if self.uvs.is_empty() {
            [u as f32, v as f32]
        } else {
            let uv = corners.map(|c| self.uvs[c as usize]);
            std::array::from_fn(|i| blend(uv.map(|t| t[i])))
        });
    }

    /// Returns true if a patch and its texture coordinates and normals form parallelograms, so that two triangles
    /// represent it exactly.
    fn is_flat(&self, corners: &[u32; 4]) -> bool {
        let p = corners.map(|c| self.positions[c as usize]);
        let size = (p[3] - p[0]).abs().max((p[1] - p[2]).abs()).max_element();
        // The distance from a parallelogram, which is compared with the rounding of single precision.
        let off = (p[0] + p[3] - p[1] - p[2]).abs().max_element();
        let straight = |value: [f32; 4]| (value[0] + value[3] - value[1] - value[2]).abs() <= 1e-5;
        let uv = corners.map(|c| self.uvs.get(c as usize).copied().unwrap_or_default());
        let n = corners.map(|c| self.normals.get(c as usize).copied().unwrap_or_default());
        off <= 1e-6 * size && (0..2).all(|i| straight(uv.map(|t| t[i]))) && (0..3).all(|i| straight(n.map(|n| n[i])))
    }
}
