//! The records of a study: one JSON line per finished run, and one file about the whole study.

use crate::External;
use dapple_renderer::light::LightSelection;
use serde::{Deserialize, Serialize};
use std::fmt;

/// A method of making an image: sampler, point set and filter, each by its registry name with parameters.
///
/// ```
/// # use dapple_study::Method;
/// assert_eq!("mitchell:radius=2/halton".parse::<Method>()?, Method::new("mitchell:radius=2", "halton", "none"));
/// # Ok::<(), dapple_study::PlanError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Method {
    /// The sampler, such as `uniform` or `mitchell:mode=budget`.
    pub sampler: String,
    /// The point set, such as `sobol`.
    pub points: String,
    /// The filter (denoiser), such as `none`.
    pub filter: String,
}

/// The budget of a run.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum RunBudget {
    /// Mean samples per pixel.
    Spp(u64),
    /// As many samples as fit into the time that the baseline takes with this many samples per pixel.
    TimeOf(u64),
}

impl Default for RunBudget {
    fn default() -> Self {
        Self::Spp(0)
    }
}

/// Formats as `16 spp` or `time of 16 spp`.
impl fmt::Display for RunBudget {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Spp(spp) => write!(f, "{spp} spp"),
            Self::TimeOf(spp) => write!(f, "time of {spp} spp"),
        }
    }
}

/// Wall seconds of each phase; 0 for a phase that the method does not have.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Phases {
    /// Reading the scene, once for all runs of a process.
    pub load: f64,
    /// Building the bounding volume hierarchy, once for all runs of a process.
    pub bvh: f64,
    /// Clustering.
    pub cluster: f64,
    /// Probe rays.
    pub probe: f64,
    /// Planning sample counts, without probe rays.
    pub plan: f64,
    /// Tracing.
    pub trace: f64,
    /// Filtering.
    pub filter: f64,
}

impl Method {
    /// A method of these registry names.
    pub fn new(sampler: &str, points: &str, filter: &str) -> Self {
        Self { sampler: sampler.into(), points: points.into(), filter: filter.into() }
    }
}

/// The method `uniform/sobol/none`.
impl Default for Method {
    fn default() -> Self {
        Self::new("uniform", "sobol", "none")
    }
}

/// Formats as `SAMPLER/POINTS/FILTER`.
impl fmt::Display for Method {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}/{}", self.sampler, self.points, self.filter)
    }
}

impl Phases {
    /// Wall seconds that do not grow with the number of samples: clustering, probes and filter.
    pub fn fixed(&self) -> f64 {
        self.cluster + self.probe + self.filter
    }

    /// Wall seconds of an image: all phases but `load` and `bvh`.
    pub fn render(&self) -> f64 {
        self.cluster + self.probe + self.plan + self.trace + self.filter
    }
}

/// Errors of an image against its reference, for linear values unless noted; defined as in
/// [`dapple_metrics::Comparison`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct ImageErrors {
    /// Mean squared error, without the reference's own variance if [`Run::corrected`].
    pub mse: f64,
    /// Mean of the squared error over (squared reference + 0.01); corrected like `mse`.
    pub relmse: f64,
    /// `relmse` without the 0.1 % of pixels with the largest errors; never corrected.
    pub relmse_trimmed: f64,
    /// Symmetric mean absolute percentage error, 0 to 2.
    pub smape: f64,
    /// Peak signal-to-noise ratio of sRGB values, in decibels.
    pub psnr: f64,
    /// Mean squared error of sRGB values from 0 to 255; corrected like `mse`.
    pub srgb8_mse: f64,
    /// Mean LDR-FLIP, 0 to 1.
    pub flip: f64,
    /// Mean of the image over the mean of the reference.
    pub mean_ratio: f64,
}

