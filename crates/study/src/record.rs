//! What a study writes down: one line of JSON for each finished run, and one file on how all were made.

use crate::External;
use dapple_renderer::light::LightSelection;
use serde::{Deserialize, Serialize};

/// What is compared: a sampler over points, and a filter; words as the registry takes them, parameters included.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct Method {
    /// Such as `uniform` or `mitchell:mode=budget`.
    pub sampler: String,
    /// Such as `sobol`.
    pub points: String,
    /// Such as `none`.
    pub filter: String,
}

/// What a run was given to spend.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Budget {
    /// Mean samples per pixel.
    Spp(u64),
    /// As many samples as take as long as the baseline's with so many samples per pixel.
    TimeOf(u64),
}

/// Wall seconds of each phase; those that a method does not have take none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Phases {
    /// Reading the scene: once for all runs of a process.
    pub load: f64,
    /// Building its trees: likewise.
    pub bvh: f64,
    /// Clusters.
    pub cluster: f64,
    /// Probe rays.
    pub probe: f64,
    /// Deciding on counts, probes left out.
    pub plan: f64,
    /// Tracing.
    pub trace: f64,
    /// The filter.
    pub filter: f64,
}

impl Method {
    /// A method by its words.
    pub fn new(sampler: &str, points: &str, filter: &str) -> Self {
        Self { sampler: sampler.into(), points: points.into(), filter: filter.into() }
    }
}

/// `SAMPLER/POINTS/FILTER`.
impl std::fmt::Display for Method {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}/{}/{}", self.sampler, self.points, self.filter)
    }
}

impl Phases {
    /// What does not grow with the samples: clusters, probes and the filter.
    pub fn fixed(&self) -> f64 {
        self.cluster + self.probe + self.filter
    }

    /// What an image costs: all but load and bvh.
    pub fn render(&self) -> f64 {
        self.cluster + self.probe + self.plan + self.trace + self.filter
    }
}

/// An image against the reference, linear values unless said otherwise; as [`dapple_metrics::Comparison`] has them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Errors {
    /// Mean squared error, the reference's own variance taken out where [`Run::corrected`].
    pub mse: f64,
    /// Over the squared reference + 0.01; corrected likewise.
    pub relmse: f64,
    /// Without the worst 0.1 % of pixels; never corrected.
    pub relmse_trimmed: f64,
    /// 0 to 2.
    pub smape: f64,
    /// Decibels, as displayed.
    pub psnr: f64,
    /// As displayed, on a scale of 0 to 255; corrected as `mse`.
    pub srgb8_mse: f64,
    /// 0 to 1.
    pub flip: f64,
    /// Mean over the reference's.
    pub mean_ratio: f64,
}

/// One finished run: a line of `runs.jsonl`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Run {
    /// The scene's name in the study.
    pub scene: String,
    /// How.
    pub method: Method,
    /// What it was given.
    pub budget: Budget,
    /// Of its points.
    pub seed: u64,
    /// Samples asked for in all; a method that stops by itself spends fewer.
    #[serde(default)]
    pub asked: u64,
    /// Samples spent, separate probes left out.
    pub samples: u64,
    /// The same per pixel.
    pub spp: f64,
    /// Rays, probes included.
    pub rays: u64,
    /// Time by phase.
    pub seconds: Phases,
    /// Their sum but for load and bvh: what an image costs.
    pub render_s: f64,
    /// User and system seconds of the same phases, where known; of an external filter what it said of itself.
    pub cpu_s: Option<f64>,
    /// Against the reference.
    pub errors: Errors,
    /// Whether the reference's own variance was taken out of mse, relmse and srgb8_mse.
    pub corrected: bool,
    /// Whether the error is within 100 times the reference's own variance.
    pub reference_limited: bool,
    /// The render's own estimate, where it makes one.
    pub predicted_relmse: Option<f64>,
    /// Samples that were no numbers.
    pub rejected: u64,
    /// The machine's load average over the minute before.
    pub load: Option<f64>,
    /// Whether a process of its own made it.
    pub fresh: bool,
    /// Its image (EXR, of the first seed only), relative to the study's folder.
    pub image: Option<String>,
    /// Its sample counts (PNG, white = many), likewise.
    pub sample_map: Option<String>,
    /// The samples per pixel that are white in it.
    #[serde(default)]
    pub white: Option<f64>,
}

/// A scene's reference.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Reference {
    /// Its file (EXR), relative to the study's folder or absolute.
    pub file: String,
    /// Mean samples per pixel; `None` for a file from elsewhere.
    pub spp: Option<u64>,
    /// Words of its points.
    pub points: Option<String>,
    /// Seeds of its two halves.
    pub seeds: Option<[u64; 2]>,
    /// Its own variance, as relMSE against itself; `None` where unknown.
    pub relmse: Option<f64>,
    /// Of everything that it depends on.
    pub hash: String,
}

/// A scene of a study.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneRecord {
    /// Its name in the study.
    pub name: String,
    /// Bundled name or path.
    pub source: String,
    /// Width and height in pixels.
    pub resolution: [u32; 2],
    /// What it is compared with.
    pub reference: Reference,
    /// How a light is chosen among several.
    #[serde(default)]
    pub lights: LightSelection,
}

/// Where it ran.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Machine {
    /// The processor's name, where known.
    pub processor: Option<String>,
    /// Threads used.
    pub threads: usize,
    /// Operating system and architecture.
    pub system: String,
}

/// How a study was made: `study.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// Version of Dapple.
    pub version: String,
    /// Commit it was built from, where known; `+` behind it for a dirty tree.
    pub commit: Option<String>,
    /// The command, word by word.
    pub command: Vec<String>,
    /// When it began, UTC, RFC 3339.
    pub began: String,
    /// Where.
    pub machine: Machine,
    /// Scenes in their order.
    pub scenes: Vec<SceneRecord>,
    /// Methods in their order.
    pub methods: Vec<Method>,
    /// Filters of theirs that are programs of others.
    #[serde(default)]
    pub external: Vec<External>,
    /// What others are compared with, one of `methods`.
    pub baseline: Method,
    /// Budgets in samples per pixel, ascending.
    pub spp: Vec<u64>,
    /// Of the baseline: what equal-time runs have the time of.
    pub time_of: Option<u64>,
    /// Seeds of each point.
    pub seeds: Vec<u64>,
    /// Most scattering events between camera and light, whatever the scenes say; `None` follows them.
    #[serde(default)]
    pub max_depth: Option<u32>,
    /// Whether a process of its own made each run.
    #[serde(default)]
    pub fresh: bool,
}
