//! Cells: patches of surface around the first hits of pixels.

use crate::disjoint::Disjoint;
use crate::out_of_range;
use dapple_core::{Error, Film, FirstHit, Options as _};

dapple_core::options! {
    /// The parameters by which [`Cells`] divides first hits into patches of surface.
    pub struct CellOptions {
        /// Edge of the grid cubes that divide surfaces into cells, in pixels.
        ///
        /// The edge is converted to world units by the pixel footprint at the hit, rounded down to a power of two times
        /// the median. A cell thus covers about `edge` x `edge` pixels.
        pub edge: f32 = 16.0 => "16", |edge| (1.0..=65536.0).contains(&edge), "1 to 65536 pixels";
        /// Largest angle between a cell's normals and their mean, in degrees.
        ///
        /// The default 10 is the value of [Lan 2016].
        pub normals: f32 = 10.0 => "10", |degrees| degrees > 0.0 && degrees <= 90.0, "above 0 and at most 90 degrees";
    }
}

/// A partition of an image's first hits into cells, small patches of surface.
///
/// Two hits share a cell if they have the same key: the same cube of a grid, the same material, and normals in the same
/// bin of an octahedron [Engelhardt and Dachsbacher 2008]. They must also be connected in the image through
/// neighbouring hits with the same key. The cubes' size follows the pixel's footprint in powers of two, so that near
/// and far cells cover about as many pixels. Then neighbouring cells that the grid cut apart are joined, smoothest seam
/// first, within the limits of a cell's normals and size. All probes without a hit are one cell.
///
/// # Guarantees
///
/// * Cells depend on the hits alone. Numbers of shapes, primitives and materials are only compared for equality, so
///   neither their order nor a finer triangulation changes the cells.
/// * The sizes of all cells add up to the number of probes.
/// * No hashing, no dependence on threads.
/// * Lengths are relative to the median footprint and to the bounding box of the hits. The unit of length affects only
///   rounding.
///
/// # Weaknesses
///
/// Cells cover only surfaces that some pixel saw.
#[derive(Clone, Debug, PartialEq)]
pub struct Cells {
    labels: Vec<u32>,
    per_pixel: usize,
    hits: Vec<u32>,
}

/// The grid cube, material and normal bin of a hit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Key {
    material: u32,
    octave: i32,
    place: [i32; 3],
    normal: u32,
}

/// The largest distance of a hit from the tangent plane of a neighbouring hit on one surface, in pixel footprints.
const PLANE: f32 = 2.0;

impl Cells {
    /// Builds the cells of an image of `size` pixels from the first hits of `per_pixel` probes per pixel, row by row.
    /// `None` is a probe without a hit.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] for options out of range, or if the number of hits is not `per_pixel` per pixel.
    pub fn new(
        hits: &[Option<FirstHit>],
        per_pixel: usize,
        size: [u32; 2],
        options: &CellOptions,
    ) -> Result<Self, Error> {
        options.check_ranges()?;
        let [width, height] = size.map(|n| n as usize);
        if per_pixel == 0 || hits.len() != width * height * per_pixel {
            return Err(out_of_range("hits", hits.len(), "as many as pixels times probes per pixel"));
        }
        let keys = keys(hits, options);
        let mut sets = Disjoint::new(hits.len());
        // Hits that share a key and are connected through neighbours; all misses are one cell.
        let mut miss = None;
        for (i, key) in keys.iter().enumerate() {
            if key.is_none() {
                sets.join(*miss.get_or_insert(i), i);
            }
        }
        let alike = |a: usize, b: usize| keys[a].is_some() && keys[a] == keys[b];
        for_neighbours([width, height], per_pixel, |a, b| {
            if alike(a, b) {
                sets.join(a, b);
            }
        });
        close_seams(hits, &keys, [width, height], per_pixel, options, &mut sets);
        Ok(Self::numbered(&mut sets, per_pixel))
    }

    /// Builds the cells of a film that recorded first hits ([`Needs::first_hits`](dapple_core::Needs)). Samples not yet
    /// traced count as misses.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] for options out of range, or a film that recorded no first hits.
    pub fn of_film(film: &Film, options: &CellOptions) -> Result<Self, Error> {
        let per_pixel = usize::from(film.needs().first_hits);
        if per_pixel == 0 {
            return Err(out_of_range("hits", 0, "first hits in the film: ask for them in needs()"));
        }
        let hits: Vec<_> = (0..film.frame().pixels()).flat_map(|i| film.first_hits(i)).copied().collect();
        Self::new(&hits, per_pixel, film.frame().size(), options)
    }

