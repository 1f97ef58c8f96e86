//! The tests of the crate from outside: one program, which links and instantiates once what all of them use.

mod common;
mod conformance;
mod convergence;
mod four_dimensions;
mod hard_cases;
mod nets;
