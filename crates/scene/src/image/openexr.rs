//! Decoding of OpenEXR files through the `exr` crate, block by block. A wrong header is thus detected before memory is
//! allocated for the sizes that it claims.

use super::ImageError;
use super::read::File;
use ::exr::block::lines::LineRef;
use ::exr::block::reader::{ChunksReader, Reader};
use ::exr::error::Error as ExrError;
use ::exr::math::Vec2;
use ::exr::meta::BlockDescription;
use ::exr::meta::attribute::{ChannelDescription, SampleType};
use ::exr::meta::header::Header;
use ::exr::prelude::f16;
use std::borrow::Cow;
use std::collections::BTreeSet;
use std::fmt;
use std::io::Cursor;
use std::sync::Arc;

/// The values of one channel, row by row from the top.
#[derive(Clone, Debug, PartialEq)]
pub enum Plane<'a> {
    /// 32-bit floats; every bit pattern is preserved.
    F32(Cow<'a, [f32]>),
    /// 32-bit unsigned integers.
    U32(Cow<'a, [u32]>),
    /// Floats that are stored in the file as 16-bit floats.
    F16(Cow<'a, [f32]>),
    /// Floats that are computed as the file is written, so that they take no memory.
    Each(ComputedFloats<'a>),
}

/// The floats of a channel, each computed on demand from its index.
#[derive(Clone)]
pub struct ComputedFloats<'a> {
    len: usize,
    is_half: bool,
    of: Arc<dyn Fn(usize) -> f32 + Send + Sync + 'a>,
}

impl ComputedFloats<'_> {
    pub(super) fn value(&self, index: usize) -> f32 {
        (self.of)(index)
    }

    fn values(&self) -> impl Iterator<Item = f32> {
        (0..self.len).map(|index| self.value(index))
    }
}

impl fmt::Debug for ComputedFloats<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_list().entries(self.values()).finish()
    }
}

impl PartialEq for ComputedFloats<'_> {
    fn eq(&self, other: &Self) -> bool {
        self.is_half == other.is_half && self.values().eq(other.values())
    }
}

/// Implements the conversion of values to a plane of their type.
macro_rules! planes {
    ($($variant:ident: $values:ty;)*) => {
        $(impl<'a> From<$values> for Plane<'a> {
            fn from(values: $values) -> Self {
                Self::$variant(values.into())
            }
        })*
    };
}

planes! {
    F32: Vec<f32>;
    F32: &'a [f32];
    U32: Vec<u32>;
    U32: &'a [u32];
}

impl<'a> Plane<'a> {
    /// Makes a plane of `len` 32-bit floats; `of(i)` computes the float at index `i` whenever it is needed.
    pub fn each(len: usize, of: impl Fn(usize) -> f32 + Send + Sync + 'a) -> Self {
        Self::Each(ComputedFloats { len, is_half: false, of: Arc::new(of) })
    }

    /// Selects 16-bit storage for floats; integers keep 32 bits.
    pub fn halve(&mut self) {
        match self {
            Self::F32(values) => *self = Self::F16(std::mem::take(values)),
            Self::Each(each) => each.is_half = true,
            Self::F16(_) | Self::U32(_) => {}
        }
    }

    /// Returns the number of values in the channel.
    pub fn len(&self) -> usize {
        match self {
            Self::F32(v) | Self::F16(v) => v.len(),
            Self::U32(v) => v.len(),
            Self::Each(each) => each.len,
        }
    }

    pub(super) const fn sample_type(&self) -> SampleType {
        match self {
            Self::F32(_) => SampleType::F32,
            Self::F16(_) | Self::Each(ComputedFloats { is_half: true, .. }) => SampleType::F16,
            Self::Each(_) => SampleType::F32,
            Self::U32(_) => SampleType::U32,
        }
    }

    /// Returns the values as floats.
    pub fn floats(&self) -> Cow<'_, [f32]> {
        match self {
            Self::F32(values) | Self::F16(values) => Cow::Borrowed(values),
            Self::U32(values) => values.iter().map(|&value| value as f32).collect(),
            Self::Each(each) => each.values().collect(),
        }
    }

    /// Returns true if the channel has no values.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

pub(super) type Fault = super::read::Fault<ExrError>;

