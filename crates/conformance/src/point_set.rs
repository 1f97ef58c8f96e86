//! Conformance tests of point sets.

use dapple_core::{PointSet, SampleId};
use rayon::prelude::*;

/// Checks every required property of a [`PointSet`] on fixed inputs.
///
/// * Range: every coordinate is in `[0, 1)`, also at the last index, the last block and far pixels.
/// * Purity: bit-identical numbers in forward, backward and interleaved order, on several threads, in pairs of blocks, and in
///   batches of any size.
/// * Uniformity: over pixels, each coordinate has the mean and variance of uniform numbers, and reaches close to 0 and 1.
/// * Independence: coordinates are uncorrelated between pixels at five distances, between streams, and between blocks up to
///   number 4000. A pixel's samples have another order in each block. A set that couples neighbouring pixels
///   ([`PointSet::couples_pixels`]) is tested on every 1009th column and row.
/// * Distinctness: no two samples of a pixel are equal, for indices near 0, powers of two from 2^8 to 2^63, and the last index.
/// * `preferred_count(n)` is at least `n` and never decreases with `n`. A preferred count `c` has `preferred_count(c) = c`.
/// * `describe` is not empty and does not change.
///
/// # Precision
///
/// Statistical bounds are at 4.5 standard errors. Independent numbers exceed each bound with probability 6.8e-6. Over all
/// comparisons, a correct point set fails by chance with probability 0.01. Inputs are fixed, so such a failure repeats in every
/// run; try another seed.
///
/// Stratification and convergence are not checked here; test them in the point set's own crate.
///
/// # Panics
///
/// If a check fails; the message names the check.
pub fn point_set(points: &dyn PointSet) {
    describes_itself(points);
    counts(points);
    range(points);
    distinct(points);
    purity(points);
    pairs(points);
    batches(points);
    uniform(points);
    pixels_are_independent(points);
    streams_are_independent(points);
    blocks_are_independent(points);
}

/// The bound of the statistical checks, in standard errors.
const BOUND: f64 = 4.5;

/// The tested blocks: the blocks of the first 64 coordinates, and some later ones, as used by long paths.
const BLOCKS: [u32; 20] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 100, 256, 1000, 4000];

fn id(pixel: [u32; 2], stream: u32, index: u64) -> SampleId {
    SampleId::new(pixel, stream, index)
}

/// The distance of pixels whose numbers must be uncorrelated: a prime, so that it is not a multiple of a tile's side.
const FAR: u32 = 1009;

/// A sample of pixel `place` in a grid of pixels that are far enough apart to be uncorrelated.
fn far_id(points: &dyn PointSet, place: [u32; 2], stream: u32, index: u64) -> SampleId {
    let spacing = if points.couples_pixels() { FAR } else { 1 };
    id(place.map(|c| c * spacing), stream, index)
}

fn describes_itself(points: &dyn PointSet) {
    let name = points.describe();
    assert!(!name.trim().is_empty(), "describe() is empty");
    points.block(id([1, 2], 0, 3), 4);
    assert_eq!(name, points.describe(), "describe() changed after a block was read");
}

fn counts(points: &dyn PointSet) {
    let name = points.describe();
    assert!(points.capacity() > 0, "{name} has no samples: capacity() is 0");
    let mut before = 0;
    let most = points.capacity().min(1 << 40);
    let large = (12..40).flat_map(|k| [(1_u64 << k) - 1, 1 << k, (1 << k) + 1]).filter(|n| *n <= most);
    for n in (0..most.min(4096)).chain(large) {
        let count = points.preferred_count(n);
        assert!(count >= n, "{name}: preferred_count({n}) = {count} is less than {n}");
        assert!(count >= before, "{name}: preferred_count fell from {before} to {count} at {n}");
        let again = points.preferred_count(count);
        assert_eq!(again, count, "{name}: preferred_count({n}) = {count}, but preferred_count({count}) = {again}");
        before = count;
    }
}

