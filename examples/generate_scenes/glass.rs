//! A scene of transmission: clear, rough and thin glass, coloured glass, mist, and leaves cut out by alpha.

use super::Assets;
use super::images::tga_with_alpha;
use std::fmt::Write;

/// The twig's leaves: height on the stem, angle about the stem in degrees, tilt from upright in degrees, and size.
const LEAVES: [[f64; 4]; 11] = [
    [0.3, 20.0, 62.0, 0.62],
    [0.45, 157.0, 66.0, 0.66],
    [0.6, 295.0, 60.0, 0.68],
    [0.75, 72.0, 58.0, 0.66],
    [0.9, 210.0, 55.0, 0.62],
    [1.05, 347.0, 52.0, 0.6],
    [1.2, 125.0, 48.0, 0.56],
    [1.33, 262.0, 42.0, 0.5],
    [1.45, 40.0, 36.0, 0.44],
    [1.55, 177.0, 28.0, 0.38],
    [1.62, 315.0, 16.0, 0.32],
];

/// Width and height of the square leaf image, in pixels.
const LEAF: u16 = 96;

/// Returns the sRGB colour and the opacity of a pixel of the leaf image. The leaf grows upwards from the middle of the
/// bottom edge.
fn leaf(column: u16, row: u16) -> [u8; 4] {
    let unit = |i: u16| (f64::from(i) + 0.5) / f64::from(LEAF);
    let (across, along) = ((2.0 * unit(column) - 1.0).abs(), 1.0 - unit(row));
    // The leaf is widest at a third of its length and has a toothed edge.
    let teeth = 0.04 * (12.0 * along - (12.0 * along).floor());
    let rest = 1.0 - along;
    let width = 6.5 * along * rest * rest * 0.8 + 0.03 - teeth * rest;
    if across > width || along > 0.97 {
        return [0, 0, 0, 0];
    }
    let rib = {
        let slanted = 9.0 * along - 4.0 * across;
        across < 0.035 || slanted - slanted.floor() < 0.1
    };
    if rib { [150, 170, 80, 255] } else { [70, 130, 45, 255] }
}

/// The bars of the pane's frame. Each is a box, given by its minimum and maximum corners.
const BARS: [[[f64; 3]; 2]; 4] = [
    [[-0.64, -0.03, 0.0], [0.64, 0.03, 0.05]],
    [[-0.64, -0.02, 1.0], [0.64, 0.02, 1.04]],
    [[-0.64, -0.02, 0.05], [-0.6, 0.02, 1.0]],
    [[0.6, -0.02, 0.05], [0.64, 0.02, 1.0]],
];

/// Returns the pbrt parameters of one triangle mesh that holds all bars of the pane's frame, with normals outwards.
fn frame() -> String {
    let (mut points, mut indices) = (String::new(), String::new());
    for (number, bar) in BARS.iter().enumerate() {
        for corner in 0..8 {
            let [x, y, z] = [0, 1, 2].map(|axis| bar[corner >> axis & 1][axis]);
            let _ = write!(points, " {x} {y} {z} ");
        }
        for [a, b, c, d] in [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]] {
            let at = |corner| 8 * number + corner;
            let [a, b, c, d] = [a, b, c, d].map(at);
            let _ = write!(indices, " {a} {b} {c}  {a} {c} {d} ");
        }
    }
    format!("    \"point3 P\" [{points}]\n    \"integer indices\" [{indices}]\n")
}

/// Returns the text of the scene file, and the name and bytes of the scene's other files.
pub(super) fn scene() -> (String, Assets) {
    let mut text = include_str!("glass.pbrt").replace("{frame}", &frame());
    for [height, turn, down, size] in LEAVES {
        let _ = write!(
            text,
            "AttributeBegin\n  Translate 1.75 1 {height}\n  Rotate {turn} 0 0 1\n  Rotate {down} 1 0 0\n  \
             Scale {size} {size} {size}\n  ObjectInstance \"leaf\"\nAttributeEnd\n"
        );
    }
    (text, vec![("leaf.tga".to_owned(), tga_with_alpha(LEAF, LEAF, leaf))])
}
