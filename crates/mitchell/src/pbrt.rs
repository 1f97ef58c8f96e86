//! The `adaptive` sampler of pbrt-v2.

use crate::Rates;
use crate::contrast::deviation;
use crate::two_rates::{TwoRates, sampler_of_two_rates};
use dapple_core::{Error, Film, Options as _, PilotPolicy, PointSet, Stopping, luminance};

dapple_core::options! {
    /// The parameters of [`MitchellPbrt`].
    pub struct MitchellPbrtOptions {
        /// Samples per pixel that decide, rounded up to a power of two.
        pub min: u32 = 4, |min| min >= 2, "one sample deviates from nothing: 2 or more";
        /// Samples of a refined pixel, rounded up to a power of two.
        ///
        /// Twice `min` where rounding makes them equal.
        pub max: u32 = 32;
        /// Relative deviation in luminance above which a pixel is refined.
        ///
        /// It is the deviation of a sample from the pilot's mean.
        pub threshold: f64 = 0.5, |t| t > 0.0 && t.is_finite(), "a relative deviation above 0";
        /// The end: budget (largest deviation first, to the last sample) or threshold (the budget is a ceiling).
        ///
        /// As [`MitchellOptions::mode`](crate::MitchellOptions::mode).
        pub mode: Stopping = Stopping::Budget => "budget";
        /// The pilot's retention: refined (published, biased), keep (biased), discard (unbiased).
        pub policy: PilotPolicy = PilotPolicy::Refined => "refined",
            |policy| !matches!(policy, PilotPolicy::Cross), "one of refined, keep, discard";
    }
}

/// The `adaptive` sampler of pbrt-v2 with its `contrast` test [pbrt-v2, `src/samplers/adaptive.cpp`].
///
/// Each pixel gets `min` samples. If one of them deviates in luminance by more than half of their mean, `|Y - mean| /
/// mean > 0.5`, `max` new samples replace them. With [`Stopping::Threshold`] and [`PilotPolicy::Refined`] this is the
/// published rule. [`Stopping::Budget`], the default, ranks pixels by that deviation until the budget is spent. With
/// [`PilotPolicy::Keep`] the pilot counts towards `max`.
///
/// *Guarantees*: the budget is met exactly or kept as a ceiling. If it allows `min` samples per pixel, no pixel has
/// fewer.
///
/// *Weaknesses*: the published rule is biased, by `3 p^2 - 2 p^3` for a Bernoulli pixel with two pilot samples (see
/// [`PilotPolicy`]). A black pilot has no deviation and is never refined. Each pixel decides alone. The published form
/// knows no budget. pbrt-v2's `shapeid` test is not included.
pub struct MitchellPbrt<P> {
    points: P,
    options: MitchellPbrtOptions,
    two_rates: TwoRates,
}

impl<P: PointSet> MitchellPbrt<P> {
    /// Makes a sampler with these points and the default parameters.
    pub fn new(points: P) -> Self {
        let options = MitchellPbrtOptions::default();
        Self { points, options, two_rates: TwoRates::new(options.mode, options.policy) }
    }

    /// Makes a sampler with these points and parameters.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] for `min` below 2, `max` below `min` or above 2^31, and a threshold that is
    /// not a number above 0.
    pub fn with_options(points: P, options: MitchellPbrtOptions) -> Result<Self, Error> {
        let out = |name, value: String, allowed| Err(Error::OutOfRange { name, value, allowed });
        options.check_ranges()?;
        let MitchellPbrtOptions { min, max, mode, policy, .. } = options;
        if max < min {
            return out("max", max.to_string(), "at least min");
        }
        if max > 1 << 31 || min > 1 << 30 {
            return out("max", max.to_string(), "at most 2^31, and min at most 2^30");
        }
        let min = min.next_power_of_two();
        let max = max.next_power_of_two().max(2 * min);
        let options = MitchellPbrtOptions { min, max, ..options };
        Ok(Self { points, options, two_rates: TwoRates::new(mode, policy) })
    }
}

impl MitchellPbrtOptions {
    /// The least number of samples of one pixel that have a deviation.
    fn least(&self) -> u32 {
        2
    }

    fn rates(&self, _: u64) -> Rates {
        Rates { initial: self.min, additional: self.max - self.min }
    }

    /// The largest deviation of a sample relative to the threshold, per pixel. Pixels above 1 are refined.
    fn scores(&self, film: &Film) -> Vec<f64> {
        let score = |i| {
            let (range, moments) = match self.policy {
                PilotPolicy::Discard => (film.discarded_luminance_range(i), film.discarded(i)),
                _ => (film.luminance_range(i), film.moments(i)),
            };
            range.map_or(0.0, |range| deviation(range, luminance(moments.mean)) / self.threshold)
        };
        (0..film.frame().pixels()).map(score).collect()
    }
}

// Scores.
sampler_of_two_rates!(MitchellPbrt, "mitchell-pbrt", 8);
