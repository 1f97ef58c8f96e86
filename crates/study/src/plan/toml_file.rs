//! Reading of a plan from a TOML file.

use super::{PlanError, PlanPatch, ScenePlan};
use crate::{External, Method, StudyError};
use dapple_renderer::light::LightSelection;
use serde::de::Error;
use serde::{Deserialize, Deserializer};
use std::path::{Path, PathBuf};

impl PlanPatch {
    /// Reads a plan from a TOML file. Paths in the file are relative to its folder.
    ///
    /// ```toml
    /// scenes = ["teapot", { source = "box.pbrt", name = "box", reference = "box-reference.exr" }]
    /// samplers = ["uniform", "variance", "mitchell:mode=budget"]
    /// filters = ["none", "gaussian"]
    /// methods = [{ sampler = "uniform", points = "halton" }]    # in addition; default points sobol, filter none
    /// spp = [8, 16, 32, 64]
    /// seeds = 8                                                 # 1 to 8; or a list
    /// reference_spp = 4096
    /// resolution = [128, 128]
    ///
    /// [[external]]                                              # a filter that is an external program
    /// name = "oidn"
    /// command = "python3 oidn.py {input} {output}"
    /// ```
    ///
    /// The keys are the fields of [`PlanPatch`].
    ///
    /// # Errors
    ///
    /// [`StudyError`] for a file that cannot be read, text that is not TOML, an unknown key, a value of another type,
    /// or a value that [`PlanPatch::resolve`] refuses. The message names file, line and key.
    pub fn read(file: &Path) -> Result<Self, StudyError> {
        /// The largest size of a plan in bytes.
        const LONGEST: u64 = 16 << 20;
        let text = dapple_job::read_text(file, LONGEST).map_err(|e| StudyError::file(file, "read the plan", e))?;
        Ok(Self::parse(&text, file)?)
    }

    /// Parses a plan from TOML text. Errors contain the path `file`; relative paths in the text start from its folder.
    ///
    /// # Errors
    ///
    /// [`PlanError`] for text that is not TOML, an unknown key, a value of another type, or a value that
    /// [`PlanPatch::resolve`] refuses.
    pub fn parse(text: &str, file: &Path) -> Result<Self, PlanError> {
        let mut patch: Self = toml::from_str(text).map_err(|e| located_toml(&e, text, file))?;
        patch.make_relative_to(file.parent().unwrap_or(Path::new("")));
        // The plan is resolved here only to find its errors while their lines in the file are known.
        patch.clone().resolve().map_err(|e| located(e, text, file))?;
        Ok(patch)
    }

    fn make_relative_to(&mut self, folder: &Path) {
        for scene in self.scenes.iter_mut().flatten() {
            let path = folder.join(&scene.source);
            // A bundled scene's name stays a name, unless a file of that name exists.
            let bundled = !path.exists() && dapple_scene::bundled::names().contains(&scene.source.as_str());
            if !bundled {
                scene.source = path.display().to_string();
            }
            scene.reference = scene.reference.take().map(|file| folder.join(file));
        }
        self.external.iter_mut().flatten().for_each(|external| external.folder = folder.to_owned());
    }
}

/// The TOML value of a scene: its name or path as text, or a table.
#[derive(Deserialize)]
#[serde(
    untagged,
    expecting = "a scene: \"NAME or path\", or { source = \"…\" } with name, reference, resolution, lights (power, uniform, learned), integrator"
)]
enum SceneForm {
    Source(String),
    Table(SceneTable),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SceneTable {
    source: String,
    name: Option<String>,
    reference: Option<PathBuf>,
    #[serde(default, deserialize_with = "resolution")]
    resolution: Option<[u32; 2]>,
    #[serde(alias = "light_choice")]
    lights: Option<LightSelection>,
    integrator: Option<String>,
}

impl<'de> Deserialize<'de> for ScenePlan {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        Ok(match SceneForm::deserialize(from)? {
            SceneForm::Source(source) => Self { source, ..Self::default() },
            SceneForm::Table(SceneTable { source, name, reference, resolution, lights, integrator }) => {
                if let Some(Err(e)) = integrator.as_deref().map(dapple_job::check_integrator) {
                    return Err(D::Error::custom(format!("integrator: {e}")));
                }
                Self { source, name, reference, resolution, lights, integrator }
            }
        })
    }
}

