//! The tree that rays walk, and the walk.

use crate::frame::Frame;
use crate::instance::Placements;
#[cfg(target_arch = "x86_64")]
use crate::lanes::Whole;
use crate::lanes::{Eight, Lanes, Pair, Vectors, WIDTH, Words};
use crate::safeguards::{All, Safeguards};
use crate::shape::Quadric;
use crate::triangle::{Triangles8, lowest};
use pulp::NullaryFnOnce;
use std::marker::PhantomData;

/// Set in a child's code if it is a leaf of triangles; the rest is its block.
const TRIANGLES: u32 = 1 << 31;
/// Set in a child's code if it is a sphere or disk; the rest is its number.
const QUADRIC: u32 = 1 << 30;
/// Codes below this are nodes.
pub(crate) const LIMIT: usize = QUADRIC as usize;
/// The deepest stack that is traced; a tree that would need more is built anew by medians.
pub(crate) const DEEPEST: usize = 256;

/// A box is met if it is entered before it is left, to within this factor on the far side: three roundings a slab
/// [after Ize 2013], seven in a sheared corner and eight in `t`, each of 2^-24, with room to spare.
const fn far_side<S: Safeguards>() -> f32 {
    if S::PADDING { 1.0 + 1.0 / (1u64 << 18) as f32 } else { 1.0 }
}

/// A node with up to eight children; children left over have empty boxes.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
pub(crate) struct Node8 {
    /// Per axis the children's lower and upper bounds.
    pub(crate) bounds: [[Eight; 2]; 3],
    pub(crate) children: [u32; WIDTH],
}

impl Node8 {
    pub(crate) const EMPTY: Self =
        Self { bounds: [[Eight([f32::INFINITY; WIDTH]), Eight([f32::NEG_INFINITY; WIDTH])]; 3], children: [0; WIDTH] };

    /// Where the ray enters and leaves the children's slabs along an axis; `near` is the bound that it meets first.
    #[inline(always)]
    fn slab<L: Lanes>(&self, token: L::Token, frame: &Frame, axis: usize, near: usize) -> [L; 2] {
        let bounds = &self.bounds[axis];
        let (origin, inverse) = (L::splat(token, frame.origin[axis & 3]), L::splat(token, frame.inverse[axis & 3]));
        [
            (L::load(token, &bounds[near & 1]) - origin) * inverse,
            (L::load(token, &bounds[near & 1 ^ 1]) - origin) * inverse,
        ]
    }
}

/// What a child is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Child {
    Node(u32),
    Triangles(u32),
    Quadric(u32),
    /// In a tree over boxes: the number of one.
    Box(u32),
}

impl Child {
    pub(crate) fn code(self) -> u32 {
        match self {
            Self::Node(number) => number,
            Self::Triangles(number) => number | TRIANGLES,
            Self::Quadric(number) | Self::Box(number) => number | QUADRIC,
        }
    }
}

/// Shape and primitive of the triangles of a leaf.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Keys {
    pub(crate) shapes: Words,
    pub(crate) primitives: Words,
}

impl Keys {
    pub(crate) fn new(keys: [u64; WIDTH]) -> Self {
        Self { shapes: Words(keys.map(|key| (key >> 32) as u32)), primitives: Words(keys.map(|key| key as u32)) }
    }

    #[inline(always)]
    fn key(&self, lane: usize) -> u64 {
        key(self.shapes.0[lane], self.primitives.0[lane])
    }

    /// The lanes with this key.
    #[inline(always)]
    pub(crate) fn equal<L: Lanes>(&self, token: L::Token, key: u64) -> u32 {
        L::equal(token, &self.shapes, (key >> 32) as u32) & L::equal(token, &self.primitives, key as u32)
    }
}

/// Shape and primitive number in one, ordered as ties are decided.
#[inline(always)]
pub(crate) fn key(shape: u32, primitive: u32) -> u64 {
    u64::from(shape) << 32 | u64::from(primitive)
}

/// The tree, its leaves and their numbers.
#[derive(Clone, Debug, Default)]
pub(crate) struct Tree {
    pub(crate) nodes: Vec<Node8>,
    pub(crate) triangles: Vec<Triangles8>,
    /// The same at time 1; none where no vertex moves.
    pub(crate) moved: Vec<Triangles8>,
    pub(crate) triangle_keys: Vec<Keys>,
    pub(crate) quadrics: Vec<Quadric>,
    pub(crate) quadric_keys: Vec<u64>,
    /// Most entries that the stack can hold at once.
    pub(crate) stack: usize,
    pub(crate) way: Way,
}

