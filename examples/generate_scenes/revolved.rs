//! Surfaces of revolution, as the control meshes of subdivision surfaces.

use super::directions::sin_cos;
use std::fmt::Write;

/// Number of control points around the z axis.
const AROUND: usize = 16;

/// Returns the pbrt shape of a profile that turns about the z axis. Each point of the profile is a distance from the axis
/// and a height; at the ends the distance may be 0.
///
/// The normals point outwards where the profile rises: a subdivision surface's face against the winding. The surface is
/// smooth and lies a little within the control points.
pub(super) fn revolved(profile: &[[f64; 2]]) -> String {
    let (mut points, mut indices) = (String::new(), String::new());
    // The first control point of each ring, and how many the ring has.
    let (mut rings, mut made) = (Vec::new(), 0);
    for &[radius, height] in profile {
        let count = if radius == 0.0 { 1 } else { AROUND };
        for step in 0..count {
            let [sin, cos] = sin_cos(step as f64 / AROUND as f64);
            let _ = write!(points, " {:.4} {:.4} {height} ", radius * cos, radius * sin);
        }
        rings.push((made, count));
        made += count;
    }
    for pair in rings.windows(2) {
        let at = |ring: usize, step: usize| pair[ring].0 + step % pair[ring].1;
        for step in 0..AROUND {
            let [a, b, c, d] = [at(0, step), at(0, step + 1), at(1, step + 1), at(1, step)];
            if a != b {
                let _ = write!(indices, " {a} {c} {b} ");
            }
            if c != d {
                let _ = write!(indices, " {a} {d} {c} ");
            }
        }
    }
    format!(
        "Shape \"loopsubdiv\" \"integer levels\" [ 3 ]\n  \"point3 P\" [{points}]\n  \"integer indices\" [{indices}]\n"
    )
}
