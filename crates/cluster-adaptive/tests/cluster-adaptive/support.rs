//! Made-up surfaces, and plans of them.
#![allow(unreachable_pub)]

use dapple_cluster_adaptive::{
    ClusterSize, ClusterThesis, ClusterThesisOptions, FirstHitRay, FirstHitSource, FirstHitSurface, FirstHits,
    Placement, first_hits,
};
use dapple_clustering::Cluster;
use dapple_core::plan::{Plan, Progress};
use dapple_core::{Error, Film, Frame, Sampler};
use dapple_low_discrepancy::Random;

/// A cluster that fills this box, facing z.
pub fn cluster(low: [f32; 3], high: [f32; 3]) -> Cluster {
    Cluster { triangles: 2, bounds: [low, high], area: 1.0, normal: [0.0, 0.0, 1.0], cone: 1.0, material: 0, group: 0 }
}

/// A flat square of this area, facing z.
pub fn square(area: f32) -> Cluster {
    cluster([0.0; 3], [area, 1.0, 0.0])
}

/// A hit seen along z, at distance 2, where pixels have size 1.
pub fn hit(primitive: u32) -> FirstHitSurface {
    FirstHitSurface { primitive, direction: [0.0, 0.0, -1.0], distance: 2.0, normal: [0.0, 0.0, 1.0], footprint: 1.0 }
}

/// A scene for every frame: sky above, three clusters of columns, and a floor. The clusters' sizes differ by factors of
/// hundreds, and one is seen from the side.
pub fn scene(ray: FirstHitRay) -> Option<FirstHitSurface> {
    let [x, y] = ray.film;
    if y < 1.5 && x > 2.5 {
        return None;
    }
    let primitive = if y > 12.0 { 3 } else { (x * 0.3) as u32 % 3 };
    let direction = [0.1 * primitive as f32, 0.0, -1.0];
    Some(FirstHitSurface { direction, distance: 1.0 + y, footprint: 0.01 * (1.0 + y), ..hit(primitive) })
}

pub fn clusters() -> Vec<Cluster> {
    vec![
        cluster([0.0; 3], [1.0, 2.0, 0.5]),
        cluster([0.0; 3], [0.1, 0.1, 0.0]),
        Cluster { normal: [1.0, 0.0, 0.0], ..cluster([0.0; 3], [0.0, 1.0, 1.0]) },
        Cluster { normal: [0.0; 3], ..cluster([-50.0, 0.0, -50.0], [50.0, 0.0, 50.0]) },
    ]
}

pub const LABELS: [u32; 4] = [0, 1, 2, 3];

pub fn frame(width: u32, height: u32) -> Frame {
    Frame::new(width, height).unwrap()
}

pub fn seen(frame: &Frame, placement: Placement) -> FirstHits {
    first_hits(frame, placement, &Random::new(3), &LABELS, scene).unwrap()
}

pub fn tracing(
    seed: u64,
    placement: Placement,
    size: ClusterSize,
    options: ClusterThesisOptions,
) -> ClusterThesis<Random> {
    let (labels, clusters) = (LABELS.into(), clusters().into());
    let source =
        FirstHitSource { labels, clusters, shoot: std::sync::Arc::new(scene), placement, described: String::new() };
    ClusterThesis::tracing(Random::new(seed), source, size, options).unwrap()
}

/// A camera at the origin along -z, 90 degrees wide.
pub const LOOK: [[f32; 4]; 4] =
    [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, -1.0, 0.0]];

/// The counts of a first round, by the rules of the render loop.
pub fn first_counts(sampler: &mut dyn Sampler, frame: Frame, total: u64, bounds: [u32; 2]) -> Result<Vec<u32>, Error> {
    let film = Film::new(frame, sampler.needs());
    let budget = dapple_core::plan::BudgetLeft::new(total).with_min_spp(bounds[0]).with_max_spp(bounds[1]);
    let mut plan = Plan::empty(frame.pixels());
    match sampler.next_round(&dapple_core::plan::Feedback::new(0, &film, budget), &mut plan)? {
        Progress::Trace => Ok(plan.counts),
        Progress::Done => Ok(vec![0; frame.pixels()]),
    }
}

/// The counts of a sampler planned from first-hit rays, for so many samples in all.
pub fn planned(
    first_hits: &FirstHits,
    clusters: &[Cluster],
    size: ClusterSize,
    options: ClusterThesisOptions,
    total: u64,
) -> Vec<u32> {
    let mut sampler = ClusterThesis::with_options(Random::new(1), first_hits, clusters, size, options).unwrap();
    let counts = first_counts(&mut sampler, *first_hits.frame(), total, [1, 1000]).unwrap();
    assert_eq!(sum(&counts), total);
    counts
}

/// The first-hit rays through the centres of a frame's pixels.
pub fn centres(
    frame: Frame,
    labels: &[u32],
    shoot: impl Fn(FirstHitRay) -> Option<FirstHitSurface> + Sync,
) -> FirstHits {
    first_hits(&frame, Placement::Centre, &Random::new(1), labels, shoot).unwrap()
}

pub fn sum(counts: &[u32]) -> u64 {
    counts.iter().map(|&n| u64::from(n)).sum()
}
