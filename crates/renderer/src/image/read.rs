//! From the bytes of a file to a picture.

use super::{ImageError, Picture, openexr, pfm, srgb};
use ::image::codecs::{hdr::HdrDecoder, jpeg::JpegDecoder, png::PngDecoder, tga::TgaDecoder};
use ::image::{DynamicImage, ImageDecoder, ImageError as Decoder, Limits};
use std::io::{Cursor, ErrorKind};

/// How the integers of a file encode intensities. Floating-point files are linear whatever is asked for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Encoding {
    /// Integers are sRGB.
    #[default]
    Auto,
    /// Integers are proportional to intensity: bump maps, roughness, masks.
    Linear,
    /// Integers are sRGB.
    Srgb,
}

/// Reads a picture: PNG, JPEG, TGA, Radiance HDR, OpenEXR or PFM.
///
/// The content decides on the format; only TGA, which has no signature, needs its extension. Integers of
/// 8 or 16 bits become 0..=1, then pass the sRGB curve unless `encoding` says otherwise; alpha never does. Gray
/// becomes RGB. Colour profiles, EXIF orientation and EXR's display window are not looked at; an animated PNG
/// gives its first frame. HDR files are taken as they stand (no EXPOSURE), PFM values are multiplied by
/// the magnitude of the header's scale. Of an EXR file, the main layer is read: channels `R`, `G`, `B`
/// without a layer name, or else `Y`, or else those of the first layer that has them, or else the one channel
/// that there is, or else as many of `R`, `G`, `B` as there are (0 for the others); `A` of the same layer is its
/// alpha, and its pixels are those of the data window. NaN and infinities are kept: see [`Picture::non_finite`].
///
/// `file_name` is for messages, and for its extension.
///
/// # Errors
/// Whatever is wrong with the file, naming it and the byte where that showed. Nothing larger than about
/// 100 MiB + 2.5 KiB x `bytes.len()` is ever allocated, whatever the header claims: see
/// [`ImageError::TooLarge`].
pub fn read_picture(bytes: &[u8], file_name: &str, encoding: Encoding) -> Result<Picture, ImageError> {
    let file = File { bytes, name: file_name };
    let mut cursor = Cursor::new(bytes);
    let (format, picture) = match Content::of(&file) {
        Some(Content::Exr) => return openexr::read(&file),
        Some(Content::Pfm) => return pfm::read(&file),
        Some(Content::Png) => {
            check_png(&file)?;
            ("PNG", decode(&file, "PNG", encoding, PngDecoder::with_limits(&mut cursor, decoder_limits(&file))))
        }
        Some(Content::Jpeg) => {
            check_jpeg_end(&file)?;
            ("JPEG", decode(&file, "JPEG", encoding, JpegDecoder::new(&mut cursor)))
        }
        Some(Content::Hdr) => {
            check_hdr_colors(&file)?;
            (HDR, decode(&file, HDR, encoding, HdrDecoder::new_nonstrict(&mut cursor)))
        }
        Some(Content::Tga) => ("TGA", decode(&file, "TGA", encoding, TgaDecoder::new(&mut cursor))),
        None => return Err(ImageError::UnknownContent { file: file_name.to_owned() }),
    };
    picture.map_err(|fault| match fault {
        Fault::Ours(error) => error,
        Fault::Decoder(Decoder::IoError(e)) if e.kind() == ErrorKind::UnexpectedEof => file.truncated(format),
        Fault::Decoder(Decoder::Unsupported(e)) => {
            file.unsupported(format, &format!("what this file uses ({e})"), "RGB of 8 bits per channel")
        }
        Fault::Decoder(error) => file.malformed(format, cursor.position() as usize, error.to_string()),
    })
}

const HDR: &str = "Radiance HDR";

/// The decoder's error, or ours.
enum Fault {
    Decoder(Decoder),
    Ours(ImageError),
}

impl From<Decoder> for Fault {
    fn from(error: Decoder) -> Self {
        Self::Decoder(error)
    }
}

impl From<ImageError> for Fault {
    fn from(error: ImageError) -> Self {
        Self::Ours(error)
    }
}

/// A file in memory and the name to use in messages.
pub(super) struct File<'a> {
    pub(super) bytes: &'a [u8],
    pub(super) name: &'a str,
}

