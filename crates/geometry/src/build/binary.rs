//! Top-down construction of binary trees, stored as obvhs's nodes: siblings are adjacent, the root is first, and children come
//! after their parent. A leaf holds consecutive items.
//!
//! A node is split between two bins of centres where the expected cost is smallest [after Wald 2007]: the sum over both sides
//! of area times number of items. For a large node, the cost is estimated from a subset of the items. Reinsertion improves the
//! tree afterwards.

use super::items::{FEW, ItemBox};
use super::reinsertion::reinsert;
use glam::Vec3A;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::node::Bvh2Node;
use rayon::prelude::*;

/// The fraction of all nodes for which reinsertion searches for a cheaper position.
const REINSERTION: f32 = 0.01;
/// The largest number of items for which a split uses half the number of bins.
const COARSE: usize = 32;
/// The largest number of items in a leaf, for trees of more than [`FEW_IN_ALL`] triangles. With 4, spheres have 4 % more
/// expected cost (docs/LOG.md).
const GROUP: usize = 3;
/// The depth from which nodes are split at the median. The largest tree has up to 28 levels of splits below it, which keeps
/// the depth under the 96 levels that obvhs's reinsertion supports.
const DEEP: usize = 60;

/// A binary tree over items.
pub(super) struct Binary {
    /// The nodes. The first index of a leaf is the position of the leaf's first item in `order`.
    pub(super) nodes: Vec<Bvh2Node>,
    /// The numbers of the items, in the order of the leaves.
    pub(super) order: Vec<u32>,
}

/// Returns a binary tree with a small expected cost over at least one item, and reorders the items. In a large tree with
/// `triangles` only, a leaf holds up to [`GROUP`] items.
pub(super) fn tree(items: &mut [ItemBox], triangles: bool) -> Binary {
    let group = if triangles && items.len() > FEW_IN_ALL { GROUP } else { 1 };
    let Binary { nodes, order } = divided(items, Rules { levels: DEEP, group, ..Rules::medians(items.len()) });
    let mut tree = Bvh2 { nodes, ..Bvh2::default() };
    reinsert(&mut tree, REINSERTION);
    Binary { nodes: tree.nodes, order }
}

/// Returns a balanced binary tree: all nodes are split at the median along the axis on which centres differ most.
pub(super) fn balanced(items: &mut [ItemBox]) -> Binary {
    divided(items, Rules::medians(items.len()))
}

/// Returns the tree before reinsertion.
fn divided(items: &mut [ItemBox], rules: Rules) -> Binary {
    let extent = items.par_chunks(CHUNK).map(Extent::of).reduce(|| Extent::NONE, Extent::joined);
    let tree = Subtree::over(items, &extent, 0, rules);
    let mut nodes = bytemuck::zeroed_vec(1 + tree.below);
    let (root, below) = nodes.split_at_mut(1);
    root[0] = tree.written(below, 1);
    Binary { nodes, order: items.par_iter().with_min_len(FEW).map(ItemBox::item).collect() }
}

/// A subtree whose position among all nodes is not known yet. Several threads build its parts.
struct Subtree {
    /// The number of nodes below its root.
    below: usize,
    form: Form,
}

enum Form {
    /// Two subtrees, and their bounding box.
    Cut(Aabb, Box<[Subtree; 2]>),
    /// The root and the nodes below it. The indices in inner nodes count from the first node below the root.
    Whole(Bvh2Node, Vec<Bvh2Node>),
}

impl Subtree {
    /// Builds the subtree over some items. `first` is the position of the first item in the order of all items.
    fn over(items: &mut [ItemBox], extent: &Extent, first: u32, rules: Rules) -> Self {
        if items.len() < FEW {
            let mut nodes = Vec::with_capacity(2 * items.len().div_ceil(rules.group));
            let root = divide(items, extent, first, rules, &mut nodes);
            return Self { below: nodes.len(), form: Form::Whole(root, nodes) };
        }
        let (middle, [of_left, of_right]) = cut(items, extent, rules);
        let (left, right) = items.split_at_mut(middle);
        let (left, right) = rayon::join(
            || Self::over(left, &of_left, first, rules.below()),
            || Self::over(right, &of_right, first + middle as u32, rules.below()),
        );
        Self { below: 2 + left.below + right.below, form: Form::Cut(extent.around, Box::new([left, right])) }
    }

