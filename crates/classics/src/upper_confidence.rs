//! Optimistic counts: samples where the upper confidence bound of the deviation is largest.

use crate::method::{MethodSampler, SamplingMethod};
use crate::rounds::{counts_so_far, lacking, total};
use dapple_core::{Error, Feedback, Film, Frame, Needs, PilotPolicy, Plan, SamplerMemory, allocate};

dapple_core::options! {
    /// The parameters of [`UpperConfidence`]. All defaults are Dapple's.
    pub struct UpperConfidenceOptions {
        /// Samples per pixel before counts adapt.
        pub pilot: u32 = 4, |pilot| pilot >= 2, "one sample has no deviation: 2 or more";
        /// Scale of the bonus, in units of the image's pooled deviation.
        pub bonus: f64 = 0.5, |bonus| bonus >= 0.0 && bonus.is_finite(), "0 or above";
        /// Factor k in ln(1/delta) = k ln(budget), where delta is the probability of a wrong bound.
        pub confidence: f64 = 4.0 => "4", |k| k > 0.0 && k.is_finite(), "above 0";
        /// Number added to the squared mean in the weight of a pixel, 1 / sqrt(mean^2 + epsilon).
        pub epsilon: f64 = 0.01, |epsilon| epsilon > 0.0 && epsilon.is_finite(), "a number above zero";
        /// Share of the budget that is spent before bounds are computed again.
        pub step: f64 = 0.12, |step| (0.01..=1.0).contains(&step), "a share from 0.01 to 1";
        /// Use of pilot samples in the image: keep (biased, as published), the only one.
        pub policy: PilotPolicy = PilotPolicy::Keep => "keep",
            |policy| policy == PilotPolicy::Keep, "keep; there is no other";
    }
}

/// Counts in proportion to an upper bound of each pixel's deviation [after Carpentier and Munos 2011].
///
/// The bound is `w (s + c sqrt(ln(1/delta) / n))` for a pixel of `n` samples with deviation `s` and weight `w = 1 /
/// sqrt(mean^2 + epsilon)`. The scale `c` is `bonus` times the pooled deviation of the image. Published counts give the
/// next sample to the pixel with the largest bound divided by `n`. Here counts in proportion to the bound are planned
/// for the next share of the budget, and the bounds are then computed again. The constants of `ln(1/delta)` and `c` are
/// Dapple's.
///
/// The bonus of a pixel grows as its share of samples falls. A pixel whose pilot saw nothing is therefore sampled again:
/// the cure for zero-variance pilots, which `variance` treats by pooling over neighbours.
///
/// Deviations and means are those of the average of the three channels, with the mean of the channels' variances.
///
/// *Guarantees*: the budget is met exactly. No pixel gets fewer samples than the pilot. The regret over Neyman's counts
/// falls as `n^(-3/2)` up to logarithms [Carpentier and Munos 2011, abstract]. *Bias*: all samples are kept and decide
/// how many follow [Kirk and Arvo 1991]. *Weaknesses*: the bonus moves counts towards uniform ones, and each pixel is
/// judged by its own samples alone. Counts are off the ladder of well-stratified ones.
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

/// The largest variance that is used: sums of more would be infinite.
const LARGEST: f64 = 1e200;

fn grey([r, g, b]: [f64; 3]) -> f64 {
    (r + g + b) / 3.0
}

impl SamplingMethod for UpperConfidenceOptions {
    const NAME: &'static str = "ucb";

    fn planning(&self, frame: &Frame, _: &Needs) -> SamplerMemory {
        // Per pixel: the bound and its copy in `allocate`, the counts so far and those wanted.
        SamplerMemory::planning(frame, 8 + 8 + 4 + 4)
    }

    fn pilot_samples(&self, _: u64) -> u32 {
        self.pilot
    }

    fn refine(&self, seen: &Feedback<'_>, _: u32, plan: &mut Plan) -> Result<(), Error> {
        let (budget, now) = (seen.budget, counts_so_far(seen));
        let floors: Vec<u32> = now.iter().map(|&n| n.max(budget.min_spp)).collect();
        let needed = total(&floors) - total(&now);
        let step = ((self.step * budget.total as f64).ceil() as u64).max(needed).min(budget.left());
        let bounds = self.bounds(seen.film, budget.total);
        plan.counts = lacking(&allocate(&bounds, &floors, budget.max_spp, total(&now) + step)?.counts, &now);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_scenes::{frame, planned_until_done};
    use dapple_conformance::sampler;
    use dapple_low_discrepancy::{Random, Sobol};

    #[test]
    fn optimistic_counts_conform() {
        sampler(|| Box::new(UpperConfidence::new(Sobol::new(1))));
        let options = UpperConfidenceOptions::default().pilot(3).bonus(0.0).step(0.3);
        sampler(|| Box::new(UpperConfidence::with_options(Random::new(1), options).unwrap()));
    }

    /// The counts of 100 pixels at 32 samples each. Samples of the last pixel are all equal, those of the others have
    /// deviation 0.3 about the same mean.
    fn counts_beside_a_dark_pilot(options: UpperConfidenceOptions) -> Vec<u64> {
        let mut sampler = UpperConfidence::with_options(Random::new(1), options).unwrap();
        let sample = |pixel: usize, k: u64| match (pixel, k % 2) {
            (99, _) => [1.0; 3],
            (_, 0) => [0.7; 3],
            _ => [1.3; 3],
        };
        planned_until_done(&mut sampler, frame(10, 10), 3200, sample).counts()
    }

    #[test]
    fn pixels_whose_pilot_saw_nothing_get_half_of_the_uniform_count() {
        let counts = counts_beside_a_dark_pilot(UpperConfidenceOptions::default());
        // The fixed point of n = 32 (bound of the pixel) / (mean bound) is 15.
        assert!((14..=16).contains(&counts[99]), "{}", counts[99]);
        let others = &counts[..99];
        let (least, most) = (others.iter().min().unwrap(), others.iter().max().unwrap());
        assert!(most - least <= 1, "{least} .. {most}");
        // The control: without the bonus it keeps its pilot.
        assert_eq!(counts_beside_a_dark_pilot(UpperConfidenceOptions::default().bonus(0.0))[99], 4);
    }

    #[test]
    fn equal_deviations_give_uniform_counts() {
        for bonus in [0.0, 0.5, 2.0] {
            let options = UpperConfidenceOptions::default().bonus(bonus);
            let mut sampler = UpperConfidence::with_options(Random::new(1), options).unwrap();
            // Every pixel takes the same samples, of which each round adds more.
            let sample = |_: usize, k: u64| [if k.is_multiple_of(2) { 0.7 } else { 1.3 }; 3];
            let counts = planned_until_done(&mut sampler, frame(10, 10), 3257, sample).counts();
            assert!(counts.iter().all(|n| (32..=33).contains(n)), "{bonus}: {counts:?}");
        }
    }
}
