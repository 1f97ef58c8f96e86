//! Conversion of a binary tree to eight-wide nodes and leaves of up to eight triangles, with the least expected cost.
//!
//! Dynamic programming over the surface-area cost decides each subtree's form: a node, a leaf, or several children of
//! its parent [after Ylitie, Karras and Laine 2017, section 3.1].

use super::{Bounds, Item, Items, union};
use crate::Shape;
use crate::lanes::WIDTH;
use crate::traverse::{Child, DEEPEST, Keys, Node8, Tree, WalkKind};
use crate::triangle::Triangles8;
use glam::Vec3;
use obvhs::bvh2::node::Bvh2Node;
use rayon::iter::repeat_n;
use rayon::prelude::*;

/// The expected time of testing eight boxes. It is the unit of all costs here.
const NODE_COST: f32 = 1.0;
/// The expected time of testing a leaf of eight triangles. Of 0.6, 1.2 and 2, the value 0.6 gave the fastest rays and
/// the smallest tree in each scene of benches/rays.rs, by 1 to 5 %.
const TRIANGLES_COST: f32 = 0.6;
/// The expected time of testing one sphere or disk.
const QUADRIC_COST: f32 = 2.5;
/// The expected time of testing an instance: an estimate for transforming a ray and testing a few nodes of the object.
const BOX_COST: f32 = 10.0;

/// The combined costs of two siblings. It takes 32 bytes, since there is one for each primitive.
#[derive(Clone, Copy, Debug, Default)]
struct Pair {
    /// The least total cost of both siblings if they become at most 2, 3, … 8 children of a node.
    cost: [f32; WIDTH - 1],
    /// The number of triangles below both siblings, or [`MANY`] if a leaf cannot hold them or other items are among
    /// them. 0 marks a pair whose costs are not computed yet.
    triangles: u32,
}

const MANY: u32 = WIDTH as u32 + 1;

/// The least costs of a subtree of the binary tree, and its best form.
#[derive(Clone, Copy, Debug)]
struct SubtreePlan {
    /// The least cost of the subtree if it becomes at most 1, 2, … 7 children of a node.
    cost: [f32; WIDTH - 1],
    /// The number of triangles in the subtree, or [`MANY`] if a leaf cannot hold its items; see [`Pair::triangles`].
    triangles: u32,
    /// True if a leaf costs less than a node for the subtree as a single child.
    leaf: bool,
}

/// Converts a binary tree to an eight-wide one; `None` if it is empty or needs a deeper traversal stack than
/// [`DEEPEST`].
pub(super) fn collapse(nodes: &[Bvh2Node], items: &Items<'_>) -> Option<Tree> {
    let moves = items.shapes.iter().any(|shape| matches!(shape, Shape::Moving(_)));
    let plans = SubtreePlans::new(nodes, items);
    let mut tree = Wide { nodes, items, moves, plans, tree: Tree::default() }.emit();
    if moves {
        tree.way = WalkKind::moving();
    }
    tree.stack = enclose(&mut tree.nodes);
    (!nodes.is_empty() && tree.stack <= DEEPEST).then_some(tree)
}

/// The expected time of a ray through the eight-wide tree of a binary one, up to a factor.
pub(super) fn cost(nodes: &[Bvh2Node], items: &Items<'_>) -> f32 {
    if nodes.is_empty() { 0.0 } else { SubtreePlans::new(nodes, items).plan(0).cost[0] }
}

struct SubtreePlans<'a> {
    nodes: &'a [Bvh2Node],
    items: &'a Items<'a>,
    /// True if all items are triangles, so that their kind need not be looked up.
    triangles: bool,
    /// The pairs of siblings in reverse order of their nodes: the first pair is the last two nodes.
    pairs: Vec<Pair>,
}

impl<'a> SubtreePlans<'a> {
    /// Computes the costs of all pairs, from the leaves up. Almost all children come after their parent in the list.
    /// The few that obvhs puts elsewhere, and their ancestors, wait until the rest is done.
    fn new(nodes: &'a [Bvh2Node], items: &'a Items<'a>) -> Self {
        let count = nodes.len() / 2;
        let triangles = items.boxes.is_empty() && items.shapes.iter().all(|shape| shape.mesh().is_some());
        let mut plans = Self { nodes, items, triangles, pairs: Vec::with_capacity(count) };
        let mut waiting = Vec::new();
        for number in 0..count {
            let pair = plans.pair(number);
            if pair.is_none() {
                waiting.push(number);
            }
            plans.pairs.push(pair.unwrap_or_default());
        }
        while let Some(number) = waiting.pop() {
            if plans.pairs[number].triangles > 0 {
                continue;
            }
            match plans.pair(number) {
                Some(pair) => plans.pairs[number] = pair,
                None => {
                    waiting.push(number);
                    let first = nodes.len() - 2 * (number + 1);
                    let below = nodes[first..first + 2].iter().filter(|child| !child.is_leaf());
                    waiting.extend(below.map(|child| plans.pair_of(child)));
                }
            }
        }
        plans
    }

