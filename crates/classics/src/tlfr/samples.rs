//! Samples with their trajectories over lens and time, output points, a tree of samples with bounds that are linear in time,
//! and the division of samples into surfaces.

use crate::recorders::FilmSamples;
use crate::{Defocus, Domain, FilmPoints, Role};
use dapple_core::integrator::Trajectory;
use dapple_core::point_set::mix;

/// The least depth, relative to a sample's own depth, that its motion may reach. A sample that comes nearer to the camera is
/// treated as being at rest.
const NEAREST: f32 = 1e-3;

/// The largest distance in pixels of a sample from the image. Samples with faster motion are treated as being at rest.
const FARTHEST: f32 = 1e9;
/// The largest inverse depth.
const CLOSEST: f32 = 1e30;

/// A point of the light field: the position in the image in pixels, the point on the unit disk of the lens, and the time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct At {
    pub(super) place: [f64; 2],
    pub(super) lens: [f64; 2],
    pub(super) time: f64,
}

/// A sample that can be moved to any point on the lens and any time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Sample {
    /// The position `(x w, y w, w)` through the lens' centre when the shutter opens. The depth `w` is relative to the sample's
    /// own depth.
    start: [f32; 3],
    motion: [f32; 3],
    inverse_depth: f32,
    pub(super) radiance: [f32; 3],
}

/// A sample as seen through a point on the lens at a time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Seen {
    pub(super) place: [f64; 2],
    pub(super) inverse_depth: f64,
    /// The derivative of the position by the two lens coordinates; `by_time` is the derivative by time.
    pub(super) by_lens: [f64; 2],
    pub(super) by_time: [f64; 2],
}

/// The radius of the blur, in pixels, at an inverse depth.
pub(super) fn radius(defocus: &Defocus, inverse_depth: f64) -> [f64; 2] {
    let of =
        |axis: usize| f64::from(defocus.at_infinity[axis]) + f64::from(defocus.by_inverse_depth[axis]) * inverse_depth;
    [of(0), of(1)]
}

impl Sample {
    /// Creates a sample at the point `at` with this trajectory.
    pub(super) fn new(at: &At, trajectory: &Trajectory, defocus: &Defocus, radiance: [f32; 3]) -> Self {
        let inverse_depth = trajectory.inverse_depth.min(CLOSEST);
        let blur = radius(defocus, f64::from(inverse_depth));
        let place = |axis: usize| {
            let place = (at.place[axis] - blur[axis] * at.lens[axis]) as f32;
            place.clamp(-FARTHEST, FARTHEST)
        };
        let (x, y, time) = (place(0), place(1), at.time as f32);
        let back = |motion: [f32; 3]| [x - time * motion[0], y - time * motion[1], 1.0 - time * motion[2]];
        let start = back(trajectory.motion);
        let numbers = start.iter().chain(&trajectory.motion);
        let is_sound =
            start[2].min(start[2] + trajectory.motion[2]) > NEAREST && numbers.into_iter().all(|x| x.abs() < FARTHEST);
        let motion = if is_sound { trajectory.motion } else { [0.0; 3] };
        Self { start: back(motion), motion, inverse_depth, radiance }
    }

    /// The depth at a time, relative to the sample's own.
    pub(super) fn depth(&self, time: f64) -> f64 {
        f64::from(self.start[2]) + time * f64::from(self.motion[2])
    }

    /// The position through the lens' centre and the inverse depth, at a time.
    pub(super) fn through_centre(&self, time: f64) -> ([f64; 2], f64) {
        let share = self.depth(time).recip();
        let place = |axis: usize| (f64::from(self.start[axis]) + time * f64::from(self.motion[axis])) * share;
        ([place(0), place(1)], f64::from(self.inverse_depth) * share)
    }

