//! The command line as its user meets it: one program, so that shared code is linked once.

mod common;
mod denoise;
mod effects;
mod farm;
mod image_files;
mod image_pairs;
mod live;
#[path = "../../../scene/tests/scene/image/made_exr.rs"]
mod made_exr;
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
