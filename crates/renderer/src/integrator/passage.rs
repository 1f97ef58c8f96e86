//! What a ray passes on its way: media, holes cut by alpha, and surfaces that are but a border.

use super::code::RARE;
use super::path::{LastScatter, Path, PathTracer};
use crate::blocks;
use crate::camera::Lens;
use crate::light::{LightSample, Target};
use crate::material::{self, Surface};
use crate::medium::{HenyeyGreenstein, MediumEvent};
use crate::shading::power_heuristic_over_pdf;
use crate::world::{Interaction, NO_MEDIUM};
use dapple_core::Draws;
use dapple_geometry::{PrimitiveId, Ray, SurfacePoint, spawn_ray, spawn_ray_to, spawn_ray_to_point};
use glam::Vec3;

/// A ray that passed this many surfaces goes nowhere: nested interfaces and leaves are rarely a hundred deep.
const MOST_PASSED: u32 = 10_000;

/// What a ray finds at a hit.
pub(super) enum Met<'w> {
    /// A surface that scatters.
    Surface(&'w Surface),
    /// Nothing there: the ray goes on behind.
    Passed,
}

/// What a way through a medium ends with.
pub(super) enum Way {
    /// The surface ahead, or nothing.
    Passed,
    /// A scattering event, after which the path goes on.
    Scattered,
    /// Nothing more.
    Ended,
}

