//! Images: reading every format, and writing files.
#![allow(clippy::print_stderr)] // A skipped test has to say so.

mod layers;
mod made_exr;
mod read;
mod rewrite;
mod spaces;
mod write;
