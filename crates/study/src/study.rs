//! A study from its first run to its last, through as many sittings as it takes.

mod equal_time;
mod manifest;

use crate::ledger::{Ledger, Store};
use crate::references::{Shelf, Wanted, file_name, obtain, want};
use crate::run::{Job, Runner, image_stem};
use crate::subject::{Subject, View, name_of};
use crate::truth::Truth;
use crate::{Budget, Manifest, Method, Plan, PlanError, Run, ScenePlan, SceneRecord, StudyError};
use dapple_core::{Control, Status};
use dapple_scene::image::write_file;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// How a study went on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ended {
    /// All runs are there.
    Done,
    /// The monitor said stop; the same plan in the same folder goes on.
    Stopped,
}

/// How far a study is.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Progress<'a> {
    /// What is about to be done, or being done.
    pub doing: &'a str,
    /// Runs finished, those of earlier sittings included.
    pub done: usize,
    /// Runs in all.
    pub runs: usize,
    /// How much of this sitting's work is done, 0 to 1, by samples.
    pub share: f64,
    /// Seconds until the end, if the rest goes as this sitting went; `None` at its beginning.
    pub left: Option<f64>,
}

/// Looks on between runs, and a few times a second while a reference is rendered; never while a run is timed.
pub trait Onlooker {
    /// Sees how far it is, and says whether to go on.
    fn look(&mut self, progress: &Progress<'_>) -> Control;

    /// Hears what was read otherwise than written.
    fn hear(&mut self, _notice: &str) {}
}

/// Nobody looks on.
impl Onlooker for () {
    fn look(&mut self, _: &Progress<'_>) -> Control {
        Control::Continue
    }
}

/// Settings of a sitting that change no run.
#[derive(Clone, Debug, Default)]
pub struct Sitting {
    /// A folder of references that several studies share; else they are kept in the study's.
    pub references: Option<PathBuf>,
    /// The command, word by word, for the record.
    pub command: Vec<String>,
}

/// A study in its folder.
pub struct Study {
    plan: Plan,
    folder: PathBuf,
    manifest: Manifest,
    views: Vec<View>,
    ledger: Ledger,
    meter: Meter,
}

impl Study {
    /// Begins a study in a folder, or finds the one that is there: reads the scenes, checks the plan against the
    /// folder's, makes the references. `None` where `onlooker` said stop while they were made.
    ///
    /// # Errors
    ///
    /// [`StudyError::AnotherStudy`] with the difference, scenes and references that are none, whatever the disk refuses.
    pub fn open(
        plan: Plan,
        folder: &Path,
        sitting: &Sitting,
        onlooker: &mut dyn Onlooker,
    ) -> Result<Option<Self>, StudyError> {
        std::fs::create_dir_all(folder).map_err(|e| StudyError::file(folder, "make the folder", e))?;
        let file = folder.join("study.json");
        let there = manifest::read(&file)?;
        let runs = folder.join("runs.jsonl");
        if there.is_none() && runs.metadata().is_ok_and(|m| m.len() > 0) {
            let differences = vec!["it has runs (runs.jsonl), and study.json, which says of what, is missing".into()];
            return Err(StudyError::AnotherStudy { folder: folder.to_owned(), differences });
        }
        let ledger = Ledger::open(&runs)?;
        let views = views(&plan)?;
        let shelf = Shelf { folder, shared: sitting.references.as_deref() };
        let mut wanted = Vec::new();
        // The last one read is kept: mostly it is the only one.
        let mut last: Option<Subject> = None;
        for (view, scene) in views.iter().zip(&plan.scenes) {
            drop(last.take());
            let subject = Subject::load(&view.by_default())?;
            subject.notices().iter().for_each(|notice| onlooker.hear(notice));
            wanted.push(want(&plan, scene, &subject, &shelf)?);
            last = Some(subject);
        }
        let scenes = views.iter().zip(&wanted).map(|(view, wanted)| SceneRecord {
            name: view.name.clone(),
            source: view.source.clone(),
            resolution: view.resolution,
            reference: wanted.record().clone(),
            lights: view.lights,
        });
        let mut manifest = manifest::new(&plan, scenes.collect(), &sitting.command);
        if let Some(there) = &there {
            let differences = manifest::differences(there, &manifest);
            if !differences.is_empty() {
                return Err(StudyError::AnotherStudy { folder: folder.to_owned(), differences });
            }
        }
        let mut meter = Meter::new(&plan, &views, &wanted, &ledger);
        for (at, wanted) in wanted.into_iter().enumerate() {
            let view = views[at].by_default();
            let subject = match last.take().filter(|s| s.view == view) {
                Some(subject) => subject,
                // Only where there is something to render.
                None => Subject::load(&view)?,
            };
            let doing = format!("{}: reference", views[at].name);
            let cost = meter.of_reference(&wanted, &views[at]);
            let mut half = Half::default();
            let mut monitor = |status: &Status<'_>| onlooker.look(&meter.progress(&doing, cost * half.share(status)));
            let Some(record) = obtain(wanted, &subject, &mut monitor)? else { return Ok(None) };
            meter.add(cost);
            manifest.scenes[at].reference = record;
        }
        if let Some(there) = there {
            // When it began, and by which command, stay.
            manifest = Manifest { began: there.began, command: there.command, ..manifest };
        }
        write_file(&file, &manifest::bytes(&manifest))?;
        Ok(Some(Self { plan, folder: folder.to_owned(), manifest, views, ledger, meter }))
    }

