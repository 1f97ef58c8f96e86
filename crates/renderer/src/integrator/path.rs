//! Path tracing with next-event estimation, multiple importance sampling and Russian roulette
//! [Kajiya 1986; Veach 1997, ch. 9 and 10].

#![allow(clippy::neg_cmp_op_on_partial_ord, reason = "a survival probability that is NaN ends the path")]

mod features;
mod transmission;
mod vertex_light;

pub use vertex_light::{GatherPoint, NoVertexLight, VertexLight};

use super::code::{self, ROULETTE_FROM};
use super::light_selector::LightSelector;
use crate::World;
use crate::blocks;
use crate::camera::Lens;
use crate::light::LightSample;
use crate::material::Surface;
use crate::shading::{Bsdf, ShadingFrame, power_heuristic, power_heuristic_over_pdf};
use crate::world::{Interaction, NO_LIGHT, NO_MEDIUM};
use dapple_core::integrator::{CERTAIN_LOBE, Pass, PreparationCost, Prepares, RARE_LOBE, TrainingData};
use dapple_core::{Draws, Estimate, Frame, Integrator, Worker};
use dapple_geometry::{Ray, spawn_ray};
use glam::Vec3;
use std::marker::PhantomData;
use transmission::MediumEnd;

/// The largest survival probability of Russian roulette. It is below 1, so that every path ends.
///
/// The variance of an endless path is finite only while albedo^2 < SURVIVAL. A value of 0.95 would make it infinite in
/// closed rooms of albedo 0.98.
const SURVIVAL: f32 = 0.99;

/// A path tracer with camera kind `L`, light selector `S` and additional light source `G`. It has code for the effects in `E`,
/// a combination of the bits of [`code`](super::code).
#[derive(Debug)]
pub struct PathTracer<'w, L, S, const E: u32, G = NoVertexLight> {
    world: &'w World,
    pub(super) selector: S,
    vertex_light: G,
    lens: PhantomData<fn() -> L>,
}

/// The state of a path while it is traced.
struct Path<P, G> {
    ray: Ray,
    throughput: Vec3,
    radiance: Vec3,
    /// The last scattering event, if light sampling there could also have found a light that the next ray hits; else `None`.
    last: Option<LastScatter<P>>,
    /// The number of scattering events so far.
    depth: u32,
    /// The number of rays traced so far, including shadow rays.
    rays: u32,
    /// The product of the squared relative indices of refraction crossed.
    ///
    /// Roulette multiplies the throughput by this product, since the radiance scaling on entering glass is undone on
    /// leaving it.
    eta_squared: f32,
    /// The number of path segments so far, without shadow rays. Passing a surface starts a new segment.
    segments: u32,
    /// The index of the medium around the ray's origin, or `NO_MEDIUM`.
    medium: u32,
    /// The time of the sample within the motion, in `[0, 1]`.
    time: f32,
    /// The product of the survival probabilities of Russian roulette so far.
    survival: f32,
    /// True if glass reflected or refracted the path in a lobe of less than [`RARE_LOBE`] of the light.
    is_rare: bool,
    /// True while the emission of directly visible lights is requested, and all scattering so far was specular with a
    /// probability of at least [`CERTAIN_LOBE`].
    is_direct: bool,
    /// The stage of the path, which separates direct from indirect lighting.
    part: Part,
    /// The radiance from direct lighting, set when the path starts to gather indirect lighting.
    direct: Vec3,
    /// The state of the additional light at vertices.
    gathered: G,
}

/// A path's stage, by its non-specular scattering events. It separates direct from indirect lighting.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Part {
    /// Only mirrors, glass and smooth coats have scattered the path so far.
    First,
    /// One non-specular surface or point in a medium has scattered the path. Lights that the next ray hits still count as
    /// direct lighting.
    Once,
    /// The path has reached a second non-specular surface or point in a medium, whose lighting is indirect. Also the stage of
    /// all paths if neither features nor indirect lighting are requested.
    Indirect,
}

/// A scattering event at which a light was sampled as well.
#[derive(Clone, Copy)]
struct LastScatter<P> {
    position: Vec3,
    /// The key of the light distribution that was sampled.
    place: P,
    /// The solid-angle density with which the BSDF or phase function sampled the next direction.
    pdf: f32,
}

