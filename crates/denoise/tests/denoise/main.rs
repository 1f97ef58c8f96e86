//! The tests of the crate from outside: one program, which links and instantiates once what all of them use.

mod blurred;
mod conformance;
mod consistency;
mod filters;
mod hard_cases;
mod lobes_and_tiles;
mod outside;
