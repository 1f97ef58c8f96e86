//! The render loop: plan a round, trace it, plan the next.

mod band;
mod budget;
mod check;
mod clock;
mod feature_samples;
mod filter_time;
mod halos;
pub(crate) mod holdout;
mod meeting;
mod methods;
mod planning;
mod prepare;
mod pull;
mod round;
mod session;
mod showing;
mod slicing;
mod stage;
mod team;
mod tile;
mod training;

use budget::Meter;
use halos::runs_at_first;
pub use methods::Methods;
pub use pull::Round;
pub use session::Session;
pub use stage::Stage;
use team::Team;
pub use tile::{Samples, Tile};

use crate::snapshot::{View, source::Source};
use crate::{
    Error, Exchange, Film, Filter, Frame, Integrator, Limits, Needs, Sampler, Snapshot, TrainingData, exchange,
};

/// The state of a render between two slices of tracing (about 0.2 seconds each), passed to a [`Monitor`].
#[non_exhaustive]
#[derive(Clone, Copy)]
pub struct Status<'a> {
    /// The film so far, with valid statistics in every pixel. That of one process among several may hold its own rows only
    /// ([`Film::is_whole`]).
    pub film: &'a Film,
    /// The number of the round being traced, from 0.
    pub round: u32,
    /// The number of samples traced so far.
    pub samples: u64,
    /// The number of samples to trace in all, as far as known; a limit of time or error may change it.
    pub expected: u64,
    /// Wall seconds of planning and tracing so far, without the monitor's own time.
    pub seconds: f64,
    /// The time limit in seconds, if there is one.
    pub seconds_limit: Option<f64>,
    /// The seconds of the time limit that are reserved for the filter, once they are measured: after the first round.
    pub filter_seconds: Option<f64>,
    view: View<'a>,
}

impl Status<'_> {
    /// The state of the render as bytes for [`Snapshot::from_bytes`], about as many as the film takes in memory. A
    /// render resumed from them ends with the same bits as this one.
    ///
    /// In a render by several processes, it may lack the other processes' pixels and plans. [`Monitor::saved`] gets the state
    /// of all.
    pub fn snapshot(&self) -> Vec<u8> {
        self.view.write()
    }
}

/// A monitor's decision about the render.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Control {
    /// Continue rendering.
    Continue,
    /// Stop the render and return the film so far.
    Stop,
}

