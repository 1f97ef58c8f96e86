//! Conversions between the colour spaces of FLIP.

use super::convolution::Plane;
use crate::Pixels;

/// The matrix from linear sRGB to CIE XYZ, rounded as in the published implementation.
const XYZ: [[f64; 3]; 3] = [
    [10_135_552.0 / 24_577_794.0, 8_788_810.0 / 24_577_794.0, 4_435_075.0 / 24_577_794.0],
    [2_613_072.0 / 12_288_897.0, 8_788_810.0 / 12_288_897.0, 887_015.0 / 12_288_897.0],
    [1_425_312.0 / 73_733_382.0, 8_788_810.0 / 73_733_382.0, 70_074_185.0 / 73_733_382.0],
];

/// The matrix from linear sRGB to XYZ relative to white; each row adds up to 1.
const RELATIVE_XYZ: [[f32; 3]; 3] = {
    let mut rows = [[0.0; 3]; 3];
    let mut i = 0;
    while i < 9 {
        let [row, c] = [i / 3, i % 3];
        rows[row][c] = (XYZ[row][c] / (XYZ[row][0] + XYZ[row][1] + XYZ[row][2])) as f32;
        i += 1;
    }
    rows
};

/// The inverse of [`RELATIVE_XYZ`], computed by cofactors: from XYZ relative to white to linear sRGB.
const RGB: [[f32; 3]; 3] = {
    let m = RELATIVE_XYZ;
    let mut inverse = [[0.0; 3]; 3];
    let mut determinant = 0.0;
    let mut i = 0;
    while i < 9 {
        let [row, c] = [i / 3, i % 3];
        // Cyclic rows and columns give cofactors with their signs.
        let [r1, r2, c1, c2] = [(row + 1) % 3, (row + 2) % 3, (c + 1) % 3, (c + 2) % 3];
        let cofactor = m[r1][c1] as f64 * m[r2][c2] as f64 - m[r1][c2] as f64 * m[r2][c1] as f64;
        if row == 0 {
            determinant += m[0][c] as f64 * cofactor;
        }
        inverse[c][row] = cofactor;
        i += 1;
    }
    let mut rounded = [[0.0; 3]; 3];
    let mut i = 0;
    while i < 9 {
        rounded[i / 3][i % 3] = (inverse[i / 3][i % 3] / determinant) as f32;
        i += 1;
    }
    rounded
};

/// The largest distance of displayable colours: [`hyab`] between [`perceived`] green and blue. Tested below.
pub(super) const LARGEST_DISTANCE: f32 = 203.301_62;

fn times(matrix: &[[f32; 3]; 3], v: [f32; 3]) -> [f32; 3] {
    matrix.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

/// Converts linear RGB to YCxCz, the linear version of L*a*b*: lightness, red-green and blue-yellow.
pub(super) fn opponent(rgb: [f32; 3]) -> [f32; 3] {
    let [x, y, z] = times(&RELATIVE_XYZ, rgb);
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

/// Clamps an image to 0..=1 and converts it to YCxCz ([`opponent`]), one plane per channel.
pub(super) fn opponent_planes(image: Pixels<'_>, size: [usize; 2]) -> [Plane; 3] {
    let mut planes = [(); 3].map(|()| Plane { size, values: Vec::with_capacity(image.values.len()) });
    for rgb in image.values {
        let displayed = rgb.map(|v| if v.is_finite() { v.clamp(0.0, 1.0) } else { 0.0 });
        planes.iter_mut().zip(opponent(displayed)).for_each(|(plane, v)| plane.values.push(v));
    }
    planes
}

/// Converts a YCxCz colour (from [`opponent`]), clamped to the display's gamut, to L*a*b*. Chroma is scaled by
/// lightness (the Hunt effect) [after Andersson 2020].
pub(super) fn perceived([lightness, red_green, blue_yellow]: [f32; 3]) -> [f32; 3] {
    let y = (lightness + 16.0) / 116.0;
    let rgb = times(&RGB, [y + red_green / 500.0, y, y - blue_yellow / 200.0]);
    let [x, y, z] = times(&RELATIVE_XYZ, rgb.map(|v| v.clamp(0.0, 1.0))).map(response);
    let lightness = 116.0 * y - 16.0;
    let chroma = 0.01 * lightness;
    [lightness, chroma * 500.0 * (x - y), chroma * 200.0 * (y - z)]
}

/// The nonlinear curve of L*a*b* [after CIE 15:2004]: a cube root, and a line below (6/29)^3.
fn response(t: f32) -> f32 {
    const KNEE: f32 = 6.0 / 29.0;
    if t > KNEE * KNEE * KNEE { libm::cbrtf(t) } else { t / (3.0 * KNEE * KNEE) + 4.0 / 29.0 }
}

/// The HyAB distance of two L*a*b* colours, meant for large differences: the sum of the lightness difference and the
/// Euclidean chroma difference [after Abasi 2020].
pub(super) fn hyab(a: [f32; 3], b: [f32; 3]) -> f32 {
    let [lightness, red_green, blue_yellow] = std::array::from_fn(|c| a[c] - b[c]);
    lightness.abs() + (red_green * red_green + blue_yellow * blue_yellow).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_distance_lies_between_green_and_blue() {
        let corner = |i: u32| perceived(opponent([0, 1, 2].map(|c| (i >> c & 1) as f32)));
        let found = hyab(corner(0b010), corner(0b100));
        assert!((found - LARGEST_DISTANCE).abs() < 1e-4 * found, "{found}");
        for (a, b) in (0..64).map(|i| (corner(i / 8), corner(i % 8))) {
            assert!(hyab(a, b) <= found * 1.000_001);
        }
    }
}
