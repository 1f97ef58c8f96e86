//! Path tracing with next-event estimation, multiple importance sampling and Russian roulette
//! [Kajiya 1986; Veach 1997, ch. 9 and 10].

#![allow(clippy::neg_cmp_op_on_partial_ord, reason = "a survival that is no number ends the path")]

use super::code::{CLEAR, DEEP, GUIDED, RARE, SEVERAL, SKY, VARIED};
use super::guide::{Guide, NO_CELL};
use super::passage::{Met, Way, beyond, shadow_ray};
use super::report::report;
use crate::World;
use crate::blocks;
use crate::camera::Lens;
use crate::light::LightSample;
use crate::material::Surface;
use crate::shading::{Bsdf, Frame, power_heuristic, power_heuristic_over_pdf};
use crate::world::{Interaction, NO_LIGHT, NO_MEDIUM};
use dapple_core::{Draws, Estimate, Integrator, TrainingData, TrainingLog};
use dapple_geometry::{Ray, spawn_ray};
use glam::Vec3;
use std::marker::PhantomData;

/// Roulette starts after this many scattering events: before, nearly every path is worth its cost.
pub(super) const ROULETTE_FROM: u32 = 4;
/// No path survives more surely than this, so that endless ones end. The variance of an endless path is
/// finite only while albedo^2 < SURVIVAL, so 0.95 would lose closed rooms of albedo 0.98.
const SURVIVAL: f32 = 0.99;

/// A path tracer for worlds with a lens `L`, with the code that the bits `E` of [`code`](super::code) name.
#[derive(Debug)]
pub struct PathTracer<'w, L, const E: u32> {
    pub(super) world: &'w World,
    /// What is learned of the choice among lights.
    pub(super) guide: Option<Guide>,
    lens: PhantomData<fn() -> L>,
}

/// Where a path stands.
pub(super) struct Path {
    pub(super) ray: Ray,
    pub(super) throughput: Vec3,
    pub(super) radiance: Vec3,
    /// The last scattering event, if light sampling could have found what the ray meets.
    pub(super) last: Option<LastScatter>,
    pub(super) rays: u32,
    /// Product of the squared indices of refraction crossed: what refraction did to the throughput is
    /// undone when the path comes out again, and no reason to end it.
    spread: f32,
    /// Rays so far that lead to where the path stands, surfaces passed included.
    pub(super) segments: u32,
    /// What fills space around the ray's origin.
    pub(super) medium: u32,
    /// When, as a share of the motion's time.
    pub(super) time: f32,
}

#[derive(Clone, Copy)]
pub(super) struct LastScatter {
    pub(super) position: Vec3,
    /// Density with which the ray's direction was drawn.
    pub(super) pdf: f32,
}

impl<'w, L: Lens, const E: u32> PathTracer<'w, L, E> {
    pub(super) fn new(world: &'w World) -> Self {
        let guide = if E & GUIDED != 0 { Guide::new(world) } else { None };
        Self { world, guide, lens: PhantomData }
    }

    /// The path at its camera.
    #[inline(always)]
    fn begin(&self, draws: &Draws<'_>) -> Path {
        let world = self.world;
        let u = draws.block(blocks::CAMERA);
        let offset = world.filter.sample([u[0], u[1]]);
        let time = if E & RARE != 0 && world.moves { world.time(draws.block(blocks::TIME)[0]) } else { 0.0 };
        let view = &world.camera;
        let ray = L::ray_at(view, view.place(draws.pixel(), offset), [u[2], u[3]], time);
        let medium = if E & RARE != 0 { world.camera_medium } else { NO_MEDIUM };
        let (throughput, radiance) = (Vec3::ONE, Vec3::ZERO);
        Path { ray, throughput, radiance, last: None, rays: 0, spread: 1.0, segments: 0, medium, time }
    }

