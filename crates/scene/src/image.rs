//! Images and image files.
//!
//! [`read_image`] turns the bytes of a PNG, JPEG, TGA, Radiance HDR, OpenEXR or PFM file into an [`Image`]: linear RGB, top
//! row first. It takes bytes, not a path, so that the caller decides where files come from. Headers are not trusted: memory
//! stays in proportion to the length of the file, and a truncated file is an error.
//!
//! [`encode_exr`], [`encode_pfm`] and [`encode_png`] turn images into the bytes of files, and [`write_file`] writes all bytes
//! or none. [`check_writable`] tests a path before a long computation starts. The same image is encoded to the same bytes on
//! every machine and for any number of threads.
//!
//! ```
//! use dapple_scene::image::{Encoding, Format, Layer, Image, encode_exr, read_image, write_file};
//! # let folder = tempfile::tempdir()?;
//! # let path = folder.path().join("image.exr");
//! assert_eq!(Format::from_path(&path)?, Format::Exr);
//! let image = Image::filled([4, 3], [0.5, 1.0, 2.0])?;
//! let counts = Layer { name: "count".into(), channels: vec![("Y", vec![16_u32; 12].into())] };
//! let layers = [Layer::of_image("", &image), counts];
//! let made = [("dapple:sampler".to_owned(), "uniform".to_owned())];
//! write_file(&path, &encode_exr(image.size, &layers, &made)?.bytes)?;
//! assert_eq!(read_image(&std::fs::read(&path)?, "image.exr", Encoding::Auto)?, image);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod color_space;
mod exr_file;
mod exr_rewrite;
mod exr_write;
mod file;
mod hdr;
mod info;
mod layers;
mod openexr;
mod pfm;
mod png;
mod read;
mod window;

pub use color_space::Chromaticities;
pub use exr_file::{Channels, ExrChannel, ExrFile, ExrPart, read_attributes, read_channels};
pub use exr_rewrite::{ExrEdit, RewrittenExr};
pub use exr_write::{EncodedExr, ExrHeader, Layer, encode_exr, encode_exr_with, rows_at_a_time, write_exr};
pub use file::{Format, check_writable, write_file};
pub use info::{ImageInfo, image_info, is_image};
pub use layers::{ChosenImage, FoundLayer, KNOWN_LAYERS, LayerKind, Layers, NoImage, Purpose};
pub use openexr::{ComputedFloats, Plane};
pub use pfm::encode_pfm;
pub use png::{encode_png, encode_png_gray, encode_png_rgb, srgb_decode, srgb_encode};
pub use read::{Encoding, ImageFile, LayerQuery, read_image, read_image_file, read_texture};
pub use window::Window;

use std::path::PathBuf;

/// An image in memory: linear RGB, row by row from the top.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Image {
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// The `size[0] * size[1]` pixels, row by row from the top.
    pub pixels: Vec<[f32; 3]>,
    /// Opacity of each pixel, 0 to 1, in the order of `pixels`; empty if all pixels are opaque. Colours are as in the
    /// file: premultiplied by opacity in OpenEXR, not premultiplied in PNG and TGA.
    pub alpha: Vec<f32>,
}

impl Image {
    /// Makes an image from its pixels, top row first.
    ///
    /// # Errors
    /// [`ImageError::Empty`] if a side is 0, [`ImageError::PixelCount`] if `pixels.len()` is not the product of `size`.
    pub fn new(size: [u32; 2], pixels: Vec<[f32; 3]>) -> Result<Self, ImageError> {
        check_count(size, pixels.len())?;
        Ok(Self { size, pixels, alpha: Vec::new() })
    }

    /// Returns the image with the opacities `alpha`, one per pixel, clamped to 0..=1; NaN becomes 1. If all pixels are
    /// opaque, no opacities are stored.
    ///
    /// # Errors
    /// [`ImageError::PixelCount`] if there is not one value per pixel.
    pub fn with_alpha(mut self, mut alpha: Vec<f32>) -> Result<Self, ImageError> {
        check_count(self.size, alpha.len())?;
        alpha.iter_mut().for_each(|a| *a = if a.is_nan() { 1.0 } else { a.clamp(0.0, 1.0) });
        self.alpha = if alpha.iter().all(|&a| a == 1.0) { Vec::new() } else { alpha };
        Ok(self)
    }

    /// Makes an image of one colour. Allocates 12 bytes per pixel: the caller should limit `size`.
    ///
    /// # Errors
    /// [`ImageError::Empty`] if a side is 0.
    pub fn filled(size: [u32; 2], color: [f32; 3]) -> Result<Self, ImageError> {
        check_size(size)?;
        Ok(Self { size, pixels: vec![color; size[0] as usize * size[1] as usize], alpha: Vec::new() })
    }

    /// Returns the number of pixels in a row.
    pub fn width(&self) -> usize {
        self.size[0] as usize
    }

