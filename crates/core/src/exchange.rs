//! Processes that render one image together.
//!
//! [`Render::exchange`](crate::Render::exchange) takes an [`Exchange`]. Each process traces its bands of 16 rows. At the end of
//! each training pass all get everyone's training data. Within a round, bands are dealt anew by the work that each process has
//! left, unless the integrator learns or prepares itself for each pass: a slow process leaves bands to others.
//!
//! A sampler that plans by rows ([`Sampler::halo`](crate::Sampler::halo)) plans the own rows only, and the film holds these and
//! the rows around them. Before a round, a process gets the rows around its own ones, and bands that it takes over. The pixels
//! of all are gathered at the end, unless the render stays [in bands](crate::Render::in_bands). Monitors get the state of all in
//! pieces ([`Monitor::saved`](crate::Monitor::saved), [`Monitor::rows`](crate::Monitor::rows)), and resumed processes get their rows of it
//! in pieces ([`Render::read_snapshot`](crate::Render::read_snapshot)). Other samplers plan the whole image on every
//! process, as do renders with splats or an error limit. They gather everyone's pixels at the end of each round.
//!
//! ```
//! # use dapple_core::{PointSet, SampleId};
//! # struct Centre;
//! # impl PointSet for Centre {
//! #     fn describe(&self) -> String { "centre".into() }
//! #     fn block(&self, _: SampleId, _: u32) -> [f32; 4] { [0.5; 4] }
//! #     fn capacity(&self) -> u64 { u64::MAX }
//! # }
//! # use dapple_core::{Draws, Estimate, Integrator, Worker};
//! # struct Ramp;
//! # impl Integrator for Ramp {
//! #     fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
//! #         Estimate::new([draws.pixel()[0] as f32; 3])
//! #     }
//! # }
//! use dapple_core::samplers::Uniform;
//! use dapple_core::{Frame, Limits, Render, exchange};
//!
//! let (frame, limits) = (Frame::new(8, 40)?, Limits::spp(4.0));
//! let films = std::thread::scope(|threads| {
//!     let process = |mut with| {
//!         let limits = &limits;
//!         threads.spawn(move || Render::new(frame, limits).exchange(&mut with).run(&mut Ramp, &mut Uniform::new(Centre)))
//!     };
//!     let running: Vec<_> = exchange::in_memory(2).into_iter().map(process).collect();
//!     running.into_iter().map(|one| one.join().expect("no process panics")).collect::<Result<Vec<_>, _>>()
//! })?;
//! let alone = Render::new(frame, &limits).run(&mut Ramp, &mut Uniform::new(Centre))?;
//! assert!(films.iter().all(|film| film.image() == alone.image()));
//! # Ok::<(), dapple_core::Error>(())
//! ```

mod in_memory;
pub(crate) mod message;

pub use in_memory::{InMemory, in_memory};

use crate::snapshot::Broken;
use crate::snapshot::bytes::{Reader, Writer};
use crate::{Error, Shard};

/// Messages between processes that render one image together. Every process calls it equally often.
///
/// All processes render the same image with the same settings. The film that each returns has the bits of a render in one
/// process.
pub trait Exchange {
    /// This process' number and the number of processes.
    fn share(&self) -> Shard;

    /// Sends `mine` to all processes; returns everyone's bytes, by number.
    ///
    /// # Errors
    ///
    /// [`Error::Gone`] when a process is gone. The render ends then, since no message can reach all.
    fn all_gather(&mut self, mine: Vec<u8>) -> Result<Vec<Vec<u8>>, Error>;

    /// Sends the bytes `to_each[k]` to process `k`; returns what each process sent to this one, by number. Processes beyond the
    /// list get nothing.
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

/// Sends bytes to all processes and returns everyone's, by number; or ends the render of all with the reason why this
/// process cannot take part.
///
/// A program calls it between preparing and rendering, so that no process waits for one that failed.
///
/// # Errors
///
/// [`Error::Exchange`] with the reasons of all processes that failed, and the errors of [`Exchange::all_gather`].
pub fn agree(exchange: &mut dyn Exchange, mine: Result<Vec<u8>, String>) -> Result<Vec<Vec<u8>>, Error> {
    let mut to = Writer::with_capacity(64);
    to.flag(mine.is_ok());
    to.list(&mine.unwrap_or_else(String::into_bytes));
    let mut all = Vec::new();
    let mut troubles = Vec::new();
    for (rank, bytes) in exchange.all_gather(to.finish())?.iter().enumerate() {
        let mut from = Reader::new(bytes);
        let read = |from: &mut Reader<'_>| -> Result<(bool, Vec<u8>), Broken> { Ok((from.flag()?, from.list()?)) };
        match read(&mut from) {
            Ok((true, bytes)) => all.push(bytes),
            Ok((false, reason)) => troubles.push(format!("rank {rank}: {}", String::from_utf8_lossy(&reason))),
            Err(_) => troubles.push(format!("rank {rank} is at another step, or another program")),
        }
    }
    if troubles.is_empty() { Ok(all) } else { Err(Error::Exchange { what: troubles.join("\n") }) }
}

/// Compares settings, as pairs of name and value, with those of rank 0.
///
/// # Errors
///
/// [`Error::Exchange`] with a line for each difference: on all processes, so that none waits for another.
pub fn compare(exchange: &mut dyn Exchange, mine: &[(String, String)]) -> Result<(), Error> {
    let mut to = Writer::with_capacity(1024);
    for text in mine.iter().flat_map(|(name, value)| [name, value]) {
        to.text(text);
    }
    let all = agree(exchange, Ok(to.finish()))?;
    let pairs = |bytes: &[u8]| -> Result<Vec<(String, String)>, Broken> {
        let mut from = Reader::new(bytes);
        let mut pairs = Vec::new();
        while !from.is_empty() {
            pairs.push((from.text()?, from.text()?));
        }
        Ok(pairs)
    };
    let all = all.iter().map(|bytes| pairs(bytes)).collect::<Result<Vec<_>, _>>()?;
    let mut differ = Vec::new();
    let [first, others @ ..] = &all[..] else { return Ok(()) };
    let value = |of: &[(String, String)], name: &str| {
        of.iter().find(|(known, _)| known == name).map_or("nothing".to_owned(), |(_, value)| value.clone())
    };
    for (rank, pairs) in others.iter().enumerate() {
        let more = pairs.iter().filter(|(name, _)| first.iter().all(|(known, _)| known != name));
        for (name, _) in first.iter().chain(more) {
            let (here, there) = (value(first, name), value(pairs, name));
            if here != there {
                differ.push(format!("{name}: {there} at rank {}, not {here}", rank + 1));
            }
        }
    }
    if differ.is_empty() { Ok(()) } else { Err(Error::Exchange { what: differ.join("\n") }) }
}
