//! S1 and S4: means, and whether they are what they should be.

use super::levels::{critical, sidak, student_tail};
use dapple_metrics::student_t_quantile;

/// What an equivalence test found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// The claim holds at the level asked for.
    Pass,
    /// The claim is refuted at that level.
    Fail,
    /// Neither: more samples are needed.
    Undecided,
}

/// Mean and its standard error, by Welford's recurrence.
#[derive(Clone, Copy, Debug, Default)]
pub struct Mean {
    /// How many.
    pub n: u64,
    /// Their mean.
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
    /// Takes in one value.
    pub fn add(&mut self, x: f64) {
        self.n += 1;
        let d = x - self.mean;
        self.mean += d / self.n as f64;
        self.m2 += d * (x - self.mean);
    }

    /// Standard error of the mean.
    pub fn standard_error(&self) -> f64 {
        (self.m2 / (self.n - 1) as f64 / self.n as f64).sqrt()
    }

    /// By how many standard errors the mean exceeds `reference`.
    pub fn deviation(&self, reference: f64) -> f64 {
        (self.mean - reference) / self.standard_error()
    }

    /// S1: whether the values' expectation is `reference`, which is exact.
    pub fn against(&self, reference: f64) -> MeanTest {
        MeanTest::new(self.mean - reference, self.standard_error(), (self.n - 1) as f64)
    }

    /// S1: whether two expectations are equal, whatever their variances [after Welch 1947].
    pub fn against_estimate(&self, reference: &Self) -> MeanTest {
        let [a, b] = [self, reference].map(|m| (m.standard_error().powi(2), (m.n - 1) as f64));
        let variance = a.0 + b.0;
        let degrees =
            if variance > 0.0 { variance * variance / (a.0 * a.0 / a.1 + b.0 * b.0 / b.1) } else { a.1 + b.1 };
        MeanTest::new(self.mean - reference.mean, variance.sqrt(), degrees)
    }

    /// Whether the mean is below `bound`, with `z` standard errors to spare.
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

    /// S4: whether the mean lies within `delta` of `reference` (two one-sided tests).
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

/// What a test of means found.
#[derive(Clone, Copy, Debug)]
pub struct MeanTest {
    /// Mean less reference.
    pub difference: f64,
    /// Of the difference.
    pub standard_error: f64,
    /// Of its t.
    pub degrees_of_freedom: f64,
}

impl MeanTest {
    fn new(difference: f64, standard_error: f64, degrees_of_freedom: f64) -> Self {
        Self { difference, standard_error, degrees_of_freedom }
    }

    /// The difference in standard errors; without any spread 0 where the means are equal, else infinite.
    pub fn t(&self) -> f64 {
        if self.difference == 0.0 { 0.0 } else { self.difference / self.standard_error }
    }

    /// Two-sided p-value.
    pub fn p(&self) -> f64 {
        2.0 * student_tail(self.t().abs(), self.degrees_of_freedom)
    }

    /// A standard normal deviate about as probable as t [after Wallace 1959].
    pub fn z(&self) -> f64 {
        let (t, v) = (self.t(), self.degrees_of_freedom);
        ((8.0 * v + 1.0) / (8.0 * v + 3.0) * (v * (t * t / v).ln_1p()).sqrt()).copysign(t)
    }
}

/// Samples that let S4 decide: how many, and what was found.
#[derive(Clone, Copy, Debug)]
pub struct Decided {
    /// Undecided at the cap is [`Verdict::Fail`].
    pub verdict: Verdict,
    /// Of all samples drawn.
    pub mean: Mean,
}

/// S4 with samples as needed: `first` of them, and twice as many while undecided, up to `cap`, where undecided is failed.
/// The claim is wrongly passed with probability `alpha` at most, all looks together.
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

/// How many samples S4 needs to pass what is true with probability `1 - beta` at level `alpha`, for a standard deviation
/// `spread` of a sample: `((z_alpha + z_beta/2) spread / delta)^2`.
pub fn samples_needed(spread: f64, delta: f64, alpha: f64, beta: f64) -> u64 {
    ((critical(alpha) + critical(0.5 * beta)) * spread / delta).powi(2).ceil() as u64
}
