//! Shrinkage of wavelet coefficients.

use crate::support::{VARIANCE, frame, image, noisy_film, normal};
use dapple_classics::{Basis, Wavelet, WaveletOptions};
use dapple_conformance::statistics::Mean;
use dapple_core::Film;

const BASES: [Basis; 3] = [Basis::Cdf97, Basis::Cdf53, Basis::Haar];

fn wavelet(basis: Basis, gamma: f64) -> Wavelet {
    Wavelet::with_options(WaveletOptions::default().basis(basis).gamma(gamma)).expect("options in range")
}

#[test]
fn images_of_any_size_stay_if_nothing_is_shrunk() {
    for basis in BASES {
        for size in [[1, 1], [1, 7], [2, 2], [37, 19], [64, 33]] {
            let film = noisy_film(size, 2, VARIANCE, 1, |x, _| 10.0 + f64::from(x), |_, _| 1.0);
            for (a, b) in image(&wavelet(basis, 0.0), &film).iter().zip(film.image()) {
                assert!((0..3).all(|c| (a[c] - b[c]).abs() < 1e-5), "{basis:?} {size:?}: {a:?} {b:?}");
            }
        }
    }
}

/// The filters of a basis in the literature: low band and high band, as the offset of the first weight from the even sample, and
/// weights. Those of 9/7 are JPEG 2000's, and the sum of the high band's, with alternating signs, is 1 here.
fn filters(basis: Basis) -> [(i64, Vec<f64>); 2] {
    let symmetric = |first: i64, half: &[f64]| (first, half.iter().rev().chain(&half[1..]).copied().collect());
    match basis {
        Basis::Cdf97 => [
            symmetric(
                -4,
                &[0.602_949_018_236, 0.266_864_118_443, -0.078_223_266_529, -0.016_864_118_443, 0.026_748_757_411],
            ),
            symmetric(-2, &[0.557_543_526_228, -0.295_635_881_557, -0.028_771_763_114, 0.045_635_881_557]),
        ],
        Basis::Cdf53 => [symmetric(-2, &[0.75, 0.25, -0.125]), symmetric(0, &[0.5, -0.25])],
        Basis::Haar => [(0, vec![0.5, 0.5]), (0, vec![-0.5, 0.5])],
    }
}

/// The columns of an image, given by rows, through a filter at every second place of a row. Rows are mirrored at their ends.
fn halved(rows: &[Vec<f64>], (first, weights): &(i64, Vec<f64>)) -> Vec<Vec<f64>> {
    let last = rows[0].len() as i64 - 1;
    let mirrored = |k: i64| (last - (last - k.rem_euclid(2 * last)).abs()) as usize;
    let sum = |row: &Vec<f64>, j: i64| weights.iter().zip(2 * j + first..).map(|(w, k)| w * row[mirrored(k)]).sum();
    (0..=last / 2).map(|j| rows.iter().map(|row| sum(row, j)).collect()).collect()
}

/// The filter `finer`, taken at every `spacing`-th place, followed by `next`.
fn then(finer: &[f64], next: &[f64], spacing: usize) -> Vec<f64> {
    let mut weights = vec![0.0; (next.len() - 1) * spacing + finer.len()];
    for (k, outer) in next.iter().enumerate() {
        weights[k * spacing..].iter_mut().zip(finer).for_each(|(sum, inner)| *sum += outer * inner);
    }
    weights
}

/// The energy that shrinkage by one standard error leaves of a coefficient of pure noise, `2 [2 Phi(-1) - phi(1)]`.
const LEFT: f64 = 0.150_68;

