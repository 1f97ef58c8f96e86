//! Image files made from a film (per-pixel statistics): the layers and header of an EXR file, and maps (images of a
//! per-pixel quantity, such as sample counts).
//!
//! [`OutputFiles`] writes the files; [`image`](dapple_scene::image) encodes them.

mod files;
mod header;
mod layers;
mod maps;

pub use crate::files::FileIdentity;
pub use files::OutputFiles;
pub use layers::{layer_names, layers};
pub use maps::{GrayMap, albedo_map, cluster_ids, cluster_map, depth_map, error_map, normal_map, sample_map};
