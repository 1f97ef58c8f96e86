//! The records of a study: one JSON line per finished run, and one file about the whole study.

use crate::External;
use dapple_metrics::METRICS;
use dapple_renderer::light::LightSelection;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::collections::BTreeMap;
use std::fmt;

/// A method of rendering an image: sampler, point set and filter, each as registry name and parameters.
///
/// ```
/// # use dapple_study::Method;
/// assert_eq!("mitchell:radius=2/halton".parse::<Method>()?, Method::new("mitchell:radius=2", "halton", "none"));
/// # Ok::<(), String>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Method {
    /// The sampler, such as `mitchell:mode=budget`; default `uniform`.
    pub sampler: String,
    /// The point set; default `sobol`.
    pub points: String,
    /// The filter (denoiser); default `none`.
    pub filter: String,
}

/// The budget of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RunBudget {
    /// This mean number of samples per pixel.
    Spp(u64),
    /// Equal time: as long as the baseline's run with this mean number of samples per pixel.
    TimeOf(u64),
}

impl Default for RunBudget {
    fn default() -> Self {
        Self::Spp(0)
    }
}

/// Formats a budget as `16 spp` or `time of 16 spp`.
impl fmt::Display for RunBudget {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Spp(spp) => write!(f, "{spp} spp"),
            Self::TimeOf(spp) => write!(f, "time of {spp} spp"),
        }
    }
}

impl RunBudget {
    /// Returns true for [`TimeOf`](Self::TimeOf), an equal-time budget.
    pub fn is_timed(self) -> bool {
        matches!(self, Self::TimeOf(_))
    }

    /// The number of samples per pixel in the budget; for equal time, the number in the baseline's run.
    pub fn spp(self) -> u64 {
        match self {
            Self::Spp(spp) | Self::TimeOf(spp) => spp,
        }
    }
}

/// Parses `SAMPLER[/POINTS[/FILTER]]`; the point set defaults to that of `dapple render`, the filter to `none`.
impl std::str::FromStr for Method {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let Self { points, filter, .. } = Self::default();
        match text.split('/').map(str::trim).collect::<Vec<_>>()[..] {
            [sampler] => Ok(Self::new(sampler, &points, &filter)),
            [sampler, points] => Ok(Self::new(sampler, points, &filter)),
            [sampler, points, filter] => Ok(Self::new(sampler, points, filter)),
            _ => Err(format!("\"{text}\" is not a method; write SAMPLER/POINTS/FILTER")),
        }
    }
}

/// Wall-clock seconds spent on each phase of a run; 0 for a phase that the method does not have.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Phases {
    /// Wall-clock seconds spent on reading the scene, which happens once for all runs of a process.
    pub load: f64,
    /// Wall-clock seconds spent on building the bounding volume hierarchy, which happens once for all runs of a process.
    pub bvh: f64,
    /// Wall-clock seconds spent on grouping triangles into clusters.
    pub cluster: f64,
    /// Wall-clock seconds spent on tracing first-hit rays before sampling.
    #[serde(alias = "probe")]
    pub first_hits: f64,
    /// Wall-clock seconds spent on planning sample counts, excluding first-hit rays.
    pub plan: f64,
    /// Wall-clock seconds spent on tracing the samples.
    pub trace: f64,
    /// Wall-clock seconds spent on filtering.
    pub filter: f64,
}

impl Method {
    /// Creates a method from registry names with parameters.
    pub fn new(sampler: &str, points: &str, filter: &str) -> Self {
        Self { sampler: sampler.into(), points: points.into(), filter: filter.into() }
    }
}

/// The method `uniform/sobol/none`.
impl Default for Method {
    fn default() -> Self {
        Self::new("uniform", dapple_job::DEFAULT_POINTS, "none")
    }
}

/// Formats a method as `SAMPLER/POINTS/FILTER`.
impl fmt::Display for Method {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}/{}", self.sampler, self.points, self.filter)
    }
}

/// The names of the phases of a run, in order.
pub(crate) const PHASES: [&str; 7] = ["load", "bvh", "cluster", "first_hits", "plan", "trace", "filter"];

impl Phases {
    /// The wall-clock seconds spent on each phase, in the order of [`PHASES`].
    pub(crate) fn each(&self) -> [f64; 7] {
        let Self { load, bvh, cluster, first_hits, plan, trace, filter } = *self;
        [load, bvh, cluster, first_hits, plan, trace, filter]
    }

    /// The wall-clock seconds of clustering, first-hit rays and filter, which do not grow with the number of samples.
    pub fn fixed(&self) -> f64 {
        self.cluster + self.first_hits + self.filter
    }

    /// The wall-clock seconds of all phases except `load` and `bvh`.
    pub fn render(&self) -> f64 {
        self.cluster + self.first_hits + self.plan + self.trace + self.filter
    }
}

/// The errors of an image against its reference: a value for each of [`METRICS`]; NaN means unknown.
///
/// In JSON, the errors are an object with the metrics' names as keys. A missing or `null` value is read as NaN, and an unknown
/// name is skipped, so that files of other versions can be read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImageErrors([f64; METRICS.len()]);

