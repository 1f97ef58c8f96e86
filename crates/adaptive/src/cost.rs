//! The cost of samples, in rays.

use crate::Sources;
use crate::pool::ratios_over_windows;
use dapple_core::Film;

/// The rays per sample of each pixel, pooled over a window, relative to the cheapest pixel: 1 or above.
///
/// The window is `2 radius + 1` pixels wide and high. Only the samples of `sources` count, so that a pixel's own paths do
/// not decide its counts where its own values must not. A sample takes at least one ray. Equal costs give exactly 1.
pub(crate) fn relative_costs(film: &Film, radius: u32, sources: Sources) -> Vec<f64> {
    let size = film.frame().size().map(|n| n as usize);
    let parts = |i: usize| {
        let samples = film.count(i) + film.discarded(i).count;
        [film.cost(i).unwrap_or(samples) as f64, samples as f64]
    };
    let mut costs = ratios_over_windows(size, (radius as usize, sources), parts);
    costs.iter_mut().for_each(|cost| *cost = cost.max(1.0));
    let least = costs.iter().copied().fold(f64::INFINITY, f64::min);
    costs.iter_mut().for_each(|cost| *cost /= least);
    costs
}
