//! Counts by divergences and entropies of a pixel's samples.

mod geometric;
mod scores;

pub use scores::DivergenceScore;

use crate::rounds::{WorstFirst, counts_so_far, first_samples, lacking, plan_first, total, with_extra};
use dapple_core::{
    Error, Feedback, Film, Frame, Limits, Needs, Options as _, PilotPolicy, Plan, PointSet, Progress, Recorder,
    Sampler, SamplerMemory, Stopping, allocate, saturating_u32,
};
use std::mem;
use std::sync::Arc;

dapple_core::options! {
    /// The parameters of [`Divergence`]. All defaults are Dapple's.
    pub struct DivergenceOptions {
        /// Score: kl, chi2, hellinger, geometric (Rigau 2003), entropy, tsallis, fuzzy (after Xu 2008) or gh (after Cui 2009).
        pub by: DivergenceScore = DivergenceScore::Hellinger => "hellinger";
        /// Index of the Tsallis entropy for by=tsallis: 0.5, 1 or 2.
        pub q: f64 = 2.0 => "2", |q| [0.5, 1.0, 2.0].contains(&q), "0.5, 1 or 2, whose sums a film records";
        /// Deviation at which a sample's membership is one half, in means, for by=fuzzy.
        pub k: f64 = 1.0 => "1", |k| (0.001..=1000.0).contains(&k), "0.001 to 1000";
        /// Exponent of the divergence for by=gh; 0.5 gives Hellinger's, 1 the total variation.
        pub a: f64 = 1.0 => "1", |a| a > 0.0 && a <= 1.0, "above 0 and at most 1";
        /// Samples per pixel before counts adapt, 2 to 128; with mode=budget at most half of the mean.
        pub pilot: u32 = 8, |pilot| (2..=128).contains(&pilot), "2 to 128 samples";
        /// Additional samples per round of each pixel above the threshold, for mode=threshold.
        pub step: u32 = 8, |step| step != 0, "at least one sample";
        /// Score above which a pixel is refined, for mode=threshold; 0 takes kappa times the mean score of the pilot.
        pub threshold: f64 = 0.0 => "0", |t| t >= 0.0 && t.is_finite(), "0 or above; 0 chooses";
        /// Factor on the mean score, if the threshold is chosen.
        pub kappa: f64 = 1.0 => "1", |kappa| kappa > 0.0 && kappa.is_finite(), "above 0";
        /// Largest number of samples of a pixel, as a multiple of the mean number.
        pub cap: f64 = 8.0 => "8", |cap| cap >= 1.0 && cap.is_finite(), "at least 1";
        /// Stopping rule: budget (counts by scores, until spent) or threshold (the budget is an upper bound).
        pub mode: Stopping = Stopping::Budget => "budget";
        /// Use in the image of the samples that decide counts: keep (biased, as published), the only one.
        pub policy: PilotPolicy = PilotPolicy::Keep => "keep",
            |policy| policy == PilotPolicy::Keep, "keep; there is no other";
    }
}

/// Counts by how much the shares of a pixel's samples in their sum differ from equal shares [after Rigau 2003].
///
/// The samples `x_i` of one channel have the shares `p_i = x_i / sum x`. Equal ones are `1 / n`. The scores are
/// [`DivergenceScore`]. Most are functions of streaming sums, so that no sample is stored. `geometric` reads the first hits
/// of the pilot. `fuzzy` and `gh` read a pixel's first samples: as many as the pilot has, but at most 8.
///
/// With [`Stopping::Threshold`], each pixel gets `step` more samples while its score exceeds the threshold, as published.
/// [`Stopping::Budget`], the default, plans all counts at once from the pilot's scores `s`, so that the sum of `s^2 n` over
/// the final counts is least. Every score is at least 1 % of the mean.
///
/// *Guarantees*: spends the budget exactly, or treats it as an upper bound. No pixel gets fewer samples than the pilot.
/// *Bias*: all samples are kept and decide how many follow [Kirk and Arvo 1991].
///
/// *Weaknesses*: a score of few samples is as noisy as their variance, and is not pooled over neighbours. Near convergence
/// all divergences rank pixels alike: with `c` the coefficient of variation, `kl` is about `c^2 / 2` and `hellinger` `c^2 /
/// 8`. `hellinger` reacts least to fireflies. Later samples do not change `geometric`, `fuzzy` and `gh`: with
/// [`Stopping::Threshold`], a pixel whose pilot exceeds the threshold is refined up to the cap. The factor of the published
/// score is recalled, and refinement there descends a tree over the image, which this sampler does not have.
pub struct Divergence<P> {
    points: P,
    options: DivergenceOptions,
    /// The threshold that was chosen after the pilot.
    chosen: Option<f64>,
}