/// How a tree is walked: one question, so that a scene without instances pays nothing for those that others have.
#[derive(Clone, Debug)]
pub(crate) enum Way {
    /// In the widest vectors.
    #[cfg(target_arch = "x86_64")]
    Whole(pulp::x86::V3),
    /// In pairs of vectors.
    Pair,
    /// To triangles that move.
    Moving(Vectors),
    /// And after it, what stands in the scene as instances.
    Placed(Box<Placed>),
}

/// Instances, and the vectors to walk the tree in.
#[derive(Clone, Debug)]
pub(crate) struct Placed {
    pub(crate) placements: Placements,
    vectors: Vectors,
    /// Whether the tree's own triangles move.
    moving: bool,
}

impl Default for Way {
    fn default() -> Self {
        match Vectors::default() {
            #[cfg(target_arch = "x86_64")]
            Vectors::Whole(v3) => Self::Whole(v3),
            Vectors::Pair => Self::Pair,
        }
    }
}

impl Way {
    pub(crate) fn placed(placements: Placements, moving: bool) -> Self {
        Self::Placed(Box::new(Placed { placements, vectors: Vectors::default(), moving }))
    }

    pub(crate) fn moving() -> Self {
        Self::Moving(Vectors::default())
    }
}

/// A walk through a tree, compiled for each kind of vectors that may be there at run time.
struct Walk<'a, S, L: Lanes, V, const ANY: bool> {
    token: L::Token,
    tree: &'a Tree,
    frame: &'a Frame,
    best: &'a mut Best,
    leaves: V,
    safeguards: PhantomData<S>,
}

impl<S: Safeguards, L: Lanes, V: Leaves, const ANY: bool> NullaryFnOnce for Walk<'_, S, L, V, ANY> {
    type Output = bool;

    #[inline(always)]
    fn call(self) -> bool {
        let Self { token, tree, frame, best, mut leaves, .. } = self;
        match tree.stack {
            0..=24 => tree.walk::<S, L, ANY, 24, _>(token, frame, best, &mut leaves),
            25..=64 => tree.walk::<S, L, ANY, 64, _>(token, frame, best, &mut leaves),
            _ => tree.walk::<S, L, ANY, DEEPEST, _>(token, frame, best, &mut leaves),
        }
    }
}

/// What a walk does at a leaf: offers hits to the best so far; with `ANY` it tells whether there was one.
trait Leaves {
    fn test<S: Safeguards, L: Lanes, const ANY: bool>(
        &mut self,
        tree: &Tree,
        token: L::Token,
        code: u32,
        frame: &Frame,
        best: &mut Best,
    ) -> bool;
}

/// Leaves are triangles, spheres and disks; with `MOVING`, triangles stand where they are at a time in `[0, 1]`.
struct Primitives<const MOVING: bool> {
    time: f32,
}

impl<const MOVING: bool> Leaves for Primitives<MOVING> {
    #[inline(always)]
    fn test<S: Safeguards, L: Lanes, const ANY: bool>(
        &mut self,
        tree: &Tree,
        token: L::Token,
        code: u32,
        frame: &Frame,
        best: &mut Best,
    ) -> bool {
        if code & TRIANGLES == 0 {
            return tree.test_quadric::<S, ANY>((code & !QUADRIC) as usize, frame, best);
        }
        let block = (code & !TRIANGLES) as usize;
        let triangles = &tree.triangles[block];
        if MOVING {
            let now = triangles.toward(&tree.moved[block], self.time);
            return tree.test_triangles::<S, L, ANY>(token, &now, block, frame, best);
        }
        tree.test_triangles::<S, L, ANY>(token, triangles, block, frame, best)
    }
}

/// Where nothing moves, no time is looked at.
const STILL: Primitives<false> = Primitives { time: 0.0 };

/// Leaves are boxes, and the function knows what is in them.
struct Boxes<F>(F);

impl<F: FnMut(u32, &mut Best) -> bool> Leaves for Boxes<F> {
    #[inline(always)]
    fn test<S: Safeguards, L: Lanes, const ANY: bool>(
        &mut self,
        _: &Tree,
        _: L::Token,
        code: u32,
        _: &Frame,
        best: &mut Best,
    ) -> bool {
        (self.0)(code & !QUADRIC, best)
    }
}

/// The best hit so far.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Best {
    pub(crate) t: f32,
    pub(crate) key: u64,
    pub(crate) weights: [f32; 2],
    pub(crate) found: bool,
}

