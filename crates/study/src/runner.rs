//! Requests for runs of a study, and the runners that perform the runs.

use crate::reference::ReferenceImage;
use crate::scene::{Order, Shared, Subject, View, shoot};
use crate::{External, Method, Run, RunBudget, StudyError};
use dapple_core::render::NoMonitor;
use dapple_job::output::sample_map;
use dapple_scene::image::{Image, Layer, encode_exr, write_file};
use serde::{Deserialize, Serialize};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// A request for one run of a study. It can be sent as JSON to another process.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunRequest {
    /// The scene with the settings of its image.
    pub view: View,
    /// The method: sampler, point set and filter.
    pub method: Method,
    /// The external program that is the method's filter; `None` for built-in filters.
    #[serde(default)]
    pub external: Option<External>,
    /// The budget: mean samples per pixel, or equal time.
    pub budget: RunBudget,
    /// The seed of the point set.
    pub seed: u64,
    /// The total number of samples to request.
    pub asked: u64,
    /// The path of the reference image.
    pub reference: PathBuf,
    /// The number of threads; 0 means one per core.
    pub threads: usize,
    /// The study's folder.
    pub folder: PathBuf,
    /// The path of the image and sample map without extension, relative to the study's folder; `None` writes neither.
    pub image: Option<String>,
}

/// A way to perform the runs of a study: in this process ([`InProcess`]) or in new processes ([`Processes`]).
pub trait Runner {
    /// Performs the requested run: renders, filters and compares with the reference.
    ///
    /// # Errors
    ///
    /// [`StudyError`] for an unusable scene or reference, or a failed render.
    fn run(&mut self, request: &RunRequest) -> Result<Run, StudyError>;
}

/// The runner that performs runs in this process, on the current rayon thread pool.
///
/// A scene is read once for all of its runs. Before a scene's first run, one image is rendered as warm-up and not recorded.
pub struct InProcess {
    cpu: fn() -> Option<f64>,
    fresh: bool,
    /// The latest samples, if filters share samples.
    shared: Option<Option<Shared>>,
    subject: Option<Subject>,
    truth: Option<(PathBuf, ReferenceImage)>,
}

impl InProcess {
    /// Creates a runner. `cpu` returns the CPU seconds (user and system) of this process so far; `None` if unknown.
    pub fn new(cpu: fn() -> Option<f64>) -> Self {
        Self { cpu, fresh: false, shared: None, subject: None, truth: None }
    }

    /// Lets consecutive runs that differ only in their filter share samples, which are traced once. Each run's time includes
    /// the tracing.
    #[must_use]
    pub fn sharing(self) -> Self {
        Self { shared: Some(None), ..self }
    }

    /// Creates a runner without warm-up, for a process that performs a single run. The run is marked as `fresh`. `cpu` is as in
    /// [`InProcess::new`].
    pub fn fresh(cpu: fn() -> Option<f64>) -> Self {
        Self { fresh: true, ..Self::new(cpu) }
    }

    fn subject(&mut self, view: &View) -> Result<&Subject, StudyError> {
        // The previous scene is freed before the next is read.
        let subject = match self.subject.take().filter(|subject| subject.view == *view) {
            Some(subject) => subject,
            None => {
                let subject = Subject::load(view)?;
                if !self.fresh {
                    warm_up(&subject)?;
                }
                subject
            }
        };
        Ok(self.subject.insert(subject))
    }

    /// The request's reference, averaged to the size of the images.
    fn truth(&mut self, RunRequest { view, reference, .. }: &RunRequest) -> Result<&ReferenceImage, StudyError> {
        let [w, h] = view.resolution;
        let known = self.truth.take().filter(|(file, truth)| file == reference && truth.size == [w, h]);
        let truth = match known {
            Some((_, truth)) => truth,
            None => ReferenceImage::read(reference)?.0.averaged_to([w, h]).ok_or_else(|| {
                let why = format!("its size is neither {w}x{h} pixels nor a multiple; render the reference again");
                StudyError::reference(reference, &view.name, why)
            })?,
        };
        Ok(&self.truth.insert((reference.clone(), truth)).1)
    }
}

/// Renders an image that is not recorded, because the first images of a process are slower.
fn warm_up(subject: &Subject) -> Result<(), StudyError> {
    let samples = WARM_UP_SPP * subject.view.pixels();
    let order = Order { method: &Method::default(), seed: 0, samples, external: None, threads: 0 };
    shoot(subject, order, None, &mut NoMonitor, || None).map(|_| ())
}

const WARM_UP_SPP: u64 = 2;

