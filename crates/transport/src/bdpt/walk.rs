//! Random walks: the vertices of camera and light paths.

use super::Bdpt;
use super::features::Seen;
use super::vertex::{From, Kind, Vertex};
use dapple_core::{Block, Draws, Estimate};
use dapple_geometry::{PrimitiveId, Ray, SurfacePoint, spawn_ray};
use dapple_renderer::light::Target;
use dapple_renderer::{Interaction, blocks};
use glam::Vec3;

/// The number of scattering events after which Russian roulette starts.
const ROULETTE_FROM: u32 = 4;
/// The largest survival probability of Russian roulette, so that every path ends.
const SURVIVAL: f32 = 0.99;

/// The number of the light path's first group. Those of the camera path are below; those of media, which are refused, and
/// of the time above ([`blocks`]).
pub(crate) const OF_LIGHT: u32 = 1 << 27;
/// The group for the start of the light path: the light (dimension 0) and the place on it (2 and 3).
const LIGHT_START: Block = Block::new(OF_LIGHT);
/// The group for the first direction of the light path (dimensions 0 and 1).
const LIGHT_DIRECTION: Block = Block::new(OF_LIGHT + 1);

/// Returns the group for the point on the lens (dimensions 0 and 1) and the scattered direction (2 and 3) at a vertex of
/// the light path. `vertex` counts its scattering events from 0.
pub(crate) const fn light_scatter(vertex: u32) -> Block {
    Block::new(OF_LIGHT + 2).at(vertex, 2)
}

/// Returns the group for the choices at a vertex of the light path: the material (dimension 0), the lobe (1) and Russian
/// roulette (2). `vertex` counts its scattering events from 0.
pub(crate) const fn light_choose(vertex: u32) -> Block {
    Block::new(OF_LIGHT + 3).at(vertex, 2)
}

/// The state of a random walk between two vertices.
struct Walk {
    ray: Ray,
    throughput: Vec3,
    /// The solid-angle density of the ray's direction.
    density: f32,
    /// The product of the squared indices of refraction crossed, by which the throughput of a camera path is scaled.
    eta_squared: f32,
    /// The throughput of which roulette counts the survivors.
    unit: f32,
    /// The product of the survival probabilities so far.
    survival: f32,
}

impl Walk {
    /// Returns the share of light that the vertices so far pass on to the camera.
    fn tint(&self) -> Vec3 {
        self.throughput * (self.eta_squared * self.survival)
    }
}

/// Returns two blocks of random numbers, the second one only if the path `goes_on`.
fn numbers(draws: &Draws<'_>, [first, second]: [Block; 2], goes_on: bool) -> [[f32; 4]; 2] {
    if goes_on { draws.two_blocks([first, second]) } else { [draws.block(first), [0.0; 4]] }
}

/// Returns a point in space, without a surface.
pub(super) fn point_in_space(position: Vec3) -> SurfacePoint {
    SurfacePoint { position, error: Vec3::ZERO, normal: Vec3::ZERO, primitive: PrimitiveId::NONE }
}

