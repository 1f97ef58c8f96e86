//! Non-local means in two halves, and the counts that follow their difference.

use crate::support::{ANY, next_counts, noisy_film, normal, sobol, squared_error};
use dapple_classics::{NlmLoop, NlmLoopFilter};
use dapple_core::{Film, Filter as _, Needs};

const NEEDS: Needs = Needs::none().with_half_variance();

fn planned(film: &Film, total: u64) -> Vec<u32> {
    next_counts(&mut NlmLoop::new(sobol(1)), film, total, ANY)
}

#[test]
fn samples_follow_the_difference_of_the_halves() {
    // A flat part, and a part in which no patch is like another, with the same noise.
    let image = |x: u32, y: u32| if x < 32 { 20.0 } else { 20.0 + 3.0 * normal(u64::from(x + 64 * y)) };
    let film = noisy_film([64, 64], 4, NEEDS, 2, image, |_, _| 1.0);
    let counts = planned(&film, 16 * 4096);
    assert_eq!(counts.iter().sum::<u32>(), 4 * 4096, "a third of what the pilot left");
    let sum = |columns: std::ops::Range<usize>| {
        counts.iter().enumerate().filter(|(i, _)| columns.contains(&(i % 64))).map(|(_, n)| n).sum::<u32>()
    };
    let (flat, busy) = (sum(0..28), sum(36..64));
    assert!(busy > 4 * flat, "{busy} in the texture, {flat} in the flat part");
    assert!(counts.iter().all(|n| *n <= 32), "no more than twice the mean budget");
}

#[test]
fn equal_halves_make_uniform_counts() {
    let film = noisy_film([16, 16], 4, NEEDS, 2, |x, _| f64::from(x), |_, _| 0.0);
    assert_eq!(planned(&film, 10 * 256), [2; 256]);
}

#[test]
fn the_filter_smooths_noise_and_keeps_edges() {
    let image = |x: u32, _: u32| if x < 32 { 10.0 } else { 20.0 };
    let film = noisy_film([64, 48], 8, NEEDS, 4, image, |_, _| 1.0);
    let filtered = NlmLoopFilter::default().apply(&film).expect("a film with halves");
    let truth = |i: usize| image(i as u32 % 64, 0);
    let error = squared_error(&filtered.radiance, truth);
    assert!(error < 0.15 / 8.0, "{error} is left of {}", 1.0 / 8.0);
    let wrong = |i: usize| (f64::from(filtered.radiance[i][0]) - truth(i)).abs();
    assert!((0..48).all(|y| wrong(y * 64 + 31) < 1.5 && wrong(y * 64 + 32) < 1.5));
    let predicted = filtered.error.expect("an error").iter().map(|e| f64::from(*e)).sum::<f64>() / (64.0 * 48.0);
    assert!(predicted > 0.5 * error && predicted < 2.0 * error, "{predicted} predicted, {error} true");
}
