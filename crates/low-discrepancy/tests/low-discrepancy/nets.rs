//! Every elementary interval contains the same number of points.

use crate::support::id;
use dapple_core::PointSet;
use dapple_low_discrepancy::{BlueNoise, BlueNoiseKeys, Halton, LowDiscrepancy, Random, Sobol};

/// Returns the first shape of elementary intervals, as the logarithm of its columns, in which the `2^k` samples from `start` on
/// do not have one point per box.
fn uneven_shape(points: &dyn PointSet, pixel: [u32; 2], block: u32, pair: usize, start: u64, k: u32) -> Option<u32> {
    let samples: Vec<[f32; 2]> = (start..start + (1 << k))
        .map(|i| {
            let u = points.block(id(pixel, 1, i), block);
            [u[2 * pair], u[2 * pair + 1]]
        })
        .collect();
    (0..=k).find(|&columns| {
        let mut seen = vec![false; 1 << k];
        samples.iter().any(|[x, y]| {
            // Exact: 24-bit fractions times powers of two.
            let column = (x * (1 << columns) as f32) as usize;
            let row = (y * (1 << (k - columns)) as f32) as usize;
            std::mem::replace(&mut seen[column << (k - columns) | row], true)
        })
    })
}

proptest::proptest! {
    #![proptest_config(proptest::test_runner::Config::with_cases(1000))]

    /// The property holds for the first `2^k` samples, and for `2^k` samples from any multiple of `2^k` on, as in later rounds.
    /// The test is exact. Scrambling keys preserve nets in every pixel.
    #[test]
    fn elementary_intervals_of_any_sample_hold_one_point_each_s02(
        seed: u64,
        pixel: [u32; 2],
        block: u32,
        pair in 0_usize..2,
        k in 1_u32..=10,
        place in 0_u64..1 << 22,
    ) {
        let published = LowDiscrepancy::new(seed, 1 << k).unwrap();
        for points in [&Sobol::new(seed) as &dyn PointSet, &published, &BlueNoiseKeys::new(seed)] {
            for start in [0, place << k] {
                let uneven = uneven_shape(points, pixel, block, pair, start, k);
                proptest::prop_assert_eq!(uneven, None, "{}: 2^{} samples from {}", points.describe(), k, start);
            }
        }
    }
}

/// Negative controls: random points are not a net, and neither are shifted ones and a net whose index is off by one.
#[test]
fn elementary_intervals_tell_nets_from_other_points_s02() {
    assert!(uneven_shape(&Random::new(0), [0, 0], 0, 0, 0, 4).is_some());
    assert!((0..8).any(|p| uneven_shape(&Sobol::new(0), [p, 0], 0, 0, 1, 4).is_some()));
    assert!((0..8).any(|p| uneven_shape(&Halton::new(0), [p, 0], 0, 0, 0, 4).is_some()));
    let shifted = BlueNoise::new(0, Sobol::new(0));
    assert!((0..8).any(|p| uneven_shape(&shifted, [p, 0], 0, 0, 0, 4).is_some()));
}

#[test]
fn cells_of_stratified_hold_one_point_each_s02() {
    use dapple_low_discrepancy::Stratified;
    for strata in [1_u32, 2, 3, 7, 10, 16, 31] {
        let points = Stratified::new(5, strata).unwrap();
        let cells = u64::from(points.cells());
        for p in 0..20 {
            for (block, pair, grid) in [(0, 0, 0), (0, 1, 0), (3, 0, 7), (900, 1, 1 << 40)] {
                let mut seen = vec![false; cells as usize];
                for i in 0..cells {
                    let u = points.block(id([p, 3], 0, grid * cells + i), block);
                    // In f64 the product is exact enough: no 24-bit fraction is closer than 2^-24 / n to an edge.
                    let [column, row] = [0, 1].map(|k| (f64::from(u[2 * pair + k]) * f64::from(strata)) as usize);
                    assert!(
                        !std::mem::replace(&mut seen[row * strata as usize + column], true),
                        "{strata} strata, block {block}: two points in cell ({column}, {row})"
                    );
                }
            }
        }
    }
}

/// Returns true if each of the `columns x rows` boxes contains one point. An edge `k / 3^b` is not an `f32` number, so a point
/// within 2^-24 below it may count for the box above.
fn fill_boxes(samples: &[[f32; 2]], columns: u32, rows: u32) -> bool {
    let cells = |u: f32, n: u32| {
        let below = (f64::from(u) * f64::from(n)) as usize;
        let above = ((f64::from(u) + 1.0 / 16_777_216.0) * f64::from(n)) as usize;
        [below, above.min(n as usize - 1)]
    };
    let mut seen = vec![false; (columns * rows) as usize];
    let mut doubtful = Vec::new();
    for [x, y] in samples {
        let (c, r) = (cells(*x, columns), cells(*y, rows));
        if c[0] == c[1] && r[0] == r[1] {
            if std::mem::replace(&mut seen[c[0] * rows as usize + r[0]], true) {
                return false;
            }
        } else {
            doubtful.push((c, r));
        }
    }
    doubtful.into_iter().all(|(c, r)| {
        let places = c.into_iter().flat_map(|c| r.map(|r| c * rows as usize + r));
        places.into_iter().any(|place| !std::mem::replace(&mut seen[place], true))
    })
}

fn samples(
    points: &dyn PointSet,
    pixel: [u32; 2],
    block: u32,
    pair: usize,
    range: std::ops::Range<u64>,
) -> Vec<[f32; 2]> {
    let read = |i| points.block(id(pixel, 0, i), block);
    range.map(read).map(|u| [u[2 * pair], u[2 * pair + 1]]).collect()
}

#[test]
fn boxes_of_halton_hold_one_point_each_in_bases_2_and_3_and_5_and_7_s02() {
    for seed in [0, 1, 0xdead_beef_0bad_cafe] {
        let points = Halton::new(seed);
        for p in 0..20 {
            let pixel = [p * 17, p * 3];
            for (pair, p, q) in [(0, 2_u32, 3_u32), (1, 5, 7)] {
                for (a, b) in (0..=8).flat_map(|a| (0..=6).map(move |b| (a, b))) {
                    let (columns, rows) = (u64::from(p).pow(a), u64::from(q).pow(b));
                    if columns * rows > 1300 {
                        continue;
                    }
                    for start in [0, 1000, (1 << 32) - columns * rows] {
                        let s = samples(&points, pixel, 0, pair, start..start + columns * rows);
                        assert!(
                            fill_boxes(&s, columns as u32, rows as u32),
                            "seed {seed}, pixel {pixel:?}: {p}^{a} x {q}^{b} from {start}"
                        );
                    }
                }
            }
        }
    }
}

#[test]
fn boxes_of_halton_hold_one_point_each_in_later_pairs_s02() {
    for seed in [0, 1, 0xdead_beef_0bad_cafe] {
        let points = Halton::new(seed);
        for p in 0..25 {
            for (block, pair) in [(1, 0), (1, 1), (800, 0)] {
                for (columns, rows) in [(2, 1), (2, 3), (4, 3), (4, 9), (8, 27), (16, 81)] {
                    let n = u64::from(columns * rows);
                    for start in [0, 7 * n] {
                        let s = samples(&points, [p, 9], block, pair, start..start + n);
                        assert!(fill_boxes(&s, columns, rows), "{n} samples of block {block}");
                    }
                }
            }
        }
    }
    // Negative control.
    let random = samples(&Random::new(0), [0, 0], 1, 0, 0..36);
    assert!(!fill_boxes(&random, 4, 9));
}
