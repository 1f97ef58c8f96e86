//! Samplers driven by the deviation of each pixel's samples: a threshold on the confidence interval of the mean, counts from
//! upper confidence bounds, and efficiency-aware splitting at the camera.

use crate::method::{MethodSampler, SamplingMethod};
use crate::method::{WorstFirst, counts_so_far, lacking, total};
use crate::welch::two_sided_critical;
use crate::windows::{per_pixel, window_sums};
use dapple_core::plan::{Feedback, PilotPolicy, Plan, Stopping, allocate, saturating_u32, share};
use dapple_core::{Error, Film, Filter as _, Needs, film::luminance};
use dapple_denoise::Gaussian;

dapple_core::options! {
    /// The parameters of [`VarianceThreshold`]. The defaults are those of Mitsuba's `adaptive` integrator.
    pub struct VarianceThresholdOptions {
        /// A pixel stops when half the width of its confidence interval is below this fraction of its mean.
        pub threshold: f64 = 0.05, |t| t > 0.0 && t.is_finite(), "a relative error above 0";
        /// Probability that the interval misses the true mean, for normally distributed samples.
        pub alpha: f64 = 0.05, |alpha| (1e-6..=0.5).contains(&alpha), "a probability from 1e-6 to 0.5";
        /// Minimum samples per pixel before any pixel stops; with mode=budget at most spp/4, but at least 2.
        pub min: u32 = 8, |min| min >= 2, "at least 2";
        /// Maximum samples per pixel, as a multiple of the mean.
        pub cap: f64 = 32.0 => "32", |cap| cap >= 1.0 && cap.is_finite(), "at least 1";
        /// Samples per round for each pixel that has not stopped.
        pub step: u32 = 4, |step| step != 0, "at least one sample";
        /// Stopping rule: budget (widest intervals first, until spent) or threshold (until all pixels are below it, within the budget).
        pub mode: Stopping = Stopping::Budget => "budget";
        /// keep: samples used to set counts stay in the image (biased, as published); the only value.
        pub policy: PilotPolicy = PilotPolicy::Keep => "keep",
            |policy| policy == PilotPolicy::Keep, "only keep";
    }
}

/// Sampling of each pixel until the confidence interval of its mean is narrow [after Kajiya 1986; Mitsuba,
/// `src/integrators/misc/adaptive.cpp`].
///
/// A pixel stops when `t s / sqrt(n) <= threshold max(mean, 0.01 image)`. Here `n` is its sample count, `t` the two-sided
/// critical value of Student's distribution with `n - 1` degrees of freedom, and `image` the mean of all pixels. Means are
/// luminances. The deviation `s` is the luminance-weighted sum of the channels' deviations, an upper bound of the luminance's
/// deviation.
///
/// With [`Stopping::Threshold`], intervals are checked every `step` samples. [`Stopping::Budget`], the default, ranks pixels by
/// the width of their intervals. Each round adds samples to the quarter of the pixels with the widest intervals.
///
/// *Guarantees*: spends the budget exactly, or at most the budget with [`Stopping::Threshold`]. No pixel stops below `min`
/// samples if the budget allows it. With [`Stopping::Budget`], `min` is at most a quarter of the mean samples per pixel.
///
/// *Bias*: sample counts depend on the samples, and all samples are kept [Kirk and Arvo 1991]. A pixel stops when its samples
/// happen to agree, so its interval misses the true mean more often than `alpha`.
///
/// *Weaknesses*: a pixel whose first samples are equal stops for ever, even if they missed a rare light. Variances are not
/// pooled over neighbours. Fireflies keep a pixel from stopping.
pub type VarianceThreshold<P> = MethodSampler<P, VarianceThresholdOptions>;

impl VarianceThresholdOptions {
    /// Half the width of each pixel's confidence interval, divided by the largest half width at which the pixel stops.
    fn scores(&self, film: &Film) -> Vec<f64> {
        let pixels = film.frame().pixels();
        let image = (0..pixels).map(|i| luminance(film.moments(i).mean)).sum::<f64>() / pixels as f64;
        let score = |i: usize| {
            let moments = film.moments(i);
            let Some(variance) = moments.variance() else { return 0.0 };
            let error = luminance(variance.map(f64::sqrt)) / (moments.count as f64).sqrt();
            if error == 0.0 || !error.is_finite() {
                return 0.0;
            }
            let critical = two_sided_critical(self.alpha, (moments.count - 1) as f64);
            let allowed = self.threshold * luminance(moments.mean).max(DARKEST * image);
            (critical * error / allowed).min(f64::MAX)
        };
        per_pixel(film, score)
    }
}

