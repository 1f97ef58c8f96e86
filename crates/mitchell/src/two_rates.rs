//! The common part of Mitchell's and pbrt-v2's samplers: a pilot, its use in the image, a ranking of pixels, and two rates.

use crate::extrema::Extrema;
use dapple_core::film::Recorder;
use dapple_core::options::Options;
use dapple_core::plan::{
    BudgetLeft, Feedback, PilotPolicy, Plan, Progress, Retention, SamplerMemory, Stopping, allocate, saturating_u32,
};
use dapple_core::{Error, Film, Frame, Limits, Needs, PointSet, Sampler, point_set::mix};
use std::sync::Arc;

const NOT_OURS: Error = Error::BadSnapshot { what: "the data hold no state of a sampler with two rates" };

/// Sampling rates in samples per pixel: `initial` for every pixel, `initial + additional` for refined ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rates {
    /// The number of samples that every pixel gets.
    pub initial: u32,
    /// The number of additional samples that a refined pixel gets.
    pub additional: u32,
}

/// Mean budget, initial and additional samples per pixel [Lan 2016, table 4-2].
const PRESETS: [[u64; 3]; 4] = [[8, 4, 6], [16, 4, 16], [32, 12, 24], [64, 16, 54]];

impl Rates {
    /// Returns the rates for a budget of `mean` samples per pixel [Lan 2016, table 4-2]. The pair `(initial, additional)` is
    /// (4, 6) for `mean` 8, (4, 16) for 16, (12, 24) for 32 and (16, 54) for 64. From 8 to 64, the table is interpolated
    /// linearly; below 8 and above 64, the rates are proportional to `mean`. The initial rate is rounded down, the additional
    /// rate up, and both are at least 1. Refining all pixels thus costs at least `mean`.
    pub fn for_mean(mean: u64) -> Self {
        // Larger numbers would all be clamped to u32 anyway.
        let mean = mean.min(1 << 32);
        let [first, .., last] = PRESETS;
        let between = PRESETS.windows(2).find(|w| (w[0][0]..=w[1][0]).contains(&mean)).map(|w| (w[0], w[1]));
        let (low, high) = between.unwrap_or(([0; 3], if mean < first[0] { first } else { last }));
        let width = high[0] - low[0];
        // Scaled by `width`, so that integers are exact.
        let at = |c: usize| low[c] * width + (high[c] - low[c]) * (mean - low[0]);
        let clamped = |n: u64| u32::try_from(n.max(1)).unwrap_or(u32::MAX);
        Self { initial: clamped(at(1) / width), additional: clamped(at(2).div_ceil(width)) }
    }

    /// The number of samples of a refined pixel: `initial + additional`.
    pub(crate) const fn refined(self) -> u32 {
        self.initial.saturating_add(self.additional)
    }
}

/// The rule of a sampler with two rates: the scores that rank pixels for refinement, and the rates.
pub trait Rule: Options + Copy + Default + Send {
    /// The sampler's name.
    const NAME: &str;
    /// The bytes per pixel that scoring needs.
    const SCORING: usize;

    /// Checks the ranges and the combination of the parameters, and returns the parameters in effect.
    fn checked(self) -> Result<Self, Error>;

    /// The stopping rule, and how the image uses the pilot's samples.
    fn modes(&self) -> (Stopping, PilotPolicy);

    /// The statistics that scores read, besides the extrema.
    fn needs(&self) -> Needs {
        Needs::none()
    }

    /// Returns `true` if scores read the extrema of pixels.
    fn reads_extrema(&self) -> bool {
        true
    }

    /// The smallest number of samples per pixel for which scores are defined.
    fn least(&self) -> u32;

    /// The rates for a mean budget.
    fn rates(&self, mean: u64) -> Rates;

    /// The score of each pixel, from its pilot samples. Pixels with scores above 1 are refined.
    fn scores(&self, film: &Film) -> Result<Vec<f64>, Error>;
}

