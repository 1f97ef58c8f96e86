//! Adaptive wavelet rendering: the counts of its only round after the pilot.

use crate::support::{ANY, VARIANCE, frame, next_counts, noisy_film, sobol};
use dapple_classics::{Awr, AwrOptions, Basis};
use dapple_core::Film;

/// The counts of a round of `spp` samples per pixel.
fn added(film: &Film, basis: Basis, spp: u64) -> Vec<u32> {
    let mut sampler = Awr::with_options(sobol(1), AwrOptions::default().basis(basis).rounds(1)).unwrap();
    let total = film.record().samples + spp * film.frame().pixels() as u64;
    let counts = next_counts(&mut sampler, film, total, ANY);
    assert_eq!(counts.iter().map(|&n| u64::from(n)).sum::<u64>(), total - film.record().samples);
    counts
}

const BASES: [Basis; 3] = [Basis::Cdf97, Basis::Cdf53, Basis::Haar];

/// The samples of the pixels that are inside.
fn sum(counts: &[u32], inside: impl Fn(usize) -> bool) -> u32 {
    counts.iter().enumerate().filter(|(i, _)| inside(*i)).map(|(_, n)| n).sum()
}

#[test]
fn samples_go_where_the_variance_is() {
    let film = noisy_film([64, 64], 4, VARIANCE, 6, |_, _| 10.0, |x, _| if x < 32 { 0.1 } else { 2.0 });
    for basis in BASES {
        let right = sum(&added(&film, basis, 1), |i| i % 64 >= 32);
        assert!(right > 3500, "{basis:?}: {right} of 4096");
    }
}

/// The keys of all levels are equal where all pixels have equal means and variances. The largest blocks come first, and spread
/// their samples over all their pixels.
#[test]
fn large_blocks_sample_all_their_pixels() {
    let mut film = Film::new(frame([64, 64]), VARIANCE);
    (0..4 * 4096).for_each(|k| film.push(k / 4, 0, [if k % 2 == 0 { 9.0 } else { 11.0 }; 3]));
    for basis in BASES {
        let counts = added(&film, basis, 4);
        assert!(counts.iter().all(|n| (1..=9).contains(n)), "{:?}", counts.iter().min().zip(counts.iter().max()));
    }
}

#[test]
fn an_edge_is_sampled_by_its_pixels() {
    // One edge and noise of equal variance relative to the brightness left and right.
    let image = |x: u32, _: u32| if x < 37 { 10.0 } else { 20.0 };
    let film = noisy_film([128, 64], 16, VARIANCE, 4, image, |x, _| if x < 37 { 1.0 } else { 2.0 });
    let counts = added(&film, Basis::Haar, 4);
    // Blocks across the edge have no positive key: nobody shares its samples with them.
    let [edge, flat] = [36..38, 80..120].map(|columns| {
        let number = 64 * columns.len();
        f64::from(sum(&counts, |i| columns.contains(&(i % 128)))) / number as f64
    });
    assert!(edge > 1.0 && edge < flat, "{edge} at the edge, {flat} on flat noise");
}

#[test]
fn constant_images_get_even_counts() {
    let film = noisy_film([32, 32], 4, VARIANCE, 6, |_, _| 10.0, |_, _| 0.0);
    // A quarter of what is left, evenly.
    assert_eq!(next_counts(&mut Awr::new(sobol(1)), &film, 8 * 1024, ANY), [1; 1024]);
}

/// Blocks whose variance never falls would take all samples.
#[test]
fn a_small_noisy_lamp_shares_its_samples_evenly() {
    let is_lamp = |x: u32, y: u32| (29..37).contains(&x) && (13..21).contains(&y);
    let image = move |x: u32, y: u32| if is_lamp(x, y) { 1000.0 } else { 1.0 };
    let noise = move |x: u32, y: u32| if is_lamp(x, y) { 200.0 } else { 0.01 };
    let film = noisy_film([64, 64], 4, VARIANCE, 6, image, noise);
    for basis in BASES {
        let counts = added(&film, basis, 1);
        let lamp = sum(&counts, |i| (27..39).contains(&(i % 64)) && (11..23).contains(&(i / 64)));
        assert!(3 * lamp > 2 * 4096, "{basis:?}: {lamp} in the lamp");
        let most = counts.iter().max();
        assert!(most < Some(&(4 * 4096 / 64)), "{basis:?}: a pixel gets {most:?} samples of 64 on average");
    }
}
