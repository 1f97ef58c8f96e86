//! The plan of a study: its scenes, methods, budgets and seeds, from a TOML file, `--set key=value`, or code.

mod values;

use crate::scene::name_of;
use crate::{External, Method, StudyError};
use dapple_core::PointSet;
use dapple_job::registry::{self, PointSettings};
use dapple_renderer::light::LightSelection;
use serde::Deserialize;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use toml::{Spanned, Table, Value};

/// An error in a plan. Each message names the setting and the remedy.
#[derive(Clone, Debug, Default, PartialEq, Eq, thiserror::Error)]
#[error("{}{}{message}", place.as_ref().map_or_else(String::new, |p| format!("{p}: ")), if key.is_empty() { String::new() } else { format!("{key}: ") })]
#[non_exhaustive]
pub struct PlanError {
    /// The place of the error, `FILE:LINE` or `--set KEY=VALUE`; `None` for a plan from code.
    pub place: Option<String>,
    /// The key of the wrong setting; empty if the message names it.
    pub key: String,
    /// The wrong text, such as an unknown name; `None` for other errors.
    pub value: Option<String>,
    /// The message: the error and its remedy.
    pub message: String,
}

impl PlanError {
    pub(crate) fn new(key: &str, message: impl ToString) -> Self {
        Self { key: key.to_owned(), message: message.to_string(), ..Self::default() }
    }

    fn of_value(key: &str, value: &str, message: impl ToString) -> Self {
        Self { value: Some(value.to_owned()), ..Self::new(key, message) }
    }

    fn at(place: String, message: impl ToString) -> Self {
        Self { place: Some(place), ..Self::new("", message) }
    }

    fn unless(holds: bool, key: &str, message: impl ToString) -> Result<(), Self> {
        if holds { Ok(()) } else { Err(Self::new(key, message)) }
    }
}

/// A scene of a study, with its reference image and the settings that apply to this scene only.
///
/// In a plan file, a scene is a table with these fields as keys, or the text of `source` alone.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScenePlan {
    /// The name of a bundled scene, or the path of a scene file.
    pub source: String,
    /// The scene's name in the study; `None` uses the file stem of `source`, or the folder's name for `scene*` files.
    pub name: Option<String>,
    /// The file of the reference image; `None` renders a reference.
    pub reference: Option<PathBuf>,
    /// Width and height of this scene's images in pixels; `None` uses the study's resolution.
    #[serde(default, deserialize_with = "values::resolution")]
    pub resolution: Option<[u32; 2]>,
    /// The rule by which light sampling selects one of several lights; `None` uses the study's rule.
    #[serde(alias = "light_choice")]
    pub lights: Option<LightSelection>,
    /// The integrator, `NAME` or `NAME:key=value,…`; `None` selects one for the scene. References are always rendered with the
    /// integrator selected for the scene.
    pub integrator: Option<String>,
}

impl FromStr for ScenePlan {
    type Err = std::convert::Infallible;

    fn from_str(source: &str) -> Result<Self, Self::Err> {
        Ok(Self { source: source.to_owned(), ..Self::default() })
    }
}

