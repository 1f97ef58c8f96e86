//! Samples with their trajectories over lens and time, and output points.

use crate::recorders::FilmSamples;
use crate::{Defocus, Domain, FilmPoints, Role};
use dapple_core::{Trajectory, mix};

/// The least depth, relative to a sample's own, at which its motion may start and end. Samples that come nearer to the
/// camera are taken as being at rest.
const NEAREST: f32 = 1e-3;

/// The largest distance from the image, in pixels, at which a sample may lie. Faster motions are taken as rest.
const FARTHEST: f32 = 1e9;
/// The largest inverse depth.
const CLOSEST: f32 = 1e30;

/// A point of the light field: the place in the image in pixels, the point on the unit disk of the lens, and the time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct At {
    pub(super) place: [f64; 2],
    pub(super) lens: [f64; 2],
    pub(super) time: f64,
}

/// A sample that can be moved to any point on the lens and any time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Sample {
    /// The place `(x w, y w, w)` through the lens' centre when the shutter opens, with the depth `w` relative to the
    /// sample's own.
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
    /// The change of the place with the two coordinates of the lens, and with time.
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
    /// The sample that lies at `at` and has this trajectory.
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

    /// The place through the lens' centre, and the inverse depth, at a time.
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

/// The axes of a domain that samples are moved along.
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

    /// The point of a sample with these coordinates in a pixel.
    fn point(&self, pixel: [u32; 2], coordinates: &[f32]) -> At {
        let of = |axis: usize| f64::from(coordinates[axis]);
        At {
            place: [0, 1].map(|axis| f64::from(pixel[axis]) + of(axis)),
            lens: self.lens.map_or([0.0; 2], |[u, v]| on_disk([of(u), of(v)])),
            time: self.time.map_or(0.0, of),
        }
    }

    /// Output point number `number` of a pixel: a Sobol' point [Joe and Kuo 2008] with digits exchanged by the pixel.
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

/// The samples of a film.
pub(super) fn read(recorded: &FilmSamples<'_>, points: &FilmPoints, defocus: &Defocus) -> Vec<Sample> {
    let (film, domain, placed) = (recorded.film, points.domain(), points.now());
    let axes = Axes::of(domain);
    let mut samples = Vec::with_capacity(film.counts().iter().sum::<u64>() as usize);
    for i in 0..film.frame().pixels() {
        for (half, (number, (radiance, path))) in recorded.of_pixel(i) {
            let mut coordinates = [0.0; Domain::MOST];
            let id = film.sample_id(half, i, number);
            domain.read(&placed, id, &mut coordinates);
            let path = if axes.time.is_some() { path } else { Trajectory::new(path.inverse_depth, [0.0; 3]) };
            samples.push(Sample::new(&axes.point(id.pixel, &coordinates), &path, defocus, radiance));
        }
    }
    samples
}

/// The point of the unit disk for a point of the unit square, by the concentric map [Shirley and Chiu 1997].
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_axis_of_the_output_points_has_one_point_in_each_of_128_intervals() {
        for axis in 0..5 {
            let mut cells: Vec<u32> = (0..128).map(|number| sobol(axis, number) >> 25).collect();
            cells.sort_unstable();
            assert!(cells.iter().copied().eq(0..128), "axis {axis}");
        }
        // The lens gets a net: one point in each elementary interval.
        for wide in 0..=7 {
            let mut cells: Vec<u32> = (0..128)
                .map(|number| {
                    let [u, v] = [0, 1].map(|axis| u64::from(sobol(axis, number)));
                    ((u >> (32 - wide)) << (7 - wide) | v >> (25 + wide)) as u32
                })
                .collect();
            cells.sort_unstable();
            assert!(cells.iter().copied().eq(0..128), "2^{wide} columns");
        }
    }

    #[test]
    fn the_map_to_the_disk_keeps_area() {
        let inside = (0..10_000).filter(|k| {
            let [x, y] = on_disk([0.005 + f64::from(k % 100) / 100.0, 0.005 + f64::from(k / 100) / 100.0]);
            assert!(x * x + y * y <= 1.0);
            x * x + y * y < 0.25
        });
        assert!((inside.count() as f64 - 2500.0).abs() <= 100.0);
        assert_eq!(
            [on_disk([0.5, 0.5]), on_disk([1.0, 0.5]), on_disk([0.5, 0.0])],
            [[0.0, 0.0], [1.0, 0.0], [0.0, -1.0]]
        );
    }

    #[test]
    fn samples_that_pass_the_camera_are_at_rest() {
        let at = At { place: [3.0, 4.0], time: 0.5, ..At::default() };
        let none = Defocus::new([0.0; 2], [0.0; 2]);
        let sample = Sample::new(&at, &Trajectory::new(1.0, [0.0, 0.0, -3.0]), &none, [1.0; 3]);
        assert_eq!(sample.seen(&none, [0.0; 2], 1.0).place, [3.0, 4.0]);
    }
}
