//! Colours of vertices and facets. Scanners and modellers write them in sRGB, except in glTF.

use crate::image::srgb_decode;

/// Decodes colours in sRGB to linear RGB. If a number is above 1, all are from 0 to 255, else from 0 to 1. NaN and infinity
/// stay.
pub(super) fn decode(colors: &mut [[f32; 3]]) {
    let most = if colors.as_flattened().iter().any(|c| c.is_finite() && *c > 1.0) { 255.0 } else { 1.0 };
    for channel in colors.as_flattened_mut().iter_mut().filter(|channel| channel.is_finite()) {
        *channel = srgb_decode((f64::from(*channel) / most).clamp(0.0, 1.0)) as f32;
    }
}
