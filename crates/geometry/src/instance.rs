//! Objects that stand in a scene once or often: one in memory, each with a map of its own.
//!
//! A ray is taken to an object's space in f64. There it starts anew, where it enters the object's box: so the f32 of its
//! origin has the object's precision, however far the ray has come. Its direction is given unit length. With `start`
//! where it entered and `speed` the length of the mapped direction, the object's `t'` is `(t - start) speed`. An
//! object's hits within its own limits are hits; their `t` is rounded once, and kept within the limits.
//!
//! What rounding the mapped ray to f32 does to where it passes is of the order of an ulp of the object's size.
//! [`Placements::surface`] adds it to the error of points, so that rays leave them beyond it.

use crate::build::{Bounds, Preset, build_top};
use crate::frame::Frame;
use crate::mesh::{LARGEST, LOST_IN_F64, ROUNDING};
use crate::safeguards::All;
use crate::shape::Quadric;
use crate::traverse::{Best, Tree, key};
use crate::{Error, Geometry, Hit, Motion, PrimitiveId, Ray, Shape, SurfacePoint};
use glam::{DAffine3, DMat3, DVec3, Vec3};
use std::sync::Arc;

/// An object that stands somewhere.
#[derive(Clone, Debug, PartialEq)]
pub struct Instance {
    /// Its place in the list of objects.
    pub object: u32,
    /// From the object's space to world space.
    pub motion: Motion,
}

/// What a shape number that is none of the base shapes stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Placed {
    /// The instance's place in its list.
    pub instance: u32,
    /// The object's place in its list.
    pub object: u32,
    /// The shape's place in the object.
    pub shape: u32,
}

/// All instances, and the tree over their boxes.
#[derive(Clone, Debug)]
pub(crate) struct Placements {
    /// How many shapes stand by themselves: instances' shapes are numbered from here.
    base: u32,
    pub(crate) objects: Vec<Object>,
    instances: Vec<Standing>,
    /// The instance of each shape number from `base` on.
    instance_of: Vec<u32>,
    top: Tree,
    pub(crate) bounds: Option<Bounds>,
    pub(crate) moves: bool,
}

/// An object, with what a ray asks first.
#[derive(Clone, Debug)]
pub(crate) struct Object {
    pub(crate) geometry: Arc<Geometry>,
    /// Its box, grown so that its surfaces lie inside and not on it; nothing if nothing can be hit.
    bounds: Option<[DVec3; 2]>,
    /// How far rounding can move a ray within the box, per axis.
    reach: f64,
    /// Shapes of the base and of the objects before it.
    first: u32,
}

#[derive(Clone, Debug)]
struct Standing {
    object: u32,
    /// The number of its first shape.
    first: u32,
    place: Place,
}

#[derive(Clone, Debug)]
enum Place {
    Still(Map),
    Moving(Motion),
}

/// From an object to the world and back.
#[derive(Clone, Copy, Debug)]
struct Map {
    to_world: DAffine3,
    /// The inverse of its matrix; the translation is taken off first, which loses nothing far from the world's origin.
    to_object: DMat3,
}

/// A ray in an object's space.
struct Local {
    ray: Ray,
    start: f64,
    speed: f64,
}

/// Boxes of objects grow by this share of their extent, and by this share of their largest coordinate: far above what
/// f32 loses of a ray's origin, far below what would cost time.
const GROWTH: f64 = 1.0 / (1u64 << 10) as f64;
const GROWTH_FAR: f64 = 1.0 / (1u64 << 20) as f64;
/// Hits this much farther than the best so far are still looked at, since rounding may bring them nearer.
const BEYOND: f64 = 1.0 + 1.0 / (1u64 << 20) as f64;

impl Object {
    fn new(geometry: Arc<Geometry>, first: u32) -> Self {
        let bounds = geometry.bounds().map(|corners| corners.map(|corner| corner.as_dvec3()));
        let (mut reach, mut grown) = (0.0, None);
        if let Some([low, high]) = bounds {
            let largest = low.abs().max(high.abs()).max_element();
            let by = (high - low).max_element() * GROWTH + largest * GROWTH_FAR;
            grown = Some([low - by, high + by]);
            // Half an ulp of the origin, and of the direction and of t' along the whole way; twice that.
            reach = (largest + by + (high - low + 2.0 * by).length()) * ROUNDING;
        }
        Self { geometry, bounds: grown, reach, first }
    }
}

impl Place {
    #[inline]
    fn at(&self, time: f32) -> Map {
        match self {
            Self::Still(map) => *map,
            Self::Moving(motion) => Map::new(motion.at(time)),
        }
    }
}

impl Map {
    fn new(to_world: DAffine3) -> Self {
        Self { to_world, to_object: to_world.matrix3.inverse() }
    }

