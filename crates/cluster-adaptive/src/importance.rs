//! Sampling importance: each pixel's weight, computed from the sampling rates of its probes.

use crate::probe::{BACKGROUND, Probe, Probes, dot};
use crate::{ClusterSize, ClusterThesisOptions, Error, rates};
use dapple_clustering::Cluster;
use rayon::prelude::*;

/// The increasing map `f` from the ratio `x = SP / SC` of pixel area to cluster size to a sampling rate [Lan 2016, eq.
/// 3-3]. The thesis requires such a map and gives none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum RateMap {
    /// `f(x) = x` for the ratio `x` of pixel area to cluster size: every cluster gets the same number of samples, as in
    /// the text of [Lan 2016].
    Identity,
    /// `f(x) = sqrt(x)` for the ratio `x` of pixel area to cluster size, the default: rates vary less than with
    /// [`RateMap::Identity`].
    #[default]
    Root,
    /// `f(x) = ln(1 + x / m)`, with `m` the median over probes of the ratio `x` of pixel area to cluster size. Nearly
    /// proportional to `x` for clusters larger than most, logarithmic for smaller ones.
    Log,
}

dapple_core::choices!(RateMap { Identity = "identity", Root = "root", Log = "log" });

impl RateMap {
    /// Returns `f(x)` for a ratio `x >= 0`; `median` is the `m` of [`RateMap::Log`].
    fn of(self, x: f64, median: f64) -> f64 {
        match self {
            Self::Identity => x,
            Self::Root => x.sqrt(),
            // A median of 0 needs a footprint of 0 in half of all probes.
            Self::Log if median > 0.0 => (x / median).ln_1p(),
            Self::Log => x.sqrt(),
        }
    }
}

/// The sampling importance of all pixels: weights in proportion to which samples are distributed.
#[derive(Clone, Debug, PartialEq)]
pub struct Importance {
    /// The importance of each pixel of the window, row by row: finite, not negative, without unit. If no term is left
    /// out, the mean over the image is `1 + angle + distance`.
    pub per_pixel: Vec<f32>,
    /// The number of probes whose cluster has no size ([`Rates::replaced`](crate::Rates::replaced)).
    pub replaced: usize,
}

/// The sampling importance of every pixel.
///
/// [Lan 2016, 2.5] calls it "cluster share, plus weight for a large angle between cluster normal and view ray, plus
/// weight for distance", and gives no formula. This is the simplest one:
///
/// `I_p = share_p / <share> + angle * a_p / <a> + distance * z_p / <z>`
///
/// Here `share` is the mean over the pixel's probes of `f(SP / SC)`, for pixel area `SP` and cluster size `SC`. `a` is
/// the mean of `1 - |n . d|`, with `d` the ray and `n` the cluster's mean normal (the surface's where normals cancel).
/// `z` is the mean distance to the hit, and `< >` the mean over the image. A term whose mean is 0 is left out. Probes
/// without a hit add 0 to each term, except to the share with [`ClusterSize::Hits`].
///
/// Importance has no unit: a scaled scene has the same importance, except for the rounding of its coordinates. (The
/// published [`PixelArea::One`](crate::PixelArea::One) is an area in world units. It is the same for all pixels and
/// cancels in the mean.) Values are rounded to `f32`, which hides the last digits of `f64`.
///
/// # Errors
///
/// [`Error::NoCluster`] if a probe has a cluster that is not in `clusters`; [`Error::OutOfRange`] for a weight that is
/// negative or not finite.
pub fn importance(
    probes: &Probes,
    clusters: &[Cluster],
    size: &ClusterSize,
    options: &ClusterThesisOptions,
) -> Result<Importance, Error> {
    options.check()?;
    let rates = rates(probes, clusters, size, options.pixel)?;
    let median = if options.map == RateMap::Log { median(probes, &rates.values) } else { 1.0 };
    let k = probes.placement().per_pixel() as usize;
    let terms = |(probes, rates): (&[Probe], &[f64])| -> [f64; 3] {
        let of = |(p, &rate): (&Probe, &f64)| {
            let oblique = if options.angle > 0.0 { obliquity(p, clusters) } else { 0.0 };
            [options.map.of(rate, median), oblique, f64::from(p.distance)]
        };
        probes.iter().zip(rates).map(of).fold([0.0; 3], plus)
    };
    let pixels = probes.all().par_chunks_exact(k).zip(rates.values.par_chunks_exact(k)).with_min_len(4096);
    let terms: Vec<[f64; 3]> = pixels.map(terms).collect();
    // Summed in order: the sum does not depend on threads.
    let sums = terms.iter().copied().fold([0.0; 3], plus);
    let scale = |sum: f64, weight: f64| if sum > 0.0 { weight * terms.len() as f64 / sum } else { 0.0 };
    let [share, angle, distance] =
        [scale(sums[0], 1.0), scale(sums[1], options.angle), scale(sums[2], options.distance)];
    let of = |[s, a, z]: &[f64; 3]| (s * share + a * angle + z * distance) as f32;
    Ok(Importance { per_pixel: terms.par_iter().with_min_len(4096).map(of).collect(), replaced: rates.replaced })
}

fn plus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// `1 - |cos|` of the angle between the probe's ray and its cluster's mean normal, or the surface's normal where the
/// cluster's normals cancel. 0 without a hit.
fn obliquity(probe: &Probe, clusters: &[Cluster]) -> f64 {
    if probe.cluster == BACKGROUND {
        return 0.0;
    }
    let cosine = dot(clusters[probe.cluster as usize].normal, probe.direction).abs();
    let known = clusters[probe.cluster as usize].normal != [0.0; 3] && cosine.is_finite();
    (1.0 - if known { cosine } else { f64::from(probe.cosine) }).clamp(0.0, 1.0)
}

/// The lower median of the rates of probes with a hit; 1 if no probe has a hit.
fn median(probes: &Probes, rates: &[f64]) -> f64 {
    let hits = probes.all().iter().zip(rates).filter(|(p, _)| p.cluster != BACKGROUND);
    let mut rates: Vec<f64> = hits.map(|(_, &r)| r).collect();
    match rates.len() {
        0 => 1.0,
        n => *rates.select_nth_unstable_by((n - 1) / 2, f64::total_cmp).1,
    }
}
