//! Snapshots: the state of a render between two calls of its monitor, as bytes.

use crate::film::{Beside, Half, LampEdges, REJECTED_LISTED, Splats, Spread};
use crate::film::{Record, Rejected};
use crate::plan::{Combine, Plan, Retention};
use crate::render::filtered_error::FilteredError;
use crate::render::state::{OpenRound, Stage, State};
use crate::{Error, Film, Frame, Limits, Needs, Sampler, container, integrator::TrainingData, recorder::Recorders};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize, Serializer};

/// Returns the error for bytes that are not a snapshot; `what` is the fault as a clause.
fn broken<T>(what: &'static str) -> Result<T, Error> {
    Err(Error::BadSnapshot { what })
}

/// Serialises a value to bytes, about `size` of them.
fn encoded(value: &impl Serialize, size: usize) -> Vec<u8> {
    postcard::to_extend(value, Vec::with_capacity(size)).expect("memory takes any state")
}

/// Deserialises a value that takes all of the bytes. Memory is allocated only as values are read.
fn decoded<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, Error> {
    match postcard::take_from_bytes(bytes) {
        Ok((value, [])) => Ok(value),
        Ok(_) => broken("there are extra bytes after the end"),
        Err(postcard::Error::DeserializeUnexpectedEnd) => broken("the data are truncated"),
        Err(_) => broken("the contents are invalid"),
    }
}

/// Borrowed state of a render, complete enough to resume it; the content of a snapshot.
#[derive(Clone, Copy)]
pub(crate) struct View<'a> {
    pub(crate) state: &'a State,
    pub(crate) sampler: Planner<'a>,
    /// The least and the largest number of samples per pixel.
    pub(crate) bounds: [u32; 2],
    pub(crate) total: u64,
    pub(crate) seconds: f64,
}

/// A sampler, or its description and state from a snapshot.
#[derive(Clone, Copy)]
pub(crate) enum Planner<'a> {
    Sampler(&'a dyn Sampler),
    Saved(&'a SavedSampler),
}

impl Serialize for Planner<'_> {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Saved(saved) => saved.serialize(to),
            Self::Sampler(sampler) => SavedSampler::of(*sampler).serialize(to),
        }
    }
}

/// The description and state of a sampler during one round.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct SavedSampler {
    name: String,
    points: String,
    state: Vec<u8>,
}

impl SavedSampler {
    pub(crate) fn of(sampler: &dyn Sampler) -> Self {
        Self { name: sampler.describe(), points: sampler.points().describe(), state: sampler.save() }
    }
}

impl View<'_> {
    pub(crate) fn write(&self) -> Vec<u8> {
        let State { film, round, open, passes, filtered_error, prepared: _, stage, repeats: _ } = self.state;
        let counts = open.as_ref().map_or(0, |open| open.plan.counts.len());
        let course = (self.sampler, self.bounds, self.total, self.seconds, round, open, passes, filtered_error, stage);
        let (course, film) = (encoded(&course, 2 * counts + 4096), film_bytes(film));
        let mut bytes = container::begin(course.len() + film.len());
        container::append(&mut bytes, "render", &course);
        container::append(&mut bytes, "film", &film);
        bytes
    }
}

