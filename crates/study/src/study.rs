//! A study in a folder, performed in one or more sessions.

mod equal_time;

use crate::record::{image_stem, method_file_names, numbered, safe_file_name};
use crate::records::{RunLog, differences, manifest_bytes, manifest_of, read_manifest};
use crate::reference::{ReferenceImage, ReferenceSource, load_or_render, plan_reference};
use crate::runner::{RunRequest, Runner};
use crate::scene::{Subject, View, name_of};
use crate::{Manifest, Method, Plan, PlanError, Run, RunBudget, ScenePlan, SceneRecord, StudyError};
use dapple_core::render::Control;
use dapple_scene::image::write_file;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// The state in which [`Study::run`] ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum StudyStatus {
    /// All runs are finished.
    Done,
    /// The monitor stopped the study; the same plan in the same folder resumes it.
    Stopped,
}

/// The progress of a study.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct StudyProgress<'a> {
    /// A description of the run or reference in progress.
    pub doing: &'a str,
    /// The number of finished runs, including those of earlier sessions.
    pub done: usize,
    /// The number of runs in the whole study, finished or not.
    pub runs: usize,
    /// The fraction of this session's samples that has been traced so far, 0 to 1.
    pub share: f64,
    /// The estimated seconds until the study ends; `None` before the first samples are traced.
    pub left: Option<f64>,
}

/// An observer of a study, which receives progress and warnings, and can stop the study.
///
/// The study calls it between runs, and several times a second while a reference is rendered, but never while a run is timed.
/// `()` is a monitor that ignores everything.
///
/// ```
/// use dapple_core::render::Control;
/// use dapple_study::{StudyMonitor, StudyProgress};
/// struct StopAfter(usize);
/// impl StudyMonitor for StopAfter {
///     fn progress(&mut self, progress: &StudyProgress<'_>) -> Control {
///         if progress.done >= self.0 { Control::Stop } else { Control::Continue }
///     }
/// }
/// ```
pub trait StudyMonitor {
    /// Receives the progress; returns [`Control::Stop`] to stop the study.
    fn progress(&mut self, progress: &StudyProgress<'_>) -> Control;

    /// Receives a warning, such as a directive of a scene that was approximated.
    fn warning(&mut self, _warning: &str) {}
}

impl StudyMonitor for () {
    fn progress(&mut self, _: &StudyProgress<'_>) -> Control {
        Control::Continue
    }
}

/// Options of one process that runs a study. They do not change results.
#[derive(Clone, Debug, Default)]
pub struct StudyOptions {
    /// A folder for rendered references that several studies share; `None` keeps them in the study's folder.
    pub references: Option<PathBuf>,
    /// The command line to record in `study.json`, argument by argument.
    pub command: Vec<String>,
}

/// A study in its folder, opened for performing runs. An example is on the [front page](crate).
pub struct Study {
    plan: Plan,
    folder: PathBuf,
    manifest: Manifest,
    views: Vec<View>,
    log: RunLog,
    meter: WorkMeter,
}

impl Study {
    /// Begins a study in `folder`, or resumes the study there. Reads the scenes, compares the plan with `study.json`, and
    /// renders missing references. Returns `None` if `monitor` stopped the study.
    ///
    /// # Errors
    ///
    /// [`StudyError::Refused`] if the settings differ from those in `study.json`. Other errors if a scene or reference is
    /// unusable, or the disk fails.
    pub fn open(
        plan: Plan,
        folder: &Path,
        options: &StudyOptions,
        monitor: &mut dyn StudyMonitor,
    ) -> Result<Option<Self>, StudyError> {
        std::fs::create_dir_all(folder).map_err(|e| StudyError::file(folder, "create the folder", e))?;
        let another = |differences: Vec<String>| {
            let why = "this folder holds another study; choose another folder, or use the settings of that study";
            Err(StudyError::refused(folder.display(), format_args!("{why}\n{}", differences.join("\n"))))
        };
        let earlier = read_manifest(folder)?;
        let runs = folder.join("runs.jsonl");
        if earlier.is_none() && runs.metadata().is_ok_and(|m| m.len() > 0) {
            return another(vec!["runs.jsonl has runs, but their study.json is missing".into()]);
        }
        let log = RunLog::open(&runs)?;
        let views = views(&plan)?;
        let (sources, last) = reference_sources(&plan, &views, folder, options, monitor)?;
        let scenes = views.iter().zip(&sources).map(|(view, source)| SceneRecord {
            name: view.name.clone(),
            source: view.source.clone(),
            resolution: view.resolution,
            reference: source.record.clone(),
            lights: view.lights,
            integrator: view.integrator.clone(),
        });
        let mut manifest = manifest_of(&plan, scenes.collect(), &options.command);
        if let Some(earlier) = &earlier {
            let differences = differences(earlier, &manifest);
            if !differences.is_empty() {
                return another(differences);
            }
        }
        let mut meter = WorkMeter::new(&plan, &views, &sources, &log);
        if !load_references(&mut manifest, sources, &views, last, &mut meter, monitor)? {
            return Ok(None);
        }
        if let Some(earlier) = earlier {
            // A resumed study keeps the recorded start time and command line.
            manifest = Manifest { began: earlier.began, command: earlier.command, ..manifest };
        }
        write_file(&folder.join("study.json"), &manifest_bytes(&manifest))?;
        Ok(Some(Self { plan, folder: folder.to_owned(), manifest, views, log, meter }))
    }

