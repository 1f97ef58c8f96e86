//! The arguments of `dapple study`.

use crate::render::args::resolution;
use crate::{Failure, Result};
use dapple_study::{External, Method, Plan, PlanPatch, ScenePlan, StudyError, split_names};
use std::path::PathBuf;

/// Measure accuracy against time: samplers x filters x budgets x seeds over scenes
///
/// Every combination is rendered with every seed, timed and compared with a reference: at the same numbers of samples
/// per pixel, and in the time that the baseline takes. Methods take turns run by run, so that a machine that slows
/// down does so for all. Each finished run is a line of runs.jsonl in the folder DIR. The same command resumes a study
/// that was stopped or killed.
///
/// All images are made with a box of one pixel as their pixel filter. References are rendered once, by points that
/// no method uses, in two halves whose difference tells their own error.
#[derive(clap::Args)]
#[command(after_help = AFTER)]
pub(crate) struct StudyArgs {
    /// Scene files, models, bundled scenes, or names of scenes of the plan [default: teapot terrain]
    #[arg(value_name = "SCENE")]
    scenes: Vec<String>,

    /// A plan in TOML, with these options as its keys; options given here override it
    #[arg(long, value_name = "FILE")]
    plan: Option<PathBuf>,

    /// The folder for all results
    #[arg(short, long = "output", value_name = "DIR", default_value = "study")]
    pub(super) output: PathBuf,

    /// Samplers, by commas or one at a time [default: uniform,variance,cluster-thesis]
    ///
    /// A comma before key=value belongs to the name before it: `mitchell:mode=budget,radius=2,variance` are two.
    #[arg(long, value_name = "NAME[:key=value,…],…", help_heading = "Methods")]
    samplers: Vec<String>,

    /// Point sets, each with every sampler and filter [default: sobol]
    #[arg(long, value_name = "NAME[:…],…", help_heading = "Methods")]
    points: Vec<String>,

    /// Filters, each with every sampler [default: none,gaussian]
    #[arg(long, value_name = "NAME[:…],…", help_heading = "Methods")]
    filters: Vec<String>,

    /// One method, by itself; may be given again. Points are sobol and the filter is none by default
    ///
    /// Besides those of --samplers; without these, all there are.
    #[arg(long = "method", value_name = "SAMPLER[/POINTS[/FILTER]]", help_heading = "Methods")]
    methods: Vec<Method>,

    /// An external program as a filter, by its name for --filters and --method; may be given again
    ///
    /// It reads the unfiltered image with albedo and normal (EXR) and writes an image (EXR or PFM). No shell reads the
    /// arguments. A last line {"seconds": 0.25} is its time; without one, the wall's.
    #[arg(long, value_name = "NAME=PROGRAM {input} {output}", help_heading = "Methods")]
    external: Vec<External>,

    /// The method that the others are compared with [default: uniform/sobol/none]
    #[arg(long, value_name = "SAMPLER[/POINTS[/FILTER]]", help_heading = "Methods")]
    baseline: Option<Method>,

    /// Samples per pixel [default: 4,8,16,32]
    #[arg(long, value_name = "N,…", value_delimiter = ',', help_heading = "Budgets")]
    spp: Vec<u64>,

    /// Number of seeds; each combination is rendered with each [default: 8]
    #[arg(long, value_name = "N", help_heading = "Budgets")]
    #[arg(value_parser = clap::value_parser!(u64).range(1..=100_000))]
    seeds: Option<u64>,

    /// Equal-time runs take as long as the baseline with N spp, one of --spp; 0 leaves them out [default: the largest
    /// but one]
    #[arg(long, value_name = "N", help_heading = "Budgets")]
    time_of: Option<u64>,

    /// Compare with this image; given again for each scene, in their order
    #[arg(long, value_name = "FILE", help_heading = "References", conflicts_with = "reference_spp")]
    reference: Vec<PathBuf>,

    /// Samples per pixel of rendered references [default: 1024]
    #[arg(long, value_name = "N", help_heading = "References")]
    reference_spp: Option<u64>,

    /// Keep rendered references in this folder, where other studies find them
    #[arg(long, value_name = "DIR", help_heading = "References")]
    pub(super) references: Option<PathBuf>,

    /// Width and height in pixels [default: the reference file's, else 128x128]
    #[arg(long, value_name = "WxH", value_parser = resolution)]
    resolution: Option<[u32; 2]>,

    /// Most scattering events between camera and light [default: each scene's]
    #[arg(long, value_name = "N")]
    max_depth: Option<u32>,