/// The settings of a study as written in a plan. [`resolve`](Self::resolve) checks them and returns a [`Plan`].
///
/// Fields are the keys of the TOML file.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PlanSettings {
    /// The scenes; default teapot and terrain, both bundled with Dapple.
    #[serde(deserialize_with = "values::list")]
    pub scenes: Vec<ScenePlan>,
    /// The names of the `scenes` to use; default all.
    pub only: Vec<String>,
    /// The samplers (how many samples each pixel gets), each combined with every point set and filter. Default: if `methods` is
    /// set, no samplers; otherwise two, the default sampler of `dapple render` and `uniform`.
    pub samplers: Option<Vec<String>>,
    /// The point sets (where samples lie), each combined with every sampler and filter; default `sobol`.
    pub points: Vec<String>,
    /// The filters (denoisers), each combined with every sampler and point set. Default: both the default filter of
    /// `dapple render` and `none`.
    pub filters: Vec<String>,
    /// Methods in addition to samplers x points x filters, or the only methods if no samplers are set. In a plan, each is
    /// `SAMPLER/POINTS/FILTER` or a table.
    #[serde(deserialize_with = "values::list")]
    pub methods: Vec<Method>,
    /// External programs, which methods can name as their filter.
    pub external: Vec<External>,
    /// The method with which the others are compared; default uniform/sobol/none. If it is not one of the methods, it is added
    /// as the first one.
    #[serde(deserialize_with = "values::one")]
    pub baseline: Method,
    /// The budgets in mean samples per pixel; default 4, 8, 16 and 32.
    pub spp: Option<Vec<u64>>,
    /// The seeds; default 1 to 8. Each scene, method and budget has one run per seed. In a plan: the number of seeds, or a list
    /// of them.
    #[serde(deserialize_with = "values::seeds")]
    pub seeds: Option<Vec<u64>>,
    /// The budget, one of `spp`, that sets the time of equal-time runs: every method gets the time that the baseline takes at
    /// this budget. 0 means no equal-time runs; the default is the second largest budget, or the only one.
    pub time_of: Option<u64>,
    /// If true, the default budgets, seeds and resolution are smaller, so that the study takes less than a minute.
    pub quick: bool,
    /// Width and height of images in pixels; default: the size of the scene's reference file, or 128x128 without one. In a
    /// plan, `[128, 128]` or `128x128`.
    #[serde(deserialize_with = "values::resolution")]
    pub resolution: Option<[u32; 2]>,
    /// The largest number of scattering events between camera and light; default each scene's own limit.
    pub max_depth: Option<u32>,
    /// Samples per pixel of rendered reference images, from 2 to 2^32, rounded up to an even number; default 1024.
    pub reference_spp: u64,
    /// The rule by which light sampling selects one of several lights; default that of `dapple render`.
    pub lights: LightSelection,
    /// The number of threads, at most 1024; 0, the default, means one per core.
    pub threads: usize,
    /// If true, each run is performed in a new process.
    pub fresh: bool,
    /// If true, consecutive methods that differ only in their filter share samples, which are traced once. If a filter requires
    /// statistics that were not recorded, the samples are traced again. The time of each method includes the tracing.
    pub share_samples: bool,
    /// If true, unsupported directives of scene files are warnings, not errors.
    pub allow_unsupported: bool,
}

impl Default for PlanSettings {
    fn default() -> Self {
        let names = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect();
        let scene = |name: &str| ScenePlan { source: name.to_owned(), ..ScenePlan::default() };
        Self {
            scenes: ["teapot", "terrain"].map(scene).to_vec(),
            only: Vec::new(),
            samplers: None,
            points: names(&[dapple_job::DEFAULT_POINTS]),
            filters: names(&[dapple_job::DEFAULT_FILTER, "none"]),
            methods: Vec::new(),
            external: Vec::new(),
            baseline: Method::default(),
            spp: None,
            seeds: None,
            time_of: None,
            quick: false,
            resolution: None,
            max_depth: None,
            reference_spp: 1024,
            lights: dapple_job::RenderSpec::new("").selection(),
            threads: 0,
            fresh: false,
            share_samples: false,
            allow_unsupported: false,
        }
    }
}

/// A complete plan of a study: every setting has a value. Values are not checked against the scene files yet.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Plan {
    /// The scenes in the order of their runs, at least one.
    pub scenes: Vec<ScenePlan>,
    /// The methods in the order of their runs, without repetitions; they include the baseline.
    pub methods: Vec<Method>,
    /// The budgets in mean samples per pixel, ascending.
    pub spp: Vec<u64>,
    /// The seeds, without repetitions.
    pub seeds: Vec<u64>,
    /// The budget, one of `spp`, that sets the time of equal-time runs; `None` means no equal-time runs.
    pub time_of: Option<u64>,
    /// The side in pixels of square images, used for scenes with neither a resolution nor a reference file.
    pub side: u32,
    /// The settings from which the plan was made.
    pub settings: PlanSettings,
}

