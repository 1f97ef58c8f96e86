//! The choice of the direction from which a model is seen.
//!
//! A bare model is seen from the front, the right and above. A room without a front wall, such as a Cornell box, would
//! show the outsides of its walls from there. So a small image of each side tells whether the triangles that are seen
//! face the viewer, and the first view from which most do is taken.

use super::{TAN_HALF_FOV, each_triangle};
use crate::Scene;
use glam::{DVec2, DVec3};

/// A view: components of the direction to the camera to the front, to the right and up. It is normalized at its use.
pub(super) type View = [f64; 3];

/// The usual view.
pub(super) const USUAL: View = [1.0, 0.6, 0.45];
/// Other views, in the order of preference.
const OTHERS: [View; 6] =
    [[1.0, 0.0, 0.08], [-1.0, 0.0, 0.08], [0.0, 1.0, 0.08], [0.0, -1.0, 0.08], [1.0, 0.0, 1.2], [-1.0, -0.6, 0.45]];
/// The share of back faces among what is seen, above which other views are tried.
const ENOUGH: f64 = 0.3;
/// Another view must have this part of the usual view's back faces at most.
const BETTER: f64 = 0.5;
/// Width and height of the small images in pixels.
const SIZE: usize = 48;
/// The largest number of triangles that are drawn; of more, evenly spaced ones.
const MOST: usize = 300_000;

/// Returns the direction of a view, given the directions to the front, to the right and up.
pub(super) fn direction(view: View, [front, right, up]: [DVec3; 3]) -> DVec3 {
    (view[0] * front + view[1] * right + view[2] * up).normalize()
}

/// Chooses the view of a model with its centre and radius.
pub(super) fn choose(scene: &Scene, axes: [DVec3; 3], centre: DVec3, radius: f64) -> View {
    let usual = back_faces(scene, direction(USUAL, axes), axes[2], centre, radius);
    if usual <= ENOUGH {
        return USUAL;
    }
    let mut best = (BETTER * usual, USUAL);
    for view in OTHERS {
        let share = back_faces(scene, direction(view, axes), axes[2], centre, radius);
        if share < best.0 {
            best = (share, view);
        }
    }
    best.1
}

/// The share of pixels that show the back of a triangle, among those that show any.
fn back_faces(scene: &Scene, towards: DVec3, up: DVec3, centre: DVec3, radius: f64) -> f64 {
    let right = (-towards).cross(up).normalize();
    let up = right.cross(-towards);
    let eye = centre + towards * (1.1 * radius / TAN_HALF_FOV);
    let mut total = 0;
    each_triangle(scene, |_| total += 1);
    let (every, mut number) = (total / MOST + 1, 0);
    // Depth, and true for a back face.
    let mut pixels = [(f64::INFINITY, false); SIZE * SIZE];
    each_triangle(scene, |corners| {
        number += 1;
        if number % every != 0 {
            return;
        }
        let back = (corners[1] - corners[0]).cross(corners[2] - corners[0]).dot(eye - corners[0]) < 0.0;
        let seen = corners.map(|p| (p - eye).dot(-towards));
        if seen.iter().any(|z| *z <= 0.0) {
            return;
        }
        let at = |k: usize| {
            let p = corners[k] - eye;
            (DVec2::new(p.dot(right), p.dot(up)) / (seen[k] * TAN_HALF_FOV) + 1.0) * (0.5 * SIZE as f64)
        };
        draw(&mut pixels, [at(0), at(1), at(2)], seen, back);
    });
    let shown = pixels.iter().filter(|p| p.0.is_finite()).count();
    pixels.iter().filter(|p| p.1).count() as f64 / shown.max(1) as f64
}

/// Draws a triangle with corners at `at`, in pixels, and depths `depth`. A triangle that covers no pixel's centre is drawn
/// as a point.
fn draw(pixels: &mut [(f64, bool); SIZE * SIZE], at: [DVec2; 3], depth: [f64; 3], back: bool) {
    let mut set = |x: usize, y: usize, z: f64| {
        let pixel = &mut pixels[y * SIZE + x];
        if z < pixel.0 {
            *pixel = (z, back);
        }
    };
    let (low, high) = (at[0].min(at[1]).min(at[2]), at[0].max(at[1]).max(at[2]));
    let cell = |v: f64| v.clamp(0.0, SIZE as f64 - 1.0) as usize;
    let area = (at[1] - at[0]).perp_dot(at[2] - at[0]);
    let mut drawn = false;
    if area.abs() > 1e-9 {
        for y in cell(low.y)..=cell(high.y) {
            for x in cell(low.x)..=cell(high.x) {
                let p = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
                let share = |k: usize| (at[(k + 1) % 3] - p).perp_dot(at[(k + 2) % 3] - p) / area;
                let shares = [share(0), share(1), share(2)];
                if shares.iter().all(|s| *s >= 0.0) {
                    drawn = true;
                    set(x, y, (0..3).map(|k| shares[k] * depth[k]).sum());
                }
            }
        }
    }
    if !drawn && low.min_element() >= 0.0 && high.max_element() < SIZE as f64 {
        set(cell(at[0].x), cell(at[0].y), depth[0]);
    }
}
