use super::*;
use crate::test_films::{noisy_film, normal};
use dapple_core::{BudgetLeft, Filter as _, Progress, Sampler as _};
use dapple_low_discrepancy::Sobol;

const NEEDS: Needs = Needs::none().with_variance().with_halves();

fn planned(film: &Film, total: u64) -> Plan {
    let spent = film.counts().iter().sum();
    let mut plan = Plan::empty(film.frame().pixels());
    let seen = Feedback::new(1, film, BudgetLeft::new(total).with_spent(spent));
    let answer = NlmLoop::new(Sobol::new(1)).next_round(&seen, &mut plan);
    assert!(matches!(answer, Ok(Progress::Trace)), "{answer:?}");
    plan
}

#[test]
fn samples_follow_the_difference_of_the_halves() {
    // A flat part, and a part in which no patch is like another, with the same noise.
    let image = |x: u32, y: u32| if x < 32 { 20.0 } else { 20.0 + 3.0 * normal(u64::from(x + 64 * y)) };
    let film = noisy_film([64, 64], 4, NEEDS, 2, image, |_, _| 1.0);
    let plan = planned(&film, 16 * 4096);
    assert_eq!(plan.total(), 4 * 4096, "a third of what the pilot left");
    let flat: u32 = plan.counts.iter().enumerate().filter(|(i, _)| i % 64 < 28).map(|(_, n)| n).sum();
    let busy: u32 = plan.counts.iter().enumerate().filter(|(i, _)| i % 64 >= 36).map(|(_, n)| n).sum();
    assert!(busy > 4 * flat, "{busy} in the texture, {flat} in the flat part");
    assert!(plan.counts.iter().all(|n| *n <= 32), "no more than twice the mean budget");
}

#[test]
fn equal_halves_make_uniform_counts() {
    let film = noisy_film([16, 16], 4, NEEDS, 2, |x, _| f64::from(x), |_, _| 0.0);
    let plan = planned(&film, 10 * 256);
    assert!(plan.counts.iter().all(|n| *n == 2), "{:?}", &plan.counts[..16]);
}

#[test]
fn variances_of_halves_are_right_on_average_and_no_more_than_those_of_samples() {
    let film = noisy_film([64, 64], 16, NEEDS, 5, |_, _| 10.0, |_, _| 1.0);
    let halves = [0, 1].map(|half| Half::new(&film, half));
    let like = Patches { window: 7, patch: 3, k: 0.45, alpha: 0.5 };
    let smooth = smoothed_variance(&film, &halves, like);
    let unit = median(&film) * median(&film);
    let mean = smooth[0].iter().map(|v| f64::from(*v) * unit).sum::<f64>() / 4096.0;
    // 1 / 8 less what the bound takes off.
    assert!((0.095..0.13).contains(&mean), "{mean}");
    for (i, smooth) in smooth[0].iter().enumerate() {
        assert!(*smooth <= halves[0].variance[0][i].max(halves[1].variance[0][i]), "pixel {i}");
    }
}

#[test]
fn the_filter_smooths_noise_and_keeps_edges() {
    let image = |x: u32, _: u32| if x < 32 { 10.0 } else { 20.0 };
    let film = noisy_film([64, 48], 8, NEEDS, 4, image, |_, _| 1.0);
    let filtered = NlmLoopFilter::default().apply(&film).expect("a film with halves");
    let wrong = |i: usize| f64::from(filtered.radiance[i][0]) - image(i as u32 % 64, 0);
    let error = (0..64 * 48).map(|i| wrong(i) * wrong(i)).sum::<f64>() / (64.0 * 48.0);
    assert!(error < 0.15 / 8.0, "{error} is left of {}", 1.0 / 8.0);
    assert!((0..48).all(|y| wrong(y * 64 + 31).abs() < 1.5 && wrong(y * 64 + 32).abs() < 1.5));
    let predicted = filtered.error.expect("an error").iter().map(|e| f64::from(*e)).sum::<f64>() / (64.0 * 48.0);
    assert!(predicted > 0.5 * error && predicted < 2.0 * error, "{predicted} predicted, {error} true");
}
