//! Checkpoints of a run, written at intervals by a separate thread while rendering continues.

use super::JobMonitor;
use super::identity::{compared, same_render};
use super::monitor::TimeWatch;
use crate::checkpoint::{Error, Identity, StateFile, StateKind, Store};
use crate::output::FileIdentity;
use crate::{JobError, Warning};
use dapple_core::render::{Control, Monitor, Status};
use dapple_core::{Film, Snapshot};
use std::path::PathBuf;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Default seconds between two checkpoints.
const EVERY: f64 = 60.0;
/// Seconds from the start of a render to its first checkpoint, unless the interval between checkpoints is shorter.
const FIRST: f64 = 1.0;
/// The largest fraction of the render time that checkpoints may use, unless the user sets an interval.
const SHARE: f64 = 0.01;
/// The assumed rate in bytes per second at which a film is encoded, checksummed and written, until the first checkpoint
/// is measured. It is half of the rate measured on one slow core.
const GUESS: f64 = 0.5e9;

/// The checkpoint file to write and the one to resume from.
#[derive(Clone, Debug, Default)]
pub struct CheckpointOptions {
    /// The file to write checkpoints to; `None` means the file `resume`. If both are `None`, no checkpoints are written.
    pub keep: Option<PathBuf>,
    /// The checkpoint file to resume from; `None` starts a new render. If the file does not exist, a new render starts only if
    /// `keep` names the same file.
    pub resume: Option<PathBuf>,
    /// Seconds between checkpoints. `None` means 60, or more if checkpoints would use over 1 % of the render time.
    pub every: Option<f64>,
}

impl CheckpointOptions {
    /// Locks the checkpoint file; returns `None` if the options name no file.
    ///
    /// # Errors
    ///
    /// [`JobError::CheckpointExists`] if the file exists and the render does not resume from it. [`JobError::Checkpoint`] if
    /// another process uses the file.
    pub fn open(self) -> Result<Option<Checkpoints>, JobError> {
        let Some(path) = self.keep.as_ref().or(self.resume.as_ref()) else { return Ok(None) };
        let store = Store::lock(path)?;
        let exists = Store::exists(path);
        // One file may have two names, such as c and ./c.
        let is_kept = |from: &PathBuf| FileIdentity::of(from).is_same(&FileIdentity::of(path));
        if exists && !self.resume.as_ref().is_some_and(is_kept) {
            return Err(JobError::CheckpointExists { path: path.clone() });
        }
        let begins = |from: &PathBuf| self.keep.is_some() && is_kept(from) && !exists;
        let resume = self.resume.as_ref().filter(|from| !begins(from)).cloned();
        Ok(Some(Checkpoints { resume, every: self.every, ..Checkpoints::on(store) }))
    }
}

/// A checkpoint file that this process has locked, with the file to resume from and the interval between checkpoints.
pub struct Checkpoints {
    store: Arc<Store>,
    every: Option<f64>,
    resume: Option<PathBuf>,
}

impl Checkpoints {
    /// Checkpoints of a render that starts afresh, written to the locked file `store` at the default intervals.
    pub fn on(store: Store) -> Self {
        Self { store: Arc::new(store), every: None, resume: None }
    }

    /// Reads the file to resume from and checks that it belongs to this render; `None` if there is no such file.
    pub(super) fn state(&self, here: &Identity, monitor: &mut dyn JobMonitor) -> Result<Option<StateFile>, JobError> {
        let Some(path) = &self.resume else { return Ok(None) };
        let found = Store::read(path, StateKind::Checkpoint)?;
        if let Some(trouble) = &found.trouble {
            monitor.warn(Warning::PreviousCheckpoint(trouble.fault()));
        }
        same_render(path, &compared(here), &compared(&found.contents.identity))?;
        Ok(Some(found.contents))
    }

    /// Writes `file` as the newest checkpoint.
    pub(super) fn save(&self, file: &StateFile) -> Result<(), JobError> {
        Ok(self.store.save(file)?)
    }

    /// Reads the state of a whole render from the file to resume from.
    pub(super) fn snapshot(&self, here: &Identity, monitor: &mut dyn JobMonitor) -> Result<Option<Snapshot>, JobError> {
        let (Some(file), Some(path)) = (self.state(here, monitor)?, &self.resume) else { return Ok(None) };
        Snapshot::from_bytes(file.bytes()).map(Some).map_err(|source| JobError::Snapshot { path: path.clone(), source })
    }
}

/// A [`Monitor`] that passes calls to a job's monitor. It writes checkpoints, and warns
/// about a time limit that cannot be met.
pub(super) struct Watched<'m> {
    monitor: &'m mut dyn JobMonitor,
    writer: Option<Writer>,
    time: TimeWatch,
    min_spp: u32,
}

impl<'m> Watched<'m> {
    pub(super) fn new(
        monitor: &'m mut dyn JobMonitor,
        checkpoints: Option<Checkpoints>,
        identity: Identity,
        min_spp: u32,
    ) -> Self {
        let writer = checkpoints.map(|checkpoints| Writer::new(checkpoints, identity));
        Self { monitor, writer, time: TimeWatch::default(), min_spp }
    }

