//! Statistics that a film records.

mod sums;

pub use sums::Sums;

/// The per-pixel statistics that the film must record besides sample counts and means.
///
/// A film stores nothing that no sampler, filter or limit requests.
///
/// ```
/// use dapple_core::{Film, Needs};
///
/// let sampler = Needs::none().with_variance();
/// let filter = Needs::none().with_halves().with_features();
/// let both = sampler.and(filter);
/// assert!(both.variance && both.halves && both.features);
///
/// assert_eq!(Film::bytes_per_pixel(&Needs::none()), 32);
/// assert_eq!(Film::bytes_per_pixel(&sampler), 56);
/// ```
#[non_exhaustive]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Needs {
    /// Sample variance per pixel and channel.
    pub variance: bool,
    /// Smallest and largest sample per pixel, of each channel and of luminance.
    pub extrema: bool,
    /// Two independently scrambled halves of each pixel's samples: the only unbiased error estimate for low-discrepancy
    /// samples. Halves raise the image's error (a net of n points beats two of n/2), so request them only if they are
    /// read.
    pub halves: bool,
    /// Mean and variance of albedo, normal, depth and position of the first rough surface
    /// ([`SurfaceFeatures`](crate::SurfaceFeatures)).
    pub features: bool,
    /// The number of samples per pixel, from the first on, whose first hits are stored one by one.
    pub first_hits: u8,
    /// The cost of each pixel's samples, in rays.
    pub cost: bool,
    /// The mean emission of light sources seen directly ([`Estimate::emission`](crate::Estimate::emission)).
    pub emission: bool,
    /// The indirect light ([`Estimate::indirect`](crate::Estimate::indirect)): its mean, and with `variance` its variance.
    pub indirect: bool,
    /// Light that samples add to other pixels ([`Worker::splat`](crate::Worker::splat)).
    pub splats: bool,
    /// The number of values beside the radiance whose means are recorded ([`Worker::channels`](crate::Worker::channels)).
    pub channels: u16,
    /// Features of each half's samples alone, besides those of all samples.
    pub feature_halves: bool,
    /// Sums of functions of each sample, such as `x ln x`.
    pub sums: Sums,
    /// The number of samples per pixel and half, from the first on, whose radiance is stored one by one.
    pub samples: u32,
    /// The [`Trajectory`](crate::Trajectory) of each sample that is stored one by one.
    pub trajectories: bool,
}

impl Needs {
    /// No statistics besides sample counts and means.
    pub const fn none() -> Self {
        Self {
            variance: false,
            extrema: false,
            halves: false,
            features: false,
            first_hits: 0,
            cost: false,
            emission: false,
            indirect: false,
            splats: false,
            channels: 0,
            feature_halves: false,
            sums: Sums::NONE,
            samples: 0,
            trajectories: false,
        }
    }

    /// Adds the sample variance per pixel and channel.
    #[must_use]
    pub const fn with_variance(mut self) -> Self {
        self.variance = true;
        self
    }

    /// Adds the smallest and largest sample per pixel.
    #[must_use]
    pub const fn with_extrema(mut self) -> Self {
        self.extrema = true;
        self
    }

    /// Adds the split of each pixel's samples into two independently scrambled halves.
    #[must_use]
    pub const fn with_halves(mut self) -> Self {
        self.halves = true;
        self
    }

    /// Adds mean and variance of albedo, normal, depth and position of the first rough surface.
    #[must_use]
    pub const fn with_features(mut self) -> Self {
        self.features = true;
        self
    }

    /// Adds the first hits of at least the first `k` samples per pixel, stored one by one.
    #[must_use]
    pub const fn with_first_hits(mut self, k: u8) -> Self {
        if k > self.first_hits {
            self.first_hits = k;
        }
        self
    }

    /// Adds the cost of each pixel's samples, in rays.
    #[must_use]
    pub const fn with_cost(mut self) -> Self {
        self.cost = true;
        self
    }

    /// Adds the mean emission of light sources seen directly.
    #[must_use]
    pub const fn with_emission(mut self) -> Self {
        self.emission = true;
        self
    }

    /// Adds the mean of the indirect light, and with [`Needs::variance`] its variance.
    #[must_use]
    pub const fn with_indirect(mut self) -> Self {
        self.indirect = true;
        self
    }

    /// Adds light that samples add to other pixels.
    #[must_use]
    pub const fn with_splats(mut self) -> Self {
        self.splats = true;
        self
    }

    /// Adds the means, and with [`Needs::variance`] the variances, of this number of values beside the radiance.
    #[must_use]
    pub const fn with_channels(mut self, channels: u16) -> Self {
        if channels > self.channels {
            self.channels = channels;
        }
        self
    }

    /// Adds halves, features, and features of each half's samples alone.
    #[must_use]
    pub const fn with_feature_halves(mut self) -> Self {
        self.feature_halves = true;
        self.with_halves().with_features()
    }

    /// Adds sums of functions of each sample.
    #[must_use]
    pub const fn with_sums(mut self, sums: Sums) -> Self {
        self.sums = self.sums.and(sums);
        self
    }

    /// Adds the radiance of at least the first `k` samples per pixel and half, stored one by one: 24 + 12 `k` bytes per
    /// pixel and half. `u32::MAX` stores all samples.
    #[must_use]
    pub const fn with_samples(mut self, k: u32) -> Self {
        if k > self.samples {
            self.samples = k;
        }
        self
    }

    /// Adds the trajectories of the samples that are stored one by one: 24 bytes per pixel and half, and 16 per sample. Without
    /// [`Needs::with_samples`] there are none.
    #[must_use]
    pub const fn with_trajectories(mut self) -> Self {
        self.trajectories = true;
        self
    }

    /// The union: the statistics that `self` or `other` requests.
    #[must_use]
    pub const fn and(self, other: Self) -> Self {
        Self {
            variance: self.variance || other.variance,
            extrema: self.extrema || other.extrema,
            halves: self.halves || other.halves,
            features: self.features || other.features,
            first_hits: if self.first_hits > other.first_hits { self.first_hits } else { other.first_hits },
            cost: self.cost || other.cost,
            emission: self.emission || other.emission,
            indirect: self.indirect || other.indirect,
            splats: self.splats || other.splats,
            channels: if self.channels > other.channels { self.channels } else { other.channels },
            feature_halves: self.feature_halves || other.feature_halves,
            sums: self.sums.and(other.sums),
            samples: if self.samples > other.samples { self.samples } else { other.samples },
            trajectories: self.trajectories || other.trajectories,
        }
    }

    /// The number of values per pixel and half beside the radiance: the channels, then the indirect light.
    pub(crate) const fn values(&self) -> usize {
        self.channels as usize + if self.indirect { 3 } else { 0 }
    }

    /// The number of feature planes per half: 2, or 0 if the film does not record them.
    pub(crate) const fn feature_planes(&self) -> usize {
        if self.feature_halves && self.halves { 2 } else { 0 }
    }

    /// Returns `true` if any of these statistics reads first hits, so that the integrator must report them.
    pub const fn wants_first_hit(&self) -> bool {
        self.features || self.feature_halves || self.first_hits > 0 || self.trajectories
    }
}
