//! What a study is made of: scenes, methods, budgets, seeds; from words or from a TOML file.

mod file;
mod words;

pub use words::split_words;

use crate::{External, Method};
use dapple_core::PointSet;
use dapple_job::registry::{self, Setting};
use dapple_renderer::light::LightSelection;
use serde::Deserialize;
use std::collections::BTreeSet;
use std::path::PathBuf;

/// What is wrong with a plan. Each message says what to do.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{}{key}: {what}", place.as_ref().map_or_else(String::new, |p| format!("{p}: ")))]
#[non_exhaustive]
pub struct PlanError {
    /// File and line, where the plan is a file's.
    pub place: Option<String>,
    /// The setting, as the TOML file calls it (`_` is `-` on the command line).
    pub key: String,
    /// The offending word.
    pub word: Option<String>,
    /// What is wrong and what to do.
    pub what: String,
}

impl PlanError {
    pub(crate) fn new(key: &str, what: impl ToString) -> Self {
        Self { place: None, key: key.to_owned(), word: None, what: what.to_string() }
    }

    fn of_word(key: &str, word: &str, what: impl ToString) -> Self {
        Self { word: Some(word.to_owned()), ..Self::new(key, what) }
    }
}

/// A scene to study.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ScenePlan {
    /// Bundled name or path.
    pub source: String,
    /// Its name in the study; else made from the source.
    pub name: Option<String>,
    /// A file to compare with; else a reference is rendered.
    pub reference: Option<PathBuf>,
    /// Width and height of this scene, where they are not those of the study.
    pub resolution: Option<[u32; 2]>,
    /// How a light is chosen among several.
    pub lights: LightSelection,
}

impl From<&str> for ScenePlan {
    fn from(source: &str) -> Self {
        Self { source: source.to_owned(), ..Self::default() }
    }
}

/// What is said about a study; what is not said gets its default in [`Draft::resolve`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Draft {
    /// Scenes; default [`DEFAULT_SCENES`].
    pub scenes: Option<Vec<ScenePlan>>,
    /// Samplers; default [`DEFAULT_SAMPLERS`].
    pub samplers: Option<Vec<String>>,
    /// Point sets, each with each sampler and filter; default `sobol`.
    pub points: Option<Vec<String>>,
    /// Filters; default [`DEFAULT_FILTERS`].
    pub filters: Option<Vec<String>>,
    /// Methods besides samplers x points x filters. Where these are given and no samplers, they are all.
    pub methods: Option<Vec<Method>>,
    /// Filters that are programs of others, by the names under which methods have them.
    pub external: Option<Vec<External>>,
    /// What others are compared with; default uniform / sobol / none. Put in front where it is not among the methods.
    pub baseline: Option<Method>,
    /// Budgets in samples per pixel; default [`DEFAULT_SPP`].
    pub spp: Option<Vec<u64>>,
    /// Seeds; default 1 to 8.
    pub seeds: Option<Vec<u64>>,
    /// Samples per pixel of references that are rendered; default [`DEFAULT_REFERENCE_SPP`].
    pub reference_spp: Option<u64>,
    /// Width and height; default the reference file's, else [`DEFAULT_SIDE`] squared.
    pub resolution: Option<[u32; 2]>,
    /// Most scattering events between camera and light; default each scene's.
    pub max_depth: Option<u32>,
    /// Threads, 0 for one per core (the default).
    pub threads: Option<usize>,
    /// Equal-time runs get the time that the baseline takes with so many samples per pixel, one of `spp`; 0 for none;
    /// default the largest but one.
    pub time_of: Option<u64>,
    /// A process for each run; default no.
    pub fresh: Option<bool>,
    /// List what the renderer cannot do as warnings, rather than refusing the scene.
    pub allow_unsupported: Option<bool>,
    /// Smaller defaults, for a look in under a minute: what is said is not touched.
    pub quick: Option<bool>,
}

