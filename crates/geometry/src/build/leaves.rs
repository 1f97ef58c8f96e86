//! Leaves of up to eight triangles.

use super::{Bounds, Item, Items, NOTHING, UpToEight, union};
use crate::Shape;
use crate::lanes::WIDTH;
use crate::tree::{Child, Keys, Tree};
use crate::triangle::Triangles8;
use obvhs::bvh2::node::Bvh2Node;
use rayon::prelude::*;

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
    let mut labels: Vec<(Keys, Bounds)> = Vec::new();
    let packed = leaves.par_iter().with_min_len(BATCH).map(|members| {
        let (triangles, keys, bounds) = pack_leaf(members, items);
        (triangles, (keys, bounds))
    });
    packed.unzip_into_vecs(&mut tree.triangles, &mut labels);
    if items.shapes.iter().any(|shape| matches!(shape, Shape::Moving(_))) {
        let ends = leaves.par_iter().with_min_len(BATCH).map(|members| ends(members, items));
        ends.collect_into_vec(&mut tree.moved);
    }
    labels.par_iter().with_min_len(BATCH).map(|(keys, _)| *keys).collect_into_vec(&mut tree.triangle_keys);
    for (number, (&Loose { wide, lane, .. }, &(_, bounds))) in (0..).zip(loose.iter().zip(&labels)) {
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

/// Returns the corners of a leaf's triangles (those at time 0, if they move), their keys and their box.
fn pack_leaf(members: &Members, items: &Items<'_>) -> (Triangles8, Keys, Bounds) {
    let mut corners = Triangles8::default();
    let mut keys = [0; WIDTH];
    let mut bounds = NOTHING;
    for (lane, slot) in keys.iter_mut().enumerate() {
        let (key, item) = items.item(members.in_lane(lane));
        *slot = key;
        let triangle = match item {
            Item::Triangle(mesh) => mesh.corners(key as u32),
            Item::Moving(mesh) => {
                bounds = union(bounds, items.around(mesh.ends_of(key as u32)));
                mesh.corners(key as u32, 0.0)
            }
            // Leaves with several items hold triangles only.
            Item::Quadric(_) | Item::Box(_) => continue,
        };
        corners.put(lane, triangle);
        bounds = union(bounds, items.around(triangle));
    }
    (corners, Keys::new(keys), bounds)
}

/// Returns the corners of a leaf's triangles at time 1.
fn ends(members: &Members, items: &Items<'_>) -> Triangles8 {
    let mut ends = Triangles8::default();
    for lane in 0..WIDTH {
        let (key, item) = items.item(members.in_lane(lane));
        match item {
            Item::Triangle(mesh) => ends.put(lane, mesh.corners(key as u32)),
            Item::Moving(mesh) => ends.put(lane, mesh.ends_of(key as u32)),
            Item::Quadric(_) | Item::Box(_) => {}
        }
    }
    ends
}

impl Members {
    /// Returns the item in a lane. Unused lanes repeat the first.
    #[inline(always)]
    fn in_lane(&self, lane: usize) -> u32 {
        self.all[if lane < self.count { lane } else { 0 }]
    }
}
