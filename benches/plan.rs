//! The cost of a plan on one thread, excluding the caller's rays. Divide by 2^18 for the cost per pixel.
//!
//! With one first-hit ray per pixel, in callgrind's instructions per pixel (x86-64, release): tracing first-hit rays 160,
//! importance 285, counts 250. This is about 75 ns in total. A jittered first-hit ray needs 260 more for its coordinates.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use dapple_cluster_adaptive::{
    AreaVectors, ClusterSize, ClusterThesis, ClusterThesisOptions, FirstHitRay, FirstHitSurface, PixelArea, Placement,
    RateMap, first_hits, importance, rates,
};
use dapple_clustering::{Cluster, Triangles};
use dapple_core::plan::{BudgetLeft, Feedback, Plan, share};
use dapple_core::{Film, Frame, Needs, Sampler};
use dapple_low_discrepancy::Sobol;
use std::hint::black_box;

const SIDE: u32 = 512;
const CLUSTERS: u32 = 4096;

fn frame() -> Frame {
    Frame::new(SIDE, SIDE).expect("a frame")
}

/// Returns hits as if each 8 x 8 pixels showed one cluster, with sky above.
fn shoot(ray: FirstHitRay) -> Option<FirstHitSurface> {
    let [x, y] = ray.pixel;
    let primitive = (y / 8) * (SIDE / 8) + x / 8;
    let direction = [ray.film[0] * 1e-3, 0.3, -0.9];
    let distance = 1.0 + 0.01 * y as f32;
    (y >= 64).then_some(FirstHitSurface { primitive, direction, distance, normal: [0.0, 0.0, 1.0], footprint: 0.01 })
}

fn clusters() -> Vec<Cluster> {
    let of = |i: u32| {
        let size = 0.1 + (i % 97) as f32 * 0.05;
        Cluster {
            triangles: 2,
            bounds: [[0.0; 3], [size, size * 1.5, 0.1]],
            area: 1.0,
            normal: [0.0, 0.6, 0.8],
            cone: 0.99,
            material: 0,
            group: 0,
        }
    };
    (0..CLUSTERS).map(of).collect()
}

/// A tent of four triangles for each cluster.
fn area_vectors() -> AreaVectors {
    let positions = [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]];
    let tent = [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1]];
    let indices: Vec<[u32; 3]> = (0..CLUSTERS).flat_map(|_| tent).collect();
    let labels: Vec<u32> = (0..4 * CLUSTERS).map(|t| t / 4).collect();
    let triangles = Triangles::new(&positions, &indices);
    AreaVectors::new(&triangles, &labels, CLUSTERS as usize).expect("labels that fit")
}

fn bench(c: &mut Criterion) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool");
    let (frame, clusters, points) = (frame(), clusters(), Sobol::new(1));
    let labels: Vec<u32> = (0..CLUSTERS).collect();
    let mut group = c.benchmark_group("plan");
    group.throughput(Throughput::Elements(frame.pixels() as u64));
    group.bench_function("first-hits/centre", |b| {
        b.iter(|| pool.install(|| first_hits(&frame, Placement::Centre, &points, &labels, shoot)));
    });
    group.bench_function("first-hits/jittered-4", |b| {
        b.iter(|| pool.install(|| first_hits(&frame, Placement::Jittered(4), &points, &labels, shoot)));
    });
    let first_hits =
        pool.install(|| first_hits(&frame, Placement::Centre, &points, &labels, shoot)).expect("labels that fit");
    let screen = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0; 4], [0.0, 0.0, -1.0, 3.0]];
    for size in [
        ClusterSize::ProjectedBox,
        ClusterSize::ProjectedTriangles(area_vectors()),
        ClusterSize::ScreenBox(screen),
        ClusterSize::Hits,
    ] {
        group.bench_function(format!("rates/{}", size.name()), |b| {
            b.iter(|| pool.install(|| rates(black_box(&first_hits), &clusters, &size, PixelArea::One)));
        });
    }
    for map in [RateMap::Identity, RateMap::Root, RateMap::Log] {
        let options = ClusterThesisOptions::default().map(map);
        group.bench_function(format!("importance/{}", map.name()), |b| {
            b.iter(|| {
                pool.install(|| importance(black_box(&first_hits), &clusters, &ClusterSize::ProjectedBox, &options))
            });
        });
    }
    let known = importance(&first_hits, &clusters, &ClusterSize::ProjectedBox, &ClusterThesisOptions::default())
        .expect("clusters");
    let weights: Vec<f64> = known.per_pixel.iter().map(|&i| f64::from(i)).collect();
    let floors = vec![0; weights.len()];
    let total = 16 * frame.pixels() as u64;
    group.bench_function("share", |b| {
        b.iter(|| pool.install(|| share(black_box(&weights), 12, &floors, 32, total)));
    });
    let film = Film::new(frame, Needs::none());
    let mut sampler = ClusterThesis::published(points, &first_hits, &clusters).expect("clusters");
    group.bench_function("next_round", |b| {
        b.iter(|| {
            let mut plan = Plan::empty(frame.pixels());
            let budget = BudgetLeft::new(total);
            let seen = Feedback::new(0, &film, budget);
            pool.install(|| sampler.next_round(&seen, &mut plan)).map(|_| plan)
        });
    });
}

criterion_group!(benches, bench);
criterion_main!(benches);
