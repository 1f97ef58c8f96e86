//! Light that leaves the lights: rays for photons, virtual lights and bidirectional paths, with their densities.

use super::{Expectation, Light, LightSource, Lights, SelectedLight, Target};
use crate::shading::{ShadingFrame, warp};
use dapple_geometry::{Ray, SurfacePoint, spawn_ray};
use glam::Vec3;
use std::f32::consts::FRAC_1_PI;
use std::f64::consts::PI;

/// The largest random number below 1.
const BELOW_ONE: f32 = 1.0 - f32::EPSILON / 2.0;

/// The sphere around a scene. Light from infinity enters it through a disk of its radius.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SceneSphere {
    pub(crate) centre: Vec3,
    pub(crate) radius: f32,
}

impl SceneSphere {
    /// Returns the area density of a point on the disk, and 1 / pi for a scene that is a point.
    fn disk_pdf(&self) -> f32 {
        FRAC_1_PI / (self.radius * self.radius)
    }

    /// Returns the emission of parallel light: a ray in the unit `direction` that starts on the disk in front of the
    /// sphere, at the place `u` in `[0, 1)^2`.
    pub(super) fn parallel(&self, direction: Vec3, radiance: Vec3, pdf: f32, u: [f32; 2]) -> EmittedLight {
        let (disk, frame) = (warp::concentric_disk(u), ShadingFrame::from_normal(direction));
        let on = frame.tangent * disk.x + frame.bitangent * disk.y - direction;
        let (position, pdf) = (self.centre + on * self.radius, self.parallel_pdf(pdf));
        EmittedLight { light: 0, pmf: 1.0, source: Target::Far, position, direction, radiance, cosine: 1.0, pdf }
    }

    /// Returns the densities of parallel light whose direction has the solid-angle density `direction`.
    pub(super) fn parallel_pdf(&self, direction: f32) -> EmissionPdf {
        EmissionPdf { position: self.disk_pdf(), direction }
    }
}

/// The densities with which [`Lights::sample_emission`] samples a ray, without the selection of the light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EmissionPdf {
    /// The area density of the ray's origin: on the surface of an area light, or on the disk of the scene's radius across
    /// the rays of a light from infinity. 1 for a point or a spot.
    pub position: f32,
    /// The solid-angle density of the direction. 1 for a distant light.
    pub direction: f32,
}

/// A ray that leaves a light, with the light along it.
#[derive(Clone, Copy, Debug)]
pub struct EmittedLight {
    /// The index of the light in [`Lights`].
    pub light: u32,
    /// The probability with which the light was selected.
    pub pmf: f32,
    /// The place that the ray leaves: [`Target::Surface`] with the normal on the emitting side, [`Target::Point`], or
    /// [`Target::Far`].
    pub source: Target,
    /// The origin of the ray. For a light from infinity, a point outside the sphere around the scene.
    pub position: Vec3,
    /// The unit direction of the ray.
    pub direction: Vec3,
    /// The linear RGB radiance along the ray. For a point or spot light, the radiant intensity; for a distant light, the
    /// irradiance on a surface that faces it.
    pub radiance: Vec3,
    /// The cosine between the ray and the normal of an area light; 1 for other lights.
    pub cosine: f32,
    /// The densities of the ray.
    pub pdf: EmissionPdf,
}

impl EmittedLight {
    /// Returns the flux that the ray stands for: radiance times cosine over all densities. Its mean over random rays is
    /// the power of all lights.
    pub fn flux(&self) -> Vec3 {
        self.radiance * (self.cosine / (self.pmf * self.pdf.position * self.pdf.direction))
    }

    /// Returns the ray. It starts above the surface of an area light.
    pub fn ray(&self) -> Ray {
        match &self.source {
            Target::Surface(point) => spawn_ray(point, self.direction),
            _ => Ray::new(self.position, self.direction),
        }
    }

    /// Returns the emission of a point on an area light. `point` has its normal on the emitting side, and `u` in
    /// `[0, 1)^2` selects the side of a two-sided lamp and the direction.
    pub(super) fn from_surface(
        lamp: &super::Lamp,
        mut point: SurfacePoint,
        u: [f32; 2],
        area: f32,
    ) -> Option<EmittedLight> {
        let mut u = u;
        if lamp.two_sided {
            let below = u[0] >= 0.5;
            u[0] = (2.0 * u[0] - if below { 1.0 } else { 0.0 }).min(BELOW_ONE);
            point.normal = if below { -point.normal } else { point.normal };
        }
        let local = warp::cosine_hemisphere(u);
        let direction = ShadingFrame::from_normal(point.normal).to_world(local).normalize();
        Self::leaving(lamp, point, direction, area)
    }

    /// Returns the emission of a point on an area light in a direction. Both were sampled with the densities of
    /// [`Self::from_surface`].
    pub(super) fn leaving(lamp: &super::Lamp, point: SurfacePoint, direction: Vec3, area: f32) -> Option<EmittedLight> {
        let cosine = point.normal.dot(direction);
        let pdf = lamp.emission_pdf(cosine, area);
        let (position, source, radiance) = (point.position, Target::Surface(point), lamp.radiance);
        let emitted = EmittedLight { light: 0, pmf: 1.0, source, position, direction, radiance, cosine, pdf };
        (area > 0.0 && cosine > 0.0).then_some(emitted)
    }

