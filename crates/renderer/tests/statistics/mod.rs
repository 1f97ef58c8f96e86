//! The tests of `dapple_conformance::statistics`, and those on directions.
//!
//! Each integration test that uses this says `mod statistics;`; not every one uses all of it.
#![allow(dead_code, unused_imports, unreachable_pub)]

pub mod directions;

pub use dapple_conformance::statistics::*;
