//! Renders in stages: a plan file, the parts that machines trace of it, and the next plan file.

use super::checkpoints::Watched;
use super::identity::{PLAN, SPEC, compared};
use super::{Job, JobMonitor, Traced};
use crate::checkpoint::{Contents, Identity, Kind};
use crate::memory::MemoryEstimate;
use crate::{JobError, RenderSpec};
use dapple_core::{Integrator, NoMonitor, Render, Sampler, Shard, Stage};
use dapple_renderer::make_integrator;
use std::path::{Path, PathBuf};

type Staged<'j> = (Render<'j>, Box<dyn Integrator + 'j>, &'j mut dyn Sampler);

/// A plan file: the state of a render between two stages, and its description.
pub struct PlanFile {
    path: PathBuf,
    spec: RenderSpec,
    identity: Identity,
    stage: Stage,
}

impl PlanFile {
    /// Reads a plan file.
    ///
    /// # Errors
    ///
    /// [`JobError::Checkpoint`] for a file that is missing or damaged; [`JobError::Snapshot`] for an inconsistent one;
    /// [`JobError::Spec`] for a description of another version.
    pub fn read(path: &Path) -> Result<Self, JobError> {
        let contents = Contents::read(path, Kind::Plan)?;
        let path = path.to_owned();
        let stage = Stage::from_bytes(&contents.body);
        let stage = stage.map_err(|source| JobError::Snapshot { path: path.clone(), source })?;
        let spec = RenderSpec::from_json(contents.identity.value(SPEC).unwrap_or_default())?;
        Ok(Self { path, spec, identity: contents.identity, stage })
    }

    /// The path of the plan that a part was traced from, as it was given then.
    ///
    /// # Errors
    ///
    /// [`JobError::Checkpoint`] for a part that is missing or damaged.
    pub fn of_part(part: &Path) -> Result<PathBuf, JobError> {
        let contents = Contents::read(part, Kind::Part)?;
        Ok(contents.identity.value(PLAN).unwrap_or_default().into())
    }

    /// The description of the render.
    pub fn spec(&self) -> &RenderSpec {
        &self.spec
    }

    /// The number of stages before this plan.
    pub fn stage(&self) -> u32 {
        self.stage.number()
    }

    /// Returns `true` if all samples are traced, so that the image can be made.
    pub fn is_done(&self) -> bool {
        self.stage.is_done()
    }
}

/// What a process does in a render in stages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum StageTask {
    /// It plans the first stage.
    First,
    /// It traces a part.
    Part,
    /// It makes the next plan of all parts.
    Next,
}

impl Job {
    /// The estimated memory of a process of a render in stages. It holds files beside the film.
    ///
    /// # Errors
    ///
    /// As [`Job::memory`].
    pub fn memory_in_stages(&mut self, task: StageTask) -> Result<MemoryEstimate, JobError> {
        // All parts together are as long as the film, and so is a plan. The next plan is made while they are held.
        let copies = match task {
            StageTask::First | StageTask::Part => 3,
            StageTask::Next => 5,
        };
        self.need_any_image();
        let (estimate, bytes) = self.forecast(false)?;
        Ok(estimate.with_copies(copies, bytes))
    }

    /// Records all that any image of the render may need, as for shards.
    fn need_any_image(&mut self) {
        let hits = u8::from(self.clusters().is_some());
        self.needs = self.needs.with_variance().with_first_hits(hits);
    }

    /// Plans the first stage of a render. Returns the bytes of a plan file.
    ///
    /// # Errors
    ///
    /// [`JobError::NoTogether`] for a shard; [`JobError::Core`] for a limit of time, or one that the sampler cannot meet.
    pub fn first_plan(&mut self) -> Result<Vec<u8>, JobError> {
        if self.spec.shard.is_some() {
            return Err(JobError::NoTogether);
        }
        let identity = self.identity()?;
        self.need_any_image();
        let (render, mut integrator, sampler) = self.staged()?;
        let stage = render.first_stage(&mut *integrator, sampler)?;
        plan_bytes(identity, &stage)
    }

