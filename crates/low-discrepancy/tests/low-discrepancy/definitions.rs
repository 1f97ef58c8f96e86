//! Point sets compared with their definitions: Sobol' points, lattices, nets assigned to pixels, tabulated sequences.

use crate::keys::{Seed, halves, nth_key, unit};
use crate::support::id;
use dapple_core::PointSet;
use dapple_low_discrepancy::{Halton, Lattice, Pmj02, Sobol, ZSobol};
use sobol_burley::parts::owen_scramble_rev;

/// Dimension 2 of [Joe 2008] has the polynomial x + 1 (s = 1, a = 0) and m_1 = 1; dimension 1 is van der Corput's
/// sequence. The recurrence is m_k = 2 m_{k-1} xor m_{k-1}.
fn joe_kuo_dimension_2(mut index: u32) -> u32 {
    let (mut m, mut x) = (1_u32, 0);
    for k in 0..32 {
        if index & 1 == 1 {
            x ^= m << (31 - k);
        }
        index >>= 1;
        m ^= m << 1;
    }
    x
}

/// Sobol' points from the direction numbers of Joe and Kuo, shuffled and scrambled by the hash of `sobol_burley`.
#[test]
fn matches_the_direction_numbers_of_joe_and_kuo_and_the_scramble_of_sobol_burley() {
    for i in 0..20_000_u32 {
        let id = id([i % 7, i % 5], i % 3, u64::from(i.wrapping_mul(0x9e37_79b9)) | u64::from(i % 2) << 32);
        let key = Seed::new(4).key(&id, i % 11, id.index >> 32);
        let pair = |shuffle: u32, scrambles: u64| {
            let index = owen_scramble_rev((id.index as u32).reverse_bits(), shuffle).reverse_bits();
            let [x, y] = halves(scrambles);
            let y = owen_scramble_rev(joe_kuo_dimension_2(index).reverse_bits(), y);
            [owen_scramble_rev(index, x), y].map(|reversed| unit(reversed.reverse_bits()))
        };
        let [first, second] = halves(key);
        let wanted = [pair(first, nth_key(key, 0)), pair(second, nth_key(key, 1))].concat();
        assert_eq!(Sobol::new(4).block(id, i % 11)[..], wanted, "sample {i}");
    }
}

/// The second component of the lattices' generating vector.
const MULTIPLIER: u32 = 1_063_578_985;

#[test]
fn samples_of_a_lattice_are_multiples_of_its_vector() {
    for i in 0..20_000_u32 {
        let id = id([i % 7, i % 5], i % 3, u64::from(i.wrapping_mul(0x9e37_79b9)) | u64::from(i % 2) << 32);
        let key = Seed::new(4).key(&id, i % 11, id.index >> 32);
        let pair = |shuffle: u32, shift: u64| {
            let x = owen_scramble_rev((id.index as u32).reverse_bits(), shuffle);
            let [dx, dy] = halves(shift);
            [unit(x.wrapping_add(dx)), unit(x.wrapping_mul(MULTIPLIER).wrapping_add(dy))]
        };
        let [first, second] = halves(key);
        let wanted = [pair(first, nth_key(key, 0)), pair(second, nth_key(key, 1))].concat();
        assert_eq!(Lattice::new(4).block(id, i % 11)[..], wanted, "sample {i}");
    }
}

/// Returns the squared minimum distance of the lattice of `2^m` points, relative to the hexagonal lattice of equal density (`2
/// / sqrt(3)` per point). It is computed by Gauss' reduction of the basis.
fn quality(multiplier: u32, m: u32) -> f64 {
    let n = 1_i128 << m;
    let dot = |a: [i128; 2], b: [i128; 2]| a[0] * b[0] + a[1] * b[1];
    let (mut u, mut v) = ([1, i128::from(multiplier) % n], [0, n]);
    loop {
        if dot(u, u) > dot(v, v) {
            std::mem::swap(&mut u, &mut v);
        }
        let times = (2 * dot(u, v) + dot(u, u)).div_euclid(2 * dot(u, u));
        if times == 0 {
            return dot(u, u) as f64 / n as f64 / (2.0 / 3.0_f64.sqrt());
        }
        v = [v[0] - times * u[0], v[1] - times * u[1]];
    }
}

