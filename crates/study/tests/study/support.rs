//! A small scene with plans, runs without rendering, and synthetic studies with a known report.

use dapple_scene::image::{Image, Layer, encode_exr, encode_png_gray, write_file};
use dapple_study::{
    ImageErrors, InProcess, Machine, Manifest, Method, Phases, Plan, ReferenceRecord, Run, RunBudget, RunRequest,
    Runner, SceneRecord, Study, StudyError, StudyOptions,
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

/// Synthetic runs: times and errors are functions of the request.
#[derive(Default)]
pub(crate) struct Fake {
    /// The number of requests so far.
    pub(crate) asked: usize,
}

/// The time of a made-up run. A method with `variance` takes 1.5 times as long per sample. A filter takes a tenth of a
/// millisecond for any number of samples.
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
        // The factor of the seed, equal for all methods.
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

/// Copies a folder's files, and of its subfolders only the references.
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

/// The behaviour of a method.
#[derive(Clone)]
pub(crate) struct Law {
    pub(crate) method: Method,
    /// relMSE at one sample per pixel, times `spp^slope`.
    pub(crate) scale: f64,
    pub(crate) slope: f64,
    /// Seconds per sample per pixel, and seconds per image.
    pub(crate) seconds: f64,
    pub(crate) overhead: f64,
    /// The random stream of the errors.
    pub(crate) stream: u64,
}

impl Law {
    pub(crate) fn new(sampler: &str, filter: &str) -> Self {
        let method = Method::new(sampler, "sobol", filter);
        let stream = method.sampler.bytes().chain(method.filter.bytes()).fold(7, |h, b| mix(h ^ u64::from(b)));
        Self { method, scale: 1.0, slope: -1.0, seconds: 0.01, overhead: 0.0, stream }
    }

    pub(crate) fn errors(self, scale: f64) -> Self {
        Self { scale, ..self }
    }

    pub(crate) fn slope(self, slope: f64) -> Self {
        Self { slope, ..self }
    }

    pub(crate) fn seconds(self, seconds: f64) -> Self {
        Self { seconds, ..self }
    }

    pub(crate) fn overhead(self, overhead: f64) -> Self {
        Self { overhead, ..self }
    }

    /// A run whose errors and seconds follow the law, with the seed's noise on the errors: a standard deviation of 5 %.
    pub(crate) fn run(&self, scene: &str, budget: RunBudget, seed: u64, base: &Law) -> Run {
        let spp = match budget {
            RunBudget::Spp(spp) => spp as f64,
            RunBudget::TimeOf(spp) => (base.cost(spp as f64) - self.overhead).max(0.2 * self.seconds) / self.seconds,
        };
        let of_budget = match budget {
            RunBudget::Spp(spp) => spp,
            RunBudget::TimeOf(spp) => 1000 + spp,
        };
        let place = scene.bytes().fold(self.stream ^ mix(seed) ^ of_budget, |h, b| mix(h ^ u64::from(b)));
        let relmse = self.scale * spp.powf(self.slope) * (0.05 * normal(place)).exp();
        let filter = if self.method.filter == "none" { 0.0 } else { 0.25 * self.overhead };
        let trace = spp * self.seconds;
        let seconds = Phases {
            load: 0.012,
            bvh: 0.02,
            cluster: 0.5 * self.overhead,
            first_hits: 0.2 * self.overhead,
            plan: 0.3 * self.overhead - filter,
            trace,
            filter,
        };
        Run {
            scene: scene.into(),
            method: self.method.clone(),
            budget,
            seed,
            asked: (spp * 4096.0) as u64,
            samples: (spp * 4096.0) as u64,
            spp,
            rays: (spp * 12288.0) as u64,
            seconds,
            render_s: seconds.render(),
            errors: errors(relmse),
            corrected: true,
            predicted_relmse: (self.method.sampler != "uniform").then_some(1.1 * relmse),
            load: Some(0.4),
            ..Run::default()
        }
    }

    fn cost(&self, spp: f64) -> f64 {
        self.overhead + self.seconds * spp
    }
}

pub(crate) fn errors(relmse: f64) -> ImageErrors {
    let values = [
        ("mse", 0.3 * relmse),
        ("relmse", relmse),
        ("relmse_trimmed", 0.9 * relmse),
        ("smape", relmse.sqrt().min(2.0)),
        ("psnr", -10.0 * (0.3 * relmse).log10()),
        ("srgb8_mse", 900.0 * relmse),
        ("flip", (0.5 * relmse.sqrt()).min(1.0)),
        ("mean_ratio", 1.0 + 0.01 * relmse),
    ];
    values.into_iter().collect()
}

/// A complete study's manifest and runs, for tests to change.
#[derive(Clone)]
pub(crate) struct MadeUp {
    pub(crate) manifest: Manifest,
    pub(crate) runs: Vec<Run>,
    pub(crate) size: [u32; 2],
}

impl MadeUp {
    /// The first law is the baseline.
    pub(crate) fn new(scenes: &[&str], laws: &[Law], spp: &[u64], time_of: Option<u64>, seeds: u64) -> Self {
        let size = [96, 60];
        let manifest = Manifest {
            version: "0.1.0".into(),
            commit: Some("0123abc+".into()),
            command: ["dapple", "study", "a plan.toml", "--set", "spp=[4, 8]"].map(String::from).to_vec(),
            began: "2026-11-21T12:00:00Z".into(),
            machine: Machine {
                processor: Some("A & B <fast>".into()),
                threads: 2,
                system: "linux x86_64".into(),
                ..Machine::default()
            },
            scenes: scenes.iter().map(|name| scene(name, size)).collect(),
            methods: laws.iter().map(|law| law.method.clone()).collect(),
            baseline: laws[0].method.clone(),
            spp: spp.to_vec(),
            time_of,
            seeds: (1..=seeds).collect(),
            ..Manifest::default()
        };
        let budgets = spp.iter().map(|&s| RunBudget::Spp(s)).chain(time_of.map(RunBudget::TimeOf));
        let mut runs = Vec::new();
        for scene in scenes {
            for budget in budgets.clone() {
                for seed in 1..=seeds {
                    runs.extend(laws.iter().map(|law| law.run(scene, budget, seed, &laws[0])));
                }
            }
        }
        Self { manifest, runs, size }
    }

    /// Sets another size of images.
    pub(crate) fn resized(mut self, size: [u32; 2]) -> Self {
        self.size = size;
        self.manifest.scenes.iter_mut().for_each(|scene| scene.resolution = size);
        self
    }

    /// Writes the study. `images` adds the images of the first seed, with noise as large as the error.
    pub(crate) fn write(&mut self, folder: &Path, images: bool) {
        if images {
            self.write_images(folder);
        }
        let manifest = serde_json::to_vec_pretty(&self.manifest).unwrap();
        std::fs::write(folder.join("study.json"), manifest).unwrap();
        let lines: Vec<String> = self.runs.iter().map(|run| serde_json::to_string(run).unwrap() + "\n").collect();
        std::fs::write(folder.join("runs.jsonl"), lines.concat()).unwrap();
    }

    fn write_images(&mut self, folder: &Path) {
        for name in ["images", "references"] {
            std::fs::create_dir_all(folder.join(name)).unwrap();
        }
        let size = self.size;
        let exr = |pixels: Vec<[f32; 3]>| {
            let image = Image::new(size, pixels).unwrap();
            encode_exr(size, &[Layer::of_image("", &image)], &[]).unwrap().bytes
        };
        for scene in &self.manifest.scenes {
            write_file(&folder.join(&scene.reference.file), &exr(truth(size))).unwrap();
        }
        let first = self.manifest.seeds[0];
        // Only images that a page shows.
        let last = RunBudget::Spp(self.manifest.spp.iter().copied().max().unwrap_or(0));
        let shown = |run: &Run| run.seed == first && (run.budget == last || matches!(run.budget, RunBudget::TimeOf(_)));
        for (index, run) in self.runs.iter_mut().enumerate().filter(|(_, run)| shown(run)) {
            let noise = run.errors.get("relmse").sqrt();
            // An adaptive method has noise in other pixels.
            let shift = if run.method.sampler == "uniform" { 0 } else { size[0] / 3 };
            let pixels = truth(size).into_iter().enumerate().map(|(i, p)| {
                let column = (i as u32 + shift) % size[0];
                let local = noise * (0.4 + 1.2 * f64::from(column) / f64::from(size[0]));
                let off = local * normal(mix((index * 100_000 + i) as u64));
                p.map(|v| (f64::from(v) + f64::from(v + 0.1) * off).max(0.0) as f32)
            });
            let file = format!("images/{index}.exr");
            write_file(&folder.join(&file), &exr(pixels.collect())).unwrap();
            let counts: Vec<u8> = (0..size[0] * size[1]).map(|i| ((i % size[0]) * 255 / size[0]) as u8).collect();
            let map = format!("images/{index}.png");
            write_file(&folder.join(&map), &encode_png_gray(size, &counts).unwrap()).unwrap();
            (run.image, run.sample_map) = (Some(file), Some(map));
            run.white = Some(2.0 * run.spp);
        }
    }
}

fn scene(name: &str, size: [u32; 2]) -> SceneRecord {
    let reference = ReferenceRecord {
        file: format!("references/{name}.exr"),
        spp: Some(65536),
        points: Some("random".into()),
        seeds: Some([901, 902]),
        relmse: Some(1.5e-6),
        hash: "0123456789abcdef0123456789abcdef".into(),
    };
    let source = format!("bundled {name}");
    SceneRecord { name: name.into(), source, resolution: size, reference, ..SceneRecord::default() }
}

/// A reference image that resembles a ball over a chequered floor.
fn truth([width, height]: [u32; 2]) -> Vec<[f32; 3]> {
    let at = |i: u32| {
        let [x, y] = [(i % width) as f32 / width as f32, (i / width) as f32 / height as f32];
        let [dx, dy] = [(x - 0.5) * width as f32 / height as f32, y - 0.45];
        let r2 = (dx * dx + dy * dy) / 0.09;
        if r2 < 1.0 {
            let light = (0.3 + 0.7 * ((1.0 - r2).sqrt() - dx - dy)).clamp(0.03, 1.0);
            [0.8 * light, 0.35 * light, 0.2 * light]
        } else if y > 0.6 {
            let dark = ((x * 12.0 / (0.2 + y)) as u32 + (6.0 / (y - 0.45)) as u32).is_multiple_of(2);
            [if dark { 0.08 } else { 0.6 }; 3]
        } else {
            [0.25 + 0.3 * y, 0.35 + 0.3 * y, 0.6]
        }
    };
    (0..width * height).map(at).collect()
}

pub(crate) fn mix(x: u64) -> u64 {
    let x = (x ^ (x >> 30)).wrapping_add(0x9e37_79b9_7f4a_7c15).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

/// A nearly normal number: the sum of twelve uniform numbers less 6.
pub(crate) fn normal(place: u64) -> f64 {
    let place = mix(place);
    (0..12).map(|i| mix(place ^ (i << 40)) as f64 / u64::MAX as f64).sum::<f64>() - 6.0
}

/// A typical study: two scenes, two samplers, two filters.
pub(crate) fn example() -> MadeUp {
    let laws = [
        Law::new("uniform", "none").slope(-1.2),
        Law::new("uniform", "cluster-gaussian").slope(-0.9).errors(0.35).overhead(0.02),
        Law::new("mitchell", "none").slope(-1.2).errors(1.15).seconds(0.011),
        Law::new("mitchell", "cluster-gaussian").slope(-0.95).errors(0.42).seconds(0.011).overhead(0.02),
        Law::new("cluster", "none").slope(-1.22).errors(0.85).overhead(0.05),
        Law::new("cluster", "cluster-gaussian").slope(-0.95).errors(0.25).overhead(0.06),
    ];
    MadeUp::new(&["cornell-box", "teapot"], &laws, &[4, 8, 16, 32, 64], Some(32), 8)
}
