//! Common cuts of clusters [after Wang et al. 2011]: points near each other start from the same cut, and refine it.
//!
//! Clusters are the patches of radiosity. Some points that the camera sees have their cuts made before the first sample.
//! The common cut of a cluster holds the groups that no such point of it divides. Groups above are never visited again.

use super::{CutLight, Lit, Member, NodeId, Refinement};
use crate::patches::Patches;
pub(super) use crate::walk::grid;
use dapple_core::{Frame, parallel};
use dapple_renderer::{GatherPoint, World};
use std::collections::BTreeMap;

/// First-hit rays for each cluster, on average over those that the camera sees.
const FIRST_HITS: u32 = 4;

/// The common cuts of clusters, one for each side of each.
#[derive(Clone, Debug)]
pub(super) struct CommonCuts {
    patches: Patches,
    /// The place in `nodes` where the cut of each side begins. Sides that no first-hit ray met have an empty cut.
    starts: Vec<u32>,
    nodes: Vec<NodeId>,
}

impl CommonCuts {
    /// The common cut at a surface point, empty where no first hit lay.
    pub(super) fn at(&self, world: &World, vertex: &GatherPoint<'_>) -> &[NodeId] {
        let key = self.patches.side_at(world, vertex.at, vertex.back);
        &self.nodes[self.starts[key] as usize..self.starts[key + 1] as usize]
    }
}

impl CutLight<'_> {
    /// Makes the common cuts of clusters from the cuts at first hits. Returns them with the number of rays.
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

    /// The groups that none of the points behind these pixels divides.
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

    /// The cut that takes the upper node of two sorted cuts everywhere, sorted.
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