    /// Returns the emission of a point without extent, in a direction sampled with density `pdf`.
    pub(super) fn from_point(position: Vec3, direction: Vec3, intensity: Vec3, pdf: f32) -> EmittedLight {
        let (source, pdf) = (Target::Point(position), EmissionPdf { position: 1.0, direction: pdf });
        EmittedLight { light: 0, pmf: 1.0, source, position, direction, radiance: intensity, cosine: 1.0, pdf }
    }
}

impl super::Lamp {
    /// Returns the densities of a ray that leaves a lamp of this area. `cosine` is taken between the ray and the normal
    /// of the emitting side.
    pub(super) fn emission_pdf(&self, cosine: f32, area: f32) -> EmissionPdf {
        let direction = if self.two_sided { 0.5 * cosine.abs() } else { cosine.max(0.0) } * FRAC_1_PI;
        EmissionPdf { position: area.recip(), direction }
    }
}

impl Lights {
    /// Samples a ray that leaves a light: the light by `choice` in `[0, 1)`, as [`Lights::select`] does; the place on it
    /// and the direction by `place` and `towards` in `[0, 1)^2`.
    ///
    /// Places are uniform on area lights. Light from infinity leaves a disk of the radius of the sphere around the
    /// scene, across its direction. Directions follow the cosine of a surface, the texels of an environment, and the
    /// cone of a spot. Returns `None` if no light leaves there.
    pub fn sample_emission(&self, choice: f32, place: [f32; 2], towards: [f32; 2]) -> Option<EmittedLight> {
        self.sample_emission_of(self.select(choice)?, place, towards)
    }

    /// Samples a ray that leaves a selected light, as [`Lights::sample_emission`] does.
    pub fn sample_emission_of(
        &self,
        selected: SelectedLight,
        place: [f32; 2],
        towards: [f32; 2],
    ) -> Option<EmittedLight> {
        let light = &self.lights[selected.index as usize];
        let mut emitted = light.emit(&self.scene, place, towards)?;
        (emitted.light, emitted.pmf) = (selected.index, selected.pmf);
        let flux = emitted.flux();
        (flux != Vec3::ZERO && flux.is_finite()).then_some(emitted)
    }

    /// Returns the densities with which [`Lights::sample_emission`] samples a ray in the unit `direction` from a point
    /// of the light, once the light is selected.
    ///
    /// `normal` is the normal of an area light on its emitting side; other lights ignore it. A direction into which
    /// nothing is emitted has density 0. A distant light has density 1 for every direction, since it has only one.
    pub fn emission_pdf(&self, light: u32, normal: Vec3, direction: Vec3) -> EmissionPdf {
        self.lights[light as usize].emission_pdf(&self.scene, normal, direction)
    }

    /// Returns the solid-angle density with which [`Lights::sample_emission`] samples light that arrives from the unit
    /// direction `w` out of an environment, with the selection of its light. Returns 0 without an environment.
    pub fn environment_emission_pdf(&self, w: Vec3) -> f32 {
        let density = |(_, pdf, light): (Vec3, f32, u32)| pdf * self.pmf(light);
        self.environments.iter().map(|environment| density(environment.find(w))).sum()
    }

    /// Returns the luminance of a light's radiant power. An environment or a distant light counts with the power that enters
    /// the sphere around the scene.
    pub fn power(&self, light: u32) -> f64 {
        PI * self.lights[light as usize].power(f64::from(self.scene.radius))
    }

    /// Returns true if a light has no extent: a point, a spot or a distant light.
    pub fn is_delta(&self, light: u32) -> bool {
        self.lights[light as usize].is_delta()
    }

    /// Returns the centre and the radius of a sphere around a light; `None` for light from infinity.
    pub fn light_sphere(&self, light: u32) -> Option<(Vec3, f32)> {
        match self.lights[light as usize].expectation() {
            Expectation::Near { middle, radius, .. } => Some((middle, radius)),
            Expectation::Far { .. } => None,
        }
    }

    /// Returns the centre, the radius and the radiance of a light that is a ball shining outwards; `None` for others.
    pub fn ball(&self, light: u32) -> Option<(Vec3, f32, Vec3)> {
        match &self.lights[light as usize] {
            Light::Sphere(sphere) => sphere.seen_from_outside(),
            _ => None,
        }
    }

    /// Returns the largest radiant intensity of a point or spot light; `None` for others.
    pub fn intensity(&self, light: u32) -> Option<Vec3> {
        match &self.lights[light as usize] {
            Light::Point(point) => Some(point.intensity()),
            Light::Spot(spot) => Some(spot.intensity()),
            _ => None,
        }
    }

    /// Returns the centre and the radius of the sphere around the scene.
    pub fn scene_sphere(&self) -> (Vec3, f32) {
        (self.scene.centre, self.scene.radius)
    }
}
