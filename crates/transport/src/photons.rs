//! Photon mapping [Jensen 1996] in passes of one radius each [Knaus and Zwicker 2011].
//!
//! Each pass traces photons from the lights and stores them where they arrive at non-specular surfaces. At the vertices of its
//! paths, the path tracer adds radiance estimated from the density of photons. The radius shrinks from pass to pass, so that
//! both bias and variance of the mean over passes converge to 0.

mod map;

use crate::walk::{
    Arrival, MOST_TURNED, Onwards, Sources, draws_of_half, emitted, first_hit, grid, is_non_specular, pilot_draws,
    refuse, scattered_from, walk,
};
use dapple_core::integrator::{Pass, PreparationCost, Prepares};
use dapple_core::options::Options as _;
use dapple_core::{Draws, Frame, Integrator, Worker};
use dapple_renderer::{GatherPoint, MakeError, VertexLight, World, path_tracer_with};
use dapple_scene::Effect;
use glam::Vec3;
use map::{Photon, PhotonMap, shrunk};

/// The light that photons carry. Path tracing finds all other light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PhotonScope {
    /// Caustics: light from small light sources that reaches non-specular surfaces by way of mirrors and clear glass only.
    Caustics,
    /// All indirect lighting at the first non-specular surface of a path.
    All,
}

dapple_core::choices!(PhotonScope { Caustics = "caustics", All = "all" });

dapple_core::options! {
    /// The parameters of the integrator `photons`.
    pub struct PhotonOptions {
        /// Light that photons carry: caustics (of small lights), or all (all indirect lighting).
        pub what: PhotonScope = PhotonScope::Caustics => "caustics", |_what| true, "\"caustics\" or \"all\"";
        /// Photons per pass for each half of the samples; 0 = automatic (one per pixel).
        pub photons: u32 = 0, |photons| photons <= 1 << 24, "0 to 16777216";
        /// Lookup radius of the first pass, in units of the scene file; 0 = automatic (the size of a pixel at the median hit distance).
        pub radius: f64 = 0.0, |radius| radius >= 0.0 && radius.is_finite(), "0 or above";
        /// Shrinking of the radius from pass to pass: 0 fastest (noisy), 1 none (biased).
        pub alpha: f64 = 0.667, |alpha| (0.0..=1.0).contains(&alpha), "0 to 1";
        /// With what=caustics: maximum solid angle in sr of a small light, seen from one scene radius away.
        pub small: f64 = 0.05, |small| small >= 0.0, "0 or above";
        /// With what=all: non-specular bounces traced before the photon map is queried (0: direct lookup).
        pub gather: u32 = 0, |gather| gather <= 1, "0 or 1";
    }
}

/// Makes the integrator from the text of its parameters, for the table of integrators.
pub(crate) fn make<'w>(parameters: &str, world: &'w World) -> Result<Box<dyn Integrator + 'w>, MakeError> {
    let options = PhotonOptions::parse(parameters)?;
    let blur = "motion blur, which photons do not support; use integrator \"path\", or render without motion-blur";
    let medium = "scattering-media, but photons are stored on surfaces only; use integrator \"path\" or what=caustics";
    let lacking = [(Effect::MotionBlur, blur), (Effect::ScatteringMedia, medium)];
    refuse(world, if options.what == PhotonScope::All { &lacking } else { &lacking[..1] })?;
    let light = PhotonLight::new(world, options);
    light.check_radius()?;
    Ok(path_tracer_with(world, light))
}

/// The smallest cosine between the normals of two points that count as the same surface.
const SAME_NORMAL: f32 = 0.9;
/// The smallest and the largest radius of a look-up, relative to the scene's radius. Positions are about as precise as the
/// smallest.
const RADII: [f32; 2] = [1e-6, 2.0];
/// Half the height of the look-up's cylinder, in radii.
const THICKNESS: f32 = 0.5;
/// The radius of the first look-up, in pixels at the median first hit.
const PIXELS: f32 = 1.0;
/// The number of caustic photons stored per guided path, for the memory estimate. Measured: 0.6 on the scene `caustic`.
const STORED_CAUSTICS: f64 = 0.7;
/// The number of paths traced for the memory estimate with what=all.
const PILOT_PHOTONS: u32 = 2048;

/// The photons of the current pass, one map for each half of the samples.
struct PhotonLight<'w> {
    world: &'w World,
    options: PhotonOptions,
    /// The lights that emit photons.
    sources: Sources,
    /// For each light, true if photons replace its light through mirrors and glass.
    replaced: Vec<bool>,
    /// The radius of the first pass, in the renderer's units; `None` before it is measured.
    radius: Option<f32>,
    maps: [PhotonMap; 2],
    is_guided: bool,
}