impl Plan {
    /// Reads a plan from a TOML file, or uses the defaults if `file` is `None`. Each string `KEY=VALUE` in `sets` replaces a
    /// setting. Paths in the file are relative to the file's folder.
    ///
    /// A value has TOML's syntax, or is text without quotes. A single value is accepted for a list. A dot selects a key within
    /// a table, as in `baseline.filter=nlm`. `resolution` and `lights` in `sets` apply to every scene.
    ///
    /// ```
    /// # use dapple_study::Plan;
    /// let plan = Plan::read(None, &["spp=[8, 16]".into(), "scenes=cornell".into(), "seeds=4".into()])?;
    /// assert_eq!((plan.spp, plan.seeds, plan.scenes.len()), (vec![8, 16], vec![1, 2, 3, 4], 1));
    /// # Ok::<(), dapple_study::StudyError>(())
    /// ```
    ///
    /// # Errors
    /// [`StudyError`] for a file that cannot be read, and the errors of [`parse`](Self::parse).
    pub fn read(file: Option<&Path>, sets: &[String]) -> Result<Self, StudyError> {
        /// The largest size of a plan in bytes.
        const LONGEST: u64 = 16 << 20;
        let Some(file) = file else { return Ok(Self::parse("", Path::new(""), sets)?) };
        let text = dapple_job::read_text(file, LONGEST).map_err(|e| StudyError::file(file, "read the plan", e))?;
        Ok(Self::parse(&text, file, sets)?)
    }

    /// Parses a plan from TOML text and the replacements `sets`, as [`read`](Self::read) does. Errors contain the path `file`.
    ///
    /// # Errors
    /// [`PlanError`] with file and line for text that is not TOML, an unknown key, a value of the wrong type, or a value
    /// that [`PlanSettings::resolve`] refuses.
    pub fn parse(text: &str, file: &Path, sets: &[String]) -> Result<Self, PlanError> {
        let place = |line: usize| format!("{}:{line}", file.display());
        let wrong = |e: toml::de::Error| {
            let before = e.span().map_or(0, |span| text[..span.start.min(text.len())].matches('\n').count());
            PlanError::at(place(1 + before), e.message())
        };
        let mut settings: PlanSettings = toml::from_str(text).map_err(wrong)?;
        let mut table: Table = toml::from_str(text).map_err(wrong)?;
        let mut replaced: BTreeMap<String, &String> = BTreeMap::new();
        for set in sets {
            let refuse = |message: &dyn fmt::Display| PlanError::at(format!("--set {set}"), message);
            let key = assign(&mut table, set).map_err(|e| refuse(&e))?;
            settings = PlanSettings::deserialize(table.clone()).map_err(|e| refuse(&e.message()))?;
            let _ = replaced.insert(key, set);
        }
        let folder = file.parent().unwrap_or(Path::new(""));
        if table.contains_key("scenes") && !replaced.contains_key("scenes") {
            settings.scenes.iter_mut().for_each(|scene| scene.make_relative_to(folder));
        }
        if !replaced.contains_key("external") {
            settings.external.iter_mut().for_each(|external| external.folder = folder.join(&external.folder));
        }
        for scene in &mut settings.scenes {
            scene.resolution = scene.resolution.filter(|_| !replaced.contains_key("resolution"));
            scene.lights = scene.lights.filter(|_| !replaced.contains_key("lights"));
        }
        settings.resolve().map_err(|e| {
            // An error in one of `methods` has the key of the wrong part, such as `points`.
            let keys = [e.key.as_str(), "methods"];
            let set = keys.iter().find_map(|key| replaced.get(*key)).map(|set| format!("--set {set}"));
            let line = || keys.iter().find_map(|key| line_of(text, key, e.value.as_deref()));
            PlanError { place: set.or_else(|| line().map(place)), ..e }
        })
    }

