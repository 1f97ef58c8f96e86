//! From the triangles of one voxel and material to their clusters.

use crate::Cluster;
use crate::connected::{Connector, Group};
use crate::few::{FEW, Few, FirstFit};
use crate::greedy::{Classes, Facet, Rule, classify};
use crate::grid::Mesh;
use crate::params::{Grouping, Insertion, Order, Params};
use crate::surface::{Normals, Surface};

/// Clusters of some voxels, numbered from 0.
#[derive(Default)]
pub(crate) struct Batch {
    /// Triangles, cluster after cluster, ascending in each.
    pub(crate) members: Vec<u32>,
    pub(crate) clusters: Vec<Cluster>,
    /// Groups with a cluster.
    pub(crate) groups: u32,
    /// Voxels with a triangle.
    pub(crate) voxels: u64,
    /// Triangles put into the fullest voxel.
    pub(crate) fullest: u32,
    /// Clusters that kept no triangle.
    pub(crate) phantoms: u64,
}

/// A voxel's triangles of one material, ascending, and what is known of each.
#[derive(Clone, Copy)]
pub(crate) struct Members<'a> {
    pub(crate) triangles: &'a [u32],
    pub(crate) surfaces: &'a [Surface],
    pub(crate) normals: Normals<'a>,
}

/// What one thread needs to make batches: the arrays are by number in the group.
#[derive(Default)]
pub(crate) struct Scratch {
    few: Few,
    facets: Vec<Facet>,
    classes: Classes,
    class: Vec<u32>,
    kept: Vec<u32>,
    connector: Connector,
}

/// Parameters, as groups want them.
#[derive(Clone, Copy)]
pub(crate) struct Plan {
    grouping: Grouping,
    weld: bool,
    rule: Rule,
    steep: f32,
    /// Whether all triangles of a group have their clusters there.
    keeps_all: bool,
}

impl Plan {
    pub(crate) fn new(params: &Params) -> Self {
        let keeps_all = params.insertion == Insertion::Centroid;
        let rule = Rule::new(params);
        Self { grouping: params.grouping, weld: params.weld, rule, steep: steep(params), keeps_all }
    }

    /// Whether [`Few`] will do.
    fn is_plain(&self) -> bool {
        self.keeps_all && self.grouping == Grouping::Greedy && self.rule.order == Order::Canonical
    }
}

impl Scratch {
    /// Clusters a group and adds them to a batch. Only triangles that `keeps` says (by number in the group) have their
    /// cluster here count.
    #[inline(always)]
    pub(crate) fn cluster(
        &mut self,
        mesh: &Mesh<'_>,
        plan: &Plan,
        group: Members<'_>,
        keeps: impl Fn(usize) -> bool,
        batch: &mut Batch,
    ) {
        let count = group.triangles.len();
        let common = Cluster { material: mesh.material(group.triangles[0]), group: batch.groups, ..Cluster::NONE };
        if plan.is_plain() {
            let rule = FirstFit { cosine: plan.rule.cosine, two_sided: plan.rule.two_sided, steep: plan.steep };
            let done = match count {
                0..=8 => self.few.cluster::<8>(rule, group, common, batch),
                9..=16 => self.few.cluster::<16>(rule, group, common, batch),
                17..=32 => self.few.cluster::<32>(rule, group, common, batch),
                33..=64 => self.few.cluster::<64>(rule, group, common, batch),
                65..=128 => self.few.cluster::<128>(rule, group, common, batch),
                129..=FEW => self.few.cluster::<FEW>(rule, group, common, batch),
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
            batch.clusters.push(measure(group, members, plan.steep, common));
        }
        batch.groups += u32::from(batch.clusters.len() > clusters);
    }

    /// Fills `classes`.
    fn classify(&mut self, mesh: &Mesh<'_>, plan: &Plan, group: Members<'_>) {
        self.facets.clear();
        let facet = |number| Facet { normal: group.normals.of(number), number: number as u32 };
        self.facets.extend((0..group.triangles.len()).map(facet));
        // Rare, so that the loop above is without branches.
        let flat = (0..group.triangles.len()).fold(false, |any, i| any | group.normals.is_flat(i));
        if flat {
            self.facets.retain(|facet| !group.normals.is_flat(facet.number as usize));
        }
        classify(&mut self.facets, plan.rule, &mut self.classes);
        if plan.grouping == Grouping::Connected {
            self.cut(Group { mesh, triangles: group.triangles, weld: plan.weld, order: plan.rule.order });
        } else if flat {
            // No normal contradicts any: into the first cluster.
            self.classes.join_first((0..group.triangles.len()).filter(|&i| group.normals.is_flat(i)));
        }
    }

    /// Cuts classes into their connected pieces.
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

impl Cluster {
    /// No triangles.
    pub(crate) const NONE: Self =
        Self { triangles: 0, bounds: [[0.0; 3]; 2], area: 0.0, normal: [0.0; 3], cone: -1.0, material: 0, group: 0 };
}

/// From this z on, a two-sided normal has none of its cluster on its other side: they point upwards, and lines of a cluster
/// are at most twice the angle apart. Infinite where no z says so; below any z where sides are told apart anyway.
fn steep(params: &Params) -> f32 {
    /// Room for the rounding of normals, of products and of the angle.
    const SLACK: f64 = 1e-3;
    match (params.two_sided, 2.0 * params.angle.to_radians()) {
        (false, _) => f32::NEG_INFINITY,
        (true, angle) if angle < std::f64::consts::FRAC_PI_2 => (angle.sin() + SLACK) as f32,
        (true, _) => f32::INFINITY,
    }
}

/// A cluster with all that is known of its members filled in.
fn measure(group: Members<'_>, members: &[u32], steep: f32, common: Cluster) -> Cluster {
    let numbers = || members.iter().map(|&i| i as usize);
    let mut sum = Surface::NOTHING;
    let lead = numbers().find(|&i| !group.normals.is_flat(i)).map_or([0.0, 0.0, 1.0], |i| group.normals.of(i));
    if lead[2] >= steep {
        for i in numbers() {
            sum.add(&group.surfaces[i]);
        }
    } else {
        for i in numbers() {
            sum.add(&group.surfaces[i].turned(group.normals.dot(i, lead) < 0.0));
        }
    }
    let normal = sum.normal();
    let cone = cone(normal, numbers().map(|i| group.normals.cosine(i, normal)), steep > f32::NEG_INFINITY);
    Cluster { triangles: members.len() as u32, normal, cone, ..sum.cluster(common) }
}

/// The smallest cosine between a normal and members'; -1 where the normal is zero.
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