/// Scenes of a study where none are named: bundled ones.
pub const DEFAULT_SCENES: [&str; 2] = ["teapot", "terrain"];
/// Samplers where none are named.
pub const DEFAULT_SAMPLERS: [&str; 3] = ["uniform", "variance", "cluster-thesis"];
/// Filters where none are named.
pub const DEFAULT_FILTERS: [&str; 2] = ["none", "gaussian"];
/// Budgets where none are given.
pub const DEFAULT_SPP: [u64; 4] = [4, 8, 16, 32];
/// How many seeds where none are given: the fewest that STATISTICS' intervals are for.
pub const DEFAULT_SEEDS: u64 = 8;
/// Samples per pixel of a reference, where not given.
pub const DEFAULT_REFERENCE_SPP: u64 = 1024;
/// Pixels along a side, where no resolution is given.
pub const DEFAULT_SIDE: u32 = 128;

/// A study, every setting decided and checked as far as that goes without reading a scene.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Plan {
    /// Scenes in their order, at least one.
    pub scenes: Vec<ScenePlan>,
    /// Methods in their order, each once.
    pub methods: Vec<Method>,
    /// Filters of methods that are programs of others.
    pub external: Vec<External>,
    /// One of them.
    pub baseline: Method,
    /// Ascending.
    pub spp: Vec<u64>,
    /// Each once.
    pub seeds: Vec<u64>,
    /// Even.
    pub reference_spp: u64,
    /// `None`: a reference file's, else [`side`](Self::side) squared.
    pub resolution: Option<[u32; 2]>,
    /// Pixels along a side where neither resolution nor reference file say.
    pub side: u32,
    /// `None` follows each scene.
    pub max_depth: Option<u32>,
    /// 0 is one per core.
    pub threads: usize,
    /// One of `spp`.
    pub time_of: Option<u64>,
    /// A process for each run.
    pub fresh: bool,
    /// Whether unsupported directives are warnings.
    pub allow_unsupported: bool,
}

impl Draft {
    /// This draft, with what `other` says in the place of what this one says; its resolution is that of all scenes.
    pub fn overridden_by(self, other: Self) -> Self {
        let mut scenes = other.scenes.or(self.scenes);
        if other.resolution.is_some() {
            scenes.iter_mut().flatten().for_each(|scene| scene.resolution = None);
        }
        Self {
            scenes,
            samplers: other.samplers.or(self.samplers),
            points: other.points.or(self.points),
            filters: other.filters.or(self.filters),
            methods: other.methods.or(self.methods),
            external: other.external.or(self.external),
            baseline: other.baseline.or(self.baseline),
            spp: other.spp.or(self.spp),
            seeds: other.seeds.or(self.seeds),
            reference_spp: other.reference_spp.or(self.reference_spp),
            resolution: other.resolution.or(self.resolution),
            max_depth: other.max_depth.or(self.max_depth),
            threads: other.threads.or(self.threads),
            time_of: other.time_of.or(self.time_of),
            fresh: other.fresh.or(self.fresh),
            allow_unsupported: other.allow_unsupported.or(self.allow_unsupported),
            quick: other.quick.or(self.quick),
        }
    }

