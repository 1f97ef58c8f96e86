//! Integration tests of the crate in one program, which links their dependencies once.

mod blue_noise;
mod convergence;
mod definitions;
mod hashing;
#[path = "../../src/keys.rs"]
#[allow(dead_code, reason = "tests use a part of it")]
mod keys;
mod mitchell;
mod nets;
mod sets;
mod support;
