//! Tangents of surfaces, and shading normals tilted by bump maps and normal maps.

use super::{Interaction, World};
use crate::material::{NormalVariation, Surface};
use crate::shading::ShadingFrame;
use dapple_geometry::{Mesh, Shape};
use glam::Vec3;

/// The step in u and v at which a bump map's slope is measured: pbrt-v4's default without a known footprint [Pharr et al.
/// 2023, sec. 10.5.3].
const STEP: f32 = 5e-4;

impl World {
    /// Returns the derivatives of a hit point's position with respect to u and v. Both are zero if the texture
    /// coordinates are degenerate.
    pub(super) fn derivatives(&self, at: &Interaction<'_>) -> [Vec3; 2] {
        let shape = self.geometry.shape(at.hit.shape);
        let (to_world, position) = (self.geometry.to_world(at.hit.shape, at.time), at.point.position);
        // The hit point in the space of the instance's object.
        let local = || to_world.map_or(position, |map| map.inverse().transform_point3(position.as_dvec3()).as_vec3());
        let derivatives = match shape {
            Shape::Sphere(sphere) => sphere.derivatives(local()),
            Shape::Disk(disk) => disk.derivatives(local()),
            Shape::Mesh(mesh) => triangle_derivatives(at, mesh, mesh.corners(at.hit.primitive)),
            Shape::Moving(mesh) => triangle_derivatives(at, mesh.start(), mesh.corners(at.hit.primitive, at.time)),
        };
        derivatives.map(|d| to_world.map_or(d, |map| (map.matrix3 * d.as_dvec3()).as_vec3()))
    }

    /// Returns the shading frame of a hit whose material has a normal map or a bump map. If it has both, the normal map is
    /// used.
    ///
    /// The frame's z axis is on the side of the geometric normal.
    #[inline(never)]
    pub(super) fn bumped_frame(&self, at: &Interaction<'_>, surface: &Surface) -> ShadingFrame {
        let [along_u, along_v] = self.derivatives(at);
        let level = ShadingFrame::from_shading_normal(at.shading_normal, at.point.normal, Some(along_u));
        let uv = self.uv(at);
        let tilted = match surface.normal_variation {
            NormalVariation { normal_map: Some(image), .. } => {
                level.to_world(2.0 * self.textures.look_up(image, uv) - Vec3::ONE)
            }
            NormalVariation { bump: Some(height), .. } => {
                let height = |u: f32, v: f32| self.textures.look_up(height, [u, v]).x;
                let here = height(uv[0], uv[1]);
                let scale = self.space.scale() as f32 / STEP;
                let rise = [height(uv[0] + STEP, uv[1]) - here, height(uv[0], uv[1] + STEP) - here].map(|h| h * scale);
                tilt(level.normal, [along_u, along_v], rise)
            }
            NormalVariation { .. } => return level,
        };
        ShadingFrame::from_shading_normal(tilted, at.point.normal, Some(along_u))
    }
}

/// Returns the normal of a surface with unit normal `n` that a height displaces along `n`. `derivatives` are the derivatives of
/// the position with respect to u and v, and `rise` the derivatives of the height. The result is `(p_u + h_u n) x (p_v + h_v
/// n)`, on the side of `n` [Pharr et al. 2023, eq. 10.16, for a height of 0].
fn tilt(n: Vec3, derivatives: [Vec3; 2], rise: [f32; 2]) -> Vec3 {
    // Vertex normals are not perpendicular to their triangle, so only the derivatives' parts perpendicular to `n`
    // count.
    let [p_u, p_v] = derivatives.map(|p| p - n * n.dot(p));
    let level = p_u.cross(p_v);
    let side = if level.dot(n) < 0.0 { -1.0 } else { 1.0 };
    let tilted = level + rise[0] * n.cross(p_v) + rise[1] * p_u.cross(n);
    let largest = tilted.abs().max_element();
    // Without derivatives with respect to u and v, the slope is unknown.
    if largest > 0.0 && largest.is_finite() { side / largest * tilted } else { n }
}

/// Returns the derivatives of a position on a triangle with respect to u and v. Both are zero if the texture
/// coordinates are degenerate.
fn triangle_derivatives(at: &Interaction<'_>, mesh: &Mesh, [p0, p1, p2]: [Vec3; 3]) -> [Vec3; 2] {
    let [t0, t1, t2] = match at.part.uvs.is_empty() {
        true => [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]],
        false => mesh.triangles()[at.hit.primitive as usize].map(|v| at.part.uvs[v as usize]),
    };
    let (du1, dv1, du2, dv2) = (t1[0] - t0[0], t1[1] - t0[1], t2[0] - t0[0], t2[1] - t0[1]);
    let determinant = du1 * dv2 - dv1 * du2;
    if determinant == 0.0 {
        return [Vec3::ZERO; 2];
    }
    let (e1, e2) = (p1 - p0, p2 - p0);
    [(e1 * dv2 - e2 * dv1) / determinant, (e2 * du1 - e1 * du2) / determinant]
}
