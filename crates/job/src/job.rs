//! A render as a job: prepared, estimated, run or resumed, and finished.

mod checkpoints;
mod exact_crop;
mod identity;
mod monitor;
mod plan_file;
mod shards;
mod time;
mod together;

pub use checkpoints::{CheckpointOptions, Checkpoints};
pub use identity::pixel_filter;
pub use monitor::{JobMonitor, RenderMonitor};
pub use plan_file::{PlanFile, StageTask};
pub use shards::ShardSet;

use crate::checkpoint::Identity;
use crate::chosen;
use crate::load::{LoadOptions, LoadedScene, PreparedScene, frame, limits, setting};
use crate::memory::MemoryEstimate;
use crate::output::OutputFiles;
use crate::registry::{self, MadeFilter, MadeSampler, MethodInputs};
use crate::{BudgetSpec, ErrorOf, JobError, RenderSpec, Warning, WorldClusters};
use checkpoints::Watched;
use dapple_cluster_adaptive::ProbesHandle;
use dapple_core::{
    Budget, Error, Exchange, Film, FilmPoints, Filter, Filtered, Frame, Limits, Memory, Needs, NoMonitor, PointSet,
    Prepares, Render, Sampler, Sharded, Snapshot, Unfiltered, apply_together,
};
use dapple_renderer::World;
use dapple_scene::Scene;
use dapple_transport::make_integrator;
use serde::Serialize;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

/// A prepared render: the world, the sampler and the filter exist, and nothing is traced yet.
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
    integrator: String,
    /// The bytes of light that the integrator prepares.
    integrator_bytes: u64,
    described: String,
    sampler: Box<dyn Sampler>,
    filter: Box<dyn Filter>,
    clusters: Option<Arc<WorldClusters>>,
    cluster_seconds: f64,
    probes: ProbesHandle,
    needs: Needs,
    /// The most bytes that the integrator takes by learning.
    training_bytes: u64,
    outputs: OutputFiles,
}

/// The result of tracing.
pub struct Traced {
    /// The film with the samples traced.
    pub film: Film,
    /// The message of an integrator's panic; the film then holds the samples finished before.
    pub failure: Option<String>,
    /// The checkpoint file to resume from, or the error that kept it from being written; `None` without checkpoints.
    pub checkpoint: Option<Result<PathBuf, JobError>>,
    /// The number of checkpoints written.
    pub checkpoints_written: u64,
}

/// A finished image with the film it was made from.
pub struct RenderedImage {
    /// The film.
    pub film: Film,
    /// The filtered image.
    pub filtered: Filtered,
    /// The name and parameters of the filter.
    pub filter: String,
    /// Wall seconds of each phase.
    pub seconds: PhaseSeconds,
    /// The number of rays traced as probes, not included in the film's.
    pub probe_rays: u64,
    /// Warnings about the samples, the clusters and the filter.
    pub warnings: Vec<Warning>,
}

/// Wall seconds of each phase; 0 for phases that a render does not have.
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
    /// Wall seconds from clustering to filtering, without reading the scene, building the world and writing files.
    pub fn render(&self) -> f64 {
        self.cluster + self.probe + self.plan + self.trace + self.filter
    }
}

impl Job {
    /// Reads the scene of a description, builds the world, and makes sampler and filter.
    ///
    /// # Errors
    ///
    /// [`JobError`] if the description is invalid, or the scene or a method cannot be made.
    pub fn prepare(spec: &RenderSpec) -> Result<Self, JobError> {
        LoadedScene::read(spec, &LoadOptions::default())?.build()?.job(spec)
    }