/// The state of a path that gathers photons.
#[derive(Clone, Copy, Default)]
struct Gathered {
    now: Next,
    /// The state to use after the next scattering event, unless the event is specular.
    next: Next,
    /// The number of non-specular surfaces at which the path gathered photons.
    vertices: u32,
}

#[derive(Clone, Copy, Default)]
struct Next {
    /// True if photons at the last non-specular surface already provided the light that arrives there through specular chains.
    has_chains: bool,
    /// True if photons provided all indirect lighting of the last non-specular surface.
    ends: bool,
}

impl<'w> PhotonLight<'w> {
    fn new(world: &'w World, options: PhotonOptions) -> Self {
        let lights = world.lights();
        let is_small = |light| match lights.light_sphere(light) {
            _ if options.what == PhotonScope::All => true,
            _ if lights.is_delta(light) => true,
            Some((_, radius)) => {
                let distance = f64::from(lights.scene_sphere().1);
                std::f64::consts::PI * (f64::from(radius) / distance).powi(2) < options.small
            }
            None => false,
        };
        let replaced: Vec<bool> = (0..lights.len() as u32).map(is_small).collect();
        let sources = Sources::new(world, |light| replaced[light as usize]);
        let radius = (options.radius > 0.0).then(|| (options.radius * world.space().scale()) as f32);
        Self { world, options, sources, replaced, radius, maps: Default::default(), is_guided: false }
    }

    /// Rejects a radius so small that no photons are found, or so large that all photons are.
    fn check_radius(&self) -> Result<(), MakeError> {
        let scene = self.world.lights().scene_sphere().1;
        let [least, most] = RADII.map(|of_scene| of_scene * scene);
        if self.radius.is_none_or(|radius| (least..=most).contains(&radius)) {
            return Ok(());
        }
        let [least, most] = [least, most].map(|radius| f64::from(radius) / self.world.space().scale());
        let radius = self.options.radius;
        Err(MakeError::Scene(format!(
            "radius={radius:?} does not fit the scene; use {least:.3e} to {most:.3e}, or 0 for the default"
        )))
    }

    /// Returns the radius of a pass: `r(i+1)^2 = r(i)^2 (i + alpha) / (i + 1)` [Knaus and Zwicker 2011].
    fn radius_of(&mut self, pass: &Pass<'_>) -> f32 {
        let first = *self.radius.get_or_insert_with(|| PIXELS * footprint(self.world, &pass.frame));
        first * shrunk(self.options.alpha, pass.number).sqrt() as f32
    }

    /// Learns which rays from the lights become caustics: the few that hit glass or mirrors. Returns the number of rays
    /// traced.
    fn guide(&mut self) -> u64 {
        self.is_guided = true;
        if self.options.what == PhotonScope::All {
            return 0;
        }
        let mut sources = self.sources.clone();
        let rays = sources.guide(self.world, |emitted, draws| {
            let mut photons = Vec::new();
            let rays = walk(self.world, emitted, draws, |arrival| self.arrive(arrival, &mut photons));
            (photons.iter().map(|photon| photon.flux.element_sum()).sum(), rays)
        });
        self.sources = sources;
        rays
    }

