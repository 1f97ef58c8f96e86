//! The kinds of shapes in a geometry: meshes, spheres and disks.

use crate::mesh::{LOST_IN_F64, ROUNDING, SMALLEST};
use crate::{Error, Mesh, MovingMesh, PrimitiveId, Ray, SurfacePoint};
use glam::{DAffine3, DMat3, DVec3, Vec3};
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

/// A shape of a [`Geometry`](crate::Geometry): a mesh, a sphere or a disk.
#[derive(Clone, Debug)]
pub enum Shape {
    /// A triangle mesh, shared without copying.
    Mesh(Arc<Mesh>),
    /// A triangle mesh with moving vertices, shared without copying.
    Moving(Arc<MovingMesh>),
    /// A full sphere, transformed by an affine map.
    Sphere(Sphere),
    /// A full disk or a ring, transformed by an affine map.
    Disk(Disk),
}

impl Shape {
    /// Returns the triangle mesh (at time 0, if vertices move); `None` for spheres and disks.
    pub fn mesh(&self) -> Option<&Mesh> {
        match self {
            Self::Mesh(mesh) => Some(mesh),
            Self::Moving(mesh) => Some(mesh.start()),
            Self::Sphere(_) | Self::Disk(_) => None,
        }
    }

    /// Returns the lower and upper corner of the shape's axis-aligned bounding box over all times, up to rounding.
    /// `None` for a mesh without triangles.
    pub fn bounds(&self) -> Option<[Vec3; 2]> {
        let quadric = |quadric: Quadric| Some(quadric.bounds().map(DVec3::as_vec3));
        match self {
            Self::Mesh(mesh) => (!mesh.triangles().is_empty()).then_some(mesh.around),
            Self::Moving(mesh) => (0..mesh.start().triangles().len() as u32)
                .flat_map(|n| [0.0, 1.0].map(|time| mesh.corners(n, time)))
                .flatten()
                .map(|corner| [corner; 2])
                .reduce(|[low, high], [corner, _]| [low.min(corner), high.max(corner)]),
            Self::Sphere(sphere) => quadric(Quadric::Sphere(*sphere)),
            Self::Disk(disk) => quadric(Quadric::Disk(*disk)),
        }
    }
}

impl From<MovingMesh> for Shape {
    fn from(mesh: MovingMesh) -> Self {
        Self::Moving(Arc::new(mesh))
    }
}

impl From<Mesh> for Shape {
    fn from(mesh: Mesh) -> Self {
        Self::Mesh(Arc::new(mesh))
    }
}

impl From<Sphere> for Shape {
    fn from(sphere: Sphere) -> Self {
        Self::Sphere(sphere)
    }
}

impl From<Disk> for Shape {
    fn from(disk: Disk) -> Self {
        Self::Disk(disk)
    }
}

/// A sphere around the origin of its own space, with an affine map to world space. Intersections are computed in f64.
#[derive(Clone, Copy, Debug)]
pub struct Sphere {
    space: Space,
    radius: f64,
}

impl Sphere {
    /// Makes a sphere in world space from its centre and radius.
    ///
    /// # Errors
    /// The errors of [`transformed`](Self::transformed), for a translation to the centre.
    pub fn new(centre: Vec3, radius: f32) -> Result<Self, Error> {
        Self::transformed(DAffine3::from_translation(centre.as_dvec3()), radius.into())
    }

    /// Makes a sphere around the origin of its own space, transformed to world space by an invertible affine map.
    ///
    /// # Errors
    /// * [`Error::BadParameter`] unless the radius is positive and finite, and the map is finite and invertible.
    /// * [`Error::ScaleOutOfRange`] if the largest magnitude of a coordinate of the bounding box is below 2^-60 or above 2^59.
    pub fn transformed(to_world: DAffine3, radius: f64) -> Result<Self, Error> {
        positive("a sphere's radius", radius)?;
        let sphere = Self { space: Space::checked(to_world, "a transform's determinant")?, radius };
        check_range("a sphere's extent", sphere.space.bounds(DVec3::splat(radius), DVec3::ZERO))?;
        Ok(sphere)
    }

