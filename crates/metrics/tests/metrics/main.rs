//! The tests of the crate from outside: one program, which links and instantiates once what all of them use.

mod blocks;
mod common;
mod flip;
mod metrics;
mod oracle;
mod properties;
mod reference;
mod statistics;
mod student;
