//! Rendering on many machines: plan files and the rows that machines trace for them, parts without a plan, and cooperating processes.

use super::checkpoints::Watched;
use super::identity::{PART, PLAN, SPEC, common, compared, joined, same_render};
use super::{Checkpoints, Job, JobMonitor, Traced};
use crate::checkpoint::{Identity, ROWS, StateFile, StateKind};
use crate::files::path::{of_text, to_text};
use crate::memory::MemoryEstimate;
use crate::{JobError, PartNumber, RenderSpec};
use dapple_core::render::{Control, Monitor, Readiness, Stage, Status, TracedRows};
use dapple_core::{Clock, Error, Integrator, Methods, Render, Session, Snapshot, container, limits::Budget};
use dapple_distributed::{Processes, coordinate, dismiss, rows_of_part, serve};
use dapple_transport::make_integrator;
use std::path::{Path, PathBuf};

/// A plan file: the state of a render, with a planned stage whose rows are divided among machines.
pub struct PlanFile {
    path: PathBuf,
    /// The description of the render.
    pub spec: RenderSpec,
    file: StateFile,
}

/// Files of traced rows: the parts of a plan's stage or, without a plan, the parts of an image.
pub struct RowsFiles {
    /// The description of the render.
    pub spec: RenderSpec,
    files: Vec<(PathBuf, StateFile)>,
}

impl PlanFile {
    /// Reads a plan file.
    ///
    /// # Errors
    ///
    /// [`JobError::Checkpoint`] for a file that cannot be read, is damaged or of another kind.
    pub fn read(path: &Path) -> Result<Self, JobError> {
        let file = StateFile::read(path, StateKind::Plan)?;
        let spec = RenderSpec::from_json(file.identity.value(SPEC).unwrap_or_default())?;
        Ok(Self { path: path.to_owned(), spec, file })
    }

    fn snapshot(&self) -> Result<Snapshot, JobError> {
        let of = |source| JobError::Snapshot { path: self.path.clone(), source };
        Snapshot::from_bytes(self.file.bytes()).map_err(of)
    }
}

impl RowsFiles {
    /// Reads files of traced rows.
    ///
    /// # Errors
    ///
    /// [`JobError::Parts`] if `paths` is empty, and with a line for each file that cannot be read, is damaged, or belongs to
    /// another render than the first file.
    pub fn read(paths: &[PathBuf]) -> Result<Self, JobError> {
        let (mut files, mut troubles): (Vec<(PathBuf, StateFile)>, Vec<String>) = (Vec::new(), Vec::new());
        for path in paths {
            match StateFile::read(path, StateKind::Rows) {
                Ok(file) => {
                    if let Some((first, known)) = files.first() {
                        let (path, first) = (path.display(), first.display());
                        let differ = common(&known.identity).differences(&common(&file.identity));
                        let of = |d| format!("{path}: the part belongs to another render than {first}: {d}");
                        troubles.extend(differ.into_iter().map(of));
                    }
                    files.push((path.clone(), file));
                }
                Err(e) => troubles.push(e.to_string()),
            }
        }
        let first = files.first().filter(|_| troubles.is_empty());
        let Some((_, first)) = first else { return Err(JobError::Parts(troubles)) };
        let spec = RenderSpec::from_json(first.identity.value(SPEC).unwrap_or_default())?;
        // Parts have another default light selection than whole images.
        let spec = RenderSpec { light_selection: Some(spec.selection()), part: None, ..spec };
        Ok(Self { spec, files })
    }

    /// The path that the plan file had when the rows were traced; `None` without a plan.
    pub fn plan(&self) -> Option<PathBuf> {
        let plan = self.files.first().and_then(|(_, file)| file.identity.value(PLAN));
        plan.map(of_text)
    }
}

impl Job {
    /// The estimated memory of a render in stages, including encoded copies of the render's state (plans and parts).
    pub fn memory_in_stages(&mut self) -> MemoryEstimate {
        self.need_any_image();
        let (estimate, bytes) = self.forecast(false);
        estimate.with_copies("plan and parts", 4, bytes)
    }

    /// Adds the statistics that any output file may need, since output files are chosen only at the end.
    fn need_any_image(&mut self) {
        self.needs = self.needs.with_variance();
        self.needs.surfaces |= self.clusters().is_some();
    }

