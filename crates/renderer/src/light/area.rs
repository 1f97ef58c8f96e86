//! Shapes that shine.

use super::spherical::SphericalTriangle;
use super::{Lamp, LightSample, Target, area_to_solid_angle};
use crate::shading::Frame;
use crate::shading::discrete::Discrete;
use crate::shading::warp;
use dapple_geometry::{Geometry, PrimitiveId, Shape, SurfacePoint};
use glam::{DVec3, Vec3};

/// Triangles that shine alike.
#[derive(Clone, Debug)]
pub struct MeshLamp {
    lamp: Lamp,
    facets: Vec<Facet>,
    choice: Discrete,
    /// Where each of a few facets starts on the unit interval, and one over its share of it: counting these
    /// takes half the time of the table (a lamp of two triangles, perf).
    few: Vec<[f32; 2]>,
    area: f64,
    /// No facet that is near a point has a point farther from it than the root of this.
    near_squared: f32,
    /// Facets by the number of their triangle, where some triangles have no area.
    facet_of: Vec<u32>,
}

/// Lamps of up to so many facets are walked through.
const FEW: usize = 8;

/// One triangle of a lamp, ready to be sampled.
#[derive(Clone, Copy, Debug)]
struct Facet {
    corner: Vec3,
    edges: [Vec3; 2],
    /// Unit, by the winding.
    normal: Vec3,
    /// 1 or -1: what turns the normal to the side that shines.
    side: f32,
    /// Bound on the error of a sampled point per axis.
    error: Vec3,
    primitive: PrimitiveId,
    /// Share of the lamp's area.
    share: f32,
    /// Squared distance of the farthest corner from the centroid: from nearer points, the facet is sampled by its
    /// solid angle, which the area would serve badly. From farther ones the density varies little over the facet.
    reach_squared: f32,
}

impl Facet {
    fn centroid(&self) -> Vec3 {
        self.corner + (self.edges[0] + self.edges[1]) * (1.0 / 3.0)
    }

    /// What is seen of the facet from a point so near that the solid angle is to be sampled. A pure function of both:
    /// light sampling and its density must agree.
    fn near(&self, from: Vec3) -> Option<SphericalTriangle> {
        if (from - self.centroid()).length_squared() >= self.reach_squared {
            return None;
        }
        let [corner, from] = [self.corner, from].map(Vec3::as_dvec3);
        let edges = self.edges.map(Vec3::as_dvec3);
        SphericalTriangle::new([corner, corner + edges[0], corner + edges[1]].map(|c| c - from))
    }

    /// Coordinates along the edges of the point of the triangle that lies in this direction.
    fn met(&self, from: Vec3, direction: DVec3) -> [f32; 2] {
        let [e0, e1] = self.edges.map(Vec3::as_dvec3);
        let to = from.as_dvec3() - self.corner.as_dvec3();
        // [Moeller and Trumbore 1997].
        let across = direction.cross(e1);
        let scale = 1.0 / e0.dot(across);
        let bound = |x: f64| if x.is_finite() { x.clamp(0.0, 1.0) } else { 0.0 };
        let b1 = bound(to.dot(across) * scale);
        let b2 = bound(direction.dot(to.cross(e0)) * scale);
        // Rounding leads past the far edge at most.
        let over = (b1 + b2).max(1.0);
        [(b1 / over) as f32, (b2 / over) as f32]
    }
}

/// A sphere that shines.
#[derive(Clone, Debug)]
pub struct SphereLamp {
    lamp: Lamp,
    centre: Vec3,
    radius: f32,
    /// Points this near to the centre count as inside: those on the sphere itself do, whichever way they
    /// were rounded.
    reach: f32,
    /// -1 if it shines inwards.
    flip: f32,
}

/// A disk or ring that shines.
#[derive(Clone, Debug)]
pub struct DiskLamp {
    lamp: Lamp,
    centre: Vec3,
    frame: Frame,
    radius: f32,
    inner_radius: f32,
}

