//! Tests of expectations by sample means.

use super::levels::{critical, sidak, student_tail};
use dapple_metrics::student_t_quantile;

/// The outcome of an equivalence test.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// The claim holds at the significance level of the test.
    Pass,
    /// The claim is refuted at the significance level of the test.
    Fail,
    /// The samples decide neither; more are needed.
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

    /// The standard error of the mean.
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

    /// Tests that the expectation is below `bound`: the mean must be below by `z` standard errors.
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

    /// Tests that the expectation lies within `delta` of `reference`, by two one-sided tests at `z` standard errors.
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

    /// The difference in standard errors. Without spread, 0 if the means are equal, else infinite.
    pub fn t(&self) -> f64 {
        if self.difference == 0.0 { 0.0 } else { self.difference / self.standard_error }
    }

    /// The two-sided p-value.
    pub fn p(&self) -> f64 {
        2.0 * student_tail(self.t().abs(), self.degrees_of_freedom)
    }

    /// The standard normal deviate about as probable as t [after Wallace 1959].
    pub fn z(&self) -> f64 {
        let (t, v) = (self.t(), self.degrees_of_freedom);
        ((8.0 * v + 1.0) / (8.0 * v + 3.0) * (v * (t * t / v).ln_1p()).sqrt()).copysign(t)
    }
}

/// The outcome of the sequential equivalence test [`decide`].
#[derive(Clone, Copy, Debug)]
pub struct Decided {
    /// The verdict; [`Verdict::Fail`] if the cap leaves it undecided.
    pub verdict: Verdict,
    /// The mean of all samples.
    pub mean: Mean,
}

/// Tests that the expectation of `draw` lies within `delta` of `reference`, with as many samples as needed.
///
/// The test starts with `first` samples and doubles their number while undecided, up to `cap`, where undecided counts
/// as failed. A false claim passes with probability `alpha` at most, over all steps together.
pub fn decide(reference: f64, delta: f64, alpha: f64, first: u64, cap: u64, mut draw: impl FnMut() -> f64) -> Decided {
    let looks = (cap / first).max(1).ilog2() as usize + 1;
    let level = sidak(alpha, looks);
    let mut mean = Mean::default();
    let mut wanted = first;
    loop {
        while mean.n < wanted {
            mean.add(draw());
        }
        let z = student_t_quantile(1.0 - level, (mean.n - 1) as f64);
        let verdict = mean.equals(reference, delta, z);
        match verdict {
            Verdict::Undecided if 2 * wanted <= cap => wanted *= 2,
            Verdict::Undecided => return Decided { verdict: Verdict::Fail, mean },
            _ => return Decided { verdict, mean },
        }
    }
}

/// The number of samples for which an equivalence test at level `alpha` passes a true claim with probability `1 -
/// beta`. It is `((z_alpha + z_beta/2) spread / delta)^2`, for samples of standard deviation `spread` and a tolerance
/// `delta`.
pub fn samples_needed(spread: f64, delta: f64, alpha: f64, beta: f64) -> u64 {
    ((critical(alpha) + critical(0.5 * beta)) * spread / delta).powi(2).ceil() as u64
}
