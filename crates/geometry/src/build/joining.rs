//! Joining of boxes to a binary tree from the leaves up, in parallel: PLOC, parallel locally ordered clustering
//! [Meister and Bittner 2018].
//!
//! In each round every cluster looks for the neighbour along the Morton curve with which it shares the smallest box.
//! Two clusters that choose each other become one. The tree is the one that obvhs builds, node by node. obvhs joins on
//! one thread, after it sorts the leaves again.

use crate::lanes::Vectors;
use crate::pages::Pages;
use bytemuck::{Pod, Zeroable};
use glam::Vec3A;
use obvhs::aabb::Aabb;
use obvhs::bvh2::node::Bvh2Node;
use pulp::NullaryFnOnce;
use rayon::prelude::*;
use std::ops::Range;

/// A subtree without a parent yet. Leaves and inner nodes differ as in [`Bvh2Node`].
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C, align(32))]
pub(super) struct Cluster {
    low: [f32; 3],
    first_index: u32,
    high: [f32; 3],
    prim_count: u32,
}

impl Cluster {
    /// Returns the leaf of an item.
    #[inline(always)]
    pub(super) fn leaf([low, high]: [[f32; 3]; 2], item: u32) -> Self {
        Self { low, first_index: item, high, prim_count: 1 }
    }

    #[inline(always)]
    pub(super) fn aabb(&self) -> Aabb {
        Aabb::new(Vec3A::from_array(self.low), Vec3A::from_array(self.high))
    }

    #[inline(always)]
    pub(super) fn node(&self) -> Bvh2Node {
        Bvh2Node::new(self.aabb(), self.prim_count, self.first_index)
    }

    /// Returns the parent of two clusters whose nodes are at `first_index` and after it.
    #[inline(always)]
    fn parent(&self, other: &Self, first_index: u32) -> Self {
        let (mut low, mut high) = (self.low, self.high);
        for axis in 0..3 {
            low[axis] = lesser(low[axis], other.low[axis]);
            high[axis] = greater(high[axis], other.high[axis]);
        }
        Self { low, first_index, high, prim_count: 0 }
    }
}

/// The lesser of two numbers, in one instruction, since neither is NaN.
#[inline(always)]
pub(super) fn lesser(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline(always)]
pub(super) fn greater(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// The number of clusters that one task searches or joins.
const CHUNK: usize = 1 << 12;
/// The number of clusters whose partners are searched together.
const BLOCK: usize = 128;
/// The largest search distance.
const FARTHEST: usize = 32;
/// The length of a block with the neighbours on both sides.
const WINDOW: usize = BLOCK + 2 * FARTHEST;

/// Joins clusters along the Morton curve to a binary tree with the root first and children after their parent. Returns
/// it with the number of rounds.
///
/// Clusters look at `distance` neighbours on each side, from 1 to 32, but at one in the first `short` rounds.
pub(super) fn join(mut clusters: Pages<Cluster>, distance: usize, short: usize) -> (Vec<Bvh2Node>, usize) {
    let distance = distance.clamp(1, FARTHEST);
    // Zeros cost no time until they are written, by many threads.
    let mut nodes: Vec<Bvh2Node> = bytemuck::zeroed_vec((2 * clusters.len()).saturating_sub(1));
    let mut partners: Vec<i8> = bytemuck::zeroed_vec(clusters.len());
    let mut joined = Pages::zeroed(clusters.len());
    let (mut count, mut free, mut rounds) = (clusters.len(), nodes.len(), 0);
    while count > 1 {
        let now = &clusters[..count];
        let partners = &mut partners[..count];
        search(now, partners, if rounds < short { 1 } else { distance });
        let pairs = merge(now, partners, &mut joined, &mut nodes[..free]);
        free -= 2 * pairs;
        count -= pairs;
        std::mem::swap(&mut clusters, &mut joined);
        rounds += 1;
    }
    if let (Some(root), Some(last)) = (nodes.first_mut(), clusters.first()) {
        *root = last.node();
    }
    (nodes, rounds)
}

/// Finds for each cluster the neighbour with the smallest common box, as the difference of their places. Of equal
/// boxes, the last one counts.
fn search(clusters: &[Cluster], partners: &mut [i8], distance: usize) {
    let vectors = Vectors::default();
    partners.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, partners)| {
        let start = chunk * CHUNK;
        let search = Search { clusters, start, partners, distance };
        match vectors {
            #[cfg(target_arch = "x86_64")]
            Vectors::Whole(v3) => v3.vectorize(search),
            Vectors::Pair => search.call(),
        }
    });
}

