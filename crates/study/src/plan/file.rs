//! A plan as a TOML file.

use super::{Draft, PlanError, ScenePlan, Seeds, parse_resolution};
use crate::{External, Method, StudyError};
use dapple_renderer::light::LightSelection;
use serde::Deserialize;
use std::path::Path;

/// The keys of the file; those of [`Draft`].
#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct Keys {
    scenes: Option<Vec<Scene>>,
    samplers: Option<Vec<String>>,
    points: Option<Vec<String>>,
    filters: Option<Vec<String>>,
    methods: Option<Vec<MethodKeys>>,
    external: Option<Vec<ExternalKeys>>,
    baseline: Option<MethodKeys>,
    spp: Option<Vec<u64>>,
    seeds: Option<Seeds>,
    reference_spp: Option<u64>,
    resolution: Option<Resolution>,
    max_depth: Option<u32>,
    threads: Option<usize>,
    time_of: Option<u64>,
    fresh: Option<bool>,
    allow_unsupported: Option<bool>,
    quick: Option<bool>,
}

#[derive(Deserialize)]
#[serde(
    untagged,
    expecting = "a scene: \"NAME or path\", or { source = \"…\" } with name, reference, resolution, light_choice (power, uniform, learned)"
)]
enum Scene {
    Source(String),
    Keys(SceneKeys),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SceneKeys {
    source: String,
    name: Option<String>,
    reference: Option<String>,
    resolution: Option<Resolution>,
    #[serde(default)]
    light_choice: LightSelection,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ExternalKeys {
    name: String,
    command: Words,
}

#[derive(Deserialize)]
#[serde(untagged, expecting = "a command: \"PROGRAM {input} {output}\", or a list of its words where they hold blanks")]
enum Words {
    Line(String),
    List(Vec<String>),
}

#[derive(Deserialize)]
#[serde(
    untagged,
    expecting = "a method: \"SAMPLER/POINTS/FILTER\", or { sampler = \"…\", points = \"…\", filter = \"…\" }"
)]
enum MethodKeys {
    Words(String),
    Keys(MethodTable),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct MethodTable {
    sampler: String,
    points: Option<String>,
    filter: Option<String>,
}

#[derive(Deserialize)]
#[serde(untagged, expecting = "a resolution: \"128x128\" or [128, 128]")]
enum Resolution {
    Word(String),
    Sides([u32; 2]),
}

impl Draft {
    /// Reads a plan. Paths in it are relative to its folder.
    ///
    /// ```toml
    /// scenes = ["teapot", { source = "box.pbrt", name = "box", reference = "box-reference.exr" }]
    /// samplers = ["uniform", "variance", "mitchell:mode=budget"]
    /// filters = ["none", "gaussian"]
    /// methods = [{ sampler = "uniform", points = "halton" }]    # besides; points sobol and filter none if not said
    /// spp = [8, 16, 32, 64]
    /// seeds = 8                                                 # or a list
    /// reference_spp = 4096
    /// resolution = [128, 128]
    ///
    /// [[external]]                                              # a filter that is a program of somebody else's
    /// name = "oidn"
    /// command = "python3 oidn.py {input} {output}"
    /// ```
    ///
    /// The other keys are those of [`Draft`], by the same names.
    ///
    /// # Errors
    ///
    /// With file, line and key: for what is no TOML, unknown keys, values of another kind, and whatever
    /// [`Draft::resolve`] refuses.
    pub fn read(file: &Path) -> Result<Self, StudyError> {
        let text = std::fs::read_to_string(file).map_err(|e| StudyError::file(file, "read the plan", e))?;
        Ok(Self::parse(&text, file)?)
    }

