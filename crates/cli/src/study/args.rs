//! The arguments of `dapple study`.

use crate::render::values::{light_selection, resolution};
use crate::{Failure, Result};
use dapple_core::Shard;
use dapple_renderer::light::LightSelection;
use dapple_study::{External, Method, Plan, PlanPatch, ScenePlan, StudyError, split_names};
use std::path::PathBuf;

/// Measure error against render time: samplers x point sets x filters x budgets x seeds over scenes
///
/// Every combination is rendered with every seed, timed and compared with a reference. Methods are compared at the same
/// samples per pixel, and in the time that the baseline takes. Methods alternate run by run, so that a temporary
/// slowdown of the machine affects all of them. Each finished run is a line of runs.jsonl in the folder DIR, beside report.html. The same command resumes a stopped
/// or killed study.
///
/// The first method is that of `dapple render` without options: its sampler, points, filter and light selection.
///
/// The pixel filter of all images is a box one pixel wide. References are rendered once, with a point set that no
/// method uses, in two halves whose difference estimates the reference's own error.
#[derive(clap::Args)]
#[command(after_help = AFTER)]
pub(crate) struct StudyArgs {
    /// Scene files, models, bundled scenes, or names of scenes in the plan [default: teapot terrain]
    #[arg(value_name = "SCENE")]
    scenes: Vec<String>,

    /// Plan as a TOML file, with keys like these options; options on the command line override it
    #[arg(long, value_name = "FILE")]
    plan: Option<PathBuf>,

    /// Folder for all results
    #[arg(short, long = "output", value_name = "DIR", default_value = "study")]
    pub(super) output: PathBuf,

    /// Samplers, separated by commas or by repeating the option [default: adaptive,uniform]
    ///
    /// After a comma, key=value is a parameter of the preceding name: `mitchell:mode=budget,radius=2,variance` are two
    /// samplers.
    #[arg(long, value_name = "NAME[:key=value,…],…", help_heading = "Methods")]
    samplers: Vec<String>,

    /// Point sets, each combined with every sampler and filter [default: sobol]
    #[arg(long, value_name = "NAME[:…],…", help_heading = "Methods")]
    points: Vec<String>,

    /// Filters (denoisers), each combined with every sampler and point set [default: cluster-regression,none]
    #[arg(long, value_name = "NAME[:…],…", help_heading = "Methods")]
    filters: Vec<String>,

    /// Single method; may be repeated. Points default to sobol, the filter to none
    ///
    /// Without --samplers, only these methods run. With it, they run besides its combinations.
    #[arg(long = "method", value_name = "SAMPLER[/POINTS[/FILTER]]", help_heading = "Methods")]
    methods: Vec<Method>,

    /// External program as a filter, which --filters and --method can use by NAME; may be repeated
    ///
    /// The program reads the unfiltered image with albedo, normals and depth (EXR), and writes an image (EXR or PFM).
    /// No shell interprets the arguments. A last line of output such as {"seconds": 0.25} sets its time; without such a
    /// line, its wall time counts.
    #[arg(long, value_name = "NAME=PROGRAM {input} {output}", help_heading = "Methods")]
    external: Vec<External>,

    /// Rule by which light sampling selects one of several lights: power, uniform or learned [default: learned]
    #[arg(long, value_name = "HOW", value_parser = light_selection, help_heading = "Methods")]
    light_selection: Option<LightSelection>,

    /// Method with which the others are compared [default: uniform/sobol/none]
    #[arg(long, value_name = "SAMPLER[/POINTS[/FILTER]]", help_heading = "Methods")]
    baseline: Option<Method>,

    /// Budgets in mean samples per pixel [default: 4,8,16,32]
    #[arg(long, value_name = "N,…", value_delimiter = ',', value_parser = samples, help_heading = "Budgets")]
    spp: Vec<u64>,

    /// Number of seeds; each method is rendered once per seed and budget [default: 8]
    #[arg(long, value_name = "N", help_heading = "Budgets")]
    #[arg(value_parser = clap::value_parser!(u64).range(1..=100_000))]
    seeds: Option<u64>,

    /// Equal-time runs take as long as the baseline takes with N samples per pixel; N is one of --spp, and 0 means no
    /// such runs [default: the second largest of --spp]
    #[arg(long, value_name = "N", help_heading = "Budgets")]
    time_of: Option<u64>,

    /// Reference image of a scene; repeat it for each SCENE, in the same order
    #[arg(long, value_name = "FILE", help_heading = "References", conflicts_with = "reference_spp")]
    reference: Vec<PathBuf>,

    /// Samples per pixel of rendered reference images [default: 1024]
    #[arg(long, value_name = "N", help_heading = "References")]
    reference_spp: Option<u64>,

