//! The integration tests of the crate: one program, so that shared code is linked and instantiated once.

mod bias;
mod budget;
mod conformance;
mod decisions;
mod support;
