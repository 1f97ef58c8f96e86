//! A threshold on the confidence interval of each pixel's mean.

use crate::method::{MethodSampler, SamplingMethod};
use crate::rounds::WorstFirst;
use crate::student::two_sided_critical;
use crate::variances::per_pixel;
use dapple_core::{
    Error, Feedback, Film, Frame, Needs, PilotPolicy, Plan, SamplerMemory, Stopping, luminance, saturating_u32,
};

dapple_core::options! {
    /// The parameters of [`VarianceThreshold`]. The defaults are those of Mitsuba's `adaptive` integrator.
    pub struct VarianceThresholdOptions {
        /// Half the width of a pixel's confidence interval, relative to its mean, at which the pixel stops.
        pub threshold: f64 = 0.05, |t| t > 0.0 && t.is_finite(), "a relative error above 0";
        /// Probability that the interval misses the expectation of normally distributed samples.
        pub alpha: f64 = 0.05, |alpha| (1e-6..=0.5).contains(&alpha), "a probability from 1e-6 to 0.5";
        /// Samples per pixel before any pixel stops; with mode=budget at most a quarter of the mean, but at least 2.
        pub min: u32 = 8, |min| min >= 2, "one sample has no variance: 2 or more";
        /// Largest number of samples of a pixel, as a multiple of the mean number.
        pub cap: f64 = 32.0 => "32", |cap| cap >= 1.0 && cap.is_finite(), "at least 1";
        /// Additional samples per round of each pixel that continues.
        pub step: u32 = 4, |step| step != 0, "at least one sample";
        /// Stopping rule: budget (widest intervals first, until spent) or threshold (the budget is an upper bound).
        pub mode: Stopping = Stopping::Budget => "budget";
        /// Use in the image of the samples that decide when a pixel stops: keep (biased, as published), the only one.
        pub policy: PilotPolicy = PilotPolicy::Keep => "keep",
            |policy| policy == PilotPolicy::Keep, "keep; there is no other";
    }
}

/// Samples for each pixel until the confidence interval of its mean is narrow [after Kajiya 1986; Mitsuba,
/// `src/integrators/misc/adaptive.cpp`].
///
/// A pixel stops when `t s / sqrt(n) <= threshold max(mean, 0.01 image)`. Here `n` is its count, `t` the two-sided
/// critical value of Student's distribution with `n - 1` degrees of freedom, and `image` the mean of all pixels. Means
/// are luminances. The deviation `s` is the weighted sum of the channels' deviations, an upper bound of the luminance's.
///
/// With [`Stopping::Threshold`], intervals are checked every `step` samples. [`Stopping::Budget`], the default, ranks
/// pixels by the width of their intervals: each round adds samples to the widest quarter.
///
/// *Guarantees*: spends the budget exactly, or treats it as an upper bound. No pixel stops below `min` samples if the
/// budget allows them, or a quarter of it with [`Stopping::Budget`].
///
/// *Bias*: all samples are kept and decide how many follow [Kirk and Arvo 1991]. A pixel stops when its samples happen
/// to agree, so its interval misses more often than `alpha`.
///
/// *Weaknesses*: a pixel whose first samples are equal stops for ever, however rare the light that it missed. Variances
/// are not pooled over neighbours. Fireflies keep a pixel open.
pub type VarianceThreshold<P> = MethodSampler<P, VarianceThresholdOptions>;

impl VarianceThresholdOptions {
    /// Half the width of each pixel's confidence interval, divided by the largest width at which it stops.
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

/// The least mean to which a pixel's error is relative, as a share of the image's mean.
const DARKEST: f64 = 0.01;

impl SamplingMethod for VarianceThresholdOptions {
    const NAME: &'static str = "variance-threshold";

    fn planning(&self, frame: &Frame, _: &Needs) -> SamplerMemory {
        // A score per pixel.
        SamplerMemory::planning(frame, 8 + WorstFirst::BYTES)
    }

    fn pilot_samples(&self, mean: u64) -> u32 {
        match self.mode {
            Stopping::Threshold => self.min,
            Stopping::Budget => self.min.min(saturating_u32(mean / 4)).max(2),
        }
    }

