//! Instant radiosity [Keller 1997]: indirect lighting by virtual lights.
//!
//! Each pass traces a few paths from the lights and places a virtual light at each non-specular surface that they hit. Each
//! half of the samples has its own virtual lights, which light the non-specular surfaces on its camera paths. The geometric
//! factor of each virtual light is bounded. The path itself traces the light cut off by the bound [after Kollig and Keller
//! 2004], so that no light is lost.

use crate::walk::{
    Arrival, Onwards, Sources, draws_of_half, is_non_specular, leaks, refuse, scattered_from, turned, visible,
};
use dapple_core::integrator::{Pass, PreparationCost, Prepares};
use dapple_core::options::Options as _;
use dapple_core::{Draws, Frame, Integrator, Worker};
use dapple_geometry::SurfacePoint;
use dapple_renderer::light::Target;
use dapple_renderer::shading::{Bsdf, ShadingFrame};
use dapple_renderer::{GatherPoint, MakeError, VertexLight, World, path_tracer_with};
use dapple_scene::Effect;
use glam::Vec3;

dapple_core::options! {
    /// The parameters of the integrator `instant`: instant radiosity [Keller 1997].
    pub struct InstantOptions {
        /// Light paths per pass for each half of the samples.
        pub paths: u32 = 64, |paths| (1..=1 << 20).contains(&paths), "1 to 1048576";
        /// Maximum geometry term (cosines / distance^2, distance in scene radii); path tracing adds the light that clamping removes. inf: no clamping.
        pub clamp: f64 = 10.0, |clamp| clamp > 0.0, "above 0";
    }
}

/// Makes the integrator from the text of its parameters, for the table of integrators.
pub(crate) fn make<'w>(parameters: &str, world: &'w World) -> Result<Box<dyn Integrator + 'w>, MakeError> {
    let options = InstantOptions::parse(parameters)?;
    let lacking = [
        (Effect::MotionBlur, "motion-blur, but virtual lights do not move; use integrator \"path\""),
        (Effect::ScatteringMedia, "scattering-media, but virtual lights lie on surfaces only; use integrator \"path\""),
    ];
    refuse(world, &lacking)?;
    Ok(path_tracer_with(world, VirtualLights::new(world, options)))
}

/// A virtual light: a surface point that a path from a light has reached.
#[derive(Clone, Copy, Debug)]
struct VirtualLight<'w> {
    point: SurfacePoint,
    bsdf: Bsdf<'w>,
    frame: ShadingFrame,
    /// The unit direction from which its light arrived: `from` in the renderer's space, `wi` in the shading frame.
    from: Vec3,
    wi: Vec3,
    /// The flux that arrives, corrected for the shading normal.
    flux: Vec3,
    /// The number of scattering events of its light, including the one at this point.
    bounces: u32,
}

impl VirtualLight<'_> {
    /// Returns the radiance times area that the virtual light emits into a unit direction.
    fn towards(&self, direction: Vec3) -> Vec3 {
        let wo = self.frame.to_local(direction);
        if leaks([self.wi.z, wo.z], [self.from, direction].map(|w| self.point.normal.dot(w))) {
            return Vec3::ZERO;
        }
        self.bsdf.evaluate(wo, self.wi) * self.flux
    }
}

/// The virtual lights of the current pass, one set for each half of the samples.
struct VirtualLights<'w> {
    world: &'w World,
    options: InstantOptions,
    sources: Sources,
    /// The upper bound of the geometric factor, in the renderer's units.
    largest: f32,
    sets: [Vec<VirtualLight<'w>>; 2],
}

/// The state of a path.
#[derive(Clone, Copy, Default)]
struct Gathered {
    /// The position and unit shading normal of a surface lit by virtual lights: the last such surface (`last`), and the current
    /// vertex (`next`).
    last: Option<[Vec3; 2]>,
    next: Option<[Vec3; 2]>,
}

impl<'w> VirtualLights<'w> {
    fn new(world: &'w World, options: InstantOptions) -> Self {
        let radius = f64::from(world.lights().scene_sphere().1);
        let largest = (options.clamp / (radius * radius)) as f32;
        let sources = Sources::new(world, |_| true);
        Self { world, options, sources, largest, sets: Default::default() }
    }