/// A sampler with two rates (samples per pixel before and after refinement), with the points `P` and the rule `O`.
pub struct TwoRates<P, O> {
    points: P,
    options: O,
    /// The pixels ranked for refinement. The ranking is computed once per pilot: later samples do not change it.
    ranking: Option<Ranking>,
    /// The mean budget, in samples per pixel, for which rates were last selected, and these rates. They stay in use until the
    /// mean budget has doubled. Otherwise the last tenth of a time limit would be spent on one more sample everywhere.
    rates: Option<(u64, Rates)>,
}

/// The pixels in the order in which they are refined.
struct Ranking {
    /// The samples per pixel of the pilot from which the order was computed.
    pilot: u32,
    order: Vec<u32>,
    /// The number of pixels whose score is above 1; they come first in the order.
    asking: usize,
    /// `true` if all pixels have the same score.
    level: bool,
}

impl<P: PointSet, O: Rule> TwoRates<P, O> {
    /// Creates a sampler that uses this point set, with the default parameters.
    pub fn new(points: P) -> Self {
        Self { points, options: O::default(), ranking: None, rates: None }
    }

    /// Creates a sampler that uses this point set, with these parameters.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] for a parameter or a combination of parameters out of range.
    pub fn with_options(points: P, options: O) -> Result<Self, Error> {
        Ok(Self { points, options: options.checked()?, ranking: None, rates: None })
    }

    /// Returns `true` if the whole pilot is discarded.
    fn discards(&self) -> bool {
        self.options.modes().1 == PilotPolicy::Discard
    }

    /// Returns the number of pilot samples per pixel, for a budget of `mean` samples per pixel.
    fn pilot(&self, budget: &BudgetLeft, mean: u64, rates: Rates) -> u32 {
        let wanted = u64::from(rates.initial);
        if !self.discards() {
            return saturating_u32(wanted.min(mean)).max(budget.min_spp).min(budget.max_spp);
        }
        // A discarded pilot gets at most half of the budget, and leaves enough for each pixel's floor.
        let affordable = mean.saturating_sub(u64::from(budget.min_spp.max(1))).min(mean / 2);
        let pilot = saturating_u32(wanted.min(affordable));
        if pilot < self.options.least() { 0 } else { pilot }
    }

    fn plan_kept(&self, seen: &Feedback<'_>, plan: &mut Plan, rates: Rates, ranking: &Ranking) -> Result<(), Error> {
        let BudgetLeft { min_spp, max_spp, .. } = seen.budget;
        let now: Vec<u32> = (0..seen.pixels()).map(|i| saturating_u32(seen.film.count(i))).collect();
        let total = now.iter().map(|&n| u64::from(n)).sum::<u64>() + seen.budget.left();
        if ranking.level && self.options.modes().0 == Stopping::Budget {
            let counts = allocate(&vec![1.0; now.len()], &now, max_spp, total)?.counts;
            plan.counts = counts.iter().zip(&now).map(|(n, now)| n - now).collect();
            return Ok(());
        }
        let floor = saturating_u32(u64::from(rates.initial).min(total / now.len() as u64)).max(min_spp).min(max_spp);
        let mut steps = Steps::new(seen, plan, now, self.options.modes().1 == PilotPolicy::Refined);
        steps.raise_all(&ranking.order, floor, false);
        match self.options.modes().0 {
            Stopping::Threshold => {
                let target = rates.refined().max(floor).min(max_spp);
                steps.raise_all(&ranking.order[..ranking.asking], target, true);
            }
            Stopping::Budget => steps.raise_in_passes(&ranking.order, rates),
        }
        if steps.withdrawn.contains(&true) {
            plan.withdraw = Some(steps.withdrawn);
        }
        Ok(())
    }
}

impl<P: PointSet, O: Rule> Sampler for TwoRates<P, O> {
    fn name(&self) -> &str {
        O::NAME
    }

    fn describe(&self) -> String {
        format!("{}:{}", O::NAME, self.options.describe())
    }

    fn needs(&self) -> Needs {
        self.options.needs()
    }

    fn recorders(&self) -> Vec<Arc<dyn Recorder>> {
        if self.options.reads_extrema() { Extrema::list() } else { Vec::new() }
    }

    fn points(&self) -> &dyn PointSet {
        &self.points
    }

