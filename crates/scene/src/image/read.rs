//! Reading of image files.

use super::{Image, ImageError, expand, openexr, pfm};
use ::image::codecs::{hdr::HdrDecoder, jpeg::JpegDecoder, png::PngDecoder, tga::TgaDecoder};
use ::image::{ImageDecoder, ImageError as Decoder, Limits};
use std::io::{Cursor, ErrorKind};

/// The encoding of integer samples in an image file. Floating-point samples are always linear.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Encoding {
    /// The default: integers are sRGB, as with [`Encoding::Srgb`].
    #[default]
    Auto,
    /// Integers are proportional to intensity, as in bump maps, roughness and masks.
    Linear,
    /// Integers are sRGB.
    Srgb,
}

/// Reads an image: PNG, JPEG, TGA, Radiance HDR, OpenEXR or PFM.
///
/// The content decides on the format; only TGA, which has no signature, needs its extension. Integers of 8 or 16 bits
/// are scaled to 0..=1, then decoded by the sRGB curve unless `encoding` is linear; alpha is never decoded. Gray
/// becomes RGB. Color profiles, EXIF orientation and OpenEXR's display window are ignored. An animated PNG gives its
/// first frame. HDR values are used as stored (EXPOSURE is ignored); PFM values are multiplied by the magnitude of the
/// header's scale. Pixels of an OpenEXR file are those of its data window. NaN and infinities are kept: see
/// [`Image::non_finite`].
///
/// Of an OpenEXR file, the first of these that exists is read, with the `A` of the same layer as alpha:
/// * channels `R`, `G`, `B` without a layer name,
/// * channel `Y` without a layer name,
/// * `R`, `G`, `B` of the first layer that has them,
/// * `Y` of the first layer that has it,
/// * the only channel of the file,
/// * any of `R`, `G`, `B`, the others 0.
///
/// `file_name` is used for messages and for its extension.
///
/// # Errors
/// Any fault of the file, with its name and the byte offset. An image whose reading would take more than 256 MiB + 16 x
/// `bytes.len()` is refused before memory is allocated: see [`ImageError::TooLarge`]. Images of up to 5 million pixels
/// always pass (4 million with alpha, 3.5 million for a progressive JPEG).
pub fn read_image(bytes: &[u8], file_name: &str, encoding: Encoding) -> Result<Image, ImageError> {
    let file = File { bytes, name: file_name };
    let mut cursor = Cursor::new(bytes);
    let (format, image) = match Content::of(&file) {
        Some(Content::Exr) => return openexr::read(&file),
        Some(Content::Pfm) => return pfm::read(&file),
        Some(Content::Png) => {
            let limits = check_png(&file)?;
            ("PNG", decode(&file, "PNG", encoding, 0, PngDecoder::with_limits(&mut cursor, limits)))
        }
        Some(Content::Jpeg) => {
            let working = check_jpeg(&file)?;
            ("JPEG", decode(&file, "JPEG", encoding, working, JpegDecoder::new(&mut cursor)))
        }
        Some(Content::Hdr) => {
            check_hdr(&file)?;
            (HDR, decode(&file, HDR, encoding, 0, HdrDecoder::new_nonstrict(&mut cursor)))
        }
        Some(Content::Tga) => ("TGA", decode(&file, "TGA", encoding, tga_copy(&file), TgaDecoder::new(&mut cursor))),
        None => return Err(ImageError::UnknownContent { file: file_name.to_owned() }),
    };
    image.map_err(|fault| match fault {
        Fault::Ours(error) => error,
        Fault::Decoder(Decoder::IoError(e)) if e.kind() == ErrorKind::UnexpectedEof => file.truncated(format),
        Fault::Decoder(Decoder::Unsupported(e)) => {
            file.unsupported(format, &format!("what this file uses ({e})"), "RGB of 8 bits per channel")
        }
        Fault::Decoder(error) => file.malformed(format, cursor.position() as usize, error.to_string()),
    })
}

const HDR: &str = "Radiance HDR";

/// An error of a decoder, or an [`ImageError`] found by this module.
pub(super) enum Fault<E> {
    Decoder(E),
    Ours(ImageError),
}

impl From<Decoder> for Fault<Decoder> {
    fn from(error: Decoder) -> Self {
        Self::Decoder(error)
    }
}

impl<E> From<ImageError> for Fault<E> {
    fn from(error: ImageError) -> Self {
        Self::Ours(error)
    }
}