    fn point(&self, world: Vec3) -> DVec3 {
        self.to_object * (world.as_dvec3() - self.to_world.translation)
    }

    /// The part of a ray within a box, in the object's space.
    fn enter(&self, ray: &Ray, [low, high]: [DVec3; 2]) -> Option<Local> {
        let (origin, direction) = (self.point(ray.origin), self.to_object * ray.direction.as_dvec3());
        // As in `Frame`: finite, so that no product of zero and infinity is formed.
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
    pub(crate) fn new(
        base: u32,
        objects: Vec<Arc<Geometry>>,
        instances: Vec<Instance>,
        preset: Preset,
    ) -> Result<Self, Error> {
        let mut known = Vec::with_capacity(objects.len());
        let mut count = base as usize;
        for (number, geometry) in objects.into_iter().enumerate() {
            if geometry.has_instances() {
                return Err(Error::Nested { object: number as u32 });
            }
            known.push(Object::new(geometry, numbered(count)?));
            count += known[number].geometry.shapes().len();
        }
        let mut all = Self {
            base,
            objects: known,
            instances: Vec::with_capacity(instances.len()),
            instance_of: Vec::new(),
            top: Tree::default(),
            bounds: None,
            moves: false,
        };
        let mut boxes = Vec::with_capacity(instances.len());
        for (number, instance) in instances.into_iter().enumerate() {
            boxes.extend(all.place(number as u32, instance)?.map(|bounds| (number as u32, bounds)));
        }
        (all.top, all.bounds) = build_top(&boxes, preset)?;
        Ok(all)
    }

    /// Takes an instance in; its box, if there is anything in it.
    fn place(&mut self, number: u32, Instance { object, motion }: Instance) -> Result<Option<[DVec3; 2]>, Error> {
        let objects = self.objects.len();
        let known =
            self.objects.get(object as usize).ok_or(Error::NoSuchObject { instance: number, object, objects })?;
        let shapes = known.geometry.shapes().len();
        let first = numbered(self.base as usize + self.instance_of.len())?;
        numbered(first as usize + shapes)?;
        let start = Map::new(motion.at(0.0));
        let determinant = start.to_world.matrix3.determinant();
        if determinant == 0.0 || !start.to_world.is_finite() || !start.to_object.is_finite() {
            let expected = "the map to world space must be finite and invertible";
            return Err(Error::BadParameter { what: "an instance's determinant", value: determinant, expected });
        }
        let bounds = known.bounds.map(|[low, high]| motion.bounds(low, high));
        if let Some([low, high]) = bounds {
            let value = low.abs().max(high.abs()).max_element();
            if value.is_nan() || value > LARGEST.into() {
                return Err(Error::ScaleOutOfRange { what: "an instance's extent", value });
            }
        }
        self.instance_of.resize(self.instance_of.len() + shapes, number);
        self.moves |= motion.moves() || known.geometry.moves();
        let place = if motion.moves() { Place::Moving(motion) } else { Place::Still(start) };
        self.instances.push(Standing { object, first, place });
        Ok(bounds)
    }

    #[inline(never)]
    pub(crate) fn closest(&self, frame: &Frame, time: f32, best: &mut Best) {
        let mut visit = |number: u32, best: &mut Best| {
            self.closest_of(&self.instances[number as usize], frame, time, best);
            false
        };
        self.top.visit::<false>(frame, best, &mut visit);
    }

    #[inline(never)]
    pub(crate) fn occluded(&self, frame: &Frame, time: f32) -> bool {
        let mut visit = |number: u32, _: &mut Best| {
            let instance = &self.instances[number as usize];
            self.enter(instance, frame, time).and_then(|local| Frame::ordinary(&local.ray)).is_some_and(|local| {
                self.objects[instance.object as usize].geometry.tree().occluded::<All>(&local, time)
            })
        };
        self.top.visit::<true>(frame, &mut Best::new(frame.ray.tmax), &mut visit)
    }

    fn closest_of(&self, instance: &Standing, frame: &Frame, time: f32, best: &mut Best) {
        let Some(local) = self.enter(instance, frame, time) else { return };
        let limit = f64::from(best.t) * BEYOND;
        if local.start > limit {
            return;
        }
        let Some(inner) = Frame::ordinary(&local.ray) else { return };
        let mut found = Best::new(((limit - local.start) * local.speed) as f32);
        self.objects[instance.object as usize].geometry.tree().closest::<All>(&inner, time, &mut found);
        if found.found {
            let t = (local.start + f64::from(found.t) / local.speed) as f32;
            let t = t.max(frame.ray.tmin.next_up()).min(frame.ray.tmax.next_down());
            best.offer::<All>(t, found.key + key(instance.first, 0), found.weights);
        }
    }

    /// The ray in the instance's object.
    fn enter(&self, instance: &Standing, frame: &Frame, time: f32) -> Option<Local> {
        let object = &self.objects[instance.object as usize];
        let mut local = instance.place.at(time).enter(&frame.ray, object.bounds?)?;
        let shapes = object.geometry.shapes().len() as u64;
        for (inner, outer) in local.ray.ends.iter_mut().zip(frame.ray.ends) {
            let inside = outer.0.wrapping_sub(key(instance.first, 0));
            if inside >> 32 < shapes {
                *inner = PrimitiveId(inside);
            }
        }
        Some(local)
    }

    pub(crate) fn placed(&self, number: u32) -> Option<Placed> {
        let instance = *self.instance_of.get(number.checked_sub(self.base)? as usize)?;
        let Standing { object, first, .. } = self.instances[instance as usize];
        Some(Placed { instance, object, shape: number - first })
    }

    pub(crate) fn shape_count(&self) -> u32 {
        self.base + self.instance_of.len() as u32
    }

    /// The instance, object and shape of a number that a hit of this scene has.
    fn resolve(&self, number: u32) -> (&Standing, &Object, u32) {
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
        object.geometry.parametric(&inner, instance.place.at(time).point(position).as_vec3())
    }

    #[inline(never)]
    pub(crate) fn surface(&self, ray: &Ray, hit: &Hit, time: f32) -> SurfacePoint {
        let (instance, object, shape) = self.resolve(hit.shape);
        let map = instance.place.at(time);
        let shape = &object.geometry.shapes()[shape as usize];
        let (point, error, normal, primitive) = match shape {
            Shape::Mesh(mesh) => {
                let (point, error, _) = mesh.point(hit.primitive, hit.barycentrics);
                // Not the one in f32, whose rounding a map that is nearly flat would magnify.
                let [a, b, c] = mesh.corners(hit.primitive).map(Vec3::as_dvec3);
                let primitive = PrimitiveId::triangle(hit.shape, hit.primitive);
                (point, error, (b - a).cross(c - a).normalize_or_zero(), primitive)
            }
            Shape::Moving(mesh) => {
                let (point, error, _) = mesh.point(hit.primitive, hit.barycentrics, time);
                let [a, b, c] = mesh.corners(hit.primitive, time).map(Vec3::as_dvec3);
                let primitive = PrimitiveId::triangle(hit.shape, hit.primitive);
                (point, error, (b - a).cross(c - a).normalize_or_zero(), primitive)
            }
            Shape::Sphere(sphere) => on_quadric(&Quadric::Sphere(*sphere), &map, ray, hit.t),
            Shape::Disk(disk) => on_quadric(&Quadric::Disk(*disk), &map, ray, hit.t),
        };
        let (matrix, translation) = (map.to_world.matrix3, map.to_world.translation);
        let point = point.as_dvec3();
        let exact = matrix * point + translation;
        let magnitude = DMat3::from_cols(matrix.x_axis.abs(), matrix.y_axis.abs(), matrix.z_axis.abs());
        let entered = magnitude * point.abs() + translation.abs();
        let error = magnitude * (error.as_dvec3() + object.reach);
        let error = error + exact.abs() * ROUNDING + entered * LOST_IN_F64;
        SurfacePoint {
            position: exact.as_vec3(),
            error: error.as_vec3(),
            normal: (map.to_object.transpose() * normal).normalize_or(DVec3::Z).as_vec3(),
            primitive,
        }
    }

    pub(crate) fn memory_bytes(&self) -> usize {
        let objects: usize = self.objects.iter().map(|object| object.geometry.memory_bytes()).sum();
        let path =
            |instance: &Standing| if matches!(instance.place, Place::Moving(_)) { Motion::PATH_BYTES } else { 0 };
        objects
            + size_of_val(&*self.objects)
            + size_of_val(&*self.instances)
            + self.instances.iter().map(path).sum::<usize>()
            + size_of_val(&*self.instance_of)
            + self.top.memory_bytes()
    }
}

/// A point of a sphere or disk in its object's space, its error and the surface's normal.
fn on_quadric(quadric: &Quadric, map: &Map, ray: &Ray, t: f32) -> (Vec3, Vec3, DVec3, PrimitiveId) {
    let (origin, direction) = (map.point(ray.origin), map.to_object * ray.direction.as_dvec3());
    // Seen from where it was hit, near `t` = 0.
    let origin = (origin + direction * f64::from(t)).as_vec3();
    let point = quadric.surface(&Ray::new(origin, direction.normalize_or(DVec3::Z).as_vec3()), 0.0);
    (point.position, point.error, point.normal.as_dvec3(), PrimitiveId::NONE)
}

fn numbered(count: usize) -> Result<u32, Error> {
    let limit = u32::MAX as usize;
    if count < limit { Ok(count as u32) } else { Err(Error::TooMany { what: "shapes of instances", count, limit }) }
}