/// The filtered image of noise is taken apart again. Standard errors are those of the bases in the literature.
#[test]
fn shrunk_noise_has_the_energy_of_the_closed_form() {
    let (size, deviation) = (256, |x: usize| if x < 128 { 1.0 } else { 2.0 });
    for basis in BASES {
        let [low, high] = filters(basis);
        let mut left: [[Mean; 2]; 3] = Default::default();
        for seed in 0..4 {
            // Two samples give each mean its exact variance.
            let mut film = Film::new(frame([size as u32; 2]), VARIANCE);
            for i in 0..size * size {
                let d = deviation(i % size);
                let mean = [0, 1, 2].map(|c| 100.0 + d * normal(((3 * seed + c) << 32) + i as u64));
                [-d, d].iter().for_each(|d| film.push(i, 0, mean.map(|x| (x + d) as f32)));
            }
            let filtered = image(&wavelet(basis, 1.0), &film);
            for c in 0..3 {
                let mut rows: Vec<Vec<f64>> =
                    filtered.chunks(size).map(|row| row.iter().map(|x| f64::from(x[c])).collect()).collect();
                let mut finer = vec![1.0];
                for (level, left) in left.iter_mut().enumerate() {
                    let [of_low, of_high] = [&low, &high].map(|(_, weights)| then(&finer, weights, 1 << level));
                    let energies = [&of_low, &of_high].map(|weights| weights.iter().map(|w| w * w).sum::<f64>());
                    finer = of_low;
                    let [columns, columns_of_high] = [&low, &high].map(|taps| halved(&rows, taps));
                    let bands = [(&columns_of_high, &low), (&columns, &high), (&columns_of_high, &high)];
                    let energies = [energies[0], energies[0], energies[1]].map(|other| energies[1] * other);
                    for ((columns, taps), energy) in bands.into_iter().zip(energies) {
                        let band = halved(columns, taps);
                        // Away from the border, whose pixels count twice, and from the step in the middle.
                        let eighth = band.len() / 8;
                        for (part, left) in left.iter_mut().enumerate() {
                            let of_row =
                                |row: &Vec<f64>| row[(1 + 4 * part) * eighth..(3 + 4 * part) * eighth].to_vec();
                            let inner = band[eighth..7 * eighth].iter().flat_map(of_row);
                            let one = energy * deviation(200 * part).powi(2) * LEFT;
                            inner.for_each(|w| left.add(w * w / one));
                        }
                    }
                    rows = halved(&columns, &low);
                }
            }
        }
        for (level, left) in left.iter().flatten().enumerate() {
            let limit = [0.08, 0.12, 0.25][level / 2];
            assert!((left.mean - 1.0).abs() < limit, "{basis:?}, {level}: {left:?}");
        }
    }
}

#[test]
fn noise_falls_beside_an_edge_that_stays() {
    let truth = |x: u32, y: u32| if x + y < 64 { 10.0 } else { 20.0 };
    let film = noisy_film([64, 64], 8, VARIANCE, 3, truth, |_, _| 1.0);
    for basis in BASES {
        let filtered = image(&wavelet(basis, 1.5), &film);
        let wrong = |i: usize| f64::from(filtered[i][0]) - truth(i as u32 % 64, i as u32 / 64);
        let (flat, edge): (Vec<_>, Vec<_>) = (0..4096usize).partition(|i| (i % 64 + i / 64).abs_diff(64) > 20);
        let error = flat.iter().map(|&i| wrong(i) * wrong(i)).sum::<f64>() / flat.len() as f64;
        assert!(error < 0.25 / 8.0, "{basis:?}: {error} of {} is left", 1.0 / 8.0);
        assert!(edge.iter().all(|&i| wrong(i).abs() < 3.0), "{basis:?}: the edge is washed out");
    }
}

#[test]
fn pixels_without_samples_are_filled() {
    let mut film = noisy_film([16, 16], 0, VARIANCE, 0, |_, _| 1.0, |_, _| 0.0);
    for i in (0..256).filter(|i| i % 5 != 0) {
        (0..4).for_each(|s| film.push(i, 0, [1.0 + 0.1 * s as f32; 3]));
    }
    let image = image(&wavelet(Basis::Cdf97, 1.0), &film);
    assert!(image.iter().all(|colour| (colour[0] - 1.15).abs() < 1e-5));
}