/// The TOML value of a method: `SAMPLER/POINTS/FILTER` as text, or a table.
#[derive(Deserialize)]
#[serde(
    untagged,
    expecting = "a method: \"SAMPLER/POINTS/FILTER\", or { sampler = \"…\", points = \"…\", filter = \"…\" }"
)]
enum MethodForm {
    Text(String),
    Table(MethodTable),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct MethodTable {
    sampler: String,
    points: Option<String>,
    filter: Option<String>,
}

impl MethodForm {
    fn method<E: Error>(self) -> Result<Method, E> {
        match self {
            Self::Text(text) => text.parse().map_err(|e: PlanError| E::custom(e.message)),
            Self::Table(MethodTable { sampler, points, filter }) => {
                Ok(Method::new(&sampler, points.as_deref().unwrap_or("sobol"), filter.as_deref().unwrap_or("none")))
            }
        }
    }
}

pub(super) fn method<'de, D: Deserializer<'de>>(from: D) -> Result<Option<Method>, D::Error> {
    MethodForm::deserialize(from)?.method().map(Some)
}

pub(super) fn methods<'de, D: Deserializer<'de>>(from: D) -> Result<Option<Vec<Method>>, D::Error> {
    Vec::<MethodForm>::deserialize(from)?.into_iter().map(MethodForm::method).collect::<Result<_, _>>().map(Some)
}

/// The TOML table of an external program, which runs in the folder of the plan file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ExternalTable {
    name: String,
    command: CommandForm,
}

#[derive(Deserialize)]
#[serde(untagged, expecting = "a command: \"PROGRAM {input} {output}\", or a list of arguments where they hold spaces")]
enum CommandForm {
    Line(String),
    List(Vec<String>),
}

impl From<ExternalTable> for External {
    fn from(ExternalTable { name, command }: ExternalTable) -> Self {
        let command = match command {
            CommandForm::Line(line) => line.split_whitespace().map(str::to_owned).collect(),
            CommandForm::List(arguments) => arguments,
        };
        Self { name, command, folder: PathBuf::new() }
    }
}

pub(super) fn externals<'de, D: Deserializer<'de>>(from: D) -> Result<Option<Vec<External>>, D::Error> {
    Ok(Some(Vec::<ExternalTable>::deserialize(from)?.into_iter().map(External::from).collect()))
}

/// The TOML value of the seeds: their number N for seeds 1 to N, or a list.
#[derive(Deserialize)]
#[serde(untagged, expecting = "a number of seeds, or a list of seeds")]
enum SeedsForm {
    Count(u64),
    List(Vec<u64>),
}

/// The largest number of seeds in a plan; it keeps a typing error from filling the memory.
const MOST_SEEDS: u64 = 100_000;

pub(super) fn seeds<'de, D: Deserializer<'de>>(from: D) -> Result<Option<Vec<u64>>, D::Error> {
    Ok(Some(match SeedsForm::deserialize(from)? {
        SeedsForm::Count(n) => (1..=n.min(MOST_SEEDS)).collect(),
        SeedsForm::List(list) => list,
    }))
}

/// The TOML value of a resolution: text such as `128x128`, or a pair.
#[derive(Deserialize)]
#[serde(untagged, expecting = "a resolution: \"128x128\" or [128, 128]")]
enum ResolutionForm {
    Text(String),
    Sides([u32; 2]),
}

pub(super) fn resolution<'de, D: Deserializer<'de>>(from: D) -> Result<Option<[u32; 2]>, D::Error> {
    let text = match ResolutionForm::deserialize(from)? {
        ResolutionForm::Sides(sides) => return Ok(Some(sides)),
        ResolutionForm::Text(text) => text,
    };
    let sides = text.split_once(['x', 'X']).and_then(|(w, h)| Some([w.trim().parse().ok()?, h.trim().parse().ok()?]));
    let wrong =
        || D::Error::custom(format!("\"{text}\" is not a resolution; write WIDTHxHEIGHT in pixels, such as 128x128"));
    sides.map(Some).ok_or_else(wrong)
}

