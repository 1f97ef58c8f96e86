//! The tree that rays walk, and the walk.

use crate::frame::Frame;
use crate::shape::Quadric;
use crate::triangle::Triangles4;
use glam::Vec4;
use pulp::Arch;

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
const FAR_SIDE: f32 = 1.0 + 1.0 / (1u64 << 18) as f32;

/// A node with up to four children; children left over have empty boxes.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
pub(crate) struct Node4 {
    /// Per axis the children's lower and upper bounds.
    pub(crate) bounds: [[Vec4; 2]; 3],
    pub(crate) children: [u32; 4],
}

impl Node4 {
    pub(crate) const EMPTY: Self =
        Self { bounds: [[Vec4::splat(f32::INFINITY), Vec4::splat(f32::NEG_INFINITY)]; 3], children: [0; 4] };
}

/// What a child is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Child {
    Node(u32),
    Triangles(u32),
    Quadric(u32),
}

impl Child {
    pub(crate) fn code(self) -> u32 {
        match self {
            Self::Node(number) => number,
            Self::Triangles(number) => number | TRIANGLES,
            Self::Quadric(number) => number | QUADRIC,
        }
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
    pub(crate) nodes: Vec<Node4>,
    pub(crate) triangles: Vec<Triangles4>,
    pub(crate) triangle_keys: Vec<[u64; 4]>,
    pub(crate) quadrics: Vec<Quadric>,
    pub(crate) quadric_keys: Vec<u64>,
    /// Most entries that the stack can hold at once.
    pub(crate) stack: usize,
    /// What this machine's processor can do, asked once.
    pub(crate) arch: Arch,
}

/// A walk through a tree, compiled for each set of vector instructions that may be there at run time.
struct Walk<'a, const ANY: bool> {
    tree: &'a Tree,
    frame: &'a Frame,
    best: &'a mut Best,
}

impl<const ANY: bool> pulp::NullaryFnOnce for Walk<'_, ANY> {
    type Output = bool;

    #[inline(always)]
    fn call(self) -> bool {
        let Self { tree, frame, best } = self;
        match tree.stack {
            0..=12 => tree.walk::<ANY, 12>(frame, best),
            13..=64 => tree.walk::<ANY, 64>(frame, best),
            _ => tree.walk::<ANY, DEEPEST>(frame, best),
        }
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
    fn offer(&mut self, t: f32, key: u64, weights: [f32; 2]) {
        if t < self.t || (t == self.t && key < self.key) {
            *self = Self { t, key, weights, found: true };
        }
    }
}

/// A child put aside, and where the ray enters it.
type Aside = (f32, u32);

impl Tree {
    pub(crate) fn closest(&self, frame: &Frame, best: &mut Best) {
        self.arch.dispatch(Walk::<false> { tree: self, frame, best });
    }

    pub(crate) fn occluded(&self, frame: &Frame) -> bool {
        let mut best = Best::new(frame.ray.tmax);
        self.arch.dispatch(Walk::<true> { tree: self, frame, best: &mut best })
    }

    /// Walks the tree from near to far. With `ANY` it returns `true` at the first hit, else it leaves the closest in
    /// `best`. `STACK` is at least `self.stack`.
    #[inline(always)]
    fn walk<const ANY: bool, const STACK: usize>(&self, frame: &Frame, best: &mut Best) -> bool {
        if self.nodes.is_empty() {
            return false;
        }
        let mut stack: [Aside; STACK] = [(0.0, 0); STACK];
        let mut height = 0;
        let mut code = 0;
        loop {
            let met = if code < QUADRIC {
                self.enter(code, frame, best.t, &mut stack, &mut height)
            } else {
                if self.test_leaf::<ANY>(code, frame, best) {
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

    /// Tests a node's children: the nearest one met, the others go on the stack, the farthest deepest.
    #[inline(always)]
    fn enter<const STACK: usize>(
        &self,
        number: u32,
        frame: &Frame,
        limit: f32,
        stack: &mut [Aside; STACK],
        height: &mut usize,
    ) -> Option<u32> {
        let node = &self.nodes[number as usize];
        let slab = |axis: usize, side: usize| (node.bounds[axis][side & 1] - frame.origin[axis]) * frame.inverse[axis];
        let [x, y, z] = frame.near;
        let entry = slab(0, x).max(slab(1, y)).max(slab(2, z).max(frame.tmin));
        let exit = slab(0, x ^ 1).min(slab(1, y ^ 1)).min(slab(2, z ^ 1).min(Vec4::splat(limit)));
        let mut met = entry.cmple(exit * FAR_SIDE).bitmask();
        if met == 0 {
            return None;
        }
        let first = met.trailing_zeros() as usize & 3;
        met &= met - 1;
        if met == 0 {
            return Some(node.children[first]);
        }
        let entry = entry.to_array();
        let second = met.trailing_zeros() as usize & 3;
        met &= met - 1;
        let aside = |lane: usize| (entry[lane], node.children[lane]);
        let (mut near, far) =
            if entry[second] < entry[first] { (aside(second), aside(first)) } else { (aside(first), aside(second)) };
        let base = *height;
        stack[base] = far;
        *height += 1;
        while met != 0 {
            let mut next = aside(met.trailing_zeros() as usize & 3);
            met &= met - 1;
            if next.0 < near.0 {
                std::mem::swap(&mut next, &mut near);
            }
            // Insertion into at most two entries, nearest on top.
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
    fn test_leaf<const ANY: bool>(&self, code: u32, frame: &Frame, best: &mut Best) -> bool {
        if code & TRIANGLES == 0 {
            return self.test_quadric::<ANY>((code & !QUADRIC) as usize, frame, best);
        }
        let block = (code & !TRIANGLES) as usize;
        let keys = &self.triangle_keys[block];
        let Some(lanes) = self.triangles[block].intersect(frame, best.t, keys) else { return false };
        if ANY {
            return true;
        }
        let mut mask = lanes.mask;
        while mask != 0 {
            let lane = mask.trailing_zeros() as usize & 3;
            mask &= mask - 1;
            best.offer(lanes.t[lane], keys[lane], lanes.weights.map(|weights| weights[lane]));
        }
        false
    }

    #[inline(never)]
    fn test_quadric<const ANY: bool>(&self, number: usize, frame: &Frame, best: &mut Best) -> bool {
        let Some(t) = self.quadrics[number].intersect(&frame.ray) else { return false };
        if !ANY {
            best.offer(t, self.quadric_keys[number], [0.0; 2]);
        }
        ANY
    }

    pub(crate) fn memory_bytes(&self) -> usize {
        size_of_val(&*self.nodes)
            + size_of_val(&*self.triangles)
            + size_of_val(&*self.triangle_keys)
            + size_of_val(&*self.quadrics)
            + size_of_val(&*self.quadric_keys)
    }
}