    /// Writes the nodes below the root to `below`, whose first node has the index `first` in the whole tree. Returns the root.
    fn written(self, below: &mut [Bvh2Node], first: u32) -> Bvh2Node {
        match self.form {
            Form::Whole(root, nodes) => {
                let moved = |mut node: Bvh2Node| {
                    node.first_index += if node.is_leaf() { 0 } else { first };
                    node
                };
                below.iter_mut().zip(nodes).for_each(|(to, node)| *to = moved(node));
                moved(root)
            }
            Form::Cut(around, sides) => {
                let [left, right] = *sides;
                let (pair, rest) = below.split_at_mut(2);
                let right_first = first + 2 + left.below as u32;
                let (of_left, of_right) = rest.split_at_mut(left.below);
                (pair[0], pair[1]) =
                    rayon::join(|| left.written(of_left, first + 2), || right.written(of_right, right_first));
                Bvh2Node::new(around, 0, first)
            }
        }
    }
}

/// Returns the node over some items, and adds the nodes below it to `nodes`. `first` is the position of the first item in the
/// order of all items.
fn divide(items: &mut [ItemBox], extent: &Extent, first: u32, rules: Rules, nodes: &mut Vec<Bvh2Node>) -> Bvh2Node {
    if items.len() <= rules.group {
        return Bvh2Node::new(extent.around, items.len() as u32, first);
    }
    let pair = nodes.len();
    if let [left, right] = items {
        nodes.extend([left.leaf(first), right.leaf(first + 1)]);
        return Bvh2Node::new(extent.around, 0, pair as u32);
    }
    let (middle, [of_left, of_right]) = cut(items, extent, rules);
    let (left, right) = items.split_at_mut(middle);
    nodes.extend([Bvh2Node::default(); 2]);
    nodes[pair] = divide(left, &of_left, first, rules.below(), nodes);
    nodes[pair + 1] = divide(right, &of_right, first + middle as u32, rules.below(), nodes);
    Bvh2Node::new(extent.around, 0, pair as u32)
}

/// Orders at least three items by the side of a split: the cheapest one, or one at the median. Returns the number of items on
/// the left side, and the extents of both sides.
fn cut(items: &mut [ItemBox], extent: &Extent, rules: Rules) -> (usize, [Extent; 2]) {
    let span = extent.centres.diagonal();
    let widest = span.max_position();
    if rules.levels > 0 && items.len() > rules.small && span[widest] > 0.0 {
        let best = if items.len() > COARSE { Plane::best::<16> } else { Plane::best::<8> };
        if let Some(plane) = best(items, extent, rules) {
            return part(items, &plane);
        }
    }
    let middle = items.len() / 2;
    let along = |item: &ItemBox| item.centre()[widest];
    items.select_nth_unstable_by(middle, |a, b| along(a).total_cmp(&along(b)).then(a.item().cmp(&b.item())));
    (middle, [Extent::of(&items[..middle]), Extent::of(&items[middle..])])
}

/// Moves the items on the left side of a plane to the front. Returns their number, and the extents of both sides.
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

/// The number of items that one task processes.
const CHUNK: usize = 1 << 14;
/// The largest number of items of a node that is always split at the median: in trees of up to [`FEW_IN_ALL`] items, and in
/// larger trees. With 8 in small trees, a room of 712 triangles has 8 % more expected cost (docs/LOG.md).
const SMALL: [usize; 2] = [4, 8];
/// The largest number of items of a small tree.
const FEW_IN_ALL: usize = 1 << 15;
/// The number of items in the subset from which a node's split is chosen. Nodes with fewer than twice as many items use all
/// items.
const CHOSEN_BY: usize = 1 << 12;
/// The smallest area of the subset's bounding box relative to the node's box. If it is smaller, the split is chosen from all
/// items.
const SEEN: f32 = 0.8;
/// 2^32 divided by the golden ratio. Its multiples are scattered modulo 2^32.
const SCATTER: u32 = 2_654_435_769;