/// Converts an error of the TOML parser to a plan error with file, line and key.
fn located_toml(error: &toml::de::Error, text: &str, file: &Path) -> PlanError {
    let at = error.span().map_or(0, |span| span.start.min(text.len()));
    let number = text.as_bytes()[..at].iter().filter(|b| **b == b'\n').count();
    // The value may be on a later line than its key.
    let key = text.lines().take(number + 1).filter_map(key_of).last().unwrap_or("plan");
    let place = format!("{}:{}", file.display(), number + 1);
    PlanError { place: Some(place), ..PlanError::new(key, error.message()) }
}

/// Adds to a plan error the file and the line of the wrong value; if the value is not found, the line of its key.
fn located(error: PlanError, text: &str, file: &Path) -> PlanError {
    let lines = || text.lines().enumerate();
    let keyed = |key: &str| lines().find(|(_, line)| key_of(line) == Some(key)).map(|(number, _)| number);
    let of_key = keyed(&error.key);
    // An error in one of `methods` has the key of the wrong part, such as `points`.
    let from = of_key.or_else(|| keyed("methods")).unwrap_or(0);
    let of_value = error.value.as_ref().and_then(|value| lines().skip(from).find(|(_, line)| line.contains(value)));
    let number = of_value.map(|(number, _)| number).or(of_key);
    let place = number.map_or_else(|| file.display().to_string(), |n| format!("{}:{}", file.display(), n + 1));
    PlanError { place: Some(place), ..error }
}

