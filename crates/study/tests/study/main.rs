//! The integration tests of the crate: one program, so that shared code is linked and instantiated once.

mod browser;
mod common;
mod exports;
mod external;
mod known_answers;
mod references;
mod report;
mod resume;
mod synthesis;
