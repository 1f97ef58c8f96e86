//! Radiosity [Goral et al. 1984] with clusters of triangles as patches.
//!
//! Each pass traces particles from the lights and sums the flux that arrives at each patch [after Pattanaik and Mudur 1992].
//! Patches are the clusters of \[Lan 2016\]. A camera path looks up the indirect lighting of a diffuse surface in the patches,
//! and ends there.

use crate::patches::{Division, Patches};
use crate::walk::{Arrival, MOST_TURNED, Onwards, Sources, draws_of_half, emitted, refuse, turned};
use dapple_core::integrator::{Pass, PreparationCost, Prepares};
use dapple_core::options::Options as _;
use dapple_core::{Draws, Frame, Integrator, Worker};
use dapple_renderer::shading::Bsdf;
use dapple_renderer::{GatherPoint, MakeError, VertexLight, World, path_tracer_with};
use dapple_scene::Effect;
use glam::{DVec3, Vec3};

dapple_core::options! {
    /// The parameters of the integrator `radiosity`.
    pub struct RadiosityOptions {
        /// Desired number of patches; more reduce bias, but need more particles.
        pub patches: u32 = 4096, |patches| (1..=1 << 20).contains(&patches), "1 to 1048576";
        /// Particles per pass for each half of the samples; 0 = automatic (one per pixel).
        pub particles: u32 = 0, |particles| particles <= 1 << 24, "0 to 16777216";
        /// Diffuse bounces traced before patches are read: 0 shows the patches, 1 is final gathering.
        pub gather: u32 = 1, |gather| gather <= 1, "0 or 1";
    }
}

/// Makes the integrator from the text of its parameters, for the table of integrators.
pub(crate) fn make<'w>(parameters: &str, world: &'w World) -> Result<Box<dyn Integrator + 'w>, MakeError> {
    let options = RadiosityOptions::parse(parameters)?;
    let lacking = [
        (Effect::MotionBlur, "motion-blur, but patches do not move; use integrator \"path\""),
        (Effect::ScatteringMedia, "scattering-media, but patches lie on surfaces only; use integrator \"path\""),
        (Effect::Transparency, "transparency, but patches have no holes; use integrator \"path\""),
    ];
    refuse(world, &lacking)?;
    let division = Division::new(world, options.patches).map_err(MakeError::Scene)?;
    Ok(path_tracer_with(world, PatchLight::new(world, options, division)))
}

/// The largest number of scattering events that are counted separately; light with more events is added to the last layer.
const LAYERS: u32 = 16;
/// The number of particles whose flux is buffered before it is added to the patches.
const TOGETHER: u32 = 1 << 15;

/// The light that arrives at the patches, one solution for each half of the samples.
struct PatchLight<'w> {
    world: &'w World,
    options: RadiosityOptions,
    sources: Sources,
    division: Division,
    /// The patches, computed in the first pass; empty before.
    patches: Patches,
    /// The number of layers: light is summed separately for each number of scattering events.
    layers: u32,
    /// The indirect irradiance of each side of each patch, from light with at most 1, 2, … scattering events.
    irradiance: [Vec<Vec3>; 2],
}

/// The state of a path that looks up patches.
#[derive(Clone, Copy, Default)]
struct Gathered {
    /// True if patches provided all indirect lighting of the last diffuse surface (`ends`) or of the current vertex (`next`).
    ends: bool,
    next: bool,
    /// The number of diffuse surfaces that have scattered the path.
    vertices: u32,
    is_diffuse: bool,
}

impl<'w> PatchLight<'w> {
    fn new(world: &'w World, options: RadiosityOptions, division: Division) -> Self {
        let layers = world.max_depth().saturating_sub(1).clamp(1, LAYERS);
        let sources = Sources::new(world, |_| true);
        let (patches, irradiance) = Default::default();
        Self { world, options, sources, division, patches, layers, irradiance }
    }

    /// Records the flux that arrives at a patch, unless it is direct light.
    fn arrive(&self, arrival: &Arrival<'_, '_>, found: &mut Vec<(u32, Vec3)>) -> Onwards {
        if arrival.bounces > 0 {
            let side = self.patches.side_at(self.world, arrival.at, arrival.from);
            let place = side as u32 * self.layers + arrival.bounces.min(self.layers) - 1;
            // Irradiance refers to the shading normal.
            let [shading, geometric] = [arrival.frame.normal, arrival.at.point().normal].map(|n| n.dot(arrival.from));
            if shading * geometric > 0.0 {
                found.push((place, arrival.flux * turned(shading, geometric).min(MOST_TURNED)));
            }
        }
        Onwards::Scatter
    }

