//! `dapple render`.

mod checkpoints;
mod files;
pub(crate) mod foresight;
pub(crate) mod identity;
mod memory;
pub(crate) mod options;
mod progress;
mod report;
mod settings;
pub(crate) mod shard;

pub(crate) use options::{Options, Words};

use crate::machine::{cpu_seconds, start_threads};
use crate::output::{say, tell, warn};
use crate::stop::Stop;
use crate::{Failure, Outcome, Result, scene};
use checkpoints::Checkpoints;
use clap::CommandFactory;
use clap::error::ErrorKind;
use dapple_core::{Error, Film, Filter, Needs, Sampler, Sharded, Unfiltered, streams};
use dapple_job::checkpoint::{Identity, Store};
use dapple_job::{Stage, WorldClusters};
use dapple_renderer::{World, integrator, without};
use dapple_scene::Scene;
use dapple_scene::{Effect, Effects};
use files::Files;
use memory::{Expected, Limit};
use progress::Progress;
use report::{Report, Seconds};
use settings::{Methods, Settings, no_shard};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

/// Mean samples per pixel where no budget is given. What a scene file suggests is often one sample, for a
/// quick look with another renderer.
const DEFAULT_SPP: f64 = 64.0;

pub(crate) fn run(options: &Options) -> Result<Outcome> {
    make(options, None)
}

/// Makes the image of a film that is there already, rendered with these words: what `identity` says of it must hold here.
pub(crate) fn show(options: &Options, film: Film, identity: &Identity) -> Result<Outcome> {
    make(options, Some((film, identity)))
}

fn make(options: &Options, merged: Option<(Film, &Identity)>) -> Result<Outcome> {
    if let Err(wrong) = options.check() {
        refuse(&wrong);
    }
    let stop = Stop::listen()?;
    start_threads(options.threads)?;
    // Before anything long: a second process learns at once that it is one.
    let store = options.checkpoint.as_ref().or(options.resume.as_ref());
    let store = store.map(|path| checkpoints::open(path, options.resume.as_ref())).transpose()?;
    let clock = Instant::now();
    let limit = Limit::new(options);
    let (mut scene, digest) = match store.is_some() || options.shard.is_some() || merged.is_some() {
        true => scene::read_digested(&options.scene, options.allow_unsupported, limit.bytes())?,
        false => (scene::read_within(&options.scene, options.allow_unsupported, limit.bytes())?, String::new()),
    };
    let mut settings = Settings::new(options, &mut scene)?;
    let foreseen = Expected::of_scene(&scene, &settings.frame);
    foreseen.check(limit)?;
    let share = shard::file(options, &scene.name, &settings.frame)?;
    let files = Files::new(options, &scene.name, &settings)?;
    files.prepare(options)?;
    let load = clock.elapsed().as_secs_f64();
    warn_of(&scene, options);
    leave_out(&mut scene, &settings.without)?;
    crate::scene::warn_of_chance(&scene);

    let clock = Instant::now();
    let mut world = scene::build(&scene, settings.frame.resolution())?;
    world.set_light_selection(options.light_choice());
    if world.dropped_triangles() > 0 {
        warn(format!("{} triangles have no area and are left out", world.dropped_triangles()));
    }
    let mut seconds = Seconds { load, bvh: clock.elapsed().as_secs_f64(), ..Seconds::default() };
    if stop.asked() {
        warn("stopped before the first sample: nothing is saved");
        return Ok(Outcome::Interrupted);
    }

    let world = Arc::new(world);
    let stage = Stage::new(world.clone());
    let cpu = cpu_seconds();
    let mut methods = settings.methods(&stage)?;
    let clusters = stage.first_clusters();
    let identity = identity::identity(options, &settings, &methods, &scene, &digest);
    let needs = needs(options, &methods, &files, clusters.is_some());
    let expected = match merged {
        Some(_) => None,
        None => {
            let expected = expect(options, &settings, &mut methods, &files, needs, &foreseen)?;
            expected.check(limit)?;
            Some(expected)
        }
    };
    let traced = match merged {
        Some((film, known)) => {
            let here = shard::common(&identity);
            checkpoints::refuse_other(&options.scene, &here, known)?;
            Traced { film, failure: None, resume: None }
        }
        None => {
            let keep = store.map(|store| Checkpoints::new(store, identity.clone(), options.checkpoint_every));
            let progress = Progress::new(options, &settings, stop, keep);
            trace(&settings, &mut methods, needs, &world, options, &identity, progress)?
        }
    };
    let Traced { film, failure, resume } = traced;
    if let (Some(path), Some(shard), None) = (&share, options.shard, &failure) {
        shard::write(path, shard, &film, identity, options.quiet)?;
        return end(&film, None, resume);
    }
    leave_filter_out(&mut methods, &film);
    let clock = Instant::now();
    let filtered = methods.filter.apply(&film).map_err(Failure::new)?;
    seconds.filter = clock.elapsed().as_secs_f64();
    let probes = stage.probe_cost();
    seconds.cluster = stage.cluster_seconds();
    seconds.probe = probes.seconds;
    // Probes are shot when the first round is planned.
    seconds.plan = (film.record().plan_seconds() - probes.seconds).max(0.0);
    seconds.trace = film.record().trace_seconds();
    let cpu = cpu_seconds().zip(cpu).map(|(after, before)| after - before);

    let report = Report {
        settings: &settings,
        methods: &methods,
        scene: &scene,
        film: &film,
        filtered: &filtered,
        clusters: clusters.as_deref(),
        probe_rays: probes.rays,
        seconds,
        cpu,
        light_choice: options.light_choice().name(),
        expected: expected.as_ref(),
    };
    warn_of_rejected(&film, &settings);
    warn_of_clusters(clusters.as_deref(), &stage);
    if failure.is_none() {
        warn_of_error(&film, options);
    }
    deliver(report, &files, 1.0 / world.space().scale(), options)?;
    end(&film, failure, resume)
}

