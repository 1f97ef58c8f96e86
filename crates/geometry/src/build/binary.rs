//! Binary trees whose leaves hold one item each, stored as obvhs's nodes: siblings are adjacent and the root is first.
//!
//! PLOC takes quadratic time and makes long chains if many boxes share a centre; [`by_area`] avoids this. The other
//! requirements of [`joining`] and obvhs are met: boxes are finite and of moderate size, and there is at least one.

use super::FEW;
use super::joining::{self, Cluster};
use crate::pages::Pages;
use glam::Vec3A;
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::ploc::PlocSearchDistance;
use obvhs::ploc::morton::morton_encode_u64_unorm;
use rayon::prelude::*;
use std::cmp::Ordering;

/// The largest number of boxes with their centre in one cell that are joined by area. More boxes in a cell are split at
/// medians here.
const CROWD: usize = 8;

/// The Morton code of an item's centre, and the item's index.
type Place = (u64, u32);

/// Returns the cell of a Morton code, with 20 bits per axis. Boxes whose centres share it count as sharing a centre.
fn cell((code, _): Place) -> u64 {
    code >> 3
}

/// Returns a binary tree of small expected cost. PLOC and obvhs's reinsertion join boxes with different centres;
/// median splits divide groups of boxes that share one.
///
/// Item `n` is the leaf at index `n` of `leaves`, whose boxes are between 0 and 1 on each axis. The cells of Morton
/// codes divide the box from 0 to `size`. Children may come before their parent.
pub(super) fn by_area(leaves: Pages<Cluster>, params: BvhBuildParams, size: Vec3A) -> Vec<Bvh2Node> {
    let order = morton_order(&leaves, size);
    let crowded = |places: &[Place]| cell(places[0]) == cell(places[CROWD]);
    if !order.par_windows(CROWD + 1).with_min_len(FEW).any(crowded) {
        let mut sorted = Pages::zeroed(order.len());
        let places = sorted.par_iter_mut().with_min_len(FEW).zip(&order);
        places.for_each(|(leaf, &(_, number))| *leaf = leaves[number as usize]);
        drop((leaves, order));
        return joined(sorted, params);
    }
    let mut groups = Groups::new(order);
    if groups.len() == 1 {
        return by_median(leaves);
    }
    let mut nodes = joined(groups.leaves(&leaves), params);
    for number in 0..nodes.len() {
        if nodes[number].is_leaf() {
            let members = groups.members(nodes[number].first_index);
            split_by_median(&leaves, members, &mut nodes, number);
        }
    }
    nodes
}

/// Returns the items by Morton code, then by index.
fn morton_order(leaves: &[Cluster], size: Vec3A) -> Vec<Place> {
    let scale = 1.0 / size.as_dvec3();
    let code = |leaf: &Cluster| morton_encode_u64_unorm(leaf.aabb().center().as_dvec3() * scale);
    let numbers = (0..leaves.len() as u32).into_par_iter();
    let places = leaves.par_iter().with_min_len(FEW).zip(numbers).map(|(leaf, number)| (code(leaf), number));
    let mut order: Vec<Place> = places.collect();
    // No two places are equal, so both sorts give the same order. On one thread, the first takes half of the time.
    if rayon::current_num_threads() == 1 {
        order.sort_unstable();
    } else {
        order.par_sort_unstable();
    }
    order
}

/// Returns a balanced binary tree. Each node is split at the median along the axis on which the centres differ most.
pub(super) fn by_median(leaves: Pages<Cluster>) -> Vec<Bvh2Node> {
    let mut nodes = Vec::with_capacity(2 * leaves.len());
    let mut numbers: Vec<u32> = (0..leaves.len() as u32).collect();
    if !leaves.is_empty() {
        nodes.push(leaves[0].node());
        split_by_median(&leaves, &mut numbers, &mut nodes, 0);
    }
    nodes
}

/// A partition of the items. Items with their centre in the same crowded cell form a group; every other item is alone.
struct Groups {
    members: Vec<u32>,
    /// The index in `members` at which each group starts, and the length of `members` as the last entry.
    starts: Vec<u32>,
}

impl Groups {
    fn new(order: Vec<Place>) -> Self {
        let mut starts = Vec::with_capacity(order.len() + 1);
        let mut start = 0;
        for crowd in order.chunk_by(|&a, &b| cell(a) == cell(b)) {
            let count = crowd.len() as u32;
            if count as usize > CROWD {
                starts.push(start);
            } else {
                starts.extend(start..start + count);
            }
            start += count;
        }
        starts.push(start);
        Self { members: order.into_iter().map(|(_, number)| number).collect(), starts }
    }

    fn len(&self) -> usize {
        self.starts.len() - 1
    }

    fn members(&mut self, group: u32) -> &mut [u32] {
        let [start, end] = [group, group + 1].map(|at| self.starts[at as usize] as usize);
        &mut self.members[start..end]
    }

