//! Hashing: random bits from the coordinates of a sample.

use dapple_core::SampleId;

/// The odd number nearest to 2^64 / golden ratio, which is the step between the keys of one block [after Steele 2014].
const STEP: u64 = 0x9e37_79b9_7f4a_7c15;

/// The odd factor of batch numbers in a key: the first 16 hexadecimal digits of pi's fraction, made odd.
const HIGH_STEP: u64 = 0x243f_6a88_85a3_08d3;

/// A bijective hash of 64 bits. Every input bit affects every output bit.
///
/// The constants are those of variant 13 of Stafford's search, as in SplitMix64 [after Steele 2014].
#[inline(always)]
pub(crate) const fn mix64(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// A user's seed, expanded to two words that enter both rounds of [`Seed::key`]. Neighbouring seeds are unrelated. No seed has
/// the keys of another seed shifted by some pixels.
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

    /// Returns 64 random bits for a pixel, stream and block. `batch` is the number of restarts of a point set beyond its
    /// capacity.
    #[inline(always)]
    pub(crate) fn key(&self, id: &SampleId, block: u32, batch: u64) -> u64 {
        let pixel = u64::from(id.pixel[0]) | u64::from(id.pixel[1]) << 32;
        let place = u64::from(id.stream) | u64::from(block) << 32;
        let here = mix64(pixel ^ self.words[0]);
        // Batches enter by multiplication, so that low bits of streams and batches cannot cancel.
        mix64(here.wrapping_add(place ^ self.words[1]) ^ batch.wrapping_mul(HIGH_STEP))
    }
}

/// Returns the key with index `n` derived from `key`. It differs from `key`, even for `n = 0`.
#[inline(always)]
pub(crate) const fn nth_key(key: u64, n: u64) -> u64 {
    mix64(key.wrapping_add(STEP.wrapping_mul(n + 1)))
}

/// Returns the lower and the upper half of a key.
#[inline(always)]
pub(crate) const fn halves(key: u64) -> [u32; 2] {
    [key as u32, (key >> 32) as u32]
}

/// Returns the largest f32 of at most `bits / 2^32`. It has 24 bits, so it is never 1.
#[inline(always)]
pub(crate) fn unit(bits: u32) -> f32 {
    // Both steps are exact: 24 bits fit an f32, and the factor is a power of two.
    (bits >> 8) as f32 * (1.0 / 16_777_216.0)
}

/// Returns the image of `i < n` under a random permutation of `0..n` selected by `key`, for `1 <= n <= 2^31`.
///
/// A bijection on the next power of two is repeated until its value is below `n` [after Kensler 2013]. The bijection is a
/// Feistel network on the upper and lower bits of the number, which is not in the paper. Since its words are short, it needs
/// five double rounds: with four, the test `permutations_are_uniform` fails.
#[inline]
pub(crate) fn permute(i: u32, n: u32, key: u64) -> u32 {
    debug_assert!(i < n && n <= 1 << 31);
    let bits = 32 - (n - 1).leading_zeros();
    if bits < 2 {
        // Two numbers are swapped or not, depending on one bit of the key.
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

/// Returns the state of child `digit` of a node in a tree of random numbers. It is cheaper than a full mix, for scrambles that
/// need many states.
#[inline(always)]
pub(crate) fn next_state(state: u64, digit: u64) -> u64 {
    let s = (state ^ state >> 29).wrapping_add(digit + 1).wrapping_mul(0x94d0_49bb_1331_11eb);
    s ^ s >> 32
}

/// Returns a cheap pseudorandom function of a short number: the middle bits of its product with a random odd number.
#[inline(always)]
fn noise(x: u32, key: u64) -> u32 {
    let product = (u64::from(x) ^ key).wrapping_mul(key.rotate_left(29) | 1);
    (product >> 32) as u32
}
