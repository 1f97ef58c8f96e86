//! Clustered triangles per second, on a fractal height field of about a million triangles (a small one with `--test`).
//!
//! `RAYON_NUM_THREADS=1 cargo bench -p dapple-benches --bench cluster` measures one core.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use dapple_clustering::{ClusterParams, Grouping, Insertion, Triangles, cluster};
use std::hint::black_box;

/// A pseudo-random number in [-1, 1) for a lattice point: a multiplicative hash with its high bits folded down twice.
fn lattice(x: i64, y: i64) -> f64 {
    let mut h = (x as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ (y as u64).wrapping_mul(0xc2b2_ae3d_27d4_eb4f);
    h = (h ^ h >> 31).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    h = (h ^ h >> 29).wrapping_mul(0x94d0_49bb_1331_11eb);
    (h >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
}

/// Noise between lattice points, with a continuous slope.
fn noise(x: f64, y: f64) -> f64 {
    let (i, j) = (x.floor(), y.floor());
    let ease = |t: f64| t * t * (3.0 - 2.0 * t);
    let (u, v) = (ease(x - i), ease(y - j));
    let at = |di: f64, dj: f64| lattice((i + di) as i64, (j + dj) as i64);
    let low = at(0.0, 0.0) + u * (at(1.0, 0.0) - at(0.0, 0.0));
    let high = at(0.0, 1.0) + u * (at(1.0, 1.0) - at(0.0, 1.0));
    low + v * (high - low)
}

/// Mountains over the unit square: nine octaves, each twice as fine as the one before and `gain` times as high.
fn terrain(side: u32, gain: f64) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
    let mut positions = Vec::new();
    for row in 0..=side {
        for column in 0..=side {
            let (x, y) = (f64::from(column) / f64::from(side), f64::from(row) / f64::from(side));
            let octave = |o: i32| gain.powi(o) * noise(4.0 * x * 2_f64.powi(o), 4.0 * y * 2_f64.powi(o));
            let z = 0.1 * (0..9).map(octave).sum::<f64>();
            positions.push([x as f32, y as f32, z as f32]);
        }
    }
    let mut indices = Vec::new();
    for row in 0..side {
        for column in 0..side {
            let [a, b] = [row, row + 1].map(|row| row * (side + 1) + column);
            indices.extend([[a, a + 1, b + 1], [a, b + 1, b]]);
        }
    }
    (positions, indices)
}

#[allow(clippy::print_stderr)]
fn clustering(criterion: &mut Criterion) {
    let side = if std::env::args().any(|word| word == "--test") { 50 } else { 708 };
    let published = ClusterParams::published();
    let variants = [
        ("default", ClusterParams::default()),
        ("unclamped", ClusterParams { clamp: 1 << 20, ..ClusterParams::default() }),
        ("bounding_box", ClusterParams { insertion: Insertion::BoundingBox, ..ClusterParams::default() }),
        ("connected", ClusterParams { grouping: Grouping::Connected, ..ClusterParams::default() }),
        ("published", published),
    ];
    // Eroded hills have a gain of about 0.4 per octave. At 0.5 every octave is equally steep, and most neighbours
    // differ by more than the angle: the worst case of a height field.
    for (name, gain) in [("hills", 0.4), ("crags", 0.5)] {
        let (positions, indices) = terrain(side, gain);
        let triangles = Triangles::new(&positions, &indices);
        let mut group = criterion.benchmark_group(name);
        group.sample_size(10);
        group.throughput(Throughput::Elements(indices.len() as u64));
        for (name, params) in variants {
            if std::env::var_os("DAPPLE_FIGURES").is_some() {
                let clusters = cluster(&triangles, &params);
                eprintln!("{name}: {:?}", clusters.map(|clusters| (clusters.len(), clusters.report())));
            }
            group.bench_function(name, |b| b.iter(|| cluster(black_box(&triangles), black_box(&params))));
        }
        group.finish();
    }
}

criterion_group!(benches, clustering);
criterion_main!(benches);
