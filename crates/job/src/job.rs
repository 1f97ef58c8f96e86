//! A render as a job: prepared, estimated, run or resumed, and finished.

mod checkpoints;
mod finish;
mod identity;
mod monitor;
mod stages;

pub use checkpoints::{CheckpointOptions, Checkpoints};
pub use finish::{PhaseSeconds, RenderedImage};
pub use identity::pixel_filter;
pub use monitor::{JobMonitor, RenderMonitor};
pub use stages::{PlanFile, RowsFiles};

use crate::checkpoint::Identity;
use crate::load::{LoadOptions, LoadedScene, PreparedScene, chosen_integrator, frame, limits, setting};
use crate::memory::{ImageMemory, MemoryEstimate};
use crate::output::OutputFiles;
use crate::registry::{self, MadeFilter, MadeSampler, MethodInputs};
use crate::{ErrorOf, JobError, RenderSpec, WorldClusters};
use checkpoints::Watched;
use dapple_cluster_adaptive::FirstHitsHandle;
use dapple_core::integrator::Prepares;
use dapple_core::render::NoMonitor;
use dapple_core::{Error, Film, Filter, Frame, Limits, Needs, PointSet, Render, Sampler, Unfiltered, limits::Budget};
use dapple_renderer::World;
use dapple_scene::Scene;
use dapple_transport::make_integrator;
use std::path::PathBuf;
use std::sync::Arc;

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
    described: String,
    sampler: Box<dyn Sampler>,
    filter: Box<dyn Filter>,
    clusters: Option<Arc<WorldClusters>>,
    cluster_seconds: f64,
    first_hits: FirstHitsHandle,
    needs: Needs,
    /// Bytes of the integrator's prepared light (such as photons), and an upper bound on the bytes of its training data.
    integrator_bytes: [u64; 2],
    outputs: OutputFiles,
}

/// The result of tracing.
pub struct Traced {
    /// The film with the traced samples.
    pub film: Film,
    /// The message of the integrator's panic, if it panicked. The film then holds the samples finished before the panic.
    pub failure: Option<String>,
    /// The file of the final checkpoint, or the error of writing it; `None` if the job writes no checkpoints.
    pub checkpoint: Option<Result<PathBuf, JobError>>,
    /// The number of checkpoints written.
    pub checkpoints_written: u64,
}

impl Job {
    /// Reads the scene that `spec` names, builds the world, and creates the sampler and the filter.
    ///
    /// # Errors
    ///
    /// [`JobError`] if the description is invalid, the scene cannot be read, or the sampler or filter cannot be created.
    pub fn prepare(spec: &RenderSpec) -> Result<Self, JobError> {
        LoadedScene::read(spec, &LoadOptions::default())?.build()?.job(spec)
    }

    pub(crate) fn on(spec: &RenderSpec, prepared: PreparedScene) -> Result<Self, JobError> {
        spec.check()?;
        if !spec.has_world_of(&prepared.loaded.spec) {
            return Err(JobError::OtherWorld);
        }
        let frame = frame(spec, &prepared.loaded.scene)?;
        let points = registry::points(&spec.points, setting(spec, frame))?;
        let points_described = points.describe();
        let mut inputs = MethodInputs::of(prepared.world.clone());
        let MadeSampler { sampler, clusters, first_hits, placed } = registry::sampler(&spec.sampler, points, &inputs)?;
        inputs.clusters.clone_from(&clusters);
        let points = Arc::from(registry::points(&spec.points, setting(spec, frame))?);
        inputs.points = registry::film_points(&prepared.world, points).map(|points| points.with_placed(placed));
        let MadeFilter { filter, clusters: of_filter } = registry::filter(&spec.filter, &inputs)?;
        let is_shared = |made: &&Arc<_>| clusters.as_ref().is_some_and(|known| Arc::ptr_eq(known, made));
        let sets = clusters.iter().chain(of_filter.iter().filter(|made| !is_shared(made)));
        let cluster_seconds = sets.fold(0.0, |sum, set| sum + set.seconds());
        let mut limits = limits(spec, frame);
        if let Budget::Seconds(seconds) = &mut limits.budget {
            // Keeps at least 1 ms, so that clustering cannot use up the whole limit.
            *seconds = (*seconds - cluster_seconds).max(1e-3);
        }
        let (integrator, _) = chosen_integrator(spec, &prepared.loaded.scene);
        let made = make_integrator(&integrator, &prepared.world)?;
        let (prepares, of_integrator) = (made.prepares(), made.needs());
        let integrator_bytes = [made.memory(&frame), made.training_memory(frame.pixels() as u64)];
        drop(made);
        if of_integrator.splats && matches!(limits.budget, Budget::Error { .. }) {
            return Err(JobError::SplatsWithoutError { integrator });
        }
        if let Some(part) = spec.part.filter(|_| prepares == Prepares::EveryPass) {
            let why = format!(
                "integrator \"{integrator}\" traces light for the whole image in each pass and cannot render a part; use integrator \"path\""
            );
            return Err(JobError::NoParts { part, why });
        }
        Ok(Self {
            spec: spec.clone(),
            prepared,
            frame,
            limits,
            points: points_described,
            integrator,
            described: sampler.describe(),
            needs: filter.needs().and(of_integrator),
            sampler,
            filter,
            clusters: clusters.or(of_filter),
            cluster_seconds,
            first_hits,
            integrator_bytes,
            outputs: OutputFiles::none(),
        })
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
        &self.prepared.loaded.scene
    }

