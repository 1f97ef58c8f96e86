//! Chains have the distribution of their target, and images the path tracer's mean.
#![allow(clippy::print_stderr, reason = "figures of tests")]

use super::chain::{Deposit, Target};
use super::*;
use crate::support::{FAMILY, Mean, Sobol, bundle, film_by, images, pixels, sidak, thorough};
use dapple_core::{SampleId, streams};
use dapple_renderer::{blocks, integrator};

const BINS: u32 = 16;

/// Light `1 + 3 x` at a number `x` of the second group, shown by the pixel of that number. Where x is above a half, it needs
/// a number of a longer path, which decides whether there is light.
struct Slope;

/// The light of a bin, of all samples.
fn slope(bin: u32) -> f64 {
    let (low, high) = (f64::from(bin) / f64::from(BINS), f64::from(bin + 1) / f64::from(BINS));
    let mean = 1.0 + 1.5 * (low + high);
    mean / f64::from(BINS) * if low >= 0.5 { 0.5 } else { 1.0 }
}

impl Target for Slope {
    fn evaluate(&self, draws: &Draws<'_>, found: &mut Vec<Deposit>) -> u32 {
        let [x, ..] = draws.block(blocks::scatter(0));
        let bin = (x * BINS as f32) as u32;
        if x < 0.5 || draws.block(blocks::scatter(3))[1] < 0.5 {
            found.push((bin, Vec3::splat(1.0 + 3.0 * x)));
        }
        1
    }
}

fn frame(width: u32, height: u32) -> Frame {
    Frame::new(width, height).expect("not empty")
}

fn images_of(options: &str, keys: std::ops::Range<u64>) -> Vec<ChainImage> {
    let options = MetropolisOptions::parse(options).unwrap_or_else(|e| panic!("{e}"));
    keys.map(|key| image_of(&Slope, &frame(BINS, 64), mix(key), &options)).collect()
}

/// With any share of large steps, 1 included (independent samples). 68 tests at 1e-6 in all.
#[test]
fn chains_have_the_distribution_of_their_target() {
    for options in ["", "large=1", "large=0.02,length=64", "seeds=1,length=7"] {
        let found = images_of(options, 0..200);
        let total: f64 = (0..BINS).map(slope).sum();
        let level = sidak(FAMILY, 4 * (BINS as usize + 1));
        let brightness: Mean = found.iter().map(|image| image.brightness).collect();
        assert!(brightness.standard_error() < 0.01 * total, "{options}: {brightness:?}");
        assert!(brightness.against(total).p() > level, "{options}: {brightness:?}, not {total}");
        for bin in 0..BINS {
            let mean: Mean = found.iter().map(|image| image.light[bin as usize][1]).collect();
            assert!(mean.standard_error() < 0.1 * slope(bin), "{options}, bin {bin}: {mean:?} is too noisy a test");
            assert!(mean.against(slope(bin)).p() > level, "{options}, bin {bin}: {mean:?}, not {}", slope(bin));
        }
        // Negative control: the first bin does not have the second one's light.
        let mean: Mean = found.iter().map(|image| image.light[0][1]).collect();
        assert!(mean.against(slope(1)).p() < 1e-3, "{options}: {mean:?}");
    }
}

#[test]
fn chains_start_in_proportion_to_brightness() {
    let brightness = [0.0, 1.0, 0.0, 3.0, 4.0];
    let mut counts = [0; 5];
    for key in 0..1000 {
        let found = starts(brightness.into_iter(), 8.0, 4, key);
        assert_eq!(found.len(), 4);
        found.iter().for_each(|&i| counts[i as usize] += 1);
    }
    assert!(counts[0] + counts[2] == 0 && counts[4] == 2000, "{counts:?}");
    // One start in two: binomial, five standard deviations.
    assert!((i32::abs(counts[1] - 500)) < 80 && counts[1] + counts[3] == 2000, "{counts:?}");
}

const SIZE: [u32; 2] = [24, 16];

/// Discarded samples too, so that the halves of the film stay independent.
#[test]
fn samples_of_a_half_take_the_image_of_that_half() {
    let world = bundle("cornell", SIZE);
    let mut metropolis = Metropolis::new(&world, &MetropolisOptions::default()).expect("no media");
    let frame = frame(SIZE[0], SIZE[1]);
    metropolis.images = [1.0, 3.0].map(|light| vec![[light; 3]; frame.pixels()]);
    metropolis.frame = Some(frame);
    for (half, expected) in [1.0, 3.0].into_iter().enumerate() {
        for (stream, index) in [(streams::HALVES, 0), (streams::HALVES, 1), (streams::DISCARDED_HALVES, 0)] {
            let points = Sobol::new(1);
            let draws = Draws::new(&points, SampleId::new([3, 2], stream[half], index));
            let direct = metropolis.direct.estimate(&draws, &mut Worker::default()).radiance[1];
            let indirect = metropolis.estimate(&draws, &mut Worker::default()).radiance[1] - direct;
            assert!((indirect - expected).abs() < 1e-4, "half {half}, stream {}: {indirect}", stream[half]);
        }
    }
}

/// Negative control: without the chains, light is missing.
#[test]
fn the_mean_is_the_path_tracers() {
    for name in &["cornell", "lens"][..thorough(1, 2)] {
        let mut world = bundle(name, SIZE);
        world.set_max_depth(4);
        let make = || Metropolis::new(&world, &MetropolisOptions::default()).unwrap_or_else(|e| panic!("{e}"));
        let film = |integrator: &mut dyn Integrator, spp, seed| pixels(&film_by(integrator, SIZE, spp, seed));
        let found: Vec<_> = (0..24).map(|seed| film(&mut make(), 8, seed)).collect();
        let missing = |seed| film(&mut Metropolis { depth: 1, ..make() }, 8, seed);
        let missing: Vec<_> = (0..24).map(missing).collect();
        let expected: Vec<_> = (100..124).map(|seed| film(&mut *integrator(&world), 16, seed)).collect();
        let [p, wrong] = [&found, &missing].map(|set| images(SIZE[0] as usize, set, &expected).p());
        let mean = |set: &[Vec<[f64; 3]>]| -> Mean {
            set.iter().map(|image| image.iter().map(|p| p[1]).sum::<f64>() / image.len() as f64).collect()
        };
        let z = mean(&found).against_estimate(&mean(&expected)).z();
        eprintln!("{name}: p {p:.2e}, {z:+.2} standard errors");
        assert!(p > sidak(FAMILY, 2) && z.abs() < 3.0, "{name}: p {p:e}, {z} standard errors");
        assert!(wrong < FAMILY, "{name}: the test sees nothing, p {wrong:e}");
    }
}