impl Runner for InProcess {
    fn run(&mut self, request: &RunRequest) -> Result<Run, StudyError> {
        self.truth(request)?;
        let load = load_average();
        let (cpu, fresh) = (self.cpu, self.fresh);
        let RunRequest { method, seed, asked: samples, threads, .. } = request;
        let external = request.external.as_ref();
        let order = Order { method, seed: *seed, samples: *samples, external, threads: *threads };
        let mut shared = self.shared.take();
        let subject = self.subject(&request.view);
        let shot = subject.and_then(|subject| shoot(subject, order, shared.as_mut(), &mut NoMonitor, cpu));
        self.shared = shared;
        let shot = shot?;
        let truth = self.truth(request)?;
        let measured = truth.measure(&shot.filtered.radiance);
        let wrong = |e| StudyError::refused(format_args!("{}, {method}, seed {seed}", request.view.name), e);
        let (errors, reference_limited) = measured.map_err(wrong)?;
        let corrected = truth.variance.is_some();
        let map = sample_map(&shot.film);
        if let Some(stem) = &request.image {
            let file = |extension: &str| request.folder.join(format!("{stem}.{extension}"));
            let exr = file("exr");
            let folder = exr.parent().unwrap_or(&request.folder);
            std::fs::create_dir_all(folder).map_err(|e| StudyError::file(folder, "create the folder of images", e))?;
            let filtered = &shot.filtered;
            let image = Layer::of_image("", &Image::new(filtered.size, filtered.radiance.clone())?);
            write_file(&exr, &encode_exr(filtered.size, &[image], &attributes(request))?.bytes)?;
            write_file(&file("png"), &map.png()?)?;
        }
        let record = shot.film.record();
        let named = |extension: &str| request.image.as_ref().map(|stem| format!("{stem}.{extension}"));
        Ok(Run {
            scene: request.view.name.clone(),
            method: request.method.clone(),
            budget: request.budget,
            seed: request.seed,
            asked: request.asked,
            samples: record.samples,
            spp: record.samples as f64 / shot.film.frame().pixels() as f64,
            rays: shot.rays,
            seconds: shot.seconds,
            render_s: shot.seconds.render(),
            cpu_s: shot.cpu_s,
            errors,
            corrected,
            reference_limited,
            predicted_relmse: shot.film.predicted_relmse().filter(|e| e.is_finite()),
            rejected: record.rejected,
            load,
            fresh,
            image: named("exr"),
            sample_map: named("png"),
            white: request.image.is_some().then_some(map.white),
        })
    }
}

/// The settings of a run, as attributes of the image's header.
fn attributes(request: &RunRequest) -> Vec<(String, String)> {
    let [w, h] = request.view.resolution;
    let list = [
        ("version", env!("CARGO_PKG_VERSION").to_owned()),
        ("scene", request.view.name.clone()),
        ("scene-file", request.view.source.clone()),
        ("sampler", request.method.sampler.clone()),
        ("points", request.method.points.clone()),
        ("filter", request.method.filter.clone()),
        ("seed", request.seed.to_string()),
        ("budget", format!("{} samples", request.asked)),
        ("resolution", format!("{w}x{h}")),
    ];
    list.into_iter().map(|(key, text)| (format!("dapple:{key}"), text)).collect()
}

/// The runner that starts a process for each run. The process reads a [`RunRequest`] as JSON from standard input, and
/// writes the [`Run`] as JSON to standard output.
pub struct Processes {
    program: PathBuf,
    words: Vec<String>,
}

impl Processes {
    /// Creates a runner that starts `program` with the arguments `words` for each run.
    pub fn new(program: &Path, words: &[&str]) -> Self {
        Self { program: program.to_owned(), words: words.iter().map(|w| (*w).to_owned()).collect() }
    }
}

impl Runner for Processes {
    fn run(&mut self, request: &RunRequest) -> Result<Run, StudyError> {
        let refuse = |why: String| {
            let RunRequest { view, method, seed, .. } = request;
            StudyError::refused(format_args!("{}, {method}, seed {seed}, in a new process", view.name), why)
        };
        let mut command = Command::new(&self.program);
        command.args(&self.words).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command
            .spawn()
            .map_err(|e| refuse(format!("{} cannot be started: {e}; set fresh = false", self.program.display())))?;
        let words = serde_json::to_vec(request).map_err(|e| refuse(e.to_string()))?;
        // Dropping the pipe closes it. If the child process ends early, its own error is reported, not the write error.
        let told = child.stdin.take().map_or(Ok(()), |mut pipe| pipe.write_all(&words));
        let output = child.wait_with_output().map_err(|e| refuse(e.to_string()))?;
        if !output.status.success() {
            let said = String::from_utf8_lossy(&output.stderr);
            return Err(refuse(format!("it ended with {}: {}", output.status, said.trim())));
        }
        told.map_err(|e| refuse(e.to_string()))?;
        serde_json::from_slice(&output.stdout).map_err(|e| refuse(format!("its output is not a run: {e}")))
    }
}

/// The machine's load average over the last minute, if the system reports it.
pub(crate) fn load_average() -> Option<f64> {
    std::fs::read_to_string("/proc/loadavg").ok()?.split_whitespace().next()?.parse().ok()
}
