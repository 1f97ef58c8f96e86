//! Random walks that sample camera and light paths. For camera paths, they also record the same data as the path tracer:
//! features for filters, and the emission of directly visible lights.

use super::Bdpt;
use super::vertex::{From, Kind, Vertex, on_light, point_in_space};
use dapple_core::integrator::{CERTAIN_LOBE, RARE_LOBE};
use dapple_core::{Block, Draws, Estimate, SurfaceFeatures};
use dapple_geometry::{Ray, spawn_ray};
use dapple_renderer::light::Target;
use dapple_renderer::{Interaction, World, blocks};
use glam::Vec3;

/// The number of scattering events after which Russian roulette starts.
const ROULETTE_FROM: u32 = 4;
/// The largest survival probability of Russian roulette, so that every path ends.
const SURVIVAL: f32 = 0.99;

/// The number of the light path's first group. The groups of the camera path have smaller numbers; the groups of time and of
/// media (which are rejected) have larger ones ([`blocks`]).
pub(crate) const OF_LIGHT: u32 = 1 << 27;
/// The group for the start of the light path: the light (dimension 0) and the point on it (2 and 3).
const LIGHT_START: Block = Block::new(OF_LIGHT);
/// The group for the first direction of the light path (dimensions 0 and 1).
const LIGHT_DIRECTION: Block = Block::new(OF_LIGHT + 1);

/// Returns the group for the point on the lens (dimensions 0 and 1) and the scattered direction (2 and 3) at a vertex of the
/// light path. `vertex` is the number of scattering events before this one.
pub(crate) const fn light_scatter(vertex: u32) -> Block {
    Block::new(OF_LIGHT + 2).at(vertex, 2)
}

/// Returns the group for the choices at a vertex of the light path: the material (dimension 0), the lobe (1) and Russian
/// roulette (2). `vertex` is the number of scattering events before this one.
pub(crate) const fn light_choose(vertex: u32) -> Block {
    Block::new(OF_LIGHT + 3).at(vertex, 2)
}

/// The state of a random walk between two vertices.
struct Walk {
    ray: Ray,
    throughput: Vec3,
    /// The density of the ray's direction: per solid angle or, if `is_per_area`, per area perpendicular to the ray.
    density: f32,
    is_per_area: bool,
    /// The product of the squared relative indices of refraction crossed, by which the throughput of a camera path is scaled.
    eta_squared: f32,
    /// The reference throughput: Russian roulette computes survival probabilities relative to it.
    unit: f32,
    /// The product of the survival probabilities so far.
    survival: f32,
}

impl Walk {
    fn new(ray: Ray, throughput: Vec3, unit: f32) -> Self {
        Self { ray, throughput, density: 0.0, is_per_area: false, eta_squared: 1.0, unit, survival: 1.0 }
    }

    /// Returns the fraction of light that the vertices so far transmit to the camera.
    fn tint(&self) -> Vec3 {
        self.throughput * (self.eta_squared * self.survival)
    }
}

/// Returns two blocks of random numbers. The second is requested only if `goes_on` is true; otherwise it is zero.
fn numbers(draws: &Draws<'_>, [first, second]: [Block; 2], goes_on: bool) -> [[f32; 4]; 2] {
    if goes_on { draws.two_blocks([first, second]) } else { [draws.block(first), [0.0; 4]] }
}