/// Returns `P_2` of the lattice of `2^m` points: the mean of a product of Bernoulli polynomials, minus 1.
fn p2(multiplier: u32, m: u32) -> f64 {
    let n = 1_u64 << m;
    let factor = |i: u64| {
        let x = i as f64 / n as f64;
        1.0 + 2.0 * std::f64::consts::PI.powi(2) * (x * x - x + 1.0 / 6.0)
    };
    let sum: f64 = (0..n).map(|i| factor(i) * factor(i * u64::from(multiplier) % n)).sum();
    sum / n as f64 - 1.0
}

/// The multiplier is compared with all others for sizes at which this is fast enough.
#[test]
fn the_multiplier_has_the_stated_quality_at_every_size() {
    let ratio = |multiplier, m| {
        let best = (0..1_u32 << (m - 1)).map(|k| p2(2 * k + 1, m)).fold(f64::INFINITY, f64::min);
        p2(multiplier, m) / best
    };
    let worst = |multiplier| (4..=11).map(|m| ratio(multiplier, m)).fold(0.0, f64::max);
    assert!((worst(MULTIPLIER) - 2.17).abs() < 5e-3, "{}", worst(MULTIPLIER));
    let closest = |multiplier| (19..=32).map(|m| quality(multiplier, m)).fold(f64::INFINITY, f64::min);
    assert!((closest(MULTIPLIER) - 0.5405).abs() < 5e-4, "{}", closest(MULTIPLIER));
    // Negative controls: the diagonal of a grid, and a random odd number.
    assert!(worst(1) > 100.0 && closest(1) < 1e-3, "{} {}", worst(1), closest(1));
    assert!(worst(0x9e37_79b9) > 3.0, "{}", worst(0x9e37_79b9));
}

/// The lattice (1, 5) modulo 16 has the reduced basis (3, -1), (1, 5). One point in each of two cells has a closed
/// form: `P_2` of the lattice (1, 1) modulo 2.
#[test]
fn the_criteria_have_their_closed_forms() {
    assert!((quality(5, 4) - 10.0 / 16.0 / (2.0 / 3.0_f64.sqrt())).abs() < 1e-12);
    let b = 2.0 * std::f64::consts::PI.powi(2);
    let wanted = 0.5 * ((1.0 + b / 6.0).powi(2) + (1.0 - b / 12.0).powi(2)) - 1.0;
    assert!((p2(1, 1) - wanted).abs() < 1e-12);
}

/// The differences of `2^m` samples from a multiple of `2^m` on are the lattice of `2^m` points.
#[test]
fn aligned_runs_are_shifted_lattices() {
    let points = Lattice::new(3);
    for (m, start) in [(2, 0), (4, 48), (6, 192), (8, 1024)] {
        for first in [0, 2] {
            let cell = |i: u64| {
                let u = points.block(id([9, 1], 0, start + i), 2);
                let origin = points.block(id([9, 1], 0, start), 2);
                [0, 1].map(|k| {
                    let n = f64::from(1_u32 << m);
                    let steps = (f64::from(u[first + k]) - f64::from(origin[first + k])) * n;
                    // A coordinate has 24 bits.
                    assert!((steps - steps.round()).abs() < n * 1.3e-7, "{steps}");
                    (steps.round() as i64).rem_euclid(1 << m)
                })
            };
            let mut seen = vec![false; 1 << m];
            for i in 0..1 << m {
                let [x, y] = cell(i);
                assert_eq!((x * i64::from(MULTIPLIER)).rem_euclid(1 << m), y, "2^{m} from {start}: not a lattice");
                assert!(!std::mem::replace(&mut seen[x as usize], true), "2^{m} from {start}: a point twice");
            }
        }
    }
}

/// The four pixels of a block use the four quarters in all 24 orders equally often. Chi-square with 23 degrees of freedom over
/// 24,000 blocks of random numbers exceeds 64 with probability 1e-5. A base-2 scramble would give only 8 of the orders.
#[test]
fn all_orders_of_a_digit_occur_equally_often() {
    let mut counts = std::collections::BTreeMap::new();
    let points = ZSobol::new(5, 1).unwrap();
    for block in 0..24_000 {
        let quarter = |p: u32| points.block(id([6 + p % 2, 8 + p / 2], 0, 0), block).map(|u| u >= 0.5);
        *counts.entry([0, 1, 2, 3].map(|p| [quarter(p)[0], quarter(p)[1]])).or_insert(0_u32) += 1;
    }
    let chi2: f64 = counts.values().map(|c| (f64::from(*c) - 1000.0).powi(2) / 1000.0).sum();
    assert!(counts.len() == 24 && chi2 < 64.0, "{} orders, chi2 {chi2:.1}", counts.len());
}

