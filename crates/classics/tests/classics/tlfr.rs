//! Samples that are moved over lens and time.

use crate::recorders::Singles;
use crate::samples::{At, Axes, Near, Sample, Seen, Tree, covers, divide, join_small, on_disk, radius, surrounds};
use crate::support::{Traced, domain, film_points, frame, image, sobol as net, unit};
use dapple_classics::{Defocus, FilmPoints, Role, Tlfr, TlfrOptions};
use dapple_core::integrator::Trajectory;
use dapple_core::samplers::Uniform;
use dapple_core::{Block, Draws, Error, Estimate, Film, Filter as _, Limits, PointSet as _, Render, SampleId, Worker};

/// A plane parallel to the image. Its points are named by their place in the image at the opening of the shutter, seen
/// through the lens' centre. The depth is then 1.
struct Plane {
    inverse_depth: f64,
    /// The change of `(x w, y w, w)` over the exposure, in units of the plane's depth at the opening.
    motion: [f64; 3],
    colour: fn([f64; 2]) -> Option<[f32; 3]>,
}

impl Plane {
    /// The plane's point seen at `at`, and its inverse depth at that time.
    fn point(&self, at: &At, defocus: &Defocus) -> ([f64; 2], f64) {
        let depth = 1.0 + at.time * self.motion[2];
        let blur = radius(defocus, self.inverse_depth / depth);
        let of = |axis: usize| (at.place[axis] - blur[axis] * at.lens[axis]) * depth - at.time * self.motion[axis];
        ([of(0), of(1)], self.inverse_depth / depth)
    }
}

fn moving(radiance: [f32; 3], path: Option<Trajectory>) -> Estimate {
    let mut estimate = Estimate::new(radiance);
    estimate.trajectory = path;
    estimate
}

/// Planes from front to back, before a black background at rest.
struct Planes {
    planes: Vec<Plane>,
    defocus: Defocus,
}

impl Planes {
    fn seen(&self, at: &At) -> ([f32; 3], Option<Trajectory>) {
        for plane in &self.planes {
            let (point, inverse_depth) = plane.point(at, &self.defocus);
            if let Some(colour) = (plane.colour)(point) {
                let motion = plane.motion.map(|x| (x / (1.0 + at.time * plane.motion[2])) as f32);
                return (colour, Some(Trajectory { inverse_depth: inverse_depth as f32, motion }));
            }
        }
        ([0.0; 3], None)
    }
}

/// The point of the light field of a sample with these random numbers.
fn at(pixel: [u32; 2], place: [f32; 4], rest: [f32; 4]) -> At {
    let of = |axis: usize| f64::from(pixel[axis]) + f64::from(place[axis]);
    let [u, v, time, _] = rest.map(f64::from);
    At { place: [of(0), of(1)], lens: on_disk([u, v]), time }
}

const ALL: [Role; 3] = [Role::Lens, Role::Lens, Role::Time];
const NONE: Defocus = Defocus::new([0.0; 2], [0.0; 2]);

fn sobol(roles: &[Role], defocus: Defocus) -> FilmPoints {
    film_points(net(3), roles, None).with_defocus(Some(defocus))
}

fn tlfr(roles: &[Role], defocus: Defocus, points: u32) -> Tlfr {
    Tlfr::new(sobol(roles, defocus), TlfrOptions::default().points(points)).unwrap()
}

/// An empty film that records all samples with their trajectories.
fn empty(size: [u32; 2]) -> Film {
    Film::with_recorders(frame(size), Singles::Moving.needs(), Singles::Moving.list())
}

/// The film of planes that are seen at `at` of pixel and random numbers.
fn film_at(at: fn([u32; 2], [f32; 4], [f32; 4]) -> At, planes: &Planes, size: [u32; 2], spp: f64) -> Film {
    let mut scene = Traced(|draws: &Draws<'_>, _: &mut Worker| {
        let (colour, path) = planes.seen(&at(draws.pixel(), draws.block(Block::new(0)), draws.block(Block::new(1))));
        moving(colour, path)
    });
    let limits = Limits::spp(spp);
    let render = Render::new(frame(size), &limits).needs(Singles::Moving.needs()).recorders(Singles::Moving.list());
    render.run(&mut scene, &mut Uniform::new(net(3))).unwrap()
}

