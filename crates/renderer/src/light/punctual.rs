//! Lights without extent: points, spots and distant lights.

use super::source::{EmissionPdf, EmittedLight, Expectation, LightSample, LightSource, SceneSphere, Target, luminance};
use crate::SceneError;
use crate::shading::{ShadingFrame, warp};
use crate::space::{Space, even_scale};
use dapple_geometry::SurfacePoint;
use dapple_scene::{Source, SpotFalloff};
use glam::{DAffine3, DVec3, Vec3};

/// Checks an intensity or irradiance: all channels must be finite and at least 0. Returns `None` if all are 0.
pub(super) fn checked(value: [f32; 3], at: &Source) -> Result<Option<Vec3>, SceneError> {
    if value.iter().any(|x| !(x.is_finite() && *x >= 0.0)) {
        let remedy = "use finite numbers of at least 0";
        return Err(SceneError::new(at, format!("the light's intensity {value:?} is invalid; {remedy}")));
    }
    Ok((value != [0.0; 3]).then_some(Vec3::from_array(value)))
}

pub(super) fn transform_error(at: &Source) -> SceneError {
    let what = "the light's transform is not finite or not invertible, or stretches a spot's cone; only move, rotate, \
                mirror or scale it uniformly";
    SceneError::new(at, what)
}

/// A point that emits the same radiant intensity in all directions.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PointLight {
    position: Vec3,
    /// The linear RGB radiant intensity, in the renderer's units.
    pub(super) intensity: Vec3,
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
    ) -> Result<Option<Self>, SceneError> {
        let Some(intensity) = checked(intensity, at)? else { return Ok(None) };
        let position = space.point(to_world.translation);
        if !position.is_finite() {
            return Err(transform_error(at));
        }
        // The irradiance (intensity over squared distance) must not depend on the unit of length, so the intensity is
        // scaled.
        let intensity = (intensity.as_dvec3() * space.scale() * space.scale()).as_vec3();
        if position.abs().max_element() > FARTHEST || !intensity.is_finite() {
            let what =
                "the light is too strong or too far away for a scene of this size; dim it, or use a distant light";
            return Err(SceneError::new(at, what));
        }
        // An intensity that underflows f32 counts as 0.
        Ok((intensity != Vec3::ZERO).then_some(Self { position: position.as_vec3(), intensity }))
    }

    /// Returns the expectation of a point light at this position with the given intensity in all directions.
    fn expectation_of(&self, intensity: f64) -> Expectation {
        Expectation::Near { middle: self.position, radius: 0.0, facing: Vec3::ZERO, intensity: intensity as f32 }
    }
}

impl LightSource for PointLight {
    /// Returns `None` at the light's position and where the light underflows to 0.
    #[inline]
    fn sample(&self, from: Vec3, _: [f32; 2]) -> Option<LightSample> {
        let to = self.position - from;
        let squared = to.length_squared();
        let wi = to / squared.sqrt();
        let radiance = self.intensity / squared;
        // At the light's own position, there is no direction.
        let arrives = radiance != Vec3::ZERO && radiance.is_finite();
        arrives.then_some(LightSample { wi, radiance, pdf: 1.0, target: Target::Point(self.position), delta: true })
    }

    fn is_delta(&self) -> bool {
        true
    }

    fn emit(&self, _: &SceneSphere, _: [f32; 2], towards: [f32; 2]) -> Option<EmittedLight> {
        let direction = warp::uniform_sphere(towards);
        Some(EmittedLight::from_point(self.position, direction, self.intensity, warp::uniform_sphere_pdf()))
    }

    fn emission_pdf(&self, _: &SceneSphere, _: &SurfacePoint, _: Vec3) -> EmissionPdf {
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

/// A point that emits light into a cone.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SpotLight {
    /// The position, and the intensity along the axis.
    pub(super) point: PointLight,
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
    ) -> Result<Option<Self>, SceneError> {
        if !(0.0 <= falloff_start && falloff_start <= cone && 0.0 < cone && cone <= 180.0) {
            let what = format!("the spot's cone of {cone} degrees with a falloff from {falloff_start} is invalid");
            return Err(SceneError::new(at, what + "; use 0 <= start <= cone <= 180, cone above 0"));
        }
        if even_scale(&to_world.matrix3).is_none() {
            return Err(transform_error(at));
        }
        let axis = (to_world.matrix3 * DVec3::Z).normalize().as_vec3();
        let height = |degrees: f32| (2.0 * (0.5 * f64::from(degrees).to_radians()).sin().powi(2)) as f32;
        let point = PointLight::new(intensity, to_world, space, at)?;
        Ok(point.map(|point| Self { point, axis, edge: height(cone), core: height(falloff_start), falloff }))
    }

    /// Returns the intensity relative to the intensity on the axis, 0 to 1, at the angle whose `1 - cos` is `height`.
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

    /// Returns the spot's power relative to a point light with the axis intensity in all directions, 0 to 1.
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
    fn sample(&self, from: Vec3, u: [f32; 2]) -> Option<LightSample> {
        let mut sample = self.point.sample(from, u)?;
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
        let intensity = self.point.intensity * self.share(1.0 - local.z);
        Some(EmittedLight::from_point(self.point.position, direction, intensity, warp::uniform_cone_pdf(self.edge)))
    }

    fn emission_pdf(&self, _: &SceneSphere, _: &SurfacePoint, direction: Vec3) -> EmissionPdf {
        let inside = 0.5 * (direction - self.axis).length_squared() <= self.edge;
        EmissionPdf { position: 1.0, direction: if inside { warp::uniform_cone_pdf(self.edge) } else { 0.0 } }
    }

    /// Returns the luminance of the axis intensity times 4 pi times the relative power, divided by pi.
    fn power(&self, _: f64) -> f64 {
        4.0 * luminance(self.point.intensity) * self.share_of_sphere()
    }

    /// Returns the expectation of a point light of the same power. A cell may be partly inside the cone, so the
    /// cone's shape is learned.
    fn expectation(&self) -> Expectation {
        self.point.expectation_of(luminance(self.point.intensity) * self.share_of_sphere())
    }
}

/// Parallel light from one direction, infinitely far away.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DistantLight {
    /// The unit direction from the scene to the light.
    towards: Vec3,
    irradiance: Vec3,
}

impl DistantLight {
    /// Makes parallel light that comes from direction +z of the light's space. Returns `None` if the irradiance is 0.
    pub(crate) fn new(irradiance: [f32; 3], to_world: DAffine3, at: &Source) -> Result<Option<Self>, SceneError> {
        let Some(irradiance) = checked(irradiance, at)? else { return Ok(None) };
        match (to_world.matrix3 * DVec3::Z).try_normalize() {
            Some(towards) => Ok(Some(Self { towards: towards.as_vec3(), irradiance })),
            None => Err(transform_error(at)),
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

    fn emission_pdf(&self, scene: &SceneSphere, _: &SurfacePoint, _: Vec3) -> EmissionPdf {
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