/// The bytes of a file, and the file name to use in messages.
pub(super) struct File<'a> {
    pub(super) bytes: &'a [u8],
    pub(super) name: &'a str,
}

/// Memory in bytes that reading a file of any length may take. Suffices for textures of 4096 x 4096 pixels (201 MB).
const FREE_BYTES: u64 = 256 << 20;
/// Further memory in bytes that reading may take for each byte of the file. A good texture holds fewer than 10 samples
/// per byte.
const BYTES_PER_BYTE: u64 = 16;
/// Memory in bytes for a decoder's tables and buffers, independent of the size of the image.
const OWN_BYTES: u128 = 1 << 20;
/// Memory in bytes of the RGB colour of one pixel.
pub(super) const PIXEL_BYTES: u64 = 12;
/// Memory in bytes of the opacity of one pixel.
pub(super) const ALPHA_BYTES: u64 = 4;

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

    /// Returns the largest memory in bytes that reading the file may take, the file included.
    fn memory_limit(&self) -> u64 {
        FREE_BYTES.saturating_add((self.bytes.len() as u64).saturating_mul(BYTES_PER_BYTE))
    }

    /// Refuses images without pixels, and sizes out of proportion to the file, before memory is allocated. `per_pixel`
    /// is the memory in bytes per pixel during reading; `besides` is all other memory in bytes that the decoder needs.
    pub(super) fn check_claim(
        &self,
        format: &'static str,
        size: [u64; 2],
        per_pixel: u64,
        besides: u64,
    ) -> Result<(), ImageError> {
        let file = self.name.to_owned();
        if size.contains(&0) {
            return Err(ImageError::EmptyFile { file, format, size });
        }
        let limit = self.memory_limit();
        let bytes = self.bytes.len() as u64;
        let pixels = u128::from(size[0]).saturating_mul(size[1].into());
        let needed = [OWN_BYTES, besides.into(), bytes.into()]
            .into_iter()
            .fold(pixels.saturating_mul(per_pixel.into()), u128::saturating_add);
        if size.iter().all(|&s| s <= 1 << 30) && needed <= u128::from(limit) {
            return Ok(());
        }
        Err(ImageError::TooLarge { file, format, size, needed, bytes, limit })
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

/// Bytes per image column that decoders buffer: up to three rows of the widest pixels.
const COLUMN_BYTES: u64 = 32;

/// Decodes an image in its final memory. `working` is the memory in bytes that the decoder needs in addition.
fn decode<D: ImageDecoder>(
    file: &File<'_>,
    format: &'static str,
    encoding: Encoding,
    working: u64,
    opened: ::image::ImageResult<D>,
) -> Result<Image, Fault<Decoder>> {
    let decoder = opened?;
    let (width, height) = decoder.dimensions();
    let color = decoder.color_type();
    let alpha_bytes = if color.has_alpha() { ALPHA_BYTES } else { 0 };
    let besides = working.saturating_add(u64::from(width) * COLUMN_BYTES);
    file.check_claim(format, [width.into(), height.into()], PIXEL_BYTES + alpha_bytes, besides)?;
    let mut pixels = vec![[0.0; 3]; width as usize * height as usize];
    let packed = expand::packed(&mut pixels, color.bytes_per_pixel().into());
    decoder.read_image(packed)?;
    let alpha = expand::alpha(packed, color);
    expand::expand(&mut pixels, color, encoding)
        .map_err(|what| file.unsupported(format, what, "RGB of 8 bits per channel"))?;
    let image = Image::new([width, height], pixels)?;
    Ok(match alpha {
        Some(alpha) => image.with_alpha(alpha)?,
        None => image,
    })
}

/// Checks a PNG's size, for which the decoder has no clear error, and its end, since the decoder accepts truncated
/// files. Returns the decoder's memory limits, which bound compressed texts and colour profiles.
fn check_png(file: &File<'_>) -> Result<Limits, ImageError> {
    let mut limits = Limits::no_limits();
    if let Some(&[.., a, b, c, d, e, f, g, h]) = file.bytes.first_chunk::<24>() {
        let size = [u32::from_be_bytes([a, b, c, d]).into(), u32::from_be_bytes([e, f, g, h]).into()];
        file.check_claim("PNG", size, PIXEL_BYTES, 0)?;
        let rest = file.memory_limit().saturating_sub(size[0] * size[1] * (PIXEL_BYTES + ALPHA_BYTES));
        // Every image may have a small profile; the decoder counts its row buffers, too.
        limits.max_alloc = Some((rest / 4).max(OWN_BYTES as u64 / 2 + size[0] * COLUMN_BYTES));
    }
    let mut rest = &file.bytes[8..];
    while let Some((length, after)) = rest.split_first_chunk::<4>() {
        let end = (u32::from_be_bytes(*length) as usize).saturating_add(8);
        if after.len() < end {
            break;
        }
        if after.starts_with(b"IEND") {
            return Ok(limits);
        }
        rest = &after[end..];
    }
    Err(file.truncated("PNG"))
}

/// Checks that a JPEG is complete by walking its segments. The decoder would fill the rest of a truncated file with
/// gray.
///
/// Returns the decoder's working memory in bytes: row buffers, twice the file's length and, if the image comes in
/// several scans, the coefficients of the whole image.
fn check_jpeg(file: &File<'_>) -> Result<u64, ImageError> {
    const END_OF_IMAGE: u8 = 0xd9;
    const START_OF_SCAN: u8 = 0xda;
    const PROGRESSIVE: u8 = 0xc2;
    let (mut working, mut channels, mut coefficients) = (0, 0, 0);
    let mut rest = &file.bytes[2..];
    while let Some(start) = rest.windows(2).position(|w| w[0] == 0xff && !matches!(w[1], 0 | 0xff)) {
        let marker = rest[start + 1];
        rest = &rest[start + 2..];
        match marker {
            END_OF_IMAGE => return Ok(working),
            // Restart markers and TEM have no length. Coded data after a scan's header is skipped by `position`.
            0x01 | 0xd0..=0xd8 => {}
            _ => {
                let Some(length) = rest.first_chunk::<2>() else { break };
                let Some(after) = rest.get(usize::from(u16::from_be_bytes(*length))..) else { break };
                match (marker, rest) {
                    // Frame header: length, precision, height, width, channels, and the sampling of each channel.
                    (0xc0..=0xc3, &[_, _, _, h0, h1, w0, w1, count, ..]) => {
                        let size = [[w0, w1], [h0, h1]].map(|side| u64::from(u16::from_be_bytes(side)));
                        channels = u64::from(count);
                        let [w, h] = size.map(|side| side.next_multiple_of(32));
                        coefficients = w * h * channels * 2;
                        // Several buffers of 8 x 4 lines, and copies of the file.
                        working = w * channels * 8 * 4 * 2 * 4 + 2 * file.bytes.len() as u64;
                        if marker == PROGRESSIVE {
                            working += std::mem::take(&mut coefficients);
                        }
                        file.check_claim("JPEG", size, PIXEL_BYTES, working)?;
                    }
                    (START_OF_SCAN, &[_, _, count, ..]) if u64::from(count) < channels => {
                        working += std::mem::take(&mut coefficients);
                    }
                    _ => {}
                }
                rest = after;
            }
        }
    }
    Err(file.truncated("JPEG"))
}

/// Returns the memory in bytes, at most two per pixel, of the palette indices that the decoder of a TGA copies.
fn tga_copy(file: &File<'_>) -> u64 {
    match file.bytes.first_chunk::<16>() {
        Some(&[.., w0, w1, h0, h1]) => {
            2 * u64::from(u16::from_le_bytes([w0, w1])) * u64::from(u16::from_le_bytes([h0, h1]))
        }
        None => 0,
    }
}

/// Largest accepted header of a Radiance HDR file, in bytes. Small attributes take tens of times their bytes in memory
/// (an estimate).
const HDR_HEADER: usize = 1 << 20;

fn check_hdr(file: &File<'_>) -> Result<(), ImageError> {
    let head = &file.bytes[..file.bytes.len().min(HDR_HEADER)];
    if head.len() == HDR_HEADER && !head.windows(2).any(|w| w == b"\n\n") {
        return Err(file.malformed(HDR, HDR_HEADER, "its header does not end"));
    }
    let mut lines = head.split(|&b| b == b'\n').take_while(|line| !line.is_empty());
    if lines.any(|line| line.starts_with(b"FORMAT=32-bit_rle_xyze")) {
        return Err(file.unsupported(HDR, "XYZ colour", "RGBE"));
    }
    Ok(())
}
