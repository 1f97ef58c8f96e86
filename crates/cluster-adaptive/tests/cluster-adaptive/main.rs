//! Integration tests of the crate in one program, which links their dependencies once.

mod hard_cases;
mod sampler;
mod support;
mod thesis;
