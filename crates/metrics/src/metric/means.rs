//! The sRGB MSE of the means of 4x4 pixels: the error seen by an eye that does not resolve single pixels.

use super::Measurement;
use crate::compare::srgb_encode;
use crate::sum::Sum;
use crate::{MetricsError, Pixels, block_means};

/// Mean of `(x - a) (x - b)` over blocks and channels, in sRGB values of 0 to 255. x is a block's mean in the image, a and b
/// are its means in the reference's two halves. The noise of the halves is independent, so that it cancels.
pub(super) fn of(measurement: &Measurement<'_>) -> Result<f64, MetricsError> {
    let (image, reference) = (measurement.image, measurement.reference);
    let halves = measurement.variance.map(|variance| halves(reference.values, variance.values));
    let [a, b] = halves.as_ref().map_or([reference.values; 2], |[a, b]| [a, b]);
    let [x, a, b] = [displayed(image.size, image.values)?, displayed(image.size, a)?, displayed(image.size, b)?];
    let products: Sum = x.iter().zip(a.iter().zip(&b)).map(|(x, (a, b))| (x - a) * (x - b)).collect();
    Ok(255.0 * 255.0 * products.value() / x.len() as f64)
}

/// The sRGB values of the block means. A block is 4 pixels long, or as long as a shorter side of the image.
fn displayed(size: [u32; 2], values: &[[f32; 3]]) -> Result<Vec<f64>, MetricsError> {
    let means = block_means(Pixels::new(size, values)?, size.map(|side| side.min(4)))?.means;
    Ok(means.into_iter().flatten().map(srgb_encode).collect())
}

/// The two halves of the reference, computed from its mean and variance. Which half is brighter is random for each pixel and
/// channel. A half that is brighter everywhere would be biased, with correlated noise in neighbouring pixels.
pub(super) fn halves(reference: &[[f32; 3]], variance: &[[f32; 3]]) -> [Vec<[f32; 3]>; 2] {
    [1.0, -1.0].map(|order: f32| {
        let values = reference.iter().zip(variance).enumerate();
        let of_pixel = |(i, (r, v)): (usize, (&[f32; 3], &[f32; 3]))| {
            std::array::from_fn(|c| {
                let hash = (3 * i as u64 + c as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
                let hash = (hash ^ hash >> 31).wrapping_mul(0xbf58_476d_1ce4_e5b9);
                r[c] + if hash >> 63 == 0 { order } else { -order } * v[c].sqrt()
            })
        };
        values.map(of_pixel).collect()
    })
}