/// What is recorded for filter and files; the sampler's own needs come on top.
fn needs(options: &Options, methods: &Methods, files: &Files, clusters: bool) -> Needs {
    let needs = methods.filter.needs().and(files.needs(clusters));
    match options.shard {
        // What any image that is made of them may show.
        Some(_) => needs.with_variance().with_first_hits(u8::from(clusters)),
        None => needs,
    }
}

/// What the render will take, when everything is made and nothing is traced.
fn expect(
    options: &Options,
    settings: &Settings,
    methods: &mut Methods,
    files: &Files,
    needs: Needs,
    foreseen: &Expected,
) -> Result<Expected> {
    let memory = methods.memory(settings, needs, options.shard)?;
    let keeps = options.checkpoint.is_some() || options.resume.is_some() || options.shard.is_some();
    let writing = files.memory(&settings.frame, &memory.needs, methods.filter.name() != "none");
    Ok(Expected::of_render(foreseen, &memory, writing, keeps))
}

/// Pixels that a filter is taken to finish in a second, one thread: what the default is held to (8 microseconds a pixel).
const FILTERED_A_SECOND: usize = 125_000;

/// Whoever stops a render wants to have it soon: a filter that would take a second or more is left out, and said to be.
fn leave_filter_out(methods: &mut Methods, film: &Film) {
    let patience = FILTERED_A_SECOND * rayon::current_num_threads();
    if film.record().interrupted && methods.filter.name() != Unfiltered.name() && film.frame().pixels() > patience {
        warn(format!("stopped: the image is not filtered, since {} would take too long", methods.filter.name()));
        methods.filter = Box::new(Unfiltered);
    }
}

/// The last words, after everything is written. `resume` is the checkpoint to go on from, or why there is none.
fn end(film: &Film, failure: Option<Failure>, resume: Option<Result<PathBuf>>) -> Result<Outcome> {
    let interrupted = film.record().interrupted;
    let go_on = match resume {
        Some(Err(trouble)) if interrupted => return Err(trouble),
        Some(Err(Failure(lines))) => {
            lines.iter().for_each(warn);
            None
        }
        Some(Ok(path)) => Some(path),
        None => None,
    };
    match failure {
        Some(failure) => Err(failure),
        None if interrupted => {
            say("interrupted", "the image is what was done until then");
            if let Some(path) = go_on {
                say("interrupted", &format!("the same words with --resume {} go on from there", path.display()));
            }
            Ok(Outcome::Interrupted)
        }
        None => Ok(Outcome::Done),
    }
}

/// Writes the files and says how it went. `unit` as in [`dapple_job::output::layers`].
fn deliver(mut report: Report<'_>, files: &Files, unit: f64, options: &Options) -> Result<()> {
    if report.film.record().samples == 0 {
        warn("stopped before the first sample: nothing is saved");
        return Ok(());
    }
    let clock = Instant::now();
    let written = files.write(&report, unit)?;
    report.seconds.write = clock.elapsed().as_secs_f64();
    if options.json {
        return tell(report.json());
    }
    if !options.quiet {
        tell(report.summary())?;
        written.iter().try_for_each(tell)?;
    }
    Ok(())
}

/// Ends the program as clap does for a single wrong word: usage, exit status 2.
fn refuse(wrong: &str) -> ! {
    let mut words = crate::Words::command();
    words.build();
    let kind = ErrorKind::ValueValidation;
    match words.find_subcommand_mut("render") {
        Some(render) => render.error(kind, wrong).exit(),
        None => words.error(kind, wrong).exit(),
    }
}

/// What came of tracing.
struct Traced {
    film: Film,
    /// What an integrator's panic left is kept beside it.
    failure: Option<Failure>,
    /// Where to go on from, or why that is not possible; `None` without checkpoints.
    resume: Option<Result<PathBuf>>,
}

