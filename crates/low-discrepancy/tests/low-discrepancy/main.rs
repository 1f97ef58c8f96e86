//! Integration tests of the crate in one program, which links their dependencies once.

mod convergence;
mod nets;
mod sets;
mod support;