    /// The sample as seen through a point on the lens at a time.
    pub(super) fn seen(&self, defocus: &Defocus, lens: [f64; 2], time: f64) -> Seen {
        let share = self.depth(time).recip();
        let (centre, inverse_depth) = self.through_centre(time);
        let by_lens = radius(defocus, inverse_depth);
        let towards = f64::from(self.motion[2]) * share;
        let of = |axis: usize| {
            let drift = f64::from(self.motion[axis]) * share - centre[axis] * towards;
            let widening = f64::from(defocus.by_inverse_depth[axis]) * inverse_depth * towards;
            (centre[axis] + by_lens[axis] * lens[axis], drift - widening * lens[axis])
        };
        let (x, y) = (of(0), of(1));
        Seen { place: [x.0, y.0], inverse_depth, by_lens, by_time: [x.1, y.1] }
    }
}

/// The axes of a domain along which samples are moved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Axes {
    lens: Option<[usize; 2]>,
    time: Option<usize>,
}

impl Axes {
    pub(super) fn of(domain: &Domain) -> Self {
        let mut of = [Role::Lens, Role::Time].map(|role| {
            let axes = domain.axes().iter().enumerate().filter(move |(_, axis)| axis.role == role);
            axes.map(|(axis, _)| axis)
        });
        let [lens, time] = &mut of;
        Self { lens: lens.next().zip(lens.next()).map(|(u, v)| [u, v]), time: time.next() }
    }

    pub(super) fn has_lens(&self) -> bool {
        self.lens.is_some()
    }

    /// The samples of a film.
    pub(super) fn samples(&self, all: &FilmSamples<'_>, points: &FilmPoints, defocus: &Defocus) -> Vec<Sample> {
        let (film, placed) = (all.film, points.now());
        let mut samples = Vec::with_capacity(film.counts().iter().sum::<u64>() as usize);
        for i in 0..film.frame().pixels() {
            for (half, (number, (radiance, path))) in all.of_pixel(i) {
                let mut coordinates = [0.0; Domain::MOST];
                let id = film.sample_id(half, i, number);
                points.domain().read(&placed, id, &mut coordinates);
                let of = |axis: usize| f64::from(coordinates[axis]);
                let at = At {
                    place: [0, 1].map(|axis| f64::from(id.pixel[axis]) + of(axis)),
                    lens: self.lens.map_or([0.0; 2], |[u, v]| on_disk([of(u), of(v)])),
                    time: self.time.map_or(0.0, of),
                };
                let path = if self.time.is_some() {
                    path
                } else {
                    Trajectory { inverse_depth: path.inverse_depth, motion: [0.0; 3] }
                };
                samples.push(Sample::new(&at, &path, defocus, radiance));
            }
        }
        samples
    }

    /// Output point `number` of a pixel: a Sobol' point [Joe and Kuo 2008] with digits scrambled by the pixel.
    pub(super) fn output(&self, pixel: [u32; 2], number: u32) -> At {
        let [column, row] = pixel.map(u64::from);
        let of = |axis: u32| {
            let bits = sobol(axis, number) ^ (mix(mix(column ^ row << 32) ^ u64::from(axis)) >> 32) as u32;
            f64::from(bits) / 4_294_967_296.0
        };
        At {
            place: [f64::from(pixel[0]) + of(2), f64::from(pixel[1]) + of(3)],
            lens: if self.has_lens() { on_disk([of(0), of(1)]) } else { [0.0; 2] },
            time: if self.time.is_some() { of(4) } else { 0.0 },
        }
    }
}

/// Maps a point of the unit square to the unit disk by the concentric map [Shirley and Chiu 1997].
pub(super) fn on_disk(u: [f64; 2]) -> [f64; 2] {
    let [a, b] = u.map(|u| 2.0 * u - 1.0);
    let flat = a.abs() > b.abs();
    let (near, far) = if flat { (b, a) } else { (a, b) };
    let angle = near / if far == 0.0 { 1.0 } else { far } * std::f64::consts::FRAC_PI_4;
    let (along, across) = (far * libm::cos(angle), far * libm::sin(angle));
    if flat { [along, across] } else { [across, along] }
}

