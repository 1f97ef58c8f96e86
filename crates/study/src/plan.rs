//! The plan of a study: its scenes, methods, budgets and seeds, set in code or in a TOML file.

mod keys;
mod name_list;
mod toml_file;

pub use keys::{Plan, PlanPatch};
pub use name_list::split_names;

use crate::{External, Method};
use dapple_core::PointSet;
use dapple_job::registry::{self, Setting};
use dapple_renderer::light::LightSelection;
use std::collections::BTreeSet;
use std::path::PathBuf;

/// An error in a plan. Each message names the setting and the remedy.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{}{key}: {message}", place.as_ref().map_or_else(String::new, |p| format!("{p}: ")))]
#[non_exhaustive]
pub struct PlanError {
    /// The place of the error, `FILE:LINE`; `None` for a plan from code.
    pub place: Option<String>,
    /// The key of the wrong setting, as in the TOML file. On the command line, options have `-` instead of `_`.
    pub key: String,
    /// The wrong name or value; `None` if the error is not about a single one.
    pub value: Option<String>,
    /// The message: the error and its remedy.
    pub message: String,
}

impl PlanError {
    pub(crate) fn new(key: &str, message: impl ToString) -> Self {
        Self { place: None, key: key.to_owned(), value: None, message: message.to_string() }
    }

    fn of_value(key: &str, value: &str, message: impl ToString) -> Self {
        Self { value: Some(value.to_owned()), ..Self::new(key, message) }
    }
}

/// A scene of a study, with its reference image and the settings that are its own.
///
/// ```
/// # use dapple_study::ScenePlan;
/// let mut scene = ScenePlan::from("cornell");
/// scene.reference = Some("cornell-reference.exr".into());
/// ```
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct ScenePlan {
    /// The name of a bundled scene, or the path of a scene file.
    pub source: String,
    /// The scene's name in the study; `None` derives it from `source`.
    pub name: Option<String>,
    /// The file of the reference image; `None` renders a reference.
    pub reference: Option<PathBuf>,
    /// Width and height of this scene's images in pixels; `None` takes the study's resolution.
    pub resolution: Option<[u32; 2]>,
    /// The rule by which light sampling selects one of several lights; `None` takes the study's.
    pub lights: Option<LightSelection>,
    /// The integrator, `NAME` or `NAME:key=value,…`; `None` takes the one that the scene calls for. References are always
    /// rendered with that one.
    pub integrator: Option<String>,
}

impl From<&str> for ScenePlan {
    fn from(source: &str) -> Self {
        Self { source: source.to_owned(), ..Self::default() }
    }
}

/// The default scenes of a study, both bundled with Dapple.
pub const DEFAULT_SCENES: [&str; 2] = ["teapot", "terrain"];
/// The default samplers of a study: that of `dapple render`, then uniform sampling.
pub const DEFAULT_SAMPLERS: [&str; 2] = [dapple_job::DEFAULT_SAMPLER, "uniform"];
/// The default filters of a study: that of `dapple render`, then none.
pub const DEFAULT_FILTERS: [&str; 2] = [dapple_job::DEFAULT_FILTER, "none"];
/// The default budgets of a study, in mean samples per pixel.
pub const DEFAULT_SPP: [u64; 4] = [4, 8, 16, 32];
/// The default number of seeds: enough for Student's t intervals of a useful width.
pub const DEFAULT_SEEDS: u64 = 8;
/// The default samples per pixel of a rendered reference image.
pub const DEFAULT_REFERENCE_SPP: u64 = 1024;
/// The default width and height of images in pixels.
pub const DEFAULT_SIDE: u32 = 128;

/// The default light selection of a study: that of `dapple render`.
pub fn default_lights() -> LightSelection {
    dapple_job::RenderSpec::new("").selection()
}

impl PlanPatch {
    /// Returns this patch with its settings replaced by those that `other` sets. A resolution in `other` also replaces
    /// the resolutions of single scenes, and a light selection theirs.
    #[must_use]
    pub fn merge(self, other: Self) -> Self {
        let (resized, relit) = (other.resolution.is_some(), other.lights.is_some());
        let mut merged = self.replaced_by(other);
        for scene in merged.scenes.iter_mut().flatten() {
            if resized {
                scene.resolution = None;
            }
            if relit {
                scene.lights = None;
            }
        }
        merged
    }