impl MeshLamp {
    /// The mesh `shape` of `geometry`; `sides` holds a sign per triangle, or one for all. `None` if it has
    /// no area.
    pub(crate) fn new(geometry: &Geometry, shape: u32, lamp: Lamp, sides: &[f32]) -> Option<Self> {
        let Shape::Mesh(mesh) = &geometry.shapes()[shape as usize] else { return None };
        let mut facets = Vec::with_capacity(mesh.triangles().len());
        let mut areas = Vec::with_capacity(mesh.triangles().len());
        for triangle in (0..mesh.triangles().len() as u32).filter(|t| !mesh.is_degenerate(*t)) {
            let [a, b, c] = mesh.corners(triangle);
            let across = (b - a).as_dvec3().cross((c - a).as_dvec3());
            areas.push((across.length() * 0.5) as f32);
            facets.push(Facet {
                corner: a,
                edges: [b - a, c - a],
                normal: across.normalize_or_zero().as_vec3(),
                side: sides.get(triangle as usize).or(sides.first()).copied().unwrap_or(1.0),
                // Six roundings at most: two edges, two products, two sums [Pharr et al. 2023, eq. 6.26].
                error: (a.abs().max(b.abs()).max(c.abs()) * 3.0) * (6.0 * f32::EPSILON),
                primitive: PrimitiveId::triangle(shape, triangle),
                share: 0.0,
                reach_squared: 0.0,
            });
        }
        let choice = Discrete::new(&areas).ok().filter(|d| !d.is_empty())?;
        let area = choice.total();
        let mut few = Vec::new();
        if facets.len() <= FEW && areas.iter().all(|a| *a > 0.0) {
            let mut end = 0.0;
            few.extend(areas.iter().map(|&a| {
                let start = end;
                end += f64::from(a) / area;
                [start as f32, (area / f64::from(a)) as f32]
            }));
        }
        for (facet, area_of_it) in facets.iter_mut().zip(&areas) {
            facet.share = (f64::from(*area_of_it) / area) as f32;
            let centroid = facet.centroid();
            let corners = [facet.corner, facet.corner + facet.edges[0], facet.corner + facet.edges[1]];
            facet.reach_squared = corners.map(|c| (c - centroid).length_squared()).into_iter().fold(0.0, f32::max);
        }
        // Twice the widest reach, and a margin for rounding.
        let near_squared = 5.0 * facets.iter().map(|f| f.reach_squared).fold(0.0, f32::max);
        let mut facet_of = Vec::new();
        if facets.len() < mesh.triangles().len() {
            facet_of = vec![0; mesh.triangles().len()];
            (0..).zip(&facets).for_each(|(i, f)| facet_of[f.primitive.number() as usize] = i);
        }
        Some(Self { lamp, facets, choice, few, area, near_squared, facet_of })
    }

    pub(super) fn lamp(&self) -> &Lamp {
        &self.lamp
    }

    pub(super) fn area(&self) -> f64 {
        self.area
    }

    /// Its middle, the distance of its farthest corner from there, and the mean of the unit normals on the side that
    /// shines.
    pub(super) fn extent(&self) -> (Vec3, f32, Vec3) {
        let sum = |f: &dyn Fn(&Facet) -> Vec3| self.facets.iter().map(|facet| f(facet) * facet.share).sum::<Vec3>();
        let middle = sum(&Facet::centroid);
        let corners = self.facets.iter().flat_map(|f| [f.corner, f.corner + f.edges[0], f.corner + f.edges[1]]);
        let radius = corners.map(|corner| (corner - middle).length()).fold(0.0, f32::max);
        (middle, radius, sum(&|facet| facet.normal * facet.side))
    }

    /// A triangle is chosen by its area, by `u[0]`, which is used again within it: that keeps the points stratified
    /// over the whole lamp. Within, uniform over the area from far, over the solid angle from near.
    #[inline(always)]
    pub(super) fn sample(&self, from: Vec3, u: [f32; 2]) -> Option<LightSample> {
        let (index, within) = self.choose(u[0])?;
        let facet = &self.facets[index];
        let [_, b1, b2] = warp::uniform_triangle([within, u[1]]);
        let position = facet.corner + facet.edges[0] * b1 + facet.edges[1] * b2;
        // Where the distance is known anyway, this costs a comparison; whether the facet is near is decided after it.
        if (position - from).length_squared() < self.near_squared
            && let Some(seen) = facet.near(from)
        {
            return self.sample_near(facet, &seen, from, [within, u[1]]);
        }
        let point = SurfacePoint { position, error: facet.error, normal: facet.normal, primitive: facet.primitive };
        sample_on(&self.lamp, from, point, facet.side, self.area as f32)
    }

