//! The subcommand `dapple render`.

pub(crate) mod args;
mod file_conflicts;
pub(crate) mod live;
pub(crate) mod many;
pub(crate) mod values;

pub(crate) use args::{RenderArgs, described_in};

use crate::machine::{Stop, cpu_seconds, start_threads};
use crate::output::{say, tell, warn};
use crate::progress::Progress;
use crate::{Failure, Outcome, Result, failure};
use dapple_job::memory::{MemoryEstimate, MemoryLimit, resident, size};
use dapple_job::{
    Checkpoints, Job, JobError, LoadOptions, LoadedScene, OutputFiles, PhaseSeconds, RenderSpec, RenderedImage, Traced,
    Warning,
};
use dapple_scene::Scene;
use dapple_scene::text::file_stem;
use live::Live;
use serde::Serialize;
use std::path::{Path, PathBuf};
use values::EachLayer;

pub(crate) fn run(args: &RenderArgs) -> Result<Outcome> {
    if let Some(part) = args.part {
        args.check_part().map_err(|wrong| Failure::usage("render", wrong))?;
        return many::part(args, part);
    }
    let spec = args.spec()?;
    if args.print_spec {
        tell(spec.to_json_pretty().map_err(Failure::new)?)?;
        return Ok(Outcome::Done);
    }
    if let Some(plan) = args.outputs.iter().find(|path| values::has_extension(path, "plan")) {
        return many::first_plan(&spec, plan, &args.into());
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
    let show = Show::from(args);
    let Some(Ready { mut job, expected, cpu, mut progress, checkpoints }) = ready(args, spec, &show, &stop, false)?
    else {
        return Ok(Outcome::Interrupted);
    };
    progress.begin(&job);
    let traced = job.run(checkpoints, &mut progress)?;
    show.deliver(&job, traced, (Some(&expected), cpu), progress)
}

/// A render that is ready to take its first sample.
struct Ready {
    job: Job,
    expected: MemoryEstimate,
    cpu: Option<f64>,
    progress: Progress,
    checkpoints: Option<Checkpoints>,
}

/// Prepares a render, in stages or not; `None` if the user stopped it.
fn ready(args: &RenderArgs, spec: &RenderSpec, show: &Show<'_>, stop: &Stop, in_stages: bool) -> Result<Option<Ready>> {
    // The checkpoint file is locked first, so that a second process with the same file fails at once.
    let checkpoints = args.checkpoints().open()?;
    let progress = Progress::new(show, stop.clone(), Live::open(args)?);
    let (keeps, limit) = (checkpoints.is_some(), limit(args.memory));
    progress.phase("reading");
    let loaded = load(spec, limit, keeps || in_stages)?;
    let files = show.files(&loaded)?;
    file_conflicts::check(args, &loaded, &files)?;
    files.prepare()?;
    warn_all(&loaded.warnings);
    let Some((mut job, cpu)) = prepare(loaded, files, &progress)? else { return Ok(None) };
    let expected = if in_stages { job.memory_in_stages() } else { job.memory(keeps) };
    let expected = if args.is_live() { expected.with_live_image(job.frame()) } else { expected };
    expected.check(limit)?;
    Ok(Some(Ready { job, expected, cpu, progress, checkpoints }))
}

/// Returns the given memory limit, or the machine's memory for `None`.
fn limit(given: Option<u64>) -> MemoryLimit {
    given.map_or_else(MemoryLimit::of_machine, MemoryLimit::given)
}

/// Filters the merged film of parts, or of a plan whose samples are all traced, and writes the image files.
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
    let loaded = load(spec, limit, true)?;
    let files = show.files(&loaded)?;
    file_conflicts::check_inputs(&loaded, None, files.paths().map(|path| ("--output", path)))?;
    files.prepare()?;
    warn_all(&loaded.warnings);
    let Some((mut job, cpu)) = prepare(loaded, files, &progress)? else { return Ok(Outcome::Interrupted) };
    let expected = job.memory(false).with_film_in_memory();
    if expected.check(limit).is_err() {
        let limit = limit.bytes().map_or_else(String::new, size);
        let wrong = format!("creating the image takes {expected}, but the limit is {limit}; raise --memory");
        return Err(Failure::new(wrong));
    }
    let traced = film(&mut job)?;
    show.deliver(&job, traced, (None, cpu), progress)
}

