#![doc = include_str!("../README.md")]

mod local;

pub use local::{LocalProcess, local};

use dapple_core::render::{Control, Monitor, Stage, Status, TracedRows};
use dapple_core::{Error, Integrator, Session, container};
use std::ops::Range;

/// A process's connection to the other processes of a render, by MPI or between threads ([`local`]).
///
/// Process 0 plans, distributes rows, joins the results, and holds the film. The other processes trace rows.
pub trait Processes {
    /// The number of this process, from 0.
    fn rank(&self) -> u32;

    /// The number of processes.
    fn size(&self) -> u32;

    /// Sends `bytes` to process `to`. Returns once `bytes` may be changed.
    ///
    /// # Errors
    ///
    /// [`Error::Other`] if the process has ended.
    fn send(&mut self, to: u32, bytes: &[u8]) -> Result<(), Error>;

    /// Waits for the next message from any process. Returns the sender's rank and the bytes.
    ///
    /// # Errors
    ///
    /// [`Error::Other`] if all other processes have ended.
    fn receive(&mut self) -> Result<(u32, Vec<u8>), Error>;
}

// The sections of messages, which are containers: rows to trace and traced rows, the end of the render, and answers without rows.
const ROWS: &str = "rows";
const OVER: &str = "over";
const STOPPED: &str = "stopped";
const FAILED: &str = "failed";

/// A message with one section.
fn message(name: &str, section: &[u8]) -> Vec<u8> {
    let mut bytes = container::begin(section.len());
    container::append(&mut bytes, name, section);
    bytes
}

/// A message with runs of rows. All runs for a process are in one message, so that each send is followed by a receive: MPI
/// may block a send until then.
fn rows_message<'a>(runs: impl IntoIterator<Item = &'a Vec<u8>>) -> Vec<u8> {
    let mut bytes = container::begin(0);
    runs.into_iter().for_each(|run| container::append(&mut bytes, ROWS, run));
    bytes
}

/// The number of runs of rows in each part of a stage. The runs of a part are spread over the image, so that parts take
/// about the same time even if some rows cost more than others.
const RUNS: u32 = 8;

/// The row ranges of a stage's part `index`, from 0 to `parts - 1`, top to bottom. They depend only on the plan.
pub fn rows_of_part(session: &Session<'_>, stage: &Stage, index: u32, parts: u32) -> Vec<Range<u32>> {
    // An integrator that prepares for each of several passes would do so again for each range.
    let runs = if stage.passes() > 1 { 1 } else { RUNS };
    let runs = session.deal(stage, parts.saturating_mul(runs));
    runs.into_iter().skip(index as usize).step_by(parts as usize).collect()
}

/// Coordinates a render of several processes; called on process 0. Returns `false` if `monitor` stops the render or any process
/// was stopped; the session is then at the end of the last complete stage.
///
/// The session may be new, or resumed from a snapshot of a render with the same settings and any number of processes. `monitor`
/// is called after each stage and at the end. `stop` is called about every 0.2 seconds of this process's tracing; `true` stops
/// the render.
///
/// # Errors
///
/// The errors of [`Render::run`](dapple_core::Render::run), and [`Error::Other`] with the message of a process that failed.
pub fn coordinate(
    session: &mut Session<'_>,
    integrator: &mut dyn Integrator,
    processes: &mut dyn Processes,
    monitor: &mut dyn Monitor,
    stop: &mut dyn FnMut() -> bool,
) -> Result<bool, Error> {
    session.teach(integrator);
    let outcome = stages(session, integrator, processes, monitor, stop);
    // All processes learn that the render is over, even after an error. The first error is returned.
    let told = dismiss(processes);
    let complete = outcome?;
    told?;
    if complete {
        session.show_end_to(monitor);
    }
    Ok(complete)
}

