//! Image positions spread over pixels, after Mitchell's point diffusion.

use crate::Sobol;
use crate::keys::{Seed, nth_key};
use crate::pixel_pattern::{PIXELS, ROUNDS, SIDE, coordinate, places};
use dapple_core::{PointSet, SampleId};

/// Positions in the pixel that are blue noise over the image [after Mitchell 1987]; everything else from [`Sobol`].
///
/// Mitchell placed about one sample per pixel by error diffusion on a finer grid. Here each pixel has exactly one
/// sample per round, and best candidates take the place of diffusion. A pattern of 64 x 64 pixels and 16 rounds is made
/// once per process. Each round's positions together are a net, so a position is uniform.
///
/// * The first pair of block 0 is the position. Each tile of the image, stream and 16 samples read it at an offset.
/// * All other coordinates are those of [`Sobol`].
///
/// ```
/// use dapple_core::{PointSet, SampleId};
/// use dapple_low_discrepancy::Diffused;
///
/// let points = Diffused::new(7);
/// let [x, y, ..] = points.block(SampleId::new([3, 4], 0, 5), 0);
/// assert!((0.0..1.0).contains(&x) && (0.0..1.0).contains(&y));
/// ```
///
/// # Limits
///
/// * It gains at one to a few samples per pixel. At more, a pixel's positions are hardly better than random, and
///   [`Sobol`] wins.
/// * Below 0.2 cycles per pixel a jittered grid has even less power; from there to 0.6 it has 2x to 4x more.
/// * The borders of tiles are seams: pixels on either side are independent.
/// * Light, lens and time are not spread over pixels.
///
/// Name: `diffused`. Parameters: `seed`.
#[derive(Clone, Copy, Debug)]
pub struct Diffused {
    seed: Seed,
    inner: Sobol,
}

impl Diffused {
    /// Makes the point set of a seed. The pattern is the same for all seeds, at another offset.
    pub fn new(seed: u64) -> Self {
        Self { seed: Seed::new(seed), inner: Sobol::new(seed) }
    }
}

/// The block that holds the position in the pixel.
const POSITION: u32 = 0;

/// The index of a sample in the pattern. Each tile, stream and run of `ROUNDS` samples has an offset of its own.
pub(crate) fn pattern_index(seed: &Seed, id: &SampleId) -> usize {
    let tile = SampleId::new(id.pixel.map(|c| c / SIDE as u32), id.stream, 0);
    let offset = nth_key(seed.key(&tile, POSITION, id.index / ROUNDS as u64), 3);
    let x = (id.pixel[0] as usize % SIDE + offset as usize % SIDE) % SIDE;
    let y = (id.pixel[1] as usize % SIDE + (offset >> 32) as usize % SIDE) % SIDE;
    (id.index % ROUNDS as u64) as usize * PIXELS + y * SIDE + x
}

/// Random bits for the places within the pattern's steps, the sample's own.
pub(crate) fn pattern_jitter(seed: &Seed, id: &SampleId, block: u32) -> u64 {
    nth_key(nth_key(seed.key(id, block, 0), 5), id.index)
}

impl PointSet for Diffused {
    fn describe(&self) -> String {
        format!("diffused:seed={}", self.seed.given())
    }

    fn block(&self, id: SampleId, block: u32) -> [f32; 4] {
        let inner = self.inner.block(id, block);
        if block != POSITION {
            return inner;
        }
        let [x, y] = places()[pattern_index(&self.seed, &id)];
        let jitter = pattern_jitter(&self.seed, &id, block);
        [coordinate(x, jitter as u32), coordinate(y, (jitter >> 12) as u32), inner[2], inner[3]]
    }

    fn capacity(&self) -> u64 {
        self.inner.capacity()
    }

    fn couples_pixels(&self) -> bool {
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Random;

    /// The power at frequency `(u, v) / 64` per pixel of the sample positions of 64 x 64 pixels, per sample. Independent
    /// points have 1.
    fn power(points: &dyn PointSet, u: u32, v: u32) -> f64 {
        let (mut re, mut im) = (0.0, 0.0);
        for p in 0..64 * 64_u32 {
            let [x, y, ..] = points.block(SampleId::new([p % 64, p / 64], 0, 0), 0).map(f64::from);
            let place = [f64::from(p % 64) + x, f64::from(p / 64) + y];
            let phase = std::f64::consts::TAU * (f64::from(u) * place[0] + f64::from(v) * place[1]) / 64.0;
            re += phase.cos();
            im += phase.sin();
        }
        (re * re + im * im) / 4096.0
    }

    /// The mean power at frequencies from `from` to `to` steps of 1/64 per pixel, in the upper half plane.
    fn mean_power(points: &dyn PointSet, from: f64, to: f64) -> f64 {
        let all = (0..=40_u32).flat_map(|v| (0..=40_u32).map(move |u| (u, v)));
        let inside: Vec<_> = all.filter(|(u, v)| (from..to).contains(&f64::from(u * u + v * v).sqrt())).collect();
        inside.iter().map(|(u, v)| power(points, *u, *v)).sum::<f64>() / inside.len() as f64
    }

    /// Below a quarter of the Nyquist frequency, which is 32 of these steps, under a tenth of white noise. About the Nyquist
    /// frequency under half of a jittered grid. The jittered grid is `random`, whose positions are independent.
    #[test]
    fn positions_have_little_power_up_to_the_nyquist_frequency() {
        for seed in 0..3 {
            let low = mean_power(&Diffused::new(seed), 0.5, 8.0);
            assert!(low < 0.1, "seed {seed}: {low:.3} of white noise");
            let of = |points: &dyn PointSet| mean_power(points, 20.0, 40.0);
            let [ours, jittered] = [of(&Diffused::new(seed)), of(&Random::new(seed))];
            assert!(ours < 0.5 * jittered, "seed {seed}: {ours:.3}, jittered {jittered:.3}");
        }
    }

    /// Each position of a round is used by one pixel of the pattern.
    #[test]
    fn each_round_is_a_net() {
        for round in places().chunks_exact(PIXELS) {
            for (columns, rows) in [(12, 0), (6, 6), (0, 12), (9, 3)] {
                let mut seen = vec![false; PIXELS];
                for [x, y] in round {
                    let cell = usize::from(*x) >> (12 - columns) << rows | usize::from(*y) >> (12 - rows);
                    assert!(!std::mem::replace(&mut seen[cell], true), "2^{columns} x 2^{rows}");
                }
            }
        }
    }
}
