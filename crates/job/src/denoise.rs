//! Denoising of image files of any renderer: OpenEXR layers in, an image and its error out.
//!
//! [`DenoiseSpec`] names the files and settings; [`denoise_files`] reads and denoises them. Layers are found by the names
//! that renderers give them ([`KNOWN_LAYERS`]), or by a name that the caller gives.

mod assemble;
mod error;
mod features;
mod layers;
mod output;

pub use error::DenoiseError;
pub use layers::{KNOWN_LAYERS, LayerKind};

use crate::registry::{self, MethodInputs, RegistryError};
use assemble::Assembled;
use dapple_core::Filtered;
use std::path::PathBuf;
use std::time::Instant;

/// The files and settings of a denoising run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DenoiseSpec {
    /// One OpenEXR file with its variance, or two files of the same image rendered with different seeds.
    pub inputs: Vec<PathBuf>,
    /// Layer names that the caller gives: the kind of layer, and its name in the files.
    pub layers: Vec<(LayerKind, String)>,
    /// The number of samples per pixel in each file, if the files do not hold it.
    pub spp: Option<u32>,
    /// True if the variance in the files is that of the mean, not of one sample.
    pub variance_of_mean: bool,
    /// The filter; `None` for the default.
    pub filter: Option<String>,
}

/// A denoised image, and what was read for it.
#[derive(Clone, Debug)]
pub struct DenoisedImage {
    /// The image and its estimated error.
    pub filtered: Filtered,
    /// The filter with all its parameters.
    pub filter: String,
    /// The kinds of layers that were read, each with its name in the files.
    pub found: Vec<(LayerKind, String)>,
    /// Notices about layers that the files lack, and about assumptions made instead; one sentence each.
    pub notices: Vec<String>,
    /// The seconds that reading and filtering took.
    pub seconds: [f64; 2],
}

/// Reads the files of `spec` and denoises their image.
///
/// # Errors
///
/// [`DenoiseError`] for files that cannot be read, layers that are missing or do not fit each other, and the filter.
pub fn denoise_files(spec: &DenoiseSpec) -> Result<DenoisedImage, DenoiseError> {
    let filter = spec.filter.as_deref().map(filter).transpose()?;
    let start = Instant::now();
    let read = Assembled::read(spec)?;
    let reading = start.elapsed().as_secs_f64();
    let start = Instant::now();
    let image = read.image();
    let (filtered, described) = match &filter {
        Some(filter) => (image.filter(&**filter).run()?, filter.describe()),
        None => (image.run()?, read.default_filter()),
    };
    let seconds = [reading, start.elapsed().as_secs_f64()];
    Ok(DenoisedImage { filtered, filter: described, found: read.found, notices: read.notices, seconds })
}

/// Makes a filter by its name, without a scene.
fn filter(description: &str) -> Result<Box<dyn dapple_core::Filter>, DenoiseError> {
    match registry::filter(description, &MethodInputs::default()) {
        Ok(made) => Ok(made.filter),
        Err(RegistryError::NeedsWorld { of, .. }) => Err(DenoiseError::NeedsScene { filter: of }),
        Err(error) => Err(error.into()),
    }
}
