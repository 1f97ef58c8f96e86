//! The crate's integration tests: one program.

mod photons;
mod support;
