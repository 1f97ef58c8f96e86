//! The command line as its user meets it: one program, so that shared code is linked once.

mod common;
mod denoise;
mod effects;
mod farm;
mod live;
mod memory;
mod models;
#[cfg(target_os = "linux")]
mod mutated;
mod options;
mod programs;
mod render;
mod resume;
mod schemas;
mod stages;
mod study;
mod together;
mod words;