fn film(planes: &Planes, size: [u32; 2], spp: f64) -> Film {
    film_at(at, planes, size, spp)
}

/// All samples of a film of `spp` samples per pixel: their points of the light field, and their radiance.
fn all_samples(film: &Film) -> Vec<(At, [f32; 3])> {
    let of = |id: SampleId| at(id.pixel, net(3).block(id, 0), net(3).block(id, 1));
    let pixel = |i: usize| {
        let samples = Singles::Moving.of(film, "a test").unwrap();
        samples.of_half(0, i).enumerate().map(move |(k, (radiance, _))| (of(film.sample_id(0, i, k)), radiance))
    };
    (0..film.frame().pixels()).flat_map(pixel).collect()
}

/// The mean of values at places, weighted by a tent around `centre`.
fn tent(values: &[([f64; 2], [f32; 3])], centre: [f64; 2], radius: f64) -> [f64; 3] {
    let (mut sum, mut weights) = ([0.0; 3], 0.0);
    for (place, value) in values {
        let distance = (place[0] - centre[0]).hypot(place[1] - centre[1]);
        let weight = (1.0 - distance / radius).max(0.0);
        weights += weight;
        (0..3).for_each(|c| sum[c] += weight * f64::from(value[c]));
    }
    sum.map(|x| x / weights)
}

fn noise([x, y]: [f64; 2]) -> Option<[f32; 3]> {
    let key = (x * 1e4) as u64 ^ ((y * 1e4) as u64) << 20;
    Some([unit(key), unit(key ^ 1 << 50), 4.0 * unit(key ^ 1 << 51)])
}

#[test]
fn a_static_image_in_focus_is_the_input_filtered_by_a_tent() {
    let still = |inverse_depth| Plane { inverse_depth, motion: [0.0; 3], colour: noise };
    let defocus = Defocus::new([20.0, -20.0], [-10.0, 10.0]);
    // The radius is that of the published table.
    for (roles, spp, radius, size) in [
        (&[][..], 1.0, 2.0, [6, 5]),
        (&[], 4.0, 1.1, [6, 5]),
        (&[], 1024.0, 0.07, [2, 2]),
        (&[Role::Time], 16.0, 0.5, [6, 5]),
        (&ALL, 16.0, 0.5, [6, 5]),
    ] {
        let film = film(&Planes { planes: vec![still(2.0)], defocus }, size, spp);
        let values: Vec<_> = all_samples(&film).iter().map(|(at, value)| (at.place, *value)).collect();
        let axes = Axes::of(&domain(roles));
        for (i, found) in image(&tlfr(roles, defocus, 32), &film).iter().enumerate() {
            let points = (0..32).map(|k| axes.output(film.frame().pixel(i), k));
            let colours: Vec<_> = points.map(|at| tent(&values, at.place, radius)).collect();
            for c in 0..3 {
                let expected = colours.iter().map(|colour| colour[c]).sum::<f64>() / 32.0;
                assert!((f64::from(found[c]) - expected).abs() < 1e-5, "pixel {i}: {found:?} and {expected}");
            }
        }
    }
}

/// Without axes of lens and time, depths and motions have no effect.
#[test]
fn a_domain_of_the_place_alone_is_filtered_by_a_tent_whatever_moves() {
    let images = [[0.0; 3], [9.0, -3.0, 0.5]].map(|motion| {
        let planes = Planes { planes: vec![Plane { inverse_depth: 2.0, motion, colour: noise }], defocus: NONE };
        // The integrator's own time is 0, so that colours are the same.
        let at_opening = |pixel, place, _| at(pixel, place, [0.5, 0.5, 0.0, 0.0]);
        image(&tlfr(&[], NONE, 16), &film_at(at_opening, &planes, [5, 4], 4.0))
    });
    assert_eq!(images[0], images[1]);
}