impl Best {
    pub(crate) fn new(tmax: f32) -> Self {
        // No key is below 0, so that a tie with tmax never wins.
        Self { t: tmax, key: 0, weights: [0.0; 2], found: false }
    }

    #[inline(always)]
    pub(crate) fn offer<S: Safeguards>(&mut self, t: f32, key: u64, weights: [f32; 2]) {
        if t < self.t || (S::TIES && t == self.t && key < self.key) {
            *self = Self { t, key, weights, found: true };
        }
    }
}

/// A child put aside, and where the ray enters it.
type Aside = (f32, u32);

impl Tree {
    #[inline(always)]
    pub(crate) fn closest<S: Safeguards>(&self, frame: &Frame, time: f32, best: &mut Best) {
        self.dispatch::<S, false>(frame, time, best);
    }

    #[inline(always)]
    pub(crate) fn occluded<S: Safeguards>(&self, frame: &Frame, time: f32) -> bool {
        self.dispatch::<S, true>(frame, time, &mut Best::new(frame.ray.tmax))
    }

    // Inlined at every call it takes seconds to compile; see `Geometry::closest_at`.
    #[cfg_attr(not(debug_assertions), inline(always))]
    #[cfg_attr(debug_assertions, inline(never))]
    fn dispatch<S: Safeguards, const ANY: bool>(&self, frame: &Frame, time: f32, best: &mut Best) -> bool {
        match &self.way {
            #[cfg(target_arch = "x86_64")]
            &Way::Whole(v3) => v3.vectorize(self.still::<S, Whole, ANY>(v3, frame, best)),
            Way::Pair => self.still::<S, Pair, ANY>((), frame, best).call(),
            &Way::Moving(vectors) => self.dispatch_moving::<ANY>(vectors, frame, time, best),
            Way::Placed(placed) => self.dispatch_placed::<ANY>(placed, frame, time, best),
        }
    }