/// The least mean to which a pixel's error is relative, as a fraction of the image's mean.
const DARKEST: f64 = 0.01;

impl SamplingMethod for VarianceThresholdOptions {
    const NAME: &'static str = "variance-threshold";
    // A score per pixel.
    const PLANNING: usize = 8 + WorstFirst::BYTES;

    fn pilot_and_rounds(&self, mean: u64) -> (u32, Option<u32>) {
        match self.mode {
            Stopping::Threshold => (self.min, None),
            Stopping::Budget => (self.min.min(saturating_u32(mean / 4)).max(2), None),
        }
    }

    fn refine(&self, seen: &Feedback<'_>, _: u32, _: &mut Option<f64>, plan: &mut Plan) -> Result<(), Error> {
        let Self { mode, step, cap, .. } = *self;
        WorstFirst { mode, step, cap }.plan(seen, &self.scores(seen.film), plan)
    }
}

dapple_core::options! {
    /// The parameters of [`UpperConfidence`]. No default is from the paper.
    pub struct UpperConfidenceOptions {
        /// Samples per pixel before counts adapt.
        pub pilot: u32 = 4, |pilot| pilot >= 2, "at least 2";
        /// Weight of the bonus for uncertainty, in units of the image's pooled deviation.
        pub bonus: f64 = 0.5, |bonus| bonus >= 0.0 && bonus.is_finite(), "0 or above";
        /// The deviations' upper bounds fail with probability budget^-confidence (budget in samples).
        pub confidence: f64 = 4.0 => "4", |k| k > 0.0 && k.is_finite(), "above 0";
        /// Epsilon in a pixel's weight, 1 / sqrt(mean^2 + epsilon).
        pub epsilon: f64 = 0.01, |epsilon| epsilon > 0.0 && epsilon.is_finite(), "a number above zero";
        /// Fraction of the budget that is spent between updates of the bounds.
        pub step: f64 = 0.12, |step| (0.01..=1.0).contains(&step), "a fraction from 0.01 to 1";
        /// keep: samples used to set counts stay in the image (biased, as published); the only value.
        pub policy: PilotPolicy = PilotPolicy::Keep => "keep",
            |policy| policy == PilotPolicy::Keep, "only keep";
    }
}

/// Counts in proportion to an upper bound of each pixel's deviation [after Carpentier and Munos 2011].
///
/// The bound is `w (s + bonus S sqrt(confidence ln(N) / n))` for a pixel of `n` samples with standard deviation `s`. The weight
/// `w` is `1 / sqrt(mean^2 + epsilon)`. `S` is the pooled deviation of the image, and `N` the budget in samples. The published
/// method gives the next sample to the pixel with the largest `bound / n`. Here, a round spends the fraction `step` of the
/// budget, and makes counts proportional to the bounds. The constants of the bound's second term are not in the paper.
///
/// The second term is large for small `n`, so a pixel whose pilot samples were all 0 is sampled again.
///
/// Means and deviations are averages over the three channels.
///
/// *Guarantees*: spends the budget exactly. No pixel gets fewer samples than the pilot. The excess error over optimal counts
/// falls as `N^(-3/2)` up to logarithms [Carpentier and Munos 2011, abstract]. *Bias*: sample counts depend on the samples, and
/// all samples are kept [Kirk and Arvo 1991]. *Weaknesses*: the second term makes counts more uniform, and each pixel is judged
/// by its own samples alone. Counts differ from those at which the point set is well stratified.
pub type UpperConfidence<P> = MethodSampler<P, UpperConfidenceOptions>;

