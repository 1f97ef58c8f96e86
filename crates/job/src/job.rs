//! One render: prepared, estimated, run or resumed, finished.

mod checkpoints;
mod identity;
mod shards;

pub use checkpoints::{CheckpointOptions, Checkpoints};
pub use identity::pixel_filter;
pub use shards::ShardSet;

use crate::checkpoint::Identity;
use crate::load::{LoadOptions, LoadedScene, PreparedScene, frame, limits, setting};
use crate::memory::MemoryEstimate;
use crate::output::OutputFiles;
use crate::{JobError, RenderSpec, Stage, Warning, WorldClusters, registry};
use checkpoints::Watched;
use dapple_core::{
    Budget, Control, Error, Film, Filter, Filtered, Frame, Limits, Memory, Monitor, Needs, NoMonitor, PointSet, Render,
    Sampler, Sharded, Status, Unfiltered,
};
use dapple_renderer::{World, make_integrator};
use dapple_scene::Scene;
use serde::Serialize;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

/// A prepared render: its world, sampler and filter are made, and nothing is traced.
///
/// ```
/// use dapple_job::{BudgetSpec, Job, RenderSpec};
///
/// let spec = RenderSpec::new("cornell").resolution(16, 16).budget(BudgetSpec::Spp(4.0));
/// let image = Job::prepare(&spec)?.render()?;
/// assert_eq!(image.film.record().samples, 4 * 16 * 16);
/// # Ok::<(), dapple_job::JobError>(())
/// ```
pub struct Job {
    spec: RenderSpec,
    prepared: PreparedScene,
    frame: Frame,
    limits: Limits,
    points: String,
    described: String,
    sampler: Box<dyn Sampler>,
    filter: Box<dyn Filter>,
    of_sampler: Stage,
    of_filter: Stage,
    needs: Needs,
    outputs: OutputFiles,
}

/// Watches a run.
pub trait JobMonitor {
    /// Sees the state between two slices, and decides whether the render continues.
    fn slice(&mut self, status: &Status<'_>) -> Control;

    /// Sees the state when all is traced, unless the render was stopped.
    fn end(&mut self, status: &Status<'_>) {
        let _ = status;
    }

    /// Takes a warning during the run.
    fn warn(&mut self, warning: Warning) {
        let _ = warning;
    }

    /// Takes the mean samples per pixel of the checkpoint that the run resumes from.
    fn resumed(&mut self, spp: f64) {
        let _ = spp;
    }
}

impl JobMonitor for NoMonitor {
    fn slice(&mut self, _: &Status<'_>) -> Control {
        Control::Continue
    }
}

/// The monitor of a render as that of a job, without warnings.
pub struct RenderMonitor<'m>(pub &'m mut dyn Monitor);

impl JobMonitor for RenderMonitor<'_> {
    fn slice(&mut self, status: &Status<'_>) -> Control {
        self.0.slice(status)
    }

    fn end(&mut self, status: &Status<'_>) {
        self.0.end(status);
    }
}

/// The end of a run.
pub struct Traced {
    /// The film.
    pub film: Film,
    /// The error of an integrator that panicked; the film holds what was finished before.
    pub failure: Option<String>,
    /// The checkpoint to resume from, or the reason why there is none; `None` without checkpoints.
    pub checkpoint: Option<Result<PathBuf, JobError>>,
}

/// An image with the film that it was made of.
pub struct RenderedImage {
    /// The film.
    pub film: Film,
    /// The image.
    pub filtered: Filtered,
    /// The filter that made it, described.
    pub filter: String,
    /// Seconds of each phase.
    pub seconds: PhaseSeconds,
    /// Rays of probes, besides the film's.
    pub probe_rays: u64,
    /// Warnings about the samples, the clusters and the filter.
    pub warnings: Vec<Warning>,
}

/// Wall seconds of each phase; 0 for a phase that a render does not have.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct PhaseSeconds {
    /// Reading the scene.
    pub load: f64,
    /// Building the world.
    pub bvh: f64,
    /// Clustering.
    pub cluster: f64,
    /// Tracing probes.
    pub probe: f64,
    /// Planning, without probes.
    pub plan: f64,
    /// Tracing.
    pub trace: f64,
    /// Filtering.
    pub filter: f64,
    /// Writing files.
    pub write: f64,
}

impl PhaseSeconds {
    /// From clusters to filter: the render without reading, building and writing.
    pub fn render(&self) -> f64 {
        self.cluster + self.probe + self.plan + self.trace + self.filter
    }
}

impl Job {
    /// Reads the scene of a description, builds its world, and makes sampler and filter.
    ///
    /// # Errors
    ///
    /// [`JobError`] for a description that is not valid, and for a scene or methods that cannot be made.
    pub fn prepare(spec: &RenderSpec) -> Result<Self, JobError> {
        LoadedScene::read(spec, &LoadOptions::default())?.build()?.job(spec)
    }

