//! Rays per second, and the time to build the BVH. Scenes: a box of 36 triangles, displaced spheres of 70,000 and 270,000, and
//! a terrain of a million. Rays: primary, bounce and shadow; one iteration is one ray.

mod scenes;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use dapple_geometry::Geometry;
use scenes::{Scene, rays, scenes, shapes};
use std::hint::black_box;

fn measure(criterion: &mut Criterion, Scene { name, soups, views }: &Scene) {
    let scene = Geometry::build(shapes(soups)).expect("not too many");
    let [primary, bounce, shadow] = rays(&scene, *views);
    let mut group = criterion.benchmark_group(*name);
    group.throughput(Throughput::Elements(1));
    for (kind, rays) in [("primary", &primary), ("bounce", &bounce)] {
        let mut next = rays.iter().cycle();
        group.bench_function(kind, |b| b.iter(|| scene.closest(black_box(next.next().expect("endless")))));
    }
    let mut next = shadow.iter().cycle();
    group.bench_function("shadow", |b| b.iter(|| scene.occluded(black_box(next.next().expect("endless")))));
    let mut next = primary.iter().cycle();
    group.bench_function("primary and surface", |b| {
        b.iter(|| {
            let ray = next.next().expect("endless");
            scene.closest(ray).map(|hit| scene.surface(ray, &hit))
        });
    });
    group.finish();
}

fn bench(criterion: &mut Criterion) {
    for scene in &scenes() {
        measure(criterion, scene);
    }
    let [_, sphere, ..] = scenes();
    let mut group = criterion.benchmark_group("build");
    group.sample_size(10);
    let shapes = shapes(&sphere.soups);
    group.bench_function(sphere.name, |b| b.iter(|| Geometry::build(shapes.clone())));
    group.finish();
}

criterion_group!(benches, bench);
criterion_main!(benches);