    /// Uniform over the solid angle of a facet.
    #[inline(never)]
    fn sample_near(&self, facet: &Facet, seen: &SphericalTriangle, from: Vec3, u: [f32; 2]) -> Option<LightSample> {
        let radiance = self.lamp.radiance(if seen.seen_from_above() { facet.side } else { -facet.side });
        if radiance == Vec3::ZERO {
            return None;
        }
        let [b1, b2] = facet.met(from, seen.sample(u.map(f64::from)));
        let position = facet.corner + facet.edges[0] * b1 + facet.edges[1] * b2;
        let wi = (position - from).try_normalize()?;
        let point = SurfacePoint { position, error: facet.error, normal: facet.normal, primitive: facet.primitive };
        let pdf = facet.share / seen.solid_angle as f32;
        Some(LightSample { wi, radiance, pdf, target: Target::Surface(point), delta: false })
    }

    /// The facet that `u` chooses by area, and the place of `u` within its share, in `[0, 1)`.
    #[inline(always)]
    fn choose(&self, u: f32) -> Option<(usize, f32)> {
        if !self.few.is_empty() {
            // Counted, not searched: the processor cannot guess where a random number falls.
            let index = self.few[1..].iter().map(|[start, _]| usize::from(u >= *start)).sum::<usize>();
            let [start, scale] = self.few[index];
            return Some((index, ((u - start) * scale).clamp(0.0, BELOW_ONE)));
        }
        let choice = self.choice.sample(u)?;
        Some((choice.index, choice.u))
    }

    #[inline]
    pub(super) fn pdf(&self, from: Vec3, point: &SurfacePoint) -> f32 {
        if (point.position - from).length_squared() < self.near_squared
            && let Some(pdf) = self.pdf_near(from, point)
        {
            return pdf;
        }
        area_to_solid_angle(from, point, self.area as f32)
    }

    #[inline(never)]
    fn pdf_near(&self, from: Vec3, point: &SurfacePoint) -> Option<f32> {
        let number = point.primitive.number() as usize;
        let number = if self.facet_of.is_empty() { number } else { *self.facet_of.get(number)? as usize };
        let facet = self.facets.get(number).filter(|f| f.primitive == point.primitive)?;
        facet.near(from).map(|seen| facet.share / seen.solid_angle as f32)
    }
}

/// The largest `f32` below 1.
const BELOW_ONE: f32 = 1.0 - f32::EPSILON / 2.0;

/// The sample that a point drawn uniformly on `area` is; `side` turns its normal to the side that shines.
#[inline(always)]
fn sample_on(lamp: &Lamp, from: Vec3, point: SurfacePoint, side: f32, area: f32) -> Option<LightSample> {
    let to = point.position - from;
    let squared = to.length_squared();
    let wi = to * squared.sqrt().recip();
    let cosine = -side * point.normal.dot(wi);
    let radiance = lamp.radiance(cosine);
    // As `area_to_solid_angle`; a lamp that touches the point has no direction.
    let pdf = squared / (cosine.abs() * area);
    (radiance != Vec3::ZERO && pdf > 0.0).then_some(LightSample {
        wi,
        radiance,
        pdf,
        target: Target::Surface(point),
        delta: false,
    })
}

impl SphereLamp {
    /// A sphere; `flip` is -1 if it shines inwards.
    pub(crate) fn new(lamp: Lamp, centre: Vec3, radius: f32, flip: f32) -> Self {
        // A point on the sphere is off by a rounding of each coordinate; its distance by some more.
        let error = (centre.length() + radius) * (4.0 * f32::EPSILON);
        Self { lamp, centre, radius, reach: radius + error, flip }
    }

    pub(super) fn lamp(&self) -> &Lamp {
        &self.lamp
    }

    pub(super) fn area(&self) -> f64 {
        4.0 * std::f64::consts::PI * f64::from(self.radius) * f64::from(self.radius)
    }

    /// Its middle and radius.
    pub(super) fn extent(&self) -> (Vec3, f32) {
        (self.centre, self.radius)
    }