    /// Decides on every setting.
    ///
    /// # Errors
    ///
    /// For unknown names (which lists those there are), empty lists, and numbers out of range; the first found.
    pub fn resolve(self) -> Result<Plan, PlanError> {
        let quick = self.quick.unwrap_or(false);
        let owned = |words: &[&str]| words.iter().map(|w| (*w).to_owned()).collect::<Vec<_>>();
        let scenes = self.scenes.unwrap_or_else(|| DEFAULT_SCENES.iter().map(|s| ScenePlan::from(*s)).collect());
        filled("scenes", &scenes)?;
        let sampled = self.samplers.is_some() || self.methods.is_none();
        let samplers = match self.samplers {
            Some(samplers) => samplers,
            None if sampled => owned(&DEFAULT_SAMPLERS),
            None => Vec::new(),
        };
        let points = self.points.unwrap_or_else(|| owned(&["sobol"]));
        let filters = self.filters.unwrap_or_else(|| owned(&DEFAULT_FILTERS));
        let spp = self.spp.unwrap_or_else(|| if quick { vec![4, 8, 16] } else { DEFAULT_SPP.to_vec() });
        let spp = ascending("spp", spp)?;
        let most = spp.last().copied().unwrap_or(1);
        if sampled {
            filled("samplers", &samplers)?;
            filled("points", &points)?;
            filled("filters", &filters)?;
        }
        let mut all = Vec::new();
        for sampler in &samplers {
            for points in &points {
                all.extend(filters.iter().map(|filter| Method::new(sampler, points, filter)));
            }
        }
        all.extend(self.methods.unwrap_or_default());
        let external = self.external.unwrap_or_default();
        check_external(&external)?;
        let mut methods: Vec<Method> = Vec::new();
        for method in all {
            check_method(&method, most, &external)?;
            if methods.contains(&method) {
                let word = method.sampler.clone();
                return Err(PlanError::of_word("methods", &word, format!("{method} is given twice: once is enough")));
            }
            methods.push(method);
        }
        let baseline = self.baseline.unwrap_or_else(|| Method::new("uniform", "sobol", "none"));
        check_method(&baseline, most, &external).map_err(|e| PlanError { key: "baseline".into(), ..e })?;
        if !methods.contains(&baseline) {
            methods.insert(0, baseline.clone());
        }
        let default_seeds = if quick { 4 } else { DEFAULT_SEEDS };
        let seeds = self.seeds.unwrap_or_else(|| (1..=default_seeds).collect());
        filled("seeds", &seeds)?;
        if seeds.iter().collect::<BTreeSet<_>>().len() < seeds.len() {
            return Err(PlanError::new("seeds", "a seed is given twice: it would make the same image again"));
        }
        let time_of = match self.time_of {
            Some(0) => None,
            Some(n) if spp.contains(&n) => Some(n),
            Some(n) => {
                let known = list(&spp);
                let what = format!(
                    "{n} is none of the spp ({known}): the baseline's time is known for those only; 0 leaves equal-time runs out"
                );
                return Err(PlanError::new("time_of", what));
            }
            None => Some(spp[spp.len().saturating_sub(2)]),
        };
        let reference_spp = self.reference_spp.unwrap_or(DEFAULT_REFERENCE_SPP);
        if !(2..=1 << 32).contains(&reference_spp) {
            return Err(PlanError::new(
                "reference_spp",
                format!("{reference_spp}: from 2 to 2^32 are wanted, half of them for each half of the reference"),
            ));
        }
        for [w, h] in scenes.iter().filter_map(|scene| scene.resolution).chain(self.resolution) {
            dapple_core::Frame::new(w, h).map_err(|e| PlanError::new("resolution", e))?;
        }
        let threads = self.threads.unwrap_or(0);
        if threads > 1024 {
            return Err(PlanError::new("threads", format!("{threads}: from 0 (one per core) to 1024 are wanted")));
        }
        Ok(Plan {
            scenes,
            methods,
            external,
            baseline,
            spp,
            seeds,
            reference_spp: reference_spp.next_multiple_of(2),
            resolution: self.resolution,
            side: if quick { 64 } else { DEFAULT_SIDE },
            max_depth: self.max_depth,
            threads,
            time_of,
            fresh: self.fresh.unwrap_or(false),
            allow_unsupported: self.allow_unsupported.unwrap_or(false),
        })
    }
}

impl Plan {
    /// How many runs there are.
    pub fn runs(&self) -> usize {
        let budgets = self.spp.len() + usize::from(self.time_of.is_some());
        self.scenes.len() * self.methods.len() * budgets * self.seeds.len()
    }
}

/// Makes all three for trial: what is wrong with the words is known before anything is read.
fn check_method(method: &Method, spp: u64, external: &[External]) -> Result<(), PlanError> {
    let Method { sampler, points, filter } = method;
    registry::check_sampler(sampler).map_err(|e| PlanError::of_word("samplers", sampler, e))?;
    if !external.iter().any(|e| e.name == *filter) {
        registry::check_filter(filter).map_err(|e| PlanError::of_word("filters", filter, e))?;
    }
    let refuse = |what: String| PlanError::of_word("points", points, what);
    let made = registry::points(points, Setting { seed: 0, spp: Some(spp) }).map_err(|e| refuse(e.to_string()))?;
    if spp > made.capacity() {
        return Err(refuse(format!("{points} has {} points a pixel, fewer than {spp} spp", made.capacity())));
    }
    Ok(())
}

