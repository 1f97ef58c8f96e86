//! Counts, means and variances of streams of numbers.

/// Count, mean and sum of squared deviations of a stream of numbers.
///
/// [`Moments::push`] follows [Welford 1962], [`Moments::merge`] follows [Chan, Golub and LeVeque 1979]. Both stay accurate
/// if the mean is far larger than the spread.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moments {
    /// The number of values.
    pub count: u64,
    /// The mean; 0 without values.
    pub mean: f64,
    /// The sum of squared deviations from the mean; divide by `count - 1` for the sample variance.
    pub m2: f64,
}

impl Moments {
    /// Adds a value to count, mean and squared deviations.
    #[inline]
    pub fn push(&mut self, value: f64) {
        self.count += 1;
        let delta = value - self.mean;
        self.mean += delta / self.count as f64;
        self.m2 += delta * (value - self.mean);
    }

    /// Adds all values of `other`.
    pub fn merge(&mut self, other: &Self) {
        if other.count == 0 {
            return;
        }
        if self.count == 0 {
            *self = *other;
            return;
        }
        let (a, b) = (self.count as f64, other.count as f64);
        let delta = other.mean - self.mean;
        self.mean += delta * (b / (a + b));
        self.m2 += other.m2 + delta * delta * (a * b / (a + b));
        self.count += other.count;
    }

    /// The unbiased sample variance; `None` for fewer than two values.
    pub fn variance(&self) -> Option<f64> {
        (self.count >= 2).then(|| self.m2 / (self.count - 1) as f64)
    }
}

/// [`Moments`] of three channels that share their count.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RgbMoments {
    /// The number of values.
    pub count: u64,
    /// The mean per channel; 0 without values.
    pub mean: [f64; 3],
    /// The sum of squared deviations from the mean, per channel; divide by `count - 1` for the sample variance.
    pub m2: [f64; 3],
}

impl RgbMoments {
    /// The moments of `count` values with this mean and this unbiased sample variance per channel.
    pub fn new(count: u64, mean: [f64; 3], variance: [f64; 3]) -> Self {
        Self { count, mean, m2: variance.map(|v| v * count.saturating_sub(1) as f64) }
    }

    /// Adds a colour to count, means and squared deviations.
    #[inline]
    pub fn push(&mut self, value: [f32; 3]) {
        self.count += 1;
        let share = 1.0 / self.count as f64;
        for (c, x) in value.into_iter().enumerate() {
            let x = f64::from(x);
            let delta = x - self.mean[c];
            self.mean[c] += delta * share;
            self.m2[c] += delta * (x - self.mean[c]);
        }
    }

    /// Adds all values of `other`.
    pub fn merge(&mut self, other: &Self) {
        for c in 0..3 {
            let mut channel = Moments { count: self.count, mean: self.mean[c], m2: self.m2[c] };
            channel.merge(&Moments { count: other.count, mean: other.mean[c], m2: other.m2[c] });
            (self.mean[c], self.m2[c]) = (channel.mean, channel.m2);
        }
        self.count += other.count;
    }

    /// The unbiased sample variance per channel; `None` for fewer than two values, or if the deviations were not recorded
    /// and are NaN.
    pub fn variance(&self) -> Option<[f64; 3]> {
        (self.count >= 2 && !self.m2[0].is_nan()).then(|| self.m2.map(|m| m / (self.count - 1) as f64))
    }
}
