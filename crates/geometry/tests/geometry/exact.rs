//! Results that are equal bit for bit over scales, trees and orders.

use crate::support::{Soup, cuboid, direction, generator, geometry, lat_long, point_in, scaled_ray};
use dapple_geometry::{Error, Geometry, Hit, Mesh, Ray, Shape};
use glam::{DVec3, Vec3};
use rand::RngExt;

fn scaled((positions, triangles): &Soup, scale: f32) -> Soup {
    (positions.iter().map(|p| p.map(|x| x * scale)).collect(), triangles.clone())
}

/// A room with two boxes and a sphere in it.
fn room() -> Vec<Soup> {
    let mut ball = lat_long(12, 0.8, DVec3::new(1.1, 0.9, -1.3));
    ball.0.iter_mut().for_each(|p| p[1] += 0.05);
    vec![
        cuboid(Vec3::new(-2.78, 0.0, -2.79), Vec3::new(2.78, 5.49, 2.8)),
        cuboid(Vec3::new(-1.9, 0.0, -0.3), Vec3::new(-0.4, 3.3, 1.2)),
        ball,
    ]
}

fn rays(count: usize, seed: u64) -> Vec<Ray> {
    let mut rng = generator(seed);
    (0..count)
        .map(|i| {
            let origin = point_in(&mut rng, Vec3::new(-2.5, 0.1, -2.5), Vec3::new(2.5, 5.0, 2.5));
            let axis = [Vec3::X, Vec3::NEG_Y, Vec3::Z][i % 3];
            let direction = if i % 10 == 0 { axis } else { direction(&mut rng) };
            Ray { tmin: if i % 4 == 0 { 0.25 } else { 0.0 }, ..Ray::new(origin, direction) }
        })
        .collect()
}

/// Scaled by a power of two, hits are equal except `t`, which scales.
fn assert_scales(scale: f32, ray_count: usize) {
    let scene = geometry(room());
    let other = geometry(room().iter().map(|mesh| scaled(mesh, scale)).collect());
    for ray in rays(ray_count, 4) {
        let expected = scene.closest(&ray).map(|hit| Hit { t: hit.t * scale, ..hit });
        assert_eq!(other.closest(&scaled_ray(&ray, scale)), expected, "scale {scale:e}, {ray:?}");
        // A longer direction in the same scene.
        let short = Ray { direction: ray.direction * scale, tmin: ray.tmin / scale, ..ray };
        let expected = scene.closest(&ray).map(|hit| Hit { t: hit.t / scale, ..hit });
        assert_eq!(scene.closest(&short), expected, "direction times {scale:e}, {ray:?}");
    }
}

#[test]
fn hits_scale_bit_for_bit_g04() {
    for k in -40..=40 {
        assert_scales(2.0_f32.powi(k), 1000);
    }
}

#[test]
fn negative_control_a_scale_that_is_no_power_of_two_shows_g04() {
    assert!(std::panic::catch_unwind(|| assert_scales(3.1, 1000)).is_err());
}

#[test]
fn far_scales_are_traced_or_refused_g05() {
    for radius in [1e-30, 1e-20, 1e-15, 1e-9, 1e9, 1e15, 1e30] {
        let (positions, triangles) = lat_long(20, radius, DVec3::ZERO);
        match Mesh::new(positions, triangles) {
            Ok(mesh) => {
                assert!((1e-18..1e18).contains(&radius));
                assert_eq!(mesh.degenerate(), 0);
                let scene = Geometry::build(vec![mesh.into()]).expect("one mesh");
                let mut rng = generator(5);
                for _ in 0..1000 {
                    let ray = Ray::new(direction(&mut rng) * (radius * 0.3) as f32, direction(&mut rng));
                    let hit = scene.closest(&ray).unwrap_or_else(|| panic!("{radius:e}: {ray:?}"));
                    let length = ray.at(hit.t).as_dvec3().length();
                    assert!((0.98 * radius..1.0001 * radius).contains(&length), "{length} at {radius}");
                }
            }
            Err(error) => {
                assert!(matches!(error, Error::ScaleOutOfRange { .. }), "{error}");
                assert!(!(1e-15..1e15).contains(&radius), "{radius:e} belongs to the documented range");
            }
        }
    }
}

