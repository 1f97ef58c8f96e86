//! The effects that a path tracer has code for, as bits of its const parameter.
//!
//! Code whose bit is missing is not compiled. One parameter of bits replaces many type parameters; 13 of 384 possible
//! forms are built.

use crate::World;
use dapple_scene::Effect;

/// The number of scattering events after which Russian roulette starts. Almost all shorter paths are worth tracing to their
/// end.
pub(super) const ROULETTE_FROM: u32 = 4;
/// The bit for selection among several lights.
pub const SEVERAL_LIGHTS: u32 = 1;
/// The bit for light from environments, which rays find when they leave the scene.
pub const ENVIRONMENT: u32 = 2;
/// The bit for Russian roulette, needed if paths may have more than 4 scattering events.
pub const ROULETTE: u32 = 4;
/// The bit for surfaces that transmit light.
pub const TRANSMISSION: u32 = 8;
/// The bit for effects that few scenes have: media, alpha, interfaces between media, mixed materials and motion. At run time,
/// one predictable branch per effect skips the effects that the scene lacks.
pub const RARE: u32 = 16;
/// The bit for vertex normals, instances and all surfaces other than diffuse ones of constant color.
pub const VARIED: u32 = 32;
/// The bit for learned light selection. It selects a [`LearnedSelector`](super::LearnedSelector) and is not part of the path
/// tracer's const parameter.
pub const LEARNED_SELECTION: u32 = 64;

/// All bits except [`LEARNED_SELECTION`].
pub const ALL: u32 = SEVERAL_LIGHTS | ENVIRONMENT | ROULETTE | TRANSMISSION | RARE | VARIED;

/// Returns the bits that a world needs, from the [effects](World::effects) of its scene and from its surfaces.
///
/// Surfaces are inspected too, since diffuse transmission, interfaces, mixes, vertex normals and instances are not
/// listed as effects.
pub(super) fn needed(world: &World) -> u32 {
    let has = |effect| world.effects().has(effect);
    let bit = |needed: bool, bit: u32| if needed { bit } else { 0 };
    let media = has(Effect::AbsorbingMedia) || has(Effect::ScatteringMedia);
    let rare = media || has(Effect::MotionBlur) || has(Effect::Transparency) || world.has_passable_surfaces;
    bit(has(Effect::SeveralLights), SEVERAL_LIGHTS)
        | bit(has(Effect::Environment), ENVIRONMENT)
        | bit(world.max_depth() > ROULETTE_FROM, ROULETTE)
        | bit(world.has_transmission, TRANSMISSION)
        | bit(rare, RARE)
        | bit(world.has_varied_surfaces(), VARIED)
        | bit(world.lights().is_selection_learned(), LEARNED_SELECTION)
}
