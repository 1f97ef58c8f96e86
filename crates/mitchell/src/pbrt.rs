//! The `adaptive` sampler of pbrt-v2.

use crate::Rates;
use crate::contrast::deviation;
use crate::two_rates::{TwoRates, sampler_of_two_rates};
use dapple_core::{Error, Film, Options as _, PilotPolicy, PointSet, Stopping, luminance};

dapple_core::options! {
    /// The parameters of [`MitchellPbrt`], the `adaptive` sampler of pbrt-v2.
    pub struct MitchellPbrtOptions {
        /// Samples per pixel before refinement, rounded up to a power of two.
        pub min: u32 = 4, |min| min >= 2, "one sample deviates from nothing: 2 or more";
        /// Samples per refined pixel, rounded up to a power of two.
        ///
        /// If rounding makes `min` and `max` equal, `max` is doubled.
        pub max: u32 = 32;
        /// Relative deviation in luminance above which a pixel is refined.
        ///
        /// The deviation is that of a sample from the mean of its pixel's pilot samples.
        pub threshold: f64 = 0.5, |t| t > 0.0 && t.is_finite(), "a relative deviation above 0";
        /// Stopping rule: budget (largest deviation first, until spent) or threshold (the budget is an upper bound).
        ///
        /// The rule works as in [`MitchellOptions::mode`](crate::MitchellOptions::mode), with deviation in place of
        /// contrast.
        pub mode: Stopping = Stopping::Budget => "budget";
        /// Use of pilot samples: refined (published, biased), keep (biased) or discard (unbiased).
        pub policy: PilotPolicy = PilotPolicy::Refined => "refined",
            |policy| !matches!(policy, PilotPolicy::Cross | PilotPolicy::Neighbours), "one of refined, keep, discard";
    }
}

/// The `adaptive` sampler of pbrt-v2 with its `contrast` test [pbrt-v2, `src/samplers/adaptive.cpp`].
///
/// Each pixel gets `min` pilot samples. If the luminance `Y` of one deviates far from their mean, `|Y - mean| / mean >
/// 0.5`, `max` new samples replace the pilot samples. With [`Stopping::Threshold`] and [`PilotPolicy::Refined`] this is
/// the published rule. [`Stopping::Budget`], the default, ranks pixels by that deviation until the budget is spent.
/// With [`PilotPolicy::Keep`] the pilot samples stay in the image and count towards `max`.
///
/// *Guarantees*: the budget is met exactly, or is an upper bound. If it allows `min` samples per pixel, no pixel has
/// fewer.
///
/// *Weaknesses*: the published rule is biased. If samples are 1 with probability `p`, else 0, and the pilot has two, a
/// pixel's expected value is `3 p^2 - 2 p^3` (see [`PilotPolicy`]). A black pilot has no deviation and is never
/// refined. Each pixel decides alone. The published form knows no budget. pbrt-v2's `shapeid` test is not included.
pub struct MitchellPbrt<P> {
    points: P,
    options: MitchellPbrtOptions,
    two_rates: TwoRates,
}

impl<P: PointSet> MitchellPbrt<P> {
    /// Makes a sampler that uses this point set, with the default parameters.
    pub fn new(points: P) -> Self {
        let options = MitchellPbrtOptions::default();
        Self { points, options, two_rates: TwoRates::new(options.mode, options.policy) }
    }

    /// Makes a sampler that uses this point set, with these parameters.
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

    /// The largest relative deviation of a pixel's samples, divided by the threshold, per pixel. Pixels above 1 are
    /// refined.
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

// Eight bytes per pixel for the scores.
sampler_of_two_rates!(MitchellPbrt, "mitchell-pbrt", 8);
