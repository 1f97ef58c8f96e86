//! Common cuts of clusters [after Wang et al. 2011]: nearby points start from the same cut, and refine it.
//!
//! Clusters are the patches of radiosity. Before the first sample, cuts are computed for some points that the camera sees. The
//! common cut of a cluster consists of the groups that none of the cluster's points divides. Rendering never visits groups
//! above it.

use super::{CutLight, Lit, Member, NodeId, Refinement};
use crate::patches::Patches;
pub(super) use crate::walk::grid;
use dapple_core::{Frame, parallel};
use dapple_renderer::{GatherPoint, World};
use std::collections::BTreeMap;

/// The mean number of first-hit rays per cluster, over the clusters that the camera sees.
const FIRST_HITS: u32 = 4;

/// The common cuts of clusters, one for each side of a cluster.
#[derive(Clone, Debug)]
pub(super) struct CommonCuts {
    patches: Patches,
    /// The start index in `nodes` of each side's cut. Sides that no first-hit ray hit have an empty cut.
    starts: Vec<u32>,
    nodes: Vec<NodeId>,
}

impl CommonCuts {
    /// Returns the common cut at a surface point; empty if no first-hit ray hit that side of its cluster.
    pub(super) fn at(&self, world: &World, vertex: &GatherPoint<'_>) -> &[NodeId] {
        let key = self.patches.side_at(world, vertex.at, vertex.back);
        &self.nodes[self.starts[key] as usize..self.starts[key + 1] as usize]
    }
}

impl CutLight<'_> {
    /// Computes the common cuts of clusters from the cuts of first-hit rays. Returns them with the number of rays traced.
    pub(super) fn common_cuts(&self, patches: Patches, frame: &Frame) -> (CommonCuts, u64) {
        let side = f64::from(FIRST_HITS * self.options.clusters).sqrt().ceil() as u32;
        let mut first_hits: BTreeMap<usize, Vec<[u32; 2]>> = BTreeMap::new();
        for pixel in grid(frame, side) {
            let side = |vertex: &GatherPoint<'_>| patches.side_at(self.world, vertex.at, vertex.back);
            if let Some(key) = self.at_first_hit(pixel, side) {
                first_hits.entry(key).or_default().push(pixel);
            }
        }
        let first_hits: Vec<(usize, Vec<[u32; 2]>)> = first_hits.into_iter().collect();
        let cuts: Vec<(Vec<NodeId>, u64)> = parallel::map(first_hits.len(), |k| self.common_cut(&first_hits[k].1));
        let (mut starts, mut nodes, mut rays) = (vec![0], Vec::new(), u64::from(side * side));
        for ((key, _), (cut, more)) in first_hits.iter().zip(cuts) {
            starts.resize(key + 1, nodes.len() as u32);
            nodes.extend(cut);
            rays += more;
        }
        starts.resize(2 * patches.areas.len() + 1, nodes.len() as u32);
        (CommonCuts { patches, starts, nodes }, rays)
    }

    /// Returns the groups that are not divided in the cut of any of these pixels' first hits, and the number of rays traced.
    fn common_cut(&self, pixels: &[[u32; 2]]) -> (Vec<NodeId>, u64) {
        let (mut common, mut rays, mut made): (Option<Vec<NodeId>>, u64, _) = (None, 0, Refinement::default());
        for pixel in pixels {
            let traced = self.at_first_hit(*pixel, |vertex| self.cut(&Lit::new(vertex, 0), &[], &mut made).rays);
            rays += 1 + u64::from(traced.unwrap_or_default());
            let mut cut: Vec<NodeId> = made.members.iter().map(|member: &Member| member.id).collect();
            cut.sort_unstable();
            common = Some(match common {
                None => cut,
                Some(before) => self.upper([&before, &cut]),
            });
        }
        (common.unwrap_or_default(), rays)
    }

    /// Returns the coarser combination of two sorted cuts: where they differ, the node nearer to the root. The result is
    /// sorted.
    fn upper(&self, cuts: [&[NodeId]; 2]) -> Vec<NodeId> {
        let (mut waiting, mut found): (Vec<NodeId>, _) = (self.roots().collect(), Vec::new());
        while let Some(id) = waiting.pop() {
            match self.trees[id.tree as usize].nodes[id.node as usize].children {
                Some(children) if cuts.iter().all(|cut| cut.binary_search(&id).is_err()) => {
                    waiting.extend(children.map(|node| NodeId { node, ..id }));
                }
                _ => found.push(id),
            }
        }
        found.sort_unstable();
        found
    }
}