    /// Returns the number of rows.
    pub fn height(&self) -> usize {
        self.size[1] as usize
    }

    /// Returns the pixel in column `x` of row `y`; row 0 is the top one.
    ///
    /// # Panics
    /// If `x` or `y` is outside the image.
    pub fn pixel(&self, x: usize, y: usize) -> [f32; 3] {
        self.row(y)[x]
    }

    /// Returns row `y`, from left to right; row 0 is the top one.
    ///
    /// # Panics
    /// If `y` is outside the image.
    pub fn row(&self, y: usize) -> &[[f32; 3]] {
        &self.pixels[y * self.width()..(y + 1) * self.width()]
    }

    /// Returns the number of pixels with NaN or infinity, and the column and the row of the first one from the top;
    /// `None` if all values are finite. Files may hold such values; lights and reference images must not.
    pub fn non_finite(&self) -> Option<(usize, [usize; 2])> {
        let mut bad = (0..self.pixels.len()).filter(|&i| !self.pixels[i].iter().all(|c| c.is_finite()));
        let first = bad.next()?;
        Some((1 + bad.count(), [first % self.width(), first / self.width()]))
    }

    /// Returns the image itself if all its values are finite. `file_name` appears in the error.
    ///
    /// # Errors
    /// [`ImageError::NotFinite`] if a value is NaN or infinite.
    pub fn checked_finite(self, file_name: &str) -> Result<Self, ImageError> {
        let Some((count, [column, row])) = self.non_finite() else { return Ok(self) };
        let more = if count > 1 { format!(", and {} more", count - 1) } else { String::new() };
        let what = format!("the pixel in column {column} of row {row} is NaN or infinite{more}");
        Err(ImageError::NotFinite(format!("{file_name}: {what}")))
    }
}

fn check_size(size: [u32; 2]) -> Result<(), ImageError> {
    if size.contains(&0) { Err(ImageError::Empty(size)) } else { Ok(()) }
}

fn check_count(size: [u32; 2], found: usize) -> Result<(), ImageError> {
    check_size(size)?;
    let expected = u64::from(size[0]) * u64::from(size[1]);
    if expected == found as u64 { Ok(()) } else { Err(ImageError::PixelCount { size, found }) }
}

/// The error of an image that cannot be made, read or written. Each message gives a remedy.
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub enum ImageError {
    /// An image whose width or height, given here, is 0.
    #[error("an image of {}x{} has no pixels; both sides must be at least 1", .0[0], .0[1])]
    Empty([u32; 2]),
    /// The number of pixels differs from width times height.
    #[error("an image of {}x{} needs {} pixels, not {found}; pass width times height pixels", size[0], size[1], u64::from(size[0]) * u64::from(size[1]))]
    PixelCount {
        /// Width and height in pixels.
        size: [u32; 2],
        /// Number of pixels given.
        found: usize,
    },
    /// A file whose format is not recognized.
    #[error(
        "{0}: unknown image format; convert it to PNG, JPEG, TGA (with extension .tga), Radiance HDR, OpenEXR or PFM"
    )]
    UnknownContent(String),
    /// A file that ends before its image is complete. The text holds the file's name, format and length.
    #[error("{0}, before its image is complete; copy or download the file again")]
    Truncated(String),
    /// A file that contradicts its format or itself. The text holds the file's name, format and the byte's offset.
    #[error("{0}; copy the file again, or save the image again")]
    Malformed(String),
    /// A file whose image has a side of 0.
    #[error("{0} pixels; both sides must be at least 1")]
    EmptyFile(String),
    /// A header that claims more pixels than the file can plausibly hold.
    #[error(
        "{0} (256 MiB plus 16 times its length); if the header is right, save a smaller image, or use less compression (such as TGA)"
    )]
    TooLarge(String),
    /// An image with NaN or infinity where values must be finite.
    #[error("{0}; textures and environment maps must be finite; save the image without NaN and infinity")]
    NotFinite(String),
    /// A file with a feature of its format that Dapple does not support.
    #[error("{0}")]
    Unsupported(String),
    /// An OpenEXR file with several layers that may be the image.
    #[error("{file}: several layers may be the image: {}; save the right one as channels R, G and B without a layer name", layers.join(", "))]
    Ambiguous {
        /// The file.
        file: String,
        /// The names of the layers.
        layers: Vec<String>,
    },
    /// An output path whose extension is not .exr, .pfm or .png.
    #[error("{}: unknown image format; give the output the extension .exr, .pfm or .png", .0.display())]
    UnknownExtension(PathBuf),
    /// An exposure, in stops, that is not finite.
    #[error("an exposure of {0} stops is not finite; give a finite number (0 changes nothing)")]
    Exposure(f32),
    /// A name, attribute or size that the output format cannot hold: a description of the error, with its remedy.
    #[error("{0}")]
    Encode(String),
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
