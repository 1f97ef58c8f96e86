//! The items of a bounding volume hierarchy, and their boxes: padded for rounding, and computed for eight triangles at once.

use crate::bvh::key;
use crate::huge_pages::Pages;
use crate::lanes::{Eight, Lanes, Vectorised, Vectors, WIDTH};
use crate::leaf::{self, FLIPPED, Triangles8};
use crate::shape::{Quadric, Shape};
use crate::{Error, Mesh, MovingMesh};
use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec3, Vec3A, Vec4};
use obvhs::aabb::Aabb;
use obvhs::bvh2::node::Bvh2Node;
use rayon::prelude::*;

/// The lower and the upper corner of an axis-aligned box.
pub(crate) type Bounds = [Vec3; 2];

/// The items of a bounding volume hierarchy: primitives of shapes, or boxes of instances. Boxes of primitives are
/// computed on demand, which is faster than fetching stored ones.
pub(super) struct Items<'a> {
    pub(super) shapes: &'a [Shape],
    /// The boxes of the instances; empty if the items are primitives of shapes.
    pub(super) boxes: &'a [Bounds],
    /// One key per item. For a primitive, the shape's number is in the upper 32 bits and the primitive's in the lower. For an
    /// instance, the key is its index.
    pub(super) keys: Vec<u64>,
    /// True if all items are triangles at rest.
    pub(super) still: bool,
}

