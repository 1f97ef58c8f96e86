//! Ten thousand small lamps over columns and blocks.

use super::cornell::{Quad, write_mesh};
use super::directions::sin_cos;
use super::room::{Corners, sides};
use std::fmt::Write;

/// Lamps along each side of their square.
const ROWS: u32 = 100;
/// Distance of neighbouring lamps, in lamp radii.
const SPACING: u32 = 12;
/// Radius of a lamp in metres.
const RADIUS: f64 = 0.006;

/// Groups of lamps: linear RGB radiance. Powers differ up to 15 times.
const GROUPS: [[f64; 3]; 5] =
    [[24.0, 15.0, 7.0], [5.0, 8.0, 3.0], [3.0, 6.0, 12.0], [12.0, 3.0, 2.0], [40.0, 36.0, 30.0]];

/// The group of the lamp at a place of the square: patches of 20 x 25 lamps.
fn group_of(column: u32, row: u32) -> u32 {
    (column / 20 + 2 * (row / 25)) % 5
}

/// Columns and blocks: minimum and maximum corners.
const BLOCKS: [Corners; 7] = [
    [[-2.6, 0.6, 0.0], [-2.2, 1.0, 1.1]],
    [[-0.3, 1.2, 0.0], [0.1, 1.6, 1.2]],
    [[2.2, 1.4, 0.0], [2.6, 1.8, 1.1]],
    [[0.2, -1.6, 0.0], [0.9, -0.9, 0.35]],
    [[-2.4, -1.7, 0.0], [-1.9, -1.2, 0.7]],
    [[-1.6, 2.6, 0.0], [1.6, 2.9, 0.9]],
    [[0.35, -0.2, 0.0], [0.55, 0.6, 0.8]],
];

/// The height in lamp radii at a place of the square: a sheet that hangs in waves.
fn height(column: u32, row: u32) -> i64 {
    let [wave, _] = sin_cos(f64::from(column) / 25.0);
    let [_, other] = sin_cos(f64::from(row) / 40.0);
    (40.0 + 12.0 * wave + 8.0 * other).round() as i64
}

/// Returns the text of the scene's file.
pub(super) fn scene() -> String {
    let mut text = include_str!("many_lights.pbrt").to_owned();
    let quads: Vec<Quad> = BLOCKS.into_iter().flat_map(sides).collect();
    text += "\nNamedMaterial \"stone\"\n";
    write_mesh(&mut text, &quads);
    text += "\n# The lamps, spheres of radius 1 in units of their radius. Each place is relative to the lamp before.\n";
    text += "NamedMaterial \"lamp\"\n";
    for (group, [r, g, b]) in GROUPS.into_iter().enumerate() {
        let _ = writeln!(text, "AttributeBegin\nScale {RADIUS} {RADIUS} {RADIUS}");
        let _ = writeln!(text, "AreaLightSource \"diffuse\" \"rgb L\" [ {r} {g} {b} ]");
        let mut before = [0; 3];
        for lamp in (0..ROWS * ROWS).filter(|lamp| group_of(lamp % ROWS, lamp / ROWS) == group as u32) {
            let (column, row) = (lamp % ROWS, lamp / ROWS);
            let along = |k: u32| i64::from(SPACING * k) - i64::from(SPACING * ROWS / 2);
            let place = [along(column), along(row), height(column, row)];
            let [x, y, z] = [0, 1, 2].map(|k| place[k] - before[k]);
            let _ = writeln!(text, "Translate {x} {y} {z} Shape \"sphere\"");
            before = place;
        }
        text += "AttributeEnd\n";
    }
    text
}