/// An observer of a render, called about five times a second: for progress, previews, checkpoints and Ctrl-C.
///
/// A closure `FnMut(&Status) -> Control` is a monitor too.
///
/// ```
/// use dapple_core::{Control, Monitor, Status};
///
/// /// Stops after a minute.
/// struct Minute;
///
/// impl Monitor for Minute {
///     fn slice(&mut self, status: &Status<'_>) -> Control {
///         if status.seconds < 60.0 { Control::Continue } else { Control::Stop }
///     }
/// }
/// ```
pub trait Monitor {
    /// Called after each slice of tracing (about 0.2 seconds). The returned value decides whether the render continues.
    fn slice(&mut self, status: &Status<'_>) -> Control;

    /// Called at the end of each round of a render by several processes ([`Render::exchange`]), with the seconds that each
    /// process took to trace it. The film may hold the rows of this process only.
    fn barrier(&mut self, status: &Status<'_>, seconds: &[f64]) {
        let _ = (status, seconds);
    }

    /// Returns `true` if the monitor takes the state of all processes after a [`Monitor::barrier`], and after [`Monitor::end`].
    /// The default is `false`. The barrier after the last round of a budget of samples is left out, since the end follows at
    /// once.
    fn saves(&self) -> bool {
        false
    }

    /// Takes the next bytes of the state of all, of `length` bytes altogether: those of [`Status::snapshot`] in one process. A
    /// render resumed from them may have any number of processes.
    ///
    /// A piece has some rows of one statistic, so that no process holds the film of all. All processes wait until the last
    /// piece is taken.
    fn saved(&mut self, bytes: &[u8], length: u64) {
        let _ = (bytes, length);
    }

    /// Returns `true` if the monitor takes everyone's rows by [`Monitor::rows`] after a [`Monitor::barrier`]. The default is
    /// `false`.
    fn reads_rows(&self) -> bool {
        false
    }

    /// Takes the next rows of the window, from the top, with counts, means and variances.
    fn rows(&mut self, rows: &Film) {
        let _ = rows;
    }

    /// Called once at the end, unless the render was stopped. A render resumed from a snapshot taken here may have
    /// larger limits.
    fn end(&mut self, status: &Status<'_>) {
        let _ = status;
    }
}

/// The monitor that does nothing: the render runs to the end.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoMonitor;

impl Monitor for NoMonitor {
    fn slice(&mut self, _: &Status<'_>) -> Control {
        Control::Continue
    }
}

impl<F: FnMut(&Status<'_>) -> Control> Monitor for F {
    fn slice(&mut self, status: &Status<'_>) -> Control {
        self(status)
    }
}

/// A render to run or resume: the frame, the limits, the statistics to record and a monitor.
///
/// The film records the statistics that the sampler and the integrator need and those of [`Render::needs`]. An error limit
/// adds halves.
/// Tracing uses the current rayon thread pool.
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
/// use dapple_core::{Control, Draws, Estimate, Frame, Integrator, Limits, Needs, Render, Status, Worker};
///
/// struct Ramp;
/// impl Integrator for Ramp {
///     fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
///         Estimate::new([draws.pixel()[0] as f32; 3])
///     }
/// }
///
/// let frame = Frame::new(16, 9)?;
/// let mut slices = 0;
/// let mut progress = |_: &Status<'_>| {
///     slices += 1;
///     Control::Continue
/// };
/// let film = Render::new(frame, &Limits::samples(8 * 16 * 9))
///     .needs(Needs::none().with_variance())
///     .monitor(&mut progress)
///     .run(&mut Ramp, &mut Uniform::new(Centre))?;
/// assert_eq!(film.record().samples, 8 * 16 * 9);
/// assert_eq!(film.moments(3).variance(), Some([0.0; 3]));
/// assert!(slices > 0);
/// # Ok::<(), dapple_core::Error>(())
/// ```
#[must_use = "nothing is rendered before `run` or `resume`"]
pub struct Render<'a> {
    frame: Frame,
    limits: &'a Limits,
    needs: Needs,
    monitor: Option<&'a mut dyn Monitor>,
    filter: Option<&'a dyn Filter>,
    exchange: Option<&'a mut dyn Exchange>,
    in_bands: bool,
    training: Vec<TrainingData>,
}

impl<'a> Render<'a> {
    /// A render of `frame` within `limits`, without a monitor.
    pub fn new(frame: Frame, limits: &'a Limits) -> Self {
        let (needs, in_bands, training) = (Needs::none(), false, Vec::new());
        Self { frame, limits, needs, monitor: None, filter: None, exchange: None, in_bands, training }
    }

    /// Adds statistics that the film must record besides counts and means.
    pub fn needs(mut self, needs: Needs) -> Self {
        self.needs = self.needs.and(needs);
        self
    }

    /// Sets the monitor that is called between slices of tracing (about 0.2 seconds each).
    pub fn monitor(mut self, monitor: &'a mut dyn Monitor) -> Self {
        self.monitor = Some(monitor);
        self
    }

    /// Renders together with the other processes of this exchange. Each must have the same frame, limits, needs, sampler
    /// and integrator. The film of each has the bits of a render in one process.
    pub fn exchange(mut self, exchange: &'a mut dyn Exchange) -> Self {
        self.exchange = Some(exchange);
        self
    }

    /// Leaves each of several processes its own rows at the end, where the sampler plans by rows
    /// ([`Sampler::halo`]), so that none holds the whole film. [`Film::gather`] returns rows of
    /// others. Films are [whole](Film::is_whole) where every process plans the whole image.
    pub fn in_bands(self) -> Self {
        Self { in_bands: true, ..self }
    }

    /// Makes the integrator learn from these training passes, in order, instead of this render's own. Passes beyond them are
    /// its own.
    ///
    /// With the passes of the whole image ([`Render::train`]), a crop has the whole image's bits where its counts are the
    /// same.
    pub fn learn_from(mut self, training: Vec<TrainingData>) -> Self {
        self.training = training;
        self
    }

