//! Reading of image files.

use super::{Chromaticities, Image, ImageError, ImageInfo, Window, exr_file, hdr, pfm, srgb_decode};
use ::image::ColorType;
use ::image::codecs::{jpeg::JpegDecoder, png::PngDecoder, tga::TgaDecoder};
use ::image::{ImageDecoder, ImageError as Decoder, Limits};
use std::io::{Cursor, ErrorKind};

/// The meaning of the values in an image file. Floating-point values are always linear.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Encoding {
    /// The default: integers are sRGB, as with [`Encoding::Srgb`].
    #[default]
    Auto,
    /// Values are data, as in bump maps, roughness maps and masks: integers are linear, and there is no colour space.
    Linear,
    /// Values are colours; integers are sRGB.
    Srgb,
}

/// An image file that was read.
#[derive(Clone, Debug, PartialEq)]
pub struct ImageFile {
    /// The image, linear Rec. 709.
    pub image: Image,
    /// The view of the image; empty in files without views.
    pub view: String,
    /// The data window and the display window of an OpenEXR file; other formats have none.
    pub window: Option<[Window; 2]>,
    /// Notices about the choice of a layer; one sentence each, without the file's name.
    pub notices: Vec<String>,
    /// True if colours were converted from another colour space.
    pub converted: bool,
}

/// The layer and the view to read from an OpenEXR file.
#[derive(Clone, Copy, Debug, Default)]
pub struct LayerQuery<'a> {
    /// The name of the layer; `None` chooses the image as [`read_image`] does.
    pub layer: Option<&'a str>,
    /// The view to read. `None`, or a view without the layer, selects the first view with the layer.
    pub view: Option<&'a str>,
}

/// Reads an image: PNG, JPEG, TGA, Radiance HDR, OpenEXR or PFM.
///
/// The content determines the format; only TGA, which has no signature, needs its extension. Integers of 8 or 16 bits are
/// scaled to 0..=1, then decoded by the sRGB curve unless `encoding` is linear; alpha is never decoded. Gray becomes RGB.
/// Color profiles and EXIF orientation are ignored. A PNG's gAMA, cHRM and cICP are ignored with a notice; an animated PNG
/// gives its first frame. HDR files may have any of the eight orders of pixels; their values are used as stored (EXPOSURE and
/// COLORCORR are ignored, with a notice). PFM values are multiplied by the magnitude of the header's scale. NaN and infinities
/// are kept: see [`Image::non_finite`].
///
/// Colours of an OpenEXR or HDR file of other chromaticities are converted to Rec. 709, unless `encoding` is linear;
/// channels may become negative.
///
/// Of an OpenEXR file, the pixels of the data window are read. The image is the first of the following that the file has
/// ([`Layers::image`](super::Layers::image)), and includes the alpha channel of the same layer:
/// * channels `R`, `G`, `B` (or `Y`) without a layer name,
/// * the layer that is named as an image, such as `Combined`, `rgba` or `beauty`, unless it is 0 everywhere,
/// * the only layer with the channels of an image,
/// * the only channel of the file,
/// * any of `R`, `G`, `B`, the others 0.
///
/// `file_name` is used for messages and for its extension.
///
/// # Errors
/// Any fault of the file, with its name and the byte offset. [`ImageError::Ambiguous`] for an OpenEXR file with several
/// images. An image that would take more than 256 MiB + 16 x `bytes.len()` to read is refused before memory is allocated: see
/// [`ImageError::TooLarge`]. Images of up to 5 million pixels always pass (4 million with alpha, 3.5 million for a
/// progressive JPEG).
pub fn read_image(bytes: &[u8], file_name: &str, encoding: Encoding) -> Result<Image, ImageError> {
    read_image_file(bytes, file_name, encoding, LayerQuery::default()).map(|file| file.image)
}