    /// The closest hit of a ray.
    #[inline(always)]
    fn closest(&self, ray: &Ray, time: f32) -> Option<Interaction<'w>> {
        match E & (RARE | VARIED) {
            0 => self.world.closest_plain(ray),
            VARIED => self.world.closest(ray),
            _ => self.world.closest_at(ray, time),
        }
    }

    /// Light that a hit lamp gives off towards the ray's origin, weighted against light sampling.
    #[inline(always)]
    fn emitted(&self, path: &Path, at: &Interaction<'_>, cell: u32) -> Vec3 {
        let lights = &self.world.lights;
        let Some(lamp) = lights.lamp(at.part.light) else { return Vec3::ZERO };
        let radiance = lamp.radiance(-at.point.normal.dot(path.ray.direction));
        match path.last {
            Some(last) if radiance != Vec3::ZERO => {
                let found = match &self.guide {
                    Some(guide) if E & GUIDED != 0 => {
                        let pmf = guide.pmf(lights, cell, at.part.light);
                        lights.pdf_chosen(at.part.light, pmf, last.position, &at.point)
                    }
                    _ => lights.pdf(at.part.light, last.position, &at.point),
                };
                radiance * power_heuristic(last.pdf, found)
            }
            _ => radiance,
        }
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
        let Some(light) = self.world.lights.sample(at.point.position, choice, u) else {
            return Vec3::ZERO;
        };
        self.arriving(path, at, frame, bsdf, wo, outside, &light)
    }

    /// The same with a light chosen by what was learned, in the cell that the path is now in; notes down what it was
    /// worth.
    #[inline(always)]
    #[expect(clippy::too_many_arguments, reason = "as above")]
    fn direct_guided(
        &self,
        guide: &Guide,
        observed: &mut TrainingLog,
        cell: u32,
        path: &mut Path,
        at: &Interaction<'_>,
        frame: &Frame,
        bsdf: &Bsdf<'_>,
        wo: Vec3,
        outside: f32,
        choice: f32,
        u: [f32; 2],
    ) -> Vec3 {
        let (index, pmf) = guide.choose(cell, choice);
        let arrived = match self.world.lights.sample_one(index as usize, pmf, at.point.position, u) {
            Some(light) => self.arriving(path, at, frame, bsdf, wo, outside, &light),
            None => Vec3::ZERO,
        };
        guide.note(observed, cell, index, arrived * pmf);
        arrived
    }

    /// What arrives from a light, if nothing is in between, and is scattered.
    #[inline(always)]
    #[expect(clippy::too_many_arguments, reason = "as above")]
    fn arriving(
        &self,
        path: &mut Path,
        at: &Interaction<'_>,
        frame: &Frame,
        bsdf: &Bsdf<'_>,
        wo: Vec3,
        outside: f32,
        light: &LightSample,
    ) -> Vec3 {
        // No light through the geometric surface, whatever the shading normal says.
        let same_side = at.point.normal.dot(light.wi) * outside > 0.0;
        if E & CLEAR == 0 && !same_side {
            return Vec3::ZERO;
        }
        let wi = bsdf.local(frame, light.wi);
        if E & CLEAR != 0 && same_side != (wo.z * wi.z > 0.0) {
            return Vec3::ZERO;
        }
        let (f, pdf) = bsdf.evaluate_and_pdf(wo, wi);
        if f == Vec3::ZERO {
            return Vec3::ZERO;
        }
        let ray = shadow_ray(&at.point, light);
        let medium = if E & RARE != 0 { beyond(at, light.wi, path.medium) } else { NO_MEDIUM };
        let Some(share) = self.transmittance(ray, &light.target, path, medium) else { return Vec3::ZERO };
        let weight = if light.delta { light.pdf.recip() } else { power_heuristic_over_pdf(light.pdf, pdf) };
        share * f * light.radiance * (wi.z.abs() * weight)
    }

    /// The scattering event number `vertex`: gathers direct light and turns the ray. Returns whether the
    /// path goes on.
    #[inline(always)]
    #[expect(clippy::too_many_arguments, reason = "the innermost loop, kept flat")]
    fn scatter(
        &self,
        draws: &Draws<'_>,
        path: &mut Path,
        at: &Interaction<'_>,
        surface: &Surface,
        vertex: u32,
        observed: &mut TrainingLog,
        cell: &mut u32,
    ) -> bool {
        let world = self.world;
        if surface.black {
            return false;
        }
        let varied = E & VARIED != 0;
        let bsdf = if varied { world.bsdf(at, surface) } else { surface.plain() };
        let frame = if varied { world.frame(at, surface) } else { Frame::from_normal(at.point.normal) };
        let wo = bsdf.local(&frame, -path.ray.direction);
        let outside = -at.point.normal.dot(path.ray.direction);
        let roulette = E & DEEP != 0 && vertex >= ROULETTE_FROM;
        let chooses = E & SEVERAL != 0 && world.lights.len() > 1 || varied && surface.several_lobes || roulette;
        let choices = if chooses { draws.block(blocks::choose(vertex)) } else { [0.0; 4] };
        let u = draws.block(blocks::scatter(vertex));
        if !bsdf.is_specular() && !world.lights.is_empty() {
            let on_light = [u[0], u[1]];
            let direct = match &self.guide {
                Some(guide) if E & GUIDED != 0 => {
                    *cell = guide.cell(at.point.position, at.point.normal * outside);
                    self.direct_guided(
                        guide, observed, *cell, path, at, &frame, &bsdf, wo, outside, choices[0], on_light,
                    )
                }
                _ => self.direct(path, at, &frame, &bsdf, wo, outside, choices[0], on_light),
            };
            path.radiance += path.throughput * direct;
        }
        let Some(sample) = bsdf.sample(wo, [u[2], u[3]], choices[1]) else { return false };
        let wi = frame.to_world(sample.wi);
        let same_side = at.point.normal.dot(wi) * outside > 0.0;
        let reflected = E & CLEAR == 0 || sample.wi.z * wo.z > 0.0;
        if same_side != reflected {
            return false;
        }
        path.throughput *= sample.weight;
        if E & CLEAR != 0 {
            path.spread *= sample.eta * sample.eta;
        }
        if roulette && !self.survives(path, choices[2]) {
            return false;
        }
        path.last = (!sample.specular).then_some(LastScatter { position: at.point.position, pdf: sample.pdf });
        path.ray = spawn_ray(&at.point, wi);
        if E & RARE != 0 {
            path.medium = beyond(at, wi, path.medium);
        }
        path.throughput.max_element() > 0.0
    }

    /// Russian roulette.
    #[inline(always)]
    pub(super) fn survives(&self, path: &mut Path, u: f32) -> bool {
        let spread = if E & CLEAR != 0 { path.spread } else { 1.0 };
        let survival = (path.throughput.max_element() * spread).min(SURVIVAL);
        if !(u < survival) {
            return false;
        }
        path.throughput /= survival;
        true
    }
}

