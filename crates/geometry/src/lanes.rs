//! Vectors of eight f32 in the widest registers of the machine. Results are bit-identical on every machine.

use bytemuck::{Pod, Zeroable};
use glam::Vec4;
use std::ops::{Add, Div, Mul, Sub};

/// The number of lanes (numbers) in a vector.
pub(crate) const WIDTH: usize = 8;

/// Eight f32 in memory, aligned like a vector.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C, align(32))]
pub(crate) struct Eight(pub(crate) [f32; WIDTH]);

/// Eight u32 in memory, aligned like a vector.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C, align(32))]
pub(crate) struct Words(pub(crate) [u32; WIDTH]);

/// A vector of eight `f32` with lane-wise operations. Comparisons return a mask with one bit per lane. `min` and `max`
/// of NaN and a number are unspecified.
pub(crate) trait Lanes:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self>
{
    /// The type of a token that proves that the processor supports these vectors.
    type Token: Copy;

    fn splat(token: Self::Token, value: f32) -> Self;
    fn load(token: Self::Token, values: &[f32; WIDTH]) -> Self;
    fn to_array(self) -> [f32; WIDTH];
    fn min(self, other: Self) -> Self;
    fn max(self, other: Self) -> Self;
    fn abs(self) -> Self;
    fn less(self, other: Self) -> u32;
    fn at_most(self, other: Self) -> u32;
    /// Returns the mask of the lanes in which `words` equals `word`.
    fn equal(token: Self::Token, words: &[u32; WIDTH], word: u32) -> u32;
}

/// The kinds of vectors that processors support.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Vectors {
    /// One vector of eight f32 (AVX2).
    #[cfg(target_arch = "x86_64")]
    Whole(pulp::x86::V3),
    /// Two vectors of four f32 (SSE2, NEON or other).
    Pair,
}

impl Default for Vectors {
    /// Returns the widest kind that the processor supports. Detection takes time, so it is done once per tree.
    fn default() -> Self {
        #[cfg(target_arch = "x86_64")]
        if let Some(v3) = pulp::x86::V3::try_new() {
            return Self::Whole(v3);
        }
        Self::Pair
    }
}

/// A computation that is compiled for each kind of vectors.
pub(crate) trait Vectorised {
    fn run<L: Lanes>(self, token: L::Token);
}

impl Vectors {
    /// Runs a computation with these vectors.
    #[inline(always)]
    pub(crate) fn run(self, work: impl Vectorised) {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Whole(token) => token.vectorize(avx::Work(token, work)),
            Self::Pair => work.run::<Pair>(()),
        }
    }
}

/// Eight f32 in two vectors of four (SSE2 or NEON).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pair([Vec4; 2]);

impl Pair {
    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(Vec4, Vec4) -> Vec4) -> Self {
        Self([f(self.0[0], other.0[0]), f(self.0[1], other.0[1])])
    }
}

macro_rules! pairwise {
    ($($operator:ident, $method:ident;)*) => {$(
        impl $operator for Pair {
            type Output = Self;

            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                self.zip(other, |a, b| $operator::$method(a, b))
            }
        }
    )*};
}

pairwise! { Add, add; Sub, sub; Mul, mul; Div, div; }

impl Lanes for Pair {
    type Token = ();

    #[inline(always)]
    fn splat((): (), value: f32) -> Self {
        Self([Vec4::splat(value); 2])
    }

    #[inline(always)]
    fn load((): (), values: &[f32; WIDTH]) -> Self {
        let [a, b, c, d, e, f, g, h] = *values;
        Self([Vec4::new(a, b, c, d), Vec4::new(e, f, g, h)])
    }

    #[inline(always)]
    fn to_array(self) -> [f32; WIDTH] {
        let [[a, b, c, d], [e, f, g, h]] = self.0.map(|v| v.to_array());
        [a, b, c, d, e, f, g, h]
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.zip(other, Vec4::min)
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.zip(other, Vec4::max)
    }

    #[inline(always)]
    fn abs(self) -> Self {
        Self(self.0.map(Vec4::abs))
    }

