//! Errors of images and image files.

use std::path::PathBuf;

/// The error of an image that cannot be made, read or written. Each message gives a remedy.
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub enum ImageError {
    /// An image whose width or height is 0.
    #[error("an image of {}x{} has no pixels; both sides must be at least 1", size[0], size[1])]
    Empty {
        /// Width and height in pixels.
        size: [u32; 2],
    },
    /// The number of pixels differs from width times height.
    #[error("an image of {}x{} needs {} pixels, not {found}", size[0], size[1], u64::from(size[0]) * u64::from(size[1]))]
    PixelCount {
        /// Width and height in pixels.
        size: [u32; 2],
        /// Number of pixels given.
        found: usize,
    },
    /// A file whose format is not recognized.
    #[error(
        "{file}: unknown image format; convert it to PNG, JPEG, TGA (by its extension), Radiance HDR, OpenEXR or PFM"
    )]
    UnknownContent {
        /// Name of the image file.
        file: String,
    },
    /// A file that ends before its image is complete.
    #[error("{file}: the {format} file ends at byte {offset}, before its image is complete; copy or download it again")]
    Truncated {
        /// Name of the image file.
        file: String,
        /// Name of the file format, such as "PNG".
        format: &'static str,
        /// Offset in bytes at which the file ends.
        offset: u64,
    },
    /// A file that contradicts its format or itself.
    #[error("{file}: the {format} file is damaged at or before byte {offset}: {what}; copy it again or save it anew")]
    Malformed {
        /// Name of the image file.
        file: String,
        /// Name of the file format, such as "PNG".
        format: &'static str,
        /// Offset in bytes of the error, or a later offset.
        offset: u64,
        /// A description of the error.
        what: String,
    },
    /// A file whose image has a side of 0.
    #[error("{file}: the {format} file has {}x{} pixels; both sides must be at least 1", size[0], size[1])]
    EmptyFile {
        /// Name of the image file.
        file: String,
        /// Name of the file format, such as "PNG".
        format: &'static str,
        /// Width and height in pixels; at least one is 0.
        size: [u64; 2],
    },
    /// A header that claims more pixels than the file can plausibly hold.
    #[error(
        "{file}: the {format} header claims {}x{} pixels, which take {} MiB to read, but a file of {bytes} bytes is given {} (256 MiB and 16 times its length): if the header is right, save the image smaller, or with less compression (as TGA, say)",
        size[0], size[1], needed.div_ceil(1 << 20), limit >> 20
    )]
    TooLarge {
        /// Name of the image file.
        file: String,
        /// Name of the file format, such as "PNG".
        format: &'static str,
        /// Width and height in pixels, from the header.
        size: [u64; 2],
        /// Memory in bytes to read the image, the file included.
        needed: u128,
        /// Length of the file in bytes.
        bytes: u64,
        /// The largest `needed` that is allowed for a file of this length.
        limit: u64,
    },
    /// An image with NaN or infinity where values must be finite.
    #[error(
        "{file}: the pixel in column {} of row {} is NaN or infinite{}: an image that scatters or gives light must be finite, save it without",
        first[0], first[1], if *count > 1 { format!(", and {} more", count - 1) } else { String::new() }
    )]
    NotFinite {
        /// Name of the image file.
        file: String,
        /// Number of pixels with NaN or infinity.
        count: u64,
        /// Column (from the left) and row (from the top), from 0, of the first pixel with NaN or infinity.
        first: [u32; 2],
    },
    /// A file with a feature of its format that Dapple does not support.
    #[error("{file}: {what} in {format} files is not supported; save it as {instead}")]
    Unsupported {
        /// Name of the image file.
        file: String,
        /// Name of the file format, such as "PNG".
        format: &'static str,
        /// Name of the unsupported feature.
        what: String,
        /// The kind of image to save instead.
        instead: &'static str,
    },
    /// An output path whose extension is not .exr, .pfm or .png.
    #[error("{}: unknown image format; name the output .exr, .pfm or .png", path.display())]
    UnknownExtension {
        /// The output path.
        path: PathBuf,
    },
    /// An exposure that is not finite.
    #[error("an exposure of {stops} stops is not finite; give a finite number (0 changes nothing)")]
    Exposure {
        /// The exposure in stops.
        stops: f32,
    },
    /// A name, attribute or size that the output format cannot hold.
    #[error("{what}")]
    Encode {
        /// A description of the error, with its remedy.
        what: String,
    },
    /// A file that cannot be written.
    #[error("{}: cannot {action}: {source}; {advice}", path.display())]
    Write {
        /// The path of the file to write.
        path: PathBuf,
        /// The step that failed, such as "write the file".
        action: &'static str,
        /// The remedy.
        advice: &'static str,
        /// The operating system's error.
        source: std::io::Error,
    },
}
