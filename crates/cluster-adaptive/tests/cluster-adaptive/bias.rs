//! Counts from geometry are unbiased, checked against the closed form. The naive rule is the control and must be caught
//! [Kirk and Arvo 1991].

use crate::common::*;
use dapple_cluster_adaptive::{ClusterSize, ClusterThesisOptions, Placement};
use dapple_conformance::statistics::{Mean, Naive, image_mean};
use dapple_conformance::toys::raised;
use dapple_core::{Needs, Sampler};
use dapple_low_discrepancy::Random;

const SIDE: u32 = 64;

/// The probability of light follows the clusters' columns, so that counts correlate with variance.
fn probability([x, y]: [u32; 2]) -> f32 {
    if y > 12 { 0.1 } else { [0.3, 0.01, 0.1][(x as f32 * 0.3) as usize % 3] }
}

fn truth() -> f64 {
    let pixels = (0..SIDE * SIDE).map(|i| f64::from(probability([i % SIDE, i / SIDE])));
    pixels.sum::<f64>() / f64::from(SIDE * SIDE)
}

/// The deviation of the image's mean from the expected value in standard errors, over 64 images. With 63 degrees of
/// freedom, 5 is exceeded with p = 5e-6 and 10 with p < 1e-13.
fn deviation<S: Sampler>(make: impl Fn(u64) -> S, budgets: &[u64]) -> f64 {
    let at = frame(SIDE, SIDE);
    let mean = |seed: u64| {
        let mut field = Field(|pixel, u: [f32; 4]| f32::from(u8::from(u[0] < probability(pixel))));
        image_mean(&raised(&mut field, &mut make(1000 + seed), Needs::none(), at, budgets))
    };
    (0..64).map(mean).collect::<Mean>().deviation(truth())
}

fn ours(seed: u64) -> impl Sampler {
    probing(seed, Placement::Centre, ClusterSize::ProjectedBox, ClusterThesisOptions::default())
}

#[test]
fn counts_from_geometry_are_unbiased_a01() {
    let pixels = u64::from(SIDE * SIDE);
    // The last budget is raised twice.
    for budgets in [&[8 * pixels][..], &[5 * pixels / 2], &[pixels, 3 * pixels, 10 * pixels]] {
        let z = deviation(ours, budgets);
        assert!(z.abs() < 5.0, "{z} standard errors at {budgets:?}");
    }
}

#[test]
fn the_naive_rule_is_caught_a01() {
    let z = deviation(|seed| Naive { points: Random::new(seed), pilot: 4, total: 64 }, &[64 * u64::from(SIDE * SIDE)]);
    assert!(z < -10.0, "{z} standard errors");
}

/// Two images with nothing in common have the same counts.
#[test]
fn counts_do_not_read_radiance() {
    let at = frame(SIDE, SIDE);
    let pixels = u64::from(SIDE * SIDE);
    let budgets = [pixels, 3 * pixels + 1, 10 * pixels];
    let dark = raised(&mut Field(|_, _| 0.0), &mut ours(1), Needs::none(), at, &budgets);
    let noisy = Field(|[x, y]: [u32; 2], u: [f32; 4]| if x > y { f32::NAN } else { 100.0 * u[0] });
    let bright = raised(&mut { noisy }, &mut ours(1), Needs::none(), at, &budgets);
    assert_eq!(dark.counts(), bright.counts());
    assert!(dark.counts().iter().max() > dark.counts().iter().min());
}
