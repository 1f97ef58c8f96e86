//! Paths from the lights: emission, scattering, and passage through media. Also utilities that several integrators share:
//! first-hit rays, shadow rays, and checks for unsupported effects.

use dapple_core::{Block, Draws, Frame, HostNumbers, SampleId, integrator::Pass, parallel, point_set::streams};
use dapple_geometry::spawn_ray;
use dapple_renderer::light::{EmittedLight, LightSample, SelectedLight, Target};
use dapple_renderer::shading::{Bsdf, Discrete, ShadingFrame};
use dapple_renderer::{GatherPoint, Interaction, MakeError, World};
use dapple_scene::Effect;
use glam::Vec3;
use std::ops::Range;

/// The group for the light (dimension 0) and the point on it (2 and 3).
pub(crate) const LIGHT: Block = Block::new(0);
/// The group for the emitted direction (dimensions 0 and 1).
pub(crate) const TOWARDS: Block = Block::new(1);
/// The first group for a scattering event: direction (dimensions 0 and 1), lobe (2), roulette (3).
const SCATTER: Block = Block::new(2);
/// The first group for a hit with alpha or a mixed material: opacity (dimension 0) and selection of the material (1).
const SURFACE: Block = Block::new(3);
/// The distance between the groups of successive hits.
const STRIDE: u32 = 2;
/// The largest number of hits of a path, including surfaces passed without scattering.
const MOST_HITS: u32 = 10_000;

/// Returns the random numbers of a path that is traced before sampling: a first-hit ray or a pilot photon.
pub(crate) fn pilot_draws(pixel: [u32; 2]) -> Draws<'static> {
    Draws::new(&HostNumbers, SampleId::new(pixel, streams::FIRST_HITS, 0))
}

/// Iterates over the pixels of a regular grid on an image, in row-major order.
pub(crate) fn grid(frame: &Frame, side: u32) -> impl Iterator<Item = [u32; 2]> {
    let [width, height] = frame.resolution().map(u64::from);
    let at = move |k: u32, length: u64| (u64::from(k) * length / u64::from(side)) as u32;
    (0..side * side).map(move |i| [at(i % side, width), at(i / side, height)])
}

/// Returns the first hit of a ray through a pixel, and the ray's direction.
pub(crate) fn first_hit(world: &World, pixel: [u32; 2]) -> Option<(Interaction<'_>, Vec3)> {
    let (ray, time) = world.camera_ray(&pilot_draws(pixel));
    Some((world.closest_hit(&ray, time)?, ray.direction))
}

/// Rejects a world that has one of these effects. Each effect comes with the reason for the error message.
pub(crate) fn refuse(world: &World, lacking: &[(Effect, &str)]) -> Result<(), MakeError> {
    match lacking.iter().find(|(effect, _)| world.effects().has(*effect)) {
        Some((_, reason)) => Err(MakeError::Scene(format!("the scene has {reason}"))),
        None => Ok(()),
    }
}

/// Returns the BSDF value at a vertex for light from the unit direction `wi`, and the cosine of `wi` with the shading normal.
/// Returns `None` if light would leak through the surface.
#[inline]
pub(crate) fn scattered_from(vertex: &GatherPoint<'_>, wi: Vec3) -> Option<(Vec3, f32)> {
    let (local, normal) = (vertex.frame.to_local(wi), vertex.at.point().normal);
    let leaks = leaks([local.z, vertex.wo.z], [normal.dot(wi), normal.dot(vertex.back)]);
    (!leaks).then(|| (vertex.bsdf.evaluate(vertex.wo, local), local.z))
}

/// Returns the transmittance from a target in the unit direction `wi` to a surface point, and the number of rays traced.
pub(crate) fn visible(world: &World, at: &Interaction<'_>, wi: Vec3, target: Target) -> (Vec3, u32) {
    let ray = LightSample { wi, radiance: Vec3::ONE, pdf: 1.0, target, delta: true }.shadow_ray(at.point());
    let medium = world.medium_beyond(at, wi, world.camera_medium());
    world.transmittance(ray, &target, at.time(), medium)
}

/// The smallest and the largest default number of paths per pass and half. A small image needs a minimum of paths; a large
/// image must not fill the memory.
const EMITTED: [u32; 2] = [1000, 1 << 22];

/// Returns the number of paths to emit per pass and half of the samples. If `requested` is 0, this is one path per pixel,
/// clamped to [`EMITTED`].
pub(crate) fn emitted(requested: u32, frame: &Frame) -> u32 {
    let pixels = u32::try_from(frame.pixels()).unwrap_or(u32::MAX);
    if requested == 0 { pixels.clamp(EMITTED[0], EMITTED[1]) } else { requested }
}

