//! The blocks of random numbers that integrators use. A block is four dimensions of a sample.
//!
//! An effect that a scene lacks requests no block. The random numbers of other blocks do not depend on it.

use dapple_core::Block;

/// The block for the position in the pixel (dimensions 0 and 1) and the point on the lens (2 and 3).
pub const CAMERA: Block = Block::new(0);

/// The block for time: dimension 0 is the time within the exposure. Requested only in scenes with motion.
pub const TIME: Block = Block::new(1 << 30);

/// The first block for the light point and scattered direction of path vertices; see [`scatter`].
const SCATTER: Block = Block::new(1);
/// The first block for discrete choices at path vertices; see [`choose`].
const CHOOSE: Block = Block::new(2);
/// The distance between the blocks of successive path vertices.
const STRIDE: u32 = 2;

/// The first block for events along a ray through a medium; see [`medium`].
const MEDIUM: Block = Block::new(1 << 28);
/// The first block for hits at surfaces that rays may pass without scattering; see [`surface`].
const SURFACE: Block = Block::new(1 << 29);

/// Returns the block for a scattering event: the point on a light (dimensions 0 and 1) and the scattered direction (2 and 3).
/// `vertex` is the number of scattering events before this one.
#[inline]
pub const fn scatter(vertex: u32) -> Block {
    SCATTER.at(vertex, STRIDE)
}

/// Returns the block for the choices at a scattering event: the light (dimension 0), the BSDF lobe (1) and Russian roulette
/// (2). `vertex` is the number of scattering events before this one.
///
/// Requested only where at least one of these choices has several outcomes.
#[inline]
pub const fn choose(vertex: u32) -> Block {
    CHOOSE.at(vertex, STRIDE)
}

/// Returns the block for a ray in a medium: the color channel (dimension 0), the distance (1) and the scattered direction (2
/// and 3). `ray` is the ray's number on the path: 1 for the camera ray; shadow rays have no number.
///
/// Requested only in media that scatter.
#[inline]
pub const fn medium(ray: u32) -> Block {
    MEDIUM.at(ray, 1)
}

/// Returns the block for a hit at a surface with alpha or mixed materials: the opacity test (dimension 0) and the selection of
/// a material (1). `ray` is the ray's number, as in [`medium`].
///
/// Requested only where alpha is between 0 and 1 or materials are mixed.
#[inline]
pub const fn surface(ray: u32) -> Block {
    SURFACE.at(ray, 1)
}
