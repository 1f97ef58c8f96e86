//! Renders in stages: processes that exchange files, and need not run at the same time.

use super::round::{self, Stopped, failed};
use super::team::{Team, deal};
use super::{Monitor, NoMonitor, Render};
use crate::bands::{BandCost, bands};
use crate::exchange::Exchange;
use crate::exchange::message::{Message, Standing};
use crate::snapshot::bytes::{Reader, Writer};
use crate::snapshot::{Broken, check_head};
use crate::{Budget, Error, Integrator, Sampler, Shard, Snapshot};

const MAGIC: &[u8; 8] = b"dapple-q";
const VERSION: u32 = 2;

/// The state of a render between two stages, with the plan of the next one.
///
/// A stage is a training pass, or the rest of a round. Any number of processes trace the parts of a stage
/// ([`Render::stage_part`]), from which one makes the next stage ([`Render::next_stage`]), until it
/// [is done](Stage::is_done). [`Render::resume`] with [`Stage::snapshot`] then returns the film, with the bits of a render
/// in one process.
///
/// ```
/// # use dapple_core::{PointSet, SampleId};
/// # struct Centre;
/// # impl PointSet for Centre {
/// #     fn describe(&self) -> String { "centre".into() }
/// #     fn block(&self, _: SampleId, _: u32) -> [f32; 4] { [0.5; 4] }
/// #     fn capacity(&self) -> u64 { u64::MAX }
/// # }
/// # use dapple_core::{Draws, Estimate, Integrator, Worker};
/// # struct Ramp;
/// # impl Integrator for Ramp {
/// #     fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
/// #         Estimate::new([draws.pixel()[0] as f32; 3])
/// #     }
/// # }
/// use dapple_core::samplers::Uniform;
/// use dapple_core::{Frame, Limits, Render, Shard};
///
/// let (frame, limits) = (Frame::new(8, 40)?, Limits::spp(4.0));
/// let render = || Render::new(frame, &limits);
/// let mut stage = render().first_stage(&mut Ramp, &mut Uniform::new(Centre))?;
/// while !stage.is_done() {
///     // On each machine, one of three parts; the bytes travel.
///     let machine = |index| -> Result<Vec<u8>, dapple_core::Error> {
///         let part = render().stage_part(&stage, Shard::new(index, 3)?, &mut Ramp, &mut Uniform::new(Centre))?;
///         Ok(part.expect("no monitor stops it"))
///     };
///     let parts = [machine(0)?, machine(1)?, machine(2)?];
///     stage = render().next_stage(&stage, &parts, &mut Ramp, &mut Uniform::new(Centre))?;
/// }
/// let film = render().resume(stage.snapshot()?, &mut Ramp, &mut Uniform::new(Centre))?;
/// assert_eq!(film.image(), render().run(&mut Ramp, &mut Uniform::new(Centre))?.image());
/// # Ok::<(), dapple_core::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Stage {
    number: u32,
    done: bool,
    /// The seconds of tracing the open round in earlier stages.
    traced: f64,
    costs: Vec<BandCost>,
    /// The state without the planes of pixels.
    state: Vec<u8>,
    /// The planes of each band of 16 rows; some of them in a process that traces a part.
    bands: Vec<(usize, Vec<u8>)>,
}

impl Stage {
    /// The number of stages before this one.
    pub fn number(&self) -> u32 {
        self.number
    }

    /// Returns true if no sample is left to trace.
    pub fn is_done(&self) -> bool {
        self.done
    }

    /// The state of the render.
    ///
    /// # Errors
    ///
    /// The errors of [`Snapshot::from_bytes`], and [`Error::BadSnapshot`] for a stage that has only some bands.
    pub fn snapshot(&self) -> Result<Snapshot, Error> {
        let snapshot = self.some_bands()?;
        let all = bands(snapshot.film().frame().size()[1] as usize);
        if self.bands.len() == all { Ok(snapshot) } else { Err(Broken("bands of the film are missing").into()) }
    }

    /// The state of the render in the bands that this stage has.
    fn some_bands(&self) -> Result<Snapshot, Error> {
        Ok(Snapshot::read_in_bands(&self.state, &self.bands)?)
    }

