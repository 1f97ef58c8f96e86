//! Checkpoints: a killed render resumes from its last one.

use super::image::Image;
use super::pairs::{in_turn, pairs, seconds};
use super::{Break, Effort, Error, Ratio, Result, Row};
use dapple_core::{Control, Monitor, Needs, NoMonitor, Render, Snapshot, Status};
use dapple_job::checkpoint::{Identity, Kind, StateFile, Store};
use dapple_renderer::integrator;
use std::path::PathBuf;

/// Default seconds between checkpoints of `dapple render`.
const EVERY: f64 = 60.0;

pub(crate) fn row(effort: Effort, image: &Image) -> Result<Row> {
    let count = match effort {
        Effort::Quick => 6,
        Effort::Full => 11,
    };
    let folder = Folder::new()?;
    let store = Store::lock(&folder.0.join("render.checkpoint"))?;
    let mut ratios = Vec::new();
    let mut lengths = Vec::new();
    let price = pairs(count, |number| {
        let mut middle = Middle { store: &store, stop: false, seconds: 0.0, samples: 0, trouble: None };
        let [with, without] = in_turn(
            number,
            || {
                let mut film = Ok(());
                let seconds = seconds(|| film = image.render(Needs::none(), &mut middle).map(drop));
                film.map(|()| seconds)
            },
            || image.seconds(Needs::none()),
        )?;
        middle.trouble.map_or(Ok(()), Err)?;
        ratios.push(with / without);
        lengths.push(without);
        Ok::<_, Error>(1.0 + middle.seconds / EVERY)
    })?;
    let [ratio, length] = [ratios, lengths].map(|all| Ratio::of(all).median);
    let each = (price.median - 1.0) * EVERY * 1e3;
    Ok(Row {
        safeguard: "checkpoints",
        does: "the render is saved once a minute, in a file that is whole at any moment",
        price,
        price_of: format!(
            "one checkpoint a minute, {each:.1} ms each where nothing goes on meanwhile; with one in a render of {length:.2} s it \
             is {ratio:.3} of {}",
            image.describe()
        ),
        breaks: vec![killed(image, &store)?],
    })
}

/// A temporary folder, removed when dropped.
struct Folder(PathBuf);

impl Folder {
    fn new() -> Result<Self> {
        let path = std::env::temp_dir().join(format!("dapple-price-{}", std::process::id()));
        std::fs::create_dir_all(&path).map_err(|source| Error::Folder { path: path.clone(), source })?;
        Ok(Self(path))
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        // A folder that cannot be removed stays among the system's temporary files.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Writes a checkpoint after the first slice, and can stop there.
struct Middle<'a> {
    store: &'a Store,
    stop: bool,
    /// Seconds spent on the checkpoint.
    seconds: f64,
    /// Samples traced until then.
    samples: u64,
    trouble: Option<Error>,
}

impl Monitor for Middle<'_> {
    fn slice(&mut self, status: &Status<'_>) -> Control {
        if self.samples == 0 {
            self.samples = status.samples;
            self.seconds = seconds(|| {
                let contents = StateFile::new(Kind::Checkpoint, identity(), status.snapshot());
                self.trouble = self.store.save(&contents).err().map(Error::from);
            });
        }
        if self.stop { Control::Stop } else { Control::Continue }
    }
}

fn identity() -> Identity {
    Identity::new([("scene", Image::NAME)])
}

/// Kills a render half-way. Counts the samples traced twice for the same image, and adds the pixels that differ.
fn killed(image: &Image, store: &Store) -> Result<Break> {
    let mut middle = Middle { store, stop: true, seconds: 0.0, samples: 0, trouble: None };
    let stopped = image.render(Needs::none(), &mut middle)?.record().samples;
    middle.trouble.map_or(Ok(()), Err)?;
    let whole = image.render(Needs::none(), &mut NoMonitor)?;
    let found = Store::read(store.path(), Kind::Checkpoint)?;
    let snapshot = Snapshot::from_bytes(found.contents.bytes())?;
    let saved = snapshot.film().record().samples;
    let (mut sampler, mut integrator) = (Image::sampler(), integrator(image.world()));
    let limits = image.limits();
    let resumed = Render::new(image.frame, &limits).resume(snapshot, &mut *integrator, &mut sampler)?;
    let pixels = 0..image.frame.pixels();
    let bits = |value: [f64; 3]| value.map(f64::to_bits);
    let other = pixels.filter(|&i| bits(resumed.mean(i)) != bits(whole.mean(i))).count() as u64;
    let again = (resumed.record().samples - saved).saturating_sub(image.samples() - stopped);
    Ok(Break {
        input: format!(
            "{} killed half-way, just after a checkpoint: samples to trace again for the same bits",
            image.describe()
        ),
        seen: "the night's work is gone; with checkpoints, at most its last minute",
        of: image.samples(),
        without: stopped,
        with: again + other,
    })
}
