//! Leaves of up to eight triangles.

use super::boxes::boxes;
use super::joining::{greater, lesser};
use super::{Bounds, Item, Items, NOTHING, UpToEight};
use crate::Shape;
#[cfg(target_arch = "x86_64")]
use crate::lanes::Whole;
use crate::lanes::{Lanes, Pair, Vectors, WIDTH};
use crate::pages::Pages;
use crate::tree::{Child, Keys, Leaf, Tree};
use crate::triangle::Triangles8;
use obvhs::bvh2::node::Bvh2Node;
use pulp::NullaryFnOnce;
use rayon::prelude::*;
use std::marker::PhantomData;

/// A leaf of triangles that is not packed yet: the root of its binary subtree, and its place (node and lane) in a wide
/// node.
#[derive(Clone, Copy)]
pub(super) struct Loose {
    pub(super) binary: u32,
    pub(super) wide: u32,
    pub(super) lane: usize,
}

/// The number of leaves whose items are looked up together. Reading nodes of several subtrees in turn hides memory
/// latency.
const BATCH: usize = 64;

/// The items of a leaf.
type Members = UpToEight<u32>;

/// Packs leaves of triangles into a tree in their order, and sets their boxes in its nodes.
pub(super) fn pack(loose: &[Loose], nodes: &[Bvh2Node], items: &Items<'_>, tree: &mut Tree) {
    let batches: Vec<[Members; BATCH]> =
        loose.par_chunks(BATCH).map_init(Default::default, |open, leaves| members(leaves, nodes, open)).collect();
    let leaves = &batches.as_flattened()[..loose.len()];
    let mut boxes = vec![NOTHING; leaves.len()];
    tree.leaves = Pages::zeroed(leaves.len());
    fill(leaves, items, &mut tree.leaves, &mut boxes);
    if items.shapes.iter().any(|shape| matches!(shape, Shape::Moving(_))) {
        tree.moved = Pages::zeroed(leaves.len());
        fill(leaves, items, &mut tree.moved, &mut boxes);
    }
    for (number, (&Loose { wide, lane, .. }, &bounds)) in (0..).zip(loose.iter().zip(&boxes)) {
        tree.nodes[wide as usize].put(lane, Child::Triangles(number), bounds);
    }
}

/// Returns the items of up to [`BATCH`] leaves. `open` is memory to work in: binary nodes to visit, now and next, each
/// with its leaf.
fn members(leaves: &[Loose], nodes: &[Bvh2Node], [open, next]: &mut [Vec<(u32, u32)>; 2]) -> [Members; BATCH] {
    let mut members = std::array::from_fn(|_| Members { all: [0; WIDTH], count: 0 });
    open.extend((0..).zip(leaves).map(|(leaf, &Loose { binary, .. })| (leaf, binary)));
    while !open.is_empty() {
        // Nodes are counted first, without branches, so that all memory is requested before any of it is needed.
        let inner = open.iter().filter(|&&(_, number)| !nodes[number as usize].is_leaf()).count();
        next.reserve(2 * inner);
        for &(leaf, number) in &*open {
            let node = &nodes[number as usize];
            if node.is_leaf() {
                members[leaf as usize].push(node.first_index);
            } else {
                next.extend([(leaf, node.first_index), (leaf, node.first_index + 1)]);
            }
        }
        std::mem::swap(open, next);
        next.clear();
    }
    members
}

/// The place of a leaf's triangles at one time.
trait Slot: Send {
    /// True if the triangles are those at time 1.
    const ENDS: bool;

    fn triangles(&mut self) -> &mut Triangles8;
    fn label(&mut self, keys: [u64; WIDTH]);
}

impl Slot for Leaf {
    const ENDS: bool = false;

    #[inline(always)]
    fn triangles(&mut self) -> &mut Triangles8 {
        &mut self.triangles
    }

    #[inline(always)]
    fn label(&mut self, keys: [u64; WIDTH]) {
        self.keys = Keys::new(keys);
    }
}

impl Slot for Triangles8 {
    const ENDS: bool = true;

    #[inline(always)]
    fn triangles(&mut self) -> &mut Triangles8 {
        self
    }

    #[inline(always)]
    fn label(&mut self, _: [u64; WIDTH]) {}
}

/// Writes the triangles of leaves, and adds them to the boxes of the leaves.
fn fill<T: Slot>(leaves: &[Members], items: &Items<'_>, slots: &mut [T], boxes: &mut [Bounds]) {
    let vectors = Vectors::default();
    let parts = leaves.par_chunks(BATCH).zip(slots.par_chunks_mut(BATCH)).zip(boxes.par_chunks_mut(BATCH));
    parts.for_each(|((leaves, slots), boxes)| match vectors {
        #[cfg(target_arch = "x86_64")]
        Vectors::Whole(token) => {
            let lanes = PhantomData::<Whole>;
            token.vectorize(Fill { token, leaves, items, slots, boxes, lanes });
        }
        Vectors::Pair => {
            Fill { token: (), leaves, items, slots, boxes, lanes: PhantomData::<Pair> }.call();
        }
    });
}

/// The filling of some leaves, compiled for each kind of vectors.
struct Fill<'a, T, L: Lanes> {
    token: L::Token,
    leaves: &'a [Members],
    items: &'a Items<'a>,
    slots: &'a mut [T],
    boxes: &'a mut [Bounds],
    lanes: PhantomData<L>,
}

impl<T: Slot, L: Lanes> NullaryFnOnce for Fill<'_, T, L> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        for ((members, slot), bounds) in self.leaves.iter().zip(self.slots).zip(self.boxes) {
            let triangles = slot.triangles();
            let mut found = [0; WIDTH];
            for (lane, (slot, &number)) in found.iter_mut().zip(&members.all).enumerate().take(members.count) {
                let (key, item) = self.items.item(number);
                *slot = key;
                triangles.put(
                    lane,
                    match item {
                        Item::Triangle(mesh) => mesh.corners(key as u32),
                        Item::Moving(mesh) if T::ENDS => mesh.ends_of(key as u32),
                        Item::Moving(mesh) => mesh.corners(key as u32, 0.0),
                        // Leaves with several items hold triangles only.
                        Item::Quadric(_) | Item::Box(_) => continue,
                    },
                );
            }
            triangles.repeat_from(members.count);
            let sides = boxes::<L>(self.token, triangles, self.items.padded);
            let first = found[0];
            found.iter_mut().skip(members.count).for_each(|key| *key = first);
            slot.label(found);
            for axis in 0..3 {
                let [low, high] = &sides[axis];
                for lane in 0..WIDTH {
                    bounds[0][axis] = lesser(bounds[0][axis], low.0[lane]);
                    bounds[1][axis] = greater(bounds[1][axis], high.0[lane]);
                }
            }
        }
    }
}