/// Traces all stages in order. Returns `false` if a process was stopped.
fn stages(
    session: &mut Session<'_>,
    integrator: &mut dyn Integrator,
    processes: &mut dyn Processes,
    monitor: &mut dyn Monitor,
    stop: &mut dyn FnMut() -> bool,
) -> Result<bool, Error> {
    while let Some(stage) = session.next_stage(integrator)? {
        for rank in 1..processes.size() {
            let runs = rows_of_part(session, &stage, rank, processes.size()).into_iter();
            let runs = runs.map(|rows| session.rows_of(&stage, rows)).collect::<Result<Vec<_>, _>>()?;
            processes.send(rank, &rows_message(&runs))?;
        }
        let mut watch = |_: &Status<'_>| if stop() { Control::Stop } else { Control::Continue };
        let mut traced: Vec<Result<Option<TracedRows>, Error>> = Vec::new();
        for rows in rows_of_part(session, &stage, 0, processes.size()) {
            traced.push(session.trace_rows_here(&stage, rows, integrator, &mut watch));
        }
        // All answers are received, even after an error, so that no process waits with an unread message.
        for _ in 1..processes.size() {
            let (rank, answer) = processes.receive()?;
            let of = |e: &dyn std::fmt::Display| Error::other(format!("process {rank}"), e.to_string());
            match container::sections(&answer) {
                Ok(found) => traced.extend(found.into_iter().map(|(name, section)| match name {
                    ROWS => TracedRows::from_bytes(section).map(Some),
                    FAILED => Err(of(&String::from_utf8_lossy(section))),
                    _ => Ok(None),
                })),
                Err(fault) => traced.push(Err(of(&fault.text()))),
            }
        }
        let traced = traced.into_iter().collect::<Result<Vec<_>, _>>()?;
        // If one process was stopped, the whole stage is dropped, so that a file can hold the state.
        let Some(traced) = traced.into_iter().collect::<Option<Vec<_>>>() else { return Ok(false) };
        for rows in traced {
            session.join(&stage, rows)?;
        }
        session.end_stage(&stage, integrator)?;
        if session.show_to(monitor) == Control::Stop {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Traces the rows that process 0 sends, until the render is over.
///
/// `trace` traces rows as [`Render::trace_rows`](dapple_core::Render::trace_rows) does, for a render with the coordinator's
/// frame, limits, statistics and recorders. It returns `None` if it was stopped.
///
/// # Errors
///
/// [`Error::Other`] if process 0 has ended. Errors of `trace` are reported to process 0.
pub fn serve(
    mut trace: impl FnMut(&[u8]) -> Result<Option<Vec<u8>>, Error>,
    processes: &mut dyn Processes,
) -> Result<(), Error> {
    loop {
        let (_, bytes) = processes.receive()?;
        let found = container::sections(&bytes).map_err(|fault| Error::other("process 0", fault.text()))?;
        if found.iter().any(|(name, _)| *name == OVER) {
            return Ok(());
        }
        let traced = found.into_iter().map(|(_, rows)| trace(rows)).collect::<Result<Option<Vec<_>>, _>>();
        processes.send(
            0,
            &match traced {
                Ok(Some(runs)) => rows_message(&runs),
                Ok(None) => message(STOPPED, &[]),
                Err(error) => message(FAILED, error.to_string().as_bytes()),
            },
        )?;
    }
}

/// Serves a render without tracing: answers each request of process 0 with the error `why`, until the render is over.
///
/// # Errors
///
/// The errors of [`serve`].
pub fn refuse(why: &str, processes: &mut dyn Processes) -> Result<(), Error> {
    serve(|_| Err(Error::other("preparing for the render", why)), processes)
}

/// Sends all other processes the message that the render is over, even if some have already ended.
///
/// # Errors
///
/// The first error of [`Processes::send`].
pub fn dismiss(processes: &mut dyn Processes) -> Result<(), Error> {
    let told: Vec<_> = (1..processes.size()).map(|rank| processes.send(rank, &message(OVER, &[]))).collect();
    told.into_iter().collect()
}
