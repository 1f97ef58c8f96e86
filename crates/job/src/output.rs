//! From a film to image files: the layers of an EXR file, its header, and maps.
//!
//! [`OutputFiles`] writes them; [`image`](dapple_scene::image) encodes them.

mod files;
mod header;
mod layers;
mod maps;

pub use files::OutputFiles;

pub use layers::layers;
pub use maps::{GrayMap, albedo_map, cluster_ids, cluster_map, depth_map, error_map, normal_map, sample_map};
