//! Integrators: each returns a random estimate of a pixel's radiance for one sample.

mod ambient_occlusion;
pub mod code;
mod light_selector;
mod path;
mod table;
#[cfg(test)]
mod tests;

pub use ambient_occlusion::{AmbientOcclusion, AmbientOcclusionOptions};
pub use light_selector::{FixedSelector, LearnedSelector, LightSelector};
pub use path::{GatherPoint, NoVertexLight, PathTracer, VertexLight};
pub use table::{
    IntegratorEntry, IntegratorError, MakeError, MakeIntegrator, check_among, integrators, make, make_among,
};

use crate::World;
use crate::camera::{General, Pinhole, ThinLens};
use dapple_core::Integrator;

/// Returns the path tracer for a world, compiled without code for effects that the scene lacks.
///
/// Leaving out code does not affect the image.
pub fn integrator(world: &World) -> Box<dyn Integrator + '_> {
    integrator_with(world, 0)
}

/// Returns the path tracer for a world, with code for additional effects that the world lacks. `idle` is a combination of the
/// bits of [`code`].
///
/// Used to measure the cost of unused code, and to test that such code does not change the image.
pub fn integrator_with(world: &World, idle: u32) -> Box<dyn Integrator + '_> {
    use code::{ENVIRONMENT, LEARNED_SELECTION, RARE, ROULETTE, SEVERAL_LIGHTS, TRANSMISSION, VARIED};
    let wanted = code::needed(world) | idle;
    macro_rules! form {
        ($lens:ty, $selector:ty, $code:expr) => {
            Box::new(PathTracer::<$lens, $selector, { $code }>::new(world, NoVertexLight)) as Box<dyn Integrator + '_>
        };
    }
    // Each form takes seconds to compile, so forms exist only for effects whose unused code costs measurable time:
    // environments, transmission and varied surfaces. Unused light selection and roulette cost one branch each.
    const MANY: u32 = SEVERAL_LIGHTS | ROULETTE | VARIED;
    const GLASS: u32 = MANY | ENVIRONMENT | TRANSMISSION;
    // The unit tests of this crate compile two forms only; the tests in tests/ use all of them.
    let general = cfg!(test) || wanted & RARE != 0 || world.camera.is_general();
    let transmission = wanted & TRANSMISSION != 0;
    if wanted & LEARNED_SELECTION != 0 {
        return match () {
            () if general => form!(General, LearnedSelector, GLASS | RARE),
            () if world.camera.has_lens() => form!(ThinLens, LearnedSelector, GLASS),
            () if transmission => form!(Pinhole, LearnedSelector, GLASS),
            () => form!(Pinhole, LearnedSelector, MANY | ENVIRONMENT),
        };
    }
    if general {
        return form!(General, FixedSelector, GLASS | RARE);
    }
    if world.camera.has_lens() {
        return form!(ThinLens, FixedSelector, GLASS);
    }
    match (transmission, wanted & ENVIRONMENT != 0, wanted & VARIED != 0) {
        (true, true, _) => form!(Pinhole, FixedSelector, GLASS),
        (true, false, _) => form!(Pinhole, FixedSelector, MANY | TRANSMISSION),
        (false, true, _) => form!(Pinhole, FixedSelector, MANY | ENVIRONMENT),
        (false, false, true) => form!(Pinhole, FixedSelector, MANY),
        (false, false, false) => match wanted {
            0 => form!(Pinhole, FixedSelector, 0),
            ROULETTE => form!(Pinhole, FixedSelector, ROULETTE),
            _ => form!(Pinhole, FixedSelector, SEVERAL_LIGHTS | ROULETTE),
        },
    }
}

/// Returns the path tracer with code for all effects, and with `light` as an additional source of light at path vertices.
pub fn path_tracer_with<'w, G: VertexLight + 'w>(world: &'w World, light: G) -> Box<dyn Integrator + 'w> {
    use code::ALL;
    if world.lights().is_selection_learned() {
        return Box::new(PathTracer::<General, LearnedSelector, ALL, G>::new(world, light));
    }
    Box::new(PathTracer::<General, FixedSelector, ALL, G>::new(world, light))
}