/// The bounding box of some items, and the bounding box of their centres, scaled by 2.
#[derive(Clone, Copy)]
struct Extent {
    around: Aabb,
    centres: Aabb,
}

impl Extent {
    const NONE: Self = Self { around: Aabb::INVALID, centres: Aabb::INVALID };

    #[inline(always)]
    fn add(&mut self, item: &ItemBox) {
        self.around = self.around.union(&item.aabb());
        self.centres.extend(item.centre());
    }

    fn of(items: &[ItemBox]) -> Self {
        let mut extent = Self::NONE;
        items.iter().for_each(|item| extent.add(item));
        extent
    }

    fn joined(self, other: Self) -> Self {
        Self { around: self.around.union(&other.around), centres: self.centres.union(&other.centres) }
    }
}

/// The parameters of splits.
#[derive(Clone, Copy)]
struct Rules {
    /// The number of levels whose nodes use the cheapest split. Nodes further down are split at the median.
    levels: usize,
    /// The largest number of items of a node that is always split at the median.
    small: usize,
    /// The largest number of items of a leaf.
    group: usize,
    /// The size of the subset; see [`CHOSEN_BY`].
    chosen_by: usize,
    /// The smallest relative area of the subset's box; see [`SEEN`].
    seen: f32,
}

impl Rules {
    /// Returns the parameters of median splits only, for a tree of `items` items.
    fn medians(items: usize) -> Self {
        Self { levels: 0, small: SMALL[usize::from(items > FEW_IN_ALL)], group: 1, chosen_by: CHOSEN_BY, seen: SEEN }
    }

    fn below(self) -> Self {
        Self { levels: self.levels.saturating_sub(1), ..self }
    }
}

/// The map from centres to bins, per axis.
#[derive(Clone, Copy)]
struct Grid {
    low: Vec3A,
    scale: Vec3A,
}

/// The smallest f32 above which consecutive f32 differ by 1. Adding it to a small number therefore rounds the number to an
/// integer, which the lowest bits of the sum hold.
const WHOLE: f32 = (1u32 << 23) as f32;

impl Grid {
    /// Returns the sum of [`WHOLE`] and the bin, per axis.
    #[inline(always)]
    fn place(&self, item: &ItemBox) -> Vec3A {
        (item.centre() - self.low) * self.scale + Vec3A::splat(WHOLE)
    }
}

/// A split of a node: items in bins below `bin` along `axis` are on the left side.
struct Plane {
    grid: Grid,
    axis: usize,
    bin: usize,
}

impl Plane {
    #[inline(always)]
    fn is_left(&self, item: &ItemBox) -> bool {
        let limit = Vec3A::splat(WHOLE + self.bin as f32);
        self.grid.place(item).cmplt(limit).bitmask() >> self.axis & 1 == 1
    }

    /// Returns the cheapest plane between two of `N` bins on any axis; `None` if all costs are NaN.
    fn best<const N: usize>(items: &[ItemBox], extent: &Extent, rules: Rules) -> Option<Self> {
        let span = extent.centres.diagonal();
        let scale = Vec3A::splat((N - 1) as f32) / span.max(Vec3A::splat(f32::MIN_POSITIVE * 1024.0));
        let grid = Grid { low: extent.centres.min, scale };
        let run = items.len() / rules.chosen_by;
        let part = (run > 1).then(|| {
            // One item of each run, at varying positions, since meshes are often periodic.
            let within = |n: usize| ((u64::from((n as u32).wrapping_mul(SCATTER)) * run as u64) >> 32) as usize;
            Bins::<N>::of((0..rules.chosen_by).map(|n| &items[n * run + within(n)]), &grid)
        });
        // The subset may lack the few large items of a node.
        let whole = extent.around.half_area();
        let part = part.filter(|part| part.around().half_area() >= rules.seen * whole);
        let bins = part.unwrap_or_else(|| Bins::of_all(items, &grid));
        let axes = (0..3).filter(|&axis| span[axis] > 0.0);
        let best = axes.filter_map(|axis| bins.best(axis).map(|(cost, bin)| (cost, axis, bin)));
        best.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, axis, bin)| Self { grid, axis, bin })
    }
}

