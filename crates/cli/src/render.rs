//! The subcommand `dapple render`.

pub(crate) mod args;
mod file_conflicts;
pub(crate) mod live;
pub(crate) mod many;
mod progress;
mod report;
pub(crate) mod values;

pub(crate) use args::{RenderArgs, described_in};

use crate::machine::{cpu_seconds, start_threads};
use crate::output::{say, tell, warn};
use crate::stop::Stop;
use crate::{Failure, Outcome, Result, failure};
use dapple_job::memory::{MemoryLimit, size};
use dapple_job::{Job, JobError, LoadOptions, LoadedScene, OutputFiles, RenderSpec, Traced, Warning, can_be_replayed};
use dapple_scene::Scene;
use live::Live;
use progress::Progress;
use report::Report;
use std::path::{Path, PathBuf};
use values::EachLayer;

pub(crate) fn run(args: &RenderArgs) -> Result<Outcome> {
    if let Some(shard) = args.shard {
        args.check_part().map_err(|wrong| Failure::usage("render", wrong))?;
        return many::part(args, shard);
    }
    let spec = args.spec()?;
    if args.print_spec {
        tell(spec.to_json_pretty().map_err(Failure::new)?)?;
        return Ok(Outcome::Done);
    }
    if let Some(plan) = args.outputs.iter().find(|path| values::has_extension(path, "plan")) {
        return many::first_plan(&spec, plan, &many::PlanOptions::from(args));
    }
    match many::processes()? {
        Some(processes) => many::together(args, &spec, processes),
        None => alone(args, &spec),
    }
}

/// Renders the whole image in this process.
fn alone(args: &RenderArgs, spec: &RenderSpec) -> Result<Outcome> {
    let stop = Stop::listen()?;
    start_threads(args.threads)?;
    // The checkpoint file is locked first, so that a second process with the same file fails at once.
    let checkpoints = args.checkpoints().open().map_err(|e| failure::of_job(&e))?;
    let show = Show::from(args);
    let mut progress = Progress::new(&show, stop, Live::open(&args.live())?);
    let keeps = checkpoints.is_some();
    let limit = args.memory.map_or_else(MemoryLimit::of_machine, MemoryLimit::given);
    let options = LoadOptions::default().with_limit(limit);
    let options = if keeps { options } else { options.without_digest() };
    progress.phase("reading");
    let loaded = load(spec, &options, limit)?;
    let files = show.files(&loaded)?;
    file_conflicts::check(args, &loaded, &files)?;
    files.prepare().map_err(|e| failure::of_job(&e))?;
    warn_all(loaded.warnings());
    let Some((mut job, cpu)) = prepare(loaded, files, &progress)? else { return Ok(Outcome::Interrupted) };
    let expected = job.memory(keeps).map_err(|e| failure::of_job(&e))?;
    let expected = if args.live().is_on() { expected.with_live_image(job.frame()) } else { expected };
    expected.check(limit).map_err(|e| failure::of_job(&e))?;
    progress.begin(&job);
    let traced = job.run(checkpoints, &mut progress).map_err(|e| failure::of_job(&e))?;
    show.deliver(&job, traced, (Some(&expected), cpu), progress)
}

/// Filters the merged film of shards, or of a plan whose samples are all traced, and writes the image files.
pub(crate) fn merge(
    film: impl FnOnce(&mut Job) -> std::result::Result<Traced, JobError>,
    spec: &RenderSpec,
    show: &Show<'_>,
    (threads, limit): (u16, MemoryLimit),
) -> Result<Outcome> {
    let stop = Stop::listen()?;
    start_threads(threads)?;
    let progress = Progress::new(show, stop, Live::default());
    progress.phase("reading");
    let loaded = load(spec, &LoadOptions::default().with_limit(limit), limit)?;
    let files = show.files(&loaded)?;
    file_conflicts::check_inputs(&loaded, files.paths().map(|path| ("--output", path)))?;
    files.prepare().map_err(|e| failure::of_job(&e))?;
    warn_all(loaded.warnings());
    let Some((mut job, cpu)) = prepare(loaded, files, &progress)? else { return Ok(Outcome::Interrupted) };
    let expected = job.memory(false).map_err(|e| failure::of_job(&e))?.with_film_in_memory();
    if expected.check(limit).is_err() {
        let limit = limit.bytes().map_or_else(String::new, size);
        let wrong = format!("making the image takes {expected}, and {limit} is the limit; raise --memory");
        return Err(Failure::new(wrong));
    }
    let traced = film(&mut job).map_err(|e| failure::of_job(&e))?;
    show.deliver(&job, traced, (None, cpu), progress)
}

