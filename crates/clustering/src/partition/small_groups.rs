//! A fast path of the default grouping for groups of up to 256 triangles (of one material in a voxel), with vector lanes and no
//! branch per triangle.
//!
//! Most groups of fine grids are small. For these, a mispredicted branch costs more than idle lanes.

use crate::Cluster;
use crate::partition::greedy::Rule;
use crate::partition::triangle_normals::{Members, Surface};

/// The largest number of classes of similar normals in a group that is clustered in vector lanes. Each class needs a pass over
/// all lanes, and a group with more classes must be clustered again by the general method.
const MAX_CLASSES: usize = 64;

/// The clusters of a range of voxels, with groups numbered from 0.
#[derive(Default)]
pub(crate) struct Batch {
    /// The indices of triangles, cluster by cluster, ascending within each cluster.
    pub(crate) members: Vec<u32>,
    pub(crate) clusters: Vec<Cluster>,
    /// The number of groups (one voxel's triangles of one material) that have a cluster.
    pub(crate) groups: u32,
    /// The number of voxels with at least one triangle.
    pub(crate) voxels: u64,
    /// The number of triangles in the fullest voxel.
    pub(crate) fullest: u32,
    /// The number of clusters that kept no triangle and were dropped.
    pub(crate) phantoms: u64,
}

/// The scratch space of one thread for small groups.
#[derive(Default)]
pub(crate) struct SmallGroups {
    parts: Vec<Part>,
    sorted: Vec<u32>,
}

/// The sums and the results of one class of triangles with similar normals.
#[derive(Clone, Copy)]
struct Part {
    sum: Surface,
    triangles: u32,
    /// The index in `sorted` at which the next triangle of the class is stored.
    next: u32,
    /// The normal of the class's first triangle.
    lead: [f32; 3],
    normal: [f32; 3],
    cone: f32,
}

impl Part {
    const NOTHING: Self =
        Self { sum: Surface::NOTHING, triangles: 0, next: 0, lead: [0.0; 3], normal: [0.0; 3], cone: 1.0 };
}

impl SmallGroups {
    /// Clusters a group of at most N triangles and adds its clusters to `batch`. Returns `false` and does nothing if some
    /// triangles have no normal or there are too many classes.
    #[inline(always)]
    pub(crate) fn cluster<const N: usize>(
        &mut self,
        rule: Rule,
        group: Members<'_>,
        common: Cluster,
        batch: &mut Batch,
    ) -> bool {
        let count = group.triangles.len();
        let Some(axes) = group.normals.first::<N>() else { return false };
        if group.normals.flat[..count].iter().fold(false, |any, &flat| any | (flat != 0.0)) {
            return false;
        }
        let mut class = [0; N];
        let classes = if count == 1 {
            1
        } else if rule.two_sided {
            classify::<N, true>(axes, count, rule.cosine, &mut class)
        } else {
            classify::<N, false>(axes, count, rule.cosine, &mut class)
        };
        if classes > MAX_CLASSES {
            return false;
        }
        if classes == 1 {
            batch.members.extend_from_slice(group.triangles);
            batch.clusters.push(one_class(rule, group, axes, common));
            batch.groups += 1;
            return true;
        }
        self.parts.clear();
        self.parts.resize(classes, Part::NOTHING);
        let lowest = axes[2][..count].iter().fold(f32::INFINITY, |low, &z| if z < low { z } else { low });
        self.sum(group, &class[..count], lowest < rule.steep);
        self.finish(group, &class[..count], rule.two_sided);
        batch.members.extend_from_slice(&self.sorted);
        batch.clusters.extend(self.parts.iter().map(|part| {
            let zero = part.normal == [0.0; 3];
            let cone = if zero { -1.0 } else { part.cone.max(-1.0) };
            Cluster { triangles: part.triangles, normal: part.normal, cone, ..part.sum.cluster(common) }
        }));
        batch.groups += 1;
        true
    }

    /// Sums the normals, areas and boxes of each class. If `sides` is `true`, each normal is first flipped to the side of its
    /// class's first normal.
    #[inline(always)]
    fn sum(&mut self, group: Members<'_>, class: &[u32], sides: bool) {
        if !sides {
            for (surface, &class) in group.surfaces.iter().zip(class) {
                let part = &mut self.parts[class as usize];
                part.triangles += 1;
                part.sum = part.sum.and(*surface);
            }
            return;
        }
        for (i, (surface, &class)) in group.surfaces.iter().zip(class).enumerate() {
            let part = &mut self.parts[class as usize];
            if part.triangles == 0 {
                part.lead = group.normals.of(i);
            }
            part.triangles += 1;
            part.sum = part.sum.and(surface.turned(group.normals.dot(i, part.lead) < 0.0));
        }
    }