#[test]
fn a_moving_plane_out_of_focus_is_filtered_by_a_tent_on_the_plane() {
    let defocus = Defocus::new([9.0, -8.0], [-2.0, 1.5]);
    for motion in [[5.0, -3.0, 0.0], [4.0, 2.0, 0.25]] {
        let plane = || Plane { inverse_depth: 1.5, motion, colour: noise };
        let film = film(&Planes { planes: vec![plane()], defocus }, [24, 20], 16.0);
        let (found, axes) = (image(&tlfr(&ALL, defocus, 4), &film), Axes::of(&domain(&ALL)));
        let samples = all_samples(&film);
        let mut checked = 0;
        for pixel in (0..60).map(|k| [8 + k % 8, 6 + k / 8]) {
            let mut expected = [0.0; 3];
            for at in (0..4).map(|k| axes.output(pixel, k)) {
                // Through the lens' centre at the time of the output point.
                let ([x, y], _) = plane().point(&at, &defocus);
                let (depth, time) = (1.0 + at.time * motion[2], at.time);
                let seen = |[x, y]: [f64; 2]| [(x + time * motion[0]) / depth, (y + time * motion[1]) / depth];
                let values: Vec<_> =
                    samples.iter().map(|(at, value)| (seen(plane().point(at, &defocus).0), *value)).collect();
                let colour = tent(&values, seen([x, y]), 0.5);
                (0..3).for_each(|c| expected[c] += colour[c] / 4.0);
            }
            if !expected[0].is_finite() {
                continue;
            }
            let found = found[(pixel[1] * 24 + pixel[0]) as usize].map(f64::from);
            assert!((0..3).all(|c| (found[c] - expected[c]).abs() < 2e-4), "{pixel:?}: {found:?} and {expected:?}");
            checked += 1;
        }
        assert!(checked > 20, "{checked}");
    }
}

const MIDDLE: u32 = 28;
const SIZE: [u32; 2] = [2 * MIDDLE, 30];

/// A red half plane before a blue plane.
fn half_plane(blur: f32, motion: [f64; 3]) -> Planes {
    let front = Plane { inverse_depth: 1.0, motion, colour: left };
    let back = Plane { inverse_depth: 0.0, motion: motion.map(|x| -0.5 * x), colour: blue };
    Planes { planes: vec![front, back], defocus: Defocus::new([0.0; 2], [blur, -blur]) }
}

/// The rows and columns in which red is counted, far from the image's edges.
const ROWS: std::ops::Range<u32> = 11..19;
const COLUMNS: std::ops::Range<u32> = MIDDLE - 12..MIDDLE + 16;

/// The share of red in each column: of the true colours, and of the reconstructed ones.
fn shares_of_red(planes: &Planes, film: &Film) -> Vec<[f64; 2]> {
    const POINTS: u32 = 16;
    let (image, axes) = (image(&tlfr(&ALL, planes.defocus, POINTS), film), Axes::of(&domain(&ALL)));
    let of = |column: u32| {
        ROWS.fold([0.0; 2], |[truth, found], row| {
            let red = |k| f64::from(planes.seen(&axes.output([column, row], k)).0[0]);
            let pixel = (row * SIZE[0] + column) as usize;
            let share = (0..POINTS).map(red).sum::<f64>() / f64::from(POINTS);
            [truth + share / 8.0, found + f64::from(image[pixel][0]) / 8.0]
        })
    };
    COLUMNS.step_by(2).map(of).collect()
}

/// The share of mixed colours, if one point is reconstructed in each pixel.
fn mixed(planes: &Planes, film: &Film) -> f64 {
    let image = image(&tlfr(&ALL, planes.defocus, 1), film);
    let inner = ROWS.flat_map(|row| COLUMNS.map(move |column| (row * SIZE[0] + column) as usize));
    let is_mixed = |i: &usize| image[*i][0] > 1e-6 && image[*i][2] > 1e-6;
    inner.clone().filter(is_mixed).count() as f64 / inner.count() as f64
}

/// Red to the left of the middle, nothing to its right.
fn left([x, _]: [f64; 2]) -> Option<[f32; 3]> {
    (x < f64::from(MIDDLE)).then_some([1.0, 0.0, 0.0])
}

