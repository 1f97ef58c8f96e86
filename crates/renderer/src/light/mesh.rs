//! Meshes that emit light.

use super::source::{
    EmittedLight, Expectation, Lamp, LightSample, LightSource, SceneSphere, Target, area_to_solid_angle, sample_on,
};
use crate::shading::discrete::{BELOW_ONE, Discrete};
use crate::shading::warp;
use dapple_geometry::{Geometry, PrimitiveId, Shape, SurfacePoint};
use glam::{DVec3, Vec3};
use std::f64::consts::PI;

/// A mesh whose triangles all emit the same radiance; see [`TexturedLight`](super::TexturedLight) for varying emission.
#[derive(Clone, Debug)]
pub(crate) struct MeshLight {
    pub(super) lamp: Lamp,
    pub(super) facets: Vec<Facet>,
    choice: Discrete,
    /// For lights of at most [`FEW`] triangles: the start of each triangle's interval in the unit interval, and 1 divided by
    /// the interval's length. Empty for larger lights.
    ///
    /// For a light of two triangles, this linear search takes half the time of the table.
    few: Vec<[f32; 2]>,
    pub(super) area: f64,
    /// The squared distance from a sampled point beyond which [`Facet::near`] returns `None` for every triangle.
    near_squared: f32,
    /// The index in `facets` of each triangle of the mesh; empty if all triangles have an area.
    facet_of: Vec<u32>,
}

/// The largest number of triangles for which one is selected by linear search.
const FEW: usize = 8;

/// One triangle of a mesh light, prepared for sampling.
#[derive(Clone, Copy, Debug)]
pub(super) struct Facet {
    corner: Vec3,
    edges: [Vec3; 2],
    /// The unit normal on the side from which the corners appear counter-clockwise.
    normal: Vec3,
    /// 1 if `normal` is on the emitting side, -1 if it is on the other.
    side: f32,
    /// A bound on the rounding error of a sampled point, per axis.
    error: Vec3,
    pub(super) primitive: PrimitiveId,
    /// The probability of selecting this triangle: its fraction of the light's area, unless triangles have weights.
    pub(super) share: f32,
    /// The squared distance from the centroid to the farthest corner.
    ///
    /// From points nearer than this, the triangle is sampled by solid angle; from farther points, by area.
    reach_squared: f32,
}

impl Facet {
    fn centroid(&self) -> Vec3 {
        self.corner + (self.edges[0] + self.edges[1]) * (1.0 / 3.0)
    }

    /// Returns the point at these coordinates along the two edges. Its normal follows the triangle's winding.
    #[inline(always)]
    fn point(&self, b1: f32, b2: f32) -> SurfacePoint {
        let position = self.corner + self.edges[0] * b1 + self.edges[1] * b2;
        SurfacePoint { position, error: self.error, normal: self.normal, primitive: self.primitive }
    }

    fn corners(&self) -> [Vec3; 3] {
        [self.corner, self.corner + self.edges[0], self.corner + self.edges[1]]
    }

    /// Returns the triangle's projection onto the sphere around a nearby point, for sampling by solid angle. Returns `None`
    /// for distant points.
    ///
    /// The result depends only on the triangle and the point, so sampling and density always agree on the method.
    fn near(&self, from: Vec3) -> Option<SphericalTriangle> {
        if (from - self.centroid()).length_squared() >= self.reach_squared {
            return None;
        }
        let [corner, from] = [self.corner, from].map(Vec3::as_dvec3);
        let edges = self.edges.map(Vec3::as_dvec3);
        SphericalTriangle::new([corner, corner + edges[0], corner + edges[1]].map(|c| c - from))
    }

    /// Returns a point's coordinates along the two edges, clamped to the triangle.
    pub(super) fn coordinates(&self, position: Vec3) -> [f32; 2] {
        let [e0, e1] = self.edges.map(Vec3::as_dvec3);
        let (to, across) = ((position - self.corner).as_dvec3(), e0.cross(e1));
        let scale = across.length_squared().recip();
        within([to.cross(e1).dot(across) * scale, e0.cross(to).dot(across) * scale])
    }

    /// Returns the intersection of the triangle with the ray from a point in `direction`, as coordinates along the two edges.
    fn intersection(&self, from: Vec3, direction: DVec3) -> [f32; 2] {
        let [e0, e1] = self.edges.map(Vec3::as_dvec3);
        let to = from.as_dvec3() - self.corner.as_dvec3();
        // The intersection of Moeller and Trumbore [1997].
        let across = direction.cross(e1);
        let scale = 1.0 / e0.dot(across);
        within([to.dot(across) * scale, direction.dot(to.cross(e0)) * scale])
    }
}

