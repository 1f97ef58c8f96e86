//! Projected areas of clusters, triangle by triangle.

use crate::Error;
use dapple_clustering::Triangles;

/// The area vectors (unit normal times area) of every cluster's triangles.
///
/// The vectors give `S(d) = sum |n_t . d| A_t`, the sum of projected triangle areas, for any direction `d`. Lan
/// proposes this sum as the remedy for boxes that are larger than their contents [Lan 2016, 3.2.2 a].
///
/// If a cluster's normals all lie on one side of the plane perpendicular to `d`, as they do except at grazing angles,
/// one scalar product is exact: `|d . sum of area vectors|`. Otherwise up to 256 triangles are summed exactly. More
/// triangles are summed as at most 256 bundles of similar normals. Only bundles that are seen edge-on themselves are
/// inexact (less than 1 % of the cluster's area in the tests' hemisphere).
#[derive(Clone, Debug, PartialEq)]
pub struct AreaVectors {
    clusters: Vec<Bundle>,
    vectors: Vec<[f64; 3]>,
}

/// One cluster's area vectors, each negated where needed, so that its component along `axis` is not negative.
#[derive(Clone, Debug, PartialEq)]
struct Bundle {
    range: std::ops::Range<usize>,
    sum: [f64; 3],
    axis: [f64; 3],
    /// Sine of the largest angle between a normal and the axis; above 1 if that is a right angle or more.
    sine: f64,
    area: f64,
}

/// The largest number of a cluster's triangles that are summed one by one.
const EXACT: usize = 256;
/// The number of cells along each side of the octahedral map's square. Its 256 cells are the bundles of similar
/// normals.
const CELLS: usize = 16;

impl AreaVectors {
    /// Computes the area vectors of all clusters. `labels` has the index, below `clusters`, of each triangle's cluster.
    /// Triangles with a vertex that is not finite have no area.
    ///
    /// # Errors
    ///
    /// [`Error::LabelCount`] unless there is one label per triangle. [`Error::NoVertex`] for the index of a missing
    /// vertex. [`Error::NoCluster`] for a label that is not below `clusters`.
    pub fn new(triangles: &Triangles<'_>, labels: &[u32], clusters: usize) -> Result<Self, Error> {
        let Triangles { positions, indices, .. } = *triangles;
        if labels.len() != indices.len() {
            return Err(Error::LabelCount { labels: labels.len(), triangles: indices.len() });
        }
        let mut members: Vec<(u32, [f64; 3])> = Vec::with_capacity(labels.len());
        for (triangle, (index, &label)) in indices.iter().zip(labels).enumerate() {
            if let Some(&vertex) = index.iter().find(|&&v| v as usize >= positions.len()) {
                return Err(Error::NoVertex { triangle, vertex, vertices: positions.len() });
            }
            if label as usize >= clusters {
                return Err(Error::NoCluster { label, clusters });
            }
            members.push((label, area_vector(index.map(|v| positions[v as usize].map(f64::from)))));
        }
        members.sort_by_key(|m| m.0);
        let mut made = Self { clusters: Vec::with_capacity(clusters), vectors: Vec::new() };
        let mut rest = &members[..];
        for cluster in 0..clusters as u32 {
            let (mine, others) = rest.split_at(rest.partition_point(|m| m.0 <= cluster));
            made.push(mine.iter().map(|m| m.1).collect());
            rest = others;
        }
        Ok(made)
    }

    fn push(&mut self, mut vectors: Vec<[f64; 3]>) {
        let first = vectors.iter().copied().find(|&v| length(v) > 0.0).unwrap_or_default();
        turn_to(first, &mut vectors);
        let axis = unit(sum(&vectors));
        turn_to(axis, &mut vectors);
        let total = sum(&vectors);
        let axis = unit(total);
        let cosine = |v: &[f64; 3]| if length(*v) > 0.0 { dot(axis, unit(*v)) } else { 1.0 };
        let least = vectors.iter().map(cosine).fold(1.0, f64::min);
        let sine = if least > 0.0 { (1.0 - least * least).max(0.0).sqrt() } else { 2.0 };
        let area = vectors.iter().map(|v| length(*v)).sum();
        if vectors.len() > EXACT {
            vectors.sort_by_key(|v| cell(*v));
            vectors = vectors.chunk_by(|a, b| cell(*a) == cell(*b)).map(sum).collect();
        }
        let start = self.vectors.len();
        self.vectors.extend(vectors);
        self.clusters.push(Bundle { range: start..self.vectors.len(), sum: total, axis, sine, area });
    }

    /// The number of clusters.
    pub fn len(&self) -> usize {
        self.clusters.len()
    }

    /// Returns `true` if there are no clusters.
    pub fn is_empty(&self) -> bool {
        self.clusters.is_empty()
    }

    /// The sum of the projected areas of a cluster's triangles along the unit direction `d`, in world units. Hidden
    /// triangles count too. 0 for an unknown cluster.
    pub fn projected(&self, cluster: u32, d: [f32; 3]) -> f64 {
        let Some(bundle) = self.clusters.get(cluster as usize) else { return 0.0 };
        let d = d.map(f64::from);
        if dot(bundle.axis, d).abs() >= bundle.sine {
            return dot(bundle.sum, d).abs();
        }
        self.vectors[bundle.range.clone()].iter().map(|&v| dot(v, d).abs()).sum()
    }

    /// The sum of the areas of a cluster's triangles, in world units; 0 for an unknown cluster.
    pub fn area(&self, cluster: u32) -> f64 {
        self.clusters.get(cluster as usize).map_or(0.0, |b| b.area)
    }
}

fn area_vector([a, b, c]: [[f64; 3]; 3]) -> [f64; 3] {
    let edge = |p: [f64; 3]| [p[0] - a[0], p[1] - a[1], p[2] - a[2]];
    let (u, v) = (edge(b), edge(c));
    let cross = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    if cross.iter().all(|x| x.is_finite()) { cross.map(|x| 0.5 * x) } else { [0.0; 3] }
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn length(v: [f64; 3]) -> f64 {
    dot(v, v).sqrt()
}

fn unit(v: [f64; 3]) -> [f64; 3] {
    let length = length(v);
    if length > 0.0 { v.map(|x| x / length) } else { v }
}

fn sum(vectors: &[[f64; 3]]) -> [f64; 3] {
    vectors.iter().fold([0.0; 3], |s, v| [s[0] + v[0], s[1] + v[1], s[2] + v[2]])
}

/// Turns area vectors to the side of `axis`. Their sign is arbitrary, since winding may flip within a surface.
fn turn_to(axis: [f64; 3], vectors: &mut [[f64; 3]]) {
    for v in vectors.iter_mut().filter(|v| dot(axis, **v) < 0.0) {
        *v = v.map(|x| -x);
    }
}

/// The index of a direction's cell on the octahedron, unfolded into a square [Engelhardt and Dachsbacher 2008].
fn cell(v: [f64; 3]) -> usize {
    let norm = v[0].abs() + v[1].abs() + v[2].abs();
    if norm == 0.0 {
        return 0;
    }
    let (x, y) = (v[0] / norm, v[1] / norm);
    let (x, y) = if v[2] >= 0.0 { (x, y) } else { ((1.0 - y.abs()).copysign(x), (1.0 - x.abs()).copysign(y)) };
    let index = |x: f64| (((x + 1.0) * 0.5 * CELLS as f64) as usize).min(CELLS - 1);
    index(y) * CELLS + index(x)
}