/// Samples (pixels times channels) that any file may claim: 2048 x 2048 RGBA.
const FREE_SAMPLES: u64 = 4 << 22;
/// Samples that each byte of a file may claim besides. A flat JPEG of three full channels holds 96 samples a
/// byte, a good texture below 10; deflate's limit of 1032 is met by bombs only.
const SAMPLES_PER_BYTE: u64 = 192;

impl File<'_> {
    pub(super) fn malformed(&self, format: &'static str, offset: usize, what: impl Into<String>) -> ImageError {
        ImageError::Malformed { file: self.name.to_owned(), format, offset: offset as u64, what: what.into() }
    }

    pub(super) fn truncated(&self, format: &'static str) -> ImageError {
        ImageError::Truncated { file: self.name.to_owned(), format, offset: self.bytes.len() as u64 }
    }

    pub(super) fn unsupported(&self, format: &'static str, what: &str, instead: &'static str) -> ImageError {
        ImageError::Unsupported { file: self.name.to_owned(), format, what: what.to_owned(), instead }
    }

    /// Most samples that a file of this length is trusted with.
    fn sample_limit(&self) -> u64 {
        FREE_SAMPLES.saturating_add((self.bytes.len() as u64).saturating_mul(SAMPLES_PER_BYTE))
    }

    /// Refuses empty pictures, and sizes out of proportion to the file: before anything is allocated.
    pub(super) fn check_claim(&self, format: &'static str, size: [u64; 2], channels: u64) -> Result<(), ImageError> {
        let file = self.name.to_owned();
        if size.contains(&0) {
            return Err(ImageError::EmptyFile { file, format, size });
        }
        let limit = self.sample_limit();
        let samples = u128::from(size[0]).saturating_mul(size[1].into()).saturating_mul(channels.max(3).into());
        if size.iter().all(|&s| s <= 1 << 30) && samples <= u128::from(limit) {
            return Ok(());
        }
        Err(ImageError::TooLarge { file, format, size, samples, bytes: self.bytes.len() as u64, limit })
    }
}

enum Content {
    Png,
    Jpeg,
    Tga,
    Hdr,
    Exr,
    Pfm,
}

impl Content {
    fn of(file: &File<'_>) -> Option<Self> {
        let starts = |magic: &[u8]| file.bytes.starts_with(magic);
        let extension = file.name.rsplit('.').next().unwrap_or_default();
        if starts(b"\x89PNG\r\n\x1a\n") {
            Some(Self::Png)
        } else if starts(&[0xff, 0xd8, 0xff]) {
            Some(Self::Jpeg)
        } else if starts(&[0x76, 0x2f, 0x31, 0x01]) {
            Some(Self::Exr)
        } else if starts(b"#?") {
            Some(Self::Hdr)
        } else if starts(b"PF") || starts(b"Pf") {
            Some(Self::Pfm)
        } else if extension.eq_ignore_ascii_case("tga") {
            Some(Self::Tga)
        } else {
            None
        }
    }
}

fn decoder_limits(file: &File<'_>) -> Limits {
    let mut limits = Limits::no_limits();
    // The widest sample is a 32-bit float.
    limits.max_alloc = Some(file.sample_limit().saturating_mul(4));
    limits
}

fn decode<D: ImageDecoder>(
    file: &File<'_>,
    format: &'static str,
    encoding: Encoding,
    opened: ::image::ImageResult<D>,
) -> Result<Picture, Fault> {
    let mut decoder = opened?;
    let (width, height) = decoder.dimensions();
    file.check_claim(format, [width.into(), height.into()], decoder.color_type().channel_count().into())?;
    decoder.set_limits(decoder_limits(file))?;
    let image = DynamicImage::from_decoder(decoder)?;
    let picture = Picture::new([width, height], linear_pixels(&image, encoding))?;
    Ok(match alpha(&image) {
        Some(alpha) => picture.with_alpha(alpha)?,
        None => picture,
    })
}

/// Opacity, where the picture has any: proportional to the file's integers.
fn alpha(image: &DynamicImage) -> Option<Vec<f32>> {
    fn last<T: Copy + Into<f32>, const N: usize>(samples: &[T], most: f32) -> Vec<f32> {
        samples.as_chunks::<N>().0.iter().map(|p| p[N - 1].into() / most).collect()
    }
    Some(match image {
        DynamicImage::ImageLumaA8(i) => last::<_, 2>(i.as_raw(), 255.0),
        DynamicImage::ImageRgba8(i) => last::<_, 4>(i.as_raw(), 255.0),
        DynamicImage::ImageLumaA16(i) => last::<_, 2>(i.as_raw(), 65535.0),
        DynamicImage::ImageRgba16(i) => last::<_, 4>(i.as_raw(), 65535.0),
        _ => return None,
    })
}

