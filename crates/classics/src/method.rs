//! Methods defined by a rule with options, and common parts of the rules: a uniform pilot, equal steps of the budget, and
//! selection of the pixels with the largest errors.

use crate::recorders::Singles;
use dapple_core::filter::{FilterMemory, ImagePlanes};
use dapple_core::options::Options;
use dapple_core::plan::{Feedback, Plan, Progress, SamplerMemory, Stopping, allocate, saturating_u32};
use dapple_core::point_set::mix;
use dapple_core::{Error, Film, Filter, Filtered, Frame, Limits, Needs, PointSet, Sampler, film::Recorder};
use std::cmp::Ordering;
use std::mem;
use std::sync::Arc;

/// A rule that plans sample counts from a film alone, after a pilot.
pub trait SamplingMethod: Options + Copy + Send {
    /// The sampler's name.
    const NAME: &'static str;

    /// The bytes per pixel that planning a round needs besides the plan.
    const PLANNING: usize;

    /// The statistics that the rule reads.
    fn needs(&self) -> Needs {
        Needs::none().with_variance()
    }

    /// The recorders of statistics that the rule reads.
    fn recorders(&self) -> Vec<Arc<dyn Recorder>> {
        Vec::new()
    }

    /// The pilot's samples per pixel for a mean budget of `mean` samples per pixel, and the number of later rounds (`None` if
    /// unknown).
    fn pilot_and_rounds(&self, mean: u64) -> (u32, Option<u32>);

    /// Plans a round after the pilot of `first` samples per pixel. Counts stay 0 if no more samples are needed.
    ///
    /// `kept` is a number, 0 or above, that the rule preserves from round to round; it is `None` at first.
    ///
    /// # Errors
    ///
    /// If the budget cannot be met, or the film lacks a recorder's data.
    fn refine(&self, seen: &Feedback<'_>, first: u32, kept: &mut Option<f64>, plan: &mut Plan) -> Result<(), Error>;
}

/// A sampler that combines a point set with a rule and its options.
pub struct MethodSampler<P, M> {
    points: P,
    options: M,
    kept: Option<f64>,
}

impl<P: PointSet, M: SamplingMethod> MethodSampler<P, M> {
    /// Creates a sampler with these points and the default parameters.
    pub fn new(points: P) -> Self {
        Self { points, options: M::default(), kept: None }
    }

    /// Creates a sampler with these points and parameters.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] for the first parameter out of range.
    pub fn with_options(points: P, options: M) -> Result<Self, Error> {
        options.check_ranges()?;
        Ok(Self { options, ..Self::new(points) })
    }
}

impl<P: PointSet, M: SamplingMethod> Sampler for MethodSampler<P, M> {
    fn name(&self) -> &str {
        M::NAME
    }

    fn describe(&self) -> String {
        format!("{}:{}", M::NAME, self.options.describe())
    }

    fn rounds(&self) -> Option<u32> {
        self.options.pilot_and_rounds(0).1.map(|rounds| 1 + rounds)
    }

    fn needs(&self) -> Needs {
        self.options.needs()
    }

    fn recorders(&self) -> Vec<Arc<dyn Recorder>> {
        self.options.recorders()
    }

    fn memory(&self, frame: &Frame, _: &Needs, _: &Limits) -> SamplerMemory {
        SamplerMemory::planning(frame, M::PLANNING)
    }

    fn points(&self) -> &dyn PointSet {
        &self.points
    }

    fn next_round(&mut self, seen: &Feedback<'_>, plan: &mut Plan) -> Result<Progress, Error> {
        seen.film.require(M::NAME, &self.needs())?;
        if seen.round == 0 {
            self.kept = None;
        }
        if seen.budget.left() == 0 {
            return Ok(Progress::Done);
        }
        // The pilot respects the limits of each pixel's count and the mean budget.
        let mean = seen.budget.total / seen.pixels() as u64;
        let (pilot, _) = self.options.pilot_and_rounds(mean);
        let first = pilot.max(seen.budget.min_spp).min(seen.budget.max_spp).min(saturating_u32(mean));
        plan.counts = counts_so_far(seen).into_iter().map(|n| first.saturating_sub(n)).collect();
        if plan.total() == 0 || plan.total() > seen.budget.left() {
            plan.counts.fill(0);
            self.options.refine(seen, first, &mut self.kept, plan)?;
        }
        Ok(if plan.total() == 0 { Progress::Done } else { Progress::Trace })
    }

    fn save(&self) -> Vec<u8> {
        self.kept.map_or_else(Vec::new, |kept| kept.to_le_bytes().to_vec())
    }

