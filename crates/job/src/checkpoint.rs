//! Files that survive a crash: checkpoints of renders, and shards of images that several machines make.
//!
//! * [`Store::save`] writes a file beside its place, flushes it to the disk and renames it; the generation before stays
//!   beside it. At every moment, [`Store::read`] finds a whole one.
//! * [`Contents`] have an [`Identity`] (everything that they depend on) and a checksum over every byte.
//! * [`FileSystem`] holds the calls to the operating system; tests let each call fail.
//!
//! It knows no film and no scene: contents are bytes, such as those of `dapple_core::Status::snapshot`.

mod contents;
mod error;
mod file_system;
mod store;

pub use contents::{Contents, Damage, Identity, Kind};
pub use error::Error;
pub use file_system::{Disk, FileSystem};
pub use store::{Found, Generation, Store};