/// Returns the random numbers of each path for one half of the samples. Each half has `count` paths.
pub(crate) fn draws_of_half<'p>(pass: &'p Pass<'_>, half: usize, count: u32) -> impl Fn(u32) -> Draws<'p> + Sync {
    move |number| pass.draws(half as u64 * u64::from(count) + u64::from(number))
}

/// Returns true for a non-specular surface, as the crate's front page defines it. Narrower lobes would make single photons or
/// virtual lights visible, and are left to path tracing.
pub(crate) fn is_non_specular(bsdf: &Bsdf<'_>) -> bool {
    /// The smallest microfacet width of the widest lobe of a non-specular surface.
    const LEAST_WIDTH: f32 = 0.3;
    bsdf.roughness() >= LEAST_WIDTH
}

/// Returns the factor that converts flux measured at the geometric surface to the surface of the shading normal. The arguments
/// are the cosines of the light's direction with both normals.
pub(crate) fn turned(shading: f32, geometric: f32) -> f32 {
    if shading == geometric { 1.0 } else { (shading / geometric).abs() }
}

/// The largest [`turned`] factor of a particle in density estimates. Without it, a particle that grazes the surface would
/// dominate all others. The limit darkens light from less than 6 degrees above a surface with interpolated normals.
pub(crate) const MOST_TURNED: f32 = 10.0;

/// A set of lights that emit paths, and the selection of their rays. The rays of each light are divided into a grid of cells.
#[derive(Clone, Debug)]
pub(crate) struct Sources {
    lights: Vec<SourceLight>,
    /// The number of cells along each side of a light's grid.
    side: u32,
    /// The distribution over the cells of all lights; `None` without lights.
    choice: Option<Discrete>,
}

/// A light that emits paths.
#[derive(Clone, Copy, Debug)]
struct SourceLight {
    index: u32,
    power: f32,
    /// True if the grid divides the start points of rays, as for light from infinity; false if it divides their directions.
    by_place: bool,
}

/// The number of paths traced by one task.
const CHUNK: usize = 1024;
/// The total number of pilot paths.
const PILOTS: u32 = 1 << 17;
/// The smallest number of pilot paths per cell.
const PILOTS_IN_CELL: u32 = 8;
/// The largest number of cells along a side.
const MOST_SIDE: u32 = 64;
/// The fraction of paths selected by power alone, so that no light is missed for long.
const BLIND: f64 = 0.2;

impl Sources {
    /// Makes the set of all lights for which `includes` returns true. They are selected in proportion to power.
    pub(crate) fn new(world: &World, includes: impl Fn(u32) -> bool) -> Self {
        let all = world.lights();
        let light = |index: u32| {
            let power = (all.power(index) as f32).min(f32::MAX);
            SourceLight { index, power, by_place: all.light_sphere(index).is_none() }
        };
        let lights: Vec<SourceLight> = (0..all.len() as u32).filter(|light| includes(*light)).map(light).collect();
        let choice = select(lights.iter().map(|light| light.power));
        Self { lights, side: 1, choice }
    }

