//! Colours of light and metals as linear RGB.

use super::params::{Params, Type, Values};
use super::tokens::shown;

/// What numbers a colour may have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Gamut {
    /// Shares: from 0 to 1.
    Reflectance,
    /// From 0 on; a spectrum's name or temperature means light.
    Light,
    /// From 0 on: indices of refraction.
    Unbounded,
}

impl Params {
    /// A constant colour in linear sRGB, if it was given and could be read.
    pub(super) fn rgb(&mut self, name: &'static str, gamut: Gamut) -> Option<[f32; 3]> {
        let param = self.take_typed(name, &[Type::Rgb, Type::Spectrum, Type::Blackbody])?;
        let of = self.of().to_owned();
        match (param.ty, &param.values) {
            (Type::Rgb, Values::Numbers(values)) => {
                let most = if gamut == Gamut::Reflectance { 1.0 } else { f64::from(f32::MAX) };
                if let [r, g, b] = values[..] {
                    if [r, g, b].iter().all(|c| (0.0..=most).contains(c)) {
                        return Some([r as f32, g as f32, b as f32]);
                    }
                    let range = if most == 1.0 { "within 0..=1" } else { "at least 0 and below 3.4e38" };
                    let what = format!("parameter {name} of {of} must be {range} in every channel, not {r} {g} {b}");
                    self.problem(param.line, what);
                } else {
                    let what = format!("parameter {name} of {of} takes 3 numbers, not {}", values.len());
                    self.problem(param.line, what);
                }
            }
            (Type::Blackbody, Values::Numbers(values)) if gamut == Gamut::Light => match values[..] {
                [kelvin] if kelvin > 0.0 => match blackbody(kelvin) {
                    Some(rgb) => return Some(rgb),
                    None => self.problem(param.line, format!("a black body of {kelvin} K does not shine visibly")),
                },
                _ => {
                    self.problem(param.line, format!("parameter {name} of {of} takes one temperature above 0 (kelvin)"))
                }
            },
            (Type::Spectrum, Values::Texts(names)) if names[..] == ["stdillum-D65"] && gamut == Gamut::Light => {
                return Some([1.0; 3]);
            }
            (_, values) => {
                if let Some(value) = constant_spectrum(values, gamut) {
                    return Some([value; 3]);
                }
                let what = match values {
                    Values::Texts(names) => format!("spectrum {}", shown(names.first().map_or("", |n| n))),
                    _ => format!("a sampled spectrum or black body as {name} of {of}"),
                };
                self.unsupported(param.line, what);
            }
        }
        None
    }
}

/// The value of a spectrum given by wavelengths and values that are all the same; not of a light, whose
/// RGB white is not flat.
fn constant_spectrum(values: &Values, gamut: Gamut) -> Option<f32> {
    let Values::Numbers(values) = values else { return None };
    let first = *values.get(1)?;
    let same = values.len() % 2 == 0 && values.chunks_exact(2).all(|pair| pair[1] == first);
    let most = if gamut == Gamut::Reflectance { 1.0 } else { f64::from(f32::MAX) };
    (same && gamut != Gamut::Light && (0.0..=most).contains(&first)).then_some(first as f32)
}

/// Complex indices of refraction as linear RGB: eta, then k.
///
/// The values of the Tungsten renderer's table of conductors [Bitterli 2018], which integrates measured
/// spectra against the CIE observer.
const METALS: &[(&str, [f32; 3], [f32; 3])] = &[
    ("Ag", [0.155_264_65, 0.116_723_3, 0.138_380_7], [4.828_343_4, 3.122_246, 2.147_050_4]),
    ("Al", [1.657_46, 0.880_368_95, 0.521_228_73], [9.223_869, 6.269_523, 4.837_001_3]),
    ("Au", [0.143_118_96, 0.374_957_03, 1.442_478_5], [3.983_160_5, 2.385_720_7, 1.603_215_2]),
    ("Cu", [0.200_437_7, 0.924_033_4, 1.102_212], [3.912_948_5, 2.452_847_7, 2.142_188]),
];

/// The index that a name such as `metal-Cu-eta` stands for.
pub(super) fn metal(name: &str) -> Option<[f32; 3]> {
    let (metal, part) = name.strip_prefix("metal-")?.split_once('-')?;
    let (_, eta, k) = METALS.iter().find(|m| m.0 == metal)?;
    match part {
        "eta" => Some(*eta),
        "k" => Some(*k),
        _ => None,
    }
}

