//! The uniform sampler, and the sequence of two samplers.

use crate::{
    Budget, BudgetLeft, Error, Feedback, Frame, Limits, Needs, Plan, PointSet, Progress, Recorder, Retention, Sampler,
    SamplerMemory, allocate, nested, saturating_u32, snapshot,
};
use std::sync::Arc;

/// Uniform sampling: the same number of samples for every pixel.
///
/// If the budget is not a multiple of the number of pixels, a hash of the pixel's index picks those that get one sample
/// more.
///
/// *Guarantees*: unbiased, the exact budget, counts that do not depend on samples. *Weaknesses*: spends as much on a
/// constant wall as on its shadow.
///
/// ```
/// # use dapple_core::{PointSet, SampleId};
/// # struct Centre;
/// # impl PointSet for Centre {
/// #     fn describe(&self) -> String { "centre".into() }
/// #     fn block(&self, _: SampleId, _: u32) -> [f32; 4] { [0.5; 4] }
/// #     fn capacity(&self) -> u64 { u64::MAX }
/// # }
/// use dapple_core::samplers::Uniform;
/// use dapple_core::{Block, Draws, Estimate, Frame, Integrator, Limits, Render, Worker};
///
/// struct Grey;
/// impl Integrator for Grey {
///     fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
///         Estimate::new([draws.block(Block::new(0))[0]; 3])
///     }
/// }
///
/// // Two samples per pixel, and one more for two of the six.
/// let frame = Frame::new(3, 2)?;
/// let film = Render::new(frame, &Limits::samples(14)).run(&mut Grey, &mut Uniform::new(Centre))?;
/// assert_eq!(film.counts().iter().filter(|&&n| n == 3).count(), 2);
/// # Ok::<(), dapple_core::Error>(())
/// ```
pub struct Uniform<P> {
    points: P,
}

impl<P: PointSet> Uniform<P> {
    /// A uniform sampler that uses this point set.
    pub fn new(points: P) -> Self {
        Self { points }
    }
}

impl<P: PointSet> Sampler for Uniform<P> {
    fn name(&self) -> &str {
        "uniform"
    }

    fn a_priori(&self) -> bool {
        true
    }

    fn memory(&self, frame: &Frame, _: &Needs, limits: &Limits) -> SamplerMemory {
        // Bytes per pixel: floor, count, score and its copy, hash and index. With a budget known in samples, the only
        // plan is made before anything is written to the film, which takes more.
        let once = limits.budget.samples(frame).is_some();
        SamplerMemory::planning(frame, if once { 0 } else { 40 })
    }

    fn points(&self) -> &dyn PointSet {
        &self.points
    }

    fn next_round(&mut self, seen: &Feedback<'_>, plan: &mut Plan) -> Result<Progress, Error> {
        if seen.budget.left() == 0 {
            return Ok(Progress::Done);
        }
        plan.retention = Retention::Keep;
        // After a raised budget, counts may already differ by one: level them to the new total.
        let mut wanted = level(seen, seen.budget.total)?;
        let now: Vec<u32> = (0..seen.pixels()).map(|i| saturating_u32(seen.film.count(i))).collect();
        let is_uneven = |wanted: &[u32]| wanted.iter().zip(&now).any(|(wanted, now)| wanted < now);
        if seen.budget.spent != sum(&now) || is_uneven(&wanted) {
            // After the rounds of another sampler: pixels that have more keep it, or samples of theirs are discarded.
            let total = sum(&now) + seen.budget.left();
            wanted = allocate(&vec![1.0; now.len()], &now, seen.budget.max_spp, total)?.counts;
        }
        for ((count, wanted), now) in plan.counts.iter_mut().zip(wanted).zip(now) {
            *count = wanted - now;
        }
        // Nothing is left to add if every pixel is at its ceiling.
        Ok(if plan.total() == 0 { Progress::Done } else { Progress::Trace })
    }
}

fn sum(counts: &[u32]) -> u64 {
    counts.iter().map(|&n| u64::from(n)).sum()
}

/// Returns counts per pixel that sum to `total` and differ by at most one. A hash of the pixel's index picks the pixels
/// that get the remainder.
fn level(seen: &Feedback<'_>, total: u64) -> Result<Vec<u32>, crate::Error> {
    let pixels = seen.pixels();
    let floors = vec![seen.budget.min_spp.min(saturating_u32(total / pixels as u64)); pixels];
    Ok(allocate(&vec![1.0; pixels], &floors, seen.budget.max_spp, total)?.counts)
}