    pub(crate) fn on(spec: &RenderSpec, prepared: PreparedScene) -> Result<Self, JobError> {
        spec.check()?;
        if !spec.has_world_of(&prepared.spec) {
            return Err(JobError::OtherWorld);
        }
        let frame = frame(spec, &prepared.scene)?;
        let points = registry::points(&spec.points, setting(spec, frame))?;
        let points_described = points.describe();
        let mut inputs = MethodInputs::of(prepared.world.clone());
        let MadeSampler { sampler, clusters, probes, placed } = registry::sampler(&spec.sampler, points, &inputs)?;
        inputs.clusters.clone_from(&clusters);
        if let Some(domain) = prepared.world.domain() {
            let points = Arc::from(registry::points(&spec.points, setting(spec, frame))?);
            let points = FilmPoints::new(points, domain).with_placed(placed);
            inputs.points = Some(points.with_defocus(prepared.world.camera().defocus()));
        }
        let MadeFilter { filter, clusters: of_filter } = registry::filter(&spec.filter, &inputs)?;
        let is_shared = |made: &&Arc<_>| clusters.as_ref().is_some_and(|known| Arc::ptr_eq(known, made));
        let sets = clusters.iter().chain(of_filter.iter().filter(|made| !is_shared(made)));
        let cluster_seconds = sets.fold(0.0, |sum, set| sum + set.seconds());
        let mut limits = limits(spec, frame);
        if let Budget::Seconds(seconds) = &mut limits.budget {
            // Keeps at least 1 ms, so that clustering cannot use up the whole limit.
            *seconds = (*seconds - cluster_seconds).max(1e-3);
        }
        let (integrator, _) = chosen::integrator(spec, &prepared.scene);
        let made = make_integrator(&integrator, &prepared.world)?;
        let (prepares, of_integrator, integrator_bytes) = (made.prepares(), made.needs(), made.memory(&frame));
        let trained = exact_crop::whole(spec, &frame).unwrap_or(frame);
        let training_bytes = made.training_memory(trained.pixels() as u64);
        drop(made);
        if of_integrator.splats && matches!(limits.budget, Budget::Error { .. }) {
            return Err(JobError::SplatsWithoutError { integrator });
        }
        if let Some(shard) = spec.shard.filter(|_| prepares == Prepares::EveryPass) {
            let why =
                format!("integrator \"{integrator}\" traces light for the whole image in each pass; use \"path\"");
            return Err(JobError::NoShard { shard, why });
        }
        exact_crop::check((spec, &frame), (&*sampler, &*filter), (&integrator, prepares, of_integrator))?;
        let mut job = Self {
            spec: spec.clone(),
            prepared,
            frame,
            limits,
            points: points_described,
            integrator,
            integrator_bytes,
            described: sampler.describe(),
            needs: filter.needs().and(of_integrator),
            sampler,
            filter,
            clusters: clusters.or(of_filter),
            cluster_seconds,
            probes,
            training_bytes,
            outputs: OutputFiles::none(),
        };
        if spec.shard.is_some() {
            // All that any image of the shards may need.
            let hits = u8::from(job.clusters().is_some());
            job.needs = job.needs.with_variance().with_first_hits(hits);
        }
        Ok(job)
    }

    /// Sets the image files to write, and makes the film record the statistics they need.
    pub fn set_outputs(&mut self, outputs: OutputFiles) {
        self.needs = self.needs.and(outputs.needs(self.clusters().is_some()));
        self.outputs = outputs;
    }

    /// Makes the film record these statistics as well.
    pub fn record(&mut self, needs: Needs) {
        self.needs = self.needs.and(needs);
    }

    /// The description of the render.
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

    /// The image's resolution and rendered window.
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// The budget and the bounds of samples per pixel.
    pub fn limits(&self) -> &Limits {
        &self.limits
    }

    /// The image files to write.
    pub fn outputs(&self) -> &OutputFiles {
        &self.outputs
    }

    /// The name and all parameters of the sampler.
    pub fn sampler_described(&self) -> &str {
        &self.described
    }

    /// The integrator, `NAME` or `NAME:key=value,…`: the one in the description, or the one that the scene calls for.
    pub fn integrator(&self) -> &str {
        &self.integrator
    }

    /// The name and all parameters of the point set.
    pub fn points_described(&self) -> &str {
        &self.points
    }

    /// Returns `true` if the sampler's counts never depend on samples.
    pub fn is_a_priori(&self) -> bool {
        self.sampler.a_priori()
    }

    /// The number of rounds in which the sampler spends the budget; `None` if it is unknown, as for a limit of time or
    /// error.
    pub fn rounds(&self) -> Option<u32> {
        matches!(self.limits.budget, Budget::Samples(_)).then(|| self.sampler.rounds()).flatten()
    }

    /// The scene and the world built from it.
    pub fn prepared(&self) -> &PreparedScene {
        &self.prepared
    }

    /// The warnings of reading the scene, building the world and clustering.
    pub fn warnings(&self) -> &[Warning] {
        &self.prepared.warnings
    }

    /// The clusters that the sampler uses, else those of the filter; `None` if neither uses any.
    pub fn clusters(&self) -> Option<&Arc<WorldClusters>> {
        self.clusters.as_ref()
    }

    /// The estimated memory of the render. `keeps` adds the bytes of a checkpoint or shard.
    ///
    /// # Errors
    ///
    /// [`JobError::NoShard`] for a sampler that cannot be sharded.
    pub fn memory(&mut self, keeps: bool) -> Result<MemoryEstimate, JobError> {
        Ok(self.forecast(keeps, None)?.0)
    }