    /// Traces photons. Returns them in the order of their paths, and the number of rays.
    fn trace<'d>(&self, paths: u32, draws: impl Fn(u32) -> Draws<'d> + Sync) -> (Vec<Photon>, u64) {
        self.sources.trace(self.world, 0..paths, draws, |arrival, photons| self.arrive(arrival, photons))
    }

    /// Returns the mean number of photons that a path stores, for the memory estimate. With what=all, some paths are traced to
    /// measure it.
    fn stored(&self) -> f64 {
        if self.options.what == PhotonScope::Caustics {
            return if self.sources.is_empty() { 0.0 } else { STORED_CAUSTICS };
        }
        let (photons, _) = self.trace(PILOT_PHOTONS, |number| pilot_draws([number, 0]));
        photons.len() as f64 / f64::from(PILOT_PHOTONS)
    }

    /// Stores an arriving photon unless it is direct light. Returns how its path continues.
    fn arrive(&self, arrival: &Arrival<'_, '_>, photons: &mut Vec<Photon>) -> Onwards {
        let caustics = self.options.what == PhotonScope::Caustics;
        if caustics && !arrival.is_specular {
            return Onwards::Stop;
        }
        if arrival.bounces > 0 && is_non_specular(arrival.bsdf) {
            let &Arrival { from, flux, bounces, is_specular: is_caustic, .. } = arrival;
            let point = arrival.at.point();
            let (position, normal) = (point.position, point.normal);
            photons.push(Photon { position, from, normal, flux, bounces, is_caustic });
        }
        if caustics { Onwards::Specular } else { Onwards::Scatter }
    }

    /// Returns the radiance estimated from the photons around a vertex: from caustic photons only, or from all.
    fn density(&self, vertex: &GatherPoint<'_>, map: &PhotonMap, caustics: bool) -> Vec3 {
        let point = vertex.at.point();
        let (normal, shading) = (point.normal, vertex.frame.normal);
        let bumped = shading != normal;
        let most = self.world.max_depth().saturating_sub(vertex.depth + 1);
        let mut sum = Vec3::ZERO;
        map.near(point.position, |photon| {
            let height = (photon.position - point.position).dot(normal).abs();
            // The same surface may be stored with its normal on the other side.
            let same = photon.normal.dot(normal).abs() > SAME_NORMAL && height <= THICKNESS * map.radius;
            if !same || photon.bounces > most || (caustics && !photon.is_caustic) {
                return;
            }
            let Some((f, cosine)) = scattered_from(vertex, photon.from) else { return };
            // Flux is measured on the geometric surface, and scattered by the shading normal.
            let turn = if bumped { (cosine / normal.dot(photon.from)).abs().min(MOST_TURNED) } else { 1.0 };
            sum += f * photon.flux * turn;
        });
        sum * map.density
    }
}

impl VertexLight for PhotonLight<'_> {
    const ACTIVE: bool = true;
    type State = Gathered;

    fn gather(&self, state: &mut Gathered, vertex: &GatherPoint<'_>, draws: &Draws<'_>, _: &mut Worker) -> (Vec3, u32) {
        state.next = Next::default();
        if !is_non_specular(vertex.bsdf) || self.sources.is_empty() {
            return (Vec3::ZERO, 0);
        }
        let all = self.options.what == PhotonScope::All && state.vertices >= self.options.gather;
        state.next = Next { has_chains: true, ends: all };
        (self.density(vertex, &self.maps[(draws.sample_number() & 1) as usize], !all), 0)
    }

    fn scattered(&self, state: &mut Gathered, specular: bool) {
        if !specular {
            state.now = state.next;
            state.vertices += u32::from(state.now.has_chains);
        }
    }

    fn scattered_in_medium(&self, state: &mut Gathered) {
        state.now = Next::default();
    }

    fn replaces(&self, state: &Gathered, light: u32, specular: bool) -> bool {
        let all = self.options.what == PhotonScope::All;
        specular && state.now.has_chains && self.replaced.get(light as usize).copied().unwrap_or(all)
    }

    fn ends(&self, state: &Gathered, _: bool) -> bool {
        state.now.ends
    }

    fn prepares(&self) -> Prepares {
        if self.sources.is_empty() { Prepares::Never } else { Prepares::EveryPass }
    }

    fn prepare(&mut self, pass: &Pass<'_>) -> PreparationCost {
        let emitted = emitted(self.options.photons, &pass.frame);
        let radius = self.radius_of(pass);
        let mut prepared = PreparationCost::default();
        if !self.is_guided {
            let rays = self.guide();
            // A resumed render repeats the guiding, whose rays are already counted.
            prepared.rays += if pass.number == 0 { rays } else { 0 };
        }
        self.maps = Default::default();
        for half in 0..2 {
            let (photons, rays) = self.trace(emitted, draws_of_half(pass, half, emitted));
            self.maps[half] = PhotonMap::new(&photons, emitted, radius);
            prepared.rays += rays;
        }
        prepared
    }

    fn memory(&self, frame: &Frame) -> u64 {
        // Both maps, the unsorted photons of one map, and the indices of its photons and buckets.
        const BYTES: usize = 3 * size_of::<Photon>() + 6 * size_of::<u32>();
        (self.stored() * BYTES as f64 * f64::from(emitted(self.options.photons, frame))) as u64
    }
}

/// Returns the median width of a pixel's footprint at first hits, in the renderer's units. If camera rays hit nothing, returns
/// a hundredth of the scene's radius.
fn footprint(world: &World, frame: &Frame) -> f32 {
    let width = |pixel| first_hit(world, pixel).map(|(at, _)| world.camera().footprint(at.distance()));
    let widths = grid(frame, 32).filter_map(width).filter(|width| *width > 0.0 && width.is_finite());
    let mut widths: Vec<f32> = widths.collect();
    widths.sort_by(f32::total_cmp);
    widths.get(widths.len() / 2).copied().unwrap_or(0.01 * world.lights().scene_sphere().1)
}
