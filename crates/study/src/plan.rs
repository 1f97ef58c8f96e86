//! The plan of a study: its scenes, methods, budgets and seeds, from a TOML file, `--set key=value`, or code.

use crate::scene::name_of;
use crate::{External, Method, StudyError};
use dapple_core::PointSet;
use dapple_job::registry::{self, PointSettings};
use dapple_renderer::light::LightSelection;
use serde::de::Error;
use serde::{Deserialize, Deserializer};
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
    /// The scene's name in the study; `None` derives it from `source`.
    pub name: Option<String>,
    /// The file of the reference image; `None` renders a reference.
    pub reference: Option<PathBuf>,
    /// Width and height of this scene's images in pixels; `None` uses the study's resolution.
    #[serde(default, deserialize_with = "resolution")]
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
    #[serde(deserialize_with = "list")]
    pub scenes: Vec<ScenePlan>,
    /// The names of the `scenes` to use; default all.
    pub only: Vec<String>,
    /// The samplers (how many samples each pixel gets), each combined with every point set and filter. Default: if `methods` is
    /// set, no samplers; otherwise first the sampler of `dapple render`, then `uniform`.
    pub samplers: Option<Vec<String>>,
    /// The point sets (where samples lie), each combined with every sampler and filter; default `sobol`.
    pub points: Vec<String>,
    /// The filters (denoisers), each combined with every sampler and point set. Default: first the filter of `dapple render`,
    /// then `none`.
    pub filters: Vec<String>,
    /// Methods in addition to samplers x points x filters, or the only methods if no samplers are set. In a plan, each is
    /// `SAMPLER/POINTS/FILTER` or a table.
    #[serde(deserialize_with = "list")]
    pub methods: Vec<Method>,
    /// External programs, which methods can name as their filter.
    pub external: Vec<External>,
    /// The method with which the others are compared; default uniform/sobol/none. If it is not one of the methods, it is added
    /// as the first one.
    #[serde(deserialize_with = "one")]
    pub baseline: Method,
    /// The budgets in mean samples per pixel; default 4, 8, 16 and 32.
    pub spp: Option<Vec<u64>>,
    /// The seeds; default 1 to 8. Each scene, method and budget has one run per seed. In a plan: the number of seeds, or a list
    /// of them.
    #[serde(deserialize_with = "seeds")]
    pub seeds: Option<Vec<u64>>,
    /// The budget, one of `spp`, that sets the time of equal-time runs: every method gets the time that the baseline takes at
    /// this budget. 0 means no equal-time runs; the default is the second largest budget.
    pub time_of: Option<u64>,
    /// If true, the default budgets, seeds and resolution are smaller, so that the study takes less than a minute.
    pub quick: bool,
    /// Width and height of images in pixels; default: the size of the scene's reference file, or 128x128 without one. In a
    /// plan, `[128, 128]` or `128x128`.
    #[serde(deserialize_with = "resolution")]
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
    /// statistics that were not recorded, its samples are traced again. The time of each method includes the tracing.
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

/// A complete plan of a study. Every setting has a value, not yet checked against the scene files.
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
    /// The default width and height in pixels of a scene's images, used if neither a resolution nor a reference file is given.
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
    /// [`PlanError`] with file and line for text that is not TOML, an unknown key, a value of another type, or a value
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

/// A TOML value that is either text to parse, or a value that serde reads.
#[derive(Deserialize)]
#[serde(untagged, expecting = "text, or a table of the keys that `dapple study --help` lists")]
enum Written<T> {
    Text(String),
    Value(T),
}

impl<T: FromStr<Err: fmt::Display>> Written<T> {
    fn read<E: Error>(self) -> Result<T, E> {
        match self {
            Self::Text(text) => text.parse().map_err(E::custom),
            Self::Value(value) => Ok(value),
        }
    }
}

fn one<'de, D: Deserializer<'de>>(from: D) -> Result<Method, D::Error> {
    Written::deserialize(from)?.read()
}