    /// Returns one leaf per group.
    fn leaves(&mut self, leaves: &[Cluster]) -> Pages<Cluster> {
        let mut clusters = Pages::zeroed(self.len());
        for (group, cluster) in (0..).zip(clusters.iter_mut()) {
            let Aabb { min, max } = around(leaves, self.members(group));
            *cluster = Cluster::leaf([min.to_array(), max.to_array()], group);
        }
        clusters
    }
}

/// Builds a tree (PLOC, then obvhs's reinsertion) over leaves in the order of their Morton codes.
fn joined(leaves: Pages<Cluster>, params: BvhBuildParams) -> Vec<Bvh2Node> {
    let distance = match params.ploc_search_distance {
        PlocSearchDistance::Minimum => 1,
        PlocSearchDistance::VeryLow => 2,
        PlocSearchDistance::Low => 6,
        PlocSearchDistance::Medium => 14,
        PlocSearchDistance::High => 24,
        PlocSearchDistance::VeryHigh => 32,
    };
    let (nodes, rounds) = joining::join(leaves, distance, params.search_depth_threshold);
    let mut tree = Bvh2 { nodes, ..Bvh2::default() };
    // Reinsertion takes it as the size of its stack.
    tree.max_depth = tree.max_depth.max(rounds + 1);
    reinsert(&mut tree, params.reinsertion_batch_ratio);
    tree.nodes
}

/// Moves subtrees to cheaper places, as `ReinsertionOptimizer::run` does: in rounds of fewer and fewer candidates, the
/// largest of the first nodes. That sorts millions of candidates of equal area differently by each number of threads.
/// Here the node's number decides.
fn reinsert(tree: &mut Bvh2, ratio: f32) {
    let nodes = tree.nodes.len();
    if nodes < 2 || ratio <= 0.0 {
        return;
    }
    let mut optimizer = ReinsertionOptimizer::default();
    for part in (1..32).step_by(2) {
        let count = (((nodes as f32 * ratio) * (1.0 / part as f32)) as usize).clamp(1, nodes - 1);
        let numbered = (1..).zip(&tree.nodes[1..nodes.min(2 * count + 2)]);
        // Areas are not negative, so their bits have their order.
        let by_area = numbered.map(|(number, node)| (!node.aabb().half_area().to_bits(), number));
        let mut order: Vec<(u32, u32)> = by_area.collect();
        if count < order.len() {
            order.select_nth_unstable(count);
            order.truncate(count);
        }
        order.par_sort_unstable();
        let candidates: Vec<u32> = order.into_iter().map(|(_, number)| number).collect();
        optimizer.run_with_candidates(tree, &candidates, 1);
    }
}

/// Builds a subtree by median splits at the node `root` over the items `numbers`, of which there is at least one.
fn split_by_median(leaves: &[Cluster], numbers: &mut [u32], nodes: &mut Vec<Bvh2Node>, root: usize) {
    let mut open = vec![(root, 0, numbers.len())];
    while let Some((node, start, end)) = open.pop() {
        if end - start == 1 {
            nodes[node] = leaves[numbers[start] as usize].node();
            continue;
        }
        let part = &mut numbers[start..end];
        let middle = part.len() / 2;
        let order = median_order(leaves, part);
        part.select_nth_unstable_by(middle, order);
        let children = nodes.len();
        nodes[node] = Bvh2Node::new(around(leaves, part), 0, children as u32);
        nodes.extend([Bvh2Node::default(); 2]);
        open.extend([(children, start, start + middle), (children + 1, start + middle, end)]);
    }
}

/// Returns the order of items by centre along the axis on which centres differ most, then by area, then by index.
fn median_order<'a>(leaves: &'a [Cluster], numbers: &[u32]) -> impl Fn(&u32, &u32) -> Ordering + use<'a> {
    let centre_of = |number: u32| centre(&leaves[number as usize]);
    let start = centre_of(numbers[0]);
    let fold = |[low, high]: [Vec3A; 2], &number: &u32| [low.min(centre_of(number)), high.max(centre_of(number))];
    let [low, high] = numbers.iter().fold([start, start], fold);
    let axis = (high - low).max_position();
    move |&a, &b| {
        let [one, other] = [a, b].map(|number| &leaves[number as usize]);
        let by_centre = centre(one)[axis].total_cmp(&centre(other)[axis]);
        by_centre.then_with(|| one.aabb().half_area().total_cmp(&other.aabb().half_area())).then(a.cmp(&b))
    }
}

fn centre(leaf: &Cluster) -> Vec3A {
    (leaf.aabb().min + leaf.aabb().max) * 0.5
}

fn around(leaves: &[Cluster], numbers: &[u32]) -> Aabb {
    let first = leaves[numbers[0] as usize].aabb();
    numbers[1..].iter().fold(first, |sum, &number| sum.union(&leaves[number as usize].aabb()))
}
