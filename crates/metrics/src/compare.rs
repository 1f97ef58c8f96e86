//! Error metrics of an image against its reference.

use crate::sum::Sum;
use crate::{MetricsError, Pixels};

/// The constant added to the squared reference in relMSE, so that black pixels do not dominate [after Rousselle 2011].
pub const RELATIVE_EPSILON: f64 = 0.01;

/// The fraction of worst pixels that [`Comparison::rel_mse_trimmed`] leaves out: 0.1 %.
pub const TRIMMED_SHARE: f64 = 0.001;

/// The side length in pixels of the blocks searched for [`Comparison::worst_block`].
pub const WORST_BLOCK_SIZE: u32 = 16;

/// Error metrics of an image x against its reference r, from [`compare`].
///
/// Unless noted, means are over pixels and the three channels, of linear values without clamping. All metrics replace
/// non-finite values of x by 0, so check [`non_finite`](Self::non_finite) first.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq)]
pub struct Comparison {
    /// Mean of `(x - r)^2`, in squared radiance.
    pub mse: f64,
    /// Mean of `(x - r)^2 / (r^2 + 0.01)` [after Rousselle 2011]; 0.01 is [`RELATIVE_EPSILON`].
    pub rel_mse: f64,
    /// relMSE without the 0.1 % of pixels with the largest errors ([`TRIMMED_SHARE`]). A pixel's error is the mean over
    /// its channels. Of n pixels the best `round(0.999 n)` remain, at least one.
    pub rel_mse_trimmed: f64,
    /// Mean of `|x - r| / ((|x| + |r|) / 2)`, 0..=2, and 0 where both are 0. Symmetric in x and r.
    pub smape: f64,
    /// Mean of `(s(x) - s(r))^2`, 0..=1. s clamps to 0..=1 and applies the sRGB curve [IEC 61966-2-1].
    pub display_mse: f64,
    /// `10 log10(1 / display_mse)` in dB, at most 200, the value for equal images.
    pub psnr: f64,
    /// `255^2 display_mse`: MSE on the scale of 8-bit sRGB files, computed without rounding to 8 bits.
    pub srgb8_mse: f64,
    /// Mean of x divided by mean of r, for each channel; 1 if they are equal, even if both are 0. A mean of r closer to 0
    /// than 1e-20 counts as 1e-20, so that the ratio is finite.
    pub channel_ratios: [f64; 3],
    /// Mean of x divided by mean of r over all channels together; finite like [`channel_ratios`](Self::channel_ratios).
    pub mean_ratio: f64,
    /// The number of channel values of x (not pixels) that are NaN or infinite.
    pub non_finite: u64,
    /// The block of 16x16 pixels with the largest relMSE; among equals, the first in reading order.
    pub worst_block: WorstBlock,
}

/// The block of 16x16 pixels ([`WORST_BLOCK_SIZE`]) with the largest relMSE. Blocks are smaller at the right and lower
/// edge of the image.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct WorstBlock {
    /// Column and row, from 0, of the block's upper left pixel.
    pub position: [u32; 2],
    /// Width and height of the block in pixels.
    pub size: [u32; 2],
    /// relMSE over the block's pixels and channels.
    pub rel_mse: f64,
}

/// Compares an image with its reference and returns all error metrics.
///
/// Sums are in f64 and cannot overflow, since an f64 holds the square of the largest f32.
///
/// ```
/// # use dapple_metrics::{Pixels, compare};
/// let (image, reference) = ([[0.5, 0.0, 1.0]], [[0.0, 0.0, 1.0]]);
/// let errors = compare(Pixels::new([1, 1], &image)?, Pixels::new([1, 1], &reference)?)?;
/// assert_eq!(errors.mse, 0.25 / 3.0);
/// assert_eq!(errors.channel_ratios[2], 1.0);
/// # Ok::<(), dapple_metrics::MetricsError>(())
/// ```
///
/// # Errors
/// [`MetricsError::Sizes`] if the sizes differ; [`MetricsError::NonFiniteReference`] for NaN or infinity in the
/// reference. Non-finite values in the image are not an error; they are counted.
pub fn compare(image: Pixels<'_>, reference: Pixels<'_>) -> Result<Comparison, MetricsError> {
    check(image, reference)?;
    let mut sums = Sums::default();
    let mut relative = Vec::with_capacity(reference.values.len());
    for (x, r) in image.values.iter().zip(reference.values) {
        relative.push(sums.add(x, r));
    }
    let worst_block = worst_block(&relative, reference.size);
    let [rel_mse, rel_mse_trimmed] = [mean(&relative), trimmed_mean(relative)];
    let count = 3.0 * reference.values.len() as f64;
    let display_mse = sums.display.value() / count;
    let [x, r] = [sums.image.map(Sum::value), sums.reference.map(Sum::value)];
    Ok(Comparison {
        mse: sums.squared.value() / count,
        rel_mse,
        rel_mse_trimmed,
        smape: sums.symmetric.value() / count,
        display_mse,
        psnr: -10.0 * libm::log10(display_mse.max(1e-20)),
        srgb8_mse: 255.0 * 255.0 * display_mse,
        channel_ratios: std::array::from_fn(|c| ratio(3.0 * x[c] / count, 3.0 * r[c] / count)),
        mean_ratio: ratio(total(x) / count, total(r) / count),
        non_finite: sums.non_finite,
        worst_block,
    })
}