    /// Writes the final checkpoint.
    pub(super) fn save_last(&mut self, status: &Status<'_>) {
        if let Some(writer) = &mut self.writer {
            writer.finish(status, self.monitor);
        }
    }

    /// Waits for the last write; returns the path of the checkpoint file, or the error of writing it, and the number of
    /// checkpoints written. `None` without checkpoints.
    pub(super) fn into_checkpoint(self) -> (Option<Result<PathBuf, JobError>>, u64) {
        let Some(mut writer) = self.writer else { return (None, 0) };
        writer.wait(self.monitor);
        let path = writer.store.path().to_owned();
        (Some(writer.trouble.take().map_or(Ok(path), |trouble| Err(trouble.into()))), writer.written)
    }
}

impl Monitor for Watched<'_> {
    fn progress(&mut self, status: &Status<'_>) -> Control {
        if let Some(warning) = self.time.look(status, self.min_spp) {
            self.monitor.warn(warning);
        }
        if self.monitor.progress(status) == Control::Stop {
            self.save_last(status);
            return Control::Stop;
        }
        if let Some(writer) = &mut self.writer {
            writer.progress(status, self.monitor);
        }
        Control::Continue
    }

    fn end(&mut self, status: &Status<'_>) {
        self.monitor.end(status);
        self.save_last(status);
    }
}

/// The writer of one render's checkpoints.
struct Writer {
    store: Arc<Store>,
    identity: Identity,
    every: Option<f64>,
    /// The time at which the last checkpoint began; before the first checkpoint, the start of the render.
    last: Instant,
    /// Estimated computing time per checkpoint in seconds: twice the time of taking the last snapshot. `None` before the first
    /// checkpoint.
    cost: Option<f64>,
    is_first: bool,
    writing: Option<JoinHandle<Result<(), Error>>>,
    warned: bool,
    /// The number of checkpoints written.
    written: u64,
    /// The error of writing the final checkpoint, if there was one.
    trouble: Option<Error>,
}

impl Writer {
    fn new(Checkpoints { store, every, .. }: Checkpoints, identity: Identity) -> Self {
        let (last, is_first, warned) = (Instant::now(), true, false);
        Self { store, identity, every, last, cost: None, is_first, writing: None, warned, written: 0, trouble: None }
    }

    /// Starts writing a checkpoint if one is due and none is being written. After a disk error, the next due checkpoint
    /// tries again.
    fn progress(&mut self, status: &Status<'_>, monitor: &mut dyn JobMonitor) {
        if !self.is_due(status) || self.writing.as_ref().is_some_and(|writing| !writing.is_finished()) {
            return;
        }
        self.wait(monitor);
        let began = Instant::now();
        let contents = self.contents(status);
        // The writing thread needs about the same time again for the checksum and for passing the bytes to the system.
        self.cost = Some(2.0 * began.elapsed().as_secs_f64());
        (self.last, self.is_first) = (began, false);
        let store = self.store.clone();
        let writer = std::thread::Builder::new().name("checkpoint".into());
        match writer.spawn(move || store.save(&contents)) {
            Ok(writing) => self.writing = Some(writing),
            Err(e) => self.warn(&e, monitor),
        }
    }

    /// Writes the final checkpoint in this thread, after a write in progress has ended.
    fn finish(&mut self, status: &Status<'_>, monitor: &mut dyn JobMonitor) {
        self.wait(monitor);
        let contents = self.contents(status);
        self.trouble = self.store.save(&contents).err();
        self.written += u64::from(self.trouble.is_none());
    }

    fn is_due(&self, status: &Status<'_>) -> bool {
        let every = self.every.unwrap_or(EVERY);
        let mut interval = if self.is_first { every.min(FIRST) } else { every };
        // An interval set by the user is kept, even if checkpoints take much of the time.
        if self.every.is_none() {
            let film = status.film;
            let bytes = Film::bytes_per_pixel(film.needs()) as f64 * film.frame().pixels() as f64;
            interval = interval.max(self.cost.unwrap_or(bytes / GUESS) / SHARE);
        }
        self.last.elapsed() >= Duration::try_from_secs_f64(interval).unwrap_or(Duration::MAX)
    }

    fn contents(&self, status: &Status<'_>) -> StateFile {
        StateFile::new(StateKind::Checkpoint, self.identity.clone(), status.snapshot())
    }

    fn wait(&mut self, monitor: &mut dyn JobMonitor) {
        match self.writing.take().map(JoinHandle::join) {
            None => {}
            Some(Ok(Ok(()))) => self.written += 1,
            Some(Ok(Err(e))) => self.warn(&e, monitor),
            Some(Err(_)) => self.warn(&"the writing thread panicked", monitor),
        }
    }

    /// Warns about a failed write the first time only: a full disk would cause a warning every minute.
    fn warn(&mut self, trouble: &dyn std::fmt::Display, monitor: &mut dyn JobMonitor) {
        if !std::mem::replace(&mut self.warned, true) {
            monitor.warn(Warning::NoCheckpoint(trouble.to_string()));
        }
    }
}
