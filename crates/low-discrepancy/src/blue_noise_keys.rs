//! Errors that are blue noise over the image, from nets that stay whole.

use crate::keys::{Seed, halves, nth_key, unit};
use crate::optimised_keys::{BITS, SIDE, sequence, tile};
use crate::sobol::owen_reversed;
use dapple_core::{PointSet, SampleId};

/// Sobol' points whose errors differ between neighbouring pixels, by optimised scrambling keys [after Heitz et al. 2019].
///
/// All pixels of a tile of 64 x 64 pixels share one Owen-scrambled Sobol' pair sequence. Each pixel has its own key for
/// each coordinate, and takes the exclusive or of both. That keeps every net whole.
///
/// The upper 6 bits of the two keys come from a tile in which each of the 4096 combinations occurs once. Swaps of keys
/// between pixels make the integration errors of neighbours as different as possible, at 1, 2, 4, 8 and 16 samples
/// together. The lower bits are random. Each pair, block, stream and tile reads the tile of keys at an offset of its own,
/// so each pixel's samples are uniform.
///
/// ```
/// use dapple_core::{PointSet, SampleId};
/// use dapple_low_discrepancy::BlueNoiseKeys;
///
/// let points = BlueNoiseKeys::new(7);
/// assert!(points.couples_pixels());
/// let [x, y, ..] = points.block(SampleId::new([3, 4], 0, 5), 0);
/// assert!((0.0..1.0).contains(&x) && (0.0..1.0).contains(&y));
/// ```
///
/// # Precision
///
/// Energy of the error at low frequencies (means over 4 x 4 pixels), over that of independent [`Sobol`](crate::Sobol)
/// pixels. Neither integrand is among those of the optimisation:
///
/// | samples | half-plane | shifted instead | `x y` | shifted instead |
/// |---|---|---|---|---|
/// | 1 | 0.38 | 0.42 | 0.32 | 0.40 |
/// | 2 | 0.58 | 1.13 | 0.45 | 0.80 |
/// | 4 | 0.48 | 1.09 | 0.13 | 2.1 |
/// | 8 | 0.56 | 0.89 | 0.29 | 4.3 |
/// | 16 | 0.80 | 1.59 | 0.42 | 11 |
///
/// The mean square over single pixels is 0.24 to 1.4 of that of independent pixels, since all share one scramble. At 16
/// samples of `x y` it is a nineteenth of that of shifted points ([`BlueNoise`](crate::BlueNoise)).
///
/// # Differences from the publication
///
/// * The test integrands are 48 cosine waves with the power spectrum of random half-planes. In a trial with 64 waves or
///   64 half-planes, other half-planes kept 0.62 or 0.72 of their low-frequency energy at 16 samples.
/// * There are no ranking keys, exclusive ors of the sample index. Chosen to suit the scrambling keys, they would make a
///   pixel's first samples uneven. All counts are optimised together instead.
/// * Two coordinates are optimised, and all pairs use the same tile.
///
/// A second paper of that year permutes the pixels' seeds between frames [Heitz and Belcour 2019]. It has a frame that the
/// seeds made before; a still image has none, so it is not built.
///
/// # Limits
///
/// * From 32 samples on, smooth integrands gain nothing and edges little.
/// * Adaptive counts differ between pixels, and pixels of different counts do not share their errors.
/// * The tiles' borders are seams: pixels on either side are independent.
/// * All pairs share the scramble. At 2 samples, integrands across pairs have up to 1.5x the squared error.
/// * The first of these point sets in a process takes about half a second.
///
/// Name: `blue-noise` with `keys=optimised`. Parameters: `seed`.
#[derive(Clone, Copy)]
pub struct BlueNoiseKeys {
    seed: Seed,
    keys: &'static [u16],
}

/// Without the keys.
impl std::fmt::Debug for BlueNoiseKeys {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("BlueNoiseKeys").field("seed", &self.seed).finish_non_exhaustive()
    }
}

impl BlueNoiseKeys {
    /// Makes the point set of a seed. The first one in a process optimises the keys.
    pub fn new(seed: u64) -> Self {
        Self { seed: Seed::new(seed), keys: tile() }
    }
}

impl PointSet for BlueNoiseKeys {
    fn describe(&self) -> String {
        format!("blue-noise:seed={},keys=optimised,of=sobol", self.seed.given())
    }

    fn block(&self, id: SampleId, block: u32) -> [f32; 4] {
        let batch = id.index >> 32;
        let mut shared = id;
        shared.pixel = id.pixel.map(|c| c / SIDE as u32);
        // The complement keeps the keys of tiles apart from those of pixels.
        let key = self.seed.key(&shared, block, !batch);
        let own = self.seed.key(&id, block, batch);
        let index = halves(nth_key(key, 0)).map(|shuffle| shuffled(id.index as u32, shuffle));
        let points = sequence(index[0], index[1]);
        let place = id.pixel.map(|c| c as usize % SIDE);
        let mut block = [0.0; 4];
        for (pair, offset) in halves(nth_key(key, 1)).into_iter().enumerate() {
            let x = (place[0] + offset as usize) % SIDE;
            let y = (place[1] + (offset >> BITS) as usize) % SIDE;
            let cell = u32::from(self.keys[y * SIDE + x]);
            let fine = halves(nth_key(own, pair as u64)).map(|bits| bits >> BITS);
            block[2 * pair] = unit(points[2 * pair] ^ (cell << (32 - BITS) | fine[0]));
            block[2 * pair + 1] = unit(points[2 * pair + 1] ^ (cell >> BITS << (32 - BITS) | fine[1]));
        }
        block
    }