    /// Checks the settings, and adds the defaults of missing ones.
    ///
    /// # Errors
    ///
    /// [`PlanError`] for the first unknown name, empty list or number out of range. The message lists the known names.
    pub fn resolve(self) -> Result<Plan, PlanError> {
        let plan = self.taken_over();
        let quick = self.quick.unwrap_or(false);
        let spp = self.spp.clone().unwrap_or_else(|| if quick { vec![4, 8, 16] } else { DEFAULT_SPP.to_vec() });
        let spp = ascending("spp", spp)?;
        let scenes =
            self.scenes.clone().unwrap_or_else(|| DEFAULT_SCENES.iter().map(|s| ScenePlan::from(*s)).collect());
        filled("scenes", &scenes)?;
        check_sizes(&scenes, self.resolution)?;
        let external = self.external.clone().unwrap_or_default();
        check_external(&external)?;
        let most = spp.last().copied().unwrap_or(1);
        let mut methods = self.all_methods()?;
        check_methods(&methods, most, &external)?;
        let baseline = self.baseline.unwrap_or_default();
        check_method(&baseline, most, &external).map_err(|e| PlanError { key: "baseline".into(), ..e })?;
        if !methods.contains(&baseline) {
            methods.insert(0, baseline.clone());
        }
        let seeds = self.seeds.unwrap_or_else(|| (1..=if quick { 4 } else { DEFAULT_SEEDS }).collect());
        check_seeds(&seeds)?;
        let time_of = equal_time_budget(self.time_of, &spp)?;
        check_numbers(&plan)?;
        Ok(Plan {
            scenes,
            methods,
            external,
            baseline,
            spp,
            seeds,
            time_of,
            side: if quick { 64 } else { DEFAULT_SIDE },
            reference_spp: plan.reference_spp.next_multiple_of(2),
            ..plan
        })
    }

    /// All combinations of samplers, point sets and filters, then the methods that are listed one by one.
    fn all_methods(&self) -> Result<Vec<Method>, PlanError> {
        let names = |set: &Option<Vec<String>>, default: &[&str]| {
            set.clone().unwrap_or_else(|| default.iter().map(|name| (*name).to_owned()).collect())
        };
        let mut methods = Vec::new();
        if self.samplers.is_some() || self.methods.is_none() {
            let samplers = names(&self.samplers, &DEFAULT_SAMPLERS);
            let points = names(&self.points, &[dapple_job::DEFAULT_POINTS]);
            let filters = names(&self.filters, &DEFAULT_FILTERS);
            for (key, list) in [("samplers", &samplers), ("points", &points), ("filters", &filters)] {
                filled(key, list)?;
            }
            for sampler in &samplers {
                for points in &points {
                    methods.extend(filters.iter().map(|filter| Method::new(sampler, points, filter)));
                }
            }
        }
        methods.extend(self.methods.clone().unwrap_or_default());
        Ok(methods)
    }
}

impl Plan {
    /// The number of runs in the study, equal-time runs included.
    pub fn runs(&self) -> usize {
        let budgets = self.spp.len() + usize::from(self.time_of.is_some());
        self.scenes.len() * self.methods.len() * budgets * self.seeds.len()
    }
}

fn check_sizes(scenes: &[ScenePlan], resolution: Option<[u32; 2]>) -> Result<(), PlanError> {
    for [w, h] in scenes.iter().filter_map(|scene| scene.resolution).chain(resolution) {
        dapple_core::Frame::new(w, h).map_err(|e| PlanError::new("resolution", e))?;
    }
    Ok(())
}

fn check_methods(methods: &[Method], spp: u64, external: &[External]) -> Result<(), PlanError> {
    for (at, method) in methods.iter().enumerate() {
        check_method(method, spp, external)?;
        if methods[..at].contains(method) {
            let message = format!("\"{method}\" is given twice; remove one");
            return Err(PlanError::of_value("methods", &method.sampler, message));
        }
    }
    Ok(())
}

/// Makes the method's sampler, point set and filter once, so that wrong names are found before a scene is read.
fn check_method(method: &Method, spp: u64, external: &[External]) -> Result<(), PlanError> {
    let Method { sampler, points, filter } = method;
    registry::check_sampler(sampler).map_err(|e| PlanError::of_value("samplers", sampler, e))?;
    if !external.iter().any(|e| e.name == *filter) {
        registry::check_filter(filter).map_err(|e| PlanError::of_value("filters", filter, e))?;
    }
    let refuse = |message: String| PlanError::of_value("points", points, message);
    let made = registry::points(points, Setting { seed: 0, spp: Some(spp) }).map_err(|e| refuse(e.to_string()))?;
    if spp > made.capacity() {
        let capacity = made.capacity();
        return Err(refuse(format!(
            "\"{points}\" has {capacity} points per pixel, and {spp} spp need more; lower spp"
        )));
    }
    Ok(())
}

