//! Neyman allocation from a pilot whose variance is pooled over neighbours.

use crate::pilot::{Pilot, clamped};
use dapple_core::{
    BudgetLeft, Error, Feedback, Frame, Limits, Needs, PilotPolicy, Plan, PointSet, Progress, RgbMoments, Sampler,
    SamplerMemory, allocate_on_ladder,
};

/// The parameters of [`Variance`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VarianceOptions {
    /// Samples per pixel of the pilot; 0 takes 4, or a quarter of the mean budget where that is more.
    /// At least 2 otherwise, and 4 with [`PilotPolicy::Cross`], whose halves must each know a variance.
    pub pilot: u32,
    /// Variance and mean are pooled over `2 radius + 1` pixels squared.
    pub radius: u32,
    /// Errors are taken to fall as `n^-exponent`: 1 for independent samples; 1.3 measured best for
    /// Owen-scrambled nets in images (FEASIBILITY 1).
    pub exponent: f64,
    /// Relative errors are `error / (mean^2 + epsilon)`.
    pub epsilon: f64,
    /// No pixel gets more than this many times the mean count.
    pub cap: f64,
    /// What becomes of the pilot.
    pub policy: PilotPolicy,
}

impl Default for VarianceOptions {
    fn default() -> Self {
        Self { pilot: 0, radius: 2, exponent: 1.3, epsilon: 0.01, cap: 6.0, policy: PilotPolicy::Keep }
    }
}

/// Counts by Neyman's rule [Neyman 1934] from a uniform pilot.
///
/// *What*: a pilot; its sample variance, divided by `mean^2 + epsilon` for relative error, pooled over
/// 5x5 pixels; then the counts that minimise the predicted relMSE, on a ladder of well-stratified
/// prefixes. *Guarantees*: exact budget; no pixel below the pilot or the floor; a pixel whose pilot
/// saw no variance still takes part with a hundredth of the mean score. *Weaknesses*: a light that
/// the pilot of a whole neighbourhood misses is not searched for; the image is slightly biased
/// unless [`PilotPolicy::Discard`] or [`PilotPolicy::Cross`] is chosen. Raw 4-sample variances would be useless
/// (1.2 to 3.3 times the error of uniform sampling); pooling repairs them nearly to the oracle.
pub struct Variance<P> {
    points: P,
    options: VarianceOptions,
}

/// Share of the mean score that a pixel without any seen variance keeps.
const SCORE_FLOOR: f64 = 0.01;

impl<P: PointSet> Variance<P> {
    /// With these points and the default parameters.
    pub fn new(points: P) -> Self {
        Self { points, options: VarianceOptions::default() }
    }

    /// With these points and parameters.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] for a pilot too small to have a variance, an exponent outside (0, 3], an
    /// epsilon that is not above zero, a cap below 1 or a radius above 64.
    pub fn with_options(points: P, options: VarianceOptions) -> Result<Self, Error> {
        let out = |name, value: String, allowed| Err(Error::OutOfRange { name, value, allowed });
        let o = options;
        if o.pilot == 1 {
            return out("pilot", "1".into(), "two samples or more have a variance; 0 chooses");
        }
        if o.policy == PilotPolicy::Cross && o.pilot != 0 && o.pilot < 4 {
            return out("pilot", o.pilot.to_string(), "each of the two halves needs two samples; 0 chooses");
        }
        if !(o.exponent > 0.0 && o.exponent <= 3.0) {
            return out("exponent", o.exponent.to_string(), "the rate at which errors fall lies in (0, 3]");
        }
        if !(o.epsilon > 0.0 && o.epsilon.is_finite()) {
            return out("epsilon", o.epsilon.to_string(), "a number above zero");
        }
        if !(o.cap >= 1.0 && o.cap.is_finite()) {
            return out("cap", o.cap.to_string(), "at least 1");
        }
        if o.radius > 64 {
            return out("radius", o.radius.to_string(), "at most 64 pixels");
        }
        Ok(Self { points, options })
    }

    fn needs_halves(&self) -> bool {
        self.options.policy == PilotPolicy::Cross
    }

