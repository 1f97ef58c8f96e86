//! Chess pieces near, in focus and far through a thin lens.

use super::directions::{dot, normalize, sub};
use super::revolved::revolved;
use std::fmt::Write;

/// The camera's place and target, as in the template.
const EYE: [f64; 3] = [1.4, -7.2, 2.4];
const TARGET: [f64; 3] = [0.1, 0.0, 0.45];
/// The middle of the piece in focus.
const SHARP: [f64; 3] = [-0.5, 0.5, 0.7];

/// The profile of a pawn of height 1: distance from the axis and height.
const PAWN: [[f64; 2]; 14] = [
    [0.0, 0.0],
    [0.36, 0.0],
    [0.38, 0.06],
    [0.34, 0.14],
    [0.2, 0.22],
    [0.15, 0.42],
    [0.14, 0.58],
    [0.26, 0.6],
    [0.26, 0.64],
    [0.12, 0.67],
    [0.22, 0.78],
    [0.21, 0.9],
    [0.1, 1.0],
    [0.0, 1.0],
];

/// The profile of a queen of height 1.6.
const QUEEN: [[f64; 2]; 16] = [
    [0.0, 0.0],
    [0.42, 0.0],
    [0.44, 0.08],
    [0.4, 0.18],
    [0.24, 0.28],
    [0.17, 0.6],
    [0.15, 0.95],
    [0.3, 0.98],
    [0.3, 1.04],
    [0.16, 1.08],
    [0.18, 1.2],
    [0.32, 1.42],
    [0.26, 1.46],
    [0.12, 1.48],
    [0.1, 1.6],
    [0.0, 1.6],
];

/// The pieces: kind, material, and the middle of the square, from near to far.
const PIECES: [(&str, &str, [f64; 2]); 15] = [
    ("pawn", "black", [0.5, -3.5]),
    ("pawn", "white", [-1.5, -3.5]),
    ("pawn", "white", [2.5, -2.5]),
    ("queen", "black", [-2.5, -1.5]),
    ("pawn", "black", [0.5, -0.5]),
    ("queen", "white", [-0.5, 0.5]),
    ("pawn", "white", [1.5, 0.5]),
    ("pawn", "black", [-2.5, 0.5]),
    ("queen", "black", [2.5, 1.5]),
    ("pawn", "white", [-1.5, 2.5]),
    ("pawn", "black", [0.5, 2.5]),
    ("pawn", "black", [-3.5, 3.5]),
    ("queen", "white", [-1.5, 3.5]),
    ("pawn", "black", [1.5, 3.5]),
    ("pawn", "white", [3.5, 3.5]),
];

/// Returns the text of the chess scene's file.
pub(super) fn scene() -> String {
    let distance = dot(sub(SHARP, EYE), normalize(sub(TARGET, EYE)));
    let mut text = include_str!("chess.pbrt").replace("{distance}", &format!("{distance:.4}"));
    for (kind, profile) in [("pawn", &PAWN[..]), ("queen", &QUEEN[..])] {
        for material in ["white", "black"] {
            let _ = writeln!(text, "\nObjectBegin \"{material} {kind}\"\nNamedMaterial \"{material}\"");
            text += &revolved(profile);
            text += "ObjectEnd\n";
        }
    }
    for (kind, material, [x, y]) in PIECES {
        let _ =
            writeln!(text, "AttributeBegin\nTranslate {x} {y} 0\nObjectInstance \"{material} {kind}\"\nAttributeEnd");
    }
    text
}