/// A search for the partners of a chunk, compiled for each kind of vectors.
struct Search<'a> {
    clusters: &'a [Cluster],
    start: usize,
    partners: &'a mut [i8],
    distance: usize,
}

impl NullaryFnOnce for Search<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        for (block, partners) in self.partners.chunks_mut(BLOCK).enumerate() {
            search_block(self.clusters, self.start + block * BLOCK, partners, self.distance);
        }
    }
}

#[inline(always)]
fn search_block(clusters: &[Cluster], start: usize, partners: &mut [i8], distance: usize) {
    // Beyond the ends there are boxes whose area is infinite with any other.
    const BEYOND: f32 = 1e30;
    let mut low = [[-BEYOND; WINDOW]; 3];
    let mut high = [[BEYOND; WINDOW]; 3];
    let (from, to) = (start.saturating_sub(distance), clusters.len().min(start + partners.len() + distance));
    let shift = FARTHEST + from - start;
    for (place, cluster) in (shift..WINDOW).zip(&clusters[from..to]) {
        for axis in 0..3 {
            low[axis][place] = cluster.low[axis];
            high[axis][place] = cluster.high[axis];
        }
    }
    let mut least = [f32::INFINITY; BLOCK];
    let mut best = [0_i32; BLOCK];
    let mut areas = [0.0; BLOCK + FARTHEST];
    for away in 1..=distance {
        // The cluster at `before` and those up to the block's last one, each with the one that far away.
        let before = FARTHEST - away;
        let areas = &mut areas[..BLOCK + away];
        let side = |axis: usize| {
            let [one, other] = [before, FARTHEST].map(|at| (&low[axis][at..], &high[axis][at..]));
            move |i: usize| greater(one.1[i], other.1[i]) - lesser(one.0[i], other.0[i])
        };
        let [x, y, z] = [side(0), side(1), side(2)];
        for (i, area) in areas.iter_mut().enumerate() {
            let (x, y, z) = (x(i), y(i), z(i));
            *area = (x + y) * z + x * y;
        }
        let offset = away as i32;
        for (((least, best), &back), &front) in least.iter_mut().zip(&mut best).zip(&areas[..BLOCK]).zip(&areas[away..])
        {
            let (area, choice) = if back < *least { (back, -offset) } else { (*least, *best) };
            let closer = front <= area;
            *least = if closer { front } else { area };
            *best = if closer { offset } else { choice };
        }
    }
    for (partner, best) in partners.iter_mut().zip(best) {
        *partner = best as i8;
    }
}

/// The outcome of a round for a cluster.
enum Fate {
    /// It is alone in the next round too.
    Alone,
    /// It joins a later cluster, in whose place their parent is put.
    Gone,
    /// It joins the earlier cluster at this place.
    Joins(usize),
}

/// Returns the fate of a cluster: two that chose each other are joined.
#[inline(always)]
fn fate(partners: &[i8], place: usize) -> Fate {
    let other = place.wrapping_add_signed(partners[place].into());
    if other == place || other.wrapping_add_signed(partners[other].into()) != place {
        Fate::Alone
    } else if other > place {
        Fate::Gone
    } else {
        Fate::Joins(other)
    }
}

/// A part of a round's clusters, with the memory that their results go to.
struct Part<'a> {
    places: Range<usize>,
    next: &'a mut [Cluster],
    /// The nodes of pairs, those of the last pair first.
    nodes: &'a mut [Bvh2Node],
    first_node: usize,
}

