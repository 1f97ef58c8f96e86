//! Random bits from the coordinates of a sample: all hashing of this crate.

use dapple_core::SampleId;

/// The odd number nearest to 2^64 / golden ratio: the step between the keys of one block [after Steele 2014].
const STEP: u64 = 0x9e37_79b9_7f4a_7c15;

/// An odd constant by which batch numbers enter a key: the first 16 hexadecimal digits of the fraction of pi, made odd.
const HIGH_STEP: u64 = 0x243f_6a88_85a3_08d3;

/// A bijective hash of 64 bits. Every input bit affects every output bit.
///
/// The constants are variant 13 of Stafford's search, as in SplitMix64 [after Steele 2014].
#[inline(always)]
pub(crate) const fn mix64(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// A user's seed, spread over two words that enter both rounds of [`Seed::key`]. Neighbouring seeds share nothing, and
/// no seed is another one shifted by some pixels.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Seed {
    given: u64,
    words: [u64; 2],
}

impl Seed {
    pub(crate) const fn new(seed: u64) -> Self {
        let first = mix64(seed ^ STEP);
        Self { given: seed, words: [first, mix64(first.wrapping_add(STEP))] }
    }

    /// The seed as the user gave it.
    pub(crate) const fn given(&self) -> u64 {
        self.given
    }

    /// 64 random bits for a pixel, stream and block. `batch` counts the restarts of a point set beyond its capacity.
    #[inline(always)]
    pub(crate) fn key(&self, id: &SampleId, block: u32, batch: u64) -> u64 {
        let pixel = u64::from(id.pixel[0]) | u64::from(id.pixel[1]) << 32;
        let place = u64::from(id.stream) | u64::from(block) << 32;
        let here = mix64(pixel ^ self.words[0]);
        // Batches enter by multiplication, so that low bits of streams and batches cannot cancel.
        mix64(here.wrapping_add(place ^ self.words[1]) ^ batch.wrapping_mul(HIGH_STEP))
    }
}

/// The `n`th further key derived from `key`. `n = 0` does not return `key` itself.
#[inline(always)]
pub(crate) const fn nth_key(key: u64, n: u64) -> u64 {
    mix64(key.wrapping_add(STEP.wrapping_mul(n + 1)))
}

/// The low and the high half of a key.
#[inline(always)]
pub(crate) const fn halves(key: u64) -> [u32; 2] {
    [key as u32, (key >> 32) as u32]
}

/// The largest f32 at or below `bits / 2^32`. It has 24 bits, so it is never 1.
#[inline(always)]
pub(crate) fn unit(bits: u32) -> f32 {
    // Both steps are exact: 24 bits fit an f32, and the factor is a power of two.
    (bits >> 8) as f32 * (1.0 / 16_777_216.0)
}

/// The image of `i < n` under a random permutation of `0..n` chosen by `key`, for `1 <= n <= 2^31`.
///
/// A bijection on the next power of two is repeated until its value is below `n` [after Kensler 2013].
/// The bijection is our own Feistel network on the high and low bits of the number.
/// Its words are short, so it needs five double rounds: with four, `permutations_are_uniform` fails.
#[inline]
pub(crate) fn permute(i: u32, n: u32, key: u64) -> u32 {
    debug_assert!(i < n && n <= 1 << 31);
    let bits = 32 - (n - 1).leading_zeros();
    if bits < 2 {
        // One number, or two that keep or exchange their places.
        return if n == 2 { i ^ (key >> 63) as u32 } else { 0 };
    }
    let (low, high) = (bits / 2, bits - bits / 2);
    let (low_mask, high_mask) = ((1_u32 << low) - 1, (1_u32 << high) - 1);
    let mut x = i;
    loop {
        let (mut l, mut h) = (x & low_mask, x >> low);
        let mut round_key = key;
        for _ in 0..5 {
            round_key = next_state(round_key, 0);
            l ^= noise(h, round_key) & low_mask;
            round_key = next_state(round_key, 0);
            h ^= noise(l, round_key) & high_mask;
        }
        x = h << low | l;
        if x < n {
            return x;
        }
    }
}

/// The state of child `digit` of a node in a tree of random numbers. Cheaper than a full mix, for scrambles that need
/// many.
#[inline(always)]
pub(crate) fn next_state(state: u64, digit: u64) -> u64 {
    let s = (state ^ state >> 29).wrapping_add(digit + 1).wrapping_mul(0x94d0_49bb_1331_11eb);
    s ^ s >> 32
}

