//! Integration tests in one program, so that shared code is linked and instantiated once.

mod common;
mod conformance;
mod convergence;
mod four_dimensions;
mod hard_cases;
mod nets;
