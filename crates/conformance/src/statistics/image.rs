//! Tests of equal expectations of two images, and of the bias due to adaptive counts that depend on kept samples.

use super::levels::{adjusted, gamma_q};
use super::{Mean, MeanTest};
use dapple_core::plan::{Feedback, Plan, Progress, Retention};
use dapple_core::{Block, Draws, Error, Estimate, Film, Integrator, Needs, PointSet, Sampler, Worker};

/// The side of a block in pixels. Means over a block are nearly normal.
const BLOCK: usize = 8;
/// The |z| above which a block is an outlier; 5 % of blocks exceed it by chance.
const OUTLYING: f64 = 1.96;
/// The number of bootstrap resamples that estimate the spread of the pooled statistics (number of outliers, sum of
/// squared z).
const RESAMPLES: usize = 200;

/// The p-values of an image test. `blocks` and `global` are p-values of the largest of several deviations, adjusted for the
/// number of deviations.
#[derive(Clone, Copy, Debug)]
pub struct ImageTest {
    /// The p-value of the 8x8 block and channel that deviates most.
    pub blocks: f64,
    /// The p-value of the image's mean in the channel that deviates most.
    pub global: f64,
    /// The p-value of the number of blocks with |z| above 1.96.
    pub outliers: f64,
    /// The two-sided p-value of the sum of squared z values. A sum that is too small means that the two images share samples.
    pub spread: f64,
}

impl ImageTest {
    /// The p-value of the four statistics together.
    pub fn p(&self) -> f64 {
        adjusted([self.blocks, self.global, self.outliers, self.spread].into_iter().fold(1.0, f64::min), 4)
    }
}

/// Tests that replicates of two images, `width` pixels wide, have the same expectation.
///
/// Use at least 16 replicates of each image (64 for heavy tails), each with its own seed. All pixels are tested, in blocks of
/// 8x8. Blocks without noise must be equal in both images.
///
/// # Panics
///
/// If there are fewer than 2 replicates, or the sizes of images differ.
pub fn images(width: usize, a: &[Vec<[f64; 3]>], b: &[Vec<[f64; 3]>]) -> ImageTest {
    test(&Group::new(width, a), Some(&Group::new(width, b)), None)
}

/// Tests that the expectation of the replicates is the noiseless image `exact`, `width` pixels wide.
///
/// # Panics
///
/// If there are fewer than 2 replicates, or the sizes of images differ.
pub fn image(width: usize, replicates: &[Vec<[f64; 3]>], exact: &[[f64; 3]]) -> ImageTest {
    let exact = Group::new(width, std::slice::from_ref(&exact.to_vec()));
    test(&Group::new(width, replicates), None, Some(&exact.blocks[0]))
}

/// The block means of each replicate, three channels per block, and the weight of each block.
struct Group {
    blocks: Vec<Vec<f64>>,
    weights: Vec<f64>,
}

impl Group {
    fn new(width: usize, replicates: &[Vec<[f64; 3]>]) -> Self {
        let pixels = replicates[0].len();
        assert!(replicates.iter().all(|r| r.len() == pixels) && pixels.is_multiple_of(width), "images differ in size");
        let across = width.div_ceil(BLOCK);
        let count = across * (pixels / width).div_ceil(BLOCK);
        let block = |i: usize| i / width / BLOCK * across + i % width / BLOCK;
        let mut weights = vec![0.0; count];
        (0..pixels).for_each(|i| weights[block(i)] += 1.0);
        let means = |image: &Vec<[f64; 3]>| {
            let mut sums = vec![0.0; 3 * count];
            for (i, pixel) in image.iter().enumerate() {
                (0..3).for_each(|c| sums[3 * block(i) + c] += pixel[c]);
            }
            sums.iter().enumerate().map(|(k, s)| s / weights[k / 3]).collect()
        };
        Self { blocks: replicates.iter().map(means).collect(), weights }
    }

