//! The subcommand `dapple farm`: files of a job for a scheduler or a render farm.

mod systems;

use crate::output::tell;
use crate::render::RenderArgs;
use crate::{Failure, Outcome, Result};
use clap::builder::{PathBufValueParser, TypedValueParser};
use clap::parser::ValueSource;
use clap::{ArgMatches, Args, Command, FromArgMatches, ValueEnum};
use dapple_job::{BudgetSpec, RenderSpec};
use dapple_scene::bundled;
use dapple_scene::image::Format;
use dapple_scene::text::file_stem;
use std::path::{Path, PathBuf};
use systems::{Files, quoted};

/// Write a job that renders an image on many machines: scripts for Slurm, or a template for OpenJD, OpenCue or Kubernetes
///
/// Nothing is started. DIR gets render.json (the render settings), stage.sh (the commands of every task), and
/// the scheduler's own files. All machines need DIR and the scene at the same path, and `dapple` in their PATH or its
/// path in the variable DAPPLE. Resubmit a failed job unchanged; finished tasks are skipped.
#[derive(Args)]
pub(crate) struct FarmOptions {
    /// Scheduler or render farm
    #[arg(value_name = "SYSTEM")]
    system: System,

    /// Number of parts, each rendered by a task of its own
    #[arg(long, value_name = "N", default_value_t = 16, help_heading = "Job")]
    #[arg(value_parser = clap::value_parser!(u32).range(1..=10_000))]
    parts: u32,

    /// Image file to write at the end: .exr, .pfm or .png, in DIR unless absolute; may be repeated [default: image.exr]
    #[arg(long = "image", value_name = "FILE", value_parser = image(), help_heading = "Job")]
    images: Vec<PathBuf>,

    /// Attempts per task
    #[arg(long, value_name = "N", default_value_t = 3, help_heading = "Job")]
    #[arg(value_parser = clap::value_parser!(u32).range(1..=100))]
    tries: u32,

    /// Number of sampling stages in the job (openjd and opencue only) [default: derived from --spp]
    ///
    /// Methods that learn from samples render in stages, each after the previous one. Surplus stages exit at once;
    /// with too few, the image is not made.
    #[arg(long, value_name = "N", help_heading = "Job")]
    #[arg(value_parser = clap::value_parser!(u32).range(1..=1000))]
    stages: Option<u32>,

    /// Container image of the pods (k8s), with `dapple` in its PATH
    #[arg(long, value_name = "NAME", default_value = "dapple", help_heading = "Job")]
    container: String,

    /// Persistent volume claim of the pods (k8s), mounted at DIR
    #[arg(long, value_name = "NAME", default_value = "dapple", help_heading = "Job")]
    claim: String,

    /// OpenCue's show of the job (opencue)
    #[arg(long, value_name = "NAME", default_value = "testing", value_parser = word, help_heading = "Job")]
    show: String,
}

/// The systems for which jobs are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum System {
    /// Slurm: job arrays with dependencies
    Slurm,
    /// Open Job Description: a template, for AWS Deadline Cloud and others
    Openjd,
    /// OpenCue: a job specification
    Opencue,
    /// Kubernetes: an Indexed Job
    K8s,
}

/// The options of the job and of the render. `-o` names the job's folder.
pub(crate) struct FarmArgs {
    options: FarmOptions,
    render: RenderArgs,
    /// The option of `dapple render` that was given but cannot be used in a job; `None` if there is none.
    refused: Option<&'static str>,
}

/// Options of `dapple render` with another help text in a job.
const HELP: &[(&str, &str)] = &[
    ("outputs", "Folder for the job's files; if it exists, results of an identical earlier job are reused"),
    (
        "light_selection",
        "How lights (and parts of environment maps) are selected: power (in proportion to power), uniform, or learned (from samples) [default: learned]",
    ),
    (
        "spec",
        "Read the render settings from this JSON file, in place of SCENE and the options of Method, Budget, Bounds and Image",
    ),
    ("seed", "Seed of all random numbers; the same seed gives the same image on any number of machines"),
    ("memory", "Memory limit of each task, such as 2G, 500M or a number of bytes [default: the machine's memory]"),
    ("threads", "Number of threads of each task; 0 is one per core"),
    ("quiet", "Print only warnings and errors"),
];

