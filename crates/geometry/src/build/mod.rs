//! From shapes to the tree: boxes, a binary tree (obvhs's, where that is safe), eight-wide nodes.

mod binary;
mod wide;

use crate::safeguards::PADDING;
use crate::shape::Quadric;
use crate::traverse::{LIMIT, Tree, key};
use crate::{Error, Shape};
use glam::{DVec3, Vec3};
use obvhs::BvhBuildParams;

/// How much time goes into the tree. Pictures do not depend on it, only speed does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Preset {
    /// The least.
    Fastest,
    /// Little.
    VeryFast,
    /// Less than usual.
    Fast,
    /// For a picture.
    #[default]
    Medium,
    /// For many pictures.
    Slow,
    /// The most.
    VerySlow,
}

impl Preset {
    fn params(self) -> BvhBuildParams {
        match self {
            Self::Fastest => BvhBuildParams::fastest_build(),
            Self::VeryFast => BvhBuildParams::very_fast_build(),
            Self::Fast => BvhBuildParams::fast_build(),
            Self::Medium => BvhBuildParams::medium_build(),
            Self::Slow => BvhBuildParams::slow_build(),
            Self::VerySlow => BvhBuildParams::very_slow_build(),
        }
    }
}

/// Lower and upper corner.
pub(crate) type Bounds = [Vec3; 2];

/// What an item is. Not the thing itself: there are as many of these in memory as there are primitives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Content {
    Triangle,
    Quadric,
    /// An instance.
    Box,
}

/// A primitive with its box, grown by what rounding asks for.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Item {
    pub(crate) bounds: Bounds,
    /// Its shape and primitive, or an instance's number.
    pub(crate) key: u64,
    pub(crate) content: Content,
}

/// Boxes of triangles grow by this share of the triangle's extent: f32 weights of a triangle seen from the side (see
/// `triangle::THIN`) can be off by 2^-17, for each of three corners, each up to two extents from the ray.
const GROWTH: f32 = 1.0 / (1u64 << 14) as f32;
/// All boxes grow by this share of their largest coordinate, so that no slab is thinner than rounding.
const ULPS: f32 = 1.0 / (1u64 << 22) as f32;

/// Builds the tree; also the bounds and the number of triangles that can be hit.
pub(crate) fn build_tree(shapes: &[Shape], preset: Preset) -> Result<(Tree, Option<Bounds>, usize), Error> {
    let items = collect(shapes)?;
    let triangles = items.iter().filter(|item| matches!(item.content, Content::Triangle)).count();
    let bounds = items.iter().map(|item| item.bounds).reduce(union);
    Ok((build_over(&items, shapes, preset), bounds, triangles))
}

/// Builds the tree over boxes with numbers, and a box around all of them.
pub(crate) fn build_top(boxes: &[(u32, [DVec3; 2])], preset: Preset) -> Result<(Tree, Option<Bounds>), Error> {
    too_many("instances", boxes.len(), LIMIT)?;
    let item = |&(number, [low, high]): &(u32, [DVec3; 2])| {
        let bounds = [low.as_vec3(), high.as_vec3()];
        let bounds = grow(bounds, (bounds[1] - bounds[0]).max_element() * ULPS);
        Item { bounds, key: number.into(), content: Content::Box }
    };
    let items: Vec<Item> = boxes.iter().map(item).collect();
    let bounds = items.iter().map(|item| item.bounds).reduce(union);
    Ok((build_over(&items, &[], preset), bounds))
}

fn build_over(items: &[Item], shapes: &[Shape], preset: Preset) -> Tree {
    wide::collapse(&binary::by_area(items, preset.params()), items, shapes)
        .or_else(|| wide::collapse(&binary::by_median(items), items, shapes))
        .unwrap_or_default()
}

fn collect(shapes: &[Shape]) -> Result<Vec<Item>, Error> {
    too_many("shapes", shapes.len(), u32::MAX as usize)?;
    let count = shapes.iter().map(|shape| shape.mesh().map_or(1, |mesh| mesh.triangles().len())).sum();
    too_many("primitives", count, LIMIT)?;
    let mut items = Vec::with_capacity(count);
    for (number, shape) in shapes.iter().enumerate() {
        let number = number as u32;
        match shape {
            Shape::Mesh(mesh) => {
                let sound = mesh.degenerate() == 0;
                let numbers = 0..mesh.triangles().len() as u32;
                items.extend(numbers.filter(|&n| sound || !mesh.is_degenerate(n)).map(|n| Item {
                    bounds: around(mesh.corners(n)),
                    key: key(number, n),
                    content: Content::Triangle,
                }));
            }
            Shape::Moving(mesh) => {
                let numbers = 0..mesh.start().triangles().len() as u32;
                items.extend(numbers.filter(|&n| !mesh.is_degenerate(n)).map(|n| Item {
                    bounds: union(around(mesh.corners(n, 0.0)), around(mesh.ends_of(n))),
                    key: key(number, n),
                    content: Content::Triangle,
                }));
            }
            Shape::Sphere(sphere) => items.push(quadric(&Quadric::Sphere(*sphere), key(number, 0))),
            Shape::Disk(disk) => items.push(quadric(&Quadric::Disk(*disk), key(number, 0))),
        }
    }
    Ok(items)
}

fn too_many(what: &'static str, count: usize, limit: usize) -> Result<(), Error> {
    if count < limit { Ok(()) } else { Err(Error::TooMany { what, count, limit }) }
}

fn around([a, b, c]: [Vec3; 3]) -> Bounds {
    let (low, high) = (a.min(b).min(c), a.max(b).max(c));
    grow([low, high], (high - low).max_element() * GROWTH)
}

fn quadric(quadric: &Quadric, key: u64) -> Item {
    let [low, high] = quadric.bounds().map(DVec3::as_vec3);
    // Rounding to f32 and a sphere's own growth: both within a few of its ulps.
    let bounds = grow([low, high], (high - low).max_element() * ULPS);
    Item { bounds, key, content: Content::Quadric }
}

fn grow([low, high]: Bounds, by: f32) -> Bounds {
    if !PADDING {
        return [low, high];
    }
    let by = by + low.abs().max(high.abs()).max_element() * ULPS;
    [(low - by).map(f32::next_down), (high + by).map(f32::next_up)]
}

pub(crate) fn union(a: Bounds, b: Bounds) -> Bounds {
    [a[0].min(b[0]), a[1].max(b[1])]
}

/// Half the surface of a box, in f64: no magnitude that is let in over- or underflows.
pub(crate) fn half_area([low, high]: Bounds) -> f64 {
    let d = high.as_dvec3() - low.as_dvec3();
    d.x * d.y + d.y * d.z + d.z * d.x
}

pub(crate) fn centre([low, high]: Bounds) -> DVec3 {
    (low.as_dvec3() + high.as_dvec3()) * 0.5
}
