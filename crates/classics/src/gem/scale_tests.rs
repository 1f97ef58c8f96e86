use super::*;
use crate::test_films::noisy_film;
use dapple_core::Needs;

const NEEDS: Needs = Needs::none().with_variance();

fn white_noise(seed: u64) -> Film {
    noisy_film([64, 64], 8, NEEDS, seed, |_, _| 10.0, |_, _| 1.0)
}

/// The steps of one bank, unsmoothed.
fn raw_steps(film: &Film, bank: &Bank, gamma: f64) -> Vec<Vec<Step>> {
    let size = film.frame().size().map(|n| n as usize);
    let finest = Level::finest(film, &variances_of_means(film));
    let mut levels = vec![finest];
    for sigma in &bank.sigmas {
        let next = levels[0].blurred(size, *sigma);
        levels.push(next);
    }
    let step = |s: usize, i| compare(&levels[s], &levels[s + 1], bank.beta(s), strictness(gamma), i);
    (0..bank.sigmas.len()).map(|s| (0..size[0] * size[1]).map(|i| step(s, i)).collect()).collect()
}

fn share_of_flags(steps: &[Step]) -> f64 {
    steps.iter().map(|step| step.flag).sum::<f64>() / steps.len() as f64
}

#[test]
fn gamma_is_the_share_of_false_stops_on_white_noise() {
    assert!((strictness(0.2) - 0.7022).abs() < 5e-5);
    for bank in [Bank::between_rounds(), Bank::of_image()] {
        for step in 0..bank.sigmas.len() {
            let share = |gamma, seed| share_of_flags(&raw_steps(&white_noise(seed), &bank, gamma)[step]);
            let [share, wide] = [0.2, 0.4].map(|gamma| (0..8).map(|seed| share(gamma, seed)).sum::<f64>() / 8.0);
            assert!((0.18..0.23).contains(&share), "step {step}: {share}");
            assert!(wide > 1.5 * share, "step {step}: a larger gamma makes {wide} of {share}");
        }
    }
}

#[test]
fn white_noise_ends_at_the_coarsest_scale() {
    for (bank, least) in [(Bank::between_rounds(), 0.96), (Bank::of_image(), 0.99)] {
        let coarsest = bank.sigmas.len() as u8;
        let share = |seed| {
            let scales = select(&white_noise(seed), &bank, 0.2).scales;
            scales.iter().filter(|s| **s == coarsest).count() as f64 / scales.len() as f64
        };
        let mean = (0..8).map(share).sum::<f64>() / 8.0;
        assert!(mean > least, "only {mean} of the pixels are at the coarsest scale");
    }
}

#[test]
fn variances_fall_by_the_energy_of_the_kernel() {
    let finest = Level::finest(&white_noise(1), &[2.0; 64 * 64]);
    for sigma in [1.0, 2.0, 8.0] {
        let energy: f64 = gaussian_taps(sigma).iter().map(|tap| tap * tap).sum();
        let blurred = finest.blurred([64, 64], sigma);
        let middle = blurred.variances[32 * 64 + 32];
        assert!((middle / (2.0 * energy * energy) - 1.0).abs() < 1e-5, "{sigma}: {middle}");
        assert!(blurred.variances[0] > 2.0 * middle, "a corner averages fewer pixels");
    }
}

#[test]
fn beta_turns_differences_of_means_into_those_of_squared_biases_on_a_quadratic() {
    let size = [101, 101];
    let image = |x: u32, y: u32| {
        let [x, y] = [x, y].map(|x| f64::from(x) - 50.0);
        1e4 + 2.0 * x * x + 0.5 * x * y - 7.0 * x + y * y
    };
    let film = noisy_film(size, 2, NEEDS, 1, image, |_, _| 0.0);
    let finest = Level::finest(&film, &vec![1.0; 101 * 101]);
    let (middle, truth) = (50 * 101 + 50, image(50, 50));
    let bank = Bank::of_image();
    for step in 1..bank.sigmas.len() {
        let [fine, coarse] =
            [bank.sigmas[step - 1], bank.sigmas[step]].map(|sigma| finest.blurred(size.map(|n| n as usize), sigma));
        let [f, c] = [&fine, &coarse].map(|level| level.means[middle][0] - truth);
        let (loss, wanted) = (bank.beta(step) * (f - c) * (f - c), c * c - f * f);
        assert!((loss / wanted - 1.0).abs() < 0.05, "step {step}: {loss}, not {wanted}");
    }
    assert!((bank.beta(1) - 3.0).abs() < 1e-12 && (Bank::between_rounds().beta(2) - 5.0 / 3.0).abs() < 1e-12);
}

#[test]
fn pixels_at_an_edge_stop_at_once_and_a_larger_gamma_is_never_coarser() {
    let film = noisy_film([64, 32], 16, NEEDS, 3, |x, _| if x < 32 { 10.0 } else { 20.0 }, |_, _| 0.5);
    let bank = Bank::of_image();
    let [loose, strict] = [0.2, 0.4].map(|gamma| select(&film, &bank, gamma).scales);
    for y in 0..32 {
        assert_eq!([loose[y * 64 + 31], loose[y * 64 + 32]], [0, 0], "row {y}");
        assert!(loose[y * 64 + 3] > 4, "row {y}: the flat part is at scale {}", loose[y * 64 + 3]);
    }
    assert!(strict.iter().zip(&loose).all(|(strict, loose)| strict <= loose) && strict != loose);
}

#[test]
fn pixels_without_samples_are_filled() {
    let mut film = noisy_film([9, 9], 0, NEEDS, 0, |_, _| 1.0, |_, _| 0.0);
    for i in (0..81).filter(|i| i % 9 != 4) {
        (0..4).for_each(|s| film.push(i, 0, [1.0 + 0.1 * s as f32; 3]));
    }
    let selection = select(&film, &Bank::of_image(), 0.2);
    for y in 0..9 {
        assert!((selection.means[9 * y + 4][0] - 1.15).abs() < 1e-6, "{:?}", selection.means[9 * y + 4]);
        assert!(selection.errors[9 * y + 4] > 0.0 && selection.scales[9 * y + 4] > 0);
    }
}
