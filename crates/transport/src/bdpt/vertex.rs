//! Vertices of camera and light paths: scattering in both directions, and densities per area.

use crate::walk::{adjoint, leaks};
use dapple_geometry::{PrimitiveId, SurfacePoint};
use dapple_renderer::light::Target;
use dapple_renderer::shading::{Bsdf, ShadingFrame};
use glam::Vec3;

/// A vertex of a path, counted from the camera or from the light.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Vertex<'w> {
    pub(crate) kind: Kind<'w>,
    /// The position, with the geometric normal of a surface. Points that are not on a surface have the normal 0.
    pub(crate) point: SurfacePoint,
    /// The unit direction towards the previous vertex. For a vertex at infinity, the direction towards this vertex.
    pub(crate) wo: Vec3,
    /// The radiance or importance that arrives from the previous vertices, divided by the densities of the vertices so far.
    pub(crate) throughput: Vec3,
    /// True if the next vertex was sampled by a specular lobe, so that this vertex cannot be connected.
    pub(crate) specular: bool,
    /// The density with which its own path samples this vertex: per area, or per solid angle at infinity.
    pub(crate) forward: f32,
    /// The density with which a path in the other direction samples this vertex. It is set once the path has two more
    /// vertices.
    pub(crate) backward: f32,
    /// The random numbers that a vertex of a camera path uses to sample a light: one for the light, two for the point on it.
    pub(crate) to_light: [f32; 3],
}

/// The kind of a vertex.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Kind<'w> {
    /// The start of a camera path: the eye, or a point on the lens or on the screen.
    Camera,
    /// A surface that scatters light. `light` is the surface's index as an area light; `None` if it emits nothing.
    Surface { bsdf: Bsdf<'w>, frame: ShadingFrame, light: Option<u32> },
    /// A point of an area light at which a path starts.
    Lamp { light: u32 },
    /// A light that no ray can hit: a point, a spot or, with `parallel`, a distant light.
    Delta { parallel: bool },
    /// A direction of the environment.
    Sky,
}

/// The end from which a path is traced.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum From {
    /// A camera path, which carries importance.
    Camera,
    /// A light path, which carries radiance.
    Light,
}

/// A scattered direction, sampled at a vertex.
pub(crate) struct Scattered {
    /// The unit direction to the next vertex.
    pub(crate) direction: Vec3,
    /// The factor by which the throughput is multiplied.
    pub(crate) weight: Vec3,
    /// The solid-angle density of the direction; for a specular lobe, the lobe's probability.
    pub(crate) forward: f32,
    /// The density with which a path in the opposite direction samples the direction to the previous vertex, in the
    /// same measure.
    pub(crate) backward: f32,
    /// True for a specular lobe.
    pub(crate) specular: bool,
    /// The relative index of refraction crossed; see [`dapple_renderer::shading::BsdfSample::eta`].
    pub(crate) eta: f32,
}

/// The scattering between two given directions, with the density of sampling each from the other.
pub(crate) struct Connected {
    /// The throughput factor of a path that arrives along one direction and leaves along the other.
    pub(crate) factor: Vec3,
    /// The solid-angle density of the leaving direction.
    pub(crate) forward: f32,
    /// The solid-angle density with which a path in the opposite direction samples the direction to the previous vertex.
    pub(crate) backward: f32,
}

impl<'w> Vertex<'w> {
    /// Makes a vertex that its own path samples with density `forward`.
    pub(crate) fn new(kind: Kind<'w>, point: SurfacePoint, wo: Vec3, throughput: Vec3, forward: f32) -> Self {
        Self { kind, point, wo, throughput, specular: false, forward, backward: 0.0, to_light: [0.0; 3] }
    }

    /// Returns true if the vertex lies infinitely far away.
    pub(crate) fn is_far(&self) -> bool {
        matches!(self.kind, Kind::Sky | Kind::Delta { parallel: true, .. })
    }

    /// Returns true if a path from the other end can be connected here. Smooth surfaces cannot be connected.
    pub(crate) fn connects(&self) -> bool {
        matches!(&self.kind, Kind::Surface { bsdf, .. } if !bsdf.is_specular())
    }

    /// Returns the index of the area light that contains the vertex; `None` for other vertices.
    pub(crate) fn lamp(&self) -> Option<u32> {
        match self.kind {
            Kind::Surface { light, .. } => light,
            Kind::Lamp { light } => Some(light),
            _ => None,
        }
    }

    /// Returns the absolute cosine between a unit direction and the geometric normal; 1 for a point that is not on a surface.
    pub(crate) fn cosine(&self, direction: Vec3) -> f32 {
        match self.kind {
            Kind::Surface { .. } | Kind::Lamp { .. } => self.point.normal.dot(direction).abs(),
            _ => 1.0,
        }
    }