fn linear_pixels(image: &DynamicImage, encoding: Encoding) -> Vec<[f32; 3]> {
    let linear = encoding == Encoding::Linear;
    let table = |srgb: fn() -> Vec<f32>, most: f64| {
        if linear { (0..=most as u32).map(|i| (f64::from(i) / most) as f32).collect() } else { srgb() }
    };
    let bytes = || table(srgb::decode_table_8, 255.0);
    let words = || table(srgb::decode_table_16, 65535.0);
    match image {
        DynamicImage::ImageLuma8(i) => look_up::<_, 1>(i.as_raw(), &bytes()),
        DynamicImage::ImageLumaA8(i) => look_up::<_, 2>(i.as_raw(), &bytes()),
        DynamicImage::ImageRgb8(i) => look_up::<_, 3>(i.as_raw(), &bytes()),
        DynamicImage::ImageRgba8(i) => look_up::<_, 4>(i.as_raw(), &bytes()),
        DynamicImage::ImageLuma16(i) => look_up::<_, 1>(i.as_raw(), &words()),
        DynamicImage::ImageLumaA16(i) => look_up::<_, 2>(i.as_raw(), &words()),
        DynamicImage::ImageRgb16(i) => look_up::<_, 3>(i.as_raw(), &words()),
        DynamicImage::ImageRgba16(i) => look_up::<_, 4>(i.as_raw(), &words()),
        // Floating point: HDR.
        other => other.to_rgb32f().pixels().map(|p| p.0).collect(),
    }
}

/// RGB through a table, from samples of which each pixel has `N`: gray, gray and alpha, RGB, RGB and alpha.
fn look_up<T: Copy + Into<usize>, const N: usize>(samples: &[T], table: &[f32]) -> Vec<[f32; 3]> {
    let (pixels, _) = samples.as_chunks::<N>();
    let channel = |i: usize| if N < 3 { 0 } else { i };
    pixels.iter().map(|p| std::array::from_fn(|i| table[p[channel(i)].into()])).collect()
}

/// Checks the size, since the decoder's own words on it say little, and the end: the decoder gives what it has
/// of a PNG that lacks it.
fn check_png(file: &File<'_>) -> Result<(), ImageError> {
    if let Some(&[.., a, b, c, d, e, f, g, h]) = file.bytes.first_chunk::<24>() {
        let size = [u32::from_be_bytes([a, b, c, d]).into(), u32::from_be_bytes([e, f, g, h]).into()];
        file.check_claim("PNG", size, 1)?;
    }
    let mut rest = &file.bytes[8..];
    while let Some((length, after)) = rest.split_first_chunk::<4>() {
        let end = (u32::from_be_bytes(*length) as usize).saturating_add(8);
        if after.len() < end {
            break;
        }
        if after.starts_with(b"IEND") {
            return Ok(());
        }
        rest = &after[end..];
    }
    Err(file.truncated("PNG"))
}

/// The decoder fills what a cut JPEG lacks with gray; so the end is looked for by walking the segments.
fn check_jpeg_end(file: &File<'_>) -> Result<(), ImageError> {
    const END_OF_IMAGE: u8 = 0xd9;
    let mut rest = &file.bytes[2..];
    while let Some(start) = rest.windows(2).position(|w| w[0] == 0xff && !matches!(w[1], 0 | 0xff)) {
        let marker = rest[start + 1];
        rest = &rest[start + 2..];
        match marker {
            END_OF_IMAGE => return Ok(()),
            // Restart markers and TEM have no length. Coded data after a scan's header is skipped by `position`.
            0x01 | 0xd0..=0xd8 => {}
            _ => {
                let Some(length) = rest.first_chunk::<2>() else { break };
                let Some(after) = rest.get(usize::from(u16::from_be_bytes(*length))..) else { break };
                rest = after;
            }
        }
    }
    Err(file.truncated("JPEG"))
}

fn check_hdr_colors(file: &File<'_>) -> Result<(), ImageError> {
    let mut lines = file.bytes.split(|&b| b == b'\n').take_while(|line| !line.is_empty());
    if lines.any(|line| line.starts_with(b"FORMAT=32-bit_rle_xyze")) {
        return Err(file.unsupported(HDR, "XYZ colour", "RGBE"));
    }
    Ok(())
}
