//! A small scene, plans for it, and runs without rendering.
#![allow(dead_code)] // Each test file uses a part.

use dapple_study::{
    InProcess, Method, Phases, Plan, Run, RunBudget, RunRequest, Runner, Study, StudyError, StudyOptions,
};
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// A floor under a large lamp out of view. It renders quickly with about equal noise in all pixels, so that a few seeds
/// suffice.
pub(crate) const TINY: &str = r#"LookAt 0 4 4  0 0 0  0 1 0
Camera "perspective" "float fov" [ 40 ]
Film "rgb" "integer xresolution" [ 24 ] "integer yresolution" [ 16 ] "string filename" [ "tiny.exr" ]
WorldBegin
Material "diffuse" "rgb reflectance" [ 0.5 0.5 0.5 ]
Include "floor.pbrt"
AttributeBegin
  AreaLightSource "diffuse" "rgb L" [ 4 4 4 ]
  Translate 0 6 -3
  Shape "sphere" "float radius" [ 3 ]
AttributeEnd
"#;
pub(crate) const FLOOR: &str = r#"Shape "trianglemesh" "integer indices" [ 0 1 2 0 2 3 ]
  "point3 P" [ -9 0 -9  -9 0 9  9 0 9  9 0 -9 ]
"#;

/// A folder with the scene in it, and a study beside it.
pub(crate) struct Place(TempDir);

impl Place {
    pub(crate) fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join("tiny.pbrt"), TINY).expect("the scene");
        std::fs::write(folder.path().join("floor.pbrt"), FLOOR).expect("its floor");
        Self(folder)
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub(crate) fn text(&self, name: &str) -> String {
        std::fs::read_to_string(self.path(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
    }

    /// Two budgets, two seeds, two methods, 8x8 pixels and a reference of few samples, with these replacements.
    pub(crate) fn plan(&self, sets: &[&str]) -> Plan {
        let text = format!(
            "{}\nsamplers = [\"uniform\", \"variance\"]\nfilters = [\"none\"]\nspp = [4, 8]\nseeds = 2\n\
             reference_spp = 16\nresolution = [8, 8]\n",
            self.scenes(&[""])
        );
        let sets: Vec<String> = sets.iter().map(|set| (*set).to_owned()).collect();
        Plan::parse(&text, &self.path("plan.toml"), &sets).expect("a plan")
    }

    /// The scenes of a plan: the small scene, once for each of these further settings.
    pub(crate) fn scenes(&self, more: &[&str]) -> String {
        let scene = |more: &&str| format!("{{ source = {:?}, {more} }}", self.path("tiny.pbrt"));
        format!("scenes = [{}]", more.iter().map(scene).collect::<Vec<_>>().join(", "))
    }

    pub(crate) fn open(&self, plan: Plan, name: &str) -> Result<Study, StudyError> {
        let study = Study::open(plan, &self.path(name), &StudyOptions::default(), &mut ());
        study.map(|study| study.expect("not stopped"))
    }

    /// Opens a study and runs it to the end.
    pub(crate) fn study(&self, plan: Plan, name: &str, runner: &mut dyn Runner) -> Study {
        let mut study = self.open(plan, name).expect("it opens");
        study.run(runner, &mut ()).expect("it runs");
        study
    }
}

pub(crate) fn in_process() -> InProcess {
    InProcess::new(|| None)
}

/// Makes runs up: times and errors are functions of the request.
#[derive(Default)]
pub(crate) struct Fake {
    /// The number of requests so far.
    pub(crate) asked: usize,
}

/// The time of a made-up run. A method with `variance` takes 1.5 times as long per sample. A filter costs a tenth of a
/// millisecond, whatever the samples.
fn phases(method: &Method, samples: u64) -> Phases {
    let rate = if method.sampler.starts_with("variance") { 1.5e-6 } else { 1e-6 };
    let filter = if method.filter == "none" { 0.0 } else { 1e-4 };
    Phases { trace: rate * samples as f64, filter, ..Phases::default() }
}

impl Runner for Fake {
    fn run(&mut self, request: &RunRequest) -> Result<Run, StudyError> {
        self.asked += 1;
        let seconds = phases(&request.method, request.asked);
        let pixels = f64::from(request.view.resolution[0]) * f64::from(request.view.resolution[1]);
        // A seed's luck, the same for all methods.
        let error = (1.0 + 0.01 * request.seed as f64) / request.asked as f64;
        let errors = dapple_metrics::METRICS.iter().map(|metric| (metric.name, error));
        Ok(Run {
            scene: request.view.name.clone(),
            method: request.method.clone(),
            budget: request.budget,
            seed: request.seed,
            asked: request.asked,
            samples: request.asked,
            spp: request.asked as f64 / pixels,
            rays: 3 * request.asked,
            seconds,
            render_s: seconds.render(),
            errors: errors.chain([("relmse", 2.0 * error), ("psnr", 30.0), ("mean_ratio", 1.0)]).collect(),
            corrected: true,
            image: request.image.clone(),
            ..Run::default()
        })
    }
}

/// The label that identifies a run.
pub(crate) fn label(run: &Run) -> String {
    let budget = match run.budget {
        RunBudget::Spp(n) => format!("{n}"),
        RunBudget::TimeOf(n) => format!("t{n}"),
    };
    format!("{} {} {budget} {}", run.scene, run.method, run.seed)
}

/// Copies the files of a folder; of its folders only the references.
pub(crate) fn copy(from: &Path, to: &Path) {
    for folder in ["", "references"] {
        std::fs::create_dir_all(to.join(folder)).expect("a folder");
        for entry in std::fs::read_dir(from.join(folder)).expect("the folder") {
            let path = entry.expect("an entry").path();
            if path.is_file() {
                std::fs::copy(&path, to.join(folder).join(path.file_name().expect("a name"))).expect("a copy");
            }
        }
    }
}
