//! The tests of the crate from outside: one program, which links and instantiates once what all of them use.

mod bias;
mod cells;
mod common;
mod conformance;
mod error_driven;
mod error_driven_bias;
mod hard_cases;
mod light_cells;
mod thesis;
