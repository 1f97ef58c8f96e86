//! Progressive multi-jittered (0,2) points.

use crate::BlueNoise;
use crate::keys::{Seed, halves, mix64, nth_key, unit};
use crate::sobol::owen_reversed;
use dapple_core::{PointSet, SampleId};
use std::ops::RangeInclusive;
use std::sync::LazyLock;

/// Progressive multi-jittered (0,2) sequences, with blue noise across pixels [after Christensen 2018].
///
/// In each sequence, `2^k` consecutive points form a (0,k,2)-net if their first index is a multiple of `2^k`. Sixteen
/// sequences of 1024 points are computed once per process. Each new point is in a free stratum of every shape of elementary
/// interval; of ten such candidates, the one farthest from all earlier points is chosen.
///
/// The pairs of eight consecutive blocks use different sequences. Each pair has a nested shuffle of its indices and a random
/// shift modulo 1 [Cranley 1976]. By default, all pixels of a tile share sequences, shuffles and shifts, and [`BlueNoise`] adds
/// a shift for each pixel. pbrt-v4's `PMJ02BNSampler` does the same for all pairs except the position in the pixel.
///
/// ```
/// use dapple_core::{PointSet, SampleId};
/// use dapple_low_discrepancy::Pmj02;
///
/// let points = Pmj02::new(7);
/// assert!(points.couples_pixels() && !points.with_independent_pixels().couples_pixels());
/// let [x, y, ..] = points.block(SampleId::new([3, 4], 0, 5), 0);
/// assert!((0.0..1.0).contains(&x) && (0.0..1.0).contains(&y));
/// ```
///
/// # Limits
///
/// * A net shifted modulo 1 is no longer a net. [`Sobol`](crate::Sobol) preserves nets, and has a smaller error.
/// * After 1024 samples, a pair starts another sequence with its own shift.
/// * The sequences take 128 KiB of memory.
/// * From `n` to `2n` points, the free strata restrict all candidates for a new point to one cell of `1/(2n)` by `1/(2n)`. The
///   candidates differ little. The published variant without elementary intervals (`pmjbn`) has a clearer blue-noise spectrum.
///
/// Name: `pmj02`. Parameters: `seed`, `pixels` (blue-noise or independent).
#[derive(Clone, Copy, Debug)]
pub struct Pmj02 {
    sequences: Sequences,
    coupled: Option<BlueNoise<Sequences>>,
}

impl Pmj02 {
    /// Makes the point set of a seed, with blue noise across pixels. The sequences themselves are the same for all seeds.
    pub fn new(seed: u64) -> Self {
        let sequences = Sequences { seed: Seed::new(seed) };
        Self { sequences, coupled: Some(BlueNoise::new(seed, sequences)) }
    }

    /// Returns the point set with a separate choice of sequences, shuffles and shifts for each pixel.
    #[must_use]
    pub fn with_independent_pixels(self) -> Self {
        Self { coupled: None, ..self }
    }
}

impl PointSet for Pmj02 {
    fn describe(&self) -> String {
        let pixels = if self.coupled.is_some() { "blue-noise" } else { "independent" };
        format!("pmj02:seed={},pixels={pixels}", self.sequences.seed.given())
    }

    fn block(&self, id: SampleId, block: u32) -> [f32; 4] {
        match &self.coupled {
            Some(coupled) => coupled.block(id, block),
            None => self.sequences.block(id, block),
        }
    }

    fn capacity(&self) -> u64 {
        self.sequences.capacity()
    }

    fn preferred_count(&self, n: u64) -> u64 {
        self.sequences.preferred_count(n)
    }

    fn couples_pixels(&self) -> bool {
        self.coupled.is_some()
    }
}

/// The sequences, shuffled and shifted separately for each pixel.
#[derive(Clone, Copy, Debug)]
struct Sequences {
    seed: Seed,
}

/// The number of consecutive blocks whose pairs use different sequences.
const GROUP: u32 = SEQUENCES as u32 / 2;

impl PointSet for Sequences {
    fn describe(&self) -> String {
        format!("pmj02:seed={}", self.seed.given())
    }

    fn block(&self, id: SampleId, block: u32) -> [f32; 4] {
        let batch = id.index / LENGTH as u64;
        let within = (id.index % LENGTH as u64) as u32;
        // Groups are numbered from the end of the range, so that their keys differ from the keys of blocks.
        let group = self.seed.key(&id, !(block / GROUP), batch) as usize;
        let key = self.seed.key(&id, block, batch);
        let [shuffle0, shuffle1] = halves(key);
        let reversed = (within << (32 - LOG2_LENGTH)).reverse_bits();
        let pair = |number: u32, shuffle: u32, shift: u64| {
            let sequence = group.wrapping_add((2 * (block % GROUP) + number) as usize) % SEQUENCES;
            let index = owen_reversed(reversed, shuffle).reverse_bits() >> (32 - LOG2_LENGTH);
            let [x, y] = sequences()[sequence * LENGTH + index as usize];
            let [dx, dy] = halves(shift);
            [unit(x.wrapping_add(dx)), unit(y.wrapping_add(dy))]
        };
        let [a, b] = pair(0, shuffle0, nth_key(key, 0));
        let [c, d] = pair(1, shuffle1, nth_key(key, 1));
        [a, b, c, d]
    }

    /// Returns the smallest power of two of at least `n`; above 1024, the smallest multiple of 1024.
    fn preferred_count(&self, n: u64) -> u64 {
        let n = n.max(1);
        if n <= LENGTH as u64 { n.next_power_of_two() } else { n.checked_next_multiple_of(LENGTH as u64).unwrap_or(n) }
    }
}

/// The number of sequences.
const SEQUENCES: usize = 16;
/// The number of points in each sequence.
const LENGTH: usize = 1 << LOG2_LENGTH;
const LOG2_LENGTH: u32 = 10;

/// The number of candidates for each point; the one farthest from all earlier points is chosen. It is not from the paper.
const CANDIDATES: u32 = 10;

/// Returns the points of all sequences, sequence by sequence, in units of 2^-32.
fn sequences() -> &'static [[u32; 2]] {
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

/// The random number generator of the construction.
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

/// The elementary intervals of area `2^-bits` that contain a point. Shape `j` has `2^j` columns.
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

/// Returns a net of twice the size: the given points, followed by as many new ones.
///
/// The square is divided into `4^k` cells. From `4^k` to `2 4^k` points, each new point is in the quarter of the cell opposite
/// to the old point. From `2 4^k` to `4 4^k` points, two quarters of each cell are free: the neighbours of the cell's first
/// point along x and along y. The first half of the new points fills the neighbours along one axis, the same in all cells. The
/// second half fills the others. Each half is therefore a net by itself.
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

/// Returns the candidate farthest from all points, on the torus. Candidates are in free strata of the square at `corner`,
/// whose first `top` bits per axis are fixed.
///
/// The square fixes the coarser axis of every shape, so the free columns and the free rows are independent of each other.
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

/// Returns the squared distance of two points on the torus, in units of 2^-62.
fn distance(a: [u32; 2], b: [u32; 2]) -> u64 {
    let along = |axis: usize| u64::from((a[axis].wrapping_sub(b[axis]) as i32).unsigned_abs() >> 1);
    along(0).pow(2) + along(1).pow(2)
}