    /// Returns the two parameters at which the infinite line intersects the sphere, the smaller one first; `None` without
    /// intersections.
    ///
    /// The discriminant is computed from the line's point nearest to the centre, and the root nearer to 0 from the product of
    /// both roots. Neither suffers from cancellation [after Haines et al., Ray Tracing Gems 2019, chapter 7].
    #[inline]
    fn roots(&self, ray: &Ray) -> Option<[f64; 2]> {
        let (o, d) = self.space.ray_to_object(ray);
        let a = d.length_squared();
        let middle = -o.dot(d) / a;
        let discriminant = self.radius * self.radius - (o + d * middle).length_squared();
        if discriminant < 0.0 {
            return None;
        }
        let half = (discriminant / a).sqrt();
        let distance = o.length();
        let product = (distance - self.radius) * (distance + self.radius) / a;
        let far = if middle >= 0.0 { middle + half } else { middle - half };
        let near = if far == 0.0 { 0.0 } else { product / far };
        Some(if middle >= 0.0 { [near, far] } else { [far, near] })
    }

    pub(crate) fn surface(&self, ray: &Ray, t: f32) -> SurfacePoint {
        let (o, d) = self.space.ray_to_object(ray);
        let t = f64::from(t);
        let nearest = |roots: [f64; 2]| if (roots[0] - t).abs() <= (roots[1] - t).abs() { roots[0] } else { roots[1] };
        let point = o + d * self.roots(ray).map_or(t, nearest);
        let point = point.normalize_or(DVec3::Z) * self.radius;
        self.space.surface(point, DVec3::ZERO, point, PrimitiveId::NONE)
    }

    pub(crate) fn parametric(&self, point: Vec3) -> [f32; 2] {
        let p = self.space.point_to_object(point);
        [longitude(p), (1.0 - (p.z / p.length()).clamp(-1.0, 1.0).acos() / PI) as f32]
    }

    /// The map to world space from the sphere's own space, in which its centre is the origin.
    pub fn to_world(&self) -> DAffine3 {
        self.space.to_world
    }

    /// The radius in the sphere's own space.
    pub fn radius(&self) -> f64 {
        self.radius
    }

    /// Returns the derivatives of a point's world-space position with respect to `u` and `v` of
    /// [`Geometry::parametric_at`](crate::Geometry::parametric_at). At the poles, both derivatives are zero.
    pub fn derivatives(&self, point: Vec3) -> [Vec3; 2] {
        let p = self.space.point_to_object(point);
        let across = p.truncate().length();
        let upwards = match across > 0.0 {
            true => DVec3::new(-p.z * p.x / across, -p.z * p.y / across, across),
            false => DVec3::ZERO,
        };
        self.space.derivatives([DVec3::new(-p.y, p.x, 0.0) * TAU, upwards * PI])
    }
}

/// A disk or ring in a plane of constant z of its own space, with an affine map to world space. Intersections are
/// computed in f64.
#[derive(Clone, Copy, Debug)]
pub struct Disk {
    space: Space,
    height: f64,
    radius: f64,
    inner_radius: f64,
}

impl Disk {
    /// Makes a disk in world space from its centre, its normal and its radius. `inner_radius` is the radius of the hole; 0 for
    /// no hole. `normal` need not have unit length.
    ///
    /// # Errors
    /// The errors of [`transformed`](Self::transformed). [`Error::BadParameter`] also if the length of `normal` is not
    /// positive and finite.
    pub fn new(centre: Vec3, normal: Vec3, radius: f32, inner_radius: f32) -> Result<Self, Error> {
        let normal = normal.as_dvec3();
        let length = normal.length();
        positive("the length of a disk's normal", length)?;
        let z = normal / length;
        let (x, y) = z.any_orthonormal_pair();
        let to_world = DAffine3 { matrix3: DMat3::from_cols(x, y, z), translation: centre.as_dvec3() };
        Self::transformed(to_world, 0.0, radius.into(), inner_radius.into())
    }

