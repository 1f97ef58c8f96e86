//! The cost of the filters on one thread, with default parameters. Criterion's throughput is in pixels.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use dapple_core::samplers::Uniform;
use dapple_core::{Block, Draws, Estimate, Film, Filter, FirstHit, Frame, Integrator, Limits, Needs, Render, Worker};
use dapple_denoise::{Bilateral, ClusterGaussian, ClusterGaussianOptions, ClusterRegression, Gaussian, NlMeans};
use dapple_low_discrepancy::Random;
use std::hint::black_box;
use std::sync::Arc;

const SIDE: u32 = 1024;

/// Noise on slanted stripes, each with its own shape.
struct Stripes;

impl Integrator for Stripes {
    fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
        let [u, v, a, _] = draws.block(Block::new(0));
        let [x, y] = draws.pixel();
        let stripe = ((x as f32 + u + 0.3 * (y as f32 + v)) / 16.0) as u32;
        let hit = FirstHit::new([x as f32, y as f32, 0.0], [0.0, 0.0, 1.0], 1.0)
            .with_albedo([0.5; 3])
            .with_footprint(1.0)
            .with_shape(stripe);
        Estimate::new([a, u, v]).with_first_hit(draws.wants_first_hit().then_some(hit))
    }
}

/// A film of `side` x `side` pixels with `spp` samples each.
fn film(side: u32, spp: u64, needs: Needs) -> Film {
    let frame = Frame::new(side, side).expect("a frame");
    let limits = Limits::samples(spp * frame.pixels() as u64);
    Render::new(frame, &limits).needs(needs).run(&mut Stripes, &mut Uniform::new(Random::new(1))).expect("a film")
}

/// Measures blurs on 2^20 pixels, and filters that use halves and features on a quarter of that.
fn filters(c: &mut Criterion) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool");
    let plain = film(SIDE, 4, Needs::none());
    let noisy = film(SIDE, 4, Needs::none().with_variance());
    let hits = film(SIDE, 4, Needs::none().with_first_hits(4));
    let halves = Needs::none().with_variance().with_halves().with_features().with_surfaces();
    let halves = film(SIDE / 2, 8, halves);
    let map = (0..SIDE * SIDE).map(|i| (i % SIDE + i / SIDE / 3) / 16).collect();
    let from_map = ClusterGaussian::from_map([SIDE, SIDE], map).expect("a map");
    let label = |hits| {
        let filter = ClusterGaussian::from_hits(Arc::new(|shape, _| Some(shape)));
        filter.with_options(ClusterGaussianOptions::default().hits(hits)).expect("first hits")
    };
    let clusters = |plain: ClusterRegression| plain.with_clusters(Arc::new(|shape, _| Some(shape)), "");
    let cases: [(&str, &Film, Box<dyn Filter>); 10] = [
        ("gaussian", &plain, Box::new(Gaussian::default())),
        ("gaussian with error", &noisy, Box::new(Gaussian::default())),
        ("cluster-gaussian from a map", &plain, Box::new(from_map.clone())),
        ("cluster-gaussian from a map with error", &noisy, Box::new(from_map)),
        ("cluster-gaussian from 1 hit", &hits, Box::new(label(1))),
        ("cluster-gaussian from 4 hits", &hits, Box::new(label(4))),
        ("bilateral", &halves, Box::new(Bilateral::default())),
        ("nlm", &halves, Box::new(NlMeans::default())),
        ("cluster-regression, one pass", &halves, Box::new(clusters(ClusterRegression::new().one_pass()))),
        ("cluster-regression", &halves, Box::new(clusters(ClusterRegression::new()))),
    ];
    let mut group = c.benchmark_group("filter");
    for (name, film, filter) in cases {
        group.throughput(Throughput::Elements(film.frame().pixels() as u64)).sample_size(10);
        group.bench_function(name, |b| {
            pool.install(|| b.iter(|| filter.apply(black_box(film)).expect("an image")));
        });
    }
}

criterion_group!(benches, filters);
criterion_main!(benches);
