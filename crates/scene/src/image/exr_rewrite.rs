//! Copies of OpenEXR files with new values in some channels.

use super::exr_file::ExrFile;
use super::exr_write::{check_attributes, encode, room_for, sort_attributes, text};
use super::openexr::with_reader;
use super::{ImageError, Plane, Window};
use ::exr::block::chunk::Chunk;
use ::exr::math::Vec2;
use ::exr::meta::BlockDescription;
use ::exr::meta::attribute::{AttributeValue, ChannelDescription, ChannelList, Compression, LineOrder, SampleType};
use ::exr::meta::header::Header;
use std::borrow::Cow;
use std::collections::BTreeMap;

/// New values of some channels in a part of an OpenEXR file.
pub struct ExrEdit<'a> {
    /// The part, from 0.
    pub part: usize,
    /// The window that the values cover. The part is cropped to the pixels that lie in the windows of all its edits.
    pub window: Window,
    /// Full name and values of each channel. A new name adds a channel. For an existing `half` channel, floats become `half`.
    pub channels: Vec<(String, Plane<'a>)>,
}

/// A copy of an OpenEXR file in memory.
#[derive(Clone, Debug, PartialEq)]
pub struct RewrittenExr {
    /// The bytes of the file.
    pub bytes: Vec<u8>,
    /// Notices about features that the copy lacks; one sentence each.
    pub notices: Vec<String>,
}

impl ExrFile<'_> {
    /// Encodes the file with new values in some channels, and adds text attributes to the first part. Parts without edits are
    /// copied unchanged. Edited parts keep their header, but lose their mip or rip maps. If an edited part has a lossy
    /// compression, ZIP replaces it, so that its other channels keep their values.
    ///
    /// # Errors
    /// Those of [`planes`](Self::planes); [`ImageError::PixelCount`] and [`ImageError::Encode`] for channels and
    /// attributes that the file cannot hold.
    pub fn rewritten(
        &self,
        edits: &[ExrEdit<'_>],
        attributes: &[(String, String)],
    ) -> Result<RewrittenExr, ImageError> {
        let mut headers = self.headers.clone();
        let mut planes: Vec<Vec<Plane<'_>>> = headers.iter().map(|_| Vec::new()).collect();
        let mut notices = Vec::new();
        for part in 0..headers.len() {
            let edits: Vec<&ExrEdit<'_>> = edits.iter().filter(|edit| edit.part == part).collect();
            if let Some(window) = self.common_window(part, &edits)? {
                planes[part] = self.edited(&mut headers[part], part, window, &edits)?;
                notices.extend(self.re_encoded(&mut headers[part], part));
            }
        }
        let other = &mut headers[0].own_attributes.other;
        other.extend(attributes.iter().map(|(name, value)| (text(name), AttributeValue::Text(text(value)))));
        headers.iter_mut().for_each(keep_key_codes);
        let clamped: u64 = planes.iter().flatten().map(super::exr_write::count_clamped).sum();
        if clamped > 0 {
            notices.push(format!("values above 65504, the limit of 16-bit floats, are clamped ({clamped})"));
        }
        let copied = self.chunks(|part| planes[part].is_empty())?;
        let planes: Vec<Vec<&Plane<'_>>> = planes.iter().map(|planes| planes.iter().collect()).collect();
        let mut bytes = room_for(planes.iter().flatten().copied());
        encode(&mut bytes, headers, &planes, copied, false)
            .map_err(|e| ImageError::Encode(format!("EXR: {e}; write another format")))?;
        let bytes = sort_attributes(bytes.into_inner());
        check_attributes(&bytes, attributes)?;
        Ok(RewrittenExr { bytes, notices })
    }

    /// The window common to all edits of a part; `None` without edits.
    fn common_window(&self, part: usize, edits: &[&ExrEdit<'_>]) -> Result<Option<Window>, ImageError> {
        let whole = self.parts[part].data_window;
        let common = edits.iter().try_fold(whole, |window, edit| window.common(edit.window));
        match common {
            _ if edits.is_empty() => Ok(None),
            Some(window) => Ok(Some(window)),
            None => Err(ImageError::Encode(format!("EXR: part {part}: its edits have no pixel in common"))),
        }
    }

    /// Returns the planes of a part after its edits, cropped to `window`. Updates the channels and the window of `header`.
    fn edited<'p>(
        &'p self,
        header: &mut Header,
        part: usize,
        window: Window,
        edits: &[&'p ExrEdit<'_>],
    ) -> Result<Vec<Plane<'p>>, ImageError> {
        let own = self.parts[part].data_window;
        let mut channels: BTreeMap<String, (ChannelDescription, Plane<'p>)> = BTreeMap::new();
        for (channel, plane) in header.channels.list.iter().zip(self.planes(part)?) {
            channels.insert(channel.name.to_string(), (channel.clone(), cut(plane, own, window)));
        }
        for (edit, name, plane) in edits.iter().flat_map(|edit| edit.channels.iter().map(move |(n, p)| (edit, n, p))) {
            super::check_count(edit.window.size, plane.len())?;
            let values = cut(plane, edit.window, window);
            let known = channels.get(name);
            let values = match (values, known) {
                (Plane::F32(values), Some((_, Plane::F16(_)))) => Plane::F16(values),
                (values, _) => values,
            };
            let mut channel = known.map(|(channel, _)| channel.clone());
            let channel = channel.get_or_insert_with(|| ChannelDescription::new(text(name), SampleType::F32, false));
            channel.sample_type = values.sample_type();
            channels.insert(name.clone(), (channel.clone(), values));
        }
        header.layer_size = Vec2(window.size[0] as usize, window.size[1] as usize);
        header.own_attributes.layer_position = Vec2(window.origin[0], window.origin[1]);
        let (list, planes): (Vec<_>, Vec<_>) = channels.into_values().unzip();
        header.channels = ChannelList::new(list.into_iter().collect());
        Ok(planes)
    }

    /// Sets a lossless encoding and its number of chunks in `header`. Returns notices about changes.
    fn re_encoded(&self, header: &mut Header, part: usize) -> Vec<String> {
        let mut notices = Vec::new();
        let compression = match self.compression(part) {
            kept @ (Compression::Uncompressed | Compression::RLE | Compression::ZIP1 | Compression::PIZ) => kept,
            _ => Compression::ZIP16,
        };
        if compression != self.compression(part) {
            let old = &self.parts[part].compression;
            notices.push(format!("its compression is now ZIP, not {old}, so that other channels keep their values"));
        }
        let mut encoding = (header.blocks, header.line_order);
        if self.parts[part].levels {
            notices.push("the smaller versions of the image (mip maps) are left out".to_owned());
            encoding = (BlockDescription::ScanLines, LineOrder::Increasing);
        }
        *header = header.clone().with_encoding(compression, encoding.0, encoding.1);
        notices
    }

    /// The compressed chunks of the parts to copy, each with its number in the part.
    fn chunks(&self, is_copied: impl Fn(usize) -> bool) -> Result<Vec<(usize, Chunk)>, ImageError> {
        if !(0..self.parts.len()).any(&is_copied) {
            return Ok(Vec::new());
        }
        let mut numbers = BTreeMap::new();
        for (part, header) in self.headers.iter().enumerate().filter(|(part, _)| is_copied(*part)) {
            for (number, tile) in header.blocks_increasing_y_order().enumerate() {
                let at = tile.location;
                numbers.insert((part, [at.tile_index.0, at.tile_index.1, at.level_index.0, at.level_index.1]), number);
            }
        }
        let file = self.file();
        with_reader(&file, |open| {
            let mut chunks = Vec::new();
            for chunk in open()?.filter_chunks(false, |_, _, block| is_copied(block.layer))? {
                let chunk = chunk?;
                let part = chunk.layer_index;
                let header = self.headers.get(part).ok_or_else(|| damaged(&file))?;
                let at = header.get_block_data_indices(&chunk.compressed_block)?;
                let at = [at.tile_index.0, at.tile_index.1, at.level_index.0, at.level_index.1];
                let number = numbers.get(&(part, at)).ok_or_else(|| damaged(&file))?;
                chunks.push((*number, chunk));
            }
            Ok(chunks)
        })
    }
}

