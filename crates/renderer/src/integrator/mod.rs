//! Integrators: what a sample of a pixel is worth.

mod path;

pub use path::PathTracer;

use crate::World;
use crate::camera::{Pinhole, ThinLens};
use dapple_core::Integrator;

/// The integrator that a world calls for: path tracing without the code of effects that it does not
/// have.
///
/// One `match` chooses among the specialised forms: the lens, whether there are lights to choose among,
/// an environment, and paths long enough for roulette. Lights and materials decide by their own kind.
pub fn integrator(world: &World) -> Box<dyn Integrator + '_> {
    let several = world.lights.len() > 1;
    let sky = world.lights.has_sky();
    let deep = world.max_depth > path::ROULETTE_FROM;
    macro_rules! specialise {
        ($lens:ty) => {
            match (several, sky, deep) {
                (false, false, false) => Box::new(PathTracer::<$lens, false, false, false>::new(world)),
                (false, false, true) => Box::new(PathTracer::<$lens, false, false, true>::new(world)),
                (false, true, false) => Box::new(PathTracer::<$lens, false, true, false>::new(world)),
                (false, true, true) => Box::new(PathTracer::<$lens, false, true, true>::new(world)),
                (true, false, false) => Box::new(PathTracer::<$lens, true, false, false>::new(world)),
                (true, false, true) => Box::new(PathTracer::<$lens, true, false, true>::new(world)),
                (true, true, false) => Box::new(PathTracer::<$lens, true, true, false>::new(world)),
                (true, true, true) => Box::new(PathTracer::<$lens, true, true, true>::new(world)),
            }
        };
    }
    if world.camera.has_lens() { specialise!(ThinLens) } else { specialise!(Pinhole) }
}
