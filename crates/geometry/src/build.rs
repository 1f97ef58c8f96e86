//! Construction of the bounding volume hierarchy: boxes of primitives, a binary tree, and its conversion to eight-wide nodes.

mod binary;
mod boxes;
mod leaves;
mod plane;
mod plans;
mod reinsertion;
mod wide;

use crate::lanes::WIDTH;
use crate::leaf;
use crate::pages::Pages;
use crate::shape::Quadric;
use crate::tree::{LIMIT, Node8, Tree, key};
use crate::{Error, Mesh, MovingMesh, Shape};
use binary::ItemBox;
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// The effort spent on building the bounding volume hierarchy. It affects speed only, not images.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Preset {
    /// The least effort: the fastest building and the slowest rays.
    Fastest,
    /// More effort than [`Fastest`](Self::Fastest), less than [`Fast`](Self::Fast).
    VeryFast,
    /// Effort suited to rendering one image.
    #[default]
    Fast,
    /// More effort than [`Fast`](Self::Fast), the default.
    Medium,
    /// More effort than [`Medium`](Self::Medium), for many images of one scene.
    Slow,
    /// The most effort: the slowest building and the fastest rays.
    VerySlow,
}

impl Preset {
    /// The part of all nodes for which a cheaper place is looked for: obvhs's presets of these names, but half as much for
    /// `VeryFast` and `Fast`.
    fn reinsertion(self) -> f32 {
        match self {
            Self::Fastest => 0.0,
            Self::VeryFast => 0.005,
            Self::Fast => 0.01,
            Self::Medium => 0.05,
            Self::Slow => 0.2,
            Self::VerySlow => 1.0,
        }
    }
}

/// The lower and the upper corner of an axis-aligned box.
pub(crate) type Bounds = [Vec3; 2];

/// The items of a bounding volume hierarchy: primitives of shapes, or boxes of instances. Boxes of primitives are
/// computed on demand, which is faster than fetching stored ones.
struct Items<'a> {
    shapes: &'a [Shape],
    /// The boxes of the instances; empty if the items are primitives of shapes.
    boxes: &'a [Bounds],
    /// One key per item: the shape's number in the upper and the primitive's in the lower 32 bits, or the index of an
    /// instance.
    keys: Vec<u64>,
    /// True if all items are triangles at rest.
    still: bool,
    /// True if boxes are padded for rounding. Only measurements set it to false (see `safeguards`).
    padded: bool,
}

