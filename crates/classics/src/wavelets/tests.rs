use super::*;
use crate::test_films::{noisy_film, normal};
use dapple_core::{Filter as _, Needs};

const BASES: [Basis; 3] = [Basis::Cdf97, Basis::Cdf53, Basis::Haar];

#[test]
fn transforms_are_inverted_at_any_size() {
    for basis in BASES {
        for size in [[1, 1], [1, 7], [2, 2], [37, 19], [64, 33]] {
            let image: Vec<[f64; 2]> = (0..size[0] * size[1]).map(|i| [normal(i as u64), i as f64]).collect();
            let mut changed = image.clone();
            transform(basis, size, 0..5, &mut changed);
            assert!(size == [1, 1] || changed != image);
            restore(basis, size, 5, &mut changed);
            for (a, b) in image.iter().zip(&changed) {
                assert!((0..2).all(|c| (a[c] - b[c]).abs() < 1e-9), "{basis:?} {size:?}: {a:?} {b:?}");
            }
        }
    }
}

#[test]
fn filters_are_those_of_the_literature() {
    let [low, high] = Basis::Cdf53.filters();
    assert_eq!((low.first, high.first), (-2, 0));
    let expected: [&[f64]; 2] = [&[-0.125, 0.25, 0.75, 0.25, -0.125], &[-0.25, 0.5, -0.25]];
    for (taps, expected) in [&low, &high].into_iter().zip(expected) {
        assert_eq!(taps.weights.len(), expected.len());
        assert!(taps.weights.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12 || (a + b).abs() < 1e-12));
    }
    // The low band of JPEG 2000, from its middle.
    let [low, high] = Basis::Cdf97.filters();
    let expected = [0.602_949_018_236, 0.266_864_118_443, -0.078_223_266_529, -0.016_864_118_443, 0.026_748_757_411];
    assert_eq!((low.weights.len(), low.first, high.weights.len()), (9, -4, 7));
    assert!(expected.iter().enumerate().all(|(k, w)| (low.weights[4 + k] - w).abs() < 1e-9), "{low:?}");
    for basis in BASES {
        let [low, high] = basis.filters();
        assert!(
            (low.weights.iter().sum::<f64>() - 1.0).abs() < 1e-12 && high.weights.iter().sum::<f64>().abs() < 1e-12
        );
    }
}

#[test]
fn constants_and_ramps_have_no_details() {
    for basis in BASES {
        let mut image: Vec<[f64; 1]> =
            (0..64 * 32).map(|i| [3.0 + if basis == Basis::Haar { 0.0 } else { (i % 64) as f64 }]).collect();
        transform(basis, [64, 32], 0..2, &mut image);
        for level in 1..=2 {
            for band in 0..3 {
                let [x, y] = high_band([64, 32], level, band);
                // The ramp has corners where it is mirrored.
                for (x, y) in y.flat_map(|y| x.clone().skip(3).take(20 / level).map(move |x| (x, y))) {
                    assert!(image[y * 64 + x][0].abs() < 1e-9, "{basis:?}, level {level}, band {band}");
                }
            }
        }
    }
}

#[test]
fn variances_of_coefficients_are_those_of_noise() {
    let size = [128, 128];
    for basis in BASES {
        let cascade = basis.cascade(3);
        let variance = |i: usize| if i % 128 < 64 { 1.0 } else { 4.0 };
        let variances: Vec<f64> = (0..16384).map(variance).collect();
        let mut squares = vec![0.0; 16384];
        const DRAWS: u64 = 150;
        for draw in 0..DRAWS {
            let mut image: Vec<[f64; 1]> =
                (0..16384).map(|i| [variance(i).sqrt() * normal(draw * 16384 + i as u64)]).collect();
            transform(basis, size, 0..3, &mut image);
            squares.iter_mut().zip(&image).for_each(|(sum, [w])| *sum += w * w / DRAWS as f64);
        }
        for level in 1..=3 {
            let [_, predicted @ ..] = coefficient_variances(&cascade[level - 1], level, size, &variances);
            for (band, predicted) in predicted.iter().enumerate() {
                let [xs, ys] = high_band(size, level, band);
                // Away from the border, where mirrored pixels are not independent. The step is in the middle.
                let columns = 128 >> level;
                let middle = columns / 4..columns - columns / 4;
                let (mut got, mut wanted) = ([0.0; 2], [0.0; 2]);
                for (y, x) in middle.clone().flat_map(|y| middle.clone().map(move |x| (y, x))) {
                    let part = usize::from(x >= columns / 2);
                    got[part] += squares[(ys.start + y) * 128 + xs.start + x];
                    wanted[part] += predicted[y * columns + x];
                }
                for part in 0..2 {
                    let ratio = got[part] / wanted[part];
                    assert!((ratio - 1.0).abs() < 0.08, "{basis:?}, level {level}, band {band}, part {part}: {ratio}");
                }
                if basis == Basis::Haar {
                    assert!((predicted[0] - 0.25f64.powi(level as i32)).abs() < 1e-12, "16^-k times the sum of 4^k");
                }
            }
        }
    }
}

