//! Planes between two bins of centres, the best of which cut a node.

use super::items::ItemBox;
use glam::Vec3A;
use obvhs::aabb::Aabb;
use rayon::prelude::*;

/// The number of items that one task looks over.
pub(super) const CHUNK: usize = 1 << 14;
/// The number of items up to which a median is good enough, in trees of up to [`FEW_IN_ALL`] items and in larger ones. A leaf
/// holds as many. With 8, a room of 712 triangles has 8 % more expected cost (docs/results/rays.md).
const SMALL: [usize; 2] = [4, 8];
/// The largest number of items of a small tree.
pub(super) const FEW_IN_ALL: usize = 1 << 15;
/// The number of items that the cut of a node is chosen by if it has at least twice as many.
pub(super) const CHOSEN_BY: usize = 1 << 12;
/// The least area of the box around these items, over that of the node. With less, all items choose.
pub(super) const SEEN: f32 = 0.8;
/// 2^32 over the golden ratio, whose multiples are scattered modulo 2^32.
const SCATTER: u32 = 2_654_435_769;

/// The box around some items, and the box around their centres, doubled.
#[derive(Clone, Copy)]
pub(super) struct Extent {
    pub(super) around: Aabb,
    pub(super) centres: Aabb,
}

impl Extent {
    pub(super) const NONE: Self = Self { around: Aabb::INVALID, centres: Aabb::INVALID };

    #[inline(always)]
    pub(super) fn add(&mut self, item: &ItemBox) {
        self.around = self.around.union(&item.aabb());
        self.centres.extend(item.centre());
    }

    pub(super) fn of(items: &[ItemBox]) -> Self {
        let mut extent = Self::NONE;
        items.iter().for_each(|item| extent.add(item));
        extent
    }

    pub(super) fn joined(self, other: Self) -> Self {
        Self { around: self.around.union(&other.around), centres: self.centres.union(&other.centres) }
    }
}

/// The choice of cuts.
#[derive(Clone, Copy)]
pub(super) struct Rules {
    /// The number of levels of best cuts. Nodes below them are cut at the median.
    pub(super) levels: usize,
    /// The largest number of items of a node that is cut at the median anyway.
    pub(super) small: usize,
    /// The largest number of items of a leaf.
    pub(super) group: usize,
    /// See [`CHOSEN_BY`].
    pub(super) chosen_by: usize,
    /// See [`SEEN`].
    pub(super) seen: f32,
}

impl Rules {
    /// Cuts at the median only, in a tree of so many items.
    pub(super) fn medians(items: usize) -> Self {
        Self { levels: 0, small: SMALL[usize::from(items > FEW_IN_ALL)], group: 1, chosen_by: CHOSEN_BY, seen: SEEN }
    }

    pub(super) fn below(self) -> Self {
        Self { levels: self.levels.saturating_sub(1), ..self }
    }
}

/// The map from centres to bins, by axis.
#[derive(Clone, Copy)]
struct Grid {
    low: Vec3A,
    scale: Vec3A,
}

/// The least f32 from which on consecutive numbers differ by one: a sum of it and a small number is rounded to a whole number,
/// which its lowest bits hold.
const WHOLE: f32 = (1u32 << 23) as f32;

impl Grid {
    /// Returns [`WHOLE`] and the bin, for each axis.
    #[inline(always)]
    fn place(&self, item: &ItemBox) -> Vec3A {
        (item.centre() - self.low) * self.scale + Vec3A::splat(WHOLE)
    }
}

/// A cut of a node: bins below `bin` along `axis` are on the left side.
pub(super) struct Plane {
    grid: Grid,
    axis: usize,
    bin: usize,
}

impl Plane {
    #[inline(always)]
    pub(super) fn is_left(&self, item: &ItemBox) -> bool {
        let limit = Vec3A::splat(WHOLE + self.bin as f32);
        self.grid.place(item).cmplt(limit).bitmask() >> self.axis & 1 == 1
    }