impl UpperConfidenceOptions {
    /// The squared upper confidence bound of each pixel's weighted deviation, for a budget of `total` samples.
    fn bounds(&self, film: &Film, total: u64) -> Vec<f64> {
        let UpperConfidenceOptions { bonus, confidence, epsilon, .. } = *self;
        let pixels = film.frame().pixels();
        let variance = |i: usize| film.moments(i).variance().map(|v| grey(v).min(LARGEST));
        let (mut sum, mut known) = (0.0, 0u64);
        for v in (0..pixels).filter_map(variance) {
            sum += v;
            known += 1;
        }
        let pooled = (sum / known.max(1) as f64).sqrt();
        let log = confidence * libm::log(total.max(1) as f64);
        let bound = |i: usize| {
            let mean = grey(film.moments(i).mean);
            let deviation = variance(i).map_or(pooled, f64::sqrt);
            let n = film.count(i).max(1) as f64;
            let upper = deviation + bonus * pooled * (log / n).sqrt();
            upper * upper / (mean * mean + epsilon)
        };
        (0..pixels).map(bound).collect()
    }
}

/// The largest variance and relative variance that are used; sums of larger ones would be infinite.
const LARGEST: f64 = 1e200;

fn grey([r, g, b]: [f64; 3]) -> f64 {
    (r + g + b) / 3.0
}

impl SamplingMethod for UpperConfidenceOptions {
    const NAME: &'static str = "ucb";
    // The bound and its copy in `allocate`, the counts so far and the planned ones.
    const PLANNING: usize = 8 + 8 + 4 + 4;

    fn pilot_and_rounds(&self, _: u64) -> (u32, Option<u32>) {
        (self.pilot, None)
    }

    fn refine(&self, seen: &Feedback<'_>, _: u32, _: &mut Option<f64>, plan: &mut Plan) -> Result<(), Error> {
        let (budget, now) = (seen.budget, counts_so_far(seen));
        let floors: Vec<u32> = now.iter().map(|&n| n.max(budget.min_spp)).collect();
        let needed = total(&floors) - total(&now);
        let step = ((self.step * budget.total as f64).ceil() as u64).max(needed).min(budget.left());
        let bounds = self.bounds(seen.film, budget.total);
        plan.counts = lacking(&allocate(&bounds, &floors, budget.max_spp, total(&now) + step)?.counts, &now);
        Ok(())
    }
}

dapple_core::options! {
    /// The parameters of [`Ears`]. The defaults of `least`, `most`, `outliers` and `epsilon` are as published. The other
    /// parameters are not in the paper.
    pub struct EarsOptions {
        /// Samples per pixel before counts adapt; 0 = automatic, max(4, spp/4).
        pub pilot: u32 = 0, |pilot| pilot != 1, "at least 2; 0 chooses";
        /// Rounds after the pilot, each planned from all samples before it.
        pub rounds: u32 = 3, |rounds| (1..=64).contains(&rounds), "1 to 64";
        /// Radius in pixels of the window over which variances and costs are pooled.
        pub radius: u32 = 2, |radius| radius <= 64, "at most 64 pixels";
        /// Minimum splitting factor: samples of a pixel relative to the average pixel.
        pub least: f64 = 0.05, |least| least > 0.0 && least <= 1.0, "above 0 and at most 1";
        /// Maximum splitting factor: samples of a pixel relative to the average pixel.
        pub most: f64 = 20.0 => "20", |most| most >= 1.0 && most.is_finite(), "at least 1";
        /// Number of highest-variance pixels excluded from the variance of the image.
        ///
        /// At most a tenth of the pixels are left out.
        pub outliers: u32 = 10;
        /// Added to the denominator (the denoised value) of relative deviations.
        pub epsilon: f64 = 0.01, |epsilon| epsilon > 0.0 && epsilon.is_finite(), "a number above zero";
        /// keep: samples used to set counts stay in the image (biased); the only value.
        pub policy: PilotPolicy = PilotPolicy::Keep => "keep",
            |policy| policy == PilotPolicy::Keep, "only keep";
    }
}

/// Counts in proportion to the splitting factor of efficiency-aware Russian roulette and splitting, at depth 0 [after
/// Rath 2022].
///
/// A pixel's factor is `sqrt(V / C) sqrt(C_image / V_image)`, clamped to `[least, most]`. `V` is the variance of its samples
/// relative to the squared denoised pixel, and `C` the number of rays per sample. `V_image` and `C_image` are the means of `V`
/// and `C` over the image; `V_image` leaves out the `outliers` pixels of largest `V`. The denoiser is [`Gaussian`]. The
/// published method also splits at later vertices; this sampler splits only at the camera, where the factor is a sample count.
///
/// The budget is a number of samples, but counts minimise the error for a given number of rays. This helps under a time limit.
///
/// *Guarantees*: spends the budget exactly. No pixel gets fewer samples than the pilot. *Bias*: sample counts depend on the
/// samples, and all samples are kept [Kirk and Arvo 1991]. *Weaknesses*: the number of rays is not the time. If all samples
/// cost the same, counts follow the clamped relative deviation. The published gains come from later vertices.
pub type Ears<P> = MethodSampler<P, EarsOptions>;

