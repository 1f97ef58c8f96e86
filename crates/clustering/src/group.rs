//! From the triangles of one voxel and material to their clusters.

use crate::Cluster;
use crate::connected::{Connector, Group};
use crate::greedy::{Facet, Rule, classify};
use crate::grid::{Bounds, Mesh};
use crate::params::{Grouping, Insertion, Params};

/// A triangle whose edges span less than this (the sine between them) has no normal: `f32` coordinates make one by
/// rounding even of three points on a line, in f64 arithmetic some `2^-52`.
const FLAT: f64 = 1.0 / (1_u64 << 46) as f64;

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

/// What one thread needs to make batches: the arrays are by number in the group.
#[derive(Default)]
pub(crate) struct Scratch {
    /// Unit normals, with areas doubled.
    surfaces: Vec<Surface>,
    facets: Vec<Facet>,
    class: Vec<u32>,
    starts: Vec<u32>,
    sorted: Vec<u32>,
    kept: Vec<u32>,
    connector: Connector,
}

/// A triangle's unit normal, zero where it has none, and its doubled area.
#[derive(Clone, Copy, Default)]
pub(crate) struct Surface {
    pub(crate) normal: [f32; 3],
    pub(crate) doubled: f64,
}

impl Surface {
    #[inline]
    pub(crate) fn of(corners: [[f32; 4]; 3]) -> Self {
        let [a, b, c] = corners.map(|corner| corner.map(f64::from));
        let u = [b[0] - a[0], b[1] - a[1], b[2] - a[2]];
        let v = [c[0] - a[0], c[1] - a[1], c[2] - a[2]];
        let n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
        let square = |a: [f64; 3]| a[0] * a[0] + a[1] * a[1] + a[2] * a[2];
        let squared = square(n);
        if squared <= FLAT * FLAT * (square(u) * square(v)) {
            return Self::default();
        }
        let doubled = squared.sqrt();
        let inverse = 1.0 / doubled;
        Self { normal: n.map(|x| (x * inverse) as f32), doubled }
    }
}

/// The normal itself or its opposite, whichever has z > 0 (or, of z = 0, y > 0, and so on).
#[inline]
fn upper(n: [f32; 3]) -> [f32; 3] {
    // Without branches: of a closed surface, half the normals point either way.
    let negative = (n[2] < 0.0) | ((n[2] == 0.0) & ((n[1] < 0.0) | ((n[1] == 0.0) & (n[0] < 0.0))));
    let sign = if negative { -1.0 } else { 1.0 };
    n.map(|x| sign * x)
}

impl Scratch {
    /// Clusters a group and adds them to a batch. Only triangles that `keeps` says have their cluster here count.
    pub(crate) fn cluster(
        &mut self,
        mesh: &Mesh<'_>,
        params: &Params,
        triangles: &[u32],
        keeps: impl Fn(u32) -> bool,
        batch: &mut Batch,
    ) {
        self.load(mesh, params, triangles);
        let classes = self.classify(mesh, params, triangles);
        self.sort_by_class(classes);
        let keeps_all = params.insertion == Insertion::Centroid;
        let clusters = batch.clusters.len();
        for number in 0..classes as usize {
            let members = &self.sorted[self.starts[number] as usize..self.starts[number + 1] as usize];
            let members = if keeps_all {
                members
            } else {
                self.kept.clear();
                self.kept.extend(members.iter().copied().filter(|&i| keeps(triangles[i as usize])));
                &self.kept
            };
            if members.is_empty() {
                batch.phantoms += 1;
                continue;
            }
            batch.members.extend(members.iter().map(|&i| triangles[i as usize]));
            let cluster = measure(mesh, triangles, &self.surfaces, members, params.two_sided);
            batch.clusters.push(Cluster { group: batch.groups, ..cluster });
        }
        batch.groups += u32::from(batch.clusters.len() > clusters);
    }

    /// Normals and areas, and the facets of all that have a normal.
    fn load(&mut self, mesh: &Mesh<'_>, params: &Params, triangles: &[u32]) {
        self.surfaces.clear();
        self.surfaces.extend(triangles.iter().map(|&triangle| {
            let surface = Surface::of(mesh.corners(triangle));
            Surface { normal: if params.two_sided { upper(surface.normal) } else { surface.normal }, ..surface }
        }));
        self.facets.clear();
        let facet = |(surface, number): (&Surface, u32)| Facet { normal: surface.normal, number };
        self.facets.extend(self.surfaces.iter().zip(0..).map(facet));
        // Rare, so that the loops above are without branches.
        if self.surfaces.iter().any(|surface| surface.doubled == 0.0) {
            self.facets.retain(|facet| facet.normal != [0.0; 3]);
        }
    }

