//! An area-preserving map between the sphere and a square [Clarberg 2008].
//!
//! The upper hemisphere fills the diamond in the middle of the square, and the lower hemisphere its four corners: an
//! octahedron cut open along its lower edges. A direction on such an edge has two points on the border of the square.
//! They are mirror images about the midpoint of a side.

use crate::shading::trigonometry::{sin_cos_turn, turn_of};
use glam::Vec3;

/// Returns the unit direction at a point `[u, v]` of `[0, 1]^2`. `u` increases with x and `v` with y; the centre is
/// +z.
#[inline]
pub(super) fn to_sphere(uv: [f32; 2]) -> Vec3 {
    let [a, b] = uv.map(|x| 2.0 * x - 1.0);
    // Positive in the upper hemisphere.
    let inside = 1.0 - (a.abs() + b.abs());
    let radius = 1.0 - inside.abs();
    // The angle in turns within a quarter circle, from the x axis.
    let turn = if radius > 0.0 { ((b.abs() - a.abs()) / radius + 1.0) * 0.125 } else { 0.125 };
    let (sin, cos) = sin_cos_turn(turn);
    let z = (1.0 - radius * radius).copysign(inside);
    let across = radius * (2.0 - radius * radius).max(0.0).sqrt();
    Vec3::new((across * cos).copysign(a), (across * sin).copysign(b), z)
}

/// Returns the point of `[0, 1]^2` for a unit direction: the inverse of [`to_sphere`].
#[inline]
pub(super) fn to_square(w: Vec3) -> [f32; 2] {
    // This equals sqrt(1 - |z|), without cancellation near the poles.
    let radius = ((w.x * w.x + w.y * w.y) / (1.0 + w.z.abs())).sqrt();
    let share = 4.0 * turn_of(w.y.abs(), w.x.abs());
    let (b, a) = (share * radius, radius - share * radius);
    let (a, b) = if w.z < 0.0 { (1.0 - b, 1.0 - a) } else { (a, b) };
    [a.copysign(w.x), b.copysign(w.y)].map(|x| (0.5 * x + 0.5).clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square() -> impl Iterator<Item = [f32; 2]> {
        (0..=256).flat_map(|i| (0..=256).map(move |j| [i as f32 / 256.0, j as f32 / 256.0]))
    }

    #[test]
    fn known_places() {
        for (uv, w) in [
            ([0.5, 0.5], Vec3::Z),
            ([1.0, 0.5], Vec3::X),
            ([0.5, 1.0], Vec3::Y),
            ([0.0, 0.5], Vec3::NEG_X),
            ([0.5, 0.0], Vec3::NEG_Y),
            ([0.0, 0.0], Vec3::NEG_Z),
            ([1.0, 1.0], Vec3::NEG_Z),
            ([0.75, 0.75], Vec3::new(0.5_f32.sqrt(), 0.5_f32.sqrt(), 0.0)),
        ] {
            assert!((to_sphere(uv) - w).length() < 1e-6, "{uv:?}: {}", to_sphere(uv));
        }
    }

    #[test]
    fn there_and_back() {
        for uv in square() {
            let w = to_sphere(uv);
            assert!((w.length() - 1.0).abs() < 3e-7, "{uv:?}: {w}");
            let back = to_square(w);
            let off = (back[0] - uv[0]).abs().max((back[1] - uv[1]).abs());
            let border = uv.iter().any(|x| *x == 0.0 || *x == 1.0);
            let again = (to_sphere(back) - w).length();
            assert!(again < 1e-6 && (border || off < 1e-6), "{uv:?}: {w} {back:?}");
        }
    }

    /// On the border of the square, the middle of each side mirrors a direction into itself: nothing jumps there.
    #[test]
    fn the_border_closes() {
        for i in 0..=64 {
            let t = i as f32 / 64.0;
            for (here, there) in [([0.0, t], [0.0, 1.0 - t]), ([1.0, t], [1.0, 1.0 - t])] {
                assert!((to_sphere(here) - to_sphere(there)).length() < 1e-6, "{here:?}");
                let turned = [here, there].map(|[u, v]| to_sphere([v, u]));
                assert!((turned[0] - turned[1]).length() < 1e-6, "{here:?}, turned");
            }
        }
    }

    /// Small squares fill equal solid angles: the Jacobian is 4 pi everywhere.
    #[test]
    fn areas_are_kept() {
        let h = 1.0 / 512.0;
        for [u, v] in square().filter(|uv| uv.iter().all(|x| *x > 0.01 && *x < 0.99)) {
            // The folds run along the axes and the diamond's sides: not across one.
            let [a, b] = [2.0 * u - 1.0, 2.0 * v - 1.0];
            if a.abs().min(b.abs()).min((1.0 - a.abs() - b.abs()).abs()) < 0.02 {
                continue;
            }
            let across = |du: f32, dv: f32| (to_sphere([u + du, v + dv]) - to_sphere([u - du, v - dv])) / (2.0 * h);
            let jacobian = across(h, 0.0).cross(across(0.0, h)).length();
            assert!((jacobian / (4.0 * std::f32::consts::PI) - 1.0).abs() < 2e-3, "{u} {v}: {jacobian}");
        }
    }
}