    fn next_round(&mut self, seen: &Feedback<'_>, plan: &mut Plan) -> Result<Progress, Error> {
        seen.film.require(O::NAME, &self.needs())?;
        if self.options.reads_extrema() {
            Extrema::of(seen.film, O::NAME)?;
        }
        if seen.round == 0 {
            (self.ranking, self.rates) = (None, None);
        }
        let (budget, pixels) = (seen.budget, seen.pixels());
        let needed = pixels as u64 * u64::from(budget.min_spp);
        if budget.total < needed {
            return Err(Error::BudgetTooSmall { budget: budget.total, needed, pixels });
        }
        if budget.left() == 0 {
            return Ok(Progress::Done);
        }
        let mean = budget.total / pixels as u64;
        let known = self.rates.filter(|&(before, _)| mean / 2 < before);
        let (_, rates) = *self.rates.insert(known.unwrap_or_else(|| (mean, self.options.rates(mean))));
        let pilot = self.pilot(&budget, mean, rates);
        for (i, count) in plan.counts.iter_mut().enumerate() {
            let done = if self.discards() { seen.film.discarded(i).count } else { seen.film.count(i) };
            *count = pilot.saturating_sub(saturating_u32(done));
        }
        if plan.total() > 0 && plan.total() <= budget.left() {
            plan.retention = if self.discards() { Retention::Discard } else { Retention::Keep };
            return Ok(Progress::Trace);
        }
        plan.counts.fill(0);
        let ranking = match self.ranking.take() {
            Some(known) if known.pilot == pilot && known.order.len() == pixels => known,
            _ => Ranking::new(pilot, &self.options.scores(seen.film)?),
        };
        self.plan_kept(seen, plan, rates, &ranking)?;
        self.ranking = Some(ranking);
        Ok(if plan.total() == 0 { Progress::Done } else { Progress::Trace })
    }

    fn memory(&self, frame: &Frame, needs: &Needs, limits: &Limits) -> SamplerMemory {
        // The ranking is computed after scoring, and held together with the scores, or with counts and marks.
        const RANKING: usize = 4;
        let planning = O::SCORING.saturating_sub(RANKING).max(8);
        let mut memory = SamplerMemory::planning(frame, planning).with_state(frame, RANKING);
        let withdraws = self.options.modes().1 == PilotPolicy::Refined;
        if withdraws || self.discards() {
            // From the second round on, withdrawn samples have their own statistics and counts.
            memory = memory.with_discarded(frame, needs, limits);
            let extremes = if self.options.reads_extrema() { Extrema::BYTES } else { 0 };
            let counts = if withdraws { size_of::<u64>() } else { 0 };
            let halves = if needs.halves { 2 } else { 1 };
            memory.discarded = memory.discarded.saturating_add(frame.bytes(halves * (extremes + counts)));
        }
        memory
    }

    /// Saves the rates and the ranking, which cannot be derived from later films.
    fn save(&self) -> Vec<u8> {
        let (mean, rates) = self.rates.unwrap_or((0, Rates { initial: 0, additional: 0 }));
        let mut words = vec![mean as u32, (mean >> 32) as u32, rates.initial, rates.additional];
        if let Some(Ranking { pilot, order, asking, level }) = &self.ranking {
            words.extend([*pilot, saturating_u32(*asking as u64), u32::from(*level)]);
            words.extend(order);
        }
        words.into_iter().flat_map(u32::to_le_bytes).collect()
    }

    fn restore(&mut self, saved: &[u8]) -> Result<(), Error> {
        let (words, rest) = saved.as_chunks();
        let words: Vec<u32> = words.iter().map(|w| u32::from_le_bytes(*w)).collect();
        let [low, high, initial, additional, ref ranking @ ..] = words[..] else { return Err(NOT_OURS) };
        let ranking = match *ranking {
            [] => None,
            [pilot, asking, level, ref order @ ..] => {
                let mut seen = vec![false; order.len()];
                let fresh = |i: &u32| seen.get_mut(*i as usize).is_some_and(|seen| !std::mem::replace(seen, true));
                if !order.iter().all(fresh) || asking as usize > order.len() {
                    return Err(NOT_OURS);
                }
                Some(Ranking { pilot, order: order.to_vec(), asking: asking as usize, level: level != 0 })
            }
            _ => return Err(NOT_OURS),
        };
        if !rest.is_empty() {
            return Err(NOT_OURS);
        }
        let mean = u64::from(low) | u64::from(high) << 32;
        // Before rates are selected, the initial rate is 0.
        self.rates = (initial > 0).then_some((mean, Rates { initial, additional }));
        self.ranking = ranking;
        Ok(())
    }
}

