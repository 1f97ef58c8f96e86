//! Leaves of up to eight triangles.

use super::binary::Binary;
use super::items::{Bounds, Item, Items, NOTHING, boxes};
use crate::bvh::{Bvh, Child};
use crate::huge_pages::Pages;
#[cfg(target_arch = "x86_64")]
use crate::lanes::Whole;
use crate::lanes::{Lanes, Pair, Vectors, WIDTH};
use crate::leaf::{self, Triangles8};
use crate::shape::Shape;
use pulp::NullaryFnOnce;
use rayon::prelude::*;
use std::marker::PhantomData;

/// A leaf of triangles that is not packed yet: the root of its binary subtree, its place (node and lane) in a wide node, and the
/// number of its triangles.
#[derive(Clone, Copy)]
pub(super) struct Loose {
    pub(super) binary: u32,
    pub(super) wide: u32,
    pub(super) lane: u8,
    pub(super) count: u8,
}

/// The number of leaves whose items are looked up together. Reading nodes of several subtrees in turn hides memory
/// latency.
const BATCH: usize = 64;

/// A list of up to eight values, without heap allocation.
#[derive(Clone, Copy)]
pub(super) struct UpToEight<T> {
    pub(super) all: [T; WIDTH],
    pub(super) count: usize,
}

impl<T: Copy> UpToEight<T> {
    pub(super) fn push(&mut self, one: T) {
        self.all[self.count] = one;
        self.count += 1;
    }
}

/// The items of a leaf.
type Members = UpToEight<u32>;

/// Packs leaves of triangles into a tree in their order, and sets their boxes in its nodes.
pub(super) fn pack(loose: &[Loose], binary: &Binary, items: &Items<'_>, bvh: &mut Bvh) {
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

/// Returns the items of up to [`BATCH`] leaves. `open` is memory to work in: binary nodes to visit, now and next, each
/// with its leaf.
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

/// The lesser of two numbers, in one instruction, since neither is NaN.
#[inline(always)]
fn lesser(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline(always)]
fn greater(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// Writes the leaves, also with the triangles at time 1 if there is memory for these, and adds them to the boxes of the leaves.
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
        fill_batch::<false>(vectors, leaves, items, words, boxes);
        if !ends.is_empty() {
            fill_batch::<true>(vectors, leaves, items, ends, boxes);
        }
    });
}

fn fill_batch<const ENDS: bool>(
    vectors: Vectors,
    leaves: &[Members],
    items: &Items<'_>,
    words: &mut [f32],
    boxes: &mut [Bounds],
) {
    match vectors {
        #[cfg(target_arch = "x86_64")]
        Vectors::Whole(token) => {
            let lanes = PhantomData::<Whole>;
            token.vectorize(Fill::<_, ENDS> { token, leaves, items, words, boxes, lanes });
        }
        Vectors::Pair => {
            Fill::<_, ENDS> { token: (), leaves, items, words, boxes, lanes: PhantomData::<Pair> }.call();
        }
    }
}

/// The filling of some leaves, compiled for each kind of vectors.
struct Fill<'a, L: Lanes, const ENDS: bool> {
    token: L::Token,
    leaves: &'a [Members],
    items: &'a Items<'a>,
    words: &'a mut [f32],
    boxes: &'a mut [Bounds],
    lanes: PhantomData<L>,
}

impl<L: Lanes, const ENDS: bool> NullaryFnOnce for Fill<'_, L, ENDS> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
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
            let sides = boxes::<L>(self.token, &triangles);
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