/// An item of a bounding volume hierarchy. A triangle is given by its mesh; its index is in the item's key.
enum Item<'a> {
    Triangle(&'a Mesh),
    Moving(&'a MovingMesh),
    Quadric(Quadric),
    /// The box of an instance.
    Box(Bounds),
}

impl<'a> Items<'a> {
    /// Collects the primitives that can be hit: triangles with an area, spheres and disks. Fails if there are too
    /// many.
    fn of_shapes(shapes: &'a [Shape], padded: bool) -> Result<Self, Error> {
        too_many("shapes", shapes.len(), u32::MAX as usize)?;
        let count = shapes.iter().map(|shape| shape.mesh().map_or(1, |mesh| mesh.triangles().len())).sum();
        too_many("primitives", count, leaf::LIMIT)?;
        let mut keys = Vec::with_capacity(count);
        for (number, shape) in (0..).zip(shapes) {
            let triangles = 0..shape.mesh().map_or(1, |mesh| mesh.triangles().len()) as u32;
            let all = triangles.clone().map(|n| key(number, n));
            match shape {
                Shape::Mesh(mesh) if mesh.degenerate() > 0 => {
                    keys.extend(triangles.filter(|&n| !mesh.is_degenerate(n)).map(|n| key(number, n)));
                }
                Shape::Moving(mesh) if mesh.degenerate() > 0 => {
                    keys.extend(triangles.filter(|&n| !mesh.is_degenerate(n)).map(|n| key(number, n)));
                }
                Shape::Mesh(_) | Shape::Moving(_) | Shape::Sphere(_) | Shape::Disk(_) => keys.extend(all),
            }
        }
        let still = shapes.iter().all(|shape| matches!(shape, Shape::Mesh(_)));
        Ok(Self { shapes, boxes: &[], keys, still, padded })
    }

    /// Returns an item by its index, with its key.
    #[inline(always)]
    fn item(&self, number: u32) -> (u64, Item<'a>) {
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

    /// Returns the box of an item by its index, padded for rounding if `padded` is set.
    #[inline(always)]
    fn bounds(&self, number: u32) -> Bounds {
        match self.item(number) {
            (key, Item::Triangle(mesh)) => self.around(mesh.corners(key as u32)),
            (key, Item::Moving(mesh)) => {
                union(self.around(mesh.corners(key as u32, 0.0)), self.around(mesh.ends_of(key as u32)))
            }
            (_, Item::Quadric(quadric)) => self.around_quadric(&quadric),
            (_, Item::Box(bounds)) => bounds,
        }
    }

    #[inline(always)]
    fn around(&self, triangle: [Vec3; 3]) -> Bounds {
        let [low, high] = enclose(triangle);
        if self.padded { grow([low, high], (high - low).max_element() * GROWTH) } else { [low, high] }
    }

    fn around_quadric(&self, quadric: &Quadric) -> Bounds {
        let [low, high] = quadric.bounds().map(DVec3::as_vec3);
        // The padding covers the rounding to f32 and the rounding of the f64 bounds: both within a few ulps.
        if self.padded { grow([low, high], (high - low).max_element() * ULPS) } else { [low, high] }
    }

    /// Builds the tree over all items. Returns it with the box around all items, `None` if there are no items.
    fn tree(&self, preset: Preset) -> (Tree, Option<Bounds>) {
        let Some(bounds) = self.total() else { return (Tree::default(), None) };
        let mut boxes = self.boxes(bounds);
        let binary = binary::tree(&mut boxes, preset, self.are_triangles());
        let tree = wide::collapse(&binary, self, boxes)
            .or_else(|| {
                let mut boxes = self.boxes(bounds);
                wide::collapse(&binary::balanced(&mut boxes), self, boxes)
            })
            .unwrap_or_default();
        let around = tree.nodes.first().map(Node8::around);
        (tree, around)
    }

    /// Returns `true` if all items are triangles.
    fn are_triangles(&self) -> bool {
        self.boxes.is_empty() && self.shapes.iter().all(|shape| shape.mesh().is_some())
    }

    /// Returns a box around all items, unpadded for triangles at rest; `None` without items.
    fn total(&self) -> Option<Bounds> {
        if self.keys.is_empty() {
            return None;
        }
        if self.still {
            return self.shapes.iter().filter_map(|shape| shape.mesh().map(Mesh::around)).reduce(union);
        }
        let items = (0..self.keys.len() as u32).into_par_iter().with_min_len(FEW);
        items.map(|number| self.bounds(number)).reduce_with(union)
    }

    /// Returns the boxes of all items, scaled to the unit cube: areas then neither overflow nor vanish, and the tree does not
    /// depend on the scene's scale. Rounding and clamping affect only speed.
    fn boxes(&self, bounds: Bounds) -> Pages<ItemBox> {
        let origin = bounds[0].as_dvec3();
        let per_extent = 1.0 / (bounds[1].as_dvec3() - origin).max_element().max(f64::MIN_POSITIVE);
        boxes::scaled(self, origin.to_array(), per_extent)
    }
}

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

/// The empty box.
const NOTHING: Bounds = [Vec3::INFINITY, Vec3::NEG_INFINITY];
/// The least number of items that is worth a thread.
const FEW: usize = 1 << 12;
/// The padding of a triangle's box, as a fraction of the triangle's extent. The f32 weights of a triangle seen nearly
/// edge-on (see `triangle::THIN`) can be off by 2^-17 per corner, and a corner can be two extents from the ray.
const GROWTH: f32 = 1.0 / (1u64 << 14) as f32;
/// The padding of every box, as a fraction of its largest coordinate, so that no slab is thinner than rounding. It is
/// three ulps, one of them for the rounding of the padding itself.
const ULPS: f32 = 3.0 / (1u64 << 23) as f32;
/// The padding of every box as an absolute length.
///
/// If a direction's component is nearly 0, the ray crosses a slab's wall at the distance to the wall times the
/// largest reciprocal, below 2^128. Triangles lie up to 2^71 away (twice `prepared_ray::FARTHEST`, in lengths of the
/// shortest direction, 2^-10). Underflow of a slope shears them by less than 2^-80.
const LEAST: f32 = 1.0 / (1u64 << 57) as f32;

/// Builds the bounding volume hierarchy over shapes. Returns it with its bounds and the number of triangles that can
/// be hit.
pub(crate) fn build_tree(
    shapes: &[Shape],
    preset: Preset,
    padded: bool,
) -> Result<(Tree, Option<Bounds>, usize), Error> {
    let items = Items::of_shapes(shapes, padded)?;
    let quadrics = shapes.iter().filter(|shape| shape.mesh().is_none()).count();
    let (tree, bounds) = items.tree(preset);
    Ok((tree, bounds, items.keys.len() - quadrics))
}

/// Builds the bounding volume hierarchy over the boxes of instances, each with its index. Returns it with a box around
/// all of them.
pub(crate) fn build_top(boxes: &[(u32, [DVec3; 2])], preset: Preset) -> Result<(Tree, Option<Bounds>), Error> {
    too_many("instances", boxes.len(), LIMIT)?;
    let grown: Vec<Bounds> = boxes
        .iter()
        .map(|&(_, [low, high])| {
            let [low, high] = [low.as_vec3(), high.as_vec3()];
            grow([low, high], (high - low).max_element() * ULPS)
        })
        .collect();
    let keys = boxes.iter().map(|&(number, _)| number.into()).collect();
    let items = Items { shapes: &[], boxes: &grown, keys, still: false, padded: true };
    Ok(items.tree(preset))
}

fn too_many(what: &'static str, count: usize, limit: usize) -> Result<(), Error> {
    if count < limit { Ok(()) } else { Err(Error::TooMany { what, count, limit }) }
}

fn enclose([a, b, c]: [Vec3; 3]) -> Bounds {
    [a.min(b).min(c), a.max(b).max(c)]
}

fn grow([low, high]: Bounds, by: f32) -> Bounds {
    let by = by + low.abs().max(high.abs()).max_element() * ULPS + LEAST;
    [low - by, high + by]
}

pub(crate) fn union(a: Bounds, b: Bounds) -> Bounds {
    [a[0].min(b[0]), a[1].max(b[1])]
}

#[cfg(test)]
mod tests {
    use super::*;
    use obvhs::bvh2::node::Bvh2Node;

    /// A binary tree that is a chain needs seven entries on the stack per level.
    #[test]
    fn a_tree_that_is_too_deep_is_refused_and_another_is_built() {
        const COUNT: u32 = 8000;
        let corner = |n: u32, i: u32| [(n + i % 2) as f32, (i / 2) as f32, n as f32];
        let mesh = Mesh::new(
            (0..COUNT).flat_map(|n| (0..3).map(move |i| corner(n, i))).collect(),
            (0..COUNT).map(|n| [3 * n, 3 * n + 1, 3 * n + 2]).collect(),
        );
        let shapes = [Shape::from(mesh.expect("valid"))];
        let items = Items::of_shapes(&shapes, true).expect("it fits");
        let mut all = items.boxes(items.total().expect("some"));
        // Node 2 n + 1 is item n, and node 2 n + 2 holds the items after it.
        let leaves: Vec<_> = (0..).zip(&*all).map(|(n, item)| item.leaf(n)).collect();
        let mut boxes: Vec<_> = leaves.iter().rev().map(|leaf| *leaf.aabb()).collect();
        for n in 1..boxes.len() {
            boxes[n] = boxes[n].union(&boxes[n - 1]);
        }
        let mut chain = vec![Bvh2Node::new(boxes[COUNT as usize - 1], 0, 1)];
        for n in 0..COUNT as usize - 1 {
            let rest = COUNT as usize - 2 - n;
            chain.push(leaves[n]);
            chain.push(if rest == 0 { leaves[n + 1] } else { Bvh2Node::new(boxes[rest], 0, 2 * n as u32 + 3) });
        }
        let chain = binary::Binary { nodes: chain, order: (0..COUNT).collect() };
        assert!(wide::collapse(&chain, &items, Pages::default()).is_none());
        let tree = wide::collapse(&binary::balanced(&mut all), &items, all).expect("it is shallow");
        assert!(tree.stack < 64, "{}", tree.stack);
    }
}
