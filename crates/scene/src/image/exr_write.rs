//! Encoding of OpenEXR files with any number of layers.

use super::file::{Sink, write_file_with};
use super::openexr::Plane;
use super::read::Fault;
use super::{Image, ImageError, check_count, read_attributes};
use ::exr::block::chunk::Chunk;
use ::exr::block::writer::ChunksWriter;
use ::exr::block::{self, BlockIndex, UncompressedBlock, enumerate_ordered_header_block_indices};
use ::exr::error::Error as ExrError;
use ::exr::meta::BlockDescription;
use ::exr::meta::attribute::{AttributeValue, ChannelDescription, Compression, LineOrder, SampleType, Text};
use ::exr::meta::header::{Header, ImageAttributes, LayerAttributes};
use ::exr::prelude::f16;
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::io::{self, BufWriter, Cursor, Seek, SeekFrom, Write};
use std::path::Path;

/// A layer of an OpenEXR file: a named group of channels.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer<'a> {
    /// Name of the layer; empty for the main layer, which every viewer shows.
    pub name: String,
    /// Name and values of each channel: `R`, `G`, `B` for colours, `Y` for one number per pixel.
    pub channels: Vec<(&'a str, Plane<'a>)>,
}

impl Layer<'_> {
    /// Makes a layer of an image's three channels as 32-bit floats.
    pub fn of_image(name: impl Into<String>, image: &Image) -> Self {
        let channel = |c: usize| Plane::F32(image.pixels.iter().map(|p| p[c]).collect());
        Self { name: name.into(), channels: vec![("R", channel(0)), ("G", channel(1)), ("B", channel(2))] }
    }
}

/// The attributes of an OpenEXR file's header besides its size and channels.
#[derive(Clone, Copy, Debug, Default)]
pub struct ExrHeader<'a> {
    /// Text attributes, name and value: a record of how the image was made.
    pub attributes: &'a [(String, String)],
    /// The program that made the image, as the standard attribute `software`.
    pub software: Option<&'a str>,
    /// The standard attribute `worldToCamera`: a row-major matrix for row vectors.
    pub world_to_camera: Option<[f32; 16]>,
    /// The standard attribute `worldToNDC`: a row-major matrix for row vectors.
    pub world_to_ndc: Option<[f32; 16]>,
}

/// An encoded OpenEXR file in memory.
#[derive(Clone, Debug, PartialEq)]
pub struct EncodedExr {
    /// The bytes of the file, for [`write_file`](super::write_file).
    pub bytes: Vec<u8>,
    /// Number of finite values that were clamped to the range of 16-bit floats, -65504 to 65504. Callers should warn if it
    /// is above 0. It is 0 without 16-bit channels.
    pub clamped: u64,
}

/// The largest finite 16-bit float.
const F16_MAX: f32 = 65504.0;