/// The key to which a line of TOML assigns a value; `None` if it assigns none.
fn key_of(line: &str) -> Option<&str> {
    let (key, _) = line.split_once('=')?;
    let key = key.trim();
    (!key.is_empty() && key.chars().all(|c| c.is_ascii_alphanumeric() || c == '_' || c == '-')).then_some(key)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message_of(text: &str) -> String {
        match PlanPatch::parse(text, Path::new("some/plan.toml")) {
            Ok(_) => String::new(),
            Err(e) => e.to_string(),
        }
    }

    #[test]
    fn errors_name_file_line_and_key() {
        let cases = [
            ("spp = [8, \"a\"]", "some/plan.toml:1: spp: invalid type: string \"a\", expected u64"),
            ("# a\n\nspp = [\n  8,\n  8,\n]\n", "some/plan.toml:3: spp: a number is given twice"),
            ("spp = [0]", ":1: spp: 0 is out of range; use 1 to"),
            ("spp = []", ":1: spp: the list is empty"),
            ("ssp = [8]", ":1: ssp: unknown field `ssp`, expected one of `scenes`, `samplers`"),
            ("spp = [8", ":1: spp: "),
            (
                "samplers = [\n  \"uniform\",\n  \"nonesuch\",\n]",
                ":3: samplers: there is no sampler \"nonesuch\"; choose among variance, ",
            ),
            ("filters = [\"nonesuch\"]", ":1: filters: there is no filter \"nonesuch\"; choose among none, "),
            ("points = [\"nonesuch\"]", ":1: points: there is no point set \"nonesuch\"; choose among sobol, "),
            ("samplers = [\"mitchell:nonesuch=2\"]", ":1: samplers: mitchell: there is no parameter \"nonesuch\""),
            ("methods = [\"uniform\",\n \"variance/nonesuch\"]", ":2: points: there is no point set"),
            ("methods = [\"a/b/c/d\"]", ":1: methods: \"a/b/c/d\" is not a method; write SAMPLER/POINTS/FILTER"),
            ("samplers = [\"uniform\", \"uniform\"]", "\"uniform/sobol/cluster-regression\" is given twice"),
            ("seeds = \"x\"", ":1: seeds: "),
            ("seeds = [1, 1]", ":1: seeds: a seed is given twice"),
            ("seeds = 0", ":1: seeds: the list is empty"),
            ("resolution = \"12\"", ":1: resolution: \"12\" is not a resolution; write WIDTHxHEIGHT"),
            ("resolution = [0, 4]", ":1: resolution: "),
            ("time_of = 7", ":1: time_of: 7 is not one of spp (4, 8, 16, 32)"),
            ("reference_spp = 1", ":1: reference_spp: 1 is out of range; use 2"),
            ("baseline = \"nonesuch\"", ":1: baseline: there is no sampler"),
            ("scenes = [{ name = \"a\" }]", ":1: scenes: "),
            ("threads = -1", ":1: threads: "),
            ("scenes = [{ source = \"teapot\", lights = \"nonesuch\" }]", ":1: scenes: "),
            ("scenes = [{ source = \"teapot\", resolution = \"0x4\" }]", "some/plan.toml: resolution: "),
            ("[[external]]\nname = \"a/b\"\ncommand = \"p {input} {output}\"", ":2: external: \"a/b\": not a name"),
            (
                "[[external]]\nname = \"nlm\"\ncommand = \"p {input} {output}\"",
                ":2: external: \"nlm\": a built-in filter",
            ),
            ("[[external]]\nname = \"a\"\ncommand = \"p {input}\"", "external: \"a\": the command lacks its images"),
            (
                "[[external]]\nname = \"a\"\ncommand = \"{input} {output}\"",
                "external: \"a\": the command lacks its images",
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
        for name in ["oidn", "both"] {
            let text = format!(
                "filters = [\"{name}\"]\n[[external]]\nname = \"{name}\"\ncommand = \"p {{input}} {{output}}\""
            );
            let plan = PlanPatch::parse(&text, Path::new("plan.toml")).unwrap().resolve().unwrap();
            assert_eq!((plan.external[0].name.as_str(), plan.methods[1].filter.as_str()), (name, name));
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
        let plan = PlanPatch::parse(text, Path::new("some/plan.toml")).unwrap().resolve().unwrap();
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
        assert_eq!((plan.resolution, plan.time_of), (Some([20, 10]), Some(16)));
        assert_eq!(plan.scenes[0], ScenePlan::from("teapot"));
        assert_eq!(plan.scenes[1].source, "some/box.pbrt");
        assert_eq!(plan.scenes[1].reference.as_deref(), Some(Path::new("some/r.exr")));
        assert_eq!(plan.runs(), 2 * 5 * 3 * 2);
    }

    #[test]
    fn later_settings_replace_those_of_the_file() {
        let file = PlanPatch::parse("spp = [2, 4]\nseeds = 3", Path::new("plan.toml")).unwrap();
        let later = PlanPatch::default().spp(vec![7]).quick(true);
        let sized = "scenes = [{ source = \"teapot\", resolution = [5, 6], light_choice = \"cells\" }]";
        let sized = PlanPatch::parse(sized, Path::new("plan.toml")).unwrap();
        let scene = &sized.scenes.as_ref().unwrap()[0];
        assert_eq!((scene.resolution, scene.lights), (Some([5, 6]), Some(LightSelection::Learned)));
        let resized = sized.merge(PlanPatch::default().resolution([7, 8])).resolve().unwrap();
        assert_eq!((resized.scenes[0].resolution, resized.resolution), (None, Some([7, 8])));
        let lit = PlanPatch::parse(
            "lights = \"power\"\nscenes = [{ source = \"room\", lights = \"uniform\" }]",
            Path::new("plan.toml"),
        );
        let lit = lit.unwrap().merge(PlanPatch::default().lights(LightSelection::Learned)).resolve().unwrap();
        assert_eq!((lit.lights, lit.scenes[0].lights), (LightSelection::Learned, None));
        let plan = file.merge(later).resolve().unwrap();
        assert_eq!((plan.spp, plan.seeds, plan.time_of, plan.side), (vec![7], vec![1, 2, 3], Some(7), 64));
    }

    #[test]
    fn the_older_key_of_light_selection_still_reads() {
        let lights = |text: &str| PlanPatch::parse(text, Path::new("plan.toml")).unwrap().scenes.unwrap()[0].lights;
        assert_eq!(lights("scenes = [{ source = \"teapot\", lights = \"uniform\" }]"), Some(LightSelection::Uniform));
        assert_eq!(
            lights("scenes = [{ source = \"teapot\", light_choice = \"uniform\" }]"),
            Some(LightSelection::Uniform)
        );
    }
}
