//! Conversion of colours, spectra and named metals, glasses and illuminants to linear RGB. Files of spectra.

use super::params::{Params, Type, Values};
use super::tokens::shown;
use super::version::Version;
use crate::colorimetry::{Sampled, blackbody, blackbody_of_peak_one, rgb_of_chromaticity, rgb_of_xyz};
use crate::text;
use glam::DVec3;
use std::str::FromStr;

/// The valid range of a colour, and the illuminant under which a spectrum is converted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Gamut {
    /// A reflectance: 0 to 1. A spectrum is converted under D65.
    Reflectance,
    /// The colour of a light: at least 0. In pbrt-v4 a spectrum or a temperature gives a colour of luminance 1; other
    /// parameters set the brightness.
    Light,
    /// An index of refraction: at least 0. A spectrum is converted without an illuminant.
    Index,
    /// A texture value or a coefficient of a medium: at least 0. A spectrum is converted under D65.
    Unbounded,
}

impl Params {
    /// Takes a constant colour parameter (RGB, XYZ, spectrum or black body) as linear sRGB; `None` if it is missing or
    /// invalid.
    pub(super) fn rgb(&mut self, name: &'static str, gamut: Gamut) -> Option<[f32; 3]> {
        let param = self.take_typed(name, &[Type::Rgb, Type::Xyz, Type::Spectrum, Type::Blackbody])?;
        let rgb = match (param.ty, &param.values) {
            (Type::Rgb | Type::Xyz, Values::Numbers(values)) => three(values, param.ty == Type::Xyz, gamut),
            (Type::Blackbody, Values::Numbers(values)) if gamut == Gamut::Light => self.blackbody(values),
            (Type::Spectrum, Values::Numbers(values)) => {
                Sampled::new(values).and_then(|spectrum| self.color_of(&spectrum, gamut))
            }
            (Type::Spectrum, Values::Texts(names)) => {
                let spectrum = names.first().map_or("", String::as_str);
                let known = match gamut {
                    Gamut::Light => illuminant(spectrum),
                    Gamut::Index => metal(spectrum).or_else(|| glass(spectrum).map(|eta| [eta; 3])),
                    Gamut::Reflectance | Gamut::Unbounded => None,
                };
                if known.is_none() {
                    self.unsupported(param.line, format!("spectrum {} as {name} of {}", shown(spectrum), self.of));
                }
                return known;
            }
            _ => {
                self.unsupported(param.line, format!("a black body as {name} of {}", self.of));
                return None;
            }
        };
        rgb.map_err(|what| self.bad(name, param.line, what)).ok()
    }

    /// Returns the linear sRGB colour of a black body parameter. The values are a temperature in kelvin and, in pbrt-v3
    /// files, a scale.
    fn blackbody(&self, values: &[f64]) -> Result<[f32; 3], String> {
        let hidden = |kelvin: f64| format!("is a black body of {kelvin} K, which emits no visible light");
        let rgb = match *values {
            [kelvin] if kelvin > 0.0 && self.context.version == Version::V4 => {
                blackbody(kelvin).ok_or_else(|| hidden(kelvin))?
            }
            [kelvin, scale] if kelvin > 0.0 && scale >= 0.0 && self.context.version == Version::V3 => {
                blackbody_of_peak_one(kelvin).ok_or_else(|| hidden(kelvin))? * scale
            }
            _ if self.context.version == Version::V3 => {
                return Err("takes a temperature above 0 (kelvin) and a scale of at least 0".into());
            }
            _ if self.context.version == Version::V2 => {
                return Err("is a black body, which only files of pbrt-v3 and v4 may have; use rgb instead".into());
            }
            _ => return Err("takes one temperature above 0 (kelvin)".into()),
        };
        in_range(rgb.max(DVec3::ZERO).to_array(), Gamut::Light).map_err(|range| format!("must be {range}"))
    }

    fn color_of(&self, spectrum: &Sampled, gamut: Gamut) -> Result<[f32; 3], String> {
        if spectrum.least() < 0.0 {
            return Err(format!("must be at least 0 everywhere, not {}", spectrum.least()));
        }
        let constant = spectrum.constant().filter(|_| gamut != Gamut::Light).map(DVec3::splat);
        let rgb = match gamut {
            _ if constant.is_some() => constant.unwrap_or_default(),
            Gamut::Light if self.context.version == Version::V4 => {
                spectrum.rgb_of_luminance_one().ok_or("has no visible part; use values above 0 from 380 to 780 nm")?
            }
            Gamut::Light | Gamut::Index => spectrum.rgb(),
            Gamut::Reflectance => spectrum.rgb_under_d65().min(DVec3::ONE),
            Gamut::Unbounded => spectrum.rgb_under_d65(),
        };
        let rgb = rgb.max(DVec3::ZERO);
        in_range(rgb.to_array(), gamut).map_err(|range| format!("must be {range}, not {}", rgb.max_element()))
    }