fn blue(_: [f64; 2]) -> Option<[f32; 3]> {
    Some([0.0, 0.0, 1.0])
}

#[test]
fn two_planes_that_cross_hardly_mix() {
    for (blur, motion, spp) in
        [(8.0, [8.0, 4.0, 0.0], 32.0), (8.0, [0.0; 3], 32.0), (-8.0, [0.0, 6.0, 0.0], 32.0), (8.0, [0.0; 3], 128.0)]
    {
        let planes = half_plane(blur, motion);
        let film = film(&planes, SIZE, spp);
        let columns = shares_of_red(&planes, &film);
        let apart = columns.iter().map(|red| (red[1] - red[0]).abs());
        let (worst, mean) = (apart.clone().fold(0.0, f64::max), apart.sum::<f64>() / columns.len() as f64);
        assert!(worst < 0.03 && mean < 0.005, "{motion:?}: off by {mean}, at most {worst}");
        // In between, both are seen.
        assert!(columns.iter().filter(|red| red[0] > 0.05 && red[0] < 0.95).count() >= 5);
        // Surfaces of less than four samples join the one behind.
        let mixed = mixed(&planes, &film);
        assert!(mixed <= if spp > 100.0 { 0.0 } else { 0.001 }, "{motion:?}: {mixed} of the points");
    }
}

/// Negative control of the test before: samples that are all taken as a background at rest mix.
#[test]
fn planes_at_rest_mix() {
    let planes = half_plane(8.0, [0.0; 3]);
    let mut film = empty(SIZE);
    for i in 0..film.frame().pixels() {
        for k in 0..32 {
            let id = film.sample_id(0, i, k);
            let colour = planes.seen(&at(id.pixel, net(3).block(id, 0), net(3).block(id, 1))).0;
            film.push_estimate(i, 0, &moving(colour, Some(Trajectory { inverse_depth: 0.0, motion: [0.0; 3] })));
        }
    }
    let mixed = mixed(&Planes { defocus: NONE, ..planes }, &film);
    assert!(mixed > 0.1, "{mixed}");
}

#[test]
fn senseless_trajectories_spoil_no_other_samples() {
    for path in [
        Trajectory { inverse_depth: f32::MAX, motion: [0.0; 3] },
        Trajectory { inverse_depth: 1.0, motion: [f32::MAX, 0.0, 0.0] },
        Trajectory { inverse_depth: 1.0, motion: [0.0, -1e30, f32::MAX] },
        Trajectory { inverse_depth: f32::MIN_POSITIVE, motion: [0.0, 0.0, -f32::MAX] },
        Trajectory { inverse_depth: f32::NAN, motion: [0.0; 3] },
    ] {
        let mut film = empty([4, 4]);
        for (i, k) in (0..16).flat_map(|i| (0..4).map(move |k| (i, k))) {
            let path = if (i + k) % 3 == 0 { path } else { Trajectory { inverse_depth: 0.5, motion: [1.0, 0.0, 0.0] } };
            film.push_estimate(i, 0, &moving([0.5; 3], Some(path)));
        }
        let image = image(&tlfr(&ALL, Defocus::new([2.0, -2.0], [4.0, -4.0]), 16), &film);
        assert!(image.iter().flatten().all(|x| (x - 0.5).abs() < 1e-5), "{path:?}: {image:?}");
    }
}

#[test]
fn lenses_of_unknown_blur_and_films_without_trajectories_are_refused() {
    let points = |roles: &[Role]| film_points(net(3), roles, None);
    let error = Tlfr::new(points(&ALL), TlfrOptions::default()).unwrap_err();
    assert!(error.to_string().contains("unknown blur"), "{error}");
    assert!(Tlfr::new(points(&[Role::Time]), TlfrOptions::default()).is_ok());
    assert!(Tlfr::new(points(&[]), TlfrOptions::default().points(0)).is_err());
    let mut film = empty([1, 1]);
    film.push(0, 0, [1.0; 3]);
    let refused = tlfr(&[], NONE, 4).apply(&film);
    assert!(matches!(refused, Err(Error::NoneReported { .. })), "{refused:?}");
}