/// Two samplers in sequence: the first spends up to a number of samples per pixel, the second the rest of the budget.
///
/// The second sampler sees the first one's samples in the film. If it takes a pilot, they are its pilot, and it adds only
/// what pixels lack. So counts planned from geometry can be the first stage of a sampler that reads samples.
///
/// The first stage ends when its share is spent, or when its sampler wants no more. Each stage uses the points of its
/// sampler. Give both the same point set, so that a pixel's samples continue one sequence.
///
/// *Guarantees*: the budget is spent exactly if the second sampler spends it exactly. *Bias*: none if both samplers are
/// [a priori](Sampler::a_priori). A second sampler that reads samples is biased as its own policy says, and reads the
/// first one's samples too; kept samples that decided counts bias the image [Kirk and Arvo 1991].
/// [`Sampler::describe`] names both with their policies. *Weaknesses*: a first stage that puts samples in the wrong place
/// takes them from the second.
///
/// ```
/// # use dapple_core::{PointSet, SampleId};
/// # struct Centre;
/// # impl PointSet for Centre {
/// #     fn describe(&self) -> String { "centre".into() }
/// #     fn block(&self, _: SampleId, _: u32) -> [f32; 4] { [0.5; 4] }
/// #     fn capacity(&self) -> u64 { u64::MAX }
/// # }
/// use dapple_core::Sampler;
/// use dapple_core::samplers::{Then, Uniform};
///
/// let sampler = Then::new(Uniform::new(Centre), 4, Uniform::new(Centre))?;
/// assert_eq!(sampler.describe(), "then:first=uniform,spp=4,second=uniform");
/// assert!(sampler.a_priori());
/// # Ok::<(), dapple_core::Error>(())
/// ```
pub struct Then<A, B> {
    first: A,
    spp: u32,
    second: B,
    /// `true` from the end of the first stage on.
    is_second: bool,
    /// The state of the second sampler before its first plan.
    fresh: Vec<u8>,
}

impl<A: Sampler, B: Sampler> Then<A, B> {
    /// A sequence in which `first` spends up to `spp` samples per pixel on average, and `second` the rest.
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

    /// The budget of the first sampler: its share, and bounds of counts that leave every pixel's floor affordable.
    fn first_budget(&self, seen: &Feedback<'_>) -> BudgetLeft {
        let pixels = seen.pixels() as u64;
        let BudgetLeft { min_spp, max_spp, .. } = seen.budget;
        let total = seen.budget.total.min(self.share(seen.pixels()));
        let affordable = saturating_u32(total / pixels);
        // Samples above a pixel's floor must not take what other floors need.
        let beyond_floors = seen.budget.total.saturating_sub(pixels * u64::from(min_spp));
        let is_tight = affordable < min_spp && beyond_floors < total;
        let max_spp = if is_tight { min_spp.min(max_spp) } else { max_spp };
        BudgetLeft { total, min_spp: min_spp.min(affordable), max_spp, ..seen.budget }
    }
}

impl<A: Sampler, B: Sampler> Sampler for Then<A, B> {
    fn name(&self) -> &str {
        "then"
    }

    fn describe(&self) -> String {
        let [first, second] = [nested(&self.first.describe()), nested(&self.second.describe())];
        format!("then:first={first},spp={},second={second}", self.spp)
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
        let of = |budget: Budget| Limits { budget, ..limits.clone() };
        let first = self.first.memory(frame, needs, &of(total.map_or(limits.budget, Budget::Samples)));
        // The film is not empty before the second sampler's first plan, just as under a limit of time.
        let second = self.second.memory(frame, needs, &of(Budget::Seconds(1.0)));
        SamplerMemory {
            discarded: first.discarded.max(second.discarded),
            state: first.state.saturating_add(second.state),
            planning: first.planning.max(second.planning),
            plan: first.plan.max(second.plan),
        }
    }

    fn points(&self) -> &dyn PointSet {
        if self.is_second { self.second.points() } else { self.first.points() }
    }

    fn next_round(&mut self, seen: &Feedback<'_>, plan: &mut Plan) -> Result<Progress, Error> {
        if seen.round == 0 {
            // The sampler may have rendered before.
            self.is_second = false;
            self.second.restore(&self.fresh)?;
        }
        if seen.budget.left() == 0 {
            return Ok(Progress::Done);
        }
        if !self.is_second && seen.budget.spent < self.share(seen.pixels()) {
            let budget = self.first_budget(seen);
            if self.first.next_round(&Feedback { budget, ..*seen }, plan)? == Progress::Trace {
                return Ok(Progress::Trace);
            }
            *plan = Plan::empty(seen.pixels());
        }
        self.is_second = true;
        self.second.next_round(seen, plan)
    }

    fn save(&self) -> Vec<u8> {
        snapshot::encoded(&(self.is_second, self.first.save(), self.second.save()), 0)
    }

    fn restore(&mut self, saved: &[u8]) -> Result<(), Error> {
        let (is_second, first, second): (bool, Vec<u8>, Vec<u8>) = snapshot::decoded(saved)?;
        self.is_second = is_second;
        self.first.restore(&first)?;
        self.second.restore(&second)
    }
}