/// Encodes layers of `size` pixels as one OpenEXR part that every viewer reads: scan lines, top row first, ZIP compression.
/// A channel is named `LAYER.CHANNEL`, or just `CHANNEL` in the main layer.
///
/// 32-bit values are stored bit for bit, NaN and infinities included. 16-bit values are rounded to nearest; finite
/// values beyond 65504 are clamped and counted. `attributes` (name, value) become text attributes of the header
/// (UTF-8), a record of how the image was made; [`read_attributes`] reads them. The same input gives the same bytes.
///
/// # Errors
/// [`ImageError::Empty`] if a side is 0. [`ImageError::PixelCount`] for a plane whose length disagrees with `size`.
/// [`ImageError::Encode`] without channels, for a name that is empty, is longer than 255 bytes, is given twice or contains NUL,
/// and for an attribute name that OpenEXR reserves.
pub fn encode_exr(
    size: [u32; 2],
    layers: &[Layer<'_>],
    attributes: &[(String, String)],
) -> Result<EncodedExr, ImageError> {
    encode_exr_with(size, layers, &ExrHeader { attributes, ..ExrHeader::default() })
}

/// Encodes as [`encode_exr`] does, with standard attributes in the header.
///
/// # Errors
/// Those of [`encode_exr`].
pub fn encode_exr_with(size: [u32; 2], layers: &[Layer<'_>], given: &ExrHeader<'_>) -> Result<EncodedExr, ImageError> {
    let channels = channels(size, layers, given)?;
    let mut bytes = room_for(channels.iter().map(|(_, plane)| *plane));
    encode_channels(&mut bytes, size, &channels, given).map_err(|fault| match fault {
        Fault::Ours(error) => error,
        Fault::Decoder(error) => ImageError::Encode(format!("EXR: {error}")),
    })?;
    check_attributes(bytes.get_ref(), given.attributes)?;
    Ok(EncodedExr { bytes: bytes.into_inner(), clamped: channels.iter().map(|(_, plane)| count_clamped(plane)).sum() })
}

/// Encodes like [`encode_exr_with`], and writes to `path` block by block. The whole file is in memory only if `path` is a
/// device or a pipe. Returns the number of [clamped](EncodedExr::clamped) values.
///
/// # Errors
/// Those of [`encode_exr`] and of [`write_file`](super::write_file).
pub fn write_exr(path: &Path, size: [u32; 2], layers: &[Layer<'_>], given: &ExrHeader<'_>) -> Result<u64, ImageError> {
    let channels = channels(size, layers, given)?;
    // A file of one pixel is encoded, to check that the header's attributes can be read back.
    let pixel = [Layer { name: String::new(), channels: vec![("Y", Plane::each(1, |_| 0.0))] }];
    encode_exr_with([1, 1], &pixel, given)?;
    write_file_with(path, |file| encode_channels(file, size, &channels, given))?;
    Ok(channels.iter().map(|(_, plane)| count_clamped(plane)).sum())
}

/// The channels of all layers with their full names, in the order of the file.
fn channels<'a>(
    size: [u32; 2],
    layers: &'a [Layer<'_>],
    given: &ExrHeader<'_>,
) -> Result<Vec<(String, &'a Plane<'a>)>, ImageError> {
    let mut channels: Vec<(String, &Plane<'_>)> = Vec::new();
    for layer in layers {
        for (name, plane) in &layer.channels {
            check_count(size, plane.len())?;
            let prefix = if layer.name.is_empty() { String::new() } else { format!("{}.", layer.name) };
            channels.push((prefix + name, plane));
        }
    }
    if channels.is_empty() {
        return Err(ImageError::Encode("an EXR file needs at least one channel; add a layer".to_owned()));
    }
    // The format requires channels in order of their names.
    channels.sort_by(|a, b| a.0.as_bytes().cmp(b.0.as_bytes()));
    check_names("channel", channels.iter().map(|(name, _)| name.as_str()))?;
    check_names("attribute", given.attributes.iter().map(|(name, _)| name.as_str()))?;
    Ok(channels)
}

fn encode_channels(
    mut to: &mut dyn Sink,
    size: [u32; 2],
    channels: &[(String, &Plane<'_>)],
    given: &ExrHeader<'_>,
) -> Result<(), Fault<io::Error>> {
    let planes: Vec<&Plane<'_>> = channels.iter().map(|&(_, plane)| plane).collect();
    let headers = vec![header(size, channels, given)];
    let refused = |error| match error {
        ExrError::Io(error) => Fault::Decoder(error),
        error => Fault::Ours(ImageError::Encode(format!(
            "EXR: {error}; rename the layer or channel, or write another format"
        ))),
    };
    let mut head = Vec::new();
    Header::write_all(&headers, &mut head, false).map_err(refused)?;
    // The magic number and the version come first.
    let mut head = vec![0; head.len() + 8];
    encode(&mut to, headers, std::slice::from_ref(&planes), Vec::new(), true).map_err(refused)?;
    let mut sort = || {
        to.seek(SeekFrom::Start(0))?;
        to.read_exact(&mut head)?;
        head = sort_attributes(std::mem::take(&mut head));
        to.seek(SeekFrom::Start(0))?;
        to.write_all(&head)
    };
    sort().map_err(Fault::Decoder)
}

fn check_names<'a>(kind: &str, names: impl Iterator<Item = &'a str>) -> Result<(), ImageError> {
    let mut seen = BTreeSet::new();
    for name in names {
        let unnamed = name.is_empty() || (kind == "channel" && name.ends_with('.'));
        if unnamed || name.len() > 255 || name.contains('\0') {
            return Err(ImageError::Encode(format!(
                "{kind} name {name:?} is invalid; EXR names have 1 to 255 bytes and no NUL"
            )));
        }
        if !seen.insert(name) {
            return Err(ImageError::Encode(format!("{kind} name {name:?} is given twice; rename one")));
        }
    }
    Ok(())
}

/// Checks that every attribute can be read back as text. Refuses names that OpenEXR reserves for other types.
pub(super) fn check_attributes(bytes: &[u8], attributes: &[(String, String)]) -> Result<(), ImageError> {
    let found = read_attributes(bytes, "EXR: the file in memory")
        .map_err(|error| ImageError::Encode(format!("{error}; write another format")))?;
    match attributes.iter().find(|given| !found.contains(given)) {
        Some((name, _)) => {
            Err(ImageError::Encode(format!("attribute name {name:?} is reserved by OpenEXR; rename the attribute")))
        }
        None => Ok(()),
    }
}

pub(super) fn count_clamped(plane: &Plane<'_>) -> u64 {
    let is_clamped = |v: &f32| v.is_finite() && v.abs() > F16_MAX;
    match plane {
        Plane::F16(values) => values.iter().filter(|v| is_clamped(v)).count() as u64,
        Plane::Each(each) if plane.sample_type() == SampleType::F16 => {
            (0..plane.len()).filter(|i| is_clamped(&each.value(*i))).count() as u64
        }
        _ => 0,
    }
}

pub(super) fn text(text: &str) -> Text {
    Text::from_slice_unchecked(text.as_bytes())
}

fn header(size: [u32; 2], channels: &[(String, &Plane<'_>)], given: &ExrHeader<'_>) -> Header {
    let size = (size[0] as usize, size[1] as usize);
    let list = channels.iter().map(|(name, plane)| ChannelDescription::new(text(name), plane.sample_type(), false));
    let other = given.attributes.iter().map(|(name, value)| (text(name), AttributeValue::Text(text(value)))).collect();
    Header::new(text("main"), size, list.collect())
        .with_encoding(Compression::ZIP16, BlockDescription::ScanLines, LineOrder::Increasing)
        .with_shared_attributes(ImageAttributes::with_size(size))
        .with_attributes(LayerAttributes {
            other,
            software_name: given.software.map(text),
            world_to_camera: given.world_to_camera,
            world_to_normalized_device: given.world_to_ndc,
            ..LayerAttributes::default()
        })
}

/// Number of image rows per ZIP-compressed block, fixed by the OpenEXR format.
const BLOCK_ROWS: usize = 16;

/// Returns the number of rows that [`write_exr`] holds in memory and compresses at a time.
pub fn rows_at_a_time() -> usize {
    4 * BLOCK_ROWS * rayon::current_num_threads()
}

/// Creates an empty file in memory, large enough for incompressible planes, since a vector that grows is copied.
pub(super) fn room_for<'a>(planes: impl Iterator<Item = &'a Plane<'a>>) -> Cursor<Vec<u8>> {
    let raw: usize = planes.map(|plane| plane.sample_type().bytes_per_sample() * plane.len()).sum();
    Cursor::new(Vec::with_capacity(raw + raw / 64))
}

/// Encodes a file. `planes` holds each part's planes in the order of its channels; a part without planes has its chunks in
/// `copied`, with their numbers in the part. `strict` refuses files that other programs may not read.
pub(super) fn encode(
    to: &mut (impl Write + Seek),
    headers: Vec<Header>,
    planes: &[Vec<&Plane<'_>>],
    copied: Vec<(usize, Chunk)>,
    strict: bool,
) -> ::exr::error::Result<()> {
    block::write(BufWriter::new(to), headers.into_iter().collect(), strict, |meta, writer| {
        let blocks = enumerate_ordered_header_block_indices(&meta.headers);
        let blocks: Vec<(usize, BlockIndex)> = blocks.filter(|(_, index)| !planes[index.layer].is_empty()).collect();
        // In batches, so that not everything is in memory uncompressed; in order, so that the bytes do not
        // depend on threads.
        for batch in blocks.chunks(rows_at_a_time() / BLOCK_ROWS) {
            let compress = |&(number, index): &(usize, BlockIndex)| {
                let block = pack(&meta.headers[index.layer], index, &planes[index.layer])?;
                block.compress_to_chunk(&meta.headers).map(|chunk| (number, chunk))
            };
            let chunks: Vec<_> = batch.par_iter().map(compress).collect::<::exr::error::Result<_>>()?;
            for (number, chunk) in chunks {
                writer.write_chunk(number, chunk)?;
            }
        }
        copied.into_iter().try_for_each(|(number, chunk)| writer.write_chunk(number, chunk))
    })
}

fn pack(header: &Header, index: BlockIndex, planes: &[&Plane<'_>]) -> ::exr::error::Result<UncompressedBlock> {
    let mut outcome = Ok(());
    let block = UncompressedBlock::from_lines(&header.channels, index, |line| {
        let start = line.location.position.1 * header.layer_size.0 + line.location.position.0;
        let range = start..start + line.location.sample_count;
        let written = match planes[line.location.channel] {
            Plane::F32(values) => line.write_samples_from_slice(&values[range]),
            Plane::U32(values) => line.write_samples_from_slice(&values[range]),
            Plane::F16(values) => line.write_samples(|i| to_half(values[start + i])),
            plane @ Plane::Each(each) => match plane.sample_type() {
                SampleType::F16 => line.write_samples(|i| to_half(each.value(start + i))),
                _ => line.write_samples(|i| each.value(start + i)),
            },
        };
        if outcome.is_ok() {
            outcome = written;
        }
    });
    outcome.map(|()| block)
}

fn to_half(value: f32) -> f16 {
    f16::from_f32(if value.is_finite() { value.clamp(-F16_MAX, F16_MAX) } else { value })
}

/// Sorts the attributes in each header of an encoded file by name, since `exr` keeps them in a hash map and files would
/// differ between runs. The length of the headers and all offsets stay the same.
pub(super) fn sort_attributes(mut bytes: Vec<u8>) -> Vec<u8> {
    let several = bytes[5] & 0x10 != 0;
    let mut at = 8;
    loop {
        at = sort_header(&mut bytes, at);
        // A list of several headers ends with an empty one.
        if !several || bytes[at] == 0 {
            return bytes;
        }
    }
}

/// Sorts the attributes of the header that starts here. Returns the end of the header.
fn sort_header(bytes: &mut [u8], start: usize) -> usize {
    let mut entries = Vec::new();
    let mut at = start;
    let word_end = |at: usize| at + bytes[at..].iter().position(|&b| b == 0).unwrap_or(0);
    while bytes[at] != 0 {
        let name_end = word_end(at);
        let size_at = word_end(name_end + 1) + 1;
        let size = [0, 1, 2, 3].map(|i| bytes[size_at + i]);
        let end = size_at + 4 + u32::from_le_bytes(size) as usize;
        entries.push((bytes[at..name_end].to_vec(), bytes[at..end].to_vec()));
        at = end;
    }
    entries.sort();
    let sorted = entries.into_iter().flat_map(|(_, entry)| entry);
    bytes[start..at].iter_mut().zip(sorted).for_each(|(byte, new)| *byte = new);
    at + 1
}