    /// Traces part `shard` of a plan: bands of 16 rows. Returns the bytes of a part file; `None` if the monitor stopped it.
    ///
    /// # Errors
    ///
    /// [`JobError::OtherRender`] for a plan of another render, [`JobError::Panicked`] if the integrator panicked.
    pub fn part(
        &mut self,
        plan: &PlanFile,
        shard: Shard,
        monitor: &mut dyn JobMonitor,
    ) -> Result<Option<Vec<u8>>, JobError> {
        let mut pairs = self.identity_of(plan)?.pairs().to_vec();
        pairs.push((PLAN.into(), plan.path.to_string_lossy().into_owned()));
        let mut watched = Watched::new(monitor, None, Identity::default(), self.limits.min_spp, true);
        let (render, mut integrator, sampler) = self.staged()?;
        let part = render.monitor(&mut watched).stage_part(&plan.stage, shard, &mut *integrator, sampler);
        let body = match part {
            Ok(Some(body)) => body,
            Ok(None) => return Ok(None),
            Err(error @ dapple_core::Error::Panicked { .. }) => return Err(JobError::Panicked(error.to_string())),
            Err(other) => return Err(other.into()),
        };
        Ok(Some(Contents { kind: Kind::Part, identity: Identity::new(pairs), body }.to_bytes()?))
    }

    /// Makes the next plan of all parts of one, in any order. Returns the bytes of its file, and `true` if all samples are
    /// traced.
    ///
    /// # Errors
    ///
    /// [`JobError::Shards`] with a line for each part that is missing, damaged, given twice, of another render, or of
    /// another plan.
    pub fn next_plan(&mut self, plan: &PlanFile, parts: &[PathBuf]) -> Result<(Vec<u8>, bool), JobError> {
        let identity = self.identity_of(plan)?;
        let (mut bodies, mut troubles) = (Vec::new(), Vec::new());
        for path in parts {
            match Contents::read(path, Kind::Part) {
                Ok(contents) => {
                    let differ = compared(&identity).differences(&compared(&contents.identity));
                    troubles.extend(differ.iter().map(|d| format!("{}: it is of another render: {d}", path.display())));
                    bodies.push(contents.body);
                }
                Err(e) => troubles.push(e.to_string()),
            }
        }
        if !troubles.is_empty() {
            return Err(JobError::Shards(troubles));
        }
        let (render, mut integrator, sampler) = self.staged()?;
        let stage = match render.next_stage(&plan.stage, &bodies, &mut *integrator, sampler) {
            Ok(stage) => stage,
            Err(dapple_core::Error::BadShards { what }) => {
                let plan = plan.path.display();
                return Err(JobError::Shards(what.lines().map(|line| format!("{plan}: {line}")).collect()));
            }
            Err(other) => return Err(other.into()),
        };
        Ok((plan_bytes(identity, &stage)?, stage.is_done()))
    }

    /// Takes over the film of a plan whose samples are all traced.
    ///
    /// # Errors
    ///
    /// [`JobError::NotDone`] for a plan with samples to trace, [`JobError::OtherRender`] for one of another render.
    pub fn finish_plan(&mut self, plan: &PlanFile) -> Result<Traced, JobError> {
        if !plan.is_done() {
            return Err(JobError::NotDone { path: plan.path.clone() });
        }
        let identity = self.identity_of(plan)?;
        self.trace((Some(plan.stage.snapshot()?), identity), None, &mut NoMonitor, None)
    }

    /// The identity of this job, which must be that of a plan.
    fn identity_of(&self, plan: &PlanFile) -> Result<Identity, JobError> {
        let identity = self.identity()?;
        let differences = compared(&identity).differences(&compared(&plan.identity));
        match differences.is_empty() {
            true => Ok(identity),
            false => Err(JobError::OtherRender { path: plan.path.clone(), differences }),
        }
    }

    /// The render of a stage, with integrator and sampler.
    fn staged(&mut self) -> Result<Staged<'_>, JobError> {
        if super::exact_crop::whole(&self.spec, &self.frame).is_some() {
            let why = "its stages would trace the training passes of the whole image on each machine; use one machine";
            return Err(JobError::NoExactCrop { why: why.into() });
        }
        let filtered = self.is_error_of_filtered();
        let integrator = make_integrator(&self.integrator, &self.prepared.world)?;
        let render = Render::new(self.frame, &self.limits).needs(self.needs);
        let render = if filtered { render.error_of(&*self.filter) } else { render };
        Ok((render, integrator, &mut *self.sampler))
    }
}

fn plan_bytes(identity: Identity, stage: &Stage) -> Result<Vec<u8>, JobError> {
    Ok(Contents { kind: Kind::Plan, identity, body: stage.to_bytes() }.to_bytes()?)
}