/// Names that are nobody else's, and commands that are told what to read and what to write.
fn check_external(external: &[External]) -> Result<(), PlanError> {
    for (at, one) in external.iter().enumerate() {
        let refuse = |what: &str| Err(PlanError::of_word("external", &one.name, format!("{:?}: {what}", one.name)));
        if one.name.is_empty() || one.name.contains(|c: char| "/:,=".contains(c) || c.is_whitespace()) {
            return refuse("a name without blanks and / : , = is wanted");
        }
        if registry::FILTERS.iter().any(|entry| entry.name == one.name) {
            return refuse("a filter of ours has that name: choose another");
        }
        if external[..at].iter().any(|other| other.name == one.name) {
            return refuse("the name is given twice");
        }
        let told = |mark: &str| one.command.iter().skip(1).any(|word| word.contains(mark));
        if !(told("{input}") && told("{output}")) {
            return refuse(
                "the command is to hold a program, {input} and {output}, for the images it reads and writes",
            );
        }
    }
    Ok(())
}

fn filled<T>(key: &str, list: &[T]) -> Result<(), PlanError> {
    if list.is_empty() {
        Err(PlanError::new(key, "the list is empty: leave it out to have the default"))
    } else {
        Ok(())
    }
}

fn ascending(key: &str, mut spp: Vec<u64>) -> Result<Vec<u64>, PlanError> {
    filled(key, &spp)?;
    spp.sort_unstable();
    if spp.windows(2).any(|pair| pair[0] == pair[1]) {
        return Err(PlanError::new(key, "a number is given twice: once is enough"));
    }
    match spp.iter().find(|n| !(1..=u64::from(u32::MAX)).contains(*n)) {
        Some(n) => Err(PlanError::new(key, format!("{n}: from 1 to 2^32 - 1 samples per pixel are wanted"))),
        None => Ok(spp),
    }
}

fn list(numbers: &[u64]) -> String {
    numbers.iter().map(u64::to_string).collect::<Vec<_>>().join(", ")
}

/// `SAMPLER[/POINTS[/FILTER]]`; `sobol` and `none` where left out.
impl std::str::FromStr for Method {
    type Err = PlanError;

    fn from_str(words: &str) -> Result<Self, PlanError> {
        let parts: Vec<&str> = words.split('/').map(str::trim).collect();
        match parts[..] {
            [sampler] => Ok(Self::new(sampler, "sobol", "none")),
            [sampler, points] => Ok(Self::new(sampler, points, "none")),
            [sampler, points, filter] => Ok(Self::new(sampler, points, filter)),
            _ => Err(PlanError::of_word("methods", words, format!("{words}: SAMPLER/POINTS/FILTER is wanted"))),
        }
    }
}

/// A resolution as a word: `WxH`.
pub(crate) fn parse_resolution(word: &str) -> Result<[u32; 2], String> {
    let sides = word.split_once(['x', 'X']).and_then(|(w, h)| Some([w.trim().parse().ok()?, h.trim().parse().ok()?]));
    sides.ok_or_else(|| "WIDTHxHEIGHT in pixels is wanted, such as 128x128".into())
}

/// So many seeds, or these.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(untagged, expecting = "a number of seeds, or a list of seeds")]
pub(crate) enum Seeds {
    Count(u64),
    List(Vec<u64>),
}

impl Seeds {
    /// 1 to the count, or the list.
    pub(crate) fn list(self) -> Vec<u64> {
        match self {
            // Never so many that memory ends before the plan is read.
            Self::Count(n) => (1..=n.min(100_000)).collect(),
            Self::List(list) => list,
        }
    }
}
