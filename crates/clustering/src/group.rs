//! Clusters a group: the triangles of one material in one voxel.

use crate::Cluster;
use crate::connected::{Connector, Group};
use crate::greedy::{Classes, Facet, Rule, classify};
use crate::grid::Mesh;
use crate::params::{ClusterParams, Connection, Grouping, Insertion, Order};
use crate::small_groups::{Batch, SmallGroups};
use crate::triangle_normals::{MAX_SMALL, Members, Surface};

/// The scratch space of one thread for clustering groups. Triangles are identified by their index in the group.
#[derive(Default)]
pub(crate) struct Scratch {
    small: SmallGroups,
    facets: Vec<Facet>,
    classes: Classes,
    class: Vec<u32>,
    kept: Vec<u32>,
    connector: Connector,
}

/// The clustering parameters in the form that [`Scratch::cluster`] uses.
#[derive(Clone, Copy)]
pub(crate) struct GroupRule {
    grouping: Grouping,
    weld: bool,
    rule: Rule,
    /// True if every triangle keeps its cluster in the group, as with insertion by centroid.
    keeps_all: bool,
}

impl GroupRule {
    pub(crate) fn new(params: &ClusterParams) -> Self {
        let keeps_all = params.insertion == Insertion::Centroid;
        let weld = params.connection == Connection::Place;
        Self { grouping: params.grouping, weld, rule: Rule::new(params), keeps_all }
    }

    /// Tests if the parameters allow [`SmallGroups`], the fast path for small groups.
    fn is_plain(&self) -> bool {
        self.keeps_all && self.grouping == Grouping::Greedy && self.rule.order == Order::Canonical
    }
}

impl Scratch {
    /// Clusters a group and adds its clusters to `batch`. With insertion by bounding box, a triangle stays in its
    /// cluster only if `keeps` returns true for its index in the group.
    #[inline(always)]
    pub(crate) fn cluster(
        &mut self,
        mesh: &Mesh<'_>,
        plan: &GroupRule,
        group: Members<'_>,
        keeps: impl Fn(usize) -> bool,
        batch: &mut Batch,
    ) {
        let count = group.triangles.len();
        let common = Cluster { material: mesh.material(group.triangles[0]), group: batch.groups, ..Cluster::NONE };
        if plan.is_plain() {
            let rule = plan.rule;
            let done = match count {
                0..=8 => self.small.cluster::<8>(rule, group, common, batch),
                9..=16 => self.small.cluster::<16>(rule, group, common, batch),
                17..=32 => self.small.cluster::<32>(rule, group, common, batch),
                33..=64 => self.small.cluster::<64>(rule, group, common, batch),
                65..=128 => self.small.cluster::<128>(rule, group, common, batch),
                129..=MAX_SMALL => self.small.cluster::<MAX_SMALL>(rule, group, common, batch),
                _ => false,
            };
            if done {
                return;
            }
        }
        self.classify(mesh, plan, group);
        let clusters = batch.clusters.len();
        for members in self.classes.iter() {
            let members = if plan.keeps_all {
                members
            } else {
                self.kept.clear();
                self.kept.extend(members.iter().copied().filter(|&i| keeps(i as usize)));
                &self.kept
            };
            if members.is_empty() {
                batch.phantoms += 1;
                continue;
            }
            batch.members.extend(members.iter().map(|&i| group.triangles[i as usize]));
            batch.clusters.push(measure(group, members, plan.rule.steep, common));
        }
        batch.groups += u32::from(batch.clusters.len() > clusters);
    }

    /// Sorts the triangles of a group into `self.classes`: sets of similar normals, or their connected pieces.
    fn classify(&mut self, mesh: &Mesh<'_>, plan: &GroupRule, group: Members<'_>) {
        self.facets.clear();
        let facet = |number| Facet { normal: group.normals.of(number), number: number as u32 };
        self.facets.extend((0..group.triangles.len()).map(facet));
        // Flat triangles are rare, so the loop above needs no branches.
        let flat = (0..group.triangles.len()).fold(false, |any, i| any | group.normals.is_flat(i));
        if flat {
            self.facets.retain(|facet| !group.normals.is_flat(facet.number as usize));
        }
        classify(&mut self.facets, plan.rule, &mut self.classes);
        if plan.grouping == Grouping::Connected {
            self.cut(Group { mesh, triangles: group.triangles, weld: plan.weld, order: plan.rule.order });
        } else if flat {
            // Without a normal, a triangle fits the first cluster.
            self.classes.join_first((0..group.triangles.len()).filter(|&i| group.normals.is_flat(i)));
        }
    }

    /// Cuts `self.classes` (sets of triangles with similar normals) into their connected pieces.
    fn cut(&mut self, group: Group<'_>) {
        self.class.clear();
        self.class.resize(group.triangles.len(), u32::MAX);
        for (number, members) in (0..).zip(self.classes.iter()) {
            for &member in members {
                self.class[member as usize] = number;
            }
        }
        let pieces = self.connector.cut(group, &mut self.class, self.classes.len() as u32);
        self.classes.sort(&self.class, pieces);
    }
}

/// Makes a cluster from its members: their bounds, area, mean normal and cone.
fn measure(group: Members<'_>, members: &[u32], steep: f32, common: Cluster) -> Cluster {
    let numbers = || members.iter().map(|&i| i as usize);
    let mut sum = Surface::NOTHING;
    let lead = numbers().find(|&i| !group.normals.is_flat(i)).map_or([0.0, 0.0, 1.0], |i| group.normals.of(i));
    if lead[2] >= steep {
        for i in numbers() {
            sum = sum.and(group.surfaces[i]);
        }
    } else {
        for i in numbers() {
            sum = sum.and(group.surfaces[i].turned(group.normals.dot(i, lead) < 0.0));
        }
    }
    let normal = sum.normal();
    let cone = cone(normal, numbers().map(|i| group.normals.cosine(i, normal)), steep > f32::NEG_INFINITY);
    Cluster { triangles: members.len() as u32, normal, cone, ..sum.cluster(common) }
}

/// The smallest of `cosines`, those between `normal` and its cluster's triangles; -1 if `normal` is zero. If `both`,
/// absolute values count.
fn cone(normal: [f32; 3], cosines: impl Iterator<Item = f32>, both: bool) -> f32 {
    if normal == [0.0; 3] {
        return -1.0;
    }
    let mut cone = 1.0_f32;
    for cosine in cosines {
        let cosine = if both { cosine.abs() } else { cosine };
        cone = if cosine < cone { cosine } else { cone };
    }
    cone.max(-1.0)
}