    /// The mean of channel `c` over the image and the replicates.
    fn whole(&self, c: usize) -> Mean {
        let total: f64 = self.weights.iter().sum();
        let mean = |r: &Vec<f64>| self.weights.iter().enumerate().map(|(k, w)| w * r[3 * k + c]).sum::<f64>() / total;
        self.blocks.iter().map(mean).collect()
    }

    /// The mean of figure `k` (a block's mean in one channel) over the replicates in `chosen`.
    fn figure(&self, k: usize, chosen: impl Iterator<Item = usize>) -> Mean {
        chosen.map(|r| self.blocks[r][k]).collect()
    }

    /// Returns the group with each block's mean over replicates subtracted.
    fn centred(&self) -> Self {
        let n = self.blocks.len() as f64;
        let mean = |k: usize| self.blocks.iter().map(|r| r[k]).sum::<f64>() / n;
        let means: Vec<f64> = (0..self.blocks[0].len()).map(mean).collect();
        let centre = |r: &Vec<f64>| r.iter().zip(&means).map(|(x, m)| x - m).collect();
        Self { blocks: self.blocks.iter().map(centre).collect(), weights: self.weights.clone() }
    }
}

fn compare(a: &Mean, b: Option<&Mean>, exact: Option<f64>) -> MeanTest {
    match b {
        Some(b) => a.against_estimate(b),
        None => a.against(exact.unwrap_or(0.0)),
    }
}

fn test(a: &Group, b: Option<&Group>, exact: Option<&Vec<f64>>) -> ImageTest {
    let figures = a.blocks[0].len();
    assert!(
        a.blocks.len() > 1 && b.is_none_or(|b| b.blocks.len() > 1 && b.blocks[0].len() == figures),
        "give at least two replicates of the same size"
    );
    assert!(exact.is_none_or(|e| e.len() == figures), "images differ in size");
    let all = |g: &Group, k| g.figure(k, 0..g.blocks.len());
    let tests: Vec<MeanTest> =
        (0..figures).map(|k| compare(&all(a, k), b.map(|b| all(b, k)).as_ref(), exact.map(|e| e[k]))).collect();
    let worst = tests.iter().max_by(|x, y| x.z().abs().total_cmp(&y.z().abs())).expect("at least one block");
    let whole = |c: usize| {
        let total: f64 = a.weights.iter().sum();
        let exact = exact.map(|e| a.weights.iter().enumerate().map(|(k, w)| w * e[3 * k + c]).sum::<f64>() / total);
        compare(&a.whole(c), b.map(|b| b.whole(c)).as_ref(), exact).p()
    };
    let seen = pooled(tests.iter().map(MeanTest::z));
    let [outliers, spread] = null(a, b, seen);
    let global = (0..3).map(whole).fold(1.0, f64::min);
    ImageTest { blocks: adjusted(worst.p(), figures), global: adjusted(global, 3), outliers, spread }
}

/// The pooled statistics: the number of z values that are outliers, and the sum of all squared z values.
fn pooled(deviates: impl Iterator<Item = f64>) -> [f64; 2] {
    let mut sums = [0.0; 2];
    for z in deviates {
        sums[0] += f64::from(u8::from(z.abs() > OUTLYING));
        sums[1] += z * z;
    }
    sums
}