    pub(crate) fn on(spec: &RenderSpec, prepared: PreparedScene) -> Result<Self, JobError> {
        spec.check()?;
        if !spec.has_world_of(&prepared.spec) {
            return Err(JobError::OtherWorld);
        }
        let frame = frame(spec, &prepared.scene)?;
        let of_sampler = Stage::new(prepared.world.clone());
        let of_filter = of_sampler.sibling();
        let points = registry::points(&spec.points, setting(spec, frame))?;
        let points_described = points.describe();
        let sampler = registry::sampler(&spec.sampler, points, &of_sampler)?;
        let filter = registry::filter(&spec.filter, &of_filter)?;
        let mut limits = limits(spec, frame);
        if let Budget::Seconds(seconds) = &mut limits.budget {
            // Keeps at least 1 ms, so that clustering cannot use up the whole limit.
            *seconds = (*seconds - of_sampler.cluster_seconds()).max(1e-3);
        }
        drop(make_integrator(&spec.integrator, &prepared.world)?);
        let mut job = Self {
            spec: spec.clone(),
            prepared,
            frame,
            limits,
            points: points_described,
            described: sampler.describe(),
            needs: filter.needs(),
            sampler,
            filter,
            of_sampler,
            of_filter,
            outputs: OutputFiles::none(),
        };
        if spec.shard.is_some() {
            // All that any image of the shards may need.
            let hits = u8::from(job.clusters().is_some());
            job.needs = job.needs.with_variance().with_first_hits(hits);
        }
        Ok(job)
    }

    /// Sets the files that the image is written to, and records what they show.
    pub fn set_outputs(&mut self, outputs: OutputFiles) {
        self.needs = self.needs.and(outputs.needs(self.clusters().is_some()));
        self.outputs = outputs;
    }

    /// Records these statistics too.
    pub fn record(&mut self, needs: Needs) {
        self.needs = self.needs.and(needs);
    }

    /// The description.
    pub fn spec(&self) -> &RenderSpec {
        &self.spec
    }

    /// The scene.
    pub fn scene(&self) -> &Scene {
        &self.prepared.scene
    }

    /// The world.
    pub fn world(&self) -> &Arc<World> {
        &self.prepared.world
    }

    /// Resolution and window.
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// Budget and bounds.
    pub fn limits(&self) -> &Limits {
        &self.limits
    }

    /// The files that the image is written to.
    pub fn outputs(&self) -> &OutputFiles {
        &self.outputs
    }

    /// The sampler with all its parameters.
    pub fn sampler_described(&self) -> &str {
        &self.described
    }

    /// The point set with all its parameters.
    pub fn points_described(&self) -> &str {
        &self.points
    }

    /// Returns true if the sampler plans its counts a priori.
    pub fn is_a_priori(&self) -> bool {
        self.sampler.a_priori()
    }

    /// The scene and its preparation.
    pub fn prepared(&self) -> &PreparedScene {
        &self.prepared
    }

    /// The warnings of reading, building and clustering.
    pub fn warnings(&self) -> &[Warning] {
        &self.prepared.warnings
    }

    /// The clusters of this render: the sampler's own; the filter's if the sampler uses none.
    pub fn clusters(&self) -> Option<Arc<WorldClusters>> {
        self.of_sampler.clusters_used().or_else(|| self.of_filter.clusters_used())
    }

    /// The memory that the render takes. `keeps` adds the bytes of a checkpoint or shard.
    ///
    /// # Errors
    ///
    /// [`JobError::NoShard`] for a sampler that cannot be sharded.
    pub fn memory(&mut self, keeps: bool) -> Result<MemoryEstimate, JobError> {
        let (frame, limits, needs) = (&self.frame, &self.limits, self.needs);
        let memory = match self.spec.shard {
            None => Memory::of_render(&*self.sampler, &*self.filter, needs, frame, limits),
            Some(shard) => {
                let sharded =
                    Sharded::new(&mut *self.sampler, shard, limits).map_err(|e| shards::refused(shard, &e))?;
                Memory::of_render(&sharded, &*self.filter, needs, frame, limits)
            }
        };
        let files = self.outputs.memory(frame, &memory.needs, self.filter.name() != Unfiltered.name());
        Ok(MemoryEstimate::of_render(&self.prepared.expected, &memory, files, keeps || self.spec.shard.is_some()))
    }

    /// Traces the render, from its beginning or from the checkpoint of `checkpoints`.
    ///
    /// # Errors
    ///
    /// [`JobError`] for limits that the sampler cannot meet, and for a checkpoint of another render.
    pub fn run(&mut self, checkpoints: Option<Checkpoints>, monitor: &mut dyn JobMonitor) -> Result<Traced, JobError> {
        let identity = match &checkpoints {
            Some(_) => self.identity()?,
            None => Identity::default(),
        };
        let snapshot = checkpoints.as_ref().map(|c| c.snapshot(&identity, monitor)).transpose()?.flatten();
        if let Some(snapshot) = &snapshot {
            monitor.resumed(snapshot.film().record().samples as f64 / self.frame.pixels() as f64);
        }
        let mut watched = Watched::new(monitor, checkpoints, identity);
        let mut integrator = make_integrator(&self.spec.integrator, &self.prepared.world)?;
        let mut sharded;
        let sampler: &mut dyn Sampler = match self.spec.shard {
            None => &mut *self.sampler,
            Some(shard) => {
                sharded =
                    Sharded::new(&mut *self.sampler, shard, &self.limits).map_err(|e| shards::refused(shard, &e))?;
                &mut sharded
            }
        };
        let render = Render::new(self.frame, &self.limits).needs(self.needs).monitor(&mut watched);
        let film = match snapshot {
            None => render.run(&mut *integrator, sampler),
            Some(snapshot) => render.resume(snapshot, &mut *integrator, sampler),
        };
        let checkpoint = watched.into_checkpoint();
        match film {
            Ok(film) => Ok(Traced { film, failure: None, checkpoint }),
            Err(error) => {
                let message = error.to_string();
                match error {
                    Error::Panicked { film, .. } => Ok(Traced { film: *film, failure: Some(message), checkpoint }),
                    other => Err(other.into()),
                }
            }
        }
    }