    /// The numbers of the bands of 16 rows that a part traces; all bands of a stage that is done.
    ///
    /// # Errors
    ///
    /// [`Error::BadSnapshot`] for an inconsistent stage.
    pub fn bands_of(&self, shard: Shard) -> Result<Vec<usize>, Error> {
        let snapshot = Snapshot::read_in_bands(&self.state, &[])?;
        let [width, height] = snapshot.film().frame().size().map(|n| n as usize);
        let Some(open) = &snapshot.open else { return Ok((0..bands(height)).collect()) };
        let unknown = vec![BandCost::default(); bands(height)];
        let costs = if self.costs.len() == unknown.len() { &self.costs } else { &unknown };
        Ok(deal(open, costs, width, &vec![1; shard.of() as usize]).of(shard.index()).collect())
    }

    /// The bands that this stage has: their numbers, and the planes of their pixels as bytes.
    pub fn bands(&self) -> &[(usize, Vec<u8>)] {
        &self.bands
    }

    /// This stage with these bands instead of its own, for one that was read by [`Stage::from_head`].
    ///
    /// # Errors
    ///
    /// [`Error::BadSnapshot`] for bands that are truncated, inconsistent or those of another stage.
    pub fn with_bands(self, bands: Vec<(usize, Vec<u8>)>) -> Result<Self, Error> {
        let stage = Self { bands, ..self };
        match stage.some_bands()?.open.is_some() == stage.done {
            true => Err(Broken("the plan of a stage is missing").into()),
            false => Ok(stage),
        }
    }

    /// The stage as bytes for [`Stage::from_bytes`], about as many as its film takes in memory.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut to = Writer::with_capacity(self.bands.iter().map(|(_, bytes)| bytes.len() + 16).sum());
        to.list(&self.head());
        to.number(self.bands.len() as u64);
        for (band, bytes) in &self.bands {
            to.number(*band as u64);
            to.list(bytes);
        }
        to.finish()
    }

    /// The stage without its bands as bytes for [`Stage::from_head`]: costs, sums of training passes, and the counts of the
    /// plan, four or eight bytes per pixel.
    pub fn head(&self) -> Vec<u8> {
        let mut to = Writer::with_capacity(self.state.len() + 16 * self.costs.len() + 64);
        to.raw(MAGIC);
        to.number(VERSION);
        to.number(self.number);
        to.flag(self.done);
        to.number(self.traced);
        to.list(&self.costs.iter().map(|cost| [cost.nanoseconds, cost.samples]).collect::<Vec<_>>());
        to.list(&self.state);
        to.finish()
    }

    /// Reads the bytes of [`Stage::to_bytes`].
    ///
    /// # Errors
    ///
    /// [`Error::BadSnapshot`] for bytes of another kind or version, truncated or inconsistent.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, Error> {
        let mut from = Reader::new(bytes);
        let stage = Self::from_head(&from.list::<u8>()?)?;
        let count = from.count(16)?;
        let mut bands = Vec::with_capacity(count);
        for place in 0..count {
            if from.number::<u64>()? != place as u64 {
                return Err(Broken("bands of the film are missing").into());
            }
            bands.push((place, from.list()?));
        }
        if !from.is_empty() {
            return Err(Broken("there are bytes after the end").into());
        }
        let stage = stage.with_bands(bands)?;
        stage.snapshot()?;
        Ok(stage)
    }

    /// Reads the bytes of [`Stage::head`]. The stage has no bands yet ([`Stage::with_bands`]).
    ///
    /// # Errors
    ///
    /// [`Error::BadSnapshot`] for bytes of another kind or version, truncated or inconsistent.
    pub fn from_head(bytes: &[u8]) -> Result<Self, Error> {
        let mut from = Reader::new(bytes);
        check_head(&mut from, MAGIC, VERSION)?;
        let (number, done, traced) = (from.number()?, from.flag()?, from.number::<f64>()?);
        let cost = |[nanoseconds, samples]: [u64; 2]| BandCost { nanoseconds, samples };
        let costs = from.list::<[u64; 2]>()?.into_iter().map(cost).collect();
        let stage = Self { number, done, traced, costs, state: from.list()?, bands: Vec::new() };
        if !from.is_empty() || !traced.is_finite() {
            return Err(Broken("there are bytes after the end").into());
        }
        Ok(stage)
    }
}

