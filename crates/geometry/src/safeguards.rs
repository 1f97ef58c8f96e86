//! What keeps rays right, and can be left out of a build to see what it costs and what it is good for: see
//! `examples/price_of_rays.rs`. Not a feature, since nobody should have it by accident: `RUSTFLAGS='--cfg
//! dapple_without="padding"'`.

/// Triangles are finished in f64 where f32 cannot tell.
pub(crate) const EXACT: bool = !cfg!(dapple_without = "exact");
/// Boxes grow by what rounding asks for, and are left a little later than computed.
pub(crate) const PADDING: bool = !cfg!(dapple_without = "padding");
/// Of hits at the same distance the smallest number wins.
pub(crate) const TIES: bool = !cfg!(dapple_without = "ties");
/// Rays leave surfaces by a bound on the point's error; else by a fixed distance.
pub(crate) const OFFSETS: bool = !cfg!(dapple_without = "offsets");
