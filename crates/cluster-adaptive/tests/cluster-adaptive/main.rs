//! The tests of the crate from outside: one program, which links and instantiates once what all of them use.

mod bias;
mod common;
mod conformance;
mod hard_cases;
mod thesis;
