//! From the triangles of one voxel and material to their clusters.

use crate::Cluster;
use crate::connected::{Connector, Group};
use crate::greedy::{Classes, Facet, Rule, classify};
use crate::grid::{Bounds, Mesh};
use crate::params::{Grouping, Insertion, Params};
use crate::surface::{Normal, Surface, is_flat};

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
    pub(crate) normals: &'a [Normal],
}

/// What one thread needs to make batches: the arrays are by number in the group.
#[derive(Default)]
pub(crate) struct Scratch {
    facets: Vec<Facet>,
    classes: Classes,
    class: Vec<u32>,
    kept: Vec<u32>,
    connector: Connector,
}

impl Scratch {
    /// Clusters a group and adds them to a batch. Only triangles that `keeps` says (by number in the group) have their
    /// cluster here count.
    pub(crate) fn cluster(
        &mut self,
        mesh: &Mesh<'_>,
        params: &Params,
        group: Members<'_>,
        keeps: impl Fn(usize) -> bool,
        batch: &mut Batch,
    ) {
        let steep = steep(params);
        let keeps_all = params.insertion == Insertion::Centroid;
        let common = Cluster { material: mesh.material(group.triangles[0]), group: batch.groups, ..Cluster::NONE };
        self.classify(mesh, params, group);
        if self.classes.len() == 1 && keeps_all {
            batch.members.extend_from_slice(group.triangles);
            batch.clusters.push(measure(group, 0..group.triangles.len(), steep, common));
            batch.groups += 1;
            return;
        }
        let clusters = batch.clusters.len();
        for members in self.classes.iter() {
            let members = if keeps_all {
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
            batch.clusters.push(measure(group, members.iter().map(|&i| i as usize), steep, common));
        }
        batch.groups += u32::from(batch.clusters.len() > clusters);
    }

    /// Fills `classes`.
    fn classify(&mut self, mesh: &Mesh<'_>, params: &Params, group: Members<'_>) {
        self.facets.clear();
        let facet = |(&[x, y, z, _], number): (&Normal, u32)| Facet { normal: [x, y, z], number };
        self.facets.extend(group.normals.iter().zip(0..).map(facet));
        // Rare, so that the loop above is without branches.
        let flat = group.normals.iter().fold(false, |any, &normal| any | is_flat(normal));
        if flat {
            self.facets.retain(|facet| !is_flat(group.normals[facet.number as usize]));
        }
        classify(&mut self.facets, Rule::new(params), &mut self.classes);
        if params.grouping == Grouping::Connected {
            self.cut(Group { mesh, triangles: group.triangles, weld: params.weld, order: params.order });
        } else if flat {
            // No normal contradicts any: into the first cluster.
            let flat = (0..).zip(group.normals).filter(|&(_, &normal)| is_flat(normal)).map(|(number, _)| number);
            self.classes.join_first(flat);
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
    const NONE: Self =
        Self { triangles: 0, bounds: [[0.0; 3]; 2], area: 0.0, normal: [0.0; 3], cone: -1.0, material: 0, group: 0 };
}

/// From this z on, a normal's cluster has none on its other side: two-sided normals point upwards, and within a cluster
/// lines are at most twice the angle apart. Above 1 where no z says so, below where sides differ anyway.
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
fn measure(
    group: Members<'_>,
    members: impl ExactSizeIterator<Item = usize> + Clone,
    steep: f32,
    common: Cluster,
) -> Cluster {
    let mut sum = [0.0_f64; 4];
    let mut bounds = Bounds::NOTHING;
    let lead = members.clone().map(|i| group.normals[i]).find(|&normal| !is_flat(normal));
    let lead = lead.unwrap_or([0.0, 0.0, 1.0, 0.0]);
    if lead[2] >= steep {
        for i in members.clone() {
            let surface = &group.surfaces[i];
            for lane in 0..4 {
                sum[lane] += surface.weighted[lane];
            }
            bounds.unite(surface.bounds);
        }
    } else {
        for i in members.clone() {
            let surface = &group.surfaces[i];
            let side = if dot(lead, group.normals[i]) < 0.0 { -1.0 } else { 1.0 };
            let sides = [side, side, side, 1.0];
            for lane in 0..4 {
                sum[lane] += sides[lane] * surface.weighted[lane];
            }
            bounds.unite(surface.bounds);
        }
    }
    let triangles = members.len() as u32;
    let normal = unit(sum);
    let both = steep > f32::NEG_INFINITY;
    let cone = cone(normal, members.map(|i| group.normals[i]), both);
    Cluster { triangles, bounds: bounds.corners(), area: 0.5 * sum[3], normal, cone, ..common }
}

/// The smallest cosine between a normal and members'; -1 where the normal is zero.
fn cone(normal: [f32; 3], members: impl Iterator<Item = Normal>, both: bool) -> f32 {
    if normal == [0.0; 3] {
        return -1.0;
    }
    // Members without a normal deviate from none.
    let normal = [normal[0], normal[1], normal[2], 1.0];
    let mut cone = 1.0_f32;
    for member in members {
        let cosine = dot(normal, member) + member[3];
        let cosine = if both { cosine.abs() } else { cosine };
        cone = if cosine < cone { cosine } else { cone };
    }
    cone.max(-1.0)
}

#[inline]
fn dot(a: Normal, b: Normal) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// A sum of weighted unit vectors, and that of the weights, made a unit vector; zero where they cancel but for rounding.
fn unit([x, y, z, weight]: [f64; 4]) -> [f32; 3] {
    let length = (x * x + y * y + z * z).sqrt();
    // Normals are known to 2^-24 or so.
    const CANCELLED: f64 = 1e-6;
    if length <= CANCELLED * weight {
        return [0.0; 3];
    }
    let inverse = 1.0 / length;
    [x, y, z].map(|x| (x * inverse) as f32)
}
