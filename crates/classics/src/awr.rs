//! Adaptive wavelet rendering: the variance of wavelet coefficients determines which blocks of pixels get samples.

use crate::method::{MethodSampler, SamplingMethod};
use crate::method::{next_step, with_extra};
use crate::wavelets::{Basis, Taps, coefficient_variances, high_band, sizes, transform};
use crate::windows::{around, filled_means, per_pixel};
use dapple_core::plan::{Feedback, PilotPolicy, Plan, saturating_u32};
use dapple_core::{Error, Film, point_set::mix};
use std::cmp::Reverse;
use std::collections::BinaryHeap;

dapple_core::options! {
    /// The parameters of [`Awr`].
    pub struct AwrOptions {
        /// Wavelets: cdf97 or cdf53 (smooth, by Cohen, Daubechies and Feauveau), or haar (blocks).
        pub basis: Basis = Basis::Cdf97 => "cdf97";
        /// Number of wavelet levels.
        pub levels: usize = 5, |levels| levels <= 8, "0 to 8";
        /// Samples per pixel before counts adapt.
        pub pilot: u32 = 4, |pilot| pilot >= 2, "at least 2, since one sample has no variance";
        /// Rounds after the pilot, each with an equal share of the remaining budget.
        pub rounds: u32 = 4, |rounds| (1..=1024).contains(&rounds), "1 to 1024";
        /// keep: samples used to set counts stay in the image (biased, as published); the only value.
        pub policy: PilotPolicy = PilotPolicy::Keep => "keep",
            |policy| policy == PilotPolicy::Keep, "only keep";
    }
}

/// The sampler of adaptive wavelet rendering [after Overbeck, Donner and Ramamoorthi 2009].
///
/// Blocks of 1, 2x2, 4x4 and more pixels compete for samples. The priority of a block of `n` pixels is `n (V - D) / (s^2 +
/// 0.01)`. `V` is the variance of the block's mean, and `s` its scaling coefficient. `D` is the mean square of its three
/// wavelet coefficients, minus the noise expected in them. Where a block crosses an edge, `D` is large, and the block ranks
/// below its parts. The block with the highest priority gets four samples per pixel, at most 64 in all. The `V` of all blocks
/// that contain these pixels is lowered, and the next block is picked. [`Wavelet`](crate::Wavelet) is the matching filter.
///
/// The authors' formula for the priority was not available. The following are not from the paper either: averaging sample
/// variances over 3x3 pixels, dividing them by the squared brightness, the values of levels, batches, rounds and pilot, and the
/// use of `V` in place of the scaling coefficient's variance (equal for Haar wavelets).
///
/// *Guarantees*: spends the budget exactly, and takes the pilot in every pixel if the budget allows. *Bias*: sample counts
/// depend on the samples, and all samples are kept [Kirk and Arvo 1991]. *Weaknesses*: counts suit wavelet shrinkage; the
/// errors of filters that use features lie elsewhere. A single thread distributes the samples.
pub type Awr<P> = MethodSampler<P, AwrOptions>;

impl SamplingMethod for AwrOptions {
    const NAME: &'static str = "awr";
    // The image and its transposed copy with variances; then blocks of all levels and the heap.
    const PLANNING: usize = 108 + 2 * (size_of::<WaveletBlock>() + size_of::<Waiting>()) * 4 / 3;

    fn pilot_and_rounds(&self, _: u64) -> (u32, Option<u32>) {
        (self.pilot, Some(self.rounds))
    }

    fn refine(&self, seen: &Feedback<'_>, first: u32, _: &mut Option<f64>, plan: &mut Plan) -> Result<(), Error> {
        let mut queue = Queue::new(seen, self);
        let left = queue.hand_out(next_step(seen, first, self.rounds));
        let counts: Vec<u32> = queue.pixels.iter().map(|pixel| pixel.added).collect();
        plan.counts = with_extra(seen, counts, left)?;
        Ok(())
    }
}

/// A block of pixels at one level of the wavelet transform.
#[derive(Clone, Copy)]
struct WaveletBlock {
    /// One over the squared mean brightness plus 0.01.
    unit: f64,
    /// The part of the mean's variance that the wavelets attribute to detail.
    detail: f64,
    /// The sum of the variances of the block's pixels.
    sum: f64,
    /// The number of pixels in the block.
    area: f64,
    /// The number of samples that were assigned to the block as a whole.
    given: u64,
}