/// Indices near which integers of common widths overflow, up to the capacity.
fn critical_indices(points: &dyn PointSet) -> Vec<u64> {
    let last = points.capacity() - 1;
    let mut indices: Vec<u64> = [8, 16, 24, 31, 32, 53, 63].iter().map(|k| 1_u64 << k).chain([0, last]).collect();
    indices.sort_unstable();
    indices.retain(|i| *i <= last);
    indices
}

fn range(points: &dyn PointSet) {
    let check = |s: SampleId, block: u32| {
        for (k, u) in points.block(s, block).into_iter().enumerate() {
            assert!(
                (0.0..1.0).contains(&u),
                "{}: coordinate {k} of block {block} at {s:?} is {u}, not in [0, 1)",
                points.describe()
            );
        }
    };
    for centre in critical_indices(points) {
        for index in centre.saturating_sub(8)..=centre.saturating_add(8).min(points.capacity() - 1) {
            for block in BLOCKS.into_iter().chain([u32::MAX - 1, u32::MAX]) {
                for pixel in [[0, 0], [3, 5], [65_535, 65_536], [u32::MAX, u32::MAX]] {
                    for stream in [0, 6, u32::MAX] {
                        check(id(pixel, stream, index), block);
                    }
                }
            }
        }
    }
    let most = points.capacity().min(32);
    (0..4096_u32).into_par_iter().for_each(|p| {
        for index in 0..most {
            check(id([p % 64, p / 64], 0, index), p % 97);
        }
    });
}

/// Checks that samples of a pixel differ. False alarms are rare: there are about 10^7 comparisons, and random pairs are equal
/// with probability 2^-48.
fn distinct(points: &dyn PointSet) {
    let last = points.capacity() - 1;
    let mut indices: Vec<u64> = critical_indices(points)
        .into_iter()
        .flat_map(|centre| centre.saturating_sub(256)..=centre.saturating_add(256).min(last))
        .collect();
    indices.sort_unstable();
    indices.dedup();
    for (block, pair) in [0, 1, 1000].into_iter().flat_map(|b| [(b, 0), (b, 2)]) {
        let read = |index: &u64| {
            let u = points.block(id([7, 9], 0, *index), block);
            ([u[pair].to_bits(), u[pair + 1].to_bits()], *index)
        };
        let mut seen: Vec<_> = indices.iter().map(read).collect();
        seen.sort_unstable();
        for twins in seen.windows(2) {
            assert!(
                twins[0].0 != twins[1].0,
                "{}: sample {} repeats as sample {} in block {block}, coordinates {pair} and {}",
                points.describe(),
                twins[0].1,
                twins[1].1,
                pair + 1
            );
        }
    }
}

/// Checks that samples read in four orders and from several threads are bit-identical.
fn purity(points: &dyn PointSet) {
    let most = points.capacity().min(16);
    let names: Vec<(SampleId, u32)> = (0..most)
        .flat_map(|i| (0..6).flat_map(move |p| [0, 1, 900].map(|b| (id([p % 3, p / 3], p % 2, i), b))))
        .collect();
    let read = |(s, b): &(SampleId, u32)| points.block(*s, *b).map(f32::to_bits);
    let forward: Vec<_> = names.iter().map(read).collect();
    let mut backward: Vec<_> = names.iter().rev().map(read).collect();
    backward.reverse();
    // A step of 7 visits every name once if 7 does not divide the number of names.
    let len = names.len();
    let step = if len.is_multiple_of(7) { 1 } else { 7 };
    let mut interleaved = vec![[0; 4]; len];
    for k in 0..len {
        interleaved[k * step % len] = read(&names[k * step % len]);
    }
    let threads: Vec<_> = names.par_iter().map(read).collect();
    let lonely: Vec<_> = names.iter().map(|n| (read(n), read(n)).1).collect();
    for (order, values) in [
        ("backward", backward),
        ("interleaved", interleaved),
        ("by several threads", threads),
        ("twice in a row", lonely),
    ] {
        for ((name, a), b) in names.iter().zip(&forward).zip(&values) {
            assert_eq!(a, b, "{}: {name:?} read {order} differs from reading forward", points.describe());
        }
    }
}

