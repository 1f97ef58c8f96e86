//! Motions between their ends, and the boxes around them.

use crate::support::*;
use dapple_geometry::{Error, Geometry, Instance, Mesh, Motion, Ray, Shape, Sphere};
use glam::{DAffine3, DMat3, DQuat, DVec3, Vec3};
use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::Arc;

/// A random rotation, stretch and translation; mirrored if requested.
fn map(rng: &mut Pcg64Mcg, mirror: bool) -> DAffine3 {
    let mut matrix = DMat3::from_axis_angle(direction(rng).as_dvec3().normalize(), rng.random_range(-PI..PI));
    let mut scale = || 10.0_f64.powf(rng.random_range(-1.0..1.0));
    matrix *= DMat3::from_diagonal(DVec3::new(scale(), scale(), if mirror { -scale() } else { scale() }));
    matrix *= DMat3::from_axis_angle(direction(rng).as_dvec3().normalize(), rng.random_range(-PI..PI));
    DAffine3 { matrix3: matrix, translation: DVec3::from_array(std::array::from_fn(|_| rng.random_range(-5.0..5.0))) }
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

/// A moving object is met where a still copy at that time is.
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
