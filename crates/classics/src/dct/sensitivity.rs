//! The visibility of errors by their frequency and by the luminance around them.

use super::cosines::{Fit, SIDE};

/// The quantisation steps of luminance [ITU-T T.81 1992, annex K], by rows of rising horizontal frequency.
const LUMINANCE: [[u8; 8]; 8] = [
    [16, 11, 10, 16, 24, 40, 51, 61],
    [12, 12, 14, 19, 26, 58, 60, 55],
    [14, 13, 16, 24, 40, 57, 69, 56],
    [14, 17, 22, 29, 51, 87, 80, 62],
    [18, 22, 37, 56, 68, 109, 103, 77],
    [24, 35, 55, 64, 81, 104, 113, 92],
    [49, 64, 78, 87, 103, 121, 120, 101],
    [72, 92, 95, 98, 112, 100, 103, 99],
];

/// The quantisation steps of chroma [ITU-T T.81 1992, annex K] at the four lowest frequencies along both axes.
const CHROMA: [[u8; 4]; 4] = [[17, 18, 24, 47], [18, 21, 26, 66], [24, 26, 56, 99], [47, 66, 99, 99]];
/// The step of chroma at all other frequencies.
const CHROMA_BEYOND: u8 = 99;

/// The step that has sensitivity 1: that of the mean luminance.
const UNIT: f64 = 16.0;

/// The sensitivity to a channel's error at a frequency of half waves per eight pixels: the reciprocal of JPEG's step.
fn sensitivity(channel: usize, [u, v]: [usize; 2]) -> f64 {
    let step = match channel {
        0 => LUMINANCE[v.min(7)][u.min(7)],
        _ => CHROMA.get(v).and_then(|row| row.get(u)).copied().unwrap_or(CHROMA_BEYOND),
    };
    UNIT / f64::from(step)
}

/// The weight of a channel's squared error, at the lowest frequencies that its fit lacks. A fit that lacks none has the
/// weight of the highest.
pub(super) fn weight(fit: &Fit, channel: usize) -> f64 {
    let unfitted = fit.first_unfitted(channel);
    let band = if unfitted.is_empty() { &fit.frequencies[fit.frequencies.len() - 1..] } else { unfitted };
    let per_block = |[u, v]: [usize; 2]| [u * SIDE as usize / fit.size[0], v * SIDE as usize / fit.size[1]];
    let squares = band.iter().map(|&frequency| sensitivity(channel, per_block(frequency)).powi(2));
    squares.sum::<f64>() / band.len() as f64
}

/// The weight of squared errors around a luminance, relative to the mean luminance of the image: bright parts mask them.
pub(super) fn masking(luminance: f64, mean: f64, exponent: f64) -> f64 {
    if mean > 0.0 { libm::pow((luminance / mean).max(DARKEST), -2.0 * exponent) } else { 1.0 }
}

/// The least luminance that masks, relative to the image's mean.
const DARKEST: f64 = 0.01;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_count_less_at_high_frequencies_in_chroma_and_on_bright_ground() {
        assert_eq!(sensitivity(0, [0, 0]), 1.0);
        assert_eq!((sensitivity(0, [5, 4]), sensitivity(1, [3, 0])), (16.0 / 109.0, 16.0 / 47.0));
        assert_eq!((sensitivity(1, [4, 0]), sensitivity(2, [7, 7])), (16.0 / 99.0, 16.0 / 99.0));
        assert!((masking(2.0, 1.0, 0.65) - 2f64.powf(-1.3)).abs() < 1e-12);
        assert_eq!(masking(0.0, 1.0, 0.65), masking(0.01, 1.0, 0.65));
        assert_eq!((masking(3.0, 1.0, 0.0), masking(0.0, 0.0, 0.65)), (1.0, 1.0));
    }
}
