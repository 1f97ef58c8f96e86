//! A job that several processes run together.

use super::identity::compared;
use super::{Checkpoints, Job, JobMonitor, RenderedImage, Traced};
use crate::JobError;
use crate::memory::MemoryEstimate;
use dapple_core::exchange::{agree, compare};
use dapple_core::{Exchange, Film, Shard, Snapshot};

impl Job {
    /// Traces the render together with other processes, each with a job of the same description and outputs.
    ///
    /// Program version, scene files and settings are compared first. Each gets its rows of the film of [`Job::run`] in one
    /// process ([`Film::is_whole`]), and [`Job::finish_together`] makes the image of them. Process 0 alone reads the checkpoint to resume from, and writes one at each barrier
    /// between rounds; others pass `None`. A render whose processes died goes on from the last barrier, with any number
    /// of processes.
    ///
    /// # Errors
    ///
    /// The errors of [`Job::run`]; [`JobError::NoTogether`] for a shard; [`JobError::Core`] with a list of differences, or
    /// if another process failed or is gone.
    pub fn run_together(
        &mut self,
        checkpoints: Option<Checkpoints>,
        monitor: &mut dyn JobMonitor,
        exchange: &mut dyn Exchange,
    ) -> Result<Traced, JobError> {
        let prepared = self.prepare_together(checkpoints.as_ref(), monitor);
        let mine = prepared.as_ref().map(|(_, snapshot)| snapshot.clone()).map_err(ToString::to_string);
        // All hear of a failure. The process that failed reports its own error.
        let all = agree(exchange, mine);
        let (identity, _) = prepared?;
        let all = all?;
        let mut pairs = compared(&identity).pairs().to_vec();
        pairs.push(("budget".into(), format!("{:?}", self.spec.budget)));
        pairs.push(("filter".into(), self.filter.describe()));
        compare(exchange, &pairs)?;
        let snapshot = match &all[0][..] {
            [] => None,
            bytes => Some(Snapshot::from_bytes(bytes)?),
        };
        drop(all);
        self.trace((snapshot, identity), checkpoints, monitor, Some(exchange))
    }

    /// The estimated memory of process `share` among several that render together ([`Job::run_together`]), if their rows take
    /// the same time. `keeps` adds the pieces of a checkpoint, or its bytes where every process plans the whole image.
    /// `resumes` adds the bytes of a checkpoint and its film, which every process reads.
    ///
    /// # Errors
    ///
    /// As [`Job::memory`].
    pub fn memory_together(&mut self, share: Shard, keeps: bool, resumes: bool) -> Result<MemoryEstimate, JobError> {
        let (estimate, state) = self.forecast(keeps, Some(share))?;
        Ok(if resumes { estimate.with_copies("resumption", 2, state) } else { estimate })
    }

    /// Filters the film of [`Job::run_together`], each process some of its rows. Returns the image on process 0, and `None` on
    /// the others. It has the bits of [`Job::finish`]; its film has the statistics that the outputs show.
    ///
    /// # Errors
    ///
    /// As [`Job::finish`], and if a process is gone.
    pub fn finish_together(&self, film: Film, exchange: &mut dyn Exchange) -> Result<Option<RenderedImage>, JobError> {
        self.filtered(film, Some(exchange))
    }

    /// The identity of the job, and the encoded snapshot to resume from, empty without one.
    fn prepare_together(
        &self,
        checkpoints: Option<&Checkpoints>,
        monitor: &mut dyn JobMonitor,
    ) -> Result<(crate::checkpoint::Identity, Vec<u8>), JobError> {
        if self.spec.shard.is_some() {
            return Err(JobError::NoTogether);
        }
        let identity = self.identity()?;
        let snapshot = match checkpoints {
            Some(checkpoints) => checkpoints.snapshot(&identity, monitor)?,
            None => None,
        };
        if let (Some(checkpoints), Some(bytes)) = (checkpoints, &snapshot) {
            checkpoints.decode(bytes)?;
        }
        Ok((identity, snapshot.unwrap_or_default()))
    }
}
