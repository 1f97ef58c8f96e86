//! Integration tests of the crate in one program, which links their dependencies once.

mod compare;
mod discrepancy;
mod flip;
mod means;
mod metric;
mod noise;
mod statistics;
mod support;
