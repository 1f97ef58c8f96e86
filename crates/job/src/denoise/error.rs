//! Errors of denoising image files.

use super::LayerKind;
use crate::registry::RegistryError;
use dapple_scene::image::ImageError;
use std::path::PathBuf;

/// The reason why image files cannot be denoised. Each message says what to do.
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub enum DenoiseError {
    /// No file, or more than two.
    #[error("{count} files are given; give one OpenEXR file with its variance, or two renders with different seeds")]
    Files {
        /// The number of files.
        count: usize,
    },
    /// A file that cannot be opened.
    #[error("{}: cannot read it: {source}; check the name of the file", path.display())]
    Open {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// A file of another format, which cannot hold layers.
    #[error("{}: it is no OpenEXR file; save the image as OpenEXR with its variance, or with a second seed", path.display())]
    NotExr {
        /// The file.
        path: PathBuf,
    },
    /// A file that is not an image, or an image that cannot be written.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// Two files of different sizes.
    #[error("{}: it has {}x{} pixels, and {} has {}x{}; render both alike but for the seed",
        paths[1].display(), sizes[1][0], sizes[1][1], paths[0].display(), sizes[0][0], sizes[0][1])]
    Sizes {
        /// The two files.
        paths: Box<[PathBuf; 2]>,
        /// Their sizes in pixels.
        sizes: [[u32; 2]; 2],
    },
    /// A layer that the caller names and that no file has.
    #[error("{}: it has no layer \"{name}\" for {}; {}its layers are {}", path.display(), kind.name(),
        near.as_ref().map_or(String::new(), |near| format!("did you mean \"{near}\"? ")), layers.join(", "))]
    NoLayer {
        /// The file.
        path: PathBuf,
        /// The kind of layer.
        kind: LayerKind,
        /// The name that was given.
        name: String,
        /// The most similar name of a layer in the file.
        near: Option<String>,
        /// All layers of the file.
        layers: Vec<String>,
    },
    /// A file without an image.
    #[error("{}: no image was found among its layers {}; name it with --layer color=NAME", path.display(), layers.join(", "))]
    NoImage {
        /// The file.
        path: PathBuf,
        /// All layers of the file.
        layers: Vec<String>,
    },
    /// One file without its variance.
    #[error("{}: it has no variance, and one image alone does not show its noise; give a second render with another seed, or name the layer with --layer variance=NAME. Its layers are {}",
        path.display(), layers.join(", "))]
    NoVariance {
        /// The file.
        path: PathBuf,
        /// All layers of the file.
        layers: Vec<String>,
    },
    /// The variance of a sample, without the number of samples.
    #[error("{}: layer \"{layer}\" holds the variance of a sample, so the number of samples per pixel is needed; give it with --spp N, or --variance-of-mean if the layer holds the variance of the mean", path.display())]
    NoCount {
        /// The file.
        path: PathBuf,
        /// The name of the variance layer.
        layer: String,
    },
    /// A filter that reads the clusters of a scene.
    #[error(
        "filter \"{filter}\" reads clusters of a scene, which images lack; set outside=1, as in \"{filter}:outside=1\", or leave --filter out"
    )]
    NeedsScene {
        /// The filter's name.
        filter: &'static str,
    },
    /// An output that is one of the inputs.
    #[error("{}: it is an input; choose another name for the output", path.display())]
    Overwrites {
        /// The output.
        path: PathBuf,
    },
    /// Two outputs that are one file.
    #[error("{}: this is the file of {}; give each output its own file", path.display(), first.display())]
    SameOutput {
        /// The later output.
        path: PathBuf,
        /// The first output with this file.
        first: PathBuf,
    },
    /// A filter that cannot be made.
    #[error(transparent)]
    Registry(#[from] RegistryError),
    /// Buffers that do not make an image, or an error of the filter.
    #[error(transparent)]
    Core(#[from] dapple_core::Error),
}