    fn refine(&self, seen: &Feedback<'_>, _: u32, plan: &mut Plan) -> Result<(), Error> {
        let Self { mode, step, cap, .. } = *self;
        WorstFirst { mode, step, cap }.plan(seen, &self.scores(seen.film), plan)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_scenes::{Field, bernoulli, frame, run};
    use dapple_conformance::{sampler, threshold_sampler};
    use dapple_core::Limits;
    use dapple_low_discrepancy::{Random, Sobol};

    fn with(options: VarianceThresholdOptions, seed: u64) -> VarianceThreshold<Random> {
        VarianceThreshold::with_options(Random::new(seed), options).unwrap()
    }

    #[test]
    fn variance_thresholds_conform() {
        sampler(|| Box::new(VarianceThreshold::new(Sobol::new(1))));
        let options = VarianceThresholdOptions::default().min(3).step(5).cap(2.0).threshold(0.01);
        for options in [VarianceThresholdOptions::default(), options] {
            sampler(|| Box::new(with(options, 1)));
            threshold_sampler(|| Box::new(with(options.mode(Stopping::Threshold), 1)));
        }
    }

    /// Samples of mean 1 that are nearly normal: sums of four uniform numbers, with standard deviation 0.25.
    const DEVIATION: f64 = 0.25;

    fn near_normal() -> impl dapple_core::Integrator {
        Field(|_, u: [f32; 4]| {
            let sum = u.iter().map(|&u| f64::from(u) - 0.5).sum::<f64>();
            [(1.0 + DEVIATION * 3f64.sqrt() * sum) as f32; 3]
        })
    }

    /// The counts at which 64x64 pixels stop, and the share whose interval contains the expectation.
    fn stopped(options: VarianceThresholdOptions, seed: u64) -> (Vec<f64>, f64) {
        let size = frame(64, 64);
        let options = options.mode(Stopping::Threshold);
        let film = run(&mut near_normal(), &mut with(options, seed), size, &Limits::spp(10_000.0));
        let covered = (0..size.pixels()).filter(|&i| {
            let (moments, n) = (film.moments(i), film.count(i) as f64);
            let width = two_sided_critical(options.alpha, n - 1.0) * (moments.variance().unwrap()[0] / n).sqrt();
            (moments.mean[0] - 1.0).abs() <= width
        });
        let share = covered.count() as f64 / size.pixels() as f64;
        (film.counts().iter().map(|&n| n as f64).collect(), share)
    }

    #[test]
    fn counts_concentrate_where_the_interval_is_as_wide_as_allowed() {
        for threshold in [0.05, 0.025] {
            let (counts, covered) = stopped(VarianceThresholdOptions::default().threshold(threshold), 3);
            let expected = (1.96 * DEVIATION / threshold).powi(2);
            let mean = counts.iter().sum::<f64>() / counts.len() as f64;
            let near = counts.iter().filter(|&n| (n / expected - 1.0).abs() < 0.35).count();
            assert!((mean / expected - 1.0).abs() < 0.1, "{mean} for {expected}");
            assert!(near as f64 > 0.85 * counts.len() as f64, "{near} of {}", counts.len());
            assert!(covered >= 0.9, "{covered}");
        }
        // The control: an interval of 80 % covers less than 90 %.
        let (_, covered) = stopped(VarianceThresholdOptions::default().alpha(0.2), 3);
        assert!(covered < 0.85, "{covered}");
    }

    #[test]
    fn pixels_with_equal_samples_stop_for_long() {
        check_equal_samples(60.0);
    }

    #[test]
    #[ignore = "8 s: up to 1000 samples per pixel; up to 60 are tested always"]
    fn pixels_with_equal_samples_stop_for_ever() {
        check_equal_samples(1000.0);
    }

    /// The defect that pooling removes: nothing ever samples a pixel again whose pilot saw no light.
    fn check_equal_samples(spp: f64) {
        let size = frame(64, 64);
        let options = VarianceThresholdOptions::default().mode(Stopping::Threshold);
        let film = run(&mut bernoulli(0.01), &mut with(options, 4), size, &Limits::spp(spp));
        let stopped = film.counts().iter().filter(|&&n| n == 8).count() as f64;
        let (share, pixels) = (0.99f64.powi(8), size.pixels() as f64);
        assert!((stopped - share * pixels).abs() < 5.0 * (share * (1.0 - share) * pixels).sqrt(), "{stopped}");
    }

    #[test]
    fn a_budget_goes_to_the_noisy_half() {
        let size = frame(32, 32);
        let mut field = Field(|[x, _]: [u32; 2], u: [f32; 4]| [if x < 16 { 0.5 } else { u[0] }; 3]);
        let film = run(&mut field, &mut with(VarianceThresholdOptions::default(), 5), size, &Limits::spp(32.0));
        let of = |left: bool| (0..size.pixels()).filter(move |i| (i % 32 < 16) == left).map(|i| film.count(i));
        assert!(of(true).all(|n| n == 8), "flat pixels keep the pilot");
        let noisy: Vec<u64> = of(false).collect();
        assert_eq!(noisy.iter().sum::<u64>(), 56 * 512);
        // A few pixels keep 8 or a little more, since their first samples happen to agree.
        let near = noisy.iter().filter(|&n| (32..=96).contains(n)).count();
        assert!(near > 486, "{near} of 512 pixels, {noisy:?}");
    }
}
