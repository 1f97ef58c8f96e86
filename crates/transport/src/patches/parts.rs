//! Equal parts of a triangle.

use glam::DVec3;

pub(super) fn triangle_area([a, b, c]: [DVec3; 3]) -> f64 {
    0.5 * (b - a).cross(c - a).length()
}

/// Divides a triangle into `parts * parts` equal parts, in rows by decreasing weight of the first corner.
pub(super) fn divide([a, b, c]: [DVec3; 3], parts: u32, mut add: impl FnMut([DVec3; 3])) {
    let point = |i: u32, j: u32| a + ((b - a) * f64::from(i) + (c - a) * f64::from(j)) / f64::from(parts);
    for i in 0..parts {
        for j in 0..parts - i {
            add([point(i, j), point(i + 1, j), point(i, j + 1)]);
            if i + j + 1 < parts {
                add([point(i + 1, j + 1), point(i, j + 1), point(i + 1, j)]);
            }
        }
    }
}

/// Returns the index, in the order of [`divide`], of the part that contains a point. `v` and `w` are the weights of the second
/// and third corner.
pub(super) fn part_at([v, w]: [f32; 2], parts: u32) -> u32 {
    let scaled = [v, w].map(|weight| weight * parts as f32);
    let i = (scaled[0] as u32).min(parts - 1);
    let j = (scaled[1] as u32).min(parts - 1 - i);
    let beyond = scaled[0] - i as f32 + (scaled[1] - j as f32) > 1.0;
    // Row i has 2 (parts - i) - 1 parts.
    2 * parts * i - i * i + 2 * j + u32::from(beyond && i + j + 1 < parts)
}
