//! The traversal of rays through the bounding volume hierarchy.

use crate::bvh::{Bvh, DEEPEST, Node8, QUADRIC, TRIANGLES};
use crate::instance::Placements;
#[cfg(target_arch = "x86_64")]
use crate::lanes::Whole;
use crate::lanes::{Lanes, Pair, Vectors};
use crate::leaf::Leaf;
use crate::ray::PreparedRay;
use crate::triangle::lowest;
use pulp::NullaryFnOnce;

/// The factor by which a box's exit distance is multiplied before it is compared with the entry distance. It
/// allows for three roundings per slab [after Ize 2013], seven in a sheared corner and eight in `t`, each of 2^-24,
/// and some slack.
const FAR_SIDE: f32 = 1.0 + 1.0 / (1u64 << 18) as f32;

impl Node8 {
    /// Returns the ray parameters at which the ray enters and leaves the children's slabs along an axis. `near` is the side
    /// that the ray crosses first.
    #[inline(always)]
    fn slab<L: Lanes>(&self, token: L::Token, prepared: &PreparedRay, axis: usize, near: usize) -> [L; 2] {
        let bounds = &self.bounds[axis];
        let (origin, inverse) =
            (L::splat(token, prepared.origin[axis & 3]), L::splat(token, prepared.inverse[axis & 3]));
        [
            (L::load(token, &bounds[near & 1].0) - origin) * inverse,
            (L::load(token, &bounds[near & 1 ^ 1].0) - origin) * inverse,
        ]
    }
}

/// The kind of traversal for a tree. A single branch selects it, so scenes without instances do not pay for them.
#[derive(Clone, Debug)]
pub(crate) enum WalkKind {
    /// Traversal of triangles at rest, with AVX2 vectors of eight.
    #[cfg(target_arch = "x86_64")]
    Whole(pulp::x86::V3),
    /// Traversal of triangles at rest, with pairs of four-wide vectors.
    Pair,
    /// Traversal of triangles with moving vertices.
    Moving(Vectors),
    /// Traversal of the base shapes, then of the instances.
    Placed(Box<PlacedTree>),
}

/// The instances of a scene, and the vectors for the traversal of the base shapes.
#[derive(Clone, Debug)]
pub(crate) struct PlacedTree {
    pub(crate) placements: Placements,
    vectors: Vectors,
    /// True if triangles of the base shapes have moving vertices.
    moving: bool,
}

impl WalkKind {
    pub(crate) fn placed(placements: Placements, moving: bool) -> Self {
        Self::Placed(Box::new(PlacedTree { placements, vectors: Vectors::default(), moving }))
    }
}

/// The arguments of a traversal, which is compiled for each kind of vectors. With `ANY`, the traversal ends at the first hit
/// found.
struct Walk<'a, L: Lanes, V, const ANY: bool> {
    token: L::Token,
    bvh: &'a Bvh,
    prepared: &'a PreparedRay,
    best: &'a mut Best,
    leaves: V,
}

impl<L: Lanes, V: Leaves, const ANY: bool> NullaryFnOnce for Walk<'_, L, V, ANY> {
    type Output = bool;

    #[inline(always)]
    fn call(self) -> bool {
        let Self { token, bvh, prepared, best, mut leaves } = self;
        // Each ray sets the whole stack to zero.
        match bvh.stack {
            0..=24 => bvh.walk::<L, ANY, 24, _>(token, prepared, best, &mut leaves),
            25..=64 => bvh.walk::<L, ANY, 64, _>(token, prepared, best, &mut leaves),
            65..=96 => bvh.walk::<L, ANY, 96, _>(token, prepared, best, &mut leaves),
            _ => bvh.walk::<L, ANY, DEEPEST, _>(token, prepared, best, &mut leaves),
        }
    }
}

/// The intersection test at a leaf, which passes hits to `best`. With `ANY`, it returns true if something is hit.
trait Leaves {
    fn test<L: Lanes, const ANY: bool>(
        &mut self,
        view: &View<'_>,
        token: L::Token,
        code: u32,
        prepared: &PreparedRay,
        best: &mut Best,
    ) -> bool;
}

/// The leaf test for triangles, spheres and disks. With `MOVING`, triangles are interpolated at `time` in `[0, 1]`.
struct Primitives<const MOVING: bool> {
    time: f32,
}

impl<const MOVING: bool> Leaves for Primitives<MOVING> {
    #[inline(always)]
    fn test<L: Lanes, const ANY: bool>(
        &mut self,
        view: &View<'_>,
        token: L::Token,
        code: u32,
        prepared: &PreparedRay,
        best: &mut Best,
    ) -> bool {
        if code & TRIANGLES == 0 {
            return view.bvh.test_quadric::<ANY>((code & !QUADRIC) as usize, prepared, best);
        }
        let leaf = Leaf::at(view.leaves, code);
        if MOVING {
            let now = leaf.toward(&Leaf::at(&view.bvh.moved, code), self.time);
            return test_triangles::<L, ANY>(token, &leaf.with(&now), prepared, best);
        }
        test_triangles::<L, ANY>(token, &leaf, prepared, best)
    }
}