    /// The scores of all pixels: pooled relative variance, from what `moments` says of each.
    fn scores(&self, size: [u32; 2], moments: impl Fn(usize) -> RgbMoments) -> Vec<f64> {
        let [w, h] = size.map(|n| n as usize);
        let radius = self.options.radius as usize;
        // Where a pixel has fewer than two samples, its neighbours speak for it.
        let known: Vec<RgbMoments> = (0..w * h).map(moments).collect();
        let counted: Vec<f64> = known.iter().map(|m| f64::from(u8::from(m.count >= 2))).collect();
        let counted = box_sums(&counted, w, h, radius);
        let mut scores = vec![0.0; w * h];
        for c in 0..3 {
            let plane = |f: &dyn Fn(&RgbMoments) -> f64| -> Vec<f64> {
                let raw: Vec<f64> = known.iter().map(|m| if m.count >= 2 { f(m) } else { 0.0 }).collect();
                box_sums(&raw, w, h, radius)
            };
            let variances = plane(&|m| m.m2[c] / (m.count - 1) as f64);
            let means = plane(&|m| m.mean[c]);
            for (i, score) in scores.iter_mut().enumerate() {
                let share = 1.0 / counted[i].max(1.0);
                let mean = means[i] * share;
                *score += variances[i].max(0.0) * share / (mean * mean + self.options.epsilon);
            }
        }
        let floor = SCORE_FLOOR * scores.iter().filter(|s| s.is_finite()).sum::<f64>() / scores.len() as f64;
        scores.iter().map(|s| s.max(floor)).collect()
    }

    /// Counts that spend `total` in all, at least `floors`, by scores.
    fn counts(&self, scores: &[f64], floors: &[u32], total: u64, ceiling: u32, even: bool) -> Result<Vec<u32>, Error> {
        let mean = total as f64 / scores.len() as f64;
        let cap = (self.options.cap * mean).ceil().min(f64::from(ceiling)) as u32;
        let shared = allocate_on_ladder(scores, floors, cap, total, self.options.exponent, even)?;
        if shared.unspent == 0 {
            return Ok(shared.counts);
        }
        // The floors left too little room under the cap: only the user's ceiling counts.
        Ok(allocate_on_ladder(scores, floors, ceiling, total, self.options.exponent, even)?.counts)
    }

    fn plan_kept(&self, seen: &Feedback<'_>, plan: &mut Plan, even: bool) -> Result<(), Error> {
        let BudgetLeft { total, min_spp, max_spp, .. } = seen.budget;
        let scores = self.scores(seen.frame().size(), |i| seen.film.moments(i));
        let now: Vec<u32> = (0..seen.pixels()).map(|i| clamped(seen.film.count(i))).collect();
        let floors: Vec<u32> = now.iter().map(|&n| n.max(min_spp)).collect();
        let counts = self.counts(&scores, &floors, total, max_spp, even)?;
        plan.counts = counts.iter().zip(&now).map(|(n, now)| n - now).collect();
        Ok(())
    }

    fn plan_after_discarding(&self, seen: &Feedback<'_>, plan: &mut Plan, even: bool) -> Result<(), Error> {
        let pixels = seen.pixels();
        let scores = self.scores(seen.frame().size(), |i| seen.film.discarded(i));
        let now: Vec<u32> = (0..pixels).map(|i| clamped(seen.film.count(i))).collect();
        let kept = now.iter().map(|&n| u64::from(n)).sum::<u64>();
        let total = kept + seen.budget.left();
        let least = clamped(total / pixels as u64).min(seen.budget.min_spp.max(1));
        let floors: Vec<u32> = now.iter().map(|&n| n.max(least)).collect();
        let counts = self.counts(&scores, &floors, total, seen.budget.max_spp, even)?;
        plan.counts = counts.iter().zip(&now).map(|(n, now)| n - now).collect();
        Ok(())
    }

