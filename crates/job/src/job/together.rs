//! A job that several processes run together.

use super::identity::compared;
use super::{Checkpoints, Job, JobMonitor, RenderedImage, Traced};
use crate::JobError;
use crate::checkpoint::{Identity, Opened};
use crate::memory::MemoryEstimate;
use dapple_core::exchange::{agree, compare};
use dapple_core::{Exchange, Film, Shard};

impl Job {
    /// Traces the render together with other processes, each with a job of the same description and outputs.
    ///
    /// Program version, scene files and settings are compared first. Each gets its rows of the film of [`Job::run`] in one
    /// process ([`Film::is_whole`]), and [`Job::finish_together`] makes the image of them. Process 0 alone reads the checkpoint
    /// to resume from, of which each process gets its rows, and writes one at each barrier between rounds; others pass `None`.
    /// A render whose processes died goes on from the last barrier, with any number of processes.
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
        let mine = prepared.as_ref().map(|(_, file)| vec![u8::from(file.is_some())]).map_err(ToString::to_string);
        // All hear of a failure. The process that failed reports its own error.
        let all = agree(exchange, mine);
        let (identity, file) = prepared?;
        let resumes = all?.contains(&vec![1]);
        let mut pairs = compared(&identity).pairs().to_vec();
        pairs.push(("budget".into(), format!("{:?}", self.spec.budget)));
        pairs.push(("filter".into(), self.filter.describe()));
        compare(exchange, &pairs)?;
        let snapshot = match resumes {
            true => Some(self.snapshot(file, checkpoints.as_ref(), Some(&mut *exchange))?),
            false => None,
        };
        self.trace((snapshot, identity), checkpoints, monitor, Some(exchange))
    }

    /// The estimated memory of process `share` among several that render together ([`Job::run_together`]), if their rows take
    /// the same time. `keeps` adds the pieces of a checkpoint, or its bytes where every process plans the whole image.
    ///
    /// # Errors
    ///
    /// As [`Job::memory`].
    pub fn memory_together(&mut self, share: Shard, keeps: bool) -> Result<MemoryEstimate, JobError> {
        Ok(self.forecast(keeps, Some(share))?.0)
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

    /// The identity of the job, and the checkpoint to resume from.
    fn prepare_together(
        &self,
        checkpoints: Option<&Checkpoints>,
        monitor: &mut dyn JobMonitor,
    ) -> Result<(Identity, Option<Opened>), JobError> {
        if self.spec.shard.is_some() {
            return Err(JobError::NoTogether);
        }
        let identity = self.identity()?;
        let file = checkpoints.map(|checkpoints| checkpoints.resumed(&identity, monitor)).transpose()?;
        Ok((identity, file.flatten()))
    }
}
