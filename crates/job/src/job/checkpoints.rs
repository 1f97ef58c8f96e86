//! Checkpoints of a run: written now and then in a thread of their own, while rendering goes on.

use super::JobMonitor;
use super::identity::compared;
use crate::checkpoint::{Contents, Error, Generation, Identity, Kind, Store};
use crate::{JobError, Warning};
use dapple_core::{Control, Film, Monitor, Snapshot, Status};
use std::path::PathBuf;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Seconds between checkpoints by default.
const EVERY: f64 = 60.0;
/// Seconds until the first one, unless they are more frequent still.
const FIRST: f64 = 1.0;
/// Largest part of the time that checkpoints take by default.
const SHARE: f64 = 0.01;
/// Bytes per second at which a film becomes a file, before it is measured: encoding and checksum, and as much again in the
/// thread that writes. Half of the rate measured on one slow core.
const GUESS: f64 = 0.5e9;

/// The files of checkpoints: the one that is kept, and the one that a render resumes from.
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct CheckpointOptions {
    /// The file to keep checkpoints in.
    pub keep: Option<PathBuf>,
    /// The file to resume from. It is kept up to date, unless `keep` names another. A render begins anew where both name one
    /// file that does not exist.
    pub resume: Option<PathBuf>,
    /// Seconds between checkpoints; by default 60, or more where they would take above 1 % of the time.
    pub every: Option<f64>,
}

impl CheckpointOptions {
    /// Keeps checkpoints in this file.
    #[must_use]
    pub fn keep(self, path: impl Into<PathBuf>) -> Self {
        Self { keep: Some(path.into()), ..self }
    }

    /// Resumes from this file.
    #[must_use]
    pub fn resume(self, path: impl Into<PathBuf>) -> Self {
        Self { resume: Some(path.into()), ..self }
    }

    /// Sets the seconds between checkpoints.
    #[must_use]
    pub fn every(self, seconds: f64) -> Self {
        Self { every: Some(seconds), ..self }
    }

    /// Locks the file; `None` without one.
    ///
    /// # Errors
    ///
    /// [`JobError::CheckpointExists`] for an existing file that is not resumed from; [`JobError::Checkpoint`] for a file in use
    /// by another process.
    pub fn open(self) -> Result<Option<Checkpoints>, JobError> {
        let Some(path) = self.keep.as_ref().or(self.resume.as_ref()) else { return Ok(None) };
        let store = Store::lock(path)?;
        let exists = Store::exists(path);
        if exists && self.resume.as_ref().is_none_or(|from| from != path) {
            return Err(JobError::CheckpointExists { path: path.clone() });
        }
        let begins = |from: &PathBuf| self.keep.as_ref() == Some(from) && !exists;
        let resume = self.resume.as_ref().filter(|from| !begins(from)).cloned();
        Ok(Some(Checkpoints { store: Arc::new(store), every: self.every, resume }))
    }
}

/// An open checkpoint file, locked for this process.
pub struct Checkpoints {
    store: Arc<Store>,
    every: Option<f64>,
    resume: Option<PathBuf>,
}

impl Checkpoints {
    /// The snapshot to resume from; `None` at the beginning of a render.
    pub(super) fn snapshot(&self, here: &Identity, monitor: &mut dyn JobMonitor) -> Result<Option<Snapshot>, JobError> {
        let Some(path) = &self.resume else { return Ok(None) };
        let found = Store::read(path, Kind::Checkpoint)?;
        if let (Generation::Previous, Some(trouble)) = (found.generation, &found.trouble) {
            monitor.warn(Warning::PreviousCheckpoint(trouble.to_string()));
        }
        let differences = compared(here).differences(&compared(&found.contents.identity));
        if !differences.is_empty() {
            return Err(JobError::OtherRender { path: path.clone(), differences });
        }
        let snapshot = Snapshot::from_bytes(&found.contents.body);
        snapshot.map(Some).map_err(|source| JobError::Snapshot { path: path.clone(), source })
    }
}

/// A job's monitor, with checkpoints between its slices.
pub(super) struct Watched<'m> {
    monitor: &'m mut dyn JobMonitor,
    writer: Option<Writer>,
}

impl<'m> Watched<'m> {
    pub(super) fn new(monitor: &'m mut dyn JobMonitor, checkpoints: Option<Checkpoints>, identity: Identity) -> Self {
        Self { monitor, writer: checkpoints.map(|checkpoints| Writer::new(checkpoints, identity)) }
    }

