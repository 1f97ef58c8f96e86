//! The sRGB transfer curve and 8-bit PNG files, by IEEE-exact operations only, so that results are bitwise the same on
//! every machine.

use super::{Image, ImageError, check_count};
use ::image::codecs::png::{CompressionType, FilterType, PngEncoder};
use ::image::{ExtendedColorType, ImageEncoder};

/// Encodes an image as an 8-bit sRGB PNG file, after multiplying it by `2^exposure_stops`.
///
/// With v a channel times `2^exposure_stops` in f64: NaN, negative values and -∞ become 0; 1, larger values and +∞
/// become 255; all others become `255 * srgb(v)` rounded to nearest. There is no dithering and no tone curve. The same
/// input gives the same bytes on every machine.
///
/// # Errors
/// [`ImageError::Empty`] if a side is 0, [`ImageError::PixelCount`] if the number of pixels is not width times height,
/// [`ImageError::Exposure`] for stops that are not finite.
pub fn encode_png(image: &Image, exposure_stops: f32) -> Result<Vec<u8>, ImageError> {
    check_count(image.size, image.pixels.len())?;
    if !exposure_stops.is_finite() {
        return Err(ImageError::Exposure(exposure_stops));
    }
    let factor = exp2(f64::from(exposure_stops));
    let quantizer = Quantizer::new();
    let bytes: Vec<u8> = image.pixels.iter().flatten().map(|&v| quantizer.byte(f64::from(v) * factor)).collect();
    encode(image.size, &bytes, ExtendedColorType::Rgb8)
}

/// Encodes a gray PNG file from one byte per pixel, top row first. The bytes are stored without conversion.
///
/// # Errors
/// [`ImageError::Empty`] if a side is 0, [`ImageError::PixelCount`] if the number of values is not width times height.
pub fn encode_png_gray(size: [u32; 2], values: &[u8]) -> Result<Vec<u8>, ImageError> {
    check_count(size, values.len())?;
    encode(size, values, ExtendedColorType::L8)
}

/// Encodes an RGB PNG file from three bytes per pixel, top row first. The bytes are stored without conversion.
///
/// # Errors
/// [`ImageError::Empty`] if a side is 0, [`ImageError::PixelCount`] if the number of values is not width times height.
pub fn encode_png_rgb(size: [u32; 2], values: &[[u8; 3]]) -> Result<Vec<u8>, ImageError> {
    check_count(size, values.len())?;
    encode(size, values.as_flattened(), ExtendedColorType::Rgb8)
}

fn encode(size: [u32; 2], bytes: &[u8], color: ExtendedColorType) -> Result<Vec<u8>, ImageError> {
    let mut file = Vec::new();
    PngEncoder::new_with_quality(&mut file, CompressionType::Default, FilterType::Adaptive)
        .write_image(bytes, size[0], size[1], color)
        .map_err(|e| ImageError::Encode(format!("PNG: {e}; write an EXR file")))?;
    Ok(file)
}

/// A converter of linear values to sRGB bytes. It searches among exact thresholds, which is faster than the sRGB curve
/// and rounds exactly.
struct Quantizer {
    /// The smallest linear values that become the bytes 1, 2, ..., 255.
    borders: Vec<f64>,
}

impl Quantizer {
    fn new() -> Self {
        Self { borders: (1..256).map(|k| srgb_decode((f64::from(k) - 0.5) / 255.0)).collect() }
    }

    fn byte(&self, linear: f64) -> u8 {
        // No border is <= NaN, so that NaN becomes 0.
        self.borders.partition_point(|&border| border <= linear) as u8
    }
}

/// Returns `2^x` for finite `x` by IEEE-exact operations; libm's result differs between platforms.
fn exp2(x: f64) -> f64 {
    let x = x.clamp(-2000.0, 2000.0);
    let whole = x.floor();
    let t = (x - whole) * std::f64::consts::LN_2;
    // Horner's scheme of the exponential series; t < 0.7, so 18 terms leave less than 1e-18.
    let fraction = (1..=18).rev().fold(1.0, |sum, k| 1.0 + sum * t / f64::from(k));
    fraction * 2.0_f64.powi(whole as i32)
}

/// Returns the linear intensity of an sRGB value in 0..=1 [IEC 61966-2-1]. Values outside are clamped; NaN becomes 0.
pub fn srgb_decode(encoded: f64) -> f64 {
    let s = unit(encoded);
    if s <= 0.04045 {
        return s / 12.92;
    }
    // x^2.4 = x^2 * (x^(1/5))^2
    let x = (s + 0.055) / 1.055;
    let fifth_root = root::<5>(x);
    x * x * fifth_root * fifth_root
}

/// Returns the sRGB value of a linear intensity in 0..=1 [IEC 61966-2-1]. Values outside are clamped; NaN becomes 0.
pub fn srgb_encode(linear: f64) -> f64 {
    let x = unit(linear);
    if x <= 0.003_130_8 {
        return 12.92 * x;
    }
    // 1.055 - 0.055 is not 1 in f64.
    if x == 1.0 {
        return 1.0;
    }
    // x^(1/2.4) = x^(5/12)
    let twelfth_root = root::<3>(x.sqrt().sqrt());
    1.055 * twelfth_root.powi(5) - 0.055
}

/// Returns `x` clamped to 0..=1; NaN becomes 0.
fn unit(x: f64) -> f64 {
    if x.is_nan() { 0.0 } else { x.clamp(0.0, 1.0) }
}

/// Returns the `N`th root of `x` in [0.08, 1], by Newton's iteration from above. libm's `pow` differs between
/// platforms.
fn root<const N: i32>(x: f64) -> f64 {
    let n = f64::from(N);
    let mut y = (x + n - 1.0) / n;
    for _ in 0..6 {
        y -= (y - x / y.powi(N - 1)) / n;
    }
    y
}