/// Degree, inner coefficients and first direction numbers of the primitive polynomials of dimensions 2 to 5
/// [Joe and Kuo 2008].
const DIRECTIONS: [(u32, u32, [u32; 3]); 4] =
    [(1, 0, [1, 0, 0]), (2, 1, [1, 3, 0]), (3, 1, [1, 3, 1]), (3, 2, [1, 1, 1])];

/// Coordinate `axis`, 0 to 4, of a point of Sobol's sequence, as a fraction of 2^32.
fn sobol(axis: u32, number: u32) -> u32 {
    if axis == 0 {
        return number.reverse_bits();
    }
    let (degree, inner, first) = DIRECTIONS[axis as usize - 1];
    let mut directions = [0_u32; 32];
    let mut bits = 0;
    for k in 0..(32 - number.leading_zeros()) as usize {
        let s = degree as usize;
        directions[k] = if k < s {
            first[k] << (31 - k)
        } else {
            let mixed = (1..s).filter(|j| inner >> (s - 1 - j) & 1 == 1).map(|j| directions[k - j]);
            mixed.fold(directions[k - s] ^ directions[k - s] >> s, |all, one| all ^ one)
        };
        if number >> k & 1 == 1 {
            bits ^= directions[k];
        }
    }
    bits
}

/// The largest number of samples in a leaf.
const LEAF: usize = 8;
/// The smallest number of samples for which both halves of the tree are built in parallel.
const PARALLEL: usize = 1 << 14;

/// The bounds of a set of samples through the lens' centre, in column, row and inverse depth. They are stored for the opening
/// and for the closing of the shutter, and interpolated linearly in between.
#[derive(Clone, Copy, Debug)]
struct Bounds {
    low: [f32; 6],
    high: [f32; 6],
}

impl Bounds {
    const EMPTY: Self = Self { low: [f32::INFINITY; 6], high: [f32::NEG_INFINITY; 6] };

    /// The bounds of one sample at the opening and closing of the shutter. They are widened by the largest deviation of the
    /// sample's path from linear interpolation.
    fn of(sample: &Sample) -> Self {
        let [(from, near), (to, far)] = [sample.through_centre(0.0), sample.through_centre(1.0)];
        // The fraction of the path is `t b / ((1 - t) a + t b)` for depths `a` and `b`. This is the largest deviation from `t`.
        let [a, b] = [sample.depth(0.0).sqrt(), sample.depth(1.0).sqrt()];
        let apart = ((b - a) / (b + a)).abs();
        let mut bounds = Self::EMPTY;
        for (k, ends) in [[from[0], to[0]], [from[1], to[1]], [near, far]].into_iter().enumerate() {
            let slack = apart * (ends[1] - ends[0]).abs();
            for (end, x) in ends.into_iter().enumerate() {
                bounds.low[2 * k + end] = ((x - slack) as f32).next_down();
                bounds.high[2 * k + end] = ((x + slack) as f32).next_up();
            }
        }
        bounds
    }

    fn join(&mut self, other: &Self) {
        for k in 0..6 {
            self.low[k] = self.low[k].min(other.low[k]);
            self.high[k] = self.high[k].max(other.high[k]);
        }
    }

    /// The axis along which the samples spread most. Inverse depths are measured by their blur in pixels.
    fn widest(&self, defocus: &Defocus) -> usize {
        let blur = defocus.by_inverse_depth.map(f32::abs).into_iter().fold(0.0, f32::max);
        let extent = |k: usize| (self.high[k] - self.low[k]) * if k < 4 { 1.0 } else { blur };
        (1..6).fold(0, |best, k| if extent(k) > extent(best) { k } else { best })
    }

    /// Returns `true` if a sample within these bounds may be seen within `reach` of a point.
    fn reaches(&self, defocus: &Defocus, at: &At, reach: f64) -> bool {
        let between = |ends: &[f32; 6], k: usize| {
            let [from, to] = [2 * k, 2 * k + 1].map(|k| f64::from(ends[k]));
            from + at.time * (to - from)
        };
        let blurs = [between(&self.low, 2), between(&self.high, 2)].map(|q| radius(defocus, q));
        (0..2).all(|axis| {
            let [a, b] = blurs.map(|blur| blur[axis] * at.lens[axis]);
            let (low, high) = (between(&self.low, axis) + a.min(b), between(&self.high, axis) + a.max(b));
            low - reach <= at.place[axis] && at.place[axis] <= high + reach
        })
    }
}

