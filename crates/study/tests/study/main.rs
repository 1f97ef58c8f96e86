//! The integration tests of the crate: one program, so that shared code is linked and instantiated once.

mod browser;
mod external;
mod references;
mod report;
mod runs;
mod support;