/// Clamps coordinates along two edges to the triangle. Rounding may have moved them slightly out of it.
fn within(coordinates: [f64; 2]) -> [f32; 2] {
    let [b1, b2] = coordinates.map(|x| if x.is_finite() { x.clamp(0.0, 1.0) } else { 0.0 });
    let over = (b1 + b2).max(1.0);
    [(b1 / over) as f32, (b2 / over) as f32]
}

impl MeshLight {
    /// Makes the light of the mesh with index `shape` in `geometry`. Returns `None` for other shapes and for a mesh
    /// without area.
    ///
    /// `sides` holds one sign per triangle, or one sign for all: 1 if the winding's side emits, -1 for the other.
    pub(crate) fn new(geometry: &Geometry, shape: u32, lamp: Lamp, sides: &[f32]) -> Option<Self> {
        Self::weighted(geometry, shape, lamp, sides, |_| 1.0)
    }

    /// Makes the light as [`Self::new`] does, but selects triangles by area times `weight`. `weight` receives the number of a
    /// triangle.
    pub(super) fn weighted(
        geometry: &Geometry,
        shape: u32,
        lamp: Lamp,
        sides: &[f32],
        weight: impl Fn(u32) -> f32,
    ) -> Option<Self> {
        let Shape::Mesh(mesh) = &geometry.shapes()[shape as usize] else { return None };
        let mut facets = Vec::with_capacity(mesh.triangles().len());
        let (mut area, mut weights) = (0.0, Vec::with_capacity(mesh.triangles().len()));
        for triangle in (0..mesh.triangles().len() as u32).filter(|t| !mesh.is_degenerate(*t)) {
            let [a, b, c] = mesh.corners(triangle);
            let across = (b - a).as_dvec3().cross((c - a).as_dvec3());
            let of_it = (across.length() * 0.5) as f32;
            area += f64::from(of_it);
            weights.push(of_it * weight(triangle));
            facets.push(Facet {
                corner: a,
                edges: [b - a, c - a],
                normal: across.normalize_or_zero().as_vec3(),
                side: sides.get(triangle as usize).or(sides.first()).copied().unwrap_or(1.0),
                // At most six roundings: two edges, two products, two sums [Pharr et al. 2023, eq. 6.26].
                error: (a.abs().max(b.abs()).max(c.abs()) * 3.0) * (6.0 * f32::EPSILON),
                primitive: PrimitiveId::triangle(shape, triangle),
                share: 0.0,
                reach_squared: 0.0,
            });
        }
        let choice = Discrete::new(&weights).ok().filter(|d| !d.is_empty())?;
        let total = choice.total();
        let mut few = Vec::new();
        if facets.len() <= FEW && weights.iter().all(|w| *w > 0.0) {
            let mut end = 0.0;
            few.extend(weights.iter().map(|&w| {
                let start = end;
                end += f64::from(w) / total;
                [start as f32, (total / f64::from(w)) as f32]
            }));
        }
        for (facet, weight) in facets.iter_mut().zip(&weights) {
            facet.share = (f64::from(*weight) / total) as f32;
            let centroid = facet.centroid();
            facet.reach_squared =
                facet.corners().map(|c| (c - centroid).length_squared()).into_iter().fold(0.0, f32::max);
        }
        // Twice the largest distance to a corner, squared, and a margin for rounding.
        let near_squared = 5.0 * facets.iter().map(|f| f.reach_squared).fold(0.0, f32::max);
        let mut facet_of = Vec::new();
        if facets.len() < mesh.triangles().len() {
            facet_of = vec![0; mesh.triangles().len()];
            (0..).zip(&facets).for_each(|(i, f)| facet_of[f.primitive.number() as usize] = i);
        }
        Some(Self { lamp, facets, choice, few, area, near_squared, facet_of })
    }