#[test]
fn every_axis_of_the_output_points_has_one_point_in_each_of_128_intervals() {
    let axes = Axes::of(&domain(&ALL));
    let of: [fn(&At) -> f64; 3] = [|at| at.place[0] - 7.0, |at| at.place[1] - 5.0, |at| at.time];
    for of in of {
        let mut cells: Vec<u32> = (0..128).map(|k| (128.0 * of(&axes.output([7, 5], k))) as u32).collect();
        cells.sort_unstable();
        assert!(cells.iter().copied().eq(0..128), "{cells:?}");
    }
    // The lens gets a net: in each quarter of the turn and half of the area, 16 points.
    let mut counts = [0; 8];
    for [x, y] in (0..128).map(|k| axes.output([7, 5], k).lens) {
        let quarter = usize::from(x.abs() > y.abs()) + 2 * usize::from(if x.abs() > y.abs() { x } else { y } > 0.0);
        counts[2 * quarter + usize::from(x * x + y * y > 0.5)] += 1;
    }
    assert!(counts.iter().all(|n| (14..=18).contains(n)), "{counts:?}");
}

#[test]
fn the_map_to_the_disk_keeps_area() {
    let inside = (0..10_000).filter(|k| {
        let [x, y] = on_disk([0.005 + f64::from(k % 100) / 100.0, 0.005 + f64::from(k / 100) / 100.0]);
        assert!(x * x + y * y <= 1.0);
        x * x + y * y < 0.25
    });
    assert!((inside.count() as f64 - 2500.0).abs() <= 100.0);
    assert_eq!([on_disk([0.5, 0.5]), on_disk([1.0, 0.5]), on_disk([0.5, 0.0])], [[0.0, 0.0], [1.0, 0.0], [0.0, -1.0]]);
}

#[test]
fn samples_that_pass_the_camera_are_at_rest() {
    let at = At { place: [3.0, 4.0], time: 0.5, ..At::default() };
    let none = Defocus::new([0.0; 2], [0.0; 2]);
    let sample = Sample::new(&at, &Trajectory { inverse_depth: 1.0, motion: [0.0, 0.0, -3.0] }, &none, [1.0; 3]);
    assert_eq!(sample.seen(&none, [0.0; 2], 1.0).place, [3.0, 4.0]);
}

#[test]
fn a_gather_finds_exactly_the_samples_within_reach() {
    let defocus = Defocus::new([9.0, -8.0], [-20.0, 18.0]);
    let of = |k: u64| {
        let u = |lane: u64| f64::from(unit(16 * k + lane));
        let at = At { place: [40.0 * u(0), 30.0 * u(1)], lens: on_disk([u(2), u(3)]), time: u(4) };
        let motion = [6.0 * u(5) - 3.0, 4.0 * u(6) - 2.0, 1.4 * u(7) - 0.7].map(|x| x as f32);
        (at, Trajectory { inverse_depth: u(8) as f32, motion })
    };
    let made = (0..3000).map(|k| {
        let (at, path) = of(k);
        Sample::new(&at, &path, &defocus, [k as f32; 3])
    });
    let samples: Vec<Sample> = made.collect();
    let tree = Tree::new(samples.clone(), defocus);
    let mut most = 0;
    for k in 0..400 {
        let (at, reach) = (of(10_000 + k).0, 0.3 * (1 << (k % 4)) as f64);
        let mut found = Vec::new();
        tree.gather(&at, reach, |index, _| found.push(tree.sample(index).radiance[0]));
        found.sort_by(f32::total_cmp);
        let near = |sample: &&Sample| {
            let [x, y] = sample.seen(&defocus, at.lens, at.time).place;
            (x - at.place[0]).powi(2) + (y - at.place[1]).powi(2) <= reach * reach
        };
        let expected: Vec<f32> = samples.iter().filter(near).map(|sample| sample.radiance[0]).collect();
        assert_eq!(found, expected);
        most = most.max(found.len());
    }
    assert!(most > 20, "{most}");
}

