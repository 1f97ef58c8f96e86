use crate::build::{Preset, build_tree, union};
use crate::frame::Frame;
use crate::instance::Placements;
#[cfg(test)]
use crate::lanes::Vectors;
use crate::safeguards::{All, Safeguards};
use crate::shape::Quadric;
use crate::traverse::{Best, Tree, Way};
use crate::{Error, Hit, Instance, Placed, PrimitiveId, Ray, Shape, SurfacePoint};
use glam::{DAffine3, Vec3};
use std::sync::Arc;

/// Shapes, and the tree that finds which of them a ray meets; and objects made of shapes, which stand in the scene as
/// often as there are instances of them.
///
/// Shape numbers: first the base shapes in their order, then the shapes of each instance in the order of instances.
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
        Self::build_padded(shapes, preset, All::PADDING)
    }

    /// The same with boxes that grow by what rounding asks for, or do not.
    pub(crate) fn build_padded(shapes: Vec<Shape>, preset: Preset, padded: bool) -> Result<Self, Error> {
        let (tree, bounds, triangle_count) = build_tree(&shapes, preset, padded)?;
        Ok(Self { shapes, tree, bounds, triangle_count })
    }

    /// The same with instances: of each object there is one in memory, however often it stands in the scene. Objects
    /// without shapes and objects that stand nowhere are fine. A single shape that moves is the moving instance of an
    /// object of one shape.
    ///
    /// A mesh is as watertight in an instance as it is by itself. Between instances, and between them and the base,
    /// rays may pass where surfaces only touch, in a gap as wide as rounding in f32 makes it.
    ///
    /// # Errors
    /// As [`build`](Self::build), and [`Error::NoSuchObject`]; [`Error::Nested`] for an object that holds instances
    /// itself; [`Error::BadParameter`] for a map that is not finite or not invertible; [`Error::ScaleOutOfRange`] for
    /// an instance that reaches farther than a [`Mesh`](crate::Mesh) may.
    pub fn with_instances(
        shapes: Vec<Shape>,
        objects: Vec<Arc<Self>>,
        instances: Vec<Instance>,
        preset: Preset,
    ) -> Result<Self, Error> {
        let mut scene = Self::build(shapes, preset)?;
        let placements = Placements::new(scene.shapes.len() as u32, objects, instances, preset)?;
        scene.triangle_count += placements.objects.iter().map(|object| object.geometry.triangle_count).sum::<usize>();
        scene.bounds = match (scene.bounds, placements.bounds) {
            (Some(base), Some(placed)) => Some(union(base, placed)),
            (base, placed) => base.or(placed),
        };
        let moving = scene.base_moves();
        scene.tree.way = Way::placed(placements, moving);
        Ok(scene)
    }

    /// The closest hit with `tmin < t < tmax`. Of hits at the same `t` the smallest (shape, primitive) is returned,
    /// whatever the preset and the order of traversal. What moves stands where it is at time 0.
    #[inline(always)]
    #[must_use]
    pub fn closest(&self, ray: &Ray) -> Option<Hit> {
        self.closest_at(ray, 0.0)
    }

    /// The closest hit at a time in `[0, 1]`.
    // Debug builds are compiled more than they run: there each crate does not compile the walk anew.
    #[cfg_attr(not(debug_assertions), inline(always))]
    #[must_use]
    pub fn closest_at(&self, ray: &Ray, time: f32) -> Option<Hit> {
        self.closest_with::<All>(ray, time)
    }

    #[inline(always)]
    pub(crate) fn closest_with<S: Safeguards>(&self, ray: &Ray, time: f32) -> Option<Hit> {
        match Frame::ordinary(ray) {
            Some(frame) => self.closest_along::<S>(&frame, 1.0, time),
            None => {
                let (frame, scale) = Frame::rescaled(ray)?;
                let hit = self.closest_along::<S>(&frame, scale, time)?;
                // Rounding to the caller's scale must not leave the limits.
                let (least, most) = (ray.tmin.max(0.0).next_up(), ray.tmax.next_down());
                Some(Hit { t: hit.t.max(least).min(most), ..hit })
            }
        }
    }

    /// The closest hit, `t` multiplied by `scale`.
    #[inline(always)]
    fn closest_along<S: Safeguards>(&self, frame: &Frame, scale: f32, time: f32) -> Option<Hit> {
        let mut best = Best::new(frame.ray.tmax);
        self.tree.closest::<S>(frame, time, &mut best);
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
        self.occluded_at(ray, 0.0)
    }

    /// Whether anything is hit at a time in `[0, 1]`.
    #[cfg_attr(not(debug_assertions), inline(always))]
    #[must_use]
    pub fn occluded_at(&self, ray: &Ray, time: f32) -> bool {
        self.occluded_with::<All>(ray, time)
    }

    #[inline(always)]
    pub(crate) fn occluded_with<S: Safeguards>(&self, ray: &Ray, time: f32) -> bool {
        match Frame::ordinary(ray) {
            Some(frame) => self.tree.occluded::<S>(&frame, time),
            None => Frame::rescaled(ray).is_some_and(|(frame, _)| self.tree.occluded::<S>(&frame, time)),
        }
    }

    /// The point that was hit, with its error and normal. `hit` must come from [`closest`](Self::closest) of this
    /// geometry with this ray.
    #[inline(always)]
    #[must_use]
    pub fn surface(&self, ray: &Ray, hit: &Hit) -> SurfacePoint {
        self.surface_at(ray, hit, 0.0)
    }

    /// The same for a hit of [`closest_at`](Self::closest_at) with this ray at this time.
    ///
    /// An instance's normals are its object's, taken to the world by the inverse transpose: a map that mirrors does
    /// not turn them around.
    #[inline(always)]
    #[must_use]
    pub fn surface_at(&self, ray: &Ray, hit: &Hit, time: f32) -> SurfacePoint {
        match self.shapes.get(hit.shape as usize) {
            Some(Shape::Mesh(mesh)) => {
                let (position, error, normal) = mesh.point(hit.primitive, hit.barycentrics);
                let primitive = PrimitiveId::triangle(hit.shape, hit.primitive);
                SurfacePoint { position, error, normal, primitive }
            }
            Some(Shape::Moving(mesh)) => {
                let (position, error, normal) = mesh.point(hit.primitive, hit.barycentrics, time);
                let primitive = PrimitiveId::triangle(hit.shape, hit.primitive);
                SurfacePoint { position, error, normal, primitive }
            }
            Some(Shape::Sphere(sphere)) => Quadric::Sphere(*sphere).surface(ray, hit.t),
            Some(Shape::Disk(disk)) => Quadric::Disk(*disk).surface(ray, hit.t),
            None => self.placements().surface(ray, hit, time),
        }
    }

    /// The surface's parameters at a point of it: a triangle's [`Hit::barycentrics`]; for spheres and disks the
    /// `(u, v)` of pbrt-v4, in `[0, 1]`: around the axis, and from the lower pole up or from the rim inwards.
    #[must_use]
    pub fn parametric(&self, hit: &Hit, position: Vec3) -> [f32; 2] {
        self.parametric_at(hit, position, 0.0)
    }

    /// The same for a point that was hit at this time.
    #[must_use]
    pub fn parametric_at(&self, hit: &Hit, position: Vec3, time: f32) -> [f32; 2] {
        match self.shapes.get(hit.shape as usize) {
            Some(Shape::Mesh(_) | Shape::Moving(_)) => hit.barycentrics,
            Some(Shape::Sphere(sphere)) => Quadric::Sphere(*sphere).parametric(position),
            Some(Shape::Disk(disk)) => Quadric::Disk(*disk).parametric(position),
            None => self.placements().parametric(hit, position, time),
        }
    }

    /// What stands behind a shape number beyond the base shapes; `None` for a base shape, and for numbers that no
    /// shape has.
    #[inline]
    #[must_use]
    pub fn placed(&self, shape: u32) -> Option<Placed> {
        self.instances()?.placed(shape)
    }

    /// A shape's number where every object counts once: base shapes keep theirs, the objects' shapes follow, object
    /// by object. The number must be below [`shape_count`](Self::shape_count).
    #[inline]
    #[must_use]
    pub fn original(&self, shape: u32) -> u32 {
        if (shape as usize) < self.shapes.len() { shape } else { self.placements().original(shape) }
    }

    /// The shape with a number below [`shape_count`](Self::shape_count); an instance's in its object's space.
    #[inline]
    #[must_use]
    pub fn shape(&self, number: u32) -> &Shape {
        match self.shapes.get(number as usize) {
            Some(shape) => shape,
            None => self.placements().shape(number),
        }
    }

    /// The map from a shape's space to the world at a time in `[0, 1]`: none for base shapes, which are in the world.
    #[must_use]
    pub fn to_world(&self, shape: u32, time: f32) -> Option<DAffine3> {
        ((shape as usize) >= self.shapes.len()).then(|| self.placements().to_world(shape, time))
    }

    /// How many shape numbers there are: base shapes, and the shapes of each instance.
    #[must_use]
    pub fn shape_count(&self) -> u32 {
        self.instances().map_or(self.shapes.len() as u32, |placed| placed.shape_count())
    }

    /// The objects, as given.
    pub fn objects(&self) -> impl Iterator<Item = &Arc<Self>> {
        self.instances().into_iter().flat_map(|placed| placed.objects.iter().map(|object| &object.geometry))
    }

    /// Whether there are instances, or objects for them.
    #[must_use]
    pub fn has_instances(&self) -> bool {
        self.instances().is_some()
    }

    /// Whether an instance moves, or the vertices of a mesh.
    #[must_use]
    pub fn moves(&self) -> bool {
        self.base_moves() || self.instances().is_some_and(|placed| placed.moves)
    }

    fn base_moves(&self) -> bool {
        !self.tree.moved.is_empty()
    }

    /// The most nodes and leaves that a ray can have to put aside at once: at most 256, whatever the triangles.
    #[must_use]
    pub fn deepest(&self) -> usize {
        self.tree.stack
    }

    pub(crate) fn tree(&self) -> &Tree {
        &self.tree
    }

    fn instances(&self) -> Option<&Placements> {
        if let Way::Placed(placed) = &self.tree.way { Some(&placed.placements) } else { None }
    }

    /// Only asked about shapes that are none of the base.
    #[inline]
    fn placements(&self) -> &Placements {
        self.instances().expect("a shape number of this geometry")
    }

    /// The same without AVX2, whatever the machine has.
    #[cfg(test)]
    pub(crate) fn in_pairs(mut self) -> Self {
        self.tree.way = if self.base_moves() { Way::Moving(Vectors::Pair) } else { Way::Pair };
        self
    }

    /// The base shapes, as given.
    #[must_use]
    pub fn shapes(&self) -> &[Shape] {
        &self.shapes
    }

    /// Lower and upper corner of a box around everything that can be hit, at any time; `None` if nothing can.
    #[must_use]
    pub fn bounds(&self) -> Option<[Vec3; 2]> {
        self.bounds
    }

    /// Bytes of the tree and its leaves, of the objects' and of what there is per instance; without the shapes
    /// themselves.
    #[must_use]
    pub fn memory_bytes(&self) -> usize {
        self.tree.memory_bytes() + self.instances().map_or(0, |placed| placed.memory_bytes())
    }

    /// Triangles in memory that can be hit: those with an area, an object's once.
    #[must_use]
    pub fn triangle_count(&self) -> usize {
        self.triangle_count
    }
}
