//! The tests of the crate from outside: one program, which links and instantiates once what all of them use.

mod bias;
mod cells;
mod common;
mod conformance;
mod decisions;
mod memory;
mod variance_bias;
