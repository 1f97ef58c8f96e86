//! Errors that are blue noise over the image, for any point set.

use crate::keys::{Seed, nth_key};
use crate::void_and_cluster::{PIXELS, SIDE, tile};
use dapple_core::{PointSet, SampleId};

/// A decorator that makes the errors of neighbouring pixels differ [after Georgiev 2016].
///
/// All pixels of a tile of 128 x 128 pixels share one sequence of the inner point set. Each pixel adds its own shift to
/// each coordinate, modulo 1 [Cranley 1976]. The shifts are a tile of blue noise, made by void and cluster
/// [Ulichney 1993]. So pixels that look alike have different errors, and the error has little energy at low frequencies.
///
/// Each coordinate, stream and tile reads the blue noise at an offset of its own.
///
/// ```
/// use dapple_core::{PointSet, SampleId};
/// use dapple_low_discrepancy::{BlueNoise, Sobol};
///
/// let points = BlueNoise::new(7, Sobol::new(7));
/// assert!(points.couples_pixels());
/// let [x, y, ..] = points.block(SampleId::new([3, 4], 0, 5), 0);
/// assert!((0.0..1.0).contains(&x) && (0.0..1.0).contains(&y));
/// ```
///
/// # Limits
///
/// * The error's sum of squares does not fall; only its place in the spectrum changes. Filters and eyes gain.
/// * A shift breaks nets at the border of the square. On a product `x y` of 64 samples, shifted Sobol' points have more
///   error than scrambled ones.
/// * The gain falls with the number of samples, and with the number of coordinates that matter.
/// * Adaptive counts differ between pixels, and pixels of different counts do not share their errors.
/// * The tiles' borders are seams: pixels on either side are independent.
/// * Scrambling keys keep nets whole: see [`BlueNoiseKeys`](crate::BlueNoiseKeys).
///
/// Name: `blue-noise`. Parameters: `seed`, `of` (the inner point set).
#[derive(Clone, Copy, Debug)]
pub struct BlueNoise<P> {
    seed: Seed,
    inner: P,
}

impl<P: PointSet> BlueNoise<P> {
    /// Distributes the errors of `inner` as blue noise.
    pub fn new(seed: u64, inner: P) -> Self {
        Self { seed: Seed::new(seed), inner }
    }
}

/// The batch number of the tile's keys, which no inner point set of the same seed uses before sample 2^63.
const TILES: u64 = u64::MAX;

impl<P: PointSet> PointSet for BlueNoise<P> {
    fn describe(&self) -> String {
        format!("blue-noise:seed={},of={}", self.seed.given(), self.inner.describe())
    }

    fn block(&self, id: SampleId, block: u32) -> [f32; 4] {
        let mut shared = id;
        shared.pixel = id.pixel.map(|c| c / SIDE as u32);
        let place = id.pixel.map(|c| c as usize % SIDE);
        let key = self.seed.key(&shared, block, TILES);
        let ranks = tile();
        let inner = self.inner.block(shared, block);
        std::array::from_fn(|k| {
            let offset = nth_key(key, k as u64);
            let x = (place[0] + offset as usize) % SIDE;
            let y = (place[1] + (offset >> 32) as usize) % SIDE;
            shifted(inner[k], ranks[y * SIDE + x])
        })
    }

    fn capacity(&self) -> u64 {
        self.inner.capacity()
    }

    fn preferred_count(&self, n: u64) -> u64 {
        self.inner.preferred_count(n)
    }

    fn is_independent(&self) -> bool {
        self.inner.is_independent()
    }

    fn couples_pixels(&self) -> bool {
        true
    }
}

/// The coordinate `u` moved by `rank / PIXELS`, modulo 1. All 24 bits stay exact.
#[inline]
fn shifted(u: f32, rank: u16) -> f32 {
    const ONE: u32 = 1 << 24;
    let sum = (u * ONE as f32) as u32 + u32::from(rank) * (ONE / PIXELS as u32);
    (sum % ONE) as f32 * (1.0 / ONE as f32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Random, Sobol};

    /// The mean square of an image's means over blocks of 4 x 4 pixels, over that of the image. It is 1/16 for white
    /// noise.
    fn low_energy(points: &dyn PointSet, spp: u64, f: fn(f64, f64) -> f64, mean: f64) -> f64 {
        let side = 128_u32;
        let error = |x: u32, y: u32| {
            let value = |index| {
                let [a, b, ..] = points.block(SampleId::new([x, y], 0, index), 1).map(f64::from);
                f(a, b) - mean
            };
            (0..spp).map(value).sum::<f64>() / spp as f64
        };
        let errors: Vec<f64> = (0..side * side).map(|p| error(p % side, p / side)).collect();
        let block = |b: usize| {
            let places = (0..16).map(|k| (b / 32 * 4 + k / 4) * 128 + b % 32 * 4 + k % 4);
            (places.map(|p| errors[p]).sum::<f64>() / 16.0).powi(2)
        };
        let blocks = (0..1024).map(block).sum::<f64>() / 1024.0;
        blocks / (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64)
    }

    /// Of 1024 blocks, white noise has 1/16 with a standard error of 4 %.
    #[test]
    fn errors_have_little_energy_at_low_frequencies() {
        let disk = |x: f64, y: f64| f64::from(u8::from(x * x + y * y < 1.0));
        let ramp = |x: f64, _: f64| x;
        let quarter = std::f64::consts::FRAC_PI_4;
        for (what, f, mean, spp, most) in [
            ("ramp", ramp as fn(f64, f64) -> f64, 0.5, 1, 0.3),
            ("ramp", ramp, 0.5, 4, 0.4),
            ("disk", disk, quarter, 1, 0.8),
        ] {
            let blue = 16.0 * low_energy(&BlueNoise::new(3, Sobol::new(3)), spp, f, mean);
            let white = 16.0 * low_energy(&Sobol::new(3), spp, f, mean);
            assert!(blue < most, "{what}, {spp} spp: {blue:.3} of white noise");
            assert!((white - 1.0).abs() < 0.2, "{what}, {spp} spp: the control has {white:.3}");
        }
    }

    #[test]
    fn shifts_are_exact_and_stay_below_one() {
        assert_eq!(shifted(0.25, 0), 0.25);
        assert_eq!(shifted(0.75, (PIXELS / 2) as u16), 0.25);
        assert_eq!(shifted(1.0 - 1.0 / 16_777_216.0, 0), 1.0 - 1.0 / 16_777_216.0);
        assert_eq!(
            shifted(1.0 - 1.0 / 16_777_216.0, (PIXELS - 1) as u16),
            ((PIXELS - 1) * 1024 - 1) as f32 / 16_777_216.0
        );
    }

    #[test]
    fn independence_is_that_of_the_inner_set() {
        assert!(
            BlueNoise::new(0, Random::new(0)).is_independent() && !BlueNoise::new(0, Sobol::new(0)).is_independent()
        );
    }
}