impl WaveletBlock {
    /// A block without pixels yet, with this mean colour and detail.
    fn new(colour: &[f64; 3], detail: f64) -> Self {
        let grey = colour.iter().sum::<f64>() / 3.0;
        Self { unit: 1.0 / (grey * grey + BLACK), detail, sum: 0.0, area: 0.0, given: 0 }
    }

    /// The squared error that samples in this block would reduce, relative and summed over its pixels.
    fn key(&self) -> f64 {
        let variance = self.sum / (self.area * self.area);
        self.area * self.unit * (variance - self.detail)
    }
}

/// A queued block: the bits of its key, its level, a hash that breaks ties, and its number. Positive floats sort by their bits.
/// Among equal keys, coarse blocks come first.
type Waiting = (u64, u32, Reverse<u64>, u32);

fn waiting(key: f64, level: u32, block: u32) -> Waiting {
    (key.to_bits(), level, Reverse(mix(block.into())), block)
}

/// The sample counts of a pixel in a round.
#[derive(Clone, Copy)]
struct PixelCount {
    /// The variance of one sample.
    variance: f64,
    /// The count before the round.
    before: u32,
    /// The samples planned in this round.
    added: u32,
}

/// A queue of the blocks of all levels, by key.
struct Queue {
    size: [usize; 2],
    sizes: Vec<[usize; 2]>,
    levels: Vec<Vec<WaveletBlock>>,
    pixels: Vec<PixelCount>,
    heap: BinaryHeap<Waiting>,
    ceiling: u32,
    /// A hash of the round.
    salt: u64,
}

/// The number added to the squared brightness in the denominator of relative variances.
const BLACK: f64 = 0.01;

impl Queue {
    fn new(seen: &Feedback<'_>, options: &AwrOptions) -> Self {
        let size = seen.frame().size().map(|n| n as usize);
        let (mut image, unpooled) = filled_means(seen.film);
        let variances = pooled(seen.film, size, &image, &unpooled);
        let sizes = sizes(size, options.levels);
        let finest = |i: usize| WaveletBlock { sum: variances[i], area: 1.0, ..WaveletBlock::new(&image[i], 0.0) };
        let mut levels = vec![per_pixel(seen.film, finest)];
        let cascade = options.basis.cascade(options.levels);
        for level in 1..=options.levels {
            transform(options.basis, size, level - 1..level, false, &mut image);
            let mut blocks = coarse_blocks(&image, size, level, &variances, &cascade[level - 1]);
            let columns = sizes[level - 1][0];
            for (i, block) in levels[level - 1].iter().enumerate() {
                let parent = &mut blocks[i / columns / 2 * sizes[level][0] + i % columns / 2];
                (parent.sum, parent.area) = (parent.sum + block.sum, parent.area + block.area);
            }
            levels.push(blocks);
        }
        let pixel = |i: usize| {
            let before = saturating_u32(seen.film.count(i));
            PixelCount { variance: variances[i] * f64::from(before.max(1)), before, added: 0 }
        };
        let pixels = per_pixel(seen.film, pixel);
        let blocks = levels.iter().zip(0..).flat_map(|(blocks, level)| {
            let keys = blocks.iter().zip(0..).map(|(of, block)| (of.key(), block)).filter(|(key, _)| *key > 0.0);
            keys.map(move |(key, block)| waiting(key, level, block))
        });
        let heap = blocks.collect();
        let (ceiling, salt) = (seen.budget.max_spp, mix(seen.budget.spent));
        Self { size, sizes, levels, pixels, heap, ceiling, salt }
    }

    /// Distributes `total` samples in batches. Returns the number left over when no block has a positive key.
    fn hand_out(&mut self, total: u64) -> u64 {
        let mut left = total;
        while left > 0 {
            let Some((key, level, _, block)) = self.heap.pop() else { break };
            let (level, block) = (level as usize, block as usize);
            let now = self.levels[level][block].key();
            // Keys only fall, so a block is moved down when it reaches the top.
            if now >= f64::from_bits(key) {
                let most = left.min(self.batch(level, block));
                let taken = self.sample(level, block, most);
                left -= taken;
                if taken == 0 {
                    continue; // its pixels are at their ceiling
                }
            }
            let key = self.levels[level][block].key();
            if key > 0.0 {
                self.heap.push(waiting(key, level as u32, block as u32));
            }
        }
        left
    }

    /// The first pixel of a block, and the block's width and height within the image.
    fn place(&self, level: usize, block: usize) -> ([usize; 2], [usize; 2]) {
        let columns = self.sizes[level][0];
        let first = [block % columns, block / columns].map(|at| at << level);
        (first, [0, 1].map(|axis| (self.size[axis] - first[axis]).min(1 << level)))
    }

