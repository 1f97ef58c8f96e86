//! Reading and describing scenes, as one test program: linking takes longer than compiling.

mod bundled;
mod corpus;
mod effects_found;
mod effects_removed;
mod fuzz_corpus;
mod gltf;
mod gltf_surfaces;
mod image;
#[cfg(target_os = "linux")] // Reads /proc.
mod image_memory;

mod left_out;
mod model_colors;
mod model_views;
mod models;
mod reader_directives;
mod reader_hard;
mod reader_made;
mod reader_messages;
mod reader_old;
mod reader_parts;
mod reader_scenes;
mod support;
mod text;
