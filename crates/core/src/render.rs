//! The render loop: plan a round, trace it, plan the next.

mod budget;
mod feature_samples;
pub(crate) mod filtered_error;
mod methods;
mod monitor;
mod plan;
mod pull;
mod repeats;
mod round;
mod session;
mod stage;
pub(crate) mod state;
mod tile;
mod turns;

pub use methods::Methods;
pub use monitor::{Control, Monitor, NoMonitor, Status};
pub use pull::Round;
pub use session::Session;
pub use stage::{Readiness, TracedRows};
pub use state::Stage;
pub use tile::{Samples, Tile};

use crate::{Clock, Error, Film, Filter, Frame, Integrator, Limits, Needs, Sampler, Snapshot, film::Recorder};
use std::sync::Arc;

/// A render to run or resume: the frame, the limits, the statistics to record and a monitor.
///
/// The film records the statistics that the sampler, the integrator and [`Render::needs`] request. An error limit adds
/// halves. Tracing uses the current rayon thread pool.
///
/// ```
/// # use dapple_core::{PointSet, SampleId};
/// # struct Centre;
/// # impl PointSet for Centre {
/// #     fn describe(&self) -> String { "centre".into() }
/// #     fn block(&self, _: SampleId, _: u32) -> [f32; 4] { [0.5; 4] }
/// # }
/// use dapple_core::samplers::Uniform;
/// use dapple_core::{Draws, Estimate, Frame, Integrator, Limits, Needs, Render, Worker};
/// use dapple_core::render::{Control, Status};
///
/// struct Ramp;
/// impl Integrator for Ramp {
///     fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
///         Estimate::new([draws.pixel()[0] as f32; 3])
///     }
/// }
///
/// let frame = Frame::new(16, 9)?;
/// let mut calls = 0;
/// let mut progress = |_: &Status<'_>| {
///     calls += 1;
///     Control::Continue
/// };
/// let film = Render::new(frame, &Limits::samples(8 * 16 * 9))
///     .needs(Needs::none().with_variance())
///     .monitor(&mut progress)
///     .run(&mut Ramp, &mut Uniform::new(Centre))?;
/// assert_eq!(film.record().samples, 8 * 16 * 9);
/// assert_eq!(film.moments(3).variance(), Some([0.0; 3]));
/// assert!(calls > 0);
/// # Ok::<(), dapple_core::Error>(())
/// ```
#[must_use = "nothing is rendered before `run` or `resume`"]
pub struct Render<'a> {
    frame: Frame,
    limits: &'a Limits,
    needs: Needs,
    monitor: Option<&'a mut dyn Monitor>,
    filter: Option<&'a dyn Filter>,
    recorders: Vec<Arc<dyn Recorder>>,
}

impl<'a> Render<'a> {
    /// The bytes per pixel that [`Render::error_of`] keeps: the last filtered image and the halves from which it was made.
    pub const ERROR_OF_BYTES: usize = 12 + 4 + 2 * (4 + 12);

    /// A render of `frame` within `limits`, without a monitor.
    pub fn new(frame: Frame, limits: &'a Limits) -> Self {
        Self { frame, limits, needs: Needs::none(), monitor: None, filter: None, recorders: Vec::new() }
    }

    /// Adds statistics that the film must record besides counts and means.
    pub fn needs(mut self, needs: Needs) -> Self {
        self.needs = self.needs.and(needs);
        self
    }

    /// Sets the monitor, which is called about every 0.2 seconds during tracing.
    pub fn monitor(mut self, monitor: &'a mut dyn Monitor) -> Self {
        self.monitor = Some(monitor);
        self
    }

    /// Adds recorders of statistics, such as those of a filter ([`Filter::recorders`]).
    pub fn recorders(mut self, recorders: Vec<Arc<dyn Recorder>>) -> Self {
        self.recorders.extend(recorders);
        self
    }

    /// Applies an error limit to the image of `filter`. A time limit includes an estimate of the filter's time, made after the
    /// first round.
    ///
    /// Under an error limit, the film records the statistics that the filter reads, and each prediction filters the film.
    /// Samples traced after a prediction measure the error of its image, and correct the filter's own estimate,
    /// [`Filtered::error`](crate::Filtered::error).
    /// [`Record::filtered_relmse`](crate::film::Record::filtered_relmse) is the last prediction. If the filter has no error
    /// estimate, the limit applies to the unfiltered image.
    ///
    /// # Precision
    ///
    /// `docs/results/predicted-error.md` compares predicted with true errors.
    pub fn error_of(mut self, filter: &'a dyn Filter) -> Self {
        self.filter = Some(filter);
        self
    }

    /// Renders until the limits are met, and returns the film. Each round is planned by `sampler` and traced with
    /// `integrator`, which learns from training passes.
    ///
    /// # Errors
    ///
    /// For limits that are invalid or that the sampler cannot meet, an invalid plan, and an exhausted point set. Also
    /// for an invalid sample under [`InvalidSample::Fail`](crate::InvalidSample), and a panic of the integrator;
    /// [`Error::Panicked`] carries the samples finished before.
    pub fn run(self, integrator: &mut dyn Integrator, sampler: &mut dyn Sampler) -> Result<Film, Error> {
        self.drive(None, integrator, sampler)
    }

    /// Resumes a render from a [`Snapshot`]. The film is bit-identical to that of an uninterrupted render, on any number of
    /// threads. This requires the same frame, and a sampler and an integrator made with the same options.
    ///
    /// The budget may differ: a larger one continues the render, and a time limit includes the seconds before the
    /// snapshot. All statistics in [`Render::needs`] must have been recorded from the start. The caller must pass the
    /// same integrator (scene, depth, …); this is not checked.
    ///
    /// # Errors
    ///
    /// The errors of [`Render::run`]. [`Error::OtherRender`] if sampler, points, frame, bounds of counts or needs
    /// differ, or if more samples are already planned than the budget allows. [`Error::BadSnapshot`] for inconsistent
    /// bytes.
    pub fn resume(
        self,
        snapshot: Snapshot,
        integrator: &mut dyn Integrator,
        sampler: &mut dyn Sampler,
    ) -> Result<Film, Error> {
        self.drive(Some(snapshot.of_window()?), integrator, sampler)
    }

    fn drive(
        self,
        snapshot: Option<Snapshot>,
        integrator: &mut dyn Integrator,
        sampler: &mut dyn Sampler,
    ) -> Result<Film, Error> {
        let mut unwatched = NoMonitor;
        let needs = self.needs.and(integrator.needs());
        let filter = self.filter.map(|filter| Box::new(filter) as Box<dyn Filter>);
        let methods = Methods { needs, filter, recorders: self.recorders, ..Methods::from(sampler) };
        let monitor: &mut dyn Monitor = self.monitor.unwrap_or(&mut unwatched);
        let session = Session::of_render(self.frame, self.limits, methods, snapshot)?;
        let mut session = session.with_clock(Clock::of_machine());
        session.teach(integrator);
        while session.open()? {
            let stopped = round::trace(integrator, &mut session, monitor)?;
            if session.close(stopped)? {
                return Ok(session.into_film());
            }
        }
        session.show_end_to(monitor);
        Ok(session.into_film())
    }
}