    /// The estimated memory, and the bytes of the render's state in a file.
    fn forecast(
        &mut self,
        keeps: bool,
        together: Option<dapple_core::Shard>,
    ) -> Result<(MemoryEstimate, u64), JobError> {
        let (frame, limits, needs) = (&self.frame, &self.limits, self.needs);
        let memory = match self.spec.shard {
            None => Memory::of_render(&*self.sampler, &*self.filter, needs, frame, limits),
            Some(shard) => {
                let sharded =
                    Sharded::new(&mut *self.sampler, shard, limits).map_err(|e| shards::refused(shard, &e))?;
                Memory::of_render(&sharded, &*self.filter, needs, frame, limits)
            }
        };
        let memory = match together {
            Some(share) => {
                let methods = (&*self.sampler as &dyn Sampler, &*self.filter as &dyn Filter);
                memory.in_bands(methods, &self.outputs.shown(), frame, limits, share)
            }
            None => memory,
        };
        let limited = matches!(limits.budget, Budget::Error { .. }) && self.is_error_of_filtered();
        let memory = if limited { memory.with_error_of(frame) } else { memory };
        let files = self.outputs.memory(frame, &memory.needs, self.filter.name() != Unfiltered.name());
        let keeps = keeps || self.spec.shard.is_some();
        let estimate = MemoryEstimate::of_render(&self.prepared.expected, &memory, files, keeps)
            .with_integrator(self.integrator_bytes)
            .with_training(self.training_bytes, self.memory_of_training());
        Ok((estimate, memory.snapshot()))
    }

    /// Traces the render, from the beginning or from the checkpoint file in `checkpoints`.
    ///
    /// # Errors
    ///
    /// [`JobError`] for limits that the sampler cannot meet, or a checkpoint of another render.
    pub fn run(&mut self, checkpoints: Option<Checkpoints>, monitor: &mut dyn JobMonitor) -> Result<Traced, JobError> {
        let identity = match &checkpoints {
            Some(_) => self.identity()?,
            None => Identity::default(),
        };
        let bytes = checkpoints.as_ref().map(|c| c.snapshot(&identity, monitor)).transpose()?.flatten();
        let snapshot = checkpoints.as_ref().zip(bytes).map(|(c, bytes)| c.decode(&bytes)).transpose()?;
        self.trace((snapshot, identity), checkpoints, monitor, None)
    }

    /// Traces the render, from a snapshot if there is one, alone or with other processes.
    fn trace(
        &mut self,
        (snapshot, identity): (Option<Snapshot>, Identity),
        checkpoints: Option<Checkpoints>,
        monitor: &mut dyn JobMonitor,
        exchange: Option<&mut dyn Exchange>,
    ) -> Result<Traced, JobError> {
        if let Some(snapshot) = &snapshot {
            monitor.resumed(snapshot.film().record().samples as f64 / self.frame.pixels() as f64);
        }
        let training = self.training_of_whole(snapshot.as_ref(), monitor)?;
        let mut watched = Watched::new(monitor, checkpoints, identity, self.limits.min_spp, exchange.is_some());
        let mut integrator = make_integrator(&self.integrator, &self.prepared.world)?;
        let filtered = self.is_error_of_filtered();
        let mut sharded;
        let sampler: &mut dyn Sampler = match self.spec.shard {
            None => &mut *self.sampler,
            Some(shard) => {
                sharded =
                    Sharded::new(&mut *self.sampler, shard, &self.limits).map_err(|e| shards::refused(shard, &e))?;
                &mut sharded
            }
        };
        let mut render =
            Render::new(self.frame, &self.limits).needs(self.needs).monitor(&mut watched).learn_from(training);
        if filtered {
            render = render.error_of(&*self.filter);
        }
        if let Some(exchange) = exchange {
            render = render.exchange(exchange).in_bands();
        }
        let film = match snapshot {
            None => render.run(&mut *integrator, sampler),
            Some(snapshot) => render.resume(snapshot, &mut *integrator, sampler),
        };
        let (checkpoint, checkpoints_written) = watched.into_checkpoint();
        match film {
            Ok(film) => Ok(Traced { film, failure: None, checkpoint, checkpoints_written }),
            Err(error) => {
                let message = error.to_string();
                match error {
                    Error::Panicked { film, .. } => {
                        Ok(Traced { film: *film, failure: Some(message), checkpoint, checkpoints_written })
                    }
                    other => Err(other.into()),
                }
            }
        }
    }

    /// Returns `true` if a limit of error concerns the filtered image.
    fn is_error_of_filtered(&self) -> bool {
        self.spec.error_of == ErrorOf::Filtered && self.filter.name() != Unfiltered.name()
    }