    /// Plans the first stage and returns the bytes of a plan file.
    ///
    /// # Errors
    ///
    /// The errors of [`Job::run`].
    pub fn first_plan(&mut self) -> Result<Vec<u8>, JobError> {
        let identity = self.identity()?;
        let (mut session, integrator) = self.open(None)?;
        session.next_stage(&*integrator)?;
        Ok(StateFile::new(StateKind::Plan, identity, session.snapshot()).into_bytes())
    }

    /// Traces `part` of a plan's stage or, without a plan, of the only stage of the render. Returns the bytes of a file
    /// of rows; `None` if the monitor stopped the tracing.
    ///
    /// # Errors
    ///
    /// The errors of [`Job::run`]; [`JobError::OtherRender`] if the plan belongs to another render; [`JobError::NoParts`] if
    /// `plan` is `None` but the render has more than one stage.
    pub fn trace_part(
        &mut self,
        plan: Option<&PlanFile>,
        part: PartNumber,
        checkpoints: Option<Checkpoints>,
        monitor: &mut dyn JobMonitor,
    ) -> Result<Option<Vec<u8>>, JobError> {
        let mut pairs = self.identity()?.pairs().to_vec();
        pairs.extend(plan.map(|plan| (PLAN.into(), to_text(&plan.path))));
        pairs.push((PART.into(), part.to_string()));
        let identity = Identity::new(pairs);
        // This integrator receives its training passes with the rows, `planning` receives them from the plan.
        let world = self.prepared.world.clone();
        let mut integrator = make_integrator(&self.integrator, &world)?;
        let (mut session, planning) = self.open(plan)?;
        let stage = session
            .next_stage(&*planning)?
            .ok_or_else(|| Error::other("the plan", "all samples are traced; run dapple merge"))?;
        if plan.is_none() {
            only_stage(&session, &stage, &*planning, part)?;
        }
        let cut = |rows| session.rows_of(&stage, rows);
        let runs = rows_of_part(&session, &stage, part.index(), part.of());
        let runs = runs.into_iter().map(cut).collect::<Result<Vec<_>, _>>()?;
        drop((session, planning));
        let began = checkpoints.as_ref().map(|c| c.state(&identity, monitor)).transpose()?.flatten();
        let mut done: Vec<Vec<u8>> = began.iter().flat_map(StateFile::rows).map(<[u8]>::to_vec).collect();
        let mut watched = Watched::new(monitor, None, Identity::default(), self.limits.min_spp);
        let mut ready = Readiness::default();
        for run in &runs[done.len().min(runs.len())..] {
            let Some(rows) = self.traced(run, &mut ready, &mut *integrator, &mut watched)? else { return Ok(None) };
            done.push(rows);
            if let Some(checkpoints) = &checkpoints {
                checkpoints.save(&rows_file(StateKind::Checkpoint, &identity, &done))?;
            }
        }
        Ok(Some(rows_file(StateKind::Rows, &identity, &done).into_bytes()))
    }

    /// Joins the rows of a stage and plans the next one. Returns the bytes of a plan file, and `true` if no stage is left.
    ///
    /// # Errors
    ///
    /// [`JobError::Parts`] if the rows do not make up the complete stage.
    pub fn next_plan(&mut self, plan: &PlanFile, rows: &RowsFiles) -> Result<(Vec<u8>, bool), JobError> {
        self.check_rows(rows)?;
        let identity = self.identity()?;
        let (mut session, mut integrator) = self.open(Some(plan))?;
        join(&mut session, &mut *integrator, rows)?;
        let is_done = session.next_stage(&*integrator)?.is_none();
        Ok((StateFile::new(StateKind::Plan, identity, session.snapshot()).into_bytes(), is_done))
    }

    /// The film of a plan whose samples are all traced.
    ///
    /// # Errors
    ///
    /// [`JobError::NotDone`] for a plan with samples left to trace.
    pub fn finish_plan(&mut self, plan: &PlanFile) -> Result<Traced, JobError> {
        let (mut session, integrator) = self.open(Some(plan))?;
        match session.next_stage(&*integrator)? {
            None => Ok(Traced::of(session.into_film())),
            Some(_) => Err(JobError::NotDone { path: plan.path.clone() }),
        }
    }