impl<'w> Bdpt<'w> {
    /// Returns the vertex at a surface that the walk's ray from vertex `before` hits. `mix` in `[0, 1)` selects one material
    /// if the surface is a mix.
    fn surface(&self, at: &Interaction<'w>, walk: &Walk, before: &Vertex<'_>, mix: f32) -> Vertex<'w> {
        let (bsdf, frame) = self.world.bsdf(at, mix);
        let kind = Kind::Surface { bsdf, frame, light: at.light() };
        let vertex = Vertex::new(kind, *at.point(), -walk.ray.direction, walk.throughput, 0.0);
        let forward = match walk.is_per_area {
            true => walk.density * vertex.cosine(walk.ray.direction),
            false => vertex.density_from(before.point.position, walk.density),
        };
        Vertex { forward, ..vertex }
    }

    /// Traces the camera path of a sample into `path`, starting at the camera. Sets the features of the estimate, and adds the
    /// rays to its cost. Returns the time of the sample, and the number of vertices whose emission is directly visible.
    pub(super) fn camera_path(
        &self,
        draws: &Draws<'_>,
        path: &mut Vec<Vertex<'w>>,
        estimate: &mut Estimate,
    ) -> (f32, usize) {
        let (world, most) = (self.world, self.depth);
        let (ray, time) = world.camera_ray(draws);
        let mut walk = Walk::new(ray, Vec3::ONE, 1.0);
        path.push(Vertex::new(Kind::Camera, point_in_space(ray.origin), Vec3::ZERO, Vec3::ONE, 1.0));
        let mut seen = Seen::new(world, draws);
        for event in 0.. {
            estimate.cost += 1;
            let Some(at) = world.closest_hit(&walk.ray, time) else {
                seen.background((&walk.ray, time), walk.tint(), estimate);
                if world.lights().has_environment() {
                    let Walk { ray, throughput, density, .. } = walk;
                    let origin = point_in_space(ray.origin);
                    path.push(Vertex::new(Kind::Sky, origin, ray.direction, throughput, density));
                }
                break;
            };
            let [choices, scatter] = numbers(draws, [blocks::choose(event), blocks::scatter(event)], event < most);
            seen.surface((&walk.ray, &at, choices[3]), walk.tint(), estimate);
            if event == 0 {
                walk.density = world.camera().density(ray.direction, at.distance(), time);
                walk.is_per_area = true;
            }
            let vertex = self.surface(&at, &walk, &path[path.len() - 1], choices[3]);
            let [light_u, light_v, u, v] = scatter;
            path.push(Vertex { to_light: [choices[0], light_u, light_v], ..vertex });
            if event >= most || !self.step(From::Camera, path, &mut walk, [u, v, choices[1], choices[2]], event) {
                break;
            }
            seen.scattered(&path[path.len() - 1], walk.density, choices[1]);
        }
        (time, seen.direct)
    }

    /// Traces the light path of a sample into `path`, starting at the light, and adds its rays to `rays`.
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
        let (kind, point) = on_light(light, emitted.source, lights.is_delta(light), emitted.position);
        if matches!(kind, Kind::Sky) {
            // All environments together are one light.
            start = lights.environment_emission_pdf(-emitted.direction);
            emitted.radiance = lights.environment(-emitted.direction);
            (emitted.pmf, emitted.pdf.direction) = (1.0, start);
        }
        let flux = emitted.flux();
        if !(flux.is_finite() && flux.max_element() > 0.0) {
            return;
        }
        let far = matches!(emitted.source, Target::Far);
        let wo = if far { -emitted.direction } else { Vec3::ZERO };
        path.push(Vertex::new(kind, point, wo, Vec3::ONE, start));
        let mut walk = Walk::new(emitted.ray(), flux, flux.max_element());
        walk.density = if far { emitted.pdf.position } else { emitted.pdf.direction };
        // Parallel light has the density of its disk, seen at an angle.
        walk.is_per_area = far;
        for event in 0.. {
            *rays += 1;
            let Some(at) = world.closest_hit(&walk.ray, time) else { break };
            // The next vertex needs one more event to reach the camera.
            let goes_on = event + 1 < most;
            let [choices, scatter] = numbers(draws, [light_choose(event), light_scatter(event)], goes_on);
            path.push(self.surface(&at, &walk, &path[path.len() - 1], choices[0]));
            let [.., u, v] = scatter;
            if !goes_on || !self.step(From::Light, path, &mut walk, [u, v, choices[1], choices[2]], event) {
                break;
            }
        }
    }

    /// Scatters a walk at its last vertex. Returns false if the walk ends there. `u` holds the random numbers for the
    /// direction, the lobe and Russian roulette.
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
        (walk.density, walk.is_per_area) = (next.forward, false);
        walk.ray = spawn_ray(&path[last].point, next.direction);
        walk.throughput.max_element() > 0.0 && walk.throughput.is_finite()
    }
}