/// A surface point at which a path scatters.
///
/// Hit, BSDF and frame are borrowed: only structs behind pointers live in memory, so the other fields stay in registers.
struct Vertex<'a> {
    at: &'a Interaction<'a>,
    bsdf: &'a Bsdf<'a>,
    frame: &'a ShadingFrame,
    /// The unit direction towards the previous vertex, in the shading frame.
    wo: Vec3,
    /// The cosine between the direction to the previous vertex and the geometric normal.
    outside: f32,
}

impl<P, G> Path<P, G> {
    /// Returns true while features are requested and all scattering so far was by mirrors, glass and smooth coats.
    #[inline(always)]
    fn is_smooth(&self, draws: &Draws<'_>) -> bool {
        self.part == Part::First && draws.wants_features()
    }

    /// Marks the radiance so far as direct lighting if one vertex has scattered the path. Called before the next vertex adds
    /// scattered light.
    #[inline(always)]
    fn begins_indirect(&mut self) {
        if self.part == Part::Once {
            (self.part, self.direct) = (Part::Indirect, self.radiance);
        }
    }
}

impl Vertex<'_> {
    /// Returns true if the world-space direction `wi` is on the same side of the geometric surface as `wo`.
    #[inline(always)]
    fn is_same_side(&self, wi: Vec3) -> bool {
        self.at.point.normal.dot(wi) * self.outside > 0.0
    }
}

impl<'w, L: Lens, S: LightSelector, const E: u32, G: VertexLight> PathTracer<'w, L, S, E, G> {
    const HAS_SEVERAL_LIGHTS: bool = E & code::SEVERAL_LIGHTS != 0;
    const HAS_ENVIRONMENT: bool = E & code::ENVIRONMENT != 0;
    const HAS_ROULETTE: bool = E & code::ROULETTE != 0;
    const HAS_TRANSMISSION: bool = E & code::TRANSMISSION != 0;
    const HAS_RARE_EFFECTS: bool = E & code::RARE != 0;
    const HAS_VARIED_SURFACES: bool = E & code::VARIED != 0;

    pub(super) fn new(world: &'w World, vertex_light: G) -> Self {
        Self { world, selector: S::of(world), vertex_light, lens: PhantomData }
    }

    /// Starts a path at the camera.
    #[inline(always)]
    fn begin(&self, draws: &Draws<'_>) -> Path<S::Place, G::State> {
        let world = self.world;
        let u = draws.block(blocks::CAMERA);
        let offset = world.filter.sample([u[0], u[1]]);
        let moves = Self::HAS_RARE_EFFECTS && world.moves;
        let time = if moves { world.time(draws.block(blocks::TIME)[0]) } else { 0.0 };
        let view = &world.camera;
        Path {
            ray: L::ray_at(view, view.place(draws.pixel(), offset), [u[2], u[3]], time),
            throughput: Vec3::ONE,
            radiance: Vec3::ZERO,
            last: None,
            depth: 0,
            rays: 0,
            eta_squared: 1.0,
            segments: 0,
            medium: if Self::HAS_RARE_EFFECTS { world.camera_medium } else { NO_MEDIUM },
            time,
            survival: 1.0,
            is_rare: false,
            is_direct: draws.wants_emission(),
            part: if draws.wants_features() || draws.wants_indirect() { Part::First } else { Part::Indirect },
            direct: Vec3::ZERO,
            gathered: G::State::default(),
        }
    }

