//! Clustering over a grid: triangles are sorted by voxel, ranges of voxels are clustered in parallel, and the results are
//! joined.

mod greedy;
mod grid;
mod group;
mod result;
mod small_groups;
mod triangle_normals;
mod voxels;

pub use result::Clusters;

use crate::params::{ClusterParams, Insertion, MAX_CLAMP};
use crate::{Cluster, ClusterReport, Error, Triangles};
use grid::{Bounds, CHUNK, Grid, Mesh};
use group::{GroupRule, Scratch};
use pulp::{Arch, NullaryFnOnce};
use rayon::prelude::*;
use small_groups::Batch;
use std::sync::Arc;
use triangle_normals::{Members, Surfaces};
use voxels::{Entry, Ranges, Sorted, for_ranges};

/// The largest number of triangle-voxel pairs. With a sorted copy, pairs of 64 bits then use up to 4 GiB.
const MAX_ENTRIES: u64 = 1 << 28;
/// The limits on triangle-voxel pairs during the search for a grid: pairs per triangle, and the smallest limit for a whole
/// mesh.
const SEARCHED_ENTRIES: [u64; 2] = [32, 1 << 16];
/// The ratio at which the search for a grid ends: between the found and the desired number of clusters, or between the
/// resolutions of the two grids that bracket the result.
const NEAR: f64 = 1.01;
/// The largest number of voxels for which a triangle-voxel pair fits into 64 bits.
const WIDE: u64 = 1 << 32;

/// Clusters triangles by position, material and normal. The crate's front page describes the method, and [`ClusterParams`] the
/// parameters.
///
/// The result is bit-identical for any number of threads. With [`crate::Order::Canonical`], triangles that are shuffled
/// together with their vertices and materials keep their labels; only sums may differ in their last digits.
///
/// A flat triangle (three corners on a line) has no normal and is similar to every triangle. It joins the first cluster of its
/// voxel and material. With [`crate::Grouping::Connected`], it joins the first cluster that it touches, directly or through
/// other flat triangles. Flat triangles that can join no cluster form clusters of flat triangles.
///
/// # Errors
///
/// * There are no triangles.
/// * A triangle refers to a vertex that does not exist or is not finite. Unused vertices may have any value.
/// * The number of materials is neither 0 nor the number of triangles.
/// * A parameter is out of range.
/// * With [`Insertion::BoundingBox`], the boxes of the triangles overlap more than 2^28 voxels in total.
pub fn cluster(triangles: &Triangles<'_>, params: &ClusterParams) -> Result<Clusters, Error> {
    params.check()?;
    let mesh = Mesh::new(triangles)?;
    match params.count {
        Some(count) => search(&mesh, params, count),
        None => {
            let longest = Grid::longest(params.k, triangles.indices.len());
            partition(&mesh, params, Grid::new(mesh.bounds, longest, params.clamp), MAX_ENTRIES)
        }
    }
}

/// Searches for the grid whose number of clusters is nearest to `count`, and returns its clusters. The search bisects the ratio
/// of the numbers of voxels along the longest axis.
fn search(mesh: &Mesh<'_>, params: &ClusterParams, count: u32) -> Result<Clusters, Error> {
    let [each, least] = SEARCHED_ENTRIES;
    let limit = (each * mesh.indices.len() as u64).clamp(least, MAX_ENTRIES);
    let at = |longest: u32| partition(mesh, params, Grid::new(mesh.bounds, f64::from(longest), MAX_CLAMP), limit);
    let miss = |clusters: &Clusters| {
        let (made, asked) = (clusters.len() as f64, f64::from(count));
        (made / asked).max(asked / made)
    };
    // `low` voxels give too few clusters, `high` voxels too many.
    let (mut low, mut high) = (1, MAX_CLAMP + 1);
    let mut best = at(1)?;
    if best.len() >= count as usize {
        return Ok(best);
    }
    // A surface crosses about as many voxels as a plane does: the square of the resolution.
    let mut next = (f64::from(count).sqrt() as u32).clamp(2, MAX_CLAMP);
    while high - low > 1 && f64::from(high) > NEAR * f64::from(low) && miss(&best) > NEAR {
        let found = match at(next) {
            Err(Error::TooManyEntries { .. }) => {
                high = next;
                next = middle(low, high);
                continue;
            }
            found => found?,
        };
        let enough = found.len() >= count as usize;
        // If each triangle is a cluster of its own, no finer grid helps.
        if enough || found.len() == mesh.indices.len() {
            high = next;
        } else {
            low = next;
        }
        let (new, old) = (miss(&found), miss(&best));
        if new < old || (new == old && found.report.resolution < best.report.resolution) {
            best = found;
        }
        next = if high > MAX_CLAMP { (4 * low).min(MAX_CLAMP) } else { middle(low, high) };
    }
    Ok(best)
}

