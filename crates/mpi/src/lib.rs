//! The processes of an MPI job as an [`Exchange`].
//!
//! ```no_run
//! use dapple_core::Exchange;
//!
//! let mut processes = dapple_mpi::Processes::start()?;
//! let mine = format!("process {}", processes.share().index()).into_bytes();
//! let all = processes.all_gather(mine)?;
//! assert_eq!(all.len(), processes.share().of() as usize);
//! # Ok::<(), dapple_core::Error>(())
//! ```
//!
//! Only the thread that started MPI sends messages; other threads may compute meanwhile.
//!
//! # Failures
//!
//! MPI's default error handler ends all processes if one is killed or a message fails. A render goes on from its
//! checkpoint.

mod one_host;

use dapple_core::{Error, Exchange, Shard};
use mpi::Count;
use mpi::datatype::PartitionMut;
use mpi::environment::Universe;
use mpi::topology::SimpleCommunicator;
use mpi::traits::{Communicator, CommunicatorCollectives, Destination, Source};

/// The bytes that all processes together send at once, at most: MPI counts them in 31 bits.
const AT_ONCE: usize = 1 << 30;

/// The processes that mpirun or srun started together, seen from one of them.
///
/// Dropping it ends MPI, which waits for the other processes. It cannot be started again.
pub struct Processes {
    /// Dropped last: the communicator is part of it.
    world: SimpleCommunicator,
    share: Shard,
    at_once: usize,
    _universe: Universe,
}

impl Processes {
    /// Starts MPI. A program that no launcher started is the only process.
    ///
    /// Processes that Open MPI's mpirun started on one machine talk through shared memory, without a search for networks. A
    /// user's own choice of `pml`, `btl` or `mtl` stays.
    ///
    /// # Errors
    ///
    /// [`Error::Gone`] if MPI was started before, or if it cannot be used beside threads that compute.
    pub fn start() -> Result<Self, Error> {
        one_host::prefer_shared_memory();
        let gone = |what: &str| Error::Gone { what: what.to_owned() };
        let (universe, threading) = mpi::initialize_with_threading(mpi::Threading::Funneled)
            .ok_or_else(|| gone("MPI was started before in this process"))?;
        if threading < mpi::Threading::Funneled {
            return Err(gone("this MPI library allows no threads; install one with MPI_THREAD_FUNNELED"));
        }
        let world = universe.world();
        let share = Shard::new(world.rank() as u32, world.size() as u32)?;
        Ok(Self { world, share, at_once: AT_ONCE, _universe: universe })
    }

    /// Limits the bytes that all processes together send at once, 2^30 by default. All must choose the same.
    #[must_use]
    pub fn with_bytes_at_once(self, bytes: usize) -> Self {
        Self { at_once: bytes.clamp(1, AT_ONCE), ..self }
    }

    fn of(&self) -> usize {
        self.share.of() as usize
    }
}

impl Exchange for Processes {
    fn share(&self) -> Shard {
        self.share
    }

    fn all_gather(&mut self, mine: Vec<u8>) -> Result<Vec<Vec<u8>>, Error> {
        let mut lengths = vec![0_u64; self.of()];
        self.world.all_gather_into(&(mine.len() as u64), &mut lengths[..]);
        let lengths: Vec<usize> = lengths.into_iter().map(|n| n as usize).collect();
        let piece = (self.at_once / self.of()).max(1);
        let mut all: Vec<Vec<u8>> = lengths.iter().map(|n| Vec::with_capacity(*n)).collect();
        let longest = lengths.iter().copied().max().unwrap_or(0);
        for from in (0..longest).step_by(piece) {
            let counts: Vec<usize> = lengths.iter().map(|n| n.saturating_sub(from).min(piece)).collect();
            let (sizes, starts) = partition(&counts);
            let mut got = buffer(vec![0_u8; counts.iter().sum()]);
            let own = buffer(mine[from.min(mine.len())..(from + piece).min(mine.len())].to_vec());
            self.world.all_gather_varcount_into(&own[..], &mut PartitionMut::new(&mut got[..], sizes, &starts[..]));
            append(&mut all, &got, &counts);
        }
        Ok(all)
    }

    fn all_to_all(&mut self, mut to_each: Vec<Vec<u8>>) -> Result<Vec<Vec<u8>>, Error> {
        to_each.resize(self.of(), Vec::new());
        // Bytes for this process need no message.
        let me = self.share.index() as usize;
        let kept = std::mem::take(&mut to_each[me]);
        let own: Vec<u64> = to_each.iter().map(|bytes| bytes.len() as u64).collect();
        let mut theirs = vec![0_u64; self.of()];
        self.world.all_to_all_into(&own[..], &mut theirs[..]);
        let piece = (self.at_once / self.of()).max(1);
        let mut all: Vec<Vec<u8>> = theirs.iter().map(|n| vec![0; *n as usize]).collect();
        // From where bytes lie to where they are read, without copies: pieces between two processes arrive in order.
        mpi::request::scope(|scope| {
            let mut open = Vec::new();
            for (bytes, from) in all.iter_mut().zip(0..) {
                let from = self.world.process_at_rank(from);
                open.extend(bytes.chunks_mut(piece).map(|part| from.immediate_receive_into(scope, part)));
            }
            for (bytes, to) in to_each.iter().zip(0..) {
                let to = self.world.process_at_rank(to);
                open.extend(bytes.chunks(piece).map(|part| to.immediate_send(scope, part)));
            }
            for request in open {
                request.wait();
            }
        });
        all[me] = kept;
        Ok(all)
    }
}

/// Bytes at an address of their own even if there are none. Rust gives an empty vector the address 1, which is
/// `MPI_IN_PLACE` in Open MPI.
fn buffer(mut bytes: Vec<u8>) -> Vec<u8> {
    bytes.reserve(1);
    bytes
}

/// The sizes of consecutive pieces and where each begins, as MPI takes them.
fn partition(counts: &[usize]) -> (Vec<Count>, Vec<Count>) {
    let sizes = counts.iter().map(|n| *n as Count).collect();
    let starts = counts.iter().scan(0, |start, n| {
        *start += n;
        Some((*start - n) as Count)
    });
    (sizes, starts.collect())
}

/// Appends consecutive pieces of these sizes, one to each message.
fn append(all: &mut [Vec<u8>], mut pieces: &[u8], counts: &[usize]) {
    for (bytes, count) in all.iter_mut().zip(counts) {
        let (piece, rest) = pieces.split_at(*count);
        bytes.extend_from_slice(piece);
        pieces = rest;
    }
}