fn load(spec: &RenderSpec, options: &LoadOptions, limit: MemoryLimit) -> Result<LoadedScene> {
    let loaded = LoadedScene::read(spec, options).map_err(|e| failure::of_job(&e))?;
    loaded.memory().check(limit).map_err(|e| failure::of_job(&e))?;
    Ok(loaded)
}

/// Prepares the job. Also returns the processor seconds used before clustering, if the system reports them. The result
/// is `None` if the user stopped it.
fn prepare(loaded: LoadedScene, files: OutputFiles, progress: &Progress) -> Result<Option<(Job, Option<f64>)>> {
    progress.phase("building");
    let (spec, warned) = (loaded.spec().clone(), loaded.warnings().len());
    let prepared = loaded.build().map_err(|e| failure::of_job(&e))?;
    warn_all(&prepared.warnings()[warned..]);
    if progress.stop.asked() {
        warn(NOTHING);
        return Ok(None);
    }
    let cpu = cpu_seconds();
    progress.phase("preparing the methods");
    let mut job = prepared.job(&spec).map_err(|e| failure::of_job(&e))?;
    job.set_outputs(files);
    Ok(Some((job, cpu)))
}

const NOTHING: &str = "stopped before the first sample: nothing is saved";

/// Prints warnings, to stderr.
fn warn_all(warnings: &[Warning]) {
    warnings.iter().for_each(|warning| warn(failure::warning(warning)));
}

/// The options for an image's files and for its summary.
#[derive(Default)]
pub(crate) struct Show<'a> {
    pub(crate) outputs: &'a [PathBuf],
    pub(crate) maps: Option<&'a Path>,
    pub(crate) features: bool,
    /// True stores colours in EXR files as 16-bit floats.
    pub(crate) half: bool,
    /// The layers of EXR files; `None` for all.
    pub(crate) layers: Option<&'a [EachLayer]>,
    pub(crate) exposure: f32,
    pub(crate) json: bool,
    pub(crate) quiet: bool,
    /// Seconds between plain lines of progress, instead of a bar.
    pub(crate) progress_every: Option<f64>,
}

/// The estimated memory of a render, which is unknown for merged shards, and the processor seconds before it.
type Before<'a> = (Option<&'a dapple_job::memory::MemoryEstimate>, Option<f64>);

impl<'a> From<&'a RenderArgs> for Show<'a> {
    fn from(args: &'a RenderArgs) -> Self {
        Self {
            outputs: &args.outputs,
            maps: args.maps.as_deref(),
            features: args.features,
            half: args.half,
            layers: args.layers.as_deref(),
            exposure: args.exposure,
            json: args.json,
            quiet: args.quiet,
            progress_every: args.progress_every,
        }
    }
}