impl From<ExrError> for Fault {
    fn from(error: ExrError) -> Self {
        Self::Decoder(error)
    }
}

pub(super) type Source<'a> = Cursor<&'a [u8]>;

/// Calls `work` with a function that opens the file and checks its headers. Returns the result of `work`, its errors
/// converted to [`ImageError`].
pub(super) fn with_reader<'a, T>(
    file: &File<'a>,
    work: impl FnOnce(&mut dyn FnMut() -> Result<Reader<Source<'a>>, Fault>) -> Result<T, Fault>,
) -> Result<T, ImageError> {
    const DEEP: u8 = 0x08;
    if file.bytes.get(5).is_some_and(|flags| flags & DEEP != 0) {
        return Err(file.unsupported("deep data", "a flat image"));
    }
    check_header_length(file)?;
    let mut open = || {
        let reader = ::exr::block::read(Cursor::new(file.bytes), false)?;
        check_headers(file, reader.headers())?;
        Ok(reader)
    };
    work(&mut open).map_err(|fault| match fault {
        Fault::Ours(error) => error,
        Fault::Decoder(ExrError::Io(e)) if e.kind() == std::io::ErrorKind::UnexpectedEof => file.truncated(),
        Fault::Decoder(ExrError::NotSupported(what)) => file.unsupported(&what, "scan lines compressed by ZIP"),
        Fault::Decoder(error) => file.malformed(file.bytes.len(), error.to_string()),
    })
}

/// Checks the header fields that the block reader trusts: sizes, tiles, chunk counts, sampling.
fn check_headers(file: &File<'_>, headers: &[Header]) -> Result<(), ImageError> {
    for header in headers {
        // Memory for one channel and one block; the caller checks again for the channels that it keeps.
        check_size(file, header, 4)?;
        if header.deep {
            return Err(file.unsupported("deep data", "a flat image"));
        }
        if header.channels.list.iter().any(|c| c.sampling.0 != 1 || c.sampling.1 != 1) {
            return Err(file.unsupported("a channel of lower resolution than the image", "RGB"));
        }
        // The offset table has eight bytes per chunk, and the reader indexes it by the number of chunks that it computes.
        if header.chunk_count > file.bytes.len() / 8 {
            return Err(file.truncated());
        }
        if header.chunk_count != header.blocks_increasing_y_order().count() {
            let what = format!("its number of chunks ({}) does not fit the size of the image", header.chunk_count);
            return Err(file.malformed(file.bytes.len(), what));
        }
    }
    if headers.is_empty() {
        return Err(file.malformed(file.bytes.len(), "it has no header"));
    }
    Ok(())
}

/// Largest accepted header in bytes. Small attributes take about 30 times their length in memory; a preview image fits.
const MOST_HEADER: usize = 4 << 20;

/// Checks the length of the header by walking its attributes (name, type, length, value). An empty name ends the
/// attributes of a part.
fn check_header_length(file: &File<'_>) -> Result<(), ImageError> {
    let text = |at: usize| {
        let end = file.bytes.get(at..)?.iter().take(256).position(|&b| b == 0)?;
        Some((end, at + end + 1))
    };
    let attribute = |at: usize| {
        let (name, at) = text(at)?;
        if name == 0 {
            return Some((true, at));
        }
        let (_, at) = text(at)?;
        let length = i32::from_le_bytes(*file.bytes.get(at..)?.first_chunk()?);
        Some((false, at.checked_add(4 + usize::try_from(length).ok()?)?))
    };
    let several = file.bytes.get(5).is_some_and(|flags| flags & 0x10 != 0);
    let (mut at, mut ended) = (8, false);
    // The decoder reports damage itself.
    while let Some((end, next)) = attribute(at) {
        if next > MOST_HEADER {
            return Err(file.malformed(at, "its header takes more than 4 MiB"));
        }
        if end && (ended || !several) {
            break;
        }
        (at, ended) = (next, end);
    }
    Ok(())
}

/// Estimated number of copies of a block in memory during decompression. With this estimate every kind of compression
/// stays within the memory limit (`tests/image_memory.rs`).
const BLOCK_COPIES: u64 = 5;

