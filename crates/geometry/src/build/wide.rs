//! Conversion of a binary tree to eight-wide nodes, in the forms that [`SubtreePlans`] found to be cheapest.
//!
//! The top of the tree is converted first, then the subtrees below it in parallel. They are joined in a fixed order, so
//! the tree doesn't depend on the number of threads. Leaves of up to eight triangles are packed last.

use super::binary::Binary;
use super::items::{Bounds, Item, ItemBox, Items, NOTHING, boxes};
use super::plans::{SubtreePlan, SubtreePlans, share};
use crate::bvh::{Bvh, Child, DEEPEST, Node8};
use crate::huge_pages::Pages;
use crate::lanes::{Lanes, Vectorised, Vectors, WIDTH};
use crate::leaf::{self, Triangles8};
use crate::shape::{Quadric, Shape};
use rayon::prelude::*;

/// Converts a binary tree to an eight-wide tree. Returns `None` if the tree is empty or needs a deeper traversal stack than
/// [`DEEPEST`]. The memory of `spent` is reused.
pub(super) fn collapse(binary: &Binary, items: &Items<'_>, spent: Pages<ItemBox>) -> Option<Bvh> {
    if binary.nodes.is_empty() {
        return None;
    }
    let (nodes, rest) = Wide { binary, items, plans: SubtreePlans::new(binary, items, spent) }.emit();
    let mut bvh = Bvh { nodes, quadrics: rest.quadrics, quadric_keys: rest.quadric_keys, ..Bvh::default() };
    pack(&rest.loose, binary, items, &mut bvh);
    bvh.stack = enclose(&mut bvh.nodes);
    (bvh.stack <= DEEPEST).then_some(bvh)
}

/// A binary tree during its conversion.
struct Wide<'a> {
    binary: &'a Binary,
    items: &'a Items<'a>,
    plans: SubtreePlans<'a>,
}

/// A part of the wide tree: nodes, the first of which is the root, and the leaves below. Indices count from the start of the
/// part.
#[derive(Default)]
struct Part {
    /// The nodes. The boxes of inner children and of triangle leaves are not set yet.
    nodes: Vec<Node8>,
    loose: Vec<Loose>,
    quadrics: Vec<Quadric>,
    quadric_keys: Vec<u64>,
}

/// A binary subtree that becomes a child of a wide node.
#[derive(Clone, Copy)]
struct Chosen {
    node: u32,
    leaf: bool,
    /// The number of triangles of a leaf; 0 for a leaf with another item.
    triangles: u8,
}

impl Chosen {
    fn new(node: u32, plan: &SubtreePlan) -> Self {
        let triangles = if plan.triangles <= WIDTH as u32 { plan.triangles as u8 } else { 0 };
        Self { node, leaf: plan.leaf, triangles }
    }
}

/// A wide node whose children are not set yet.
#[derive(Clone, Copy)]
struct Open {
    /// The first of the two siblings in the binary tree that the wide node replaces.
    below: u32,
    wide: u32,
}

/// The number of binary nodes per subtree that is converted as a separate task, if the tree branches enough.
const SUBTREE: usize = 1 << 15;

