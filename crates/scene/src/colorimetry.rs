//! Conversion of spectra to linear RGB.

use glam::{DMat3, DVec3, DVec4, dvec3};
use std::sync::LazyLock;

/// The first wavelength of the table and the step between its lines, in nm.
const FIRST: f64 = 380.0;
const STEP: f64 = 10.0;

/// The colour-matching functions x, y, z of the CIE 1931 observer [CIE 15:2004, table T.4] and the relative spectral
/// power of illuminant D65 [table T.1], by wavelength from 380 to 780 nm.
static TABLE: LazyLock<Vec<DVec4>> = LazyLock::new(|| {
    let value = |line: &str, k| line.split('\t').nth(k).and_then(|value| value.parse().ok()).unwrap_or(f64::NAN);
    include_str!("observer.tsv").lines().map(|line| DVec4::from_array([0, 1, 2, 3].map(|k| value(line, k)))).collect()
});

/// Converts XYZ to linear sRGB [IEC 61966-2-1] without clipping.
pub(crate) fn rgb_of_xyz(xyz: DVec3) -> DVec3 {
    DMat3::from_cols_array_2d(&[
        [3.240_969_942, -0.969_243_636, 0.055_630_080],
        [-1.537_383_178, 1.875_967_502, -0.203_976_959],
        [-0.498_610_760, 0.041_555_057, 1.056_971_514],
    ]) * xyz
}

/// Returns the observer's x, y, z and the power of D65 at a wavelength in nm, interpolated linearly; 0 outside of the
/// table.
fn table_at(wavelength: f64) -> DVec4 {
    let place = (wavelength - FIRST) / STEP;
    if !(0.0..=(TABLE.len() - 1) as f64).contains(&place) {
        return DVec4::ZERO;
    }
    let below = (place as usize).min(TABLE.len() - 2);
    let (from, to, part) = (TABLE[below], TABLE[below + 1], place - below as f64);
    from.truncate().lerp(to.truncate(), part).extend(from.w + (to.w - from.w) * part)
}

/// Returns the CIE XYZ of `spectrum` under D65 or, if `under_d65` is false, under equal energy. The result is divided
/// by the illuminant's Y.
fn xyz(spectrum: impl Fn(f64) -> f64, under_d65: bool) -> DVec3 {
    let (mut sum, mut whole) = (DVec3::ZERO, 0.0);
    for step in 0..=4 * (TABLE.len() as u32 - 1) {
        let wavelength = FIRST + f64::from(step) * STEP / 4.0;
        let (observer, d65) = (table_at(wavelength).truncate(), table_at(wavelength).w);
        let weight = if under_d65 { d65 } else { 1.0 };
        sum += observer * (weight * spectrum(wavelength));
        whole += weight * observer.y;
    }
    sum / whole
}

/// A sampled spectrum: pairs of wavelength (nm) and value, linear between wavelengths and constant beyond the first and the
/// last.
#[derive(Clone, Debug)]
pub(crate) struct Sampled {
    pairs: Vec<[f64; 2]>,
}

impl Sampled {
    /// Makes a spectrum from alternating wavelengths (nm) and values.
    ///
    /// # Errors
    /// Returns a message to be read after the parameter's name.
    pub(crate) fn new(numbers: &[f64]) -> Result<Self, String> {
        let (pairs, rest) = numbers.as_chunks::<2>();
        if pairs.is_empty() || !rest.is_empty() {
            return Err(format!("takes pairs of wavelength and value, not {} numbers", numbers.len()));
        }
        if let Some(w) = pairs.windows(2).find(|w| w[0][0] >= w[1][0]) {
            return Err(format!("takes increasing wavelengths, not {} after {}", w[1][0], w[0][0]));
        }
        if pairs[0][0] <= 0.0 {
            return Err(format!("takes wavelengths above 0 nm, not {}", pairs[0][0]));
        }
        Ok(Self { pairs: pairs.to_vec() })
    }

    /// Returns the spectrum's value if it is equal at all wavelengths, else `None`.
    pub(crate) fn constant(&self) -> Option<f64> {
        let [_, value] = self.pairs[0];
        self.pairs.iter().all(|p| p[1] == value).then_some(value)
    }

