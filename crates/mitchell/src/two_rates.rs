//! The part that Mitchell's and pbrt-v2's samplers share: a pilot, its retention, a ranking of pixels, and two rates.

use crate::Rates;
use dapple_core::{
    BudgetLeft, Error, Feedback, Film, Frame, Limits, Needs, PilotPolicy, Plan, Progress, Retention, SamplerMemory,
    Stopping, allocate, mix, saturating_u32,
};

const NOT_OURS: Error = Error::BadSnapshot { what: "they do not hold the state of a sampler of two rates" };

/// Implements `Sampler` for a struct of points, options and [`TwoRates`]. The options return the statistics
/// that scores read, the scores, the rates for a mean budget, and the least number of samples that has a
/// score. Scoring takes `$scoring` bytes per pixel.
macro_rules! sampler_of_two_rates {
    ($Sampler:ident, $name:literal, $scoring:expr) => {
        impl<P: PointSet> dapple_core::Sampler for $Sampler<P> {
            fn name(&self) -> &str {
                $name
            }

            fn describe(&self) -> String {
                format!("{}:{}", $name, self.options.describe())
            }

            fn needs(&self) -> dapple_core::Needs {
                self.options.needs()
            }

            fn recorders(&self) -> Vec<std::sync::Arc<dyn dapple_core::Recorder>> {
                if self.options.reads_extrema() { Extrema::list() } else { Vec::new() }
            }

            fn points(&self) -> &dyn PointSet {
                &self.points
            }

            fn next_round(
                &mut self,
                seen: &dapple_core::Feedback<'_>,
                plan: &mut dapple_core::Plan,
            ) -> Result<dapple_core::Progress, Error> {
                seen.film.require($name, &self.needs())?;
                let options = self.options;
                if options.reads_extrema() {
                    Extrema::of(seen.film, $name)?;
                }
                let rates = |mean| options.rates(mean);
                self.two_rates.next_round(seen, plan, rates, options.least(), |film| options.scores(film))
            }

            fn memory(
                &self,
                frame: &dapple_core::Frame,
                needs: &dapple_core::Needs,
                limits: &dapple_core::Limits,
            ) -> dapple_core::SamplerMemory {
                let extremes = if self.options.reads_extrema() { Extrema::BYTES } else { 0 };
                self.two_rates.memory(frame, needs, limits, [$scoring, extremes])
            }

            fn save(&self) -> Vec<u8> {
                self.two_rates.save()
            }

            fn restore(&mut self, saved: &[u8]) -> Result<(), Error> {
                self.two_rates.restore(saved)
            }
        }
    };
}

pub(crate) use sampler_of_two_rates;

/// The state of a sampler with two rates (samples per pixel before and after refinement): ranking and rates in use.
#[derive(Default)]
pub(crate) struct TwoRates {
    pub(crate) mode: Stopping,
    pub(crate) policy: PilotPolicy,
    /// The pixels ranked for refinement. The ranking is made once per pilot: later samples do not change it.
    ranking: Option<Ranking>,
    /// The mean budget, in samples per pixel, for which rates were last chosen, and these rates.
    rates: Option<(u64, Rates)>,
}

/// The pixels in the order in which they are refined.
struct Ranking {
    /// Samples per pixel of the pilot from which the order was computed.
    pilot: u32,
    order: Vec<u32>,
    /// The number of pixels whose contrast exceeds their threshold; they come first in the order.
    asking: usize,
    /// `true` if all pixels have the same score (contrast relative to its threshold).
    level: bool,
}

impl TwoRates {
    pub(crate) fn new(mode: Stopping, policy: PilotPolicy) -> Self {
        Self { mode, policy, ranking: None, rates: None }
    }

