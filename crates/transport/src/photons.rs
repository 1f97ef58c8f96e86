//! Photon mapping [Jensen 1996] in passes of one radius each [Knaus and Zwicker 2011].
//!
//! Each pass traces photons from the lights and stores those that arrive at rough surfaces. The path tracer adds their
//! density at the vertices of its paths. The radius shrinks from pass to pass, so that the mean over passes converges
//! to the true image: bias and variance both fall to 0.

use crate::walk::{
    Arrival, MOST_TURNED, Onwards, Sources, draws_of_half, emitted, first_hit, grid, is_rough, probe, refuse,
    scattered_from, walk,
};
use dapple_core::{Draws, Frame, Integrator, Options as _, Pass, Prepared, Prepares, Worker};
use dapple_renderer::{GatherPoint, MakeError, VertexLight, World, path_tracer_with};
use dapple_scene::Effect;
use glam::{IVec3, Vec3};
use std::f32::consts::PI;

/// The light that photons carry. The rest is left to path tracing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum What {
    /// Light of small lamps that reaches rough surfaces by mirrors and clear glass only.
    Caustics,
    /// All indirect light at the first rough surface of a path.
    All,
}

dapple_core::choices!(What { Caustics = "caustics", All = "all" });

dapple_core::options! {
    /// The parameters of the integrator `photons`.
    pub struct PhotonOptions {
        /// The light that photons carry: caustics (of small lamps), or all indirect light.
        pub what: What = What::Caustics => "caustics", |_what| true, "\"caustics\" or \"all\"";
        /// Photons per pass and half of the samples; 0 takes one per pixel.
        pub photons: u32 = 0, |photons| photons <= 1 << 24, "0 to 16777216";
        /// The radius of the first pass, in units of the scene file; 0 takes a pixel at the median first hit.
        pub radius: f64 = 0.0, |radius| radius >= 0.0 && radius.is_finite(), "0 or above";
        /// The speed at which radii stay large, from 0 (fast, noisy) to 1 (no shrinking, biased).
        pub alpha: f64 = 0.667, |alpha| (0.0..=1.0).contains(&alpha), "0 to 1";
        /// With what=caustics: the largest solid angle of a small lamp in sr, from the distance of the scene's radius.
        pub small: f64 = 0.05, |small| small >= 0.0, "0 or above";
        /// With what=all: rough surfaces that a path leaves before photons end it.
        pub gather: u32 = 0, |gather| gather <= 1, "0 or 1";
    }
}

/// Makes the integrator from the text of its parameters, for the table of integrators.
pub(crate) fn make<'w>(parameters: &str, world: &'w World) -> Result<Box<dyn Integrator + 'w>, MakeError> {
    let options = PhotonOptions::parse(parameters)?;
    let blur = "motion blur, and photons have no time; use \"path\", or render without motion-blur";
    let medium = "a medium that scatters light, and photons are stored on surfaces only; use \"path\" or what=caustics";
    let lacking = [(Effect::MotionBlur, blur), (Effect::ScatteringMedia, medium)];
    refuse(world, if options.what == What::All { &lacking } else { &lacking[..1] })?;
    let light = PhotonLight::new(world, options);
    light.check_radius()?;
    Ok(path_tracer_with(world, light))
}

/// The least cosine between the normals of two points of the same surface.
const SAME_NORMAL: f32 = 0.9;
/// The smallest and the largest radius of a look-up, in radii of the scene. Positions are no more exact than the smallest.
const RADII: [f32; 2] = [1e-6, 2.0];
/// The height of the look-up's cylinder to each side, in radii.
const THICKNESS: f32 = 0.5;
/// The radius of the first look-up in pixels at the median first hit.
const PIXELS: f32 = 1.0;
/// Photons that a guided path stores as caustics, for the estimate of memory. Measured: 0.6 on the scene `caustic`.
const STORED_CAUSTICS: f64 = 0.7;
/// Paths that are traced for the estimate of memory with what=all.
const PROBES: u32 = 2048;