    /// From outside uniform over the cone that the sphere fills, which no distance makes vanish: the
    /// cone's height `1 - cos` is computed from the sine [Pharr et al. 2023, sec. 6.2.4]; from inside, and
    /// from the sphere itself, uniform over the area.
    #[inline]
    pub(super) fn sample(&self, from: Vec3, u: [f32; 2]) -> Option<LightSample> {
        let axis = from - self.centre;
        let Some(sin2) = self.sine_squared(axis) else {
            let normal = warp::uniform_sphere(u);
            return sample_on(&self.lamp, from, self.point(normal), self.flip, self.area() as f32);
        };
        let height = warp::one_minus_cos(sin2);
        let local = warp::uniform_cone(u, height);
        // Angle at the centre between the axis and the point met first; both terms keep their digits
        // at any distance [Pharr et al. 2023, eq. 6.6].
        let sin2_theta = local.x * local.x + local.y * local.y;
        let sin_max = sin2.sqrt();
        let cos_alpha = sin2_theta / sin_max + local.z * (1.0 - sin2_theta / sin2).max(0.0).sqrt();
        let sin_alpha = (1.0 - cos_alpha * cos_alpha).max(0.0).sqrt();
        let frame = Frame::from_normal(axis.normalize());
        let around = if sin2_theta > 0.0 { 1.0 / sin2_theta.sqrt() } else { 0.0 };
        let normal = frame.to_world(Vec3::new(local.x * around * sin_alpha, local.y * around * sin_alpha, cos_alpha));
        let point = self.point(normal.normalize());
        let wi = frame.to_world(Vec3::new(local.x, local.y, -local.z)).normalize();
        // The first point met is seen from outside.
        let radiance = self.lamp.radiance(self.flip);
        let pdf = warp::uniform_cone_pdf(height);
        (radiance != Vec3::ZERO).then_some(LightSample {
            wi,
            radiance,
            pdf,
            target: Target::Surface(point),
            delta: false,
        })
    }

    #[inline]
    pub(super) fn pdf(&self, from: Vec3, point: &SurfacePoint) -> f32 {
        match self.sine_squared(from - self.centre) {
            Some(sin2) => warp::uniform_cone_pdf(warp::one_minus_cos(sin2)),
            None => area_to_solid_angle(from, point, self.area() as f32),
        }
    }

    /// Squared sine of half the angle that the sphere fills, from outside.
    #[inline]
    fn sine_squared(&self, axis: Vec3) -> Option<f32> {
        let squared = axis.length_squared();
        (squared > self.reach * self.reach).then(|| self.radius * self.radius / squared)
    }

    /// The point with this outward normal, with the error of its computation.
    #[inline]
    fn point(&self, normal: Vec3) -> SurfacePoint {
        let position = self.centre + normal * self.radius;
        // Three roundings of each coordinate, and those of the normal.
        let error = (self.centre.abs() + Vec3::splat(self.radius)) * (4.0 * f32::EPSILON);
        SurfacePoint { position, error, normal, primitive: PrimitiveId::NONE }
    }
}

impl DiskLamp {
    /// A ring around `centre` that shines along `normal` (unit length).
    pub(crate) fn new(lamp: Lamp, centre: Vec3, normal: Vec3, radius: f32, inner_radius: f32) -> Self {
        Self { lamp, centre, frame: Frame::from_normal(normal), radius, inner_radius }
    }

    pub(super) fn lamp(&self) -> &Lamp {
        &self.lamp
    }

    pub(super) fn area(&self) -> f64 {
        let [outer, inner] = [self.radius, self.inner_radius].map(f64::from);
        std::f64::consts::PI * (outer - inner) * (outer + inner)
    }

    /// Its middle, radius and normal.
    pub(super) fn extent(&self) -> (Vec3, f32, Vec3) {
        (self.centre, self.radius, self.frame.normal)
    }

    /// Uniform over the area, equal areas of the disk mapped to equal areas of the ring.
    #[inline]
    pub(super) fn sample(&self, from: Vec3, u: [f32; 2]) -> Option<LightSample> {
        let disk = warp::concentric_disk(u);
        let hole = self.inner_radius / self.radius;
        let r2 = disk.length_squared();
        let wanted = (hole * hole + r2 * (1.0 - hole * hole)).sqrt();
        let on = if hole > 0.0 && r2 > 0.0 { disk * (wanted / r2.sqrt()) } else { disk };
        let position = self.centre + (self.frame.tangent * on.x + self.frame.bitangent * on.y) * self.radius;
        let error = (self.centre.abs() + Vec3::splat(self.radius)) * (4.0 * f32::EPSILON);
        let point = SurfacePoint { position, error, normal: self.frame.normal, primitive: PrimitiveId::NONE };
        sample_on(&self.lamp, from, point, 1.0, self.area() as f32)
    }

    #[inline]
    pub(super) fn pdf(&self, from: Vec3, point: &SurfacePoint) -> f32 {
        area_to_solid_angle(from, point, self.area() as f32)
    }
}
