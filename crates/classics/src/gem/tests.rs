use super::*;
use crate::test_films::noisy_film;
use dapple_core::{BudgetLeft, Filter as _, Progress, Sampler as _};
use dapple_low_discrepancy::Sobol;

fn planned(film: &Film, total: u64, max_spp: u32) -> Plan {
    let pixels = film.frame().pixels();
    let spent = film.counts().iter().sum();
    let budget = BudgetLeft::new(total).with_spent(spent).with_max_spp(max_spp);
    let mut plan = Plan::empty(pixels);
    let answer = Gem::new(Sobol::new(1)).next_round(&Feedback::new(1, film, budget), &mut plan);
    assert!(matches!(answer, Ok(Progress::Trace)), "{answer:?}");
    plan
}

/// Noise in the right half only.
fn half_noisy(size: [u32; 2]) -> Film {
    noisy_film(
        size,
        4,
        Needs::none().with_variance(),
        5,
        |_, _| 10.0,
        move |x, _| if x < size[0] / 2 { 0.1 } else { 2.0 },
    )
}

#[test]
fn samples_go_where_the_error_is_and_each_round_spends_its_share() {
    let film = half_noisy([64, 64]);
    let plan = planned(&film, 16 * 4096, u32::MAX);
    assert_eq!(plan.total(), 12 * 4096 / 8, "an eighth of what the pilot left");
    let right: u32 = plan.counts.iter().enumerate().filter(|(i, _)| i % 64 >= 32).map(|(_, n)| n).sum();
    // Kernels at the edge reach up to 24 pixels into the quiet half.
    assert!(f64::from(right) > 0.8 * plan.total() as f64, "{right} of {} samples", plan.total());
    // Where noise is white, scales are coarse, so that picks spread over the whole half.
    let fed = plan.counts.iter().filter(|n| **n > 0).count();
    assert!(fed > 1000, "{fed} pixels receive samples, of {} picks", plan.total() / 16);
}

#[test]
fn what_exceeds_the_ceiling_goes_to_other_pixels() {
    let film = half_noisy([16, 16]);
    let plan = planned(&film, 9 * 256, 10);
    assert_eq!(plan.total(), 5 * 256 / 8);
    let close = planned(&film, 9 * 256, 5);
    assert_eq!(close.total(), 5 * 256 / 8, "the ceiling moves samples, and loses none");
    assert!(plan.counts.iter().any(|n| *n > 1) && close.counts.iter().all(|n| *n <= 1));
}

#[test]
fn receiving_pixels_follow_the_kernel() {
    let bank = Bank::between_rounds();
    let kernels = Kernels::new(&bank, [64, 64]);
    let (middle, draws) = (32 * 64 + 32, 100_000u64);
    for (scale, sigma) in [(1, 1.0), (3, 4.0)] {
        let mut square = 0.0;
        for j in 0..draws {
            let at = kernels.draw(middle, scale, mix(9).wrapping_add(j << 8)) as f64;
            square += (at % 64.0 - 32.0).powi(2) / draws as f64;
        }
        // Less 2 % for the cut at 3 standard deviations; 1 % is 2 standard errors.
        assert!((square / (sigma * sigma) - 0.98).abs() < 0.025, "{scale}: {square}");
    }
    assert_eq!(kernels.draw(middle, 0, 1), middle as usize);
    assert!((0..1000u64).all(|j| kernels.draw(0, 4, j << 8) < 4096), "the corner's kernel is half outside");
}

#[test]
fn predicted_errors_add_up_to_the_true_error() {
    type Image = fn(u32, u32) -> f64;
    let images: [Image; 4] = [
        |_, _| 10.0,
        |x, y| 10.0 + 0.05 * f64::from(x) + 0.02 * f64::from(y),
        |x, y| if x + y / 2 < 40 { 10.0 } else { 16.0 },
        |x, y| 12.0 + libm::sin(0.3 * f64::from(x)) * libm::sin(0.2 * f64::from(y)),
    ];
    for (k, image) in images.into_iter().enumerate() {
        let film = noisy_film([64, 64], 8, Needs::none().with_variance(), 7 + k as u64, image, |_, _| 1.0);
        let filtered = GemFilter::default().apply(&film).expect("a film with variance");
        let truth = |i: usize| image(i as u32 % 64, i as u32 / 64);
        let squared =
            |i: usize| filtered.radiance[i].iter().map(|m| (f64::from(*m) - truth(i)).powi(2)).sum::<f64>() / 3.0;
        let wrong = (0..4096).map(squared).sum::<f64>();
        let predicted: f64 = filtered.error.expect("an error").iter().map(|e| f64::from(*e)).sum();
        let unfiltered = 4096.0 / 8.0;
        assert!(wrong < 0.3 * unfiltered, "image {k}: the filter leaves {wrong}");
        assert!(
            predicted > 0.5 * wrong && predicted < 2.0 * wrong + 0.1 * unfiltered,
            "image {k}: {predicted}, {wrong}"
        );
    }
}