/// An item of a bounding volume hierarchy. A triangle is given by its mesh; its index is in the item's key.
pub(super) enum Item<'a> {
    Triangle(&'a Mesh),
    Moving(&'a MovingMesh),
    Quadric(Quadric),
    /// The box of an instance.
    Box(Bounds),
}

impl<'a> Items<'a> {
    /// Collects the primitives that can be hit: triangles with an area, spheres and disks. Returns an error if there are too
    /// many.
    pub(super) fn of_shapes(shapes: &'a [Shape]) -> Result<Self, Error> {
        Error::too_many("shapes", shapes.len(), u32::MAX as usize)?;
        let count = shapes.iter().map(|shape| shape.mesh().map_or(1, |mesh| mesh.triangles().len())).sum();
        Error::too_many("primitives", count, leaf::LIMIT)?;
        let mut keys = Vec::with_capacity(count);
        for (number, shape) in (0..).zip(shapes) {
            let triangles = 0..shape.mesh().map_or(1, |mesh| mesh.triangles().len()) as u32;
            let is_flat = |n: u32| match shape {
                Shape::Mesh(mesh) => mesh.degenerate() > 0 && mesh.is_degenerate(n),
                Shape::Moving(mesh) => mesh.degenerate() > 0 && mesh.is_degenerate(n),
                Shape::Sphere(_) | Shape::Disk(_) => false,
            };
            keys.extend(triangles.filter(|&n| !is_flat(n)).map(|n| key(number, n)));
        }
        let still = shapes.iter().all(|shape| matches!(shape, Shape::Mesh(_)));
        Ok(Self { shapes, boxes: &[], keys, still })
    }

    /// Returns the item with an index, and its key.
    #[inline(always)]
    pub(super) fn item(&self, number: u32) -> (u64, Item<'a>) {
        let key = self.keys[number as usize];
        if !self.boxes.is_empty() {
            return (key, Item::Box(self.boxes[number as usize]));
        }
        let item = match &self.shapes[(key >> 32) as usize] {
            Shape::Mesh(mesh) => Item::Triangle(mesh),
            Shape::Moving(mesh) => Item::Moving(mesh),
            Shape::Sphere(sphere) => Item::Quadric(Quadric::Sphere(*sphere)),
            Shape::Disk(disk) => Item::Quadric(Quadric::Disk(*disk)),
        };
        (key, item)
    }

    /// Returns the box of the item with an index, padded for rounding.
    #[inline(always)]
    pub(super) fn bounds(&self, number: u32) -> Bounds {
        match self.item(number) {
            (key, Item::Triangle(mesh)) => padded(mesh.corners(key as u32)),
            (key, Item::Moving(mesh)) => union(padded(mesh.corners(key as u32, 0.0)), padded(mesh.ends_of(key as u32))),
            (_, Item::Quadric(quadric)) => padded_by_ulps(quadric.bounds()),
            (_, Item::Box(bounds)) => bounds,
        }
    }

    /// Returns `true` if all items are triangles.
    pub(super) fn are_triangles(&self) -> bool {
        self.boxes.is_empty() && self.shapes.iter().all(|shape| shape.mesh().is_some())
    }

    /// Returns the bounding box of all items, without padding for triangles at rest; `None` without items.
    pub(super) fn total(&self) -> Option<Bounds> {
        if self.keys.is_empty() {
            return None;
        }
        if self.still {
            return self.shapes.iter().filter_map(|shape| shape.mesh().map(|mesh| mesh.around)).reduce(union);
        }
        let items = (0..self.keys.len() as u32).into_par_iter().with_min_len(FEW);
        items.map(|number| self.bounds(number)).reduce_with(union)
    }

    /// Returns the boxes of all items, scaled to the unit cube. Areas then neither overflow nor underflow, and the tree does
    /// not depend on the scene's scale. Rounding and clamping affect only speed.
    pub(super) fn boxes(&self, bounds: Bounds) -> Pages<ItemBox> {
        let origin = bounds[0].as_dvec3();
        let scale = 1.0 / (bounds[1].as_dvec3() - origin).max_element().max(f64::MIN_POSITIVE);
        let (items, origin, vectors) = (self, origin.to_array(), Vectors::default());
        let mut boxes = Pages::zeroed(self.keys.len());
        boxes.par_chunks_mut(FEW).enumerate().for_each(|(chunk, boxes)| {
            vectors.run(Scaled { items, origin, scale, first: (chunk * FEW) as u32, boxes });
        });
        boxes
    }
}

/// The empty box.
pub(super) const NOTHING: Bounds = [Vec3::INFINITY, Vec3::NEG_INFINITY];
/// The smallest number of items for which another thread is worthwhile.
pub(super) const FEW: usize = 1 << 12;
/// The padding of a triangle's box, as a fraction of the triangle's extent. The f32 weights of a triangle seen nearly
/// edge-on (see `triangle::THIN`) can be off by 2^-17 per corner, and a corner can be two extents from the ray.
const GROWTH: f32 = 1.0 / (1u64 << 14) as f32;
/// The padding of every box, as a fraction of its largest coordinate, so that no slab is thinner than rounding. It is
/// three ulps, one of them for the rounding of the padding itself.
const ULPS: f32 = 3.0 / (1u64 << 23) as f32;
/// The padding of every box as an absolute length.
///
/// If a component of a ray's direction is nearly 0, the ray crosses a slab's plane at the distance to the plane times the
/// largest reciprocal, below 2^128. Triangles lie up to 2^71 away (twice `prepared_ray::FARTHEST`, in lengths of the shortest
/// direction, 2^-10). Underflow of a slope shears them by less than 2^-80.
const LEAST: f32 = 1.0 / (1u64 << 57) as f32;

/// Returns the bounding box of a triangle, padded for rounding.
#[inline(always)]
fn padded([a, b, c]: [Vec3; 3]) -> Bounds {
    let [low, high] = [a.min(b).min(c), a.max(b).max(c)];
    grow([low, high], (high - low).max_element() * GROWTH)
}

/// Rounds a box from f64 to f32 and pads it. The padding covers this rounding and the rounding of the f64 bounds, both within a
/// few ulps.
pub(super) fn padded_by_ulps(bounds: [DVec3; 2]) -> Bounds {
    let [low, high] = bounds.map(DVec3::as_vec3);
    grow([low, high], (high - low).max_element() * ULPS)
}

fn grow([low, high]: Bounds, by: f32) -> Bounds {
    let by = by + low.abs().max(high.abs()).max_element() * ULPS + LEAST;
    [low - by, high + by]
}

pub(crate) fn union(a: Bounds, b: Bounds) -> Bounds {
    [a[0].min(b[0]), a[1].max(b[1])]
}

/// The box of an item. The fourth word is the item's index, with bits flipped as in leaves. Coordinates are between 0 and 1.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C, align(32))]
pub(super) struct ItemBox {
    pub(super) low: [f32; 4],
    pub(super) high: [f32; 4],
}

impl ItemBox {
    #[inline(always)]
    pub(super) fn new([[x, y, z], [right, top, far]]: [[f32; 3]; 2], item: u32) -> Self {
        Self { low: [x, y, z, f32::from_bits(item ^ FLIPPED)], high: [right, top, far, 0.0] }
    }

    pub(super) fn item(&self) -> u32 {
        self.low[3].to_bits() ^ FLIPPED
    }

    #[inline(always)]
    pub(super) fn aabb(&self) -> Aabb {
        let corner = |words| Vec3A::from_vec4(Vec4::from_array(words));
        Aabb::new(corner(self.low), corner(self.high))
    }

    /// Returns twice the centre.
    #[inline(always)]
    pub(super) fn centre(&self) -> Vec3A {
        let Aabb { min, max } = self.aabb();
        min + max
    }

    /// Returns a leaf with only this item, whose position in the order is `first`.
    pub(super) fn leaf(&self, first: u32) -> Bvh2Node {
        Bvh2Node::new(self.aabb(), 1, first)
    }
}

/// Returns the boxes of eight triangles, per axis and side. Each is padded as in [`Items::bounds`].
// Written without closures, since compilers don't always use the vectors of the enclosing function in them.
#[inline(always)]
pub(super) fn boxes<L: Lanes>(token: L::Token, triangles: &Triangles8) -> [[Eight; 2]; 3] {
    let [x, y, z] = [triangles.bounds::<L>(token, 0), triangles.bounds::<L>(token, 1), triangles.bounds::<L>(token, 2)];
    let extent = (x[1] - x[0]).max(y[1] - y[0]).max(z[1] - z[0]);
    let reach = reach(x).max(reach(y)).max(reach(z));
    let by = extent * L::splat(token, GROWTH) + reach * L::splat(token, ULPS) + L::splat(token, LEAST);
    [sides([x[0] - by, x[1] + by]), sides([y[0] - by, y[1] + by]), sides([z[0] - by, z[1] + by])]
}

#[inline(always)]
fn sides<L: Lanes>([low, high]: [L; 2]) -> [Eight; 2] {
    [Eight(low.to_array()), Eight(high.to_array())]
}

/// Returns the larger magnitude of the two bounds.
#[inline(always)]
fn reach<L: Lanes>([low, high]: [L; 2]) -> L {
    low.abs().max(high.abs())
}

/// The computation of the scaled boxes of the items from `first` on, compiled for each kind of vectors.
struct Scaled<'a> {
    items: &'a Items<'a>,
    origin: [f64; 3],
    scale: f64,
    first: u32,
    boxes: &'a mut [ItemBox],
}