impl<P: PointSet> Divergence<P> {
    /// Makes a sampler that uses this point set, with the default parameters.
    pub fn new(points: P) -> Self {
        Self { points, options: DivergenceOptions::default(), chosen: None }
    }

    /// Makes a sampler that uses this point set, with these parameters.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] for the first parameter out of range.
    pub fn with_options(points: P, options: DivergenceOptions) -> Result<Self, Error> {
        options.check_ranges()?;
        Ok(Self { points, options, chosen: None })
    }

    fn pilot(&self, mean: u64) -> u32 {
        match self.options.mode {
            Stopping::Threshold => self.options.pilot,
            Stopping::Budget => self.options.pilot.min(saturating_u32(mean / 2)).max(2),
        }
    }

    /// The score of each pixel, 0 or above.
    fn scores(&self, film: &Film) -> Result<Vec<f64>, Error> {
        let DivergenceOptions { by, q, k, a, pilot, .. } = self.options;
        match by {
            DivergenceScore::Geometric => Ok(geometric::scores(film)),
            DivergenceScore::Fuzzy => scores::of_samples(film, pilot, |samples| scores::fuzzy(samples, k)),
            DivergenceScore::Gh => scores::of_samples(film, pilot, |x| scores::generalised_hellinger(x, a)),
            _ => scores::of_sums(by, q, film),
        }
    }

    /// Plans all counts from the scores so far.
    fn plan_budget(&self, seen: &Feedback<'_>, scores: &[f64], plan: &mut Plan) -> Result<(), Error> {
        let budget = seen.budget;
        let now = counts_so_far(seen);
        let total = total(&now) + budget.left();
        let errors = scores.iter().zip(&now).map(|(s, &n)| (s * s * f64::from(n)).min(f64::MAX));
        let mut errors: Vec<f64> = errors.collect();
        let least = SCORE_FLOOR * errors.iter().map(|e| e / errors.len() as f64).sum::<f64>();
        errors.iter_mut().for_each(|e| *e = e.max(least));
        let floors: Vec<u32> = now.iter().map(|&n| n.max(budget.min_spp)).collect();
        let cap = (self.options.cap * total as f64 / now.len() as f64).ceil().min(f64::from(budget.max_spp)) as u32;
        let mut shared = allocate(&errors, &floors, cap, total)?;
        if shared.unspent > 0 {
            shared = allocate(&errors, &floors, budget.max_spp, total)?;
        }
        plan.counts = lacking(&shared.counts, &now);
        Ok(())
    }

    /// Plans a step for each pixel above the threshold.
    fn plan_threshold(&mut self, seen: &Feedback<'_>, mut scores: Vec<f64>, plan: &mut Plan) -> Result<(), Error> {
        let DivergenceOptions { threshold, kappa, step, cap, mode, .. } = self.options;
        let mean = scores.iter().map(|s| s / scores.len() as f64).sum::<f64>();
        let threshold = if threshold > 0.0 { threshold } else { *self.chosen.get_or_insert(kappa * mean) };
        if threshold > 0.0 {
            scores.iter_mut().for_each(|s| *s /= threshold);
            WorstFirst { mode, step, cap }.plan(seen, &scores, plan)?;
        }
        Ok(())
    }
}

/// The smallest squared score of a pixel, as a share of the mean.
const SCORE_FLOOR: f64 = 0.01;

impl<P: PointSet> Sampler for Divergence<P> {
    fn name(&self) -> &str {
        "divergence"
    }

    fn describe(&self) -> String {
        format!("divergence:{}", self.options.describe())
    }

    fn needs(&self) -> Needs {
        scores::needs(self.options.by, self.options.q, self.options.pilot as u8)
    }

    fn recorders(&self) -> Vec<Arc<dyn Recorder>> {
        scores::recorders(self.options.by, self.options.q, self.options.pilot)
    }

    fn memory(&self, frame: &Frame, _: &Needs, _: &Limits) -> SamplerMemory {
        // A score per pixel; then its error, counts so far, floors, and what `allocate` takes.
        SamplerMemory::planning(frame, 8 + (8 + 4 + 4 + 8 + 4).max(WorstFirst::BYTES))
    }

    fn points(&self) -> &dyn PointSet {
        &self.points
    }

