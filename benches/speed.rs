//! Speed on the bundled scenes: clustering, whole renders and filters.
//!
//! ```sh
//! RAYON_NUM_THREADS=1 cargo bench -p dapple-benches --bench speed
//! ```

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use dapple_clustering::{ClusterParams, cluster};
use dapple_core::{Film, Frame, Limits, Render};
use dapple_job::registry::{self, MethodInputs, PointSettings};
use dapple_job::{WorldClusters, WorldTriangles};
use dapple_renderer::{World, integrator};
use dapple_scene::bundled;
use std::hint::black_box;
use std::sync::Arc;

const SEED: u64 = 2016;
const SAMPLERS: [&str; 4] = ["uniform", "variance", "mitchell", "cluster-thesis"];
const FILTERS: [&str; 2] = ["gaussian", "cluster-gaussian"];

/// Returns `true` with `--test`, where everything runs once at a small size.
fn is_test() -> bool {
    std::env::args().any(|word| word == "--test")
}

fn world(name: &str, side: u32) -> Arc<World> {
    let scene = bundled::files(name).and_then(|bundle| bundle.read().ok()).expect("a bundled scene");
    Arc::new(World::with_resolution(&scene, [side; 2]).expect("a sound scene"))
}

/// Clustered triangles per second, for `cluster` alone and for a call that also copies the world's triangles.
fn clustering(criterion: &mut Criterion) {
    let world = world("terrain", 64);
    let triangles = WorldTriangles::of(&world);
    let mut group = criterion.benchmark_group("clustering/terrain");
    group.throughput(Throughput::Elements(triangles.indices.len() as u64));
    let params = ClusterParams::default();
    group.bench_function("cluster", |b| b.iter(|| cluster(black_box(&triangles.as_slices()), &params)));
    group.bench_function("world", |b| b.iter(|| WorldClusters::new(black_box(&world), &params)));
    group.finish();
}

/// A film of the world, with the statistics that `filter` needs.
fn film(world: &Arc<World>, sampler: &str, filter: &str, side: u32, spp: u64) -> Film {
    let points = registry::points("sobol", PointSettings { seed: SEED, spp: Some(spp) }).expect("points");
    let mut inputs = MethodInputs::of(world.clone());
    let made = registry::sampler(sampler, points, &inputs).expect("a sampler");
    let mut sampler = made.sampler;
    inputs.clusters = made.clusters;
    let needs = registry::filter(filter, &inputs).expect("a filter").filter.needs();
    let frame = Frame::new(side, side).expect("a frame");
    let limits = Limits::samples(spp * frame.pixels() as u64);
    Render::new(frame, &limits).needs(needs).run(&mut *integrator(world), &mut *sampler).expect("a film")
}

/// Samples per second of renders, including planning and clustering.
fn renders(criterion: &mut Criterion) {
    let (side, spp) = if is_test() { (8, 4) } else { (64, 16) };
    for name in ["cornell", "teapot", "terrain"] {
        let world = world(name, side);
        let mut group = criterion.benchmark_group(format!("render/{name}"));
        group.sample_size(10);
        group.throughput(Throughput::Elements(spp * u64::from(side * side)));
        for sampler in SAMPLERS {
            // Each iteration makes new clusters, which are part of the cost.
            group.bench_function(sampler, |b| b.iter(|| film(&world, sampler, "none", side, spp)));
        }
        group.finish();
    }
}

/// Pixels per second of filters.
fn filters(criterion: &mut Criterion) {
    let side = if is_test() { 16 } else { 128 };
    let world = world("teapot", side);
    let inputs = MethodInputs::of(world.clone());
    let mut group = criterion.benchmark_group("filter/teapot");
    group.throughput(Throughput::Elements(u64::from(side * side)));
    for name in FILTERS {
        let film = film(&world, "cluster-thesis", name, side, 4);
        let filter = registry::filter(name, &inputs).expect("a filter").filter;
        group.bench_function(name, |b| b.iter(|| filter.apply(black_box(&film))));
    }
    group.finish();
}

criterion_group!(benches, clustering, renders, filters);
criterion_main!(benches);
