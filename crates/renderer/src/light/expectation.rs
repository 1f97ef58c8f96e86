//! First guesses of lights' contributions, for learned selection.

use glam::Vec3;

/// The strength of a light, for a first guess of its contribution.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Expectation {
    /// A light within the scene.
    Near {
        middle: Vec3,
        radius: f32,
        /// Mean of the unit normals: shorter the more they differ, zero if the light emits from both sides.
        facing: Vec3,
        /// Luminance-weighted radiant intensity along `facing`.
        intensity: f32,
    },
    /// A light beyond the scene.
    Far {
        /// Unit direction to the light; zero if it comes from all sides.
        towards: Vec3,
        irradiance: f32,
    },
}

impl Expectation {
    /// Returns the approximate unoccluded irradiance on surfaces within distance `half` of `at` whose normals are
    /// nearest to `axis`.
    ///
    /// It is above 0 even if the light is behind `at`, since cells have an extent.
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