    fn arrive(&self, arrival: &Arrival<'_, 'w>, set: &mut Vec<VirtualLight<'w>>) -> Onwards {
        if is_non_specular(arrival.bsdf) {
            let &Arrival { from, frame, .. } = arrival;
            let (point, wi) = (*arrival.at.point(), frame.to_local(from));
            let turned = turned(frame.normal.dot(from), point.normal.dot(from));
            let flux = arrival.flux * (turned / self.options.paths as f32);
            if flux.is_finite() {
                let (bsdf, frame, bounces) = (*arrival.bsdf, *frame, arrival.bounces + 1);
                set.push(VirtualLight { point, bsdf, frame, from, wi, flux, bounces });
            }
        }
        Onwards::Scatter
    }
}

impl VertexLight for VirtualLights<'_> {
    const ACTIVE: bool = true;
    type State = Gathered;

    fn gather(&self, state: &mut Gathered, vertex: &GatherPoint<'_>, draws: &Draws<'_>, _: &mut Worker) -> (Vec3, u32) {
        state.next = None;
        if !is_non_specular(vertex.bsdf) {
            return (Vec3::ZERO, 0);
        }
        let from = vertex.at.point().position;
        state.next = Some([from, vertex.frame.normal]);
        let most = self.world.max_depth().saturating_sub(vertex.depth + 1);
        let (mut sum, mut traced) = (Vec3::ZERO, 0);
        let set = &self.sets[(draws.sample_number() & 1) as usize];
        for light in set.iter().filter(|light| light.bounces <= most) {
            let to = light.point.position - from;
            let squared = to.length_squared();
            let wi = to / squared.sqrt();
            let Some((f, cosine)) = scattered_from(vertex, wi) else { continue };
            let geometry = geometry(cosine, light.point.normal.dot(wi), squared).min(self.largest);
            let light_of_it = f * light.towards(-wi) * geometry;
            if light_of_it == Vec3::ZERO || !light_of_it.is_finite() {
                continue;
            }
            let (share, rays) = visible(self.world, vertex.at, wi, Target::Surface(light.point));
            sum += light_of_it * share;
            traced += rays;
        }
        (sum, traced)
    }

    fn share(&self, state: &Gathered, vertex: &GatherPoint<'_>) -> f32 {
        let Some([position, normal]) = state.last.filter(|_| is_non_specular(vertex.bsdf)) else { return 1.0 };
        let (point, back) = (vertex.at.point(), vertex.back);
        let squared = point.position.distance_squared(position);
        let geometry = geometry(normal.dot(back), point.normal.dot(back), squared);
        // Virtual lights provide the fraction `largest / geometry` of this light.
        if geometry > self.largest { 1.0 - self.largest / geometry } else { 0.0 }
    }

    fn scattered(&self, state: &mut Gathered, specular: bool) {
        // Virtual lights do not replace light from a specular lobe.
        state.last = state.next.filter(|_| !specular);
        state.next = None;
    }

    fn scattered_in_medium(&self, state: &mut Gathered) {
        *state = Gathered::default();
    }

    fn prepares(&self) -> Prepares {
        Prepares::EveryPass
    }

    fn prepare(&mut self, pass: &Pass<'_>) -> PreparationCost {
        let mut prepared = PreparationCost::default();
        for half in 0..2 {
            let (paths, draws) = (0..self.options.paths, draws_of_half(pass, half, self.options.paths));
            let (set, rays) = self.sources.trace(self.world, paths, draws, |arrival, set| self.arrive(arrival, set));
            self.sets[half] = set;
            prepared.rays += rays;
        }
        prepared
    }

    fn memory(&self, _: &Frame) -> u64 {
        /// The number of virtual lights per path, including the unused capacity of a growing list.
        const OF_A_PATH: u64 = 8;
        2 * OF_A_PATH * size_of::<VirtualLight>() as u64 * u64::from(self.options.paths)
    }
}

/// Returns the geometric factor between two surface points: the product of both cosines divided by the squared distance.
fn geometry(at_one: f32, at_other: f32, squared: f32) -> f32 {
    (at_one * at_other).abs() / squared
}