    /// Filters a film of this render.
    ///
    /// A stopped render is not filtered if that would take a second or more.
    ///
    /// # Errors
    ///
    /// [`JobError::Core`] where the filter lacks statistics.
    pub fn finish(&self, film: Film) -> Result<RenderedImage, JobError> {
        /// Pixels per second and thread of the default filter.
        const FILTERED_A_SECOND: usize = 125_000;
        let mut warnings = self.clusters_warnings();
        let mut filter: &dyn Filter = &*self.filter;
        let patience = FILTERED_A_SECOND * rayon::current_num_threads();
        if film.record().interrupted && filter.name() != Unfiltered.name() && film.frame().pixels() > patience {
            warnings.push(Warning::NotFiltered { filter: filter.name().to_owned() });
            filter = &Unfiltered;
        }
        let clock = Instant::now();
        let filtered = filter.apply(&film)?;
        let seconds = clock.elapsed().as_secs_f64();
        let described = filter.describe();
        Ok(self.image(film, filtered, described, seconds, warnings))
    }

    /// An image that another filter made of a film of this render, in so many seconds.
    pub fn finished(&self, film: Film, filtered: Filtered, filter: String, seconds: f64) -> RenderedImage {
        self.image(film, filtered, filter, seconds, self.clusters_warnings())
    }

    /// Traces and filters, without a monitor.
    ///
    /// # Errors
    ///
    /// As [`Job::run`] and [`Job::finish`]; [`JobError::Panicked`] where the integrator panicked.
    pub fn render(&mut self) -> Result<RenderedImage, JobError> {
        let traced = self.run(None, &mut NoMonitor)?;
        match traced.failure {
            Some(failure) => Err(JobError::Panicked(failure)),
            None => self.finish(traced.film),
        }
    }

    fn image(
        &self,
        film: Film,
        filtered: Filtered,
        filter: String,
        seconds: f64,
        mut warnings: Vec<Warning>,
    ) -> RenderedImage {
        let record = film.record();
        if let Some(&first) = film.rejected().first() {
            let (rejected, samples, points) = (record.rejected, record.samples, self.points.clone());
            warnings.push(Warning::RejectedSamples { rejected, samples, first, points });
        }
        if let Budget::Error { relmse: goal, .. } = self.limits.budget {
            let predicted = film.predicted_relmse();
            if !record.interrupted && predicted.is_none_or(|predicted| predicted > goal) {
                warnings.push(Warning::ErrorNotReached { predicted, goal });
            }
        }
        let probes = self.of_sampler.probe_cost();
        let seconds = PhaseSeconds {
            load: self.prepared.load_seconds,
            bvh: self.prepared.build_seconds,
            cluster: self.of_sampler.cluster_seconds(),
            probe: probes.seconds,
            // Probes are traced when the first round is planned.
            plan: (record.plan_seconds() - probes.seconds).max(0.0),
            trace: record.trace_seconds(),
            filter: seconds,
            write: 0.0,
        };
        RenderedImage { film, filtered, filter, seconds, probe_rays: probes.rays, warnings }
    }

    /// A grid that tells nothing apart, and probes that are NaN.
    fn clusters_warnings(&self) -> Vec<Warning> {
        let mut warnings = Vec::new();
        let report = self.clusters().and_then(|clusters| clusters.report());
        if let Some(report) = report.filter(|report| report.is_degenerate()) {
            let (requested, occupied) = (report.requested(), report.occupied);
            warnings.push(Warning::DegenerateClusters { requested, occupied });
        }
        let rejected = self.of_sampler.rejected_probes();
        if rejected > 0 {
            warnings.push(Warning::RejectedProbes(rejected));
        }
        warnings
    }

    /// The parts of this render that its samples depend on.
    pub(crate) fn identity(&self) -> Result<Identity, JobError> {
        identity::identity(self)
    }
}

impl RenderedImage {
    /// Mean samples per pixel.
    pub fn spp(&self) -> f64 {
        self.film.record().samples as f64 / self.film.frame().pixels() as f64
    }

    /// Rays, those of probes included.
    pub fn rays(&self) -> u64 {
        self.film.record().rays + self.probe_rays
    }
}