    /// How it was made, as `study.json` says.
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// The finished runs.
    pub fn runs(&self) -> &[Run] {
        self.ledger.runs()
    }

    /// How many runs there will be.
    pub fn expected(&self) -> usize {
        self.plan.runs()
    }

    /// Writes finished runs to another store: for tests of what happens when a disk is full.
    pub fn with_store(mut self, store: Box<dyn Store>) -> Self {
        self.ledger = self.ledger.with_store(store);
        self
    }

    /// Makes all runs that are not there yet: scene by scene; seed by seed, budget by budget, method by method, so that
    /// a machine that grows slower does so for all; then, seed by seed and method by method, those of equal time.
    ///
    /// # Errors
    ///
    /// Whatever keeps a run from being made or written down. What was done is kept.
    pub fn run(&mut self, runner: &mut dyn Runner, onlooker: &mut dyn Onlooker) -> Result<Ended, StudyError> {
        for at in 0..self.views.len() {
            let pixels = pixels(&self.views[at]);
            for seed in self.plan.seeds.clone() {
                for spp in self.plan.spp.clone() {
                    for method in self.plan.methods.clone() {
                        let job = self.job(at, &method, Budget::Spp(spp), seed, spp * pixels);
                        if self.find(&job).is_some() {
                            continue;
                        }
                        if self.look(&job, onlooker) == Control::Stop {
                            return Ok(Ended::Stopped);
                        }
                        let run = runner.run(&job)?;
                        self.keep(run)?;
                    }
                }
            }
            if self.equal_time(at, runner, onlooker)? == Ended::Stopped {
                return Ok(Ended::Stopped);
            }
        }
        Ok(Ended::Done)
    }

    fn job(&self, at: usize, method: &Method, budget: Budget, seed: u64, asked: u64) -> Job {
        let view = &self.views[at];
        let number = self.plan.methods.iter().position(|m| m == method).unwrap_or(0);
        let first = self.plan.seeds.first() == Some(&seed);
        Job {
            view: view.clone(),
            method: method.clone(),
            external: self.plan.external.iter().find(|e| e.name == method.filter).cloned(),
            budget,
            seed,
            asked,
            reference: self.folder.join(&self.manifest.scenes[at].reference.file),
            threads: self.plan.threads,
            folder: self.folder.clone(),
            image: first.then(|| image_stem(&view.name, budget, number)),
        }
    }

    /// The finished run of a job.
    fn find(&self, job: &Job) -> Option<&Run> {
        let same = |r: &&Run| {
            r.scene == job.view.name && r.method == job.method && r.budget == job.budget && r.seed == job.seed
        };
        self.ledger.runs().iter().find(same)
    }

    fn look(&self, job: &Job, onlooker: &mut dyn Onlooker) -> Control {
        let budget = match job.budget {
            Budget::Spp(n) => format!("{n} spp"),
            Budget::TimeOf(n) => format!("time of {n} spp"),
        };
        let doing = format!("{}, {}, {budget}, seed {}", job.view.name, job.method, job.seed);
        onlooker.look(&Progress { done: self.ledger.runs().len(), ..self.meter.progress(&doing, 0.0) })
    }