    /// Numbers the cells in the order of their first probes.
    fn numbered(sets: &mut Disjoint, per_pixel: usize) -> Self {
        const UNKNOWN: u32 = u32::MAX;
        let probes = sets.len();
        let mut numbers = vec![UNKNOWN; probes];
        let mut hits: Vec<u32> = Vec::new();
        let labels = (0..probes)
            .map(|i| {
                let number = &mut numbers[sets.root(i)];
                if *number == UNKNOWN {
                    *number = hits.len() as u32;
                    hits.push(0);
                }
                hits[*number as usize] += 1;
                *number
            })
            .collect();
        Self { labels, per_pixel, hits }
    }

    /// The largest number of bytes per hit that [`Cells::of_film`] takes: a copy of the hit, its key, and 33 bytes of
    /// sets, seams and labels. Measured on a million pixels of the Cornell box.
    pub(crate) const BYTES_PER_HIT: usize = size_of::<Option<FirstHit>>() + size_of::<Option<Key>>() + 33;

    /// The number of cells.
    pub fn len(&self) -> usize {
        self.hits.len()
    }

    /// Returns `true` if there are no cells, which means no pixels.
    pub fn is_empty(&self) -> bool {
        self.hits.is_empty()
    }

    /// The number of pixels in the image.
    pub fn pixels(&self) -> usize {
        self.labels.len() / self.per_pixel
    }

    /// The index of each probe's cell: `per_pixel` indices per pixel, row by row.
    pub fn labels(&self) -> &[u32] {
        &self.labels
    }

    /// The indices of the cells that the probes of `pixel` hit, in the order of the probes.
    pub fn of_pixel(&self, pixel: usize) -> &[u32] {
        &self.labels[pixel * self.per_pixel..][..self.per_pixel]
    }

    /// The number of probes in each cell, which measures its visible area.
    pub fn hits(&self) -> &[u32] {
        &self.hits
    }
}

/// Calls `visit` with the indices of each pair of neighbouring probes: within a pixel, and between a pixel and the ones
/// to the right and below.
fn for_neighbours([width, height]: [usize; 2], per_pixel: usize, mut visit: impl FnMut(usize, usize)) {
    for pixel in 0..width * height {
        let first = pixel * per_pixel;
        for b in 1..per_pixel {
            (0..b).for_each(|a| visit(first + a, first + b));
        }
        let right = (pixel % width + 1 < width).then_some(pixel + 1);
        let below = (pixel + width < width * height).then_some(pixel + width);
        for other in [right, below].into_iter().flatten() {
            for (a, b) in (0..per_pixel).flat_map(|a| (0..per_pixel).map(move |b| (a, b))) {
                visit(first + a, other * per_pixel + b);
            }
        }
    }
}

/// The grid cube, material and normal bin of each hit; `None` for a miss.
fn keys(hits: &[Option<FirstHit>], options: &CellOptions) -> Vec<Option<Key>> {
    let mut footprints: Vec<f32> = hits.iter().flatten().map(|h| h.footprint).filter(|f| *f > 0.0).collect();
    let middle = footprints.len() / 2;
    let reference = match footprints.is_empty() {
        true => 1.0,
        false => *footprints.select_nth_unstable_by(middle, f32::total_cmp).1,
    };
    let mut corner = [f32::INFINITY; 3];
    for hit in hits.iter().flatten() {
        (0..3).for_each(|a| corner[a] = corner[a].min(hit.position[a]));
    }
    // A bin is about as wide as a cell's cone: side^2 bins of (2 normals)^2 over 4 pi.
    let side = (std::f32::consts::PI.sqrt() / options.normals.to_radians()).clamp(1.0, 1024.0).round();
    let key = |hit: &FirstHit| {
        // The exponent alone: whole octaves, the same on every machine.
        let ratio = (hit.footprint / reference).clamp(1e-9, 1e9);
        let octave = (ratio.to_bits() >> 23) as i32 - 127;
        let edge = options.edge * reference * f32::from_bits(((octave + 127) as u32) << 23);
        let place = |a: usize| ((hit.position[a] - corner[a]) / edge).floor().clamp(-2e9, 2e9) as i32;
        let normal = bin(hit.shading_normal, side);
        Key { material: hit.material, octave, place: [place(0), place(1), place(2)], normal }
    };
    hits.iter().map(|hit| hit.as_ref().map(key)).collect()
}

