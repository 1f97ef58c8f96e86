//! Radiance HDR files: their header, and the eight orders of their scanlines.

use super::read::{Fault, File, ImageFile, PIXEL_BYTES, decode};
use super::{Chromaticities, Encoding, Image, ImageError};
use ::image::ImageError as Decoder;
use ::image::codecs::hdr::HdrDecoder;
use std::io::{Cursor, Read};

/// Largest accepted header in bytes. Small attributes may take tens of times their length in memory.
const HEADER: usize = 1 << 20;

/// Reads a file.
pub(super) fn read(file: &File<'_>, encoding: Encoding) -> Result<ImageFile, ImageError> {
    let header = Header::of(file)?;
    let mut cursor = Cursor::new(file.bytes);
    let image = pixels(file, header.start, &mut cursor);
    let mut image = image.map_err(|fault| file.fault(fault, cursor.position() as usize))?;
    let (mut notices, mut converted) = (header.notices, false);
    if let Some(space) = header.space.filter(|s| encoding != Encoding::Linear && !s.is_same(Chromaticities::REC709)) {
        converted = space.convert_to_rec709(&mut image.pixels);
        if !converted {
            notices.push(space.unfit());
        }
    }
    Ok(ImageFile { image, view: String::new(), window: None, notices, converted })
}

/// Reads the pixels. `start` is the offset of the line with the resolution.
fn pixels(file: &File<'_>, start: Option<usize>, cursor: &mut Cursor<&[u8]>) -> Result<Image, Fault<Decoder>> {
    let order = start.and_then(|start| Order::at(&file.bytes[start..]));
    let (Some(start), Some(order)) = (start, order) else {
        return decode(file, Encoding::Linear, 0, HdrDecoder::new_nonstrict(cursor));
    };
    let [(_, height), (_, width)] = order.0;
    // Pixels in an unusual order are rearranged afterwards, in a copy.
    let copies = if order == order.usual() { 1 } else { 2 };
    file.check_claim([width, height], copies * PIXEL_BYTES, 0)?;
    // The decoder supports only the usual order and line ends.
    let head = format!("FORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}");
    let line = file.bytes[start..].iter().position(|&byte| byte == b'\n').unwrap_or(0);
    cursor.set_position((start + line) as u64);
    let image = decode(file, Encoding::Linear, 0, HdrDecoder::new_nonstrict(head.as_bytes().chain(cursor)))?;
    Ok(if copies == 1 { image } else { order.turned(image)? })
}

/// The width and height stated by the header; `None` if its last line has another form.
pub(super) fn size(file: &File<'_>) -> Result<Option<[u32; 2]>, ImageError> {
    let order = Header::of(file)?.start.and_then(|start| Order::at(&file.bytes[start..]));
    let size = |Order([(axis, scanlines), (_, pixels)])| {
        let size = if axis.0 == 'Y' { [pixels, scanlines] } else { [scanlines, pixels] };
        Some([u32::try_from(size[0]).ok()?, u32::try_from(size[1]).ok()?])
    };
    Ok(order.and_then(size))
}

/// The statements of a header.
#[derive(Default)]
struct Header {
    /// The offset of the resolution line, which follows the header; `None` if the header does not end.
    start: Option<usize>,
    space: Option<Chromaticities>,
    /// Notices of fields that are ignored.
    notices: Vec<String>,
}

impl Header {
    /// Reads and checks the header.
    fn of(file: &File<'_>) -> Result<Self, ImageError> {
        let mut header = Self::default();
        let mut rest = &file.bytes[..file.bytes.len().min(HEADER)];
        while let Some(end) = rest.iter().position(|&byte| byte == b'\n') {
            let line = String::from_utf8_lossy(rest[..end].trim_ascii_end());
            rest = &rest[end + 1..];
            if line.is_empty() {
                header.start = Some(file.bytes.len().min(HEADER) - rest.len());
                return Ok(header);
            }
            let Some((field, value)) = line.split_once('=') else { continue };
            let numbers: Vec<f32> = value.split_whitespace().map_while(|word| word.parse().ok()).collect();
            match field.trim() {
                "FORMAT" if value.trim() == "32-bit_rle_xyze" => return Err(file.unsupported("XYZ colour", "RGBE")),
                "PRIMARIES" => match *numbers.as_chunks().0 {
                    // Photoshop writes eight zeros into every file.
                    _ if numbers == [0.0; 8] => {}
                    [red, green, blue, white] => header.space = Some(Chromaticities { red, green, blue, white }),
                    _ => header.notices.push(format!("its {line} is not eight numbers; Rec. 709 is assumed")),
                },
                "EXPOSURE" | "COLORCORR" | "GAMMA" | "PIXASPECT" if numbers.iter().any(|number| *number != 1.0) => {
                    let notice = format!("its {line} is ignored; values are used as stored");
                    if !header.notices.contains(&notice) {
                        header.notices.push(notice);
                    }
                }
                _ => {}
            }
        }
        match file.bytes.len() < HEADER {
            true => Ok(header),
            false => Err(file.malformed(HEADER, "its header does not end")),
        }
    }
}

/// The pixel order: direction and number of scanlines, then direction and number of pixels within a scanline. +Y points up,
/// +X to the right.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Order([(Direction, u64); 2]);

/// An axis, `X` or `Y`, and true for the direction in which its coordinate grows.
type Direction = (char, bool);

impl Order {
    /// The order stated by the line at the start of `bytes`; `None` if the line has another form.
    fn at(bytes: &[u8]) -> Option<Self> {
        let line = bytes.split(|&byte| byte == b'\n').next()?;
        let words: Vec<&str> = std::str::from_utf8(line).ok()?.split_ascii_whitespace().collect();
        let direction = |word: &str| match word {
            "+X" => Some(('X', true)),
            "-X" => Some(('X', false)),
            "+Y" => Some(('Y', true)),
            "-Y" => Some(('Y', false)),
            _ => None,
        };
        let &[first, scanlines, second, pixels] = &words[..] else { return None };
        let [first, second] = [direction(first)?, direction(second)?];
        (first.0 != second.0).then_some(Self([(first, scanlines.parse().ok()?), (second, pixels.parse().ok()?)]))
    }

    /// The usual order with the same numbers of scanlines and pixels: rows from the top, each from the left.
    fn usual(self) -> Self {
        Self([(('Y', false), self.0[0].1), (('X', true), self.0[1].1)])
    }

    /// Rearranges an image whose scanlines were read as rows from the top, each from the left.
    fn turned(self, read: Image) -> Result<Image, ImageError> {
        let [((axis, _), scanlines), (_, pixels)] = self.0.map(|(direction, count)| (direction, count as usize));
        let [width, height] = if axis == 'X' { [scanlines, pixels] } else { [pixels, scanlines] };
        let coordinate = |axis: char, x: usize, y: usize| if axis == 'X' { x } else { height - 1 - y };
        let place = |((axis, grows), count): (Direction, u64), x: usize, y: usize| {
            let at = coordinate(axis, x, y);
            if grows { at } else { count as usize - 1 - at }
        };
        let at = |(x, y)| read.pixel(place(self.0[1], x, y), place(self.0[0], x, y));
        let places = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        Image::new([width as u32, height as u32], places.map(at).collect())
    }
}