    /// Computes the costs of a pair; `None` while the costs of a pair below it are unknown.
    #[inline(always)]
    fn pair(&self, number: usize) -> Option<Pair> {
        let first = self.nodes.len() - 2 * (number + 1);
        let (left, right) = (self.plan(first), self.plan(first + 1));
        if left.triangles == 0 || right.triangles == 0 {
            return None;
        }
        let triangles = (left.triangles + right.triangles).min(MANY);
        Some(Pair { cost: shares(&left, &right), triangles })
    }

    #[inline(always)]
    fn plan(&self, number: usize) -> SubtreePlan {
        let node = &self.nodes[number];
        let area = node.aabb().half_area();
        if node.is_leaf() {
            let (cost, triangles) = if self.triangles {
                (TRIANGLES_COST, 1)
            } else {
                match self.items.item(node.first_index).1 {
                    Item::Triangle(_) | Item::Moving(_) => (TRIANGLES_COST, 1),
                    Item::Quadric(_) => (QUADRIC_COST, MANY),
                    Item::Box(_) => (BOX_COST, MANY),
                }
            };
            return SubtreePlan { cost: [area * cost; WIDTH - 1], triangles, leaf: true };
        }
        let Pair { cost: below, triangles } = *self.pairs.get(self.pair_of(node)).unwrap_or(&Pair::default());
        let as_node = area * NODE_COST + below[WIDTH - 2];
        let as_leaf = if triangles == MANY { f32::INFINITY } else { area * TRIANGLES_COST };
        let mut cost = [as_node.min(as_leaf); WIDTH - 1];
        for slots in 2..WIDTH {
            cost[slots - 1] = cost[slots - 2].min(below[slots - 2]);
        }
        SubtreePlan { cost, triangles, leaf: as_leaf <= as_node }
    }

    /// Returns the index of the pair that holds the children of an inner node.
    #[inline(always)]
    fn pair_of(&self, node: &Bvh2Node) -> usize {
        (self.nodes.len() - 1 - node.first_index as usize) / 2
    }
}

/// Returns the least costs of two siblings with 2, 3, … 8 children in total, over all distributions. All are computed
/// in one loop, so that compilers vectorise it.
#[inline(always)]
fn shares(left: &SubtreePlan, right: &SubtreePlan) -> [f32; WIDTH - 1] {
    // The right side's costs, preceded by infinite costs for fewer than one child.
    let mut rights = [f32::INFINITY; 2 * WIDTH];
    rights[WIDTH..2 * WIDTH - 1].copy_from_slice(&right.cost);
    let mut least = [f32::INFINITY; WIDTH];
    for lefts in 0..WIDTH - 1 {
        for slots in 0..WIDTH {
            let cost = left.cost[lefts] + rights[WIDTH - lefts + slots];
            least[slots] = if cost < least[slots] { cost } else { least[slots] };
        }
    }
    std::array::from_fn(|slots| least[slots])
}

/// Returns how many of `slots` children go to the left side in the cheapest distribution.
fn share(left: &SubtreePlan, right: &SubtreePlan, slots: usize) -> usize {
    let mut best = (1, f32::INFINITY);
    for i in 1..slots {
        let cost = left.cost[i - 1] + right.cost[slots - i - 1];
        if cost < best.1 {
            best = (i, cost);
        }
    }
    best.0
}

/// A list of up to eight values, without heap allocation.
struct UpToEight<T> {
    all: [T; WIDTH],
    count: usize,
}

impl<T: Copy> UpToEight<T> {
    fn push(&mut self, one: T) {
        self.all[self.count] = one;
        self.count += 1;
    }
}

struct Wide<'a> {
    nodes: &'a [Bvh2Node],
    items: &'a Items<'a>,
    /// True if vertices of a shape move over time.
    moves: bool,
    plans: SubtreePlans<'a>,
    tree: Tree,
}

/// A binary subtree that becomes a child of a wide node.
#[derive(Clone, Copy)]
struct Chosen {
    node: u32,
    leaf: bool,
    /// True if the leaf holds triangles.
    triangles: bool,
}

/// A leaf of triangles that is not packed yet: the root of its binary subtree, and its place (node and lane) in a wide
/// node.
struct Loose {
    binary: u32,
    wide: u32,
    lane: usize,
}

/// The number of leaves packed together. Reading nodes of several subtrees in turn hides memory latency.
const BATCH: usize = 64;

