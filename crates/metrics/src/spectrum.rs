//! Radial power spectra of images and of points.

use crate::{MetricsError, check_count};
use std::f64::consts::TAU;

/// The mean power of a spectrum in a ring of frequencies.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct SpectrumRing {
    /// The mean frequency in the ring: cycles per pixel for an image, cycles per side of the square for points.
    pub frequency: f64,
    /// The mean power; 1 for white noise and for independent points.
    pub power: f64,
    /// The number of frequencies in the ring. Of each pair `f` and `-f`, only one is included.
    pub count: usize,
}

/// The radial power spectrum of one channel of an image. The mean of the channel is subtracted first.
///
/// Rings are `1 / max(width, height)` cycles per pixel wide, and end at 1/2, the Nyquist frequency along an axis. The power
/// is `|F|^2 / (pixels * variance)`, where `F` is the discrete Fourier transform. It is 1 for white noise, and 0 for a
/// constant image.
///
/// Takes `O(pixels * (width + height))` steps.
///
/// ```
/// use dapple_metrics::image_spectrum;
///
/// // A checkerboard has all its power at half a cycle per pixel along both axes, beyond all rings.
/// let values: Vec<f64> = (0..16 * 16).map(|p| f64::from((p % 16 + p / 16) % 2)).collect();
/// assert!(image_spectrum([16, 16], &values)?.iter().all(|ring| ring.power < 1e-20));
/// # Ok::<(), dapple_metrics::MetricsError>(())
/// ```
///
/// # Errors
/// [`MetricsError::Empty`] if a side is 0; [`MetricsError::PixelCount`] if `values` has another length.
pub fn image_spectrum(size: [u32; 2], values: &[f64]) -> Result<Vec<SpectrumRing>, MetricsError> {
    check_count(size, values.len())?;
    let [width, height] = size.map(|side| side as usize);
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let total: f64 = values.iter().map(|v| (v - mean) * (v - mean)).sum();
    // Along rows, then along columns.
    let complex: Vec<[f64; 2]> = values.iter().map(|v| [v - mean, 0.0]).collect();
    let rows: Vec<[f64; 2]> = complex.chunks_exact(width).flat_map(transform).collect();
    let mut rings = Rings::new(1.0 / width.max(height) as f64, 0.5);
    for u in 0..width {
        let column: Vec<[f64; 2]> = (0..height).map(|y| rows[y * width + u]).collect();
        for (v, [re, im]) in transform(&column).into_iter().enumerate() {
            let signed = |k: usize, n: usize| if 2 * k > n { k as f64 - n as f64 } else { k as f64 } / n as f64;
            let [fx, fy] = [signed(u, width), signed(v, height)];
            // Half of the plane: the other half mirrors it.
            if fy > 0.0 || fy == 0.0 && fx > 0.0 {
                let power = if total > 0.0 { (re * re + im * im) / total } else { 0.0 };
                rings.add([fx, fy], power);
            }
        }
    }
    Ok(rings.finish())
}

/// The radial power spectrum of points in the unit square, repeated periodically, up to `most` cycles per side.
///
/// The power at the integer frequency `f` is `|sum exp(-2 pi i f x)|^2 / n`, so that independent points have an expected
/// power of 1. Rings are one cycle wide. Takes `O(n most^2)` steps. Returns no rings if there are no points.
///
/// ```
/// use dapple_metrics::point_spectrum;
///
/// // A grid of 4 x 4 points has no power but at multiples of 4 cycles.
/// let grid: Vec<[f64; 2]> = (0..16).map(|p| [f64::from(p % 4) / 4.0, f64::from(p / 4) / 4.0]).collect();
/// let rings = point_spectrum(&grid, 3);
/// assert!(rings.len() == 3 && rings.iter().all(|ring| ring.power < 1e-20));
/// ```
pub fn point_spectrum(points: &[[f64; 2]], most: u32) -> Vec<SpectrumRing> {
    if points.is_empty() {
        return Vec::new();
    }
    let most = most as usize;
    // Powers of exp(-2 pi i x) and of exp(-2 pi i y) of each point, from 0 to `most`.
    let powers = |x: f64| -> Vec<[f64; 2]> { (0..=most).map(|k| turn(x * k as f64)).collect() };
    let tables: Vec<[Vec<[f64; 2]>; 2]> = points.iter().map(|[x, y]| [powers(*x), powers(*y)]).collect();
    let mut rings = Rings::new(1.0, most as f64 + 0.5);
    for v in 0..=most {
        for u in -(most as i64)..=most as i64 {
            if v == 0 && u <= 0 {
                continue;
            }
            let mut sum = [0.0; 2];
            for [along_x, along_y] in &tables {
                let [re, im] = along_x[u.unsigned_abs() as usize];
                let [a, b] = [[re, if u < 0 { -im } else { im }], along_y[v]];
                sum[0] += a[0] * b[0] - a[1] * b[1];
                sum[1] += a[0] * b[1] + a[1] * b[0];
            }
            rings.add([u as f64, v as f64], (sum[0] * sum[0] + sum[1] * sum[1]) / points.len() as f64);
        }
    }
    rings.finish()
}

/// `exp(-2 pi i turns)`.
fn turn(turns: f64) -> [f64; 2] {
    let angle = -TAU * (turns - libm::floor(turns));
    [libm::cos(angle), libm::sin(angle)]
}

/// The discrete Fourier transform.
fn transform(values: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let n = values.len();
    let roots: Vec<[f64; 2]> = (0..n).map(|k| turn(k as f64 / n as f64)).collect();
    let at = |frequency: usize| {
        let mut sum = [0.0; 2];
        for (place, [re, im]) in values.iter().enumerate() {
            let [cos, sin] = roots[frequency * place % n];
            sum[0] += re * cos - im * sin;
            sum[1] += re * sin + im * cos;
        }
        sum
    };
    (0..n).map(at).collect()
}

/// Sums over rings of frequencies.
struct Rings {
    width: f64,
    end: f64,
    /// Sums of frequency, power and count in each ring. Ring `k` lies at about `(k + 1) * width`.
    sums: Vec<[f64; 3]>,
}

impl Rings {
    fn new(width: f64, end: f64) -> Self {
        Self { width, end, sums: Vec::new() }
    }

    fn add(&mut self, [x, y]: [f64; 2], power: f64) {
        let frequency = (x * x + y * y).sqrt();
        if frequency > self.end {
            return;
        }
        let ring = (frequency / self.width + 0.5) as usize;
        let ring = ring.saturating_sub(1);
        if self.sums.len() <= ring {
            self.sums.resize(ring + 1, [0.0; 3]);
        }
        self.sums[ring] = [self.sums[ring][0] + frequency, self.sums[ring][1] + power, self.sums[ring][2] + 1.0];
    }

    fn finish(self) -> Vec<SpectrumRing> {
        let filled = self.sums.into_iter().filter(|sums| sums[2] > 0.0);
        filled.map(|[f, p, n]| SpectrumRing { frequency: f / n, power: p / n, count: n as usize }).collect()
    }
}