    fn next_round(&mut self, seen: &Feedback<'_>, plan: &mut Plan) -> Result<Progress, Error> {
        seen.film.require(self.name(), &self.needs())?;
        if seen.round == 0 {
            self.chosen = None;
        }
        if seen.budget.left() == 0 {
            return Ok(Progress::Done);
        }
        let pilot = self.pilot(seen.budget.total / seen.pixels() as u64);
        if !plan_first(seen, first_samples(seen, pilot), plan) {
            let scores = self.scores(seen.film)?;
            match self.options.mode {
                Stopping::Threshold => self.plan_threshold(seen, scores, plan)?,
                Stopping::Budget if scores.iter().all(|&s| s == 0.0) => {
                    plan.counts = with_extra(seen, mem::take(&mut plan.counts), seen.budget.left())?;
                }
                Stopping::Budget => self.plan_budget(seen, &scores, plan)?,
            }
        }
        Ok(if plan.total() == 0 { Progress::Done } else { Progress::Trace })
    }

    /// The chosen threshold.
    fn save(&self) -> Vec<u8> {
        self.chosen.map_or_else(Vec::new, |t| t.to_le_bytes().to_vec())
    }

    fn restore(&mut self, saved: &[u8]) -> Result<(), Error> {
        self.chosen = match <[u8; 8]>::try_from(saved).map(f64::from_le_bytes) {
            Ok(threshold) if threshold >= 0.0 => Some(threshold),
            Err(_) if saved.is_empty() => None,
            _ => return Err(Error::BadSnapshot { what: "they do not hold a threshold of the sampler divergence" }),
        };
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recorders::Singles;
    use crate::test_scenes::{Field, frame, run};
    use dapple_core::Render;
    use dapple_low_discrepancy::Random;

    fn with(options: DivergenceOptions, seed: u64) -> Divergence<Random> {
        Divergence::with_options(Random::new(seed), options).unwrap()
    }

    #[test]
    fn samples_that_others_store_do_not_change_the_counts() {
        let counts = |by, recorders| {
            let mut sampler = with(DivergenceOptions::default().by(by), 4);
            let render = Render::new(frame(16, 16), &Limits::spp(20.0))
                .recorders(recorders)
                .run(&mut half_noise(), &mut sampler);
            render.unwrap().counts()
        };
        for by in [DivergenceScore::Fuzzy, DivergenceScore::Gh] {
            assert_eq!(counts(by, Vec::new()), counts(by, Singles::ALL.list()));
        }
    }

    /// Flat on the left, noise on the right.
    fn half_noise() -> impl dapple_core::Integrator {
        Field(|[x, _]: [u32; 2], u: [f32; 4]| [if x < 16 { 0.5 } else { u[0] }; 3])
    }

    #[test]
    fn noise_gets_the_samples_by_every_divergence() {
        for by in [
            DivergenceScore::Kl,
            DivergenceScore::Chi2,
            DivergenceScore::Hellinger,
            DivergenceScore::Entropy,
            DivergenceScore::Tsallis,
            DivergenceScore::Fuzzy,
            DivergenceScore::Gh,
        ] {
            let film = run(
                &mut half_noise(),
                &mut with(DivergenceOptions::default().by(by), 2),
                frame(32, 32),
                &Limits::spp(32.0),
            );
            let flat = (0..1024).filter(|i| i % 32 < 16).map(|i| film.count(i)).sum::<u64>() as f64 / 512.0;
            assert!((8.0..12.0).contains(&flat), "{by:?}: {flat} samples in flat pixels");
        }
    }

    #[test]
    fn a_threshold_stops_where_scores_are_below_it() {
        let options = DivergenceOptions::default().mode(Stopping::Threshold).cap(1e3).threshold(0.004);
        let film = run(&mut half_noise(), &mut with(options, 3), frame(32, 32), &Limits::spp(1e4));
        let scores = with(options, 3).scores(&film).unwrap();
        for (i, score) in scores.into_iter().enumerate() {
            assert!(score <= 0.004 && (i % 32 >= 16 || film.count(i) == 8), "pixel {i}: {score}");
            // The score falls with the inverse of the count.
            assert!(i % 32 < 16 || film.count(i) < 200, "{}", film.count(i));
        }
        let mean = film.counts().iter().sum::<u64>() as f64 / 1024.0;
        assert!(mean > 16.0, "{mean}");
    }

    #[test]
    fn saved_states_of_others_are_refused() {
        let mut sampler = Divergence::new(Random::new(1));
        assert!(sampler.restore(&0.25f64.to_le_bytes()).is_ok() && sampler.save() == 0.25f64.to_le_bytes());
        for bytes in [&[1u8, 2][..], &f64::NAN.to_le_bytes(), &(-1f64).to_le_bytes()] {
            assert!(matches!(sampler.restore(bytes), Err(Error::BadSnapshot { .. })));
        }
    }
}