/// The geometric mean of two numbers, rounded down, and strictly between them if there is room.
fn middle(low: u32, high: u32) -> u32 {
    let mean = (f64::from(low) * f64::from(high)).sqrt() as u32;
    mean.clamp(low + 1, (high - 1).max(low + 1))
}

fn partition(mesh: &Mesh<'_>, params: &ClusterParams, grid: Grid, limit: u64) -> Result<Clusters, Error> {
    if grid.voxels() <= WIDE {
        partition_with::<u64>(mesh, params, grid, limit)
    } else {
        partition_with::<u128>(mesh, params, grid, limit)
    }
}

fn partition_with<E: Entry>(
    mesh: &Mesh<'_>,
    params: &ClusterParams,
    grid: Grid,
    limit: u64,
) -> Result<Clusters, Error> {
    let insertions = match params.insertion {
        Insertion::Centroid => mesh.indices.len() as u64,
        Insertion::BoundingBox => count_overlapped(mesh, grid, limit)?,
    };
    let ranges = Ranges::new(grid.voxels(), insertions as usize);
    let parts: Vec<Sorted<E>> = (0..mesh.indices.len().div_ceil(CHUNK))
        .into_par_iter()
        .map_init(Vec::new, |entries, chunk| {
            match params.insertion {
                Insertion::Centroid => Arch::new().dispatch(InsertCentroids { mesh, grid, chunk, entries }),
                Insertion::BoundingBox => insert_boxes(mesh, grid, chunk, entries),
            }
            Sorted::new(entries, ranges)
        })
        .collect();
    let batches =
        for_ranges(&parts, ranges, |worker: &mut Worker, entries| worker.cluster(mesh, params, grid, entries));
    drop(parts);
    let report = ClusterReport {
        resolution: grid.resolution,
        occupied: batches.iter().map(|batch| batch.voxels).sum(),
        fullest: batches.iter().map(|batch| batch.fullest).max().unwrap_or(0),
        triangles: mesh.indices.len() as u32,
        insertions,
        phantoms: batches.iter().map(|batch| batch.phantoms).sum(),
    };
    Ok(join(batches, report))
}

/// The indices of the triangles in a chunk of [`CHUNK`] triangles.
fn numbers(mesh: &Mesh<'_>, chunk: usize) -> std::ops::Range<u32> {
    let end = (chunk * CHUNK + CHUNK).min(mesh.indices.len());
    (chunk * CHUNK) as u32..end as u32
}

/// The insertion of triangles into the voxels of their centroids. pulp compiles it for each width of vector registers.
struct InsertCentroids<'a, 'm, E> {
    mesh: &'a Mesh<'m>,
    grid: Grid,
    chunk: usize,
    entries: &'a mut Vec<E>,
}

impl<E: Entry> NullaryFnOnce for InsertCentroids<'_, '_, E> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let numbers = numbers(self.mesh, self.chunk);
        self.entries.resize(numbers.len(), E::default());
        for (entry, i) in self.entries.iter_mut().zip(numbers) {
            *entry = E::new(self.grid.centroid_voxel(self.mesh.corners(i)), i);
        }
    }
}

fn insert_boxes<E: Entry>(mesh: &Mesh<'_>, grid: Grid, chunk: usize, entries: &mut Vec<E>) {
    entries.clear();
    for triangle in numbers(mesh, chunk) {
        let [first, last] = grid.overlapped(Bounds::of(mesh.corners(triangle)));
        for z in first[2]..=last[2] {
            for y in first[1]..=last[1] {
                for x in first[0]..=last[0] {
                    entries.push(E::new(grid.number([x, y, z]), triangle));
                }
            }
        }
    }
}

/// The sum over all triangles of the number of voxels that the triangle's box overlaps. Returns an error if it exceeds `limit`.
fn count_overlapped(mesh: &Mesh<'_>, grid: Grid, limit: u64) -> Result<u64, Error> {
    let count = |triangle: u32| {
        let [first, last] = grid.overlapped(Bounds::of(mesh.corners(triangle)));
        (0..3).map(|axis| u64::from(last[axis] - first[axis]) + 1).product::<u64>()
    };
    let entries =
        (0..mesh.indices.len() as u32).into_par_iter().with_min_len(CHUNK).map(count).reduce(|| 0, u64::saturating_add);
    if entries > limit { Err(Error::TooManyEntries { entries, limit }) } else { Ok(entries) }
}

/// The least number of triangles whose normals and areas are computed together. At this number, few vector lanes are idle, and
/// the triangles stay in the nearest cache until they are clustered.
const RUN: usize = 256;

/// The scratch space of one thread for clustering ranges of voxels.
#[derive(Default)]
struct Worker {
    scratch: Scratch,
    surfaces: Surfaces,
    /// The indices of the triangles to be clustered next, sorted by voxel, then by material.
    triangles: Vec<u32>,
    /// The groups (one voxel, one material) of `triangles`: the index of the voxel, and the end of the group in `triangles`.
    groups: Vec<(u64, usize)>,
}

