//! The size of a cluster, by its box or by its triangles, and the sampling rate that its first-hit rays predict.

use crate::Error;
use crate::first_hits::{BACKGROUND, ClusterHit, FirstHits};
use dapple_clustering::{Cluster, Triangles};
use dapple_core::parallel;

/// The measure of a cluster's size `SC`, in the ratio `SP / SC` of pixel area to cluster size.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum ClusterSize {
    /// The size of the cluster's axis-aligned box with edges `lx`, `ly` and `lz`, projected along the ray's unit direction `d`,
    /// in world units: `lx ly |dz| + lx lz |dy| + ly lz |dx|` [Lan 2016, 2.3].
    #[default]
    ProjectedBox,
    /// The sum of the areas of the cluster's triangles, projected along the first-hit ray, in world units [Lan 2016, 3.2.2 a].
    /// A box may be much larger than its triangles.
    ProjectedTriangles(AreaVectors),
    /// The film area of the cluster's box in perspective, in pixels: [`projected_box_area`] with this world-to-clip matrix. The
    /// projected box of [Lan 2016, 2.3] ignores perspective.
    ScreenBox([[f32; 4]; 4]),
    /// The number of first-hit rays that hit the cluster, divided by the first-hit rays per pixel. This is the number of pixels
    /// that the cluster covers, with occlusion and perspective. The background counts as a cluster.
    Hits,
}

impl ClusterSize {
    /// The measure's name on the command line: `box`, `triangles`, `screen` or `hits`.
    pub const fn name(&self) -> &'static str {
        match self {
            Self::ProjectedBox => "box",
            Self::ProjectedTriangles(_) => "triangles",
            Self::ScreenBox(_) => "screen",
            Self::Hits => "hits",
        }
    }
}

/// The measure of a pixel's area `SP`, if cluster sizes are measured in world units.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PixelArea {
    /// Area 1 for every pixel, as in [Lan 2016]. The perspective factor `f^2 / d^2` of focal length and distance is missing, so
    /// a far cluster counts as large as a near one.
    #[default]
    One,
    /// The squared width of the pixel's footprint at the hit. A cluster's size divided by this area is a number of pixels.
    Footprint,
}

dapple_core::choices!(PixelArea { One = "one", Footprint = "footprint" });

/// The least projected size of a cluster, as a fraction of its largest face (or of its triangles' area). A plane has this size
/// at 0.06 degrees from edge-on. Closer to edge-on, sizes stay constant, so that rates stay finite and do not jump at 0
/// degrees.
const EDGE_ON: f64 = 1e-3;

/// The sampling rate that each first-hit ray predicts.
#[derive(Clone, Debug, PartialEq)]
pub struct Rates {
    /// The ratio `SP / SC` of pixel area to cluster size, for each first-hit ray in the order of [`FirstHits::all`]. Finite and
    /// not negative; 0 for a first-hit ray without a hit, except with [`ClusterSize::Hits`]. With [`PixelArea::Footprint`],
    /// [`ClusterSize::ScreenBox`] or [`ClusterSize::Hits`], the ratio of a cluster that covers `n` pixels is `1 / n`. With
    /// [`PixelArea::One`], ratios are only proportional to rates.
    pub values: Vec<f64>,
    /// The number of first-hit rays whose cluster has no size (a point, a line, or corners that are not finite). Their rate is
    /// the largest rate of the other first-hit rays, or 1 if that rate is 0.
    pub replaced: usize,
}

