//! The tests of the crate from outside: one program, which links and instantiates once what all of them use.

mod barriers;
mod common;
mod conformance;
mod driver;
mod exchange;
mod feature_samples;
mod film;
mod film_pushed;
mod half_films;
mod holdout;
mod meetings;
mod own_rows;
mod prepare;
mod resume;
mod rng;
mod session;
mod stage;
mod then;
mod time;
mod unreported;
mod withdraw;