    /// Makes an error limit concern the image of this filter instead of the unfiltered one. The film then records what the
    /// filter needs. A time limit includes the filter's time, which is estimated after the first round. Without either
    /// limit, nothing changes.
    ///
    /// At the end of each budget, the film is filtered. The next samples, which that image has not seen, then measure its
    /// error and correct the filter's own estimate, [`Filtered::error`](crate::Filtered::error).
    /// [`Record::filtered_relmse`](crate::Record::filtered_relmse) holds the last prediction. A filter that has no
    /// estimate leaves the limit with the unfiltered image.
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
        let render = self.needs(integrator.needs());
        let mut session = render.session(sampler, None)?;
        session.training = render.training;
        drive(&mut session, integrator, render.monitor, (render.exchange, render.in_bands))?;
        Ok(session.into_film())
    }

    /// Resumes a render from a [`Snapshot`]. The film has the bits of an uninterrupted render, on any number of
    /// threads. That requires the same frame, and a sampler and an integrator made with the same options.
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
        let render = self.needs(integrator.needs());
        let share = render.exchange.as_ref().map(|exchange| exchange.share());
        let mut session = render.session(sampler, Some(snapshot))?.with_its_rows(share)?;
        session.training = render.training;
        session.state.passes.iter().for_each(|pass| integrator.learn(pass));
        drive(&mut session, integrator, render.monitor, (render.exchange, render.in_bands))?;
        Ok(session.into_film())
    }

    /// Reads a [`Snapshot`] to resume from, in pieces of some rows, together with the processes of [`Render::exchange`].
    ///
    /// The process that has the bytes passes them with their number, the others pass `None`. Where the sampler plans by rows
    /// ([`Sampler::halo`]), each process gets its own rows, so that none holds the film of all. The number of processes may
    /// differ from that of the render that was saved. One process gets what [`Snapshot::from_bytes`] returns.
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
    /// use dapple_core::{Frame, Limits, Render, Session, Snapshot};
    ///
    /// let (frame, limits) = (Frame::new(8, 6)?, Limits::spp(4.0));
    /// let saved = Session::new(frame, limits.clone(), Uniform::new(Centre))?.snapshot();
    /// let read = Render::new(frame, &limits).read_snapshot(Some((&mut &saved[..], saved.len() as u64)), &Uniform::new(Centre))?;
    /// assert_eq!(read, Snapshot::from_bytes(&saved)?);
    /// # Ok::<(), dapple_core::Error>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`Error::BadSnapshot`] on the process that reads or gets bytes of another kind or version, truncated or inconsistent
    /// ones, and [`Error::Exchange`] with its report on the others.
    pub fn read_snapshot(
        self,
        source: Option<(&mut dyn std::io::Read, u64)>,
        sampler: &dyn Sampler,
    ) -> Result<Snapshot, Error> {
        let of = self.exchange.as_ref().map_or(1, |exchange| exchange.share().of());
        let meter = Meter::new(self.limits, &self.frame)?;
        let rows = |film: &Film| {
            let by_rows = of > 1 && session::halo(sampler, &meter, film.needs()).is_some();
            by_rows.then(|| runs_at_first(film.frame(), of))
        };
        Snapshot::read_rows(source.map(Source::new), rows, self.exchange)
    }

    /// The engine of this render: a new one, or one that continues a snapshot.
    fn session<'s>(&self, sampler: &'s mut dyn Sampler, snapshot: Option<Snapshot>) -> Result<Session<'s>, Error>
    where
        'a: 's,
    {
        let methods = Methods::from(sampler).with_needs(self.needs);
        let methods = match self.filter {
            Some(filter) => methods.with_filter(filter),
            None => methods,
        };
        let share = self.exchange.as_ref().map(|exchange| exchange.share());
        Session::of_render(self.frame, self.limits, methods, snapshot, share)
    }
}

/// Traces all rounds of a session, alone or with other processes.
fn drive(
    session: &mut Session<'_>,
    integrator: &mut dyn Integrator,
    monitor: Option<&mut dyn Monitor>,
    (exchange, in_bands): (Option<&mut dyn Exchange>, bool),
) -> Result<(), Error> {
    let mut unwatched = NoMonitor;
    let monitor: &mut dyn Monitor = match monitor {
        Some(monitor) => monitor,
        None => &mut unwatched,
    };
    let mut team = match exchange {
        Some(exchange) => {
            exchange::compare(exchange, &session.settings())?;
            let rows = session.state.film.frame.size()[1] as usize;
            Some(Team::new(exchange, rows).planning_own_rows(session.halo(), in_bands))
        }
        None => None,
    };
    while session.open(team.as_mut())? {
        let stopped = round::trace(integrator, session, monitor, team.as_mut())?;
        if session.close(stopped, monitor, team.as_mut())? {
            return Ok(());
        }
    }
    session.show_end(monitor, team.as_mut())
}
