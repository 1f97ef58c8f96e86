//! Closed surfaces let no ray through.

use crate::support::{cuboid, direction, generator, geometry, lat_long, point_in};
use dapple_geometry::{Geometry, Mesh, Ray, Shape};
use glam::{DVec3, Vec3};
use rand::RngExt;

const CENTRES: [DVec3; 3] = [DVec3::ZERO, DVec3::new(0.3, -0.7, 0.11), DVec3::new(148_376.0, 1_234.0, -223_423.0)];

/// Returns the vertices and edge midpoints of all triangles, without duplicates.
fn targets(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Vec<DVec3> {
    let corner = |i: u32| Vec3::from_array(positions[i as usize]).as_dvec3();
    let of_triangle = |t: &[u32; 3]| {
        let [a, b, c] = t.map(corner);
        [a, b, c, (a + b) * 0.5, (b + c) * 0.5, (c + a) * 0.5]
    };
    let mut all: Vec<DVec3> = triangles.iter().flat_map(of_triangle).collect();
    all.sort_unstable_by_key(|at| at.to_array().map(f64::to_bits));
    all.dedup();
    all
}

#[test]
fn aimed_rays_from_inside_a_sphere_never_escape_g01() {
    for centre in CENTRES {
        let (positions, triangles) = lat_long(50, 2.0, centre);
        let targets = targets(&positions, &triangles);
        let scene = geometry(vec![(positions, triangles)]);
        for offset in [DVec3::ZERO, DVec3::new(0.5, -0.25, 0.125), DVec3::new(-0.7, 0.9, 0.3)] {
            let origin = (centre + offset).as_vec3();
            let escapes = targets
                .iter()
                .map(|target| Ray::new(origin, (*target - origin.as_dvec3()).normalize().as_vec3()))
                .filter(|ray| scene.closest(ray).is_none() || !scene.occluded(ray))
                .count();
            assert_eq!(escapes, 0, "of {} rays, centre {centre}, origin {origin}", targets.len());
        }
    }
}

#[test]
fn random_rays_from_inside_a_sphere_never_escape_g02() {
    random_rays(200_000);
}

#[test]
#[ignore = "T2: 3e7 rays"]
fn ten_million_random_rays_from_inside_never_escape_g02() {
    random_rays(10_000_000);
}

fn random_rays(count: u32) {
    let mut rng = generator(2);
    for centre in CENTRES {
        let scene = geometry(vec![lat_long(100, 2.0, centre)]);
        let reach = Vec3::splat(1.0);
        for _ in 0..count {
            let origin = point_in(&mut rng, centre.as_vec3() - reach, centre.as_vec3() + reach);
            let ray = Ray::new(origin, direction(&mut rng));
            assert!(scene.closest(&ray).is_some(), "{ray:?}");
        }
    }
}

#[test]
fn axis_aligned_rays_through_a_grid_hit_from_both_sides_g03() {
    const N: u32 = 64;
    let corner = |i: u32, j: u32| j * (N + 1) + i;
    let positions = (0..=N).flat_map(|j| (0..=N).map(move |i| [i as f32, j as f32, 0.0])).collect();
    let quads = (0..N).flat_map(|j| (0..N).map(move |i| (i, j)));
    let triangles = quads
        .flat_map(|(i, j)| {
            let [a, b, c, d] = [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect();
    let scene = geometry(vec![(positions, triangles)]);
    for z in [7.0, -7.0] {
        // Every half step: vertices, edge midpoints and diagonal midpoints.
        for (i, j) in (1..2 * N).flat_map(|j| (1..2 * N).map(move |i| (i, j))) {
            let origin = Vec3::new(i as f32 * 0.5, j as f32 * 0.5, z);
            for zero in [0.0, -0.0] {
                let ray = Ray::new(origin, Vec3::new(zero, -zero, -z));
                let hit = scene.closest(&ray);
                assert_eq!(hit.map(|hit| hit.t), Some(1.0), "{ray:?}");
            }
        }
    }
}

#[test]
fn walls_in_near_contact_are_found_g06() {
    // A strip of 64 triangles at x = t, in front of a ray along +x.
    for t in [1e-2_f32, 1e-3, 2e-4, 9e-5, 1e-5, 1e-6] {
        let positions = (0..=32).flat_map(|i| [[t, -1.0, i as f32 - 15.7], [t, 1.0, i as f32 - 15.7]]).collect();
        let triangles = (0..32).flat_map(|i| [[2 * i, 2 * i + 1, 2 * i + 2], [2 * i + 1, 2 * i + 3, 2 * i + 2]]);
        let scene = geometry(vec![(positions, triangles.collect())]);
        let mut rng = generator(6);
        for _ in 0..1000 {
            let y = rng.random_range(-0.5..0.5);
            let z = rng.random_range(-10.0..10.0);
            let slope = Vec3::new(1.0, rng.random_range(-0.5..0.5), rng.random_range(-0.5..0.5));
            let ray = Ray::new(Vec3::new(0.0, y, z), slope);
            let found = scene.closest(&ray).map(|hit| hit.t);
            let error = found.map_or(f32::INFINITY, |found| (found - t).abs());
            assert!(error <= 4.0 * f32::EPSILON * t, "{found:?} for {t}");
            assert!(scene.occluded(&Ray { tmax: t * 1.01, ..ray }));
            assert!(!scene.occluded(&Ray { tmax: t, ..ray }), "tmax is not part of the ray");
            assert!(!scene.occluded(&Ray { tmin: t * (1.0 + f32::EPSILON), ..ray }));
        }
    }
}

#[test]
fn thin_far_targets_are_met_by_exact_axis_rays_g07() {
    for axis in 0..3 {
        for half_width in [1e-7_f32, 1e-6, 1e-3, 1.0] {
            for distance in [1.0_f32, 100.0, 1e4, 1e8] {
                let place = |x: f32, y: f32| {
                    let mut p = [0.0; 3];
                    (p[(axis + 1) % 3], p[(axis + 2) % 3], p[axis]) = (x * half_width, y * half_width, distance);
                    p
                };
                let mesh = (vec![place(-1.0, -1.0), place(1.0, -1.0), place(0.0, 1.0)], vec![[0, 1, 2]]);
                let scene = geometry(vec![mesh]);
                let mut d = Vec3::ZERO;
                d[axis] = 1.0;
                for direction in [d, d * 1e-30, d * 1e30, d * f32::MIN_POSITIVE / 8.0] {
                    let hit = scene.closest(&Ray::new(Vec3::ZERO, direction));
                    let (x, y) = ((axis + 1) % 3, (axis + 2) % 3);
                    let aside = |dx: f32, dy: f32| {
                        let mut origin = Vec3::ZERO;
                        (origin[x], origin[y]) = (dx * half_width, dy * half_width);
                        scene.closest(&Ray::new(origin, direction))
                    };
                    let expected = f64::from(distance) / f64::from(direction[axis]);
                    if expected <= f64::from(f32::MAX) {
                        let error = hit.map_or(f64::INFINITY, |hit| (f64::from(hit.t) - expected).abs());
                        assert!(error <= 2e-7 * expected, "{half_width} {distance} {direction} {hit:?}");
                        assert!(aside(0.0, 0.9).is_some() && aside(0.9, 0.0).is_none() && aside(1.1, 0.0).is_none());
                    }
                }
            }
        }
    }
}

#[test]
fn closed_fan_of_slivers_has_no_gap_g15() {
    // 10^4 slivers around an apex, as two cones closed at the rim; rays from inside at rim points and beside them.
    const N: u32 = 5000;
    for squeeze in [1.0, 1e-4] {
        let rim = |i: u32| {
            let phi = std::f64::consts::TAU * f64::from(i) / f64::from(N);
            DVec3::new(phi.cos(), phi.sin() * squeeze, 0.0)
        };
        let mut positions = vec![[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]];
        positions.extend((0..N).map(|i| rim(i).as_vec3().to_array()));
        let triangles =
            (0..N).flat_map(|i| [[0, 2 + i, 2 + (i + 1) % N], [1, 2 + (i + 1) % N, 2 + i]]).collect::<Vec<_>>();
        let aims = targets(&positions, &triangles);
        let scene = geometry(vec![(positions, triangles)]);
        let origin = Vec3::new(0.1, 1e-6, 0.2);
        for target in aims {
            let ray = Ray::new(origin, (target - origin.as_dvec3()).normalize().as_vec3());
            assert!(scene.closest(&ray).is_some(), "{squeeze}: {ray:?}");
        }
    }
}

#[test]
fn edge_on_rays_miss_the_face_they_lie_in_g16() {
    let scene = geometry(vec![cuboid(Vec3::ZERO, Vec3::ONE)]);
    // In the plane y = 0, and along the edge y = z = 0 shared by two faces.
    for z in [0.5, 0.0] {
        let ray = Ray::new(Vec3::new(-1.0, 0.0, z), Vec3::X);
        let hit = scene.closest(&ray).expect("the near face of the box");
        assert_eq!(hit.t, 1.0);
        let beyond = Ray { tmin: 1.5, ..ray };
        assert_eq!(scene.closest(&beyond).map(|hit| hit.t), Some(2.0));
    }
    let alone = geometry(vec![(vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], vec![[0, 1, 2]])]);
    let mut rng = generator(16);
    for _ in 0..10_000 {
        let mut flat = direction(&mut rng);
        flat.y = 0.0;
        let ray = Ray::new(Vec3::new(rng.random(), 0.0, rng.random()) - 3.0 * flat, flat);
        assert!(alone.closest(&ray).is_none() && !alone.occluded(&ray), "{ray:?}");
    }
}

#[test]
fn slivers_are_met_at_their_centroids_g15() {
    let mut rng = generator(15);
    for exponent in 3..=8 {
        let aspect = 10.0_f32.powi(exponent);
        for _ in 0..300 {
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
            let Some(hit) = scene.closest(&ray) else {
                assert!(degenerate || exponent > 6, "aspect {aspect}: missed");
                continue;
            };
            let point = scene.surface(&ray, &hit);
            // The ray is rounded too, by at most half an ulp of its length.
            let bound = f64::from(point.error.length()) + 4.0 * f64::from(f32::EPSILON);
            let off = (point.position.as_dvec3() - exact).length();
            assert!(off <= bound * f64::from(aspect) && (hit.t - 1.0).abs() <= 1e-5, "aspect {aspect}: {off}, {hit:?}");
        }
    }
}
