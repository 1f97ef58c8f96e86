//! Picture files made here: PFM for radiance, TGA for colour.

use super::directions::lat_long_direction;

/// A latitude-longitude PFM of `radiance`, a function of the unit direction (z up), one look a pixel.
pub(super) fn lat_long_pfm(width: usize, height: usize, radiance: impl Fn([f64; 3]) -> [f64; 3]) -> Vec<u8> {
    let mut bytes = format!("PF\n{width} {height}\n-1.0\n").into_bytes();
    // PFM begins with the bottom row.
    for row in (0..height).rev() {
        for column in 0..width {
            for channel in radiance(lat_long_direction(column, row, width, height)) {
                bytes.extend((channel as f32).to_le_bytes());
            }
        }
    }
    bytes
}

/// An uncompressed 24-bit TGA, its first pixel the top left one. `color` gives sRGB-encoded 8-bit values.
pub(super) fn tga(width: u16, height: u16, color: impl Fn(u16, u16) -> [u8; 3]) -> Vec<u8> {
    // Field by field: no id, no palette, true colour, palette and origin all 0, size, 24 bits, top-left origin.
    let mut bytes = vec![0, 0, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0];
    bytes.extend(width.to_le_bytes());
    bytes.extend(height.to_le_bytes());
    bytes.extend([24, 0x20]);
    for row in 0..height {
        for column in 0..width {
            let [red, green, blue] = color(column, row);
            bytes.extend([blue, green, red]);
        }
    }
    // The footer of TGA 2.0, without which some readers do not know the format; no extensions.
    bytes.extend([0; 8]);
    bytes.extend(b"TRUEVISION-XFILE.\0");
    bytes
}
