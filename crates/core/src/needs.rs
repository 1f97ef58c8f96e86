//! Statistics that a film records.

use serde::{Deserialize, Serialize};

/// Declares the statistics: name, kind, method that adds it, and its name in the error of a film that lacks it (empty for
/// statistics that methods do without), and those that it comes with. A number is the most that anybody needs.
macro_rules! needs {
    ($($(#[$doc:meta])* $name:ident: $Kind:tt, $with:ident, $called:literal $([$($also:ident),*])?;)*) => {
        /// The per-pixel statistics that the film must record besides sample counts and means.
        ///
        /// A film stores nothing that no sampler, filter or limit requests. What one method alone reads is a
        /// [`Recorder`](crate::film::Recorder)'s.
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

            /// Adds the statistics that `other` lists.
            #[must_use]
            pub fn and(self, other: Self) -> Self {
                Self { $($name: self.$name.max(other.$name),)* }
            }

            /// The first statistic of `needed` that these lack.
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
        /// Adds this statistic, at least `k` of it:
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
    /// Sample variance of each half's samples alone: with halves and variance.
    half_variance: bool, with_half_variance, "the sample variance per half" [halves, variance];
    /// Two independently scrambled halves of each pixel's samples: the only unbiased error estimate for low-discrepancy
    /// samples. Halves raise the image's error (a net of n points beats two of n/2), so request them only if they are
    /// read.
    halves: bool, with_halves, "independent halves";
    /// Mean and variance of albedo, normal, depth and position of the first rough surface
    /// ([`SurfaceFeatures`](crate::SurfaceFeatures)).
    features: bool, with_features, "first-hit features";
    /// Features of each half's samples alone, besides those of all samples: with halves and features.
    feature_halves: bool, with_feature_halves, "first-hit features per half" [halves, features];
    /// Shape and primitive of the first hit of each pixel's first sample, by which filters tell clusters.
    surfaces: bool, with_surfaces, "the surfaces of first hits";
    /// The number of samples per pixel, from the first on, whose first hits are stored one by one.
    first_hits: u8, with_first_hits, "first hits";
    /// The cost of each pixel's samples, in rays.
    cost: bool, with_cost, "costs";
    /// The mean emission of light sources seen directly ([`Estimate::emission`](crate::Estimate::emission)).
    emission: bool, with_emission, "";
    /// The indirect lighting ([`Estimate::indirect`](crate::Estimate::indirect)): its mean, and with `variance` its variance.
    indirect: bool, with_indirect, "";
    /// Light that samples add to other pixels ([`Worker::splat`](crate::Worker::splat)).
    splats: bool, with_splats, "splats";
    /// The [`Trajectory`](crate::integrator::Trajectory) of each sample, which a [`Recorder`](crate::film::Recorder) keeps.
    trajectories: bool, with_trajectories, "";
}

impl Needs {
    /// Returns `true` if a statistic of these is taken from first hits, so that the integrator must report them.
    pub const fn wants_first_hit(&self) -> bool {
        self.features || self.feature_halves || self.has_places() || self.trajectories
    }

    /// Returns `true` if each half has squared deviations of its own, side by side. Else those of both are summed.
    pub(crate) const fn splits_variance(&self) -> bool {
        self.half_variance && self.halves
    }

    /// The number of sums of squared deviations per pixel.
    pub(crate) const fn sums(&self) -> usize {
        if self.splits_variance() { 2 } else { self.variance as usize }
    }

    /// The place of the sums for pixel `i` of a half.
    #[inline]
    pub(crate) const fn sum_at(&self, half: usize, i: usize) -> usize {
        if self.splits_variance() { 2 * i + half } else { i }
    }

    /// Returns `true` if first hits of a pixel's first samples have places of their own.
    pub(crate) const fn has_places(&self) -> bool {
        self.surfaces || self.first_hits > 0
    }
}
