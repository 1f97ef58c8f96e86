//! A room lit through a door ajar: nearly all of its light is indirect.

use super::cornell::{Quad, write_mesh};
use super::revolved::revolved;
use super::room::{Corners, sides};
use std::fmt::Write;

/// Size of the room in metres.
const ROOM: [f64; 3] = [4.6, 4.5, 2.6];
/// Left and right edge of the doorway in the back wall, and its height.
const DOORWAY: [f64; 3] = [3.2, 4.1, 2.05];
/// Thickness of the back wall.
const WALL: f64 = 0.12;
/// Angle in degrees by which the door stands open.
const AJAR: f64 = 30.0;

/// The ends of the corridor behind the back wall: left, right and back.
const CORRIDOR: [f64; 3] = [1.8, 4.9, 6.1];
/// The lamp under the corridor's ceiling, out of sight of the room: its corners, its normal down.
const LAMP: Quad = [[3.0, 5.2, 2.59], [3.0, 5.8, 2.59], [3.6, 5.8, 2.59], [3.6, 5.2, 2.59]];

/// Furniture, and mouldings on the walls, as boxes: material, minimum and maximum corners.
const BOXES: [(&str, Corners); 15] = [
    ("wood", [[1.75, 2.05, 0.72], [3.25, 2.85, 0.76]]),
    ("wood", [[1.82, 2.12, 0.0], [1.89, 2.19, 0.72]]),
    ("wood", [[3.11, 2.12, 0.0], [3.18, 2.19, 0.72]]),
    ("wood", [[1.82, 2.71, 0.0], [1.89, 2.78, 0.72]]),
    ("wood", [[3.11, 2.71, 0.0], [3.18, 2.78, 0.72]]),
    // Skirting board and rails.
    ("white", [[0.0, 4.47, 0.0], [3.1, 4.5, 0.14]]),
    ("white", [[0.0, 4.48, 0.95], [3.1, 4.5, 1.0]]),
    ("white", [[4.57, 0.0, 0.0], [4.6, 4.5, 0.14]]),
    ("white", [[4.58, 0.0, 0.95], [4.6, 4.47, 1.0]]),
    // The door's frame.
    ("white", [[3.1, 4.46, 0.0], [3.2, 4.5, 2.15]]),
    ("white", [[4.1, 4.46, 0.0], [4.2, 4.5, 2.15]]),
    ("white", [[3.2, 4.46, 2.05], [4.1, 4.5, 2.15]]),
    // A chest by the right wall.
    ("wood", [[4.1, 2.5, 0.0], [4.56, 3.7, 0.8]]),
    ("wood", [[4.08, 2.54, 0.42], [4.1, 3.66, 0.76]]),
    ("wood", [[4.08, 2.54, 0.06], [4.1, 3.66, 0.38]]),
];

/// The door's leaf and its panels as boxes about the hinge, where x = 0: minimum and maximum corners.
const LEAF: [Corners; 5] = [
    [[-0.89, 0.0, 0.01], [-0.005, 0.04, 2.04]],
    [[-0.79, -0.012, 0.15], [-0.5, 0.0, 0.9]],
    [[-0.39, -0.012, 0.15], [-0.1, 0.0, 0.9]],
    [[-0.79, -0.012, 1.1], [-0.5, 0.0, 1.9]],
    [[-0.39, -0.012, 1.1], [-0.1, 0.0, 1.9]],
];

/// The pots' places on the table.
const POTS: [(&str, [f64; 2]); 3] = [("polished", [2.08, 2.6]), ("rough", [2.52, 2.42]), ("glass", [2.92, 2.3])];

/// Half the cross-section of a pot: outside, lip, inside.
const POT: [[f64; 2]; 17] = [
    [0.0, 0.0],
    [0.1, 0.0],
    [0.108, 0.004],
    [0.16, 0.07],
    [0.19, 0.16],
    [0.16, 0.25],
    [0.105, 0.31],
    [0.112, 0.35],
    [0.145, 0.385],
    [0.148, 0.392],
    [0.138, 0.392],
    [0.101, 0.352],
    [0.094, 0.308],
    [0.15, 0.245],
    [0.178, 0.16],
    [0.148, 0.075],
    [0.0, 0.016],
];

