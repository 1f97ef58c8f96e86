//! Rank-1 lattices.

use crate::keys::{Seed, halves, nth_key, unit};
use crate::sobol::owen_reversed;
use dapple_core::{PointSet, SampleId};

/// The second component of the generating vector `(1, MULTIPLIER)`.
const MULTIPLIER: u32 = 1_063_578_985;

/// An extensible rank-1 lattice of Korobov form for each pair, with random shifts [after Korobov 1959; extensible as in
/// Hickernell 2000].
///
/// Point `i` is `phi(i) (1, a)` modulo 1, with van der Corput's `phi` in base 2. Each `2^m` points from a multiple of
/// `2^m` on are a whole lattice, shifted. Each pair has its own random shift [Cranley 1976] and a nested shuffle of its
/// indices.
///
/// # The multiplier
///
/// `a = 1,063,578,985` was found by our own beam search over its bits, lowest first.
///
/// * Bits 0 to 17: the criterion is `P_2`, the squared worst-case error on periodic functions whose Fourier coefficients
///   fall as `1 / (h k)`. The search minimises the largest ratio to the best multiplier of each size from `2^4` to
///   `2^18`. The ratio found is 2.17.
/// * Bits 18 to 31: the criterion is the squared minimum distance on the torus over that of the hexagonal lattice of equal
///   density. From `2^19` to `2^32` points it is at least 0.54.
///
/// ```
/// use dapple_core::{PointSet, SampleId};
/// use dapple_low_discrepancy::Lattice;
///
/// let points = Lattice::new(7);
/// let [x, y, ..] = points.block(SampleId::new([3, 4], 0, 5), 0);
/// assert!((0.0..1.0).contains(&x) && (0.0..1.0).contains(&y));
/// ```
///
/// # Limits
///
/// * Lattices gain on periodic functions. On edges along a lattice's directions they alias.
/// * On functions that are not periodic, such as `x y`, the error of `2^k` samples falls as `1/n`, not faster.
/// * Two pairs are padded at random, as in [`Sobol`](crate::Sobol).
///
/// Name: `lattice`. Parameters: `seed`.
#[derive(Clone, Copy, Debug)]
pub struct Lattice {
    seed: Seed,
}

impl Lattice {
    /// Makes the shifted lattice of a seed.
    pub const fn new(seed: u64) -> Self {
        Self { seed: Seed::new(seed) }
    }
}

impl PointSet for Lattice {
    fn describe(&self) -> String {
        format!("lattice:seed={}", self.seed.given())
    }

    #[inline]
    fn block(&self, id: SampleId, block: u32) -> [f32; 4] {
        let key = self.seed.key(&id, block, id.index >> 32);
        let reversed = (id.index as u32).reverse_bits();
        let [shuffle0, shuffle1] = halves(key);
        let pair = |shuffle: u32, shift: u64| {
            let [x, y] = halves(shift);
            let [u, v] = lattice_point(owen_reversed(reversed, shuffle));
            [unit(u.wrapping_add(x)), unit(v.wrapping_add(y))]
        };
        let [a, b] = pair(shuffle0, nth_key(key, 0));
        let [c, d] = pair(shuffle1, nth_key(key, 1));
        [a, b, c, d]
    }

    /// Returns `2^32`. Later samples come from a newly shifted lattice.
    fn capacity(&self) -> u64 {
        1 << 32
    }

    /// Returns the next power of two from `n` on.
    fn preferred_count(&self, n: u64) -> u64 {
        n.max(1).checked_next_power_of_two().unwrap_or(n)
    }
}