    /// Returns the plane of least cost between two of `N` bins on any axis; `None` if costs are no numbers.
    pub(super) fn best<const N: usize>(items: &[ItemBox], extent: &Extent, rules: Rules) -> Option<Self> {
        let span = extent.centres.diagonal();
        let scale = Vec3A::splat((N - 1) as f32) / span.max(Vec3A::splat(f32::MIN_POSITIVE * 1024.0));
        let grid = Grid { low: extent.centres.min, scale };
        let run = items.len() / rules.chosen_by;
        let part = (run > 1).then(|| {
            // One item of each run, not always the same one: meshes repeat themselves.
            let within = |n: usize| ((u64::from((n as u32).wrapping_mul(SCATTER)) * run as u64) >> 32) as usize;
            Bins::<N>::of((0..rules.chosen_by).map(|n| &items[n * run + within(n)]), &grid)
        });
        // A part may lack the few large items of a node.
        let whole = extent.around.half_area();
        let part = part.filter(|part| part.around().half_area() >= rules.seen * whole);
        let bins = part.unwrap_or_else(|| Bins::of_all(items, &grid));
        let axes = (0..3).filter(|&axis| span[axis] > 0.0);
        let best = axes.filter_map(|axis| bins.best(axis).map(|(cost, bin)| (cost, axis, bin)));
        best.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, axis, bin)| Self { grid, axis, bin })
    }
}

/// The items of a node by the bin that their centre lies in, for each axis.
struct Bins<const N: usize> {
    boxes: [[Aabb; N]; 3],
    counts: [[u32; N]; 3],
}

impl<const N: usize> Bins<N> {
    const EMPTY: Self = Self { boxes: [[Aabb::INVALID; N]; 3], counts: [[0; N]; 3] };

    #[inline(always)]
    fn of<'a>(items: impl IntoIterator<Item = &'a ItemBox>, grid: &Grid) -> Self {
        let mut bins = Self::EMPTY;
        for item in items {
            let place = grid.place(item).to_array();
            for (axis, place) in place.into_iter().enumerate() {
                let bin = place.to_bits() as usize & (N - 1);
                bins.boxes[axis][bin] = bins.boxes[axis][bin].union(&item.aabb());
                bins.counts[axis][bin] += 1;
            }
        }
        bins
    }

    fn of_all(items: &[ItemBox], grid: &Grid) -> Self {
        if items.len() <= 2 * CHUNK {
            return Self::of(items, grid);
        }
        // Least and greatest numbers don't depend on the order in which bins are joined.
        items.par_chunks(CHUNK).map(|items| Self::of(items, grid)).reduce(|| Self::EMPTY, Self::joined)
    }

    fn joined(mut self, other: Self) -> Self {
        for axis in 0..3 {
            for bin in 0..N {
                self.boxes[axis][bin] = self.boxes[axis][bin].union(&other.boxes[axis][bin]);
                self.counts[axis][bin] += other.counts[axis][bin];
            }
        }
        self
    }

    /// Returns the box around all items.
    fn around(&self) -> Aabb {
        self.boxes[0].iter().fold(Aabb::INVALID, |all, one| all.union(one))
    }

    /// Returns the least cost of a cut along an axis, and the first bin of its right side. A cut with an empty side costs NaN,
    /// and is never the best.
    #[inline(always)]
    fn best(&self, axis: usize) -> Option<(f32, usize)> {
        let (boxes, counts) = (&self.boxes[axis], &self.counts[axis]);
        let mut rights = [0.0; N];
        let (mut around, mut count) = (Aabb::INVALID, 0);
        for bin in (1..N).rev() {
            (around, count) = (around.union(&boxes[bin]), count + counts[bin]);
            rights[bin] = around.half_area() * count as f32;
        }
        let (mut least, mut best) = (f32::INFINITY, None);
        (around, count) = (Aabb::INVALID, 0);
        for bin in 1..N {
            (around, count) = (around.union(&boxes[bin - 1]), count + counts[bin - 1]);
            let cost = around.half_area() * count as f32 + rights[bin];
            if cost < least {
                (least, best) = (cost, Some((cost, bin)));
            }
        }
        best
    }
}
