//! Buffers of a glTF file, and the numbers in them (accessors).

use super::{Fault, named};
use crate::files::Files;
use crate::text;
use ::gltf::accessor::{Accessor, DataType};
use ::gltf::{Document, buffer};
use base64::Engine;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use std::borrow::Cow;
use std::path::{Path, PathBuf};

/// The largest number of values of an accessor that has no data in the file. Such values are all 0.
const MOST_ZEROS: usize = 1 << 24;

/// The contents of all buffers of a file.
pub(super) struct Buffers<'a> {
    contents: Vec<Cow<'a, [u8]>>,
}

impl<'a> Buffers<'a> {
    /// Reads all buffers: from the binary chunk `blob`, from data URIs, and from files beside `path`.
    pub(super) fn read(
        document: &Document,
        blob: Option<&'a [u8]>,
        files: &dyn Files,
        path: &Path,
    ) -> Result<Self, Fault> {
        let mut contents = Vec::new();
        for buffer in document.buffers() {
            let name = || named("buffer", buffer.index(), buffer.name());
            let bytes = match buffer.source() {
                buffer::Source::Bin => {
                    blob.map(Cow::Borrowed).ok_or_else(|| "the file has no binary chunk; export it again".into())
                }
                buffer::Source::Uri(uri) => read_uri(uri, files, path).map(Cow::Owned),
            };
            let bytes = bytes.map_err(|what: String| format!("{}: {what}", name()))?;
            if bytes.len() < buffer.length() {
                let (has, needs) = (bytes.len(), buffer.length());
                return Err(format!("{}: has only {has} of {needs} bytes; copy its file again", name()).into());
            }
            contents.push(bytes);
        }
        Ok(Self { contents })
    }

    /// The bytes of a view of a buffer; `None` if it reaches beyond the buffer.
    pub(super) fn view(&self, view: &buffer::View<'_>) -> Option<&[u8]> {
        let end = view.offset().checked_add(view.length())?;
        self.contents.get(view.buffer().index())?.get(view.offset()..end)
    }

    /// The values of an accessor as `N` floats each. Normalized integers become 0 to 1, or -1 to 1.
    pub(super) fn floats<const N: usize>(&self, accessor: &Accessor<'_>) -> Result<Vec<[f32; N]>, String> {
        let (kind, normalized) = (accessor.data_type(), accessor.normalized());
        let float = |bytes: &[u8]| {
            let most = match kind {
                DataType::F32 => return f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]),
                DataType::I8 => 127.0,
                DataType::U8 => 255.0,
                DataType::I16 => 32_767.0,
                _ => 65_535.0,
            };
            let value = integer(kind, bytes) as f32;
            if normalized { (value / most).max(-1.0) } else { value }
        };
        self.values(accessor, 0.0, float)
    }

    /// The values of an accessor as `N` whole numbers each.
    pub(super) fn integers<const N: usize>(&self, accessor: &Accessor<'_>) -> Result<Vec<[u32; N]>, String> {
        let kind = accessor.data_type();
        if matches!(kind, DataType::F32 | DataType::I8 | DataType::I16) {
            return Err(format!("accessor {}: must hold unsigned integers; export the file again", accessor.index()));
        }
        self.values(accessor, 0, |bytes| integer(kind, bytes) as u32)
    }

    fn values<T: Copy, const N: usize>(
        &self,
        accessor: &Accessor<'_>,
        zero: T,
        read: impl Fn(&[u8]) -> T,
    ) -> Result<Vec<[T; N]>, String> {
        let fault = |what: &str| {
            format!("{}: {what}; export the file again", named("accessor", accessor.index(), accessor.name()))
        };
        if accessor.dimensions().multiplicity() != N {
            return Err(fault(&format!("must have elements of {N} values")));
        }
        let (count, size) = (accessor.count(), accessor.data_type().size());
        let element = |bytes: &[u8]| std::array::from_fn(|k| read(&bytes[k * size..]));
        let mut values = match accessor.view() {
            None if count > MOST_ZEROS => return Err(fault(&format!("has no data for its {count} values"))),
            None => vec![[zero; N]; count],
            Some(view) => {
                let bytes = self.view(&view).ok_or_else(|| fault("reaches beyond its buffer"))?;
                let stride = view.stride().unwrap_or(N * size);
                let strided = strided(bytes, [accessor.offset(), stride, N * size], count);
                strided.ok_or_else(|| fault("reaches beyond its buffer"))?.map(element).collect()
            }
        };
        let Some(sparse) = accessor.sparse() else { return Ok(values) };
        let (indices, changed) = (sparse.indices(), sparse.values());
        let of_index = indices.index_type().size();
        let pieces =
            |view, at, size| self.view(&view).and_then(|bytes| strided(bytes, [at, size, size], sparse.count()));
        let places = pieces(indices.view(), indices.offset(), of_index);
        let elements = pieces(changed.view(), changed.offset(), N * size);
        let (Some(places), Some(elements)) = (places, elements) else { return Err(fault("reaches beyond its buffer")) };
        for (place, bytes) in places.zip(elements) {
            let place = place.iter().rev().fold(0, |sum, &byte| sum << 8 | usize::from(byte));
            *values.get_mut(place).ok_or_else(|| fault("has a sparse value out of range"))? = element(bytes);
        }
        Ok(values)
    }
}

