//! Spheres, disks and rings that emit light.

use super::source::{
    EmittedLight, Expectation, Lamp, LightSample, LightSource, SceneSphere, Target, area_to_solid_angle, sample_on,
};
use crate::shading::{ShadingFrame, warp};
use dapple_geometry::{PrimitiveId, SurfacePoint};
use glam::Vec3;

/// A sphere that emits light.
#[derive(Clone, Debug)]
pub(crate) struct SphereLight {
    lamp: Lamp,
    centre: Vec3,
    radius: f32,
    /// The distance from the centre below which a point counts as inside: the radius plus a margin for rounding.
    reach: f32,
    /// -1 if the sphere emits inwards, and 1 if it emits outwards.
    flip: f32,
}

impl SphereLight {
    /// Makes a spherical light. `flip` is -1 if it emits inwards, and 1 if it emits outwards.
    pub(crate) fn new(lamp: Lamp, centre: Vec3, radius: f32, flip: f32) -> Self {
        // The rounding of a point on the sphere affects its distance from the centre by up to this much.
        let error = (centre.length() + radius) * (4.0 * f32::EPSILON);
        Self { lamp, centre, radius, reach: radius + error, flip }
    }

    /// Returns the centre, the radius and the radiance; `None` if the sphere emits inwards only.
    pub(super) fn seen_from_outside(&self) -> Option<(Vec3, f32, Vec3)> {
        let radiance = self.lamp.radiance(self.flip);
        (radiance != Vec3::ZERO).then_some((self.centre, self.radius, radiance))
    }

    /// Returns the squared sine of half the angle that the sphere subtends at the point `axis`, given relative to the sphere's
    /// centre. Returns `None` inside the sphere.
    #[inline]
    fn sine_squared(&self, axis: Vec3) -> Option<f32> {
        let squared = axis.length_squared();
        (squared > self.reach * self.reach).then(|| self.radius * self.radius / squared)
    }

    /// Returns the point of the sphere with this unit outward normal, and a bound on its rounding error.
    #[inline]
    fn point(&self, normal: Vec3) -> SurfacePoint {
        let position = self.centre + normal * self.radius;
        // Three roundings per coordinate, plus the rounding of the normal.
        let error = (self.centre.abs() + Vec3::splat(self.radius)) * (4.0 * f32::EPSILON);
        SurfacePoint { position, error, normal, primitive: PrimitiveId::NONE }
    }
}

impl LightSource for SphereLight {
    /// From outside, samples the cone that the sphere subtends uniformly. From inside or on the sphere, samples the
    /// area uniformly.
    ///
    /// The cone's height `1 - cos` is computed from the sine, so that it does not vanish at large distances [Pharr et
    /// al. 2023, sec. 6.2.4].
    #[inline]
    fn sample(&self, from: Vec3, u: [f32; 2]) -> Option<LightSample> {
        let axis = from - self.centre;
        let Some(sin2) = self.sine_squared(axis) else {
            let normal = warp::uniform_sphere(u);
            return sample_on(&self.lamp, from, self.point(normal), self.flip, self.area() as f32);
        };
        let height = warp::one_minus_cos(sin2);
        let local = warp::uniform_cone(u, height);
        // The angle at the centre between the axis and the nearest intersection. Both terms keep precision at any
        // distance [Pharr et al. 2023, eq. 6.6].
        let sin2_theta = local.x * local.x + local.y * local.y;
        let sin_max = sin2.sqrt();
        let cos_alpha = sin2_theta / sin_max + local.z * (1.0 - sin2_theta / sin2).max(0.0).sqrt();
        let sin_alpha = (1.0 - cos_alpha * cos_alpha).max(0.0).sqrt();
        let frame = ShadingFrame::from_normal(axis.normalize());
        let around = if sin2_theta > 0.0 { 1.0 / sin2_theta.sqrt() } else { 0.0 };
        let normal = frame.to_world(Vec3::new(local.x * around * sin_alpha, local.y * around * sin_alpha, cos_alpha));
        let point = self.point(normal.normalize());
        let wi = frame.to_world(Vec3::new(local.x, local.y, -local.z)).normalize();
        // The nearest intersection is seen from outside.
        let radiance = self.lamp.radiance(self.flip);
        let (pdf, target) = (warp::uniform_cone_pdf(height), Target::Surface(point));
        (radiance != Vec3::ZERO).then_some(LightSample { wi, radiance, pdf, target, delta: false })
    }