/// A cheap random function of a short number: the middle of its product with a random odd number.
#[inline(always)]
fn noise(x: u32, key: u64) -> u32 {
    let product = (u64::from(x) ^ key).wrapping_mul(key.rotate_left(29) | 1);
    (product >> 32) as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    fn id(pixel: [u32; 2], stream: u32) -> SampleId {
        SampleId::new(pixel, stream, 0)
    }

    /// Flipping any bit of (seed, pixel, stream, block, batch) flips each bit of the key with probability 1/2.
    ///
    /// 256 input bits x 64 output bits over 4096 fixed inputs. The bound of 6 standard errors has a false alarm rate of
    /// 2e-9 each, 3e-5 in all.
    #[test]
    fn every_input_bit_reaches_every_key_bit() {
        let trials = 4096;
        let key = |w: [u64; 4]| {
            let s = id([w[1] as u32, (w[1] >> 32) as u32], w[2] as u32);
            Seed::new(w[0]).key(&s, (w[2] >> 32) as u32, w[3])
        };
        let mut worst = 0.0_f64;
        for word in 0..4 {
            for bit in 0..64 {
                let mut flips = [0_u32; 64];
                for t in 0..trials {
                    // Small numbers, as pixels, streams and blocks are in practice.
                    let mut w = [t, (t % 61) | ((t / 61) << 32), (t % 7) | ((t % 11) << 32), t % 3];
                    let before = key(w);
                    w[word] ^= 1 << bit;
                    let changed = before ^ key(w);
                    for (k, f) in flips.iter_mut().enumerate() {
                        *f += (changed >> k & 1) as u32;
                    }
                }
                for f in flips {
                    let z = (f64::from(f) - 0.5 * trials as f64) / (0.25 * trials as f64).sqrt();
                    worst = worst.max(z.abs());
                }
            }
        }
        assert!(worst < 6.0, "an output bit follows an input bit: {worst} standard errors");
    }

    /// No two of 2^21 samples with small coordinates share a key. One collision is expected in 2^23 such tests.
    #[test]
    fn small_names_have_different_keys() {
        let mut keys = Vec::new();
        for seed in 0..4 {
            for x in 0..64 {
                for y in 0..64 {
                    for stream in 0..4 {
                        for block in 0..32 {
                            keys.push(Seed::new(seed).key(&id([x, y], stream), block, 0));
                        }
                    }
                }
            }
        }
        let all = keys.len();
        keys.sort_unstable();
        keys.dedup();
        assert_eq!(keys.len(), all);
    }

    #[test]
    fn permutations_are_bijections() {
        for n in (1..70).chain([100, 128, 1000, 1024, 4096]) {
            for k in 0..20 {
                let mut seen = vec![false; n as usize];
                for i in 0..n {
                    let to = permute(i, n, mix64(k));
                    assert!(!std::mem::replace(&mut seen[to as usize], true), "n = {n}, key {k}");
                }
            }
        }
    }

    /// Each number goes to each place equally often, and so does each pair of neighbours. Chi-square over 64 and over
    /// 240 cells, 250,000 fixed keys, bound at 6 standard deviations.
    #[test]
    fn permutations_are_uniform() {
        for n in [8_usize, 16] {
            let draws = 250_000;
            let mut single = vec![0_u32; n * n];
            let mut pairs = vec![0_u32; n * n];
            for k in 0..draws {
                let key = mix64(k * 3 + 1);
                for i in 0..n {
                    single[i * n + permute(i as u32, n as u32, key) as usize] += 1;
                }
                let (a, b) = (permute(2, n as u32, key) as usize, permute(3, n as u32, key) as usize);
                pairs[a * n + b] += 1;
            }
            let chi2 = |cells: &mut dyn Iterator<Item = u32>, expected: f64| -> f64 {
                cells.map(|c| (f64::from(c) - expected).powi(2) / expected).sum()
            };
            let s = chi2(&mut single.iter().copied(), draws as f64 / n as f64);
            let dof = ((n - 1) * (n - 1)) as f64;
            assert!(s < dof + 6.0 * (2.0 * dof).sqrt() * 1.2, "n = {n}: chi2 {s} with {dof} degrees of freedom");
            let off = (0..n * n).filter(|c| c / n != c % n).map(|c| pairs[c]);
            let p = chi2(&mut off.into_iter(), draws as f64 / (n * (n - 1)) as f64);
            let dof = (n * (n - 1) - 1) as f64;
            assert!(p < dof + 6.0 * (2.0 * dof).sqrt(), "n = {n}: pairs' chi2 {p} with {dof} degrees of freedom");
        }
    }

    #[test]
    fn all_ones_stay_below_one_s01() {
        assert_eq!(unit(u32::MAX), 1.0 - 1.0 / 16_777_216.0);
        assert_eq!(unit(0), 0.0);
        for n in 1..=1_u32 << 24 {
            assert_eq!((unit(u32::MAX) * n as f32) as u32, n - 1, "an index beyond {n} choices");
        }
    }
}
