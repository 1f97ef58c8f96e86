//! Integration tests of the crate in one program, which links their dependencies once.

mod blocks;
mod common;
mod flip;
mod metrics;
mod oracle;
mod properties;
mod reference;
mod statistics;
mod student;
