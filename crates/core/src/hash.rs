//! Small arithmetic that samplers and point sets share: a hash, and a conversion that saturates.

/// Converts `n` to 32 bits. Larger numbers become `u32::MAX`.
#[inline]
pub fn saturating_u32(n: u64) -> u32 {
    u32::try_from(n).unwrap_or(u32::MAX)
}

/// A bijective 64-bit mix (the finaliser of SplitMix64, [Steele, Lea and Flood 2014]).
#[inline]
pub fn mix(x: u64) -> u64 {
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}
