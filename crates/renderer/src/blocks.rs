//! The names of the renderer's uses of randomness: four coordinates each.

use dapple_core::Block;

/// Place in the pixel (0, 1) and on the lens (2, 3).
pub const CAMERA: Block = Block::new(0);

/// What a path vertex scatters: the point on a light (0, 1) and the direction it is left in (2, 3).
const SCATTER: Block = Block::new(1);
/// What a path vertex chooses: the light (0), the lobe (1), whether the path survives (2).
const CHOOSE: Block = Block::new(2);
/// Blocks per path vertex.
const STRIDE: u32 = 2;

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