/// Linear sRGB of a black body, scaled to luminance 1, as pbrt-v4 does with lights; colours outside sRGB
/// are clipped. `None` where nothing visible remains.
fn blackbody(kelvin: f64) -> Option<[f32; 3]> {
    /// Planck's second constant h c / k in nm K [CODATA 2018].
    const C2: f64 = 1.438_776_877e7;
    // Exponents relative to 555 nm, since the constant factor is lost anyway and cold bodies underflow.
    let reference = C2 / (555.0 * kelvin);
    let mut xyz = [0.0; 3];
    for wavelength in (360..=830).step_by(5).map(f64::from) {
        let exponent = C2 / (wavelength * kelvin);
        // 1 / (e^x - 1) = e^-x / (1 - e^-x)
        let planck = (reference - exponent).exp() / -(-exponent).exp_m1() / wavelength.powi(5);
        let cie = observer(wavelength);
        (0..3).for_each(|i| xyz[i] += planck * cie[i]);
    }
    let [x, y, z] = xyz.map(|v| v / xyz[1]);
    // XYZ to linear sRGB [IEC 61966-2-1].
    let rgb = [
        3.240_969_942 * x - 1.537_383_178 * y - 0.498_610_760 * z,
        -0.969_243_636 * x + 1.875_967_502 * y + 0.041_555_057 * z,
        0.055_630_080 * x - 0.203_976_959 * y + 1.056_971_514 * z,
    ];
    rgb.iter().all(|c| c.is_finite()).then(|| rgb.map(|c| c.max(0.0) as f32))
}

/// The CIE 1931 observer's three functions, by fits [Wyman et al. 2013, eq. 4 and table 1].
fn observer(wavelength: f64) -> [f64; 3] {
    let lobe = |scale: f64, centre: f64, below: f64, above: f64| {
        let t = (wavelength - centre) / if wavelength < centre { below } else { above };
        scale * (-0.5 * t * t).exp()
    };
    [
        lobe(1.056, 599.8, 37.9, 31.0) + lobe(0.362, 442.0, 16.0, 26.7) + lobe(-0.065, 501.1, 20.4, 26.2),
        lobe(0.821, 568.8, 46.9, 40.5) + lobe(0.286, 530.9, 16.3, 31.1),
        lobe(1.217, 437.0, 11.8, 36.0) + lobe(0.681, 459.0, 26.0, 13.8),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_abs_diff_eq;

    /// Chromaticities of the Planckian locus, from a standard table [CIE 15:2004]: 6500 K is
    /// x = 0.3135, y = 0.3237; 2856 K (illuminant A) is x = 0.4476, y = 0.4074. The fits hold to 0.005.
    #[test]
    fn black_bodies_have_their_colours() {
        for (kelvin, x, y) in [(6500.0, 0.3135, 0.3237), (2856.0, 0.4476, 0.4074)] {
            let [r, g, b] = blackbody(kelvin).unwrap().map(f64::from);
            let big_x = 0.412_390_8 * r + 0.357_584_3 * g + 0.180_480_8 * b;
            let big_y = 0.212_639 * r + 0.715_168_7 * g + 0.072_192_3 * b;
            let big_z = 0.019_330_8 * r + 0.119_194_8 * g + 0.950_532_2 * b;
            assert_abs_diff_eq!(big_y, 1.0, epsilon = 1e-5);
            assert_abs_diff_eq!(big_x / (big_x + big_y + big_z), x, epsilon = 0.005);
            assert_abs_diff_eq!(big_y / (big_x + big_y + big_z), y, epsilon = 0.005);
        }
        assert!(blackbody(1e300).is_some());
        // Cold enough, the exponents overflow; that is refused rather than NaN.
        assert!(blackbody(1e-300).is_none());
    }

    #[test]
    fn metals_have_names() {
        assert_eq!(metal("metal-Cu-eta"), Some([0.200_437_7, 0.924_033_4, 1.102_212]));
        assert_eq!(metal("metal-Cu-j"), None);
        assert_eq!(metal("metal-Xx-k"), None);
    }
}
