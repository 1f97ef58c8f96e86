//! The bias of adaptive counts that depend on kept samples.

use dapple_core::{
    Block, Draws, Error, Estimate, Feedback, Film, Integrator, Needs, Plan, PointSet, Progress, Retention, Sampler,
    Worker,
};

/// The expected value of a pixel that keeps a pilot of `pilot` samples, and continues to `total` samples if the pilot's
/// samples differ.
///
/// Each sample is 1 with probability `p`, else 0. With `n = pilot` and `N = total`, the value is `p^n + (n p - n p^n +
/// (N - n) p Pmix) / N`. Here `Pmix = 1 - p^n - (1 - p)^n` [after Kirk and Arvo 1991].
pub fn kept(p: f64, pilot: u32, total: u32) -> f64 {
    let (first, all) = (f64::from(pilot), f64::from(total));
    let [ones, mixed] = outcomes(p, pilot);
    ones + (first * p - first * ones + (all - first) * p * mixed) / all
}

/// The expected value of a pixel whose samples are 1 with probability `p`, else 0. A pilot of `pilot` samples is
/// discarded if its samples differ and kept if they are equal, as in pbrt-v2.
pub fn refined(p: f64, pilot: u32) -> f64 {
    let [ones, mixed] = outcomes(p, pilot);
    ones + mixed * p
}

/// The probability of a pilot of ones only, and the probability of a pilot whose samples differ.
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

/// A deliberately biased sampler, the negative control of every test of bias. A pixel stops if its pilot's samples are
/// all equal, and all samples are kept.
#[derive(Clone, Copy, Debug)]
pub struct Naive<P> {
    /// The point set that supplies the samples' random numbers.
    pub points: P,
    /// The number of pilot samples per pixel.
    pub pilot: u32,
    /// The total number of samples of a pixel whose pilot samples differ.
    pub total: u32,
}

impl<P: PointSet> Sampler for Naive<P> {
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
    /// The mean radiance of each pixel, of one channel or over channels.
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

/// A test statistic for a trend of pixel values with counts: standard normal if they are unrelated. Negative if pixels
/// with few samples are too bright.
///
/// In each pixel, the logarithm of the count and the value are centred on their means over the replicates. The
/// statistic is the sum of their products over its standard deviation, which allows variances that differ between
/// counts [after White 1980].
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
    // The distance of a value from its own pixel's mean lacks one degree of freedom.
    if sum == 0.0 { 0.0 } else { sum / (square * n / (n - 1.0)).sqrt() }
}
