//! Sampling importance: each pixel's weight, computed from the sampling rates of its first-hit rays and from the
//! variance of the lights' visibility over clusters.

use crate::first_hits::{self, BACKGROUND, ClusterHit, FirstHits, dot};
use crate::{ClusterSize, ClusterThesisOptions, Error, FirstHitRay, rates};
use dapple_clustering::Cluster;
use dapple_core::{PointSet, parallel, point_set::mix};
use std::sync::Arc;

/// An increasing map `f` that turns the ratio `x = SP / SC` of pixel area to cluster size into a sampling rate [Lan 2016, eq.
/// 3-3]. The thesis requires such a map but does not specify one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum RateMap {
    /// `f(x) = x` for the ratio `x` of pixel area to cluster size: every cluster gets the same number of samples, as in
    /// the text of [Lan 2016].
    Identity,
    /// `f(x) = sqrt(x)` for the ratio `x` of pixel area to cluster size, the default: rates vary less than with
    /// [`RateMap::Identity`].
    #[default]
    Root,
    /// `f(x) = ln(1 + x / m)`, with `m` the median over first-hit rays of the ratio `x` of pixel area to cluster size. Nearly
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
            // The median is 0 only if half of all first-hit rays have a footprint of 0.
            Self::Log if median > 0.0 => (x / median).ln_1p(),
            Self::Log => x.sqrt(),
        }
    }
}

/// The sampling importance of all pixels: weights to which sample counts are proportional.
#[derive(Clone, Debug, PartialEq)]
pub struct Importance {
    /// The importance of each pixel, row by row: finite, not negative, without unit. The mean over the image is
    /// `1 + angle + distance`, with the weights of [`ClusterThesisOptions`]; less if a term is zero in every pixel.
    pub per_pixel: Vec<f32>,
    /// The number of first-hit rays whose cluster's size is zero or not finite ([`Rates::replaced`](crate::Rates::replaced)).
    pub replaced: usize,
}

/// Computes the sampling importance of every pixel.
///
/// [Lan 2016, 2.5] describes it as "cluster share, plus weight for a large angle between cluster normal and view ray, plus
/// weight for distance", without a formula. The simplest formula is used:
///
/// `I_p = share_p / <share> + angle * a_p / <a> + distance * z_p / <z>`
///
/// Here `share` is the mean over the pixel's first-hit rays of `f(SP / SC)`, for pixel area `SP` and cluster size `SC`. `a` is
/// the mean of `1 - |n . d|`, with `d` the ray and `n` the cluster's mean normal (the surface's normal if the cluster's normals
/// cancel). `z` is the mean distance to the hit, and `< >` denotes the mean over the image. A term whose mean is 0 is left out.
/// First-hit rays without a hit add 0 to each term, except to the share with [`ClusterSize::Hits`].
///
/// Importance has no unit: scaling a scene changes it only by rounding of coordinates. (The published
/// [`PixelArea::One`](crate::PixelArea::One) is an area in world units. It is the same for all pixels and cancels.)
///
/// # Errors
///
/// [`Error::NoCluster`] if a first-hit ray has a cluster that is not in `clusters`; [`Error::OutOfRange`] for a weight that is
/// negative or not finite.
pub fn importance(
    first_hits: &FirstHits,
    clusters: &[Cluster],
    size: &ClusterSize,
    options: &ClusterThesisOptions,
) -> Result<Importance, Error> {
    options.check()?;
    let rates = rates(first_hits, clusters, size, options.pixel)?;
    let median = if options.map == RateMap::Log { median(first_hits, &rates.values) } else { 1.0 };
    let k = first_hits.placement().per_pixel() as usize;
    let terms = |pixel: usize| -> [f64; 3] {
        let (first_hits, rates) = (&first_hits.all()[k * pixel..][..k], &rates.values[k * pixel..][..k]);
        let of = |(p, &rate): (&ClusterHit, &f64)| {
            let oblique = if options.angle > 0.0 { obliquity(p, clusters) } else { 0.0 };
            [options.map.of(rate, median), oblique, f64::from(p.distance)]
        };
        first_hits.iter().zip(rates).map(of).fold([0.0; 3], plus)
    };
    let terms: Vec<[f64; 3]> = parallel::map(first_hits.all().len() / k, terms);
    // Summed in order, so that the sum does not depend on threads.
    let sums = terms.iter().copied().fold([0.0; 3], plus);
    let scale = |sum: f64, weight: f64| if sum > 0.0 { weight * terms.len() as f64 / sum } else { 0.0 };
    let [share, angle, distance] =
        [scale(sums[0], 1.0), scale(sums[1], options.angle), scale(sums[2], options.distance)];
    let of = |[s, a, z]: &[f64; 3]| (s * share + a * angle + z * distance) as f32;
    Ok(Importance { per_pixel: terms.iter().map(of).collect(), replaced: rates.replaced })
}

fn plus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// `1 - |cos|` of the angle between the first-hit ray and the mean normal of its cluster, or the surface's normal if the
/// cluster's normals cancel. 0 without a hit.
fn obliquity(first_hit: &ClusterHit, clusters: &[Cluster]) -> f64 {
    if first_hit.cluster == BACKGROUND {
        return 0.0;
    }
    let cosine = dot(clusters[first_hit.cluster as usize].normal, first_hit.direction).abs();
    let known = clusters[first_hit.cluster as usize].normal != [0.0; 3] && cosine.is_finite();
    (1.0 - if known { cosine } else { f64::from(first_hit.cosine) }).clamp(0.0, 1.0)
}

