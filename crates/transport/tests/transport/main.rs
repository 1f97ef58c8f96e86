//! The crate's integration tests: one program.

mod bidirectional;
mod light_trees;
mod lightcuts;
mod metropolis;
mod photons;
mod radiosity;
mod references;
mod support;
mod textured_lamps;