    /// Samples a point of a triangle uniformly by solid angle.
    #[inline(never)]
    fn sample_near(&self, facet: &Facet, seen: &SphericalTriangle, from: Vec3, u: [f32; 2]) -> Option<LightSample> {
        let radiance = self.lamp.radiance(if seen.seen_from_above() { facet.side } else { -facet.side });
        if radiance == Vec3::ZERO {
            return None;
        }
        let [b1, b2] = facet.intersection(from, seen.sample(u.map(f64::from)));
        let point = facet.point(b1, b2);
        let wi = (point.position - from).try_normalize()?;
        let pdf = facet.share / seen.solid_angle as f32;
        Some(LightSample { wi, radiance, pdf, target: Target::Surface(point), delta: false })
    }

    /// Selects a triangle by area with a random number `u` in `[0, 1)`. Returns its index, and the remainder of `u`
    /// rescaled to `[0, 1)`.
    #[inline(always)]
    fn choose(&self, u: f32) -> Option<(usize, f32)> {
        if !self.few.is_empty() {
            // All entries are counted, since the branches of a search would be mispredicted.
            let index = self.few[1..].iter().map(|[start, _]| usize::from(u >= *start)).sum::<usize>();
            let [start, scale] = self.few[index];
            return Some((index, ((u - start) * scale).clamp(0.0, BELOW_ONE)));
        }
        let choice = self.choice.sample(u)?;
        Some((choice.index, choice.u))
    }

    #[inline(never)]
    fn pdf_near(&self, from: Vec3, point: &SurfacePoint) -> Option<f32> {
        let facet = &self.facets[self.facet_at(point)?];
        facet.near(from).map(|seen| facet.share / seen.solid_angle as f32)
    }

    /// Returns the index of the triangle on which a point lies.
    #[inline]
    pub(super) fn facet_at(&self, point: &SurfacePoint) -> Option<usize> {
        let number = point.primitive.number() as usize;
        let number = if self.facet_of.is_empty() { number } else { *self.facet_of.get(number)? as usize };
        self.facets.get(number).filter(|f| f.primitive == point.primitive).map(|_| number)
    }

    /// Samples the light as [`LightSource::sample`] does. `area_of` returns a triangle's area divided by the probability of
    /// selecting it.
    #[inline(always)]
    pub(super) fn sample_by(&self, from: Vec3, u: [f32; 2], area_of: impl Fn(usize) -> f32) -> Option<LightSample> {
        let (index, within) = self.choose(u[0])?;
        let facet = &self.facets[index];
        let [_, b1, b2] = warp::uniform_triangle([within, u[1]]);
        let point = facet.point(b1, b2);
        // The distance to the sampled point is known, which gives a cheap first test.
        if (point.position - from).length_squared() < self.near_squared
            && let Some(seen) = facet.near(from)
        {
            return self.sample_near(facet, &seen, from, [within, u[1]]);
        }
        sample_on(&self.lamp, from, point, facet.side, area_of(index))
    }

    /// Returns the density of [`Self::sample_by`] for a point of the light.
    #[inline(always)]
    pub(super) fn pdf_by(&self, from: Vec3, point: &SurfacePoint, area: impl FnOnce() -> f32) -> f32 {
        if (point.position - from).length_squared() < self.near_squared
            && let Some(pdf) = self.pdf_near(from, point)
        {
            return pdf;
        }
        area_to_solid_angle(from, point, area())
    }

    /// Samples a ray that leaves the light, with areas as in [`Self::sample_by`].
    #[inline(always)]
    pub(super) fn emit_by(
        &self,
        place: [f32; 2],
        towards: [f32; 2],
        area_of: impl Fn(usize) -> f32,
    ) -> Option<EmittedLight> {
        let (index, within) = self.choose(place[0])?;
        let facet = &self.facets[index];
        let [_, b1, b2] = warp::uniform_triangle([within, place[1]]);
        let point = SurfacePoint { normal: facet.normal * facet.side, ..facet.point(b1, b2) };
        EmittedLight::from_surface(&self.lamp, point, towards, area_of(index))
    }
}

impl LightSource for MeshLight {
    /// Selects a triangle by area with `u[0]` and uses the rescaled remainder of `u[0]` within it, so that points are
    /// stratified over the whole light. Nearby triangles are sampled by solid angle, others by area.
    #[inline(always)]
    fn sample(&self, from: Vec3, u: [f32; 2]) -> Option<LightSample> {
        self.sample_by(from, u, |_| self.area as f32)
    }

    #[inline]
    fn pdf(&self, from: Vec3, point: &SurfacePoint) -> f32 {
        self.pdf_by(from, point, || self.area as f32)
    }

    #[inline]
    fn lamp(&self) -> Option<&Lamp> {
        Some(&self.lamp)
    }

