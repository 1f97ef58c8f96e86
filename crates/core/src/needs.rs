//! Statistics that a film records.

use serde::{Deserialize, Serialize};

/// Declares the statistics: name, type, the method that adds it, its name in errors (empty if it is optional), and the
/// statistics that it implies. A number is the maximum that any method needs.
macro_rules! needs {
    ($($(#[$doc:meta])* $name:ident: $Kind:tt, $with:ident, $called:literal $([$($also:ident),*])?;)*) => {
        /// The per-pixel statistics that the film must record besides sample counts and means.
        ///
        /// A film stores only what a sampler, filter or limit requests. A [`Recorder`](crate::film::Recorder) stores
        /// statistics that only one sampler or filter reads.
        ///
        /// ```
        /// use dapple_core::{Film, Needs};
        ///
        /// let sampler = Needs::none().with_variance();
        /// let filter = Needs::none().with_halves().with_features();
        /// let both = sampler.and(filter);
        /// assert!(both.variance && both.halves && both.features);
        ///
        /// assert_eq!(Film::bytes_per_pixel(&Needs::none()), 28);
        /// assert_eq!(Film::bytes_per_pixel(&sampler), 40);
        /// ```
        #[non_exhaustive]
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
        pub struct Needs {
            $($(#[$doc])* pub $name: $Kind,)*
        }

        impl Needs {
            /// No statistics besides sample counts and means.
            pub const fn none() -> Self {
                Self { $($name: needs! { @none $Kind },)* }
            }

            /// Adds the statistics that `other` requests.
            #[must_use]
            pub fn and(self, other: Self) -> Self {
                Self { $($name: self.$name.max(other.$name),)* }
            }

            /// The name of the first statistic that `needed` requests and `self` lacks.
            pub(crate) fn lacking(&self, needed: &Self) -> Option<&'static str> {
                $(if needed.$name > self.$name && !$called.is_empty() { return Some($called); })*
                None
            }

            $(needs! { @with $(#[$doc])* $name: $Kind, $with $([$($also),*])? })*
        }
    };
    (@none bool) => { false };
    (@none $Kind:tt) => { 0 };
    (@with $(#[$doc:meta])* $name:ident: bool, $with:ident $([$($also:ident),*])?) => {
        /// Adds this statistic:
        ///
        $(#[$doc])*
        #[must_use]
        pub const fn $with(mut self) -> Self {
            self.$name = true;
            $($(self.$also = true;)*)?
            self
        }
    };
    (@with $(#[$doc:meta])* $name:ident: $Kind:tt, $with:ident) => {
        /// Adds this statistic, with at least `k` per pixel:
        ///
        $(#[$doc])*
        #[must_use]
        pub const fn $with(mut self, k: $Kind) -> Self {
            if k > self.$name {
                self.$name = k;
            }
            self
        }
    };
}

needs! {
    /// Sample variance per pixel and channel.
    variance: bool, with_variance, "the sample variance";
    /// Sample variance of each half. Implies `halves` and `variance`.
    half_variance: bool, with_half_variance, "the sample variance per half" [halves, variance];
    /// Two independently scrambled halves of each pixel's samples: the only unbiased error estimate for low-discrepancy
    /// samples. They raise the image's error (one net of n points is better than two of n/2), so request them only if they
    /// are read.
    halves: bool, with_halves, "independent halves";
    /// Mean and variance of albedo, normal, depth and position of the first non-specular surface
    /// ([`SurfaceFeatures`](crate::SurfaceFeatures)).
    features: bool, with_features, "first-hit features";
    /// Features of each half, besides those of all samples. Implies `halves` and `features`.
    feature_halves: bool, with_feature_halves, "first-hit features per half" [halves, features];
    /// Shape and primitive of the first hit of each pixel's first sample, from which filters find its cluster.
    surfaces: bool, with_surfaces, "the surfaces of first hits";
    /// The number of samples per pixel, from the first on, whose first hits are stored one by one.
    first_hits: u8, with_first_hits, "first hits";
    /// The cost of each pixel's samples, in rays.
    cost: bool, with_cost, "costs";
    /// The mean emission of light sources seen directly ([`Estimate::emission`](crate::Estimate::emission)).
    emission: bool, with_emission, "";
    /// The mean indirect lighting ([`Estimate::indirect`](crate::Estimate::indirect)), and its variance if `variance` is
    /// recorded.
    indirect: bool, with_indirect, "";
    /// Light that samples add to other pixels ([`Worker::splat`](crate::Worker::splat)).
    splats: bool, with_splats, "splats";
    /// The [`Trajectory`](crate::integrator::Trajectory) of each sample, which a [`Recorder`](crate::film::Recorder) stores.
    trajectories: bool, with_trajectories, "";
}

impl Needs {
    /// Returns `true` if any of these statistics comes from first hits, which the integrator must then report.
    pub const fn wants_first_hit(&self) -> bool {
        self.features || self.feature_halves || self.has_places() || self.trajectories
    }

    /// Returns `true` if each half has its own squared deviations, stored side by side, instead of a sum over both.
    pub(crate) const fn splits_variance(&self) -> bool {
        self.half_variance && self.halves
    }

    /// The number of sums of squared deviations per pixel.
    pub(crate) const fn sums(&self) -> usize {
        if self.splits_variance() { 2 } else { self.variance as usize }
    }

    /// The index of the sums of pixel `i` in a half.
    #[inline]
    pub(crate) const fn sum_at(&self, half: usize, i: usize) -> usize {
        if self.splits_variance() { 2 * i + half } else { i }
    }

    /// Returns `true` if the first hits of a pixel's first samples are stored one by one.
    pub(crate) const fn has_places(&self) -> bool {
        self.surfaces || self.first_hits > 0
    }
}