fn load(spec: &RenderSpec, limit: MemoryLimit, digest: bool) -> Result<LoadedScene> {
    let loaded = LoadedScene::read(spec, &LoadOptions { limit, digest })?;
    loaded.memory.check(limit)?;
    Ok(loaded)
}

/// Prepares the job. Also returns the processor seconds used before clustering, if the system reports them. The result
/// is `None` if the user stopped it.
fn prepare(loaded: LoadedScene, files: OutputFiles, progress: &Progress) -> Result<Option<(Job, Option<f64>)>> {
    progress.phase("building");
    let (spec, warned) = (loaded.spec.clone(), loaded.warnings.len());
    let prepared = loaded.build()?;
    warn_all(&prepared.loaded.warnings[warned..]);
    if progress.stop.asked() {
        warn(NOTHING);
        return Ok(None);
    }
    let cpu = cpu_seconds();
    progress.phase("preparing the methods");
    let mut job = prepared.job(&spec)?;
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

/// The estimated memory of a render (unknown for merged parts), and the processor seconds used before the render.
type Before<'a> = (Option<&'a MemoryEstimate>, Option<f64>);

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
    /// Returns the image files to write; an empty list for a part.
    fn files(&self, loaded: &LoadedScene) -> Result<OutputFiles> {
        let files = match self.outputs {
            [] => OutputFiles::defaults(&name(&loaded.scene), &loaded.spec.sampler),
            outputs => OutputFiles::images(outputs).map_err(Failure::new)?,
        };
        let mut files = self.maps.map_or(files.clone(), |folder| files.with_maps(folder));
        (files.exposure, files.features, files.half) = (self.exposure, self.features, self.half);
        files.layers = self.layers.map(|layers| layers.iter().filter_map(|layer| layer.0.map(str::to_owned)).collect());
        files.command = Some(crate::machine::command());
        Ok(files)
    }

    /// Filters the film, writes the image files and prints the summary.
    fn deliver(
        &self,
        job: &Job,
        traced: Traced,
        (expected, cpu): Before<'_>,
        mut progress: Progress,
    ) -> Result<Outcome> {
        let Traced { film, failure: panicked, checkpoint, checkpoints_written } = traced;
        progress.phase("filter");
        let mut image = job.finish(film)?;
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
            let (written, warnings) = job.outputs().write(job, &image, cpu)?;
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

/// The default name of output files: the file name in the scene's film settings, without folder and extension, else the
/// scene's name.
fn name(scene: &Scene) -> String {
    let given = scene.film.file_name.as_deref().and_then(|file| file_stem(Path::new(file)));
    given.unwrap_or_else(|| scene.name.clone())
}

/// Returns the outcome of the program, after all files are written. `checkpoint` is the written checkpoint file, or the error
/// of writing it, and the number of checkpoints written in all.
fn end(
    interrupted: bool,
    panicked: Option<String>,
    (checkpoint, written): (Option<std::result::Result<PathBuf, JobError>>, u64),
) -> Result<Outcome> {
    let has_none = matches!(checkpoint, Some(Err(_))) && written == 0;
    let resume = match checkpoint.transpose() {
        Err(trouble) if interrupted => return Err(failure::of_job(&trouble)),
        Err(trouble) => {
            warn(trouble.to_string());
            None
        }
        Ok(resume) => resume,
    };
    match panicked {
        Some(message) => Err(Failure::new(message + "; the samples taken before are saved")),
        None if interrupted => {
            say("interrupted", "the image uses the samples taken so far");
            if let Some(path) = resume {
                say("interrupted", &format!("to resume, repeat the command with --resume {}", path.display()));
            }
            Ok(Outcome::Interrupted)
        }
        None if has_none => Ok(Outcome::NoCheckpoint),
        None => Ok(Outcome::Done),
    }
}

/// A finished image with its job, from which the result is formatted.
struct Report<'a> {
    job: &'a Job,
    image: &'a RenderedImage,
    cpu: Option<f64>,
    /// The estimated memory of the render; `None` for merged parts, which other machines rendered.
    expected: Option<&'a MemoryEstimate>,
}

