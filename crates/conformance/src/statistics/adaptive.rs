//! S7: whether deciding on samples shows in their mean.

use dapple_core::{
    Block, Draws, Error, Estimate, Feedback, Film, Integrator, Needs, Plan, PointSet, Progress, Retention, Sampler,
    TrainingLog,
};

/// The mean of a pixel whose samples are 1 with probability `p`, else 0, that keeps `pilot` samples and goes on to `total`
/// where they differ, keeping all: `p^n + (n p - n p^n + (N - n) p Pmix) / N`, `Pmix = 1 - p^n - (1 - p)^n`
/// (after Kirk and Arvo 1991).
pub fn kept(p: f64, pilot: u32, total: u32) -> f64 {
    let (first, all) = (f64::from(pilot), f64::from(total));
    let [ones, mixed] = outcomes(p, pilot);
    ones + (first * p - first * ones + (all - first) * p * mixed) / all
}

/// The same where a mixed pilot is thrown away, and an even one stays, as pbrt-v2 has it.
pub fn refined(p: f64, pilot: u32) -> f64 {
    let [ones, mixed] = outcomes(p, pilot);
    ones + mixed * p
}

/// Probabilities of a pilot of ones only, and of a mixed one.
fn outcomes(p: f64, pilot: u32) -> [f64; 2] {
    let ones = p.powi(pilot as i32);
    [ones, 1.0 - ones - (1.0 - p).powi(pilot as i32)]
}

/// An image whose samples are 1 with this probability and else 0, in every pixel.
#[derive(Clone, Copy, Debug)]
pub struct Bernoulli(pub f32);

impl Integrator for Bernoulli {
    fn estimate(&self, draws: &Draws<'_>, _: &mut TrainingLog) -> Estimate {
        let [u, ..] = draws.block(Block::new(0));
        Estimate::new([f32::from(u8::from(u < self.0)); 3])
    }
}

/// The negative control of every test of unbiasedness: a pixel stops where its pilot's samples are all equal, else it goes on,
/// and all samples are kept.
#[derive(Clone, Copy, Debug)]
pub struct Naive<P> {
    /// Where samples lie.
    pub points: P,
    /// Samples of the pilot.
    pub pilot: u32,
    /// Samples in all of a pixel that goes on.
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

/// The mean of an image's first channel.
pub fn image_mean(film: &Film) -> f64 {
    let pixels = film.frame().pixels();
    (0..pixels).map(|i| film.mean(i)[0]).sum::<f64>() / pixels as f64
}

/// One replicate as [`count_trend`] reads it: pixels' final counts, and their values.
#[derive(Clone, Debug, Default)]
pub struct Pixels {
    /// Kept samples.
    pub counts: Vec<f64>,
    /// Means of one channel, or of all.
    pub values: Vec<f64>,
}

impl Pixels {
    /// Of a film, the mean over the channels.
    pub fn of(film: &Film) -> Self {
        let pixels = 0..film.frame().pixels();
        let value = |i| film.mean(i).iter().sum::<f64>() / 3.0;
        Self { counts: pixels.clone().map(|i| film.count(i) as f64).collect(), values: pixels.map(value).collect() }
    }
}

/// Whether values go with counts: the deviate (negative where few samples mean a bright pixel), standard normal where counts
/// say nothing of the values.
///
/// Within each pixel the logarithm of its count is taken from that count's mean over the replicates, and so is its value; what
/// the products add up to is compared with its spread, which need not be the same for all counts [after White 1980].
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
    // A value's distance from its own pixel's mean is short by one degree of freedom.
    if sum == 0.0 { 0.0 } else { sum / (square * n / (n - 1.0)).sqrt() }
}
