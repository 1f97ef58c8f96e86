//! Binary trees over boxes.
//!
//! obvhs needs quadratic time, and makes chains, where many boxes share a centre (see [`by_area`]); its input here is
//! finite, of moderate size and never empty, which is what else it asks for.

use super::{Bounds, Item, centre, half_area, union};
use glam::{DVec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::ploc::PlocBuilder;
use obvhs::{Boundable, BvhBuildParams};
use std::cmp::Ordering;

/// A node of a binary tree. Children come after their parent in the list.
#[derive(Clone, Copy, Debug)]
pub(super) struct Node2 {
    pub(super) bounds: Bounds,
    pub(super) below: Below,
}

#[derive(Clone, Copy, Debug)]
pub(super) enum Below {
    Item(u32),
    Nodes([u32; 2]),
}

/// Centres are compared on a grid of this many cells along the longest axis of the scene.
const CELLS: f64 = (1u64 << 20) as f64;
/// So many boxes with their centre in one cell are left to obvhs; more are split by medians of our own.
const CROWD: usize = 8;

/// A box as obvhs takes it.
struct Padded(Aabb);

impl Boundable for Padded {
    fn aabb(&self) -> Aabb {
        self.0
    }
}

/// A tree of small expected cost: obvhs's PLOC and reinsertion over boxes with different centres, medians below where
/// many share one. Empty for no items.
pub(super) fn by_area(items: &[Item], params: BvhBuildParams) -> Vec<Node2> {
    let Some(bounds) = items.iter().map(|item| item.bounds).reduce(union) else { return Vec::new() };
    let mut groups = Groups::new(items, bounds);
    if groups.len() <= 1 {
        return by_median(items);
    }
    let tree = obvhs_tree(&mut groups, items, bounds, params);

    let mut nodes = Vec::with_capacity(2 * items.len() - 1);
    nodes.push(placeholder());
    let mut open = vec![(0_usize, 0_usize)];
    while let Some((theirs, ours)) = open.pop() {
        let node = &tree.nodes[theirs];
        let first = node.first_index as usize;
        if node.is_leaf() {
            match groups.members(tree.primitive_indices[first] as usize) {
                Members::One(item) => nodes[ours].below = Below::Item(item),
                Members::Many(numbers) => split_by_median(items, numbers, &mut nodes, ours),
            }
        } else {
            let children = nodes.len();
            nodes.extend([placeholder(); 2]);
            nodes[ours].below = Below::Nodes([children as u32, children as u32 + 1]);
            open.extend([(first, children), (first + 1, children + 1)]);
        }
    }
    bound(&mut nodes, items);
    nodes
}

/// A balanced tree: splits at the median along the longest axis of the centres. Empty for no items.
pub(super) fn by_median(items: &[Item]) -> Vec<Node2> {
    if items.is_empty() {
        return Vec::new();
    }
    let mut nodes = vec![placeholder()];
    let mut numbers: Vec<u32> = (0..items.len() as u32).collect();
    split_by_median(items, &mut numbers, &mut nodes, 0);
    bound(&mut nodes, items);
    nodes
}

/// Items in groups: those whose centre shares a crowded cell together, all others alone.
enum Groups {
    /// There is no crowd: item by item.
    Alone(usize),
    /// Where each group starts in the list of members, and where the last one ends.
    Some { members: Vec<u32>, starts: Vec<u32> },
}

enum Members<'a> {
    One(u32),
    Many(&'a mut [u32]),
}

impl Groups {
    fn new(items: &[Item], bounds: Bounds) -> Self {
        let low = bounds[0].as_dvec3();
        let per_extent = CELLS / (bounds[1].as_dvec3() - low).max_element();
        // 21 bits an axis.
        let cell = |item: &Item| {
            let [x, y, z] = ((centre(item.bounds) - low) * per_extent).as_u64vec3().to_array();
            x << 42 | y << 21 | z
        };
        if !may_be_crowded(items.iter().map(cell), items.len()) {
            return Self::Alone(items.len());
        }
        let mut cells: Vec<(u64, u32)> = items.iter().map(cell).zip(0..).collect();
        cells.sort_unstable();
        let mut starts = Vec::with_capacity(items.len() + 1);
        let mut start = 0;
        for crowd in cells.chunk_by(|a, b| a.0 == b.0) {
            let count = crowd.len() as u32;
            if count as usize > CROWD {
                starts.push(start);
            } else {
                starts.extend(start..start + count);
            }
            start += count;
        }
        starts.push(start);
        Self::Some { members: cells.into_iter().map(|(_, number)| number).collect(), starts }
    }

    fn len(&self) -> usize {
        match self {
            Self::Alone(count) => *count,
            Self::Some { starts, .. } => starts.len() - 1,
        }
    }

    fn members(&mut self, group: usize) -> Members<'_> {
        match self {
            Self::Alone(_) => Members::One(group as u32),
            Self::Some { members, starts } => {
                let members = &mut members[starts[group] as usize..starts[group + 1] as usize];
                if let [one] = members { Members::One(*one) } else { Members::Many(members) }
            }
        }
    }

    fn bounds(&mut self, group: usize, items: &[Item]) -> Bounds {
        match self.members(group) {
            Members::One(item) => items[item as usize].bounds,
            Members::Many(numbers) => {
                let first = items[numbers[0] as usize].bounds;
                numbers[1..].iter().fold(first, |sum, &number| union(sum, items[number as usize].bounds))
            }
        }
    }
}