/// The boxes and counts of a node's items, per axis and bin of their centres.
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

    /// Returns the bounding box of all items.
    fn around(&self) -> Aabb {
        self.boxes[0].iter().fold(Aabb::INVALID, |all, one| all.union(one))
    }

    /// Returns the smallest cost of a split along an axis, and the first bin on its right side. A split with an empty side has
    /// cost NaN and is never chosen.
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the number of levels of a tree whose children come after their parents.
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

    /// Returns the numbers of the items in a tree's leaves, sorted.
    fn items_of(tree: &Binary) -> Vec<u32> {
        let mut numbers: Vec<u32> = leaves(tree).flatten().copied().collect();
        numbers.sort_unstable();
        numbers
    }

    fn leaves(tree: &Binary) -> impl Iterator<Item = &[u32]> {
        let leaves = tree.nodes.iter().filter(|node| node.is_leaf());
        leaves.map(|leaf| &tree.order[leaf.first_index as usize..][..leaf.prim_count as usize])
    }

    fn best(levels: usize) -> Rules {
        Rules { levels, ..Rules::medians(1) }
    }

    /// Returns the sum of the areas of all inner nodes divided by the root's area.
    fn cost(nodes: &[Bvh2Node]) -> f32 {
        let areas = nodes.iter().filter(|node| !node.is_leaf()).map(|node| node.aabb().half_area());
        areas.sum::<f32>() / nodes[0].aabb().half_area()
    }

    /// Returns boxes of very different sizes in clusters of very different sizes, taken from the clusters in turn.
    fn clumped(clumps: usize) -> Vec<ItemBox> {
        let mut state = 1u32;
        let mut random = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / 16_777_216.0
        };
        let places: Vec<[f32; 4]> = (0..clumps).map(|_| [random(), random(), random(), random().powi(4)]).collect();
        let item = |n: u32| {
            let [x, y, z, spread] = places[n as usize % clumps];
            let low = [x, y, z].map(|at| at + spread * (random() - 0.5));
            let size = 0.02 * random().powi(8);
            ItemBox::new([low, low.map(|at| at + size)], n)
        };
        (0..60_000).map(item).collect()
    }

    fn cost_by(items: &[ItemBox], chosen_by: usize, seen: f32) -> f32 {
        cost(&divided(&mut items.to_vec(), Rules { chosen_by, seen, ..best(DEEP) }).nodes)
    }

    #[test]
    fn a_part_of_the_items_chooses_cuts_that_cost_little_more() {
        // With as many clumps as a run has items, the first items of all runs are of the same clump.
        let items = clumped(60_000 / CHOSEN_BY);
        let [all, part, few] = [usize::MAX, CHOSEN_BY, 16].map(|chosen_by| cost_by(&items, chosen_by, 0.0));
        assert!(part < 1.02 * all, "{part}, not {all}");
        // The control: a split chosen from too few items is bad.
        assert!(few > 1.05 * all, "{few}, beside {all}");
    }

    /// The four walls of a room around boxes of a fifth of its size.
    #[test]
    fn all_items_choose_where_a_part_misses_large_ones() {
        let inside = |at: [f32; 4]| [0, 1, 2].map(|axis| 0.4 + 0.2 * at[axis]);
        let small = |item: &ItemBox| ItemBox::new([inside(item.low), inside(item.high)], item.item());
        let mut room: Vec<ItemBox> = clumped(16).iter().map(small).collect();
        let walls = [[[0.0; 3], [0.01, 1.0, 1.0]], [[0.99, 0.0, 0.0], [1.0; 3]]];
        let more = [[[0.0; 3], [1.0, 0.01, 1.0]], [[0.0, 0.99, 0.0], [1.0; 3]]];
        room.extend(walls.into_iter().chain(more).zip(60_000..).map(|(bounds, n)| ItemBox::new(bounds, n)));
        let [all, part, blind] =
            [(usize::MAX, SEEN), (CHOSEN_BY, SEEN), (CHOSEN_BY, 0.0)].map(|(by, seen)| cost_by(&room, by, seen));
        assert!(part < 1.002 * all && blind > 1.01 * all, "{part} and {blind}, not {all}");
    }

    #[test]
    fn leaves_hold_several_triangles_in_large_trees_only() {
        let sizes = |count: usize, triangles: bool| {
            let items = &mut clumped(16)[..count];
            let tree = tree(items, triangles);
            // The leaf's box is the one around its items.
            for leaf in tree.nodes.iter().filter(|node| node.is_leaf()) {
                let of_leaf = &items[leaf.first_index as usize..][..leaf.prim_count as usize];
                assert_eq!(*leaf.aabb(), Extent::of(of_leaf).around);
            }
            let mut sizes = [0; GROUP];
            leaves(&tree).for_each(|leaf| sizes[leaf.len() - 1] += 1);
            sizes
        };
        let large = sizes(FEW_IN_ALL + 1, true);
        assert!(large[1..].iter().all(|number| *number > 1000), "{large:?}");
        assert_eq!(sizes(FEW_IN_ALL, true), [FEW_IN_ALL, 0, 0]);
        assert_eq!(sizes(FEW_IN_ALL + 1, false), [FEW_IN_ALL + 1, 0, 0]);
    }

    /// Each box is 1/32 of the size of the previous one along one of three axes, so every cheapest split separates the largest
    /// box only.
    #[test]
    fn trees_that_would_be_chains_end() {
        let size = |n: u32| 2.0_f32.powi(-5 * (n as i32 / 3) - 1);
        let at = |n: u32| [0, 1, 2].map(|axis| if n % 3 == axis { size(n) } else { 0.0 });
        let items: Vec<ItemBox> = (0..75).map(|n| ItemBox::new([at(n); 2], n)).collect();
        let [chain, cut] = [usize::MAX, DEEP].map(|levels| divided(&mut items.clone(), best(levels)));
        // The control: without the limit, it is deeper.
        assert!(depth(&chain.nodes) > DEEP + 5, "{}", depth(&chain.nodes));
        assert!(depth(&cut.nodes) <= DEEP + 5, "{}", depth(&cut.nodes));
        assert!(items_of(&cut).into_iter().eq(0..75));
    }

    #[test]
    fn equal_boxes_are_halved_and_every_item_is_there_once() {
        const COUNT: u32 = 40_000;
        let equal = |n| ItemBox::new([[0.5; 3], [0.75; 3]], n);
        let low = |n: u32| (n % 97) as f32 / 128.0;
        let mixed = |n: u32| ItemBox::new([[low(n); 3], [low(n) + (n % 5 + 1) as f32 / 64.0; 3]], n);
        for (of, halved) in [(&equal as &dyn Fn(u32) -> ItemBox, true), (&mixed, false)] {
            let items: Vec<ItemBox> = (0..COUNT).map(of).collect();
            let [cut, flat] = [DEEP, 0].map(|levels| divided(&mut items.clone(), best(levels)));
            assert_eq!(depth(&flat.nodes), 17);
            assert!(!halved || depth(&cut.nodes) == 17, "{}", depth(&cut.nodes));
            let [single, grouped] = [false, true].map(|triangles| tree(&mut items.clone(), triangles));
            for tree in [cut, flat, single, grouped] {
                assert!(items_of(&tree).into_iter().eq(0..COUNT));
            }
        }
    }
}