/// Returns the walls, floor and ceiling of room and corridor: name, material, faces.
fn walls() -> [(&'static str, &'static str, Vec<Quad>); 5] {
    let [x, y, z] = ROOM;
    let [left, right, top] = DOORWAY;
    let [end, other, back] = CORRIDOR;
    let behind = y + WALL;
    // The faces of the upright rectangle from one point of the floor to another, between two heights.
    let upright = |[a, b]: [[f64; 2]; 2], [low, high]: [f64; 2]| -> Quad {
        [[a[0], a[1], low], [b[0], b[1], low], [b[0], b[1], high], [a[0], a[1], high]]
    };
    let wall = |a, b| upright([a, b], [0.0, z]);
    let flat = |[a, b]: [[f64; 2]; 2], h: f64| -> Quad {
        [[a[0], a[1], h], [b[0], a[1], h], [b[0], b[1], h], [a[0], b[1], h]]
    };
    let mut plaster = vec![wall([0.0, 0.0], [0.0, y]), wall([x, y], [x, 0.0]), wall([x, 0.0], [0.0, 0.0])];
    // The back wall on both sides, around the doorway, and the doorway's inside.
    for (depth, ends) in [(y, [0.0, x]), (behind, [end, other])] {
        plaster.push(wall([ends[0], depth], [left, depth]));
        plaster.push(wall([right, depth], [ends[1], depth]));
        plaster.push(upright([[left, depth], [right, depth]], [top, z]));
    }
    let inside = vec![
        upright([[left, y], [left, behind]], [0.0, top]),
        upright([[right, behind], [right, y]], [0.0, top]),
        flat([[left, y], [right, behind]], top),
    ];
    let corridor =
        vec![wall([end, behind], [end, back]), wall([end, back], [other, back]), wall([other, back], [other, behind])];
    [
        ("walls", "plaster", plaster),
        ("the doorway's inside", "white", inside),
        ("the corridor's walls", "plaster", corridor),
        ("ceilings", "ceiling", vec![flat([[0.0, 0.0], [x, y]], z), flat([[end, behind], [other, back]], z)]),
        (
            "under the boards",
            "groove",
            vec![flat([[0.0, 0.0], [x, y]], -0.008), flat([[end, y], [other, back]], -0.008)],
        ),
    ]
}

/// Returns the floor's boards, grouped by their three tints. They run along y.
fn boards() -> [Vec<Quad>; 3] {
    const WIDTH: f64 = 0.14;
    const GAP: f64 = 0.006;
    let mut tints = [Vec::new(), Vec::new(), Vec::new()];
    let rows = (ROOM[0].max(CORRIDOR[1]) / WIDTH) as usize + 1;
    for row in 0..rows {
        let left = WIDTH * row as f64;
        // Joints by small whole numbers, so that no two neighbours are alike.
        let mut from = 0.0;
        for part in 0..4 {
            let to = match part {
                3 => CORRIDOR[2],
                _ => 0.55 + 1.5 * f64::from(part) + 0.19 * ((row * 5 + 3 * part as usize) % 8) as f64,
            };
            let [right, end] = [left + WIDTH - GAP, to - GAP];
            let corner = |x: f64, y: f64| [(x * 1000.0).round() / 1000.0, (y * 1000.0).round() / 1000.0, 0.0];
            let quad = [corner(left, from), corner(right, from), corner(right, end), corner(left, end)];
            tints[(row * 2 + part as usize * 7 + row / 3) % 3].push(quad);
            from = to;
        }
    }
    tints
}

/// Returns the text of the door scene's file.
pub(super) fn scene() -> String {
    let mut text = include_str!("door.pbrt").to_owned();
    for (name, material, quads) in walls() {
        let _ = writeln!(text, "\n# {name}\nNamedMaterial \"{material}\"");
        write_mesh(&mut text, &quads);
    }
    text += "\n# floor\n";
    for (tint, quads) in boards().iter().enumerate() {
        let _ = writeln!(text, "NamedMaterial \"board {tint}\"");
        write_mesh(&mut text, quads);
    }
    text += "\n# table, mouldings, chest\n";
    for material in ["wood", "white"] {
        let of = BOXES.iter().filter(|(of, _)| *of == material);
        let quads: Vec<Quad> = of.flat_map(|(_, corners)| sides(*corners)).collect();
        let _ = writeln!(text, "NamedMaterial \"{material}\"");
        write_mesh(&mut text, &quads);
    }
    let quads: Vec<Quad> = LEAF.into_iter().flat_map(sides).collect();
    let _ = writeln!(text, "\n# the door\nAttributeBegin\nTranslate {} {} 0\nRotate {AJAR} 0 0 1", DOORWAY[1], ROOM[1]);
    text += "NamedMaterial \"blue\"\n";
    write_mesh(&mut text, &quads);
    text += "AttributeEnd\n";
    for (material, [x, y]) in POTS {
        let _ = writeln!(text, "\nAttributeBegin\nTranslate {x} {y} 0.761\nNamedMaterial \"{material}\"");
        text += &revolved(&POT);
        text += "AttributeEnd\n";
    }
    text += "\n# the corridor's lamp\nAttributeBegin\nNamedMaterial \"lamp\"\n";
    text += "AreaLightSource \"diffuse\" \"rgb L\" [ 560 510 430 ]\n";
    write_mesh(&mut text, &[LAMP]);
    text += "AttributeEnd\n";
    text
}
