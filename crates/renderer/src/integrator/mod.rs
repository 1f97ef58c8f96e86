//! Integrators: what a sample of a pixel is worth.

mod guide;
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
    /// A choice among lights that is learned.
    pub const GUIDED: u32 = 64;
}

/// The integrator that a world calls for: path tracing without the code of effects that it does not
/// have.
///
/// One `match` chooses among the specialised forms, by [`code`] and by the lens: the least that has all that is called for. Lights and materials decide by
/// their own kind. Images do not depend on the choice, as long as it has all that the world calls for: see
/// [`integrator_with`].
pub fn integrator(world: &World) -> Box<dyn Integrator + '_> {
    integrator_with(world, 0)
}

/// The same with the code of effects that the world does not call for, as bits of [`code`]: to measure what they
/// cost, and to show that they change nothing.
pub fn integrator_with(world: &World, idle: u32) -> Box<dyn Integrator + '_> {
    use code::{CLEAR, DEEP, GUIDED, RARE, SEVERAL, SKY, VARIED};
    let bit = |has: bool, bit: u32| if has { bit } else { 0 };
    let called = bit(world.lights.len() > 1, SEVERAL)
        | bit(world.lights.has_sky(), SKY)
        | bit(world.max_depth > path::ROULETTE_FROM, DEEP)
        | bit(world.has_clear_surfaces(), CLEAR)
        | bit(world.is_rare(), RARE)
        | bit(world.is_varied(), VARIED)
        | bit(world.lights.is_choice_learned(), GUIDED);
    let wanted = called | idle;
    macro_rules! form {
        ($lens:ty, $code:expr) => {
            Box::new(PathTracer::<$lens, { $code }>::new(world)) as Box<dyn Integrator + '_>
        };
    }
    // Each form takes seconds to compile, so there is one where leaving code out pays: for light from beyond the scene, for
    // glass, for plain surfaces. A choice among lights and roulette, where they are not called for, are but a branch each.
    const MANY: u32 = SEVERAL | DEEP | VARIED;
    // This crate's own unit tests make do with two, so that the rest is not compiled twice; tests/ has the others.
    let general = cfg!(test) || wanted & RARE != 0 || world.camera.is_general();
    // Forms of their own for those that learn a choice, so that the others carry nothing of it.
    match (wanted & GUIDED != 0, general) {
        (true, true) => return form!(General, MANY | SKY | CLEAR | RARE | GUIDED),
        (true, _) if world.camera.has_lens() => return form!(ThinLens, MANY | SKY | CLEAR | GUIDED),
        (true, _) if wanted & CLEAR != 0 => return form!(Pinhole, MANY | SKY | CLEAR | GUIDED),
        (true, _) => return form!(Pinhole, MANY | SKY | GUIDED),
        (false, true) => return form!(General, MANY | SKY | CLEAR | RARE),
        (false, false) => {}
    }
    if world.camera.has_lens() {
        return form!(ThinLens, MANY | SKY | CLEAR);
    }
    match (wanted & CLEAR != 0, wanted & SKY != 0, wanted & VARIED != 0) {
        (true, true, _) => form!(Pinhole, MANY | SKY | CLEAR),
        (true, false, _) => form!(Pinhole, MANY | CLEAR),
        (false, true, _) => form!(Pinhole, MANY | SKY),
        (false, false, true) => form!(Pinhole, MANY),
        (false, false, false) => match wanted {
            0 => form!(Pinhole, 0),
            DEEP => form!(Pinhole, DEEP),
            _ => form!(Pinhole, SEVERAL | DEEP),
        },
    }
}
