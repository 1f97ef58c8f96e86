//! The best form of each binary subtree in the eight-wide tree, by expected cost.
//!
//! Dynamic programming over the surface-area cost decides each subtree's form: a node, a leaf, or several children of
//! its parent [after Ylitie, Karras and Laine 2017, section 3.1].

use super::binary::Binary;
use super::items::{Item, ItemBox, Items};
use crate::huge_pages::Pages;
use crate::lanes::WIDTH;
use bytemuck::{Pod, Zeroable};
use obvhs::bvh2::node::Bvh2Node;
use rayon::prelude::*;

/// The expected time of testing eight boxes, which is the unit of all costs here.
const NODE_COST: f32 = 1.0;
/// The expected time of testing a leaf, and the additional time per triangle, for memory access and for hits that are computed
/// completely. With 0.6 per leaf and 0 per triangle, rays take up to 10 % longer in the scenes of benches/rays.rs
/// (docs/LOG.md).
const LEAF_COST: f32 = 0.4;
const TRIANGLE_COST: f32 = 0.05;
/// The expected time of testing one sphere or disk.
const QUADRIC_COST: f32 = 2.5;
/// The expected time of testing an instance: an estimate for transforming a ray and testing a few of the object's nodes.
const BOX_COST: f32 = 10.0;

/// The combined costs of two siblings, in 32 bytes, since there may be one such pair for each primitive.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
struct Pair {
    /// The smallest total cost of both siblings if they become at most 2, 3, … 8 children of a node.
    cost: [f32; WIDTH - 1],
    /// The number of triangles below both siblings. [`MANY`] if they do not fit a leaf, or if there are other items among
    /// them. 0 marks a pair whose costs are not computed yet.
    triangles: u32,
}

const MANY: u32 = WIDTH as u32 + 1;

/// The smallest costs of a subtree of the binary tree, and its best form.
#[derive(Clone, Copy, Debug)]
pub(super) struct SubtreePlan {
    /// The smallest cost of the subtree if it becomes at most 1, 2, … 7 children of a node.
    pub(super) cost: [f32; WIDTH - 1],
    /// The number of triangles in the subtree; [`MANY`] if its items do not fit a leaf; see [`Pair::triangles`].
    pub(super) triangles: u32,
    /// True if the subtree, as a single child, costs less as a leaf than as a node.
    pub(super) leaf: bool,
}

/// The best forms of all subtrees of a binary tree.
pub(super) struct SubtreePlans<'a> {
    tree: Costs<'a>,
    /// The pairs of siblings in reverse order of their nodes: the first pair is the last two nodes.
    pairs: Pages<Pair>,
}

impl<'a> SubtreePlans<'a> {
    /// Computes the costs of all pairs, from the leaves up, in chunks. Almost all children come after their parent in the
    /// list, most of them in the same chunk. The remaining pairs and their ancestors are computed last. The memory of `spent`
    /// is reused.
    pub(super) fn new(binary: &'a Binary, items: &'a Items<'a>, spent: Pages<ItemBox>) -> Self {
        let (nodes, triangles) = (&binary.nodes[..], items.are_triangles());
        let tree = Costs { nodes, order: &binary.order, items, triangles };
        let mut pairs: Pages<Pair> = spent.reused(nodes.len() / 2);
        let open = pairs.par_chunks_mut(CHUNK).enumerate().flat_map_iter(|(chunk, pairs)| {
            let first = chunk * CHUNK;
            for number in 0..pairs.len() {
                let (known, rest) = pairs.split_at_mut(number);
                rest[0] = tree.pair((known, first), first + number).unwrap_or_default();
            }
            let open = move |(number, pair): (usize, &mut Pair)| (pair.triangles == 0).then_some(first + number);
            pairs.iter_mut().enumerate().filter_map(open)
        });
        let mut waiting: Vec<usize> = open.collect();
        // The last nodes of the list are done first: children before their parents.
        waiting.reverse();
        while let Some(number) = waiting.pop() {
            if pairs[number].triangles > 0 {
                continue;
            }
            match tree.pair((&pairs, 0), number) {
                Some(pair) => pairs[number] = pair,
                None => {
                    waiting.push(number);
                    let first = nodes.len() - 2 * (number + 1);
                    let below = nodes[first..first + 2].iter().filter(|child| !child.is_leaf());
                    waiting.extend(below.map(|child| tree.pair_of(child)));
                }
            }
        }
        Self { tree, pairs }
    }

    /// Returns the best form of the subtree at a node.
    #[inline(always)]
    pub(super) fn plan(&self, node: usize) -> SubtreePlan {
        self.tree.plan((&self.pairs, 0), node)
    }
}

/// The number of pairs whose costs one task computes.
const CHUNK: usize = 1 << 12;

/// A binary tree with the data for computing costs.
struct Costs<'a> {
    nodes: &'a [Bvh2Node],
    order: &'a [u32],
    items: &'a Items<'a>,
    /// True if all items are triangles, so that the kind of an item is known without a look-up.
    triangles: bool,
}

impl Costs<'_> {
    /// Computes the costs of pair `number` from the costs in `known`, a list of pairs with the number of its first pair.
    /// Returns `None` if the costs of a pair below are missing.
    #[inline(always)]
    fn pair(&self, known: (&[Pair], usize), number: usize) -> Option<Pair> {
        let first = self.nodes.len() - 2 * (number + 1);
        let (left, right) = (self.plan(known, first), self.plan(known, first + 1));
        if left.triangles == 0 || right.triangles == 0 {
            return None;
        }
        let triangles = (left.triangles + right.triangles).min(MANY);
        Some(Pair { cost: shares(&left, &right), triangles })
    }

    #[inline(always)]
    fn plan(&self, (known, from): (&[Pair], usize), number: usize) -> SubtreePlan {
        let node = &self.nodes[number];
        let area = node.aabb().half_area();
        if node.is_leaf() {
            let (cost, triangles) = if self.triangles {
                (LEAF_COST + TRIANGLE_COST * node.prim_count as f32, node.prim_count)
            } else {
                match self.items.item(self.order[node.first_index as usize]).1 {
                    Item::Triangle(_) | Item::Moving(_) => (LEAF_COST + TRIANGLE_COST, 1),
                    Item::Quadric(_) => (QUADRIC_COST, MANY),
                    Item::Box(_) => (BOX_COST, MANY),
                }
            };
            return SubtreePlan { cost: [area * cost; WIDTH - 1], triangles, leaf: true };
        }
        let Pair { cost: below, triangles } =
            self.pair_of(node).checked_sub(from).and_then(|at| known.get(at)).copied().unwrap_or_default();
        let as_node = area * NODE_COST + below[WIDTH - 2];
        let of_leaf = LEAF_COST + TRIANGLE_COST * triangles as f32;
        let as_leaf = if triangles == MANY { f32::INFINITY } else { area * of_leaf };
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

/// Returns the smallest costs of two siblings with 2, 3, … 8 children in total, over all distributions. All are computed in
/// one loop, so that compilers vectorise it.
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

/// Returns the number of children, of `slots`, on the left side in the cheapest distribution.
pub(super) fn share(left: &SubtreePlan, right: &SubtreePlan, slots: usize) -> usize {
    let mut best = (1, f32::INFINITY);
    for i in 1..slots {
        let cost = left.cost[i - 1] + right.cost[slots - i - 1];
        if cost < best.1 {
            best = (i, cost);
        }
    }
    best.0
}
