//! The crate's integration tests: one program.

mod lightcuts;
mod photons;
mod radiosity;
mod references;
mod support;
