//! Point lights: light of the same intensity in all directions from a single point.

use super::punctual::checked;
use super::{
    EmissionPdf, EmittedLight, Expectation, LightSample, LightSource, PunctualError, SceneSphere, Target, luminance,
};
use crate::shading::warp;
use crate::space::Space;
use dapple_scene::Source;
use glam::{DAffine3, Vec3};

/// A point that emits the same radiant intensity in all directions.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PointLight {
    position: Vec3,
    /// The linear RGB radiant intensity, in the renderer's units.
    intensity: Vec3,
}

/// The largest coordinate of a point light in the renderer's space; squares of larger ones may overflow.
const FARTHEST: f64 = 1e18;

impl PointLight {
    /// Makes a point light at the origin of the light's space. Returns `None` if the intensity is 0.
    pub(crate) fn new(
        intensity: [f32; 3],
        to_world: DAffine3,
        space: &Space,
        at: &Source,
    ) -> Result<Option<Self>, PunctualError> {
        let Some(intensity) = checked(intensity, at)? else { return Ok(None) };
        let position = space.point(to_world.translation);
        if !position.is_finite() {
            return Err(PunctualError::Transform { at: at.clone() });
        }
        // The irradiance (intensity over squared distance) must not depend on the unit of length, so the intensity is
        // scaled.
        let intensity = (intensity.as_dvec3() * space.scale() * space.scale()).as_vec3();
        if position.abs().max_element() > FARTHEST || !intensity.is_finite() {
            return Err(PunctualError::Beyond { at: at.clone() });
        }
        // An intensity that underflows f32 counts as 0.
        Ok((intensity != Vec3::ZERO).then_some(Self { position: position.as_vec3(), intensity }))
    }

    /// Returns the light that arrives at the point `from` if the light has the same intensity in all directions. A
    /// spot light applies its falloff to the result. Returns `None` at the light's position and where the light
    /// underflows to 0.
    #[inline]
    pub(super) fn arriving(&self, from: Vec3) -> Option<LightSample> {
        let to = self.position - from;
        let squared = to.length_squared();
        let wi = to / squared.sqrt();
        let radiance = self.intensity / squared;
        // At the light's own position, there is no direction.
        let arrives = radiance != Vec3::ZERO && radiance.is_finite();
        arrives.then_some(LightSample { wi, radiance, pdf: 1.0, target: Target::Point(self.position), delta: true })
    }

    pub(super) fn position(&self) -> Vec3 {
        self.position
    }

    pub(super) fn intensity(&self) -> Vec3 {
        self.intensity
    }

    /// Returns the expectation of a point light at this position that emits a given intensity in all directions.
    pub(super) fn expectation_of(&self, intensity: f64) -> Expectation {
        Expectation::Near { middle: self.position, radius: 0.0, facing: Vec3::ZERO, intensity: intensity as f32 }
    }
}

impl LightSource for PointLight {
    #[inline]
    fn sample(&self, from: Vec3, _: [f32; 2]) -> Option<LightSample> {
        self.arriving(from)
    }

    fn is_delta(&self) -> bool {
        true
    }

    fn emit(&self, _: &SceneSphere, _: [f32; 2], towards: [f32; 2]) -> Option<EmittedLight> {
        let direction = warp::uniform_sphere(towards);
        Some(EmittedLight::from_point(self.position, direction, self.intensity, warp::uniform_sphere_pdf()))
    }

    fn emission_pdf(&self, _: &SceneSphere, _: Vec3, _: Vec3) -> EmissionPdf {
        EmissionPdf { position: 1.0, direction: warp::uniform_sphere_pdf() }
    }

    /// Returns the luminance of the intensity times 4 pi, divided by pi.
    fn power(&self, _: f64) -> f64 {
        4.0 * luminance(self.intensity)
    }

    fn expectation(&self) -> Expectation {
        self.expectation_of(luminance(self.intensity))
    }
}