pub(crate) fn check(image: Pixels<'_>, reference: Pixels<'_>) -> Result<(), MetricsError> {
    if image.size != reference.size {
        return Err(MetricsError::Sizes { image: image.size, reference: reference.size });
    }
    match reference.values.iter().position(|r| !r.iter().all(|v| v.is_finite())) {
        None => Ok(()),
        Some(at) => Err(MetricsError::NonFiniteReference { pixel: reference.place(at), value: reference.values[at] }),
    }
}

#[derive(Default)]
struct Sums {
    squared: Sum,
    symmetric: Sum,
    display: Sum,
    image: [Sum; 3],
    reference: [Sum; 3],
    non_finite: u64,
}

impl Sums {
    /// Adds a pixel to the sums. Returns the pixel's relMSE, the mean of `(x - r)^2 / (r^2 + 0.01)` over its channels.
    fn add(&mut self, image: &[f32; 3], reference: &[f32; 3]) -> f64 {
        let mut relative = 0.0;
        for c in 0..3 {
            let finite = image[c].is_finite();
            self.non_finite += u64::from(!finite);
            let x = if finite { f64::from(image[c]) } else { 0.0 };
            let r = f64::from(reference[c]);
            let squared = (x - r) * (x - r);
            self.squared.add(squared);
            relative += squared / (r * r + RELATIVE_EPSILON);
            let size = (x.abs() + r.abs()) / 2.0;
            self.symmetric.add(if size > 0.0 { (x - r).abs() / size } else { 0.0 });
            // The sRGB curve takes most of the time; equal values do not need it.
            if x != r {
                let display = srgb_encode(x) - srgb_encode(r);
                self.display.add(display * display);
            }
            self.image[c].add(x);
            self.reference[c].add(r);
        }
        relative / 3.0
    }
}

fn total(channels: [f64; 3]) -> f64 {
    channels.into_iter().collect::<Sum>().value()
}

fn ratio(x: f64, r: f64) -> f64 {
    if x == r { 1.0 } else { x / r.abs().max(1e-20).copysign(r) }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().copied().collect::<Sum>().value() / values.len() as f64
}

fn trimmed_mean(mut values: Vec<f64>) -> f64 {
    // The number of remaining pixels is rounded half to even, and is at least one.
    let kept = (values.len() as f64 * (1.0 - TRIMMED_SHARE)).round_ties_even().max(1.0) as usize;
    // Sorted, not partitioned, so that the order of the sum is defined.
    values.sort_unstable_by(f64::total_cmp);
    mean(&values[..kept])
}

/// The block with the largest relMSE; among equals, the first in reading order. `relative` is the relMSE of each pixel.
fn worst_block(relative: &[f64], size: [u32; 2]) -> WorstBlock {
    let side = WORST_BLOCK_SIZE;
    let mut worst: Option<WorstBlock> = None;
    for y in (0..size[1]).step_by(side as usize) {
        for x in (0..size[0]).step_by(side as usize) {
            let [w, h] = [side.min(size[0] - x), side.min(size[1] - y)];
            let row = |y: u32| {
                let start = y as usize * size[0] as usize + x as usize;
                &relative[start..start + w as usize]
            };
            let sum: Sum = (y..y + h).flat_map(row).copied().collect();
            let rel_mse = sum.value() / f64::from(w * h);
            if worst.is_none_or(|worst| rel_mse > worst.rel_mse) {
                worst = Some(WorstBlock { position: [x, y], size: [w, h], rel_mse });
            }
        }
    }
    // `Pixels` has at least one pixel, hence one block.
    worst.unwrap_or(WorstBlock { position: [0, 0], size, rel_mse: 0.0 })
}

/// Converts a finite linear intensity, clamped to 0..=1, to an sRGB value in 0..=1 [IEC 61966-2-1]. Uses IEEE-exact
/// operations only, so that results are bit-identical on every machine.
pub(crate) fn srgb_encode(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    if x <= 0.003_130_8 {
        return 12.92 * x;
    }
    // x^(1/2.4) = ((x^(1/4))^(1/3))^5, the cube root of t in 0.23..=1 by Newton's iteration. `pow` of the platform's
    // libm would differ between machines.
    let t = x.sqrt().sqrt();
    let mut root = (t + 2.0) / 3.0;
    for _ in 0..6 {
        root -= (root - t / (root * root)) / 3.0;
    }
    1.055 * root.powi(5) - 0.055
}