impl ImageErrors {
    /// The value of the metric `name`, such as `relmse`; NaN if the metric is unknown or has no value.
    pub fn get(&self, name: &str) -> f64 {
        METRICS.iter().position(|metric| metric.name == name).map_or(f64::NAN, |at| self.0[at])
    }

    /// Sets the value of the metric `name`; an unknown name has no effect.
    pub fn set(&mut self, name: &str, value: f64) {
        if let Some(at) = METRICS.iter().position(|metric| metric.name == name) {
            self.0[at] = value;
        }
    }
}

/// Errors that are all unknown (NaN).
impl Default for ImageErrors {
    fn default() -> Self {
        Self([f64::NAN; METRICS.len()])
    }
}

impl<N: AsRef<str>> FromIterator<(N, f64)> for ImageErrors {
    fn from_iter<I: IntoIterator<Item = (N, f64)>>(values: I) -> Self {
        let mut errors = Self::default();
        values.into_iter().for_each(|(name, value)| errors.set(name.as_ref(), value));
        errors
    }
}

impl Serialize for ImageErrors {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        to.collect_map(METRICS.iter().map(|metric| metric.name).zip(self.0))
    }
}

impl<'de> Deserialize<'de> for ImageErrors {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        let values = BTreeMap::<String, Option<f64>>::deserialize(from)?;
        Ok(values.into_iter().map(|(name, value)| (name, value.unwrap_or(f64::NAN))).collect())
    }
}

/// One finished run: a line of `runs.jsonl`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Run {
    /// The scene's name in the study.
    pub scene: String,
    /// The method: sampler, point set and filter.
    pub method: Method,
    /// The budget: mean samples per pixel, or equal time.
    pub budget: RunBudget,
    /// The seed of the point set.
    pub seed: u64,
    /// The total number of samples requested; a method with a stopping rule may use fewer.
    #[serde(default)]
    pub asked: u64,
    /// The total number of samples traced, excluding first-hit rays.
    pub samples: u64,
    /// The mean number of samples traced per pixel.
    pub spp: f64,
    /// The number of rays traced, first-hit rays included.
    pub rays: u64,
    /// Wall-clock seconds spent on each phase.
    pub seconds: Phases,
    /// Wall-clock seconds spent on the image: the sum of all phases except scene reading and BVH building.
    pub render_s: f64,
    /// CPU seconds (user and system) of the phases in `render_s`; `None` if unknown. An external filter adds the seconds that
    /// it reports, or else its wall-clock seconds.
    pub cpu_s: Option<f64>,
    /// The errors of the run's image against the reference.
    pub errors: ImageErrors,
    /// True if the reference's own variance was subtracted from `mse`, `relmse` and `srgb8_mse`.
    pub corrected: bool,
    /// True if the run's MSE or relMSE is below 100 times the error due to the reference's own variance. This variance then
    /// limits the precision of the measurement.
    pub reference_limited: bool,
    /// The relMSE that the render predicts for itself; `None` without a prediction.
    pub predicted_relmse: Option<f64>,
    /// The number of samples rejected as NaN, infinite or negative.
    pub rejected: u64,
    /// The machine's load average over the last minute before the run; `None` if the system does not report it.
    pub load: Option<f64>,
    /// True if the run was performed in a new process.
    pub fresh: bool,
    /// The path of the EXR image, relative to the study's folder; `None` for all seeds but the first.
    pub image: Option<String>,
    /// The path of the sample map (PNG of sample counts per pixel; white is the largest count), relative to the study's folder;
    /// `None` if it was not written.
    pub sample_map: Option<String>,
    /// The samples per pixel that white represents in the sample map; `None` without a map.
    #[serde(default)]
    pub white: Option<f64>,
}

impl Run {
    pub(crate) fn is_of(&self, scene: &str, method: &Method, budget: RunBudget, seed: u64) -> bool {
        self.scene == scene && self.method == *method && self.budget == budget && self.seed == seed
    }
}

/// The record of a scene's reference image.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ReferenceRecord {
    /// The path of the reference's file, relative to the study's folder or absolute.
    pub file: String,
    /// The reference's mean samples per pixel; `None` if unknown.
    pub spp: Option<u64>,
    /// The point set with which the reference was rendered; `None` if unknown.
    pub points: Option<String>,
    /// The seeds of the reference's two halves; `None` if unknown.
    pub seeds: Option<[u64; 2]>,
    /// The relMSE that the reference's own variance causes; `None` if unknown.
    pub relmse: Option<f64>,
    /// A hash of all settings and files that the reference depends on.
    pub hash: String,
}

/// A scene of a study, as recorded in the [`Manifest`].
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SceneRecord {
    /// The scene's name in the study.
    pub name: String,
    /// The name of a bundled scene, or the path of a scene file.
    pub source: String,
    /// Width and height of the scene's images in pixels.
    pub resolution: [u32; 2],
    /// The reference image with which runs are compared.
    pub reference: ReferenceRecord,
    /// The rule by which light sampling selects one of several lights.
    #[serde(default)]
    pub lights: LightSelection,
    /// The integrator; `auto` selects one for the scene.
    #[serde(default = "crate::scene::auto", skip_serializing_if = "crate::scene::is_auto")]
    pub integrator: String,
}

