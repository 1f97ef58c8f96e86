//! Runs: what is asked for, and who makes it.

use crate::references::file_name;
use crate::shot::{Order, shoot};
use crate::subject::View;
use crate::truth::Truth;
use crate::{Budget, External, Method, Run, StudyError, Subject};
use dapple_core::NoMonitor;
use dapple_job::output::sample_map;
use dapple_scene::image::{Image, Layer, encode_exr, write_file};
use serde::{Deserialize, Serialize};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// A run to be made.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Job {
    /// The scene.
    pub view: View,
    /// How.
    pub method: Method,
    /// Its filter, where that is a program of somebody else's.
    #[serde(default)]
    pub external: Option<External>,
    /// What it is given.
    pub budget: Budget,
    /// Of its points.
    pub seed: u64,
    /// The samples that makes, in all.
    pub asked: u64,
    /// The reference's file.
    pub reference: PathBuf,
    /// Threads; 0 is one per core.
    pub threads: usize,
    /// The study's folder.
    pub folder: PathBuf,
    /// Where the image and the sample map go, relative to the folder, without extension; if they are wanted.
    pub image: Option<String>,
}

/// Who makes runs.
pub trait Runner {
    /// Makes one.
    ///
    /// # Errors
    ///
    /// Whatever keeps it from being made.
    fn run(&mut self, job: &Job) -> Result<Run, StudyError>;
}

/// Makes runs in this process, on the current rayon pool. A scene is read once for all its runs, and warmed up by a
/// image that nobody sees.
pub struct InProcess {
    cpu: fn() -> Option<f64>,
    fresh: bool,
    subject: Option<Subject>,
    truth: Option<(PathBuf, Truth)>,
}

impl InProcess {
    /// `cpu` tells this process' user and system seconds so far, where the system does.
    pub fn new(cpu: fn() -> Option<f64>) -> Self {
        Self { cpu, fresh: false, subject: None, truth: None }
    }

    /// For a process that makes one run and ends: nothing is warmed up, and the run says so.
    pub fn fresh(cpu: fn() -> Option<f64>) -> Self {
        Self { fresh: true, ..Self::new(cpu) }
    }

    fn subject(&mut self, view: &View) -> Result<&Subject, StudyError> {
        if self.subject.as_ref().is_none_or(|s| s.view != *view) {
            // The last one's memory first.
            self.subject = None;
            let subject = Subject::load(view)?;
            if !self.fresh {
                warm_up(&subject)?;
            }
            self.subject = Some(subject);
        }
        self.subject.as_ref().ok_or_else(|| StudyError::Scene(view.source.clone()))
    }
}

/// The first images of a process are slower than those that follow.
fn warm_up(subject: &Subject) -> Result<(), StudyError> {
    let samples = WARM_UP_SPP * subject.frame()?.pixels() as u64;
    let method = Method::new("uniform", "sobol", "none");
    shoot(subject, Order { seed: 0, ..Order::new(&method, samples) }, &mut NoMonitor, || None).map(|_| ())
}

const WARM_UP_SPP: u64 = 2;