impl Render<'_> {
    /// Plans the first stage of a render whose parts are traced by [`Render::stage_part`].
    ///
    /// # Errors
    ///
    /// [`Error::NoShards`] for a limit of time, and the errors of [`Render::run`] that concern plans.
    pub fn first_stage(self, integrator: &mut dyn Integrator, sampler: &mut dyn Sampler) -> Result<Stage, Error> {
        self.advance(None, &[], integrator, sampler)
    }

    /// Traces one process' part of a stage: bands of 16 rows, dealt by the cost that earlier stages measured. Returns the
    /// bytes for [`Render::next_stage`]; `None` if the monitor stopped it.
    ///
    /// Sampler and integrator must be new ones, made with the same options as those of the other stages.
    ///
    /// # Errors
    ///
    /// [`Error::NoShards`] for a stage that is done. The errors of [`Render::resume`].
    pub fn stage_part(
        mut self,
        stage: &Stage,
        shard: Shard,
        integrator: &mut dyn Integrator,
        sampler: &mut dyn Sampler,
    ) -> Result<Option<Vec<u8>>, Error> {
        if stage.done {
            let why = "all samples are traced; make the image of it";
            return Err(Error::NoShards { who: "this stage".into(), why });
        }
        let mut unwatched = NoMonitor;
        let monitor: &mut dyn Monitor = match self.monitor.take() {
            Some(monitor) => monitor,
            None => &mut unwatched,
        };
        let wanted = stage.bands_of(shard)?;
        if wanted.iter().any(|band| stage.bands.iter().all(|(given, _)| given != band)) {
            return Err(Broken("the bands of this part are missing").into());
        }
        let mut session = self.session(sampler, Some(stage.some_bands()?))?;
        session.state.passes.iter().for_each(|pass| integrator.learn(pass));
        let rows = session.state.film.frame.size()[1] as usize;
        let mut recorder = Recorder { shard, message: None };
        let mut team =
            Team::new(&mut recorder, rows).at_stage(stage.number, (&stage.costs, stage.traced), shard.index());
        session.open(Some(&mut team))?;
        let traced = round::trace(integrator, &mut session, monitor, Some(&mut team));
        let outcome = match (team.standing().clone(), traced) {
            (Standing::Stopped, _) => return Ok(None),
            (Standing::Going, Ok(stopped)) => session.close(stopped, monitor, Some(&mut team)).map(|_| ()),
            (Standing::Going, Err(error)) => Err(error),
            (trouble, _) => return Err(failed(trouble, &mut session.state.film, session.sampler.points())),
        };
        match (recorder.message, outcome) {
            (Some(message), _) => Ok(Some(message)),
            (None, Err(error)) => Err(error),
            (None, Ok(())) => Err(Error::Gone { what: "the stage has no end".into() }),
        }
    }

    /// Makes the next stage of all parts of one, in any order.
    ///
    /// # Errors
    ///
    /// [`Error::BadShards`] with a line for each part that is missing, given twice, or of another stage or division. The
    /// errors of [`Render::resume`].
    pub fn next_stage(
        self,
        stage: &Stage,
        parts: &[Vec<u8>],
        integrator: &mut dyn Integrator,
        sampler: &mut dyn Sampler,
    ) -> Result<Stage, Error> {
        self.advance(Some(stage), parts, integrator, sampler)
    }

    fn advance(
        self,
        stage: Option<&Stage>,
        parts: &[Vec<u8>],
        integrator: &mut dyn Integrator,
        sampler: &mut dyn Sampler,
    ) -> Result<Stage, Error> {
        if let Budget::Seconds(_) = self.limits.budget {
            let why = "its stages have no common clock; give a number of samples or an error";
            return Err(Error::NoShards { who: "a limit of time".into(), why });
        }
        let parts = stage.map_or(Ok(Vec::new()), |stage| in_order(parts, stage.number))?;
        let snapshot = stage.map(Stage::snapshot).transpose()?;
        let mut session = self.session(sampler, snapshot)?;
        session.state.passes.iter().for_each(|pass| integrator.learn(pass));
        let rows = session.state.film.frame.size()[1] as usize;
        let of = (parts.len() as u32).max(1);
        let mut replay = Replay { share: Shard::new(0, of)?, parts };
        let (number, costs, traced) = stage.map_or((0, &[][..], 0.0), |s| (s.number, &s.costs, s.traced));
        // Its number is that of no part: it traces nothing.
        let mut team = Team::new(&mut replay, rows).at_stage(number, (costs, traced), of);
        let mut goes_on = session.open(Some(&mut team))?;
        if stage.is_some() && goes_on {
            let stopped = round::trace(integrator, &mut session, &mut NoMonitor, Some(&mut team))?;
            if stopped != Stopped::Within {
                session.close(stopped, &mut NoMonitor, Some(&mut team))?;
                goes_on = session.open(Some(&mut team))?;
            }
        }
        // The lists that a team sets aside while it traces.
        team.end(&mut session.state.film);
        let (costs, traced) = team.into_costs();
        let number = if stage.is_some() { number + 1 } else { 0 };
        let (state, bands) = session.snapshot_in_bands();
        let bands = bands.into_iter().enumerate().collect();
        Ok(Stage { number, done: !goes_on, traced, costs, state, bands })
    }
}

