use crate::build::{Preset, build_tree};
use crate::frame::Frame;
use crate::shape::Quadric;
use crate::traverse::{Best, Tree};
use crate::{Error, Hit, PrimitiveId, Ray, Shape, SurfacePoint};
use glam::Vec3;

/// Shapes, and the tree that finds which of them a ray meets.
#[derive(Clone, Debug)]
pub struct Geometry {
    shapes: Vec<Shape>,
    tree: Tree,
    bounds: Option<[Vec3; 2]>,
    triangle_count: usize,
}

impl Geometry {
    /// Builds the tree over all shapes. A shape's number in hits is its place in the list. No shapes, or shapes
    /// without triangles, are fine: every ray misses.
    ///
    /// # Errors
    /// [`Error::TooMany`] for more shapes than a `u32` counts or more than 2^30 primitives.
    pub fn build(shapes: Vec<Shape>, preset: Preset) -> Result<Self, Error> {
        let (tree, bounds, triangle_count) = build_tree(&shapes, preset)?;
        Ok(Self { shapes, tree, bounds, triangle_count })
    }

    /// The closest hit with `tmin < t < tmax`. Of hits at the same `t` the smallest (shape, primitive) is returned,
    /// whatever the preset and the order of traversal.
    #[inline(always)]
    #[must_use]
    pub fn closest(&self, ray: &Ray) -> Option<Hit> {
        match Frame::ordinary(ray) {
            Some(frame) => self.closest_along(&frame, 1.0),
            None => Frame::rescaled(ray).and_then(|(frame, scale)| self.closest_along(&frame, scale)),
        }
    }

    /// The closest hit, `t` multiplied by `scale`.
    #[inline(always)]
    fn closest_along(&self, frame: &Frame, scale: f32) -> Option<Hit> {
        let mut best = Best::new(frame.ray.tmax);
        self.tree.closest(frame, &mut best);
        best.found.then_some(Hit {
            t: best.t * scale,
            shape: (best.key >> 32) as u32,
            primitive: best.key as u32,
            barycentrics: best.weights,
        })
    }

    /// Whether anything is hit with `tmin < t < tmax`: exactly whether [`closest`](Self::closest) finds a hit, sooner.
    #[inline(always)]
    #[must_use]
    pub fn occluded(&self, ray: &Ray) -> bool {
        match Frame::ordinary(ray) {
            Some(frame) => self.tree.occluded(&frame),
            None => Frame::rescaled(ray).is_some_and(|(frame, _)| self.tree.occluded(&frame)),
        }
    }

    /// The point that was hit, with its error and normal. `hit` must come from [`closest`](Self::closest) of this
    /// geometry with this ray.
    #[inline(always)]
    #[must_use]
    pub fn surface(&self, ray: &Ray, hit: &Hit) -> SurfacePoint {
        match &self.shapes[hit.shape as usize] {
            Shape::Mesh(mesh) => {
                let (position, error, normal) = mesh.point(hit.primitive, hit.barycentrics);
                let primitive = PrimitiveId::triangle(hit.shape, hit.primitive);
                SurfacePoint { position, error, normal, primitive }
            }
            Shape::Sphere(sphere) => Quadric::Sphere(*sphere).surface(ray, hit.t),
            Shape::Disk(disk) => Quadric::Disk(*disk).surface(ray, hit.t),
        }
    }

    /// The surface's parameters at a point of it: a triangle's [`Hit::barycentrics`]; for spheres and disks the
    /// `(u, v)` of pbrt-v4, in `[0, 1]`: around the axis, and from the lower pole up or from the rim inwards.
    #[must_use]
    pub fn parametric(&self, hit: &Hit, position: Vec3) -> [f32; 2] {
        match &self.shapes[hit.shape as usize] {
            Shape::Mesh(_) => hit.barycentrics,
            Shape::Sphere(sphere) => Quadric::Sphere(*sphere).parametric(position),
            Shape::Disk(disk) => Quadric::Disk(*disk).parametric(position),
        }
    }

    /// The same without AVX2, whatever the machine has.
    #[cfg(test)]
    pub(crate) fn in_pairs(mut self) -> Self {
        self.tree.vectors = crate::lanes::Vectors::Pair;
        self
    }

    /// The shapes, as given.
    #[must_use]
    pub fn shapes(&self) -> &[Shape] {
        &self.shapes
    }

    /// Lower and upper corner of a box around everything that can be hit; `None` if nothing can.
    #[must_use]
    pub fn bounds(&self) -> Option<[Vec3; 2]> {
        self.bounds
    }

    /// Bytes of the tree and its leaves, without the shapes themselves.
    #[must_use]
    pub fn memory_bytes(&self) -> usize {
        self.tree.memory_bytes()
    }

    /// Triangles that can be hit: those with an area.
    #[must_use]
    pub fn triangle_count(&self) -> usize {
        self.triangle_count
    }
}
