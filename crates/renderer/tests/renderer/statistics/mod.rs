//! The tests of `dapple_conformance::statistics`, and those on directions.
//!
//! Each test program uses a part of it.
#![allow(dead_code, unused_imports, unreachable_pub)]

pub mod directions;

pub use dapple_conformance::statistics::*;
