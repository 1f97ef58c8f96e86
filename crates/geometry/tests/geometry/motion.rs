//! Motions at intermediate times, and their bounding boxes. At each time, a mesh with moving vertices equals a resting mesh
//! with the same corners.

use crate::support::*;
use dapple_geometry::{Error, Geometry, Instance, Mesh, Motion, MovingMesh, Ray, Shape, Sphere, spawn_ray};
use glam::{DAffine3, DQuat, DVec3, Vec3};
use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::Arc;

/// A random rotation, stretch and translation; mirrored if requested.
fn map(rng: &mut Pcg64Mcg, mirror: bool) -> DAffine3 {
    let matrix3 = turned_and_stretched(rng, 1.0, 1.0, mirror);
    DAffine3 { matrix3, translation: DVec3::from_array(std::array::from_fn(|_| rng.random_range(-5.0..5.0))) }
}

fn close(a: DAffine3, b: DAffine3, tolerance: f64) -> bool {
    a.abs_diff_eq(b, tolerance)
}

#[test]
fn boxes_contain_moving_objects_at_all_times() {
    let mut rng = generator(91);
    let (mut outside_of_ends, mut tightest) = (0, f64::INFINITY);
    for case in 0..500 {
        let mirror = case % 3 == 0;
        let first = DAffine3::from_translation(DVec3::new(rng.random_range(-9.0..9.0), 0.0, 0.0));
        let motion = Motion::between(map(&mut rng, mirror), map(&mut rng, mirror)).expect("invertible").after(first);
        let (low, high) = (DVec3::new(-1.0, -2.0, -0.5), DVec3::new(1.0, 0.5, 3.0));
        let [least, most] = motion.bounds(low, high);
        let ends = [0.0, 1.0].map(|time| Motion::still(motion.at(time)).bounds(low, high));
        let naive = [ends[0][0].min(ends[1][0]), ends[0][1].max(ends[1][1])];
        let (mut seen_low, mut seen_high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for _ in 0..200 {
            // A path leaves its box at the corners first.
            let corner = rng.random_range(0..2) == 0;
            let pick = |rng: &mut Pcg64Mcg, axis: usize| {
                let u = if corner { f64::from(rng.random_range(0..2)) } else { rng.random() };
                low[axis] + (high[axis] - low[axis]) * u
            };
            let p = DVec3::new(pick(&mut rng, 0), pick(&mut rng, 1), pick(&mut rng, 2));
            let p = motion.at(rng.random()).transform_point3(p);
            assert!(p.cmpge(least).all() && p.cmple(most).all(), "case {case}: {p} outside {least} to {most}");
            outside_of_ends += usize::from(!(p.cmpge(naive[0]).all() && p.cmple(naive[1]).all()));
            (seen_low, seen_high) = (seen_low.min(p), seen_high.max(p));
        }
        tightest = tightest.min(((seen_high - seen_low) / (most - least)).max_element());
    }
    // The negative control: the box of the ends alone is too small. And boxes are not larger than necessary.
    assert!(outside_of_ends > 1000, "{outside_of_ends} of 100000 points outside the boxes of both ends");
    assert!(tightest > 0.6, "{tightest}");
}

#[test]
fn motions_pass_through_their_ends_and_turn_the_shorter_way() {
    let mut rng = generator(92);
    for case in 0..200 {
        let mirror = case % 2 == 0;
        let [a, b] = [map(&mut rng, mirror), map(&mut rng, mirror)];
        let (there, back) = (Motion::between(a, b).expect("sound"), Motion::between(b, a).expect("sound"));
        assert_eq!((there.at(0.0), there.at(1.0), there.at(-3.0), there.at(f32::NAN)), (a, b, a, a));
        // Continuous at the ends: the parts make up the whole.
        assert!(close(there.at(1e-9), a, 1e-6) && close(there.at(1.0 - f32::EPSILON), b, 1e-4), "case {case}");
        for time in [0.125, 0.5, 0.75] {
            assert!(close(there.at(time), back.at(1.0 - time), 1e-11), "case {case}");
        }
    }
    let turn = |angle: f64| DAffine3::from_quat(DQuat::from_rotation_z(angle));
    let half = |from: f64, to: f64| Motion::between(turn(from), turn(to)).expect("rotations").at(0.5);
    assert!(close(half(0.0, FRAC_PI_2), turn(FRAC_PI_2 / 2.0), 1e-15));
    assert!(close(half(0.0, 1.5 * PI), turn(-PI / 4.0), 1e-15));
    // A stretch and a rotation at once do not disturb each other.
    let stretched = DAffine3 { matrix3: turn(1.0).matrix3 * 3.0, translation: DVec3::X };
    let middle = Motion::between(DAffine3::IDENTITY, stretched).expect("sound").at(0.5);
    assert!(close(middle, DAffine3 { matrix3: turn(0.5).matrix3 * 2.0, translation: DVec3::X * 0.5 }, 1e-14));
}

#[test]
fn a_part_of_a_path_is_the_same_path() {
    let mut rng = generator(93);
    for _ in 0..50 {
        let whole = Motion::between(map(&mut rng, false), map(&mut rng, false)).expect("sound");
        let part = Motion::between(whole.at(0.25), whole.at(0.75)).expect("sound");
        assert!(close(part.at(0.5), whole.at(0.5), 1e-10));
    }
}

#[test]
fn motions_through_flatness_are_refused() {
    let mirror = DAffine3::from_scale(DVec3::new(1.0, -1.0, 1.0));
    let flat = DAffine3::from_scale(DVec3::new(1.0, 0.0, 1.0));
    let lost = DAffine3::from_translation(DVec3::NAN);
    for wrong in [mirror, flat, lost] {
        for ends in [(DAffine3::IDENTITY, wrong), (wrong, DAffine3::IDENTITY)] {
            assert!(matches!(Motion::between(ends.0, ends.1), Err(Error::BadParameter { .. })), "{ends:?}");
        }
    }
    assert!(!Motion::between(mirror, mirror).expect("it stands still").moves());
}

/// A moving object is hit at the same points as a resting copy in its pose at that time.
#[test]
fn a_moving_object_is_met_where_a_still_copy_is() {
    let mut rng = generator(94);
    let (positions, triangles) = lat_long(6, 1.0, DVec3::new(2.0, 0.0, 0.0));
    let shapes = vec![
        Shape::from(Mesh::new(positions, triangles).expect("valid")),
        Sphere::new(Vec3::new(-1.5, 0.5, 0.0), 0.7).expect("valid").into(),
    ];
    let object = Arc::new(Geometry::build(shapes).expect("few"));
    let scene = |motions: &[Motion]| {
        let instances = motions.iter().map(|motion| Instance::new(0, motion.clone())).collect();
        Geometry::with_instances(vec![], vec![object.clone()], instances).expect("sound")
    };
    let mut hits = 0;
    for case in 0..60 {
        let motions: Vec<Motion> =
            (0..3).map(|i| Motion::between(map(&mut rng, i == 1), map(&mut rng, i == 1)).expect("sound")).collect();
        let moving = scene(&motions);
        assert!(moving.moves());
        for _ in 0..10 {
            let time = rng.random::<f32>();
            let still = scene(&motions.iter().map(|m| Motion::still(m.at(time))).collect::<Vec<_>>());
            assert!(!still.moves());
            for _ in 0..20 {
                let origin = point_in(&mut rng, Vec3::splat(-20.0), Vec3::splat(20.0));
                let ray = Ray::new(origin, point_in(&mut rng, Vec3::splat(-5.0), Vec3::splat(5.0)) - origin);
                let (found, expected) = (moving.closest_at(&ray, time), still.closest(&ray));
                assert_eq!(found, expected, "case {case} at {time}: {ray:?}");
                assert_eq!(moving.occluded_at(&ray, time), expected.is_some());
                if let Some(hit) = found {
                    hits += 1;
                    let point = moving.surface_at(&ray, &hit, time);
                    assert_eq!(point, still.surface(&ray, &hit));
                    let uv = still.parametric_at(&hit, point.position, 0.0);
                    assert_eq!(moving.parametric_at(&hit, point.position, time), uv);
                }
            }
        }
    }
    assert!(hits > 2000, "{hits} hits");
}

const TIMES: [f32; 5] = [0.0, 0.1, 0.5, 0.93, 1.0];

fn point(rng: &mut Pcg64Mcg, size: f32) -> [f32; 3] {
    std::array::from_fn(|_| rng.random_range(-size..size))
}

/// Vertices at both times, and triangles.
type MovingSoup = (Vec<[f32; 3]>, Vec<[f32; 3]>, Vec<[u32; 3]>);

/// Random triangles that share some vertices.
fn soup(rng: &mut Pcg64Mcg, size: f32) -> MovingSoup {
    let vertices = 60;
    let starts: Vec<_> = (0..vertices).map(|_| point(rng, size)).collect();
    let ends = starts.iter().map(|s| s.map(|x| x + rng.random_range(-size..size))).collect();
    let corner = |rng: &mut Pcg64Mcg| rng.random_range(0..vertices as u32);
    let triangles =
        (0..100).map(|_| [corner(rng), corner(rng), corner(rng)]).filter(|[a, b, c]| a != b && b != c && a != c);
    (starts, ends, triangles.collect())
}

/// The vertices at a time.
fn at(starts: &[[f32; 3]], ends: &[[f32; 3]], time: f32) -> Vec<[f32; 3]> {
    let between = |(a, b): (&[f32; 3], &[f32; 3])| std::array::from_fn(|axis| a[axis] + (b[axis] - a[axis]) * time);
    starts.iter().zip(ends).map(between).collect()
}

fn rays(rng: &mut Pcg64Mcg, size: f32, count: usize) -> Vec<Ray> {
    let mut ray = || {
        let [from, to] = [point(rng, 3.0 * size), point(rng, size)].map(Vec3::from_array);
        Ray::new(from, to - from)
    };
    (0..count).map(|_| ray()).collect()
}

#[test]
fn hits_equal_those_of_still_meshes() {
    let mut rng = generator(61);
    let (mut hits, mut control) = (0, 0);
    for case in 0..20 {
        let size = 10.0_f32.powi(case % 7 - 3);
        let (starts, ends, triangles) = soup(&mut rng, size);
        let still = cuboid(Vec3::splat(-0.2 * size), Vec3::splat(0.2 * size));
        let others = Shape::from(Mesh::new(still.0, still.1).expect("a box"));
        let moving = Shape::from(MovingMesh::new(starts.clone(), ends.clone(), triangles.clone()).expect("sound"));
        let scene = Geometry::build(vec![moving, others.clone()]).expect("few");
        assert!(scene.moves());
        let standing = TIMES.map(|time| {
            let mesh = Mesh::new(at(&starts, &ends, time), triangles.clone()).expect("sound");
            Geometry::build(vec![Shape::from(mesh), others.clone()]).expect("few")
        });
        for ray in rays(&mut rng, 2.0 * size, 300) {
            for (time, still) in TIMES.iter().zip(&standing) {
                let (found, expected) = (scene.closest_at(&ray, *time), still.closest(&ray));
                assert_eq!(found, expected, "case {case}, time {time}, {ray:?}");
                assert_eq!(scene.occluded_at(&ray, *time), expected.is_some(), "case {case}, time {time}");
                hits += usize::from(found.is_some_and(|hit| hit.shape == 0));
                control += usize::from(found != standing[0].closest(&ray));
            }
        }
    }
    assert!(hits > 5000, "{hits} hits of what moves");
    assert!(control > 3000, "the control: {control} hits are not those of time 0");
}

/// In large trees of triangles only, a leaf of the binary tree has several triangles. With a far sphere, each leaf has one
/// item.
#[test]
fn large_meshes_are_met_as_still_ones_and_as_one_by_one() {
    let mut rng = generator(64);
    let (starts, triangles) = lat_long(100, 2.0, DVec3::new(0.3, -0.7, 0.11));
    let ends: Vec<[f32; 3]> = starts.iter().map(|p| p.map(|x| 1.5 * x + rng.random_range(-0.1..0.1))).collect();
    let mesh = MovingMesh::new(starts.clone(), ends.clone(), triangles.clone()).expect("sound");
    let moving = Geometry::build(vec![Shape::from(mesh)]).expect("fits");
    let rays = rays(&mut rng, 1.5, 2000);
    let mut hits = 0;
    for time in [0.0, 0.3, 1.0] {
        let mesh = Shape::from(Mesh::new(at(&starts, &ends, time), triangles.clone()).expect("sound"));
        let far = Shape::from(Sphere::new(Vec3::splat(1e4), 1.0).expect("round"));
        let [still, single] =
            [vec![mesh.clone()], vec![mesh, far]].map(|shapes| Geometry::build(shapes).expect("fits"));
        for ray in &rays {
            let found = moving.closest_at(ray, time);
            assert_eq!([found, still.closest(ray)], [single.closest(ray); 2], "time {time}, {ray:?}");
            hits += usize::from(found.is_some());
        }
    }
    assert!(triangles.len() > 1 << 15 && hits > 2000, "{hits} hits of {} triangles", triangles.len());
}

#[test]
fn rays_that_leave_a_moving_mesh_do_not_meet_it_again_g18() {
    let mut rng = generator(63);
    let (starts, ends, triangles) = soup(&mut rng, 1.0);
    let mesh = MovingMesh::new(starts, ends, triangles).expect("sound");
    let alone = Geometry::build(vec![Shape::from(mesh.clone())]).expect("few");
    let turned = DAffine3::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 1.0);
    let object = Arc::new(alone.clone());
    let instance = Instance::new(0, Motion::between(DAffine3::IDENTITY, turned).expect("invertible"));
    let placed = Geometry::with_instances(vec![], vec![object], vec![instance]).expect("few");
    assert!(placed.moves());
    for scene in [&alone, &placed] {
        let (mut left, mut met) = (0, 0);
        for ray in rays(&mut rng, 1.5, 2000) {
            let time = rng.random();
            let Some(hit) = scene.closest_at(&ray, time) else { continue };
            let point = scene.surface_at(&ray, &hit, time);
            let away = direction(&mut rng);
            let next = spawn_ray(&point, away);
            left += 1;
            met += usize::from(scene.closest_at(&next, time).is_some_and(|again| again.primitive == hit.primitive));
        }
        assert!(left > 500 && met == 0, "{met} of {left} met again");
    }
}

#[test]
fn invalid_moving_meshes_are_refused() {
    let one = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let few = MovingMesh::new(one.clone(), one[..2].to_vec(), vec![[0, 1, 2]]);
    assert!(matches!(few, Err(Error::BadParameter { value: 2.0, .. })), "{few:?}");
    let mut odd = one.clone();
    odd[2][1] = f32::NAN;
    let odd = MovingMesh::new(one.clone(), odd, vec![[0, 1, 2]]);
    assert!(matches!(odd, Err(Error::NonFinite { triangle: 0, vertex: 2 })), "{odd:?}");
    // Without area at both ends, but not in between.
    let folded = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.5, 0.0, 0.0]];
    let unfolded = vec![[0.0; 3], [0.0, 1.0, 0.0], [0.0, 0.5, 0.0]];
    let mesh = MovingMesh::new(folded.clone(), unfolded, vec![[0, 1, 2]]).expect("sound");
    assert_eq!(mesh.degenerate(), 1, "on a line all the time");
    let mesh =
        MovingMesh::new(folded, vec![[0.0; 3], [0.0, 1.0, 0.0], [0.5, 0.0, 0.0]], vec![[0, 1, 2]]).expect("sound");
    assert_eq!(mesh.degenerate(), 0);
}