    /// Threads to use; 0 is one per core
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(..=1024))]
    threads: Option<u16>,

    /// Make each run in a process of its own: none profits from another's warm caches, at the price of reading the
    /// scene each time
    #[arg(long)]
    fresh: bool,

    /// A study of under a minute: 64x64 pixels, 4 seeds, 4, 8 and 16 spp by default
    #[arg(long)]
    quick: bool,

    /// List what the renderer cannot do as warnings, rather than refusing a scene
    #[arg(long)]
    allow_unsupported: bool,

    /// No progress and no list of files; warnings remain
    #[arg(short, long)]
    pub(super) quiet: bool,
}

const AFTER: &str = "\
Examples:
  dapple study --quick
  dapple study scene.pbrt -o scene-study
  dapple study teapot cornell --samplers uniform,variance,mitchell:mode=budget,radius=2 --filters none,gaussian
  dapple study scene.pbrt --spp 8,16,32,64 --seeds 8 --reference reference.exr -o scene-study --fresh
  dapple study --plan study.toml -o results

A plan, every key optional:
  scenes = [\"teapot\", { source = \"box.pbrt\", name = \"box\", reference = \"box.exr\" }]
  samplers = [\"uniform\", \"variance\", \"mitchell:mode=budget\"]
  methods = [\"uniform/halton\", { sampler = \"variance\", points = \"random\", filter = \"gaussian\" }]
  spp = [8, 16, 32, 64]
  seeds = 8
  resolution = [128, 128]
  [[external]]
  name = \"oidn\"
  command = \"python3 oidn.py {input} {output}\"

Ctrl-C stops after the current run; the same command resumes. `dapple samplers`, `points` and `filters`
list what can be compared.";

/// An error in the arguments or in the plan file.
pub(super) enum Wrong {
    /// An error in the arguments, as a message.
    Arguments(String),
    /// An error in the plan file.
    File(Failure),
}

impl StudyArgs {
    /// The plan: the settings of the plan file, overridden by the arguments.
    pub(super) fn plan(&self) -> std::result::Result<Plan, Wrong> {
        let file = self.file().map_err(Wrong::File)?;
        let arguments = self.draft(&file).map_err(Wrong::Arguments)?;
        // Underscores are the file's way of writing.
        let flag = |e: dapple_study::PlanError| format!("--{}: {}", e.key.replace('_', "-"), e.message);
        file.merge(arguments).resolve().map_err(|e| Wrong::Arguments(flag(e)))
    }

    fn file(&self) -> Result<PlanPatch> {
        let Some(file) = &self.plan else { return Ok(PlanPatch::default()) };
        PlanPatch::read(file).map_err(|e: StudyError| Failure::lines(&e))
    }

    fn draft(&self, file: &PlanPatch) -> std::result::Result<PlanPatch, String> {
        let lists = |all: &[String]| {
            let words: Vec<String> = all.iter().flat_map(|list| split_names(list)).collect();
            (!all.is_empty()).then_some(words)
        };
        let said = |flag: bool| flag.then_some(true);
        Ok(PlanPatch::default()
            .scenes(self.scenes(file)?)
            .samplers(lists(&self.samplers))
            .points(lists(&self.points))
            .filters(lists(&self.filters))
            .methods((!self.methods.is_empty()).then(|| self.methods.clone()))
            .external((!self.external.is_empty()).then(|| self.external.clone()))
            .baseline(self.baseline.clone())
            .spp((!self.spp.is_empty()).then(|| self.spp.clone()))
            .seeds(self.seeds.map(|count| (1..=count).collect()))
            .reference_spp(self.reference_spp)
            .resolution(self.resolution)
            .max_depth(self.max_depth)
            .threads(self.threads.map(usize::from))
            .time_of(self.time_of)
            .fresh(said(self.fresh))
            .allow_unsupported(said(self.allow_unsupported))
            .quick(said(self.quick)))
    }

    /// The scenes from the arguments, else those of the plan file, with the references from the arguments.
    fn scenes(&self, file: &PlanPatch) -> std::result::Result<Option<Vec<ScenePlan>>, String> {
        let planned = |name: &str| file.scenes.iter().flatten().find(|s| s.name.as_deref() == Some(name)).cloned();
        let named: Vec<ScenePlan> =
            self.scenes.iter().map(|s| planned(s).unwrap_or_else(|| ScenePlan::from(s.as_str()))).collect();
        let named = if named.is_empty() { None } else { Some(named) };
        if self.reference.is_empty() {
            return Ok(named);
        }
        let mut scenes = named.or_else(|| file.scenes.clone()).unwrap_or_default();
        if scenes.len() != self.reference.len() {
            let (scenes, references) = (scenes.len(), self.reference.len());
            return Err(format!(
                "{references} --reference for {scenes} SCENE: name the scenes, and give as many references, in their order"
            ));
        }
        for (scene, reference) in scenes.iter_mut().zip(&self.reference) {
            scene.reference = Some(reference.clone());
        }
        Ok(Some(scenes))
    }
}
