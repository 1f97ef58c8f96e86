//! Files that stay complete in a crash: checkpoints of renders, and shards (every N-th row) of images.
//!
//! * [`Store::save`] writes a temporary file, flushes it to the disk and renames it; the previous version of the file
//!   is kept beside it. So [`Store::read`] finds a complete file at every moment.
//! * [`Contents`] have an [`Identity`] (the settings that they depend on) and a checksum over every byte.
//! * [`FileSystem`] holds the calls to the operating system; tests let each call fail.
//!
//! The module knows neither films nor scenes: contents are bytes, such as those of `dapple_core::Status::snapshot`.

mod contents;
mod error;
mod file_system;
mod opened;
mod store;

pub use contents::{Contents, Damage, Identity, Kind};
pub use error::Error;
pub use file_system::{Disk, FileSystem};
pub use opened::Opened;
pub use store::{Found, Generation, Saving, Store};
