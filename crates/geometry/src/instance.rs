//! Instances of objects. An object is stored once and placed in the scene any number of times, each time by a map from the
//! object's space to world space.
//!
//! A ray is transformed to the object's space in f64. Its origin is moved to the point where it enters the object's box, and
//! its direction is normalised. Only then are both rounded to f32. The origin's rounding error is thus relative to the
//! object's size, even if the ray comes from far away.
//!
//! Let `start` be the world-space parameter at the entry and `speed` the length of the transformed direction. The parameter in
//! the object's space is then `t' = (t - start) speed`. A hit's parameter is transformed back to `t`, rounded once and clamped
//! between `tmin` and `tmax`.
//!
//! Rounding the transformed ray to f32 moves it by about an ulp of the object's size. [`Placements::surface`] adds
//! this distance to the error of surface points, so that new rays start beyond it.

use crate::build::{Bounds, build_top};
use crate::bvh::{Bvh, key};
use crate::mesh::ROUNDING;
use crate::ray::PreparedRay;
use crate::shape::Space;
use crate::traverse::Best;
use crate::{Error, Geometry, Hit, Motion, PrimitiveId, Ray, Shape, SurfacePoint};
use glam::{DAffine3, DVec3, Vec3};
use std::sync::Arc;

/// A placement of an object in a scene, by a map that may change over time.
///
/// ```
/// use dapple_geometry::{Geometry, Instance, Motion, Ray, Shape, Sphere};
/// use glam::{DAffine3, DVec3, Vec3};
/// use std::sync::Arc;
///
/// let ball = Geometry::build(vec![Shape::from(Sphere::new(Vec3::ZERO, 1.0)?)])?;
/// let at = |x| Instance::new(0, Motion::still(DAffine3::from_translation(DVec3::X * x)));
/// let row = Geometry::with_instances(Vec::new(), vec![Arc::new(ball)], vec![at(5.0), at(10.0)])?;
/// let hit = row.closest(&Ray::new(Vec3::ZERO, Vec3::X)).expect("the first ball lies ahead");
/// assert_eq!((hit.shape, row.shape_count()), (0, 2));
/// # Ok::<(), dapple_geometry::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Instance {
    /// The index of the object in the list given to [`Geometry::with_instances`].
    pub object: u32,
    /// The map from the object's space to world space, which may change over time.
    pub motion: Motion,
}

impl Instance {
    /// Makes an instance of the object with this index. `motion` maps the object's space to world space.
    pub const fn new(object: u32, motion: Motion) -> Self {
        Self { object, motion }
    }
}

/// The instance, object and shape that a shape number beyond the base shapes refers to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct PlacedShape {
    /// The index of the instance in the list given to [`Geometry::with_instances`].
    pub instance: u32,
    /// The index of the object in the list given to [`Geometry::with_instances`].
    pub object: u32,
    /// The index of the shape among the shapes of the object.
    pub shape: u32,
}

/// All instances of a scene, and the bounding volume hierarchy over their boxes.
#[derive(Clone, Debug, Default)]
pub(crate) struct Placements {
    /// The number of base shapes (those outside of instances). The shapes of instances are numbered from here.
    base: u32,
    pub(crate) objects: Vec<Object>,
    instances: Vec<PlacedObject>,
    /// The index of the instance for each shape number from `base` on.
    instance_of: Vec<u32>,
    top: Bvh,
    pub(crate) bounds: Option<Bounds>,
    pub(crate) moves: bool,
}

/// An object with its bounding box, against which rays are tested first.
#[derive(Clone, Debug)]
pub(crate) struct Object {
    pub(crate) geometry: Arc<Geometry>,
    /// The object's bounding box, padded so that surfaces lie strictly inside; `None` if nothing can be hit.
    bounds: Option<[DVec3; 2]>,
    /// A bound, per axis, on the distance by which rounding can move a ray within the box, in the object's space.
    reach: f64,
    /// The number of base shapes and of shapes of earlier objects, with each object counted once.
    first: u32,
}