/// Reads a texture or an environment map, with notices. After a conversion of colours to Rec. 709, negative channels become 0.
///
/// # Errors
/// Those of [`read_image`], and [`ImageError::NotFinite`].
pub fn read_texture(bytes: &[u8], file_name: &str, encoding: Encoding) -> Result<(Image, Vec<String>), ImageError> {
    let ImageFile { image, mut notices, converted, window, .. } =
        read_image_file(bytes, file_name, encoding, LayerQuery::default())?;
    if let Some([data, display]) = window
        && data != display
    {
        notices.push(format!("only the data window {data} is read, not the display window {display}"));
    }
    let mut image = image.checked_finite(file_name)?;
    let outside = |pixel: &&mut [f32; 3]| converted && pixel.iter().any(|channel| *channel < 0.0);
    let mut clamped = 0;
    for pixel in image.pixels.iter_mut().filter(outside) {
        *pixel = pixel.map(|channel| channel.max(0.0));
        clamped += 1;
    }
    if clamped > 0 {
        notices.push(format!("pixels outside of Rec. 709: {clamped}; their negative channels become 0"));
    }
    notices.iter_mut().for_each(|notice| *notice = format!("{file_name}: {notice}"));
    Ok((image, notices))
}

/// Reads an image as [`read_image`] does, with its view, windows and notices. `wanted` selects a layer of an OpenEXR file.
///
/// # Errors
/// Those of [`read_image`], and [`ImageError::Unsupported`] for a layer that the file lacks.
pub fn read_image_file(
    bytes: &[u8],
    file_name: &str,
    encoding: Encoding,
    wanted: LayerQuery<'_>,
) -> Result<ImageFile, ImageError> {
    let file = open(bytes, file_name)?;
    if file.format == OPENEXR {
        return exr_file::read(&file, wanted, encoding);
    }
    read_flat(&file, encoding)
}

fn open<'a>(bytes: &'a [u8], name: &'a str) -> Result<File<'a>, ImageError> {
    let format = format_of(bytes, name).ok_or_else(|| ImageError::UnknownContent(name.to_owned()))?;
    Ok(File { bytes, name, format })
}

/// Reads the properties of a file of a format other than OpenEXR.
pub(super) fn flat_info(bytes: &[u8], name: &str) -> Result<ImageInfo, ImageError> {
    let file = open(bytes, name)?;
    let mut cursor = Cursor::new(bytes);
    let about = |decoder: &dyn ImageDecoder| (decoder.dimensions(), decoder.color_type());
    let opened = match file.format {
        PFM => return pfm::info(&file),
        PNG => PngDecoder::with_limits(&mut cursor, check_png(&file)?.0).map(|decoder| about(&decoder)),
        JPEG => JpegDecoder::new(&mut cursor).map(|decoder| about(&decoder)),
        HDR => {
            let size =
                hdr::size(&file)?.map_or_else(|| read_flat(&file, Encoding::Linear).map(|read| read.image.size), Ok)?;
            Ok((size.into(), ColorType::Rgb32F))
        }
        _ => TgaDecoder::new(&mut cursor).map(|decoder| about(&decoder)),
    };
    let ((width, height), color) = opened.map_err(|e| file.fault(Fault::Decoder(e), cursor.position() as usize))?;
    let channels = match (color.channel_count(), color.has_alpha()) {
        (1, _) => "Y",
        (2, _) => "Y, A",
        (_, false) => "R, G, B",
        (_, true) => "R, G, B, A",
    };
    let values = match (file.format, color.bytes_per_pixel() / color.channel_count()) {
        (HDR, _) => "8 bits and a common exponent",
        (_, 1) => "8 bits",
        _ => "16 bits",
    };
    Ok(ImageInfo::Flat { format: file.format, size: [width, height], channels, values })
}

/// Reads a file of a format other than OpenEXR.
fn read_flat(file: &File<'_>, encoding: Encoding) -> Result<ImageFile, ImageError> {
    let mut cursor = Cursor::new(file.bytes);
    let mut notices = Vec::new();
    let image = match file.format {
        HDR => return hdr::read(file, encoding),
        PFM => pfm::read(file).map_err(Fault::Ours),
        PNG => {
            let (limits, unheeded) = check_png(file)?;
            if encoding != Encoding::Linear && !unheeded.is_empty() {
                notices.push(format!("its {} is ignored; its colours are read as sRGB", unheeded.join(", ")));
            }
            decode(file, encoding, 0, PngDecoder::with_limits(&mut cursor, limits))
        }
        JPEG => {
            let working = check_jpeg(file)?;
            decode(file, encoding, working, JpegDecoder::new(&mut cursor))
        }
        _ => decode(file, encoding, tga_copy(file), TgaDecoder::new(&mut cursor)),
    };
    let image = image.map_err(|fault| file.fault(fault, cursor.position() as usize))?;
    Ok(ImageFile { image, view: String::new(), window: None, notices, converted: false })
}