impl Wide<'_> {
    /// Returns the nodes of the whole tree, and a part with its leaves.
    fn emit(self) -> (Pages<Node8>, Part) {
        let plan = self.plans.plan(0);
        let mut top = Part { nodes: vec![Node8::EMPTY], ..Part::default() };
        let mut open = Vec::new();
        if plan.leaf {
            let root = Chosen::new(0, &plan);
            self.place(root, (0, 0), &mut top, &mut open);
        } else {
            open.push(Open { below: self.binary.nodes[0].first_index, wide: 0 });
        }
        let mut filled = 0;
        while filled < open.len() && (open.len() - filled) * SUBTREE < self.binary.nodes.len() {
            self.fill(open[filled], &mut top, &mut open);
            filled += 1;
        }
        let parts: Vec<Part> = open[filled..].par_iter().map(|root| self.subtree(root.below)).collect();
        // The root of each part is already in the top of the tree.
        let mut nodes = Pages::zeroed(top.nodes.len() + parts.iter().map(|part| part.nodes.len() - 1).sum::<usize>());
        let mut filled_nodes = top.nodes.len();
        nodes[..filled_nodes].copy_from_slice(&top.nodes);
        for (root, part) in open[filled..].iter().zip(parts) {
            filled_nodes = top.join(part, root.wide, &mut nodes, filled_nodes);
        }
        (nodes, top)
    }

    /// Converts the subtree below two siblings.
    fn subtree(&self, below: u32) -> Part {
        let mut part = Part { nodes: vec![Node8::EMPTY], ..Part::default() };
        let mut open = vec![Open { below, wide: 0 }];
        while let Some(node) = open.pop() {
            self.fill(node, &mut part, &mut open);
        }
        part
    }

    /// Sets the children of a wide node. Children that are nodes are queued in `open`.
    fn fill(&self, node: Open, part: &mut Part, open: &mut Vec<Open>) {
        let mut children = UpToEight { all: [Chosen { node: 0, leaf: false, triangles: 0 }; WIDTH], count: 0 };
        self.divide(node.below, WIDTH, &mut children);
        for lane in 0..children.count {
            self.place(children.all[lane], (node.wide, lane), part, open);
        }
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
                self.divide(self.binary.nodes[child as usize].first_index, slots, children);
            } else {
                children.push(Chosen::new(child, plan));
            }
        }
    }

    /// Makes a subtree the child of a wide node in a lane. A node is queued in `open`; a leaf of triangles is added to the
    /// part's loose leaves.
    fn place(&self, it: Chosen, (wide, lane): (u32, usize), part: &mut Part, open: &mut Vec<Open>) {
        let first = self.binary.nodes[it.node as usize].first_index;
        let (child, bounds) = if !it.leaf {
            let number = part.nodes.len() as u32;
            part.nodes.push(Node8::EMPTY);
            open.push(Open { below: first, wide: number });
            (Child::Node(number), NOTHING)
        } else if it.triangles > 0 {
            part.loose.push(Loose { binary: it.node, wide, lane: lane as u8, count: it.triangles });
            (Child::Triangles(part.loose.len() as u32 - 1), NOTHING)
        } else {
            let number = self.binary.order[first as usize];
            let (key, item) = self.items.item(number);
            let child = match item {
                Item::Quadric(quadric) => {
                    part.quadrics.push(quadric);
                    part.quadric_keys.push(key);
                    Child::Quadric(part.quadrics.len() as u32 - 1)
                }
                _ => Child::Quadric(key as u32),
            };
            (child, self.items.bounds(number))
        };
        part.nodes[wide as usize].put(lane, child, bounds);
    }
}

impl Part {
    /// Appends a part. Its root replaces the node `root`; its other nodes follow the first `filled` nodes. Returns the new
    /// number of filled nodes.
    fn join(&mut self, mut part: Self, root: u32, nodes: &mut [Node8], filled: usize) -> usize {
        // The part's root isn't appended, so its second node is the first that is.
        let before = filled as u32 - 1;
        let offsets = [before, self.loose.len() as u32, self.quadrics.len() as u32];
        part.nodes.iter_mut().for_each(|node| node.shift(offsets));
        nodes[root as usize] = part.nodes[0];
        let end = filled + part.nodes.len() - 1;
        nodes[filled..end].copy_from_slice(&part.nodes[1..]);
        self.loose.extend(part.loose.iter().map(|leaf| {
            let wide = if leaf.wide == 0 { root } else { leaf.wide + before };
            Loose { wide, ..*leaf }
        }));
        self.quadrics.append(&mut part.quadrics);
        self.quadric_keys.append(&mut part.quadric_keys);
        end
    }
}