    /// Returns the closest hit of a ray at a time.
    #[inline(always)]
    fn closest_hit(&self, ray: &Ray, time: f32) -> Option<Interaction<'w>> {
        match (Self::HAS_RARE_EFFECTS, Self::HAS_VARIED_SURFACES) {
            (false, false) => self.world.closest_hit_plain(ray),
            (false, true) => self.world.closest_hit(ray, 0.0),
            (true, _) => self.world.closest_hit(ray, time),
        }
    }

    /// Returns the radiance of all environments along the path's ray, with the multiple-importance weight of BSDF
    /// sampling.
    #[inline(always)]
    fn environment(&self, path: &Path<S::Place, G::State>) -> Vec3 {
        let (lights, direction) = (&self.world.lights, path.ray.direction);
        if G::ACTIVE && self.vertex_light.replaces(&path.gathered, NO_LIGHT, path.last.is_none()) {
            return Vec3::ZERO;
        }
        match path.last {
            Some(LastScatter { place, pdf, .. }) => {
                lights.environment_weighted(direction, pdf, |light| self.selector.pmf(lights, place, light))
            }
            None => lights.environment(direction),
        }
    }

    /// Returns the radiance that an area light emits from its hit point back along the path's ray, with the
    /// multiple-importance weight of BSDF sampling.
    #[inline(always)]
    fn emitted(&self, path: &Path<S::Place, G::State>, at: &Interaction<'_>) -> Vec3 {
        let (lights, light) = (&self.world.lights, at.part.light);
        let radiance = lights.emitted(light, &at.point, -at.point.normal.dot(path.ray.direction));
        if G::ACTIVE && self.vertex_light.replaces(&path.gathered, light, path.last.is_none()) {
            return Vec3::ZERO;
        }
        match path.last {
            Some(LastScatter { position, place, pdf }) if radiance != Vec3::ZERO => {
                let light_pdf =
                    lights.direction_pdf(light, position, &at.point) * self.selector.pmf(lights, place, light);
                radiance * power_heuristic(pdf, light_pdf)
            }
            _ => radiance,
        }
    }

    /// Returns the radiance of an unlit surface along the path's ray.
    #[inline(never)]
    fn shown(&self, path: &Path<S::Place, G::State>, at: &Interaction<'_>, surface: &Surface) -> Vec3 {
        path.throughput * self.world.bsdf_of(at, surface).albedo()
    }

    /// Performs one scattering event: adds direct light and samples the next ray. Returns false if the path ends here.
    #[inline(always)]
    fn scatter(
        &self,
        draws: &Draws<'_>,
        training: &mut Worker,
        path: &mut Path<S::Place, G::State>,
        at: &Interaction<'w>,
        surface: &Surface,
    ) -> bool {
        let (world, varied) = (self.world, Self::HAS_VARIED_SURFACES);
        if surface.black {
            return false;
        }
        let bsdf = if varied { world.bsdf_of(at, surface) } else { surface.plain() };
        if G::ACTIVE && self.vertex_light.ends(&path.gathered, bsdf.is_specular()) {
            return false;
        }
        let frame = if varied { world.frame_of(at, surface) } else { ShadingFrame::from_normal(at.point.normal) };
        let wo = bsdf.local(&frame, -path.ray.direction);
        let vertex = Vertex { at, bsdf: &bsdf, frame: &frame, wo, outside: -at.point.normal.dot(path.ray.direction) };
        let roulette = Self::HAS_ROULETTE && path.depth >= ROULETTE_FROM;
        let several_lights = Self::HAS_SEVERAL_LIGHTS && world.lights.len() > 1;
        let chooses = several_lights || varied && surface.several_lobes || roulette;
        let scatter = blocks::scatter(path.depth);
        let [u, choices] = match chooses {
            true => draws.two_blocks([scatter, blocks::choose(path.depth)]),
            false => [draws.block(scatter), [0.0; 4]],
        };
        let mut place = S::NOWHERE;
        let (mut samples_lights, mut share) = (true, 1.0);
        let point = GatherPoint { at, bsdf: &bsdf, frame: &frame, wo, back: -path.ray.direction, depth: path.depth };
        if G::ACTIVE {
            share = self.vertex_light.share(&path.gathered, &point);
            samples_lights = share > 0.0 && self.vertex_light.samples_lights(&path.gathered, &point);
        }
        if !bsdf.is_specular() {
            path.begins_indirect();
        }
        if !bsdf.is_specular() && !world.lights.is_empty() && samples_lights {
            place = self.selector.place(at.point.position, at.point.normal * vertex.outside);
            let direct = self.direct(training, path, &vertex, place, [choices[0], u[0], u[1]]);
            path.radiance += path.throughput * if G::ACTIVE { direct * share } else { direct };
        }
        if G::ACTIVE && !bsdf.is_specular() && share > 0.0 {
            let (light, rays) = self.vertex_light.gather(&mut path.gathered, &point, draws, training);
            path.radiance += path.throughput * (light * share);
            path.rays += rays;
        }
        let Some(sample) = bsdf.sample(wo, [u[2], u[3]], choices[1]) else { return false };
        let wi = frame.to_world(sample.wi);
        let reflected = !Self::HAS_TRANSMISSION || sample.wi.z * wo.z > 0.0;
        if vertex.is_same_side(wi) != reflected {
            return false;
        }
        path.throughput *= sample.weight;
        if path.part == Part::First {
            if !(sample.specular || varied && bsdf.samples_narrow_lobe(wo, choices[1])) {
                path.part = Part::Once;
            }
            path.is_rare |= Self::HAS_TRANSMISSION && sample.specular && sample.pdf < RARE_LOBE && bsdf.transmits();
        }
        path.is_direct &= sample.specular && sample.pdf >= CERTAIN_LOBE;
        if G::ACTIVE {
            self.vertex_light.scattered(&mut path.gathered, sample.specular);
            if !sample.specular {
                path.throughput *= share;
            }
        }
        if Self::HAS_TRANSMISSION {
            path.eta_squared *= sample.eta * sample.eta;
        }
        if roulette && !self.survives(path, choices[2]) {
            return false;
        }
        let position = at.point.position;
        path.last = (!sample.specular).then_some(LastScatter { position, place, pdf: sample.pdf });
        path.ray = spawn_ray(&at.point, wi);
        if Self::HAS_RARE_EFFECTS {
            path.medium = at.medium_beyond(wi, path.medium);
        }
        path.throughput.max_element() > 0.0
    }

    /// Returns the radiance that a vertex scatters back along the path from one sampled light (next-event estimation).
    ///
    /// `u[0]` selects the light; `u[1]` and `u[2]` select a direction to it.
    #[inline(always)]
    fn direct(
        &self,
        training: &mut Worker,
        path: &mut Path<S::Place, G::State>,
        vertex: &Vertex<'_>,
        place: S::Place,
        u: [f32; 3],
    ) -> Vec3 {
        let lights = &self.world.lights;
        let Some(selected) = self.selector.select(lights, place, u[0]) else { return Vec3::ZERO };
        let scattered = match lights.sample_selected(selected, vertex.at.point.position, [u[1], u[2]]) {
            Some(light) => self.scattered(path, vertex, &light),
            None => Vec3::ZERO,
        };
        self.selector.record(training, place, selected, scattered * selected.pmf);
        scattered
    }

    /// Returns the radiance that a vertex scatters back along the path from a light sample, with the multiple-importance
    /// weight of light sampling.
    #[inline(always)]
    fn scattered(&self, path: &mut Path<S::Place, G::State>, vertex: &Vertex<'_>, light: &LightSample) -> Vec3 {
        let Vertex { at, bsdf, wo, .. } = vertex;
        // Light may not pass through the geometric surface, even if the shading normal would allow it.
        let same_side = vertex.is_same_side(light.wi);
        if !Self::HAS_TRANSMISSION && !same_side {
            return Vec3::ZERO;
        }
        let wi = bsdf.local(vertex.frame, light.wi);
        if Self::HAS_TRANSMISSION && same_side != (wo.z * wi.z > 0.0) {
            return Vec3::ZERO;
        }
        let (f, pdf) = bsdf.evaluate_and_pdf(*wo, wi);
        if f == Vec3::ZERO {
            return Vec3::ZERO;
        }
        let ray = light.shadow_ray(&at.point);
        let medium = if Self::HAS_RARE_EFFECTS { at.medium_beyond(light.wi, path.medium) } else { NO_MEDIUM };
        let Some(share) = self.transmittance(ray, &light.target, path, medium) else { return Vec3::ZERO };
        let weight = if light.delta { light.pdf.recip() } else { power_heuristic_over_pdf(light.pdf, pdf) };
        share * f * light.radiance * (wi.z.abs() * weight)
    }

    /// Plays Russian roulette with a random number `u` in `[0, 1)`. Returns false if the path ends; otherwise divides
    /// the throughput by the survival probability.
    #[inline(always)]
    fn survives(&self, path: &mut Path<S::Place, G::State>, u: f32) -> bool {
        let eta_squared = if Self::HAS_TRANSMISSION { path.eta_squared } else { 1.0 };
        let survival = (path.throughput.max_element() * eta_squared).min(SURVIVAL);
        if !(u < survival) {
            return false;
        }
        path.throughput /= survival;
        path.survival *= survival;
        true
    }
}

