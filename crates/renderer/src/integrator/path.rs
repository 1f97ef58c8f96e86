//! Path tracing with next-event estimation, multiple importance sampling and Russian roulette
//! [Kajiya 1986; Veach 1997, ch. 9 and 10].

#![allow(clippy::neg_cmp_op_on_partial_ord, reason = "a survival that is no number ends the path")]

use crate::World;
use crate::blocks;
use crate::camera::Lens;
use crate::light::Target;
use crate::material::Surface;
use crate::shading::{Bsdf, Frame, power_heuristic, power_heuristic_over_pdf};
use crate::world::{Interaction, NO_LIGHT};
use dapple_core::{Draws, Estimate, FirstHit, Integrator, Observed};
use dapple_geometry::{Ray, spawn_ray, spawn_ray_to, spawn_ray_to_point};
use glam::Vec3;
use std::marker::PhantomData;

/// Roulette starts after this many scattering events: before, nearly every path is worth its cost.
pub(super) const ROULETTE_FROM: u32 = 4;
/// No path survives more surely than this, so that endless ones end. The variance of an endless path is
/// finite only while albedo^2 < SURVIVAL, so 0.95 would lose closed rooms of albedo 0.98.
const SURVIVAL: f32 = 0.99;

/// A path tracer for worlds with a lens `L`; with (`SEVERAL`) or without a choice among lights; with
/// (`SKY`) or without an environment; with (`DEEP`) or without paths long enough for roulette.
#[derive(Debug)]
pub struct PathTracer<'w, L, const SEVERAL: bool, const SKY: bool, const DEEP: bool> {
    world: &'w World,
    lens: PhantomData<fn() -> L>,
}

/// Where a path stands.
struct Path {
    ray: Ray,
    throughput: Vec3,
    radiance: Vec3,
    /// The last scattering event, if light sampling could have found what the ray meets.
    last: Option<LastScatter>,
    rays: u32,
}

#[derive(Clone, Copy)]
struct LastScatter {
    position: Vec3,
    /// Density with which the ray's direction was drawn.
    pdf: f32,
}

impl<'w, L: Lens, const SEVERAL: bool, const SKY: bool, const DEEP: bool> PathTracer<'w, L, SEVERAL, SKY, DEEP> {
    pub(super) fn new(world: &'w World) -> Self {
        Self { world, lens: PhantomData }
    }

    #[inline(always)]
    fn camera_ray(&self, draws: &Draws<'_>) -> Ray {
        let u = draws.block(blocks::CAMERA);
        let offset = self.world.filter.sample([u[0], u[1]]);
        let view = &self.world.camera;
        L::ray(view, view.place(draws.pixel(), offset), [u[2], u[3]])
    }

    /// Light that a hit lamp gives off towards the ray's origin, weighted against light sampling.
    #[inline(always)]
    fn emitted(&self, path: &Path, at: &Interaction<'_>) -> Vec3 {
        let lights = &self.world.lights;
        let Some(lamp) = lights.lamp(at.part.light) else { return Vec3::ZERO };
        let radiance = lamp.radiance(-at.point.normal.dot(path.ray.direction));
        match path.last {
            Some(last) if radiance != Vec3::ZERO => {
                let found = lights.pdf(at.part.light, last.position, &at.point);
                radiance * power_heuristic(last.pdf, found)
            }
            _ => radiance,
        }
    }

    /// Light from beyond the scene along the path's ray.
    #[inline]
    fn sky(&self, path: &Path) -> Vec3 {
        self.world.lights.sky(path.ray.direction, path.last.map(|last| last.pdf))
    }

    /// Next-event estimation: light that arrives at a hit straight from a lamp, and is scattered towards
    /// `wo`.
    #[inline(always)]
    #[expect(clippy::too_many_arguments, reason = "the innermost loop, kept flat")]
    fn direct(
        &self,
        path: &mut Path,
        at: &Interaction<'_>,
        frame: &Frame,
        bsdf: &Bsdf<'_>,
        wo: Vec3,
        outside: f32,
        choice: f32,
        u: [f32; 2],
    ) -> Vec3 {
        let world = self.world;
        let Some(light) = world.lights.sample(at.point.position, choice, u) else {
            return Vec3::ZERO;
        };
        // No light through the geometric surface, whatever the shading normal says.
        if at.point.normal.dot(light.wi) * outside <= 0.0 {
            return Vec3::ZERO;
        }
        let wi = bsdf.local(frame, light.wi);
        let (f, pdf) = bsdf.evaluate_and_pdf(wo, wi);
        if f == Vec3::ZERO {
            return Vec3::ZERO;
        }
        let ray = match &light.target {
            Target::Surface(point) => spawn_ray_to(&at.point, point),
            Target::Point(target) => spawn_ray_to_point(&at.point, *target),
            Target::Far => spawn_ray(&at.point, light.wi),
        };
        path.rays += 1;
        if world.geometry.occluded(&ray) {
            return Vec3::ZERO;
        }
        let pdf = if light.delta { 0.0 } else { pdf };
        f * light.radiance * (wi.z.abs() * power_heuristic_over_pdf(light.pdf, pdf))
    }