/// Whether more than [`CROWD`] cells may be equal: surely not, if nowhere so many have the same hash. Saves sorting them,
/// which takes longer.
fn may_be_crowded(cells: impl Iterator<Item = u64>, count: usize) -> bool {
    let bits = (2 * count).next_power_of_two().trailing_zeros().max(1);
    let mut counts = vec![0_u8; 1 << bits];
    for cell in cells {
        // Fibonacci hashing [Knuth 1998, section 6.4].
        let slot = &mut counts[(cell.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> (64 - bits)) as usize];
        *slot += 1;
        if usize::from(*slot) > CROWD {
            return true;
        }
    }
    false
}

/// obvhs's tree over groups, at least two, one a leaf. Their boxes are scaled to unit size first, so that areas neither
/// overflow nor vanish and the tree is the same at each scale.
fn obvhs_tree(groups: &mut Groups, items: &[Item], bounds: Bounds, params: BvhBuildParams) -> Bvh2 {
    let origin = bounds[0].as_dvec3();
    let extent = (bounds[1].as_dvec3() - origin).max_element();
    let scaled = |p: glam::Vec3| Vec3A::from(((p.as_dvec3() - origin) / extent).as_vec3());
    let boxes: Vec<Padded> = (0..groups.len())
        .map(|group| {
            let [low, high] = groups.bounds(group, items);
            Padded(Aabb::new(scaled(low), scaled(high)))
        })
        .collect();
    let numbers = (0..boxes.len() as u32).collect();
    let (distance, precision) = (params.ploc_search_distance, params.sort_precision);
    let threshold = params.search_depth_threshold;
    let mut tree = PlocBuilder::with_capacity(boxes.len()).build(distance, &boxes, numbers, precision, threshold);
    ReinsertionOptimizer::default().run(&mut tree, params.reinsertion_batch_ratio, None);
    tree
}

/// Grows a subtree over `numbers`, at least one, from the node `root`.
fn split_by_median(items: &[Item], numbers: &mut [u32], nodes: &mut Vec<Node2>, root: usize) {
    let mut open = vec![(root, 0, numbers.len())];
    while let Some((node, start, end)) = open.pop() {
        if end - start == 1 {
            nodes[node].below = Below::Item(numbers[start]);
            continue;
        }
        let part = &mut numbers[start..end];
        let middle = part.len() / 2;
        let order = median_order(items, part);
        part.select_nth_unstable_by(middle, order);
        let children = nodes.len();
        nodes.extend([placeholder(); 2]);
        nodes[node].below = Below::Nodes([children as u32, children as u32 + 1]);
        open.extend([(children, start, start + middle), (children + 1, start + middle, end)]);
    }
}

/// By centre along the axis on which centres differ most, then by size, then by number.
fn median_order<'a>(items: &'a [Item], numbers: &[u32]) -> impl Fn(&u32, &u32) -> Ordering + use<'a> {
    let centre_of = |number: u32| centre(items[number as usize].bounds);
    let start = centre_of(numbers[0]);
    let fold = |[low, high]: [DVec3; 2], &number: &u32| [low.min(centre_of(number)), high.max(centre_of(number))];
    let [low, high] = numbers.iter().fold([start, start], fold);
    let axis = (high - low).max_position();
    move |&a, &b| {
        let [one, other] = [a, b].map(|number| items[number as usize].bounds);
        let by_centre = centre(one)[axis].total_cmp(&centre(other)[axis]);
        by_centre.then_with(|| half_area(one).total_cmp(&half_area(other))).then(a.cmp(&b))
    }
}

/// Sets all bounds, from the leaves up.
fn bound(nodes: &mut [Node2], items: &[Item]) {
    for number in (0..nodes.len()).rev() {
        nodes[number].bounds = match nodes[number].below {
            Below::Item(item) => items[item as usize].bounds,
            Below::Nodes(children) => {
                let [left, right] = children.map(|child| nodes[child as usize].bounds);
                union(left, right)
            }
        };
    }
}

fn placeholder() -> Node2 {
    Node2 { bounds: [glam::Vec3::ZERO; 2], below: Below::Item(0) }
}
