//! The processes of an MPI job as [`Processes`] of a render.
//!
//! ```no_run
//! use dapple_distributed::Processes;
//!
//! let mut processes = dapple_mpi::MpiProcesses::start()?;
//! if processes.rank() > 0 {
//!     processes.send(0, b"ready")?;
//! }
//! # Ok::<(), dapple_core::Error>(())
//! ```
//!
//! Only the thread that started MPI sends messages; other threads may compute meanwhile.
//!
//! # Failures
//!
//! MPI's default error handler ends all processes if one is killed or a message fails. A render is resumed from its
//! checkpoint.

mod one_host;

use dapple_core::Error;
use dapple_distributed::Processes;
use mpi::environment::Universe;
use mpi::topology::SimpleCommunicator;
use mpi::traits::{Communicator, Destination, Source};

/// The maximum number of bytes in an MPI message, whose length is a signed 32-bit integer.
const AT_ONCE: usize = 1 << 30;

/// The processes of an MPI job.
pub struct MpiProcesses {
    world: SimpleCommunicator,
    at_once: usize,
    _universe: Universe,
}

impl MpiProcesses {
    /// Starts MPI.
    ///
    /// # Errors
    ///
    /// [`Error::Other`] if MPI was already started in this process, or does not support threads.
    pub fn start() -> Result<Self, Error> {
        one_host::prefer_shared_memory();
        let refused = |what: &'static str| Error::other("MPI", what);
        let (universe, threading) = mpi::initialize_with_threading(mpi::Threading::Funneled)
            .ok_or_else(|| refused("MPI was already started in this process; start MPI only once"))?;
        if threading < mpi::Threading::Funneled {
            return Err(refused("the MPI library does not support MPI_THREAD_FUNNELED; install one that does"));
        }
        Ok(Self { world: universe.world(), at_once: AT_ONCE, _universe: universe })
    }

    /// Sets the maximum number of bytes in an MPI message, clamped to `1..=2^30`, for tests.
    #[must_use]
    pub fn with_bytes_at_once(self, bytes: usize) -> Self {
        Self { at_once: bytes.clamp(1, AT_ONCE), ..self }
    }
}

impl Processes for MpiProcesses {
    fn rank(&self) -> u32 {
        self.world.rank() as u32
    }

    fn size(&self) -> u32 {
        self.world.size() as u32
    }

    fn send(&mut self, to: u32, bytes: &[u8]) -> Result<(), Error> {
        let to = self.world.process_at_rank(to as i32);
        to.send(&(bytes.len() as u64));
        bytes.chunks(self.at_once).for_each(|piece| to.send(piece));
        Ok(())
    }

    fn receive(&mut self) -> Result<(u32, Vec<u8>), Error> {
        let (length, status) = self.world.any_process().receive::<u64>();
        let from = self.world.process_at_rank(status.source_rank());
        let mut bytes = vec![0; length as usize];
        // Messages of one process arrive in order.
        bytes.chunks_mut(self.at_once).for_each(|piece| {
            from.receive_into(piece);
        });
        Ok((status.source_rank() as u32, bytes))
    }
}
