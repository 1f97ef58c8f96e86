//! Kinds of sums over a pixel's samples.

use std::ops::BitOr;

/// Sums over a pixel's samples that a film records besides mean and variance, per channel in `f64`. Kinds are joined by `|`.
///
/// Rejected samples count as 0 in each of them. [`Film::sums`](crate::Film::sums) returns the sums.
///
/// ```
/// use dapple_core::{Film, Frame, Needs, Sums};
///
/// let needs = Needs::none().with_sums(Sums::ROOT | Sums::ROOT_MOMENTS);
/// let mut film = Film::new(Frame::new(1, 1)?, needs);
/// film.push(0, 0, [4.0, 1.0, 0.0]);
/// film.push(0, 0, [9.0, 1.0, 0.0]);
/// let sums = film.sums(0);
/// assert_eq!(sums.root, Some([5.0, 2.0, 0.0]));
/// assert_eq!(sums.root_moments.map(|m| m.mean), Some([3.0, 0.0, -2.0]));
/// assert_eq!(sums.log, None);
/// # Ok::<(), dapple_core::Error>(())
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sums(u8);

impl Sums {
    /// No sums.
    pub const NONE: Self = Self(0);
    /// The sum of `x ln x`, for entropies; 24 bytes per pixel and half.
    pub const LOG: Self = Self(1);
    /// The sum of `sqrt x`; 24 bytes per pixel and half.
    pub const ROOT: Self = Self(2);
    /// Mean, and sums of squared and cubed deviations, of `2 (sqrt x - 1)`, the Box-Cox transform with exponent 1/2
    /// [Box and Cox 1964]; 72 bytes per pixel and half.
    pub const ROOT_MOMENTS: Self = Self(4);

    const ALL: u8 = 7;

    /// The union: the kinds in `self` or `other`.
    #[must_use]
    pub const fn and(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// Returns `true` if all kinds in `other` are in `self`.
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// Returns `true` if there are no kinds in `self`.
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// The number of values per pixel and channel.
    pub(crate) const fn values(self) -> usize {
        let moments = if self.contains(Self::ROOT_MOMENTS) { 3 } else { 0 };
        self.contains(Self::LOG) as usize + self.contains(Self::ROOT) as usize + moments
    }

    /// The kinds as a byte for [`Sums::from_bits`].
    pub(crate) const fn bits(self) -> u8 {
        self.0
    }

    /// The kinds of a byte; `None` for unknown ones.
    pub(crate) fn from_bits(bits: u8) -> Option<Self> {
        (bits <= Self::ALL).then_some(Self(bits))
    }
}

impl BitOr for Sums {
    type Output = Self;

    fn bitor(self, other: Self) -> Self {
        self.and(other)
    }
}
