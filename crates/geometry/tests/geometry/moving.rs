//! Meshes with moving vertices equal a still mesh of the same corners at each time.

use crate::support::*;
use dapple_geometry::{Error, Geometry, Instance, Mesh, Motion, MovingMesh, Ray, Shape, Sphere, spawn_ray};
use glam::{DAffine3, Vec3};
use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use std::sync::Arc;

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
    let ends = starts
        .iter()
        .map(|s| {
            let by = point(rng, size);
            [s[0] + by[0], s[1] + by[1], s[2] + by[2]]
        })
        .collect();
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
    (0..count)
        .map(|_| {
            let (from, to) = (point(rng, 3.0 * size), point(rng, size));
            Ray::new(Vec3::from_array(from), Vec3::from_array(to) - Vec3::from_array(from))
        })
        .collect()
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

/// Large trees of triangles alone have leaves of several in the binary tree. A far sphere makes leaves of one.
#[test]
fn large_meshes_are_met_as_still_ones_and_as_one_by_one() {
    let mut rng = generator(64);
    let (starts, triangles) = lat_long(100, 2.0, glam::DVec3::new(0.3, -0.7, 0.11));
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
fn moving_spheres_have_no_gap_g01() {
    let mut rng = generator(62);
    let (starts, triangles) = lat_long(24, 2.0, glam::DVec3::new(0.3, -0.7, 0.11));
    // Every vertex moves on its own, near the centre or far from it.
    let ends: Vec<[f32; 3]> =
        starts.iter().map(|p| p.map(|x| x * 3.0 + 0.05).map(|x| x + rng.random_range(-0.02..0.02))).collect();
    let mesh = MovingMesh::new(starts.clone(), ends.clone(), triangles.clone()).expect("sound");
    let scene = Geometry::build(vec![Shape::from(mesh)]).expect("few");
    let eye = Vec3::new(0.4, -0.5, 0.2);
    for time in TIMES {
        let now = at(&starts, &ends, time);
        for triangle in &triangles {
            let [a, b, c] = triangle.map(|v| Vec3::from_array(now[v as usize]));
            for aim in [a, b, c, (a + b) * 0.5, (b + c) * 0.5, (c + a) * 0.5] {
                let ray = Ray::new(eye, (aim - eye).normalize());
                assert!(
                    scene.occluded_at(&ray, time) && scene.closest_at(&ray, time).is_some(),
                    "time {time}, {ray:?}"
                );
            }
        }
    }
}

#[test]
fn rays_that_leave_a_moving_mesh_do_not_meet_it_again_g18() {
    let mut rng = generator(63);
    let (starts, ends, triangles) = soup(&mut rng, 1.0);
    let mesh = MovingMesh::new(starts, ends, triangles).expect("sound");
    let alone = Geometry::build(vec![Shape::from(mesh.clone())]).expect("few");
    let turned = DAffine3::from_axis_angle(glam::DVec3::new(0.6, 0.0, 0.8), 1.0);
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
