//! Parameters of the error-driven sampler, and its preset `variance`: Neyman allocation from the pooled variance of a pilot.

use crate::{Adaptive, PoolShape};
use dapple_core::options::{Options as _, OutOfRange};
use dapple_core::{Error, Film, Needs, PointSet, plan::PilotPolicy};

dapple_core::options! {
    /// The parameters of the error-driven sampler [`Adaptive`](crate::Adaptive). The defaults are those of `dapple
    /// render`.
    pub struct AdaptiveOptions {
        /// Samples per pixel before counts adapt; 0 = automatic, max(min(spp/2, 8), spp/4).
        ///
        /// An automatic pilot is rounded down to a well-stratified count of at least 4, or 1 with [`PilotPolicy::Neighbours`].
        /// An explicit pilot needs 2 samples for a variance. With [`PilotPolicy::Neighbours`], 1 suffices; with
        /// [`PilotPolicy::Cross`], each half needs 2.
        pub pilot: u32 = 0;
        /// Rounds after the pilot; 0 = automatic (3 with policy=keep, 2 with neighbours, 1 with discard or cross).
        ///
        /// Each round is planned from the samples before it. With [`PilotPolicy::Neighbours`], more than two rounds would
        /// bias the image; with [`PilotPolicy::Discard`] and [`PilotPolicy::Cross`], more than one.
        pub rounds: u32 = 0, |rounds| rounds <= 64, "1 to 64; 0 chooses";
        /// Weights of neighbours in the pooled variance: similar (higher for similar pixels) or window (equal).
        pub pool: PoolShape = PoolShape::Similar => "similar";
        /// Radius of the pooling window in pixels; with pool=similar, twice this if any pixel has fewer than 4 samples.
        pub radius: u32 = 2, |radius| radius <= 64, "at most 64 pixels";
        /// Weight of the pooled variance when averaged with the pixel's own, in degrees of freedom; inf: use only the pooled variance.
        pub prior: f64 = 12.0 => "12", |prior| prior >= 0.0, "a weight of 0 or more, or inf";
        /// Exponent applied to variances before pooling; above 1, the noisiest neighbours weigh more.
        ///
        /// See [`Pooling::power`](crate::Pooling::power).
        pub power: f64 = 1.0 => "1", |power| power > 0.0 && power <= 4.0, "above 0 and at most 4";
        /// Squared error is assumed to fall as n^-exponent with n samples; for independent points, values above 1 count as 1.
        pub exponent: f64 = 1.15, |rate| rate > 0.0 && rate <= 3.0, "above 0 and at most 3";
        /// Added to the denominator (mean^2) of relative squared errors; 0.2 suits the default filter, 0.01 no filter.
        pub epsilon: f64 = 0.2, |epsilon| epsilon > 0.0 && epsilon.is_finite(), "a number above zero";
        /// Maximum samples per pixel, as a multiple of the mean.
        pub cap: f64 = 8.0 => "8", |cap| cap >= 1.0 && cap.is_finite(), "at least 1";
        /// With by=FILTER: exponent of the filter's error map in its geometric mean with the variance estimate, 0 to 1.
        pub mix: f64 = 0.5, |mix| (0.0..=1.0).contains(&mix), "a fraction from 0 to 1";
        /// Use adaptive counts only if their predicted error is at most this fraction of uniform sampling's; inf: always.
        ///
        /// At 1, counts stay uniform only if the ladder makes adaptive counts worse than uniform ones.
        pub gain: f64 = 0.98, |gain| (0.0..=1.0).contains(&gain) || gain == f64::INFINITY, "a fraction from 0 to 1, or inf";
        /// Pilot samples: keep (biased), neighbours (kept; set only neighbours' counts), discard, cross (each half sets the other's counts).
        pub policy: PilotPolicy = PilotPolicy::Neighbours => "neighbours",
            |policy| !matches!(policy, PilotPolicy::Refined), "keep, neighbours, discard or cross";
        /// Unit of cost in the optimisation of sample counts: 0 = samples, 1 = rays.
        ///
        /// The budget is a number of samples in both cases. Rays per sample are pooled over the window.
        pub cost: u32 = 0, |cost| cost <= 1, "0 or 1";
    }
}

impl AdaptiveOptions {
    /// The number of rounds after the pilot.
    pub(crate) fn rounds_after_pilot(&self) -> u32 {
        match (self.rounds, self.policy) {
            (0, PilotPolicy::Keep) => 3,
            (0, PilotPolicy::Neighbours) => 2,
            (0, _) => 1,
            (rounds, _) => rounds,
        }
    }

