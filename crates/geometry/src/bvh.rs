//! The memory layout of the bounding volume hierarchy: eight-wide nodes, leaves, and their keys.

use crate::huge_pages::Pages;
use crate::lanes::{Eight, WIDTH, Words};
use crate::shape::Quadric;
use bytemuck::{Pod, Zeroable};
use glam::Vec3;

/// The bit that marks a child's code as a leaf of triangles. The other bits encode the leaf's position (`leaf::place`).
pub(crate) const TRIANGLES: u32 = 1 << 31;
/// The bit that marks a child's code as a sphere, a disk or the box of an instance. The other bits are its index.
pub(crate) const QUADRIC: u32 = 1 << 30;
/// The upper limit of node indices. A child's code below it is the index of a node.
pub(crate) const LIMIT: usize = QUADRIC as usize;

/// The largest allowed number of entries on the traversal stack. A tree that needs more is rebuilt by median splits.
pub(crate) const DEEPEST: usize = 256;

/// A node with up to eight children. Unused children have empty boxes, which no ray hits.
///
/// Its 224 bytes touch four cache lines, wherever an array of nodes starts.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C, align(32))]
pub(crate) struct Node8 {
    /// The children's lower and upper bounds, per axis.
    pub(crate) bounds: [[Eight; 2]; 3],
    pub(crate) children: Words,
}

impl Node8 {
    pub(crate) const EMPTY: Self = Self {
        bounds: [[Eight([f32::INFINITY; WIDTH]), Eight([f32::NEG_INFINITY; WIDTH])]; 3],
        children: Words([0; WIDTH]),
    };

    pub(crate) fn put(&mut self, lane: usize, child: Child, [low, high]: [Vec3; 2]) {
        self.children.0[lane] = child.code();
        for axis in 0..3 {
            self.bounds[axis][0].0[lane] = low[axis];
            self.bounds[axis][1].0[lane] = high[axis];
        }
    }

    /// Returns the bounding box of all children.
    pub(crate) fn around(&self) -> [Vec3; 2] {
        let least = |side: usize| self.bounds.map(|axis| axis[side].0.into_iter().fold(f32::INFINITY, f32::min));
        let most = |side: usize| self.bounds.map(|axis| axis[side].0.into_iter().fold(f32::NEG_INFINITY, f32::max));
        [Vec3::from_array(least(0)), Vec3::from_array(most(1))]
    }

    /// Adds one offset each to the indices of child nodes, triangle leaves and quadrics.
    pub(crate) fn shift(&mut self, [nodes, leaves, quadrics]: [u32; 3]) {
        for code in &mut self.children.0 {
            *code += match *code {
                // The root is nobody's child, so this lane is unused.
                0 => 0,
                TRIANGLES.. => leaves,
                QUADRIC.. => quadrics,
                _ => nodes,
            };
        }
    }
}

/// A child of a node: the index of a node or quadric, or the position of a triangle leaf.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Child {
    Node(u32),
    Triangles(u32),
    /// A sphere, a disk or, in the tree over instances, the box of an instance.
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

/// Returns the shape and primitive number as one integer. Among hits at the same distance, the one with the smallest key is
/// chosen.
#[inline(always)]
pub(crate) fn key(shape: u32, primitive: u32) -> u64 {
    u64::from(shape) << 32 | u64::from(primitive)
}

/// The bounding volume hierarchy: nodes, leaves, and the shape and primitive numbers in the leaves.
#[derive(Clone, Debug, Default)]
pub(crate) struct Bvh {
    pub(crate) nodes: Pages<Node8>,
    /// The leaves of triangles (see `leaf`), followed by `leaf::SPAN` zeros.
    pub(crate) leaves: Pages<f32>,
    /// The leaves with their triangles at time 1, like `leaves`; empty if no vertex moves.
    pub(crate) moved: Pages<f32>,
    pub(crate) quadrics: Vec<Quadric>,
    pub(crate) quadric_keys: Vec<u64>,
    /// The largest number of entries on the stack during traversal.
    pub(crate) stack: usize,
}

impl Bvh {
    pub(crate) fn memory_bytes(&self) -> usize {
        size_of_val(&*self.nodes)
            + size_of_val(&*self.leaves)
            + size_of_val(&*self.moved)
            + size_of_val(&*self.quadrics)
            + size_of_val(&*self.quadric_keys)
    }
}