impl<L: Lens, S: LightSelector, const E: u32, G: VertexLight> Integrator for PathTracer<'_, L, S, E, G> {
    fn estimate(&self, draws: &Draws<'_>, training: &mut Worker) -> Estimate {
        let mut path = self.begin(draws);
        // The estimate is filled in place, since moving its first hit would cost many instructions.
        let mut estimate = Estimate::new([0.0; 3]).with_cost(0);
        loop {
            path.rays += 1;
            // A copy, so that the path itself is never behind a pointer and stays in registers.
            let ray = path.ray;
            let hit = self.closest_hit(&ray, path.time);
            if Self::HAS_RARE_EFFECTS {
                path.segments += 1;
                if path.medium != NO_MEDIUM {
                    let distance = hit.as_ref().map_or(f32::INFINITY, |at| at.hit.t);
                    match self.cross_medium(draws, &mut path, distance) {
                        MediumEnd::Crossed => path.is_direct = false,
                        MediumEnd::Scattered => {
                            path.is_direct = false;
                            continue;
                        }
                        MediumEnd::Absorbed => break,
                    }
                }
            }
            let Some(at) = hit else {
                if Self::HAS_RARE_EFFECTS && path.depth == 0 && draws.wants_trajectory() {
                    estimate.trajectory = self.world.background_trajectory(&ray, path.time);
                }
                if Self::HAS_VARIED_SURFACES && path.is_smooth(draws) && path.depth > 0 {
                    estimate.features = features::of_background(&estimate, Self::tint(&path), path.is_rare);
                }
                if Self::HAS_ENVIRONMENT {
                    let light = path.throughput * self.environment(&path);
                    path.radiance += light;
                    if path.is_direct {
                        estimate.emission = light.to_array();
                    }
                }
                break;
            };
            let Some(surface) = self.surface_at(draws, &mut path, &at) else {
                if path.throughput == Vec3::ZERO {
                    break;
                }
                continue;
            };
            if at.part.light != NO_LIGHT {
                let light = path.throughput * self.emitted(&path, &at);
                path.radiance += light;
                if path.is_direct {
                    estimate.emission = (Vec3::from(estimate.emission) + light).to_array();
                }
            }
            if Self::HAS_RARE_EFFECTS && surface.unlit {
                let light = self.shown(&path, &at, surface);
                path.radiance += light;
                if path.is_direct {
                    estimate.emission = light.to_array();
                }
            }
            if path.depth == 0 && draws.wants_first_hit() {
                estimate.first_hit = Some(self.world.first_hit_of(ray, at, surface));
                if draws.wants_trajectory() {
                    estimate.trajectory = self.world.trajectory(&at);
                }
            } else if Self::HAS_VARIED_SURFACES && path.is_smooth(draws) {
                let (tint, length) = (Self::tint(&path), features::length(&estimate));
                let features = self.world.features_of(ray, at, surface, tint, length);
                estimate.features = Some(features.with_rare(path.is_rare));
            }
            if path.depth >= self.world.max_depth || !self.scatter(draws, training, &mut path, &at, surface) {
                break;
            }
            path.depth += 1;
        }
        estimate.radiance = path.radiance.to_array();
        if path.part == Part::Indirect && draws.wants_indirect() {
            estimate.indirect = (path.radiance - path.direct).to_array();
        }
        estimate.cost = path.rays;
        estimate
    }

    fn features_alone(&self, draws: &Draws<'_>) -> Option<Estimate> {
        Some(self.world.features_alone(draws, self.world.max_depth))
    }

    fn wants_training(&self) -> bool {
        self.selector.wants_training()
    }

    fn training_memory(&self, pixels: u64) -> u64 {
        self.selector.training_memory(pixels, u64::from(self.world.max_depth()) + 1)
    }

    fn learn(&mut self, pass: &TrainingData) {
        self.selector.learn(pass);
    }

    fn prepares(&self) -> Prepares {
        self.vertex_light.prepares()
    }

    fn prepare(&mut self, pass: &Pass<'_>) -> PreparationCost {
        self.vertex_light.prepare(pass)
    }

    fn memory(&self, frame: &Frame) -> u64 {
        self.vertex_light.memory(frame)
    }
}
