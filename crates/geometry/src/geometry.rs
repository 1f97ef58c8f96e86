use crate::build::{build_tree, union};
use crate::instance::Placements;
#[cfg(test)]
use crate::lanes::Vectors;
use crate::ray::PreparedRay;
use crate::traverse::{Best, Tree, WalkKind};
use crate::{Error, Hit, Instance, PlacedShape, Ray, Shape, SurfacePoint};
use glam::{DAffine3, Vec3};
use std::sync::Arc;

/// A scene for ray intersection: shapes, instances of objects, and the bounding volume hierarchy over both. An object is a
/// group of shapes that is stored once and can be placed in the scene many times.
///
/// Every shape has a number. The base shapes (those outside of instances) come first, in their order. The shapes of each
/// instance follow, in the order of instances.
///
/// ```
/// use dapple_geometry::{Geometry, Ray, Shape, Sphere};
/// use glam::Vec3;
///
/// let ball = Sphere::new(Vec3::new(0.0, 0.0, 5.0), 1.0)?;
/// let scene = Geometry::build(vec![Shape::from(ball)])?;
/// let ray = Ray::new(Vec3::ZERO, Vec3::Z);
/// let hit = scene.closest(&ray).expect("the ball lies ahead");
/// assert_eq!(hit.t, 4.0);
/// assert_eq!(scene.surface(&ray, &hit).normal, Vec3::NEG_Z);
/// assert!(!scene.occluded(&Ray::new(Vec3::ZERO, Vec3::X)));
/// # Ok::<(), dapple_geometry::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct Geometry {
    shapes: Vec<Shape>,
    pub(crate) tree: Tree,
    bounds: Option<[Vec3; 2]>,
    triangle_count: usize,
}

impl Geometry {
    /// Builds a scene from shapes. A shape's index in the list is its number in hits. Without shapes, or with empty
    /// meshes only, every ray misses.
    ///
    /// # Errors
    /// [`Error::TooMany`] for 2^32 - 1 shapes or more, or for 2^28 primitives or more.
    pub fn build(shapes: Vec<Shape>) -> Result<Self, Error> {
        let (bvh, bounds, triangle_count) = build_tree(&shapes)?;
        Ok(Self { shapes, tree: bvh.into(), bounds, triangle_count })
    }

    /// Builds a scene from base shapes and from instances of objects. Each object is stored once, however many instances it
    /// has.
    ///
    /// An object may have no shapes, or no instances. To move a single shape, place it as the only shape of an object with one
    /// moving instance.
    ///
    /// A mesh in an instance is watertight. Rays may pass between two instances that touch, or between an instance and a base
    /// shape, through a gap as wide as f32 rounding.
    ///
    /// # Errors
    /// * The errors of [`build`](Self::build) for the base shapes.
    /// * [`Error::TooMany`] for 2^30 or more instances of non-empty objects, or for 2^32 - 1 or more shapes, counted once per
    ///   instance.
    /// * [`Error::NoSuchObject`] if an instance refers to an object that does not exist.
    /// * [`Error::Nested`] if an object contains instances itself.
    /// * [`Error::BadParameter`] if an instance's map is not finite or not invertible.
    /// * [`Error::ScaleOutOfRange`] if an instance reaches beyond the largest coordinate of
    ///   [`Mesh::new`](crate::Mesh::new).
    pub fn with_instances(
        shapes: Vec<Shape>,
        objects: Vec<Arc<Self>>,
        instances: Vec<Instance>,
    ) -> Result<Self, Error> {
        let mut scene = Self::build(shapes)?;
        let placements = Placements::new(scene.shapes.len() as u32, objects, instances)?;
        scene.triangle_count += placements.objects.iter().map(|object| object.geometry.triangle_count).sum::<usize>();
        scene.bounds = scene.bounds.into_iter().chain(placements.bounds).reduce(union);
        let moving = scene.base_moves();
        scene.tree.way = WalkKind::placed(placements, moving);
        Ok(scene)
    }

    /// Returns the closest hit of a ray with `tmin < t < tmax` at time 0, or `None` if nothing is hit. If several hits
    /// have the same `t`, the one with the smallest shape number, then the smallest primitive number, is returned.
    #[inline(always)]
    pub fn closest(&self, ray: &Ray) -> Option<Hit> {
        self.closest_at(ray, 0.0)
    }

