//! Radial power spectra of images and of points.

use crate::MetricsError;
use std::f64::consts::TAU;

/// The mean power of a spectrum in a ring of frequencies.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct SpectrumRing {
    /// The mean frequency in the ring: cycles per pixel for an image, cycles per side of the square for points.
    pub frequency: f64,
    /// The mean power. White noise and independent points have 1.
    pub power: f64,
    /// The number of frequencies in the ring; those that mirror one another count once.
    pub count: usize,
}

/// The radial power spectrum of one channel of an image, without its mean.
///
/// Rings are `1 / max(width, height)` cycles per pixel wide, and end at 1/2, the Nyquist frequency along an axis. The power
/// is that of the discrete Fourier transform over `pixels * variance`, so that white noise has 1 in each ring. An image
/// of one value has power 0.
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
    if size.contains(&0) {
        return Err(MetricsError::Empty { size });
    }
    if u64::from(size[0]) * u64::from(size[1]) != values.len() as u64 {
        return Err(MetricsError::PixelCount { size, found: values.len() });
    }
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

/// The radial power spectrum of points on the unit square as a torus, up to `most` cycles per side.
///
/// The power at the whole frequency `f` is `|sum exp(-2 pi i f x)|^2 / n`, so that independent points have an expected
/// power of 1. Rings are one cycle wide. Takes `O(n most^2)` steps. Returns no rings without points.
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
    /// Frequency, power and count of each ring, summed. Ring `k` is about `(k + 1) * width`.
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

#[cfg(test)]
mod tests {
    use super::*;

    fn white(n: u64, seed: u64) -> Vec<f64> {
        let unit = |k: u64| {
            let mut z = (seed << 32 | k).wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
            (z >> 11) as f64 / (1_u64 << 53) as f64
        };
        (0..n).map(unit).collect()
    }

    /// The largest deviation of a ring from 1, in standard errors. Powers are exponentially distributed, so a ring's mean
    /// has a relative standard error of `1 / sqrt(count)`.
    fn deviation(rings: &[SpectrumRing]) -> f64 {
        rings.iter().map(|ring| (ring.power - 1.0).abs() * (ring.count as f64).sqrt()).fold(0.0, f64::max)
    }

    /// About 30 rings. Rings of few frequencies have long tails, hence 6; a gradient, the negative control, is far beyond.
    #[test]
    fn white_noise_is_flat_and_a_gradient_is_not() {
        for (size, seed) in [([64, 64], 1), ([48, 80], 2), ([33, 57], 3)] {
            let values = white(u64::from(size[0] * size[1]), seed);
            let rings = image_spectrum(size, &values).expect("sizes match");
            assert!(rings.len() >= 28 && deviation(&rings) < 6.0, "{size:?}: {:.1}", deviation(&rings));
            let gradient: Vec<f64> =
                values.iter().enumerate().map(|(p, v)| v + (p % size[0] as usize) as f64 * 0.05).collect();
            let rings = image_spectrum(size, &gradient).expect("sizes match");
            assert!(deviation(&rings) > 30.0, "the control is flat");
        }
    }

    /// Each pixel less the mean of its four neighbours: a known filter, `(1 - (cos 2 pi fx + cos 2 pi fy) / 2)^2`, which
    /// empties low frequencies. Over `1 + 4/16`, the variance of the sum.
    #[test]
    fn a_high_pass_filter_empties_low_frequencies() {
        let side = 96_usize;
        let values = white((side * side) as u64, 5);
        let at = |x: usize, y: usize| values[y % side * side + x % side];
        let sharp = |x: usize, y: usize| {
            at(x, y) - 0.25 * (at(x + 1, y) + at(x + side - 1, y) + at(x, y + 1) + at(x, y + side - 1))
        };
        let filtered: Vec<f64> = (0..side * side).map(|p| sharp(p % side, p / side)).collect();
        let rings = image_spectrum([side as u32; 2], &filtered).expect("sizes match");
        for ring in rings.iter().filter(|ring| ring.count > 50) {
            // The filter's mean over angles, by 64 directions.
            let response = |k: u32| {
                let angle = TAU * f64::from(k) / 64.0;
                let [x, y] = [angle.cos(), angle.sin()].map(|c| (TAU * ring.frequency * c).cos());
                (1.0 - 0.5 * (x + y)).powi(2)
            };
            let wanted = (0..64).map(response).sum::<f64>() / 64.0 / 1.25;
            let error = (ring.power / wanted - 1.0) * (ring.count as f64).sqrt();
            assert!(error.abs() < 6.0, "{}: {} {wanted}", ring.frequency, ring.power);
        }
        assert!(rings.iter().take(5).all(|ring| ring.power < 0.01));
    }

    /// The sum over all frequencies is the number of pixels, by Parseval; in a strip of 1 pixel all are in rings.
    #[test]
    fn the_power_of_a_strip_sums_to_its_pixels() {
        let rings = image_spectrum([1, 64], &white(64, 9)).expect("sizes match");
        // Frequencies from 1/64 to 1/2; all but the last have a mirror image.
        let sum: f64 = rings.iter().map(|ring| ring.power * if ring.frequency < 0.5 { 2.0 } else { 1.0 }).sum();
        assert!(rings.len() == 32 && (sum - 64.0).abs() < 1e-9, "{} {sum}", rings.len());
    }

    /// Independent points are flat; jittered points of an m x m grid have `1 - sinc^2(fx/m) sinc^2(fy/m)` expected.
    #[test]
    fn spectra_of_random_and_of_jittered_points_are_the_known_ones() {
        let side = 24_usize;
        let mut jittered = vec![0.0; 20];
        let mut wanted = [0.0; 20];
        let random: Vec<[f64; 2]> = white(1152, 3).chunks_exact(2).map(|c| [c[0], c[1]]).collect();
        let rings = point_spectrum(&random, 20);
        assert!(deviation(&rings) < 6.0, "{:.1}", deviation(&rings));
        for seed in 0..8 {
            let values = white(1152, 20 + seed);
            let place = |p: usize, k: usize| ([p % side, p / side][k] as f64 + values[2 * p + k]) / side as f64;
            let points: Vec<[f64; 2]> = (0..side * side).map(|p| [place(p, 0), place(p, 1)]).collect();
            for (ring, sum) in point_spectrum(&points, 20).iter().zip(&mut jittered) {
                *sum += ring.power / 8.0;
            }
        }
        for (k, wanted) in wanted.iter_mut().enumerate() {
            let sinc = |c: f64| {
                let x = std::f64::consts::PI * c / side as f64;
                if x == 0.0 { 1.0 } else { x.sin() / x }
            };
            let direction = |d: u32| {
                let angle = TAU * f64::from(d) / 64.0;
                1.0 - (sinc((k + 1) as f64 * angle.cos()) * sinc((k + 1) as f64 * angle.sin())).powi(2)
            };
            *wanted = (0..64).map(direction).sum::<f64>() / 64.0;
        }
        for k in 2..20 {
            assert!((jittered[k] / wanted[k] - 1.0).abs() < 0.25, "{k}: {} {}", jittered[k], wanted[k]);
        }
        assert!(jittered[1] < 0.06 && wanted[19] > 0.5);
    }
}