/// Sets the boxes of inner nodes from their children, bottom up. Returns the largest number of entries on the traversal stack:
/// the sum over the levels of a path of the number of children minus 1.
fn enclose(nodes: &mut [Node8]) -> usize {
    let mut needs = vec![0_usize; nodes.len()];
    // Children come after their parent. The box of a node is empty until it is set here.
    for number in (0..nodes.len()).rev() {
        let mut most = None;
        let mut used = 0;
        for lane in 0..WIDTH {
            let code = nodes[number].children.0[lane];
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

/// A leaf of triangles that is not packed yet: the root of its binary subtree, its position (node and lane) in a wide node,
/// and its number of triangles.
#[derive(Clone, Copy)]
struct Loose {
    binary: u32,
    wide: u32,
    lane: u8,
    count: u8,
}

/// The number of leaves whose items are collected together. Reading nodes of several subtrees in turn hides memory latency.
const BATCH: usize = 64;

/// A list of up to eight values, without heap allocation.
#[derive(Clone, Copy)]
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

/// The items of a leaf.
type Members = UpToEight<u32>;

/// Packs triangle leaves into a tree, in their order, and sets their boxes in the tree's nodes.
fn pack(loose: &[Loose], binary: &Binary, items: &Items<'_>, bvh: &mut Bvh) {
    let mut boxes = vec![NOTHING; loose.len()];
    let triangles: usize = loose.iter().map(|leaf| usize::from(leaf.count)).sum();
    let words = triangles * leaf::WORDS + leaf::SPAN;
    bvh.leaves = Pages::zeroed(words);
    if items.shapes.iter().any(|shape| matches!(shape, Shape::Moving(_))) {
        bvh.moved = Pages::zeroed(words);
    }
    fill(loose, binary, items, [&mut bvh.leaves, &mut bvh.moved], &mut boxes);
    let mut first = 0;
    for (&Loose { wide, lane, count, .. }, &bounds) in loose.iter().zip(&boxes) {
        bvh.nodes[wide as usize].put(lane.into(), Child::Triangles(leaf::place(first, count.into())), bounds);
        first += u32::from(count);
    }
}

/// Returns the items of up to [`BATCH`] leaves. The two lists are working memory: the binary nodes to visit now and next, each
/// with the number of its leaf.
fn members(leaves: &[Loose], binary: &Binary, [open, next]: &mut [Vec<(u32, u32)>; 2]) -> [Members; BATCH] {
    let Binary { nodes, order } = binary;
    let mut members = std::array::from_fn(|_| Members { all: [0; WIDTH], count: 0 });
    open.extend((0..).zip(leaves).map(|(leaf, &Loose { binary, .. })| (leaf, binary)));
    while !open.is_empty() {
        // Nodes are counted first, without branches, so that all memory is requested before any of it is needed.
        let inner = open.iter().filter(|&&(_, number)| !nodes[number as usize].is_leaf()).count();
        next.reserve(2 * inner);
        for &(leaf, number) in &*open {
            let node = &nodes[number as usize];
            if node.is_leaf() {
                let first = node.first_index as usize;
                order[first..][..node.prim_count as usize].iter().for_each(|&item| members[leaf as usize].push(item));
            } else {
                next.extend([(leaf, node.first_index), (leaf, node.first_index + 1)]);
            }
        }
        std::mem::swap(open, next);
        next.clear();
    }
    members
}

/// Returns the smaller of two numbers in one instruction, since neither is NaN.
#[inline(always)]
fn lesser(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline(always)]
fn greater(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// Writes the leaves, and extends their boxes to their triangles. Triangles at time 1 are included if there is memory for
/// them.
fn fill(
    loose: &[Loose],
    binary: &Binary,
    items: &Items<'_>,
    [mut words, mut ends]: [&mut [f32]; 2],
    boxes: &mut [Bounds],
) {
    let vectors = Vectors::default();
    let mut parts = Vec::with_capacity(loose.len().div_ceil(BATCH));
    for (loose, boxes) in loose.chunks(BATCH).zip(boxes.chunks_mut(BATCH)) {
        let count = loose.iter().map(|leaf| usize::from(leaf.count)).sum::<usize>() * leaf::WORDS;
        let (of_part, rest) = words.split_at_mut(count);
        let (ends_of_part, rest_of_ends) = ends.split_at_mut(count.min(ends.len()));
        parts.push((loose, [of_part, ends_of_part], boxes));
        (words, ends) = (rest, rest_of_ends);
    }
    parts.into_par_iter().for_each_init(Default::default, |open, (loose, [words, ends], boxes)| {
        let leaves = &members(loose, binary, open)[..loose.len()];
        vectors.run(Fill::<false> { leaves, items, words, boxes });
        if !ends.is_empty() {
            vectors.run(Fill::<true> { leaves, items, words: ends, boxes });
        }
    });
}

/// The computation of [`fill`] for some leaves, compiled for each kind of vectors.
struct Fill<'a, const ENDS: bool> {
    leaves: &'a [Members],
    items: &'a Items<'a>,
    words: &'a mut [f32],
    boxes: &'a mut [Bounds],
}

impl<const ENDS: bool> Vectorised for Fill<'_, ENDS> {
    #[inline(always)]
    fn run<L: Lanes>(self, token: L::Token) {
        let mut words = self.words;
        for (members, bounds) in self.leaves.iter().zip(self.boxes) {
            let count = members.count.min(WIDTH);
            let mut triangles = Triangles8::default();
            let mut keys = [0; WIDTH];
            for (lane, (slot, &number)) in keys.iter_mut().zip(&members.all).enumerate().take(count) {
                let (key, item) = self.items.item(number);
                *slot = key;
                triangles.put(
                    lane,
                    match item {
                        Item::Triangle(mesh) => mesh.corners(key as u32),
                        Item::Moving(mesh) if ENDS => mesh.ends_of(key as u32),
                        Item::Moving(mesh) => mesh.corners(key as u32, 0.0),
                        // Leaves with several items hold triangles only.
                        Item::Quadric(_) | Item::Box(_) => continue,
                    },
                );
            }
            let sides = boxes::<L>(token, &triangles);
            for axis in 0..3 {
                let [low, high] = &sides[axis];
                for lane in 0..count {
                    bounds[0][axis] = lesser(bounds[0][axis], low.0[lane]);
                    bounds[1][axis] = greater(bounds[1][axis], high.0[lane]);
                }
            }
            let (of_leaf, rest) = words.split_at_mut(count * leaf::WORDS);
            leaf::write(of_leaf, &triangles, &keys[..count]);
            words = rest;
        }
    }
}
