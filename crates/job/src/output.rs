//! From a film to what image files hold: the layers of an EXR file, and maps to look at.
//!
//! Nothing is written here: [`image`](dapple_scene::image) encodes and writes.

mod layers;
mod maps;

pub use layers::layers;
pub use maps::{GrayMap, albedo_map, cluster_ids, cluster_map, depth_map, error_map, normal_map, sample_map};
