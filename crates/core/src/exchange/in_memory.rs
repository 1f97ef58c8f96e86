//! An exchange between threads of one process.

use super::Exchange;
use crate::{Error, Shard};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

/// Makes an exchange between `of` threads of one process, for tests: an end for each.
///
/// A thread that drops its end counts as gone.
pub fn in_memory(of: u32) -> Vec<InMemory> {
    let board = Arc::new(Board { state: Mutex::default(), changed: Condvar::new() });
    board.lock().posted.resize(of as usize, None);
    let share = |index| Shard::new(index, of).ok();
    (0..of).filter_map(share).map(|share| InMemory { share, board: board.clone(), sent: Vec::new() }).collect()
}

/// One end of an exchange between threads, made by [`in_memory`].
pub struct InMemory {
    share: Shard,
    board: Arc<Board>,
    sent: Vec<usize>,
}

struct Board {
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Default)]
struct State {
    /// The number of complete gatherings.
    complete: u64,
    posted: Vec<Option<Vec<u8>>>,
    /// The bytes of the last complete gathering. Nobody can complete the next one before all have read these.
    gathered: Arc<Vec<Vec<u8>>>,
    gone: Option<u32>,
}

impl Board {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl InMemory {
    /// The length in bytes of each message that this end has sent.
    pub fn sent(&self) -> &[usize] {
        &self.sent
    }
}

impl Exchange for InMemory {
    fn share(&self) -> Shard {
        self.share
    }

    fn all_gather(&mut self, mine: Vec<u8>) -> Result<Vec<Vec<u8>>, Error> {
        self.sent.push(mine.len());
        let mut state = self.board.lock();
        let turn = state.complete;
        state.posted[self.share.index() as usize] = Some(mine);
        if state.posted.iter().all(Option::is_some) {
            state.gathered = Arc::new(state.posted.iter_mut().filter_map(Option::take).collect());
            state.complete += 1;
            self.board.changed.notify_all();
        }
        while state.complete == turn {
            if let Some(rank) = state.gone {
                return Err(Error::Gone { what: format!("rank {rank} has ended") });
            }
            state = self.board.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
        let gathered = state.gathered.clone();
        drop(state);
        Ok(gathered.to_vec())
    }
}

impl Drop for InMemory {
    fn drop(&mut self) {
        self.board.lock().gone.get_or_insert(self.share.index());
        self.board.changed.notify_all();
    }
}