    /// Takes one index of refraction: a number, a named glass, or a spectrum's value at 587.6 nm, the standard
    /// wavelength for glass. Returns `default` if the parameter is missing or invalid.
    pub(super) fn index(&mut self, name: &'static str, default: f32) -> f32 {
        const HELIUM_D: f64 = 587.6;
        let above = |v: f64| v > 0.0;
        if self.peek(name).is_none_or(|p| p.ty != Type::Spectrum) {
            return self.float32(name, default, above, "above 0");
        }
        let Some(param) = self.take(name) else { return default };
        let index = match &param.values {
            Values::Numbers(numbers) => Sampled::new(numbers).map(|s| s.at(HELIUM_D) as f32),
            Values::Texts(names) if glass(&names[0]).is_some() => Ok(glass(&names[0]).unwrap_or(default)),
            Values::Texts(names) => {
                self.unsupported(param.line, format!("spectrum {} as {name} of {}", shown(&names[0]), self.of));
                return default;
            }
            _ => return default,
        };
        match index {
            Ok(index) if index > 0.0 && index.is_finite() => return index,
            Ok(index) => self.bad(name, param.line, format!("must be above 0, not {index}")),
            Err(what) => self.bad(name, param.line, what),
        }
        default
    }
}

/// Returns the colour of three numbers, RGB or XYZ. The error is a message that follows the parameter's name.
fn three(values: &[f64], xyz: bool, gamut: Gamut) -> Result<[f32; 3], String> {
    let [a, b, c] = *values else { return Err(format!("takes 3 numbers, not {}", values.len())) };
    // Negative channels, of colours outside the gamut of sRGB, are clipped.
    let rgb = if xyz { rgb_of_xyz(DVec3::new(a, b, c)).max(DVec3::ZERO).to_array() } else { [a, b, c] };
    in_range(rgb, gamut).map_err(|range| format!("must be {range} in every channel, not {a} {b} {c}"))
}

/// Returns a colour in single precision. The error, if a channel is outside of `gamut`, is a message that follows the
/// parameter's name.
fn in_range(rgb: [f64; 3], gamut: Gamut) -> Result<[f32; 3], &'static str> {
    let most = if gamut == Gamut::Reflectance { 1.0 } else { f64::from(f32::MAX) };
    match rgb.iter().all(|c| (0.0..=most).contains(c)) {
        true => Ok(rgb.map(|c| c as f32)),
        false if gamut == Gamut::Reflectance => Err("within 0..=1"),
        false => Err("at least 0 and below 3.4e38"),
    }
}

/// The spectra of pbrt-v4 that are known by name, one per line.
///
/// * `metal-M-eta`, `metal-M-k`: the complex index of refraction of a metal as linear RGB, from the Tungsten renderer's
///   table of conductors [Bitterli 2018], which integrates measured spectra against the CIE observer. The values of brass
///   (CuZn) were converted from pbrt-v4's spectrum in the same way.
/// * `glass-G`: an index of refraction at 587.6 nm [Schott, optical glass data sheets]. pbrt-v4 writes F for the maker's
///   SF (flint glass).
/// * `stdillum-I`, `illum-I`: CIE x, y chromaticities of an illuminant [CIE 15:2004, tables T.3 and T.8; for ACES, SMPTE
///   ST 2065-1].
const NAMED: &str = include_str!("spectra.tsv");

/// Returns the `N` values of a spectrum whose name begins with `kind`; `None` for an unknown name.
fn values<T: FromStr, const N: usize>(kind: &str, name: &str) -> Option<[T; N]> {
    let rest =
        name.starts_with(kind).then(|| NAMED.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix('\t')));
    rest??.split('\t').map_while(|value| value.parse().ok()).collect::<Vec<T>>().try_into().ok()
}

/// Returns eta or k of a metal, as linear RGB, by a name such as `metal-Cu-eta`; `None` for an unknown name.
pub(super) fn metal(name: &str) -> Option<[f32; 3]> {
    values("metal-", name)
}

fn glass(name: &str) -> Option<f32> {
    values("glass-", name).map(|[eta]| eta)
}

/// Returns the linear RGB colour of a named illuminant at luminance 1; `None` for an unknown name.
fn illuminant(name: &str) -> Option<[f32; 3]> {
    if name == "stdillum-D65" {
        // D65 is the white of sRGB.
        return Some([1.0; 3]);
    }
    let chromaticity = values("stdillum-", name).or_else(|| values("illum-", name))?;
    Some(rgb_of_chromaticity(chromaticity).max(DVec3::ZERO).as_vec3().to_array())
}

/// The names of the known metals, glasses and illuminants of pbrt-v4.
pub(super) fn names() -> impl Iterator<Item = &'static str> {
    NAMED.lines().filter_map(|line| line.split('\t').next())
}

/// Parses all numbers of a text; `#` begins a comment. The error is the line, from 1, and a message.
pub(super) fn numbers(bytes: &[u8]) -> Result<Vec<f64>, (u32, String)> {
    let mut numbers = Vec::new();
    let text = text::decode(bytes).map_err(|what| (0, what.to_owned()))?;
    for (line, content) in (1..).zip(text.lines()) {
        let content = content.split('#').next().unwrap_or_default();
        for word in content.split_ascii_whitespace() {
            let value = word.parse().ok().filter(|value: &f64| value.is_finite());
            let what = || format!("{} is not a number; a spectrum file holds wavelengths and values", shown(word));
            numbers.push(value.ok_or_else(|| (line, what()))?);
        }
    }
    Ok(numbers)
}
