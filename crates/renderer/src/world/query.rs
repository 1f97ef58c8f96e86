//! Queries of the geometry for code outside this crate.

use super::World;
use dapple_geometry::{Hit, Ray, SurfacePoint};

impl World {
    /// The closest hit of a ray at a [`time`](Self::time), and its point with the normal turned as the shape's material
    /// sees it.
    pub fn first_surface(&self, ray: &Ray, time: f32) -> Option<(Hit, SurfacePoint)> {
        self.closest_at(ray, time).map(|at| (at.hit, at.point))
    }

    /// The number of a shape's material.
    pub fn shape_material(&self, shape: u32) -> u32 {
        self.part(shape).material
    }
}
