//! The cost of each numerical safeguard, and the inputs that break without it.
//!
//! * A price is the time with the safeguard over the time without it, from pairs that alternate in one process on one
//!   thread. It has a median and an interval with at least 95 % confidence, whatever the noise (order statistics).
//! * Breaks are counted, not timed: the same numbers on every machine.
//! * Film, loading and checkpoints are timed apart and compared with the whole.

mod checkpoints;
mod film;
mod halves;
mod image;
mod overflow;
mod pairs;
mod recentring;

pub use overflow::overflow_checks;
pub use pairs::Ratio;

use serde::Serialize;

/// The duration of the measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effort {
    /// Seconds: all failures, with rough prices.
    Quick,
    /// Two or three minutes.
    Full,
}

/// One safeguard: its price and its use.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// The safeguard's name.
    pub safeguard: &'static str,
    /// The safeguard's effect.
    pub does: &'static str,
    /// Time with it over time without it.
    pub price: Ratio,
    /// The work that was timed.
    pub price_of: String,
    /// Inputs that break without it; empty where none is known.
    pub breaks: Vec<Break>,
}

/// The smallest input tried that breaks without a safeguard.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Break {
    /// The input.
    pub input: String,
    /// The visible defect.
    pub seen: &'static str,
    /// Number of trials: rays, pixels, samples or images.
    pub of: u64,
    /// Failures without the safeguard.
    pub without: u64,
    /// Failures with it.
    pub with: u64,
}

/// A failed measurement, by a fault of a disk or a program.
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A bundled scene was refused.
    #[error("the bundled scene {name} cannot be used: {why}")]
    Scene {
        /// The scene's name.
        name: &'static str,
        /// The reason.
        why: String,
    },
    /// A mesh was refused.
    #[error(transparent)]
    Geometry(#[from] dapple_geometry::Error),
    /// A render failed.
    #[error(transparent)]
    Render(#[from] dapple_core::Error),
    /// A checkpoint was not written or read.
    #[error(transparent)]
    Checkpoint(#[from] dapple_job::checkpoint::Error),
    /// The folder for checkpoints cannot be used.
    #[error("cannot use {path} for checkpoints: {source}; set TMPDIR to a folder that can be written to")]
    Folder {
        /// The folder.
        path: std::path::PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// A program to compare with did not render.
    #[error("{program}: {why}; it must be a build of dapple, see docs/results/price.md")]
    Program {
        /// The program's path.
        program: std::path::PathBuf,
        /// The problem.
        why: String,
    },
    /// The thread to measure on did not start.
    #[error("cannot start a thread: {0}")]
    Thread(#[from] rayon::ThreadPoolBuildError),
}

type Result<T> = std::result::Result<T, Error>;

/// Measures every safeguard that can be left out of this program, in order of the chain from scene to file. `onlooker`
/// receives the name of each before it is measured. Uses one thread.
///
/// # Errors
///
/// [`Error`] of disks and threads.
pub fn price(effort: Effort, onlooker: &mut (dyn FnMut(&str) + Send)) -> Result<Vec<Row>> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    pool.install(|| {
        onlooker("recentring");
        let mut rows = vec![recentring::row(effort)?];
        let image = image::Image::new(effort)?;
        onlooker("film");
        rows.push(film::sums(effort, &image)?);
        onlooker("invalid samples");
        rows.push(film::invalid(effort, &image)?);
        onlooker("halves");
        rows.push(halves::row(effort, &image)?);
        onlooker("checkpoints");
        rows.push(checkpoints::row(effort, &image)?);
        Ok(rows)
    })
}
