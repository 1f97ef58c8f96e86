//! Results that are bit-identical over scales, trees and orders; rejected input; and rays that hit nothing.

#![allow(clippy::print_stdout, reason = "the largest trees print their figures")]

use crate::support::{Soup, cuboid, direction, generator, geometry, lat_long, point_in, scaled_ray};
use dapple_geometry::{Disk, Error, Geometry, Hit, Mesh, Ray, Shape, Sphere};
use glam::{DAffine3, DVec3, Vec3};
use rand::RngExt;
use std::time::Instant;

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

/// After scaling by a power of two, hits are equal except for `t`, which is scaled.
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
    let offsets: Vec<Vec3> = (0..n).map(|_| point_in(&mut rng, Vec3::ZERO, Vec3::splat(30.0))).collect();
    let corners = [Vec3::ZERO, Vec3::new(1.0, 0.0, 0.25), Vec3::new(0.0, 1.0, 0.5)];
    let soup = |place: &dyn Fn(u32, Vec3) -> Vec3| -> Soup {
        let positions = (0..n).flat_map(|i| corners.map(|c| place(i, c).to_array()));
        (positions.collect(), (0..n).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect())
    };
    let centred = |c: Vec3| c - Vec3::new(0.5, 0.5, 0.25);
    let spread = soup(&|i, c| c + offsets[i as usize]);
    let soups = [
        ("same", soup(&|_, c| c), 0.3),
        ("concentric", soup(&|i, c| centred(c) * (1.0 + i as f32)), -0.1),
        ("nested", soup(&|i, c| centred(c) * 2.0_f32.powi((i % 40) as i32)), -0.1),
        ("row", soup(&|i, c| c + Vec3::X * i as f32), 0.3),
    ];
    let time = |soup: &Soup| {
        let start = Instant::now();
        let scene = geometry(vec![soup.clone()]);
        (start.elapsed().as_secs_f64(), scene)
    };
    // Best of two, since the machine may be busy.
    let budget = 4.0 * time(&spread).0.max(time(&spread).0);
    for (name, soup, aim) in &soups {
        let (first, scene) = time(soup);
        let seconds = first.min(time(soup).0);
        assert!(seconds <= budget, "{name}: {seconds} s, budget {budget} s");
        let hit = scene.closest(&Ray::new(Vec3::new(*aim, *aim, -1e6), Vec3::Z));
        assert!(hit.is_some(), "{name}");
        if *name == "same" {
            assert_eq!(hit.map(|hit| hit.primitive), Some(0));
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

/// Found by the fuzzer: a distance too small for an f32 in units of a very long direction. It must not be reported as 0, which
/// is not above `tmin`.
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

/// Found by the fuzzer: along an axis in which a ray does not move, the exit from the box of a tiny distant shape may seem to
/// precede the entry.
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

#[test]
fn vertices_that_are_not_finite_are_refused_by_name_g11() {
    let (positions, mut triangles) = lat_long(10, 1.0, DVec3::ZERO);
    let new = positions.len() as u32;
    triangles.push([new, new + 1, new + 2]);
    let number = triangles.len() as u32 - 1;
    let (nan, inf) = (f32::NAN, f32::INFINITY);
    let good = [0.5, 0.5, 0.5];
    for bad in [[nan, 0.0, 0.0], [nan; 3], [0.0, inf, 0.0], [0.0, 0.0, -inf]] {
        for place in 0..3 {
            let mut corners = [good; 3];
            corners[place as usize] = bad;
            let positions = [positions.clone(), corners.to_vec()].concat();
            let error = Mesh::new(positions, triangles.clone()).expect_err("not finite");
            assert_eq!(error, Error::NonFinite { triangle: number, vertex: new + place });
        }
    }
    let positions = [positions, vec![good; 2]].concat();
    let error = Mesh::new(positions, triangles).expect_err("out of range");
    assert_eq!(error, Error::IndexOutOfRange { triangle: number, vertex: new + 2, vertices: new as usize + 2 });
}

#[test]
fn magnitudes_out_of_range_are_refused() {
    for size in [1e-30_f32, 1e18, 1e38, f32::MAX] {
        let mesh = Mesh::new(vec![[0.0; 3], [size, 0.0, 0.0], [0.0, size, 0.0]], vec![[0, 1, 2]]);
        for error in [mesh.err(), Sphere::new(Vec3::ZERO, size).err()] {
            assert!(matches!(error, Some(Error::ScaleOutOfRange { .. })), "{size}: {error:?}");
        }
    }
    let sphere = |centre: Vec3, radius: f32| Sphere::new(centre, radius).err();
    let disk = |normal: Vec3, radius: f32, inner: f32| Disk::new(Vec3::ZERO, normal, radius, inner).err();
    let maps = [DAffine3::ZERO, DAffine3::from_scale(DVec3::new(1.0, 0.0, 1.0)), DAffine3::NAN];
    let mut refused = maps.map(|map| Sphere::transformed(map, 1.0).err()).to_vec();
    refused.extend([disk(Vec3::ZERO, 1.0, 0.0), sphere(Vec3::splat(f32::NAN), 1.0)]);
    for bad in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        refused.extend([sphere(Vec3::ZERO, bad), disk(Vec3::X, bad, 0.0), disk(Vec3::X, 1.0, bad - 0.1)]);
        refused.push(disk(Vec3::X, 1.0, 1.0 + bad.abs()));
    }
    assert!(refused.iter().all(Option::is_some), "{refused:?}");
}

#[test]
fn invalid_rays_hit_nothing_g17() {
    let scene = geometry(vec![lat_long(10, 1.0, DVec3::ZERO)]);
    let good = Ray::new(Vec3::ZERO, Vec3::new(0.3, -0.2, 0.9));
    assert!(scene.closest(&good).is_some() && scene.occluded(&good));
    let mut bad = Vec::new();
    for x in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        for axis in 0..3 {
            let (mut origin, mut direction) = (good.origin, good.direction);
            (origin[axis], direction[axis]) = (x, x);
            bad.extend([Ray { origin, ..good }, Ray { direction, ..good }, Ray { origin, direction, ..good }]);
        }
        bad.push(Ray { tmin: x.abs(), ..good });
    }
    bad.extend([Vec3::ZERO, -Vec3::ZERO].map(|direction| Ray { direction, ..good }));
    let limits = [(f32::NAN, 1.0), (0.0, f32::NAN), (2.0, 1.0), (1.0, 1.0), (0.0, -1.0), (0.0, 0.0), (0.0, -0.0)];
    bad.extend(limits.map(|(tmin, tmax)| Ray { tmin, tmax, ..good }));
    for ray in bad {
        assert!(scene.closest(&ray).is_none() && !scene.occluded(&ray) && !ray.is_valid(), "{ray:?}");
    }
    assert!(good.is_valid());
    for tmin in [-0.0, -1.0, f32::NEG_INFINITY] {
        assert_eq!(scene.closest(&Ray { tmin, ..good }), scene.closest(&good), "a negative tmin is 0");
    }
    for direction in [Vec3::new(-0.0, -0.0, 1.0), Vec3::new(-0.0, 0.0, -1.0), Vec3::new(f32::MIN_POSITIVE, -1e-45, 1.0)]
    {
        assert!(scene.closest(&Ray { direction, ..good }).is_some(), "{direction}");
    }
}