/// Checks that two blocks read together equal the blocks read one by one.
fn pairs(points: &dyn PointSet) {
    let bits = |block: [f32; 4]| block.map(f32::to_bits);
    for index in critical_indices(points) {
        for (pixel, stream) in [([0, 0], 0), ([3, 5], 1), ([u32::MAX, 65_536], u32::MAX)] {
            let id = id(pixel, stream, index);
            for first in BLOCKS {
                for second in [0, first, first + 1, u32::MAX] {
                    let together = points.two_blocks(id, [first, second]).map(bits);
                    let alone = [first, second].map(|block| bits(points.block(id, block)));
                    let name = points.describe();
                    assert_eq!(
                        together, alone,
                        "{name}: blocks {first} and {second} of {id:?} differ when read together"
                    );
                }
            }
        }
    }
}

/// Checks that a pixel's samples do not depend on how many are read at a time, or on other reads in between.
fn batches(points: &dyn PointSet) {
    let n = points.capacity().min(64);
    let whole: Vec<_> = (0..n).map(|i| points.block(id([5, 5], 0, i), 1)).collect();
    for cuts in [vec![n], vec![4; 16], vec![1; 64], vec![13, 51]] {
        let mut next = 0;
        for size in cuts {
            for index in next..(next + size).min(n) {
                assert_eq!(
                    points.block(id([5, 5], 0, index), 1),
                    whole[index as usize],
                    "{}: sample {index} changed when it was read after another number of samples",
                    points.describe()
                );
            }
            next += size;
            points.block(id([6, 5], 0, next % n), 1);
        }
    }
}

/// Checks mean, variance and range of each coordinate over pixels that are independent in every point set.
fn uniform(points: &dyn PointSet) {
    let side = 128_u32;
    let n = f64::from(side * side);
    for index in [0, 1, 5, 64, 1000].into_iter().filter(|i| *i < points.capacity()) {
        for block in [0, 1, 2, 15, 1000] {
            let (mut sum, mut square) = ([0.0_f64; 4], [0.0_f64; 4]);
            let (mut least, mut most) = ([1.0_f32; 4], [0.0_f32; 4]);
            for p in 0..side * side {
                let u = points.block(far_id(points, [p % side, p / side], 0, index), block);
                for k in 0..4 {
                    let x = f64::from(u[k]) - 0.5;
                    sum[k] += x;
                    square[k] += x * x;
                    least[k] = least[k].min(u[k]);
                    most[k] = most[k].max(u[k]);
                }
            }
            for k in 0..4 {
                let what = format!("{}: coordinate {k} of block {block} at index {index}", points.describe());
                // Var x = 1/12, and Var x² = 1/80 - 1/144 = 1/180, for x uniform on [-1/2, 1/2].
                let mean = sum[k] / (n / 12.0).sqrt();
                assert!(mean.abs() < BOUND, "{what}: the mean over pixels is {mean:.1} standard errors from 1/2");
                let variance = (square[k] - n / 12.0) / (n / 180.0).sqrt();
                assert!(variance.abs() < BOUND, "{what}: the variance is {variance:.1} standard errors from 1/12");
                // The probability that all n numbers are farther than 20/n from an end is e^-20.
                let end = (20.0 / n) as f32;
                assert!(least[k] < end && most[k] > 1.0 - end, "{what}: only {} to {} is reached", least[k], most[k]);
            }
        }
    }
}

/// The correlation coefficient of pairs of uniform numbers, whose moments are known. Times `sqrt(n)`, it is standard normal if
/// the numbers are independent.
#[derive(Default, Clone, Copy)]
struct Correlation {
    sum: f64,
    n: f64,
}

impl Correlation {
    fn add(&mut self, a: f32, b: f32) {
        self.sum += 12.0 * (f64::from(a) - 0.5) * (f64::from(b) - 0.5);
        self.n += 1.0;
    }

    fn check(&self, what: impl Fn() -> String) {
        let z = self.sum / self.n.sqrt();
        assert!(z.abs() < BOUND, "{}: correlated, {z:.1} standard errors over {} pairs", what(), self.n);
    }
}