    /// Returns the spectrum's smallest value.
    pub(crate) fn least(&self) -> f64 {
        self.pairs.iter().fold(f64::INFINITY, |least, p| least.min(p[1]))
    }

    /// Returns the spectrum's value at a wavelength in nm.
    pub(crate) fn at(&self, wavelength: f64) -> f64 {
        let above = self.pairs.partition_point(|p| p[0] <= wavelength);
        match (above.checked_sub(1).map(|i| self.pairs[i]), self.pairs.get(above)) {
            (Some([x0, y0]), Some(&[x1, y1])) => y0 + (y1 - y0) * ((wavelength - x0) / (x1 - x0)),
            (Some([_, y]), None) | (None, Some(&[_, y])) => y,
            (None, None) => 0.0,
        }
    }

    /// Returns the linear sRGB colour of a reflectance spectrum under D65. A constant spectrum is gray.
    pub(crate) fn rgb_under_d65(&self) -> DVec3 {
        // At this step the white of the tables is off by 0.3 % in blue. The division removes the error.
        rgb_of_xyz(xyz(|w| self.at(w), true)) / rgb_of_xyz(xyz(|_| 1.0, true))
    }

    /// Returns the linear sRGB colour of the spectrum without an illuminant (equal energy), as in pbrt-v2 and v3. The
    /// metals in `pbrt/spectra.rs` were converted in this way.
    pub(crate) fn rgb(&self) -> DVec3 {
        rgb_of_xyz(xyz(|w| self.at(w), false))
    }

    /// Returns the linear sRGB colour of the spectrum as light, scaled to luminance 1; `None` if the spectrum has no
    /// visible part.
    pub(crate) fn rgb_of_luminance_one(&self) -> Option<DVec3> {
        let xyz = xyz(|w| self.at(w), false);
        let rgb = rgb_of_xyz(xyz / xyz.y);
        (xyz.y > 0.0 && rgb.is_finite()).then_some(rgb)
    }
}

/// Returns the linear sRGB colour of light with CIE chromaticity `x, y` and luminance 1.
pub(crate) fn rgb_of_chromaticity([x, y]: [f64; 2]) -> DVec3 {
    rgb_of_xyz(dvec3(x / y, 1.0, (1.0 - x - y) / y))
}

/// Returns the linear sRGB colour of a black body at a temperature in kelvin, scaled to luminance 1. Channels may be
/// negative. `None` if it emits no visible light.
pub(crate) fn blackbody(kelvin: f64) -> Option<DVec3> {
    // The division by Y removes the factor of `planck`, which keeps cold bodies from underflow.
    let xyz = xyz(|wavelength| planck(wavelength, kelvin, 555.0), false);
    let rgb = rgb_of_xyz(xyz / xyz.y);
    rgb.is_finite().then_some(rgb)
}

/// Returns the linear sRGB colour of a black body at a temperature in kelvin, scaled to a spectral maximum of 1, as in
/// pbrt-v3. `None` if the colour is not finite.
pub(crate) fn blackbody_of_peak_one(kelvin: f64) -> Option<DVec3> {
    /// Wien's displacement constant in nm K [CODATA 2018].
    const WIEN: f64 = 2.897_771_955e6;
    let peak = WIEN / kelvin;
    let top = planck(peak, kelvin, peak);
    let rgb = rgb_of_xyz(xyz(|wavelength| planck(wavelength, kelvin, peak) / top, false));
    rgb.is_finite().then_some(rgb)
}

/// Returns Planck's spectral radiance at a wavelength in nm, up to a factor that depends only on the temperature and on
/// `reference` (nm).
fn planck(wavelength: f64, kelvin: f64, reference: f64) -> f64 {
    /// Planck's second constant h c / k in nm K [CODATA 2018].
    const C2: f64 = 1.438_776_877e7;
    let exponent = C2 / (wavelength * kelvin);
    // 1 / (e^x - 1) = e^-x / (1 - e^-x)
    (C2 / (reference * kelvin) - exponent).exp() / -(-exponent).exp_m1() / wavelength.powi(5)
}