/// The sampling rate that each first-hit ray predicts: the ratio `SP / SC` of pixel area to cluster size [Lan 2016, eq.
/// 3-3]. The map [`RateMap`](crate::RateMap) is not applied.
///
/// The true rate of a pixel is the sum of `S_i / SC_i` over the clusters `i` that it sees, where `S_i` is the area of the
/// cluster's part inside the pixel. The thesis estimates it by `SP / SC` from one ray through the pixel's centre, which is
/// correct if one cluster fills the pixel. A ray placed uniformly in the pixel hits cluster `i` with probability `S_i / SP`.
/// The mean over [`Placement::Jittered`](crate::Placement::Jittered) first-hit rays is thus unbiased for any pixel.
///
/// # Errors
///
/// [`Error::NoCluster`] if a first-hit ray has a cluster that is not in `clusters`, or that has no area vectors in `size`.
pub fn rates(
    first_hits: &FirstHits,
    clusters: &[Cluster],
    size: &ClusterSize,
    pixel_area: PixelArea,
) -> Result<Rates, Error> {
    let classes = first_hits.class_counts(clusters.len())?;
    let k = f64::from(first_hits.placement().per_pixel());
    let mut values: Vec<f64> = match size {
        ClusterSize::Hits => {
            let rate = |p: &ClusterHit| k / classes[(p.cluster as usize).min(clusters.len())] as f64;
            first_hits.all().iter().map(rate).collect()
        }
        ClusterSize::ScreenBox(world_to_clip) => {
            let resolution = first_hits.frame().resolution();
            // A visible cluster covers at least the area of one first-hit ray.
            let area = |c: &Cluster| projected_box_area(&c.bounds, world_to_clip, resolution).max(1.0 / k);
            let seen = classes.iter().zip(clusters);
            let rates: Vec<f64> = seen.map(|(&n, c)| if n > 0 { 1.0 / area(c) } else { 0.0 }).collect();
            of_hits(first_hits, |p| rates[p.cluster as usize])
        }
        ClusterSize::ProjectedBox => {
            let boxes: Vec<BoxFaces> = clusters.iter().map(|c| BoxFaces::new(&c.bounds)).collect();
            of_hits(first_hits, |p| pixel_size(p, pixel_area) / boxes[p.cluster as usize].projected(p.direction))
        }
        ClusterSize::ProjectedTriangles(vectors) => {
            let known = vectors.clusters.len();
            if known < clusters.len() {
                return Err(Error::NoCluster { label: known as u32, clusters: known });
            }
            let size =
                |p: &ClusterHit| vectors.projected(p.cluster, p.direction).max(EDGE_ON * vectors.area(p.cluster));
            of_hits(first_hits, |p| pixel_size(p, pixel_area) / size(p))
        }
    };
    let replaced = replace_infinite(&mut values);
    Ok(Rates { values, replaced })
}

fn of_hits(first_hits: &FirstHits, rate: impl Fn(&ClusterHit) -> f64 + Sync) -> Vec<f64> {
    let of = |p: &ClusterHit| if p.cluster == BACKGROUND { 0.0 } else { rate(p) };
    parallel::map(first_hits.all().len(), |k| of(&first_hits.all()[k]))
}

fn pixel_size(first_hit: &ClusterHit, area: PixelArea) -> f64 {
    match area {
        PixelArea::One => 1.0,
        PixelArea::Footprint => f64::from(first_hit.footprint) * f64::from(first_hit.footprint),
    }
}

/// The areas of a cluster's box faces, and the least projected size of the box.
struct BoxFaces {
    areas: [f64; 3],
    least: f64,
}

impl BoxFaces {
    fn new([low, high]: &[[f32; 3]; 2]) -> Self {
        let l: [f64; 3] = std::array::from_fn(|a| f64::from(high[a]) - f64::from(low[a]));
        let areas = [l[1] * l[2], l[0] * l[2], l[0] * l[1]];
        Self { areas, least: EDGE_ON * areas[0].max(areas[1]).max(areas[2]) }
    }

    /// The box's size projected along the unit direction `d`, in the orthographic projection of [Lan 2016, 2.3, Fig. 3-20]. It
    /// is at least a thousandth of the largest face.
    fn projected(&self, d: [f32; 3]) -> f64 {
        let [x, y, z] = self.areas;
        let [dx, dy, dz] = d.map(|d| f64::from(d.abs()));
        (x * dx + y * dy + z * dz).max(self.least)
    }
}