/// Checks that one part of a file fits the memory limit: `per_pixel` bytes for each pixel, and one decompressed block.
pub(super) fn check_size(file: &File<'_>, header: &Header, per_pixel: u64) -> Result<(), ImageError> {
    let size = [header.layer_size.0 as u64, header.layer_size.1 as u64];
    let [w, h] = match header.blocks {
        // A tile may well be larger than a small image.
        BlockDescription::Tiles(tiles) => [tiles.tile_size.0 as u64, tiles.tile_size.1 as u64],
        BlockDescription::ScanLines => [size[0], (header.compression.scan_lines_per_block() as u64).min(size[1])],
    };
    // 32 bits per sample whatever its type, since some kinds of compression expand samples.
    let block = w.saturating_mul(h).saturating_mul(4 * header.channels.list.len() as u64);
    let tables = 64 * header.chunk_count as u64;
    file.check_claim(size, per_pixel, block.saturating_mul(BLOCK_COPIES).saturating_add(tables))
}

/// Reads all channels of one part at full resolution.
pub(super) fn read_planes(
    file: &File<'_>,
    reader: Reader<Source<'_>>,
    part: usize,
) -> Result<Vec<Plane<'static>>, Fault> {
    let header = reader.headers()[part].clone();
    let count = header.layer_size.area();
    let plane = |channel: &ChannelDescription| match channel.sample_type {
        SampleType::F32 => Plane::F32(vec![0.0; count].into()),
        SampleType::F16 => Plane::F16(vec![0.0; count].into()),
        SampleType::U32 => Plane::U32(vec![0; count].into()),
    };
    let mut planes: Vec<Plane<'static>> = header.channels.list.iter().map(plane).collect();
    read_lines(file, reader, part, |line, start| {
        let end = start + line.location.sample_count;
        match &mut planes[line.location.channel] {
            Plane::F32(v) => line.read_samples_into_slice(&mut v.to_mut()[start..end]),
            Plane::U32(v) => line.read_samples_into_slice(&mut v.to_mut()[start..end]),
            Plane::F16(v) => {
                let values = v.to_mut();
                floats(&header, line, |i, value| values[start + i] = value)
            }
            // Planes read from files are never computed.
            Plane::Each(_) => Ok(()),
        }
    })?;
    Ok(planes)
}

/// Calls `put` for each sample of a line, with the sample's index in the line and its value as a float.
pub(super) fn floats(header: &Header, line: LineRef<'_>, mut put: impl FnMut(usize, f32)) -> Result<(), ExrError> {
    let samples = 0..line.location.sample_count;
    match header.channels.list[line.location.channel].sample_type {
        SampleType::F32 => samples.zip(line.read_samples::<f32>()).try_for_each(|(i, v)| v.map(|v| put(i, v))),
        SampleType::F16 => samples.zip(line.read_samples::<f16>()).try_for_each(|(i, v)| v.map(|v| put(i, v.to_f32()))),
        SampleType::U32 => samples.zip(line.read_samples::<u32>()).try_for_each(|(i, v)| v.map(|v| put(i, v as f32))),
    }
}

/// Calls `store` for each line of each channel of one part, at full resolution, with the index of the line's first
/// pixel in the image.
pub(super) fn read_lines(
    file: &File<'_>,
    reader: Reader<Source<'_>>,
    part: usize,
    mut store: impl FnMut(LineRef<'_>, usize) -> Result<(), ExrError>,
) -> Result<(), Fault> {
    let header = reader.headers()[part].clone();
    let chunks =
        reader.filter_chunks(false, |_, tile, block| block.layer == part && tile.is_largest_resolution_level())?;
    let expected = chunks.expected_chunk_count();
    let mut seen = BTreeSet::new();
    chunks.decompress_sequential(false, |_, block| {
        // A faulty offset table may point to one chunk twice or to another part's chunk, which leaves pixels unset.
        let position = block.index.pixel_position;
        if block.index.layer == part && block.index.level == Vec2(0, 0) {
            seen.insert((position.1, position.0));
            for line in block.lines(&header.channels) {
                let start = line.location.position.1 * header.layer_size.0 + line.location.position.0;
                store(line, start)?;
            }
        }
        Ok(())
    })?;
    if seen.len() != expected {
        let what = format!("{} of its {expected} blocks are missing", expected - seen.len());
        return Err(file.malformed(file.bytes.len(), what).into());
    }
    Ok(())
}