/// The parts of stage `number`, by their number.
fn in_order(parts: &[Vec<u8>], number: u32) -> Result<Vec<Vec<u8>>, Error> {
    let mut troubles = Vec::new();
    let mut found: Vec<(u32, &Vec<u8>)> = Vec::new();
    let mut of = None;
    for (place, bytes) in parts.iter().enumerate() {
        let message = match Message::read(bytes) {
            Ok((message, _)) => message,
            Err(Broken(what)) => {
                troubles.push(format!("part {} of the list cannot be read: {what}", place + 1));
                continue;
            }
        };
        let [index, all] = message.share;
        let name = format!("part {}/{all}", index.saturating_add(1));
        let there = message.step.number;
        if there != number {
            let age = if there < number { "an older" } else { "a newer" };
            troubles.push(format!(
                "{name} is of {age} plan, stage {there}, and this one is at stage {number}; trace it again"
            ));
        } else if of.is_some_and(|of| of != all) {
            troubles.push(format!("{name} is of another number of parts than the first one"));
        } else if found.iter().any(|(other, _)| *other == index) {
            troubles.push(format!("{name} is given twice"));
        } else {
            of = Some(all);
            found.push((index, bytes));
        }
    }
    let missing = |index: &u32| found.iter().all(|(other, _)| other != index);
    let all = of.unwrap_or(0);
    let lost: Vec<String> = (0..all).filter(missing).take(10).map(|index| format!("{}/{all}", index + 1)).collect();
    if !lost.is_empty() || troubles.is_empty() && all == 0 {
        let which = if all == 0 { "all".into() } else { lost.join(", ") };
        troubles.push(format!("missing parts: {which}{}", if lost.len() == 10 { ", and maybe more" } else { "" }));
    }
    if !troubles.is_empty() {
        return Err(Error::BadShards { what: troubles.join("\n") });
    }
    found.sort_by_key(|(index, _)| *index);
    Ok(found.into_iter().map(|(_, bytes)| bytes.clone()).collect())
}

/// Keeps the message of the stage's end, and ends the render there.
struct Recorder {
    shard: Shard,
    message: Option<Vec<u8>>,
}

impl Exchange for Recorder {
    fn share(&self) -> Shard {
        self.shard
    }

    fn all_gather(&mut self, mine: Vec<u8>) -> Result<Vec<Vec<u8>>, Error> {
        self.message = Some(mine);
        Err(Error::Gone { what: "its stage is over".into() })
    }
}

/// Gives the messages of a stage's end.
struct Replay {
    share: Shard,
    parts: Vec<Vec<u8>>,
}

impl Exchange for Replay {
    fn share(&self) -> Shard {
        self.share
    }

    fn all_gather(&mut self, _: Vec<u8>) -> Result<Vec<Vec<u8>>, Error> {
        Ok(std::mem::take(&mut self.parts))
    }
}
