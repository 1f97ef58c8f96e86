//! Disks and rings that emit light.

use super::{
    EmissionPdf, EmittedLight, Expectation, Lamp, LightSample, LightSource, SceneSphere, area_to_solid_angle, sample_on,
};
use crate::shading::{ShadingFrame, warp};
use dapple_geometry::{PrimitiveId, SurfacePoint};
use glam::Vec3;

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

    fn area(&self) -> f64 {
        let [outer, inner] = [self.radius, self.inner_radius].map(f64::from);
        std::f64::consts::PI * (outer - inner) * (outer + inner)
    }

    /// Returns the point of the area that belongs to `u` in `[0, 1)^2`, by an area-preserving map from the disk to the
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

    fn emit(&self, _: &SceneSphere, place: [f32; 2], towards: [f32; 2]) -> Option<EmittedLight> {
        EmittedLight::from_surface(&self.lamp, self.point(place), towards, self.area() as f32)
    }

    fn emission_pdf(&self, _: &SceneSphere, normal: Vec3, direction: Vec3) -> EmissionPdf {
        self.lamp.emission_pdf(normal.dot(direction), self.area() as f32)
    }

    fn power(&self, _: f64) -> f64 {
        self.area() * self.lamp.brightness()
    }

    fn expectation(&self) -> Expectation {
        let (facing, intensity) = (self.lamp.facing(self.frame.normal), self.lamp.intensity(self.area()));
        Expectation::Near { middle: self.centre, radius: self.radius, facing, intensity }
    }
}
