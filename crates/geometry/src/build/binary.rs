//! Binary trees from the root down, stored as obvhs's nodes: siblings are adjacent, the root is first, and children come after
//! their parent.
//!
//! A node is cut between two bins of centres where the expected cost of both sides is least [after Wald 2007]: their areas times
//! their numbers of items. Obvhs's reinsertion improves the tree afterwards.

use super::Preset;
use bytemuck::{Pod, Zeroable};
use glam::{Vec3A, Vec4};
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use rayon::prelude::*;

/// The number of items from which both sides of a cut are divided in parallel.
const TASK: usize = 1 << 12;
/// The number of items that one task sorts into bins.
const CHUNK: usize = 1 << 14;
/// The number of items up to which half as many bins do.
const FEW: usize = 32;
/// The number of items up to which a median is good enough: a leaf holds them all.
const SMALL: usize = 4;
/// The depth from which nodes are cut at the median. With the up to 28 cuts of the largest tree below, that is less than the 96
/// levels for which obvhs's reinsertion has memory.
const DEEP: usize = 60;
/// The bits that are flipped in stored numbers of items; see `leaf::FLIPPED`.
const FLIPPED: u32 = 1 << 30;

/// The box of an item, with its number as the fourth word. Coordinates are between 0 and 1.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C, align(32))]
pub(super) struct ItemBox {
    low: [f32; 4],
    high: [f32; 4],
}

impl ItemBox {
    #[inline(always)]
    pub(super) fn new([[x, y, z], [right, top, far]]: [[f32; 3]; 2], item: u32) -> Self {
        Self { low: [x, y, z, f32::from_bits(item ^ FLIPPED)], high: [right, top, far, 0.0] }
    }

    fn item(&self) -> u32 {
        self.low[3].to_bits() ^ FLIPPED
    }

    #[inline(always)]
    fn sides(&self) -> Sides {
        [Vec4::from_array(self.low), Vec4::from_array(self.high)]
    }

    /// Twice the centre.
    #[inline(always)]
    fn centre(&self) -> Vec4 {
        let [low, high] = self.sides();
        low + high
    }

    pub(super) fn node(&self) -> Bvh2Node {
        Bvh2Node::new(aabb(self.sides()), 1, self.item())
    }
}

/// The lower and the upper corner of a box; the fourth words mean nothing.
type Sides = [Vec4; 2];

const NOTHING: Sides = [Vec4::INFINITY, Vec4::NEG_INFINITY];

#[inline(always)]
fn union(a: Sides, b: Sides) -> Sides {
    [a[0].min(b[0]), a[1].max(b[1])]
}

#[inline(always)]
fn half_area([low, high]: Sides) -> f32 {
    let side = high - low;
    side.x * side.y + side.y * side.z + side.z * side.x
}

fn aabb([low, high]: Sides) -> Aabb {
    Aabb::new(Vec3A::from_vec4(low), Vec3A::from_vec4(high))
}

/// The box around some items, and the box around their centres, doubled.
#[derive(Clone, Copy)]
struct Extent {
    around: Sides,
    centres: Sides,
}

impl Extent {
    const NONE: Self = Self { around: NOTHING, centres: NOTHING };

    #[inline(always)]
    fn add(&mut self, item: &ItemBox) {
        self.around = union(self.around, item.sides());
        self.centres = union(self.centres, [item.centre(); 2]);
    }

    fn of(items: &[ItemBox]) -> Self {
        let mut extent = Self::NONE;
        items.iter().for_each(|item| extent.add(item));
        extent
    }

    fn joined(self, other: Self) -> Self {
        Self { around: union(self.around, other.around), centres: union(self.centres, other.centres) }
    }
}

/// Returns a binary tree of small expected cost over the items, of which there is at least one. They change their order.
pub(super) fn tree(items: &mut [ItemBox], preset: Preset) -> Vec<Bvh2Node> {
    let mut tree = Bvh2 { nodes: divided(items, DEEP), ..Bvh2::default() };
    reinsert(&mut tree, preset.reinsertion());
    tree.nodes
}

/// Returns a balanced binary tree: all nodes are cut at the median along the axis on which centres differ most.
pub(super) fn balanced(items: &mut [ItemBox]) -> Vec<Bvh2Node> {
    divided(items, 0)
}

/// Returns a tree without reinsertion. From the depth `deep` on, nodes are cut at the median.
fn divided(items: &mut [ItemBox], deep: usize) -> Vec<Bvh2Node> {
    let mut nodes = bytemuck::zeroed_vec(2 * items.len() - 1);
    let extent = items.par_chunks(CHUNK).map(Extent::of).reduce(|| Extent::NONE, Extent::joined);
    let (root, below) = nodes.split_at_mut(1);
    root[0] = divide(items, &extent, (below, 1), deep);
    nodes
}

