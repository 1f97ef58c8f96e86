//! The two sampling rates: before and after refinement.

/// Sampling rates in samples per pixel: `initial` for every pixel, `initial + additional` for refined ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rates {
    /// The number of samples that every pixel gets.
    pub initial: u32,
    /// The number of additional samples that a refined pixel gets.
    pub additional: u32,
}

/// Mean budget, initial and additional samples per pixel [Lan 2016, table 4-2].
const PRESETS: [[u64; 3]; 4] = [[8, 4, 6], [16, 4, 16], [32, 12, 24], [64, 16, 54]];

impl Rates {
    /// Returns the rates for a budget of `mean` samples per pixel: 4 + 6, 4 + 16, 12 + 24 and 16 + 54 at 8, 16, 32 and
    /// 64 [Lan 2016, table 4-2]. Between these, both rates are interpolated linearly; below 8 and above 64 they are
    /// proportional to `mean`. The initial rate is rounded down, the additional one up, and both are at least 1.
    /// Refining all pixels thus costs at least `mean`.
    pub fn for_mean(mean: u64) -> Self {
        // Larger numbers would all be clamped to u32 anyway.
        let mean = mean.min(1 << 32);
        let [first, .., last] = PRESETS;
        let between = PRESETS.windows(2).find(|w| (w[0][0]..=w[1][0]).contains(&mean)).map(|w| (w[0], w[1]));
        let (low, high) = between.unwrap_or(([0; 3], if mean < first[0] { first } else { last }));
        let width = high[0] - low[0];
        // In `width` parts: exact integers.
        let at = |c: usize| low[c] * width + (high[c] - low[c]) * (mean - low[0]);
        let clamped = |n: u64| u32::try_from(n.max(1)).unwrap_or(u32::MAX);
        Self { initial: clamped(at(1) / width), additional: clamped(at(2).div_ceil(width)) }
    }

    /// The number of samples of a refined pixel: `initial + additional`.
    pub(crate) const fn refined(self) -> u32 {
        self.initial.saturating_add(self.additional)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn presets_are_the_thesis_table_and_others_lie_between() {
        let rates = |mean| {
            let Rates { initial, additional } = Rates::for_mean(mean);
            (initial, additional)
        };
        assert_eq!([8, 16, 32, 64].map(rates), [(4, 6), (4, 16), (12, 24), (16, 54)]);
        assert_eq!([12, 24, 48, 128].map(rates), [(4, 11), (8, 20), (14, 39), (32, 108)]);
        assert_eq!([0, 1, 2, 4].map(rates), [(1, 1), (1, 1), (1, 2), (2, 3)]);
        for mean in 1..2000 {
            let (initial, additional) = rates(mean);
            assert!(u64::from(initial) <= mean && u64::from(initial + additional) >= mean, "{mean}");
            assert!(initial <= rates(mean + 1).0 && additional <= rates(mean + 1).1, "{mean}");
        }
        assert!(rates(u64::MAX).1 > 1 << 31);
    }
}