    /// The number of runs in the study, including equal-time runs.
    pub fn runs(&self) -> usize {
        let budgets = self.spp.len() + usize::from(self.time_of.is_some());
        self.scenes.len() * self.methods.len() * budgets * self.seeds.len()
    }
}

/// The line number on which a key's value begins. If `value` occurs from there on, the line of its first occurrence.
fn line_of(text: &str, key: &str, value: Option<&str>) -> Option<usize> {
    let values: BTreeMap<String, Spanned<Value>> = toml::from_str(text).ok()?;
    let start = values.get(key)?.span().start;
    let within = value.and_then(|value| text[start..].find(value)).unwrap_or(0);
    Some(1 + text[..start + within].matches('\n').count())
}

/// The lists for which `--set` also accepts a single value.
const LISTS: [&str; 7] = ["scenes", "only", "samplers", "points", "filters", "methods", "spp"];

/// Assigns the value in `KEY=VALUE` to a key, which may lie within nested tables (`A.B.C=VALUE`). Returns the outermost key.
fn assign(table: &mut Table, set: &str) -> Result<String, String> {
    let (path, text) = set.split_once('=').ok_or("this is not a setting; write KEY=VALUE, such as seeds=4")?;
    let text = text.trim();
    let value = match toml::from_str::<Table>(&format!("value = {text}")) {
        Ok(mut parsed) if parsed.len() == 1 => parsed.remove("value").unwrap_or(Value::Boolean(false)),
        Err(e) if text.starts_with(['[', '{', '"', '\'']) => {
            return Err(format!("{}; write a TOML value, such as '[\"a\", \"b\"]'", e.message()));
        }
        _ => Value::String(text.to_owned()),
    };
    let keys: Vec<&str> = path.split('.').map(str::trim).collect();
    let (last, tables) = keys.split_last().ok_or("the key is missing; write KEY=VALUE, such as seeds=4")?;
    let value = if LISTS.contains(&path.trim()) && !value.is_array() { Value::Array(vec![value]) } else { value };
    let mut inner = table;
    for key in tables {
        let entry = inner.entry((*key).to_owned()).or_insert_with(|| Value::Table(Table::new()));
        inner = entry.as_table_mut().ok_or_else(|| format!("{key} is not a table; set the whole key"))?;
    }
    let _ = inner.insert((*last).to_owned(), value);
    Ok(keys[0].to_owned())
}

impl ScenePlan {
    fn make_relative_to(&mut self, folder: &Path) {
        let path = folder.join(&self.source);
        // A bundled scene's name stays a name, unless a file of that name exists.
        if path.exists() || !dapple_scene::bundled::names().contains(&self.source.as_str()) {
            self.source = path.display().to_string();
        }
        self.reference = self.reference.take().map(|file| folder.join(file));
    }
}