#[test]
fn triangles_without_area_change_nothing_g10() {
    let clean = lat_long(20, 1.0, DVec3::ZERO);
    let mut mixed = clean.clone();
    let mut rng = generator(10);
    let count = clean.1.len() as u32 / 10;
    for _ in 0..count {
        let a = rng.random_range(0..clean.0.len() as u32);
        let b = rng.random_range(0..clean.0.len() as u32);
        // The midpoint is rounded. On a segment along an axis all three points are exactly in line.
        let [x, y, z] = clean.0[a as usize];
        let new = mixed.0.len() as u32;
        mixed.0.extend([[x + 0.5, y, z], [x + 0.25, y, z], [x, y, z]]);
        mixed.1.extend([[a, a, a], [a, b, b], [new, new + 1, new + 2]]);
    }
    let mesh = Mesh::new(mixed.0.clone(), mixed.1.clone()).expect("valid");
    assert_eq!(mesh.degenerate(), 3 * count as usize);
    let (clean, mixed) = (geometry(vec![clean]), geometry(vec![mixed]));
    assert_eq!(mixed.triangle_count(), clean.triangle_count());
    for ray in rays(20_000, 10) {
        let ray = Ray { origin: ray.origin * 0.5, ..ray };
        assert_eq!(mixed.closest(&ray), clean.closest(&ray));
    }
}

#[test]
fn duplicates_and_concentric_triangles_build_fast_and_shallow_g12() {
    let n: u32 = 20_000;
    let mut rng = generator(12);
    let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.25], [0.0, 1.0, 0.5]];
    let mut soup = |place: &mut dyn FnMut(u32, [f32; 3], Vec3) -> [f32; 3]| -> Soup {
        let offsets: Vec<Vec3> = (0..n).map(|_| point_in(&mut rng, Vec3::ZERO, Vec3::splat(30.0))).collect();
        let positions = (0..n).flat_map(|i| corners.map(|c| (i, c))).map(|(i, c)| place(i, c, offsets[i as usize]));
        (positions.collect(), (0..n).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect())
    };
    let centred = |c: [f32; 3]| Vec3::from_array(c) - Vec3::new(0.5, 0.5, 0.25);
    let spread = soup(&mut |_, c, offset| (Vec3::from_array(c) + offset).to_array());
    let same = soup(&mut |_, c, _| c);
    let concentric = soup(&mut |i, c, _| (centred(c) * (1.0 + i as f32)).to_array());
    let nested = soup(&mut |i, c, _| (centred(c) * 2.0_f32.powi((i % 40) as i32)).to_array());
    let row = soup(&mut |i, c, _| (Vec3::from_array(c) + Vec3::X * i as f32).to_array());
    let time = |soup: &Soup| {
        let start = std::time::Instant::now();
        let scene = geometry(vec![soup.clone()]);
        (start.elapsed().as_secs_f64(), scene)
    };
    // Best of two, since the machine may be busy.
    let budget = 4.0 * time(&spread).0.max(time(&spread).0);
    let soups =
        [("same", &same, 0.3), ("concentric", &concentric, -0.1), ("nested", &nested, -0.1), ("row", &row, 0.3)];
    for (name, soup, aim) in soups {
        let (first, scene) = time(soup);
        let seconds = first.min(time(soup).0);
        assert!(seconds <= budget, "{name}: {seconds} s, budget {budget} s");
        let hit = scene.closest(&Ray::new(Vec3::new(aim, aim, -1e6), Vec3::Z));
        assert!(hit.is_some(), "{name}");
        if name == "same" {
            assert_eq!(hit.map(|hit| hit.primitive), Some(0));
        }
    }
}

#[test]
fn the_smallest_number_wins_a_tie_g13() {
    // Two tessellations of one square: along one diagonal, and as a fan around its centre.
    let first: Soup =
        (vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]], vec![[0, 1, 2], [0, 2, 3]]);
    let mut second = first.clone();
    second.0.push([0.5, 0.5, 0.0]);
    second.1 = vec![[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]];
    // The second tree holds everything twice, and the copies have larger numbers.
    let scenes = [1, 2].map(|copies| geometry(vec![[first.clone(), second.clone()]; copies].concat()));
    let swapped = geometry(vec![second, first]);
    let mut rng = generator(13);
    for i in 0..10_000 {
        let target = Vec3::new(rng.random(), rng.random(), 0.0);
        let origin =
            if i % 2 == 0 { target + Vec3::Z } else { point_in(&mut rng, Vec3::splat(-2.0), Vec3::splat(2.0)) };
        let ray = Ray::new(origin, target - origin);
        let hits: Vec<Option<Hit>> = scenes.iter().map(|scene| scene.closest(&ray)).collect();
        assert!(hits.iter().all(|hit| *hit == hits[0]), "{ray:?}: {hits:?}");
        let (hit, other) = (hits[0].expect("the square"), swapped.closest(&ray).expect("the square"));
        assert_eq!(hit.t, other.t);
        if i % 2 == 0 {
            assert_eq!((hit.shape, other.shape), (0, 0), "equal t");
        }
    }
}

