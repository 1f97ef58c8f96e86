//! Encoders of image files: PFM for radiance, TGA for colour.

use super::directions::lat_long_direction;

/// Encodes a latitude-longitude PFM image. `radiance` returns the RGB radiance from a unit direction (z up); it is
/// called for each pixel's centre.
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

/// Encodes an uncompressed 24-bit TGA image. `color` returns the sRGB bytes of the pixel at a column and a row, counted
/// from the top left.
pub(super) fn tga(width: u16, height: u16, color: impl Fn(u16, u16) -> [u8; 3]) -> Vec<u8> {
    // From the top left, no opacity.
    tga_of([width, height], [24, 0x20], |column, row| {
        let [red, green, blue] = color(column, row);
        [blue, green, red]
    })
}

/// Encodes an uncompressed 32-bit TGA image. `color` returns the sRGB and opacity bytes of the pixel at a column and a
/// row, counted from the top left.
pub(super) fn tga_with_alpha(width: u16, height: u16, color: impl Fn(u16, u16) -> [u8; 4]) -> Vec<u8> {
    // From the top left, 8 bits of opacity.
    tga_of([width, height], [32, 0x28], |column, row| {
        let [red, green, blue, alpha] = color(column, row);
        [blue, green, red, alpha]
    })
}

/// Encodes an uncompressed 8-bit grey TGA image. `value` returns the byte of the pixel at a column and a row, counted
/// from the top left.
pub(super) fn tga_grey(width: u16, height: u16, value: impl Fn(u16, u16) -> u8) -> Vec<u8> {
    tga_of([width, height], [8, 0x20], |column, row| [value(column, row)])
}

/// Encodes an uncompressed TGA image. `format` holds the bits per pixel and the descriptor byte. `pixel` returns the
/// bytes of the pixel at a column and a row, in the file's order.
fn tga_of<const N: usize>([width, height]: [u16; 2], format: [u8; 2], pixel: impl Fn(u16, u16) -> [u8; N]) -> Vec<u8> {
    // True colour, or grey.
    let kind = if N == 1 { 3 } else { 2 };
    // Field by field: no id, no palette, the kind, palette and origin all 0, size, format.
    let mut bytes = vec![0, 0, kind, 0, 0, 0, 0, 0, 0, 0, 0, 0];
    bytes.extend(width.to_le_bytes());
    bytes.extend(height.to_le_bytes());
    bytes.extend(format);
    for row in 0..height {
        for column in 0..width {
            bytes.extend(pixel(column, row));
        }
    }
    // The footer of TGA 2.0, without which some readers do not know the format; no extensions.
    bytes.extend([0; 8]);
    bytes.extend(b"TRUEVISION-XFILE.\0");
    bytes
}
