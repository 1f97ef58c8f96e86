//! Checkpoints: when they are written, and that rendering goes on meanwhile.

use crate::output::warn;
use crate::{Failure, Result};
use dapple_core::{Snapshot, Status};
use dapple_job::checkpoint::{Contents, Error, Generation, Identity, Kind, Store};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Seconds between checkpoints where none are given.
const EVERY: f64 = 60.0;
/// Seconds until the first one, where they are not to come more often still.
const FIRST: f64 = 1.0;
/// Most of the time that checkpoints take where nobody says how often they are to come.
const SHARE: f64 = 0.01;
/// Bytes a second at which a film becomes a file, before it is measured: encoding and checksum, and as much again in the
/// thread that writes; half of what was measured on one slow core.
const GUESS: f64 = 0.5e9;

/// Writes checkpoints of one render.
pub(super) struct Checkpoints {
    store: Arc<Store>,
    identity: Identity,
    every: Option<f64>,
    /// When the last one was begun, or the render.
    last: Instant,
    /// Seconds of computing that one takes, as far as is known.
    cost: Option<f64>,
    is_first: bool,
    writing: Option<JoinHandle<std::result::Result<(), Error>>>,
    warned: bool,
    /// Why the last one of all was not written.
    trouble: Option<Failure>,
}

impl Checkpoints {
    /// Into `store`, from now on.
    pub(super) fn new(store: Store, identity: Identity, every: Option<f64>) -> Self {
        Self {
            store: Arc::new(store),
            identity,
            every,
            last: Instant::now(),
            cost: None,
            is_first: true,
            writing: None,
            warned: false,
            trouble: None,
        }
    }

    pub(super) fn path(&self) -> &Path {
        self.store.path()
    }

    /// Between two slices: begins to write one if it is time. A disk that fails is tried again at the next time.
    pub(super) fn slice(&mut self, status: &Status<'_>) {
        if !self.is_due(status) || !self.is_idle() {
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
            Err(e) => self.warn_of(&e),
        }
    }

    /// Writes one now, and waits until it is on the disk.
    pub(super) fn finish(&mut self, status: &Status<'_>) {
        self.wait();
        let contents = self.contents(status);
        self.trouble = self.store.save(&contents).err().map(Failure::new);
    }

    /// Why the last checkpoint was not written, if it was not.
    pub(super) fn into_trouble(mut self) -> Option<Failure> {
        self.wait();
        self.trouble.take()
    }

    fn is_due(&self, status: &Status<'_>) -> bool {
        let every = self.every.unwrap_or(EVERY);
        let interval = if self.is_first { every.min(FIRST) } else { every };
        // Whoever says how often wants it so often.
        let interval = match self.every {
            Some(_) => interval,
            None => {
                let film = status.film;
                let bytes = dapple_core::Film::bytes_per_pixel(film.needs()) as f64 * film.frame().pixels() as f64;
                interval.max(self.cost.unwrap_or(bytes / GUESS) / SHARE)
            }
        };
        self.last.elapsed() >= Duration::try_from_secs_f64(interval).unwrap_or(Duration::MAX)
    }

    fn contents(&self, status: &Status<'_>) -> Contents {
        Contents { kind: Kind::Checkpoint, identity: self.identity.clone(), body: status.snapshot() }
    }

    /// Whether nothing is being written; hears how the last one went.
    fn is_idle(&mut self) -> bool {
        if self.writing.as_ref().is_some_and(|writing| !writing.is_finished()) {
            return false;
        }
        self.wait();
        true
    }

    fn wait(&mut self) {
        match self.writing.take().map(JoinHandle::join) {
            None | Some(Ok(Ok(()))) => {}
            Some(Ok(Err(e))) => self.warn_of(&e),
            Some(Err(_)) => self.warn_of(&"the thread that writes it panicked"),
        }
    }

    /// Once: a full disk would say so every minute.
    fn warn_of(&mut self, what: &dyn std::fmt::Display) {
        if !std::mem::replace(&mut self.warned, true) {
            warn(format!("no checkpoint: {what}. Rendering goes on, and it is tried again"));
        }
    }
}

/// Locks the file that checkpoints go to. One that is there already and is not gone on from is not written over.
pub(super) fn open(path: &Path, resumed: Option<&PathBuf>) -> Result<Store> {
    let store = Store::lock(path).map_err(Failure::new)?;
    if Store::exists(path) && resumed.is_none_or(|from| from != path) {
        let path = path.display();
        return Err(Failure::new(format!(
            "{path}: there is a checkpoint already: --resume {path} goes on from it; remove it, and {path}.previous, to \
             start anew"
        )));
    }
    Ok(store)
}

/// The snapshot in a checkpoint of this very render.
pub(super) fn read(path: &Path, identity: &Identity) -> Result<Snapshot> {
    let found = Store::read(path, Kind::Checkpoint).map_err(Failure::new)?;
    if let (Generation::Previous, Some(trouble)) = (found.generation, &found.trouble) {
        warn(format!("{trouble}: going on from the checkpoint before it"));
    }
    refuse_other(path, identity, &found.contents.identity)?;
    Snapshot::from_bytes(&found.contents.body).map_err(|e| Failure::new(format!("{}: {e}", path.display())))
}

/// What belongs to another render is refused, with a list of what differs.
pub(crate) fn refuse_other(path: &Path, here: &Identity, there: &Identity) -> Result<()> {
    let differ = here.differences(there);
    if differ.is_empty() {
        return Ok(());
    }
    let path = path.display();
    let mut lines = vec![format!("{path}: it is of another render than the one asked for:")];
    lines.extend(differ.into_iter().map(|line| format!("{path}: {line}")));
    Err(Failure(lines))
}
