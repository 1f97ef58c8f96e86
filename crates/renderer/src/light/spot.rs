//! Spot lights: light from a single point into a cone.

use super::{
    EmissionPdf, EmittedLight, Expectation, LightSample, LightSource, PointLight, PunctualError, SceneSphere, luminance,
};
use crate::shading::{ShadingFrame, warp};
use crate::space::{Space, even_scale};
use dapple_scene::{Source, SpotFalloff};
use glam::{DAffine3, DVec3, Vec3};

/// A point that emits light into a cone.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SpotLight {
    point: PointLight,
    /// The unit vector along the cone's axis, in the direction of emission.
    axis: Vec3,
    /// `1 - cos` of the angle from the axis at which the cone ends. (The cosine of a narrow cone would round to 1.)
    edge: f32,
    /// `1 - cos` of the angle from the axis at which the falloff starts.
    core: f32,
    falloff: SpotFalloff,
}

impl SpotLight {
    /// Makes a spot light at the origin of the light's space that emits along +z. `cone` and `falloff_start` are
    /// angles in degrees. Returns `None` if the intensity is 0.
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
        let point = PointLight::new(intensity, to_world, space, at)?;
        Ok(point.map(|point| Self { point, axis, edge: height(cone), core: height(falloff_start), falloff }))
    }

    /// Returns the intensity relative to the one on the axis, 0 to 1, at an angle whose `1 - cos` is `height`.
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

    /// Returns the intensity along the axis.
    pub(super) fn intensity(&self) -> Vec3 {
        self.point.intensity()
    }

    /// Returns the light's power relative to a point light with the axis intensity in all directions, 0 to 1.
    fn share_of_sphere(&self) -> f64 {
        let [edge, core] = [self.edge, self.core].map(f64::from);
        // The means of the two falloff functions over x from 0 to 1.
        let mean = match self.falloff {
            SpotFalloff::Smoothstep => 0.5,
            SpotFalloff::Quartic => 0.2,
        };
        0.5 * (core + (edge - core) * mean)
    }
}

impl LightSource for SpotLight {
    #[inline]
    fn sample(&self, from: Vec3, _: [f32; 2]) -> Option<LightSample> {
        let mut sample = self.point.arriving(from)?;
        // `1 - cos` comes from the chord, which keeps precision in narrow cones.
        let share = self.share(0.5 * (sample.wi + self.axis).length_squared());
        sample.radiance *= share;
        (sample.radiance != Vec3::ZERO).then_some(sample)
    }

    fn is_delta(&self) -> bool {
        true
    }

    fn emit(&self, _: &SceneSphere, _: [f32; 2], towards: [f32; 2]) -> Option<EmittedLight> {
        let local = warp::uniform_cone(towards, self.edge);
        let direction = ShadingFrame::from_normal(self.axis).to_world(local).normalize();
        let intensity = self.point.intensity() * self.share(1.0 - local.z);
        Some(EmittedLight::from_point(self.point.position(), direction, intensity, warp::uniform_cone_pdf(self.edge)))
    }

    fn emission_pdf(&self, _: &SceneSphere, _: Vec3, direction: Vec3) -> EmissionPdf {
        let inside = 0.5 * (direction - self.axis).length_squared() <= self.edge;
        EmissionPdf { position: 1.0, direction: if inside { warp::uniform_cone_pdf(self.edge) } else { 0.0 } }
    }

    /// Returns the luminance of the axis intensity times 4 pi times the relative power, divided by pi.
    fn power(&self, _: f64) -> f64 {
        4.0 * luminance(self.point.intensity()) * self.share_of_sphere()
    }

    /// Returns the expectation of a point light of the same power. The cone may cross a cell anywhere, so its shape is
    /// learned.
    fn expectation(&self) -> Expectation {
        self.point.expectation_of(luminance(self.point.intensity()) * self.share_of_sphere())
    }
}
