//! A glass of tea before tiles, and a polished ball on a chessboard: detail that is seen by refraction and reflection.

use super::cornell::{Quad, write_mesh};
use super::revolved::revolved;
use super::room::{Corners, sides};
use std::fmt::Write;

/// Height of the tea in the glass. The glass is straight about it.
const LEVEL: f64 = 0.88;

/// The glass's border to the air: foot, outside, lip, and the inside down to the tea.
const GLASS: [[f64; 2]; 20] = [
    [0.0, 0.0],
    [0.24, 0.0],
    [0.29, 0.005],
    [0.3, 0.03],
    [0.28, 0.08],
    [0.3, 0.16],
    [0.37, 0.28],
    [0.38, 0.42],
    [0.33, 0.58],
    [0.3, 0.7],
    [0.308, 0.79],
    [0.32, 0.88],
    [0.332, 0.97],
    [0.36, 1.1],
    [0.364, 1.125],
    [0.352, 1.13],
    [0.342, 1.1],
    [0.31, 0.97],
    [0.304, 0.925],
    [0.298, LEVEL],
];

/// The tea's border to the glass, up to the tea's surface.
const TEA: [[f64; 2]; 11] = [
    [0.0, 0.12],
    [0.16, 0.122],
    [0.24, 0.15],
    [0.33, 0.27],
    [0.35, 0.42],
    [0.305, 0.58],
    [0.276, 0.7],
    [0.28, 0.745],
    [0.286, 0.79],
    [0.292, 0.835],
    [0.298, LEVEL],
];

/// The tea's surface.
const SURFACE: [[f64; 2]; 4] = [[0.298, LEVEL], [0.2, LEVEL], [0.1, LEVEL], [0.0, LEVEL]];

/// The saucer that the glass stands on.
const SAUCER: [[f64; 2]; 12] = [
    [0.0, 0.0],
    [0.36, 0.0],
    [0.4, 0.01],
    [0.4, 0.03],
    [0.66, 0.1],
    [0.7, 0.12],
    [0.69, 0.135],
    [0.64, 0.125],
    [0.42, 0.06],
    [0.36, 0.05],
    [0.2, 0.05],
    [0.0, 0.05],
];

/// The place where the glass stands.
const PLACE: [f64; 2] = [-0.5, -0.1];
/// The chessboard's minimum and maximum corners.
const BOARD: Corners = [[-0.7, -0.7, 0.0], [0.7, 0.7, 0.08]];
/// Place and turn in degrees of the chessboard, with the ball on its middle.
const BOARD_AT: ([f64; 2], f64) = ([0.85, 0.15], 24.0);
/// Radius of the ball.
const BALL: f64 = 0.46;

/// Lumps of sugar: place and turn in degrees.
const SUGAR: [([f64; 2], f64); 3] = [([-0.02, -0.98], 12.0), ([0.2, -0.86], 50.0), ([0.06, -0.7], 75.0)];

/// The windows in the wall behind the camera and in the left wall: a corner, and the two sides, of each.
const WINDOWS: [[[f64; 3]; 3]; 2] =
    [[[9.0, -23.9, 1.0], [-9.0, 0.0, 0.0], [0.0, 0.0, 12.0]], [[-19.9, -14.0, 1.0], [0.0, 9.0, 0.0], [0.0, 0.0, 12.0]]];

/// Returns the panes of a window, two by three, with bars between.
fn panes([corner, across, up]: [[f64; 3]; 3]) -> Vec<Quad> {
    let at = |u: f64, v: f64| [0, 1, 2].map(|axis| corner[axis] + u * across[axis] + v * up[axis]);
    let mut panes = Vec::new();
    for column in 0..2 {
        for row in 0..3 {
            let [left, low] = [0.5 * f64::from(column) + 0.03125, f64::from(row) * 0.34375 + 0.03125];
            let [right, high] = [left + 0.4375, low + 0.28125];
            panes.push([at(left, low), at(right, low), at(right, high), at(left, high)]);
        }
    }
    panes
}

/// Returns the text of the tea scene's file.
pub(super) fn scene() -> String {
    let mut text = include_str!("tea.pbrt").to_owned();
    let at = |[x, y]: [f64; 2], z: f64| format!("\nAttributeBegin\nTranslate {x} {y} {z}\n");
    for (number, window) in WINDOWS.into_iter().enumerate() {
        text += "\nAttributeBegin\nNamedMaterial \"window\"\n";
        text += [
            "AreaLightSource \"diffuse\" \"rgb L\" [ 9 9.5 10.5 ]\n",
            "AreaLightSource \"diffuse\" \"rgb L\" [ 16 14 11 ]\n",
        ][number];
        write_mesh(&mut text, &panes(window));
        text += "AttributeEnd\n";
    }
    text += &at(PLACE, 0.002);
    text += "NamedMaterial \"china\"\n";
    text += &revolved(&SAUCER);
    text += "AttributeEnd\n";
    text += &at(PLACE, 0.06);
    text += "NamedMaterial \"glass\"\n";
    text += &revolved(&GLASS);
    text += "MediumInterface \"tea\" \"\"\nNamedMaterial \"tea in glass\"\n";
    text += &revolved(&TEA);
    text += "NamedMaterial \"tea\"\n";
    text += &revolved(&SURFACE);
    text += "AttributeEnd\n";
    let (place, turn) = BOARD_AT;
    text += &at(place, 0.0);
    let _ = writeln!(text, "Rotate {turn} 0 0 1\nNamedMaterial \"wood\"");
    let [[left, front, _], [right, back, top]] = BOARD;
    write_mesh(&mut text, &sides([[left - 0.06, front - 0.06, 0.001], [right + 0.06, back + 0.06, top - 0.01]]));
    text += "NamedMaterial \"squares\"\nShape \"trianglemesh\"\n";
    let _ = writeln!(
        text,
        "  \"point3 P\" [ {left} {front} {top}  {right} {front} {top}  {right} {back} {top}  {left} {back} {top} ]"
    );
    text += "  \"point2 uv\" [ 0 0  1 0  1 1  0 1 ]\n  \"integer indices\" [ 0 1 2  0 2 3 ]\n";
    let _ = writeln!(text, "Translate 0 0 {}\nNamedMaterial \"polished\"", top + BALL);
    let _ = writeln!(text, "Shape \"sphere\" \"float radius\" [ {BALL} ]\nAttributeEnd");
    for (place, turn) in SUGAR {
        text += &at(place, 0.001);
        let _ = writeln!(text, "Rotate {turn} 0 0 1\nNamedMaterial \"sugar\"");
        write_mesh(&mut text, &sides([[-0.08, -0.08, 0.0], [0.08, 0.08, 0.13]]));
        text += "AttributeEnd\n";
    }
    text
}
