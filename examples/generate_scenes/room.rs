//! A scene of two rooms with eight lamps, most of which light only their own corner.

use super::cornell::{Quad, write_mesh};
use std::fmt::Write;

pub(super) type Corners = [[f64; 3]; 2];

/// Floor, ceiling and walls of a space of 8 x 6 metres, 2.8 metres high: name, material, corners in metres.
const WALLS: [(&str, &str, Quad); 6] = [
    ("floor", "floor", [[0.0, 0.0, 0.0], [8.0, 0.0, 0.0], [8.0, 6.0, 0.0], [0.0, 6.0, 0.0]]),
    ("ceiling", "plaster", [[0.0, 0.0, 2.8], [0.0, 6.0, 2.8], [8.0, 6.0, 2.8], [8.0, 0.0, 2.8]]),
    ("front wall", "plaster", [[0.0, 0.0, 0.0], [0.0, 0.0, 2.8], [8.0, 0.0, 2.8], [8.0, 0.0, 0.0]]),
    ("back wall", "plaster", [[0.0, 6.0, 0.0], [8.0, 6.0, 0.0], [8.0, 6.0, 2.8], [0.0, 6.0, 2.8]]),
    ("left wall", "brick", [[0.0, 0.0, 0.0], [0.0, 6.0, 0.0], [0.0, 6.0, 2.8], [0.0, 0.0, 2.8]]),
    ("right wall", "green", [[8.0, 0.0, 0.0], [8.0, 0.0, 2.8], [8.0, 6.0, 2.8], [8.0, 6.0, 0.0]]),
];

/// Furniture and inner walls as boxes: name, material, minimum and maximum corners in metres.
const BOXES: [(&str, &str, Corners); 13] = [
    ("partition", "plaster", [[5.0, 2.3, 0.0], [5.12, 6.0, 2.8]]),
    ("table top", "wood", [[1.9, 2.3, 0.7], [3.6, 3.2, 0.74]]),
    ("table leg", "wood", [[1.95, 2.35, 0.0], [2.01, 2.41, 0.7]]),
    ("table leg", "wood", [[3.49, 2.35, 0.0], [3.55, 2.41, 0.7]]),
    ("table leg", "wood", [[1.95, 3.09, 0.0], [2.01, 3.15, 0.7]]),
    ("table leg", "wood", [[3.49, 3.09, 0.0], [3.55, 3.15, 0.7]]),
    ("parcel on the table", "brick", [[2.1, 2.8, 0.74], [2.4, 3.05, 0.95]]),
    ("chest", "wood", [[4.2, 4.6, 0.0], [4.9, 5.4, 0.9]]),
    ("bench", "green", [[5.9, 0.5, 0.0], [7.6, 1.0, 0.45]]),
    ("shelf's left side", "wood", [[0.9, 5.62, 0.0], [0.94, 6.0, 2.0]]),
    ("shelf's right side", "wood", [[3.26, 5.62, 0.0], [3.3, 6.0, 2.0]]),
    ("screen", "plaster", [[6.3, 2.6, 0.0], [6.36, 4.4, 1.7]]),
    ("plinth", "plaster", [[0.2, 3.3, 0.0], [0.6, 3.7, 0.8]]),
];

/// Heights of the shelf's boards in metres.
const BOARDS: [f64; 4] = [0.2, 0.8, 1.4, 1.98];

/// Lampshades, boxes open at the top and the bottom: minimum and maximum corners in metres.
const SHADES: [Corners; 2] = [[[2.95, 2.55, 1.05], [3.25, 2.85, 1.25]], [[0.4, 5.0, 1.45], [0.8, 5.4, 1.75]]];

/// Lamps of one quadrilateral each: name, radiance (RGB), corners. The order of the corners puts the normal on the
/// emitting side.
const PANELS: [(&str, [f64; 3], Quad); 4] = [
    ("ceiling panel", [5.0, 4.8, 4.4], [[1.7, 2.6, 2.79], [1.7, 3.2, 2.79], [2.3, 3.2, 2.79], [2.3, 2.6, 2.79]]),
    (
        "the other room's panel",
        [26.0, 25.0, 22.0],
        [[6.6, 4.9, 2.79], [6.6, 5.3, 2.79], [7.0, 5.3, 2.79], [7.0, 4.9, 2.79]],
    ),
    (
        "strip under a board",
        [18.0, 14.0, 9.0],
        [[1.1, 5.66, 1.39], [1.1, 5.7, 1.39], [3.1, 5.7, 1.39], [3.1, 5.66, 1.39]],
    ),
    (
        "picture on the partition",
        [0.5, 0.9, 1.6],
        [[4.99, 3.0, 1.2], [4.99, 3.0, 1.8], [4.99, 4.0, 1.8], [4.99, 4.0, 1.2]],
    ),
];