    /// The world.
    pub fn world(&self) -> &Arc<World> {
        &self.prepared.world
    }

    /// The image's resolution and rendered window.
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// The budget, and the bounds on the number of samples per pixel.
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

    /// The integrator in use, `NAME` or `NAME:key=value,…`; for `auto`, the one selected for the scene.
    pub fn integrator(&self) -> &str {
        &self.integrator
    }

    /// The name and all parameters of the point set.
    pub fn points_described(&self) -> &str {
        &self.points
    }

    /// Returns `true` if the sampler chooses sample counts without using the values of samples.
    pub fn is_a_priori(&self) -> bool {
        self.sampler.a_priori()
    }

    /// The number of rounds in which the sampler spends the budget; `None` if unknown, as under a time or error limit.
    pub fn rounds(&self) -> Option<u32> {
        matches!(self.limits.budget, Budget::Samples(_)).then(|| self.sampler.rounds()).flatten()
    }

    /// The scene and the world built from it.
    pub fn prepared(&self) -> &PreparedScene {
        &self.prepared
    }

    /// The sampler's clusters or, if the sampler uses none, the filter's. `None` if neither uses clusters.
    pub fn clusters(&self) -> Option<&Arc<WorldClusters>> {
        self.clusters.as_ref()
    }

    /// The estimated memory of the render, including a checkpoint if `keeps` is `true`.
    pub fn memory(&self, keeps: bool) -> MemoryEstimate {
        self.forecast(keeps).0
    }

    /// The estimated memory of the render, and the bytes of its state when encoded for a file.
    fn forecast(&self, keeps: bool) -> (MemoryEstimate, u64) {
        let (frame, limits, needs) = (&self.frame, &self.limits, self.needs);
        let filter = (&*self.filter, self.is_error_of_filtered());
        let memory = ImageMemory::new(&*self.sampler, filter, needs, frame, limits);
        let files = self.outputs.memory(frame, &memory.needs, self.filter.name() != Unfiltered.name());
        let estimate = self.prepared.loaded.memory.of_render(&memory, files, keeps, self.integrator_bytes);
        (estimate, memory.snapshot())
    }

    /// Traces the render, from the beginning or from the checkpoint file in `checkpoints`.
    ///
    /// # Errors
    ///
    /// [`JobError`] for limits that the sampler cannot meet, or for a checkpoint of another render.
    pub fn run(&mut self, checkpoints: Option<Checkpoints>, monitor: &mut dyn JobMonitor) -> Result<Traced, JobError> {
        let (identity, snapshot) = match &checkpoints {
            Some(checkpoints) => self.begun(checkpoints, monitor)?,
            None => (Identity::default(), None),
        };
        let mut watched = Watched::new(monitor, checkpoints, identity, self.limits.min_spp);
        let mut integrator = make_integrator(&self.integrator, &self.prepared.world)?;
        let render = Render::new(self.frame, &self.limits).needs(self.needs).recorders(self.filter.recorders());
        let render = if self.is_error_of_filtered() { render.error_of(&*self.filter) } else { render };
        let render = render.monitor(&mut watched);
        let film = match snapshot {
            None => render.run(&mut *integrator, &mut *self.sampler),
            Some(snapshot) => render.resume(snapshot, &mut *integrator, &mut *self.sampler),
        };
        let (checkpoint, checkpoints_written) = watched.into_checkpoint();
        let failure = film.as_ref().err().map(ToString::to_string);
        let film =
            film.or_else(|error| if let Error::Panicked { film, .. } = error { Ok(*film) } else { Err(error) })?;
        Ok(Traced { film, failure, checkpoint, checkpoints_written })
    }

    /// Returns `true` if [`finish`](Self::finish) accepts `film`, which comes from a render that differs only in its filter.
    /// The film must have every statistic that this render needs, and independent halves only if this render has them. This
    /// render's filter must have no recorders.
    pub fn is_recorded_by(&self, film: &Film) -> bool {
        let (needs, there) = (self.needs.and(self.sampler.needs()), film.needs());
        there.and(needs) == *there && there.halves == needs.halves && self.filter.recorders().is_empty()
    }

    /// Returns `true` if an error limit applies to the filtered image.
    pub(crate) fn is_error_of_filtered(&self) -> bool {
        self.spec.error_of == ErrorOf::Filtered && self.filter.name() != Unfiltered.name()
    }

    /// Traces and filters the render, without a monitor, and returns the image.
    ///
    /// # Errors
    ///
    /// The errors of [`Job::run`] and [`Job::finish`]; [`JobError::Panicked`] if the integrator panicked.
    pub fn render(&mut self) -> Result<RenderedImage, JobError> {
        let traced = self.run(None, &mut NoMonitor)?;
        match traced.failure {
            Some(failure) => Err(JobError::Panicked(failure)),
            None => self.finish(traced.film),
        }
    }

    /// The settings of this render on which the samples depend.
    pub(crate) fn identity(&self) -> Result<Identity, JobError> {
        identity::identity(self)
    }
}