    fn restore(&mut self, saved: &[u8]) -> Result<(), Error> {
        self.kept = match <[u8; 8]>::try_from(saved).map(f64::from_le_bytes) {
            Ok(kept) if kept >= 0.0 => Some(kept),
            Err(_) if saved.is_empty() => None,
            _ => return Err(Error::BadSnapshot { what: "the data hold no state of this sampler" }),
        };
        Ok(())
    }
}

/// A rule that computes an image from a film and from inputs `I`: nothing, or the points of the film's samples.
pub trait FilterMethod<I = ()>: Options + Copy + Send + Sync {
    /// The filter's name.
    const NAME: &'static str;

    /// The bytes per pixel that computing the image needs.
    const BYTES: usize = 12;

    /// The planes of the image.
    const PLANES: ImagePlanes = ImagePlanes::Radiance;

    /// The individual samples that the rule reads; none by default.
    const SAMPLES: Option<Singles> = None;

    /// The statistics that the rule reads.
    fn needs(&self) -> Needs {
        Self::SAMPLES.map_or(Needs::none(), Singles::needs)
    }

    /// The recorders of statistics that the rule reads.
    fn recorders(&self) -> Vec<Arc<dyn Recorder>> {
        Self::SAMPLES.map_or(Vec::new(), Singles::list)
    }

    /// Checks the inputs.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] for inputs that the rule cannot use.
    fn check(&self, inputs: &I) -> Result<(), Error> {
        let _ = inputs;
        Ok(())
    }

    /// Computes the image of a film that records the statistics of [`Self::needs`] and [`Self::recorders`].
    ///
    /// # Errors
    ///
    /// If the film lacks a recorder's data.
    fn image(&self, film: &Film, inputs: &I) -> Result<Filtered, Error>;
}

/// The [`Filter`] of a method `M`: its options, which define how a film is filtered, and the inputs `I` read besides a film.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MethodFilter<M, I = ()> {
    inputs: I,
    options: M,
}

impl<M: FilterMethod> MethodFilter<M> {
    /// Creates a filter with these parameters.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] for the first parameter out of range.
    pub fn with_options(options: M) -> Result<Self, Error> {
        Self::new((), options)
    }
}

impl<I, M: FilterMethod<I>> MethodFilter<M, I> {
    /// Creates a filter with these inputs and parameters.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] for the first parameter out of range, and for inputs that the method cannot use.
    pub fn new(inputs: I, options: M) -> Result<Self, Error> {
        options.check_ranges()?;
        options.check(&inputs)?;
        Ok(Self { inputs, options })
    }
}

impl<I: Send + Sync, M: FilterMethod<I>> Filter for MethodFilter<M, I> {
    fn name(&self) -> &str {
        M::NAME
    }

    fn describe(&self) -> String {
        format!("{}:{}", M::NAME, self.options.describe())
    }

    fn needs(&self) -> Needs {
        self.options.needs()
    }

    fn recorders(&self) -> Vec<Arc<dyn Recorder>> {
        self.options.recorders()
    }

    fn memory(&self, frame: &Frame, _: &Needs) -> FilterMemory {
        FilterMemory::new(frame, M::BYTES, M::PLANES)
    }

    fn apply(&self, film: &Film) -> Result<Filtered, Error> {
        film.require(M::NAME, &self.needs())?;
        self.options.image(film, &self.inputs)
    }
}

/// The number of samples of each pixel so far.
pub(crate) fn counts_so_far(seen: &Feedback<'_>) -> Vec<u32> {
    (0..seen.pixels()).map(|i| saturating_u32(seen.film.count(i))).collect()
}

/// The sum of counts.
pub(crate) fn total(counts: &[u32]) -> u64 {
    counts.iter().map(|&n| u64::from(n)).sum()
}

/// The number of samples that each pixel lacks to reach its count in `wanted`.
pub(crate) fn lacking(wanted: &[u32], now: &[u32]) -> Vec<u32> {
    wanted.iter().zip(now).map(|(n, now)| n - now).collect()
}

/// The number of samples of the next round, if the budget after `first` samples per pixel is divided into `rounds` equal steps.
pub(crate) fn next_step(seen: &Feedback<'_>, first: u32, rounds: u32) -> u64 {
    let budget = seen.budget;
    let first = (u64::from(first) * seen.pixels() as u64).min(budget.total);
    let step = |k: u32| first + (u128::from(budget.total - first) * u128::from(k) / u128::from(rounds.max(1))) as u64;
    let target = (1..=rounds).map(step).find(|&target| target > budget.spent).unwrap_or(budget.total);
    target.min(budget.total).saturating_sub(budget.spent)
}

