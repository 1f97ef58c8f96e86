//! The named groups of random numbers that integrators draw, four dimensions each.
//!
//! An effect that is off draws no group, and leaves all other groups' numbers unchanged.

use dapple_core::Block;

/// The group for the position in the pixel (dimensions 0 and 1) and on the lens (2 and 3).
pub const CAMERA: Block = Block::new(0);

/// The group for the time within the exposure (dimension 0). Requested only where something moves.
pub const TIME: Block = Block::new(1 << 30);

/// The index of the first group for directions at a path vertex.
const SCATTER: Block = Block::new(1);
/// The index of the first group for choices at a path vertex.
const CHOOSE: Block = Block::new(2);
/// The number of groups per path vertex.
const STRIDE: u32 = 2;

/// First group for events along a ray through a medium.
const MEDIUM: Block = Block::new(1 << 28);
/// First group for events at a surface that rays may pass.
const SURFACE: Block = Block::new(1 << 29);

/// Returns the group for the point on a light (dimensions 0 and 1) and the scattered direction (2 and 3) of the
/// `vertex`-th scattering event, from 0.
#[inline]
pub const fn scatter(vertex: u32) -> Block {
    SCATTER.at(vertex, STRIDE)
}

/// Returns the group that selects the light (dimension 0), the BSDF lobe (1) and Russian roulette (2) of the
/// `vertex`-th scattering event, from 0.
///
/// Requested only where there is a choice.
#[inline]
pub const fn choose(vertex: u32) -> Block {
    CHOOSE.at(vertex, STRIDE)
}

/// Returns the group for the color channel (dimension 0), the distance (1) and the scattered direction (2 and 3) on the
/// `ray`-th ray of a path, from 0.
///
/// Requested only in a medium that scatters.
#[inline]
pub const fn medium(ray: u32) -> Block {
    MEDIUM.at(ray, 1)
}

/// Returns the group for opacity (dimension 0) and the material of a mix (1) at the `ray`-th hit of a path, from 0.
///
/// Requested only where alpha is between 0 and 1, or materials are mixed.
#[inline]
pub const fn surface(ray: u32) -> Block {
    SURFACE.at(ray, 1)
}
