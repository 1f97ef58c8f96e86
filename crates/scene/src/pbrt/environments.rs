//! The illuminance of environment maps.

use crate::image::Image;
use std::f64::consts::{PI, TAU};

/// Returns the illuminance of an upward surface under the upper half (z > 0) of an environment map: the integral of
/// luminance times cosine. `equal_area` is the layout of the image: equal-area square if true, else latitude-longitude.
pub(super) fn illuminance_of(image: &Image, equal_area: bool) -> f64 {
    let [width, height] = image.size.map(f64::from);
    let luminance = |p: &[f32; 3]| {
        let [r, g, b] = p.map(f64::from);
        0.212_639 * r + 0.715_169 * g + 0.072_192 * b
    };
    let columns = image.size[0] as usize;
    let mut sum = 0.0;
    for (y, row) in image.pixels.chunks(columns).enumerate() {
        let v = (y as f64 + 0.5) / height;
        if equal_area {
            let weight = 4.0 * PI / (width * height);
            for (x, pixel) in row.iter().enumerate() {
                let z = height_of((x as f64 + 0.5) / width, v);
                if z > 0.0 {
                    sum += luminance(pixel) * z * weight;
                }
            }
        } else {
            let (sin, cos) = (PI * v).sin_cos();
            if cos > 0.0 {
                let weight = sin * cos * (PI / height) * (TAU / width);
                sum += row.iter().map(luminance).sum::<f64>() * weight;
            }
        }
    }
    sum
}

/// Returns z of the unit direction at the point (u, v) of the equal-area square [Clarberg 2008].
fn height_of(u: f64, v: f64) -> f64 {
    let inward = 1.0 - (2.0 * u - 1.0).abs() - (2.0 * v - 1.0).abs();
    let r = 1.0 - inward.abs();
    (1.0 - r * r).copysign(inward)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The illuminance under an environment of radiance 1 is pi.
    #[test]
    fn white_skies() {
        for (size, equal_area, close) in [([128, 64], false, 1e-3), ([64, 64], true, 1e-3)] {
            let image = Image::filled(size, [1.0; 3]).unwrap();
            let found = illuminance_of(&image, equal_area);
            assert!((found / PI - 1.0).abs() < close, "{found}");
        }
        // Nothing from below.
        let mut image = Image::filled([4, 4], [1.0; 3]).unwrap();
        image.pixels[..8].fill([0.0; 3]);
        assert_eq!(illuminance_of(&image, false), 0.0);
    }
}