    /// Converts the solid-angle density `solid_angle` of a direction sampled at `from` to the density per area at this vertex.
    /// A vertex at infinity keeps the solid-angle density.
    pub(crate) fn density_from(&self, from: Vec3, solid_angle: f32) -> f32 {
        if self.is_far() {
            return solid_angle;
        }
        let to = self.point.position - from;
        let squared = to.length_squared();
        let density = solid_angle * self.cosine(to / squared.sqrt()) / squared;
        if density.is_finite() { density } else { 0.0 }
    }

    /// Returns the point with its geometric normal flipped to the side of a direction.
    pub(crate) fn facing(&self, direction: Vec3) -> SurfacePoint {
        let normal = self.point.normal;
        SurfacePoint { normal: if normal.dot(direction) < 0.0 { -normal } else { normal }, ..self.point }
    }

    /// Samples the direction to the next vertex. `from` is the end at which the path starts. `u` in `[0, 1)^2` selects the
    /// direction, and `lobe` in `[0, 1)` the lobe. Returns `None` if the path ends here.
    pub(crate) fn scatter(&self, from: From, u: [f32; 2], lobe: f32) -> Option<Scattered> {
        let Kind::Surface { bsdf, frame, .. } = &self.kind else { return None };
        let wo = frame.to_local(self.wo);
        let sample = bsdf.sample(wo, u, lobe)?;
        let direction = frame.to_world(sample.wi);
        let [arriving, leaving] = [self.wo, direction].map(|w| self.point.normal.dot(w));
        // Light may not pass through the geometric surface, even if the shading normal would allow it.
        if leaks([wo.z, sample.wi.z], [arriving, leaving]) {
            return None;
        }
        let (specular, forward, eta) = (sample.specular, sample.pdf, sample.eta);
        let adjoint = || adjoint([wo.z, sample.wi.z], [arriving, leaving]);
        // The opposite lobe has the same probability, in the measure of the directions before refraction.
        let opposite = forward * (wo.z.abs() / (eta * eta * sample.wi.z.abs()));
        let (weight, backward) = match (from, specular) {
            (From::Camera, true) => (sample.weight, opposite),
            (From::Camera, false) => (sample.weight, bsdf.pdf(sample.wi, wo)),
            // Radiance is scaled by the squared index on refraction; importance is not.
            (From::Light, true) => (sample.weight * (eta * eta * adjoint()), opposite),
            (From::Light, false) => {
                let (f, pdf) = bsdf.evaluate_and_pdf(sample.wi, wo);
                (f * (sample.wi.z.abs() * adjoint() / forward), pdf)
            }
        };
        let sound = weight.is_finite() && forward > 0.0;
        sound.then_some(Scattered { direction, weight, forward, backward, specular, eta })
    }

    /// Returns the scattering into the unit `direction`. `from` is the end at which the path starts. Returns `None` if nothing
    /// is scattered in that direction.
    pub(crate) fn connect(&self, from: From, direction: Vec3) -> Option<Connected> {
        let Kind::Surface { bsdf, frame, .. } = &self.kind else { return None };
        let [wo, wi] = [self.wo, direction].map(|w| frame.to_local(w));
        let [arriving, leaving] = [self.wo, direction].map(|w| self.point.normal.dot(w));
        if leaks([wo.z, wi.z], [arriving, leaving]) {
            return None;
        }
        let (eye, light) = if from == From::Camera { (wo, wi) } else { (wi, wo) };
        let ((f, to_light), to_eye) = (bsdf.evaluate_and_pdf(eye, light), bsdf.pdf(light, eye));
        let (factor, forward, backward) = match from {
            From::Camera => (f * wi.z.abs(), to_light, to_eye),
            From::Light => (f * (wi.z.abs() * adjoint([wo.z, wi.z], [arriving, leaving])), to_eye, to_light),
        };
        (factor != Vec3::ZERO && factor.is_finite()).then_some(Connected { factor, forward, backward })
    }
}

/// Returns a point that is not on a surface.
pub(super) fn point_in_space(position: Vec3) -> SurfacePoint {
    SurfacePoint { position, error: Vec3::ZERO, normal: Vec3::ZERO, primitive: PrimitiveId::NONE }
}

/// Returns the kind and the point of a vertex on light number `light`. `far` is the point to use for light from infinity.
pub(super) fn on_light<'w>(light: u32, target: Target, is_delta: bool, far: Vec3) -> (Kind<'w>, SurfacePoint) {
    match target {
        Target::Surface(point) => (Kind::Lamp { light }, point),
        Target::Point(position) => (Kind::Delta { parallel: false }, point_in_space(position)),
        Target::Far if is_delta => (Kind::Delta { parallel: true }, point_in_space(far)),
        Target::Far => (Kind::Sky, point_in_space(far)),
    }
}