    /// Computes the normal and cone of each class, and sorts the triangles by class. If `both`, opposite normals are similar.
    #[inline(always)]
    fn finish(&mut self, group: Members<'_>, class: &[u32], both: bool) {
        let mut members = 0;
        for part in &mut self.parts {
            part.normal = part.sum.normal();
            part.next = members;
            members += part.triangles;
        }
        self.sorted.resize(class.len(), 0);
        for (i, &class) in class.iter().enumerate() {
            let part = &mut self.parts[class as usize];
            let dot = group.normals.dot(i, part.normal);
            let cosine = if both { dot.abs() } else { dot };
            part.cone = if cosine < part.cone { cosine } else { part.cone };
            self.sorted[part.next as usize] = group.triangles[i];
            part.next += 1;
        }
    }
}

/// Computes the cluster of a group whose triangles are all in one class.
#[inline(always)]
fn one_class<const N: usize>(rule: Rule, group: Members<'_>, [x, y, z]: [&[f32; N]; 3], common: Cluster) -> Cluster {
    let count = group.surfaces.len().min(N);
    let lowest = z[..count].iter().fold(f32::INFINITY, |low, &z| if z < low { z } else { low });
    let (lead, mut sum) = ([x[0], y[0], z[0]], Surface::NOTHING);
    for i in 0..count {
        let turned = lowest < rule.steep && x[i] * lead[0] + y[i] * lead[1] + z[i] * lead[2] < 0.0;
        sum = sum.and(group.surfaces[i].turned(turned));
    }
    let (normal, mut cone) = (sum.normal(), 1.0);
    for i in 0..count {
        let dot = x[i] * normal[0] + y[i] * normal[1] + z[i] * normal[2];
        let cosine = if rule.two_sided { dot.abs() } else { dot };
        cone = if cosine < cone { cosine } else { cone };
    }
    let cone = if normal == [0.0; 3] { -1.0 } else { cone.max(-1.0) };
    Cluster { triangles: count as u32, normal, cone, ..sum.cluster(common) }
}

/// Computes first fit in canonical order, and writes the class of each of the first `count` triangles to `class`.
/// Returns the number of classes, or `usize::MAX` if there are more than [`MAX_CLASSES`].
#[inline(always)]
fn classify<const N: usize, const TWO_SIDED: bool>(
    [x, y, z]: [&[f32; N]; 3],
    count: usize,
    cosine: f32,
    class: &mut [u32; N],
) -> usize {
    /// The key of a triangle that already has a class; below the key of any number.
    const DONE: i32 = i32::MIN;
    // Integers with the same order as z.
    let mut keys = [DONE; N];
    let mut top = DONE;
    for i in 0..N {
        keys[i] = if i < count { key(z[i]) } else { DONE };
        top = top.max(keys[i]);
    }
    let mut classes = 0;
    while top != DONE && (classes as usize) < MAX_CLASSES {
        let (first, ties) = find(&keys, top);
        let mut at = first % N;
        if ties > 1 {
            for i in at + 1..N {
                if keys[i] == top && (y[i] > y[at] || (y[i] == y[at] && x[i] > x[at])) {
                    at = i;
                }
            }
        }
        let n = [x[at], y[at], z[at]];
        top = DONE;
        for i in 0..N {
            let dot = x[i] * n[0] + y[i] * n[1] + z[i] * n[2];
            let dot = if TWO_SIDED { dot.abs() } else { dot };
            let joins = (dot >= cosine) & (keys[i] != DONE);
            class[i] = if joins { classes } else { class[i] };
            keys[i] = if joins { DONE } else { keys[i] };
            top = top.max(keys[i]);
        }
        classes += 1;
    }
    if top == DONE { classes as usize } else { usize::MAX }
}

/// Returns the first index of `top` in `keys`, whose length is a multiple of eight, and the number of occurrences. Sums and
/// ranges with overflow checks would not be vectorised.
#[inline(always)]
fn find(keys: &[i32], top: i32) -> (usize, i32) {
    const LANES: usize = 8;
    let (mut first, mut ties, mut number) = ([i32::MAX; LANES], [0_i32; LANES], [0, 1, 2, 3, 4, 5, 6, 7]);
    for keys in keys.as_chunks::<LANES>().0 {
        let places: [i32; LANES] = std::array::from_fn(|i| if keys[i] == top { number[i] } else { i32::MAX });
        first = std::array::from_fn(|i| if places[i] < first[i] { places[i] } else { first[i] });
        ties = std::array::from_fn(|i| ties[i].wrapping_add(i32::from(keys[i] == top)));
        number = number.map(|number: i32| number.wrapping_add(LANES as i32));
    }
    (first.into_iter().fold(i32::MAX, i32::min) as usize, ties.into_iter().fold(0, i32::wrapping_add))
}

/// Maps a float to an integer with the same order. 0.0 and -0.0 map to the same integer.
#[inline(always)]
fn key(x: f32) -> i32 {
    let bits = (x + 0.0).to_bits() as i32;
    bits ^ ((bits >> 31) as u32 >> 1) as i32
}
