//! The renderer of Dapple.

pub mod bundled;
pub mod files;
pub mod image;
pub mod pbrt;
pub mod ply;
pub mod scene;

/// Placeholder until the effects module lands.
#[doc(hidden)]
pub struct Effects;
/// Placeholder until the world module lands.
#[doc(hidden)]
pub struct World;
