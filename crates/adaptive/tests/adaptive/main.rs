//! The integration tests of the crate: one program, so that shared code is linked and instantiated once.

mod bias;
mod conformance;
mod decisions;
mod sequence;
mod support;
