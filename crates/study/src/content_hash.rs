//! A short name for everything that a result depends on.

pub use dapple_job::ContentHash;