    /// The scattering event number `vertex`: gathers direct light and turns the ray. Returns whether the
    /// path goes on.
    #[inline(always)]
    fn scatter(&self, draws: &Draws<'_>, path: &mut Path, at: &Interaction<'_>, vertex: u32) -> bool {
        let world = self.world;
        let surface = &world.surfaces[at.part.material as usize];
        if surface.black {
            return false;
        }
        let uv = if surface.textured { world.uv(at) } else { [0.0; 2] };
        let bsdf = surface.bsdf(&world.textures, uv);
        let frame = world.frame(at, surface);
        let wo = bsdf.local(&frame, -path.ray.direction);
        let outside = -at.point.normal.dot(path.ray.direction);
        let roulette = DEEP && vertex >= ROULETTE_FROM;
        let chooses = SEVERAL || surface.several_lobes || roulette;
        let choices = if chooses { draws.block(blocks::choose(vertex)) } else { [0.0; 4] };
        let u = draws.block(blocks::scatter(vertex));
        if !bsdf.is_specular() && !world.lights.is_empty() {
            let direct = self.direct(path, at, &frame, &bsdf, wo, outside, choices[0], [u[0], u[1]]);
            path.radiance += path.throughput * direct;
        }
        let Some(sample) = bsdf.sample(wo, [u[2], u[3]], choices[1]) else { return false };
        let wi = frame.to_world(sample.wi);
        if at.point.normal.dot(wi) * outside <= 0.0 {
            return false;
        }
        path.throughput *= sample.weight;
        if roulette {
            let survival = path.throughput.max_element().min(SURVIVAL);
            if !(choices[2] < survival) {
                return false;
            }
            path.throughput /= survival;
        }
        path.last = (!sample.specular).then_some(LastScatter { position: at.point.position, pdf: sample.pdf });
        path.ray = spawn_ray(&at.point, wi);
        path.throughput.max_element() > 0.0
    }

    /// Outlined: most renders ask for no first hits.
    #[inline(never)]
    fn report(&self, ray: &Ray, at: &Interaction<'_>) -> FirstHit {
        let world = self.world;
        let surface: &Surface = &world.surfaces[at.part.material as usize];
        let uv = if surface.textured { world.uv(at) } else { [0.0; 2] };
        let bsdf = surface.bsdf(&world.textures, uv);
        let side = if at.point.normal.dot(ray.direction) > 0.0 { -1.0 } else { 1.0 };
        let shading = world.frame(at, surface).normal;
        let shines = at.part.light != NO_LIGHT;
        let depth = (at.point.position - ray.origin).length();
        FirstHit {
            position: at.point.position.to_array(),
            geometric_normal: (at.point.normal * side).to_array(),
            shading_normal: (shading * side).to_array(),
            albedo: if shines { [1.0; 3] } else { bsdf.albedo().to_array() },
            depth,
            footprint: depth * world.camera.pixel_width(),
            roughness: bsdf.roughness(),
            material: at.part.material,
            shape: at.hit.shape,
            primitive: at.hit.primitive,
        }
    }
}

impl<L: Lens, const SEVERAL: bool, const SKY: bool, const DEEP: bool> Integrator
    for PathTracer<'_, L, SEVERAL, SKY, DEEP>
{
    fn estimate(&self, draws: &Draws<'_>, _: &mut Observed) -> Estimate {
        let mut path =
            Path { ray: self.camera_ray(draws), throughput: Vec3::ONE, radiance: Vec3::ZERO, last: None, rays: 0 };
        let mut first_hit = None;
        let mut vertex = 0;
        loop {
            path.rays += 1;
            let Some(at) = self.world.closest(&path.ray) else {
                if SKY {
                    path.radiance += path.throughput * self.sky(&path);
                }
                break;
            };
            if at.part.light != NO_LIGHT {
                path.radiance += path.throughput * self.emitted(&path, &at);
            }
            if vertex == 0 && draws.wants_first_hit() {
                first_hit = Some(self.report(&path.ray, &at));
            }
            if vertex >= self.world.max_depth || !self.scatter(draws, &mut path, &at, vertex) {
                break;
            }
            vertex += 1;
        }
        Estimate { radiance: path.radiance.to_array(), first_hit, cost: path.rays }
    }
}