/// The JSON line that is printed; its keys have the order of the fields. An unknown value is null.
#[derive(Serialize)]
struct Line<'a> {
    scene: &'a str,
    sampler: &'a str,
    points: &'a str,
    filter: &'a str,
    seed: u64,
    threads: usize,
    resolution: [u32; 2],
    samples: u64,
    spp: f64,
    rays: u64,
    seconds: PhaseSeconds,
    render_s: f64,
    cpu: Option<f64>,
    predicted_relmse: Option<f64>,
    predicted_relmse_filtered: Option<f64>,
    rejected: u64,
    effects: Vec<&'static str>,
    without: Vec<&'static str>,
}

impl Report<'_> {
    /// Formats the result of the render as one line of JSON.
    fn json(&self) -> String {
        let (job, image, record) = (self.job, self.image, self.image.film.record());
        let line = Line {
            scene: &job.scene().name,
            sampler: job.sampler_described(),
            points: job.points_described(),
            filter: &image.filter,
            seed: job.spec().seed,
            threads: rayon::current_num_threads(),
            resolution: job.frame().resolution(),
            samples: record.samples,
            spp: image.spp(),
            rays: image.rays(),
            seconds: image.seconds,
            render_s: image.seconds.render(),
            cpu: self.cpu,
            predicted_relmse: image.film.predicted_relmse(),
            predicted_relmse_filtered: record.filtered_relmse,
            rejected: record.rejected,
            effects: job.world().effects().called().iter().map(|c| c.effect.name()).collect(),
            without: job.prepared().loaded.without.iter().map(|e| e.name()).collect(),
        };
        // Serialising plain numbers and text cannot fail.
        serde_json::to_string(&line).unwrap_or_default()
    }

    /// Formats the result of the render as at most five lines of text. The settings are in the header of EXR files, and in
    /// the line of JSON.
    fn summary(&self) -> String {
        let (job, image, film) = (self.job, self.image, &self.image.film);
        let [w, h] = film.frame().size();
        let seconds = image.seconds.render();
        let counts = film.counts();
        let (least, most) = (counts.iter().min().copied().unwrap_or(0), counts.iter().max().copied().unwrap_or(0));
        let rate = film.record().rays as f64 / image.seconds.trace.max(1e-9) * 1e-6;
        // The filter that `best` selects depends on the machine.
        let filter = image.filter.split(':').next().filter(|_| job.spec().filter.trim() == "best");
        let filter = filter.map_or_else(String::new, |name| format!(", filtered by {name}"));
        let scene = &job.scene().name;
        let mut lines = vec![
            format!("{scene}, {w}x{h}: {:.2} spp ({least} to {most}) in {seconds:.2} s{filter}", image.spp()),
            format!("{} samples, {} rays, {rate:.2} million rays per second", film.record().samples, image.rays()),
        ];
        let record = film.record();
        if record.passes > 0 {
            let (passes, rays, seconds) = (record.passes, record.prepare_rays, record.prepare_seconds);
            let name = job.integrator();
            lines.push(format!("{name}: {passes} passes from the lights, {rays} rays in {seconds:.2} s of this time"));
        }
        if let Some(relmse) = film.predicted_relmse() {
            let filtered = film.record().filtered_relmse;
            let filtered = filtered.map_or_else(String::new, |filtered| format!(", filtered {filtered:.3e}"));
            lines.push(format!("predicted relMSE {relmse:.3e}{filtered}"));
        }
        if let Some(expected) = self.expected {
            let taken = resident().map_or_else(String::new, |[_, most]| format!("{} taken, ", size(most)));
            lines.push(format!("memory: {taken}{expected} expected"));
        }
        lines.join("\n")
    }
}
