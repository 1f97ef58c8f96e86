//! Approximations of the lights' contributions, which learned selection uses before it has samples.

use glam::Vec3;

/// A light's strength and position, reduced to the numbers that approximate its contribution anywhere in the scene.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Expectation {
    /// A light within the scene: an area, point or spot light.
    Near {
        middle: Vec3,
        radius: f32,
        /// The mean of the emitting sides' unit normals. It is shorter the more they differ, and zero if the light
        /// emits to all sides.
        facing: Vec3,
        /// The luminance of the radiant intensity along `facing`.
        intensity: f32,
    },
    /// A light from infinity: an environment, a tile of it, or a distant light.
    Far {
        /// The unit direction to the light; zero if light comes from all sides.
        towards: Vec3,
        irradiance: f32,
    },
}

impl Expectation {
    /// Returns the approximate unoccluded irradiance in a cell: on surfaces within distance `half` of `at` whose
    /// normals are nearest to `axis`.
    ///
    /// The value is positive even if the light is behind `at`, since other points of the cell may see it.
    pub(crate) fn irradiance(&self, at: Vec3, half: f32, axis: Vec3) -> f32 {
        // Normals of a cell deviate from the axis by up to 55 degrees.
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
