//! A tile of blue noise: ranks by void and cluster.

use std::sync::LazyLock;

/// The side of the tile in pixels, a power of two.
pub(crate) const SIDE: usize = 128;

/// The number of pixels of the tile. Each has its own rank.
pub(crate) const PIXELS: usize = SIDE * SIDE;

/// The standard deviation of the filter in pixels [Ulichney 1993].
const SIGMA: f64 = 1.5;

/// The radius at which the filter ends. Its weight there is below 2e-8.
const RADIUS: i32 = 9;

/// The share of pixels in the initial pattern, one in this many. Our choice.
const INITIAL: usize = 10;

/// The tile, row by row: a permutation of `0..PIXELS`.
///
/// Every set of the pixels with the lowest `k` ranks is evenly spread, and so is its complement. The tile is periodic.
pub(crate) fn tile() -> &'static [u16] {
    static TILE: LazyLock<Vec<u16>> = LazyLock::new(ranks);
    &TILE
}

/// The ranks by the method of [Ulichney 1993]. His last two phases are one here: the largest void among ones is the
/// tightest cluster among zeros, since the filter is linear.
fn ranks() -> Vec<u16> {
    let mut pattern = Pattern::new();
    let mut ones = 0;
    // Hashed places, so that the pattern is the same on every machine.
    for k in 0.. {
        let place = (crate::keys::mix64(k) >> 32) as usize % PIXELS;
        if !pattern.on[place] {
            pattern.set(place, true);
            ones += 1;
        }
        if ones == PIXELS / INITIAL {
            break;
        }
    }
    loop {
        let cluster = pattern.tightest_cluster();
        pattern.set(cluster, false);
        let void = pattern.largest_void();
        pattern.set(void, true);
        if void == cluster {
            break;
        }
    }
    let mut ranks = vec![0; PIXELS];
    let mut first = pattern.clone();
    for rank in (0..ones).rev() {
        let place = first.tightest_cluster();
        first.set(place, false);
        ranks[place] = rank as u16;
    }
    for rank in ones..PIXELS {
        let place = pattern.largest_void();
        pattern.set(place, true);
        ranks[place] = rank as u16;
    }
    ranks
}

/// A binary pattern with its filtered values, and the extrema of each row.
#[derive(Clone)]
struct Pattern {
    on: Vec<bool>,
    /// The filtered pattern in whole numbers, so that setting and clearing a pixel is exact.
    energy: Vec<u64>,
    /// In each row the one of highest energy and the zero of lowest energy, if there are any.
    extrema: Vec<[Option<usize>; 2]>,
    kernel: Vec<u64>,
}

impl Pattern {
    fn new() -> Self {
        let weight = |dx: i32, dy: i32| {
            let squared = f64::from(dx * dx + dy * dy);
            (libm::exp(-squared / (2.0 * SIGMA * SIGMA)) * f64::from(1 << 30)) as u64
        };
        let kernel = (-RADIUS..=RADIUS).flat_map(|dy| (-RADIUS..=RADIUS).map(move |dx| weight(dx, dy))).collect();
        let extrema = (0..SIDE).map(|row| [None, Some(row * SIDE)]).collect();
        Self { on: vec![false; PIXELS], energy: vec![0; PIXELS], extrema, kernel }
    }

    fn set(&mut self, place: usize, on: bool) {
        self.on[place] = on;
        let (x, y) = (place % SIDE, place / SIDE);
        let width = (2 * RADIUS + 1) as usize;
        for (dy, weights) in self.kernel.chunks_exact(width).enumerate() {
            let row = (y + SIDE + dy - RADIUS as usize) % SIDE;
            for (dx, weight) in weights.iter().enumerate() {
                let at = row * SIDE + (x + SIDE + dx - RADIUS as usize) % SIDE;
                let energy = self.energy[at];
                self.energy[at] = if on { energy + weight } else { energy - weight };
            }
            self.extrema[row] = self.extrema_of(row);
        }
    }

    /// Ties go to the first place.
    fn extrema_of(&self, row: usize) -> [Option<usize>; 2] {
        let places = row * SIDE..(row + 1) * SIDE;
        let cluster = places.clone().filter(|p| self.on[*p]).rev().max_by_key(|p| self.energy[*p]);
        let void = places.filter(|p| !self.on[*p]).min_by_key(|p| self.energy[*p]);
        [cluster, void]
    }

    fn tightest_cluster(&self) -> usize {
        let found = self.extrema.iter().rev().filter_map(|row| row[0]).max_by_key(|p| self.energy[*p]);
        found.unwrap_or_default()
    }

    fn largest_void(&self) -> usize {
        let found = self.extrema.iter().filter_map(|row| row[1]).min_by_key(|p| self.energy[*p]);
        found.unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_rank_occurs_once() {
        let mut seen = vec![false; PIXELS];
        for rank in tile() {
            assert!(!std::mem::replace(&mut seen[usize::from(*rank)], true), "{rank} twice");
        }
    }

    /// The pixels below a threshold fill each block of 32 x 32 pixels equally. Independent pixels, the negative control,
    /// deviate by `sqrt(1024 p (1 - p))` pixels.
    #[test]
    fn every_threshold_is_evenly_spread() {
        let rms = |ranks: &[u16], below: usize| {
            let block = |b: usize| {
                let places = (0..1024).map(|k| (b / 4 * 32 + k / 32) * SIDE + b % 4 * 32 + k % 32);
                places.filter(|p| usize::from(ranks[*p]) < below).count() as f64
            };
            let wanted = 1024.0 * below as f64 / PIXELS as f64;
            ((0..16).map(|b| (block(b) - wanted).powi(2)).sum::<f64>() / 16.0).sqrt()
        };
        let mut shuffled = tile().to_vec();
        shuffled.sort_unstable_by_key(|rank| crate::keys::mix64(u64::from(*rank)));
        for share in [0.1, 0.25, 0.5, 0.75, 0.9_f64] {
            let below = (share * PIXELS as f64) as usize;
            let white = (1024.0 * share * (1.0 - share)).sqrt();
            let (found, control) = (rms(tile(), below), rms(&shuffled, below));
            assert!(found < 0.3 * white, "{share}: {found:.2} pixels, {white:.2} for white noise");
            assert!((control / white - 1.0).abs() < 0.6, "{share}: the control has {control:.2}, not {white:.2}");
        }
    }
}
