//! Statistics of the features of one pixel.

use serde::{Deserialize, Serialize};

/// Running means of a pixel's features (shading normal, albedo, position, depth), and the squared deviations of each
/// feature, summed over its channels. They no longer change after 65,535 samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct FeatureMoments {
    pub(crate) samples: u16,
    pub(crate) hits: u16,
    pub(crate) mean: [f32; 10],
    pub(crate) m2: [f32; 4],
}

impl FeatureMoments {
    /// Adds normal, albedo, position and depth of a sample, or a miss (`None`). Rare paths count only while the pixel has
    /// no samples.
    #[inline]
    pub(crate) fn push(&mut self, values: Option<[f32; 10]>, is_rare: bool) {
        if self.samples > 0 && is_rare || self.samples == u16::MAX {
            return;
        }
        self.samples += 1;
        let Some(values) = values else { return };
        self.hits += 1;
        let share = 1.0 / f32::from(self.hits);
        let mut squares = [0.0; 10];
        for ((mean, square), x) in self.mean.iter_mut().zip(&mut squares).zip(values) {
            let delta = x - *mean;
            *mean += delta * share;
            *square = delta * (x - *mean);
        }
        for (m2, square) in self.m2.iter_mut().zip(sums(&squares)) {
            *m2 = (*m2 + square).min(f32::MAX);
        }
    }

    /// Returns `true` if more feature-only samples would help: there are fewer than `FEW` samples, or fewer than `MANY`
    /// that vary.
    pub(crate) fn wants_more(&self) -> bool {
        /// The number of samples that suffice if their features are equal.
        const FEW: u16 = 4;
        /// The number of samples that suffice if their features vary.
        const MANY: u16 = 12;
        /// The variances of normal and albedo, summed over channels, below which features count as equal.
        const EQUAL: [f32; 2] = [1e-3, 1e-4];
        let ([normal, albedo, ..], hits) = (self.m2, f32::from(self.hits));
        let varies =
            self.hits > 0 && (self.hits < self.samples || normal > EQUAL[0] * hits || albedo > EQUAL[1] * hits);
        self.samples < FEW || self.samples < MANY && varies
    }
}

/// The sums over the channels of normal, albedo, position and depth.
fn sums([nx, ny, nz, r, g, b, x, y, z, depth]: &[f32; 10]) -> [f32; 4] {
    [nx + ny + nz, r + g + b, x + y + z, *depth]
}

/// Mean and sample variance of one pixel's [`SurfaceFeatures`](crate::SurfaceFeatures), over the samples that hit a surface. A
/// sample without surface features contributes the features of its first hit.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Features {
    /// The number of samples of the pixel, at most 65,535. It includes [feature-only
    /// samples](crate::Integrator::features_alone), and a [rare](crate::SurfaceFeatures::rare) sample only if it is the first.
    pub samples: u32,
    /// The number of samples that hit a surface.
    pub hits: u32,
    /// Mean shading normal; its length is below 1 if normals differ.
    pub normal: [f32; 3],
    /// Mean albedo, linear RGB in `[0, 1]`.
    pub albedo: [f32; 3],
    /// Mean position, in the integrator's units.
    pub position: [f32; 3],
    /// Mean length of the path to the surface, in the integrator's units.
    pub depth: f32,
    /// Sample variances of normal, albedo and position, each summed over its three channels, and of depth; `None` for fewer
    /// than two hits.
    pub variance: Option<[f32; 4]>,
}

impl From<&FeatureMoments> for Features {
    fn from(f: &FeatureMoments) -> Self {
        let v = |k: usize| [f.mean[k], f.mean[k + 1], f.mean[k + 2]];
        Self {
            samples: f.samples.into(),
            hits: f.hits.into(),
            normal: v(0),
            albedo: v(3),
            position: v(6),
            depth: f.mean[9],
            variance: (f.hits >= 2).then(|| f.m2.map(|m| m / f32::from(f.hits - 1))),
        }
    }
}