    /// Plans the next round. `rates` returns the rates for a mean budget. The rates stay in use until the mean budget
    /// has doubled. Otherwise the last tenth of a time limit would go to one more sample everywhere. A pilot of fewer
    /// than `least` samples per pixel has no contrast. `scores` returns each pixel's contrast relative to its
    /// threshold, from the pilot samples traced so far.
    pub(crate) fn next_round(
        &mut self,
        seen: &Feedback<'_>,
        plan: &mut Plan,
        rates: impl Fn(u64) -> Rates,
        least: u32,
        scores: impl Fn(&Film) -> Result<Vec<f64>, Error>,
    ) -> Result<Progress, Error> {
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
        let (_, rates) = *self.rates.insert(known.unwrap_or_else(|| (mean, rates(mean))));
        let pilot = self.pilot(&budget, mean, rates, least);
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
            _ => Ranking::new(pilot, &scores(seen.film)?),
        };
        self.plan_kept(seen, plan, rates, &ranking)?;
        self.ranking = Some(ranking);
        Ok(if plan.total() == 0 { Progress::Done } else { Progress::Trace })
    }

    /// Encodes the rates and the ranking, which cannot be derived from later films, as bytes for [`TwoRates::restore`].
    pub(crate) fn save(&self) -> Vec<u8> {
        let mut words = Vec::new();
        words.push(u32::from(self.rates.is_some()));
        if let Some((mean, rates)) = self.rates {
            words.extend([mean as u32, (mean >> 32) as u32, rates.initial, rates.additional]);
        }
        words.push(u32::from(self.ranking.is_some()));
        if let Some(Ranking { pilot, order, asking, level }) = &self.ranking {
            words.extend([*pilot, saturating_u32(*asking as u64), u32::from(*level)]);
            words.extend(order);
        }
        words.into_iter().flat_map(u32::to_le_bytes).collect()
    }

    /// Restores the bytes of [`TwoRates::save`].
    pub(crate) fn restore(&mut self, saved: &[u8]) -> Result<(), Error> {
        let (words, rest) = saved.as_chunks();
        let words: Vec<u32> = words.iter().map(|w| u32::from_le_bytes(*w)).collect();
        let (rates, words) = match words[..] {
            [0, ref rest @ ..] => (None, rest),
            [1, low, high, initial, additional, ref rest @ ..] => {
                let mean = u64::from(low) | u64::from(high) << 32;
                (Some((mean, Rates { initial, additional })), rest)
            }
            _ => return Err(NOT_OURS),
        };
        let ranking = match *words {
            [0] => None,
            [1, pilot, asking, level, ref order @ ..] => {
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
        (self.rates, self.ranking) = (rates, ranking);
        Ok(())
    }

    /// The memory of a sampler that needs `scoring` bytes per pixel for its scores, and whose film records `needs` and, for
    /// each half, `extremes` bytes per pixel.
    pub(crate) fn memory(
        &self,
        frame: &Frame,
        needs: &Needs,
        limits: &Limits,
        [scoring, extremes]: [usize; 2],
    ) -> SamplerMemory {
        // The ranking is made after scoring, and held beside the scores, or counts and marks.
        const RANKING: usize = 4;
        let planning = scoring.saturating_sub(RANKING).max(8);
        let memory = SamplerMemory::planning(frame, planning).with_state(frame, RANKING);
        match self.policy {
            PilotPolicy::Keep | PilotPolicy::Cross | PilotPolicy::Neighbours => memory,
            // Withdrawn samples have statistics of their own from the second round on.
            PilotPolicy::Discard | PilotPolicy::Refined => {
                let mut memory = memory.with_discarded(frame, needs, limits);
                let halves = if needs.halves { 2 } else { 1 };
                memory.discarded = memory.discarded.saturating_add(frame.bytes(halves * extremes));
                memory
            }
        }
    }

    /// Returns `true` if the whole pilot is discarded.
    pub(crate) fn discards(&self) -> bool {
        self.policy == PilotPolicy::Discard
    }

    /// Returns the number of pilot samples per pixel, for a budget of `mean` samples per pixel.
    fn pilot(&self, budget: &BudgetLeft, mean: u64, rates: Rates, least: u32) -> u32 {
        let wanted = u64::from(rates.initial);
        if !self.discards() {
            return saturating_u32(wanted.min(mean)).max(budget.min_spp).min(budget.max_spp);
        }
        // A discarded pilot takes at most half of the budget, and leaves each pixel its floor.
        let affordable = mean.saturating_sub(u64::from(budget.min_spp.max(1))).min(mean / 2);
        let pilot = saturating_u32(wanted.min(affordable));
        if pilot < least { 0 } else { pilot }
    }

    fn plan_kept(&self, seen: &Feedback<'_>, plan: &mut Plan, rates: Rates, ranking: &Ranking) -> Result<(), Error> {
        let BudgetLeft { min_spp, max_spp, .. } = seen.budget;
        let now: Vec<u32> = (0..seen.pixels()).map(|i| saturating_u32(seen.film.count(i))).collect();
        let total = now.iter().map(|&n| u64::from(n)).sum::<u64>() + seen.budget.left();
        if ranking.level && self.mode == Stopping::Budget {
            let counts = allocate(&vec![1.0; now.len()], &now, max_spp, total)?.counts;
            plan.counts = counts.iter().zip(&now).map(|(n, now)| n - now).collect();
            return Ok(());
        }
        let floor = saturating_u32(u64::from(rates.initial).min(total / now.len() as u64)).max(min_spp).min(max_spp);
        let mut steps = Steps::new(seen, plan, now, self.policy == PilotPolicy::Refined);
        steps.raise_all(&ranking.order, floor, false);
        match self.mode {
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

impl Ranking {
    fn new(pilot: u32, scores: &[f64]) -> Self {
        // Contrast saturates at 1, so ties are common. In the order of their indices, the top of the image would take
        // all samples.
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
    /// `true` if a pixel's first refinement removes the pilot's samples from the image.
    withdraws: bool,
    withdrawn: Vec<bool>,
}

impl<'a> Steps<'a> {
    fn new(seen: &Feedback<'a>, plan: &'a mut Plan, now: Vec<u32>, withdraws: bool) -> Self {
        let withdrawn = vec![false; if withdraws { now.len() } else { 0 }];
        let BudgetLeft { max_spp, .. } = seen.budget;
        Self { film: seen.film, plan: &mut plan.counts, now, max_spp, left: seen.budget.left(), withdraws, withdrawn }
    }

    /// The number of samples that pixel `i` will have in the image after the round.
    fn count(&self, i: usize) -> u32 {
        let before = if self.withdraws && self.withdrawn[i] { 0 } else { self.now[i] };
        before.saturating_add(self.plan[i])
    }

    /// Raises the counts of pixels to `target`, in the given order, as far as the budget goes.
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
        let fresh =
            refines && self.withdraws && self.now[i] > 0 && !self.withdrawn[i] && self.film.discarded(i).count == 0;
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
        // The budget ends within this step: the pixel takes what is left, and keeps its pilot.
        let rest = self.left.min(u64::from(self.max_spp.saturating_sub(count)));
        self.plan[i] += rest as u32;
        self.left -= rest;
    }

    /// Raises pixels to the refined count in the given order, then again by the additional rate. Ends when no sample is
    /// left or all pixels are at the ceiling.
    fn raise_in_passes(&mut self, order: &[u32], rates: Rates) {
        let step = rates.additional;
        let lowest = (0..self.now.len()).map(|i| self.count(i)).min().unwrap_or(0);
        // The first pass that raises anything.
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