/// Returns the node over some items. `below` are the nodes for its descendants, and the index of the first of them. After
/// `levels` of them, nodes are cut at the median.
fn divide(items: &mut [ItemBox], extent: &Extent, (below, first): (&mut [Bvh2Node], u32), levels: usize) -> Bvh2Node {
    if let [item] = items {
        return item.node();
    }
    let parallel = items.len() >= TASK;
    let (middle, [of_left, of_right]) = cut(items, extent, levels > 0);
    let (left, right) = items.split_at_mut(middle);
    let (pair, rest) = below.split_at_mut(2);
    let (below_left, below_right) = rest.split_at_mut(2 * middle - 2);
    let [left_first, right_first] = [first + 2, first + 2 * middle as u32];
    let levels = levels.saturating_sub(1);
    let mut left = || divide(left, &of_left, (below_left, left_first), levels);
    let mut right = || divide(right, &of_right, (below_right, right_first), levels);
    (pair[0], pair[1]) = if parallel { rayon::join(left, right) } else { (left(), right()) };
    Bvh2Node::new(aabb(extent.around), 0, first)
}

/// Orders some items, two at least, by the side of a cut: the best one, or one at the median. Returns the number on the left
/// side, and what both sides extend over.
fn cut(items: &mut [ItemBox], extent: &Extent, best: bool) -> (usize, [Extent; 2]) {
    let span = extent.centres[1] - extent.centres[0];
    let widest = span.truncate().max_position();
    if best && items.len() > SMALL && span[widest] > 0.0 {
        let plane = if items.len() > FEW { Plane::best::<16>(items, extent) } else { Plane::best::<8>(items, extent) };
        if let Some(plane) = plane {
            return part(items, &plane);
        }
    }
    let middle = items.len() / 2;
    if items.len() > 2 {
        let along = |item: &ItemBox| item.centre()[widest];
        items.select_nth_unstable_by(middle, |a, b| along(a).total_cmp(&along(b)).then(a.item().cmp(&b.item())));
    }
    (middle, [Extent::of(&items[..middle]), Extent::of(&items[middle..])])
}

/// Moves the items on the left side of a plane to the front. Returns their number, and what both sides extend over.
fn part(items: &mut [ItemBox], plane: &Plane) -> (usize, [Extent; 2]) {
    let (mut left, mut right) = (Extent::NONE, Extent::NONE);
    let (mut from, mut to) = (0, items.len());
    while from < to {
        let item = items[from];
        if plane.is_left(&item) {
            left.add(&item);
            from += 1;
        } else {
            right.add(&item);
            to -= 1;
            items.swap(from, to);
        }
    }
    (from, [left, right])
}

/// The map from centres to bins, by axis.
#[derive(Clone, Copy)]
struct Grid {
    low: Vec4,
    scale: Vec4,
}

/// The least f32 from which on consecutive numbers differ by one: a sum of it and a small number is rounded to a whole number,
/// which its lowest bits hold.
const WHOLE: f32 = (1u32 << 23) as f32;

impl Grid {
    /// Returns [`WHOLE`] and the bin, for each axis.
    #[inline(always)]
    fn place(&self, item: &ItemBox) -> Vec4 {
        (item.centre() - self.low) * self.scale + Vec4::splat(WHOLE)
    }
}

/// A cut of a node: bins below `bin` along `axis` are on the left side.
struct Plane {
    grid: Grid,
    axis: usize,
    bin: usize,
}

impl Plane {
    #[inline(always)]
    fn is_left(&self, item: &ItemBox) -> bool {
        let limit = Vec4::splat(WHOLE + self.bin as f32);
        self.grid.place(item).cmplt(limit).bitmask() >> self.axis & 1 == 1
    }

    /// Returns the plane of least cost between two of `N` bins on any axis; `None` if costs are no numbers.
    fn best<const N: usize>(items: &[ItemBox], extent: &Extent) -> Option<Self> {
        let span = extent.centres[1] - extent.centres[0];
        let scale = Vec4::splat((N - 1) as f32) / span.max(Vec4::splat(f32::MIN_POSITIVE * 1024.0));
        let grid = Grid { low: extent.centres[0], scale };
        let bins = if items.len() <= 2 * CHUNK {
            Bins::<N>::of(items, &grid)
        } else {
            // Least and greatest numbers don't depend on the order in which bins are joined.
            items.par_chunks(CHUNK).map(|items| Bins::of(items, &grid)).reduce(|| Bins::EMPTY, Bins::joined)
        };
        let axes = (0..3).filter(|&axis| span[axis] > 0.0);
        let best = axes.filter_map(|axis| bins.best(axis).map(|(cost, bin)| (cost, axis, bin)));
        best.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, axis, bin)| Self { grid, axis, bin })
    }
}

/// The items of a node by the bin that their centre lies in, for each axis.
struct Bins<const N: usize> {
    boxes: [[Sides; N]; 3],
    counts: [[u32; N]; 3],
}

impl<const N: usize> Bins<N> {
    const EMPTY: Self = Self { boxes: [[NOTHING; N]; 3], counts: [[0; N]; 3] };