impl Show<'_> {
    /// Returns the image files to write; an empty list for a shard.
    fn files(&self, loaded: &LoadedScene) -> Result<OutputFiles> {
        let files = match self.outputs {
            [] => OutputFiles::defaults(&name(loaded.scene()), &loaded.spec().sampler),
            outputs => OutputFiles::images(outputs).map_err(Failure::new)?,
        };
        let files = self.maps.map_or(files.clone(), |folder| files.with_maps(folder)).with_exposure(self.exposure);
        let files = files.with_command(crate::machine::command());
        let files = if self.features { files.with_features() } else { files };
        let files = if self.half { files.with_half() } else { files };
        let files = match self.layers {
            Some(layers) => files.with_layers(layers.iter().filter_map(|layer| layer.0)),
            None => files,
        };
        Ok(files)
    }

    /// Filters the film, together with other processes if they have it too, writes the image files and prints the summary.
    fn deliver(
        &self,
        job: &Job,
        traced: Traced,
        (expected, cpu): Before<'_>,
        mut progress: Progress,
    ) -> Result<Outcome> {
        let Traced { film, failure: panicked, checkpoint, checkpoints_written } = traced;
        progress.phase("filter");
        let mut image = job.finish(film).map_err(|e| failure::of_job(&e))?;
        let cpu = cpu_seconds().zip(cpu).map(|(after, before)| after - before);
        let shown = |warning: &&Warning| panicked.is_none() || !matches!(warning, Warning::ErrorNotReached { .. });
        image.warnings.iter().filter(shown).for_each(|warning| warn(failure::warning(warning)));
        let interrupted = image.film.record().interrupted;
        if image.film.record().samples == 0 {
            warn(NOTHING);
        } else {
            progress.phase("writing");
            progress.finish(&image);
            let clock = std::time::Instant::now();
            let (written, warnings) = job.outputs().write(job, &image, cpu).map_err(|e| failure::of_job(&e))?;
            image.seconds.write = clock.elapsed().as_secs_f64();
            warn_all(&warnings);
            drop(progress);
            self.report(&Report { job, image: &image, cpu, expected }, &written)?;
        }
        end(interrupted, panicked, (checkpoint, checkpoints_written))
    }

    /// Prints the result: a line of JSON, or a summary and the files written.
    fn report(&self, report: &Report<'_>, written: &[String]) -> Result<()> {
        if self.json {
            return tell(report.json());
        }
        if !self.quiet {
            tell(report.summary())?;
            written.iter().try_for_each(tell)?;
        }
        Ok(())
    }
}

/// The name of output files: that of the scene file's own output, without folder and extension; else the scene's.
fn name(scene: &Scene) -> String {
    let given = scene.film.file_name.as_deref().and_then(|file| Path::new(file).file_stem());
    given.map_or_else(|| scene.name.clone(), |stem| stem.to_string_lossy().into_owned())
}

/// The outcome of the program, after all files are written. `checkpoint` is the written checkpoint file, or the error
/// of writing it, and the number of checkpoints written in all.
fn end(
    interrupted: bool,
    panicked: Option<String>,
    (checkpoint, written): (Option<std::result::Result<PathBuf, JobError>>, u64),
) -> Result<Outcome> {
    let has_none = matches!(checkpoint, Some(Err(_))) && written == 0;
    let resume = match checkpoint {
        Some(Err(trouble)) if interrupted => return Err(failure::of_job(&trouble)),
        Some(Err(trouble)) => {
            warn(trouble.to_string());
            None
        }
        Some(Ok(path)) => Some(path),
        None => None,
    };
    match panicked {
        Some(message) => Err(Failure::new(message + "; the samples before it are saved")),
        None if interrupted => {
            say("interrupted", "the image holds the samples until then");
            if let Some(path) = resume {
                say("interrupted", &format!("the same command with --resume {} resumes it", path.display()));
            }
            Ok(Outcome::Interrupted)
        }
        None if has_none => Ok(Outcome::NoCheckpoint),
        None => Ok(Outcome::Done),
    }
}

/// Advice on how to replay only the rejected sample `first`, by command-line options; `None` if that is impossible.
pub(crate) fn replay(first: &dapple_core::Rejected) -> Option<String> {
    let [x, y] = first.sample.pixel;
    let (spp, right, below) = (first.sample.index + 1, x + 1, y + 1);
    let crop = format!("{x},{y},{right},{below}");
    can_be_replayed(first).then(|| format!("replay it with --sampler uniform --spp {spp} --crop {crop}"))
}