/// Traces, from the beginning or from a checkpoint.
fn trace(
    settings: &Settings,
    methods: &mut Methods,
    needs: Needs,
    world: &World,
    options: &Options,
    identity: &Identity,
    mut progress: Progress,
) -> Result<Traced> {
    let mut integrator = integrator(world);
    let (frame, limits) = (settings.frame, &settings.limits);
    let mut share;
    let sampler: &mut dyn Sampler = match options.shard {
        None => &mut *methods.sampler,
        Some(shard) => {
            share = Sharded::new(&mut *methods.sampler, shard, limits).map_err(|e| no_shard(shard, &e))?;
            &mut share
        }
    };
    // Beside --checkpoint with the same file: the first time there is none.
    let begins = |from: &PathBuf| options.checkpoint.as_ref() == Some(from) && !Store::exists(from);
    let film = match options.resume.as_ref().filter(|from| !begins(from)) {
        None => {
            dapple_core::Render::new(frame, limits).needs(needs).monitor(&mut progress).run(&mut *integrator, sampler)
        }
        Some(from) => {
            let snapshot = checkpoints::read(from, identity)?;
            let done = snapshot.film().record().samples as f64 / frame.pixels() as f64;
            if !options.quiet && !options.json {
                say("resume", &format!("going on after {done:.2} spp"));
            }
            dapple_core::Render::new(frame, limits).needs(needs).monitor(&mut progress).resume(
                snapshot,
                &mut *integrator,
                sampler,
            )
        }
    };
    progress.finish();
    let resume = progress.checkpoints.map(|kept| {
        let path = kept.path().to_owned();
        kept.into_trouble().map_or(Ok(path), Err)
    });
    let error = match film {
        Ok(film) => return Ok(Traced { film, failure: None, resume }),
        Err(error) => error,
    };
    let message = error.to_string();
    match error {
        Error::Panicked { film, .. } => {
            let failure = Some(Failure::new(message + "; what was finished before is saved"));
            Ok(Traced { film: *film, failure, resume })
        }
        _ => Err(Failure::new(message)),
    }
}

/// What was read otherwise than written.
fn warn_of(scene: &Scene, options: &Options) {
    crate::scene::warn_of(scene, &options.scene);
    if let (Some(suggested), Some(spp)) = (scene.film.spp, options.mean_spp())
        && options.spp.is_none()
        && f64::from(suggested) != spp
    {
        let name = options.scene.display();
        warn(format!("{name} suggests {suggested} spp, and {spp} are taken: --spp {suggested} follows it"));
    }
}

/// Leaves effects out, and says so.
fn leave_out(scene: &mut Scene, effects: &[Effect]) -> Result<()> {
    let called = Effects::of(scene);
    for effect in effects {
        *scene = without(scene, *effect).map_err(|e| Failure::new(format!("--without {effect}: {e}")))?;
        let by = called.called().iter().find(|c| c.effect == *effect);
        let by = by.map_or_else(String::new, |c| format!("; {} calls for it ({})", c.source, c.because));
        warn(format!("without {effect}: {}{by}", effect.left_out()));
    }
    Ok(())
}

/// A grid that tells nothing apart, and probes that were no numbers, make clusters useless without a word.
fn warn_of_clusters(clusters: Option<&WorldClusters>, stage: &Stage) {
    if let Some(report) = clusters.and_then(WorldClusters::report).filter(|report| report.is_degenerate()) {
        let (occupied, requested) = (report.occupied, report.requested());
        warn(format!(
            "of {requested} voxels {occupied} hold all triangles: clusters tell little apart. Something far off stretches the \
             scene; a larger clamp= and k= help, or leaving it out"
        ));
    }
    let rejected = stage.rejected_probes();
    if rejected > 0 {
        warn(format!("{rejected} probes hit something at a place that is no number, and count as background"));
    }
}

/// An error limit that was not met.
fn warn_of_error(film: &Film, options: &Options) {
    let Some(asked) = options.error else { return };
    let predicted = film.predicted_relmse();
    if film.record().interrupted || predicted.is_some_and(|predicted| predicted <= asked) {
        return;
    }
    let known = predicted.map_or_else(|| "unknown".to_owned(), |predicted| format!("{predicted:.2e}"));
    warn(format!(
        "the predicted relMSE is {known}, not {asked}: the sampler's threshold or the highest budget ended it (--max-spp \
         raises the latter)"
    ));
}

fn warn_of_rejected(film: &Film, settings: &Settings) {
    let Some(first) = film.rejected().first() else { return };
    let (all, samples) = (film.record().rejected, film.record().samples);
    let id = first.sample;
    let [x, y] = id.pixel;
    let replay = match id.stream {
        streams::WHOLE => {
            let (spp, right, below) = (id.index + 1, x + 1, y + 1);
            format!(": replay it with --sampler uniform --spp {spp} --crop {x},{y},{right},{below}")
        }
        _ => String::new(),
    };
    warn(format!(
        "{all} of {samples} samples were NaN, infinite or negative and count as 0; the first is sample {} of stream {} \
         in pixel ({x}, {y}) with {}{replay}",
        id.index, id.stream, settings.points_described
    ));
}