    /// Checks all options and their combination.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] for a value out of range, and for these combinations:
    ///
    /// * [`PilotPolicy::Keep`] or [`PilotPolicy::Discard`] with a pilot of 1
    /// * [`PilotPolicy::Discard`] with more than one round
    /// * [`PilotPolicy::Cross`] with more than one round, a pilot below 4, or `cost` 1
    /// * [`PilotPolicy::Neighbours`] with more than two rounds or a radius of 0
    pub fn check(&self) -> Result<(), Error> {
        self.check_ranges()?;
        let Self { pilot, rounds, radius, policy, cost, .. } = *self;
        let (crosses, reads_neighbours) = (policy == PilotPolicy::Cross, policy == PilotPolicy::Neighbours);
        let is_one_round = crosses || policy == PilotPolicy::Discard;
        let name = || policy.name().to_owned();
        let (option, value, allowed) = if pilot == 1 && !reads_neighbours {
            ("pilot", pilot.to_string(), "at least 2, since a variance needs two samples; 0 chooses")
        } else if crosses && (1..4).contains(&pilot) {
            ("pilot", pilot.to_string(), "at least 4, since each half needs two samples; 0 chooses")
        } else if is_one_round && rounds > 1 {
            ("rounds", rounds.to_string(), "1 with discard or cross, as more rounds would bias the image")
        } else if reads_neighbours && rounds > 2 {
            let allowed = "1 or 2 with neighbours, as a third round would bias the image; policy=keep allows more";
            ("rounds", rounds.to_string(), allowed)
        } else if crosses && cost == 1 {
            ("policy", name(), "keep, neighbours or discard with cost=1, as costs are not recorded per half")
        } else if reads_neighbours && radius == 0 {
            ("policy", name(), "keep or discard with radius 0, or a larger radius with neighbours")
        } else {
            return Ok(());
        };
        Err(OutOfRange { name: option, value, allowed }.into())
    }
}

/// A function of a film that returns the expected squared error per pixel, relative to the squared image.
pub type MapErrors = Box<dyn Fn(&Film) -> Result<Vec<f32>, Error> + Send>;

/// An additional source of error estimates: a filter that predicts the error of the filtered image.
pub struct ErrorMap {
    /// The name of the error map in the sampler's description.
    pub name: String,
    /// The statistics that the map reads from the film.
    pub needs: Needs,
    /// The function that returns the predicted squared error of each pixel of the filtered image, row by row, relative to the
    /// squared image. The scale is arbitrary; negative numbers and NaN count as 0.
    pub of: MapErrors,
    /// The peak working memory of `of` in bytes per pixel.
    pub bytes_per_pixel: usize,
}

dapple_core::options! {
    /// The parameters of the error-driven sampler's preset `variance` ([`Adaptive::variance`]).
    pub struct VarianceOptions {
        /// Samples per pixel before counts adapt; 0 = automatic, max(min(spp/2, 8), spp/4).
        ///
        /// See [`AdaptiveOptions::pilot`].
        pub pilot: u32 = 0;
        /// Radius in pixels of the window over which variance and mean are pooled.
        pub radius: u32 = 2;
        /// Squared error is assumed to fall as n^-exponent with n samples; for independent points, values above 1 count as 1.
        ///
        /// The default suits Owen-scrambled points.
        pub exponent: f64 = 1.3;
        /// Added to the denominator (mean^2) of relative squared errors.
        pub epsilon: f64 = 0.01;
        /// Maximum samples per pixel, as a multiple of the mean.
        pub cap: f64 = 6.0 => "6";
        /// Pilot samples: keep (biased), neighbours (kept; set only neighbours' counts), discard, cross (each half sets the other's counts).
        pub policy: PilotPolicy = PilotPolicy::Keep => "keep",
            |policy| !matches!(policy, PilotPolicy::Refined), "keep, discard, cross or neighbours";
        /// Unit of cost in the optimisation of sample counts: 0 = samples, 1 = rays.
        ///
        /// See [`AdaptiveOptions::cost`].
        pub cost: u32 = 0;
    }
}

impl From<VarianceOptions> for AdaptiveOptions {
    /// Converts to options with one round, variances pooled over the window alone, and no comparison with uniform
    /// counts.
    fn from(o: VarianceOptions) -> Self {
        let VarianceOptions { pilot, radius, exponent, epsilon, cap, policy, cost } = o;
        let (rounds, pool, prior, power, gain) = (1, PoolShape::Window, f64::INFINITY, 1.0, f64::INFINITY);
        let given = Self { pilot, radius, exponent, epsilon, cap, policy, cost, ..Self::default() };
        Self { rounds, pool, prior, power, gain, ..given }
    }
}

/// The preset `variance`: counts by Neyman's rule [Neyman 1934] from a uniform pilot.
///
/// The pilot's sample variance, relative to `mean^2 + epsilon` and pooled over 5x5 pixels, determines all counts at once. With
/// unpooled variances of 4 samples, the error is 1.2 to 3.3 times the error of uniform counts. Pooled variances are nearly as
/// good as exact ones.
impl<P: PointSet> Adaptive<P> {
    /// Creates the preset `variance` of the error-driven sampler, with this point set and the default parameters.
    pub fn variance(points: P) -> Self {
        Self::preset(points, VarianceOptions::default())
    }

    /// Creates the preset `variance` of the error-driven sampler, with this point set and these parameters.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`], under the conditions of [`AdaptiveOptions::check`].
    pub fn variance_with_options(points: P, options: VarianceOptions) -> Result<Self, Error> {
        AdaptiveOptions::from(options).check()?;
        Ok(Self::preset(points, options))
    }

    fn preset(points: P, options: VarianceOptions) -> Self {
        Self { points, options: options.into(), preset: Some(options), errors: None }
    }
}