/// The machine on which a study ran.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Machine {
    /// The processor's name; `None` if unknown.
    pub processor: Option<String>,
    /// The number of rendering threads.
    pub threads: usize,
    /// The number of cores; `None` if unknown.
    #[serde(default)]
    pub cores: Option<usize>,
    /// The operating system and the processor architecture.
    pub system: String,
}

/// The contents of `study.json`: the settings and circumstances of a study.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// The version of Dapple.
    pub version: String,
    /// The git commit from which Dapple was built; `None` if unknown. A `+` at the end marks uncommitted changes.
    pub commit: Option<String>,
    /// The command line, argument by argument.
    pub command: Vec<String>,
    /// The time at which the study began, as RFC 3339 in UTC.
    pub began: String,
    /// The machine that runs the study.
    pub machine: Machine,
    /// The scenes in the order of their runs.
    pub scenes: Vec<SceneRecord>,
    /// The methods in the order of their runs.
    pub methods: Vec<Method>,
    /// The external programs that methods name as their filter.
    #[serde(default)]
    pub external: Vec<External>,
    /// The method with which the others are compared, one of `methods`.
    pub baseline: Method,
    /// The budgets in mean samples per pixel, ascending.
    pub spp: Vec<u64>,
    /// The budget, one of `spp`, that sets the time of equal-time runs: the time that the baseline takes at this
    /// budget. `None` if there are no equal-time runs.
    pub time_of: Option<u64>,
    /// The seeds; each scene, method and budget has one run per seed.
    pub seeds: Vec<u64>,
    /// The largest number of scattering events between camera and light; `None` uses each scene's own limit.
    #[serde(default)]
    pub max_depth: Option<u32>,
    /// True if each run was performed in a new process.
    #[serde(default)]
    pub fresh: bool,
    /// True if consecutive methods that differ only in their filter shared samples.
    #[serde(default)]
    pub share_samples: bool,
}

impl Manifest {
    /// All budgets: numbers of samples per pixel, then equal time.
    pub(crate) fn budgets(&self) -> impl DoubleEndedIterator<Item = RunBudget> {
        self.spp.iter().copied().map(RunBudget::Spp).chain(self.time_of.map(RunBudget::TimeOf))
    }
}

/// Replaces characters that are unsafe in a file name by `-`, and cuts `name` to 80 characters.
pub(crate) fn safe_file_name(name: &str) -> String {
    let plain = |c: char| if c.is_alphanumeric() || "-_.".contains(c) { c } else { '-' };
    name.chars().map(plain).take(80).collect()
}

/// The first name among `name`, `name-2`, `name-3`, … for which `is_free` returns `true`.
pub(crate) fn numbered(name: &str, is_free: impl Fn(&str) -> bool) -> String {
    let mut names = std::iter::once(name.to_owned()).chain((2..).map(|n| format!("{name}-{n}")));
    names.find(|name| is_free(name)).unwrap_or_default()
}

/// Unique names of all methods for files, such as `adaptive-cluster-regression`: sampler, point set (only if methods have
/// different point sets), and filter. If an earlier method has the same name, a number is appended.
pub(crate) fn method_file_names(methods: &[Method]) -> Vec<String> {
    let differ = methods.iter().any(|m| m.points != methods[0].points);
    let mut names: Vec<String> = Vec::new();
    for method in methods {
        let points = differ.then_some(&method.points);
        let parts = [Some(&method.sampler), points, Some(&method.filter)];
        let parts: Vec<&str> = parts.into_iter().flatten().map(String::as_str).collect();
        names.push(numbered(&safe_file_name(&parts.join("-")), |name| !names.iter().any(|known| known == name)));
    }
    names
}

/// The path of a run's image without extension, relative to the study's folder. `method` is the method's name from
/// [`method_file_names`].
pub(crate) fn image_stem(scene: &str, method: &str, budget: RunBudget) -> String {
    let budget = budget.to_string().replace(" spp", "spp").replace(' ', "-");
    format!("images/{}/{method}-{budget}", safe_file_name(scene))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn methods_have_unique_names_for_files() {
        let methods = [
            "adaptive/sobol/cluster-regression",
            "mitchell:mode=budget,radius=2",
            "mitchell:mode=budget/sobol/radius=2",
        ];
        let methods = methods.map(|m| m.parse::<Method>().unwrap());
        let twice = ["a:b".parse().unwrap(), "a-b".parse().unwrap()];
        let names = method_file_names(&methods);
        assert_eq!(names[..2], ["adaptive-cluster-regression", "mitchell-mode-budget-radius-2-none"]);
        assert_eq!(method_file_names(&twice), ["a-b-none", "a-b-none-2"]);
        let points = ["uniform/sobol".parse().unwrap(), "uniform/halton".parse().unwrap()];
        assert_eq!(method_file_names(&points), ["uniform-sobol-none", "uniform-halton-none"]);
        assert_eq!(
            image_stem("a b", &names[0], RunBudget::TimeOf(16)),
            "images/a-b/adaptive-cluster-regression-time-of-16spp"
        );
    }
}
