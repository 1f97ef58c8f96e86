//! The effects that a path tracer has code for: bits of its type parameter.
//!
//! Code whose bit is missing is not compiled. Bits, not one type parameter each: 13 forms are built of the 384 possible.

use super::path::ROULETTE_FROM;
use crate::World;
use dapple_scene::Effect;

/// The bit for selection among several lights.
pub const SEVERAL_LIGHTS: u32 = 1;
/// The bit for light from environments.
pub const ENVIRONMENT: u32 = 2;
/// The bit for Russian roulette, needed if paths may be long enough.
pub const ROULETTE: u32 = 4;
/// The bit for surfaces that transmit light.
pub const TRANSMISSION: u32 = 8;
/// The bit for effects that few scenes have: media, alpha, interfaces, mixed materials and motion.
///
/// One predictable branch per effect decides at run time if it is present.
pub const RARE: u32 = 16;
/// The bit for surfaces other than diffuse ones of one colour, for vertex normals, and for instances.
pub const VARIED: u32 = 32;
/// The bit for learned light selection. It selects a [`LearnedSelector`](super::LearnedSelector) and is no bit of the
/// path tracer's code.
pub const LEARNED_SELECTION: u32 = 64;

/// Returns the bits of the code that a world needs, from the [effects](World::effects) of its scene and its surfaces.
///
/// Surfaces are inspected too, since paper, interfaces, mixes, vertex normals and instances are not effects.
pub(super) fn needed(world: &World) -> u32 {
    let has = |effect| world.effects().has(effect);
    let bit = |needed: bool, bit: u32| if needed { bit } else { 0 };
    let media = has(Effect::AbsorbingMedia) || has(Effect::ScatteringMedia);
    let rare = media || has(Effect::MotionBlur) || has(Effect::Transparency) || world.has_passable_surfaces();
    bit(has(Effect::SeveralLights), SEVERAL_LIGHTS)
        | bit(has(Effect::Environment), ENVIRONMENT)
        | bit(world.max_depth() > ROULETTE_FROM, ROULETTE)
        | bit(world.has_transmission(), TRANSMISSION)
        | bit(rare, RARE)
        | bit(world.has_varied_surfaces(), VARIED)
        | bit(world.lights().is_selection_learned(), LEARNED_SELECTION)
}
