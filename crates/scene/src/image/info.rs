//! The contents of an image file, by its header.

use super::ImageError;
use super::exr_file::{ExrFile, ExrPart};
use super::read::{OPENEXR, flat_info, format_of};

/// The contents of an image file.
#[derive(Clone, Debug, PartialEq)]
pub enum ImageInfo {
    /// An OpenEXR file, with the headers of its parts.
    Exr(Vec<ExrPart>),
    /// A file of another format.
    Flat {
        /// The name of the format, such as `PNG`.
        format: &'static str,
        /// Width and height in pixels.
        size: [u32; 2],
        /// The channels, such as `R, G, B, A`.
        channels: &'static str,
        /// The type of the values, such as `8 bits`.
        values: &'static str,
    },
}

/// Returns true if a file that begins with these bytes is an image. Only TGA is recognized by its extension.
pub fn is_image(start: &[u8], file_name: &str) -> bool {
    format_of(start, file_name).is_some()
}

/// Reads the properties of an image file from its header.
///
/// # Errors
/// Those of [`read_image`](super::read_image) for a faulty header.
pub fn image_info(bytes: &[u8], file_name: &str) -> Result<ImageInfo, ImageError> {
    match format_of(bytes, file_name) {
        Some(OPENEXR) => Ok(ImageInfo::Exr(ExrFile::open(bytes, file_name)?.parts)),
        _ => flat_info(bytes, file_name),
    }
}