/// The index of a direction's bin. An octahedron maps the unit sphere to a square of `side` x `side` bins [Engelhardt
/// and Dachsbacher 2008].
fn bin([x, y, z]: [f32; 3], side: f32) -> u32 {
    let norm = x.abs() + y.abs() + z.abs();
    if norm.is_nan() || norm == 0.0 {
        return 0;
    }
    let (x, y) = (x / norm, y / norm);
    let (x, y) = if z >= 0.0 { (x, y) } else { ((1.0 - y.abs()).copysign(x), (1.0 - x.abs()).copysign(y)) };
    let index = |x: f32| ((x + 1.0) * 0.5 * side).min(side - 1.0) as u32;
    index(y) * side as u32 + index(x)
}

/// The sum of a cell's normals, and their spread around its direction.
#[derive(Clone, Copy)]
struct Cone {
    sum: [f32; 3],
    /// The smallest cosine between a normal of the cell and the mean normal.
    cosine: f32,
}

/// Joins neighbouring cells where a surface continues across the borders of cubes and bins. Both hits must have the
/// same material, and normals that differ by less than a cell's cone. Each must lie within [`PLANE`] footprints of the
/// other's tangent plane. Pairs with the most similar normals are joined first. A cell never exceeds its limits of
/// normals and size.
fn close_seams(
    hits: &[Option<FirstHit>],
    keys: &[Option<Key>],
    size: [usize; 2],
    per_pixel: usize,
    options: &CellOptions,
    sets: &mut Disjoint,
) {
    let least = cosine_of_degrees(options.normals);
    let most = (options.edge * options.edge * per_pixel as f32) as u32;
    let mut seams: Vec<(f32, u32, u32)> = Vec::new();
    for_neighbours(size, per_pixel, |a, b| {
        let (Some(p), Some(q)) = (&hits[a], &hits[b]) else { return };
        if keys[a] == keys[b] || p.material != q.material {
            return;
        }
        let cosine = dot(p.shading_normal, q.shading_normal);
        let between = minus(p.position, q.position);
        let apart = dot(p.geometric_normal, between).abs().max(dot(q.geometric_normal, between).abs());
        if cosine >= least && apart <= PLANE * p.footprint.max(q.footprint) {
            seams.push((cosine, a as u32, b as u32));
        }
    });
    seams.sort_by(|a, b| b.0.total_cmp(&a.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    let mut cones = cones(hits, sets);
    for (_, a, b) in seams {
        let (a, b) = (sets.root(a as usize), sets.root(b as usize));
        if a == b || sets.size(a) + sets.size(b) > most {
            continue;
        }
        let joint = joint(&cones[a], &cones[b]);
        if joint.cosine >= least {
            let root = sets.join(a, b);
            cones[root] = joint;
        }
    }
}

/// The cone of normals of each set of hits (a cell), stored at the index of the set's root.
fn cones(hits: &[Option<FirstHit>], sets: &mut Disjoint) -> Vec<Cone> {
    let mut cones = vec![Cone { sum: [0.0; 3], cosine: 1.0 }; hits.len()];
    for (i, hit) in hits.iter().enumerate() {
        if let Some(hit) = hit {
            let sum = &mut cones[sets.root(i)].sum;
            (0..3).for_each(|a| sum[a] += hit.shading_normal[a]);
        }
    }
    for (i, hit) in hits.iter().enumerate() {
        if let Some(hit) = hit {
            let cone = &mut cones[sets.root(i)];
            cone.cosine = cone.cosine.min(dot(unit(cone.sum), hit.shading_normal));
        }
    }
    cones
}

/// Returns a cone of normals that contains both cones.
fn joint(a: &Cone, b: &Cone) -> Cone {
    let sum = [a.sum[0] + b.sum[0], a.sum[1] + b.sum[1], a.sum[2] + b.sum[2]];
    let axis = unit(sum);
    let sine = |cosine: f32| (1.0 - cosine * cosine).max(0.0).sqrt();
    // The cosine of the sum of two angles; -1, which no cone reaches, beyond a right angle.
    let to = |cone: &Cone| {
        let turned = dot(axis, unit(cone.sum));
        if turned <= 0.0 || cone.cosine <= 0.0 { -1.0 } else { turned * cone.cosine - sine(turned) * sine(cone.cosine) }
    };
    Cone { sum, cosine: to(a).min(to(b)) }
}

/// The cosine of 0 to 90 degrees by its Taylor polynomial, with error below 1e-7 and the same bits on every machine.
fn cosine_of_degrees(degrees: f32) -> f32 {
    let x = f64::from(degrees).to_radians();
    let (mut term, mut sum) = (1.0, 1.0);
    for k in 1..9 {
        term *= -x * x / f64::from((2 * k - 1) * 2 * k);
        sum += term;
    }
    sum as f32
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn minus(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn unit(v: [f32; 3]) -> [f32; 3] {
    let length = dot(v, v).sqrt();
    if length > 0.0 { v.map(|x| x / length) } else { v }
}
