//! Colours of vertices and facets. Scanners and modelling programs write sRGB colours, except in glTF.

use crate::image::srgb_decode;

/// Colours whose range is 0 to 1 may exceed it up to this value.
const BRIGHT: f32 = 4.0;

/// Decodes colours in sRGB to linear RGB. The range is taken as 0 to 255 if a value is above 4, and more values are above 1
/// than between 0 and 1; else as 0 to 1. NaN and infinity stay. Returns a notice if values are out of range.
pub(super) fn decode(colors: &mut [[f32; 3]]) -> Option<String> {
    let channels = || colors.as_flattened().iter().copied().filter(|channel| channel.is_finite());
    let count = |is: fn(f32) -> bool| channels().filter(|channel| is(*channel)).count();
    let is_bytes = channels().any(|c| c > BRIGHT) && count(|c| c > 1.0) > count(|c| c > 0.0 && c < 1.0);
    let most = if is_bytes { 255.0 } else { 1.0 };
    let mut outside = 0;
    for channel in colors.as_flattened_mut().iter_mut().filter(|channel| channel.is_finite()) {
        let share = f64::from(*channel) / most;
        outside += usize::from(!(0.0..=1.0).contains(&share));
        *channel = srgb_decode(share.clamp(0.0, 1.0)) as f32;
    }
    (outside > 0).then(|| format!("{outside} colour values are outside of 0 to {most} and are clamped"))
}