#[derive(Clone, Debug)]
struct PlacedObject {
    object: u32,
    /// The number of the instance's first shape.
    first: u32,
    place: Pose,
}

#[derive(Clone, Debug)]
enum Pose {
    Still(Space),
    Moving(Motion),
}

/// A ray in an object's space. A world-space parameter `t` corresponds to the parameter `(t - start) speed` of this ray.
struct Local {
    ray: Ray,
    start: f64,
    speed: f64,
}

/// The padding of an object's box: [`GROWTH`] times its extent plus [`GROWTH_FAR`] times its largest coordinate. It is far
/// above the rounding of a ray's origin, and too small to cost measurable time.
const GROWTH: f64 = 1.0 / (1u64 << 10) as f64;
const GROWTH_FAR: f64 = 1.0 / (1u64 << 20) as f64;
/// Hits up to this factor beyond the best hit's distance are still tested, since rounding may reduce their distance.
const BEYOND: f64 = 1.0 + 1.0 / (1u64 << 20) as f64;

impl Object {
    fn new(geometry: Arc<Geometry>, first: u32) -> Self {
        let bounds = geometry.bounds().map(|corners| corners.map(|corner| corner.as_dvec3()));
        let (mut reach, mut grown) = (0.0, None);
        if let Some([low, high]) = bounds {
            let largest = low.abs().max(high.abs()).max_element();
            let by = (high - low).max_element() * GROWTH + largest * GROWTH_FAR;
            grown = Some([low - by, high + by]);
            // Half an ulp of the origin, and half an ulp of the direction and of t' over the whole length; doubled for slack.
            reach = (largest + by + (high - low + 2.0 * by).length()) * ROUNDING;
        }
        Self { geometry, bounds: grown, reach, first }
    }
}

impl Pose {
    #[inline]
    fn at(&self, time: f32) -> Space {
        match self {
            Self::Still(space) => *space,
            Self::Moving(motion) => Space::new(motion.at(time)),
        }
    }
}

impl Space {
    /// Returns the ray in the object's space, starting where it enters a box; `None` if the ray misses the box.
    fn enter(&self, ray: &Ray, [low, high]: [DVec3; 2]) -> Option<Local> {
        let (origin, direction) = self.ray_to_object(ray);
        // The reciprocals are finite, as in `PreparedRay`, so that no product of zero and infinity is formed.
        let inverse = direction.recip().clamp(DVec3::splat(-f64::MAX), DVec3::splat(f64::MAX));
        let (a, b) = ((low - origin) * inverse, (high - origin) * inverse);
        let start = a.min(b).max_element().max(ray.tmin.into());
        let end = a.max(b).min_element().min(ray.tmax.into());
        let speed = direction.length();
        if !(start <= end && speed > 0.0) {
            return None;
        }
        let tmax = ((f64::from(ray.tmax) - start) * speed) as f32;
        let (origin, direction) = ((origin + direction * start).as_vec3(), (direction / speed).as_vec3());
        let ray = Ray { origin, direction, tmin: 0.0, tmax, ends: [PrimitiveId::NONE; 2] };
        Some(Local { ray, start, speed })
    }
}

impl Placements {
    pub(crate) fn new(base: u32, objects: Vec<Arc<Geometry>>, instances: Vec<Instance>) -> Result<Self, Error> {
        let mut known = Vec::with_capacity(objects.len());
        let mut count = base as usize;
        for (number, geometry) in objects.into_iter().enumerate() {
            if geometry.instances().is_some() {
                return Err(Error::Nested { object: number as u32 });
            }
            known.push(Object::new(geometry, numbered(count)?));
            count += known[number].geometry.shapes().len();
        }
        let room = Vec::with_capacity(instances.len());
        let mut all = Self { base, objects: known, instances: room, ..Self::default() };
        let mut boxes = Vec::with_capacity(instances.len());
        for (number, instance) in instances.into_iter().enumerate() {
            boxes.extend(all.place(number as u32, instance)?.map(|bounds| (number as u32, bounds)));
        }
        (all.top, all.bounds) = build_top(&boxes)?;
        Ok(all)
    }

