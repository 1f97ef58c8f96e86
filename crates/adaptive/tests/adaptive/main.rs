//! The integration tests of the crate: one program, so that shared code is linked and instantiated once.

mod bias;
mod common;
mod conformance;
mod costs;
mod decisions;
mod memory;
mod then;
mod variance_bias;