const PNG: &str = "PNG";
const JPEG: &str = "JPEG";
const HDR: &str = "Radiance HDR";
pub(super) const OPENEXR: &str = "OpenEXR";
pub(super) const PFM: &str = "PFM";

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

/// The bytes of a file, with its name and the name of its format for messages.
pub(super) struct File<'a> {
    pub(super) bytes: &'a [u8],
    pub(super) name: &'a str,
    pub(super) format: &'static str,
}

/// Memory in bytes that reading may take for a file of any length. Suffices for textures of 4096 x 4096 pixels (201 MB).
const FREE_BYTES: u64 = 256 << 20;
/// Further memory in bytes that reading may take for each byte of the file. Real textures have fewer than 10 samples per
/// byte.
const BYTES_PER_BYTE: u64 = 16;
/// Memory in bytes for a decoder's tables and buffers, independent of the size of the image.
const OWN_BYTES: u128 = 1 << 20;
/// Memory in bytes of the RGB colour of one pixel.
pub(super) const PIXEL_BYTES: u64 = 12;
/// Memory in bytes of the opacity of one pixel.
pub(super) const ALPHA_BYTES: u64 = 4;

impl File<'_> {
    pub(super) fn malformed(&self, offset: usize, what: impl std::fmt::Display) -> ImageError {
        let Self { name, format, .. } = self;
        ImageError::Malformed(format!("{name}: the {format} file is damaged at or before byte {offset}: {what}"))
    }

    pub(super) fn truncated(&self) -> ImageError {
        let Self { name, format, bytes } = self;
        ImageError::Truncated(format!("{name}: the {format} file ends at byte {}", bytes.len()))
    }

    pub(super) fn unsupported(&self, what: &str, instead: &str) -> ImageError {
        let Self { name, format, .. } = self;
        ImageError::Unsupported(format!(
            "{name}: {what} in {format} files is not supported; save the image as {instead}"
        ))
    }

    pub(super) fn fault(&self, fault: Fault<Decoder>, position: usize) -> ImageError {
        match fault {
            Fault::Ours(error) => error,
            Fault::Decoder(Decoder::IoError(e)) if e.kind() == ErrorKind::UnexpectedEof => self.truncated(),
            Fault::Decoder(Decoder::Unsupported(e)) => {
                self.unsupported(&format!("a feature of this file ({e})"), "RGB of 8 bits per channel")
            }
            Fault::Decoder(error) => self.malformed(position, error),
        }
    }

    /// Returns the largest memory in bytes that reading the file may take, the file included.
    fn memory_limit(&self) -> u64 {
        FREE_BYTES.saturating_add((self.bytes.len() as u64).saturating_mul(BYTES_PER_BYTE))
    }

    /// Refuses images without pixels, and sizes out of proportion to the file, before memory is allocated. `per_pixel`
    /// is the memory in bytes per pixel during reading; `besides` is all other memory in bytes that the decoder needs.
    pub(super) fn check_claim(&self, size: [u64; 2], per_pixel: u64, besides: u64) -> Result<(), ImageError> {
        let Self { name, format, bytes } = self;
        let [width, height] = size;
        if size.contains(&0) {
            return Err(ImageError::EmptyFile(format!("{name}: the {format} file has {width}x{height}")));
        }
        let limit = self.memory_limit();
        let pixels = u128::from(width).saturating_mul(height.into());
        let needed = [OWN_BYTES, besides.into(), bytes.len() as u128]
            .into_iter()
            .fold(pixels.saturating_mul(per_pixel.into()), u128::saturating_add);
        if size.iter().all(|&s| s <= 1 << 30) && needed <= u128::from(limit) {
            return Ok(());
        }
        let claim = format!("{name}: the {format} header claims {width}x{height} pixels");
        let (needed, limit, bytes) = (needed.div_ceil(1 << 20), limit >> 20, bytes.len());
        let what = format!("which take {needed} MiB to read, but the limit for a file of {bytes} bytes is {limit} MiB");
        Err(ImageError::TooLarge(format!("{claim}, {what}")))
    }
}