/// Replaces NaN and rates of clusters without size by the largest other rate. Returns the number of replaced rates.
fn replace_infinite(rates: &mut [f64]) -> usize {
    let none = |r: f64| !r.is_finite() || r < 0.0;
    let largest = rates.iter().copied().filter(|&r| !none(r)).fold(0.0, f64::max);
    let largest = if largest > 0.0 { largest } else { 1.0 };
    let replaced = rates.iter().filter(|r| none(**r)).count();
    rates.iter_mut().filter(|r| none(**r)).for_each(|rate| *rate = largest);
    replaced
}

/// The area, in pixels, that the box between the corners `bounds` covers on a film of `resolution` pixels. `world_to_clip`
/// holds the rows of a matrix that maps `[x, y, z, 1]` to clip space. A point with `w > 0` lies in front of the eye, and is on
/// the film if `x / w` and `y / w` are in `[-1, 1]`. The row of `z` is ignored: the near plane passes through the eye.
///
/// The part of the box in front of the eye is convex. Its image is thus the convex hull of its corners' images, clipped to the
/// film. The area is never negative and never exceeds the film. It is 0 for a box entirely behind the eye or beside the film,
/// and the whole film for a box around the eye. A flat box seen edge-on has no area. For corners that are not finite or in the
/// wrong order, the area is 0.
pub fn projected_box_area(bounds: &[[f32; 3]; 2], world_to_clip: &[[f32; 4]; 4], resolution: [u32; 2]) -> f64 {
    let film = f64::from(resolution[0]) * f64::from(resolution[1]);
    let [low, high] = bounds;
    if !(0..3).all(|a| low[a].is_finite() && high[a].is_finite() && low[a] <= high[a]) {
        return 0.0;
    }
    let corners: [[f64; 3]; 8] = std::array::from_fn(|corner| {
        let along = |axis: usize| f64::from(if corner >> axis & 1 == 0 { low[axis] } else { high[axis] });
        let row = |r: &[f32; 4]| (0..3).map(|a| f64::from(r[a]) * along(a)).sum::<f64>() + f64::from(r[3]);
        [row(&world_to_clip[0]), row(&world_to_clip[1]), row(&world_to_clip[3])]
    });
    if corners.iter().flatten().any(|c| !c.is_finite()) {
        return 0.0;
    }
    let hull = hull(in_front(&corners));
    let share = area(&cut_to_film(hull)) / 4.0;
    (share * film).clamp(0.0, film)
}

/// The projections of the corners in front of the eye, and of the points where edges of the box enter that half space.
fn in_front(corners: &[[f64; 3]; 8]) -> Vec<[f64; 2]> {
    let far = corners.iter().fold(0.0, |m: f64, c| m.max(c[0].abs()).max(c[1].abs()).max(c[2].abs()));
    // Just in front of the eye: images there are a billion films away, but at finite positions.
    let near = far * 1e-9;
    let project = |c: [f64; 3]| [c[0] / c[2], c[1] / c[2]];
    let mut points: Vec<[f64; 2]> = corners.iter().filter(|c| c[2] > near).map(|&c| project(c)).collect();
    for (a, b) in (0..8).flat_map(|i| (0..3).map(move |axis| (i, i | 1 << axis))).filter(|(a, b)| a != b) {
        let (from, to) = (corners[a], corners[b]);
        if (from[2] > near) != (to[2] > near) {
            let t = (near - from[2]) / (to[2] - from[2]);
            let at = |k: usize| from[k] + t * (to[k] - from[k]);
            points.push([at(0) / near, at(1) / near]);
        }
    }
    points
}

