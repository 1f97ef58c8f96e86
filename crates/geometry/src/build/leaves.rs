//! Leaves of up to eight triangles.

use super::boxes::boxes;
use super::joining::{greater, lesser};
use super::{Bounds, Item, Items, NOTHING, UpToEight};
use crate::Shape;
#[cfg(target_arch = "x86_64")]
use crate::lanes::Whole;
use crate::lanes::{Lanes, Pair, Vectors, WIDTH};
use crate::pages::Pages;
use crate::tree::{Child, Keys, Tree};
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
    tree.triangles = Pages::zeroed(leaves.len());
    tree.triangle_keys = Pages::zeroed(leaves.len());
    fill(leaves, items, false, (&mut tree.triangles, &mut tree.triangle_keys, &mut boxes));
    if items.shapes.iter().any(|shape| matches!(shape, Shape::Moving(_))) {
        tree.moved = Pages::zeroed(leaves.len());
        fill(leaves, items, true, (&mut tree.moved, &mut tree.triangle_keys, &mut boxes));
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

/// Writes leaves of triangles and their keys, and adds them to the boxes of the leaves. If `ends`, the triangles are
/// those at time 1.
fn fill(
    leaves: &[Members],
    items: &Items<'_>,
    ends: bool,
    (triangles, keys, boxes): (&mut [Triangles8], &mut [Keys], &mut [Bounds]),
) {
    let vectors = Vectors::default();
    let parts = leaves.par_chunks(BATCH).zip(triangles.par_chunks_mut(BATCH));
    let parts = parts.zip(keys.par_chunks_mut(BATCH)).zip(boxes.par_chunks_mut(BATCH));
    parts.for_each(|(((leaves, triangles), keys), boxes)| match vectors {
        #[cfg(target_arch = "x86_64")]
        Vectors::Whole(token) => {
            let lanes = PhantomData::<Whole>;
            token.vectorize(Fill { token, leaves, items, ends, triangles, keys, boxes, lanes });
        }
        Vectors::Pair => {
            Fill { token: (), leaves, items, ends, triangles, keys, boxes, lanes: PhantomData::<Pair> }.call();
        }
    });
}

/// The filling of some leaves, compiled for each kind of vectors.
struct Fill<'a, L: Lanes> {
    token: L::Token,
    leaves: &'a [Members],
    items: &'a Items<'a>,
    ends: bool,
    triangles: &'a mut [Triangles8],
    keys: &'a mut [Keys],
    boxes: &'a mut [Bounds],
    lanes: PhantomData<L>,
}

impl<L: Lanes> NullaryFnOnce for Fill<'_, L> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let leaves = self.leaves.iter().zip(self.triangles).zip(self.keys).zip(self.boxes);
        for (((members, triangles), keys), bounds) in leaves {
            let mut found = [0; WIDTH];
            for (lane, (slot, &number)) in found.iter_mut().zip(&members.all).enumerate().take(members.count) {
                let (key, item) = self.items.item(number);
                *slot = key;
                triangles.put(
                    lane,
                    match item {
                        Item::Triangle(mesh) => mesh.corners(key as u32),
                        Item::Moving(mesh) if self.ends => mesh.ends_of(key as u32),
                        Item::Moving(mesh) => mesh.corners(key as u32, 0.0),
                        // Leaves with several items hold triangles only.
                        Item::Quadric(_) | Item::Box(_) => continue,
                    },
                );
            }
            triangles.repeat_from(members.count);
            let first = found[0];
            found.iter_mut().skip(members.count).for_each(|key| *key = first);
            *keys = Keys::new(found);
            let sides = boxes::<L>(self.token, triangles, self.items.padded);
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