#[derive(Clone, Copy, Debug)]
struct Node {
    bounds: Bounds,
    /// The distance to the second child in the list of nodes, or 0 for a leaf. The first child is the next node.
    second: u32,
}

/// A balanced tree; the samples are in the order of its leaves.
#[derive(Debug)]
pub(super) struct Tree {
    samples: Vec<Sample>,
    nodes: Vec<Node>,
    defocus: Defocus,
}

/// The number of nodes over `count` samples.
fn nodes(count: usize) -> usize {
    if count <= LEAF { 1 } else { 1 + nodes(count / 2) + nodes(count - count / 2) }
}

/// Sorts samples into a tree, and writes the tree's nodes.
fn build(samples: &mut [Sample], nodes: &mut [Node], defocus: &Defocus) {
    let mut bounds = Bounds::EMPTY;
    samples.iter().for_each(|sample| bounds.join(&Bounds::of(sample)));
    nodes[0] = Node { bounds, second: 0 };
    if samples.len() <= LEAF {
        return;
    }
    let axis = bounds.widest(defocus);
    let key = |sample: &Sample| {
        let (place, inverse_depth) = sample.through_centre((axis % 2) as f64);
        if axis < 4 { place[axis / 2] } else { inverse_depth }
    };
    let middle = samples.len() / 2;
    samples.select_nth_unstable_by(middle, |a, b| key(a).total_cmp(&key(b)));
    let (first, second) = samples.split_at_mut(middle);
    let behind = self::nodes(first.len());
    nodes[0].second = 1 + behind as u32;
    let (of_first, of_second) = nodes[1..].split_at_mut(behind);
    let mut both = [(first, of_first), (second, of_second)];
    if middle < PARALLEL {
        both.iter_mut().for_each(|(samples, nodes)| build(samples, nodes, defocus));
    } else {
        let [a, b] = &mut both;
        rayon::join(|| build(a.0, a.1, defocus), || build(b.0, b.1, defocus));
    }
}

impl Tree {
    /// The bytes per sample.
    pub(super) const BYTES: usize = size_of::<Sample>() + size_of::<Node>() / 2;

    pub(super) fn new(mut samples: Vec<Sample>, defocus: Defocus) -> Self {
        let mut nodes = vec![Node { bounds: Bounds::EMPTY, second: 0 }; nodes(samples.len())];
        build(&mut samples, &mut nodes, &defocus);
        Self { samples, nodes, defocus }
    }

    pub(super) fn sample(&self, index: u32) -> &Sample {
        &self.samples[index as usize]
    }

    /// Calls `visit` with the index of each sample within `reach` of a point, and with the sample as seen from there. Positions
    /// are relative to the point.
    pub(super) fn gather(&self, at: &At, reach: f64, mut visit: impl FnMut(u32, Seen)) {
        // Node, first sample, and number of samples. The depth of the tree is below 32.
        let mut stack = [(0_usize, 0_usize, 0_usize); 40];
        stack[0] = (0, 0, self.samples.len());
        let mut waiting = 1;
        while waiting > 0 {
            waiting -= 1;
            let (number, first, count) = stack[waiting];
            let node = &self.nodes[number];
            if !node.bounds.reaches(&self.defocus, at, reach) {
                continue;
            }
            if node.second > 0 {
                let half = count / 2;
                stack[waiting] = (number + node.second as usize, first + half, count - half);
                stack[waiting + 1] = (number + 1, first, half);
                waiting += 2;
                continue;
            }
            for index in first..first + count {
                let mut seen = self.samples[index].seen(&self.defocus, at.lens, at.time);
                (0..2).for_each(|axis| seen.place[axis] -= at.place[axis]);
                let [x, y] = seen.place;
                if x * x + y * y <= reach * reach {
                    visit(index as u32, seen);
                }
            }
        }
    }
}

