//! Images: reading every format, and writing files.
#![allow(clippy::print_stderr)] // A skipped test has to say so.

mod read;
mod write;
