//! Two samplers in sequence.

use dapple_core::plan::{BudgetLeft, Feedback, Plan, Progress, SamplerMemory, saturating_u32};
use dapple_core::{Error, Frame, Limits, Needs, PointSet, Sampler, film::Recorder, limits::Budget, options::nested};
use std::sync::Arc;

/// Two samplers in sequence: the first spends a number of samples per pixel, the second the rest of the budget.
///
/// The second sampler sees the first one's samples in the film. They count towards the second sampler's pilot, so it adds only
/// the pilot samples that are still missing. A sampler that reads samples can thus follow one that plans from geometry.
///
/// The second sampler starts when the first one has spent its samples or requests no more. Each sampler uses its own point set.
/// Use the same point set for both, so that a pixel's samples continue one sequence.
///
/// *Guarantees*: the budget is spent exactly if the second sampler does so. *Bias*: none if both samplers are [a
/// priori](Sampler::a_priori). Otherwise each sampler has the bias of its policy. A second sampler that reads samples also
/// reads the first one's, which stay in the image [Kirk and Arvo 1991]. [`Sampler::describe`] names both samplers with their
/// policies. *Weaknesses*: the second sampler cannot move samples that the first one put in the wrong place.
///
/// ```
/// # use dapple_core::{PointSet, SampleId};
/// # struct Centre;
/// # impl PointSet for Centre {
/// #     fn describe(&self) -> String { "centre".into() }
/// #     fn block(&self, _: SampleId, _: u32) -> [f32; 4] { [0.5; 4] }
/// # }
/// use dapple_core::Sampler;
/// use dapple_adaptive::Sequence;
/// use dapple_core::samplers::Uniform;
///
/// let sampler = Sequence::new(Uniform::new(Centre), 4, Uniform::new(Centre))?;
/// assert_eq!(sampler.describe(), "sequence:first=uniform,spp=4,second=uniform");
/// assert!(sampler.a_priori());
/// # Ok::<(), dapple_core::Error>(())
/// ```
pub struct Sequence<A, B> {
    first: A,
    spp: u32,
    second: B,
    /// `true` from the end of the first stage on.
    is_second: bool,
    /// The state of the second sampler before its first plan.
    fresh: Vec<u8>,
}

impl<A: Sampler, B: Sampler> Sequence<A, B> {
    /// Creates a sequence in which `first` spends up to `spp` samples per pixel on average, and `second` the rest.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] for an `spp` of 0.
    pub fn new(first: A, spp: u32, second: B) -> Result<Self, Error> {
        if spp == 0 {
            return Err(Error::out_of_range("spp", spp, "at least 1 sample per pixel for the first sampler"));
        }
        let fresh = second.save();
        Ok(Self { first, spp, second, is_second: false, fresh })
    }

    /// The number of samples that the first sampler may spend on `pixels` pixels.
    fn share(&self, pixels: usize) -> u64 {
        u64::from(self.spp).saturating_mul(pixels as u64)
    }

    /// The budget of the first sampler, with limits on counts that leave every pixel's floor affordable.
    fn first_budget(&self, seen: &Feedback<'_>) -> BudgetLeft {
        let pixels = seen.pixels() as u64;
        let BudgetLeft { min_spp, max_spp, .. } = seen.budget;
        let total = seen.budget.total.min(self.share(seen.pixels()));
        let affordable = saturating_u32(total / pixels);
        // Samples above a pixel's floor must not use up the samples that the floors of other pixels need.
        let beyond_floors = seen.budget.total.saturating_sub(pixels * u64::from(min_spp));
        let is_tight = affordable < min_spp && beyond_floors < total;
        let max_spp = if is_tight { min_spp.min(max_spp) } else { max_spp };
        BudgetLeft::new(total).with_spent(seen.budget.spent).with_min_spp(min_spp.min(affordable)).with_max_spp(max_spp)
    }
}

impl<A: Sampler, B: Sampler> Sampler for Sequence<A, B> {
    fn name(&self) -> &str {
        "sequence"
    }

    fn describe(&self) -> String {
        let [first, second] = [nested(&self.first.describe()), nested(&self.second.describe())];
        format!("sequence:first={first},spp={},second={second}", self.spp)
    }

    fn a_priori(&self) -> bool {
        self.first.a_priori() && self.second.a_priori()
    }

    fn rounds(&self) -> Option<u32> {
        Some(self.first.rounds()?.saturating_add(self.second.rounds()?))
    }

    fn needs(&self) -> Needs {
        self.first.needs().and(self.second.needs())
    }

    fn recorders(&self) -> Vec<Arc<dyn Recorder>> {
        [self.first.recorders(), self.second.recorders()].concat()
    }

    fn memory(&self, frame: &Frame, needs: &Needs, limits: &Limits) -> SamplerMemory {
        let share = self.share(frame.pixels());
        let total = limits.budget.samples(frame).map(|total| total.min(share));
        let of = |budget: Budget| {
            let mut limits = limits.clone();
            limits.budget = budget;
            limits
        };
        let first = self.first.memory(frame, needs, &of(total.map_or(limits.budget, Budget::Samples)));
        // The second sampler's first plan starts from a film with samples, as under a time limit.
        let second = self.second.memory(frame, needs, &of(Budget::Seconds(1.0)));
        let mut memory = SamplerMemory::default();
        memory.discarded = first.discarded.max(second.discarded);
        memory.state = first.state.saturating_add(second.state);
        memory.planning = first.planning.max(second.planning);
        memory.plan = first.plan.max(second.plan);
        memory
    }

    fn points(&self) -> &dyn PointSet {
        if self.is_second { self.second.points() } else { self.first.points() }
    }

    fn next_round(&mut self, seen: &Feedback<'_>, plan: &mut Plan) -> Result<Progress, Error> {
        if seen.round == 0 {
            // The sampler may have been used for an earlier render.
            self.is_second = false;
            self.second.restore(&self.fresh)?;
        }
        if seen.budget.left() == 0 {
            return Ok(Progress::Done);
        }
        if !self.is_second && seen.budget.spent < self.share(seen.pixels()) {
            let budget = self.first_budget(seen);
            if self.first.next_round(&Feedback::new(seen.round, seen.film, budget), plan)? == Progress::Trace {
                return Ok(Progress::Trace);
            }
            *plan = Plan::empty(seen.pixels());
        }
        self.is_second = true;
        self.second.next_round(seen, plan)
    }

    fn save(&self) -> Vec<u8> {
        let (first, second) = (self.first.save(), self.second.save());
        [&[u8::from(self.is_second)][..], &(first.len() as u64).to_le_bytes(), &first, &second].concat()
    }

    fn restore(&mut self, saved: &[u8]) -> Result<(), Error> {
        let parts = || {
            let (stage @ (0 | 1), rest) = saved.split_first()? else { return None };
            let (length, rest) = rest.split_first_chunk()?;
            let (first, second) = rest.split_at_checked(u64::from_le_bytes(*length).try_into().ok()?)?;
            Some((*stage == 1, first, second))
        };
        let (is_second, first, second) =
            parts().ok_or(Error::BadSnapshot { what: "the data hold no state of two samplers" })?;
        self.is_second = is_second;
        self.first.restore(first)?;
        self.second.restore(second)
    }
}