/// The state of a render between two calls of its monitor, with everything needed to resume it.
///
/// [`Status::snapshot`](crate::render::Status::snapshot) returns the state as bytes, which a
/// [`Monitor`](crate::render::Monitor) can store. [`Snapshot::from_bytes`] checks version, checksums and consistency.
/// [`Render::resume`](crate::Render::resume) continues the render.
///
/// ```
/// # use dapple_core::{PointSet, SampleId};
/// # struct Centre;
/// # impl PointSet for Centre {
/// #     fn describe(&self) -> String { "centre".into() }
/// #     fn block(&self, _: SampleId, _: u32) -> [f32; 4] { [0.5; 4] }
/// # }
/// # use dapple_core::{Draws, Estimate, Integrator, Worker};
/// # struct Ramp;
/// # impl Integrator for Ramp {
/// #     fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
/// #         Estimate::new([draws.pixel()[0] as f32; 3])
/// #     }
/// # }
/// use dapple_core::samplers::Uniform;
/// use dapple_core::{Frame, Limits, Render, Snapshot};
/// use dapple_core::render::{Control, Status};
/// use dapple_core::limits::Schedule;
///
/// let frame = Frame::new(8, 6)?;
/// let limits = Limits::samples(4 * 8 * 6).with_schedule(Schedule::default().with_progress_spp(1));
///
/// // Stop after the first sample of each pixel.
/// let mut saved = Vec::new();
/// let mut stop = |status: &Status<'_>| {
///     saved = status.snapshot();
///     Control::Stop
/// };
/// let part = Render::new(frame, &limits).monitor(&mut stop).run(&mut Ramp, &mut Uniform::new(Centre))?;
/// assert_eq!(part.record().samples, 8 * 6);
///
/// let snapshot = Snapshot::from_bytes(&saved)?;
/// let whole = Render::new(frame, &limits).resume(snapshot, &mut Ramp, &mut Uniform::new(Centre))?;
/// assert_eq!(whole.record().samples, 4 * 8 * 6);
/// # Ok::<(), dapple_core::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Snapshot {
    pub(crate) state: State,
    sampler: SavedSampler,
    bounds: [u32; 2],
    pub(crate) total: u64,
    pub(crate) seconds: f64,
}

/// The parts of a snapshot besides the film: sampler, bounds, total, seconds, and the fields of [`State`].
type Course =
    (SavedSampler, [u32; 2], u64, f64, u32, Option<OpenRound>, Vec<TrainingData>, Option<FilteredError>, Option<Stage>);

