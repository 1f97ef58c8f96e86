//! The error-driven sampler: a uniform pilot, then more samples where they reduce the error most.

use crate::pilot::Pilot;
use crate::{AdaptiveOptions, ErrorMap, VarianceOptions, pool};
use dapple_core::options::Options as _;
use dapple_core::plan::{Feedback, PilotPolicy, Plan, Progress, SamplerMemory};
use dapple_core::{Error, Frame, Limits, Needs, PointSet, Sampler, film::RgbMoments, parallel};

/// The error-driven sampler. A uniform pilot estimates each pixel's error. The other samples are distributed so that the
/// estimated relative error of the image is least.
///
/// The score of a pixel is the relative variance of its samples, pooled with that of its neighbours
/// ([`relative_variance`](crate::relative_variance)). By default, neighbours with similar surfaces weigh more, and pixels with
/// few similar neighbours get higher scores, since a filter averages over fewer pixels there
/// ([`PoolShape::Similar`](crate::PoolShape::Similar)). If an [`ErrorMap`] is given, it is combined with the scores by a
/// geometric mean ([`AdaptiveOptions::mix`]). The squared error of a pixel with `n` samples is assumed to be `score *
/// n^-exponent`. Counts minimise the sum of squared errors, and are well stratified where possible
/// ([`Ladder`](dapple_core::plan::Ladder)).
///
/// With [`AdaptiveOptions::cost`], scores are divided by the rays per sample. If `exponent` is 1, counts are then proportional
/// to `sqrt(score / rays)`, as in efficiency-aware splitting [after Rath 2022].
///
/// # Guarantees
///
/// * The budget is spent exactly.
/// * If the pilot is kept, no pixel gets fewer samples than the pilot has per pixel ([`AdaptiveOptions::pilot`]).
/// * Every pixel's score is at least 1 % of the mean score.
/// * Counts are uniform if adaptive counts are predicted to gain too little ([`AdaptiveOptions::gain`]).
///
/// # Bias
///
/// By default ([`PilotPolicy::Neighbours`]), all samples stay in the image. No pixel's count depends on the light or the
/// surfaces of its own samples. If the budget is known at the start, the only remaining bias comes from the sum of all scores,
/// to which each pixel contributes. With [`PilotPolicy::Keep`] a pixel's count also depends on its own samples [Kirk and Arvo
/// 1991]. This lowers the error a little, and loses energy where light is rare. [`PilotPolicy::Discard`] and
/// [`PilotPolicy::Cross`] are exactly unbiased for a budget that is known at the start, but less accurate.
///
/// # Weaknesses
///
/// A light is not found if the pilot misses it in a whole neighbourhood.
pub struct Adaptive<P> {
    pub(crate) points: P,
    pub(crate) options: AdaptiveOptions,
    /// The preset whose options are in use, if any. Its name and parameters then describe the sampler.
    pub(crate) preset: Option<VarianceOptions>,
    pub(crate) errors: Option<ErrorMap>,
}

impl<P: PointSet> Adaptive<P> {
    /// Creates a sampler that uses this point set, with the default parameters.
    pub fn new(points: P) -> Self {
        Self { points, options: AdaptiveOptions::default(), preset: None, errors: None }
    }

    /// Creates a sampler that uses this point set, with these parameters.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`], under the conditions of [`AdaptiveOptions::check`].
    pub fn with_options(points: P, options: AdaptiveOptions) -> Result<Self, Error> {
        options.check()?;
        Ok(Self { points, options, preset: None, errors: None })
    }

    /// Combines a filter's error map with the scores by a geometric mean, weighted by [`AdaptiveOptions::mix`].
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] unless the policy is [`PilotPolicy::Keep`].
    pub fn with_error_map(mut self, errors: ErrorMap) -> Result<Self, Error> {
        if self.options.policy != PilotPolicy::Keep {
            let allowed = "policy=keep, as a filter's error map reads kept samples";
            return Err(Error::OutOfRange { name: "policy", value: self.options.policy.name().into(), allowed });
        }
        self.errors = Some(errors);
        Ok(self)
    }

    fn pilot(&self) -> Pilot {
        Pilot::new(self.options.policy, self.options.pilot)
    }
}

impl<P: PointSet> Sampler for Adaptive<P> {
    fn name(&self) -> &str {
        if self.preset.is_some() { "variance" } else { "adaptive" }
    }

    fn describe(&self) -> String {
        if let Some(preset) = &self.preset {
            return format!("variance:{}", preset.describe());
        }
        let by = self.errors.as_ref().map_or("variance", |map| &map.name);
        format!("adaptive:by={by},{}", self.options.describe())
    }

    fn rounds(&self) -> Option<u32> {
        Some(1 + self.options.rounds_after_pilot())
    }

    fn needs(&self) -> Needs {
        let mut needs = Needs::none().with_variance();
        needs.cost = self.options.cost == 1;
        needs = if self.options.policy == PilotPolicy::Cross { needs.with_half_variance() } else { needs };
        self.errors.as_ref().map_or(needs, |map| needs.and(map.needs))
    }

    fn memory(&self, frame: &Frame, needs: &Needs, limits: &Limits) -> SamplerMemory {
        let crosses = self.options.policy == PilotPolicy::Cross;
        let memory = SamplerMemory::planning(frame, 0);
        let mut memory = if crosses { memory.with_second_half(frame) } else { memory };
        if !self.pilot().is_all(frame, limits) {
            // Counts, floors, the counts and floors of both halves, and positive scores; pooled costs, and scores divided by
            // them.
            let costs = if self.options.cost == 1 { 16 } else { 0 };
            let always = 20 + if crosses { 12 } else { 0 } + costs;
            // Scores, moments of pairs, and the windows of each thread; scores together with the error map.
            let pairs = if self.pilot().is_single(frame, limits) { size_of::<RgbMoments>() } else { 0 };
            let size = frame.size().map(|n| n as usize);
            let has_surfaces = needs.features && self.reads_surfaces();
            let radius = 2 * self.options.radius as usize;
            let windows = pool::bytes_of_windows(size, radius, parallel::threads(), has_surfaces);
            let map = self.errors.as_ref().map_or(0, |map| 8 + map.bytes_per_pixel);
            let scoring = frame.bytes(8 + pairs).saturating_add(windows as u64).max(frame.bytes(map));
            memory.planning = memory.planning.saturating_add(frame.bytes(always)).saturating_add(scoring);
        }
        if self.options.policy == PilotPolicy::Discard { memory.with_discarded(frame, needs, limits) } else { memory }
    }

    fn points(&self) -> &dyn PointSet {
        &self.points
    }

    fn next_round(&mut self, seen: &Feedback<'_>, plan: &mut Plan) -> Result<Progress, Error> {
        if seen.budget.left() == 0 {
            return Ok(Progress::Done);
        }
        let pilot = self.pilot().begin(seen, plan);
        if pilot.is_missing {
            return Ok(Progress::Trace);
        }
        match self.options.policy {
            PilotPolicy::Discard => self.plan_after_discarding(seen, plan)?,
            PilotPolicy::Cross => self.plan_across(seen, plan)?,
            _ => self.plan_kept((seen, pilot.samples), plan)?,
        }
        // No samples can be added if every pixel is at its ceiling.
        Ok(if plan.total() == 0 { Progress::Done } else { Progress::Trace })
    }
}
