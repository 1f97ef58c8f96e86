//! Scenes with many repeated objects (grass, small lights), and images of patterns (a leaf, rings).

use super::arithmetic::{mix_bits, sin_cos};
use super::files::tga;
use std::fmt::Write;

/// The handwritten first part of a scene file, up to the line `first`, where the generated part begins.
fn head(text: &str, first: &str) -> String {
    text.split_once(first).map_or(text, |(head, _)| head).to_owned()
}

/// Number of different tuft meshes.
const KINDS: u64 = 3;
/// Number of grass blades per tuft.
const BLADES: u64 = 30;
/// Number of tufts along each side of the square meadow.
const ROWS: u64 = 30;
/// Distance between neighbouring tufts in metres.
const SPACING: f64 = 0.14;

/// Returns a pseudo-random number in `[0, 1)`: a hash of the three arguments.
fn random(kind: u64, number: u64, use_of_it: u64) -> f64 {
    let x = (kind << 40 | number << 8 | use_of_it).wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    (mix_bits(x) >> 11) as f64 / (1u64 << 53) as f64
}

/// Returns the pbrt shape of a tuft: blades of three triangles each, which grow near the origin and bend outwards.
fn tuft(kind: u64) -> String {
    let (mut points, mut indices) = (String::new(), String::new());
    for blade in 0..BLADES {
        let u = |use_of_it| random(kind, blade, use_of_it);
        let [sin, cos] = sin_cos(u(0));
        let out = [cos, sin];
        let [root, height, bend] = [0.09 * u(1), 0.22 + 0.22 * u(2), 0.03 + 0.16 * u(3) * u(3)];
        let width = 0.004 + 0.003 * u(4);
        // Each blade is rotated about its axis, so that some blades face the camera and some are seen on edge.
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

/// Returns the text of the meadow's scene file, with regenerated tufts.
pub(crate) fn grass(text: &str) -> String {
    let mut text = head(text, "\nObjectBegin \"tuft 0\"");
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

/// The number of lights along each side of their square.
const LAMPS: u32 = 100;
/// The distance between neighbouring lights, in radii of a light.
const LAMP_SPACING: u32 = 12;
/// The radius of a light in metres.
const LAMP_RADIUS: f64 = 0.006;

/// The linear RGB radiance of each group of lights. Powers differ by a factor of up to 15.
const GROUPS: [[f64; 3]; 5] =
    [[24.0, 15.0, 7.0], [5.0, 8.0, 3.0], [3.0, 6.0, 12.0], [12.0, 3.0, 2.0], [40.0, 36.0, 30.0]];

/// The group of the light at a column and row of the square. Groups form patches of 20 x 25 lights.
fn group_of(column: u32, row: u32) -> u32 {
    (column / 20 + 2 * (row / 25)) % 5
}

/// The height, in radii of a light, at a column and row of the square: a wavy sheet.
fn height(column: u32, row: u32) -> i64 {
    let [wave, _] = sin_cos(f64::from(column) / 25.0);
    let [_, other] = sin_cos(f64::from(row) / 40.0);
    (40.0 + 12.0 * wave + 8.0 * other).round() as i64
}

/// Returns the text of the scene file of many lights, with regenerated lights.
pub(crate) fn many_lights(text: &str) -> String {
    let mut text = head(text, "AttributeBegin\nScale");
    for (group, [r, g, b]) in GROUPS.into_iter().enumerate() {
        let _ = writeln!(text, "AttributeBegin\nScale {LAMP_RADIUS} {LAMP_RADIUS} {LAMP_RADIUS}");
        let _ = writeln!(text, "AreaLightSource \"diffuse\" \"rgb L\" [ {r} {g} {b} ]");
        let mut before = [0; 3];
        for lamp in (0..LAMPS * LAMPS).filter(|lamp| group_of(lamp % LAMPS, lamp / LAMPS) == group as u32) {
            let (column, row) = (lamp % LAMPS, lamp / LAMPS);
            let along = |k: u32| i64::from(LAMP_SPACING * k) - i64::from(LAMP_SPACING * LAMPS / 2);
            let place = [along(column), along(row), height(column, row)];
            let [x, y, z] = [0, 1, 2].map(|k| place[k] - before[k]);
            let _ = writeln!(text, "Translate {x} {y} {z} Shape \"sphere\"");
            before = place;
        }
        text += "AttributeEnd\n";
    }
    text
}

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

/// Returns the leaf as a TGA image.
pub(crate) fn leaf_image() -> Vec<u8> {
    tga([LEAF; 2], leaf)
}

/// Side of the texture in texels: half of the plate.
const SIDE: u16 = 256;
/// The rings' phase at a radius of 1, in turns: `k = 80 pi`.
const TURNS: f64 = 40.0;

/// Returns the grey value of the texel at a column and a row, counted from the top left. The plate's centre is at the
/// lower left corner.
fn ring(column: u16, row: u16) -> [u8; 1] {
    let place = |c: u16| (f64::from(c) + 0.5) / f64::from(SIDE);
    let [x, y] = [place(column), place(SIDE - 1 - row)];
    let phase = TURNS * (x * x + y * y);
    let [sine, _] = sin_cos(phase - phase.floor());
    [(255.0 * (0.5 + 0.45 * sine)).round() as u8]
}

/// Returns the rings of the zone plate as a TGA image.
pub(crate) fn rings_image() -> Vec<u8> {
    tga([SIDE; 2], ring)
}
