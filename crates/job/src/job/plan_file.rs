//! Renders in stages: a plan file, the parts that machines trace of it, and the next plan file.

use super::checkpoints::Watched;
use super::identity::{PLAN, SPEC, compared};
use super::{Job, JobMonitor, Traced};
use crate::checkpoint::{self, Contents, Damage, Identity, Kind};
use crate::memory::MemoryEstimate;
use crate::{JobError, RenderSpec};
use dapple_core::{Integrator, NoMonitor, Render, Sampler, Shard, Stage};
use dapple_renderer::make_integrator;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

type Staged<'j> = (Render<'j>, Box<dyn Integrator + 'j>, &'j mut dyn Sampler);

/// A plan file: the state of a render between two stages, and its description.
pub struct PlanFile {
    path: PathBuf,
    spec: RenderSpec,
    identity: Identity,
    stage: Stage,
    bytes_read: u64,
}

impl PlanFile {
    /// Reads a plan file.
    ///
    /// # Errors
    ///
    /// [`JobError::Checkpoint`] for a file that is missing or damaged; [`JobError::Snapshot`] for an inconsistent one;
    /// [`JobError::Spec`] for a description of another version.
    pub fn read(path: &Path) -> Result<Self, JobError> {
        Self::read_bands(path, None)
    }

    /// Reads what a task that traces part `shard` needs: the beginning of the file, and its own bands of the film.
    ///
    /// # Errors
    ///
    /// As [`PlanFile::read`].
    pub fn read_part(path: &Path, shard: Shard) -> Result<Self, JobError> {
        Self::read_bands(path, Some(shard))
    }

    fn read_bands(path: &Path, shard: Option<Shard>) -> Result<Self, JobError> {
        let (contents, mut file, end) = Contents::read_start(path)?;
        let inconsistent = |source| JobError::Snapshot { path: path.to_owned(), source };
        let damaged = |damage| checkpoint::Error::Damaged { path: path.to_owned(), damage };
        let (places, head) = places(&contents.body, end).ok_or_else(|| damaged(Damage::Nonsense))?;
        let length = file.metadata().map_err(|source| checkpoint::Error::Read { path: path.to_owned(), source })?.len();
        let wanted_length = places.last().map_or(end, |last| last.start + last.length);
        if length != wanted_length {
            let damage = if length < wanted_length { Damage::Short } else { Damage::Nonsense };
            return Err(damaged(damage).into());
        }
        let stage = Stage::from_head(head).map_err(inconsistent)?;
        let wanted = match shard {
            Some(shard) => stage.bands_of(shard).map_err(inconsistent)?,
            None => (0..places.len()).collect(),
        };
        let (mut bands, mut bytes_read) = (Vec::with_capacity(wanted.len()), end);
        for band in wanted {
            let place = places.get(band).ok_or_else(|| damaged(Damage::Nonsense))?;
            let bytes =
                place.read(&mut file).map_err(|source| checkpoint::Error::Read { path: path.to_owned(), source })?;
            if bytes.len() as u64 != place.length || crc32fast::hash(&bytes) != place.checksum {
                return Err(damaged(Damage::Checksum).into());
            }
            bytes_read += place.length;
            bands.push((band, bytes));
        }
        let stage = stage.with_bands(bands).map_err(inconsistent)?;
        if shard.is_none() {
            stage.snapshot().map_err(inconsistent)?;
        }
        let spec = RenderSpec::from_json(contents.identity.value(SPEC).unwrap_or_default())?;
        Ok(Self { path: path.to_owned(), spec, identity: contents.identity, stage, bytes_read })
    }

    /// The bytes of the file that were read.
    pub fn bytes_read(&self) -> u64 {
        self.bytes_read
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

/// A task of a render in stages.
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
        let (estimate, bytes) = self.forecast(false, None)?;
        Ok(estimate.with_copies("plan and parts", copies, bytes))
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

/// The bytes of a plan file: contents whose body is the number of bands, the length and checksum of each, and the head of
/// the stage; then the bands.
fn plan_bytes(identity: Identity, stage: &Stage) -> Result<Vec<u8>, JobError> {
    let mut body = (stage.bands().len() as u64).to_le_bytes().to_vec();
    for (_, bytes) in stage.bands() {
        body.extend((bytes.len() as u64).to_le_bytes());
        body.extend(crc32fast::hash(bytes).to_le_bytes());
    }
    body.extend(stage.head());
    let mut file = Contents { kind: Kind::Plan, identity, body }.to_bytes()?;
    file.reserve_exact(stage.bands().iter().map(|(_, bytes)| bytes.len()).sum());
    stage.bands().iter().for_each(|(_, bytes)| file.extend(bytes));
    Ok(file)
}

/// The place of a band in a plan file.
struct BandPlace {
    start: u64,
    length: u64,
    checksum: u32,
}

impl BandPlace {
    fn read(&self, file: &mut File) -> io::Result<Vec<u8>> {
        file.seek(SeekFrom::Start(self.start))?;
        let mut bytes = Vec::new();
        file.take(self.length).read_to_end(&mut bytes)?;
        Ok(bytes)
    }
}

/// The places of the bands that the body of a plan lists, the first of them at `start`, and the head of the stage.
fn places(body: &[u8], mut start: u64) -> Option<(Vec<BandPlace>, &[u8])> {
    let (count, mut rest) = body.split_first_chunk::<8>()?;
    let mut places = Vec::new();
    for _ in 0..u64::from_le_bytes(*count) {
        let (length, more) = rest.split_first_chunk::<8>()?;
        let (checksum, more) = more.split_first_chunk::<4>()?;
        let (length, checksum) = (u64::from_le_bytes(*length), u32::from_le_bytes(*checksum));
        places.push(BandPlace { start, length, checksum });
        (start, rest) = (start.checked_add(length)?, more);
    }
    Some((places, rest))
}