    fn save_last(&mut self, status: &Status<'_>) {
        if let Some(writer) = &mut self.writer {
            writer.finish(status, self.monitor);
        }
    }

    /// The checkpoint to resume from, or the reason why the last one was not written.
    pub(super) fn into_checkpoint(self) -> Option<Result<PathBuf, JobError>> {
        let mut writer = self.writer?;
        writer.wait(self.monitor);
        let path = writer.store.path().to_owned();
        Some(writer.trouble.take().map_or(Ok(path), |trouble| Err(trouble.into())))
    }
}

impl Monitor for Watched<'_> {
    fn slice(&mut self, status: &Status<'_>) -> Control {
        if self.monitor.slice(status) == Control::Stop {
            self.save_last(status);
            return Control::Stop;
        }
        if let Some(writer) = &mut self.writer {
            writer.slice(status, self.monitor);
        }
        Control::Continue
    }

    fn end(&mut self, status: &Status<'_>) {
        self.monitor.end(status);
        self.save_last(status);
    }
}

/// Writes checkpoints of one render.
struct Writer {
    store: Arc<Store>,
    identity: Identity,
    every: Option<f64>,
    /// Begin of the last one, or of the render.
    last: Instant,
    /// Seconds of computing per checkpoint, once measured.
    cost: Option<f64>,
    is_first: bool,
    writing: Option<JoinHandle<Result<(), Error>>>,
    warned: bool,
    /// Why the very last one was not written.
    trouble: Option<Error>,
}

impl Writer {
    fn new(Checkpoints { store, every, .. }: Checkpoints, identity: Identity) -> Self {
        let last = Instant::now();
        Self { store, identity, every, last, cost: None, is_first: true, writing: None, warned: false, trouble: None }
    }

    /// Begins to write one if it is due. A disk that fails is tried again at the next time.
    fn slice(&mut self, status: &Status<'_>, monitor: &mut dyn JobMonitor) {
        if !self.is_due(status) || !self.is_idle(monitor) {
            return;
        }
        let began = Instant::now();
        let contents = self.contents(status);
        // The other thread computes about as long: a checksum, and a copy to the system.
        self.cost = Some(2.0 * began.elapsed().as_secs_f64());
        (self.last, self.is_first) = (began, false);
        let store = self.store.clone();
        let writer = std::thread::Builder::new().name("checkpoint".into());
        match writer.spawn(move || store.save(&contents)) {
            Ok(writing) => self.writing = Some(writing),
            Err(e) => self.warn(&e, monitor),
        }
    }

    /// Writes one now, and waits until it is on the disk.
    fn finish(&mut self, status: &Status<'_>, monitor: &mut dyn JobMonitor) {
        self.wait(monitor);
        let contents = self.contents(status);
        self.trouble = self.store.save(&contents).err();
    }

    fn is_due(&self, status: &Status<'_>) -> bool {
        let every = self.every.unwrap_or(EVERY);
        let interval = if self.is_first { every.min(FIRST) } else { every };
        let interval = match self.every {
            // An interval that the user gave is kept, whatever it costs.
            Some(_) => interval,
            None => {
                let film = status.film;
                let bytes = Film::bytes_per_pixel(film.needs()) as f64 * film.frame().pixels() as f64;
                interval.max(self.cost.unwrap_or(bytes / GUESS) / SHARE)
            }
        };
        self.last.elapsed() >= Duration::try_from_secs_f64(interval).unwrap_or(Duration::MAX)
    }

    fn contents(&self, status: &Status<'_>) -> Contents {
        Contents { kind: Kind::Checkpoint, identity: self.identity.clone(), body: status.snapshot() }
    }

    /// Returns true if nothing is being written. Takes the result of the last write.
    fn is_idle(&mut self, monitor: &mut dyn JobMonitor) -> bool {
        if self.writing.as_ref().is_some_and(|writing| !writing.is_finished()) {
            return false;
        }
        self.wait(monitor);
        true
    }

    fn wait(&mut self, monitor: &mut dyn JobMonitor) {
        match self.writing.take().map(JoinHandle::join) {
            None | Some(Ok(Ok(()))) => {}
            Some(Ok(Err(e))) => self.warn(&e, monitor),
            Some(Err(_)) => self.warn(&"the thread that writes it panicked", monitor),
        }
    }

    /// Warns once: a full disk would cause a warning every minute.
    fn warn(&mut self, trouble: &dyn std::fmt::Display, monitor: &mut dyn JobMonitor) {
        if !std::mem::replace(&mut self.warned, true) {
            monitor.warn(Warning::NoCheckpoint(trouble.to_string()));
        }
    }
}