impl Wide<'_> {
    /// Creates all nodes and leaves. The boxes of inner nodes stay empty until [`enclose`] sets them.
    fn emit(mut self) -> Tree {
        if self.nodes.is_empty() {
            return self.tree;
        }
        let mut open = Vec::new();
        let mut loose = Vec::new();
        // This capacity mostly suffices; growing would move all nodes. Unused memory costs nothing until it is
        // written.
        self.tree.nodes.reserve(self.nodes.len() / 32);
        self.tree.nodes.push(Node8::EMPTY);
        let plan = self.plans.plan(0);
        let root = Chosen { node: 0, leaf: plan.leaf, triangles: plan.triangles <= WIDTH as u32 };
        if root.leaf {
            self.place(root, 0, 0, &mut open, &mut loose);
        } else {
            open.push((self.nodes[0].first_index, 0));
        }
        while let Some((below, wide)) = open.pop() {
            let mut children = UpToEight { all: [root; WIDTH], count: 0 };
            self.divide(below, WIDTH, &mut children);
            for lane in 0..children.count {
                self.place(children.all[lane], wide, lane, &mut open, &mut loose);
            }
        }
        self.pack(&loose);
        self.tree
    }

    /// Collects up to `slots` binary nodes that replace the siblings `below` and `below + 1` as children of a wide
    /// node.
    fn divide(&self, below: u32, slots: usize, children: &mut UpToEight<Chosen>) {
        let (left, right) = (self.plans.plan(below as usize), self.plans.plan(below as usize + 1));
        let lefts = share(&left, &right, slots);
        for (child, plan, slots) in [(below, &left, lefts), (below + 1, &right, slots - lefts)] {
            // The smallest number of slots that reaches the least cost.
            let slots = (1..=slots).find(|&i| plan.cost[i - 1] <= plan.cost[slots - 1]).unwrap_or(1);
            if slots > 1 {
                self.divide(self.nodes[child as usize].first_index, slots, children);
            } else {
                let triangles = plan.triangles <= WIDTH as u32;
                children.push(Chosen { node: child, leaf: plan.leaf, triangles });
            }
        }
    }

    /// Makes a subtree the child of a wide node in `lane`. Its contents are queued in `open` (nodes) or `loose`
    /// (leaves).
    fn place(&mut self, it: Chosen, wide: u32, lane: usize, open: &mut Vec<(u32, u32)>, loose: &mut Vec<Loose>) {
        let first = self.nodes[it.node as usize].first_index;
        let (child, bounds) = if !it.leaf {
            let number = self.tree.nodes.len() as u32;
            self.tree.nodes.push(Node8::EMPTY);
            open.push((first, number));
            (Child::Node(number), NOTHING)
        } else if it.triangles {
            loose.push(Loose { binary: it.node, wide, lane });
            (Child::Triangles(loose.len() as u32 - 1), NOTHING)
        } else {
            let (key, item) = self.items.item(first);
            let child = match item {
                Item::Quadric(quadric) => {
                    self.tree.quadrics.push(quadric);
                    self.tree.quadric_keys.push(key);
                    Child::Quadric(self.tree.quadrics.len() as u32 - 1)
                }
                _ => Child::Box(key as u32),
            };
            (child, self.items.bounds(first))
        };
        self.tree.nodes[wide as usize].put(lane, child, bounds);
    }

    /// Packs the queued leaves of triangles in their order and sets their boxes.
    fn pack(&mut self, loose: &[Loose]) {
        let mut corners: Vec<Triangles8> = repeat_n(Triangles8::default(), loose.len()).collect();
        let mut moved = if self.moves { corners.clone() } else { Vec::new() };
        let mut keys: Vec<Keys> = repeat_n(Keys::new([0; WIDTH]), loose.len()).collect();
        let mut ends: Vec<Option<&mut [Triangles8]>> = moved.chunks_mut(BATCH).map(Some).collect();
        ends.resize_with(loose.len().div_ceil(BATCH), || None);
        let batches = loose.par_chunks(BATCH).zip(corners.par_chunks_mut(BATCH)).zip(keys.par_chunks_mut(BATCH));
        let bounds = batches.zip(ends).map_init(Default::default, |open, (((leaves, corners), keys), ends)| {
            self.pack_batch(leaves, open, Leaves { corners, ends, keys })
        });
        let bounds: Vec<[Bounds; BATCH]> = bounds.collect();
        for (number, (&Loose { wide, lane, .. }, &bounds)) in (0..).zip(loose.iter().zip(bounds.as_flattened())) {
            self.tree.nodes[wide as usize].put(lane, Child::Triangles(number), bounds);
        }
        (self.tree.triangles, self.tree.moved, self.tree.triangle_keys) = (corners, moved, keys);
    }

    /// Packs up to [`BATCH`] leaves and returns their boxes. `open` is memory to work in.
    fn pack_batch(&self, leaves: &[Loose], open: &mut OpenNodes, mut to: Leaves<'_>) -> [Bounds; BATCH] {
        let [open, next] = open;
        let mut members: [UpToEight<u32>; BATCH] = std::array::from_fn(|_| UpToEight { all: [0; WIDTH], count: 0 });
        open.extend((0..).zip(leaves).map(|(leaf, &Loose { binary, .. })| (leaf, binary)));
        while !open.is_empty() {
            // Nodes are counted first, without branches, so that all memory is requested before any of it is needed.
            let inner = open.iter().filter(|&&(_, number)| !self.nodes[number as usize].is_leaf()).count();
            next.reserve(2 * inner);
            for &(leaf, number) in &*open {
                let node = &self.nodes[number as usize];
                if node.is_leaf() {
                    members[leaf as usize].push(node.first_index);
                } else {
                    next.extend([(leaf, node.first_index), (leaf, node.first_index + 1)]);
                }
            }
            std::mem::swap(open, next);
            next.clear();
        }
        let mut bounds = [NOTHING; BATCH];
        for (leaf, members) in members[..leaves.len()].iter().enumerate() {
            bounds[leaf] = self.pack_leaf(&members.all[..members.count], leaf, &mut to);
        }
        bounds
    }

    /// Packs a leaf of 1 to 8 triangles at an index, and returns its box.
    fn pack_leaf(&self, items: &[u32], leaf: usize, to: &mut Leaves<'_>) -> Bounds {
        let mut bounds = NOTHING;
        let mut keys = [0; WIDTH];
        for lane in 0..WIDTH {
            // Unused lanes repeat the first triangle.
            let number = items[if lane < items.len() { lane } else { 0 }];
            let (key, item) = self.items.item(number);
            keys[lane] = key;
            let (from, end) = match item {
                Item::Triangle(mesh) => {
                    let corners = mesh.corners(key as u32);
                    (corners, corners)
                }
                Item::Moving(mesh) => (mesh.corners(key as u32, 0.0), mesh.ends_of(key as u32)),
                // Leaves with several items hold triangles only.
                Item::Quadric(_) | Item::Box(_) => continue,
            };
            to.corners[leaf].put(lane, from);
            if lane < items.len() {
                bounds = union(bounds, self.items.around(from));
            }
            if let Some(ends) = &mut to.ends {
                ends[leaf].put(lane, end);
                bounds = if lane < items.len() { union(bounds, self.items.around(end)) } else { bounds };
            }
        }
        to.keys[leaf] = Keys::new(keys);
        bounds
    }
}

