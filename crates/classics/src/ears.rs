//! Efficiency-aware splitting at the camera.

use crate::method::{MethodSampler, SamplingMethod};
use crate::rounds::{counts_so_far, lacking, total};
use crate::windows::window_sums;
use dapple_core::{
    Error, Feedback, Film, Filter as _, Frame, Needs, PilotPolicy, Plan, SamplerMemory, saturating_u32, share,
};
use dapple_denoise::Gaussian;

dapple_core::options! {
    /// The parameters of [`Ears`]. Clamps, outliers and epsilon are published; pilot, rounds and radius are Dapple's.
    pub struct EarsOptions {
        /// Samples per pixel before counts adapt; 0 takes 4, or a quarter of the mean budget if that is more.
        pub pilot: u32 = 0, |pilot| pilot != 1, "two samples or more have a variance; 0 chooses";
        /// Rounds for the rest of the budget; each is planned from the samples before it.
        pub rounds: u32 = 3, |rounds| (1..=64).contains(&rounds), "1 to 64";
        /// Radius of the window over which variances and costs are pooled, 2 radius + 1 pixels wide and high.
        pub radius: u32 = 2, |radius| radius <= 64, "at most 64 pixels";
        /// Smallest splitting factor.
        pub least: f64 = 0.05, |least| least > 0.0 && least <= 1.0, "above 0 and at most 1";
        /// Largest splitting factor.
        pub most: f64 = 20.0 => "20", |most| most >= 1.0 && most.is_finite(), "at least 1";
        /// Number of pixels with the largest variance that the variance of the image leaves out.
        ///
        /// At most a tenth of the pixels are left out.
        pub outliers: u32 = 10;
        /// Number added to the denoised pixel to which deviations are relative.
        pub epsilon: f64 = 0.01, |epsilon| epsilon > 0.0 && epsilon.is_finite(), "a number above zero";
        /// Use of pilot samples in the image: keep (biased), the only one.
        pub policy: PilotPolicy = PilotPolicy::Keep => "keep",
            |policy| policy == PilotPolicy::Keep, "keep; there is no other";
    }
}

/// Counts in proportion to the splitting factor of efficiency-aware Russian roulette and splitting, at depth 0 [after
/// Rath 2022].
///
/// A pixel's factor is `sqrt(V / C) sqrt(C_image / V_image)`, clamped to `[0.05, 20]`. `V` is the variance of its samples
/// relative to the squared denoised pixel, and `C` the rays per sample. `V_image` and `C_image` are means over the image,
/// the former without the 10 worst pixels. The denoiser is [`Gaussian`]. Published splitting also acts at later vertices
/// of a path; this sampler splits at the camera only, where the factor is a sample count.
///
/// The budget is a number of samples. Its division minimises the error per ray, so it helps under a time limit.
///
/// *Guarantees*: the budget is met exactly. No pixel gets fewer samples than the pilot. *Bias*: all samples are kept and
/// decide how many follow [Kirk and Arvo 1991]. *Weaknesses*: rays are not time. Samples that differ little in cost
/// leave Neyman's counts, with clamps. The published gains come from later vertices.
pub type Ears<P> = MethodSampler<P, EarsOptions>;

impl EarsOptions {
    /// The relative variance and the rays of one sample, per pixel.
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

/// The largest relative variance that is used: sums of more would be infinite.
const LARGEST: f64 = 1e200;

impl SamplingMethod for EarsOptions {
    const NAME: &'static str = "ears";

    fn needs(&self) -> Needs {
        Needs::none().with_variance().with_cost()
    }

    fn number_of_rounds(&self) -> Option<u32> {
        Some(1 + self.rounds)
    }

    fn planning(&self, frame: &Frame, needs: &Needs) -> SamplerMemory {
        // The denoised pixels beside sums of rows and of windows; then factors, counts and their shares.
        let mut memory = SamplerMemory::planning(frame, 12 + 2 * 32);
        let denoising = Gaussian::default().memory(frame, needs).applying;
        memory.planning = memory.planning.max(memory.plan.saturating_add(denoising));
        memory
    }

    fn pilot_samples(&self, mean: u64) -> u32 {
        if self.pilot > 0 { self.pilot } else { saturating_u32(mean / 4).max(4) }
    }

    fn refine(&self, seen: &Feedback<'_>, _: u32, plan: &mut Plan) -> Result<(), Error> {
        let (budget, pixels, now) = (seen.budget, seen.pixels() as u64, counts_so_far(seen));
        let floors: Vec<u32> = now.iter().map(|&n| n.max(budget.min_spp)).collect();
        // The budget after the pilot is divided into equal steps.
        let pilot = self.pilot_samples(budget.total / pixels);
        let after = budget.total.saturating_sub(u64::from(pilot) * pixels);
        let needed = total(&floors) - total(&now);
        let step = after.div_ceil(self.rounds.into()).max(needed).clamp(1, budget.left());
        let factors = self.factors(&self.variances_and_costs(seen.film)?);
        plan.counts = lacking(&share(&factors, 0, &floors, budget.max_spp, total(&now) + step)?.counts, &now);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_scenes::{frame, planned_estimates};
    use dapple_conformance::sampler;
    use dapple_core::Estimate;
    use dapple_low_discrepancy::{Random, Sobol};

    #[test]
    fn efficiency_aware_counts_conform() {
        sampler(|| Box::new(Ears::new(Sobol::new(1))));
        let options = EarsOptions::default().pilot(3).rounds(1).radius(0).most(2.0).outliers(0);
        sampler(|| Box::new(Ears::with_options(Random::new(1), options).unwrap()));
    }

    fn factors(options: EarsOptions, pixels: &[[f64; 2]]) -> Vec<f64> {
        options.factors(pixels)
    }

    #[test]
    fn factors_are_the_published_ones_within_their_clamps() {
        let all = |pixel: [f64; 2]| [pixel].into_iter().chain([[4.0, 2.0]; 999]).collect::<Vec<_>>();
        let of = |pixel| factors(EarsOptions::default(), &all(pixel))[0];
        // Of 1000 pixels, one barely moves the mean cost, and none the variance.
        for (pixel, expected) in [([16.0, 2.0], 2.0), ([4.0, 8.0], 0.5), ([0.0, 2.0], 0.05), ([1e30, 2.0], 20.0)] {
            assert!((of(pixel) / expected - 1.0).abs() < 0.01, "{pixel:?}: {}", of(pixel));
        }
        // The control: with outliers, one firefly hides the variance of all others.
        let kept = factors(EarsOptions::default().outliers(0), &all([1e30, 2.0]));
        assert_eq!(kept[1], 0.05);
        assert_eq!(factors(EarsOptions::default(), &[[0.0, 3.0]; 20]), [1.0; 20]);
    }

    /// The counts of pixels with equal deviations, whose right half costs four times as many rays.
    #[test]
    fn counts_of_two_regions_go_with_the_inverse_root_of_their_costs() {
        let options = EarsOptions::default().radius(0).rounds(1);
        let mut ears = Ears::with_options(Random::new(1), options).unwrap();
        let sample = |i: usize, k: u64| {
            Estimate::new([if k.is_multiple_of(2) { 0.7 } else { 1.3 }; 3]).with_cost(if i % 16 < 8 { 1 } else { 4 })
        };
        let counts = planned_estimates(&mut ears, frame(16, 16), 48 * 256, sample).counts();
        // Denoised pixels differ from 1 by rounding only.
        assert!(
            counts.iter().enumerate().all(|(i, n)| n.abs_diff(if i % 16 < 8 { 64 } else { 32 }) <= 1),
            "{counts:?}"
        );
    }
}
