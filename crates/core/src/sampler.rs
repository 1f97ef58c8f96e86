//! Sample counts per pixel, planned round by round.

use crate::macros::{forward, setters};
use crate::plan::{Plan, Progress, SamplerMemory};
use crate::{Error, Film, Frame, Limits, Needs, PointSet, film::Recorder};
use std::sync::Arc;

/// A render's sample budget, spent and total, at the time a round is planned.
///
/// ```
/// use dapple_core::plan::BudgetLeft;
///
/// let budget = BudgetLeft::new(1000).with_spent(400).with_min_spp(1).with_max_spp(64);
/// assert_eq!(budget.left(), 600);
/// ```
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BudgetLeft {
    /// The number of samples traced so far, discarded ones included.
    pub spent: u64,
    /// The total number of samples that may be spent, as far as known. Under a time or error limit, the render loop may
    /// raise it after a sampler reports [`Progress::Done`], and plan again.
    pub total: u64,
    /// The minimum number of samples per pixel in the image, discarded ones not counted.
    pub min_spp: u32,
    /// The maximum number of samples per pixel in the image, discarded ones not counted.
    pub max_spp: u32,
}

impl BudgetLeft {
    /// An unspent budget of `total` samples, with 1 to 2^32 - 1 samples per pixel.
    pub const fn new(total: u64) -> Self {
        Self { spent: 0, total, min_spp: 1, max_spp: u32::MAX }
    }

    setters! {
        /// Sets the number of samples traced so far, discarded ones included.
        with_spent(spent: u64);
        /// Sets the minimum number of samples per pixel in the image, discarded ones not counted.
        with_min_spp(min_spp: u32);
        /// Sets the maximum number of samples per pixel in the image, discarded ones not counted.
        with_max_spp(max_spp: u32);
    }

    /// The number of samples that may still be planned.
    pub const fn left(&self) -> u64 {
        self.total.saturating_sub(self.spent)
    }
}

/// The state of a render between two rounds, from which a sampler plans the next one.
#[non_exhaustive]
#[derive(Clone, Copy)]
pub struct Feedback<'a> {
    /// The number of rounds traced so far.
    pub round: u32,
    /// The film so far, which records at least the statistics of [`Sampler::needs`].
    pub film: &'a Film,
    /// The sample budget: spent, total, and the bounds of each pixel's count.
    pub budget: BudgetLeft,
}

impl<'a> Feedback<'a> {
    /// The state of a render after `round` rounds of planning and tracing.
    pub const fn new(round: u32, film: &'a Film, budget: BudgetLeft) -> Self {
        Self { round, film, budget }
    }

    /// The image's resolution and its rendered window.
    pub fn frame(&self) -> &Frame {
        self.film.frame()
    }

    /// The number of pixels, which is the length of every plan.
    pub fn pixels(&self) -> usize {
        self.film.frame().pixels()
    }
}

/// A sampler: decides, between rounds, how many samples each pixel gets.
///
/// Planning is a pure computation on [`Feedback`], and can be tested on synthetic films without rendering.
/// Implementations must pass `dapple_conformance::sampler`.
///
/// ```
/// use dapple_core::{Error, PointSet, Sampler};
/// use dapple_core::plan::{Feedback, Plan, Progress, share};
///
/// /// Samples in proportion to brightness, after a first round of four samples per pixel.
/// struct Brightness<P>(P);
///
/// impl<P: PointSet> Sampler for Brightness<P> {
///     fn name(&self) -> &str {
///         "brightness"
///     }
///
///     fn points(&self) -> &dyn PointSet {
///         &self.0
///     }
///
///     fn next_round(&mut self, seen: &Feedback<'_>, plan: &mut Plan) -> Result<Progress, Error> {
///         let (pixels, budget) = (seen.pixels(), seen.budget);
///         if budget.left() == 0 {
///             return Ok(Progress::Done);
///         }
///         // All is black in the first round, so that it is spread evenly. Later the counts so far are floors.
///         let total = if seen.round == 0 { budget.total.min(4 * pixels as u64) } else { budget.total };
///         let now: Vec<u32> = (0..pixels).map(|i| seen.film.count(i) as u32).collect();
///         let weights: Vec<f64> = (0..pixels).map(|i| 0.01 + seen.film.mean(i)[1]).collect();
///         let counts = share(&weights, budget.min_spp, &now, budget.max_spp, total)?.counts;
///         plan.counts = counts.iter().zip(&now).map(|(n, now)| n - now).collect();
///         Ok(Progress::Trace)
///     }
/// }
///
/// # struct Half;
/// # impl PointSet for Half {
/// #     fn describe(&self) -> String { "half".into() }
/// #     fn block(&self, _: dapple_core::SampleId, _: u32) -> [f32; 4] { [0.5; 4] }
/// # }
/// # use dapple_core::{Film, Frame, Needs};
/// # use dapple_core::plan::BudgetLeft;
/// # let film = Film::new(Frame::new(4, 2)?, Needs::none());
/// # let mut plan = Plan::empty(8);
/// # let seen = Feedback::new(0, &film, BudgetLeft::new(100));
/// # assert_eq!(Brightness(Half).next_round(&seen, &mut plan)?, Progress::Trace);
/// # assert_eq!(plan.counts, [4; 8]);
/// # Ok::<(), Error>(())
/// ```
pub trait Sampler: Send {
    /// The sampler's short name on the command line.
    fn name(&self) -> &str;