/// The leaf test for triangles at rest, which ignores time.
const STILL: Primitives<false> = Primitives { time: 0.0 };

/// The leaf test for boxes of instances. The function receives a box's index and tests the contents of the box.
struct Boxes<F>(F);

impl<F: FnMut(u32, &mut Best) -> bool> Leaves for Boxes<F> {
    #[inline(always)]
    fn test<L: Lanes, const ANY: bool>(
        &mut self,
        _: &View<'_>,
        _: L::Token,
        code: u32,
        _: &PreparedRay,
        best: &mut Best,
    ) -> bool {
        (self.0)(code & !QUADRIC, best)
    }
}

/// The closest hit found so far; without a hit, `t` is the limit `tmax`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Best {
    pub(crate) t: f32,
    pub(crate) key: u64,
    pub(crate) weights: [f32; 2],
    pub(crate) found: bool,
}

impl Best {
    pub(crate) fn new(tmax: f32) -> Self {
        // The key 0 is the smallest, so a hit at exactly `tmax` never replaces it.
        Self { t: tmax, key: 0, weights: [0.0; 2], found: false }
    }

    #[inline(always)]
    pub(crate) fn offer(&mut self, t: f32, key: u64, weights: [f32; 2]) {
        if t < self.t || (t == self.t && key < self.key) {
            *self = Self { t, key, weights, found: true };
        }
    }
}

/// An entry of the stack: the ray parameter at which a child's box is entered, and the child's code.
type Aside = (f32, u32);

/// A bounding volume hierarchy and its kind of traversal.
#[derive(Clone, Debug)]
pub(crate) struct Tree {
    pub(crate) bvh: Bvh,
    pub(crate) way: WalkKind,
}

impl From<Bvh> for Tree {
    fn from(bvh: Bvh) -> Self {
        let way = match Vectors::default() {
            vectors if !bvh.moved.is_empty() => WalkKind::Moving(vectors),
            #[cfg(target_arch = "x86_64")]
            Vectors::Whole(v3) => WalkKind::Whole(v3),
            Vectors::Pair => WalkKind::Pair,
        };
        Self { bvh, way }
    }
}

impl Tree {
    #[inline(always)]
    pub(crate) fn closest(&self, prepared: &PreparedRay, time: f32, best: &mut Best) {
        self.dispatch::<false>(prepared, time, best);
    }

    #[inline(always)]
    pub(crate) fn occluded(&self, prepared: &PreparedRay, time: f32) -> bool {
        self.dispatch::<true>(prepared, time, &mut Best::new(prepared.ray.tmax))
    }

    // Inlining at every call would add seconds of compile time to debug builds; see `Geometry::closest_at`.
    #[cfg_attr(not(debug_assertions), inline(always))]
    #[cfg_attr(debug_assertions, inline(never))]
    fn dispatch<const ANY: bool>(&self, prepared: &PreparedRay, time: f32, best: &mut Best) -> bool {
        match &self.way {
            #[cfg(target_arch = "x86_64")]
            &WalkKind::Whole(v3) => v3.vectorize(self.still::<Whole, ANY>(v3, prepared, best)),
            WalkKind::Pair => self.still::<Pair, ANY>((), prepared, best).call(),
            &WalkKind::Moving(vectors) => self.dispatch_moving::<ANY>(vectors, prepared, time, best),
            WalkKind::Placed(placed) => self.dispatch_placed::<ANY>(placed, prepared, time, best),
        }
    }

    /// Returns a call of the traversal for triangles at rest.
    #[inline(always)]
    fn still<'a, L: Lanes, const ANY: bool>(
        &'a self,
        token: L::Token,
        prepared: &'a PreparedRay,
        best: &'a mut Best,
    ) -> Walk<'a, L, Primitives<false>, ANY> {
        Walk { token, bvh: &self.bvh, prepared, best, leaves: STILL }
    }

    #[inline(never)]
    fn dispatch_moving<const ANY: bool>(
        &self,
        vectors: Vectors,
        prepared: &PreparedRay,
        time: f32,
        best: &mut Best,
    ) -> bool {
        let leaves = Primitives::<true> { time: time.clamp(0.0, 1.0) };
        let bvh = &self.bvh;
        match vectors {
            #[cfg(target_arch = "x86_64")]
            Vectors::Whole(v3) => v3.vectorize(Walk::<Whole, _, ANY> { token: v3, bvh, prepared, best, leaves }),
            Vectors::Pair => Walk::<Pair, _, ANY> { token: (), bvh, prepared, best, leaves }.call(),
        }
    }

    #[inline(never)]
    fn dispatch_placed<const ANY: bool>(
        &self,
        placed: &PlacedTree,
        prepared: &PreparedRay,
        time: f32,
        best: &mut Best,
    ) -> bool {
        let met = match placed.vectors {
            vectors if placed.moving => self.dispatch_moving::<ANY>(vectors, prepared, time, best),
            #[cfg(target_arch = "x86_64")]
            Vectors::Whole(v3) => v3.vectorize(self.still::<Whole, ANY>(v3, prepared, best)),
            Vectors::Pair => self.still::<Pair, ANY>((), prepared, best).call(),
        };
        if ANY {
            return met || placed.placements.occluded(prepared, time);
        }
        placed.placements.closest(prepared, time, best);
        false
    }
}