impl PlanSettings {
    /// Checks the settings, and returns the plan.
    ///
    /// # Errors
    ///
    /// [`PlanError`] for the first unknown name, empty list or number out of range. The message lists the known names.
    pub fn resolve(mut self) -> Result<Plan, PlanError> {
        let spp = self.spp.clone().unwrap_or_else(|| if self.quick { vec![4, 8, 16] } else { vec![4, 8, 16, 32] });
        let spp = ascending(spp)?;
        let scenes = self.taken_scenes()?;
        let own = scenes.iter().filter_map(|scene| Some(("scenes", scene.resolution?)));
        for (key, [w, h]) in own.chain(self.resolution.map(|size| ("resolution", size))) {
            dapple_core::Frame::new(w, h).map_err(|e| PlanError::new(key, e))?;
        }
        check_external(&self.external)?;
        let most = spp.last().copied().unwrap_or(1);
        let mut methods = self.all_methods()?;
        for (at, method) in methods.iter().enumerate() {
            check_method(method, most, &self.external)?;
            if methods[..at].contains(method) {
                let message = format!("\"{method}\" is given twice; remove one");
                return Err(PlanError::of_value("methods", &method.sampler, message));
            }
        }
        let baseline = &self.baseline;
        check_method(baseline, most, &self.external).map_err(|e| PlanError { key: "baseline".into(), ..e })?;
        if !methods.contains(baseline) {
            methods.insert(0, baseline.clone());
        }
        let seeds = self.seeds.clone().unwrap_or_else(|| (1..=if self.quick { 4 } else { 8 }).collect());
        filled("seeds", &seeds)?;
        let twice = "a seed is given twice and would make the same image again; remove one";
        PlanError::unless(seeds.iter().collect::<BTreeSet<_>>().len() == seeds.len(), "seeds", twice)?;
        let time_of = equal_time_budget(self.time_of, &spp)?;
        self.check_numbers()?;
        self.reference_spp = self.reference_spp.next_multiple_of(2);
        Ok(Plan { scenes, methods, spp, seeds, time_of, side: if self.quick { 64 } else { 128 }, settings: self })
    }

    /// The scenes listed in `only`, in that order; all scenes if `only` is empty.
    fn taken_scenes(&self) -> Result<Vec<ScenePlan>, PlanError> {
        filled("scenes", &self.scenes)?;
        if self.only.is_empty() {
            return Ok(self.scenes.clone());
        }
        let name = |scene: &ScenePlan| scene.name.clone().unwrap_or_else(|| name_of(&scene.source));
        let known = || self.scenes.iter().map(name).collect::<Vec<_>>().join(", ");
        let find = |wanted: &String| {
            let unknown = || format!("no scene of the plan is called \"{wanted}\"; choose among {}", known());
            let found = self.scenes.iter().find(|scene| name(scene) == *wanted).cloned();
            found.ok_or_else(|| PlanError::of_value("only", wanted, unknown()))
        };
        self.only.iter().map(find).collect()
    }

    /// All combinations of samplers, point sets and filters, followed by the methods that are listed individually.
    fn all_methods(&self) -> Result<Vec<Method>, PlanError> {
        let samplers = match &self.samplers {
            Some(samplers) => samplers.clone(),
            None if self.methods.is_empty() => vec![dapple_job::DEFAULT_SAMPLER.to_owned(), "uniform".to_owned()],
            None => return Ok(self.methods.clone()),
        };
        for (key, list) in [("samplers", &samplers), ("points", &self.points), ("filters", &self.filters)] {
            filled(key, list)?;
        }
        let mut methods = Vec::new();
        for (sampler, points) in samplers.iter().flat_map(|one| self.points.iter().map(move |points| (one, points))) {
            methods.extend(self.filters.iter().map(|filter| Method::new(sampler, points, filter)));
        }
        methods.extend(self.methods.iter().cloned());
        Ok(methods)
    }

    fn check_numbers(&self) -> Result<(), PlanError> {
        let Self { reference_spp: spp, threads, .. } = *self;
        let message = format!("{spp} is out of range; use 2 to 2^32 (the two halves of the reference get half each)");
        PlanError::unless((2..=1 << 32).contains(&spp), "reference_spp", message)?;
        let message = format!("{threads} is out of range; use 0 (one per core) to 1024");
        PlanError::unless(threads <= 1024, "threads", message)?;
        let message = "runs in new processes (fresh = true) cannot share samples; set either fresh or share_samples";
        PlanError::unless(!(self.share_samples && self.fresh), "share_samples", message)?;
        for integrator in self.scenes.iter().filter_map(|scene| scene.integrator.as_deref()) {
            dapple_job::check_integrator(integrator).map_err(|e| PlanError::of_value("scenes", integrator, e))?;
        }
        Ok(())
    }
}

