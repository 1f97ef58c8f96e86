//! Maps (warps) from the unit square to the domains that rendering samples, each with its density.
//!
//! Random numbers `u` are in `[0, 1)`. Directions are unit vectors around +z. Every map keeps neighbouring points
//! together, so that low-discrepancy points stay well distributed.

use super::trigonometry::{sin_cos_turn, sin_cos_within_an_eighth};
use glam::{Vec2, Vec3, Vec4};
use std::f32::consts::{FRAC_PI_4, PI};

/// Samples a unit direction uniformly on the sphere, by `u` in `[0, 1)^2`.
#[inline]
pub fn uniform_sphere(u: [f32; 2]) -> Vec3 {
    // sqrt(1 - z^2) = 2 sqrt(u (1 - u)), without cancellation at the poles.
    around_z(2.0 * (u[0] * (1.0 - u[0])).sqrt(), 1.0 - 2.0 * u[0], u[1])
}

/// Returns the solid-angle density of [`uniform_sphere`].
#[inline]
pub fn uniform_sphere_pdf() -> f32 {
    0.25 / PI
}

/// Samples a point uniformly on the unit disk, by `u` in `[0, 1)^2` and the concentric map [Shirley and Chiu 1997].
#[inline]
pub fn concentric_disk(u: [f32; 2]) -> Vec2 {
    concentric(u).1
}

/// Samples a unit direction on the hemisphere `z > 0` with the solid-angle density `z / pi`, by `u` in `[0, 1)^2`.
#[inline]
pub fn cosine_hemisphere(u: [f32; 2]) -> Vec3 {
    let (radius, p) = concentric(u);
    // The lower bound keeps the density above 0 at the edge of the square. The length stays 1 within 3e-8, and only a
    // fraction of 6e-8 of all samples is moved.
    let z = ((1.0 - radius) * (1.0 + radius)).max(0.5 * f32::EPSILON).sqrt();
    p.extend(z)
}

/// Samples a point uniformly on a triangle by a low-distortion map [Heitz 2019]. Returns its barycentric coordinates
/// `(b0, b1, b2)`, which sum to 1.
#[inline]
pub fn uniform_triangle(u: [f32; 2]) -> [f32; 3] {
    // Half of the smaller number, and the rest of the larger one. Both cases are computed and one is selected, since a
    // branch would be mispredicted.
    let (half, rest) = (0.5 * u[0].min(u[1]), u[0].max(u[1]) - 0.5 * u[0].min(u[1]));
    let first = Vec4::splat(u[1]).cmpgt(Vec4::splat(u[0]));
    let [b0, b1, ..] = Vec4::select(first, Vec4::new(half, rest, 0.0, 0.0), Vec4::new(rest, half, 0.0, 0.0)).to_array();
    [b0, b1, (1.0 - b0 - b1).max(0.0)]
}

/// Samples a unit direction uniformly in a cone around +z. `one_minus_cos` is `1 - cos` of the cone's half-angle, in `(0, 2]`.
///
/// For the narrow cone of a distant light, the cosine itself would round to 1. [`one_minus_cos`] computes `1 - cos` from the
/// sine.
#[inline]
pub fn uniform_cone(u: [f32; 2], one_minus_cos: f32) -> Vec3 {
    let height = u[0] * one_minus_cos;
    around_z((height * (2.0 - height)).max(0.0).sqrt(), 1.0 - height, u[1])
}

/// Returns the solid-angle density of [`uniform_cone`] inside the cone.
#[inline]
pub fn uniform_cone_pdf(one_minus_cos: f32) -> f32 {
    0.5 / (PI * one_minus_cos)
}

/// Returns `1 - cos` of an angle in `[0, pi/2]` from the squared sine, without cancellation.
#[inline]
pub fn one_minus_cos(sin2: f32) -> f32 {
    sin2 / (1.0 + (1.0 - sin2).max(0.0).sqrt())
}

/// Returns a point of the concentric map, and the point's radius in `[0, 1]`. In each of the square's four triangles, the
/// coordinate of larger magnitude is the signed radius. The ratio of the other coordinate to it gives the angle, at most an
/// eighth of a turn.
#[inline]
fn concentric(u: [f32; 2]) -> (f32, Vec2) {
    let (a, b) = (2.0 * u[0] - 1.0, 2.0 * u[1] - 1.0);
    // Both cases are computed and one is selected, since a branch on a random point's triangle would be mispredicted.
    let flat = Vec4::splat(a.abs()).cmpgt(Vec4::splat(b.abs()));
    let [near, far, ..] = Vec4::select(flat, Vec4::new(b, a, 0.0, 0.0), Vec4::new(a, b, 0.0, 0.0)).to_array();
    let angle = near / if far == 0.0 { 1.0 } else { far } * FRAC_PI_4;
    let (sin, cos) = sin_cos_within_an_eighth(angle);
    let (along, across) = (far * cos, far * sin);
    let [x, y, ..] =
        Vec4::select(flat, Vec4::new(along, across, 0.0, 0.0), Vec4::new(across, along, 0.0, 0.0)).to_array();
    (far.abs(), Vec2::new(x, y))
}

#[inline]
fn around_z(radius: f32, z: f32, turn: f32) -> Vec3 {
    let (sin, cos) = sin_cos_turn(turn);
    Vec3::new(radius * cos, radius * sin, z)
}
