//! Where samples lie and how many each pixel gets: the one thing a user swaps.

use crate::{Error, Film, Frame, Limits, Needs, Plan, PointSet, Progress, SamplerMemory};

/// What remains of the budget when a round is planned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BudgetLeft {
    /// Samples traced so far, discarded ones included.
    pub spent: u64,
    /// Samples that may be spent in all, as far as is known now. Under a time or error limit the
    /// render loop may raise it later and ask again after [`Progress::Done`].
    pub total: u64,
    /// No pixel should end below this many kept samples.
    pub min_spp: u32,
    /// No pixel may end above this many kept samples.
    pub max_spp: u32,
}

impl BudgetLeft {
    /// Samples that may still be asked for.
    pub const fn left(&self) -> u64 {
        self.total.saturating_sub(self.spent)
    }
}

/// What a sampler sees: finished rounds only.
#[derive(Clone, Copy)]
pub struct Feedback<'a> {
    /// How many rounds were traced before this one.
    pub round: u32,
    /// What was rendered so far, as far as [`Sampler::needs`] asked for it.
    pub film: &'a Film,
    /// What may still be spent.
    pub budget: BudgetLeft,
}

impl Feedback<'_> {
    /// The image's size and window.
    pub fn frame(&self) -> &Frame {
        self.film.frame()
    }

    /// The number of pixels, the length of every plan.
    pub fn pixels(&self) -> usize {
        self.film.frame().pixels()
    }
}

/// Where samples lie and how many each pixel gets.
///
/// Deciding is a pure computation on [`Feedback`], tested on made-up films without rendering.
/// Implementations must pass `dapple_conformance::sampler`.
pub trait Sampler: Send {
    /// Its short name, as the command line knows it.
    fn name(&self) -> &str;

    /// The name and every parameter that matters, for headers and reports: `variance:pilot=4`.
    fn describe(&self) -> String {
        self.name().to_owned()
    }

    /// Whether counts are decided without a look at any sample: such an image is unbiased, whatever the budget.
    fn a_priori(&self) -> bool {
        false
    }

    /// What it reads of the samples; recorded only if somebody asks.
    fn needs(&self) -> Needs {
        Needs::none()
    }

    /// The memory that it takes besides the film of a render of this frame within these limits; `needs` are all that the
    /// film records. The default is that of a sampler that fills in its plan and looks at the film for the rest.
    fn memory(&self, frame: &Frame, needs: &Needs, limits: &Limits) -> SamplerMemory {
        let _ = limits;
        SamplerMemory::planning(frame, needs.halves, 0)
    }

    /// The coordinates in use.
    fn points(&self) -> &dyn PointSet;

    /// Plans a round: fills `plan` (handed over empty) and says [`Progress::Trace`], or says
    /// [`Progress::Done`]. Round 0 has seen nothing: it is the a-priori plan.
    ///
    /// Asks for at most `seen.budget.left()` samples. A sampler that spends its budget exactly goes
    /// on until nothing is left; one that stops by a threshold may stop earlier.
    ///
    /// # Errors
    ///
    /// When the budget cannot be met: below `min_spp` for every pixel, say.
    fn next_round(&mut self, seen: &Feedback<'_>, plan: &mut Plan) -> Result<Progress, Error>;

    /// What it keeps from one round to the next and could not derive anew from the film: plain bytes, for
    /// [`Sampler::restore`]. Nothing by default: most samplers look at the film again.
    fn save(&self) -> Vec<u8> {
        Vec::new()
    }

    /// Takes back what [`Sampler::save`] gave: a sampler made with the same words then plans as the one that was saved.
    /// Called before the first plan of a render that goes on.
    ///
    /// # Errors
    ///
    /// [`Error::BadSnapshot`] for bytes that its `save` does not give.
    fn restore(&mut self, saved: &[u8]) -> Result<(), Error> {
        match saved {
            [] => Ok(()),
            _ => Err(Error::BadSnapshot { what: "they hold the state of a sampler, and this one has none" }),
        }
    }
}