    /// Traces the particles of one solution. Returns the flux that arrives at each patch side and layer, and the number of
    /// rays.
    fn trace(&self, pass: &Pass<'_>, half: usize, emitted: u32) -> (Vec<DVec3>, u64) {
        let mut sums = vec![DVec3::ZERO; 2 * self.patches.areas.len() * self.layers as usize];
        let (draws, mut rays) = (draws_of_half(pass, half, emitted), 0);
        for first in (0..emitted).step_by(TOGETHER as usize) {
            let some = first..(first + TOGETHER).min(emitted);
            let (found, more) =
                self.sources.trace(self.world, some, &draws, |arrival, found| self.arrive(arrival, found));
            rays += more;
            found.into_iter().for_each(|(place, flux)| sums[place as usize] += flux.as_dvec3());
        }
        (sums, rays)
    }

    /// Returns the irradiance of each patch side and layer: the flux per area, summed over all layers up to and including this
    /// one.
    fn solution(&self, flux: &[DVec3], emitted: u32) -> Vec<Vec3> {
        let layers = self.layers as usize;
        let density = |patch: usize| match self.patches.areas[patch] {
            area if area > 0.0 => (area * f64::from(emitted)).recip(),
            _ => 0.0,
        };
        let sides = flux.chunks(layers).enumerate();
        sides
            .flat_map(|(side, flux)| {
                let density = density(side / 2);
                flux.iter().scan(DVec3::ZERO, move |sum, flux| {
                    *sum += *flux * density;
                    Some(sum.as_vec3())
                })
            })
            .collect()
    }

    /// Returns the radiance of a diffuse surface under the irradiance of its patch.
    fn radiance(&self, vertex: &GatherPoint<'_>, irradiance: &[Vec3]) -> Vec3 {
        let most = self.world.max_depth().saturating_sub(vertex.depth + 1).min(self.layers);
        if most == 0 {
            return Vec3::ZERO;
        }
        let side = self.patches.side_at(self.world, vertex.at, vertex.back);
        let from = |side: usize, wi: Vec3| {
            vertex.bsdf.evaluate(vertex.wo, wi) * irradiance[side * self.layers as usize + most as usize - 1]
        };
        // A diffuse surface scatters the same in all directions of a side.
        let up = Vec3::Z * vertex.wo.z.signum();
        match vertex.bsdf.transmits() {
            true => from(side, up) + from(side ^ 1, -up),
            false => from(side, up),
        }
    }
}

impl VertexLight for PatchLight<'_> {
    const ACTIVE: bool = true;
    type State = Gathered;

    fn gather(&self, state: &mut Gathered, vertex: &GatherPoint<'_>, draws: &Draws<'_>, _: &mut Worker) -> (Vec3, u32) {
        state.is_diffuse = matches!(vertex.bsdf, Bsdf::Diffuse { .. } | Bsdf::DiffuseTransmission(_));
        state.next = state.is_diffuse && state.vertices >= self.options.gather && !self.sources.is_empty();
        if !state.next {
            return (Vec3::ZERO, 0);
        }
        (self.radiance(vertex, &self.irradiance[(draws.sample_number() & 1) as usize]), 0)
    }

    fn scattered(&self, state: &mut Gathered, specular: bool) {
        if !specular {
            state.ends = state.next;
            state.vertices += u32::from(state.is_diffuse);
        }
        (state.next, state.is_diffuse) = (false, false);
    }

    fn scattered_in_medium(&self, state: &mut Gathered) {
        *state = Gathered::default();
    }

    fn ends(&self, state: &Gathered, _: bool) -> bool {
        state.ends
    }

    fn prepares(&self) -> Prepares {
        if self.sources.is_empty() { Prepares::Never } else { Prepares::EveryPass }
    }

    fn prepare(&mut self, pass: &Pass<'_>) -> PreparationCost {
        if self.patches.areas.is_empty() {
            self.patches = Patches::new(self.world, &self.division);
        }
        let emitted = emitted(self.options.particles, &pass.frame);
        let mut prepared = PreparationCost::default();
        for half in 0..2 {
            let (flux, rays) = self.trace(pass, half, emitted);
            self.irradiance[half] = self.solution(&flux, emitted);
            prepared.rays += rays;
        }
        prepared
    }

    fn memory(&self, _: &Frame) -> u64 {
        let patches = self.division.pieces.min(u64::from(self.division.count));
        // The sums of one solution in double precision, then both solutions.
        let places = 2 * patches * u64::from(self.layers);
        places * (2 * size_of::<Vec3>() + size_of::<DVec3>()) as u64 + self.division.bytes()
    }
}