/// Writes the clusters of the next round, and the nodes of pairs to the end of `nodes`. Returns the number of pairs.
fn merge(now: &[Cluster], partners: &[i8], mut next: &mut [Cluster], mut nodes: &mut [Bvh2Node]) -> usize {
    let chunks = now.len().div_ceil(CHUNK);
    let places = |chunk: usize| chunk * CHUNK..now.len().min((chunk + 1) * CHUNK);
    let count = |chunk: usize| {
        places(chunk).fold([0; 2], |[stay, pairs], place| match fate(partners, place) {
            Fate::Alone => [stay + 1, pairs],
            Fate::Gone => [stay, pairs],
            Fate::Joins(_) => [stay + 1, pairs + 1],
        })
    };
    let counts: Vec<[usize; 2]> = (0..chunks).into_par_iter().map(count).collect();
    let mut parts = Vec::with_capacity(chunks);
    for (chunk, &[stay, pairs]) in counts.iter().enumerate() {
        let first_node = nodes.len() - 2 * pairs;
        let (of_chunk, later) = next.split_at_mut(stay);
        let (free, of_pairs) = nodes.split_at_mut(first_node);
        (next, nodes) = (later, free);
        parts.push(Part { places: places(chunk), next: of_chunk, nodes: of_pairs, first_node });
    }
    parts.into_par_iter().for_each(|part| part.merge(now, partners));
    counts.iter().map(|[_, pairs]| pairs).sum()
}

impl Part<'_> {
    fn merge(self, now: &[Cluster], partners: &[i8]) {
        let mut free = self.nodes.len();
        let mut next = self.next.iter_mut();
        let mut keep = |cluster| {
            if let Some(place) = next.next() {
                *place = cluster;
            }
        };
        for place in self.places {
            let one = &now[place];
            match fate(partners, place) {
                Fate::Alone => keep(*one),
                Fate::Gone => {}
                Fate::Joins(other) => {
                    let other = &now[other];
                    free -= 2;
                    self.nodes[free..free + 2].copy_from_slice(&[one.node(), other.node()]);
                    keep(one.parent(other, (self.first_node + free) as u32));
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use obvhs::bvh2::Bvh2;
    use obvhs::ploc::{PlocBuilder, SortPrecision};
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    /// Boxes in the order of their Morton codes. If `rough`, sizes and places repeat, so that areas tie.
    fn boxes(count: u32, rough: bool) -> Vec<Bvh2Node> {
        let mut rng = Pcg64Mcg::seed_from_u64(7);
        let mut number = || if rough { rng.random_range(0..32) as f32 / 64.0 } else { rng.random_range(0.0..0.5) };
        let mut leaves: Vec<Bvh2Node> = (0..count)
            .map(|i| {
                let low = Vec3A::from_array([0; 3].map(|_| number()));
                Bvh2Node::new(Aabb::new(low, low + Vec3A::from_array([0; 3].map(|_| number() * 0.1))), 1, i)
            })
            .collect();
        let code = |leaf: &Bvh2Node| obvhs::ploc::morton::morton_encode_u64_unorm(leaf.aabb().center().as_dvec3());
        leaves.sort_by_key(code);
        leaves
    }

    fn clusters(leaves: &[Bvh2Node]) -> Pages<Cluster> {
        let mut clusters = Pages::zeroed(leaves.len());
        for (cluster, leaf) in clusters.iter_mut().zip(leaves) {
            let Aabb { min, max } = *leaf.aabb();
            *cluster = Cluster::leaf([min.to_array(), max.to_array()], leaf.first_index);
        }
        clusters
    }

    #[test]
    fn trees_are_those_of_obvhs_node_by_node() {
        for count in [1, 2, 3, 7, 127, 128, 129, 4095, 4097, 20_000] {
            for rough in [false, true] {
                let leaves = boxes(count, rough);
                macro_rules! compare {
                    ($($distance: literal),*) => {$(
                        for short in [0, 2] {
                            let mut theirs = Bvh2::zeroed(leaves.len());
                            let mut builder = PlocBuilder { current_nodes: leaves.clone(), ..PlocBuilder::default() };
                            let all = Aabb::new(Vec3A::ZERO, Vec3A::ONE);
                            builder.build_ploc_from_leaves::<$distance, false>(&mut theirs, all, SortPrecision::U64, short);
                            let (ours, rounds) = join(clusters(&leaves), $distance, short);
                            let text = |nodes: &[Bvh2Node]| nodes.iter().map(|node| format!("{node:?}")).collect::<Vec<_>>();
                            assert_eq!(text(&ours), text(&theirs.nodes), "{count} {rough} {} {short}", $distance);
                            assert!(theirs.max_depth == 96.max(rounds + 1));
                        }
                    )*};
                }
                compare!(1, 2, 6, 14, 32);
            }
        }
    }
}