    /// Learns from pilot paths which cells emit useful light. `carried` traces the path of an emitted ray, and returns the
    /// path's useful light and number of rays. Returns the total number of rays.
    ///
    /// Afterwards, cells are selected by the useful light of the pilots in the cell and its neighbours, and with probability
    /// [`BLIND`] by power. The flux of paths is divided by these probabilities, so that no mean changes.
    pub(crate) fn guide(
        &mut self,
        world: &World,
        carried: impl Fn(&EmittedLight, &Draws<'_>) -> (f32, u64) + Sync,
    ) -> u64 {
        let count = self.lights.len() as u32;
        if count == 0 || count > PILOTS {
            return 0;
        }
        let side = (f64::from(PILOTS / PILOTS_IN_CELL / count)).sqrt().clamp(1.0, f64::from(MOST_SIDE)) as u32;
        let cells = side * side;
        let each = (PILOTS / (count * cells)).clamp(1, PILOTS_IN_CELL);
        let found: Vec<(f32, u64)> = parallel::map((count * cells) as usize, |number| {
            let number = number as u32;
            let (light, cell) = (&self.lights[(number / cells) as usize], number % cells);
            (0..each).fold((0.0, 0), |(sum, rays), pilot| {
                let draws = pilot_draws([number, pilot]);
                let Some(emitted) = emit(world, light, &draws, (side, cell), 1.0) else { return (sum, rays) };
                let (carried, traced) = carried(&emitted, &draws);
                (sum + carried.min(f32::MAX / 64.0), rays + traced)
            })
        });
        let rays = found.iter().map(|(_, rays)| rays).sum();
        let found = &found[..];
        let near = |number: u32| -> f64 {
            let (light, cell) = (number / cells * cells, number % cells);
            let [x, y] = [cell % side, cell / side];
            let around = |k: u32| k.saturating_sub(1)..=(k + 1).min(side - 1);
            around(y).flat_map(|y| around(x).map(move |x| f64::from(found[(light + y * side + x) as usize].0))).sum()
        };
        let guided: Vec<f64> = (0..count * cells).map(near).collect();
        let total: f64 = guided.iter().sum();
        let power: f64 = self.lights.iter().map(|light| f64::from(light.power)).sum();
        if !(total > 0.0 && total.is_finite()) {
            return rays;
        }
        let weight = |number: u32| {
            let blind = f64::from(self.lights[(number / cells) as usize].power) / power / f64::from(cells);
            (BLIND * blind + (1.0 - BLIND) * guided[number as usize] / total) as f32
        };
        self.choice = select((0..count * cells).map(weight));
        self.side = side;
        rays
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.choice.is_none()
    }

    /// Samples a ray that leaves one of the lights.
    pub(crate) fn emit(&self, world: &World, draws: &Draws<'_>) -> Option<EmittedLight> {
        let cells = (self.side * self.side) as usize;
        let chosen = self.choice.as_ref()?.sample(draws.block(LIGHT)[0])?;
        let (light, cell) = (&self.lights[chosen.index / cells], (chosen.index % cells) as u32);
        emit(world, light, draws, (self.side, cell), chosen.pmf)
    }
}

impl Sources {
    /// Traces the paths with these numbers, in parallel. Calls `arrive` at each surface, with a list to which the path's
    /// results are added. Returns the results in the order of the paths, and the number of rays.
    pub(crate) fn trace<'w, 'd, T: Send>(
        &self,
        world: &'w World,
        paths: Range<u32>,
        draws: impl Fn(u32) -> Draws<'d> + Sync,
        arrive: impl Fn(&Arrival<'_, 'w>, &mut Vec<T>) -> Onwards + Sync,
    ) -> (Vec<T>, u64) {
        let trace_some = |chunk: usize| {
            let (mut found, mut rays) = (Vec::new(), 0);
            for number in paths.clone().skip(chunk * CHUNK).take(CHUNK) {
                let draws = draws(number);
                let Some(emitted) = self.emit(world, &draws) else { continue };
                rays += walk(world, &emitted, &draws, |arrival| arrive(arrival, &mut found));
            }
            found.shrink_to_fit();
            (found, rays)
        };
        let chunks: Vec<(Vec<T>, u64)> = parallel::map(paths.len().div_ceil(CHUNK), trace_some);
        let mut all = Vec::with_capacity(chunks.iter().map(|(found, _)| found.len()).sum());
        let rays = chunks.iter().map(|(_, rays)| rays).sum();
        chunks.into_iter().for_each(|(found, _)| all.extend(found));
        (all, rays)
    }
}

/// Returns the distribution with these weights; `None` if all are 0.
fn select(weights: impl Iterator<Item = f32>) -> Option<Discrete> {
    Discrete::new(&weights.collect::<Vec<_>>()).ok().filter(|choice| !choice.is_empty())
}

/// Samples a ray of one cell. `pmf` is the probability with which the cell was selected.
fn emit(
    world: &World,
    light: &SourceLight,
    draws: &Draws<'_>,
    (side, cell): (u32, u32),
    pmf: f32,
) -> Option<EmittedLight> {
    let ([_, _, place @ ..], [u, v, ..]) = (draws.block(LIGHT), draws.block(TOWARDS));
    let within = |[u, v]: [f32; 2]| {
        let at = |k: u32, u: f32| ((k as f32 + u) / side as f32).min(BELOW_ONE);
        [at(cell % side, u), at(cell / side, v)]
    };
    let (place, towards) = if light.by_place { (within(place), [u, v]) } else { (place, within([u, v])) };
    // A cell is 1 of `side^2` equal parts of the unit square.
    let selected = SelectedLight { index: light.index, pmf: pmf * (side * side) as f32 };
    world.lights().sample_emission_of(selected, place, towards)
}

/// The largest `f32` below 1.
pub(crate) const BELOW_ONE: f32 = 1.0 - f32::EPSILON / 2.0;

/// Light of a path that arrives at a surface.
pub(crate) struct Arrival<'a, 'w> {
    pub(crate) at: &'a Interaction<'w>,
    pub(crate) bsdf: &'a Bsdf<'w>,
    pub(crate) frame: &'a ShadingFrame,
    /// The unit direction from which the light came, in the renderer's space.
    pub(crate) from: Vec3,
    /// The flux that arrives.
    pub(crate) flux: Vec3,
    /// The number of scattering events before the arrival.
    pub(crate) bounces: u32,
    /// True if only mirrors, clear glass and smooth coats have scattered the light.
    pub(crate) is_specular: bool,
}

/// The continuation of a path after an arrival. At mirrors and clear glass, the path always continues specularly.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Onwards {
    /// The path continues in any direction that the surface scatters to.
    Scatter,
    /// The path continues only by a specular lobe, such as that of a smooth coat.
    Specular,
    /// The path ends.
    Stop,
}