fn wavelet(basis: Basis, gamma: f64) -> Wavelet {
    Wavelet::with_options(WaveletOptions::default().basis(basis).gamma(gamma)).expect("options in range")
}

#[test]
fn without_shrinkage_the_image_is_kept() {
    for basis in [Basis::Cdf97, Basis::Cdf53, Basis::Haar] {
        let film = noisy_film([37, 22], 4, Needs::none().with_variance(), 1, |x, _| 10.0 + f64::from(x), |_, _| 2.0);
        let image = wavelet(basis, 0.0).apply(&film).expect("a film with variance").radiance;
        for (i, colour) in image.iter().enumerate() {
            assert!((f64::from(colour[0]) - film.mean(i)[0]).abs() < 1e-5 * film.mean(i)[0], "{basis:?}, pixel {i}");
        }
    }
}

/// The energy that shrinkage by g standard errors leaves of a coefficient of pure noise is 2 [(1 + g^2) Phi(-g) - g
/// phi(g)].
#[test]
fn shrunk_noise_has_the_energy_of_the_closed_form() {
    let size = [256, 256];
    for (gamma, wanted) in [(1.0, 0.1507), (2.0, 0.0115)] {
        let mut image: Vec<[f64; 3]> = (0..65536).map(|i| [0, 1, 2].map(|c| normal(3 * i + c))).collect();
        WaveletOptions::default().basis(Basis::Haar).gamma(gamma).shrink(size, &mut image, &vec![1.0; 65536]);
        transform(Basis::Haar, size, 0..1, &mut image);
        // Each coefficient of the first level has a variance of 1/4.
        let finest = (0..65536).filter(|i| i % 256 >= 128 || i / 256 >= 128);
        let energy = finest.flat_map(|i| image[i]).map(|w| w * w).sum::<f64>() / (3.0 * 49152.0) / 0.25;
        // The standard error of 147456 squares is below 0.5 % and 2 %.
        assert!((energy / wanted - 1.0).abs() < 0.04, "{gamma}: {energy}, not {wanted}");
    }
}

#[test]
fn noise_falls_beside_an_edge_that_stays() {
    let image = |x: u32, y: u32| if x + y < 64 { 10.0 } else { 20.0 };
    let film = noisy_film([64, 64], 8, Needs::none().with_variance(), 3, image, |_, _| 1.0);
    for basis in [Basis::Cdf97, Basis::Cdf53, Basis::Haar] {
        let filtered = wavelet(basis, 1.5).apply(&film).expect("a film with variance").radiance;
        let wrong = |i: usize| f64::from(filtered[i][0]) - image(i as u32 % 64, i as u32 / 64);
        let (flat, edge): (Vec<_>, Vec<_>) = (0..4096usize).partition(|i| (i % 64 + i / 64).abs_diff(64) > 20);
        let error = flat.iter().map(|&i| wrong(i) * wrong(i)).sum::<f64>() / flat.len() as f64;
        assert!(error < 0.25 / 8.0, "{basis:?}: {error} of {} is left", 1.0 / 8.0);
        assert!(edge.iter().all(|&i| wrong(i).abs() < 3.0), "{basis:?}: the edge is washed out");
    }
}

#[test]
fn pixels_without_samples_are_filled() {
    let mut film = noisy_film([16, 16], 0, Needs::none().with_variance(), 0, |_, _| 1.0, |_, _| 0.0);
    for i in (0..256).filter(|i| i % 5 != 0) {
        (0..4).for_each(|s| film.push(i, 0, [1.0 + 0.1 * s as f32; 3]));
    }
    let image = wavelet(Basis::Cdf97, 1.0).apply(&film).expect("a film with variance").radiance;
    assert!(image.iter().all(|colour| (colour[0] - 1.15).abs() < 1e-5));
}
