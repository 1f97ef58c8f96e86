//! The tests of the crate from outside: one program, which links and instantiates once what all of them use.

mod browser;
mod common;
mod external;
mod known_answers;
mod references;
mod report;
mod resume;
mod synthesis;