    /// Adds an instance and returns its box in world space; `None` if nothing in its object can be hit.
    fn place(&mut self, number: u32, Instance { object, motion }: Instance) -> Result<Option<[DVec3; 2]>, Error> {
        let objects = self.objects.len();
        let known =
            self.objects.get(object as usize).ok_or(Error::NoSuchObject { instance: number, object, objects })?;
        let shapes = known.geometry.shapes().len();
        let first = numbered(self.base as usize + self.instance_of.len())?;
        numbered(first as usize + shapes)?;
        let start = Space::checked(motion.at(0.0), "an instance's determinant")?;
        let bounds = known.bounds.map(|[low, high]| motion.bounds(low, high));
        if let Some([low, high]) = bounds {
            Error::out_of_range("an instance's extent", low.abs().max(high.abs()).max_element(), 0.0)?;
        }
        self.instance_of.resize(self.instance_of.len() + shapes, number);
        self.moves |= motion.moves() || known.geometry.moves();
        let place = if motion.moves() { Pose::Moving(motion) } else { Pose::Still(start) };
        self.instances.push(PlacedObject { object, first, place });
        Ok(bounds)
    }

    #[inline(never)]
    pub(crate) fn closest(&self, prepared: &PreparedRay, time: f32, best: &mut Best) {
        let mut visit = |number: u32, best: &mut Best| {
            self.closest_of(&self.instances[number as usize], prepared, time, best);
            false
        };
        self.top.visit::<false>(prepared, best, &mut visit);
    }

    #[inline(never)]
    pub(crate) fn occluded(&self, prepared: &PreparedRay, time: f32) -> bool {
        let mut visit = |number: u32, _: &mut Best| {
            let instance = &self.instances[number as usize];
            self.enter(instance, prepared, time)
                .and_then(|local| PreparedRay::ordinary(&local.ray))
                .is_some_and(|local| self.objects[instance.object as usize].geometry.tree.occluded(&local, time))
        };
        self.top.visit::<true>(prepared, &mut Best::new(prepared.ray.tmax), &mut visit)
    }

    fn closest_of(&self, instance: &PlacedObject, prepared: &PreparedRay, time: f32, best: &mut Best) {
        let Some(local) = self.enter(instance, prepared, time) else { return };
        let limit = f64::from(best.t) * BEYOND;
        if local.start > limit {
            return;
        }
        let Some(inner) = PreparedRay::ordinary(&local.ray) else { return };
        let mut found = Best::new(((limit - local.start) * local.speed) as f32);
        self.objects[instance.object as usize].geometry.tree.closest(&inner, time, &mut found);
        if found.found {
            let t = (local.start + f64::from(found.t) / local.speed) as f32;
            let t = t.max(prepared.ray.tmin.next_up()).min(prepared.ray.tmax.next_down());
            best.offer(t, found.key + key(instance.first, 0), found.weights);
        }
    }

    /// Returns the ray in the space of the instance's object; `None` if it misses the object's box.
    fn enter(&self, instance: &PlacedObject, prepared: &PreparedRay, time: f32) -> Option<Local> {
        let object = &self.objects[instance.object as usize];
        let mut local = instance.place.at(time).enter(&prepared.ray, object.bounds?)?;
        let shapes = object.geometry.shapes().len() as u64;
        for (inner, outer) in local.ray.ends.iter_mut().zip(prepared.ray.ends) {
            let inside = outer.0.wrapping_sub(key(instance.first, 0));
            if inside >> 32 < shapes {
                *inner = PrimitiveId(inside);
            }
        }
        Some(local)
    }

