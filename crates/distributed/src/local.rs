//! Processes that are threads of one program.

use crate::Processes;
use dapple_core::Error;
use std::sync::mpsc::{Receiver, Sender, channel};

/// One of the processes that [`local`] connects.
pub struct LocalProcess {
    rank: u32,
    to: Vec<Sender<(u32, Vec<u8>)>>,
    from: Receiver<(u32, Vec<u8>)>,
}

/// Connects `size` threads of one program; the thread of rank `i` takes item `i`. For tests, and for hosts with many devices.
pub fn local(size: u32) -> Vec<LocalProcess> {
    let (to, from): (Vec<_>, Vec<_>) = (0..size).map(|_| channel()).unzip();
    from.into_iter().zip(0..).map(|(from, rank)| LocalProcess { rank, to: to.clone(), from }).collect()
}

impl Processes for LocalProcess {
    fn rank(&self) -> u32 {
        self.rank
    }

    fn size(&self) -> u32 {
        self.to.len() as u32
    }

    fn send(&mut self, to: u32, bytes: &[u8]) -> Result<(), Error> {
        let sent = self.to[to as usize].send((self.rank, bytes.to_vec()));
        sent.map_err(|_| Error::other(format!("process {to}"), "it has ended"))
    }

    fn receive(&mut self) -> Result<(u32, Vec<u8>), Error> {
        self.from.recv().map_err(|_| Error::other("the other processes", "all have ended"))
    }
}