    /// Each half's counts from the other half's samples; each half spends half the budget, as far as
    /// floors and ceilings, of which the first half takes the odd sample, allow.
    fn plan_across(&self, seen: &Feedback<'_>, plan: &mut Plan) -> Result<(), Error> {
        let BudgetLeft { total, min_spp, max_spp, .. } = seen.budget;
        let moments = |half: usize, i: usize| seen.film.half(half, i).unwrap_or_default();
        let now =
            [0, 1].map(|half| -> Vec<u32> { (0..seen.pixels()).map(|i| clamped(moments(half, i).count)).collect() });
        let least = [min_spp - min_spp / 2, min_spp / 2];
        let most = [max_spp - max_spp / 2, max_spp / 2];
        let floors = [0, 1].map(|half| -> Vec<u32> { now[half].iter().map(|&n| n.max(least[half])).collect() });
        let needed = [0, 1].map(|half| floors[half].iter().map(|&n| u64::from(n)).sum::<u64>());
        let room = seen.pixels() as u64 * u64::from(most[1]);
        let second = (total / 2).min(room).min(total.saturating_sub(needed[0])).max(needed[1]);
        let of = |half: usize, total: u64| -> Result<Vec<u32>, Error> {
            let scores = self.scores(seen.frame().size(), |i| moments(1 - half, i));
            let counts = self.counts(&scores, &floors[half], total, most[half], false)?;
            Ok(counts.iter().zip(&now[half]).map(|(n, now)| n - now).collect())
        };
        plan.counts = of(0, total.saturating_sub(second))?;
        plan.second_half = Some(of(1, second)?);
        Ok(())
    }
}

impl<P: PointSet> Sampler for Variance<P> {
    fn name(&self) -> &str {
        "variance"
    }

    fn describe(&self) -> String {
        let VarianceOptions { pilot, radius, exponent, epsilon, cap, policy } = self.options;
        let policy = policy.name();
        format!(
            "variance:pilot={pilot},radius={radius},exponent={exponent},epsilon={epsilon},cap={cap},policy={policy}"
        )
    }

    fn needs(&self) -> Needs {
        let needs = Needs::none().with_variance();
        if self.needs_halves() { needs.with_halves() } else { needs }
    }

    fn memory(&self, frame: &Frame, needs: &Needs, limits: &Limits) -> SamplerMemory {
        // Moments; where they are known, and how often in reach; scores and variances; a plane, its sums over rows and its sums.
        let scores = size_of::<RgbMoments>() + 8 * 7;
        // Counts and floors of both halves.
        let crosses = if self.needs_halves() { 12 } else { 0 };
        let plans = !Pilot::new(self.options.policy, self.options.pilot).is_all(frame, limits);
        let memory = SamplerMemory::planning(frame, self.needs_halves(), if plans { scores + crosses } else { 0 });
        if self.options.policy == PilotPolicy::Discard { memory.with_discarded(frame, needs, limits) } else { memory }
    }

    fn points(&self) -> &dyn PointSet {
        &self.points
    }

    fn next_round(&mut self, seen: &Feedback<'_>, plan: &mut Plan) -> Result<Progress, Error> {
        if seen.budget.left() == 0 {
            return Ok(Progress::Done);
        }
        let (even, policy) = (seen.film.needs().halves, self.options.policy);
        if Pilot::new(policy, self.options.pilot).begin(seen, plan).is_missing {
            return Ok(Progress::Trace);
        }
        match policy {
            PilotPolicy::Keep | PilotPolicy::Refined => self.plan_kept(seen, plan, even)?,
            PilotPolicy::Discard => self.plan_after_discarding(seen, plan, even)?,
            PilotPolicy::Cross => self.plan_across(seen, plan)?,
        }
        // Nothing to add where the ceiling holds every pixel.
        Ok(if plan.total() == 0 { Progress::Done } else { Progress::Trace })
    }
}

/// Sums over `2 radius + 1` pixels squared, cut off at the borders, in an order that does not depend
/// on anything but the size.
fn box_sums(plane: &[f64], w: usize, h: usize, radius: usize) -> Vec<f64> {
    let pass = |from: &[f64], length: usize, stride: usize, start: usize, to: &mut [f64]| {
        for i in 0..length {
            let near = i.saturating_sub(radius)..(i + radius + 1).min(length);
            to[start + i * stride] = near.map(|k| from[start + k * stride]).sum();
        }
    };
    let mut rows = vec![0.0; plane.len()];
    for y in 0..h {
        pass(plane, w, 1, y * w, &mut rows);
    }
    let mut sums = vec![0.0; plane.len()];
    for x in 0..w {
        pass(&rows, h, w, x, &mut sums);
    }
    sums
}