    /// Merges all parts of an image and returns its film.
    ///
    /// # Errors
    ///
    /// [`JobError::Parts`] if the parts do not make up the complete image.
    pub fn merge(&mut self, parts: &RowsFiles) -> Result<Traced, JobError> {
        self.check_rows(parts)?;
        let (mut session, mut integrator) = self.open(None)?;
        join(&mut session, &mut *integrator, parts)?;
        session.next_stage(&*integrator)?;
        Ok(Traced::of(session.into_film()))
    }

    /// Opens the session of `plan`, or of a new render, with the statistics for any output file. Also returns an integrator to
    /// which the session's training passes have been applied.
    fn open(&mut self, plan: Option<&PlanFile>) -> Result<(Session<'_>, Box<dyn Integrator + '_>), JobError> {
        plan.map_or(Ok(()), |plan| self.check(&plan.path, &plan.file.identity, compared))?;
        self.need_any_image();
        let (session, mut integrator) = self.session(plan.map(PlanFile::snapshot).transpose()?)?;
        session.teach(&mut *integrator);
        Ok((session, integrator))
    }

    /// Coordinates a render on several processes; called on process 0. Starts from the beginning or from the checkpoint file in
    /// `checkpoints`. Ends the other processes, even after an error. A stopped render keeps only its complete stages.
    ///
    /// # Errors
    ///
    /// The errors of [`Job::run`].
    pub fn coordinate(
        &mut self,
        checkpoints: Option<Checkpoints>,
        monitor: &mut dyn JobMonitor,
        processes: &mut dyn Processes,
        stop: &mut dyn FnMut() -> bool,
    ) -> Result<Traced, JobError> {
        let min_spp = self.limits.min_spp;
        let begun = checkpoints.as_ref().map_or_else(|| Ok((self.identity()?, None)), |c| self.begun(c, monitor));
        let begun = begun.and_then(|(identity, snapshot)| Ok((identity, self.session(snapshot)?)));
        // The first error is reported, not an error of ending the other processes.
        let (identity, (mut session, mut integrator)) = begun.inspect_err(|_| drop(dismiss(processes)))?;
        let mut watched = Watched::new(monitor, checkpoints, identity, min_spp);
        if !coordinate(&mut session, &mut *integrator, processes, &mut watched, stop)? {
            session.show_to(&mut |status: &Status<'_>| {
                watched.save_last(status);
                Control::Stop
            });
        }
        let film = session.into_film();
        let (checkpoint, checkpoints_written) = watched.into_checkpoint();
        Ok(Traced { film, failure: None, checkpoint, checkpoints_written })
    }

    /// The identity of the render, and the state in the checkpoint from which it resumes; `None` if it starts afresh.
    pub(super) fn begun(
        &self,
        checkpoints: &Checkpoints,
        monitor: &mut dyn JobMonitor,
    ) -> Result<(Identity, Option<Snapshot>), JobError> {
        let identity = self.identity()?;
        let snapshot = checkpoints.snapshot(&identity, monitor)?;
        if let Some(snapshot) = &snapshot {
            monitor.resumed(snapshot.film().record().samples as f64 / self.frame.pixels() as f64);
        }
        Ok((identity, snapshot))
    }

    /// Traces the rows that process 0 sends, until the render ends. A process whose `stop` returns `true` stops the render.
    ///
    /// # Errors
    ///
    /// [`JobError::Core`] if the connection to process 0 is lost.
    pub fn serve(&mut self, processes: &mut dyn Processes, stop: &mut dyn FnMut() -> bool) -> Result<(), JobError> {
        let world = self.prepared.world.clone();
        let (mut integrator, mut ready) = (make_integrator(&self.integrator, &world)?, Readiness::default());
        let mut monitor = |_: &Status<'_>| if stop() { Control::Stop } else { Control::Continue };
        let trace = |rows: &[u8]| {
            let traced = self.traced(rows, &mut ready, &mut *integrator, &mut monitor);
            traced.map_err(|e| Error::other("tracing", e.to_string()))
        };
        Ok(serve(trace, processes)?)
    }

    /// Traces `rows`, encoded by a session. Returns the traced rows; `None` if the monitor stopped the tracing.
    fn traced(
        &mut self,
        rows: &[u8],
        ready: &mut Readiness,
        integrator: &mut dyn Integrator,
        monitor: &mut dyn Monitor,
    ) -> Result<Option<Vec<u8>>, JobError> {
        let render = Render::new(self.frame, &self.limits).needs(self.needs).recorders(self.filter.recorders());
        Ok(render.monitor(monitor).trace_rows(rows, ready, integrator, &mut *self.sampler)?)
    }

    /// Creates the session of this render, new or resumed from `snapshot`, and its integrator.
    fn session(&mut self, snapshot: Option<Snapshot>) -> Result<(Session<'_>, Box<dyn Integrator + '_>), JobError> {
        let judged = self.is_error_of_filtered() || matches!(self.limits.budget, Budget::Seconds(_));
        let integrator = make_integrator(&self.integrator, &self.prepared.world)?;
        let methods = Methods::from(&mut *self.sampler).with_needs(self.needs);
        let methods = methods.with_recorders(self.filter.recorders());
        let methods = if judged { methods.with_filter(&*self.filter) } else { methods };
        let (frame, limits) = (self.frame, self.limits.clone());
        let session = match snapshot {
            None => Session::new(frame, limits, methods)?,
            Some(snapshot) => Session::resume(frame, limits, methods, snapshot)?,
        };
        Ok((session.with_clock(Clock::of_machine()), integrator))
    }

    /// Returns an error for rows of another scene or with other settings.
    fn check_rows(&self, rows: &RowsFiles) -> Result<(), JobError> {
        rows.files.first().map_or(Ok(()), |(path, file)| self.check(path, &file.identity, joined))
    }

    /// Returns an error if the file at `path`, with identity `there`, belongs to another render. Compares only the settings
    /// that `kept` returns.
    fn check(&self, path: &Path, there: &Identity, kept: fn(&Identity) -> Identity) -> Result<(), JobError> {
        same_render(path, &kept(&self.identity()?), &kept(there))
    }
}

