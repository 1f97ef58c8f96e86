//! What a film has to record.

/// What somebody reads of the samples. Nothing is stored that nobody asked for; sample counts and
/// means always are.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Needs {
    /// Sample variance per pixel and channel.
    pub variance: bool,
    /// Smallest and largest sample per pixel, of each channel and of luminance.
    pub extrema: bool,
    /// Two independently scrambled halves per pixel: the only honest error estimate of
    /// low-discrepancy samples. They cost accuracy (a net of n points beats two of n/2), so only a
    /// sampler, a filter or an error limit that reads them should ask.
    pub halves: bool,
    /// Mean and variance of the first hit's albedo, normal, depth and position.
    pub features: bool,
    /// The first hits of the first `k` samples of each pixel, kept one by one.
    pub first_hits: u8,
    /// What the samples of each pixel cost, in rays.
    pub cost: bool,
}

impl Needs {
    /// Counts and means only.
    pub const fn none() -> Self {
        Self { variance: false, extrema: false, halves: false, features: false, first_hits: 0, cost: false }
    }

    /// These, and the sample variance.
    pub const fn with_variance(mut self) -> Self {
        self.variance = true;
        self
    }

    /// These, and the extrema.
    pub const fn with_extrema(mut self) -> Self {
        self.extrema = true;
        self
    }

    /// These, and two halves.
    pub const fn with_halves(mut self) -> Self {
        self.halves = true;
        self
    }

    /// These, and first-hit features with their variance.
    pub const fn with_features(mut self) -> Self {
        self.features = true;
        self
    }

    /// These, and the first hits of at least the first `k` samples.
    pub const fn with_first_hits(mut self, k: u8) -> Self {
        if k > self.first_hits {
            self.first_hits = k;
        }
        self
    }

    /// These, and the cost per pixel.
    pub const fn with_cost(mut self) -> Self {
        self.cost = true;
        self
    }

    /// What either asks for.
    pub const fn and(self, other: Self) -> Self {
        Self {
            variance: self.variance || other.variance,
            extrema: self.extrema || other.extrema,
            halves: self.halves || other.halves,
            features: self.features || other.features,
            first_hits: if self.first_hits > other.first_hits { self.first_hits } else { other.first_hits },
            cost: self.cost || other.cost,
        }
    }

    /// Whether the integrator has to report first hits.
    pub const fn wants_first_hit(&self) -> bool {
        self.features || self.first_hits > 0
    }
}