    fn keep(&mut self, run: Run) -> Result<(), StudyError> {
        let cost = run.asked as f64;
        self.ledger.append(run)?;
        self.meter.add(cost);
        Ok(())
    }
}

fn pixels(view: &View) -> u64 {
    u64::from(view.resolution[0]) * u64::from(view.resolution[1])
}

/// Names and resolutions of the scenes.
fn views(plan: &Plan) -> Result<Vec<View>, StudyError> {
    let mut views: Vec<View> = Vec::new();
    for scene in &plan.scenes {
        let taken = |name: &str| views.iter().any(|v| file_name(&v.name) == file_name(name));
        let name = match &scene.name {
            Some(name) if name.trim().is_empty() || taken(name) => {
                let what = format!("{name:?} is no name of its own: give each scene another");
                return Err(PlanError::new("scenes", what).into());
            }
            Some(name) => name.clone(),
            None => {
                let name = name_of(&scene.source);
                let numbered = (2..).map(|n| format!("{name}-{n}"));
                std::iter::once(name.clone()).chain(numbered).find(|n| !taken(n)).unwrap_or(name)
            }
        };
        views.push(View {
            name,
            source: scene.source.clone(),
            resolution: resolution(plan, scene)?,
            max_depth: plan.max_depth,
            allow_unsupported: plan.allow_unsupported,
            lights: scene.lights,
        });
    }
    Ok(views)
}

fn resolution(plan: &Plan, scene: &ScenePlan) -> Result<[u32; 2], StudyError> {
    match (scene.resolution.or(plan.resolution), &scene.reference) {
        (Some(resolution), _) => Ok(resolution),
        (None, Some(file)) => Ok(Truth::read(file)?.0.size),
        (None, None) => Ok([plan.side; 2]),
    }
}

/// The share of a reference that is rendered, over its two halves.
#[derive(Default)]
struct Half {
    second: bool,
    before: f64,
}

impl Half {
    fn share(&mut self, status: &Status<'_>) -> f64 {
        let now = status.samples as f64 / status.expected.max(1) as f64;
        self.second |= now < self.before;
        self.before = now;
        0.5 * (now + f64::from(u8::from(self.second)))
    }
}

/// Work by samples: done in this sitting, and to be done.
struct Meter {
    began: Instant,
    done: f64,
    all: f64,
    finished: usize,
    runs: usize,
}

impl Meter {
    fn new(plan: &Plan, views: &[View], wanted: &[Wanted], ledger: &Ledger) -> Self {
        let spp: u64 = plan.spp.iter().sum::<u64>() + plan.time_of.unwrap_or(0);
        let of_scene = |view: &View| (spp * pixels(view)) as f64 * (plan.methods.len() * plan.seeds.len()) as f64;
        let mut meter = Self { began: Instant::now(), done: 0.0, all: 0.0, finished: 0, runs: plan.runs() };
        let references: f64 = wanted.iter().zip(views).map(|(w, view)| meter.of_reference(w, view)).sum();
        let finished: f64 = ledger.runs().iter().map(|r| r.asked as f64).sum();
        meter.all = (views.iter().map(of_scene).sum::<f64>() + references - finished).max(1.0);
        meter.finished = ledger.runs().len();
        meter
    }

    /// The samples of a reference that is not there yet.
    fn of_reference(&self, wanted: &Wanted, view: &View) -> f64 {
        match wanted {
            Wanted::Rendered { path, record } if !path.exists() => (record.spp.unwrap_or(0) * pixels(view)) as f64,
            _ => 0.0,
        }
    }

    fn add(&mut self, samples: f64) {
        self.done += samples;
    }

    fn progress<'a>(&self, doing: &'a str, within: f64) -> Progress<'a> {
        let share = ((self.done + within) / self.all).clamp(0.0, 1.0);
        let left = (share > 0.0).then(|| self.began.elapsed().as_secs_f64() * (1.0 - share) / share);
        Progress { doing, done: self.finished, runs: self.runs, share, left }
    }
}