    /// Fills `class`; how many there are.
    fn classify(&mut self, mesh: &Mesh<'_>, params: &Params, triangles: &[u32]) -> u32 {
        self.class.clear();
        self.class.resize(triangles.len(), u32::MAX);
        let flat = self.facets.len() < triangles.len();
        let classes = classify(&mut self.facets, Rule::new(params), &mut self.class);
        if params.grouping == Grouping::Connected {
            let group = Group { mesh, triangles, weld: params.weld, order: params.order };
            return self.connector.cut(group, &mut self.class, classes);
        }
        if flat {
            // No normal contradicts any: into the first cluster.
            for class in &mut self.class {
                *class = if *class == u32::MAX { 0 } else { *class };
            }
        }
        classes.max(1)
    }

    /// Fills `sorted` with the numbers in the group by class, ascending in each, and `starts`.
    fn sort_by_class(&mut self, classes: u32) {
        self.starts.clear();
        self.starts.resize(classes as usize + 2, 0);
        for &class in &self.class {
            self.starts[class as usize + 2] += 1;
        }
        for i in 2..self.starts.len() {
            self.starts[i] += self.starts[i - 1];
        }
        self.sorted.clear();
        self.sorted.resize(self.class.len(), 0);
        for (number, &class) in self.class.iter().enumerate() {
            let slot = &mut self.starts[class as usize + 1];
            self.sorted[*slot as usize] = number as u32;
            *slot += 1;
        }
    }
}

/// What is known of a cluster but its group.
fn measure(mesh: &Mesh<'_>, triangles: &[u32], surfaces: &[Surface], members: &[u32], two_sided: bool) -> Cluster {
    let mut doubled = 0.0;
    let mut sum = [0.0_f64; 3];
    let mut lead = [0.0_f32; 3];
    for &i in members {
        let surface = surfaces[i as usize];
        doubled += surface.doubled;
        let aligned = if two_sided && dot(lead, surface.normal) < 0.0 { -surface.doubled } else { surface.doubled };
        if lead == [0.0; 3] {
            lead = surface.normal;
        }
        for (sum, x) in sum.iter_mut().zip(surface.normal) {
            *sum += aligned * f64::from(x);
        }
    }
    let normal = unit(sum, doubled);
    Cluster {
        triangles: members.len() as u32,
        bounds: box_of(mesh, triangles, members).corners(),
        area: 0.5 * doubled,
        normal,
        cone: cone(normal, surfaces, members, two_sided),
        material: mesh.material(triangles[members[0] as usize]),
        group: 0,
    }
}

/// The box of some triangles. Out of line, so that all four lanes are computed, which is faster than three.
#[inline(never)]
fn box_of(mesh: &Mesh<'_>, triangles: &[u32], members: &[u32]) -> Bounds {
    let mut bounds = Bounds::NOTHING;
    for &i in members {
        for corner in mesh.corners(triangles[i as usize]) {
            bounds.hold(corner);
        }
    }
    bounds
}

/// The smallest cosine between a normal and members'; -1 where the normal is zero.
fn cone(normal: [f32; 3], surfaces: &[Surface], members: &[u32], two_sided: bool) -> f32 {
    if normal == [0.0; 3] {
        return -1.0;
    }
    let mut cone = 1.0_f32;
    for &i in members {
        let surface = surfaces[i as usize];
        let cosine = dot(normal, surface.normal);
        let cosine = if two_sided { cosine.abs() } else { cosine };
        // Members without a normal deviate from none.
        let cosine = if surface.doubled == 0.0 { 1.0 } else { cosine };
        cone = if cosine < cone { cosine } else { cone };
    }
    cone.max(-1.0)
}

#[inline]
fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// A sum of weighted unit vectors made a unit vector; zero where they cancel but for rounding.
fn unit(sum: [f64; 3], weight: f64) -> [f32; 3] {
    let length = (sum[0] * sum[0] + sum[1] * sum[1] + sum[2] * sum[2]).sqrt();
    // Normals are known to 2^-24 or so.
    const CANCELLED: f64 = 1e-6;
    if length <= CANCELLED * weight {
        return [0.0; 3];
    }
    sum.map(|x| (x / length) as f32)
}