    /// Folder for rendered references that several studies share [default: in the study's folder]
    #[arg(long, value_name = "DIR", help_heading = "References")]
    pub(super) references: Option<PathBuf>,

    /// Width and height of images in pixels [default: the reference file's, else 128x128]
    #[arg(long, value_name = "WxH", value_parser = resolution)]
    resolution: Option<[u32; 2]>,

    /// Largest number of scattering events between camera and light [default: the limit in each scene]
    #[arg(long, value_name = "N")]
    max_depth: Option<u32>,

    /// Number of threads; 0 is one per core
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(..=1024))]
    threads: Option<u16>,

    /// Start a new process for each run, so that no run profits from caches of another one; the scene is read for every
    /// run
    #[arg(long)]
    fresh: bool,

    /// Make a study of less than a minute; unless set otherwise, 64x64 pixels, 4 seeds, and 4, 8 and 16 samples per pixel
    #[arg(long)]
    quick: bool,

    /// Render without unsupported features of scenes, with warnings, instead of refusing them
    #[arg(long)]
    allow_unsupported: bool,

    /// Write the report and the other files of the study in the folder of --output anew, without runs
    #[arg(long, conflicts_with_all = ["scenes", "plan"])]
    pub(super) report_only: bool,

    /// Make only runs I, I + N and so on, in a folder shard-I-of-N of --output, for --merge; without equal-time runs
    ///
    /// Every machine of a job array makes a shard. References are shared in the folder `references` of --output, unless
    /// --references names another: let one shard end before the others begin, or each renders its own.
    #[arg(long, value_name = "I/N", value_parser = dapple_job::parse_shard, conflicts_with = "report_only")]
    pub(super) shard: Option<Shard>,

    /// Merge the finished runs of all shards in the folder of --output, and write the report
    ///
    /// Seconds measured on machines of different kinds are marked in runs.jsonl and in the report.
    #[arg(long, conflicts_with_all = ["scenes", "plan", "shard", "report_only"])]
    pub(super) merge: bool,

    /// Show no progress and no list of files; warnings are still printed
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
  dapple study --report-only -o results            the report anew, from runs.jsonl
  dapple study --plan study.toml -o results --shard 3/8     one of eight machines
  dapple study --merge -o results                  the study of all shards

A plan, every key optional:
  scenes = [\"teapot\", { source = \"box.pbrt\", name = \"box\", reference = \"box.exr\" }]
  samplers = [\"uniform\", \"variance\", \"mitchell:mode=budget\"]
  methods = [\"uniform/halton\", { sampler = \"variance\", points = \"random\", filter = \"gaussian\" }]
  lights = \"learned\"
  spp = [8, 16, 32, 64]
  seeds = 8
  resolution = [128, 128]
  [[external]]
  name = \"oidn\"
  command = \"python3 oidn.py {input} {output}\"

The folder holds the report (report.html), tables (summary.csv, runs.csv with a line per run), images named by method,
latex/ (tables for booktabs, curves for pgfplots: `pdflatex study.tex`), notebook.ipynb (pandas), and viewer/ (images
for tev and JERI).

Ctrl-C stops after the current run; the same command resumes. `dapple samplers`, `points` and `filters`
list what can be compared.";

fn samples(word: &str) -> std::result::Result<u64, String> {
    word.parse().map_err(|_| "a whole number of samples per pixel is required".to_owned())
}

/// An error in the arguments or in the plan file.
pub(super) enum Wrong {
    /// An error in the arguments, as a message.
    Arguments(String),
    /// An error in the plan file.
    File(Failure),
}

impl StudyArgs {
    /// Makes the plan: the settings of the plan file, overridden by the arguments.
    pub(super) fn plan(&self) -> std::result::Result<Plan, Wrong> {
        let file = self.file().map_err(Wrong::File)?;
        let arguments = self.draft(&file).map_err(Wrong::Arguments)?;
        // Keys of plan files have underscores, and options have hyphens.
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
            .lights(self.light_selection)
            .spp((!self.spp.is_empty()).then(|| self.spp.clone()))
            .seeds(self.seeds.map(|count| (1..=count).collect()))
            .reference_spp(self.reference_spp)
            .resolution(self.resolution)
            .max_depth(self.max_depth)
            .threads(self.threads.map(usize::from))
            .time_of(self.time_of.or(self.shard.map(|_| 0)))
            .fresh(said(self.fresh))
            .allow_unsupported(said(self.allow_unsupported))
            .quick(said(self.quick)))
    }

    /// The scenes from the arguments, or else from the plan file, with the reference files from the arguments. `None`
    /// if the arguments set neither scenes nor references.
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