fn pixels_are_independent(points: &dyn PointSet) {
    let side = 96_u32;
    let lags = [[1, 0], [0, 1], [1, 1], [16, 0], [64, 0]];
    BLOCKS.par_iter().enumerate().for_each(|(number, &block)| {
        // Each block is tested at one of two indices, the first two blocks at both.
        let indices = [0, 3].into_iter().enumerate().filter(|(k, _)| number < 2 || number % 2 == *k);
        for index in indices.map(|(_, index)| index).filter(|i| *i < points.capacity()) {
            let wide = side + 64;
            let row = |y: u32| (0..wide).map(move |x| points.block(far_id(points, [x, y], 0, index), block));
            let image: Vec<Vec<[f32; 4]>> = (0..wide).map(|y| row(y).collect()).collect();
            for [dx, dy] in lags {
                let mut correlations = [Correlation::default(); 4];
                for (y, x) in (0..side).flat_map(|y| (0..side).map(move |x| (y as usize, x as usize))) {
                    let (a, b) = (image[y][x], image[y + dy][x + dx]);
                    for k in 0..4 {
                        correlations[k].add(a[k], b[k]);
                    }
                }
                for (k, c) in correlations.iter().enumerate() {
                    c.check(|| {
                        format!(
                            "{}: pixels ({dx}, {dy}) apart, coordinate {k} of block {block}, index {index}",
                            points.describe()
                        )
                    });
                }
            }
        }
    });
}

fn streams_are_independent(points: &dyn PointSet) {
    let side = 96_u32;
    for [s, t] in [[0, 1], [1, 2], [0, 3], [3, 6], [4, 5]] {
        for block in [0, 1, 9] {
            let mut correlations = [Correlation::default(); 4];
            for p in 0..side * side {
                let [a, b] = [s, t].map(|stream| points.block(far_id(points, [p % side, p / side], stream, 0), block));
                for k in 0..4 {
                    correlations[k].add(a[k], b[k]);
                }
            }
            for (k, c) in correlations.iter().enumerate() {
                c.check(|| format!("{}: streams {s} and {t}, coordinate {k} of block {block}", points.describe()));
            }
        }
    }
}

/// Checks that different blocks have independent scrambles, and different orders of samples within a pixel.
fn blocks_are_independent(points: &dyn PointSet) {
    let side = 96_u32;
    let n = points.capacity().min(16);
    let pairs: Vec<[u32; 2]> = BLOCKS
        .windows(2)
        .map(|w| [w[0], w[1]])
        .chain([[0, 2], [0, 15], [1, 256], [2, 1000], [5, 4000], [15, 100]])
        .collect();
    pairs.par_iter().for_each(|&[s, t]| {
        let mut linear = [Correlation::default(); 16];
        let mut order = [0.0_f64; 16];
        for p in 0..side * side {
            let mut within = [0.0_f64; 16];
            // The order of samples is tested with more samples on fewer pixels.
            let samples = if p % 16 == 0 { n } else { 1 };
            for index in 0..samples {
                let [a, b] = [s, t].map(|block| points.block(far_id(points, [p % side, p / side], 0, index), block));
                for (k, w) in within.iter_mut().enumerate() {
                    *w += 12.0 * (f64::from(a[k / 4]) - 0.5) * (f64::from(b[k % 4]) - 0.5);
                    if index == 0 {
                        linear[k].add(a[k / 4], b[k % 4]);
                    }
                }
            }
            if samples > 1 {
                for (o, w) in order.iter_mut().zip(within) {
                    *o += (w / n as f64).powi(2);
                }
            }
        }
        for k in 0..16 {
            let what =
                || format!("{}: coordinate {} of block {s} and {} of block {t}", points.describe(), k / 4, k % 4);
            linear[k].check(what);
            // 1/n for independent numbers, twice that for nested shuffles, near 1/2 for a common order.
            let square = order[k] / f64::from(side * side / 16);
            assert!(
                n < 16 || square < 0.2,
                "{}: a pixel's samples have the same order in both; mean squared correlation {square:.2}",
                what()
            );
        }
    });
}
