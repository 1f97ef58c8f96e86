//! Construction of the bounding volume hierarchy: boxes of primitives, a binary tree, and its conversion to eight-wide nodes.

mod binary;
mod items;
mod plans;
mod reinsertion;
mod wide;

use crate::bvh::{Bvh, LIMIT, Node8};
use crate::{Error, Shape};
use glam::DVec3;
pub(crate) use items::{Bounds, union};
use items::{Items, padded_by_ulps};

/// Builds the bounding volume hierarchy of shapes. Returns it with its bounding box and the number of triangles with an area.
pub(crate) fn build_tree(shapes: &[Shape]) -> Result<(Bvh, Option<Bounds>, usize), Error> {
    let items = Items::of_shapes(shapes)?;
    let quadrics = shapes.iter().filter(|shape| shape.mesh().is_none()).count();
    let (bvh, bounds) = tree(&items);
    Ok((bvh, bounds, items.keys.len() - quadrics))
}

/// Builds the bounding volume hierarchy over the boxes of instances, each given with its index. Returns it with its bounding
/// box.
pub(crate) fn build_top(boxes: &[(u32, [DVec3; 2])]) -> Result<(Bvh, Option<Bounds>), Error> {
    Error::too_many("instances", boxes.len(), LIMIT)?;
    let grown: Vec<Bounds> = boxes.iter().map(|&(_, bounds)| padded_by_ulps(bounds)).collect();
    let keys = boxes.iter().map(|&(number, _)| number.into()).collect();
    Ok(tree(&Items { shapes: &[], boxes: &grown, keys, still: false }))
}

/// Builds the tree over all items. Returns it with the bounding box of all items; `None` if there are no items.
fn tree(items: &Items<'_>) -> (Bvh, Option<Bounds>) {
    let Some(bounds) = items.total() else { return (Bvh::default(), None) };
    let mut boxes = items.boxes(bounds);
    let binary = binary::tree(&mut boxes, items.are_triangles());
    let bvh = wide::collapse(&binary, items, boxes)
        .or_else(|| {
            let mut boxes = items.boxes(bounds);
            wide::collapse(&binary::balanced(&mut boxes), items, boxes)
        })
        .unwrap_or_default();
    let around = bvh.nodes.first().map(Node8::around);
    (bvh, around)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Mesh;
    use crate::huge_pages::Pages;
    use obvhs::bvh2::node::Bvh2Node;

    /// A binary tree that is a chain needs seven stack entries per level.
    #[test]
    fn a_tree_that_is_too_deep_is_refused_and_another_is_built() {
        const COUNT: u32 = 8000;
        let corner = |n: u32, i: u32| [(n + i % 2) as f32, (i / 2) as f32, n as f32];
        let mesh = Mesh::new(
            (0..COUNT).flat_map(|n| (0..3).map(move |i| corner(n, i))).collect(),
            (0..COUNT).map(|n| [3 * n, 3 * n + 1, 3 * n + 2]).collect(),
        );
        let shapes = [Shape::from(mesh.expect("valid"))];
        let items = Items::of_shapes(&shapes).expect("it fits");
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