/// The lower median of the rates of first-hit rays with a hit; 1 if none has.
fn median(first_hits: &FirstHits, rates: &[f64]) -> f64 {
    let hits = first_hits.all().iter().zip(rates).filter(|(p, _)| p.cluster != BACKGROUND);
    let mut rates: Vec<f64> = hits.map(|(_, &r)| r).collect();
    match rates.len() {
        0 => 1.0,
        n => *rates.select_nth_unstable_by((n - 1) / 2, f64::total_cmp).1,
    }
}

/// The caller's function that traces a shadow ray from a first hit to a random point on the lights.
///
/// Three numbers in `[0, 1)` select a light and a point on it. The function returns `true` if the point is visible from the hit
/// of the first-hit ray. It returns `false` if the point is occluded, the ray misses, or there is no light. It must be pure.
pub type TraceVisibility = Arc<dyn Fn(FirstHitRay, [f32; 3]) -> bool + Send + Sync>;

/// The seed of all shadow rays.
const SEED: u64 = 0x51ab_71e5;

/// The steps of an additive recurrence in three dimensions: powers of the inverse of the root of `x^4 = x + 1`.
const STEPS: [f64; 3] = [0.819_172_513_396_164_4, 0.671_043_606_703_789_3, 0.549_700_477_901_970_3];

/// The variance `v (1 - v)` of the lights' visibility over each of the `clusters` clusters, from 0 to 1/4. `v` is the fraction
/// of the cluster's shadow rays that reach a light.
///
/// Each cluster that first-hit rays hit gets `rays` shadow rays, which start at an even selection of these hits. Random numbers
/// have a fixed seed. Clusters without a hit have variance 0. `points` is the point set of the first-hit rays.
///
/// # Errors
///
/// [`Error::NoCluster`] if a first-hit ray has a cluster that is not below `clusters`.
pub fn visibility_variances(
    first_hits: &FirstHits,
    clusters: usize,
    points: &dyn PointSet,
    rays: u32,
    is_visible: &(dyn Fn(FirstHitRay, [f32; 3]) -> bool + Sync),
) -> Result<Vec<f32>, Error> {
    // The indices of the first-hit rays, sorted by cluster.
    let counts = first_hits.class_counts(clusters)?;
    let mut ends: Vec<usize> =
        counts[..clusters].iter().scan(0, |end, &n| Some(std::mem::replace(end, *end + n as usize))).collect();
    let mut sorted = vec![0u32; first_hits.all().len() - counts[clusters] as usize];
    for (i, first_hit) in first_hits.all().iter().enumerate().filter(|(_, first_hit)| first_hit.cluster != BACKGROUND) {
        let end = &mut ends[first_hit.cluster as usize];
        sorted[*end] = i as u32;
        *end += 1;
    }
    let variance = |cluster: usize| {
        let hits = &sorted[ends[cluster] - counts[cluster] as usize..ends[cluster]];
        if hits.is_empty() {
            return 0.0;
        }
        let reaches = |k: &u32| {
            let name = SEED ^ (cluster as u64) << 32;
            let spread = (f64::from(*k) + unit(mix(name ^ u64::from(*k)))) / f64::from(rays);
            let hit = hits[((spread * hits.len() as f64) as usize).min(hits.len() - 1)];
            let shifted = |axis: usize| (unit(mix(name ^ 1 << 31 ^ axis as u64)) + f64::from(*k) * STEPS[axis]).fract();
            // Rounded down, since coordinates are below 1.
            let light = [0, 1, 2].map(|axis| (shifted(axis) as f32).min(1.0f32.next_down()));
            is_visible(ray_of(first_hits, hit as usize, points), light)
        };
        let visible = (0..rays).filter(reaches).count() as f64 / f64::from(rays);
        (visible * (1.0 - visible)) as f32
    };
    Ok(parallel::map(clusters, variance))
}

/// A number in `[0, 1)`.
fn unit(hash: u64) -> f64 {
    (hash >> 11) as f64 / (1u64 << 53) as f64
}

/// The `i`-th first-hit ray.
fn ray_of(first_hits: &FirstHits, i: usize, points: &dyn PointSet) -> FirstHitRay {
    let k = first_hits.placement().per_pixel() as usize;
    first_hits::ray(first_hits.frame().pixel(i / k), (i % k) as u64, first_hits.placement(), points)
}

impl Importance {
    /// Multiplies each pixel's importance by the mean over its first-hit rays of `1 + variances[cluster]`. First-hit rays
    /// without a hit count as 1.
    pub(crate) fn raise(&mut self, first_hits: &FirstHits, variances: &[f32]) {
        let k = first_hits.placement().per_pixel() as usize;
        let factor = |cluster: u32| 1.0 + variances.get(cluster as usize).map_or(0.0, |&v| f64::from(v));
        for (importance, first_hits) in self.per_pixel.iter_mut().zip(first_hits.all().chunks_exact(k)) {
            let mean = first_hits.iter().map(|first_hit| factor(first_hit.cluster)).sum::<f64>() / k as f64;
            *importance = (f64::from(*importance) * mean) as f32;
        }
    }
}