    /// Returns `2^32`, as for [`Sobol`](crate::Sobol).
    fn capacity(&self) -> u64 {
        1 << 32
    }

    /// Returns the next count from `n` on that [`Sobol`](crate::Sobol) prefers.
    fn preferred_count(&self, n: u64) -> u64 {
        crate::sobol::preferred_count(n)
    }

    fn couples_pixels(&self) -> bool {
        true
    }
}

/// A permutation of the indices that keeps each of `0..2^k` as a set: a nested shuffle of the bits below the leading one.
#[inline]
fn shuffled(index: u32, shuffle: u32) -> u32 {
    let below = index.checked_ilog2().map_or(0, |leading| (1 << leading) - 1);
    let nested = owen_reversed(index.reverse_bits(), shuffle).reverse_bits();
    index & !below | nested & below
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optimised_keys::white;
    use crate::{BlueNoise, Sobol};

    type Integrand = fn(f64, f64) -> f64;

    const COUNTS: [u64; 3] = [1, 4, 16];

    /// Two integrands on which no key was optimised, with their means.
    const INTEGRANDS: [(&str, Integrand, f64); 2] =
        [("half-plane", |x, y| f64::from(u8::from(y < 0.3 + 0.4 * x)), 0.5), ("x y", |x, y| x * y, 0.25)];

    /// The mean square of an image's errors, and 16 times that of their means over blocks of 4 x 4 pixels. For white
    /// noise the two are equal. The images have 128 x 128 pixels, one for each of four blocks of random numbers.
    fn errors(points: &dyn PointSet, spp: u64, f: Integrand, mean: f64) -> [f64; 2] {
        let error = |x: u32, y: u32, block: u32| {
            let value = |index| {
                let [a, b, ..] = points.block(SampleId::new([x, y], 0, index), block).map(f64::from);
                f(a, b) - mean
            };
            (0..spp).map(value).sum::<f64>() / spp as f64
        };
        let mut sums = [0.0; 2];
        for (block, corner) in (0..4).flat_map(|block| (0..1024).map(move |corner| (block, corner))) {
            let [x, y] = [corner % 32 * 4, corner / 32 * 4];
            let own: [f64; 16] = std::array::from_fn(|k| error(x + k as u32 % 4, y + k as u32 / 4, block));
            sums[0] += own.iter().map(|e| e * e).sum::<f64>();
            sums[1] += own.iter().sum::<f64>().powi(2);
        }
        sums.map(|s| s / f64::from(4 << 14))
    }

    fn with_white_keys() -> BlueNoiseKeys {
        BlueNoiseKeys { keys: Box::leak(white().into_boxed_slice()), ..BlueNoiseKeys::new(3) }
    }

    /// Low-frequency errors over those of independent pixels. Of 4096 means over 4 x 4 pixels, white noise has a mean
    /// square with a standard error of 2.2 %. Random keys are the negative control: they leave the errors white.
    #[test]
    fn errors_have_little_energy_at_low_frequencies() {
        let (optimised, white, independent) = (BlueNoiseKeys::new(3), with_white_keys(), Sobol::new(3));
        for ((what, f, mean), most) in INTEGRANDS.into_iter().zip([[0.45, 0.6, 0.9], [0.4, 0.2, 0.5]]) {
            for (spp, most) in COUNTS.into_iter().zip(most) {
                let [of, control, alone] =
                    [&optimised as &dyn PointSet, &white, &independent].map(|points| errors(points, spp, f, mean));
                let found = of[1] / alone[1];
                assert!(found < most, "{what}, {spp} spp: {found:.3} of independent pixels");
                let blue = of[1] / of[0];
                assert!(blue < 0.75, "{what}, {spp} spp: {blue:.3} of white noise");
                let flat = control[1] / control[0];
                assert!((flat - 1.0).abs() < 0.15, "{what}, {spp} spp: the control has {flat:.3} of white noise");
            }
        }
    }

    /// Shifts break nets at the border of the square; keys keep them. So do random keys, whose errors are as large.
    #[test]
    fn nets_that_stay_whole_have_less_error_than_shifted_ones() {
        let [_, (_, f, mean)] = INTEGRANDS;
        let shifted = errors(&BlueNoise::new(3, Sobol::new(3)), 16, f, mean);
        let optimised = errors(&BlueNoiseKeys::new(3), 16, f, mean);
        let white = errors(&with_white_keys(), 16, f, mean);
        assert!(8.0 * optimised[0] < shifted[0], "{} and {}", optimised[0], shifted[0]);
        assert!(16.0 * optimised[1] < shifted[1], "{} and {}", optimised[1], shifted[1]);
        assert!((optimised[0] / white[0] - 1.0).abs() < 0.05, "{} and {}", optimised[0], white[0]);
        assert!(optimised[1] < 0.75 * white[1], "{} and {}", optimised[1], white[1]);
    }

    #[test]
    fn shuffles_keep_every_prefix_of_a_power_of_two() {
        let mut moved = 0;
        for shuffle in halves(crate::keys::mix64(5)) {
            for k in 0..10 {
                let mut seen = vec![false; 1 << k];
                for index in 0..1 << k {
                    let to = shuffled(index, shuffle);
                    moved += u32::from(to != index);
                    assert!(!std::mem::replace(&mut seen[to as usize], true), "2^{k}: {to} twice");
                }
            }
            assert_eq!(shuffled(1 << 31, shuffle) >> 31, 1);
        }
        assert!(moved > 1000, "{moved} indices moved");
    }
}
