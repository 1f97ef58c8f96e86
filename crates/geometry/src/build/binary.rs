//! Binary trees whose leaves hold one item each, stored as obvhs's nodes: siblings are adjacent and the root is first.
//!
//! obvhs takes quadratic time and makes long chains if many boxes share a centre; [`by_area`] avoids this. Its other
//! requirements are met: boxes are finite and of moderate size, and there is at least one.

use super::FEW;
use glam::Vec3A;
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance};
use rayon::prelude::*;
use std::cmp::Ordering;
use std::sync::atomic::AtomicU8;
use std::sync::atomic::Ordering::Relaxed;

/// The number of cells along the longest axis of the scene. Boxes whose centres share a cell count as sharing a
/// centre.
const CELLS: f32 = (1u32 << 20) as f32;
/// The largest number of boxes with their centre in one cell that obvhs gets. More boxes in a cell are split at
/// medians here.
const CROWD: usize = 8;

/// The shape of the cells of Morton codes, by which obvhs sorts boxes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum MortonCells {
    /// One scale for all axes: neighbours in the order are near each other in flat scenes too.
    Cubes,
    /// A scale for each axis by itself, as in obvhs.
    OfScene,
}

/// Returns a binary tree of small expected cost. obvhs's PLOC and reinsertion join boxes with different centres;
/// median splits divide groups of boxes that share one.
///
/// Item `n` is the leaf at index `n` of `leaves`, whose boxes are in the unit cube. Children may come before their
/// parent.
pub(super) fn by_area(leaves: Vec<Bvh2Node>, params: BvhBuildParams, cells: MortonCells) -> Vec<Bvh2Node> {
    match Groups::new(&leaves) {
        None => obvhs_tree(leaves, params, cells),
        Some(groups) if groups.len() == 1 => by_median(leaves),
        Some(mut groups) => {
            let mut nodes = obvhs_tree(groups.leaves(&leaves), params, cells);
            for number in 0..nodes.len() {
                if nodes[number].is_leaf() {
                    let members = groups.members(nodes[number].first_index);
                    split_by_median(&leaves, members, &mut nodes, number);
                }
            }
            nodes
        }
    }
}

