//! The tables of progressive multi-jittered (0,2) sequences.

use crate::keys::mix64;
use std::ops::RangeInclusive;
use std::sync::LazyLock;

/// The number of sequences.
pub(super) const SEQUENCES: usize = 16;
/// The number of points in each sequence.
pub(super) const LENGTH: usize = 1 << LOG2_LENGTH;
pub(super) const LOG2_LENGTH: u32 = 10;

/// Candidates for each point, of which the farthest from all earlier points is taken. Our choice.
const CANDIDATES: u32 = 10;

/// All sequences, one after the other, in units of 2^-32.
pub(super) fn sequences() -> &'static [[u32; 2]] {
    static ALL: LazyLock<Vec<[u32; 2]>> = LazyLock::new(|| (0..SEQUENCES as u64).flat_map(sequence).collect());
    &ALL
}

fn sequence(number: u64) -> Vec<[u32; 2]> {
    let mut random = Numbers { state: mix64(number) };
    let mut points = vec![[random.next(), random.next()]];
    while points.len() < LENGTH {
        points = doubled(&points, &mut random);
    }
    points
}

/// Random numbers of the construction.
struct Numbers {
    state: u64,
}

impl Numbers {
    fn next(&mut self) -> u32 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        (mix64(self.state) >> 32) as u32
    }

    fn below(&mut self, n: usize) -> usize {
        ((u64::from(self.next()) * n as u64) >> 32) as usize
    }
}

/// The elementary intervals of area `2^-bits` that hold a point. Shape `j` has `2^j` columns.
struct Strata {
    bits: u32,
    taken: Vec<bool>,
}

impl Strata {
    fn new(bits: u32) -> Self {
        Self { bits, taken: vec![false; (bits as usize + 1) << bits] }
    }

    fn cell(&self, j: u32, [x, y]: [u32; 2]) -> usize {
        let rows = self.bits - j;
        let [column, row] = [u64::from(x) >> (32 - j), u64::from(y) >> (32 - rows)];
        (j as usize) << self.bits | (column << rows | row) as usize
    }

    fn insert(&mut self, point: [u32; 2]) {
        for j in 0..=self.bits {
            let cell = self.cell(j, point);
            self.taken[cell] = true;
        }
    }

    fn is_free(&self, mut shapes: RangeInclusive<u32>, point: [u32; 2]) -> bool {
        shapes.all(|j| !self.taken[self.cell(j, point)])
    }
}

/// Appends as many points as there are, so that all are a net of twice the size.
///
/// Let the square have `4^k` cells. From `4^k` to `2 4^k` points, each point's partner lies in the opposite quarter of its
/// cell. From there to `4 4^k`, the partners of the first points lie beside or above them, one of the two for all; the
/// others' partners take the last quarters. With a common side each run is a net by itself.
fn doubled(points: &[[u32; 2]], random: &mut Numbers) -> Vec<[u32; 2]> {
    let n = points.len();
    let bits = n.ilog2() + 1;
    let mut strata = Strata::new(bits);
    points.iter().for_each(|p| strata.insert(*p));
    let k = (bits - 1) / 2;
    let quarter = 1_u32 << (31 - k);
    let aside = random.below(2);
    let mut all = points.to_vec();
    for i in 0..n {
        let (base, flips) = match (bits % 2, i < n / 2) {
            (1, _) => (points[i], [true, true]),
            (_, true) => (points[i], [aside == 0, aside == 1]),
            (_, false) => (points[i - n / 2], [aside == 1, aside == 0]),
        };
        let corner = [0, 1].map(|axis| (base[axis] ^ if flips[axis] { quarter } else { 0 }) & !(quarter - 1));
        let point = best_candidate(&all, &strata, corner, k + 1, random);
        strata.insert(point);
        all.push(point);
    }
    all
}

/// The candidate farthest from all points, on the torus, among free strata of the square at `corner` with `top` fixed
/// bits per axis.
///
/// The square decides all shapes' coarse axes, so the free columns and the free rows are independent of each other.
fn best_candidate(points: &[[u32; 2]], strata: &Strata, corner: [u32; 2], top: u32, random: &mut Numbers) -> [u32; 2] {
    let bits = strata.bits;
    let free = |axis: usize, shapes: RangeInclusive<u32>| -> Vec<u32> {
        let moved = |fine: u32| {
            let mut place = corner;
            place[axis] |= fine << (32 - bits);
            place
        };
        let fitting = (0..1 << (bits - top)).map(moved).filter(|p| strata.is_free(shapes.clone(), *p));
        fitting.map(|p| p[axis]).collect()
    };
    let axes = [free(0, top..=bits), free(1, 0..=bits - top)];
    let mut best = (0, corner);
    for _ in 0..CANDIDATES {
        let place = [0, 1].map(|axis: usize| {
            let stratum = axes[axis].get(random.below(axes[axis].len())).copied().unwrap_or(corner[axis]);
            stratum | random.next() >> bits
        });
        let nearest = points.iter().map(|p| distance(*p, place)).min().unwrap_or(u64::MAX);
        if nearest >= best.0 {
            best = (nearest, place);
        }
    }
    best.1
}

/// The squared distance on the torus, in units of 2^-62.
fn distance(a: [u32; 2], b: [u32; 2]) -> u64 {
    let along = |axis: usize| u64::from((a[axis].wrapping_sub(b[axis]) as i32).unsigned_abs() >> 1);
    along(0).pow(2) + along(1).pow(2)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn is_net(points: &[[u32; 2]]) -> bool {
        let mut strata = Strata::new(points.len().ilog2());
        points.iter().all(|p| {
            let free = strata.is_free(0..=strata.bits, *p);
            strata.insert(*p);
            free
        })
    }

    #[test]
    fn every_aligned_run_is_a_net() {
        for sequence in sequences().chunks_exact(LENGTH) {
            for size in (0..=LOG2_LENGTH).map(|k| 1 << k) {
                assert!(sequence.chunks_exact(size).all(is_net), "a run of {size}");
            }
        }
        // Negative control: a run that is not aligned.
        assert!(!sequences().chunks_exact(LENGTH).all(|s| is_net(&s[3..67])));
    }

    #[test]
    fn sequences_differ_and_coordinates_are_uniform() {
        let all = sequences();
        assert!(all[..LENGTH].iter().zip(&all[LENGTH..]).all(|(a, b)| a != b));
        // Nets are exact: 16 sequences have 16 points in each of 1024 columns.
        let mut columns = vec![0; LENGTH];
        all.iter().for_each(|p| columns[(p[0] >> 22) as usize] += 1);
        assert!(columns.iter().all(|n| *n == SEQUENCES));
    }
}
