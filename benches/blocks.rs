//! Nanoseconds per block of four coordinates, read through `Draws` and `&dyn PointSet` as in a render. Criterion's
//! throughput is in blocks.
//!
//! Run `cargo bench -p dapple-benches --bench blocks`; for AVX2, set `RUSTFLAGS="-C target-cpu=native"`.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use dapple_core::{Block, Draws, PointSet, SampleId};
use dapple_low_discrepancy::{
    BlueNoise, Diffused, Halton, Lattice, LowDiscrepancy, Mitchell1991, Pmj02, Random, Sobol, Stratified, ZSobol,
};
use std::hint::black_box;

/// Blocks per iteration: 16 samples of 16 blocks.
const BLOCKS: u64 = 256;

/// The sum of all coordinates, which keeps the compiler from removing their computation.
fn read(points: &dyn PointSet, pixel: u32) -> f32 {
    let mut sum = 0.0;
    for index in 0..16 {
        let draws = black_box(Draws::new(points, SampleId::new([pixel, 7], 0, index)));
        for block in 0..16 {
            let [a, b, c, d] = draws.block(Block::new(block));
            sum += a + b + c + d;
        }
    }
    sum
}

fn blocks(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("block");
    group.throughput(Throughput::Elements(BLOCKS));
    let sets: [Box<dyn PointSet>; 11] = [
        Box::new(Random::new(1)),
        Box::new(Stratified::new(1, 4).unwrap()),
        Box::new(Halton::new(1)),
        Box::new(Sobol::new(1)),
        Box::new(LowDiscrepancy::new(1, 16).unwrap()),
        Box::new(ZSobol::new(1, 16).unwrap()),
        Box::new(BlueNoise::new(1, Sobol::new(1))),
        Box::new(Pmj02::new(1)),
        Box::new(Lattice::new(1)),
        Box::new(Diffused::new(1)),
        Box::new(Mitchell1991::new(1)),
    ];
    for points in &sets {
        let name = points.describe();
        let mut pixel = 0_u32;
        group.bench_function(name.split(':').next().unwrap_or_default(), |b| {
            b.iter(|| {
                pixel = pixel.wrapping_add(1);
                black_box(read(black_box(&**points), pixel))
            });
        });
    }
    // The reference implementation, with a seed per pixel and block, as its documentation advises for padding.
    type Reference = (&'static str, fn(u32, u32) -> f32);
    let references: [Reference; 2] = [
        ("sobol_burley::sample_4d", |index, seed| sobol_burley::sample_4d(index, 0, seed).iter().sum()),
        ("sobol_burley::sample x4", |index, seed| (0..4).map(|d| sobol_burley::sample(index, d, seed)).sum()),
    ];
    for (name, sample) in references {
        let mut pixel = 0_u32;
        group.bench_function(name, |b| {
            b.iter(|| {
                pixel = pixel.wrapping_add(1);
                let blocks = (0..16).flat_map(|index| (0..16_u32).map(move |block| (index, block)));
                let seed = |block: u32| (pixel ^ block << 20).wrapping_mul(0x9e37_79b9);
                black_box(blocks.map(|(index, block)| sample(black_box(index), seed(block))).sum::<f32>())
            });
        });
    }
    group.finish();
}

criterion_group!(benches, blocks);
criterion_main!(benches);