impl EarsOptions {
    /// The relative variance and the number of rays of one sample, per pixel.
    fn variances_and_costs(&self, film: &Film) -> Result<Vec<[f64; 2]>, Error> {
        let estimate = Gaussian::default().apply(film)?.radiance;
        let relative = |i: usize| {
            let (moments, freedom) = (film.moments(i), film.count(i).saturating_sub(1) as f64);
            let variance = moments.variance().unwrap_or_default();
            let of = |c: usize| {
                let deviation = variance[c].sqrt() / (f64::from(estimate[i][c].max(0.0)) + self.epsilon);
                (deviation * deviation).min(LARGEST)
            };
            [freedom * (of(0) + of(1) + of(2)) / 3.0, freedom]
        };
        let parts = |i: usize| {
            let [deviations, freedom] = relative(i);
            [deviations, freedom, film.cost(i).unwrap_or(0) as f64, film.count(i) as f64]
        };
        let size = film.frame().size().map(|n| n as usize);
        let sums = window_sums(size, self.radius as usize, parts);
        // A sample takes at least one ray.
        Ok(sums
            .iter()
            .map(|[v, freedom, rays, samples]| [v / freedom.max(1.0), (rays / samples.max(1.0)).max(1.0)])
            .collect())
    }

    /// The splitting factor of each pixel, from the variance and the cost of one sample.
    fn factors(&self, pixels: &[[f64; 2]]) -> Vec<f64> {
        let mut variances: Vec<f64> = pixels.iter().map(|[v, _]| *v).collect();
        variances.sort_unstable_by(|a, b| b.total_cmp(a));
        let left_out = (self.outliers as usize).min(pixels.len() / 10);
        let rest = &variances[left_out..];
        let variance = rest.iter().sum::<f64>() / rest.len() as f64;
        let cost = pixels.iter().map(|[_, c]| *c).sum::<f64>() / pixels.len() as f64;
        if variance <= 0.0 {
            return vec![1.0; pixels.len()];
        }
        let factor = |[v, c]: &[f64; 2]| (v / variance * (cost / c)).sqrt().clamp(self.least, self.most);
        pixels.iter().map(factor).collect()
    }
}

impl SamplingMethod for EarsOptions {
    const NAME: &'static str = "ears";
    // The denoiser's sums over rows and columns, and its emission; sums over windows, factors and counts need less.
    const PLANNING: usize = 2 * 32 + 24;

    fn needs(&self) -> Needs {
        Needs::none().with_variance().with_cost()
    }

    fn pilot_and_rounds(&self, mean: u64) -> (u32, Option<u32>) {
        let pilot = if self.pilot > 0 { self.pilot } else { saturating_u32(mean / 4).max(4) };
        (pilot, Some(self.rounds))
    }

    fn refine(&self, seen: &Feedback<'_>, _: u32, _: &mut Option<f64>, plan: &mut Plan) -> Result<(), Error> {
        let (budget, pixels, now) = (seen.budget, seen.pixels() as u64, counts_so_far(seen));
        let floors: Vec<u32> = now.iter().map(|&n| n.max(budget.min_spp)).collect();
        // The budget that remains after the pilot is divided into equal steps.
        let (pilot, _) = self.pilot_and_rounds(budget.total / pixels);
        let after = budget.total.saturating_sub(u64::from(pilot) * pixels);
        let needed = total(&floors) - total(&now);
        let step = after.div_ceil(self.rounds.into()).max(needed).clamp(1, budget.left());
        let factors = self.factors(&self.variances_and_costs(seen.film)?);
        plan.counts = lacking(&share(&factors, 0, &floors, budget.max_spp, total(&now) + step)?.counts, &now);
        Ok(())
    }
}
