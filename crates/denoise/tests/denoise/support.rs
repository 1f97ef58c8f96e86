//! Random numbers, films and filters that several tests share.

use dapple_conformance::toys::Traced;
use dapple_core::samplers::Uniform;
use dapple_core::{Draws, Estimate, Film, Filter, FirstHit, Frame, Limits, Needs, Render, Worker};
use dapple_denoise::{Bilateral, ClusterLookup, ClusterRegression, ClusterRegressionOptions, NlMeans};
use dapple_low_discrepancy::Random;
use std::sync::Arc;

/// The statistics that filters over halves read.
pub(crate) const HALVES: Needs = Needs::none().with_halves().with_variance().with_features();

/// The SplitMix64 generator, for synthetic samples.
pub(crate) struct Noise(pub(crate) u64);

impl Noise {
    /// One stream per seed.
    pub(crate) fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0xd134_2543_de82_ef95))
    }

    /// The next number in 0 .. 1.
    pub(crate) fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let x = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((x ^ (x >> 31)) >> 40) as f32 / (1 << 24) as f32
    }
}

/// A film with `count` samples in each pixel, in turns to either half. `sample` makes each of its pixel's column and row, its
/// number, and random numbers.
pub(crate) fn film(
    [width, height]: [u32; 2],
    needs: Needs,
    seed: u64,
    count: impl Fn(u32, u32) -> usize,
    mut sample: impl FnMut([u32; 2], usize, &mut Noise) -> Estimate,
) -> Film {
    let (mut film, mut noise) = (Film::new(Frame::new(width, height).unwrap(), needs), Noise::new(seed));
    for i in 0..film.frame().pixels() {
        let [x, y] = film.frame().pixel(i);
        (0..count(x, y)).for_each(|k| film.push_estimate(i, k & 1, &sample([x, y], k, &mut noise)));
    }
    film
}

/// A grey sample that hits nothing.
pub(crate) fn grey(value: f32) -> Estimate {
    Estimate::new([value; 3])
}

/// A hit of a wall that is seen head on, one unit per pixel.
pub(crate) fn wall([x, y]: [u32; 2]) -> FirstHit {
    FirstHit::new([x as f32, y as f32, 0.0], [0.0, 0.0, 1.0], 100.0).with_albedo([0.5; 3])
}

/// A render with as many independent samples in each pixel.
pub(crate) fn rendered(
    frame: Frame,
    needs: Needs,
    (seed, spp): (u64, u64),
    estimate: impl Fn(&Draws<'_>) -> Estimate + Sync,
) -> Film {
    let limits = Limits::samples(spp * frame.pixels() as u64);
    let mut scene = Traced(|draws: &Draws<'_>, _: &mut Worker| estimate(draws));
    Render::new(frame, &limits).needs(needs).run(&mut scene, &mut Uniform::new(Random::new(seed))).unwrap()
}

/// The mean of the red channel.
pub(crate) fn mean(image: &[[f32; 3]]) -> f64 {
    image.iter().map(|[red, ..]| f64::from(*red)).sum::<f64>() / image.len() as f64
}

/// The mean squared difference of the red channel from `truth`, of a pixel's number.
pub(crate) fn squared_error(image: &[[f32; 3]], truth: impl Fn(usize) -> f32) -> f64 {
    let squares = image.iter().enumerate().map(|(i, [red, ..])| f64::from(red - truth(i)).powi(2));
    squares.sum::<f64>() / image.len() as f64
}

/// The shape of a first hit as its cluster.
pub(crate) fn label() -> ClusterLookup {
    Arc::new(|shape, _| Some(shape))
}

/// The default filter without its network.
pub(crate) fn regressions() -> ClusterRegression {
    ClusterRegression::with_options(ClusterRegressionOptions::default().network(false)).unwrap()
}

/// The filters over halves, each with its defaults.
pub(crate) fn over_halves() -> [Box<dyn Filter>; 3] {
    [Box::new(ClusterRegression::new()), Box::new(Bilateral::default()), Box::new(NlMeans::default())]
}