impl Bvh {
    /// Traverses a tree over boxes and calls `visit` with the index of each box that the ray hits, nearest first, and the best
    /// hit so far. With `ANY`, the traversal ends when `visit` returns true.
    pub(crate) fn visit<const ANY: bool>(
        &self,
        prepared: &PreparedRay,
        best: &mut Best,
        visit: &mut dyn FnMut(u32, &mut Best) -> bool,
    ) -> bool {
        match self.stack {
            0..=24 => self.walk::<Pair, ANY, 24, _>((), prepared, best, &mut Boxes(visit)),
            _ => self.walk::<Pair, ANY, DEEPEST, _>((), prepared, best, &mut Boxes(visit)),
        }
    }

    /// Traverses the tree from near to far. With `ANY`, returns true at the first hit found. Otherwise returns false and
    /// stores the closest hit in `best`. `STACK` must be at least `self.stack`.
    #[inline(always)]
    fn walk<L: Lanes, const ANY: bool, const STACK: usize, V: Leaves>(
        &self,
        token: L::Token,
        prepared: &PreparedRay,
        best: &mut Best,
        leaves: &mut V,
    ) -> bool {
        let view = View { bvh: self, nodes: &self.nodes, leaves: &self.leaves };
        if view.nodes.is_empty() {
            return false;
        }
        let mut stack: [Aside; STACK] = [(0.0, 0); STACK];
        let mut height = 0;
        let mut code = 0;
        loop {
            let met = if code < QUADRIC {
                view.enter::<L, ANY, STACK>(token, code, prepared, best.t, &mut stack, &mut height)
            } else {
                if leaves.test::<L, ANY>(&view, token, code, prepared, best) {
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
                    if ANY || entry <= best.t * FAR_SIDE {
                        break child;
                    }
                },
            }
        }
    }

    #[inline(never)]
    fn test_quadric<const ANY: bool>(&self, number: usize, prepared: &PreparedRay, best: &mut Best) -> bool {
        let Some(t) = self.quadrics[number].intersect(&prepared.ray) else { return false };
        if !ANY {
            best.offer(t, self.quadric_keys[number], [0.0; 2]);
        }
        ANY
    }
}

/// The arrays of a tree, looked up once for each ray.
struct View<'a> {
    bvh: &'a Bvh,
    nodes: &'a [Node8],
    leaves: &'a [f32],
}

impl View<'_> {
    /// Tests a node's children and returns the code of the nearest child that the ray hits. The other children hit are pushed
    /// on the stack, farthest first. With `ANY`, they are not sorted.
    #[inline(always)]
    fn enter<L: Lanes, const ANY: bool, const STACK: usize>(
        &self,
        token: L::Token,
        number: u32,
        prepared: &PreparedRay,
        limit: f32,
        stack: &mut [Aside; STACK],
        height: &mut usize,
    ) -> Option<u32> {
        let node = &self.nodes[number as usize];
        let [x, y, z] = prepared.near;
        let [x, y, z] = [
            node.slab::<L>(token, prepared, 0, x),
            node.slab::<L>(token, prepared, 1, y),
            node.slab::<L>(token, prepared, 2, z),
        ];
        let entry = x[0].max(y[0]).max(z[0].max(L::splat(token, prepared.ray.tmin)));
        let exit = x[1].min(y[1]).min(z[1].min(L::splat(token, limit)));
        let mut met = entry.at_most(exit * L::splat(token, FAR_SIDE));
        if met == 0 {
            return None;
        }
        let first = lowest(met);
        met &= met - 1;
        if met == 0 {
            return Some(node.children.0[first]);
        }
        if ANY {
            // Any hit ends the traversal, so sorting does not pay.
            while met != 0 {
                stack[*height] = (0.0, node.children.0[lowest(met)]);
                met &= met - 1;
                *height += 1;
            }
            return Some(node.children.0[first]);
        }
        let entry = entry.to_array();
        let aside = |lane: usize| (entry[lane], node.children.0[lane]);
        let mut near = aside(first);
        let base = *height;
        while met != 0 {
            let mut next = aside(lowest(met));
            met &= met - 1;
            if next.0 < near.0 {
                std::mem::swap(&mut next, &mut near);
            }
            // Insertion sort among this node's children, nearest on top.
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
}

/// Tests a ray against a leaf's triangles and passes the hits to `best`. With `ANY`, returns true if there is a hit.
#[inline(always)]
fn test_triangles<L: Lanes, const ANY: bool>(
    token: L::Token,
    leaf: &Leaf<'_>,
    prepared: &PreparedRay,
    best: &mut Best,
) -> bool {
    let Some(hits) = leaf.intersect::<L>(token, prepared, best.t) else { return false };
    if ANY {
        return true;
    }
    let mut mask = hits.mask;
    while mask != 0 {
        let lane = lowest(mask);
        mask &= mask - 1;
        best.offer(hits.t[lane], leaf.key(lane), hits.weights.map(|weights| weights[lane]));
    }
    false
}