    /// Makes a disk around the z axis at `z = height` in object space, facing +z. `to_world` is an invertible affine map to
    /// world space.
    ///
    /// # Errors
    /// * [`Error::BadParameter`] unless `0 <= inner_radius < radius`, the radius and height are finite, and the map is
    ///   finite and invertible.
    /// * [`Error::ScaleOutOfRange`] if the largest magnitude of a coordinate of the bounding box is below 2^-60 or above 2^59.
    pub fn transformed(to_world: DAffine3, height: f64, radius: f64, inner_radius: f64) -> Result<Self, Error> {
        positive("a disk's radius", radius)?;
        let (within, expected) =
            ((0.0..radius).contains(&inner_radius), "it must be at least 0 and below the outer radius");
        Error::unless(within, "a disk's inner radius", inner_radius, expected)?;
        Error::unless(height.is_finite(), "a disk's height", height, "it must be finite")?;
        let space = Space::checked(to_world, "a transform's determinant")?;
        let disk = Self { space, height, radius, inner_radius };
        check_range("a disk's extent", disk.bounds())?;
        Ok(disk)
    }

    fn bounds(&self) -> [DVec3; 2] {
        self.space.bounds(DVec3::new(self.radius, self.radius, 0.0), DVec3::Z * self.height)
    }

    #[inline]
    fn root(&self, ray: &Ray) -> Option<f64> {
        let (o, d) = self.space.ray_to_object(ray);
        let t = (self.height - o.z) / d.z;
        let squared = (o + d * t).truncate().length_squared();
        let inside = squared <= self.radius * self.radius && squared >= self.inner_radius * self.inner_radius;
        (d.z != 0.0 && inside).then_some(t)
    }

    pub(crate) fn surface(&self, ray: &Ray, t: f32) -> SurfacePoint {
        let (o, d) = self.space.ray_to_object(ray);
        let point = o + d * self.root(ray).unwrap_or(t.into());
        let point = DVec3::new(point.x, point.y, self.height);
        self.space.surface(point, DVec3::ZERO, DVec3::Z, PrimitiveId::NONE)
    }

    pub(crate) fn parametric(&self, point: Vec3) -> [f32; 2] {
        let p = self.space.point_to_object(point);
        let v = (self.radius - p.truncate().length()) / (self.radius - self.inner_radius);
        [longitude(p), v.clamp(0.0, 1.0) as f32]
    }

    /// The map to world space from the disk's own space, in which the disk's axis is the z axis.
    pub fn to_world(&self) -> DAffine3 {
        self.space.to_world
    }

    /// The height along the z axis, the radius and the inner radius in the disk's own space.
    pub fn extent(&self) -> [f64; 3] {
        [self.height, self.radius, self.inner_radius]
    }

    /// Returns the derivatives of a point's world-space position with respect to `u` and `v` of
    /// [`Geometry::parametric_at`](crate::Geometry::parametric_at). At the centre, both derivatives are zero.
    pub fn derivatives(&self, point: Vec3) -> [Vec3; 2] {
        let p = self.space.point_to_object(point);
        let outwards = DVec3::new(p.x, p.y, 0.0).normalize_or_zero();
        let around = DVec3::new(-p.y, p.x, 0.0) * TAU;
        self.space.derivatives([around, outwards * (self.inner_radius - self.radius)])
    }
}

/// A sphere or a disk, as an item of the bounding volume hierarchy.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Quadric {
    Sphere(Sphere),
    Disk(Disk),
}

impl Quadric {
    /// Returns the smallest ray parameter of an intersection with `tmin < t < tmax`; `None` without one.
    #[inline]
    pub(crate) fn intersect(&self, ray: &Ray) -> Option<f32> {
        let (tmin, tmax) = (f64::from(ray.tmin), f64::from(ray.tmax));
        // Both the exact and the rounded parameter must obey the limits.
        let within = |t: f64| {
            let rounded = t as f32;
            (t > tmin && t < tmax && rounded > ray.tmin && rounded < ray.tmax).then_some(rounded)
        };
        match self {
            Self::Sphere(sphere) => {
                let [near, far] = sphere.roots(ray)?;
                within(near).or_else(|| within(far))
            }
            Self::Disk(disk) => within(disk.root(ray)?),
        }
    }

