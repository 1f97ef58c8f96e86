//! The tests of the crate from outside: one program, which links and instantiates once what all of them use.

mod common;
mod conformance;
mod driver;
mod film;
mod film_pushed;
mod holdout;
mod resume;
mod rng;
mod session;
mod time;
mod withdraw;