    fn emit(&self, _: &SceneSphere, place: [f32; 2], towards: [f32; 2]) -> Option<EmittedLight> {
        self.emit_by(place, towards, |_| self.area as f32)
    }

    fn area(&self) -> f64 {
        self.area
    }

    fn expectation(&self) -> Expectation {
        let mean = |f: &dyn Fn(&Facet) -> Vec3| self.facets.iter().map(|facet| f(facet) * facet.share).sum::<Vec3>();
        let middle = mean(&Facet::centroid);
        let radius =
            self.facets.iter().flat_map(Facet::corners).map(|corner| (corner - middle).length()).fold(0.0, f32::max);
        let facing = self.lamp.facing(mean(&|facet| facet.normal * facet.side));
        Expectation::Near { middle, radius, facing, intensity: self.lamp.intensity(self.area) }
    }
}

/// A spherical triangle: the projection of a triangle onto the unit sphere around a point. Computations use f64, since they
/// subtract nearly equal numbers close to a light.
#[derive(Clone, Copy, Debug)]
struct SphericalTriangle {
    /// The unit vectors from the point to the corners.
    corners: [DVec3; 3],
    /// The triple product `a . (b x c)` of the corners. It is positive if the corners appear counter-clockwise from the point.
    triple: f64,
    solid_angle: f64,
}

/// The solid angle in steradians below which sampling by area is as good; pbrt-v4 uses 3e-4.
const LEAST: f64 = 1e-3;
/// The largest triple product of the unit vectors to the corners at which the point counts as in the triangle's plane, because
/// of rounding.
const FLAT: f64 = 1e-9;

impl SphericalTriangle {
    /// Makes the spherical triangle of a triangle whose corners are given relative to the point.
    ///
    /// Returns `None` if the solid angle is tiny or the point lies in the triangle's plane.
    fn new(corners: [DVec3; 3]) -> Option<Self> {
        let [a, b, c] = corners.map(DVec3::normalize_or_zero);
        let triple = a.dot(b.cross(c));
        // The arctangent gives half the solid angle [Van Oosterom and Strackee 1983].
        let solid_angle = 2.0 * libm::atan2(triple.abs(), 1.0 + a.dot(b) + b.dot(c) + c.dot(a));
        // If a corner coincides with the point, the triple product is 0.
        (triple.abs() > FLAT && solid_angle > LEAST).then_some(Self { corners: [a, b, c], triple, solid_angle })
    }

    /// Returns true if the point is on the side of the normal `(b - a) x (c - a)`.
    fn seen_from_above(&self) -> bool {
        self.triple < 0.0
    }

    /// Samples a unit direction uniformly by solid angle [Arvo 1995]. `u[0]` selects an arc through the second corner,
    /// and `u[1]` a point on the arc.
    fn sample(&self, u: [f64; 2]) -> DVec3 {
        let [a, b, c] = self.corners;
        let (ab, ac) = (a.cross(b), a.cross(c));
        let lengths = ab.length() * ac.length();
        // The angle between the two arcs at `a`, and the cosine of the arc from `a` to `b`.
        let (sin_alpha, cos_alpha) = (self.triple.abs() / lengths, (ab.dot(ac) / lengths).clamp(-1.0, 1.0));
        let cos_arc = a.dot(b);
        let area = (u[0] * self.solid_angle).min(2.0 * PI);
        let (sin_area, cos_area) = (libm::sin(area), libm::cos(area));
        let s = sin_area * cos_alpha - cos_area * sin_alpha;
        let t = cos_area * cos_alpha + sin_area * sin_alpha;
        let (p, q) = (t - cos_alpha, s + sin_alpha * cos_arc);
        let cos_side = ((q * t - p * s) * cos_alpha - q) / ((q * s + p * t) * sin_alpha);
        // NaN if the sub-triangle is empty.
        let cos_side = if cos_side.is_finite() { cos_side.clamp(-1.0, 1.0) } else { 1.0 };
        let third = towards(a, c, cos_side);
        let z = 1.0 - u[1] * (1.0 - third.dot(b));
        towards(b, third, z)
    }
}

/// Returns the unit vector on the arc from `from` towards `to` whose angle from `from` has this cosine.
fn towards(from: DVec3, to: DVec3, cosine: f64) -> DVec3 {
    from * cosine + (to - from * to.dot(from)).normalize_or_zero() * (1.0 - cosine * cosine).max(0.0).sqrt()
}