/// The corners of the convex hull of the points, counter-clockwise [Andrew 1979].
fn hull(mut points: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    points.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    points.dedup();
    if points.len() < 3 {
        return Vec::new();
    }
    let turn = |a: [f64; 2], b: [f64; 2], c: [f64; 2]| (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    let mut hull: Vec<[f64; 2]> = Vec::with_capacity(points.len() + 1);
    for pass in 0..2 {
        let start = hull.len();
        for &p in &points {
            while hull.len() >= start + 2 && turn(hull[hull.len() - 2], hull[hull.len() - 1], p) <= 0.0 {
                hull.pop();
            }
            hull.push(p);
        }
        // Each chain ends where the other one begins.
        hull.pop();
        if pass == 0 {
            points.reverse();
        }
    }
    hull
}

/// The part of a convex polygon that lies in `[-1, 1]^2`, the film in clip space [Sutherland and Hodgman 1974].
fn cut_to_film(mut polygon: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    for (axis, side) in [(0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0)] {
        let inside = |p: [f64; 2]| 1.0 - side * p[axis];
        let mut cut = Vec::with_capacity(polygon.len() + 1);
        for (i, &p) in polygon.iter().enumerate() {
            let q = polygon[(i + 1) % polygon.len()];
            let (a, b) = (inside(p), inside(q));
            if a >= 0.0 {
                cut.push(p);
            }
            if (a >= 0.0) != (b >= 0.0) {
                let t = a / (a - b);
                let mut crossing = [p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1])];
                crossing[axis] = side;
                cut.push(crossing);
            }
        }
        polygon = cut;
    }
    polygon
}

fn area(polygon: &[[f64; 2]]) -> f64 {
    let cross = |a: [f64; 2], b: [f64; 2]| a[0] * b[1] - a[1] * b[0];
    let sum: f64 = (0..polygon.len()).map(|i| cross(polygon[i], polygon[(i + 1) % polygon.len()])).sum();
    0.5 * sum.abs()
}

/// The area vectors (unit normal times area) of every cluster's triangles.
///
/// The vectors give `S(d) = sum |n_t . d| A_t`, the sum of projected triangle areas, for any direction `d`. The thesis suggests
/// this sum for boxes that are much larger than their triangles [Lan 2016, 3.2.2 a].
///
/// If a cluster's normals all lie on one side of the plane perpendicular to `d`, as they do except at grazing angles, one dot
/// product is exact: `|d . sum of area vectors|`. Otherwise up to 256 triangles are summed exactly. More triangles are combined
/// into at most 256 bundles of similar normals. Only bundles seen edge-on are inexact; for normals over a whole hemisphere, the
/// error is below 1 % of the cluster's area.
#[derive(Clone, Debug, PartialEq)]
pub struct AreaVectors {
    clusters: Vec<Bundle>,
    vectors: Vec<[f64; 3]>,
}

/// The area vectors of one cluster, each negated if necessary so that its component along `axis` is not negative.
#[derive(Clone, Debug, PartialEq)]
struct Bundle {
    range: std::ops::Range<usize>,
    sum: [f64; 3],
    axis: [f64; 3],
    /// The sine of the largest angle between a normal and the axis; above 1 if that angle is 90 degrees or more.
    sine: f64,
    area: f64,
}

/// The largest number of triangles per cluster that are summed one by one.
const EXACT: usize = 256;
/// The number of cells along each side of the octahedral map's square. Its 256 cells are the bundles of similar
/// normals.
const CELLS: usize = 16;

impl AreaVectors {
    /// Computes the area vectors of all clusters. `labels` holds the cluster number, below `clusters`, of each triangle.
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

    /// The sum of the areas of a cluster's triangles, projected along the unit direction `d`, in squared world units. Hidden
    /// triangles are included. 0 for a cluster number without triangles.
    pub fn projected(&self, cluster: u32, d: [f32; 3]) -> f64 {
        let Some(bundle) = self.clusters.get(cluster as usize) else { return 0.0 };
        let d = d.map(f64::from);
        if dot(bundle.axis, d).abs() >= bundle.sine {
            return dot(bundle.sum, d).abs();
        }
        self.vectors[bundle.range.clone()].iter().map(|&v| dot(v, d).abs()).sum()
    }

    /// The sum of the areas of a cluster's triangles, in squared world units; 0 for a cluster number without triangles.
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

/// Negates area vectors on the far side of `axis`. Their sign is arbitrary, since winding may flip within a surface.
fn turn_to(axis: [f64; 3], vectors: &mut [[f64; 3]]) {
    for v in vectors.iter_mut().filter(|v| dot(axis, **v) < 0.0) {
        *v = v.map(|x| -x);
    }
}

/// The index of a direction's cell on an octahedron unfolded into a square [Engelhardt and Dachsbacher 2008].
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
