//! Lights without extent: points, spots, and parallel light. Only light sampling finds them.

use super::{LightSample, Target};
use crate::space::{Space, even_scale};
use dapple_scene::{Source, SpotFalloff};
use glam::{DAffine3, DVec3, Vec3};

/// What is wrong with a light without extent.
#[non_exhaustive]
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PunctualError {
    /// Its intensity or irradiance is none.
    #[error("{at}: a light's intensity of {value:?} is none: give finite numbers of at least 0")]
    Value {
        /// Where it is said.
        at: Source,
        /// The value.
        value: [f32; 3],
    },
    /// Beside the size of the scene, single precision cannot hold it.
    #[error(
        "{at}: the light is too strong or too far away for a scene of this size: give it less, or a distant light instead"
    )]
    Beyond {
        /// Where it is said.
        at: Source,
    },
    /// Its cone is none.
    #[error(
        "{at}: a spot's cone of {cone} degrees with a falloff from {falloff_start} is none: give 0 <= start <= cone <= 180, cone above 0"
    )]
    Cone {
        /// Where it is said.
        at: Source,
        /// Angle of the edge, degrees.
        cone: f32,
        /// Angle where it begins to fall off, degrees.
        falloff_start: f32,
    },
    /// Its transform.
    #[error(
        "{at}: the light's transform flattens space, stretches the cone of a spot, or is not finite: it may move, turn, mirror and scale evenly"
    )]
    Transform {
        /// Where it is said.
        at: Source,
    },
}

/// A point that shines alike in all directions.
#[derive(Clone, Copy, Debug)]
pub struct PointLamp {
    position: Vec3,
    /// In the renderer's own units.
    intensity: Vec3,
}

/// A point that shines into a cone.
#[derive(Clone, Copy, Debug)]
pub struct SpotLamp {
    point: PointLamp,
    /// Unit, away from the lamp.
    axis: Vec3,
    /// `1 - cos` of the angles at which light ends, and begins to fall off: narrow cones have a cosine that rounds
    /// to 1.
    edge: f32,
    core: f32,
    falloff: SpotFalloff,
}

/// Parallel light from infinitely far.
#[derive(Clone, Copy, Debug)]
pub struct DistantLamp {
    /// Unit, towards the light.
    towards: Vec3,
    irradiance: Vec3,
}

/// The farthest that a point may lie from the middle of the scene, in its half widths: squares of distances to it
/// stay finite.
const FARTHEST: f64 = 1e18;

impl PointLamp {
    /// A point at the origin of the light's space. `None` if it is black.
    pub(crate) fn new(
        intensity: [f32; 3],
        to_world: DAffine3,
        space: &Space,
        at: &Source,
    ) -> Result<Option<Self>, PunctualError> {
        let Some(intensity) = sound(intensity, at)? else { return Ok(None) };
        let position = space.point(to_world.translation);
        if !position.is_finite() {
            return Err(PunctualError::Transform { at: at.clone() });
        }
        // What arrives is intensity over squared distance, which must not change with the unit of length.
        let intensity = (intensity.as_dvec3() * space.scale() * space.scale()).as_vec3();
        if position.abs().max_element() > FARTHEST || !intensity.is_finite() {
            return Err(PunctualError::Beyond { at: at.clone() });
        }
        // Below f32 all light of the scene is black.
        Ok((intensity != Vec3::ZERO).then_some(Self { position: position.as_vec3(), intensity }))
    }

    #[inline]
    pub(super) fn sample(&self, from: Vec3) -> Option<LightSample> {
        let to = self.position - from;
        let squared = to.length_squared();
        let wi = to / squared.sqrt();
        let radiance = self.intensity / squared;
        // From the point itself there is no direction.
        let arrives = radiance != Vec3::ZERO && radiance.is_finite();
        arrives.then_some(LightSample { wi, radiance, pdf: 1.0, target: Target::Point(self.position), delta: true })
    }

    pub(super) fn intensity(&self) -> Vec3 {
        self.intensity
    }

    pub(super) fn position(&self) -> Vec3 {
        self.position
    }
}

