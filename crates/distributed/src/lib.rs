#![doc = include_str!("../README.md")]

mod local;

pub use local::{Local, local};

use dapple_core::{Control, Error, Film, Integrator, Monitor, Session, Stage, Status, TracedRows};
use std::ops::Range;

/// The processes of a render, connected by messages: those of an MPI job, or threads ([`local`]).
///
/// Process 0 coordinates: it plans, deals, joins, and has the film. All others trace what it sends them.
pub trait Processes {
    /// The number of this process, from 0.
    fn rank(&self) -> u32;

    /// The number of processes.
    fn size(&self) -> u32;

    /// Sends bytes to a process. Returns when they may be changed.
    ///
    /// # Errors
    ///
    /// [`Error::Other`] if the process is gone.
    fn send(&mut self, to: u32, bytes: &[u8]) -> Result<(), Error>;

    /// The next message of any process: its sender and its bytes. Waits for it.
    ///
    /// # Errors
    ///
    /// [`Error::Other`] if all processes are gone.
    fn receive(&mut self) -> Result<(u32, Vec<u8>), Error>;
}

/// The first byte of a message to a tracing process: rows follow, or the render is over.
const ROWS: u8 = 1;
const OVER: u8 = 0;
/// The first byte of its answer: rows follow, or it was stopped, or the text of an error follows.
const TRACED: u8 = 1;
const STOPPED: u8 = 2;
const FAILED: u8 = 3;

/// The runs of rows of each part of a stage. Runs of a part lie apart, so that parts take about equal times where some rows
/// of an image cost more than others.
const RUNS: u32 = 8;

/// The rows of a stage that part `index` of `parts` traces, as runs from the top. Follows from the plan alone.
pub fn rows_of_part(session: &Session<'_>, stage: &Stage, index: u32, parts: u32) -> Vec<Range<u32>> {
    let runs = session.deal(stage, parts.saturating_mul(RUNS));
    runs.into_iter().skip(index as usize).step_by(parts as usize).collect()
}

/// Runs a render from process 0. Returns its film, marked as interrupted if any process was stopped.
///
/// The session may be a new one, or one resumed from a snapshot of any render of the same settings, by however many processes.
/// `monitor` is called after each stage and at the end, `stop` between slices of this process's own rows.
///
/// # Errors
///
/// Those of [`Render::run`](dapple_core::Render::run), and [`Error::Other`] with the report of the process that failed.
pub fn coordinate(
    mut session: Session<'_>,
    integrator: &mut dyn Integrator,
    processes: &mut dyn Processes,
    monitor: &mut dyn Monitor,
    stop: &mut dyn FnMut() -> bool,
) -> Result<Film, Error> {
    session.teach(integrator);
    let outcome = stages(&mut session, integrator, processes, monitor, stop);
    for rank in 1..processes.size() {
        processes.send(rank, &[OVER])?;
    }
    if outcome? {
        session.show_end_to(monitor);
    }
    Ok(session.into_film())
}

/// Traces stage after stage. Returns `false` if a process was stopped.
fn stages(
    session: &mut Session<'_>,
    integrator: &mut dyn Integrator,
    processes: &mut dyn Processes,
    monitor: &mut dyn Monitor,
    stop: &mut dyn FnMut() -> bool,
) -> Result<bool, Error> {
    while let Some(stage) = session.next_stage(integrator)? {
        let mut answers = 0;
        for rank in 1..processes.size() {
            for rows in rows_of_part(session, &stage, rank, processes.size()) {
                let message = [&[ROWS][..], &session.rows_of(&stage, rows)?].concat();
                processes.send(rank, &message)?;
                answers += 1;
            }
        }
        let mut watch = |_: &Status<'_>| if stop() { Control::Stop } else { Control::Continue };
        let mut traced: Vec<Result<Option<TracedRows>, Error>> = Vec::new();
        for rows in rows_of_part(session, &stage, 0, processes.size()) {
            traced.push(session.trace_rows_here(&stage, rows, integrator, &mut watch));
        }
        // All answers are taken, whatever happened: nobody is left with a message that no one reads.
        for _ in 0..answers {
            let (rank, answer) = processes.receive()?;
            traced.push(match answer.split_first() {
                Some((&TRACED, rows)) => TracedRows::from_bytes(rows).map(Some),
                Some((&FAILED, text)) => {
                    Err(Error::other(format!("process {rank}"), String::from_utf8_lossy(text).into_owned()))
                }
                _ => Ok(None),
            });
        }
        let traced = traced.into_iter().collect::<Result<Vec<_>, _>>()?;
        // A stage that was stopped anywhere counts nowhere, so that the state is always one that a file can hold.
        let Some(traced) = traced.into_iter().collect::<Option<Vec<_>>>() else {
            session.show_to(monitor);
            return Ok(false);
        };
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

/// Traces what process 0 sends, until the render is over.
///
/// `trace` traces rows, as [`Render::trace_rows`](dapple_core::Render::trace_rows) does for a render of the coordinator's frame,
/// limits, statistics and recorders. `None` says that it was stopped.
///
/// # Errors
///
/// [`Error::Other`] if process 0 is gone. Failures of tracing are reported there.
pub fn serve(
    mut trace: impl FnMut(&[u8]) -> Result<Option<Vec<u8>>, Error>,
    processes: &mut dyn Processes,
) -> Result<(), Error> {
    loop {
        let (_, message) = processes.receive()?;
        let Some((&ROWS, rows)) = message.split_first() else { return Ok(()) };
        let answer = match trace(rows) {
            Ok(Some(rows)) => [&[TRACED][..], &rows].concat(),
            Ok(None) => vec![STOPPED],
            Err(error) => [&[FAILED][..], error.to_string().as_bytes()].concat(),
        };
        processes.send(0, &answer)?;
    }
}

/// Waits until the render is over, on a process that could not be made ready, and reports why.
///
/// # Errors
///
/// As [`serve`].
pub fn refuse(why: &str, processes: &mut dyn Processes) -> Result<(), Error> {
    serve(|_| Err(Error::other("making ready", why)), processes)
}

/// Ends the other processes of a render that process 0 could not begin.
///
/// # Errors
///
/// As [`Processes::send`].
pub fn dismiss(processes: &mut dyn Processes) -> Result<(), Error> {
    (1..processes.size()).try_for_each(|rank| processes.send(rank, &[OVER]))
}