/// The leaves of triangles that are packed, in a part of the tree's.
struct Leaves<'a> {
    corners: &'a mut [Triangles8],
    /// The corners at time 1, if vertices move.
    ends: Option<&'a mut [Triangles8]>,
    keys: &'a mut [Keys],
}

/// Binary nodes to visit, with the leaf that they belong to: now, and next.
type OpenNodes = [Vec<(u32, u32)>; 2];

/// The empty box.
const NOTHING: Bounds = [Vec3::INFINITY, Vec3::NEG_INFINITY];

impl Node8 {
    fn put(&mut self, lane: usize, child: Child, [low, high]: Bounds) {
        self.children[lane] = child.code();
        for axis in 0..3 {
            self.bounds[axis][0].0[lane] = low[axis];
            self.bounds[axis][1].0[lane] = high[axis];
        }
    }

    /// Returns the bounding box of all children.
    pub(super) fn around(&self) -> Bounds {
        let least = |side: usize| self.bounds.map(|axis| axis[side].0.into_iter().fold(f32::INFINITY, f32::min));
        let most = |side: usize| self.bounds.map(|axis| axis[side].0.into_iter().fold(f32::NEG_INFINITY, f32::max));
        [Vec3::from_array(least(0)), Vec3::from_array(most(1))]
    }
}

/// Sets the boxes of inner nodes from their children, bottom up. Returns the largest number of entries on the
/// traversal stack: per level of a path, all children but one.
fn enclose(nodes: &mut [Node8]) -> usize {
    let mut needs = vec![0_usize; nodes.len()];
    // Children come after their parent. The box of a node is empty until it is set here.
    for number in (0..nodes.len()).rev() {
        let mut most = None;
        let mut used = 0;
        for lane in 0..WIDTH {
            let code = nodes[number].children[lane];
            let open = nodes[number].bounds[0][0].0[lane] > nodes[number].bounds[0][1].0[lane];
            if open && code != 0 {
                let bounds = nodes[code as usize].around();
                nodes[number].put(lane, Child::Node(code), bounds);
                most = most.max(Some(needs[code as usize]));
                used += 1;
            } else if !open {
                most = most.max(Some(0));
                used += 1;
            }
        }
        needs[number] = most.map_or(0, |below| used - 1 + below);
    }
    needs.first().copied().unwrap_or(0)
}