impl Runner for InProcess {
    fn run(&mut self, job: &Job) -> Result<Run, StudyError> {
        if self.truth.as_ref().is_none_or(|(file, _)| *file != job.reference) {
            self.truth = Some((job.reference.clone(), Truth::read(&job.reference)?.0));
        }
        let size = job.view.resolution;
        if let Some((file, truth)) = self.truth.take_if(|(_, truth)| truth.size != size) {
            let scene = job.view.name.clone();
            let why = format!("it is not of {}x{} pixels, nor of a multiple", size[0], size[1]);
            let averaged = truth.averaged_to(size).ok_or(StudyError::Reference { file: file.clone(), scene, why })?;
            self.truth = Some((file, averaged));
        }
        let load = load_average();
        let (cpu, fresh) = (self.cpu, self.fresh);
        let (external, threads) = (job.external.as_ref(), job.threads);
        let order = Order { seed: job.seed, external, threads, ..Order::new(&job.method, job.asked) };
        let shot = shoot(self.subject(&job.view)?, order, &mut NoMonitor, cpu)?;
        let what = || format!("{}, {}, seed {}", job.view.name, job.method, job.seed);
        let Some((_, truth)) = &self.truth else {
            return Err(StudyError::Run { what: what(), why: "there is no reference".into() });
        };
        let measured = truth.measure(&shot.filtered.radiance);
        let measured = measured.map_err(|e| StudyError::Run { what: what(), why: e.to_string() })?;
        let map = sample_map(&shot.film);
        if let Some(stem) = &job.image {
            let file = |extension: &str| job.folder.join(format!("{stem}.{extension}"));
            if let Some(folder) = file("exr").parent() {
                std::fs::create_dir_all(folder)
                    .map_err(|e| StudyError::file(folder, "make the folder of images", e))?;
            }
            let filtered = &shot.filtered;
            let image = Layer::of_image("", &Image::new(filtered.size, filtered.radiance.clone())?);
            write_file(&file("exr"), &encode_exr(filtered.size, &[image], &attributes(job))?.bytes)?;
            write_file(&file("png"), &map.png()?)?;
        }
        let record = shot.film.record();
        let named = |extension: &str| job.image.as_ref().map(|stem| format!("{stem}.{extension}"));
        Ok(Run {
            scene: job.view.name.clone(),
            method: job.method.clone(),
            budget: job.budget,
            seed: job.seed,
            asked: job.asked,
            samples: record.samples,
            spp: record.samples as f64 / shot.film.frame().pixels() as f64,
            rays: shot.rays,
            seconds: shot.seconds,
            render_s: shot.seconds.render(),
            cpu_s: shot.cpu_s,
            errors: measured.errors,
            corrected: measured.corrected,
            reference_limited: measured.reference_limited,
            predicted_relmse: shot.film.predicted_relmse().filter(|e| e.is_finite()),
            rejected: record.rejected,
            load,
            fresh,
            image: named("exr"),
            sample_map: named("png"),
            white: job.image.is_some().then_some(map.white),
        })
    }
}

/// How an image was made, for its header.
fn attributes(job: &Job) -> Vec<(String, String)> {
    let [w, h] = job.view.resolution;
    let list = [
        ("version", env!("CARGO_PKG_VERSION").to_owned()),
        ("scene", job.view.name.clone()),
        ("scene-file", job.view.source.clone()),
        ("sampler", job.method.sampler.clone()),
        ("points", job.method.points.clone()),
        ("filter", job.method.filter.clone()),
        ("seed", job.seed.to_string()),
        ("budget", format!("{} samples", job.asked)),
        ("resolution", format!("{w}x{h}")),
    ];
    list.into_iter().map(|(key, text)| (format!("dapple:{key}"), text)).collect()
}

/// Makes each run in a process of its own: a program that reads a [`Job`] as JSON from its standard input and writes
/// the [`Run`] as JSON to its standard output.
pub struct Processes {
    program: PathBuf,
    words: Vec<String>,
}

impl Processes {
    /// `program` with these words behind it.
    pub fn new(program: &Path, words: &[&str]) -> Self {
        Self { program: program.to_owned(), words: words.iter().map(|w| (*w).to_owned()).collect() }
    }
}

impl Runner for Processes {
    fn run(&mut self, job: &Job) -> Result<Run, StudyError> {
        let refuse = |why: String| {
            let what = format!("{}, {}, seed {}, in a process of its own", job.view.name, job.method, job.seed);
            StudyError::Run { what, why }
        };
        let mut command = Command::new(&self.program);
        command.args(&self.words).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().map_err(|e| refuse(format!("{}: {e}", self.program.display())))?;
        let words = serde_json::to_vec(job).map_err(|e| refuse(e.to_string()))?;
        // Closed when dropped. A child that does not listen says why itself.
        let told = child.stdin.take().map_or(Ok(()), |mut pipe| pipe.write_all(&words));
        let output = child.wait_with_output().map_err(|e| refuse(e.to_string()))?;
        if !output.status.success() {
            let said = String::from_utf8_lossy(&output.stderr);
            return Err(refuse(format!("it ended with {}: {}", output.status, said.trim())));
        }
        told.map_err(|e| refuse(e.to_string()))?;
        serde_json::from_slice(&output.stdout).map_err(|e| refuse(format!("it did not answer with a run: {e}")))
    }
}

/// The machine's load average over the last minute, where the system tells.
pub(crate) fn load_average() -> Option<f64> {
    std::fs::read_to_string("/proc/loadavg").ok()?.split_whitespace().next()?.parse().ok()
}

/// Where a run's image goes, relative to the study's folder, without extension. `number` is the method's.
pub(crate) fn image_stem(scene: &str, budget: Budget, number: usize) -> String {
    let budget = match budget {
        Budget::Spp(n) => format!("spp-{n}"),
        Budget::TimeOf(n) => format!("time-of-{n}"),
    };
    format!("images/{}/{budget}-{number:02}", file_name(scene))
}