impl Worker {
    /// Clusters the voxels of a range, given as the sorted pairs of voxels and triangles.
    fn cluster<E: Entry>(&mut self, mesh: &Mesh<'_>, params: &ClusterParams, grid: Grid, entries: &[E]) -> Batch {
        let mut batch = Batch::default();
        batch.members.reserve_exact(if params.insertion == Insertion::Centroid { entries.len() } else { 0 });
        for voxel in entries.chunk_by(|a, b| a.voxel() == b.voxel()) {
            batch.voxels += 1;
            batch.fullest = batch.fullest.max(voxel.len() as u32);
            let first = self.triangles.len();
            self.triangles.extend(voxel.iter().map(|entry| entry.triangle()));
            self.split(mesh.materials, first, voxel[0].voxel());
            if self.triangles.len() >= RUN {
                self.flush(mesh, params, grid, &mut batch);
            }
        }
        self.flush(mesh, params, grid, &mut batch);
        batch
    }

    /// Splits the triangles of one voxel, which are in `self.triangles` from `first` on, into groups by material.
    fn split(&mut self, materials: &[u32], first: usize, voxel: u64) {
        if materials.is_empty() {
            self.groups.push((voxel, self.triangles.len()));
            return;
        }
        let own = &mut self.triangles[first..];
        let material = |triangle: &u32| materials[*triangle as usize];
        // The triangles ascend, and so do their materials if the triangles of each mesh are contiguous.
        if !own.is_sorted_by_key(material) {
            own.sort_unstable_by_key(|triangle| u64::from(material(triangle)) << 32 | u64::from(*triangle));
        }
        let mut end = first;
        for group in own.chunk_by(|a, b| material(a) == material(b)) {
            end += group.len();
            self.groups.push((voxel, end));
        }
    }

    /// Clusters all waiting groups into `batch` and removes them, using the machine's widest vector registers. Rust never fuses
    /// a product and a sum, so every width gives identical bits.
    fn flush(&mut self, mesh: &Mesh<'_>, params: &ClusterParams, grid: Grid, batch: &mut Batch) {
        Arch::new().dispatch(Flush { worker: self, mesh, params, grid, batch });
    }

    #[inline(always)]
    fn flush_here(&mut self, mesh: &Mesh<'_>, params: &ClusterParams, grid: Grid, batch: &mut Batch) {
        self.surfaces.load(mesh, &self.triangles, params.two_sided());
        let plan = GroupRule::new(params);
        let mut start = 0;
        for &(voxel, end) in &self.groups {
            let group = Members {
                triangles: &self.triangles[start..end],
                surfaces: &self.surfaces.surfaces[start..end],
                normals: self.surfaces.normals(start),
            };
            // A triangle keeps the cluster of the last voxel of its box.
            let keeps = |i: usize| grid.number(grid.overlapped(group.surfaces[i].bounds)[1]) == voxel;
            self.scratch.cluster(mesh, &plan, group, keeps, batch);
            start = end;
        }
        self.triangles.clear();
        self.groups.clear();
    }
}

/// A call of [`Worker::flush_here`] that pulp compiles for each width of vector registers.
struct Flush<'a, 'm> {
    worker: &'a mut Worker,
    mesh: &'a Mesh<'m>,
    params: &'a ClusterParams,
    grid: Grid,
    batch: &'a mut Batch,
}

impl NullaryFnOnce for Flush<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        self.worker.flush_here(self.mesh, self.params, self.grid, self.batch);
    }
}

/// Concatenates the batches into the final result. Each array is written once, in its final place, since the first access to a
/// page costs more than writing to it.
fn join(batches: Vec<Batch>, report: ClusterReport) -> Clusters {
    let count = batches.iter().map(|batch| batch.clusters.len()).sum();
    let triangles = report.triangles as usize;
    let mut labels: Arc<[u32]> = std::iter::repeat_n(0, triangles).collect();
    let mut clusters: Arc<[Cluster]> = std::iter::repeat_n(Cluster::NONE, count).collect();
    let (label_of, all) = (Arc::make_mut(&mut labels), Arc::make_mut(&mut clusters));
    let mut members = Vec::with_capacity(triangles);
    let mut starts = Vec::with_capacity(count + 1);
    // Group numbers continue from batch to batch.
    let (mut end, mut groups) = (0, 0);
    starts.push(end);
    for batch in &batches {
        let mut rest = batch.members.as_slice();
        for (cluster, label) in batch.clusters.iter().zip(starts.len() - 1..) {
            let (own, others) = rest.split_at(cluster.triangles as usize);
            rest = others;
            for &triangle in own {
                label_of[triangle as usize] = label as u32;
            }
            all[label] = Cluster { group: groups + cluster.group, ..*cluster };
            end += cluster.triangles;
            starts.push(end);
        }
        members.extend_from_slice(&batch.members);
        groups += batch.groups;
    }
    Clusters { labels, clusters, members, starts, report }
}