/// The unshifted point, in units of 2^-32, from its first coordinate.
#[inline(always)]
const fn lattice_point(x: u32) -> [u32; 2] {
    [x, x.wrapping_mul(MULTIPLIER)]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The squared minimum distance of the lattice of `2^m` points with this multiplier, over that of the hexagonal
    /// lattice of equal density, `2 / sqrt(3)` per point. By Gauss' reduction of its basis.
    fn quality(multiplier: u32, m: u32) -> f64 {
        let n = 1_i128 << m;
        let dot = |a: [i128; 2], b: [i128; 2]| a[0] * b[0] + a[1] * b[1];
        let (mut u, mut v) = ([1, i128::from(multiplier) % n], [0, n]);
        loop {
            if dot(u, u) > dot(v, v) {
                std::mem::swap(&mut u, &mut v);
            }
            let times = (2 * dot(u, v) + dot(u, u)).div_euclid(2 * dot(u, u));
            if times == 0 {
                return dot(u, u) as f64 / n as f64 / (2.0 / 3.0_f64.sqrt());
            }
            v = [v[0] - times * u[0], v[1] - times * u[1]];
        }
    }

    /// `P_2` of the lattice of `2^m` points: the mean of a product of Bernoulli polynomials, less 1.
    fn p2(multiplier: u32, m: u32) -> f64 {
        let n = 1_u64 << m;
        let factor = |i: u64| {
            let x = i as f64 / n as f64;
            1.0 + 2.0 * std::f64::consts::PI.powi(2) * (x * x - x + 1.0 / 6.0)
        };
        let sum: f64 = (0..n).map(|i| factor(i) * factor(i * u64::from(multiplier) % n)).sum();
        sum / n as f64 - 1.0
    }

    /// Against all multipliers, as far as there is time for all.
    #[test]
    fn the_multiplier_has_the_stated_quality_at_every_size() {
        let ratio = |multiplier, m| {
            let best = (0..1_u32 << (m - 1)).map(|k| p2(2 * k + 1, m)).fold(f64::INFINITY, f64::min);
            p2(multiplier, m) / best
        };
        let worst = |multiplier| (4..=11).map(|m| ratio(multiplier, m)).fold(0.0, f64::max);
        assert!((worst(MULTIPLIER) - 2.17).abs() < 5e-3, "{}", worst(MULTIPLIER));
        let closest = |multiplier| (19..=32).map(|m| quality(multiplier, m)).fold(f64::INFINITY, f64::min);
        assert!((closest(MULTIPLIER) - 0.5405).abs() < 5e-4, "{}", closest(MULTIPLIER));
        // Negative controls: the diagonal of a grid, and a random odd number.
        assert!(worst(1) > 100.0 && closest(1) < 1e-3, "{} {}", worst(1), closest(1));
        assert!(worst(0x9e37_79b9) > 3.0, "{}", worst(0x9e37_79b9));
    }

    /// The lattice (1, 5) modulo 16 has the reduced basis (3, -1), (1, 5). One point in each of two cells has a closed
    /// form: `P_2` of the lattice (1, 1) modulo 2.
    #[test]
    fn the_criteria_have_their_closed_forms() {
        assert!((quality(5, 4) - 10.0 / 16.0 / (2.0 / 3.0_f64.sqrt())).abs() < 1e-12);
        let b = 2.0 * std::f64::consts::PI.powi(2);
        let wanted = 0.5 * ((1.0 + b / 6.0).powi(2) + (1.0 - b / 12.0).powi(2)) - 1.0;
        assert!((p2(1, 1) - wanted).abs() < 1e-12);
    }

    /// The `2^m` samples from a multiple of `2^m` on: their differences are the lattice of `2^m` points.
    #[test]
    fn aligned_runs_are_shifted_lattices() {
        let points = Lattice::new(3);
        for (m, start) in [(2, 0), (4, 48), (6, 192), (8, 1024)] {
            for first in [0, 2] {
                let cell = |i: u64| {
                    let u = points.block(SampleId::new([9, 1], 0, start + i), 2);
                    let origin = points.block(SampleId::new([9, 1], 0, start), 2);
                    [0, 1].map(|k| {
                        let n = f64::from(1_u32 << m);
                        let steps = (f64::from(u[first + k]) - f64::from(origin[first + k])) * n;
                        // A coordinate has 24 bits.
                        assert!((steps - steps.round()).abs() < n * 1.3e-7, "{steps}");
                        (steps.round() as i64).rem_euclid(1 << m)
                    })
                };
                let mut seen = vec![false; 1 << m];
                for i in 0..1 << m {
                    let [x, y] = cell(i);
                    assert_eq!((x * i64::from(MULTIPLIER)).rem_euclid(1 << m), y, "2^{m} from {start}: not a lattice");
                    assert!(!std::mem::replace(&mut seen[x as usize], true), "2^{m} from {start}: a point twice");
                }
            }
        }
    }
}