/// Options of `dapple render` that concern a single process, so that a job refuses them.
const REFUSED: &str = "maps features preview view preview_every progress_every layers half checkpoint checkpoint_every resume \
    part from print_spec json exposure";

impl Args for FarmArgs {
    fn augment_args(command: Command) -> Command {
        let about = FarmOptions::augment_args(Command::new("farm"));
        let (short, long) = (about.get_about().cloned(), about.get_long_about().cloned());
        let command = RenderArgs::augment_args(FarmOptions::augment_args(command));
        let command = command.mut_arg("outputs", |output| {
            output.value_parser(clap::value_parser!(PathBuf)).value_name("DIR").required(true)
        });
        let mut command = command.after_help(include_str!("help/farm.txt").trim_end());
        for (id, help) in HELP {
            command = command.mut_arg(id, |argument| argument.help(*help).long_help(*help));
        }
        // A job refuses a time budget, with a reason of its own.
        for id in REFUSED.split(' ').chain(["time"]) {
            command = command.mut_arg(id, |argument| argument.hide(true));
        }
        match (short, long) {
            (Some(short), Some(long)) => command.about(short).long_about(long),
            _ => command,
        }
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl FromArgMatches for FarmArgs {
    fn from_arg_matches(matches: &ArgMatches) -> std::result::Result<Self, clap::Error> {
        let given = |id: &str| matches.value_source(id) == Some(ValueSource::CommandLine);
        let refused = REFUSED.split(' ').find(|id| given(id));
        let (options, render) = (FarmOptions::from_arg_matches(matches)?, RenderArgs::from_arg_matches(matches)?);
        Ok(Self { options, render, refused })
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> std::result::Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

pub(crate) fn run(args: &FarmArgs) -> Result<Outcome> {
    let FarmArgs { options, render, refused } = args;
    if let Some(id) = refused {
        let option = id.replace('_', "-");
        let wrong = format!("--{option} concerns a single process and cannot be used in a job; remove this option");
        return Err(Failure::usage("farm", wrong));
    }
    let [folder] = &render.outputs[..] else {
        return Err(Failure::usage("farm", "--output takes exactly one folder; give the folder for the job's files"));
    };
    let job = Job::new(options, render, folder)?;
    let mut files = Files::new(folder)?;
    files.add("render.json", &job.spec.to_json_pretty().map_err(Failure::new)?)?;
    files.add("stage.sh", &job.filled(include_str!("farm/stage.sh")))?;
    let next = match options.system {
        System::Slurm => systems::slurm(&job, &mut files)?,
        System::Openjd => systems::openjd(&job, &mut files)?,
        System::Opencue => systems::opencue(&job, &mut files)?,
        System::K8s => systems::kubernetes(&job, &mut files)?,
    };
    files.finish()?;
    if !render.quiet {
        tell(format!("{}: a job of {} parts", folder.display(), options.parts))?;
        tell(format!("next: {next}"))?;
    }
    Ok(Outcome::Done)
}

/// The settings of a job that the job files of all systems share.
struct Job<'a> {
    options: &'a FarmOptions,
    spec: RenderSpec,
    /// The absolute path of the job's folder.
    folder: String,
    name: String,
    images: Vec<String>,
    threads: u16,
    memory: Option<u64>,
    /// An upper bound on the number of stages; `None` if it is unknown.
    stages: Option<u32>,
}

impl<'a> Job<'a> {
    fn new(options: &'a FarmOptions, render: &RenderArgs, folder: &Path) -> Result<Self> {
        let mut spec = render.spec()?;
        if matches!(spec.budget, BudgetSpec::Seconds(_)) {
            let wrong = "--time cannot be used, since the tasks of a job have no common clock; use --spp or --error (--time works with mpirun)";
            return Err(Failure::usage("farm", wrong));
        }
        let name = file_stem(&spec.scene).unwrap_or_else(|| "render".into());
        if !bundled::names().iter().any(|name| spec.scene == Path::new(name)) {
            let scene = std::path::absolute(&spec.scene).map_err(Failure::new)?;
            if !scene.exists() {
                return Err(Failure::new(format!("{}: no such file; pass the path of a scene file", scene.display())));
            }
            spec.scene = scene;
        }
        let images = match &options.images[..] {
            [] => vec!["image.exr".to_owned()],
            images => images.iter().map(|path| text(path)).collect::<Result<_>>()?,
        };
        let stages = options.stages.or(most_stages(&spec));
        let folder = text(&std::path::absolute(folder).map_err(Failure::new)?)?;
        Ok(Self { options, spec, folder, name, images, threads: render.threads, memory: render.memory, stages })
    }

    /// The job's name in lower case, with letters, digits and dashes only.
    fn plain_name(&self) -> String {
        let plain = |c: char| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '-' };
        let name: String = self.name.chars().map(plain).take(40).collect();
        format!("dapple-{}", name.trim_matches('-'))
    }

    /// The number of stages, for systems whose job files must state it.
    fn stages(&self) -> Result<u32> {
        let wrong = "the number of stages is unknown; use --spp, or --stages N (surplus stages do nothing)";
        self.stages.ok_or_else(|| Failure::new(wrong))
    }

    /// Replaces placeholders such as `@NAME@` in `text` by the job's settings.
    fn filled(&self, text: &str) -> String {
        let threads = if self.threads > 0 { format!(" --threads {}", self.threads) } else { String::new() };
        let memory = self.memory.map_or_else(String::new, |bytes| format!(" --memory {bytes}"));
        let cores =
            if self.threads > 0 { format!("#SBATCH --cpus-per-task={}\n", self.threads) } else { String::new() };
        let mebibytes = |bytes: u64| format!("#SBATCH --mem={}M\n", bytes.div_ceil(1 << 20));
        let outputs: String = self.images.iter().map(|image| format!(" -o {}", quoted(image))).collect();
        filled(
            text,
            &[
                ("PARTS", &self.options.parts.to_string()),
                ("TRIES", &self.options.tries.to_string()),
                ("RETRIES", &(self.options.tries - 1).to_string()),
                ("SHOW", &self.options.show),
                ("LIMITS", &format!("{threads}{memory}")),
                ("OUTPUTS", &outputs),
                ("NAME", &self.plain_name()),
                ("FOLDER", &quoted(&self.folder)),
                ("NEEDS", &format!("{cores}{}", self.memory.map_or_else(String::new, mebibytes))),
            ],
        )
    }
}

/// Replaces each placeholder in `text`, a name between two `@`, by its value.
fn filled(text: &str, values: &[(&str, &str)]) -> String {
    values.iter().fold(text.to_owned(), |text, (name, value)| text.replace(&format!("@{name}@"), value))
}

/// A path as text; an error if job files cannot hold it.
fn text(path: &Path) -> Result<String> {
    let text = path.to_str().filter(|text| !text.contains(['\n', '\0']));
    let wrong = "the path is not UTF-8 or has line breaks; rename the file";
    text.map(str::to_owned).ok_or_else(|| Failure::new(format!("{}: {wrong}", path.display())))
}

/// A parser of names of image files.
fn image() -> impl TypedValueParser<Value = PathBuf> {
    PathBufValueParser::new().try_map(|path| Format::from_path(&path).map(|_| path).map_err(|e| e.to_string()))
}

/// Parses a word of letters, digits and underscores.
fn word(text: &str) -> std::result::Result<String, String> {
    let plain = !text.is_empty() && text.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
    if plain { Ok(text.to_owned()) } else { Err("only letters, digits and underscores are allowed".into()) }
}

/// An upper bound on the number of stages: training passes of 1, 1, 2, 4, … samples per pixel, plus rounds of the sampler,
/// which may end within a pass.
fn most_stages(spec: &RenderSpec) -> Option<u32> {
    /// The number of rounds of the default sampler, plus a margin for other samplers.
    const ROUNDS: u32 = 5;
    match spec.budget {
        BudgetSpec::Spp(spp) => Some(1 + spp.max(1.0).log2().ceil() as u32 + ROUNDS),
        _ => None,
    }
}
