//! First guesses of what a light contributes, for selection that is learned.

use glam::Vec3;

/// The strength of a light, as far as a first guess of its contribution needs it.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Expectation {
    /// A light within the scene.
    Near {
        middle: Vec3,
        radius: f32,
        /// Mean of its normals: shorter the more they differ, zero where it emits from both sides.
        facing: Vec3,
        /// Radiant intensity along `facing`.
        intensity: f32,
    },
    /// A light beyond the scene.
    Far {
        /// Unit direction to the light; zero where it comes from all sides.
        towards: Vec3,
        irradiance: f32,
    },
}

impl Expectation {
    /// About the irradiance of surfaces within `half` of `at` whose normals are nearest to `axis`, without occlusion.
    ///
    /// Above 0 also for a light on the wrong side: cells are not points.
    pub(crate) fn irradiance(&self, at: Vec3, half: f32, axis: Vec3) -> f32 {
        // Normals are up to 55 degrees off the axis.
        let received = |cosine: f32| ((cosine + 0.5) / 1.5).clamp(0.05, 1.0);
        match *self {
            Self::Near { middle, radius, facing, intensity } => {
                let to = middle - at;
                let wi = to.normalize_or_zero();
                let emitted = (-facing.dot(wi)).max(0.0) + 0.5 * (1.0 - facing.length()).max(0.0) + 0.05;
                let squared = to.length_squared() + radius * radius + half * half;
                intensity * emitted * received(axis.dot(wi)) / squared
            }
            Self::Far { towards, irradiance } if towards == Vec3::ZERO => irradiance,
            Self::Far { towards, irradiance } => irradiance * received(axis.dot(towards)),
        }
    }
}