    #[inline]
    fn pdf(&self, from: Vec3, point: &SurfacePoint) -> f32 {
        match self.sine_squared(from - self.centre) {
            Some(sin2) => warp::uniform_cone_pdf(warp::one_minus_cos(sin2)),
            None => area_to_solid_angle(from, point, self.area() as f32),
        }
    }

    #[inline]
    fn lamp(&self) -> Option<&Lamp> {
        Some(&self.lamp)
    }

    fn area(&self) -> f64 {
        4.0 * std::f64::consts::PI * f64::from(self.radius) * f64::from(self.radius)
    }

    fn emit(&self, _: &SceneSphere, place: [f32; 2], towards: [f32; 2]) -> Option<EmittedLight> {
        if self.lamp.two_sided || self.flip < 0.0 {
            let mut point = self.point(warp::uniform_sphere(place));
            point.normal *= self.flip;
            return EmittedLight::from_surface(&self.lamp, point, towards, self.area() as f32);
        }
        // The direction is sampled first, by `towards` alone; then a point on the disk onto which the sphere projects. The
        // joint density is the same.
        let direction = warp::uniform_sphere(towards);
        let (disk, frame) = (warp::concentric_disk(place), ShadingFrame::from_normal(direction));
        let cosine = (1.0 - disk.length_squared()).max(0.0).sqrt();
        let normal = (frame.tangent * disk.x + frame.bitangent * disk.y + direction * cosine).normalize();
        EmittedLight::leaving(&self.lamp, self.point(normal), direction, self.area() as f32)
    }

    fn expectation(&self) -> Expectation {
        // A sphere's projected area is a quarter of its surface.
        let intensity = self.lamp.intensity(self.area() * 0.25);
        Expectation::Near { middle: self.centre, radius: self.radius, facing: Vec3::ZERO, intensity }
    }
}

/// A disk or ring that emits light.
#[derive(Clone, Debug)]
pub(crate) struct DiskLight {
    lamp: Lamp,
    centre: Vec3,
    frame: ShadingFrame,
    radius: f32,
    inner_radius: f32,
}

impl DiskLight {
    /// Makes a disk or ring around `centre` that emits to the side of `normal` (unit length).
    pub(crate) fn new(lamp: Lamp, centre: Vec3, normal: Vec3, radius: f32, inner_radius: f32) -> Self {
        Self { lamp, centre, frame: ShadingFrame::from_normal(normal), radius, inner_radius }
    }

    /// Returns the point of the disk or ring that `u` in `[0, 1)^2` selects, by an area-preserving map from the disk to the
    /// ring.
    #[inline]
    fn point(&self, u: [f32; 2]) -> SurfacePoint {
        let disk = warp::concentric_disk(u);
        let hole = self.inner_radius / self.radius;
        let r2 = disk.length_squared();
        let wanted = (hole * hole + r2 * (1.0 - hole * hole)).sqrt();
        let on = if hole > 0.0 && r2 > 0.0 { disk * (wanted / r2.sqrt()) } else { disk };
        let position = self.centre + (self.frame.tangent * on.x + self.frame.bitangent * on.y) * self.radius;
        let error = (self.centre.abs() + Vec3::splat(self.radius)) * (4.0 * f32::EPSILON);
        SurfacePoint { position, error, normal: self.frame.normal, primitive: PrimitiveId::NONE }
    }
}

impl LightSource for DiskLight {
    #[inline]
    fn sample(&self, from: Vec3, u: [f32; 2]) -> Option<LightSample> {
        sample_on(&self.lamp, from, self.point(u), 1.0, self.area() as f32)
    }

    #[inline]
    fn pdf(&self, from: Vec3, point: &SurfacePoint) -> f32 {
        area_to_solid_angle(from, point, self.area() as f32)
    }

    #[inline]
    fn lamp(&self) -> Option<&Lamp> {
        Some(&self.lamp)
    }

    fn area(&self) -> f64 {
        let [outer, inner] = [self.radius, self.inner_radius].map(f64::from);
        std::f64::consts::PI * (outer - inner) * (outer + inner)
    }

    fn emit(&self, _: &SceneSphere, place: [f32; 2], towards: [f32; 2]) -> Option<EmittedLight> {
        EmittedLight::from_surface(&self.lamp, self.point(place), towards, self.area() as f32)
    }

    fn expectation(&self) -> Expectation {
        let (facing, intensity) = (self.lamp.facing(self.frame.normal), self.lamp.intensity(self.area()));
        Expectation::Near { middle: self.centre, radius: self.radius, facing, intensity }
    }
}
