//! Distant lights: parallel light from infinity.

use super::punctual::checked;
use super::{
    EmissionPdf, EmittedLight, Expectation, LightSample, LightSource, PunctualError, SceneSphere, Target, luminance,
};
use dapple_scene::Source;
use glam::{DAffine3, DVec3, Vec3};

/// Parallel light from one direction, infinitely far away.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DistantLight {
    /// The unit direction from the scene to the light.
    towards: Vec3,
    irradiance: Vec3,
}

impl DistantLight {
    /// Makes parallel light that comes from direction +z of the light's space. Returns `None` if the irradiance is 0.
    pub(crate) fn new(irradiance: [f32; 3], to_world: DAffine3, at: &Source) -> Result<Option<Self>, PunctualError> {
        let Some(irradiance) = checked(irradiance, at)? else { return Ok(None) };
        match (to_world.matrix3 * DVec3::Z).try_normalize() {
            Some(towards) => Ok(Some(Self { towards: towards.as_vec3(), irradiance })),
            None => Err(PunctualError::Transform { at: at.clone() }),
        }
    }
}

impl LightSource for DistantLight {
    #[inline]
    fn sample(&self, _: Vec3, _: [f32; 2]) -> Option<LightSample> {
        let (wi, radiance) = (self.towards, self.irradiance);
        Some(LightSample { wi, radiance, pdf: 1.0, target: Target::Far, delta: true })
    }

    fn is_delta(&self) -> bool {
        true
    }

    fn emit(&self, scene: &SceneSphere, place: [f32; 2], _: [f32; 2]) -> Option<EmittedLight> {
        Some(scene.parallel(-self.towards, self.irradiance, 1.0, place))
    }

    fn emission_pdf(&self, scene: &SceneSphere, _: Vec3, _: Vec3) -> EmissionPdf {
        scene.parallel_pdf(1.0)
    }

    /// Returns the luminance of the irradiance times the cross section `pi r^2` of the scene's bounding sphere,
    /// divided by pi.
    fn power(&self, scene_radius: f64) -> f64 {
        luminance(self.irradiance) * scene_radius * scene_radius
    }

    fn expectation(&self) -> Expectation {
        Expectation::Far { towards: self.towards, irradiance: luminance(self.irradiance) as f32 }
    }
}
