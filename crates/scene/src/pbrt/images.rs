//! Images that a pbrt scene names, and their decoding.

use super::params::Params;
use super::tokens::shown;
use super::version::Version;
use crate::image::{Encoding, Image, ImageError, read_texture};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

/// Decoded images by path, by the decoding of their integers, and by channel.
pub(super) type Images = BTreeMap<(PathBuf, ReadAs), Arc<Image>>;
/// The decoding of an image's integers, and the part of its pixels that is read.
pub(super) type ReadAs = (Decoding, Channel);

/// The conversion of an image file's integers to linear intensity.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Decoding {
    Srgb,
    Linear,
    /// Raises the integer, scaled to 0..=1, to this power. Holds the bits of an `f32`, so that the type can be a map
    /// key.
    Gamma(u32),
}

impl Decoding {
    /// Returns the decoding of an image map's integers, from the directive's parameters and the version of pbrt.
    pub(super) fn of(params: &mut Params, file: &str) -> Self {
        match params.context.version {
            Version::V2 => {
                let gamma = params.float("gamma", 1.0, |v| v > 0.0, "above 0");
                if gamma != 1.0 {
                    params.unsupported(params.line(), "an image with a gamma other than 1 (of pbrt-v2)");
                }
                Self::Linear
            }
            Version::V3 => {
                let integers = [".tga", ".png"].iter().any(|e| file.to_ascii_lowercase().ends_with(e));
                if params.flag("gamma", integers) { Self::Srgb } else { Self::Linear }
            }
            Version::V4 => match params.text("encoding") {
                None => Self::Srgb,
                Some((text, line)) => match text.split_ascii_whitespace().collect::<Vec<_>>()[..] {
                    ["sRGB"] => Self::Srgb,
                    ["linear"] => Self::Linear,
                    ["gamma", power] if power.parse::<f32>().is_ok_and(|p| p > 0.0 && p.is_finite()) => {
                        Self::Gamma(power.parse::<f32>().unwrap_or(1.0).to_bits())
                    }
                    _ => {
                        let what = format!("must be sRGB, linear, or gamma and a number above 0, not {}", shown(&text));
                        params.bad("encoding", line, what);
                        Self::Srgb
                    }
                },
            },
        }
    }
}

/// The part of an image's pixels that a texture reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Channel {
    /// The colour (RGB).
    Rgb,
    /// Three numbers that are no colour, as in a normal map.
    Vector,
    /// Opacity if it is not 1 everywhere, else the mean of R, G and B, as in pbrt-v4.
    AlphaOrMean,
    /// Luminance of the colour, as in pbrt-v2 and v3.
    Luminance,
}

impl Channel {
    fn of(self, mut image: Image) -> Image {
        // A float texture does not need the opacity besides its values.
        let alpha =
            if matches!(self, Self::Rgb | Self::Vector) { Vec::new() } else { std::mem::take(&mut image.alpha) };
        match self {
            Self::Rgb | Self::Vector => {}
            Self::AlphaOrMean if !alpha.is_empty() => {
                image.pixels = alpha.into_iter().map(|a| [a; 3]).collect();
            }
            Self::AlphaOrMean => image.pixels.iter_mut().for_each(|p| *p = [(p[0] + p[1] + p[2]) / 3.0; 3]),
            Self::Luminance => {
                // The weights of pbrt-v3's RGB spectra.
                let y = |p: &[f32; 3]| 0.212_671 * p[0] + 0.715_160 * p[1] + 0.072_169 * p[2];
                image.pixels.iter_mut().for_each(|p| *p = [y(p); 3]);
            }
        }
        image
    }
}

/// Decodes an image file. `name` is its name in messages. Returns notices, too.
pub(super) fn decode(
    bytes: &[u8],
    name: &str,
    (decoding, channel): ReadAs,
) -> Result<(Image, Vec<String>), ImageError> {
    // Floats are linear either way, but only colours have a colour space.
    let is_color = channel == Channel::Rgb && (decoding == Decoding::Srgb || !holds_integers(bytes));
    let encoding = if is_color || decoding == Decoding::Srgb { Encoding::Srgb } else { Encoding::Linear };
    let (mut image, notices) = read_texture(bytes, name, encoding)?;
    if let Decoding::Gamma(bits) = decoding
        && holds_integers(bytes)
    {
        let gamma = f32::from_bits(bits);
        image.pixels.iter_mut().for_each(|p| *p = p.map(|c| c.powf(gamma)));
    }
    Ok((channel.of(image), notices))
}

/// Returns true if a file's values are encoded integers, false for OpenEXR, Radiance HDR and PFM files, which hold
/// linear values.
fn holds_integers(bytes: &[u8]) -> bool {
    ![&b"\x76\x2f\x31\x01"[..], b"#?", b"\xef\xbb\xbf#?", b"PF", b"Pf"].iter().any(|magic| bytes.starts_with(magic))
}
