//! Hard cases of rays at their full size.
//!
//! `cargo test --release -p dapple-geometry --test geometry thorough:: -- --ignored --nocapture` on a quiet machine
//! takes two minutes.

#![allow(clippy::print_stdout)] // Prints figures.

use crate::support::*;
use dapple_geometry::{Geometry, Mesh, Ray, Shape};
use glam::{DVec3, Vec3};
use std::time::Instant;

#[test]
#[ignore = "T2: 3e7 rays"]
fn ten_million_random_rays_from_inside_never_escape_g02() {
    let mut rng = generator(2);
    for centre in [DVec3::ZERO, DVec3::new(0.3, -0.7, 0.11), DVec3::new(148_376.0, 1_234.0, -223_423.0)] {
        let scene = geometry(vec![lat_long(200, 2.0, centre)]);
        let reach = Vec3::splat(1.0);
        let escapes = (0..10_000_000)
            .filter(|_| {
                let origin = point_in(&mut rng, centre.as_vec3() - reach, centre.as_vec3() + reach);
                scene.closest(&Ray::new(origin, direction(&mut rng))).is_none()
            })
            .count();
        assert_eq!(escapes, 0, "centre {centre}");
    }
}

/// `n` triangles, the i-th at `place(i, corner)`.
fn soup(n: u32, place: impl Fn(u32, Vec3) -> Vec3) -> Vec<Shape> {
    let corners = [Vec3::new(-0.5, -0.5, -0.25), Vec3::new(0.5, -0.5, 0.0), Vec3::new(-0.5, 0.5, 0.25)];
    let positions = (0..n).flat_map(|i| corners.map(|c| place(i, c).to_array())).collect();
    let triangles = (0..n).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    vec![Shape::from(Mesh::new(positions, triangles).expect("sound"))]
}

#[test]
#[ignore = "T2: timing, wants a quiet machine"]
fn building_takes_linear_time_on_duplicates_and_concentric_triangles_g12() {
    let mut rng = generator(12);
    for n in [1_000, 10_000, 100_000] {
        let offsets: Vec<Vec3> = (0..n).map(|_| point_in(&mut rng, Vec3::ZERO, Vec3::splat(60.0))).collect();
        let spread = soup(n, |i, c| c + offsets[i as usize]);
        let same = soup(n, |_, c| c);
        let concentric = soup(n, |i, c| c * (1.0 + i as f32));
        let time = |shapes: &[Shape]| {
            let run = |_| {
                let start = Instant::now();
                let scene = Geometry::build(shapes.to_vec()).expect("few");
                (start.elapsed().as_secs_f64(), scene)
            };
            (0..3).map(run).min_by(|a, b| a.0.total_cmp(&b.0)).expect("three")
        };
        let (usual, _) = time(&spread);
        for (name, shapes) in [("same", &same), ("concentric", &concentric)] {
            let (seconds, scene) = time(shapes);
            println!("{n} {name}: {:.2} of {usual} s, stack {}", seconds / usual, scene.deepest());
            assert!(seconds <= 4.0 * usual && scene.deepest() <= 128, "{n} {name}: {seconds} s for {usual} s");
        }
        // Compared with one copy by itself.
        let (_, many) = time(&same);
        let (_, one) = time(&soup(1, |_, c| c));
        for _ in 0..10_000 {
            let aim = point_in(&mut rng, Vec3::splat(-1.0), Vec3::splat(1.0));
            let ray = Ray::new(aim + Vec3::Z * 3.0, -Vec3::Z + direction(&mut rng) * 0.2);
            assert_eq!(many.closest(&ray), one.closest(&ray));
        }
    }
}

/// A field of `2 rows columns` triangles, one unit wide: hills, or if rough an independent height for each corner.
fn field(rows: u32, columns: u32, rough: bool) -> Mesh {
    let height = |x: u32, y: u32| match rough {
        true => (x.wrapping_mul(7919).wrapping_add(y.wrapping_mul(104_729)) % 1013) as f32 / 1013.0,
        false => 0.5 + 0.25 * ((x as f32 * 0.02).sin() + (y as f32 * 0.03).cos()),
    };
    let place = |i: u32| {
        let (x, y) = (i % (columns + 1), i / (columns + 1));
        [x as f32, y as f32, height(x, y)]
    };
    let cell = |i: u32| {
        let a = i / columns * (columns + 1) + i % columns;
        let b = a + columns + 1;
        [[a, a + 1, b], [a + 1, b + 1, b]]
    };
    let positions = (0..(rows + 1) * (columns + 1)).map(place).collect();
    Mesh::new(positions, (0..rows * columns).flat_map(cell).collect()).expect("sound")
}