/// A file of traced rows. Each of `runs` holds consecutive rows as bytes.
fn rows_file(kind: StateKind, identity: &Identity, runs: &[Vec<u8>]) -> StateFile {
    let mut bytes = container::begin(runs.iter().map(Vec::len).sum());
    runs.iter().for_each(|run| container::append(&mut bytes, ROWS, run));
    StateFile::new(kind, identity.clone(), bytes)
}

/// Returns an error for a part of a render that has more than one stage.
fn only_stage(
    session: &Session<'_>,
    stage: &Stage,
    integrator: &dyn Integrator,
    part: PartNumber,
) -> Result<(), JobError> {
    let all = session.samples_left();
    if session.samples_in(stage) == all && !integrator.wants_training() {
        return Ok(());
    }
    let why = "the sampler or the light selection needs samples of other machines; use --sampler uniform and \
               --light-selection power, or render in stages (dapple plan)";
    Err(JobError::NoParts { part, why: why.into() })
}

/// Adds `rows` to the session's current stage, and ends the stage.
fn join(session: &mut Session<'_>, integrator: &mut dyn Integrator, rows: &RowsFiles) -> Result<(), JobError> {
    let Some(stage) = session.next_stage(integrator)? else {
        return Err(JobError::Parts(vec!["the plan is done; run dapple merge to make the image".into()]));
    };
    let (mut runs, mut troubles): (Vec<(u32, u32)>, Vec<String>) = (Vec::new(), Vec::new());
    for (path, file) in &rows.files {
        let path = path.display();
        for run in file.rows() {
            match TracedRows::from_bytes(run).and_then(|rows| session.join(&stage, rows)) {
                Ok(rows) => runs.push((rows.start, rows.end)),
                Err(Error::OtherRender { what }) => troubles.push(format!("{path}: {what}")),
                Err(e) => troubles.push(format!("{path}: {e}")),
            }
        }
    }
    runs.sort_unstable();
    troubles.dedup();
    let mut next = stage.rows().start;
    for (start, end) in runs.into_iter().chain([(stage.rows().end, stage.rows().end)]) {
        if start != next {
            let (first, end, wrong) =
                if start > next { (next, start, "are missing") } else { (start, next, "occur twice") };
            let last = end - 1;
            troubles.push(format!("rows {first} to {last} of the stage {wrong}; pass every part exactly once"));
        }
        next = end;
    }
    if !troubles.is_empty() {
        return Err(JobError::Parts(troubles));
    }
    session.end_stage(&stage, integrator)?;
    Ok(())
}

impl Traced {
    fn of(film: dapple_core::Film) -> Self {
        Self { film, failure: None, checkpoint: None, checkpoints_written: 0 }
    }
}