    #[inline(always)]
    fn less(self, other: Self) -> u32 {
        self.0[0].cmplt(other.0[0]).bitmask() | self.0[1].cmplt(other.0[1]).bitmask() << 4
    }

    #[inline(always)]
    fn at_most(self, other: Self) -> u32 {
        self.0[0].cmple(other.0[0]).bitmask() | self.0[1].cmple(other.0[1]).bitmask() << 4
    }

    #[inline(always)]
    fn equal((): (), words: &[u32; WIDTH], word: u32) -> u32 {
        (0..WIDTH).fold(0, |mask, lane| mask | u32::from(words[lane] == word) << lane)
    }
}

/// Eight f32 in one vector, for processors with AVX2.
#[cfg(target_arch = "x86_64")]
mod avx {
    use super::{Add, Div, Lanes, Mul, Sub, Vectorised, WIDTH};
    use core::arch::x86_64::__m256;
    use pulp::NullaryFnOnce;
    use pulp::x86::V3;

    pub(super) struct Work<W>(pub(super) V3, pub(super) W);

    impl<W: Vectorised> NullaryFnOnce for Work<W> {
        type Output = ();

        #[inline(always)]
        fn call(self) {
            self.1.run::<Whole>(self.0);
        }
    }

    #[derive(Clone, Copy, Debug)]
    pub(crate) struct Whole(__m256, V3);

    macro_rules! lanewise {
        ($($operator:ident, $method:ident, $intrinsic:ident;)*) => {$(
            impl $operator for Whole {
                type Output = Self;

                #[inline(always)]
                fn $method(self, other: Self) -> Self {
                    Self(self.1.avx.$intrinsic(self.0, other.0), self.1)
                }
            }
        )*};
    }

    lanewise! { Add, add, _mm256_add_ps; Sub, sub, _mm256_sub_ps; Mul, mul, _mm256_mul_ps; Div, div, _mm256_div_ps; }

    /// The predicate "less than, ordered and quiet" of AVX comparisons: false for NaN.
    const LESS: i32 = 17;
    const AT_MOST: i32 = 18;

    impl Lanes for Whole {
        type Token = V3;

        #[inline(always)]
        fn splat(token: V3, value: f32) -> Self {
            Self(token.avx._mm256_set1_ps(value), token)
        }

        #[inline(always)]
        fn load(token: V3, values: &[f32; WIDTH]) -> Self {
            Self(pulp::cast(*values), token)
        }

        #[inline(always)]
        fn to_array(self) -> [f32; WIDTH] {
            pulp::cast(self.0)
        }

        #[inline(always)]
        fn min(self, other: Self) -> Self {
            Self(self.1.avx._mm256_min_ps(self.0, other.0), self.1)
        }

        #[inline(always)]
        fn max(self, other: Self) -> Self {
            Self(self.1.avx._mm256_max_ps(self.0, other.0), self.1)
        }

        #[inline(always)]
        fn abs(self) -> Self {
            Self(self.1.avx._mm256_andnot_ps(self.1.avx._mm256_set1_ps(-0.0), self.0), self.1)
        }

        #[inline(always)]
        fn less(self, other: Self) -> u32 {
            self.1.avx._mm256_movemask_ps(self.1.avx._mm256_cmp_ps::<LESS>(self.0, other.0)) as u32
        }

        #[inline(always)]
        fn at_most(self, other: Self) -> u32 {
            self.1.avx._mm256_movemask_ps(self.1.avx._mm256_cmp_ps::<AT_MOST>(self.0, other.0)) as u32
        }

        #[inline(always)]
        fn equal(token: V3, words: &[u32; WIDTH], word: u32) -> u32 {
            let equal = token.avx2._mm256_cmpeq_epi32(pulp::cast(*words), token.avx._mm256_set1_epi32(word as i32));
            token.avx._mm256_movemask_ps(pulp::cast(equal)) as u32
        }
    }
}

#[cfg(target_arch = "x86_64")]
pub(crate) use avx::Whole;
