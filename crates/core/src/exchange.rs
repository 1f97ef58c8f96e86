//! Processes that render one image together.

use crate::{Error, Shard};

/// Messages between processes that render one image together. Every process calls it equally often.
///
/// [`Render::exchange`](crate::Render::exchange) takes an exchange. All processes render the same image with the same
/// settings: each traces its part of every round, plans are made by all. The film that each returns has the bits of a
/// render in one process.
pub trait Exchange {
    /// This process' number and the number of processes.
    fn share(&self) -> Shard;

    /// Sends `mine` to all processes; returns everyone's bytes, by number.
    ///
    /// # Errors
    ///
    /// [`Error::Gone`] when a process is gone. The render ends then, since no message can reach all.
    fn all_gather(&mut self, mine: Vec<u8>) -> Result<Vec<Vec<u8>>, Error>;
}