#[test]
fn one_ulp_apart_the_nearer_wall_is_met_g14() {
    let wall = |z: f32| -> Soup {
        (vec![[-1.0, -1.0, z], [1.0, -1.0, z], [1.0, 1.0, z], [-1.0, 1.0, z]], vec![[0, 1, 2], [0, 2, 3]])
    };
    let mut rng = generator(14);
    let scene = geometry(vec![wall(1.0_f32.next_up()), wall(1.0)]);
    for _ in 0..12_000 {
        let from = Vec3::new(rng.random_range(-0.9..0.9), rng.random_range(-0.9..0.9), 0.0);
        let slant = Vec3::new(rng.random_range(-0.05..0.05), rng.random_range(-0.05..0.05), 1.0);
        for direction in [Vec3::Z, slant] {
            let hit = scene.closest(&Ray::new(from, direction)).expect("a wall");
            assert_eq!((hit.shape, hit.t), (1, 1.0));
        }
    }
}

#[test]
fn nothing_is_hit_in_empty_geometry() {
    let none = Geometry::build(Vec::new()).expect("empty is fine");
    let hollow = Geometry::build(vec![Shape::from(Mesh::new(vec![], vec![]).expect("empty"))]);
    for scene in [none, hollow.expect("empty is fine")] {
        assert!(scene.closest(&Ray::new(Vec3::ZERO, Vec3::X)).is_none() && scene.bounds().is_none());
    }
}

/// Found by the fuzzer: a distance that no f32 represents in lengths of a very long direction. It was reported as 0,
/// which is not above `tmin`.
#[test]
fn a_hit_closer_than_f32_can_represent_lies_within_the_limits() {
    let triangle = (vec![[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]], vec![[0, 1, 2]]);
    let scene = geometry(vec![triangle]);
    let ray = Ray::new(Vec3::new(0.0, 0.0, 5.5e-40), Vec3::new(0.0, 0.0, -1.1e15));
    let hit = scene.closest(&ray).expect("a hit");
    assert!(hit.t > ray.tmin && hit.t < 1e-40 && scene.occluded(&ray), "{hit:?}");
    // No number lies between these limits.
    let none = Ray { tmin: 0.0, tmax: f32::from_bits(1), ..ray };
    assert!(scene.closest(&none).is_none() && !scene.occluded(&none));
}

/// Found by the fuzzer: boxes of tiny distant shapes were left before they were entered, along the axes in which a ray
/// does not move.
#[test]
fn tiny_distant_triangles_are_met_by_axis_aligned_rays() {
    for size in [4e-34_f32, 1e-39, 1e-20, 1.0] {
        // One distant triangle, since meshes that are tiny as a whole are refused, and enough tiny ones to fill boxes
        // of their own.
        let mut corners = vec![[0.0, -1e15, 0.0], [0.0, -1e15, 1.0], [1.0, -1e15, 0.0]];
        let square = |i: u8| [i / 8, i % 8].map(f32::from);
        corners.extend((0..64).flat_map(|i| {
            let [y, z] = square(i);
            [[0.0, y * size, z * size], [0.0, (y + 0.9) * size, z * size], [0.0, y * size, (z + 0.9) * size]]
        }));
        let triangles = (0..corners.len() as u32 / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let scene = geometry(vec![(corners, triangles)]);
        for (far, slope) in [(1.9e15, 0.0), (1.0, 0.0), (1.9e15, 1e-4 * size), (1e18, 0.0)] {
            for i in 0..64 {
                let [y, z] = square(i).map(|x| (x + 0.25) * size);
                let ray = Ray::new(Vec3::new(-far, y, z), Vec3::new(far, slope, -slope));
                let hit = scene.closest(&ray);
                let met = hit.is_some_and(|hit| hit.t == 1.0 && hit.primitive == u32::from(i) + 1);
                assert!(met && scene.occluded(&ray), "{size} {far} {slope} {i}: {hit:?}");
            }
        }
        // And rays beside them miss.
        let beside = Ray::new(Vec3::new(-1.9e15, 0.75 * size, 0.75 * size), Vec3::new(1.9e15, 0.0, 0.0));
        assert!(scene.closest(&beside).is_none() && !scene.occluded(&beside));
    }
}
