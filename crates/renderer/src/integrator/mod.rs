//! Integrators: what a sample of a pixel is worth.

mod passage;
mod path;
mod report;
#[cfg(test)]
mod tests;

pub use path::PathTracer;

use crate::World;
use crate::camera::{General, Pinhole, ThinLens};
use dapple_core::Integrator;

/// What a path tracer has code for: bits of its type parameter. What is missing there is not compiled.
pub mod code {
    /// A choice among lights.
    pub const SEVERAL: u32 = 1;
    /// Light from beyond the scene.
    pub const SKY: u32 = 2;
    /// Paths long enough for roulette.
    pub const DEEP: u32 = 4;
    /// Surfaces that light passes.
    pub const CLEAR: u32 = 8;
    /// What few scenes have: media, holes by alpha, interfaces, mixed materials, and things that move. Among
    /// themselves these are told apart at run time, by a predictable branch each.
    pub const RARE: u32 = 16;
    /// Surfaces other than Lambert's of one colour, normals at vertices, and instances.
    pub const VARIED: u32 = 32;
}

/// The integrator that a world calls for: path tracing without the code of effects that it does not
/// have.
///
/// One `match` chooses among the specialised forms, by [`code`] and by the lens. Lights and materials decide by
/// their own kind. Pictures do not depend on the choice, as long as it has all that the world calls for: see
/// [`integrator_with`].
pub fn integrator(world: &World) -> Box<dyn Integrator + '_> {
    integrator_with(world, 0)
}

/// The same with the code of effects that the world does not call for, as bits of [`code`]: to measure what they
/// cost, and to show that they change nothing.
pub fn integrator_with(world: &World, idle: u32) -> Box<dyn Integrator + '_> {
    use code::{CLEAR, DEEP, RARE, SEVERAL, SKY, VARIED};
    let bit = |has: bool, bit: u32| if has { bit } else { 0 };
    let called = bit(world.lights.len() > 1, SEVERAL)
        | bit(world.lights.has_sky(), SKY)
        | bit(world.max_depth > path::ROULETTE_FROM, DEEP)
        | bit(world.has_clear_surfaces(), CLEAR)
        | bit(world.is_rare(), RARE)
        | bit(world.is_varied(), VARIED);
    let wanted = called | idle;
    macro_rules! specialise {
        ($lens:ty, $always:expr, [$($bits:expr),*]) => {
            match wanted & !$always {
                $(b if b == $bits => Box::new(PathTracer::<$lens, { $bits | $always }>::new(world)) as Box<dyn Integrator + '_>,)*
                _ => Box::new(PathTracer::<$lens, { SEVERAL | SKY | DEEP | $always }>::new(world)),
            }
        };
    }
    // Each form takes seconds to compile. So lenses, which are rarer than glass, and glass, whose paths are long, have
    // fewer.
    if wanted & RARE != 0 || world.camera.is_general() {
        specialise!(General, CLEAR | RARE | DEEP | VARIED, [0, SEVERAL, SKY, SEVERAL | SKY])
    } else if world.camera.has_lens() {
        specialise!(ThinLens, CLEAR | DEEP | VARIED, [0, SEVERAL, SKY, SEVERAL | SKY])
    } else if wanted & CLEAR != 0 {
        specialise!(Pinhole, CLEAR | DEEP | VARIED, [0, SEVERAL, SKY, SEVERAL | SKY])
    } else if wanted & (VARIED | SKY) != 0 {
        specialise!(
            Pinhole,
            VARIED,
            [0, SEVERAL, SKY, SEVERAL | SKY, DEEP, DEEP | SEVERAL, DEEP | SKY, DEEP | SEVERAL | SKY]
        )
    } else {
        match wanted {
            0 => Box::new(PathTracer::<Pinhole, 0>::new(world)),
            SEVERAL => Box::new(PathTracer::<Pinhole, SEVERAL>::new(world)),
            DEEP => Box::new(PathTracer::<Pinhole, DEEP>::new(world)),
            _ => Box::new(PathTracer::<Pinhole, { SEVERAL | DEEP }>::new(world)),
        }
    }
}