fn list<'de, T, D: Deserializer<'de>>(from: D) -> Result<Vec<T>, D::Error>
where
    T: FromStr<Err: fmt::Display> + Deserialize<'de>,
{
    Vec::<Written<T>>::deserialize(from)?.into_iter().map(Written::read).collect()
}

/// The largest number of seeds in a plan, so that a typing error does not fill the memory.
const MOST_SEEDS: u64 = 100_000;

/// Reads the seeds: a number N for the seeds 1 to N, or a list.
fn seeds<'de, D: Deserializer<'de>>(from: D) -> Result<Option<Vec<u64>>, D::Error> {
    #[derive(Deserialize)]
    #[serde(untagged, expecting = "a number of seeds, or a list of seeds")]
    enum Seeds {
        Count(u64),
        List(Vec<u64>),
    }
    Ok(Some(match Seeds::deserialize(from)? {
        Seeds::Count(n) => (1..=n.min(MOST_SEEDS)).collect(),
        Seeds::List(list) => list,
    }))
}

/// Reads a resolution: text such as `128x128`, or a pair.
fn resolution<'de, D: Deserializer<'de>>(from: D) -> Result<Option<[u32; 2]>, D::Error> {
    let text = match Written::deserialize(from)? {
        Written::Value(sides) => return Ok(Some(sides)),
        Written::Text(text) => text,
    };
    let sides = text.split_once(['x', 'X']).and_then(|(w, h)| Some([w.trim().parse().ok()?, h.trim().parse().ok()?]));
    let wrong = || format!("\"{text}\" is not a resolution; write WIDTHxHEIGHT in pixels, such as 128x128");
    sides.map(Some).ok_or_else(|| D::Error::custom(wrong()))
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
mod tests {
    use super::*;

    fn message_of(text: &str) -> String {
        match Plan::parse(text, Path::new("some/plan.toml"), &[]) {
            Ok(_) => String::new(),
            Err(e) => e.to_string(),
        }
    }

    #[test]
    fn plans_may_have_a_byte_order_mark_any_line_ends_and_latin_1() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("plan.toml");
        for end in ["\n", "\r\n", "\r"] {
            let text = |seeds: &str| ["# caf\u{e9}", "spp = [", "8]", seeds, ""].join(end);
            let latin = text("seeds = 3").chars().map(|c| c as u8).collect::<Vec<u8>>();
            for bytes in [format!("\u{feff}{}", text("seeds = 3")).into_bytes(), latin] {
                std::fs::write(&path, bytes).expect("a plan");
                assert_eq!(Plan::read(Some(&path), &[]).expect("a plan").seeds.len(), 3, "{end:?}");
            }
            std::fs::write(&path, text("seeds = [1, 1]")).expect("a plan");
            let found = Plan::read(Some(&path), &[]).expect_err("twice").to_string();
            assert!(found.contains("plan.toml:4: seeds: a seed is given twice"), "{end:?}: {found}");
        }
        std::fs::write(&path, b"\xff\xfes\0").expect("a plan");
        let found = Plan::read(Some(&path), &[]).expect_err("UTF-16").to_string();
        assert!(found.contains("plan.toml") && found.contains("this text is in UTF-16; save it as UTF-8"), "{found}");
    }

    #[test]
    fn errors_name_file_line_and_key() {
        let cases = [
            ("spp = [8, \"a\"]", "some/plan.toml:1: invalid type: string \"a\", expected u64"),
            ("# a\n\nspp = [\n  8,\n  8,\n]\n", "some/plan.toml:3: spp: a number of samples is given twice"),
            ("spp = [0]", ":1: spp: 0 is out of range; use 1 to"),
            ("spp = []", ":1: spp: the list is empty"),
            ("ssp = [8]", ":1: unknown field `ssp`, expected one of `scenes`, `only`, `samplers`"),
            ("spp = [8", ":1: "),
            (
                "samplers = [\n  \"uniform\",\n  \"nonesuch\",\n]",
                ":3: samplers: there is no sampler \"nonesuch\"; choose among variance, ",
            ),
            ("filters = [\"nonesuch\"]", ":1: filters: there is no filter \"nonesuch\"; choose among none, "),
            ("points = [\"nonesuch\"]", ":1: points: there is no point set \"nonesuch\"; choose among sobol, "),
            ("samplers = [\"mitchell:nonesuch=2\"]", ":1: samplers: mitchell: there is no parameter \"nonesuch\""),
            ("methods = [\"uniform\",\n \"variance/nonesuch\"]", ":2: points: there is no point set"),
            ("methods = [\"a/b/c/d\"]", ":1: \"a/b/c/d\" is not a method; write SAMPLER/POINTS/FILTER"),
            ("samplers = [\"uniform\", \"uniform\"]", "\"uniform/sobol/cluster-regression\" is given twice"),
            ("seeds = \"x\"", ":1: a number of seeds, or"),
            ("seeds = [1, 1]", ":1: seeds: a seed is given twice"),
            ("seeds = 0", ":1: seeds: the list is empty"),
            ("resolution = \"12\"", ":1: \"12\" is not a resolution; write WIDTHxHEIGHT"),
            ("resolution = [0, 4]", ":1: resolution: "),
            ("time_of = 7", ":1: time_of: 7 is not one of spp (4, 8, 16, 32)"),
            ("reference_spp = 1", ":1: reference_spp: 1 is out of range; use 2"),
            ("baseline = \"nonesuch\"", ":1: baseline: there is no sampler"),
            ("scenes = [{ name = \"a\" }]", ":1: text, or a table"),
            ("threads = -1", ":1: invalid value"),
            ("scenes = [{ source = \"teapot\", lights = \"nonesuch\" }]", ":1: text, or a table"),
            ("scenes = [{ source = \"teapot\", resolution = \"0x4\" }]", ":1: scenes: an image of 0x4 pixels is empty"),
            (
                "[[external]]\nname = \"a/b\"\ncommand = \"p {input} {output}\"",
                ":2: external: \"a/b\": not a valid name",
            ),
            (
                "[[external]]\nname = \"nlm\"\ncommand = \"p {input} {output}\"",
                ":2: external: \"nlm\": a built-in filter",
            ),
            (
                "[[external]]\nname = \"a\"\ncommand = \"p {input}\"",
                "external: \"a\": the command lacks {input} or {output}",
            ),
            (
                "[[external]]\nname = \"a\"\ncommand = \"{input} {output}\"",
                "external: \"a\": the command lacks {input} or {output}",
            ),
            ("filters = [\"a\"]", "filters: there is no filter \"a\""),
        ];
        for (text, message) in cases {
            assert!(message_of(text).contains(message), "{text}: {}", message_of(text));
        }
        // The control: an empty plan is right.
        assert_eq!(message_of(""), "");
    }

    /// Plans mean the same in programs with and without the feature.
    #[test]
    fn an_external_filter_may_have_the_name_of_an_optional_filter() {
        for name in ["oidn", "oidn-blend"] {
            let text = format!(
                "filters = [\"{name}\"]\n[[external]]\nname = \"{name}\"\ncommand = \"p {{input}} {{output}}\""
            );
            let plan = Plan::parse(&text, Path::new("plan.toml"), &[]).unwrap();
            assert_eq!((plan.settings.external[0].name.as_str(), plan.methods[1].filter.as_str()), (name, name));
        }
    }

    #[test]
    fn a_file_gives_every_setting() {
        let text = r#"
            scenes = ["teapot", { source = "box.pbrt", name = "box", reference = "r.exr" }]
            samplers = ["variance", "mitchell:mode=budget"]
            filters = ["none"]
            methods = [{ sampler = "uniform", points = "halton" }, "variance/random/gaussian"]
            spp = [16, 8]
            seeds = [3, 5]
            resolution = "20x10"
            time_of = 16
        "#;
        let plan = Plan::parse(text, Path::new("some/plan.toml"), &[]).unwrap();
        let methods: Vec<String> = plan.methods.iter().map(Method::to_string).collect();
        let expected = [
            "uniform/sobol/none",
            "variance/sobol/none",
            "mitchell:mode=budget/sobol/none",
            "uniform/halton/none",
            "variance/random/gaussian",
        ];
        assert_eq!(methods, expected, "the baseline stands in front");
        assert_eq!((plan.spp.as_slice(), plan.seeds.as_slice()), (&[8, 16][..], &[3, 5][..]));
        assert_eq!((plan.settings.resolution, plan.time_of), (Some([20, 10]), Some(16)));
        assert_eq!(plan.scenes[0], "teapot".parse().unwrap());
        assert_eq!(plan.scenes[1].source, "some/box.pbrt");
        assert_eq!(plan.scenes[1].reference.as_deref(), Some(Path::new("some/r.exr")));
        assert_eq!(plan.runs(), 2 * 5 * 3 * 2);
    }

    fn with(text: &str, sets: &[&str]) -> Result<Plan, PlanError> {
        let sets: Vec<String> = sets.iter().map(|set| (*set).to_owned()).collect();
        Plan::parse(text, Path::new("some/plan.toml"), &sets)
    }

    #[test]
    fn later_settings_replace_those_of_the_file() {
        let plan = with("spp = [2, 4]\nseeds = 3", &["spp=7", "quick=true"]).unwrap();
        assert_eq!((plan.spp, plan.seeds, plan.time_of, plan.side), (vec![7], vec![1, 2, 3], Some(7), 64));
        let sized =
            "lights = \"power\"\nscenes = [{ source = \"teapot\", resolution = [5, 6], light_choice = \"cells\" }]";
        let scene = &with(sized, &[]).unwrap().scenes[0];
        assert_eq!((scene.resolution, scene.lights), (Some([5, 6]), Some(LightSelection::Learned)));
        let plan = with(sized, &["resolution=7x8", "lights=learned"]).unwrap();
        assert_eq!((plan.scenes[0].resolution, plan.settings.resolution), (None, Some([7, 8])));
        assert_eq!((plan.scenes[0].lights, plan.settings.lights), (None, LightSelection::Learned));
        // Text, lists, tables and parts of tables; a plan that holds only with its replacements.
        let sets = [
            "samplers=[\"uniform\", \"mitchell:mode=budget,radius=2\"]",
            "filters=none",
            "methods=uniform/halton",
            "baseline.filter=gaussian",
            "scenes=[\"cornell\", { source = \"box.pbrt\", name = \"b\" }]",
            "spp=[4, 9]",
        ];
        let plan = with("time_of = 9\nbaseline = { sampler = \"uniform\" }", &sets).unwrap();
        let methods: Vec<String> = plan.methods.iter().map(Method::to_string).collect();
        let expected = [
            "uniform/sobol/gaussian",
            "uniform/sobol/none",
            "mitchell:mode=budget,radius=2/sobol/none",
            "uniform/halton/none",
        ];
        assert_eq!(methods, expected);
        assert_eq!(plan.scenes[1].source, "box.pbrt", "not relative to the file");
        let named = "scenes = [\"teapot\", { source = \"room\", name = \"r\" }]";
        assert_eq!(with(named, &["only=r"]).unwrap().scenes[0].source, "room");
    }

    #[test]
    fn errors_of_replacements_name_the_replacement() {
        let cases = [
            ("spp", "--set spp: this is not a setting; write KEY=VALUE"),
            ("ssp=3", "--set ssp=3: unknown field `ssp`, expected one of"),
            ("spp=a", "--set spp=a: invalid type: string \"a\", expected u64"),
            ("spp=[2, 2]", "--set spp=[2, 2]: spp: a number of samples is given twice"),
            ("spp=[2", "write a TOML value"),
            ("seeds.a=3", "--set seeds.a=3: "),
            ("methods=uniform/nonesuch", "--set methods=uniform/nonesuch: points: there is no point set"),
            ("only=nonesuch", "no scene of the plan is called \"nonesuch\"; choose among teapot, terrain"),
            // The file's own setting no longer fits.
            ("spp=[1, 2]", "some/plan.toml:2: time_of: 8 is not one of spp (1, 2)"),
        ];
        for (set, message) in cases {
            let found = with("seeds = 2\ntime_of = 8", &[set]).unwrap_err().to_string();
            assert!(found.contains(message), "{set}: {found}");
        }
    }
}
