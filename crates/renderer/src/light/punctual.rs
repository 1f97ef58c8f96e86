//! Errors and checks of lights without extent: point, spot and distant lights.

use dapple_scene::Source;
use glam::Vec3;

/// The reason why a point, spot or distant light was refused.
#[non_exhaustive]
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PunctualError {
    /// The intensity or irradiance is negative or not finite.
    #[error("{at}: the light's intensity {value:?} is invalid; give finite numbers of at least 0")]
    Value {
        /// The line of the scene file that defines the light.
        at: Source,
        /// The invalid intensity or irradiance, linear RGB.
        value: [f32; 3],
    },
    /// The intensity or the distance overflows single precision in units of the scene's size.
    #[error(
        "{at}: the light is too strong or too far away for a scene of this size; reduce it, or use a distant light"
    )]
    Beyond {
        /// The line of the scene file that defines the light.
        at: Source,
    },
    /// The angles of a spot light do not describe a cone.
    #[error(
        "{at}: the spot's cone of {cone} degrees with a falloff from {falloff_start} is invalid; give 0 <= start <= cone <= 180, cone above 0"
    )]
    Cone {
        /// The line of the scene file that defines the light.
        at: Source,
        /// The angle from the axis at which the cone ends, in degrees.
        cone: f32,
        /// The angle from the axis at which the falloff starts, in degrees.
        falloff_start: f32,
    },
    /// The light's transform flattens space, stretches a spot's cone, or is not finite.
    #[error(
        "{at}: the light's transform flattens space, stretches the cone of a spot, or is not finite; move, rotate, mirror and scale uniformly only"
    )]
    Transform {
        /// The line of the scene file that defines the light.
        at: Source,
    },
}

/// Checks an intensity or irradiance: all channels must be finite and at least 0. Returns `None` if all are 0.
pub(super) fn checked(value: [f32; 3], at: &Source) -> Result<Option<Vec3>, PunctualError> {
    if value.iter().any(|x| !(x.is_finite() && *x >= 0.0)) {
        return Err(PunctualError::Value { at: at.clone(), value });
    }
    Ok((value != [0.0; 3]).then_some(Vec3::from_array(value)))
}
