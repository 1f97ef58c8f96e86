//! Radiance HDR files: the check of their header, and the eight orders of their scanlines.

use super::read::{Fault, File, PIXEL_BYTES, decode};
use super::{Encoding, Image, ImageError};
use ::image::ImageError as Decoder;
use ::image::codecs::hdr::HdrDecoder;
use std::io::{Cursor, Read};

/// Largest accepted header in bytes. Small attributes take tens of times their bytes in memory (an estimate).
const HEADER: usize = 1 << 20;

/// Reads the file in `cursor`, which is at the start.
pub(super) fn read(file: &File<'_>, cursor: &mut Cursor<&[u8]>) -> Result<Image, Fault<Decoder>> {
    let start = check(file)?;
    let order = start.and_then(|start| Order::at(&file.bytes[start..])).filter(|order| *order != order.usual());
    let (Some(start), Some(order)) = (start, order) else {
        return decode(file, Encoding::Linear, 0, HdrDecoder::new_nonstrict(cursor));
    };
    // The decoder knows the usual order only; the pixels are turned afterwards, with a copy.
    let [(_, height), (_, width)] = order.0;
    file.check_claim([width, height], 2 * PIXEL_BYTES, 0)?;
    let head = [&file.bytes[..start], format!("-Y {height} +X {width}").as_bytes()].concat();
    let line = file.bytes[start..].iter().position(|&byte| byte == b'\n').unwrap_or(0);
    cursor.set_position((start + line) as u64);
    let image = decode(file, Encoding::Linear, 0, HdrDecoder::new_nonstrict(head.chain(cursor)))?;
    Ok(order.turned(image)?)
}

/// The width and height by the header; `None` if its last line has another form.
pub(super) fn size(file: &File<'_>) -> Result<Option<[u32; 2]>, ImageError> {
    let order = check(file)?.and_then(|start| Order::at(&file.bytes[start..]));
    let size = |Order([(axis, scanlines), (_, pixels)])| {
        let size = if axis.0 == 'Y' { [pixels, scanlines] } else { [scanlines, pixels] };
        Some([u32::try_from(size[0]).ok()?, u32::try_from(size[1]).ok()?])
    };
    Ok(order.and_then(size))
}

/// Checks the header. Returns the offset of the line behind it, which has the resolution; `None` if it does not end.
fn check(file: &File<'_>) -> Result<Option<usize>, ImageError> {
    let head = &file.bytes[..file.bytes.len().min(HEADER)];
    let end = head.windows(2).position(|w| w == b"\n\n");
    if head.len() == HEADER && end.is_none() {
        return Err(file.malformed(HEADER, "its header does not end"));
    }
    let mut lines = head.split(|&b| b == b'\n').take_while(|line| !line.is_empty());
    if lines.any(|line| line.starts_with(b"FORMAT=32-bit_rle_xyze")) {
        return Err(file.unsupported("XYZ colour", "RGBE"));
    }
    Ok(end.map(|end| end + 2))
}

/// The order of the pixels: the direction of scanlines and their number, then the direction within them and its number
/// of pixels. +Y points up, +X to the right.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Order([(Direction, u64); 2]);

/// An axis, `X` or `Y`, and true for the direction in which its coordinate grows.
type Direction = (char, bool);

impl Order {
    /// The order in the line at the start of these bytes; `None` if they have another form.
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

    /// The usual order of the same numbers: rows from the top, each from the left.
    fn usual(self) -> Self {
        Self([(('Y', false), self.0[0].1), (('X', true), self.0[1].1)])
    }

    /// The image whose scanlines have been read as rows from the top, each from the left.
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
