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

    /// Sends the bytes `to_each[k]` to process `k`; returns what each process sent to this one, by number.
    ///
    /// The default sends everything to all. An exchange over a network sends each process its own.
    ///
    /// # Errors
    ///
    /// As [`Exchange::all_gather`].
    fn all_to_all(&mut self, to_each: Vec<Vec<u8>>) -> Result<Vec<Vec<u8>>, Error> {
        let me = self.share().index() as usize;
        let mut mine = Vec::with_capacity(to_each.iter().map(|bytes| 8 + bytes.len()).sum());
        for bytes in &to_each {
            mine.extend((bytes.len() as u64).to_le_bytes());
            mine.extend(bytes);
        }
        let all = self.all_gather(mine)?;
        Ok(all.iter().map(|sent| numbered(sent, me).unwrap_or_default().to_vec()).collect())
    }
}

/// The bytes for process `number` among those that another one sent.
fn numbered(mut sent: &[u8], number: usize) -> Option<&[u8]> {
    for at in 0.. {
        let (length, rest) = sent.split_first_chunk::<8>()?;
        let length = usize::try_from(u64::from_le_bytes(*length)).ok()?;
        let own = rest.get(..length)?;
        if at == number {
            return Some(own);
        }
        sent = &rest[length..];
    }
    None
}
