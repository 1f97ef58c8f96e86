//! Integrands and statistics that several tests share.

use dapple_core::{PointSet, SampleId};
use dapple_low_discrepancy::{
    BlueNoise, BlueNoiseKeys, Diffused, Halton, Lattice, LowDiscrepancy, Mitchell1991, Pmj02, Random, Sobol,
    Stratified, ZSobol,
};

pub(crate) fn id(pixel: [u32; 2], stream: u32, index: u64) -> SampleId {
    SampleId::new(pixel, stream, index)
}

/// Returns one of each set with independent pixels, with grids and nets of 64 samples.
pub(crate) fn all_sets(seed: u64) -> Vec<Box<dyn PointSet>> {
    vec![
        Box::new(Random::new(seed)),
        Box::new(Stratified::new(seed, 8).unwrap()),
        Box::new(Halton::new(seed)),
        Box::new(Sobol::new(seed)),
        Box::new(LowDiscrepancy::new(seed, 64).unwrap()),
        Box::new(Lattice::new(seed)),
        Box::new(Pmj02::new(seed).with_independent_pixels()),
    ]
}

/// Returns one of each set that couples pixels.
pub(crate) fn coupled_sets(seed: u64) -> Vec<Box<dyn PointSet>> {
    vec![
        Box::new(ZSobol::new(seed, 64).unwrap()),
        Box::new(BlueNoise::new(seed, Sobol::new(seed))),
        Box::new(Pmj02::new(seed)),
        Box::new(Diffused::new(seed)),
        Box::new(Mitchell1991::new(seed)),
        Box::new(BlueNoiseKeys::new(seed)),
    ]
}

/// Returns one of each set.
pub(crate) fn every_set(seed: u64) -> Vec<Box<dyn PointSet>> {
    all_sets(seed).into_iter().chain(coupled_sets(seed)).collect()
}

/// A function on the unit square with its exact mean and variance.
pub(crate) struct Integrand {
    pub(crate) name: &'static str,
    pub(crate) f: fn(f64, f64) -> f64,
    pub(crate) mean: f64,
    pub(crate) variance: f64,
}

fn one_if(inside: bool) -> f64 {
    f64::from(u8::from(inside))
}

/// Smooth, kinked and discontinuous functions, along the axes and across.
pub(crate) fn integrands() -> [Integrand; 8] {
    let edge = |name, f, p: f64| Integrand { name, f, mean: p, variance: p * (1.0 - p) };
    [
        Integrand { name: "x y", f: |x, y| x * y, mean: 0.25, variance: 7.0 / 144.0 },
        edge("disk", |x, y| one_if(x * x + y * y < 1.0), std::f64::consts::FRAC_PI_4),
        edge("half-plane", |x, y| one_if(y < 0.3 + 0.4 * x), 0.5),
        edge("box", |x, y| one_if(x < 0.3 && y < 0.7), 0.21),
        edge("ridge", |x, y| one_if((x - y).abs() < 0.05), 0.0975),
        Integrand { name: "x^2 + y", f: |x, y| x * x + y, mean: 5.0 / 6.0, variance: 4.0 / 45.0 + 1.0 / 12.0 },
        Integrand {
            name: "bump",
            f: |x, y| 16.0 * x * (1.0 - x) * y * (1.0 - y),
            mean: 4.0 / 9.0,
            variance: 256.0 / 900.0 - 16.0 / 81.0,
        },
        Integrand { name: "fold", f: |x, y| (x + y - 1.0).abs(), mean: 1.0 / 3.0, variance: 1.0 / 18.0 },
    ]
}

/// Returns one 2-D pair of a sample.
pub(crate) fn pair(points: &dyn PointSet, id: SampleId, block: u32, pair: usize) -> [f64; 2] {
    let u = points.block(id, block);
    [f64::from(u[2 * pair]), f64::from(u[2 * pair + 1])]
}

/// Returns the mean of an integrand over the first `n` samples of one stream of a pixel, in the second pair of block 1.
pub(crate) fn estimate(points: &dyn PointSet, f: fn(f64, f64) -> f64, pixel: [u32; 2], stream: u32, n: u64) -> f64 {
    let sum: f64 = (0..n)
        .map(|i| {
            let [x, y] = pair(points, id(pixel, stream, i), 1, 1);
            f(x, y)
        })
        .sum();
    sum / n as f64
}

/// Returns the root mean square.
pub(crate) fn rms(numbers: impl Iterator<Item = f64>) -> f64 {
    let (mut sum, mut n) = (0.0, 0.0);
    for x in numbers {
        sum += x * x;
        n += 1.0;
    }
    (sum / n).sqrt()
}