/// The p-values of the pooled statistics: the number of outliers, and the sum of squared z values.
///
/// Blocks and channels are correlated: the same light affects several of them, and they share a budget. So the spread of the
/// statistics is estimated from bootstrap resamples. The tails are taken from a scaled chi-square distribution with the same
/// mean and variance [after Satterthwaite 1946].
fn null(a: &Group, b: Option<&Group>, seen: [f64; 2]) -> [f64; 2] {
    let (a, b) = (a.centred(), b.map(Group::centred));
    let mut random = 0x5eed_u64;
    let mut draw = |n: usize| -> Vec<usize> {
        let mut one = || {
            random = random.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let x = (random ^ (random >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            (x ^ (x >> 31)) as usize % n
        };
        (0..n).map(|_| one()).collect()
    };
    let mut found = [Mean::default(); 2];
    let mut squares = [Mean::default(); 2];
    for _ in 0..RESAMPLES {
        let chosen = draw(a.blocks.len());
        let other = b.as_ref().map(|b| (b, draw(b.blocks.len())));
        let deviate = |k: usize| {
            let reference = other.as_ref().map(|(b, chosen)| b.figure(k, chosen.iter().copied()));
            let test = compare(&a.figure(k, chosen.iter().copied()), reference.as_ref(), Some(0.0));
            // A block without spread does not count here.
            if test.standard_error > 0.0 { test.z() } else { 0.0 }
        };
        let sums = pooled((0..a.blocks[0].len()).map(deviate));
        for i in 0..2 {
            found[i].add(sums[i]);
            squares[i].add(sums[i] * sums[i]);
        }
    }
    let tails = |i: usize| {
        let mean = found[i].mean;
        let variance = squares[i].mean - mean * mean;
        if mean == 0.0 || variance <= 0.0 {
            // No block has any spread.
            return if seen[i] == 0.0 { [1.0, 1.0] } else { [0.0, 1.0] };
        }
        let scale = variance / (2.0 * mean);
        let above = gamma_q(mean / (2.0 * scale), seen[i] / (2.0 * scale));
        [above, 1.0 - above]
    };
    let [above, below] = tails(1);
    [tails(0)[0].min(1.0), (2.0 * above.min(below)).min(1.0)]
}

/// The expected mean of a pixel whose samples are 1 with probability `p`, else 0. The pixel keeps its first `pilot` samples. If
/// they differ, more samples are added, up to `total`.
///
/// For `n = pilot`, `N = total`, `P = 1 - p^n - (1 - p)^n`: `p^n + (n p - n p^n + (N - n) p P) / N` [after Kirk and Arvo 1991].
pub fn kept(p: f64, pilot: u32, total: u32) -> f64 {
    let (first, all) = (f64::from(pilot), f64::from(total));
    let [ones, mixed] = outcomes(p, pilot);
    ones + (first * p - first * ones + (all - first) * p * mixed) / all
}

/// The expected mean of a pixel whose samples are 1 with probability `p`, else 0. The first `pilot` samples are kept if they
/// are equal; if they differ, new samples replace them, as in pbrt-v2.
pub fn refined(p: f64, pilot: u32) -> f64 {
    let [ones, mixed] = outcomes(p, pilot);
    ones + mixed * p
}

/// The probability that all pilot samples are 1, and the probability that they differ.
fn outcomes(p: f64, pilot: u32) -> [f64; 2] {
    let ones = p.powi(pilot as i32);
    [ones, 1.0 - ones - (1.0 - p).powi(pilot as i32)]
}

/// An integrator whose samples are 1 with this probability, else 0, in every pixel.
#[derive(Clone, Copy, Debug)]
pub struct Bernoulli(pub f32);

impl Integrator for Bernoulli {
    fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
        let [u, ..] = draws.block(Block::new(0));
        Estimate::new([f32::from(u8::from(u < self.0)); 3])
    }
}

/// A deliberately biased sampler, the negative control of every test of bias. A pixel stops if its pilot samples are all equal,
/// and keeps all samples.
#[derive(Clone, Copy, Debug)]
pub struct BiasedSampler<P> {
    /// The point set that supplies the samples' random numbers.
    pub points: P,
    /// The number of pilot samples per pixel.
    pub pilot: u32,
    /// The total number of samples of a pixel whose pilot samples differ.
    pub total: u32,
}

impl<P: PointSet> Sampler for BiasedSampler<P> {
    fn name(&self) -> &str {
        "naive"
    }

    fn needs(&self) -> Needs {
        Needs::none().with_variance()
    }

    fn points(&self) -> &dyn PointSet {
        &self.points
    }

    fn next_round(&mut self, seen: &Feedback<'_>, plan: &mut Plan) -> Result<Progress, Error> {
        plan.retention = Retention::Keep;
        for (i, n) in plan.counts.iter_mut().enumerate() {
            *n = match seen.round {
                0 => self.pilot,
                1 if seen.film.moments(i).m2.iter().any(|&m| m > 0.0) => self.total - self.pilot,
                _ => 0,
            };
        }
        Ok(if plan.total() > 0 { Progress::Trace } else { Progress::Done })
    }
}

/// The mean of the image's first channel over pixels.
pub fn image_mean(film: &Film) -> f64 {
    let pixels = film.frame().pixels();
    (0..pixels).map(|i| film.mean(i)[0]).sum::<f64>() / pixels as f64
}

/// One replicate for [`count_trend`]: the final count and the value of each pixel.
#[derive(Clone, Debug, Default)]
pub struct Pixels {
    /// The number of kept samples of each pixel.
    pub counts: Vec<f64>,
    /// The radiance of each pixel: one channel, or the mean of all channels.
    pub values: Vec<f64>,
}

impl Pixels {
    /// The counts, and the means over channels, of a film's pixels.
    pub fn of(film: &Film) -> Self {
        let pixels = 0..film.frame().pixels();
        let value = |i| film.mean(i).iter().sum::<f64>() / 3.0;
        Self { counts: pixels.clone().map(|i| film.count(i) as f64).collect(), values: pixels.map(value).collect() }
    }
}

/// A test statistic for a trend of pixel values with sample counts. It is standard normal if values and counts are unrelated,
/// negative if pixels with few samples are too bright, and 0 if no pixel's count varies. Needs at least 2 replicates.
///
/// The statistic is the sum of `(ln(count) - c) * (value - v)` over pixels and replicates, divided by its standard deviation.
/// `c` and `v` are the pixel's means over the replicates. Variances may depend on the count [after White 1980].
pub fn count_trend(replicates: &[Pixels]) -> f64 {
    let pixels = replicates[0].counts.len();
    let n = replicates.len() as f64;
    let (mut sum, mut square) = (0.0, 0.0);
    for i in 0..pixels {
        let count = |r: &Pixels| r.counts[i].max(0.5).ln();
        if replicates.iter().all(|r| r.counts[i] == replicates[0].counts[i]) {
            continue;
        }
        let centre = replicates.iter().map(count).sum::<f64>() / n;
        let level = replicates.iter().map(|r| r.values[i]).sum::<f64>() / n;
        for r in replicates {
            let product = (count(r) - centre) * (r.values[i] - level);
            sum += product;
            square += product * product;
        }
    }
    // Distances from the pixel's own mean have one degree of freedom less.
    if sum == 0.0 { 0.0 } else { sum / (square * n / (n - 1.0)).sqrt() }
}

/// Sums that compare error estimates with true errors, over many pixels and seeds.
#[derive(Clone, Copy, Debug, Default)]
pub struct Calibration {
    held: u64,
    all: u64,
    forecast: f64,
    real: f64,
}

impl Calibration {
    /// Adds `estimate`, whose predicted variance is `forecast`. The true value was measured as `truth`, with variance `noise`.
    ///
    /// The confidence interval is `estimate ± sqrt(quantile^2 forecast + 1.96^2 noise)`. For 95 %, `quantile` is 1.96, or the
    /// quantile of Student's t if the forecast has few degrees of freedom.
    pub fn add(&mut self, estimate: f64, forecast: f64, truth: f64, noise: f64, quantile: f64) {
        let off = estimate - truth;
        let reach = (quantile * forecast.sqrt()).hypot(1.96 * noise.sqrt());
        self.held += u64::from(off.abs() <= reach);
        self.all += 1;
        self.forecast += forecast;
        self.real += off * off - noise;
    }

    /// The fraction of intervals that contain the true value.
    pub fn coverage(&self) -> f64 {
        self.held as f64 / self.all as f64
    }

    /// The ratio of the predicted to the true root mean squared error.
    pub fn ratio(&self) -> f64 {
        (self.forecast / self.real).sqrt()
    }

    /// Returns `true` if the 95 % intervals contain 93 to 97 % of true values, and
    /// [`ratio`](Self::ratio) is from 0.9 to 1.1.
    pub fn is_honest(&self) -> bool {
        (0.93..=0.97).contains(&self.coverage()) && (0.9..=1.1).contains(&self.ratio())
    }
}
