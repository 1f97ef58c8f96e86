//! The variance of the lights' visibility over clusters.

use crate::probe::{self, BACKGROUND, Probes};
use crate::{Error, Importance, ProbeRay};
use dapple_core::{PointSet, mix};
use rayon::prelude::*;
use std::sync::Arc;

/// The caller's function that traces a shadow ray from the first hit of a probe ray to a random point of the lights.
///
/// Three numbers in `[0, 1)` select a light and a point on it. It returns `true` if nothing is between, and `false` without a
/// hit or without light. It must be pure.
pub type TraceVisibility = Arc<dyn Fn(ProbeRay, [f32; 3]) -> bool + Send + Sync>;

/// The seed of all shadow rays.
const SEED: u64 = 0x51ab_71e5;

/// The steps of an additive recurrence in three dimensions: powers of the inverse of the root of `x^4 = x + 1`.
const STEPS: [f64; 3] = [0.819_172_513_396_164_4, 0.671_043_606_703_789_3, 0.549_700_477_901_970_3];

/// The variance `v (1 - v)` of the lights' visibility over each of `clusters` clusters, 0 to 1/4. `v` is the fraction of
/// shadow rays that reach a light.
///
/// Each cluster that a probe hit gets `rays` shadow rays, from the hits of evenly spread probes. Random numbers have a fixed
/// seed. Clusters without a hit have variance 0. `points` are those of the probes.
///
/// # Errors
///
/// [`Error::NoCluster`] if a probe has a cluster that is not below `clusters`.
pub fn visibility_variances(
    probes: &Probes,
    clusters: usize,
    points: &dyn PointSet,
    rays: u32,
    is_visible: &(dyn Fn(ProbeRay, [f32; 3]) -> bool + Sync),
) -> Result<Vec<f32>, Error> {
    // The probes of each cluster, cluster by cluster.
    let counts = probes.class_counts(clusters)?;
    let mut ends: Vec<usize> = counts[..clusters].iter().scan(0, |start, &n| Some(replace_added(start, n))).collect();
    let mut sorted = vec![0u32; probes.all().len() - counts[clusters] as usize];
    for (i, probe) in probes.all().iter().enumerate().filter(|(_, probe)| probe.cluster != BACKGROUND) {
        let end = &mut ends[probe.cluster as usize];
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
            // Rounded down, since 1 is no coordinate.
            let light = [0, 1, 2].map(|axis| (shifted(axis) as f32).min(1.0f32.next_down()));
            is_visible(ray_of(probes, hit as usize, points), light)
        };
        let visible = (0..rays).filter(reaches).count() as f64 / f64::from(rays);
        (visible * (1.0 - visible)) as f32
    };
    Ok((0..clusters).into_par_iter().map(variance).collect())
}

/// Adds `n` and returns the former value.
fn replace_added(sum: &mut usize, n: u64) -> usize {
    let before = *sum;
    *sum += n as usize;
    before
}

/// A number in `[0, 1)`.
fn unit(hash: u64) -> f64 {
    (hash >> 11) as f64 / (1u64 << 53) as f64
}

/// The ray of the `i`-th probe.
fn ray_of(probes: &Probes, i: usize, points: &dyn PointSet) -> ProbeRay {
    let k = probes.placement().per_pixel() as usize;
    probe::ray(probes.frame().pixel(i / k), (i % k) as u64, probes.placement(), points)
}

impl Importance {
    /// Multiplies each pixel's importance by the mean over its probes of `1 + variances[cluster]`. Probes without a hit count
    /// as 1.
    pub(crate) fn raise(&mut self, probes: &Probes, variances: &[f32]) {
        let k = probes.placement().per_pixel() as usize;
        let factor = |cluster: u32| 1.0 + variances.get(cluster as usize).map_or(0.0, |&v| f64::from(v));
        for (importance, probes) in self.per_pixel.iter_mut().zip(probes.all().chunks_exact(k)) {
            let mean = probes.iter().map(|probe| factor(probe.cluster)).sum::<f64>() / k as f64;
            *importance = (f64::from(*importance) * mean) as f32;
        }
    }
}
