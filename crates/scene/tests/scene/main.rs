//! Reading and describing scenes, as one test program: linking takes longer than compiling.
//!
//! The test of memory and the corpus of the fuzz targets are programs of their own beside it.

mod bundled;
mod effects_found;
mod gltf;
mod image;
mod models;
mod reader_directives;
mod reader_hard;
mod reader_messages;
mod reader_old;
mod reader_scenes;
mod support;