    /// A walk to triangles that do not move.
    #[inline(always)]
    fn still<'a, S: Safeguards, L: Lanes, const ANY: bool>(
        &'a self,
        token: L::Token,
        frame: &'a Frame,
        best: &'a mut Best,
    ) -> Walk<'a, S, L, Primitives<false>, ANY> {
        Walk { token, tree: self, frame, best, leaves: STILL, safeguards: PhantomData }
    }

    #[inline(never)]
    fn dispatch_moving<const ANY: bool>(&self, vectors: Vectors, frame: &Frame, time: f32, best: &mut Best) -> bool {
        let leaves = Primitives::<true> { time: time.clamp(0.0, 1.0) };
        let (tree, safeguards) = (self, PhantomData::<All>);
        match vectors {
            #[cfg(target_arch = "x86_64")]
            Vectors::Whole(v3) => {
                v3.vectorize(Walk::<_, Whole, _, ANY> { token: v3, tree, frame, best, leaves, safeguards })
            }
            Vectors::Pair => Walk::<_, Pair, _, ANY> { token: (), tree, frame, best, leaves, safeguards }.call(),
        }
    }

    #[inline(never)]
    fn dispatch_placed<const ANY: bool>(&self, placed: &Placed, frame: &Frame, time: f32, best: &mut Best) -> bool {
        let met = match placed.vectors {
            vectors if placed.moving => self.dispatch_moving::<ANY>(vectors, frame, time, best),
            #[cfg(target_arch = "x86_64")]
            Vectors::Whole(v3) => v3.vectorize(self.still::<All, Whole, ANY>(v3, frame, best)),
            Vectors::Pair => self.still::<All, Pair, ANY>((), frame, best).call(),
        };
        if ANY {
            return met || placed.placements.occluded(frame, time);
        }
        placed.placements.closest(frame, time, best);
        false
    }

    /// Walks a tree over boxes: `visit` is given the numbers of those that are met, the nearest first, and the best so
    /// far; with `ANY` the walk ends when it returns `true`.
    pub(crate) fn visit<const ANY: bool>(
        &self,
        frame: &Frame,
        best: &mut Best,
        visit: &mut dyn FnMut(u32, &mut Best) -> bool,
    ) -> bool {
        match self.stack {
            0..=24 => self.walk::<All, Pair, ANY, 24, _>((), frame, best, &mut Boxes(visit)),
            _ => self.walk::<All, Pair, ANY, DEEPEST, _>((), frame, best, &mut Boxes(visit)),
        }
    }

    /// Walks the tree from near to far. With `ANY` it returns `true` at the first hit, else it leaves the closest in
    /// `best`. `STACK` is at least `self.stack`.
    #[inline(always)]
    fn walk<S: Safeguards, L: Lanes, const ANY: bool, const STACK: usize, V: Leaves>(
        &self,
        token: L::Token,
        frame: &Frame,
        best: &mut Best,
        leaves: &mut V,
    ) -> bool {
        if self.nodes.is_empty() {
            return false;
        }
        let mut stack: [Aside; STACK] = [(0.0, 0); STACK];
        let mut height = 0;
        let mut code = 0;
        loop {
            let met = if code < QUADRIC {
                self.enter::<S, L, ANY, STACK>(token, code, frame, best.t, &mut stack, &mut height)
            } else {
                if leaves.test::<S, L, ANY>(self, token, code, frame, best) {
                    return true;
                }
                None
            };
            code = match met {
                Some(child) => child,
                None => loop {
                    if height == 0 {
                        return false;
                    }
                    height -= 1;
                    let (entry, child) = stack[height];
                    if ANY || entry <= best.t * far_side::<S>() {
                        break child;
                    }
                },
            }
        }
    }

    /// Tests a node's children: the nearest one met, the others go on the stack, the farthest deepest (with `ANY` as
    /// they come).
    #[inline(always)]
    fn enter<S: Safeguards, L: Lanes, const ANY: bool, const STACK: usize>(
        &self,
        token: L::Token,
        number: u32,
        frame: &Frame,
        limit: f32,
        stack: &mut [Aside; STACK],
        height: &mut usize,
    ) -> Option<u32> {
        let node = &self.nodes[number as usize];
        let [x, y, z] = frame.near;
        let [x, y, z] = [
            node.slab::<L>(token, frame, 0, x),
            node.slab::<L>(token, frame, 1, y),
            node.slab::<L>(token, frame, 2, z),
        ];
        let entry = x[0].max(y[0]).max(z[0].max(L::splat(token, frame.ray.tmin)));
        let exit = x[1].min(y[1]).min(z[1].min(L::splat(token, limit)));
        let mut met = entry.at_most(exit * L::splat(token, far_side::<S>()));
        if met == 0 {
            return None;
        }
        let first = lowest(met);
        met &= met - 1;
        if met == 0 {
            return Some(node.children[first]);
        }
        if ANY {
            // Any hit will do, so sorting is not worth its time.
            while met != 0 {
                stack[*height] = (0.0, node.children[lowest(met)]);
                met &= met - 1;
                *height += 1;
            }
            return Some(node.children[first]);
        }
        let entry = entry.to_array();
        let aside = |lane: usize| (entry[lane], node.children[lane]);
        let mut near = aside(first);
        let base = *height;
        while met != 0 {
            let mut next = aside(lowest(met));
            met &= met - 1;
            if next.0 < near.0 {
                std::mem::swap(&mut next, &mut near);
            }
            // Insertion among this node's own, nearest on top.
            let mut place = *height;
            while place > base && stack[place - 1].0 < next.0 {
                stack[place] = stack[place - 1];
                place -= 1;
            }
            stack[place] = next;
            *height += 1;
        }
        Some(near.1)
    }

    #[inline(always)]
    fn test_triangles<S: Safeguards, L: Lanes, const ANY: bool>(
        &self,
        token: L::Token,
        triangles: &Triangles8,
        block: usize,
        frame: &Frame,
        best: &mut Best,
    ) -> bool {
        let keys = &self.triangle_keys[block];
        let Some(hits) = triangles.intersect::<S, L>(token, frame, best.t, keys) else { return false };
        if ANY {
            return true;
        }
        let mut mask = hits.mask;
        while mask != 0 {
            let lane = lowest(mask);
            mask &= mask - 1;
            best.offer::<S>(hits.t[lane], keys.key(lane), hits.weights.map(|weights| weights[lane]));
        }
        false
    }

    #[inline(never)]
    fn test_quadric<S: Safeguards, const ANY: bool>(&self, number: usize, frame: &Frame, best: &mut Best) -> bool {
        let Some(t) = self.quadrics[number].intersect(&frame.ray) else { return false };
        if !ANY {
            best.offer::<S>(t, self.quadric_keys[number], [0.0; 2]);
        }
        ANY
    }

    pub(crate) fn memory_bytes(&self) -> usize {
        size_of_val(&*self.nodes)
            + size_of_val(&*self.triangles)
            + size_of_val(&*self.moved)
            + size_of_val(&*self.triangle_keys)
            + size_of_val(&*self.quadrics)
            + size_of_val(&*self.quadric_keys)
    }
}