    /// Reads a plan's text; `file` is its name, and leads to what it names.
    ///
    /// # Errors
    ///
    /// As [`Draft::read`].
    pub fn parse(text: &str, file: &Path) -> Result<Self, PlanError> {
        let keys: Keys = toml::from_str(text).map_err(|e| refused(&e, text, file))?;
        let folder = file.parent().unwrap_or(Path::new(""));
        let draft = keys.draft(folder).map_err(|e| placed(e, text, file))?;
        // What is wrong is found here, while the line is known.
        draft.clone().resolve().map_err(|e| placed(e, text, file))?;
        Ok(draft)
    }
}

impl Keys {
    fn draft(self, folder: &Path) -> Result<Draft, PlanError> {
        let resolution = self.resolution.map(Resolution::sides).transpose()?;
        let methods = self.methods.map(|all| all.into_iter().map(MethodKeys::method).collect()).transpose()?;
        let baseline = self.baseline.map(MethodKeys::method).transpose();
        Ok(Draft {
            scenes: self.scenes.map(|all| all.into_iter().map(|s| s.plan(folder)).collect()).transpose()?,
            samplers: self.samplers,
            points: self.points,
            filters: self.filters,
            methods,
            external: self.external.map(|all| all.into_iter().map(|e| e.external(folder)).collect()),
            baseline: baseline.map_err(|e| PlanError { key: "baseline".into(), ..e })?,
            spp: self.spp,
            seeds: self.seeds.map(Seeds::list),
            reference_spp: self.reference_spp,
            resolution,
            max_depth: self.max_depth,
            threads: self.threads,
            time_of: self.time_of,
            fresh: self.fresh,
            allow_unsupported: self.allow_unsupported,
            quick: self.quick,
        })
    }
}

impl Scene {
    fn plan(self, folder: &Path) -> Result<ScenePlan, PlanError> {
        // A bundled scene's name is no path, unless a file has it.
        let place = |source: String| match folder.join(&source) {
            path if !path.exists() && dapple_scene::bundled::names().contains(&source.as_str()) => source,
            path => path.display().to_string(),
        };
        match self {
            Self::Source(source) => Ok(ScenePlan { source: place(source), ..ScenePlan::default() }),
            Self::Keys(SceneKeys { source, name, reference, resolution, light_choice }) => Ok(ScenePlan {
                source: place(source),
                name,
                reference: reference.map(|file| folder.join(file)),
                resolution: resolution.map(Resolution::sides).transpose()?,
                lights: light_choice,
            }),
        }
    }
}

impl Resolution {
    fn sides(self) -> Result<[u32; 2], PlanError> {
        match self {
            Self::Word(word) => parse_resolution(&word).map_err(|e| PlanError::of_word("resolution", &word, e)),
            Self::Sides(sides) => Ok(sides),
        }
    }
}

impl ExternalKeys {
    fn external(self, folder: &Path) -> External {
        let command = match self.command {
            Words::Line(line) => line.split_whitespace().map(str::to_owned).collect(),
            Words::List(words) => words,
        };
        External { name: self.name, command, folder: folder.to_owned() }
    }
}

impl MethodKeys {
    fn method(self) -> Result<Method, PlanError> {
        match self {
            Self::Words(words) => words.parse(),
            Self::Keys(MethodTable { sampler, points, filter }) => {
                Ok(Method::new(&sampler, points.as_deref().unwrap_or("sobol"), filter.as_deref().unwrap_or("none")))
            }
        }
    }
}

/// What the TOML reader says, with file, line and key.
fn refused(error: &toml::de::Error, text: &str, file: &Path) -> PlanError {
    let at = error.span().map_or(0, |span| span.start.min(text.len()));
    let number = text.as_bytes()[..at].iter().filter(|b| **b == b'\n').count();
    // The value may stand below its key.
    let key = text.lines().take(number + 1).filter_map(key_of).last().unwrap_or("plan");
    let place = format!("{}:{}", file.display(), number + 1);
    PlanError { place: Some(place), ..PlanError::new(key, error.message()) }
}

/// The same error with the line of its key, or of its word below that.
fn placed(error: PlanError, text: &str, file: &Path) -> PlanError {
    let lines = || text.lines().enumerate();
    let keyed = |key: &str| lines().find(|(_, line)| key_of(line) == Some(key)).map(|(number, _)| number);
    let of_key = keyed(&error.key);
    // A word of a method is named by its kind, wherever it stands.
    let from = of_key.or_else(|| keyed("methods")).unwrap_or(0);
    let of_word = error.word.as_ref().and_then(|word| lines().skip(from).find(|(_, line)| line.contains(word)));
    let number = of_word.map(|(number, _)| number).or(of_key);
    let place = number.map_or_else(|| file.display().to_string(), |n| format!("{}:{}", file.display(), n + 1));
    PlanError { place: Some(place), ..error }
}

/// The key that a line gives a value to.
fn key_of(line: &str) -> Option<&str> {
    let (key, _) = line.split_once('=')?;
    let key = key.trim();
    (!key.is_empty() && key.chars().all(|c| c.is_ascii_alphanumeric() || c == '_' || c == '-')).then_some(key)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn said(text: &str) -> String {
        match Draft::parse(text, Path::new("some/plan.toml")) {
            Ok(_) => String::new(),
            Err(e) => e.to_string(),
        }
    }

    #[test]
    fn errors_name_file_line_and_key() {
        let cases = [
            ("spp = [8, \"a\"]", "some/plan.toml:1: spp: invalid type: string \"a\", expected u64"),
            ("# a\n\nspp = [\n  8,\n  8,\n]\n", "some/plan.toml:3: spp: a number is given twice"),
            ("spp = [0]", ":1: spp: 0: from 1"),
            ("spp = []", ":1: spp: the list is empty"),
            ("ssp = [8]", ":1: ssp: unknown field `ssp`, expected one of `scenes`, `samplers`"),
            ("spp = [8", ":1: spp: "),
            (
                "samplers = [\n  \"uniform\",\n  \"nonesuch\",\n]",
                ":3: samplers: there is no sampler \"nonesuch\": there are variance, ",
            ),
            ("filters = [\"nonesuch\"]", ":1: filters: there is no filter \"nonesuch\": there are none, "),
            ("points = [\"nonesuch\"]", ":1: points: there is no point set \"nonesuch\": there are sobol, "),
            ("samplers = [\"mitchell:nonesuch=2\"]", ":1: samplers: mitchell: there is no parameter \"nonesuch\""),
            ("methods = [\"uniform\",\n \"variance/nonesuch\"]", ":2: points: there is no point set"),
            ("methods = [\"a/b/c/d\"]", ":1: methods: a/b/c/d: SAMPLER/POINTS/FILTER"),
            ("samplers = [\"uniform\", \"uniform\"]", "uniform/sobol/none is given twice"),
            ("seeds = \"x\"", ":1: seeds: "),
            ("seeds = [1, 1]", ":1: seeds: a seed is given twice"),
            ("seeds = 0", ":1: seeds: the list is empty"),
            ("resolution = \"12\"", ":1: resolution: WIDTHxHEIGHT"),
            ("resolution = [0, 4]", ":1: resolution: "),
            ("time_of = 7", ":1: time_of: 7 is none of the spp (4, 8, 16, 32)"),
            ("reference_spp = 1", ":1: reference_spp: 1: from 2"),
            ("baseline = \"nonesuch\"", ":1: baseline: there is no sampler"),
            ("scenes = [{ name = \"a\" }]", ":1: scenes: "),
            ("threads = -1", ":1: threads: "),
            ("scenes = [{ source = \"teapot\", light_choice = \"nonesuch\" }]", ":1: scenes: "),
            ("scenes = [{ source = \"teapot\", resolution = \"0x4\" }]", "some/plan.toml: resolution: "),
            ("[[external]]\nname = \"a/b\"\ncommand = \"p {input} {output}\"", ":2: external: \"a/b\": a name without"),
            (
                "[[external]]\nname = \"nlm\"\ncommand = \"p {input} {output}\"",
                ":2: external: \"nlm\": a filter of ours",
            ),
            (
                "[[external]]\nname = \"a\"\ncommand = \"p {input}\"",
                "external: \"a\": the command is to hold a program",
            ),
            (
                "[[external]]\nname = \"a\"\ncommand = \"{input} {output}\"",
                "external: \"a\": the command is to hold a program",
            ),
            ("filters = [\"a\"]", "filters: there is no filter \"a\""),
        ];
        for (text, message) in cases {
            assert!(said(text).contains(message), "{text}: {}", said(text));
        }
        // The control: nothing is wrong with nothing.
        assert_eq!(said(""), "");
    }

    #[test]
    fn a_file_says_what_words_say() {
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
        let plan = Draft::parse(text, Path::new("some/plan.toml")).unwrap().resolve().unwrap();
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
    fn words_override_the_file() {
        let file = Draft::parse("spp = [2, 4]\nseeds = 3", Path::new("plan.toml")).unwrap();
        let words = Draft { spp: Some(vec![7]), quick: Some(true), ..Draft::default() };
        let sized = "scenes = [{ source = \"teapot\", resolution = [5, 6], light_choice = \"cells\" }]";
        let sized = Draft::parse(sized, Path::new("plan.toml")).unwrap();
        let scene = &sized.scenes.as_ref().unwrap()[0];
        assert_eq!((scene.resolution, scene.lights), (Some([5, 6]), LightSelection::Learned));
        let resized = sized.overridden_by(Draft { resolution: Some([7, 8]), ..Draft::default() }).resolve().unwrap();
        assert_eq!((resized.scenes[0].resolution, resized.resolution), (None, Some([7, 8])));
        let plan = file.overridden_by(words).resolve().unwrap();
        assert_eq!((plan.spp, plan.seeds, plan.time_of, plan.side), (vec![7], vec![1, 2, 3], Some(7), 64));
    }
}
