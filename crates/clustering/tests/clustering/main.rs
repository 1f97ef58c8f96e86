//! The tests of the crate from outside: one program, which links and instantiates once what all of them use.

mod hard_cases;
mod soups;
mod support;
mod thesis;
