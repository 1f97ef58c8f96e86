use super::*;
use crate::test_films::normal;

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
