//! A zone plate, whose rings become finer than pixels.

use super::Assets;
use super::directions::sin_cos;
use super::images::tga_grey;

/// Side of the texture in texels: half of the plate.
const SIDE: u16 = 256;
/// The rings' phase at a radius of 1, in turns: `k = 80 pi`.
const TURNS: f64 = 40.0;

/// Returns the grey value of the texel at a column and a row, counted from the top left. The plate's centre is at the
/// lower left corner.
fn ring(column: u16, row: u16) -> u8 {
    let place = |c: u16| (f64::from(c) + 0.5) / f64::from(SIDE);
    let [x, y] = [place(column), place(SIDE - 1 - row)];
    let phase = TURNS * (x * x + y * y);
    let [sine, _] = sin_cos(phase - phase.floor());
    (255.0 * (0.5 + 0.45 * sine)).round() as u8
}

/// Returns the text of the zone plate's scene file, and its texture.
pub(super) fn scene() -> (String, Assets) {
    let texture = ("rings.tga".to_owned(), tga_grey(SIDE, SIDE, ring));
    (include_str!("zone_plate.pbrt").to_owned(), vec![texture])
}