#[test]
fn a_sample_made_at_a_point_is_seen_there() {
    let defocus = Defocus::new([9.0, -8.0], [-20.0, 18.0]);
    let at = At { place: [17.5, 3.25], lens: [0.5, -0.25], time: 0.75 };
    let sample = Sample::new(&at, &Trajectory { inverse_depth: 0.7, motion: [2.0, -1.0, 0.3] }, &defocus, [0.0; 3]);
    let seen = sample.seen(&defocus, at.lens, at.time);
    assert!((0..2).all(|axis| (seen.place[axis] - at.place[axis]).abs() < 1e-5), "{seen:?}");
    // Its changes with lens and time are those of finite differences.
    let step = 1e-6;
    let later = sample.seen(&defocus, at.lens, at.time + step);
    let aside = sample.seen(&defocus, at.lens.map(|x| x + step), at.time);
    for axis in 0..2 {
        let [by_time, by_lens] = [later, aside].map(|other| (other.place[axis] - seen.place[axis]) / step);
        assert!((by_time - seen.by_time[axis]).abs() < 1e-3 && (by_lens - seen.by_lens[axis]).abs() < 1e-3);
    }
}

fn seen(place: [f64; 2], by_lens: f64, by_time: [f64; 2]) -> Seen {
    Seen { place, inverse_depth: 1.0, by_lens: [by_lens; 2], by_time }
}

#[test]
fn samples_pass_each_other_exactly_if_their_offset_reverses_within_the_box() {
    let rest = seen([0.0; 2], 0.0, [0.0; 2]);
    for (other, expected) in [
        (seen([0.5, 0.0], 4.9, [0.0; 2]), false),
        (seen([0.5, 0.0], -5.1, [0.0; 2]), true),
        (seen([0.5, 0.0], 0.0, [9.9, 0.0]), false),
        (seen([0.5, 0.0], 0.0, [-10.1, 0.0]), true),
        (seen([0.5, 0.0], 0.0, [0.0, 99.0]), false),
        (seen([0.0, 0.0], 0.0, [0.0, 0.0]), false),
        (seen([0.0, 0.0], 0.0, [0.1, 0.0]), true),
    ] {
        for mut both in [[(0, rest), (1, other)], [(0, other), (1, rest)]] {
            let mut ends = Vec::new();
            divide(&mut both, [0.1, 0.05], &mut ends);
            assert_eq!(ends.len() == 2, expected, "{other:?}");
        }
    }
}

#[test]
fn small_surfaces_join_the_next_one_and_the_last_stays() {
    let joined = |ends: &[usize]| {
        let mut ends = ends.to_vec();
        join_small(&mut ends);
        ends
    };
    assert_eq!(joined(&[3, 7, 8, 9, 12, 14]), [7, 12, 14]);
    assert_eq!(joined(&[2]), [2]);
    assert_eq!(joined(&[4, 8]), [4, 8]);
}

#[test]
fn a_triangle_covers_the_points_inside_and_no_others() {
    let corners = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]];
    let around = |[x, y]: [f64; 2], radius: f64| {
        let near: Vec<Near> = corners.map(|[a, b]| (0, seen([a - x, b - y], 0.0, [0.0; 2]))).to_vec();
        covers(&near, radius)
    };
    for (k, inside) in (0..400).map(|k| (k, [0.037, 0.041].map(|x| x - 0.2))) {
        let [x, y] = [inside[0] + 0.07 * f64::from(k % 20), inside[1] + 0.07 * f64::from(k / 20)];
        assert_eq!(around([x, y], 0.8), x > 0.0 && y > 0.0 && x + y < 1.0, "{x} {y}");
    }
    assert!(!around([0.3, 0.3], 0.7), "an edge is longer than two radii");
    assert!(covers(&vec![(0, seen([9.0, 9.0], 0.0, [0.0; 2])); 200], 0.1));
}

#[test]
fn samples_in_four_quadrants_surround() {
    let of = |places: &[[f64; 2]]| places.iter().map(|&place| (0, seen(place, 0.0, [0.0; 2]))).collect::<Vec<Near>>();
    assert!(surrounds(&of(&[[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [0.0, -2.0]])));
    assert!(!surrounds(&of(&[[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [-0.1, -2.0]])));
}
