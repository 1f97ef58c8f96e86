//! Parameter checks and needs that several filters share.

use crate::tile::REACH;
use dapple_core::{Error, Needs};

/// The statistics that the film must record for a filter over halves and features.
pub(crate) const NEEDS: Needs = Needs::none().with_variance().with_halves().with_features();

/// Returns the error for the parameter `name` out of range.
pub(crate) fn out<T>(name: &'static str, value: impl ToString, allowed: &'static str) -> Result<T, Error> {
    Err(Error::OutOfRange { name, value: value.to_string(), allowed })
}

/// Requires a bandwidth in 0.001 ..= 1000 standard deviations.
pub(crate) fn bandwidth(name: &'static str, value: f64) -> Result<(), Error> {
    if (1e-3..=1e3).contains(&value) { Ok(()) } else { out(name, value, "0.001 to 1000 standard deviations") }
}

/// Requires a radius of at most `most` pixels, 7 or 3.
pub(crate) fn radius(name: &'static str, value: usize, most: usize) -> Result<usize, Error> {
    let allowed = if most == REACH { "0 to 7 pixels to each side" } else { "0 to 3 pixels to each side" };
    if value <= most { Ok(value) } else { out(name, value, allowed) }
}

/// Requires the weight of pixels in other clusters to lie in 0 ..= 1.
pub(crate) fn outside_weight(value: f64) -> Result<f64, Error> {
    let allowed = "0 (nothing crosses a border) to 1 (clusters do not matter)";
    if (0.0..=1.0).contains(&value) { Ok(value) } else { out("outside", value, allowed) }
}