/// The photons of the current pass, one map for each half of the samples.
struct PhotonLight<'w> {
    world: &'w World,
    options: PhotonOptions,
    /// The lights that emit photons.
    sources: Sources,
    /// For each light, true if photons stand for its light through mirrors and glass.
    replaced: Vec<bool>,
    /// The radius of the first pass, in the renderer's units; `None` before it is measured.
    radius: Option<f32>,
    maps: [PhotonMap; 2],
    is_guided: bool,
}

/// The state of a path among photons.
#[derive(Clone, Copy, Default)]
struct Gathered {
    now: Next,
    /// The state after a scattering event that is not specular.
    next: Next,
    /// The number of rough surfaces at which the path gathered.
    vertices: u32,
}

#[derive(Clone, Copy, Default)]
struct Next {
    /// True if the last rough surface had the light of specular chains from its photons.
    has_chains: bool,
    /// True if photons were all indirect light of that surface.
    ends: bool,
}

impl<'w> PhotonLight<'w> {
    fn new(world: &'w World, options: PhotonOptions) -> Self {
        let lights = world.lights();
        let is_small = |light| match lights.light_sphere(light) {
            _ if options.what == What::All => true,
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

    /// Refuses a radius that finds no photons, or all of them.
    fn check_radius(&self) -> Result<(), MakeError> {
        let scene = self.world.lights().scene_sphere().1;
        let [least, most] = RADII.map(|of_scene| of_scene * scene);
        if self.radius.is_none_or(|radius| (least..=most).contains(&radius)) {
            return Ok(());
        }
        let [least, most] = [least, most].map(|radius| f64::from(radius) / self.world.space().scale());
        let radius = self.options.radius;
        Err(MakeError::Scene(format!("radius={radius:?} does not fit the scene; use {least:.3e} to {most:.3e}, or 0")))
    }

    /// The radius of a pass: `r(i+1)^2 = r(i)^2 (i + alpha) / (i + 1)` [Knaus and Zwicker 2011].
    fn radius_of(&mut self, pass: &Pass<'_>) -> f32 {
        let first = *self.radius.get_or_insert_with(|| PIXELS * footprint(self.world, &pass.frame));
        first * shrunk(self.options.alpha, pass.number).sqrt() as f32
    }

    /// Learns which rays of the lamps become caustics: the few that meet glass or mirrors.
    fn guide(&mut self) -> u64 {
        self.is_guided = true;
        if self.options.what == What::All {
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

    /// Traces photons, in the order of their numbers.
    fn trace<'d>(&self, paths: u32, draws: impl Fn(u32) -> Draws<'d> + Sync) -> (Vec<Photon>, u64) {
        self.sources.trace(self.world, 0..paths, draws, |arrival, photons| self.arrive(arrival, photons))
    }

    /// The photons that a path stores, for the estimate of memory: with what=all by tracing some.
    fn stored(&self) -> f64 {
        if self.options.what == What::Caustics {
            return if self.sources.is_empty() { 0.0 } else { STORED_CAUSTICS };
        }
        let (photons, _) = self.trace(PROBES, |number| probe([number, 0]));
        photons.len() as f64 / f64::from(PROBES)
    }

    /// Stores a photon that arrives, if it is not direct light, and returns how its path continues.
    fn arrive(&self, arrival: &Arrival<'_, '_>, photons: &mut Vec<Photon>) -> Onwards {
        let caustics = self.options.what == What::Caustics;
        if caustics && !arrival.is_specular {
            return Onwards::Stop;
        }
        if arrival.bounces > 0 && is_rough(arrival.bsdf) {
            let &Arrival { from, flux, bounces, is_specular: is_caustic, .. } = arrival;
            let point = arrival.at.point();
            let (position, normal) = (point.position, point.normal);
            photons.push(Photon { position, from, normal, flux, bounces, is_caustic });
        }
        if caustics { Onwards::Specular } else { Onwards::Scatter }
    }

    /// The radiance that the photons around a vertex make; caustics alone, or all.
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
        if !is_rough(vertex.bsdf) || self.sources.is_empty() {
            return (Vec3::ZERO, 0);
        }
        let all = self.options.what == What::All && state.vertices >= self.options.gather;
        state.next = Next { has_chains: true, ends: all };
        (self.density(vertex, &self.maps[(draws.sample_number() & 1) as usize], !all), 0)
    }

    fn samples_lights(&self, _: &Gathered, _: &GatherPoint<'_>) -> bool {
        true
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
        let all = self.options.what == What::All;
        specular && state.now.has_chains && self.replaced.get(light as usize).copied().unwrap_or(all)
    }

    fn ends(&self, state: &Gathered, _: bool) -> bool {
        state.now.ends
    }

    fn prepares(&self) -> Prepares {
        if self.sources.is_empty() { Prepares::Never } else { Prepares::EveryPass }
    }

    fn prepare(&mut self, pass: &Pass<'_>) -> Prepared {
        let emitted = emitted(self.options.photons, &pass.frame);
        let radius = self.radius_of(pass);
        let mut prepared = Prepared::default();
        if !self.is_guided {
            let rays = self.guide();
            // A resumed render guides again, which was counted before.
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
        // Both maps, the photons of one before they are sorted, and numbers for each of them and for the buckets.
        const BYTES: usize = 3 * size_of::<Photon>() + 6 * size_of::<u32>();
        (self.stored() * BYTES as f64 * f64::from(emitted(self.options.photons, frame))) as u64
    }
}

/// The squared radius of a pass, over that of the first.
fn shrunk(alpha: f64, pass: u32) -> f64 {
    (1..=pass).map(f64::from).fold(1.0, |square, i| square * (i + alpha) / (i + 1.0))
}

/// The median width of a pixel on the first surface that camera rays meet, in the renderer's units. Where they meet
/// none, it is a hundredth of the scene's radius.
fn footprint(world: &World, frame: &Frame) -> f32 {
    let width = |pixel| first_hit(world, pixel).map(|(at, _)| world.camera().footprint(at.distance()));
    let widths = grid(frame, 32).filter_map(width).filter(|width| *width > 0.0 && width.is_finite());
    let mut widths: Vec<f32> = widths.collect();
    widths.sort_by(f32::total_cmp);
    widths.get(widths.len() / 2).copied().unwrap_or(0.01 * world.lights().scene_sphere().1)
}

/// Light that arrived at a surface.
#[derive(Clone, Copy, Debug)]
struct Photon {
    position: Vec3,
    /// The unit direction that the light came from.
    from: Vec3,
    /// The unit geometric normal of the surface.
    normal: Vec3,
    flux: Vec3,
    /// The number of scattering events on the way.
    bounces: u32,
    /// True if all of them were specular.
    is_caustic: bool,
}

/// The photons of one pass, for look-ups within a fixed radius.
#[derive(Clone, Debug, Default)]
struct PhotonMap {
    /// Sorted by bucket, then in the order of emission, so that sums have the same bits every time.
    photons: Vec<Photon>,
    /// The index of each bucket's first photon, and the number of photons.
    starts: Vec<u32>,
    radius: f32,
    /// 1 over the area of a look-up times the number of emitted photons.
    density: f32,
}

impl PhotonMap {
    /// Sorts the photons that arrived of `emitted` ones. Cells are as wide as the look-up's disk.
    fn new(arrived: &[Photon], emitted: u32, radius: f32) -> Self {
        let buckets = arrived.len().next_power_of_two();
        let mut map = Self { photons: Vec::new(), starts: vec![0; buckets + 1], radius, density: 0.0 };
        map.density = (PI * radius * radius * emitted as f32).recip();
        let bucket_of: Vec<u32> = arrived.iter().map(|p| map.bucket(map.cell(p.position))).collect();
        bucket_of.iter().for_each(|bucket| map.starts[*bucket as usize + 1] += 1);
        (0..buckets).for_each(|i| map.starts[i + 1] += map.starts[i]);
        let mut next = map.starts.clone();
        let mut order = vec![0u32; arrived.len()];
        for (photon, &bucket) in (0..).zip(&bucket_of) {
            order[next[bucket as usize] as usize] = photon;
            next[bucket as usize] += 1;
        }
        map.photons = order.into_iter().map(|photon| arrived[photon as usize]).collect();
        map
    }

    fn cell(&self, position: Vec3) -> IVec3 {
        (position * (0.5 / self.radius)).floor().as_ivec3()
    }

    /// The hash of a cell [Teschner et al. 2003].
    fn bucket(&self, cell: IVec3) -> u32 {
        let hash = (cell.x as u32).wrapping_mul(73_856_093)
            ^ (cell.y as u32).wrapping_mul(19_349_663)
            ^ (cell.z as u32).wrapping_mul(83_492_791);
        hash & (self.starts.len() as u32 - 2)
    }

    /// Calls `visit` for each photon within the radius around a point.
    #[inline]
    fn near(&self, position: Vec3, mut visit: impl FnMut(&Photon)) {
        if self.photons.is_empty() {
            return;
        }
        let reach = Vec3::splat(self.radius);
        let [low, high] = [self.cell(position - reach), self.cell(position + reach)];
        let (mut seen, mut count) = ([0u32; 8], 0);
        for z in low.z..=high.z {
            for y in low.y..=high.y {
                for x in low.x..=high.x {
                    let bucket = self.bucket(IVec3::new(x, y, z));
                    // Two cells may share a bucket. Rounding could make three cells of two.
                    if seen[..count].contains(&bucket) || count == seen.len() {
                        continue;
                    }
                    seen[count] = bucket;
                    count += 1;
                    let [start, end] = [0, 1].map(|i| self.starts[bucket as usize + i] as usize);
                    let is_near = |p: &&Photon| p.position.distance_squared(position) <= self.radius * self.radius;
                    self.photons[start..end].iter().filter(is_near).for_each(&mut visit);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn radii_shrink_as_published() {
        // r_N^2 is about N^(alpha - 1) / Gamma(1 + alpha): with alpha = 2/3 it is 0.1108 of the first after 1000 passes.
        assert!((shrunk(2.0 / 3.0, 999) - 0.1108).abs() < 5e-5, "{}", shrunk(2.0 / 3.0, 999));
        assert_eq!(shrunk(1.0, 1000), 1.0);
        assert!((shrunk(0.0, 999) - 1e-3).abs() < 1e-12, "without alpha the area falls as 1/N");
    }

    fn photon(position: Vec3) -> Photon {
        let flux = Vec3::splat(1.0);
        Photon { position, from: Vec3::Z, normal: Vec3::Z, flux, bounces: 1, is_caustic: true }
    }

    #[test]
    fn a_look_up_finds_each_photon_within_the_radius_once() {
        // A Weyl sequence in the cube [-1, 1]^3.
        let place = |i: u32| {
            Vec3::new(0.754_877_7, 0.569_840_3, 0.321_927_4)
                .map(|a| 2.0 * (f64::from(i) * f64::from(a)).fract() as f32 - 1.0)
        };
        let photons: Vec<Photon> = (0..5000).map(|i| photon(place(i))).collect();
        for radius in [0.01, 0.1, 0.35, 3.0] {
            let map = PhotonMap::new(&photons, 5000, radius);
            for at in (0..200).map(|i| place(7 * i + 100_000)) {
                let mut found = 0;
                map.near(at, |_| found += 1);
                let expected = photons.iter().filter(|p| p.position.distance(at) <= radius).count();
                assert_eq!(found, expected, "around {at} within {radius}");
            }
        }
        PhotonMap::new(&[], 0, 1.0).near(Vec3::ZERO, |_| panic!("there are no photons"));
    }
}
