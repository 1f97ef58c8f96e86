//! Counts that follow the estimated error of the filter bank.

use super::choice::{self, choose};
use super::planes::NEEDS;
use crate::rounds_and_variances::{plan_pilot, with_extra};
use dapple_core::{
    Error, Feedback, Frame, Limits, Needs, Options as _, PilotPolicy, Plan, PointSet, Progress, Sampler, SamplerMemory,
    saturating_u32, share,
};

dapple_core::options! {
    /// The parameters of [`Sure`]. Defaults are those of the authors' code, but for the number of rounds.
    pub struct SureOptions {
        /// Samples per pixel before counts adapt; at most half of the mean budget.
        pub pilot: u32 = 8, |pilot| pilot != 0, "at least one sample";
        /// Rounds for the rest of the budget, each planned from the samples before it.
        pub rounds: u32 = 1, |rounds| (1..=16).contains(&rounds), "1 to 16";
        /// Pixels searched to each side, 0 to 20.
        pub window: usize = 10, |window| window <= 20, "0 to 20 pixels to each side";
        /// Standard deviation in pixels of the kernel that smooths estimated errors.
        pub smooth: f64 = 4.0 => "4", |sigma| sigma > 0.0 && sigma <= 8.0, "above 0 and at most 8 pixels";
        /// Largest number of samples of a pixel.
        pub cap: u32 = 1024, |cap| cap != 0, "at least one sample";
        /// Use of pilot samples in the image: keep (biased, as published), the only one.
        pub policy: PilotPolicy = PilotPolicy::Keep => "keep",
            |policy| policy == PilotPolicy::Keep, "keep; there is no other";
    }
}

/// Samples where the best filter of a bank still errs, for the filter [`SureFilter`](crate::SureFilter) [Li 2012].
///
/// Every pixel gets `pilot` samples. The bank's estimated error then gives a pixel the score
/// `max(0, E + v) / (F^2 + 0.01) / (1 + n)`. `E` is the smoothed estimate of the filter that the pixel takes, and `v` the
/// variance of its mean. `F` is the luminance of the filtered pixel, and `n` its count. Additional samples are in
/// proportion to scores, at least one each where the budget allows.
///
/// *Guarantees*: the budget is met exactly; the published counts, rounded up, exceed it. No pixel gets fewer samples
/// than the pilot. *Bias*: all samples are kept and decide how many follow [Kirk and Arvo 1991]. *Weaknesses*: those of
/// the filter. Planning costs as much as filtering.
pub struct Sure<P> {
    points: P,
    options: SureOptions,
}

impl<P: PointSet> Sure<P> {
    /// Makes a sampler that uses this point set, with the default parameters.
    pub fn new(points: P) -> Self {
        Self { points, options: SureOptions::default() }
    }

    /// Makes a sampler that uses this point set, with these parameters.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] for the first parameter out of range.
    pub fn with_options(points: P, options: SureOptions) -> Result<Self, Error> {
        options.check_ranges()?;
        Ok(Self { points, options })
    }

    /// Plans the samples of a round after the pilot.
    fn refine(&self, seen: &Feedback<'_>, pilot: u32, plan: &mut Plan) -> Result<(), Error> {
        let (budget, pixels) = (seen.budget, seen.pixels() as u64);
        let now: Vec<u32> = (0..seen.pixels()).map(|i| saturating_u32(seen.film.count(i))).collect();
        let floors: Vec<u32> = now.iter().map(|&n| budget.min_spp.saturating_sub(n)).collect();
        let needed: u64 = floors.iter().map(|&n| u64::from(n)).sum();
        let after = budget.total.saturating_sub(u64::from(pilot) * pixels);
        let step = after.div_ceil(self.options.rounds.into()).max(needed).clamp(1, budget.left());
        let scores: Vec<f64> = choose(seen.film, self.options.window, self.options.smooth)
            .iter()
            .zip(&now)
            .map(|(pixel, &n)| pixel.priority / (1.0 + f64::from(n)))
            .collect();
        let more = share(&scores, 1, &floors, u32::MAX, step)?.counts;
        let cap = self.options.cap.max(budget.min_spp).min(budget.max_spp);
        let wanted: Vec<u32> =
            more.iter().zip(&now).map(|(more, &n)| n.saturating_add(*more).min(cap).max(n)).collect();
        let counts: Vec<u32> = wanted.iter().zip(&now).map(|(n, now)| n - now).collect();
        // What exceeds the cap goes to the pixels with the fewest samples.
        let planned = counts.iter().map(|&n| u64::from(n)).sum::<u64>();
        plan.counts = with_extra(seen, counts, step - planned)?;
        Ok(())
    }
}