impl<L: Lens, const E: u32> Integrator for PathTracer<'_, L, E> {
    fn estimate(&self, draws: &Draws<'_>, observed: &mut TrainingLog) -> Estimate {
        let mut path = self.begin(draws);
        // Where the last light was chosen: what a ray then meets by chance is weighted against that choice.
        let mut cell = NO_CELL;
        // Filled in where it is returned: a first hit takes more to move than to leave out.
        let mut estimate = Estimate::new([0.0; 3]).with_cost(0);
        let mut vertex = 0;
        loop {
            path.rays += 1;
            // A copy to point at: a path that is pointed at would live in memory, not in registers.
            let ray = path.ray;
            let found = self.closest(&ray, path.time);
            if E & RARE != 0 {
                path.segments += 1;
                if path.medium != NO_MEDIUM {
                    let distance = found.as_ref().map_or(f32::INFINITY, |at| at.hit.t);
                    match self.cross(draws, &mut path, distance, vertex) {
                        Way::Passed => {}
                        Way::Scattered => {
                            cell = NO_CELL;
                            vertex += 1;
                            continue;
                        }
                        Way::Ended => break,
                    }
                }
            }
            let Some(at) = found else {
                if E & SKY != 0 {
                    let last = path.last.map(|last| last.pdf);
                    let lights = &self.world.lights;
                    path.radiance += path.throughput
                        * match &self.guide {
                            Some(guide) if E & GUIDED != 0 => {
                                let pmf = |light| guide.pmf(lights, cell, light);
                                lights.sky_chosen(path.ray.direction, last, pmf)
                            }
                            _ => lights.sky(path.ray.direction, last),
                        };
                }
                break;
            };
            let Met::Surface(surface) = self.meet(draws, &mut path, &at) else {
                if path.throughput == Vec3::ZERO {
                    break;
                }
                continue;
            };
            if at.part.light != NO_LIGHT {
                path.radiance += path.throughput * self.emitted(&path, &at, cell);
            }
            if vertex == 0 && draws.wants_first_hit() {
                estimate.first_hit = Some(report(self.world, ray, at, surface));
            }
            if vertex >= self.world.max_depth {
                break;
            }
            if !self.scatter(draws, &mut path, &at, surface, vertex, observed, &mut cell) {
                break;
            }
            vertex += 1;
        }
        estimate.radiance = path.radiance.to_array();
        estimate.cost = path.rays;
        estimate
    }

    fn wants_training(&self) -> bool {
        self.guide.as_ref().is_some_and(Guide::is_learning)
    }

    fn learn(&mut self, pass: &TrainingData) {
        if let Some(guide) = &mut self.guide {
            guide.learn(pass);
        }
    }
}
