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
    use code::{CLEAR, DEEP, RARE, SEVERAL, SKY};
    let bit = |has: bool, bit: u32| if has { bit } else { 0 };
    let called = bit(world.lights.len() > 1, SEVERAL)
        | bit(world.lights.has_sky(), SKY)
        | bit(world.max_depth > path::ROULETTE_FROM, DEEP)
        | bit(world.has_clear_surfaces(), CLEAR)
        | bit(world.is_rare(), RARE);
    let wanted = called | idle;
    macro_rules! specialise {
        ($lens:ty, $always:expr, [$($bits:expr),*]) => {
            match wanted & !$always {
                $(b if b == $bits => Box::new(PathTracer::<$lens, { $bits | $always }>::new(world)) as Box<dyn Integrator + '_>,)*
                _ => Box::new(PathTracer::<$lens, { SEVERAL | SKY | DEEP | $always }>::new(world)),
            }
        };
    }
    // Lenses are rarer than glass: fewer forms of their own.
    if wanted & RARE != 0 || world.camera.is_general() {
        specialise!(General, CLEAR | RARE | DEEP, [0, SEVERAL, SKY, SEVERAL | SKY])
    } else if world.camera.has_lens() {
        specialise!(ThinLens, CLEAR | DEEP, [0, SEVERAL, SKY, SEVERAL | SKY])
    } else {
        specialise!(
            Pinhole,
            0,
            [
                0,
                SEVERAL,
                SKY,
                SEVERAL | SKY,
                DEEP,
                DEEP | SEVERAL,
                DEEP | SKY,
                DEEP | SEVERAL | SKY,
                CLEAR,
                CLEAR | SEVERAL,
                CLEAR | SKY,
                CLEAR | SEVERAL | SKY,
                CLEAR | DEEP,
                CLEAR | DEEP | SEVERAL,
                CLEAR | DEEP | SKY,
                CLEAR | DEEP | SEVERAL | SKY
            ]
        )
    }
}
