//! The tests of the crate from outside: one program, which links and instantiates once what all of them use.

mod common;
mod conformance;
mod container;
mod driver;
mod feature_samples;
mod film;
mod film_pushed;
mod half_films;
mod holdout;
mod prepare;
mod recorder;
mod resume;
mod rng;
mod session;
mod time;
mod unreported;
mod withdraw;