/// A height field of `2 rows columns` triangles, one unit wide: hills or, with `rough`, an independent height for each corner.
fn field(rows: u32, columns: u32, rough: bool) -> Mesh {
    let place = |i: u32| {
        let [x, y] = [i % (columns + 1), i / (columns + 1)];
        let height = match rough {
            true => (x.wrapping_mul(7919).wrapping_add(y.wrapping_mul(104_729)) % 1013) as f32 / 1013.0,
            false => 0.5 + 0.25 * ((x as f32 * 0.02).sin() + (y as f32 * 0.03).cos()),
        };
        [x as f32, y as f32, height]
    };
    let cell = |i: u32| {
        let a = i / columns * (columns + 1) + i % columns;
        [[a, a + 1, a + columns + 1], [a + 1, a + columns + 2, a + columns + 1]]
    };
    let positions = (0..(rows + 1) * (columns + 1)).map(place).collect();
    Mesh::new(positions, (0..rows * columns).flat_map(cell).collect()).expect("sound")
}

/// Returns the seconds to build the tree, whose size is compared with docs/results/memory.md.
fn built(mesh: Mesh) -> f64 {
    let triangles = mesh.triangles().len();
    let start = Instant::now();
    let scene = Geometry::build(vec![Shape::from(mesh)]).expect("it fits");
    let seconds = start.elapsed().as_secs_f64();
    let each = scene.memory_bytes() as f64 / triangles as f64;
    println!("{triangles} triangles: {seconds:.1} s, {each:.1} bytes each, stack {}", scene.deepest());
    assert!(each < 125.0 && scene.deepest() <= 128, "{each} bytes a triangle");
    let middle = scene.closest(&Ray::new(Vec3::new(500.3, 700.6, 3.0), -Vec3::Z));
    assert!(middle.is_some_and(|hit| (2.0..=3.0).contains(&hit.t)), "{middle:?}");
    seconds
}

#[test]
#[ignore = "T3: 5e7 triangles in 14 GiB of memory, timing, wants a quiet machine; fails where new memory is slow: 2.2 to 3.1 times, not 2.3, from 2.5e7 to 5e7"]
fn building_takes_linear_time_and_memory_up_to_fifty_million_triangles_z02() {
    // Two thousandths more than half of the triangles of 5000 x 5000 cells.
    for (name, [whole, half], rough) in [
        ("a long field", [(25_000, 1000), (12_500, 1000)], false),
        ("a square field", [(5000, 5000), (3536, 3536)], false),
        ("a long, rough field", [(5000, 1000), (2500, 1000)], true),
    ] {
        // The larger first, and the lesser of two: a machine's first search for memory is not the tree's time.
        let [whole, half] = [whole, half]
            .map(|(rows, columns)| (0..2).map(|_| built(field(rows, columns, rough))).fold(f64::INFINITY, f64::min));
        println!("{name}: {half:.1} s, twice as many triangles {whole:.1} s, {:.2} times", whole / half);
        assert!(whole <= 2.3 * half, "{name} takes {half} s, twice as many triangles {whole} s");
    }
}