/// A sample near the output point: its index, and the sample as seen relative to the point.
pub(super) type Near = (u32, Seen);

/// The smallest number of samples of a surface.
const LEAST: usize = 4;
/// The smallest number of samples with which a surface always covers the output point.
const MANY: usize = 200;

/// Returns `true` if two samples pass each other within a box around the output point. `lens` and `time` are the half widths of
/// the box on the lens and in time.
///
/// Samples pass each other if the offset between them reverses along its own direction.
fn pass(a: &Seen, b: &Seen, [lens, time]: [f64; 2]) -> bool {
    let apart = |of: fn(&Seen) -> [f64; 2]| [0, 1].map(|axis| of(b)[axis] - of(a)[axis]);
    let ([x, y], [u, v], [s, t]) = (apart(|seen| seen.place), apart(|seen| seen.by_lens), apart(|seen| seen.by_time));
    let least = lens * ((x * u).abs() + (y * v).abs()) + time * (x * s + y * t).abs();
    let moves = [u, v, s, t] != [0.0; 4];
    moves && x * x + y * y <= least
}

/// Sorts samples by depth, and divides them into surfaces: runs of samples of which no two pass each other. Writes the end of
/// each surface.
pub(super) fn divide(near: &mut [Near], widths: [f64; 2], ends: &mut Vec<usize>) {
    near.sort_unstable_by(|(a, p), (b, q)| q.inverse_depth.total_cmp(&p.inverse_depth).then(a.cmp(b)));
    ends.clear();
    let mut first = 0;
    for next in 1..near.len() {
        if near[first..next].iter().any(|(_, seen)| pass(seen, &near[next].1, widths)) {
            ends.push(next);
            first = next;
        }
    }
    if !near.is_empty() {
        ends.push(near.len());
    }
}

/// Merges each surface of fewer than four samples with the next one behind.
pub(super) fn join_small(ends: &mut Vec<usize>) {
    let (mut first, last) = (0, ends.last().copied());
    ends.retain(|&end| {
        let stays = end - first >= LEAST || Some(end) == last;
        if stays {
            first = end;
        }
        stays
    });
}

/// Returns `true` if there are samples in all four quadrants around the output point.
pub(super) fn surrounds(surface: &[Near]) -> bool {
    let quadrant = |(_, seen): &Near| 1 << (2 * u8::from(seen.place[0] >= 0.0) + u8::from(seen.place[1] >= 0.0));
    surface.iter().fold(0_u8, |all, near| all | quadrant(near)) == 15
}

/// Returns `true` if a surface covers the output point: if it has many samples, or if three of them form a triangle around the
/// point. The triangle's edges are at most two radii long, and one corner lies within one radius.
pub(super) fn covers(surface: &[Near], radius: f64) -> bool {
    let cross = |[ax, ay]: [f64; 2], [bx, by]: [f64; 2]| ax * by - ay * bx;
    let apart = |[ax, ay]: [f64; 2], [bx, by]: [f64; 2]| (ax - bx) * (ax - bx) + (ay - by) * (ay - by);
    let (inner, edge) = (radius * radius, 4.0 * radius * radius);
    let corners = || surface.iter().map(|(_, seen)| seen.place);
    let is_corner = |a: [f64; 2]| {
        let beside = |b: &[f64; 2]| apart(a, *b) <= edge;
        // Counterclockwise: b is to the left of the line from the point to a, and c to the right.
        corners().filter(beside).filter(|&b| cross(a, b) >= 0.0 && b != a).any(|b| {
            corners().filter(beside).any(|c| cross(c, a) >= 0.0 && cross(b, c) >= 0.0 && apart(b, c) <= edge && c != b)
        })
    };
    surface.len() >= MANY || corners().filter(|&a| apart(a, [0.0; 2]) <= inner).any(is_corner)
}