/// Traces a path from a ray that leaves a light. Calls `arrive` at each surface. Returns the number of rays.
pub(crate) fn walk<'w>(
    world: &'w World,
    emitted: &EmittedLight,
    draws: &Draws<'_>,
    mut arrive: impl FnMut(&Arrival<'_, 'w>) -> Onwards,
) -> u64 {
    let (mut ray, mut flux) = (emitted.ray(), emitted.flux());
    let (mut bounces, mut is_specular, mut medium) = (0, true, world.camera_medium());
    for hit in 0..MOST_HITS {
        let rays = u64::from(hit) + 1;
        let Some(at) = world.closest_hit(&ray, 0.0) else { return rays };
        if hit == 0 {
            // The light may lie in another medium than the camera: the medium in front of the first border that the path hits.
            medium = world.medium_beyond(&at, -ray.direction, medium);
        }
        flux *= world.medium_transmittance(medium, at.distance());
        let Some((bsdf, frame)) = world.scattering(&at, || {
            let [alpha, mix, ..] = draws.block(SURFACE.at(hit, STRIDE));
            [alpha, mix]
        }) else {
            medium = world.medium_beyond(&at, ray.direction, medium);
            ray = spawn_ray(at.point(), ray.direction);
            continue;
        };
        let from = -ray.direction;
        let arrived = arrive(&Arrival { at: &at, bsdf: &bsdf, frame: &frame, from, flux, bounces, is_specular });
        let onwards = if bsdf.is_specular() { Onwards::Specular } else { arrived };
        if onwards == Onwards::Stop || bounces + 1 >= world.max_depth() {
            return rays;
        }
        let [u, v, lobe, roulette] = draws.block(SCATTER.at(hit, STRIDE));
        let wo = frame.to_local(from);
        let Some(sample) = bsdf.sample(wo, [u, v], lobe) else { return rays };
        if onwards == Onwards::Specular && !sample.specular {
            return rays;
        }
        let wi = frame.to_world(sample.wi);
        let [shading, geometric] = [frame.normal, at.point().normal].map(|normal| [from, wi].map(|w| w.dot(normal)));
        let adjoint = adjoint(shading, geometric);
        // Flux, unlike radiance, does not change with the density of the medium.
        let next = flux * sample.weight * (sample.eta * sample.eta * adjoint);
        // Photons of equal flux [Jensen 1996].
        let survival = (next.max_element() / flux.max_element()).min(1.0);
        if leaks([wo.z, sample.wi.z], geometric) || !adjoint.is_finite() || survival.is_nan() || roulette >= survival {
            return rays;
        }
        flux = next / survival;
        is_specular &= sample.specular;
        bounces += 1;
        medium = world.medium_beyond(&at, wi, medium);
        ray = spawn_ray(at.point(), wi);
    }
    u64::from(MOST_HITS)
}

/// Returns the ratio between the scattering of light and of importance under shading normals [Veach 1997, sec. 5.3.2]. The
/// arguments are the cosines of the arriving and the leaving direction, with the shading normal and with the geometric one. The
/// result is not finite for directions along the surface.
pub(crate) fn adjoint(shading: [f32; 2], geometric: [f32; 2]) -> f32 {
    if shading == geometric {
        return 1.0;
    }
    ((shading[0] * geometric[1]) / (geometric[0] * shading[1])).abs()
}

/// Returns true if light is transmitted according to the geometric normal but reflected according to the shading normal, or the
/// reverse. The arguments are the cosines of both directions with each normal.
pub(crate) fn leaks(shading: [f32; 2], geometric: [f32; 2]) -> bool {
    (geometric[0] * geometric[1] > 0.0) != (shading[0] * shading[1] > 0.0)
}
