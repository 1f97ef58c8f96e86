//! Images: reading every format, and writing files.

mod exr;
// A skipped test has to say so.
#[allow(clippy::print_stderr)]
mod files;
mod png;
#[allow(clippy::print_stderr)]
mod read;
