//! The crate's integration tests: one program.

mod instant;
mod lightcuts;
mod photons;
mod radiosity;
mod references;
mod support;
mod veach_bidir;