/// The part of a camera path that is visible directly or through mirrors, glass and smooth coats.
struct Seen<'a> {
    world: &'a World,
    draws: &'a Draws<'a>,
    /// The number of surfaces so far.
    surfaces: u32,
    /// True while features are requested and all scattering so far was smooth.
    is_smooth: bool,
    /// True if glass scattered the path in a lobe with less than [`RARE_LOBE`] of the light.
    is_rare: bool,
    /// True while all scattering so far was specular with a probability of at least [`CERTAIN_LOBE`].
    is_direct: bool,
    /// The number of vertices whose emission is directly visible, including the camera.
    direct: usize,
}

impl<'a> Seen<'a> {
    fn new(world: &'a World, draws: &'a Draws<'a>) -> Self {
        let (is_smooth, is_direct) = (draws.wants_features(), draws.wants_emission());
        Self { world, draws, surfaces: 0, is_smooth, is_rare: false, is_direct, direct: if is_direct { 2 } else { 0 } }
    }

    /// Records that the path leaves the scene; `at` is the ray and its time. `tint` is the fraction of light that the surfaces
    /// so far transmit to the camera.
    fn background(&self, at: (&Ray, f32), tint: Vec3, estimate: &mut Estimate) {
        if self.surfaces == 0 && self.draws.wants_trajectory() {
            estimate.trajectory = self.world.background_trajectory(at.0, at.1);
        }
        if !self.is_smooth || self.surfaces == 0 {
            return;
        }
        let last = estimate.features.or_else(|| estimate.first_hit.as_ref().map(SurfaceFeatures::from));
        estimate.features = last.map(|last| {
            let features = SurfaceFeatures::new(last.position, [0.0; 3], last.depth).with_rare(self.is_rare);
            features.with_albedo(tint.min(Vec3::ONE).to_array())
        });
    }

    /// Records a surface that a ray hits. `mix` selects one material if the surface is a mix.
    fn surface(&mut self, (ray, at, mix): (&Ray, &Interaction<'_>, f32), tint: Vec3, estimate: &mut Estimate) {
        let (world, draws) = (self.world, self.draws);
        if self.surfaces == 0 && draws.wants_first_hit() {
            estimate.first_hit = Some(world.first_hit(ray, at, mix));
            if draws.wants_trajectory() {
                estimate.trajectory = world.trajectory(at);
            }
        } else if self.surfaces > 0 && self.is_smooth {
            let first = estimate.first_hit.map_or(0.0, |hit| hit.depth);
            let length = estimate.features.map_or(first, |features| features.depth);
            let features = world.surface_features(ray, at, mix, tint, length);
            estimate.features = Some(features.with_rare(self.is_rare));
        }
        self.surfaces += 1;
    }

    /// Records that the path was scattered at a vertex. `lobe` in `[0, 1)` selected the lobe, and `density` is the density of
    /// the new direction.
    fn scattered(&mut self, vertex: &Vertex<'_>, density: f32, lobe: f32) {
        let Kind::Surface { bsdf, frame, .. } = &vertex.kind else { return };
        if self.is_smooth {
            self.is_smooth = vertex.specular || bsdf.samples_narrow_lobe(frame.to_local(vertex.wo), lobe);
            self.is_rare |= vertex.specular && density < RARE_LOBE && bsdf.transmits();
        }
        self.is_direct &= vertex.specular && density >= CERTAIN_LOBE;
        self.direct += usize::from(self.is_direct);
    }
}