    /// The settings and circumstances of the study, as in `study.json`.
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// The finished runs in the order of completion.
    pub fn runs(&self) -> &[Run] {
        self.log.runs()
    }

    /// The number of runs in the whole study, finished or not.
    pub fn expected(&self) -> usize {
        self.plan.runs()
    }

    /// Performs all runs that are not finished yet.
    ///
    /// Runs are ordered by scene, then seed, then budget, then method. Methods thus alternate, so that a temporary slowdown of
    /// the machine affects all methods. A scene's equal-time runs come last.
    ///
    /// # Errors
    ///
    /// [`StudyError`] if a run fails, or for an error of the disk. Finished runs are kept.
    pub fn run(&mut self, runner: &mut dyn Runner, monitor: &mut dyn StudyMonitor) -> Result<StudyStatus, StudyError> {
        for at in 0..self.views.len() {
            let pixels = self.views[at].pixels();
            for seed in self.plan.seeds.clone() {
                for spp in self.plan.spp.clone() {
                    for method in self.plan.methods.clone() {
                        let request = self.request(at, &method, RunBudget::Spp(spp), seed, spp * pixels);
                        if self.find(&request).is_some() {
                            continue;
                        }
                        if self.announce(&request, monitor) == Control::Stop {
                            return Ok(StudyStatus::Stopped);
                        }
                        let run = runner.run(&request)?;
                        self.keep(run)?;
                    }
                }
            }
            if self.equal_time(at, runner, monitor)? == StudyStatus::Stopped {
                return Ok(StudyStatus::Stopped);
            }
        }
        Ok(StudyStatus::Done)
    }

    fn request(&self, at: usize, method: &Method, budget: RunBudget, seed: u64, asked: u64) -> RunRequest {
        let view = &self.views[at];
        let number = self.plan.methods.iter().position(|m| m == method).unwrap_or(0);
        let names = method_file_names(&self.plan.methods);
        let first = self.plan.seeds.first() == Some(&seed);
        RunRequest {
            view: view.clone(),
            method: method.clone(),
            external: self.plan.settings.external.iter().find(|e| e.name == method.filter).cloned(),
            budget,
            seed,
            asked,
            reference: self.folder.join(&self.manifest.scenes[at].reference.file),
            threads: self.plan.settings.threads,
            folder: self.folder.clone(),
            image: first.then(|| image_stem(&view.name, &names[number], budget)),
        }
    }

    /// The finished run with the request's scene, method, budget and seed; `None` if it is missing.
    fn find(&self, request: &RunRequest) -> Option<&Run> {
        let RunRequest { view, method, budget, seed, .. } = request;
        self.log.runs().iter().find(|run| run.is_of(&view.name, method, *budget, *seed))
    }

    fn announce(&self, request: &RunRequest, monitor: &mut dyn StudyMonitor) -> Control {
        let RunRequest { view, method, budget, seed, .. } = request;
        let doing = format!("{}, {method}, {budget}, seed {seed}", view.name);
        monitor.progress(&StudyProgress { done: self.log.runs().len(), ..self.meter.progress(&doing, 0.0) })
    }