/// Returns true if there is one point in each elementary interval of every shape.
fn is_net(points: &[[f32; 2]]) -> bool {
    let m = points.len().trailing_zeros();
    (0..=m).all(|a| {
        let (wide, high) = ((1_u32 << a) as f32, (1_u32 << (m - a)) as f32);
        let mut seen = vec![false; points.len()];
        let cells = points.iter().map(|[x, y]| (x * wide) as usize * (1 << (m - a)) + (y * high) as usize);
        cells.into_iter().all(|cell| !std::mem::replace(&mut seen[cell], true))
    })
}

fn block_of(points: &dyn PointSet, corner: [u32; 2], side: u32, spp: u64, first: usize) -> Vec<[f32; 2]> {
    let places = (0..side * side).flat_map(|p| (0..spp).map(move |i| (p, i)));
    let sample = |(p, i): (u32, u64)| {
        let u = points.block(id([corner[0] + p % side, corner[1] + p / side], 0, i), 3);
        [u[first], u[first + 1]]
    };
    places.map(sample).collect()
}

#[test]
fn aligned_blocks_of_pixels_are_nets() {
    for (count, side) in [(1, 1), (1, 2), (1, 16), (2, 8), (8, 4), (16, 4), (64, 1)] {
        for corner in [[0, 0], [48, 16], [32_768, 65_520]] {
            for first in [0, 2] {
                let net = |points: &dyn PointSet| is_net(&block_of(points, corner, side, count, first));
                let what = format!("{count} samples, {side}x{side} pixels at {corner:?}");
                assert!(net(&ZSobol::new(5, count as u32).unwrap()), "{what}");
                // Negative control: each pixel has its own sequence.
                assert!(side < 4 || !net(&Sobol::new(5)), "{what}: the control is a net too");
            }
        }
    }
}

/// Returns the 1024 points of each of the 16 sequences of `pmj02`, in the order of one pixel's samples. The shift is removed,
/// except in 8 bits that do not matter below.
fn sequences() -> Vec<Vec<[f32; 2]>> {
    let points = Pmj02::new(3).with_independent_pixels();
    let of = |number: usize| {
        let (block, pair) = (number as u32 / 2, number % 2);
        let point = |index| {
            let id = id([0, 0], 0, index);
            let shift = halves(nth_key(Seed::new(3).key(&id, block, 0), pair as u64));
            let u = points.block(id, block);
            std::array::from_fn(|k| unit((((u[2 * pair + k] * 16_777_216.0) as u32) << 8 | 128).wrapping_sub(shift[k])))
        };
        (0..1024).map(point).collect()
    };
    (0..16).map(of).collect()
}

#[test]
fn every_aligned_run_is_a_net() {
    let all = sequences();
    for sequence in &all {
        for size in (0..=10).map(|k| 1 << k) {
            assert!(sequence.chunks_exact(size).all(is_net), "a run of {size}");
        }
    }
    // Negative control: a run that is not aligned.
    assert!(!all.iter().all(|sequence| is_net(&sequence[3..67])));
}

#[test]
fn sequences_differ() {
    let mut all = sequences();
    all.iter_mut().for_each(|points| points.sort_by(|a, b| a[0].total_cmp(&b[0])));
    assert!((0..16).all(|a| (0..a).all(|b| all[a].iter().zip(&all[b]).all(|(a, b)| a != b))));
}

#[test]
fn preferred_counts_are_powers_of_two_and_their_halves_more() {
    let counts: Vec<u64> = (0..26).map(|n| Sobol::new(0).preferred_count(n)).collect();
    let ladder = [1, 1, 2, 3, 4, 6, 6, 8, 8, 12, 12, 12, 12, 16, 16, 16, 16, 24, 24, 24, 24, 24, 24, 24, 24, 32];
    assert_eq!(counts, ladder);
    assert_eq!(Sobol::new(0).preferred_count((3 << 31) - 1), 3 << 31);
    assert_eq!(Sobol::new(0).preferred_count(u64::MAX), u64::MAX);
}

#[test]
fn preferred_counts_fill_blocks_of_six() {
    let halton = Halton::new(0);
    let counts: Vec<u64> = [0, 1, 5, 6, 7, 12, 25, 36, 37, 72, 73, 216, 217].map(|n| halton.preferred_count(n)).into();
    assert_eq!(counts, [1, 1, 5, 6, 12, 12, 30, 36, 72, 72, 108, 216, 432]);
    assert!(halton.preferred_count(u64::MAX) == u64::MAX);
}