    pub(crate) fn placed(&self, number: u32) -> Option<PlacedShape> {
        let instance = *self.instance_of.get(number.checked_sub(self.base)? as usize)?;
        let PlacedObject { object, first, .. } = self.instances[instance as usize];
        Some(PlacedShape { instance, object, shape: number - first })
    }

    pub(crate) fn shape_count(&self) -> u32 {
        self.base + self.instance_of.len() as u32
    }

    /// Returns the instance and the object of a shape number, and the shape's index in the object.
    fn resolve(&self, number: u32) -> (&PlacedObject, &Object, u32) {
        let instance = &self.instances[self.instance_of[(number - self.base) as usize] as usize];
        (instance, &self.objects[instance.object as usize], number - instance.first)
    }

    pub(crate) fn original(&self, number: u32) -> u32 {
        let (_, object, shape) = self.resolve(number);
        object.first + shape
    }

    pub(crate) fn shape(&self, number: u32) -> &Shape {
        let (_, object, shape) = self.resolve(number);
        &object.geometry.shapes()[shape as usize]
    }

    pub(crate) fn to_world(&self, number: u32, time: f32) -> DAffine3 {
        self.resolve(number).0.place.at(time).to_world
    }

    pub(crate) fn parametric(&self, hit: &Hit, position: Vec3, time: f32) -> [f32; 2] {
        let (instance, object, shape) = self.resolve(hit.shape);
        let inner = Hit { shape, ..*hit };
        object.geometry.parametric_at(&inner, instance.place.at(time).point_to_object(position).as_vec3(), 0.0)
    }

    #[inline(never)]
    pub(crate) fn surface(&self, ray: &Ray, hit: &Hit, time: f32) -> SurfacePoint {
        let (instance, object, shape) = self.resolve(hit.shape);
        let space = instance.place.at(time);
        let of_triangle = |(point, error, _): (Vec3, Vec3, Vec3), corners: [Vec3; 3]| {
            // The stored f32 normal is too coarse: a nearly flat map magnifies its rounding error.
            let [a, b, c] = corners.map(Vec3::as_dvec3);
            let primitive = PrimitiveId::triangle(hit.shape, hit.primitive);
            (point, error, (b - a).cross(c - a).normalize_or_zero(), primitive)
        };
        // The ray on which a sphere or disk is hit is moved to start near the hit, which then lies near `t` = 0.
        let near = || {
            let (origin, direction) = space.ray_to_object(ray);
            let origin = (origin + direction * f64::from(hit.t)).as_vec3();
            Ray::new(origin, direction.normalize_or(DVec3::Z).as_vec3())
        };
        let of_quadric = |on: SurfacePoint| (on.position, on.error, on.normal.as_dvec3(), PrimitiveId::NONE);
        let (number, weights) = (hit.primitive, hit.barycentrics);
        let (point, error, normal, primitive) = match &object.geometry.shapes()[shape as usize] {
            Shape::Mesh(mesh) => of_triangle(mesh.point(number, weights), mesh.corners(number)),
            Shape::Moving(mesh) => of_triangle(mesh.point(number, weights, time), mesh.corners(number, time)),
            Shape::Sphere(sphere) => of_quadric(sphere.surface(&near(), 0.0)),
            Shape::Disk(disk) => of_quadric(disk.surface(&near(), 0.0)),
        };
        space.surface(point.as_dvec3(), error.as_dvec3() + object.reach, normal, primitive)
    }

    pub(crate) fn memory_bytes(&self) -> usize {
        let objects: usize = self.objects.iter().map(|object| object.geometry.memory_bytes()).sum();
        let moving = self.instances.iter().filter(|instance| matches!(instance.place, Pose::Moving(_))).count();
        objects
            + size_of_val(&*self.objects)
            + size_of_val(&*self.instances)
            + moving * Motion::PATH_BYTES
            + size_of_val(&*self.instance_of)
            + self.top.memory_bytes()
    }
}

fn numbered(count: usize) -> Result<u32, Error> {
    Error::too_many("shapes of instances", count, u32::MAX as usize)?;
    Ok(count as u32)
}