    /// The image that a limit of error concerns, as an adjective.
    pub(crate) fn error_concerns(&self) -> &'static str {
        if self.is_error_of_filtered() { "filtered" } else { "unfiltered" }
    }

    /// Filters a film of this render and returns the image.
    ///
    /// For a stopped render, the image stays unfiltered if the filter would take a second or more.
    ///
    /// # Errors
    ///
    /// [`JobError::Core`] if the film lacks statistics that the filter needs.
    pub fn finish(&self, film: Film) -> Result<RenderedImage, JobError> {
        let image = self.filtered(film, None)?;
        image.ok_or_else(|| Error::Gone { what: "it has no image".into() }.into())
    }

    /// The filtered image; `None` on processes that do not write it.
    fn filtered(&self, film: Film, exchange: Option<&mut dyn Exchange>) -> Result<Option<RenderedImage>, JobError> {
        /// Pixels per second and thread of the default filter.
        const FILTERED_A_SECOND: usize = 125_000;
        let mut warnings = self.clusters_warnings();
        let mut filter: &dyn Filter = &*self.filter;
        // Processes decide alike, whatever their threads.
        let threads = if exchange.is_some() { 1 } else { rayon::current_num_threads() };
        let patience = FILTERED_A_SECOND * threads;
        if film.record().interrupted && filter.name() != Unfiltered.name() && film.frame().pixels() > patience {
            warnings.push(Warning::NotFiltered { filter: filter.name().to_owned() });
            filter = &Unfiltered;
        }
        let clock = Instant::now();
        let (film, filtered) = match exchange {
            Some(exchange) => match apply_together(filter, film, &self.outputs.shown(), exchange)? {
                Some(both) => both,
                None => return Ok(None),
            },
            None if !film.is_whole() => {
                let what = "it holds the rows of one process; make the image by finish_together";
                return Err(Error::Mismatch { who: "the film".into(), what: what.into() }.into());
            }
            None => {
                let filtered = filter.apply(&film)?;
                (film, filtered)
            }
        };
        let seconds = clock.elapsed().as_secs_f64();
        let described = filter.describe();
        Ok(Some(self.image(film, filtered, described, seconds, warnings)))
    }

    /// Combines a film of this render with an image that another filter made in `seconds`; `filter` describes the
    /// filter.
    pub fn finished(&self, film: Film, filtered: Filtered, filter: String, seconds: f64) -> RenderedImage {
        self.image(film, filtered, filter, seconds, self.clusters_warnings())
    }

    /// Traces and filters the render, without a monitor, and returns the image.
    ///
    /// # Errors
    ///
    /// As [`Job::run`] and [`Job::finish`]; [`JobError::Panicked`] if the integrator panicked.
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
            let predicted = record.filtered_relmse.or_else(|| film.predicted_relmse());
            if !record.interrupted && predicted.is_none_or(|predicted| predicted > goal) {
                warnings.push(Warning::ErrorNotReached { predicted, goal });
            }
        }
        let probes = self.probes.cost().unwrap_or_default();
        let seconds = PhaseSeconds {
            load: self.prepared.load_seconds,
            bvh: self.prepared.build_seconds,
            cluster: self.cluster_seconds,
            probe: probes.seconds,
            // Probes are traced when the first round is planned.
            plan: (record.plan_seconds() - probes.seconds).max(0.0),
            trace: record.trace_seconds(),
            filter: seconds,
            write: 0.0,
        };
        if let BudgetSpec::Seconds(limit) = self.spec.budget {
            let first = (film.record(), self.limits.min_spp);
            warnings.extend(time::exceeded(limit, seconds.render(), seconds.filter, first));
        }
        RenderedImage { film, filtered, filter, seconds, probe_rays: probes.rays, warnings }
    }

    /// Warnings about a clustering grid without effect, and about probes that were NaN.
    fn clusters_warnings(&self) -> Vec<Warning> {
        let mut warnings = Vec::new();
        let report = self.clusters().and_then(|clusters| clusters.report());
        if let Some(report) = report.filter(|report| report.is_degenerate()) {
            let (voxels, fullest, triangles) = (report.requested(), report.fullest, report.triangles);
            warnings.push(Warning::DegenerateClusters { voxels, fullest, triangles });
        }
        let rejected = self.probes.rejected();
        if rejected > 0 {
            warnings.push(Warning::RejectedProbes(rejected));
        }
        warnings
    }

    /// The settings of this render on which the samples depend.
    pub(crate) fn identity(&self) -> Result<Identity, JobError> {
        identity::identity(self)
    }
}

impl RenderedImage {
    /// Mean samples per pixel traced.
    pub fn spp(&self) -> f64 {
        self.film.record().samples as f64 / self.film.frame().pixels() as f64
    }

    /// The number of rays traced, probes included.
    pub fn rays(&self) -> u64 {
        self.film.record().rays + self.probe_rays
    }
}
