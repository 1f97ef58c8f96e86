//! The tests of `dapple_conformance::statistics`, and those on directions.
//!
//! Not every test program that has this uses all of it.
#![allow(dead_code, unused_imports, unreachable_pub)]

pub mod directions;

pub use dapple_conformance::statistics::*;