    /// Returns the lower and upper corner of the bounding box in world space, in f64 and without padding.
    pub(crate) fn bounds(&self) -> [DVec3; 2] {
        match self {
            Self::Sphere(sphere) => sphere.space.bounds(DVec3::splat(sphere.radius), DVec3::ZERO),
            Self::Disk(disk) => disk.bounds(),
        }
    }
}

/// An object space (of a sphere, a disk or an object), given by the maps to world space and back.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Space {
    pub(crate) to_world: DAffine3,
    /// The inverse of the matrix of `to_world`. Points are first moved by the negative translation, which preserves precision
    /// far from the world's origin.
    to_object: DMat3,
}

impl Space {
    pub(crate) fn new(to_world: DAffine3) -> Self {
        Self { to_world, to_object: to_world.matrix3.inverse() }
    }

    /// Makes a space whose map must be finite and invertible. `what` is the name of the determinant in the error.
    pub(crate) fn checked(to_world: DAffine3, what: &'static str) -> Result<Self, Error> {
        let (space, determinant) = (Self::new(to_world), to_world.matrix3.determinant());
        let invertible = determinant != 0.0 && to_world.is_finite() && space.to_object.is_finite();
        Error::unless(invertible, what, determinant, "the map to world space must be finite and invertible")?;
        Ok(space)
    }

    #[inline]
    pub(crate) fn ray_to_object(&self, ray: &Ray) -> (DVec3, DVec3) {
        (self.point_to_object(ray.origin), self.to_object * ray.direction.as_dvec3())
    }

    #[inline]
    pub(crate) fn point_to_object(&self, point: Vec3) -> DVec3 {
        self.to_object * (point.as_dvec3() - self.to_world.translation)
    }

    /// Maps derivatives of a point from object space to world space.
    fn derivatives(&self, of: [DVec3; 2]) -> [Vec3; 2] {
        of.map(|d| (self.to_world.matrix3 * d).as_vec3())
    }

    /// Returns the exact world-space bounds of the ellipsoid or disk with half axes `half` around `centre`, both in object
    /// space.
    fn bounds(&self, half: DVec3, centre: DVec3) -> [DVec3; 2] {
        let m = self.to_world.matrix3;
        let centre = self.to_world.transform_point3(centre);
        let rows = [m.row(0), m.row(1), m.row(2)].map(|row| (row * half).length());
        let reach = DVec3::from_array(rows);
        [centre - reach, centre + reach]
    }

    /// Transforms a point, a bound on its error and a normal from object space to a surface point in world space.
    pub(crate) fn surface(&self, point: DVec3, error: DVec3, normal: DVec3, primitive: PrimitiveId) -> SurfacePoint {
        let DAffine3 { matrix3: m, translation } = self.to_world;
        let exact = m * point + translation;
        let magnitude = DMat3::from_cols(m.x_axis.abs(), m.y_axis.abs(), m.z_axis.abs());
        let entered = magnitude * point.abs() + translation.abs();
        let error = magnitude * error + exact.abs() * ROUNDING + entered * LOST_IN_F64;
        let normal = self.to_object.transpose() * normal;
        SurfacePoint {
            position: exact.as_vec3(),
            error: error.as_vec3(),
            normal: normal.normalize_or(DVec3::Z).as_vec3(),
            primitive,
        }
    }
}

/// Returns the angle around the z axis, from +x, as a fraction of the full turn in `[0, 1)`.
fn longitude(p: DVec3) -> f32 {
    let turns = p.y.atan2(p.x) / TAU;
    let share = (if turns < 0.0 { turns + 1.0 } else { turns }) as f32;
    if share < 1.0 { share } else { 0.0 }
}

fn positive(what: &'static str, value: f64) -> Result<(), Error> {
    Error::unless(value > 0.0 && value.is_finite(), what, value, "it must be positive and finite")
}

fn check_range(what: &'static str, [low, high]: [DVec3; 2]) -> Result<(), Error> {
    Error::out_of_range(what, low.abs().max(high.abs()).max_element(), SMALLEST)
}