/// The seconds to build the tree. Its bytes are compared with those in docs/results/memory.md.
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
    let mut slow = Vec::new();
    let long = |rows| [(2 * rows, 1000), (rows, 1000)];
    // Two thousandths more than half of the triangles of 5000 x 5000 cells.
    let square = [(5000, 5000), (3536, 3536)];
    for (name, sizes, rough) in [
        ("a long field", long(12_500), false),
        ("a square field", square, false),
        ("a long field", long(2500), false),
        ("a long, rough field", long(2500), true),
    ] {
        // The larger first, and the lesser of two: a machine's first search for memory is not the tree's time.
        let [whole, half] = sizes.map(|(rows, columns)| {
            let seconds = |_| built(field(rows, columns, rough));
            (0..2).map(seconds).fold(f64::INFINITY, f64::min)
        });
        let [_, (rows, columns)] = sizes;
        let triangles = f64::from(2 * rows * columns);
        println!(
            "{name} of {triangles:.1e}: {half:.1} s, twice as many triangles {whole:.1} s, {:.2} times",
            whole / half
        );
        if whole > 2.3 * half {
            slow.push(format!("{name} takes {half} s, twice as many triangles {whole} s"));
        }
    }
    assert!(slow.is_empty(), "{slow:?}");
}

#[test]
#[ignore = "T2: 8e5 triangles"]
fn slivers_are_met_at_their_centroids_g15() {
    let mut rng = generator(15);
    for exponent in 3..=8 {
        let aspect = 10.0_f32.powi(exponent);
        let (mut missed, mut odd) = (0, 0);
        for _ in 0..10_000 {
            let along = direction(&mut rng);
            let across = along.cross(direction(&mut rng)).normalize() / aspect;
            let at = point_in(&mut rng, Vec3::splat(-1.0), Vec3::splat(1.0));
            let corners = [at - along, at + along, at + across];
            let mesh = Mesh::new(corners.map(|c| c.to_array()).to_vec(), vec![[0, 1, 2]]).expect("sound");
            let degenerate = mesh.degenerate() > 0;
            let exact = corners.iter().fold(DVec3::ZERO, |sum, c| sum + c.as_dvec3()) / 3.0;
            let scene = Geometry::build(vec![Shape::from(mesh)]).expect("one");
            let eye = at + along.cross(across).normalize() * 2.0;
            let ray = Ray::new(eye, (exact - eye.as_dvec3()).as_vec3());
            match scene.closest(&ray) {
                None => missed += usize::from(!degenerate),
                Some(hit) => {
                    let point = scene.surface(&ray, &hit);
                    // The ray is rounded too, by at most half an ulp of its length.
                    let bound = f64::from(point.error.length()) + 4.0 * f64::from(f32::EPSILON);
                    let off = (point.position.as_dvec3() - exact).length();
                    odd += usize::from(!hit.t.is_finite() || off.is_nan() || off > bound * f64::from(aspect).max(1.0));
                    odd += usize::from((hit.t - 1.0).abs() > 1e-5);
                }
            }
        }
        println!("aspect 1e{exponent}: {missed} of 10000 missed, {odd} odd");
        assert_eq!(odd, 0, "aspect {aspect}");
        assert!(exponent > 6 || missed == 0, "aspect {aspect}: {missed} missed");
    }
}

#[test]
#[ignore = "T2: timing, wants a quiet machine"]
fn invalid_rays_take_no_longer_g17() {
    let mut rng = generator(17);
    let scene = geometry(vec![lat_long(200, 2.0, DVec3::ZERO)]);
    let good: Vec<Ray> = (0..100_000).map(|_| Ray::new(Vec3::ZERO, direction(&mut rng))).collect();
    let bad: Vec<Ray> = good
        .iter()
        .enumerate()
        .map(|(i, ray)| match i % 4 {
            0 => Ray { origin: Vec3::splat(f32::NAN), ..*ray },
            1 => Ray { direction: Vec3::ZERO, ..*ray },
            2 => Ray { tmax: f32::NAN, ..*ray },
            _ => Ray { direction: Vec3::new(f32::INFINITY, 0.0, 1.0), ..*ray },
        })
        .collect();
    assert!(good.iter().all(Ray::is_valid) && !bad.iter().any(Ray::is_valid));
    let time = |rays: &[Ray]| {
        let run = |_| {
            let start = Instant::now();
            let hits = rays.iter().filter(|ray| scene.closest(ray).is_some()).count();
            (start.elapsed().as_secs_f64(), hits)
        };
        (0..5).map(run).min_by(|a, b| a.0.total_cmp(&b.0)).expect("five")
    };
    let ((usual, hits), (odd, none)) = (time(&good), time(&bad));
    println!("invalid rays take {:.2} of the time of valid ones", odd / usual);
    assert!(hits == good.len() && none == 0 && odd <= 2.5 * usual, "{odd} s for {usual} s");
}
