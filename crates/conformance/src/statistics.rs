//! Statistical tests of claims about images, in one place for all crates.
//!
//! | claim | test |
//! |---|---|
//! | a mean has its expectation | [`Mean::against`], [`Mean::against_estimate`] |
//! | two images have the same expectation | [`images`], [`image()`] |
//! | samples follow their density | [`chi_square`], [`integrate`] |
//! | a mean is *proven* close to a value | [`Mean::equals`] |
//! | one of two methods has less error at equal budget | `ratio_interval` and `log_log_fit` of dapple-metrics |
//! | error estimates are calibrated | [`Calibration`] |
//! | adaptive counts do not bias the image | [`kept`], [`refined`], [`Bernoulli`], [`BiasedSampler`], [`count_trend`] |
//! | two images are bit-identical | [`bits`](crate::bits), and the checks of samplers and filters |
//!
//! Seeds are fixed. The probability of any false alarm in a family of tests is at most [`FAMILY`]: each test runs at the level
//! [`sidak`], or p-values are [`adjusted`]. [`power`] computes the probability that a test detects a given fault. Assert this
//! probability, since a test that cannot fail proves nothing.
//!
//! Compute variances *between* replicates with different seeds. Samples within one low-discrepancy or adaptive image are not
//! independent.
//!
//! ```
//! use dapple_conformance::statistics::{FAMILY, Mean, sidak};
//!
//! // 32 replicates of an estimate whose expectation is 1/2.
//! let replicates: Mean = (0..32).map(|i| 0.5 + 0.01 * f64::from(i % 8 - 4) + 0.005).collect();
//! let test = replicates.against(0.5);
//! assert!(test.p() > sidak(FAMILY, 100));
//! ```
//!
//! # Panics
//!
//! All functions panic on invalid input, such as lengths that differ or fewer than two replicates.

mod image;
mod levels;

pub use image::{
    Bernoulli, BiasedSampler, Calibration, ImageTest, Pixels, count_trend, image, image_mean, images, kept, refined,
};
pub use levels::{
    FAMILY, adjusted, chi_square, critical, integrate, normal_tail, power, sidak, student_tail, two_sided,
};

/// The outcome of an equivalence test.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// The claim holds at the significance level of the test.
    Pass,
    /// The claim is refuted at the significance level of the test.
    Fail,
    /// The samples neither confirm nor refute the claim; more are needed.
    Undecided,
}

/// A sample mean and its standard error, by Welford's recurrence.
#[derive(Clone, Copy, Debug, Default)]
pub struct Mean {
    /// The number of values.
    pub n: u64,
    /// The mean of the values.
    pub mean: f64,
    m2: f64,
}

impl FromIterator<f64> for Mean {
    fn from_iter<I: IntoIterator<Item = f64>>(values: I) -> Self {
        let mut mean = Self::default();
        values.into_iter().for_each(|x| mean.add(x));
        mean
    }
}

impl Mean {
    /// Adds a value to the mean.
    pub fn add(&mut self, x: f64) {
        self.n += 1;
        let d = x - self.mean;
        self.mean += d / self.n as f64;
        self.m2 += d * (x - self.mean);
    }

    /// The standard error of the mean, from at least 2 values.
    pub fn standard_error(&self) -> f64 {
        (self.m2 / (self.n - 1) as f64 / self.n as f64).sqrt()
    }

    /// The difference of the mean from `reference`, in standard errors.
    pub fn deviation(&self, reference: f64) -> f64 {
        (self.mean - reference) / self.standard_error()
    }

    /// Tests that the expectation equals `reference`, a number without error.
    pub fn against(&self, reference: f64) -> MeanTest {
        MeanTest::new(self.mean - reference, self.standard_error(), (self.n - 1) as f64)
    }

    /// Tests that two expectations are equal, for any variances [after Welch 1947].
    pub fn against_estimate(&self, reference: &Self) -> MeanTest {
        let [a, b] = [self, reference].map(|m| (m.standard_error().powi(2), (m.n - 1) as f64));
        let variance = a.0 + b.0;
        let degrees =
            if variance > 0.0 { variance * variance / (a.0 * a.0 / a.1 + b.0 * b.0 / b.1) } else { a.1 + b.1 };
        MeanTest::new(self.mean - reference.mean, variance.sqrt(), degrees)
    }

    /// Tests that the expectation is below `bound`; undecided if the mean is within `z` standard errors of `bound`.
    pub fn below(&self, bound: f64, z: f64) -> Verdict {
        let slack = z * self.standard_error();
        if self.mean + slack < bound {
            Verdict::Pass
        } else if self.mean - slack > bound {
            Verdict::Fail
        } else {
            Verdict::Undecided
        }
    }

    /// Tests that the expectation is in `reference ± delta`; undecided if the mean is within `z` standard errors of an end.
    pub fn equals(&self, reference: f64, delta: f64, z: f64) -> Verdict {
        let slack = z * self.standard_error();
        let distance = (self.mean - reference).abs();
        if distance + slack < delta {
            Verdict::Pass
        } else if distance - slack > delta {
            Verdict::Fail
        } else {
            Verdict::Undecided
        }
    }
}

/// The outcome of a t-test of a mean.
#[derive(Clone, Copy, Debug)]
pub struct MeanTest {
    /// The mean minus the reference.
    pub difference: f64,
    /// The standard error of the difference.
    pub standard_error: f64,
    /// The degrees of freedom of Student's t.
    pub degrees_of_freedom: f64,
}

impl MeanTest {
    fn new(difference: f64, standard_error: f64, degrees_of_freedom: f64) -> Self {
        Self { difference, standard_error, degrees_of_freedom }
    }

    /// The statistic `t = difference / standard_error`; 0 for a difference of 0, even with a standard error of 0.
    pub fn t(&self) -> f64 {
        if self.difference == 0.0 { 0.0 } else { self.difference / self.standard_error }
    }

    /// The two-sided p-value.
    pub fn p(&self) -> f64 {
        2.0 * student_tail(self.t().abs(), self.degrees_of_freedom)
    }

    /// The standard normal deviate with about the same tail probability as t [after Wallace 1959].
    pub fn z(&self) -> f64 {
        let (t, v) = (self.t(), self.degrees_of_freedom);
        ((8.0 * v + 1.0) / (8.0 * v + 3.0) * (v * (t * t / v).ln_1p()).sqrt()).copysign(t)
    }
}
