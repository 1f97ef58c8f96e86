//! The integration tests of the crate: one program, so that shared code is linked and instantiated once.

mod faults;
mod fuzz_corpus;
mod predicted_error;
mod registry;
mod spec;
mod together;
mod whole_jobs;