/// Checks that names of external programs are unique, and that their commands contain `{input}` and `{output}`.
fn check_external(external: &[External]) -> Result<(), PlanError> {
    for (at, one) in external.iter().enumerate() {
        let refuse = |what: &str| Err(PlanError::of_value("external", &one.name, format!("{:?}: {what}", one.name)));
        if one.name.is_empty() || one.name.contains(|c: char| "/:,=".contains(c) || c.is_whitespace()) {
            return refuse("not a name; use one without spaces and / : , =");
        }
        // A filter of an optional feature gives way, so that a plan means the same in every program.
        if registry::FILTERS.iter().any(|entry| entry.feature.is_none() && entry.name == one.name) {
            return refuse("a built-in filter has this name; choose another");
        }
        if external[..at].iter().any(|other| other.name == one.name) {
            return refuse("two external filters have this name; rename one");
        }
        let holds = |mark: &str| one.command.iter().skip(1).any(|argument| argument.contains(mark));
        if !(holds("{input}") && holds("{output}")) {
            return refuse("the command lacks its images; write \"PROGRAM {input} {output}\"");
        }
    }
    Ok(())
}

fn check_seeds(seeds: &[u64]) -> Result<(), PlanError> {
    filled("seeds", seeds)?;
    if seeds.iter().collect::<BTreeSet<_>>().len() < seeds.len() {
        return Err(PlanError::new("seeds", "a seed is given twice and would make the same image again; remove one"));
    }
    Ok(())
}

fn check_numbers(plan: &Plan) -> Result<(), PlanError> {
    let spp = plan.reference_spp;
    if !(2..=1 << 32).contains(&spp) {
        let message = format!("{spp} is out of range; use 2 to 2^32, half of them for each half of the reference");
        return Err(PlanError::new("reference_spp", message));
    }
    let threads = plan.threads;
    if threads > 1024 {
        return Err(PlanError::new("threads", format!("{threads} is out of range; use 0 (one per core) to 1024")));
    }
    Ok(())
}

/// The budget whose time the equal-time runs get: `time_of`, or the second largest of `spp` (ascending) by default.
/// `None` for 0, which leaves out equal-time runs.
fn equal_time_budget(time_of: Option<u64>, spp: &[u64]) -> Result<Option<u64>, PlanError> {
    match time_of {
        Some(0) => Ok(None),
        Some(n) if spp.contains(&n) => Ok(Some(n)),
        Some(n) => {
            let known = spp.iter().map(u64::to_string).collect::<Vec<_>>().join(", ");
            let message = format!("{n} is not one of spp ({known}); use one of them, or 0 for no equal-time runs");
            Err(PlanError::new("time_of", message))
        }
        None => Ok(Some(spp[spp.len().saturating_sub(2)])),
    }
}

fn filled<T>(key: &str, list: &[T]) -> Result<(), PlanError> {
    if list.is_empty() {
        return Err(PlanError::new(key, "the list is empty; leave the key out for the default"));
    }
    Ok(())
}

fn ascending(key: &str, mut spp: Vec<u64>) -> Result<Vec<u64>, PlanError> {
    filled(key, &spp)?;
    spp.sort_unstable();
    if spp.windows(2).any(|pair| pair[0] == pair[1]) {
        return Err(PlanError::new(key, "a number is given twice; remove one"));
    }
    match spp.iter().find(|n| !(1..=u64::from(u32::MAX)).contains(*n)) {
        Some(n) => Err(PlanError::new(key, format!("{n} is out of range; use 1 to 2^32 - 1 samples per pixel"))),
        None => Ok(spp),
    }
}

/// Parses `SAMPLER[/POINTS[/FILTER]]`; the point set defaults to that of `dapple render`, the filter to `none`.
impl std::str::FromStr for Method {
    type Err = PlanError;

    fn from_str(text: &str) -> Result<Self, PlanError> {
        let parts: Vec<&str> = text.split('/').map(str::trim).collect();
        match parts[..] {
            [sampler] => Ok(Self::new(sampler, dapple_job::DEFAULT_POINTS, "none")),
            [sampler, points] => Ok(Self::new(sampler, points, "none")),
            [sampler, points, filter] => Ok(Self::new(sampler, points, filter)),
            _ => {
                let message = format!("\"{text}\" is not a method; write SAMPLER/POINTS/FILTER");
                Err(PlanError::of_value("methods", text, message))
            }
        }
    }
}
