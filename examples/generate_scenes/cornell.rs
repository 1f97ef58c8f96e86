//! The Cornell box.

use std::fmt::Write;

pub(super) type Quad = [[f64; 3]; 4];

/// Walls, floor and ceiling in [Cornell 1998]: name, material, and corners in millimetres.
const WALLS: [(&str, &str, Quad); 5] = [
    ("floor", "white", [[552.8, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 559.2], [549.6, 0.0, 559.2]]),
    ("ceiling", "white", [[556.0, 548.8, 0.0], [556.0, 548.8, 559.2], [0.0, 548.8, 559.2], [0.0, 548.8, 0.0]]),
    ("back wall", "white", [[549.6, 0.0, 559.2], [0.0, 0.0, 559.2], [0.0, 548.8, 559.2], [556.0, 548.8, 559.2]]),
    ("right wall", "green", [[0.0, 0.0, 559.2], [0.0, 0.0, 0.0], [0.0, 548.8, 0.0], [0.0, 548.8, 559.2]]),
    ("left wall", "red", [[552.8, 0.0, 0.0], [549.6, 0.0, 559.2], [556.0, 548.8, 559.2], [556.0, 548.8, 0.0]]),
];

/// The top faces of the two blocks in [Cornell 1998], in millimetres. The side faces extend from the edges of a top
/// face down to the floor.
const BLOCKS: [(&str, Quad); 2] = [
    ("short block", [[130.0, 165.0, 65.0], [82.0, 165.0, 225.0], [240.0, 165.0, 272.0], [290.0, 165.0, 114.0]]),
    ("tall block", [[423.0, 330.0, 247.0], [265.0, 330.0, 296.0], [314.0, 330.0, 456.0], [472.0, 330.0, 406.0]]),
];

/// The corners of the lamp in [Cornell 1998], in millimetres, moved slightly below the ceiling. The original lies in a
/// hole of the ceiling, which is closed here.
const LAMP: Quad = [[343.0, 548.6, 227.0], [343.0, 548.6, 332.0], [213.0, 548.6, 332.0], [213.0, 548.6, 227.0]];

pub(super) fn write_mesh(text: &mut String, quads: &[Quad]) {
    let mut points = String::new();
    let mut indices = String::new();
    for (number, quad) in quads.iter().enumerate() {
        for [x, y, z] in quad {
            let _ = write!(points, " {x} {y} {z} ");
        }
        let a = 4 * number;
        let _ = write!(indices, " {} {} {}  {} {} {} ", a, a + 1, a + 2, a, a + 2, a + 3);
    }
    let _ = writeln!(text, "Shape \"trianglemesh\"\n  \"point3 P\" [{points}]\n  \"integer indices\" [{indices}]");
}

/// Returns the top face and the four side faces of a block, all facing outwards.
pub(super) fn block(top: Quad) -> Vec<Quad> {
    let foot = |[x, _, z]: [f64; 3]| [x, 0.0, z];
    let mut quads = vec![top];
    for i in 0..4 {
        let (here, next) = (top[i], top[(i + 1) % 4]);
        quads.push([next, here, foot(here), foot(next)]);
    }
    quads
}

/// Returns the text of the Cornell box's scene file.
pub(super) fn scene() -> String {
    let mut text = include_str!("cornell.pbrt").to_owned();
    for (name, material, quad) in WALLS {
        let _ = writeln!(text, "\n# {name}\nNamedMaterial \"{material}\"");
        write_mesh(&mut text, &[quad]);
    }
    for (name, top) in BLOCKS {
        let _ = writeln!(text, "\n# {name}\nNamedMaterial \"white\"");
        write_mesh(&mut text, &block(top));
    }
    text += "\n# The lamp, its normal down.\nAttributeBegin\nNamedMaterial \"lamp\"\n";
    text += "AreaLightSource \"diffuse\" \"rgb L\" [ 17 12 4 ]\n";
    write_mesh(&mut text, &[LAMP]);
    text += "AttributeEnd\n";
    text
}
