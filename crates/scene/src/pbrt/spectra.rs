//! Conversion of colours, spectra and named metals, glasses and illuminants to linear RGB. Files of spectra.

use super::colorimetry::{Sampled, blackbody, blackbody_of_peak_one, rgb_of_chromaticity, rgb_of_xyz};
use super::legacy::Version;
use super::params::{Param, Params, Type, Values};
use super::reader::Reader;
use super::tokens::shown;
use crate::Source;
use dapple_core::nearest_name;
use glam::DVec3;
use std::io::ErrorKind;

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
        let of = self.of().to_owned();
        let problem = match (param.ty, &param.values) {
            (Type::Rgb | Type::Xyz, Values::Numbers(values)) => match *values.as_slice() {
                [a, b, c] => {
                    let xyz = param.ty == Type::Xyz;
                    // Negative channels, of colours outside the gamut of sRGB, are clipped.
                    let rgb = if xyz { rgb_of_xyz(DVec3::new(a, b, c)).max(DVec3::ZERO).to_array() } else { [a, b, c] };
                    match in_range(rgb, gamut) {
                        Ok(rgb) => return Some(rgb),
                        Err(range) => format!("must be {range} in every channel, not {a} {b} {c}"),
                    }
                }
                _ => format!("takes 3 numbers, not {}", values.len()),
            },
            (Type::Blackbody, Values::Numbers(values)) if gamut == Gamut::Light => match self.blackbody(values) {
                Ok(rgb) => return Some(rgb),
                Err(what) => what,
            },
            (Type::Spectrum, Values::Numbers(values)) => match Sampled::new(values) {
                Ok(spectrum) => match self.color_of(&spectrum, gamut) {
                    Ok(rgb) => return Some(rgb),
                    Err(what) => what,
                },
                Err(what) => what,
            },
            (Type::Spectrum, Values::Texts(names)) => {
                let name = names.first().map_or("", String::as_str);
                let known = match gamut {
                    Gamut::Light => illuminant(name),
                    Gamut::Index => metal(name).or_else(|| glass(name).map(|eta| [eta; 3])),
                    Gamut::Reflectance | Gamut::Unbounded => None,
                };
                if known.is_some() {
                    return known;
                }
                self.unsupported(param.line, format!("spectrum {} as {} of {of}", shown(name), param.name));
                return None;
            }
            _ => {
                self.unsupported(param.line, format!("a black body as {name} of {of}"));
                return None;
            }
        };
        self.problem(param.line, format!("parameter {name} of {of} {problem}"));
        None
    }

    /// Returns the linear sRGB colour of a black body parameter. Its values are a temperature in kelvin and, in pbrt-v3
    /// files, a scale.
    fn blackbody(&self, values: &[f64]) -> Result<[f32; 3], String> {
        let hidden = |kelvin: f64| format!("is a black body of {kelvin} K, which does not shine visibly");
        let rgb = match *values {
            [kelvin] if kelvin > 0.0 && self.version() == Version::V4 => {
                blackbody(kelvin).ok_or_else(|| hidden(kelvin))?
            }
            [kelvin, scale] if kelvin > 0.0 && scale >= 0.0 && self.version() == Version::V3 => {
                blackbody_of_peak_one(kelvin).ok_or_else(|| hidden(kelvin))? * scale
            }
            _ if self.version() == Version::V3 => {
                return Err("takes a temperature above 0 (kelvin) and a scale of at least 0".into());
            }
            _ if self.version() == Version::V2 => {
                return Err("is a black body, which is read in files of pbrt-v3 and v4 only; give its rgb".into());
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
            Gamut::Light if self.version() == Version::V4 => {
                spectrum.rgb_of_luminance_one().ok_or("is not visible; give values above 0 from 380 to 780 nm")?
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
        let Some(param) = self.peek(name).filter(|p| p.ty == Type::Spectrum) else {
            return self.float32(name, default, above, "above 0");
        };
        let (values, line) = (param.values.clone(), param.line);
        let index = match &values {
            Values::Texts(names) => {
                let glass_name = names.first().map_or("", String::as_str);
                match glass(glass_name) {
                    Some(eta) => Ok(eta),
                    None => {
                        let of = self.of().to_owned();
                        self.unsupported(line, format!("spectrum {} as {name} of {of}", shown(glass_name)));
                        Ok(default)
                    }
                }
            }
            Values::Numbers(numbers) => Sampled::new(numbers).map(|s| s.at(HELIUM_D) as f32),
            _ => Ok(default),
        };
        if self.take(name).is_none() {
            return default;
        }
        match index {
            Ok(index) if index > 0.0 && index.is_finite() => return index,
            Ok(index) => {
                self.problem(line, format!("parameter {name} of {} must be above 0, not {index}", self.of()));
            }
            Err(what) => self.problem(line, format!("parameter {name} of {} {what}", self.of())),
        }
        default
    }
}

/// Returns a colour in single precision; an error, to follow the parameter's name, if a channel is outside of `gamut`.
fn in_range(rgb: [f64; 3], gamut: Gamut) -> Result<[f32; 3], &'static str> {
    let most = if gamut == Gamut::Reflectance { 1.0 } else { f64::from(f32::MAX) };
    match rgb.iter().all(|c| (0.0..=most).contains(c)) {
        true => Ok(rgb.map(|c| c as f32)),
        false if gamut == Gamut::Reflectance => Err("within 0..=1"),
        false => Err("at least 0 and below 3.4e38"),
    }
}

/// Complex indices of refraction of metals as linear RGB: name, eta, k.
///
/// The values are from the Tungsten renderer's table of conductors [Bitterli 2018], which integrates measured spectra
/// against the CIE observer. The values of brass (CuZn) were converted from pbrt-v4's spectrum in the same way.
const METALS: &[(&str, [f32; 3], [f32; 3])] = &[
    ("Ag", [0.155_264_65, 0.116_723_3, 0.138_380_7], [4.828_343_4, 3.122_246, 2.147_050_4]),
    ("Al", [1.657_46, 0.880_368_95, 0.521_228_73], [9.223_869, 6.269_523, 4.837_001_3]),
    ("Au", [0.143_118_96, 0.374_957_03, 1.442_478_5], [3.983_160_5, 2.385_720_7, 1.603_215_2]),
    ("Cu", [0.200_437_7, 0.924_033_4, 1.102_212], [3.912_948_5, 2.452_847_7, 2.142_188]),
    ("CuZn", [0.519_769, 0.488_506, 1.042_009_8], [4.330_582_6, 2.548_106, 1.591_890_6]),
    ("MgO", [2.089_588_6, 1.650_722_5, 1.594_876], [0.0, 0.0, 0.0]),
    ("TiO2", [3.456_620_2, 2.801_707_7, 2.905_148_5], [0.000_102_666_2, 0.0, 0.000_635_690_2]),
];

/// Returns eta or k of a metal, as linear RGB, by a name such as `metal-Cu-eta`; `None` for an unknown name.
pub(super) fn metal(name: &str) -> Option<[f32; 3]> {
    let (metal, part) = name.strip_prefix("metal-")?.split_once('-')?;
    let (_, eta, k) = METALS.iter().find(|m| m.0 == metal)?;
    match part {
        "eta" => Some(*eta),
        "k" => Some(*k),
        _ => None,
    }
}

/// Names of glasses and their indices of refraction at 587.6 nm [Schott, optical glass data sheets]. pbrt-v4 writes F
/// for the maker's SF (flint glass).
const GLASSES: &[(&str, f32)] = &[
    ("glass-BAF10", 1.670_03),
    ("glass-BK7", 1.516_80),
    ("glass-F10", 1.728_25),
    ("glass-F11", 1.784_72),
    ("glass-F5", 1.672_70),
    ("glass-FK51A", 1.486_56),
    ("glass-LASF9", 1.850_25),
];

fn glass(name: &str) -> Option<f32> {
    GLASSES.iter().find(|g| g.0 == name).map(|g| g.1)
}

/// Names and CIE x, y chromaticities of standard illuminants [CIE 15:2004, tables T.3 and T.8; for ACES, SMPTE ST
/// 2065-1].
const ILLUMINANTS: &[(&str, [f64; 2])] = &[
    ("illum-acesD60", [0.321_68, 0.337_67]),
    ("stdillum-A", [0.447_57, 0.407_45]),
    ("stdillum-D50", [0.345_67, 0.358_51]),
    ("stdillum-F1", [0.3131, 0.3371]),
    ("stdillum-F10", [0.3458, 0.3588]),
    ("stdillum-F11", [0.3805, 0.3769]),
    ("stdillum-F12", [0.4370, 0.4042]),
    ("stdillum-F2", [0.3721, 0.3751]),
    ("stdillum-F3", [0.4091, 0.3941]),
    ("stdillum-F4", [0.4402, 0.4031]),
    ("stdillum-F5", [0.3138, 0.3452]),
    ("stdillum-F6", [0.3779, 0.3882]),
    ("stdillum-F7", [0.3129, 0.3292]),
    ("stdillum-F8", [0.3458, 0.3586]),
    ("stdillum-F9", [0.3741, 0.3727]),
];

/// Returns the linear RGB colour of a named illuminant at luminance 1; `None` for an unknown name.
fn illuminant(name: &str) -> Option<[f32; 3]> {
    if name == "stdillum-D65" {
        // D65 is the white of sRGB.
        return Some([1.0; 3]);
    }
    let (_, chromaticity) = ILLUMINANTS.iter().find(|i| i.0 == name)?;
    Some(rgb_of_chromaticity(*chromaticity).max(DVec3::ZERO).as_vec3().to_array())
}

/// Returns true if `name` is a known metal, glass or illuminant of pbrt-v4.
pub(super) fn is_named(name: &str) -> bool {
    metal(name).is_some() || glass(name).is_some() || illuminant(name).is_some()
}

/// Returns the known spectrum name nearest to `name`; `None` if no name is near.
pub(super) fn near_name(name: &str) -> Option<String> {
    let parts = METALS.iter().flat_map(|m| ["eta", "k"].map(|part| format!("metal-{}-{part}", m.0)));
    let others = GLASSES.iter().map(|g| g.0).chain(ILLUMINANTS.iter().map(|i| i.0)).chain(["stdillum-D65"]);
    let names: Vec<String> = parts.chain(others.map(str::to_owned)).collect();
    nearest_name(name, names.iter().map(String::as_str)).map(str::to_owned)
}

impl Reader<'_> {
    /// Replaces each file name in a spectrum parameter by the numbers in the file.
    pub(super) fn load_spectra(&mut self, params: &mut [Param], source: &Source) {
        for param in params.iter_mut().filter(|p| p.ty == Type::Spectrum) {
            let Values::Texts(names) = &param.values else { continue };
            let [name] = &names[..] else { continue };
            if is_named(name) {
                continue;
            }
            let at = Source { line: param.line, ..source.clone() };
            let name = name.clone();
            param.values = self.spectrum_file(&name, &at).map_or(Values::Broken, Values::Numbers);
        }
    }

    fn spectrum_file(&mut self, name: &str, at: &Source) -> Option<Vec<f64>> {
        let path = self.resolve(name);
        match self.files.read(&path) {
            Err(e) if e.kind() == ErrorKind::NotFound => {
                let near = near_name(name).map_or(String::new(), |n| format!("; did you mean \"{n}\"?"));
                self.log.problem(at, format!("spectrum {} is neither known by name nor a file{near}", shown(name)));
                return None;
            }
            // `load` reads the file again and reports the error.
            Err(_) => {
                self.load(&path, at);
                return None;
            }
            Ok(bytes) => match numbers(&bytes) {
                Ok(numbers) => return Some(numbers),
                Err((line, what)) => {
                    let file = std::sync::Arc::new(path);
                    self.log.problem(&Source { file, line }, what);
                }
            },
        }
        None
    }
}