impl<'w, L: Lens, const E: u32> PathTracer<'w, L, E> {
    /// What is at a hit: a surface, or a hole in one.
    #[inline(always)]
    pub(super) fn meet(&self, draws: &Draws<'_>, path: &mut Path, at: &Interaction<'w>) -> Met<'w> {
        let surface = &self.world.surfaces[at.part.material as usize];
        if E & RARE == 0 || !at.part.unusual {
            return Met::Surface(surface);
        }
        self.meet_unusual(draws, path, at)
    }

    #[inline(never)]
    fn meet_unusual(&self, draws: &Draws<'_>, path: &mut Path, at: &Interaction<'w>) -> Met<'w> {
        let world = self.world;
        let mut surface = &world.surfaces[at.part.material as usize];
        let alpha = world.alpha(at);
        let partial = alpha > 0.0 && alpha < 1.0;
        let u = if partial || surface.mixes { draws.block(blocks::meet(path.segments)) } else { [0.0; 4] };
        if u[0] >= alpha {
            self.pass(path, at);
            return Met::Passed;
        }
        if surface.mixes {
            surface = material::resolve(&world.surfaces, at.part.material, &world.textures, world.uv(at), u[1]).0;
        }
        if surface.interface {
            path.medium = beyond(at, path.ray.direction, path.medium);
            self.pass(path, at);
            return Met::Passed;
        }
        Met::Surface(surface)
    }

    /// Goes on behind a hit in the same direction.
    fn pass(&self, path: &mut Path, at: &Interaction<'_>) {
        path.ray = spawn_ray(&at.point, path.ray.direction);
        if path.segments > MOST_PASSED {
            path.throughput = Vec3::ZERO;
        }
    }

    /// The share of light that gets through to a light, of a ray whose `t` ends there and that starts in `medium`;
    /// `None` where something is in the way. Counts the rays it takes.
    #[inline(always)]
    pub(super) fn transmittance(&self, ray: Ray, target: &Target, path: &mut Path, medium: u32) -> Option<Vec3> {
        let world = self.world;
        if E & RARE != 0 && world.hides_partly() {
            let share = self.transmittance_past(ray, target, path, medium);
            return (share != Vec3::ZERO).then_some(share);
        }
        path.rays += 1;
        let occluded = if E & RARE != 0 { world.occluded_at(&ray, path.time) } else { world.geometry.occluded(&ray) };
        if occluded {
            return None;
        }
        if E & RARE == 0 || medium == NO_MEDIUM {
            return Some(Vec3::ONE);
        }
        // The same medium all the way: another one begins beyond a surface, and there is none in between.
        Some(world.media.medium(medium).transmittance(ray.tmax * ray.direction.length()))
    }

    /// The same where surfaces may let light pass.
    #[inline(never)]
    fn transmittance_past(&self, mut ray: Ray, target: &Target, path: &mut Path, mut medium: u32) -> Vec3 {
        let world = self.world;
        let mut share = Vec3::ONE;
        for _ in 0..MOST_PASSED {
            path.rays += 1;
            let found = world.closest_at(&ray, path.time);
            let end = found.as_ref().map_or(ray.tmax, |at| at.hit.t);
            if medium != NO_MEDIUM {
                share *= world.media.medium(medium).transmittance(end * ray.direction.length());
            }
            let Some(at) = found else { return share };
            let part = at.part;
            if !part.unusual {
                return Vec3::ZERO;
            }
            let surface = &world.surfaces[part.material as usize];
            let alpha = world.alpha(&at);
            // A mixture lets through what its interfaces' share is.
            let empty = material::interface_share(&world.surfaces, part.material, &world.textures, || world.uv(&at));
            let through = 1.0 - alpha + alpha * empty;
            share *= through;
            if share == Vec3::ZERO {
                return share;
            }
            if surface.interface {
                medium = beyond(&at, ray.direction, medium);
            }
            ray = match target {
                Target::Surface(point) => spawn_ray_to(&at.point, point),
                Target::Point(place) => spawn_ray_to_point(&at.point, *place),
                Target::Far => spawn_ray(&at.point, ray.direction),
            };
        }
        Vec3::ZERO
    }

    /// The way through the path's medium to a surface at `distance` (infinite for none).
    #[inline(never)]
    pub(super) fn cross(&self, draws: &Draws<'_>, path: &mut Path, distance: f32, vertex: u32) -> Way {
        let world = self.world;
        let medium = world.media.medium(path.medium);
        if !medium.scatters() {
            path.throughput *= medium.transmittance(distance);
            return if path.throughput == Vec3::ZERO { Way::Ended } else { Way::Passed };
        }
        let u = draws.block(blocks::medium(path.segments));
        match medium.sample(distance, u[0], u[1], path.throughput) {
            MediumEvent::Pass { weight } => {
                path.throughput *= weight;
                Way::Passed
            }
            MediumEvent::Scatter { t, weight } => {
                path.throughput *= weight;
                if vertex >= world.max_depth || path.throughput == Vec3::ZERO {
                    return Way::Ended;
                }
                self.scatter_in_medium(draws, path, t, [u[2], u[3]], vertex)
            }
        }
    }

    fn scatter_in_medium(&self, draws: &Draws<'_>, path: &mut Path, t: f32, u: [f32; 2], vertex: u32) -> Way {
        let world = self.world;
        let position = path.ray.at(t);
        let phase = world.media.medium(path.medium).phase();
        let roulette = vertex >= super::path::ROULETTE_FROM;
        let chooses = world.lights.len() > 1 || roulette;
        let choices = if chooses { draws.block(blocks::choose(vertex)) } else { [0.0; 4] };
        if !world.lights.is_empty() {
            let on_light = draws.block(blocks::scatter(vertex));
            if let Some(light) = world.lights.sample(position, choices[0], [on_light[0], on_light[1]]) {
                let direct = self.direct_in_medium(path, position, phase, &light);
                path.radiance += path.throughput * direct;
            }
        }
        if roulette && !self.survives(path, choices[2]) {
            return Way::Ended;
        }
        let sample = phase.sample(path.ray.direction, u);
        path.last = Some(LastScatter { position, pdf: sample.pdf });
        path.ray = Ray::new(position, sample.wi);
        Way::Scattered
    }

    fn direct_in_medium(&self, path: &mut Path, position: Vec3, phase: &HenyeyGreenstein, light: &LightSample) -> Vec3 {
        // A point in space is exact and has no side.
        let from = SurfacePoint { position, error: Vec3::ZERO, normal: Vec3::ZERO, primitive: PrimitiveId::NONE };
        let ray = shadow_ray(&from, light);
        let medium = path.medium;
        let Some(share) = self.transmittance(ray, &light.target, path, medium) else { return Vec3::ZERO };
        // The phase function is a density: what it is worth is also how likely it is drawn.
        let pdf = phase.evaluate(path.ray.direction, light.wi);
        let weight = if light.delta { light.pdf.recip() } else { power_heuristic_over_pdf(light.pdf, pdf) };
        share * light.radiance * (pdf * weight)
    }
}

/// The ray from a point to a light.
#[inline(always)]
pub(super) fn shadow_ray(from: &SurfacePoint, light: &LightSample) -> Ray {
    match &light.target {
        Target::Surface(point) => spawn_ray_to(from, point),
        Target::Point(place) => spawn_ray_to_point(from, *place),
        Target::Far => spawn_ray(from, light.wi),
    }
}

/// What fills space behind a hit, for a ray that leaves it along `direction`.
#[inline]
pub(super) fn beyond(at: &Interaction<'_>, direction: Vec3, medium: u32) -> u32 {
    match &at.part.media {
        None => medium,
        Some(media) => {
            let outside = at.point.normal.dot(direction) > 0.0;
            if outside { media.outside } else { media.inside }.map_or(NO_MEDIUM, |medium| medium.0)
        }
    }
}
