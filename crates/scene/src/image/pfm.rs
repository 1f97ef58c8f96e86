//! Portable float maps (after P. Debevec's description): `PF` or `Pf`, width, height, scale, then rows of
//! 32-bit floats from the bottom up; a negative scale means little-endian.

use super::read::{File, PIXEL_BYTES};
use super::{Image, ImageError, ImageInfo, check_count};

pub(super) fn read(file: &File<'_>) -> Result<Image, ImageError> {
    let (size, channels, scale, start) = header(file)?;
    file.check_claim(size, PIXEL_BYTES, 0)?;
    let [width, height] = size.map(|s| s as usize);
    // No overflow: `check_claim` has checked the size.
    let expected = width * height * channels * 4;
    let data = &file.bytes[start..];
    if data.len() < expected {
        return Err(file.truncated());
    }
    if data.len() > expected {
        let what = format!("{} bytes follow the image of {width}x{height}", data.len() - expected);
        return Err(file.malformed(start + expected, what));
    }
    let (floats, _) = data.as_chunks::<4>();
    let value = |bytes: [u8; 4]| {
        let v = if scale < 0.0 { f32::from_le_bytes(bytes) } else { f32::from_be_bytes(bytes) };
        // Values are unchanged if the scale is 1, so that every bit pattern is preserved.
        if scale.abs() == 1.0 { v } else { v * scale.abs() }
    };
    let channel = |i: usize| if channels == 1 { 0 } else { i };
    let rows = floats.chunks_exact(width * channels).rev();
    let pixels = rows.flat_map(|row| row.chunks_exact(channels));
    let pixels = pixels.map(|p| std::array::from_fn(|i| value(p[channel(i)]))).collect();
    Image::new([width as u32, height as u32], pixels)
}

/// Reads the properties of a file from its header.
pub(super) fn info(file: &File<'_>) -> Result<ImageInfo, ImageError> {
    let (size, channels, ..) = header(file)?;
    file.check_claim(size, PIXEL_BYTES, 0)?;
    let channels = if channels == 1 { "Y" } else { "R, G, B" };
    Ok(ImageInfo::Flat { format: file.format, size: size.map(|side| side as u32), channels, values: "float" })
}

/// Encodes an image as a PFM file: little-endian, rows from the bottom up. Every bit pattern is preserved, NaN and
/// infinities included.
///
/// # Errors
/// [`ImageError::Empty`] if a side is 0, [`ImageError::PixelCount`] if the number of pixels is not width times height.
pub fn encode_pfm(image: &Image) -> Result<Vec<u8>, ImageError> {
    check_count(image.size, image.pixels.len())?;
    let mut bytes = format!("PF\n{} {}\n-1.0\n", image.size[0], image.size[1]).into_bytes();
    bytes.reserve(image.pixels.len() * 12);
    for row in image.pixels.chunks_exact(image.width()).rev() {
        bytes.extend(row.iter().flatten().flat_map(|v| v.to_le_bytes()));
    }
    Ok(bytes)
}

/// Parses the header. Returns the size, the number of channels, the scale, and the offset of the first float, in bytes.
fn header(file: &File<'_>) -> Result<([u64; 2], usize, f32, usize), ImageError> {
    let channels = if file.bytes.starts_with(b"PF") { 3 } else { 1 };
    let mut at = 2;
    let mut words = [""; 3];
    for (word, name) in words.iter_mut().zip(["width", "height", "scale"]) {
        *word = next_word(file, &mut at, name)?;
    }
    let bad = |what: String| file.malformed(at, what);
    let side = |word: &str| word.parse::<u64>().map_err(|_| bad(format!("'{word}' is no width or height")));
    let size = [side(words[0])?, side(words[1])?];
    let scale = words[2].parse::<f32>().ok().filter(|s| s.is_finite() && *s != 0.0);
    let scale = scale.ok_or_else(|| bad(format!("the scale '{}' is no finite number other than 0", words[2])))?;
    // One byte of white space, or a carriage return with its line feed, ends the header.
    let length = if file.bytes[at..].starts_with(b"\r\n") { 2 } else { 1 };
    Ok((size, channels, scale, at + length))
}

/// Returns the next field of the header, and moves `at` to the white space after it. `name` is the field's name for
/// messages.
fn next_word<'a>(file: &File<'a>, at: &mut usize, name: &str) -> Result<&'a str, ImageError> {
    let start = *at + file.bytes[*at..].iter().take_while(|b| b.is_ascii_whitespace()).count();
    if start == *at && start < file.bytes.len() {
        return Err(file.malformed(start, format!("white space is missing before the {name}")));
    }
    // No number is this long. The limit avoids a search to the end of a file that is not PFM.
    let rest = &file.bytes[start..file.bytes.len().min(start + 64)];
    match rest.iter().position(u8::is_ascii_whitespace) {
        Some(length) => {
            *at = start + length;
            let bad = |_| file.malformed(start, format!("the {name} is not a number"));
            std::str::from_utf8(&rest[..length]).map_err(bad)
        }
        None if rest.len() == 64 => Err(file.malformed(start, format!("the {name} does not end"))),
        None => Err(file.truncated()),
    }
}
