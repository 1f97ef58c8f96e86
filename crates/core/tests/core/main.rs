//! The tests of the crate from outside: one program, which links and instantiates once what all of them use.

mod allocate;
mod common;
mod conformance;
mod container;
mod driver;
mod feature_samples;
mod film;
mod film_errors;
mod holdout;
mod host;
mod moments;
mod options;
mod prepare;
mod recorder;
mod rng;
mod session;
mod share;
mod withdraw;