impl Snapshot {
    /// Reads the bytes of [`Status::snapshot`](crate::render::Status::snapshot). Memory use is in proportion to `bytes`,
    /// even if they are invalid.
    ///
    /// # Errors
    ///
    /// [`Error::BadSnapshot`] for bytes that are of another kind or version, truncated or inconsistent.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, Error> {
        let found = container::sections(bytes).or_else(|fault| broken(fault.text()))?;
        let section = |name: &str| found.iter().find(|(known, _)| *known == name).map(|(_, section)| *section);
        let (Some(course), Some(film)) = (section("render"), section("film")) else {
            return broken("the state of a render is missing");
        };
        let course: Course = decoded(course)?;
        let (sampler, bounds, total, seconds, round, open, passes, filtered_error, stage) = course;
        let state = State {
            film: film_of(film)?,
            round,
            open,
            passes,
            filtered_error,
            prepared: None,
            stage,
            repeats: Default::default(),
        };
        let mut read = Self { state, sampler, bounds, total, seconds };
        read.check()?;
        if let Some(open) = &mut read.state.open {
            open.join();
        }
        Ok(read)
    }

    /// The film (per-pixel statistics) at the time of the snapshot, with valid statistics in every pixel.
    pub fn film(&self) -> &Film {
        &self.state.film
    }

    /// The snapshot, or an error if it has only some rows of a stage.
    pub(crate) fn of_window(self) -> Result<Self, Error> {
        match self.state.stage {
            None => Ok(self),
            Some(_) => {
                Err(Error::OtherRender { what: "it has only some rows of a stage; trace and join these rows".into() })
            }
        }
    }

    /// Restores the sampler's state. Checks that the snapshot belongs to a render with this sampler, frame and limits,
    /// and that it has all statistics in `needs`.
    pub(crate) fn restore_sampler(
        &self,
        sampler: &mut dyn Sampler,
        needs: &Needs,
        frame: &Frame,
        limits: &Limits,
    ) -> Result<(), Error> {
        if self.sampler.name == sampler.describe() {
            // First, since the point set may depend on the state.
            sampler.restore(&self.sampler.state)?;
        }
        let mut differ = Vec::new();
        let mut compare = |what: &str, was: &str, is: &str| {
            if was != is {
                differ.push(format!("the {what} was {was}, not {is}"));
            }
        };
        compare("sampler", &self.sampler.name, &sampler.describe());
        compare("point set", &self.sampler.points, &sampler.points().describe());
        let window = |f: &Frame| {
            let ([x, y], [w, h], [full_w, full_h]) = (f.origin(), f.size(), f.resolution());
            format!("{w}x{h} pixels at {x},{y} of {full_w}x{full_h}")
        };
        let State { film, stage, .. } = &self.state;
        let own = stage.as_ref().map_or(film.frame, |stage| stage.frame);
        compare("window", &window(&own), &window(frame));
        let bounds = |[min, max]: [u32; 2]| format!("{min} to {max}");
        compare("range of samples per pixel", &bounds(self.bounds), &bounds([limits.min_spp, limits.max_spp]));
        let halves = |halves: bool| if halves { "two halves" } else { "one sequence" };
        compare("kind of samples", halves(film.needs.halves), halves(needs.halves));
        let missing = Needs { halves: false, ..*needs };
        if let Err(Error::NotRecorded { what, .. }) = film.require("", &missing) {
            differ.push(format!("it lacks {what}, which this render needs"));
        }
        let what = differ.join(", ") + "; use the settings of the saved render, or start a new render";
        if differ.is_empty() { Ok(()) } else { Err(Error::OtherRender { what }) }
    }

    fn check(&self) -> Result<(), Error> {
        let State { film, open, passes, filtered_error, stage, .. } = &self.state;
        let is_ascending = |pass: &TrainingData| pass.entries().is_sorted_by(|a, b| a.key < b.key);
        require(is_time(self.seconds), "a time is not a number of seconds")?;
        require(passes.iter().all(is_ascending), "training data is out of order")?;
        let fits = filtered_error.as_ref().is_none_or(|image| image.fits(film));
        require(fits, "a filtered image has another size")?;
        require(stage.as_ref().is_none_or(|stage| stage.has(&film.frame)), "a stage belongs to another window")?;
        open.as_ref().map_or(Ok(()), |open| open.check(film))
    }
}

impl OpenRound {
    /// Checks that the round is consistent with its film.
    fn check(&self, film: &Film) -> Result<(), Error> {
        let ([width, height], pixels) = (film.frame.size(), film.frame.pixels());
        let Self { plan, later, cursor, .. } = self;
        let all = || plan.halves().chain(later.iter().flat_map(Plan::halves));
        require(all().all(|counts| counts.len() == pixels), "a plan has the wrong number of pixels")?;
        require(is_sound(plan.combine), "the rule to combine halves is unknown")?;
        let fits = plan.second_half.is_none() || film.kept.len() == 2;
        require(fits, "a plan is for two halves, but the film has one")?;
        let fits = plan.retention == Retention::Keep || !film.discarded.is_empty();
        require(fits, "a round discards samples, but the film has no planes for them")?;
        let traced = plan.total() - self.rest(width as usize).total();
        let all = self.before.checked_add(self.submitted).and_then(|n| n.checked_add(traced));
        let is_within = cursor.start <= cursor.end && cursor.row < height && all == Some(film.record.samples);
        let is_within = is_within && is_time(self.plan_seconds) && is_time(self.traced_seconds);
        require(is_within, "the position within a round is out of range")
    }
}

fn require(holds: bool, otherwise: &'static str) -> Result<(), Error> {
    if holds { Ok(()) } else { broken(otherwise) }
}

fn is_time(seconds: f64) -> bool {
    seconds.is_finite() && seconds >= 0.0
}

fn is_sound(combine: Combine) -> bool {
    !matches!(combine, Combine::Fixed(weight) if !weight.is_finite())
}