impl<'w> Bdpt<'w> {
    /// Returns the vertex of a surface that a ray hits. `mix` in `[0, 1)` selects the material of a mix.
    fn surface(&self, at: &Interaction<'w>, walk: &Walk, mix: f32) -> Vertex<'w> {
        let (bsdf, frame) = self.world.bsdf(at, mix);
        Vertex {
            kind: Kind::Surface { bsdf, frame, light: at.light() },
            point: *at.point(),
            wo: -walk.ray.direction,
            throughput: walk.throughput,
            specular: false,
            forward: 0.0,
            backward: 0.0,
            to_light: [0.0; 3],
        }
    }

    /// Traces the camera path of a sample into `path`, from the camera on. Fills in the features of the estimate, and
    /// counts rays in its cost. Returns the time of the sample, and the number of vertices whose emission is seen directly.
    pub(super) fn camera_path(
        &self,
        draws: &Draws<'_>,
        path: &mut Vec<Vertex<'w>>,
        estimate: &mut Estimate,
    ) -> (f32, usize) {
        let (world, most) = (self.world, self.depth);
        let (ray, time) = world.camera_ray(draws);
        let mut walk = Walk { ray, throughput: Vec3::ONE, density: 0.0, eta_squared: 1.0, unit: 1.0, survival: 1.0 };
        path.push(Vertex {
            kind: Kind::Camera,
            point: point_in_space(ray.origin),
            wo: Vec3::ZERO,
            throughput: Vec3::ONE,
            specular: false,
            forward: 1.0,
            backward: 0.0,
            to_light: [0.0; 3],
        });
        let mut seen = Seen::new(draws);
        for event in 0.. {
            estimate.cost += 1;
            let Some(at) = world.closest_hit(&walk.ray, time) else {
                seen.background(world, (&walk.ray, time), walk.tint(), estimate);
                if world.lights().has_environment() {
                    path.push(Vertex {
                        kind: Kind::Sky,
                        point: point_in_space(walk.ray.origin),
                        wo: walk.ray.direction,
                        throughput: walk.throughput,
                        specular: false,
                        forward: walk.density,
                        backward: 0.0,
                        to_light: [0.0; 3],
                    });
                }
                break;
            };
            let [choices, scatter] = numbers(draws, [blocks::choose(event), blocks::scatter(event)], event < most);
            seen.surface(world, (&walk.ray, &at, choices[3]), walk.tint(), estimate);
            let mut vertex = self.surface(&at, &walk, choices[3]);
            vertex.to_light = [choices[0], scatter[0], scatter[1]];
            vertex.forward = match event {
                0 => {
                    let density = world.camera().density(ray.direction, at.distance(), time);
                    density * vertex.cosine(ray.direction)
                }
                _ => vertex.density_from(path[path.len() - 1].point.position, walk.density),
            };
            path.push(vertex);
            let [.., u, v] = scatter;
            if event >= most || !self.step(From::Camera, path, &mut walk, [u, v, choices[1], choices[2]], event) {
                break;
            }
            seen.scattered(&path[path.len() - 1], walk.density, choices[1]);
        }
        (time, seen.direct)
    }

    /// Traces the light path of a sample into `path`, from the light on, and counts its rays in `rays`.
    pub(super) fn light_path(&self, draws: &Draws<'_>, time: f32, path: &mut Vec<Vertex<'w>>, rays: &mut u32) {
        let world = self.world;
        // A camera path has two vertices at least, or the camera alone if light is connected to it.
        let most = if self.splats { self.depth } else { self.depth.saturating_sub(1) };
        if most == 0 {
            return;
        }
        let [[choice, _, place @ ..], [towards @ .., _, _]] = draws.two_blocks([LIGHT_START, LIGHT_DIRECTION]);
        let lights = world.lights();
        let Some(mut emitted) = lights.sample_emission(choice, place, towards) else { return };
        let (mut start, light) = (emitted.pmf * emitted.pdf.position, emitted.light);
        let (mut point, is_delta) = (point_in_space(emitted.position), lights.is_delta(light));
        let kind = match emitted.source {
            Target::Surface(on) => {
                point = on;
                Kind::Lamp { light }
            }
            Target::Point(_) => Kind::Delta { parallel: false },
            Target::Far if is_delta => Kind::Delta { parallel: true },
            Target::Far => {
                // All environments together are one light.
                start = lights.environment_emission_pdf(-emitted.direction);
                emitted.radiance = lights.environment(-emitted.direction);
                (emitted.pmf, emitted.pdf.direction) = (1.0, start);
                Kind::Sky
            }
        };
        let flux = emitted.flux();
        if !(flux.is_finite() && flux.max_element() > 0.0) {
            return;
        }
        let far = matches!(emitted.source, Target::Far);
        path.push(Vertex {
            kind,
            point,
            wo: if far { -emitted.direction } else { Vec3::ZERO },
            throughput: Vec3::ONE,
            specular: false,
            forward: start,
            backward: 0.0,
            to_light: [0.0; 3],
        });
        let density = if far { emitted.pdf.position } else { emitted.pdf.direction };
        let unit = flux.max_element();
        let mut walk = Walk { ray: emitted.ray(), throughput: flux, density, eta_squared: 1.0, unit, survival: 1.0 };
        for event in 0.. {
            *rays += 1;
            let Some(at) = world.closest_hit(&walk.ray, time) else { break };
            // The vertex behind needs one event more to reach the camera.
            let goes_on = event + 1 < most;
            let [choices, scatter] = numbers(draws, [light_choose(event), light_scatter(event)], goes_on);
            let mut vertex = self.surface(&at, &walk, choices[0]);
            vertex.forward = match event {
                // Parallel light has the density of its disk, seen at an angle.
                0 if far => walk.density * vertex.cosine(walk.ray.direction),
                _ => vertex.density_from(path[path.len() - 1].point.position, walk.density),
            };
            path.push(vertex);
            let [.., u, v] = scatter;
            if !goes_on || !self.step(From::Light, path, &mut walk, [u, v, choices[1], choices[2]], event) {
                break;
            }
        }
    }

    /// Scatters a walk at its last vertex. Returns false if it ends there. `u` holds the numbers for the direction, the
    /// lobe and roulette.
    fn step(&self, from: From, path: &mut [Vertex<'w>], walk: &mut Walk, u: [f32; 4], event: u32) -> bool {
        let last = path.len() - 1;
        let Some(next) = path[last].scatter(from, [u[0], u[1]], u[2]) else { return false };
        let before = path[last].point.position;
        path[last].specular = next.specular;
        path[last - 1].backward = path[last - 1].density_from(before, next.backward);
        walk.throughput *= next.weight;
        if from == From::Camera {
            walk.eta_squared *= next.eta * next.eta;
        }
        if event >= ROULETTE_FROM {
            let survival = (walk.throughput.max_element() * walk.eta_squared / walk.unit).min(SURVIVAL);
            let survives = u[3] < survival;
            if !survives {
                return false;
            }
            walk.throughput /= survival;
            walk.survival *= survival;
        }
        walk.density = next.forward;
        walk.ray = spawn_ray(&path[last].point, next.direction);
        walk.throughput.max_element() > 0.0 && walk.throughput.is_finite()
    }
}