impl Ranking {
    fn new(pilot: u32, scores: &[f64]) -> Self {
        // Contrast saturates at 1, so ties are common. Ordering ties by index would give all samples to the top of the image.
        let tie = |i: u32| mix(u64::from(i));
        let mut order: Vec<u32> = (0..scores.len() as u32).collect();
        order.sort_unstable_by(|&a, &b| {
            scores[b as usize].total_cmp(&scores[a as usize]).then_with(|| tie(a).cmp(&tie(b)))
        });
        let asking = scores.iter().filter(|&&s| s > 1.0).count();
        let level = scores.windows(2).all(|w| w[0] == w[1]);
        Self { pilot, order, asking, level }
    }
}

/// A plan of additional samples under construction, and the samples left of the budget.
struct Steps<'a> {
    film: &'a Film,
    plan: &'a mut [u32],
    now: Vec<u32>,
    max_spp: u32,
    left: u64,
    /// `true` for pixels whose first refinement has removed the pilot's samples from the image. Empty if refinement keeps them.
    withdrawn: Vec<bool>,
}

impl<'a> Steps<'a> {
    fn new(seen: &Feedback<'a>, plan: &'a mut Plan, now: Vec<u32>, withdraws: bool) -> Self {
        let withdrawn = vec![false; if withdraws { now.len() } else { 0 }];
        let BudgetLeft { max_spp, .. } = seen.budget;
        Self { film: seen.film, plan: &mut plan.counts, now, max_spp, left: seen.budget.left(), withdrawn }
    }

    /// The number of samples that pixel `i` will have in the image after the round.
    fn count(&self, i: usize) -> u32 {
        let before = if self.withdrawn.get(i) == Some(&true) { 0 } else { self.now[i] };
        before.saturating_add(self.plan[i])
    }

    /// Raises the counts of pixels to `target`, in the given order, until the budget is spent.
    fn raise_all(&mut self, order: &[u32], target: u32, refines: bool) {
        for &i in order {
            if self.left == 0 {
                return;
            }
            self.raise(i as usize, target, refines);
        }
    }

    fn raise(&mut self, i: usize, target: u32, refines: bool) {
        let count = self.count(i);
        if count >= target {
            return;
        }
        let withdraws = refines && self.withdrawn.get(i) == Some(&false);
        let fresh = withdraws && self.now[i] > 0 && self.film.discarded(i).count == 0;
        let step = u64::from(if fresh { target - self.plan[i] } else { target - count });
        if step <= self.left {
            self.left -= step;
            if fresh {
                self.withdrawn[i] = true;
                self.plan[i] = target;
            } else {
                self.plan[i] += target - count;
            }
            return;
        }
        // The budget ends within this step: the pixel gets the rest, and keeps its pilot samples.
        let rest = self.left.min(u64::from(self.max_spp.saturating_sub(count)));
        self.plan[i] += rest as u32;
        self.left -= rest;
    }

    /// Raises pixels to the refined count in the given order, then repeatedly by the additional rate. Ends when no sample is
    /// left or all pixels are at the ceiling.
    fn raise_in_passes(&mut self, order: &[u32], rates: Rates) {
        let step = rates.additional;
        let lowest = (0..self.now.len()).map(|i| self.count(i)).min().unwrap_or(0);
        // The first pass that raises any count.
        let passes = lowest.checked_sub(rates.refined()).map_or(0, |above| above / step + 1);
        let mut target = rates.refined().saturating_add(step.saturating_mul(passes));
        while self.left > 0 {
            self.raise_all(order, target.min(self.max_spp), true);
            if target >= self.max_spp {
                return;
            }
            target = target.saturating_add(step);
        }
    }
}