impl SpotLamp {
    /// A point at the origin of the light's space that shines along its +z; angles in degrees. `None` if it is
    /// black.
    pub(crate) fn new(
        intensity: [f32; 3],
        [cone, falloff_start]: [f32; 2],
        falloff: SpotFalloff,
        to_world: DAffine3,
        space: &Space,
        at: &Source,
    ) -> Result<Option<Self>, PunctualError> {
        if !(0.0 <= falloff_start && falloff_start <= cone && 0.0 < cone && cone <= 180.0) {
            return Err(PunctualError::Cone { at: at.clone(), cone, falloff_start });
        }
        if even_scale(&to_world.matrix3).is_none() {
            return Err(PunctualError::Transform { at: at.clone() });
        }
        let axis = (to_world.matrix3 * DVec3::Z).normalize().as_vec3();
        let height = |degrees: f32| (2.0 * (0.5 * f64::from(degrees).to_radians()).sin().powi(2)) as f32;
        let point = PointLamp::new(intensity, to_world, space, at)?;
        Ok(point.map(|point| Self { point, axis, edge: height(cone), core: height(falloff_start), falloff }))
    }

    #[inline]
    pub(super) fn sample(&self, from: Vec3) -> Option<LightSample> {
        let mut sample = self.point.sample(from)?;
        // 1 - cos from the chord, which keeps the digits of narrow cones.
        let share = self.share(0.5 * (sample.wi + self.axis).length_squared());
        sample.radiance *= share;
        (sample.radiance != Vec3::ZERO).then_some(sample)
    }

    /// Share of the intensity at an angle from the axis whose `1 - cos` is `height`.
    #[inline]
    fn share(&self, height: f32) -> f32 {
        if height <= self.core {
            return 1.0;
        }
        let x = (self.edge - height) / (self.edge - self.core);
        match self.falloff {
            _ if !(x > 0.0) => 0.0,
            SpotFalloff::Smoothstep => x * x * (3.0 - 2.0 * x),
            SpotFalloff::Quartic => (x * x) * (x * x),
        }
    }

    pub(super) fn intensity(&self) -> Vec3 {
        self.point.intensity
    }

    pub(super) fn position(&self) -> Vec3 {
        self.point.position
    }

    /// Solid angle that would take as much light, at full intensity, over 4 pi.
    pub(super) fn share_of_sphere(&self) -> f64 {
        let [edge, core] = [self.edge, self.core].map(f64::from);
        // Integrals of the falloff over x from 0 to 1.
        let mean = match self.falloff {
            SpotFalloff::Smoothstep => 0.5,
            SpotFalloff::Quartic => 0.2,
        };
        0.5 * (core + (edge - core) * mean)
    }
}

impl DistantLamp {
    /// Parallel light out of the direction +z of the light's space. `None` if it is black.
    pub(crate) fn new(irradiance: [f32; 3], to_world: DAffine3, at: &Source) -> Result<Option<Self>, PunctualError> {
        let Some(irradiance) = sound(irradiance, at)? else { return Ok(None) };
        match (to_world.matrix3 * DVec3::Z).try_normalize() {
            Some(towards) => Ok(Some(Self { towards: towards.as_vec3(), irradiance })),
            None => Err(PunctualError::Transform { at: at.clone() }),
        }
    }

    #[inline]
    pub(super) fn sample(&self) -> LightSample {
        LightSample { wi: self.towards, radiance: self.irradiance, pdf: 1.0, target: Target::Far, delta: true }
    }

    pub(super) fn irradiance(&self) -> Vec3 {
        self.irradiance
    }

    pub(super) fn towards(&self) -> Vec3 {
        self.towards
    }
}

/// Finite numbers of at least 0; `None` if all are 0.
fn sound(value: [f32; 3], at: &Source) -> Result<Option<Vec3>, PunctualError> {
    if value.iter().any(|x| !(x.is_finite() && *x >= 0.0)) {
        return Err(PunctualError::Value { at: at.clone(), value });
    }
    Ok((value != [0.0; 3]).then_some(Vec3::from_array(value)))
}