/// `count` pieces of `size` bytes, `stride` bytes apart, from `offset` on; `None` if a piece ends beyond the bytes.
fn strided(bytes: &[u8], layout: [usize; 3], count: usize) -> Option<impl Iterator<Item = &[u8]> + Clone> {
    let [offset, stride, size] = layout;
    let bytes = bytes.get(offset..)?;
    let needed = if count == 0 { 0 } else { stride.checked_mul(count - 1)?.checked_add(size)? };
    (stride >= size && needed <= bytes.len()).then(|| (0..count).map(move |i| &bytes[i * stride..i * stride + size]))
}

fn integer(kind: DataType, bytes: &[u8]) -> i64 {
    match kind {
        DataType::I8 => i64::from(bytes[0] as i8),
        DataType::U8 => i64::from(bytes[0]),
        DataType::I16 => i64::from(i16::from_le_bytes([bytes[0], bytes[1]])),
        DataType::U16 => i64::from(u16::from_le_bytes([bytes[0], bytes[1]])),
        DataType::U32 | DataType::F32 => i64::from(u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])),
    }
}

/// Reads the bytes of a URI: a data URI, or a file beside `path`.
pub(super) fn read_uri(uri: &str, files: &dyn Files, path: &Path) -> Result<Vec<u8>, String> {
    if let Some(data) = uri.strip_prefix("data:") {
        let text = data.split_once(";base64,").ok_or("a data URI must be in base64; export the file again")?.1;
        let text: String = text.split_ascii_whitespace().collect();
        // Padding is optional.
        let lenient = GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent);
        return GeneralPurpose::new(&base64::alphabet::STANDARD, lenient)
            .decode(text)
            .map_err(|e| format!("a data URI cannot be decoded ({e}); export the file again"));
    }
    let file = beside(uri, path);
    files.read(&file).map_err(|e| format!("cannot read {}: {e}; put the file beside the glTF file", file.display()))
}

/// The path of a file that a glTF file names.
pub(super) fn beside(uri: &str, path: &Path) -> PathBuf {
    path.parent().unwrap_or(Path::new("")).join(unescaped(uri))
}

/// Replaces escapes such as `%20` by the bytes that they encode.
fn unescaped(uri: &str) -> String {
    let (text, mut bytes, mut at) = (uri.as_bytes(), Vec::with_capacity(uri.len()), 0);
    while let Some(&byte) = text.get(at) {
        let hex = text.get(at + 1..at + 3).and_then(|hex| std::str::from_utf8(hex).ok());
        let escaped = hex.filter(|_| byte == b'%').and_then(|hex| u8::from_str_radix(hex, 16).ok());
        bytes.push(escaped.unwrap_or(byte));
        at += if escaped.is_some() { 3 } else { 1 };
    }
    text::lossless(&bytes).into_owned()
}