impl Vectorised for Scaled<'_> {
    #[inline(always)]
    fn run<L: Lanes>(self, token: L::Token) {
        for (first, boxes) in (self.first..).step_by(WIDTH).zip(self.boxes.chunks_mut(WIDTH)) {
            let mut bounds = self.items.boxes_from::<L>(token, first, boxes.len());
            for (axis, origin) in bounds.iter_mut().zip(self.origin) {
                for side in axis {
                    for value in &mut side.0 {
                        *value = (((f64::from(*value) - origin) * self.scale) as f32).clamp(0.0, 1.0);
                    }
                }
            }
            let [[x, right], [y, top], [z, far]] = &bounds;
            for (lane, it) in boxes.iter_mut().enumerate() {
                let low = [x.0[lane & 7], y.0[lane & 7], z.0[lane & 7]];
                let high = [right.0[lane & 7], top.0[lane & 7], far.0[lane & 7]];
                *it = ItemBox::new([low, high], first + lane as u32);
            }
        }
    }
}

impl Items<'_> {
    /// Returns the boxes of up to eight items from `first` on, per axis and side.
    #[inline(always)]
    fn boxes_from<L: Lanes>(&self, token: L::Token, first: u32, count: usize) -> [[Eight; 2]; 3] {
        let count = count.min(WIDTH);
        let from = first as usize;
        if self.still {
            let mut triangles = Triangles8::default();
            for (lane, &key) in self.keys[from..from + count].iter().enumerate() {
                if let Shape::Mesh(mesh) = &self.shapes[(key >> 32) as usize] {
                    triangles.put(lane, mesh.corners(key as u32));
                }
            }
            return boxes::<L>(token, &triangles);
        }
        let mut bounds = [[Eight::default(); 2]; 3];
        for lane in 0..count {
            let corners: Bounds = self.bounds(first + lane as u32);
            for (axis, sides) in bounds.iter_mut().enumerate() {
                sides[0].0[lane] = corners[0][axis];
                sides[1].0[lane] = corners[1][axis];
            }
        }
        bounds
    }
}
