//! Instant radiosity [Keller 1997]: indirect light from virtual lights.
//!
//! Each pass traces a few paths from the lights and leaves a virtual light at each rough surface that they meet. The first
//! rough surface of a camera path is lit by all virtual lights of its set, and ends the path unless a mirror follows.

use crate::walk::{Arrival, Onwards, Sources, walk};
use dapple_core::{Draws, Frame, Integrator, Options as _, Pass, Prepared, Prepares, Worker};
use dapple_geometry::SurfacePoint;
use dapple_renderer::light::{LightSample, Target};
use dapple_renderer::{GatherPoint, MakeError, VertexLight, World, path_tracer_with};
use dapple_scene::Effect;
use glam::Vec3;
use std::f32::consts::FRAC_1_PI;

dapple_core::options! {
    /// The parameters of the integrator `instant`.
    pub struct InstantOptions {
        /// Paths from the lights per pass and half of the samples.
        pub paths: u32 = 64, |paths| (1..=1 << 20).contains(&paths), "1 to 1048576";
        /// The largest factor between virtual light and surface, cosines over squared distance, in units of the scene's
        /// radius; inf clamps nothing.
        pub clamp: f64 = 100.0, |clamp| clamp > 0.0, "above 0";
    }
}

/// Makes the integrator from the text of its parameters, for the table of integrators.
pub(crate) fn make<'w>(parameters: &str, world: &'w World) -> Result<Box<dyn Integrator + 'w>, MakeError> {
    let options = InstantOptions::parse(parameters)?;
    for effect in [Effect::MotionBlur, Effect::ScatteringMedia] {
        if world.effects().has(effect) {
            let reason = format!("the scene has {effect}, and virtual lights stand still on surfaces; use \"path\"");
            return Err(MakeError::Scene(reason));
        }
    }
    Ok(path_tracer_with(world, VirtualLights::new(world, options)))
}

/// The least microfacet width of a surface that is lit by virtual lights, and holds them.
const ROUGH: f32 = 0.3;

/// A point that reflects light as a diffuse surface does.
#[derive(Clone, Copy, Debug)]
struct VirtualLight {
    /// The point, with its normal on the lit side.
    point: SurfacePoint,
    /// The radiance times area that leaves it.
    intensity: Vec3,
    /// The number of scattering events of its light, its own included.
    bounces: u32,
}

/// The virtual lights of the current pass, one set for each half of the samples.
struct VirtualLights<'w> {
    world: &'w World,
    options: InstantOptions,
    sources: Sources,
    /// The largest geometric factor, in the renderer's units.
    largest: f32,
    sets: [Vec<VirtualLight>; 2],
}

/// The state of a path.
#[derive(Clone, Copy, Default)]
struct Gathered {
    /// True if virtual lights were all indirect light of the last rough surface; and of the vertex in progress.
    ends: bool,
    next: bool,
}

impl<'w> VirtualLights<'w> {
    fn new(world: &'w World, options: InstantOptions) -> Self {
        let radius = f64::from(world.lights().scene_sphere().1);
        let largest = (options.clamp / (radius * radius)) as f32;
        Self { world, options, sources: Sources::new(world, |_| true), largest, sets: Default::default() }
    }

    fn arrive(&self, arrival: &Arrival<'_>, set: &mut Vec<VirtualLight>) -> Onwards {
        if arrival.bsdf.roughness() >= ROUGH {
            let mut point = *arrival.at.point();
            if point.normal.dot(arrival.from) < 0.0 {
                point.normal = -point.normal;
            }
            // All of the surface counts as diffuse.
            let share = FRAC_1_PI / self.options.paths as f32;
            let intensity = arrival.flux * arrival.bsdf.albedo() * share;
            set.push(VirtualLight { point, intensity, bounces: arrival.bounces + 1 });
        }
        Onwards::Scatter
    }
}

impl VertexLight for VirtualLights<'_> {
    const ACTIVE: bool = true;
    type State = Gathered;

    fn gather(&self, state: &mut Gathered, vertex: &GatherPoint<'_>, draws: &Draws<'_>, _: &mut Worker) -> (Vec3, u32) {
        state.next = vertex.bsdf.roughness() >= ROUGH;
        if !state.next {
            return (Vec3::ZERO, 0);
        }
        let GatherPoint { at, bsdf, frame, wo, back, depth } = *vertex;
        let from = at.point();
        let most = self.world.max_depth().saturating_sub(depth + 1);
        let (mut sum, mut traced) = (Vec3::ZERO, 0);
        for light in &self.sets[(draws.sample_number() & 1) as usize] {
            let to = light.point.position - from.position;
            let squared = to.length_squared();
            let wi = to / squared.sqrt();
            let at_light = -light.point.normal.dot(wi);
            let local = frame.to_local(wi);
            let same_side = from.normal.dot(wi) * from.normal.dot(back) > 0.0;
            if light.bounces > most || at_light <= 0.0 || same_side != (local.z * wo.z > 0.0) {
                continue;
            }
            let geometry = (local.z.abs() * at_light / squared).min(self.largest);
            let light_of_it = bsdf.evaluate(wo, local) * light.intensity * geometry;
            if light_of_it == Vec3::ZERO || !light_of_it.is_finite() {
                continue;
            }
            let target = Target::Surface(light.point);
            let ray = LightSample { wi, radiance: Vec3::ONE, pdf: 1.0, target, delta: true }.shadow_ray(from);
            let medium = self.world.medium_beyond(at, wi, self.world.camera_medium());
            let (share, rays) = self.world.transmittance(ray, &target, at.time(), medium);
            sum += light_of_it * share;
            traced += rays;
        }
        (sum, traced)
    }

    fn samples_lights(&self, _: &Gathered, _: &GatherPoint<'_>) -> bool {
        true
    }

    fn scattered(&self, state: &mut Gathered, specular: bool) {
        // What follows a mirror is not lit by virtual lights in front of it.
        state.ends = !specular && state.next;
        state.next = false;
    }

    fn scattered_in_medium(&self, state: &mut Gathered) {
        *state = Gathered::default();
    }

    fn replaces(&self, _: &Gathered, _: u32, _: bool) -> bool {
        false
    }

    fn ends(&self, state: &Gathered, specular: bool) -> bool {
        state.ends && !specular
    }

    fn prepares(&self) -> Prepares {
        Prepares::EveryPass
    }

    fn prepare(&mut self, pass: &Pass<'_>) -> Prepared {
        let mut prepared = Prepared::default();
        for half in 0..2 {
            let mut set = Vec::new();
            for path in 0..u64::from(self.options.paths) {
                let draws = pass.draws(half * u64::from(self.options.paths) + path);
                let Some(emitted) = self.sources.emit(self.world, &draws) else { continue };
                prepared.rays += walk(self.world, &emitted, &draws, |arrival| self.arrive(arrival, &mut set));
            }
            self.sets[half as usize] = set;
        }
        prepared
    }

    fn memory(&self, _: &Frame) -> u64 {
        /// Virtual lights of a path, and the reserve of a growing list.
        const OF_A_PATH: u64 = 8;
        2 * OF_A_PATH * size_of::<VirtualLight>() as u64 * u64::from(self.options.paths)
    }
}