    /// The number of samples that a block gets at once: four per pixel, at most 64.
    fn batch(&self, level: usize, block: usize) -> u64 {
        let (_, [width, height]) = self.place(level, block);
        4 * (width * height).min(16) as u64
    }

    /// Adds samples to the pixels of a block, and returns the number added. Pixels at their ceiling get none.
    fn sample(&mut self, level: usize, block: usize, samples: u64) -> u64 {
        let (first, [width, height]) = self.place(level, block);
        let area = (width * height) as u64;
        let key = mix(self.salt ^ mix((level as u64) << 32 | block as u64));
        // The sequence continues from the last batch; otherwise the same pixels would get all samples.
        let given = self.levels[level][block].given;
        self.levels[level][block].given += samples;
        let mut taken = 0;
        for j in given..given + samples {
            let [x, y] = if area <= 16 {
                [(j % area) as usize % width, (j % area) as usize / width]
            } else {
                [0, 1].map(|axis| (spread(key, axis, j) * [width, height][axis] as f64) as usize)
            };
            taken += u64::from(self.add([first[0] + x, first[1] + y]));
        }
        taken
    }

    /// Adds a sample to a pixel, and lowers the variances of all blocks that contain it. Returns `false` if the pixel is at its
    /// ceiling.
    fn add(&mut self, [x, y]: [usize; 2]) -> bool {
        let pixel = &mut self.pixels[y * self.size[0] + x];
        let count = pixel.before.saturating_add(pixel.added);
        if count >= self.ceiling {
            return false;
        }
        pixel.added += 1;
        let of = |n: u32| pixel.variance / f64::from(n.max(1));
        let fall = of(count) - of(count + 1);
        for (level, blocks) in self.levels.iter_mut().enumerate() {
            let block = &mut blocks[(y >> level) * self.sizes[level][0] + (x >> level)];
            block.sum = (block.sum - fall).max(0.0);
        }
        true
    }
}

/// Element `j` of a sequence spread evenly over [0, 1): an additive sequence with an irrational step and a hashed start
/// [Roberts 2018].
fn spread(key: u64, axis: usize, j: u64) -> f64 {
    const STEPS: [f64; 2] = [0.754_877_666_246_692_8, 0.569_840_290_998_053_3];
    let start = (mix(key ^ axis as u64) >> 11) as f64 / (1u64 << 53) as f64;
    let at = start + j as f64 * STEPS[axis];
    at - at.floor()
}

/// The variance of each pixel's mean, from the relative sample variances of 3x3 pixels. Absolute variances would give dark
/// pixels beside a noisy light too many samples.
fn pooled(film: &Film, size: [usize; 2], image: &[[f64; 3]], unpooled: &[f64]) -> Vec<f64> {
    let unit = |i: usize| WaveletBlock::new(&image[i], 0.0).unit;
    let n = |i: usize| film.count(i).max(1) as f64;
    per_pixel(film, |i| {
        let near = around(size, i).filter(|&i| film.count(i) > 0);
        let (sum, number) =
            near.fold((0.0, 0.0), |(sum, number), i| (sum + unpooled[i] * n(i) * unit(i), number + 1.0));
        if number > 0.0 { sum / (number * n(i) * unit(i)) } else { unpooled[i] }
    })
}

/// The blocks of one level of the transformed image, before their pixels are added.
fn coarse_blocks(
    image: &[[f64; 3]],
    size: [usize; 2],
    level: usize,
    variances: &[f64],
    filters: &[Taps; 2],
) -> Vec<WaveletBlock> {
    let [_, bands @ ..] = coefficient_variances(filters, level, size, variances);
    let [columns, rows] = size.map(|n| n.div_ceil(1 << level));
    let ranges = [0, 1, 2].map(|band| high_band(size, level, band));
    let of = |i: usize| {
        let (x, y) = (i % columns, i / columns);
        let square = |[xs, ys]: &[std::ops::Range<usize>; 2]| {
            let inside = x < xs.len() && y < ys.len();
            let colour = if inside { image[(ys.start + y) * size[0] + xs.start + x] } else { [0.0; 3] };
            colour.iter().map(|w| w * w).sum::<f64>() / 3.0
        };
        let squares = ranges.iter().map(square).sum::<f64>() / 3.0;
        let noise = bands.iter().map(|band| band[i]).sum::<f64>() / 3.0;
        WaveletBlock::new(&image[y * size[0] + x], (squares - noise).max(0.0))
    };
    (0..columns * rows).map(of).collect()
}