    /// Returns the closest hit with `tmin < t < tmax` at the given time, from 0 to 1. Ties in `t` are resolved as in
    /// [`closest`](Self::closest).
    // Debug builds do not inline the traversal into other crates, which would take longer to compile.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub fn closest_at(&self, ray: &Ray, time: f32) -> Option<Hit> {
        match PreparedRay::ordinary(ray) {
            Some(prepared) => self.closest_along(&prepared, 1.0, time),
            None => {
                let (prepared, scale) = PreparedRay::rescaled(ray)?;
                let hit = self.closest_along(&prepared, scale, time)?;
                // Rounding to the caller's scale must not move `t` out of the limits.
                let (least, most) = (ray.tmin.max(0.0).next_up(), ray.tmax.next_down());
                Some(Hit { t: hit.t.max(least).min(most), ..hit })
            }
        }
    }

    /// Returns the closest hit, with `t` multiplied by `scale`.
    #[inline(always)]
    fn closest_along(&self, prepared: &PreparedRay, scale: f32, time: f32) -> Option<Hit> {
        let mut best = Best::new(prepared.ray.tmax);
        self.tree.closest(prepared, time, &mut best);
        best.found.then_some(Hit {
            t: best.t * scale,
            shape: (best.key >> 32) as u32,
            primitive: best.key as u32,
            barycentrics: best.weights,
        })
    }

    /// Returns true if the ray hits anything with `tmin < t < tmax` at time 0. It is faster than [`closest`](Self::closest),
    /// which returns a hit in the same cases.
    #[inline(always)]
    pub fn occluded(&self, ray: &Ray) -> bool {
        self.occluded_at(ray, 0.0)
    }

    /// Returns true if the ray hits anything with `tmin < t < tmax` at the given time, from 0 to 1.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub fn occluded_at(&self, ray: &Ray, time: f32) -> bool {
        match PreparedRay::ordinary(ray) {
            Some(prepared) => self.tree.occluded(&prepared, time),
            None => PreparedRay::rescaled(ray).is_some_and(|(prepared, _)| self.tree.occluded(&prepared, time)),
        }
    }

    /// Returns the surface point of a hit, with its error bound and normal. `hit` must come from
    /// [`closest`](Self::closest) of this geometry and ray.
    #[inline(always)]
    pub fn surface(&self, ray: &Ray, hit: &Hit) -> SurfacePoint {
        self.surface_at(ray, hit, 0.0)
    }

    /// Returns the surface point of a hit, with its error bound and normal. `hit` must come from
    /// [`closest_at`](Self::closest_at) with this ray and time.
    ///
    /// The normals of an instance are the normals of its object, transformed by the inverse transpose of the
    /// instance's matrix. A mirroring map does not flip them.
    #[inline(always)]
    pub fn surface_at(&self, ray: &Ray, hit: &Hit, time: f32) -> SurfacePoint {
        match self.shapes.get(hit.shape as usize) {
            Some(Shape::Mesh(mesh)) => hit.on_triangle(mesh.point(hit.primitive, hit.barycentrics)),
            Some(Shape::Moving(mesh)) => hit.on_triangle(mesh.point(hit.primitive, hit.barycentrics, time)),
            Some(Shape::Sphere(sphere)) => sphere.surface(ray, hit.t),
            Some(Shape::Disk(disk)) => disk.surface(ray, hit.t),
            None => self.placements().surface(ray, hit, time),
        }
    }

    /// Returns the surface parameters of `hit`, whose point in world space is `position`, at a time in `[0, 1]`. They are
    /// [`Hit::barycentrics`] on triangles, and pbrt-v4's `(u, v)`, each in `[0, 1]`, on spheres and disks.
    ///
    /// `u` is the angle around the z axis divided by 2 pi. `v` increases from a sphere's lower pole to its upper pole, or from
    /// a disk's rim inwards.
    pub fn parametric_at(&self, hit: &Hit, position: Vec3, time: f32) -> [f32; 2] {
        match self.shapes.get(hit.shape as usize) {
            Some(Shape::Mesh(_) | Shape::Moving(_)) => hit.barycentrics,
            Some(Shape::Sphere(sphere)) => sphere.parametric(position),
            Some(Shape::Disk(disk)) => disk.parametric(position),
            None => self.placements().parametric(hit, position, time),
        }
    }

    /// Returns the instance, object and shape that a shape number refers to; `None` for base shapes and for
    /// numbers without a shape.
    #[inline]
    pub fn placed(&self, shape: u32) -> Option<PlacedShape> {
        self.instances()?.placed(shape)
    }

    /// Returns the number that a shape would have if each object had exactly one instance. Base shapes keep their numbers; the
    /// shapes of the objects follow, object by object. `shape` must be below [`shape_count`](Self::shape_count).
    #[inline]
    pub fn original(&self, shape: u32) -> u32 {
        if (shape as usize) < self.shapes.len() { shape } else { self.placements().original(shape) }
    }

    /// Returns the shape with a number below [`shape_count`](Self::shape_count). The shape of an instance is in the space of
    /// its object.
    #[inline]
    pub fn shape(&self, number: u32) -> &Shape {
        match self.shapes.get(number as usize) {
            Some(shape) => shape,
            None => self.placements().shape(number),
        }
    }

    /// Returns the map from a shape's space to world space at a time in `[0, 1]`. Returns `None` for base shapes, which are in
    /// world space.
    pub fn to_world(&self, shape: u32, time: f32) -> Option<DAffine3> {
        ((shape as usize) >= self.shapes.len()).then(|| self.placements().to_world(shape, time))
    }

    /// The number of shapes: all base shapes, plus the shapes of each instance.
    pub fn shape_count(&self) -> u32 {
        self.instances().map_or(self.shapes.len() as u32, |placed| placed.shape_count())
    }

    /// Iterates over the objects that instances can refer to, in the order given to
    /// [`with_instances`](Self::with_instances).
    pub fn objects(&self) -> impl Iterator<Item = &Arc<Self>> {
        self.instances().into_iter().flat_map(|placed| placed.objects.iter().map(|object| &object.geometry))
    }

    /// Returns true if an instance or a mesh's vertices move over time.
    pub fn moves(&self) -> bool {
        self.base_moves() || self.instances().is_some_and(|placed| placed.moves)
    }

    fn base_moves(&self) -> bool {
        !self.tree.bvh.moved.is_empty()
    }

    /// The largest number of nodes and leaves on the stack when a ray traverses the tree of the base shapes; at most 256.
    pub fn deepest(&self) -> usize {
        self.tree.bvh.stack
    }

    pub(crate) fn instances(&self) -> Option<&Placements> {
        if let WalkKind::Placed(placed) = &self.tree.way { Some(&placed.placements) } else { None }
    }

    /// Returns the instances. Panics if there are none, so it must be called only for numbers beyond the base shapes.
    #[inline]
    fn placements(&self) -> &Placements {
        self.instances().expect("a shape number of this geometry")
    }

    /// Returns the scene with the traversal by pairs of four-wide vectors, even on a machine with AVX2.
    #[cfg(test)]
    pub(crate) fn in_pairs(mut self) -> Self {
        self.tree.way = if self.base_moves() { WalkKind::Moving(Vectors::Pair) } else { WalkKind::Pair };
        self
    }

    /// The base shapes, which belong to no instance, in the order given to [`build`](Self::build).
    pub fn shapes(&self) -> &[Shape] {
        &self.shapes
    }

    /// The lower and upper corner of the bounding box of everything that can be hit at any time; `None` if nothing can be hit.
    pub fn bounds(&self) -> Option<[Vec3; 2]> {
        self.bounds
    }

    /// The memory in bytes of the trees (scene, objects and instances) and of the instances. The shapes themselves are
    /// not included.
    pub fn memory_bytes(&self) -> usize {
        self.tree.bvh.memory_bytes() + self.instances().map_or(0, |placed| placed.memory_bytes())
    }

    /// The number of triangles with an area, which can be hit. The triangles of an object count once.
    pub fn triangle_count(&self) -> usize {
        self.triangle_count
    }
}