impl<P: PointSet> Sampler for Sure<P> {
    fn name(&self) -> &str {
        "sure"
    }

    fn describe(&self) -> String {
        format!("sure:{}", self.options.describe())
    }

    fn rounds(&self) -> Option<u32> {
        Some(1 + self.options.rounds)
    }

    fn needs(&self) -> Needs {
        NEEDS
    }

    fn memory(&self, frame: &Frame, _: &Needs, _: &Limits) -> SamplerMemory {
        SamplerMemory::planning(frame, choice::BYTES + 8)
    }

    fn points(&self) -> &dyn PointSet {
        &self.points
    }

    fn next_round(&mut self, seen: &Feedback<'_>, plan: &mut Plan) -> Result<Progress, Error> {
        seen.film.require(self.name(), &self.needs())?;
        let budget = seen.budget;
        if budget.left() == 0 {
            return Ok(Progress::Done);
        }
        let half = saturating_u32(budget.total / seen.pixels() as u64 / 2).max(1);
        let pilot = self.options.pilot.min(half);
        if !plan_pilot(seen, pilot, plan) {
            self.refine(seen, pilot, plan)?;
        }
        Ok(if plan.total() == 0 { Progress::Done } else { Progress::Trace })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_scenes::{Field, frame, run};
    use dapple_core::{Draws, Estimate, FirstHit, Integrator, Worker};
    use dapple_low_discrepancy::{Random, Sobol};

    #[test]
    fn the_sampler_conforms() {
        let options = SureOptions::default().window(2).smooth(1.0);
        dapple_conformance::sampler(|| Box::new(Sure::with_options(Sobol::new(1), options).unwrap()));
        let options = options.pilot(3).rounds(3).cap(20);
        dapple_conformance::sampler(|| Box::new(Sure::with_options(Random::new(1), options).unwrap()));
    }

    /// A field on a wall.
    struct OnWall<F>(Field<F>);

    impl<F: Fn([u32; 2], [f32; 4]) -> [f32; 3] + Sync> Integrator for OnWall<F> {
        fn estimate(&self, draws: &Draws<'_>, worker: &mut Worker) -> Estimate {
            let hit = FirstHit::new([0.0; 3], [0.0, 0.0, 1.0], 1.0);
            self.0.estimate(draws, worker).with_first_hit(hit)
        }
    }

    #[test]
    fn samples_go_where_filters_err() {
        // Flat on the left; stripes of one pixel under noise on the right, which no filter can smooth.
        let field = Field(|[x, y]: [u32; 2], u: [f32; 4]| {
            let stripe = if x >= 16 && (x + y) % 2 == 0 { 0.8 } else { 0.2 };
            [if x < 16 { 0.5 } else { stripe + 0.3 * u[0] }; 3]
        });
        let options = SureOptions::default().window(5);
        let mut sampler = Sure::with_options(Random::new(1), options).unwrap();
        let film = run(&mut OnWall(field), &mut sampler, frame(32, 32), &Limits::spp(32.0));
        let mean = |left: bool| {
            let of = (0..1024).filter(|i| (i % 32 < 12) == left && (left || i % 32 > 19));
            of.clone().map(|i| film.count(i) as f64).sum::<f64>() / of.count() as f64
        };
        assert!(mean(true) < 12.0 && mean(false) > 45.0, "{} {}", mean(true), mean(false));
    }
}