    #[inline(always)]
    fn of(items: &[ItemBox], grid: &Grid) -> Self {
        let mut bins = Self::EMPTY;
        for item in items {
            let place = grid.place(item).to_array();
            for (axis, place) in place.into_iter().enumerate().take(3) {
                let bin = place.to_bits() as usize & (N - 1);
                bins.boxes[axis][bin] = union(bins.boxes[axis][bin], item.sides());
                bins.counts[axis][bin] += 1;
            }
        }
        bins
    }

    fn joined(mut self, other: Self) -> Self {
        for axis in 0..3 {
            for bin in 0..N {
                self.boxes[axis][bin] = union(self.boxes[axis][bin], other.boxes[axis][bin]);
                self.counts[axis][bin] += other.counts[axis][bin];
            }
        }
        self
    }

    /// Returns the least cost of a cut along an axis, and the first bin of its right side. The first and the last bin hold items.
    #[inline(always)]
    fn best(&self, axis: usize) -> Option<(f32, usize)> {
        let (boxes, counts) = (&self.boxes[axis], &self.counts[axis]);
        let mut rights = [0.0; N];
        let (mut around, mut count) = (NOTHING, 0);
        for bin in (1..N).rev() {
            (around, count) = (union(around, boxes[bin]), count + counts[bin]);
            rights[bin] = half_area(around) * count as f32;
        }
        let (mut least, mut best) = (f32::INFINITY, None);
        (around, count) = (NOTHING, 0);
        for bin in 1..N {
            (around, count) = (union(around, boxes[bin - 1]), count + counts[bin - 1]);
            let cost = half_area(around) * count as f32 + rights[bin];
            if cost < least {
                (least, best) = (cost, Some((cost, bin)));
            }
        }
        best
    }
}

/// Moves subtrees to cheaper places, as `ReinsertionOptimizer::run` does: in rounds of fewer and fewer candidates, the
/// largest nodes. That sorts millions of candidates of equal area differently by each number of threads. Here the node's number
/// decides.
fn reinsert(tree: &mut Bvh2, ratio: f32) {
    let nodes = tree.nodes.len();
    if nodes < 2 || ratio <= 0.0 {
        return;
    }
    let candidates = |part: usize| (((nodes as f32 * ratio) * (1.0 / part as f32)) as usize).clamp(1, nodes - 1);
    // Areas are not negative, so their bits have their order.
    let by_area = |tree: &Bvh2, number: u32| (!tree.nodes[number as usize].aabb().half_area().to_bits(), number);
    let mut large: Vec<(u32, u32)> = (1..nodes as u32).into_par_iter().map(|number| by_area(tree, number)).collect();
    largest(&mut large, 2 * candidates(1));
    let mut optimizer = ReinsertionOptimizer::default();
    for part in (1..32).step_by(2) {
        let mut order: Vec<(u32, u32)> = large.iter().map(|&(_, number)| by_area(tree, number)).collect();
        largest(&mut order, candidates(part));
        order.par_sort_unstable();
        let numbers: Vec<u32> = order.into_iter().map(|(_, number)| number).collect();
        optimizer.run_with_candidates(tree, &numbers, 1);
    }
}

/// Keeps the first `count` in order, unsorted.
fn largest(order: &mut Vec<(u32, u32)>, count: usize) {
    if count < order.len() {
        order.select_nth_unstable(count);
        order.truncate(count);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The number of levels of a tree whose children come after their parents.
    fn depth(nodes: &[Bvh2Node]) -> usize {
        let mut depths = vec![1; nodes.len()];
        for (number, node) in nodes.iter().enumerate().filter(|(_, node)| !node.is_leaf()) {
            let first = node.first_index as usize;
            assert!(first > number);
            let below = depths[number] + 1;
            depths[first..first + 2].fill(below);
        }
        depths.into_iter().max().unwrap_or(0)
    }

    /// Sizes that double from one item to the next make deep trees. Equal boxes can't be told apart.
    #[test]
    fn trees_over_sizes_that_double_and_over_equal_boxes_have_each_item_once_and_an_end() {
        const COUNT: u32 = 40_000;
        let size = |n: u32| 0.5_f32.powi(n as i32 % 120 + 1);
        let doubling = |n| ItemBox::new([[size(n); 3], [2.0 * size(n); 3]], n);
        let equal = |n| ItemBox::new([[0.5; 3], [0.75; 3]], n);
        for (of, most) in [(&doubling as &dyn Fn(u32) -> ItemBox, DEEP + 17), (&equal, 17)] {
            let items: Vec<ItemBox> = (0..COUNT).map(of).collect();
            let [cut, flat] = [DEEP, 0].map(|deep| divided(&mut items.clone(), deep));
            assert!(depth(&cut) <= most, "{}", depth(&cut));
            assert_eq!(depth(&flat), 17);
            for nodes in [cut, flat, tree(&mut items.clone(), Preset::Medium)] {
                let leaves = nodes.iter().filter(|node| node.is_leaf());
                let mut numbers: Vec<u32> = leaves.map(|node| node.first_index).collect();
                numbers.sort_unstable();
                assert!(numbers.into_iter().eq(0..COUNT));
            }
        }
    }
}