/// Creates the method's sampler, point set and filter once, so that wrong names are found before a scene is read.
fn check_method(method: &Method, spp: u64, external: &[External]) -> Result<(), PlanError> {
    let Method { sampler, points, filter } = method;
    registry::check_sampler(sampler).map_err(|e| PlanError::of_value("samplers", sampler, e))?;
    if !external.iter().any(|e| e.name == *filter) {
        registry::check_filter(filter).map_err(|e| PlanError::of_value("filters", filter, e))?;
    }
    let refuse = |message: String| PlanError::of_value("points", points, message);
    let made =
        registry::points(points, PointSettings { seed: 0, spp: Some(spp) }).map_err(|e| refuse(e.to_string()))?;
    let capacity = made.capacity();
    let needs =
        || refuse(format!("\"{points}\" has only {capacity} points per pixel, fewer than {spp} spp need; lower spp"));
    if spp <= capacity { Ok(()) } else { Err(needs()) }
}

/// Checks that names of external programs are unique, and that their commands contain `{input}` and `{output}`.
fn check_external(external: &[External]) -> Result<(), PlanError> {
    for (at, one) in external.iter().enumerate() {
        let name = &one.name;
        let refuse = |what: &str| PlanError::of_value("external", name, format!("{name:?}: {what}"));
        let require = |holds: bool, what: &str| if holds { Ok(()) } else { Err(refuse(what)) };
        let odd = name.contains(|c: char| "/:,=".contains(c) || c.is_whitespace());
        require(!name.is_empty() && !odd, "not a valid name; use a name without spaces and / : , =")?;
        // Filters of optional features do not reserve their names, so that a plan means the same with and without the feature.
        let built_in = registry::FILTERS.iter().any(|entry| entry.feature.is_none() && entry.name == *name);
        require(!built_in, "a built-in filter has this name; choose another name")?;
        let twice = external[..at].iter().any(|other| other.name == *name);
        require(!twice, "two external filters have this name; rename one of them")?;
        let holds = |mark: &str| one.command.iter().skip(1).any(|argument| argument.contains(mark));
        let lacks = "the command lacks {input} or {output}; write \"PROGRAM {input} {output}\"";
        require(holds("{input}") && holds("{output}"), lacks)?;
    }
    Ok(())
}

/// The budget whose time the equal-time runs get: `time_of`, or the second largest of `spp` (ascending) by default. `None` if
/// `time_of` is 0, which means no equal-time runs.
fn equal_time_budget(time_of: Option<u64>, spp: &[u64]) -> Result<Option<u64>, PlanError> {
    match time_of {
        Some(0) => Ok(None),
        Some(n) if spp.contains(&n) => Ok(Some(n)),
        Some(n) => {
            let known = spp.iter().map(u64::to_string).collect::<Vec<_>>().join(", ");
            let message = format!("{n} is not one of spp ({known}); use one of these, or 0 for no equal-time runs");
            Err(PlanError::new("time_of", message))
        }
        None => Ok(Some(spp[spp.len().saturating_sub(2)])),
    }
}

fn filled<T>(key: &str, list: &[T]) -> Result<(), PlanError> {
    PlanError::unless(!list.is_empty(), key, "the list is empty; omit the key to use the default")
}

fn ascending(mut spp: Vec<u64>) -> Result<Vec<u64>, PlanError> {
    filled("spp", &spp)?;
    spp.sort_unstable();
    let twice = spp.windows(2).any(|pair| pair[0] == pair[1]);
    PlanError::unless(!twice, "spp", "a number of samples is given twice; remove one")?;
    for n in &spp {
        let message = format!("{n} is out of range; use 1 to 2^32 - 1 samples per pixel");
        PlanError::unless((1..=u64::from(u32::MAX)).contains(n), "spp", message)?;
    }
    Ok(spp)
}

#[cfg(test)]
mod tests;