    fn keep(&mut self, run: Run) -> Result<(), StudyError> {
        let cost = run.asked as f64;
        self.log.append(run)?;
        self.meter.done += cost;
        Ok(())
    }
}

/// Determines the origin of each scene's reference. Also returns the scene that was read last, so that a study of a single
/// scene reads it only once.
fn reference_sources(
    plan: &Plan,
    views: &[View],
    folder: &Path,
    options: &StudyOptions,
    monitor: &mut dyn StudyMonitor,
) -> Result<(Vec<ReferenceSource>, Option<Subject>), StudyError> {
    let shared = options.references.as_deref();
    let mut sources = Vec::new();
    let mut last: Option<Subject> = None;
    for (view, scene) in views.iter().zip(&plan.scenes) {
        // Frees the memory of the last scene before the next one is read.
        drop(last.take());
        let subject = Subject::load(&view.by_default())?;
        subject.notices().iter().for_each(|notice| monitor.warning(notice));
        sources.push(plan_reference(plan, scene, &subject, folder, shared)?);
        last = Some(subject);
    }
    Ok((sources, last))
}

/// Loads or renders the references and records them in the manifest; returns `false` if the monitor stopped this.
fn load_references(
    manifest: &mut Manifest,
    sources: Vec<ReferenceSource>,
    views: &[View],
    mut last: Option<Subject>,
    meter: &mut WorkMeter,
    monitor: &mut dyn StudyMonitor,
) -> Result<bool, StudyError> {
    for (at, source) in sources.into_iter().enumerate() {
        let view = views[at].by_default();
        let subject = match last.take().filter(|s| s.view == view) {
            Some(subject) => subject,
            None => Subject::load(&view)?,
        };
        let doing = format!("{}: reference", views[at].name);
        let cost = meter.of_reference(&source, &views[at]);
        let mut look = |share: f64| monitor.progress(&meter.progress(&doing, cost * share));
        let Some(record) = load_or_render(source, &subject, &mut look)? else { return Ok(false) };
        meter.done += cost;
        manifest.scenes[at].reference = record;
    }
    Ok(true)
}

/// Creates the views of a plan's scenes, with unique names and resolutions.
fn views(plan: &Plan) -> Result<Vec<View>, StudyError> {
    let mut views: Vec<View> = Vec::new();
    for scene in &plan.scenes {
        let taken = |name: &str| views.iter().any(|v| safe_file_name(&v.name) == safe_file_name(name));
        let given = scene.name.clone();
        if let Some(name) = given.as_ref().filter(|name| name.trim().is_empty() || taken(name)) {
            let what = format!("scene name {name:?} is empty or used twice; give each scene its own name");
            return Err(PlanError::new("scenes", what).into());
        }
        let name = given.unwrap_or_else(|| numbered(&name_of(&scene.source), |name| !taken(name)));
        views.push(View {
            name,
            source: scene.source.clone(),
            resolution: resolution(plan, scene)?,
            max_depth: plan.settings.max_depth,
            allow_unsupported: plan.settings.allow_unsupported,
            lights: scene.lights.unwrap_or(plan.settings.lights),
            integrator: scene.integrator.clone().unwrap_or_else(crate::scene::auto),
        });
    }
    Ok(views)
}

fn resolution(plan: &Plan, scene: &ScenePlan) -> Result<[u32; 2], StudyError> {
    match (scene.resolution.or(plan.settings.resolution), &scene.reference) {
        (Some(resolution), _) => Ok(resolution),
        (None, Some(file)) => Ok(ReferenceImage::read(file)?.0.size),
        (None, None) => Ok([plan.side; 2]),
    }
}

/// A counter of this session's samples, traced so far and in total, from which progress is estimated.
struct WorkMeter {
    began: Instant,
    done: f64,
    all: f64,
    finished: usize,
    runs: usize,
}

impl WorkMeter {
    fn new(plan: &Plan, views: &[View], wanted: &[ReferenceSource], log: &RunLog) -> Self {
        let spp: u64 = plan.spp.iter().sum::<u64>() + plan.time_of.unwrap_or(0);
        let of_scene = |view: &View| (spp * view.pixels()) as f64 * (plan.methods.len() * plan.seeds.len()) as f64;
        let mut meter = Self { began: Instant::now(), done: 0.0, all: 0.0, finished: 0, runs: plan.runs() };
        let references: f64 = wanted.iter().zip(views).map(|(w, view)| meter.of_reference(w, view)).sum();
        let finished: f64 = log.runs().iter().map(|r| r.asked as f64).sum();
        meter.all = (views.iter().map(of_scene).sum::<f64>() + references - finished).max(1.0);
        meter.finished = log.runs().len();
        meter
    }

    /// The number of samples needed to render a reference; 0 if it exists.
    fn of_reference(&self, wanted: &ReferenceSource, view: &View) -> f64 {
        let missing = wanted.rendered.as_ref().is_some_and(|path| !path.exists());
        if missing { (wanted.record.spp.unwrap_or(0) * view.pixels()) as f64 } else { 0.0 }
    }

    fn progress<'a>(&self, doing: &'a str, within: f64) -> StudyProgress<'a> {
        let share = ((self.done + within) / self.all).clamp(0.0, 1.0);
        let left = (share > 0.0).then(|| self.began.elapsed().as_secs_f64() * (1.0 - share) / share);
        StudyProgress { doing, done: self.finished, runs: self.runs, share, left }
    }
}
