//! A meadow: many blades of grass smaller than a pixel.

use super::directions::sin_cos;
use std::fmt::Write;

/// Number of different tuft meshes.
const KINDS: u64 = 3;
/// Number of grass blades per tuft.
const BLADES: u64 = 30;
/// Number of tufts along each side of the square meadow.
const ROWS: u64 = 30;
/// Distance between neighbouring tufts in metres.
const SPACING: f64 = 0.14;

/// Returns a pseudo-random number in `[0, 1)`: a hash of the three arguments [Steele et al. 2014].
fn random(kind: u64, number: u64, use_of_it: u64) -> f64 {
    let mut x = (kind << 40 | number << 8 | use_of_it).wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((x ^ (x >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}

/// Returns the pbrt shape of a tuft: blades of three triangles each that grow near the origin and bend outwards.
fn tuft(kind: u64) -> String {
    let (mut points, mut indices) = (String::new(), String::new());
    for blade in 0..BLADES {
        let u = |use_of_it| random(kind, blade, use_of_it);
        let [sin, cos] = sin_cos(u(0));
        let out = [cos, sin];
        let [root, height, bend] = [0.09 * u(1), 0.22 + 0.22 * u(2), 0.03 + 0.16 * u(3) * u(3)];
        let width = 0.004 + 0.003 * u(4);
        // Each blade is turned about itself, so that some are seen flat and some on edge.
        let [turn_sin, turn_cos] = sin_cos(u(5));
        let side = [turn_cos * width, turn_sin * width];
        let mut point = |along: f64, across: f64| {
            let reach = root + bend * along * along;
            let [x, y] = [out[0] * reach + side[0] * across, out[1] * reach + side[1] * across];
            let _ = write!(points, " {x:.4} {y:.4} {:.4} ", height * along);
        };
        for (along, across) in [(0.0, -1.0), (0.0, 1.0), (0.6, -0.7), (0.6, 0.7), (1.0, 0.0)] {
            point(along, across);
        }
        let a = 5 * blade;
        let _ = write!(indices, " {a} {} {}  {a} {} {}  {} {} {} ", a + 1, a + 3, a + 3, a + 2, a + 2, a + 3, a + 4);
    }
    format!("  Shape \"trianglemesh\"\n    \"point3 P\" [{points}]\n    \"integer indices\" [{indices}]\n")
}

/// Returns the text of the meadow's scene file.
pub(super) fn scene() -> String {
    let mut text = include_str!("grass.pbrt").to_owned();
    for (x, y, radius) in [(-0.7, -0.9, 0.16), (0.55, -0.5, 0.22), (0.15, 0.7, 0.28)] {
        let _ = writeln!(text, "AttributeBegin\n  Translate {x} {y} 0.02");
        let _ = writeln!(text, "  Shape \"sphere\" \"float radius\" [ {radius} ]\nAttributeEnd");
    }
    for kind in 0..KINDS {
        let _ = write!(text, "\nObjectBegin \"tuft {kind}\"\n  NamedMaterial \"blade {kind}\"\n");
        text += &tuft(kind);
        text += "ObjectEnd\n";
    }
    text += "\n";
    for tuft in 0..ROWS * ROWS {
        let u = |use_of_it| random(KINDS, tuft, use_of_it);
        let half = 0.5 * ROWS as f64;
        let x = SPACING * ((tuft % ROWS) as f64 - half + u(0));
        let y = SPACING * ((tuft / ROWS) as f64 - half + u(1));
        let [turn, size] = [360.0 * u(2), 0.7 + 0.5 * u(3)];
        let kind = (u(4) * KINDS as f64) as u64;
        let _ = write!(
            text,
            "AttributeBegin\n Translate {x:.3} {y:.3} 0\n Rotate {turn:.1} 0 0 1\n Scale {size:.2} {size:.2} {size:.2}\n \
             ObjectInstance \"tuft {kind}\"\nAttributeEnd\n"
        );
    }
    text
}
