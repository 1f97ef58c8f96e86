//! The named groups of random numbers that integrators draw, four dimensions each.
//!
//! An effect that is off draws no group, and leaves all other groups' numbers unchanged.

use dapple_core::Block;

/// The position in the pixel (0, 1) and on the lens (2, 3).
pub const CAMERA: Block = Block::new(0);

/// The time within the exposure (0). Requested only where something moves.
pub const TIME: Block = Block::new(1 << 30);

/// First group for directions at a path vertex.
const SCATTER: Block = Block::new(1);
/// First group for choices at a path vertex.
const CHOOSE: Block = Block::new(2);
/// Groups per path vertex.
const STRIDE: u32 = 2;

/// First group for events along a ray through a medium.
const MEDIUM: Block = Block::new(1 << 28);
/// First group for events at a surface that rays may pass.
const SURFACE: Block = Block::new(1 << 29);

/// The point on a light (0, 1) and the scattered direction (2, 3) of the `vertex`-th scattering event, from 0.
#[inline]
pub const fn scatter(vertex: u32) -> Block {
    SCATTER.at(vertex, STRIDE)
}

/// The light (0), the lobe (1) and Russian roulette (2) of the `vertex`-th scattering event, from 0.
///
/// Requested only where there is a choice.
#[inline]
pub const fn choose(vertex: u32) -> Block {
    CHOOSE.at(vertex, STRIDE)
}

/// The color channel (0), the distance (1) and the scattered direction (2, 3) on the `ray`-th ray of a path, from 0.
///
/// Requested only in a medium that scatters.
#[inline]
pub const fn medium(ray: u32) -> Block {
    MEDIUM.at(ray, 1)
}

/// Opacity (0) and material of a mix (1) at the `ray`-th hit of a path, from 0.
///
/// Requested only where alpha is between 0 and 1, or materials are mixed.
#[inline]
pub const fn surface(ray: u32) -> Block {
    SURFACE.at(ray, 1)
}
