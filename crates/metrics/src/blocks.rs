//! Means over blocks of pixels, and averaging to a smaller size.

use crate::compare::check;
use crate::sum::Sum;
use crate::{MetricsError, Pixels};

/// Mean colours of an image's blocks of pixels, from [`block_means`].
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Blocks {
    /// Numbers of blocks across and down.
    pub count: [u32; 2],
    /// Mean RGB of each block, row by row from the top.
    pub means: Vec<[f64; 3]>,
}

/// Ratios of block means, image over reference, from [`block_ratios`].
#[derive(Clone, Debug, PartialEq)]
pub struct BlockRatios {
    /// For each channel, image over reference in all blocks where the reference is bright enough, ascending.
    sorted: [Vec<f64>; 3],
}

impl BlockRatios {
    /// The number of ratios of channel 0, 1 or 2. A block whose reference is too dark has no ratio.
    ///
    /// # Panics
    /// For a channel above 2.
    pub fn count(&self, channel: usize) -> usize {
        self.sorted[channel].len()
    }

    /// The ratios (image over reference) of channel 0, 1 or 2, ascending. A ratio of 1 means no bias.
    ///
    /// # Panics
    /// For a channel above 2.
    pub fn sorted(&self, channel: usize) -> &[f64] {
        &self.sorted[channel]
    }

    /// The percentile `percent` of each channel's ratios, linear between neighbours as in `numpy.percentile`. `percent` is
    /// clamped to `0..=100`. NaN if no block is bright enough.
    pub fn percentile(&self, percent: f64) -> [f64; 3] {
        self.sorted.each_ref().map(|sorted| percentile(sorted, percent))
    }
}

pub(crate) fn percentile(sorted: &[f64], percent: f64) -> f64 {
    let Some(last) = sorted.len().checked_sub(1) else { return f64::NAN };
    let at = last as f64 * percent.clamp(0.0, 100.0) / 100.0;
    // `clamp` lets NaN through; here it becomes 0.
    let below = (at as usize).min(last);
    let above = (below + 1).min(last);
    sorted[below] + (sorted[above] - sorted[below]) * (at - below as f64)
}

/// The mean colours of an image's blocks of `block` pixels (width, height), starting at the upper left corner.
///
/// Incomplete blocks at the right and lower edge are left out, so that all means are equally noisy. Non-finite channels
/// count as 0.
///
/// ```
/// # use dapple_metrics::{Pixels, block_means};
/// let image: Vec<[f32; 3]> = (0..8).map(|i| [i as f32; 3]).collect();
/// let blocks = block_means(Pixels::new([4, 2], &image)?, [2, 2])?;
/// assert_eq!((blocks.count, blocks.means[0]), ([2, 1], [2.5; 3]));
/// # Ok::<(), dapple_metrics::MetricsError>(())
/// ```
///
/// # Errors
/// [`MetricsError::Block`] if a block is empty or larger than the image.
pub fn block_means(image: Pixels<'_>, block: [u32; 2]) -> Result<Blocks, MetricsError> {
    let size = image.size;
    if block.contains(&0) || block[0] > size[0] || block[1] > size[1] {
        return Err(MetricsError::Block { block, size });
    }
    let count = [size[0] / block[0], size[1] / block[1]];
    let [w, h] = block.map(|b| b as usize);
    let pixels = block[0] as f64 * block[1] as f64;
    let mut means = Vec::with_capacity(count[0] as usize * count[1] as usize);
    for band in image.values.chunks_exact(size[0] as usize * h) {
        for x in 0..count[0] as usize {
            let mut sums = [Sum::default(); 3];
            for row in band.chunks_exact(size[0] as usize) {
                for pixel in &row[x * w..(x + 1) * w] {
                    sums.iter_mut().zip(pixel).for_each(|(sum, &v)| sum.add(finite(v)));
                }
            }
            means.push(sums.map(|s| s.value() / pixels));
        }
    }
    Ok(Blocks { count, means })
}

fn finite(value: f32) -> f64 {
    if value.is_finite() { value.into() } else { 0.0 }
}