    /// The sampler's name and every parameter that affects the result, for headers and reports: `variance:pilot=4`.
    fn describe(&self) -> String {
        self.name().to_owned()
    }

    /// Returns `true` if counts never depend on sample values. The image is then unbiased for any budget.
    fn a_priori(&self) -> bool {
        false
    }

    /// The number of rounds in which the sampler spends a budget of samples, for progress reports; `None` if that depends
    /// on the image. A render may take fewer.
    fn rounds(&self) -> Option<u32> {
        None
    }

    /// The statistics that the sampler reads from the film.
    fn needs(&self) -> Needs {
        Needs::none()
    }

    /// The recorders of statistics that this sampler alone reads from the film.
    fn recorders(&self) -> Vec<Arc<dyn Recorder>> {
        Vec::new()
    }

    /// The memory in bytes that the sampler takes besides the film, in a render of this frame within these limits.
    /// `needs` lists all statistics that the film records. The default assumes a sampler that keeps nothing but the
    /// plan.
    fn memory(&self, frame: &Frame, needs: &Needs, limits: &Limits) -> SamplerMemory {
        let _ = limits;
        let memory = SamplerMemory::planning(frame, 0);
        if needs.halves { memory.with_second_half(frame) } else { memory }
    }

    /// The point set that supplies the samples' random numbers.
    fn points(&self) -> &dyn PointSet;

    /// Plans the next round (batch of samples). Fills `plan`, whose counts are 0, and returns [`Progress::Trace`], or
    /// returns [`Progress::Done`] if no more samples are needed. The film is empty in round 0.
    ///
    /// A plan may have at most `seen.budget.left()` samples. A sampler that spends the budget exactly plans until
    /// nothing is left. One that stops at a threshold may stop earlier.
    ///
    /// # Errors
    ///
    /// If the budget cannot be met, for example because it is below `min_spp` per pixel.
    fn next_round(&mut self, seen: &Feedback<'_>, plan: &mut Plan) -> Result<Progress, Error>;

    /// The state that the sampler keeps between rounds and cannot derive from the film, as bytes for
    /// [`Sampler::restore`]. Empty by default.
    fn save(&self) -> Vec<u8> {
        Vec::new()
    }

    /// Restores the state saved by [`Sampler::save`], so that a sampler made with the same options plans as the saved
    /// one would. Called before the first plan of a resumed render.
    ///
    /// # Errors
    ///
    /// [`Error::BadSnapshot`] for bytes that were not written by `save` of such a sampler.
    fn restore(&mut self, saved: &[u8]) -> Result<(), Error> {
        match saved {
            [] => Ok(()),
            _ => Err(Error::BadSnapshot { what: "the data hold the state of a sampler, but this sampler has none" }),
        }
    }
}

forward!(Sampler for &mut T, Box<T>; {
    ref name() -> &str;
    ref describe() -> String;
    ref a_priori() -> bool;
    ref rounds() -> Option<u32>;
    ref needs() -> Needs;
    ref recorders() -> Vec<Arc<dyn Recorder>>;
    ref memory(frame: &Frame, needs: &Needs, limits: &Limits) -> SamplerMemory;
    ref points() -> &dyn PointSet;
    ref save() -> Vec<u8>;
    mut next_round(seen: &Feedback<'_>, plan: &mut Plan) -> Result<Progress, Error>;
    mut restore(saved: &[u8]) -> Result<(), Error>;
});