/// Stores film key codes as raw bytes, since `exr` writes only six of their seven numbers.
fn keep_key_codes(header: &mut Header) {
    let named = header.own_attributes.film_key_code.take().map(|code| (text("keyCode"), AttributeValue::KeyCode(code)));
    header.own_attributes.other.extend(named);
    for value in header.own_attributes.other.values_mut().chain(header.shared_attributes.other.values_mut()) {
        if let AttributeValue::KeyCode(code) = value {
            let numbers = [
                code.film_manufacturer_code,
                code.film_type,
                code.film_roll_prefix,
                code.count,
                code.perforation_offset,
                code.perforations_per_frame,
                code.perforations_per_count,
            ];
            let bytes = numbers.into_iter().flat_map(i32::to_le_bytes).collect();
            *value = AttributeValue::Custom { kind: text("keycode"), bytes };
        }
    }
}

fn damaged(file: &super::read::File<'_>) -> ImageError {
    file.malformed(file.bytes.len(), "a chunk belongs to no part")
}

fn cut<'p>(plane: &'p Plane<'_>, own: Window, inner: Window) -> Plane<'p> {
    let floats = |values: &'p [f32]| if own == inner { Cow::Borrowed(values) } else { own.cut(values, inner).into() };
    match plane {
        Plane::F32(values) => Plane::F32(floats(values)),
        Plane::F16(values) => Plane::F16(floats(values)),
        Plane::U32(values) if own == inner => Plane::U32(Cow::Borrowed(values)),
        Plane::U32(values) => Plane::U32(own.cut(values, inner).into()),
        each @ Plane::Each(_) => Plane::F32(own.cut(&each.floats(), inner).into()),
    }
}