/// Limits the planned counts to each pixel's ceiling, and distributes the excess evenly over pixels below their ceiling.
pub(crate) fn within_ceiling(seen: &Feedback<'_>, mut planned: Vec<u32>) -> Result<Vec<u32>, Error> {
    let most = seen.budget.max_spp;
    let mut beyond = 0;
    for (count, now) in planned.iter_mut().zip(counts_so_far(seen)) {
        let room = most.saturating_sub(now);
        beyond += u64::from(count.saturating_sub(room));
        *count = (*count).min(room);
    }
    with_extra(seen, planned, beyond)
}

/// Adds `extra` samples to the planned counts, such that the total counts of all pixels become as equal as possible.
pub(crate) fn with_extra(seen: &Feedback<'_>, planned: Vec<u32>, extra: u64) -> Result<Vec<u32>, Error> {
    if extra == 0 {
        return Ok(planned);
    }
    let now = counts_so_far(seen);
    let floors: Vec<u32> = planned.iter().zip(&now).map(|(more, n)| n + more).collect();
    let counts = allocate(&vec![1.0; floors.len()], &floors, seen.budget.max_spp, total(&floors) + extra)?.counts;
    Ok(lacking(&counts, &now))
}

/// The rule that gives a round's samples to the pixels with the largest scores.
///
/// [`Stopping::Threshold`] adds `step` samples to each pixel whose score exceeds 1. [`Stopping::Budget`] spends the budget in
/// at most 64 rounds, each on the quarter of the pixels with the largest scores above 0. If no pixel can take more, the rest of
/// the budget is spread evenly.
#[derive(Clone, Copy, Debug)]
pub(crate) struct WorstFirst {
    pub(crate) mode: Stopping,
    /// The number of samples that a round adds to each selected pixel.
    pub(crate) step: u32,
    /// The largest number of samples of a pixel, as a multiple of the mean budget.
    pub(crate) cap: f64,
}

/// One pixel in this many is refined in a round with [`Stopping::Budget`].
const QUARTER: usize = 4;
/// The largest number of rounds with [`Stopping::Budget`].
const ROUNDS: u64 = 64;

impl WorstFirst {
    /// The bytes per pixel that planning needs besides plan and scores.
    pub(crate) const BYTES: usize = 24;

    /// Fills the counts of `plan`. They stay 0 if no more samples are needed.
    ///
    /// Scores are errors relative to the threshold. NaN counts as 0. Ties are broken by a hash of the pixel's index.
    pub(crate) fn plan(&self, seen: &Feedback<'_>, scores: &[f64], plan: &mut Plan) -> Result<(), Error> {
        let (budget, pixels) = (seen.budget, seen.pixels());
        let mean = budget.total as f64 / pixels as f64;
        let ceiling = ((self.cap * mean).ceil().min(f64::from(u32::MAX)) as u32).min(budget.max_spp);
        let room = |i: usize| ceiling.saturating_sub(saturating_u32(seen.film.count(i)));
        let least = if self.mode == Stopping::Threshold { 1.0 } else { 0.0 };
        let mut open: Vec<u32> = (0..pixels).filter(|&i| scores[i] > least && room(i) > 0).map(|i| i as u32).collect();
        let mut step = self.step;
        let order = |a: &u32, b: &u32| by_score(scores, *a, *b);
        if self.mode == Stopping::Budget {
            let most = pixels.div_ceil(QUARTER);
            step = step.max(saturating_u32(budget.total / ROUNDS / most as u64));
            if most < open.len() {
                open.select_nth_unstable_by(most, order);
                open.truncate(most);
            }
        }
        let mut left = budget.left();
        if left < open.len() as u64 * u64::from(step) {
            open.sort_unstable_by(order);
        }
        for i in open.into_iter().map(|i| i as usize) {
            plan.counts[i] = step.min(room(i)).min(saturating_u32(left));
            left -= u64::from(plan.counts[i]);
        }
        if plan.total() == 0 && self.mode == Stopping::Budget {
            plan.counts = with_extra(seen, mem::take(&mut plan.counts), budget.left())?;
        }
        Ok(())
    }
}

/// Orders pixels by descending score, then by a hash of their index.
fn by_score(scores: &[f64], a: u32, b: u32) -> Ordering {
    let tie = |i: u32| mix(u64::from(i));
    scores[b as usize].total_cmp(&scores[a as usize]).then_with(|| tie(a).cmp(&tie(b)))
}
