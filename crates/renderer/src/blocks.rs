//! The names of the renderer's uses of randomness: four coordinates each.

use dapple_core::Block;

/// Place in the pixel (0, 1) and on the lens (2, 3).
pub const CAMERA: Block = Block::new(0);

/// When the shutter lets the sample in (0): asked for only where something moves.
pub const TIME: Block = Block::new(1 << 30);

/// What a path vertex scatters: the point on a light (0, 1) and the direction it is left in (2, 3).
const SCATTER: Block = Block::new(1);
/// What a path vertex chooses: the light (0), the lobe (1), whether the path survives (2).
const CHOOSE: Block = Block::new(2);
/// Blocks per path vertex.
const STRIDE: u32 = 2;

/// What happens on the way through a medium: the channel (0) and the distance (1); the direction it is left in
/// (2, 3).
const MEDIUM: Block = Block::new(1 << 28);
/// What is met on the way: whether a surface is there (0), and which of a mixture's materials it has (1).
const MEET: Block = Block::new(1 << 29);

/// Light point and direction of the `vertex`-th scattering event, from 0.
#[inline]
pub const fn scatter(vertex: u32) -> Block {
    SCATTER.at(vertex, STRIDE)
}

/// Choices of the `vertex`-th scattering event, from 0: asked for only where there is a choice.
#[inline]
pub const fn choose(vertex: u32) -> Block {
    CHOOSE.at(vertex, STRIDE)
}

/// The way to the `ray`-th hit of a path, from 0: asked for only in a medium that scatters.
#[inline]
pub const fn medium(ray: u32) -> Block {
    MEDIUM.at(ray, 1)
}

/// The `ray`-th hit of a path, from 0: asked for only where alpha is between 0 and 1, or materials are mixed.
#[inline]
pub const fn meet(ray: u32) -> Block {
    MEET.at(ray, 1)
}