/// Returns the name of a file's format; `None` for an unknown one.
pub(super) fn format_of(bytes: &[u8], name: &str) -> Option<&'static str> {
    const STARTS: [(&[u8], &str); 8] = [
        (b"\x89PNG\r\n\x1a\n", PNG),
        (b"\xff\xd8\xff", JPEG),
        (b"\x76\x2f\x31\x01", OPENEXR),
        (b"#?", HDR),
        (b"\xef\xbb\xbf#?", HDR),
        (b"PF", PFM),
        (b"Pf", PFM),
        (b"", "TGA"),
    ];
    let extension = name.rsplit('.').next().unwrap_or_default();
    let is_tga = extension.eq_ignore_ascii_case("tga");
    let known = STARTS.iter().find(|(start, _)| bytes.starts_with(start) && (is_tga || !start.is_empty()));
    known.map(|(_, format)| *format)
}

/// Bytes per image column that decoders buffer: up to three rows of the widest pixels.
const COLUMN_BYTES: u64 = 32;

/// Decodes an image directly into its final memory. `working` is the memory in bytes that the decoder needs in addition.
pub(super) fn decode<D: ImageDecoder>(
    file: &File<'_>,
    encoding: Encoding,
    working: u64,
    opened: ::image::ImageResult<D>,
) -> Result<Image, Fault<Decoder>> {
    let decoder = opened?;
    let (width, height) = decoder.dimensions();
    let color = decoder.color_type();
    let alpha_bytes = if color.has_alpha() { ALPHA_BYTES } else { 0 };
    let besides = working.saturating_add(u64::from(width) * COLUMN_BYTES);
    file.check_claim([width.into(), height.into()], PIXEL_BYTES + alpha_bytes, besides)?;
    let mut pixels = vec![[0.0; 3]; width as usize * height as usize];
    let packed = packed(&mut pixels, color.bytes_per_pixel().into());
    decoder.read_image(packed)?;
    let alpha = opacities(packed, color);
    expand(&mut pixels, color, encoding).map_err(|what| file.unsupported(what, "RGB of 8 bits per channel"))?;
    let image = Image::new([width, height], pixels)?;
    Ok(if let Some(alpha) = alpha { image.with_alpha(alpha)? } else { image })
}

/// Checks a PNG's size, for which the decoder has no clear error, and its end, since the decoder accepts truncated
/// files. Returns the decoder's memory limits, which bound compressed texts and colour profiles, and the names of chunks
/// that state other colours than sRGB.
fn check_png(file: &File<'_>) -> Result<(Limits, Vec<&'static str>), ImageError> {
    let mut limits = Limits::no_limits();
    if let Some(&[.., a, b, c, d, e, f, g, h]) = file.bytes.first_chunk::<24>() {
        let size = [u32::from_be_bytes([a, b, c, d]).into(), u32::from_be_bytes([e, f, g, h]).into()];
        file.check_claim(size, PIXEL_BYTES, 0)?;
        let rest = file.memory_limit().saturating_sub(size[0] * size[1] * (PIXEL_BYTES + ALPHA_BYTES));
        // Every image may have a small profile; the decoder counts its row buffers, too.
        limits.max_alloc = Some((rest / 4).max(OWN_BYTES as u64 / 2 + size[0] * COLUMN_BYTES));
    }
    let (mut unheeded, mut is_srgb) = (Vec::new(), false);
    let mut rest = &file.bytes[8..];
    while let Some((length, after)) = rest.split_first_chunk::<4>() {
        let end = (u32::from_be_bytes(*length) as usize).saturating_add(8);
        if after.len() < end {
            break;
        }
        let content = after.get(4..end.saturating_sub(4)).unwrap_or_default();
        match after.first_chunk() {
            Some(b"IEND") => return Ok((limits, if is_srgb { Vec::new() } else { unheeded })),
            Some(b"sRGB") => is_srgb = true,
            Some(b"gAMA") if !png_numbers(content).any(|gamma| (gamma - 1.0 / 2.2).abs() < 0.01) => {
                unheeded.push("gAMA")
            }
            Some(b"cHRM") if !png_space(content).is_some_and(|s| s.is_same(Chromaticities::REC709)) => {
                unheeded.push("cHRM")
            }
            // The primaries of Rec. 709 with the curve of sRGB.
            Some(b"cICP") if !content.starts_with(&[1, 13]) => unheeded.push("cICP"),
            _ => {}
        }
        rest = &after[end..];
    }
    Err(file.truncated())
}

