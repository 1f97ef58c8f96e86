//! Crash-safe files: checkpoints, plans and traced rows of renders.
//!
//! * [`Store::save`] writes a temporary file, flushes it to the disk and renames it; the previous version of the file
//!   is kept beside it. So [`Store::read`] finds a complete file at every moment.
//! * A [`StateFile`] has an [`Identity`] (the settings that it depends on), and a checksum over every byte.
//! * [`FileSystem`] holds the calls to the operating system; tests make each call fail.
//!
//! The module does not interpret states: a state is the bytes that `dapple_core::render::Status::snapshot` returns.

mod state_file;
mod store;

pub use state_file::{Error, Identity, ROWS, StateDamage, StateFile, StateKind};
pub use store::{Disk, FileSystem, LoadedState, Store};
