#![doc = include_str!("../README.md")]

mod checkpoints;
mod film;
mod halves;
mod image;
mod overflow;
mod pairs;
mod rays;
mod recentring;
mod soup;

pub use overflow::overflow_checks;
pub use pairs::Ratio;

use serde::Serialize;

/// How long to look.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effort {
    /// Seconds: all that breaks, and prices that say little.
    Quick,
    /// Two or three minutes.
    Full,
}

/// One safeguard: its price, and what it is good for.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// A word for it.
    pub safeguard: &'static str,
    /// What it does.
    pub does: &'static str,
    /// Time with it over time without it.
    pub price: Ratio,
    /// Time of what.
    pub price_of: String,
    /// What goes wrong without it; empty where nothing is known to.
    pub breaks: Vec<Break>,
}

/// An input that breaks without a safeguard: the smallest of those tried.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Break {
    /// What it is.
    pub input: String,
    /// What whoever renders it sees.
    pub seen: &'static str,
    /// How many things were tried: rays, pixels, samples, images.
    pub of: u64,
    /// How many of them went wrong without the safeguard.
    pub without: u64,
    /// How many with it.
    pub with: u64,
}

/// What can go wrong: none of it should, since all inputs are our own, but for disks and programs.
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A bundled scene was refused.
    #[error("the bundled scene {name} cannot be used: {why}")]
    Scene {
        /// Its name.
        name: &'static str,
        /// Why.
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
        /// The system's words.
        source: std::io::Error,
    },
    /// A program to compare with did not render.
    #[error("{program}: {why}; it must be a build of dapple, see docs/results/make price")]
    Program {
        /// Its path.
        program: std::path::PathBuf,
        /// What it said.
        why: String,
    },
    /// The thread to measure on did not start.
    #[error("cannot start a thread: {0}")]
    Thread(#[from] rayon::ThreadPoolBuildError),
}

type Result<T> = std::result::Result<T, Error>;

/// Measures every safeguard that can be left out of this very program, in order of the chain from scene to file.
/// `onlooker` hears the name of each before it is measured. Takes one thread.
///
/// # Errors
///
/// [`Error`]: disks and threads.
pub fn price(effort: Effort, onlooker: &mut (dyn FnMut(&str) + Send)) -> Result<Vec<Row>> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    pool.install(|| {
        onlooker("recentring");
        let mut rows = vec![recentring::row(effort)?];
        rows.extend(rays::rows(effort, onlooker)?);
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