/// One finished run: a line of `runs.jsonl`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Run {
    /// The scene's name in the study.
    pub scene: String,
    /// The method.
    pub method: Method,
    /// The budget.
    pub budget: RunBudget,
    /// The seed of the point set.
    pub seed: u64,
    /// Samples requested in total; a method with a stopping rule takes fewer.
    #[serde(default)]
    pub asked: u64,
    /// Samples taken in total, without separate probes.
    pub samples: u64,
    /// Mean samples taken per pixel.
    pub spp: f64,
    /// Rays traced, probes included.
    pub rays: u64,
    /// Wall seconds by phase.
    pub seconds: Phases,
    /// Wall seconds of the image: the sum of all phases but load and bvh.
    pub render_s: f64,
    /// User and system seconds of the phases in `render_s`, if known. For an external filter, the time that it reports.
    pub cpu_s: Option<f64>,
    /// Errors against the reference.
    pub errors: ImageErrors,
    /// True if the reference's own variance was subtracted from `mse`, `relmse` and `srgb8_mse`.
    pub corrected: bool,
    /// True if the error is below 100 times the reference's own variance.
    pub reference_limited: bool,
    /// The render's own estimate of its relMSE, if the sampler makes one.
    pub predicted_relmse: Option<f64>,
    /// Samples rejected as NaN or infinite.
    pub rejected: u64,
    /// The machine's load average over the last minute.
    pub load: Option<f64>,
    /// True if the run had a process of its own.
    pub fresh: bool,
    /// The path of the image (EXR, first seed only), relative to the study's folder.
    pub image: Option<String>,
    /// The path of the map of sample counts (PNG, white is most), relative to the study's folder.
    pub sample_map: Option<String>,
    /// The samples per pixel that white stands for in the sample map.
    #[serde(default)]
    pub white: Option<f64>,
}

impl Run {
    /// A run without results; a [`Runner`](crate::Runner) sets the other fields.
    pub fn new(scene: &str, method: Method, budget: RunBudget, seed: u64) -> Self {
        Self { scene: scene.to_owned(), method, budget, seed, ..Self::default() }
    }

    /// Returns `true` if both runs have the same scene, method, budget and seed.
    pub(crate) fn is_same_as(&self, other: &Self) -> bool {
        self.is_of(&other.scene, &other.method, other.budget, other.seed)
    }

    pub(crate) fn is_of(&self, scene: &str, method: &Method, budget: RunBudget, seed: u64) -> bool {
        self.scene == scene && self.method == *method && self.budget == budget && self.seed == seed
    }
}

/// A scene's reference image.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct ReferenceRecord {
    /// The file, relative to the study's folder or absolute.
    pub file: String,
    /// Mean samples per pixel; `None` if unknown.
    pub spp: Option<u64>,
    /// The point set; `None` if unknown.
    pub points: Option<String>,
    /// Seeds of the two halves; `None` if unknown.
    pub seeds: Option<[u64; 2]>,
    /// relMSE of the reference due to its own variance; `None` if unknown.
    pub relmse: Option<f64>,
    /// A hash of all settings and files that the reference depends on.
    pub hash: String,
}

/// A scene of a study, as recorded in the manifest.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct SceneRecord {
    /// The scene's name in the study.
    pub name: String,
    /// The name of a bundled scene, or a path.
    pub source: String,
    /// Width and height in pixels.
    pub resolution: [u32; 2],
    /// The reference that runs are compared with.
    pub reference: ReferenceRecord,
    /// Selection among several lights.
    #[serde(default)]
    pub lights: LightSelection,
}

/// The machine that a study ran on.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Machine {
    /// The processor's name, where known.
    pub processor: Option<String>,
    /// Threads used.
    pub threads: usize,
    /// Operating system and architecture.
    pub system: String,
}

/// The contents of `study.json`: the settings and circumstances of a study.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Manifest {
    /// Version of Dapple.
    pub version: String,
    /// Commit of the build, where known; a `+` at the end marks uncommitted changes.
    pub commit: Option<String>,
    /// The command line, argument by argument.
    pub command: Vec<String>,
    /// Time at which the study began: UTC, RFC 3339.
    pub began: String,
    /// The machine.
    pub machine: Machine,
    /// Scenes in their order.
    pub scenes: Vec<SceneRecord>,
    /// Methods in their order.
    pub methods: Vec<Method>,
    /// External programs that methods name as their filter.
    #[serde(default)]
    pub external: Vec<External>,
    /// The method that the others are compared with, one of `methods`.
    pub baseline: Method,
    /// Budgets in samples per pixel, ascending.
    pub spp: Vec<u64>,
    /// The budget of `spp` whose time equal-time runs get; `None` leaves them out.
    pub time_of: Option<u64>,
    /// Seeds of each method and budget.
    pub seeds: Vec<u64>,
    /// Most scattering events between camera and light; `None` follows each scene.
    #[serde(default)]
    pub max_depth: Option<u32>,
    /// True if each run had a process of its own.
    #[serde(default)]
    pub fresh: bool,
}