/// Spherical lamps: name, radiance (RGB), centre, radius.
const BULBS: [(&str, [f64; 3], [f64; 3], f64); 4] = [
    ("desk lamp", [110.0, 85.0, 55.0], [3.1, 2.7, 1.13], 0.04),
    ("floor lamp", [60.0, 45.0, 26.0], [0.6, 5.2, 1.58], 0.06),
    ("night light", [40.0, 6.0, 3.0], [4.86, 5.7, 0.25], 0.04),
    ("candle behind the screen", [420.0, 260.0, 90.0], [6.5, 3.3, 0.6], 0.02),
];

/// Returns the six faces of a box, facing outwards: the four sides, then two faces at the top and the bottom.
pub(super) fn sides([low, high]: Corners) -> [Quad; 6] {
    let corner = |x: usize, y: usize, z: usize| [[low, high][x][0], [low, high][y][1], [low, high][z][2]];
    let of = |q: [[usize; 3]; 4]| q.map(|[x, y, z]| corner(x, y, z));
    [
        of([[0, 0, 0], [0, 0, 1], [0, 1, 1], [0, 1, 0]]),
        of([[1, 0, 0], [1, 1, 0], [1, 1, 1], [1, 0, 1]]),
        of([[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]]),
        of([[0, 1, 0], [0, 1, 1], [1, 1, 1], [1, 1, 0]]),
        of([[0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]),
        of([[0, 0, 0], [0, 1, 0], [1, 1, 0], [1, 0, 0]]),
    ]
}

/// Returns the faces of the books on the three lower boards of the shelf, grouped by their three colours.
fn books() -> [Vec<Quad>; 3] {
    let mut colours = [Vec::new(), Vec::new(), Vec::new()];
    for (row, board) in BOARDS.iter().take(3).enumerate() {
        let foot = board + 0.02;
        for book in 0..13 {
            // Thickness, height and depth by small whole numbers, so that no two neighbours are alike.
            let step = |times: usize, of: usize| ((book * times + row * 5) % of) as f64;
            let left = 1.0 + 0.17 * book as f64 + 0.01 * step(3, 4);
            let right = left + 0.05 + 0.02 * step(2, 4);
            let top = foot + 0.26 + 0.03 * step(5, 7);
            let front = 5.7 + 0.02 * step(7, 5);
            colours[(book + row) % 3].extend(sides([[left, front, foot], [right, 5.98, top]]));
        }
    }
    colours
}

/// Returns the text of the room scene's file.
pub(super) fn scene() -> String {
    let mut text = include_str!("room.pbrt").to_owned();
    for (name, material, quad) in WALLS {
        let _ = writeln!(text, "\n# {name}\nNamedMaterial \"{material}\"");
        if name == "floor" {
            text += "Shape \"trianglemesh\"\n  \"point3 P\" [ 0 0 0  8 0 0  8 6 0  0 6 0 ]\n";
            text += "  \"point2 uv\" [ 0 0  1 0  1 1  0 1 ]\n  \"integer indices\" [ 0 1 2  0 2 3 ]\n";
        } else {
            write_mesh(&mut text, &[quad]);
        }
    }
    for (name, material, corners) in BOXES {
        let _ = writeln!(text, "\n# {name}\nNamedMaterial \"{material}\"");
        write_mesh(&mut text, &sides(corners));
    }
    text += "\n# boards\nNamedMaterial \"wood\"\n";
    let boards: Vec<Quad> = BOARDS.iter().flat_map(|&z| sides([[0.94, 5.62, z], [3.26, 6.0, z + 0.02]])).collect();
    write_mesh(&mut text, &boards);
    for (colour, quads) in ["red", "blue", "ochre"].into_iter().zip(books()) {
        let _ = writeln!(text, "\n# books\nNamedMaterial \"{colour}\"");
        write_mesh(&mut text, &quads);
    }
    for corners in SHADES {
        text += "\n# lampshade\nNamedMaterial \"shade\"\n";
        write_mesh(&mut text, &sides(corners)[..4]);
    }
    for (name, [r, g, b], quad) in PANELS {
        let _ = writeln!(text, "\n# {name}\nAttributeBegin\nNamedMaterial \"lamp\"");
        let _ = writeln!(text, "AreaLightSource \"diffuse\" \"rgb L\" [ {r} {g} {b} ]");
        write_mesh(&mut text, &[quad]);
        text += "AttributeEnd\n";
    }
    for (name, [r, g, b], [x, y, z], radius) in BULBS {
        let _ = writeln!(text, "\n# {name}\nAttributeBegin\nTranslate {x} {y} {z}\nNamedMaterial \"lamp\"");
        let _ = writeln!(text, "AreaLightSource \"diffuse\" \"rgb L\" [ {r} {g} {b} ]");
        let _ = writeln!(text, "Shape \"sphere\" \"float radius\" [ {radius} ]\nAttributeEnd");
    }
    text
}