/// A film as bytes: its settings and record, then its planes.
fn film_bytes(film: &Film) -> Vec<u8> {
    let Film { frame, needs, recorders, combine, record, rejected, .. } = film;
    let Film { kept, discarded, spread, discarded_spread, withdrawn, beside, lamp_edges, splats, unreported, .. } =
        film;
    let each =
        Film::bytes_per_pixel(needs) + if discarded.is_empty() { 0 } else { Film::halves_bytes_per_pixel(needs) };
    let head = (frame, needs, recorders, combine, record, rejected);
    let planes = (kept, discarded, [spread, discarded_spread], withdrawn, beside, lamp_edges, splats, unreported);
    encoded(&(head, planes), frame.pixels() * each + 4096)
}

/// The header before the planes of a film.
type Head = (Frame, Needs, Recorders, Combine, Record, Vec<Rejected>);
/// The planes of a film.
type Planes = (Vec<Half>, Vec<Half>, [Spread; 2], Vec<Vec<u32>>, Beside, LampEdges, Splats, u64);

fn film_of(bytes: &[u8]) -> Result<Film, Error> {
    let (head, planes): (Head, Planes) = decoded(bytes)?;
    let (frame, needs, recorders, combine, record, rejected) = head;
    let (kept, discarded, [spread, discarded_spread], withdrawn, beside, lamp_edges, splats, unreported) = planes;
    let film = Film { recorders, combine, record, rejected, ..Film::without_planes(frame, needs) };
    let film = Film { kept, discarded, spread, discarded_spread, ..film };
    let film = Film { withdrawn, beside, lamp_edges, splats, unreported, ..film };
    check_film(&film)?;
    Ok(film)
}

fn check_film(film: &Film) -> Result<(), Error> {
    let Film { kept, discarded, withdrawn, beside, record, .. } = film;
    let (pixels, layout, halves) = (film.frame.pixels(), film.layout(), if film.needs.halves { 2 } else { 1 });
    let are_sound = |all: &[Half]| all.len() == halves && all.iter().all(|planes| planes.is_sound(pixels, &layout));
    let is_sound_film = are_sound(kept)
        && (discarded.is_empty() || are_sound(discarded))
        && film.spread.is_sound(pixels, &layout)
        && (if discarded.is_empty() {
            film.discarded_spread == Spread::default()
        } else {
            film.discarded_spread.is_sound(pixels, &layout)
        })
        && beside.is_sound(pixels, &layout)
        && film.lamp_edges.is_sound(&film.frame)
        && film.splats.is_sound(if film.needs.splats { halves } else { 0 });
    require(is_sound_film, "a statistic is NaN or infinite, or has the wrong number of pixels")?;
    require(is_sound(film.combine), "the rule to combine halves is unknown")?;
    let mut seconds = record.rounds.iter().flat_map(|round| [round.plan_seconds, round.trace_seconds]);
    require(is_time(record.prepare_seconds) && seconds.all(is_time), "a time is not a number of seconds")?;
    require(film.rejected.len() <= REJECTED_LISTED, "the list of rejected samples is too long")?;
    let mut counts = kept.iter().chain(discarded).flat_map(|planes| &planes.counts);
    let samples = counts
        .try_fold(0_u64, |sum, n| sum.checked_add(u64::from(*n)))
        .map_or_else(|| broken("counts overflow"), Ok)?;
    require(film.unreported <= samples, "more samples report no hits than were traced")?;
    let fits = withdrawn.is_empty() || withdrawn.len() == discarded.len();
    require(fits, "samples are withdrawn, but the film has no planes for them")?;
    let mut of_each = withdrawn.iter().zip(discarded);
    let fewer = of_each.all(|(n, planes)| n.len() == pixels && n.iter().zip(&planes.counts).all(|(n, all)| n <= all));
    require(fewer, "more samples are withdrawn than discarded")?;
    require(samples == record.samples, "counts do not add up to the samples traced")
}
