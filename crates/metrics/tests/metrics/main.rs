//! Integration tests of the crate in one program, which links their dependencies once.

mod compare;
mod flip;
mod noise;
mod statistics;
mod support;