/// Ratios of block means, image over reference, channel by channel. They reveal bias that the noise of single pixels
/// hides.
///
/// A block whose reference is too dark has no ratio. Its mean in the reference must be above 0 and at least 2 % of the
/// median over all blocks and channels of the reference.
///
/// ```
/// # use dapple_metrics::{Pixels, block_ratios};
/// let (image, reference) = (vec![[0.55; 3]; 64], vec![[0.5; 3]; 64]);
/// let ratios = block_ratios(Pixels::new([8, 8], &image)?, Pixels::new([8, 8], &reference)?, [4, 4])?;
/// assert_eq!(ratios.count(0), 4);
/// assert!((ratios.percentile(50.0)[0] - 1.1).abs() < 1e-6);
/// # Ok::<(), dapple_metrics::MetricsError>(())
/// ```
///
/// # Errors
/// [`MetricsError::Sizes`] if the sizes differ; [`MetricsError::NonFiniteReference`] for NaN or infinity in the
/// reference; [`MetricsError::Block`] if a block is empty or larger than the image.
pub fn block_ratios(image: Pixels<'_>, reference: Pixels<'_>, block: [u32; 2]) -> Result<BlockRatios, MetricsError> {
    check(image, reference)?;
    let [image, reference] = [block_means(image, block)?, block_means(reference, block)?];
    let mut levels: Vec<f64> = reference.means.iter().flatten().copied().collect();
    levels.sort_unstable_by(f64::total_cmp);
    let least = 0.02 * percentile(&levels, 50.0);
    let sorted = std::array::from_fn(|c| {
        let pairs = image.means.iter().zip(&reference.means).map(|(x, r)| (x[c], r[c]));
        // With a median of 0, `r > 0` keeps black blocks out.
        let mut ratios: Vec<f64> = pairs.filter(|&(_, r)| r > 0.0 && r >= least).map(|(x, r)| x / r).collect();
        ratios.sort_unstable_by(f64::total_cmp);
        ratios
    });
    Ok(BlockRatios { sorted })
}

/// Averages an image by area to the size `target` (width, height); returns the pixels row by row.
///
/// Each new pixel is the mean of the old pixels that it covers, weighted by the covered area. The mean of the image
/// stays the same. NaN and infinities spread to the new pixels that cover them.
///
/// ```
/// # use dapple_metrics::{Pixels, downsample};
/// let image = [[0.0; 3], [1.0; 3], [2.0; 3], [3.0; 3]];
/// assert_eq!(downsample(Pixels::new([4, 1], &image)?, [2, 1])?, [[0.5; 3], [2.5; 3]]);
/// # Ok::<(), dapple_metrics::MetricsError>(())
/// ```
///
/// # Errors
/// [`MetricsError::Target`] if a side of `target` is 0 or larger than that of the image.
pub fn downsample(image: Pixels<'_>, target: [u32; 2]) -> Result<Vec<[f32; 3]>, MetricsError> {
    let size = image.size;
    if target.contains(&0) || target[0] > size[0] || target[1] > size[1] {
        return Err(MetricsError::Target { size, target });
    }
    let [columns, rows] = [0, 1].map(|axis| spans(size[axis], target[axis]));
    // Each row is narrowed only once: neighbouring new rows share at most one old row.
    let narrow: Vec<Vec<[f64; 3]>> =
        image.rows().map(|row| columns.iter().map(|span| span.mean(|x| row[x].map(f64::from))).collect()).collect();
    let pixels = rows.iter().flat_map(|span| {
        let narrow = &narrow;
        (0..target[0] as usize).map(move |x| span.mean(|y| narrow[y][x]).map(|v| v as f32))
    });
    Ok(pixels.collect())
}

/// The range of old pixels that a new pixel covers along one axis in [`downsample`], with weights.
struct Span {
    first: usize,
    /// The covered lengths of the old pixels from `first` on, in units of `1 / target` of an old pixel.
    weights: Vec<u64>,
}

impl Span {
    fn mean(&self, value: impl Fn(usize) -> [f64; 3]) -> [f64; 3] {
        let mut sums = [Sum::default(); 3];
        for (at, &weight) in (self.first..).zip(&self.weights) {
            sums.iter_mut().zip(value(at)).for_each(|(sum, v)| sum.add(weight as f64 * v));
        }
        let total = self.weights.iter().sum::<u64>() as f64;
        sums.map(|s| s.value() / total)
    }
}

/// The spans of all new pixels along one axis of `size` old and `target` new pixels. Lengths are integers: an old pixel
/// is `target` units wide, a new one `size`.
fn spans(size: u32, target: u32) -> Vec<Span> {
    let [size, target] = [u64::from(size), u64::from(target)];
    let span = |i: u64| {
        let [start, end] = [i * size, (i + 1) * size];
        let old = start / target..end.div_ceil(target);
        let overlap = |j: u64| end.min((j + 1) * target) - start.max(j * target);
        Span { first: old.start as usize, weights: old.map(overlap).collect() }
    };
    (0..target).map(span).collect()
}