/// The numbers in a chunk of a PNG that states colours.
fn png_numbers(content: &[u8]) -> impl Iterator<Item = f32> {
    content.as_chunks().0.iter().map(|bytes| (f64::from(u32::from_be_bytes(*bytes)) / 1e5) as f32)
}

/// The colour space in the chunk cHRM of a PNG.
fn png_space(content: &[u8]) -> Option<Chromaticities> {
    let numbers: Vec<f32> = png_numbers(content).collect();
    let [white, red, green, blue] = *numbers.as_chunks().0 else { return None };
    Some(Chromaticities { red, green, blue, white })
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
                        file.check_claim(size, PIXEL_BYTES, working)?;
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
    Err(file.truncated())
}

/// Returns the memory in bytes, at most two per pixel, of the palette indices that the decoder of a TGA copies.
fn tga_copy(file: &File<'_>) -> u64 {
    let Some(&[.., w0, w1, h0, h1]) = file.bytes.first_chunk::<16>() else { return 0 };
    2 * u64::from(u16::from_le_bytes([w0, w1])) * u64::from(u16::from_le_bytes([h0, h1]))
}

/// Returns the last part of the memory of `pixels` as bytes: `bytes_per_pixel` (at most 12) for each pixel. A decoder writes
/// packed samples there. [`expand`] then converts them in place, front to back, without overwriting unread samples.
fn packed(pixels: &mut [[f32; 3]], bytes_per_pixel: usize) -> &mut [u8] {
    let length = pixels.len() * bytes_per_pixel;
    let bytes: &mut [u8] = bytemuck::cast_slice_mut(pixels);
    let start = bytes.len().saturating_sub(length);
    &mut bytes[start..]
}

/// Returns the opacity of each packed pixel, 0 to 1; `None` if the format has no alpha channel.
fn opacities(packed: &[u8], color: ColorType) -> Option<Vec<f32>> {
    let pixels = packed.chunks_exact(color.bytes_per_pixel().into());
    let word = |b: &[u8; 2]| f32::from(u16::from_ne_bytes(*b)) / 65535.0;
    match color {
        ColorType::La8 | ColorType::Rgba8 => Some(pixels.map(|p| f32::from(p[p.len() - 1]) / 255.0).collect()),
        ColorType::La16 | ColorType::Rgba16 => Some(pixels.filter_map(|p| p.last_chunk()).map(word).collect()),
        _ => None,
    }
}

/// Converts the samples in the memory that [`packed`] returns to linear RGB, in place, so that large images are not held
/// twice. The error describes an unsupported colour type.
///
/// Of `n` pixels of `b` bytes, pixel `i` is read `b (n - i)` bytes before the end. It is written up to `12 (n - i - 1)`
/// bytes before the end, so that no unread byte is overwritten.
fn expand(pixels: &mut [[f32; 3]], color: ColorType, encoding: Encoding) -> Result<(), &'static str> {
    let [length, channels] = [color.bytes_per_pixel(), color.channel_count()].map(usize::from);
    let size = length / channels;
    if color == ColorType::Rgb32F {
        // Radiance HDR: the samples are linear RGB already, in their final place.
        return Ok(());
    } else if size > 2 {
        return Err("this kind of pixel");
    }
    let codes = 1_u32 << (8 * size);
    let value = |code: u32| f64::from(code) / f64::from(codes - 1);
    let linear = |v: f64| if encoding == Encoding::Linear { v } else { srgb_decode(v) };
    let table: Vec<f32> = (0..codes).map(|code| linear(value(code)) as f32).collect();
    // Gray has one sample for all three channels.
    let step = if channels < 3 { 0 } else { size };
    let bytes: &mut [u8] = bytemuck::cast_slice_mut(pixels);
    let mut from = bytes.len() - bytes.len() / size_of::<[f32; 3]>() * length;
    for to in (0..bytes.len()).step_by(size_of::<[f32; 3]>()) {
        let mut packed = [0; 8];
        packed[..length].copy_from_slice(&bytes[from..from + length]);
        from += length;
        for channel in 0..3 {
            let at = channel * step;
            let code = if size == 1 { packed[at].into() } else { u16::from_ne_bytes([packed[at], packed[at + 1]]) };
            bytes[to + 4 * channel..][..4].copy_from_slice(&table[usize::from(code)].to_ne_bytes());
        }
    }
    Ok(())
}
