//! Conversion of a decoder's samples to linear RGB, in place, so that large images are not held twice.

use super::{Encoding, srgb};
use ::image::ColorType;

/// Returns the end of the memory of `pixels` as bytes: `bytes_per_pixel` (at most 12) for each pixel. A decoder writes
/// packed samples there. [`expand`] then converts them in place, front to back, without overwriting unread samples.
pub(super) fn packed(pixels: &mut [[f32; 3]], bytes_per_pixel: usize) -> &mut [u8] {
    let length = pixels.len() * bytes_per_pixel;
    let bytes: &mut [u8] = bytemuck::cast_slice_mut(pixels);
    let start = bytes.len().saturating_sub(length);
    &mut bytes[start..]
}

/// Returns the opacity of each packed pixel, 0 to 1; `None` if the format has no alpha channel.
pub(super) fn alpha(packed: &[u8], color: ColorType) -> Option<Vec<f32>> {
    let byte = |b: &u8| f32::from(*b) / 255.0;
    let word = |b: &[u8; 2]| f32::from(u16::from_ne_bytes(*b)) / 65535.0;
    Some(match color {
        ColorType::La8 | ColorType::Rgba8 => {
            packed.chunks_exact(color.bytes_per_pixel().into()).filter_map(|p| p.last()).map(byte).collect()
        }
        ColorType::La16 | ColorType::Rgba16 => {
            packed.chunks_exact(color.bytes_per_pixel().into()).filter_map(|p| p.last_chunk()).map(word).collect()
        }
        _ => return None,
    })
}

/// Converts the samples in the memory that [`packed`] returns to linear RGB, in place. The error describes an
/// unsupported colour type.
pub(super) fn expand(pixels: &mut [[f32; 3]], color: ColorType, encoding: Encoding) -> Result<(), &'static str> {
    let linear = encoding == Encoding::Linear;
    let table = |srgb: fn() -> Vec<f32>, most: f64| {
        if linear { (0..=most as u32).map(|i| (f64::from(i) / most) as f32).collect() } else { srgb() }
    };
    match color {
        ColorType::L8 | ColorType::La8 | ColorType::Rgb8 | ColorType::Rgba8 => {
            let table = table(srgb::decode_table_8, 255.0);
            let value = |[byte]: [u8; 1]| table[usize::from(byte)];
            match color {
                ColorType::L8 => forward::<1, 1>(pixels, 0, value),
                ColorType::La8 => forward::<1, 2>(pixels, 0, value),
                ColorType::Rgb8 => forward::<1, 3>(pixels, 1, value),
                _ => forward::<1, 4>(pixels, 1, value),
            }
        }
        ColorType::L16 | ColorType::La16 | ColorType::Rgb16 | ColorType::Rgba16 => {
            let table = table(srgb::decode_table_16, 65535.0);
            let value = |bytes: [u8; 2]| table[usize::from(u16::from_ne_bytes(bytes))];
            match color {
                ColorType::L16 => forward::<2, 2>(pixels, 0, value),
                ColorType::La16 => forward::<2, 4>(pixels, 0, value),
                ColorType::Rgb16 => forward::<2, 6>(pixels, 1, value),
                _ => forward::<2, 8>(pixels, 1, value),
            }
        }
        // Radiance HDR: the samples are linear RGB already, in their final place.
        ColorType::Rgb32F => {}
        _ => return Err("this kind of pixel"),
    }
    Ok(())
}

/// Converts pixels of `BYTES` bytes, in samples of `SIZE` bytes, to RGB in place; `value` converts one sample. `step`
/// is 0 for gray, 1 for RGB. Of `n` pixels, pixel `i` is read `BYTES (n - i)` bytes before the end. It is written up to
/// `12 (n - i - 1)` bytes before the end, so that no unread byte is overwritten.
fn forward<const SIZE: usize, const BYTES: usize>(
    pixels: &mut [[f32; 3]],
    step: usize,
    value: impl Fn([u8; SIZE]) -> f32,
) {
    let bytes: &mut [u8] = bytemuck::cast_slice_mut(pixels);
    let mut from = bytes.len() - bytes.len() / size_of::<[f32; 3]>() * BYTES;
    for to in (0..bytes.len()).step_by(size_of::<[f32; 3]>()) {
        let mut packed = [0; BYTES];
        packed.copy_from_slice(&bytes[from..from + BYTES]);
        from += BYTES;
        for channel in 0..3 {
            let mut sample = [0; SIZE];
            sample.copy_from_slice(&packed[channel * step * SIZE..][..SIZE]);
            bytes[to + 4 * channel..to + 4 * channel + 4].copy_from_slice(&value(sample).to_ne_bytes());
        }
    }
}