/// Parses all numbers of a text; `#` begins a comment. The error is the line, from 1, and a message.
fn numbers(bytes: &[u8]) -> Result<Vec<f64>, (u32, String)> {
    let mut numbers = Vec::new();
    for (i, line) in bytes.split(|&b| b == b'\n').enumerate() {
        let line_number = i as u32 + 1;
        let content = line.split(|&b| b == b'#').next().unwrap_or_default();
        let text = std::str::from_utf8(content).map_err(|_| (line_number, "this is not UTF-8".to_owned()))?;
        for word in text.split_ascii_whitespace() {
            match word.parse::<f64>() {
                Ok(value) if value.is_finite() => numbers.push(value),
                _ => {
                    let what = format!("{} is not a number; a spectrum file holds wavelengths and values", shown(word));
                    return Err((line_number, what));
                }
            }
        }
    }
    Ok(numbers)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn metals_have_names() {
        assert_eq!(metal("metal-Cu-eta"), Some([0.200_437_7, 0.924_033_4, 1.102_212]));
        assert_eq!(metal("metal-Cu-j"), None);
        assert_eq!(metal("metal-Xx-k"), None);
        assert_eq!(near_name("metal-Cu-etta").as_deref(), Some("metal-Cu-eta"));
        assert!(is_named("glass-BK7") && is_named("stdillum-F11") && !is_named("glass-BK8"));
    }

    #[test]
    fn files_of_numbers() {
        assert_eq!(numbers(b"# gold\n400 1.5\r\n500 2e0 # end\n").unwrap(), [400.0, 1.5, 500.0, 2.0]);
        let (line, what) = numbers(b"400 1\n500 x").unwrap_err();
        assert!(line == 2 && what.contains("\"x\" is not a number"));
        assert!(numbers(b"400 nan").is_err() && numbers(b"\xff").is_err());
    }
}