/// Returns a balanced binary tree. Each node is split at the median along the axis on which the centres differ most.
pub(super) fn by_median(leaves: Vec<Bvh2Node>) -> Vec<Bvh2Node> {
    let mut nodes = Vec::with_capacity(2 * leaves.len());
    let mut numbers: Vec<u32> = (0..leaves.len() as u32).collect();
    if !leaves.is_empty() {
        nodes.push(leaves[0]);
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
    /// Partitions the items; `None` if no cell is crowded.
    fn new(leaves: &[Bvh2Node]) -> Option<Self> {
        // The cell of a centre, with 21 bits per axis.
        let cell = |leaf: &Bvh2Node| {
            let [x, y, z] = (centre(leaf) * CELLS).as_uvec3().to_array().map(u64::from);
            x << 42 | y << 21 | z
        };
        if !is_crowded(leaves.par_iter().with_min_len(FEW).map(cell)) {
            return None;
        }
        let mut cells: Vec<(u64, u32)> = leaves.iter().map(cell).zip(0..).collect();
        cells.par_sort_unstable();
        let mut starts = Vec::with_capacity(leaves.len() + 1);
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
        Some(Self { members: cells.into_iter().map(|(_, number)| number).collect(), starts })
    }

    fn len(&self) -> usize {
        self.starts.len() - 1
    }

    fn members(&mut self, group: u32) -> &mut [u32] {
        let [start, end] = [group, group + 1].map(|at| self.starts[at as usize] as usize);
        &mut self.members[start..end]
    }

    /// Returns one leaf per group.
    fn leaves(&mut self, leaves: &[Bvh2Node]) -> Vec<Bvh2Node> {
        let groups = 0..self.len() as u32;
        groups.map(|group| Bvh2Node::new(around(leaves, self.members(group)), 1, group)).collect()
    }
}

/// Returns true if a value occurs more than [`CROWD`] times in `cells`. Only values whose hash occurs that often are
/// sorted, since sorting all would take longer than the rest of this module.
fn is_crowded(cells: impl IndexedParallelIterator<Item = u64> + Clone) -> bool {
    let bits = (2 * cells.len()).next_power_of_two().trailing_zeros().max(1);
    // The finalizer of SplitMix64 [Steele, Lea and Flood 2014, figure 16]. With less mixing, cells of regular grids
    // would collide.
    let slot = |cell: u64| {
        let mixed = (cell ^ cell >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ mixed >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        (mixed >> (64 - bits)) as usize
    };
    // The number of cells with each hash, up to one more than a crowd's limit.
    let counts: Vec<AtomicU8> = std::iter::repeat_with(AtomicU8::default).take(1 << bits).collect();
    let exceeds = |cell: u64| {
        let more = |count: u8| (usize::from(count) <= CROWD).then_some(count + 1);
        counts[slot(cell)].fetch_update(Relaxed, Relaxed, more).map_or(true, |count| usize::from(count) == CROWD)
    };
    if !cells.clone().fold(|| false, |any, cell| any | exceeds(cell)).reduce(|| false, |a, b| a | b) {
        return false;
    }
    let suspect = |&cell: &u64| usize::from(counts[slot(cell)].load(Relaxed)) > CROWD;
    let mut suspects: Vec<u64> = cells.filter(suspect).collect();
    suspects.par_sort_unstable();
    suspects.chunk_by(|a, b| a == b).any(|equal| equal.len() > CROWD)
}

/// Builds obvhs's tree (PLOC, then reinsertion) over these leaves.
fn obvhs_tree(leaves: Vec<Bvh2Node>, params: BvhBuildParams, cells: MortonCells) -> Vec<Bvh2Node> {
    let boxes = leaves.par_iter().with_min_len(FEW).map(|leaf| *leaf.aabb());
    let Some(mut all) = boxes.reduce_with(|a, b| a.union(&b)) else { return leaves };
    if cells == MortonCells::Cubes {
        all.max = all.min + (all.max - all.min).max_element();
    }
    let mut tree = Bvh2::zeroed(leaves.len());
    // The leaves are moved into the builder, since `PlocBuilder::build` would copy them.
    let mut builder = PlocBuilder::with_capacity(leaves.len());
    builder.current_nodes = leaves;
    let (precision, threshold) = (params.sort_precision, params.search_depth_threshold);
    macro_rules! build {
        ($distance: literal) => {
            builder.build_ploc_from_leaves::<$distance, false>(&mut tree, all, precision, threshold)
        };
    }
    match params.ploc_search_distance {
        PlocSearchDistance::Minimum => build!(1),
        PlocSearchDistance::VeryLow => build!(2),
        PlocSearchDistance::Low => build!(6),
        PlocSearchDistance::Medium => build!(14),
        PlocSearchDistance::High => build!(24),
        PlocSearchDistance::VeryHigh => build!(32),
    }
    drop(builder);
    ReinsertionOptimizer::default().run(&mut tree, params.reinsertion_batch_ratio, None);
    tree.nodes
}

/// Builds a subtree by median splits at the node `root` over the items `numbers`, of which there is at least one.
fn split_by_median(leaves: &[Bvh2Node], numbers: &mut [u32], nodes: &mut Vec<Bvh2Node>, root: usize) {
    let mut open = vec![(root, 0, numbers.len())];
    while let Some((node, start, end)) = open.pop() {
        if end - start == 1 {
            nodes[node] = leaves[numbers[start] as usize];
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
fn median_order<'a>(leaves: &'a [Bvh2Node], numbers: &[u32]) -> impl Fn(&u32, &u32) -> Ordering + use<'a> {
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

fn centre(leaf: &Bvh2Node) -> Vec3A {
    (leaf.aabb().min + leaf.aabb().max) * 0.5
}

fn around(leaves: &[Bvh2Node], numbers: &[u32]) -> Aabb {
    let first = *leaves[numbers[0] as usize].aabb();
    numbers[1..].iter().fold(first, |sum, &number| sum.union(leaves[number as usize].aabb()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two triangles of each square share a cell: no crowd, though weaker hashes would report one.
    #[test]
    fn only_crowded_cells_are_detected() {
        let grid = (0..512_u64).flat_map(|x| (0..512_u64).flat_map(move |z| [x << 53 | z << 11; 2]));
        let crowded = |cells: Vec<u64>| is_crowded(cells.into_par_iter());
        assert!(!crowded(grid.clone().collect()));
        assert!(!crowded(grid.clone().chain([5 << 53 | 7 << 11; CROWD - 2]).collect()));
        assert!(crowded(grid.chain([5 << 53 | 7 << 11; CROWD - 1]).collect()));
    }
}
