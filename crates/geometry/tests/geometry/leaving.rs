//! Rays that leave surfaces, and shadow rays between them, for every shape.

use crate::support::{direction, generator, lat_long, point_in, wild};
use dapple_geometry::{
    Disk, Geometry, Mesh, PrimitiveId, Ray, Shape, Sphere, SurfacePoint, spawn_ray, spawn_ray_to, spawn_ray_to_point,
};
use glam::{DAffine3, DMat3, DQuat, DVec3, Vec3};
use rand::RngExt;
use rand_pcg::Pcg64Mcg;

const EPS: f32 = f32::EPSILON;

fn alone(shape: Shape) -> Geometry {
    Geometry::build(vec![shape]).expect("one shape")
}

fn triangle(corners: [Vec3; 3]) -> Option<Geometry> {
    let mesh = Mesh::new(corners.map(|c| c.to_array()).to_vec(), vec![[0, 1, 2]]).ok()?;
    (mesh.degenerate() == 0).then(|| alone(mesh.into()))
}

/// Returns a point of the only shape, hit by a ray from a random nearby position.
fn hit_somewhere(scene: &Geometry, aims: impl Fn(&mut Pcg64Mcg) -> Vec3, rng: &mut Pcg64Mcg) -> Option<SurfacePoint> {
    let [low, high] = scene.bounds()?;
    (0..20).find_map(|_| {
        let origin = point_in(rng, low - (high - low), high + (high - low));
        let ray = Ray::new(origin, aims(rng) - origin);
        scene.closest(&ray).map(|hit| scene.surface(&ray, &hit))
    })
}

/// Traces `count` rays from the point and returns how many hit the flat shape again.
fn met_again(scene: &Geometry, point: &SurfacePoint, count: usize, rng: &mut Pcg64Mcg) -> usize {
    // The primitive at the start is omitted, since the offset is tested.
    let point = &SurfacePoint { primitive: PrimitiveId::NONE, ..*point };
    let reach = scene.bounds().map_or(Vec3::ONE, |[low, high]| (high - low) * 3.0);
    (0..count)
        .filter(|_| {
            let ray = spawn_ray(point, direction(rng));
            let target = point_in(rng, point.position - reach, point.position + reach);
            let shadow = spawn_ray_to_point(point, target);
            scene.closest(&ray).is_some() || scene.occluded(&ray) || scene.occluded(&shadow)
        })
        .count()
}

#[test]
fn triangles_just_left_are_not_met_again_g18() {
    let mut rng = generator(18);
    let (mut tried, mut again) = (0, 0);
    for i in 0..1000 {
        let shift = if i % 3 == 2 { Vec3::splat(1e6) } else { Vec3::ZERO };
        let corners = std::array::from_fn(|_| {
            let one = |rng: &mut Pcg64Mcg| if i % 2 == 0 { wild(rng, 8.0) } else { rng.random_range(-1.0..1.0) };
            Vec3::new(one(&mut rng), one(&mut rng), one(&mut rng)) + shift
        });
        let Some(scene) = triangle(corners) else { continue };
        let aims = |rng: &mut Pcg64Mcg| {
            let (a, b) = (rng.random::<f32>(), rng.random::<f32>());
            let (a, b) = if a + b > 1.0 { (1.0 - a, 1.0 - b) } else { (a, b) };
            corners[0] * (1.0 - a - b) + corners[1] * a + corners[2] * b
        };
        let Some(point) = hit_somewhere(&scene, aims, &mut rng) else { continue };
        tried += 500;
        again += met_again(&scene, &point, 500, &mut rng);
    }
    assert!(tried > 300_000 && again == 0, "{again} of {tried}");
}

#[test]
fn negative_control_without_the_offset_surfaces_are_met_again_g18() {
    let mut rng = generator(180);
    let corners = [Vec3::new(0.1, 0.7, -0.4), Vec3::new(3.3, -0.2, 0.9), Vec3::new(-1.7, 0.35, 2.6)];
    let scene = triangle(corners).expect("a good triangle");
    let aims = |_: &mut Pcg64Mcg| (corners[0] + corners[1] + corners[2]) / 3.0;
    let again = (0..1000).filter(|_| {
        let Some(point) = hit_somewhere(&scene, aims, &mut rng) else { return false };
        scene.closest(&Ray::new(point.position, direction(&mut rng))).is_some()
    });
    assert!(again.count() > 50);
}

fn affine(rng: &mut Pcg64Mcg, scale: f64) -> DAffine3 {
    let mut stretch = || rng.random_range(0.3..2.0) * scale;
    let stretch = DVec3::new(stretch(), -stretch(), stretch());
    let angle = rng.random_range(0.0..6.0);
    let turn = DMat3::from_quat(DQuat::from_axis_angle(direction(rng).as_dvec3().normalize(), angle));
    let place = point_in(rng, Vec3::splat(-4.0), Vec3::splat(4.0)).as_dvec3() * scale;
    DAffine3 { matrix3: turn * DMat3::from_diagonal(stretch) * turn.transpose(), translation: place }
}

#[test]
fn spheres_and_disks_just_left_are_not_met_again_g18() {
    let mut rng = generator(181);
    for i in 0..400 {
        let scale = 2.0_f64.powi(i % 81 - 40);
        let to_world = affine(&mut rng, scale);
        let disk = Disk::transformed(to_world, 0.3, 1.5, 0.2).expect("a disk");
        let scene = alone(disk.into());
        let aims = |rng: &mut Pcg64Mcg| {
            let p = DVec3::new(rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0), 0.3);
            to_world.transform_point3(p).as_vec3()
        };
        let point = hit_somewhere(&scene, aims, &mut rng).expect("aimed at the disk");
        assert_eq!(met_again(&scene, &point, 100, &mut rng), 0, "disk at {scale:e}");

        let scene = alone(Sphere::transformed(to_world, 1.2).expect("a sphere").into());
        let aims = |_: &mut Pcg64Mcg| to_world.translation.as_vec3();
        let point = hit_somewhere(&scene, aims, &mut rng).expect("aimed at the sphere");
        for _ in 0..200 {
            let ray = spawn_ray(&point, direction(&mut rng));
            let again = scene.closest(&ray);
            let leaves = ray.direction.dot(point.normal) >= 0.0;
            assert_eq!(again.is_none(), leaves, "sphere at {scale:e}: {ray:?} {again:?}");
            if let Some(hit) = again {
                let far = scene.surface(&ray, &hit).position;
                assert!((far - point.position).length() > 1e-6 * scale as f32, "the far side, not this one");
            }
        }
    }
}

#[test]
fn error_bounds_hold_and_are_tight() {
    // The plane through exact corners in f64; spheres and disks in object space.
    let mut rng = generator(7);
    for i in 0..2000 {
        let scale = 2.0_f32.powi(i % 61 - 30);
        let corners: [Vec3; 3] = std::array::from_fn(|_| point_in(&mut rng, Vec3::splat(-1.0), Vec3::ONE) * scale);
        let Some(scene) = triangle(corners) else { continue };
        let centre = (corners[0] + corners[1] + corners[2]) / 3.0;
        let Some(point) = hit_somewhere(&scene, |_| centre, &mut rng) else { continue };
        let [a, b, c] = corners.map(Vec3::as_dvec3);
        let normal = (b - a).cross(c - a).normalize();
        let off = normal.dot(point.position.as_dvec3() - a).abs();
        assert!(off <= normal.abs().dot(point.error.as_dvec3()), "triangle at {scale:e}");
        assert!(point.normal.as_dvec3().dot(normal) > 0.999_999);
        assert!(point.error.max_element() <= 2.0 * EPS * point.position.abs().max_element() + 1e-9 * scale);

        let to_world = affine(&mut rng, f64::from(scale));
        let scene = alone(Sphere::transformed(to_world, 1.2).expect("a sphere").into());
        let point = hit_somewhere(&scene, |_| to_world.translation.as_vec3(), &mut rng).expect("the sphere");
        let p = to_world.inverse().transform_point3(point.position.as_dvec3());
        let out = to_world.matrix3.inverse().transpose() * p;
        // First order: distance along the world's normal.
        let off = (p.length() - 1.2).abs() * p.length() / out.length();
        assert!(off <= (out.normalize().abs()).dot(point.error.as_dvec3()) * 1.000_1, "sphere at {scale:e}");
        assert!(point.normal.as_dvec3().dot(out.normalize()) > 0.999_999, "outward");
    }
}

#[test]
fn shadow_rays_reach_a_wall_from_everywhere() {
    // A closed ball: every segment between two inner points is free.
    for (radius, centre) in [(1.0, DVec3::ZERO), (1.0, DVec3::new(1000.0, -300.0, 77.0)), (1e-6, DVec3::ZERO)] {
        let (positions, triangles) = lat_long(24, radius, centre);
        let mesh = alone(Mesh::new(positions, triangles).expect("valid").into());
        let sphere = Sphere::transformed(DAffine3::from_translation(centre), radius).expect("a sphere");
        for scene in [mesh, alone(sphere.into())] {
            let mut rng = generator(20);
            let mut inner = || {
                let ray = Ray::new(centre.as_vec3(), direction(&mut rng));
                let hit = scene.closest(&ray).expect("closed");
                scene.surface(&ray, &hit)
            };
            for _ in 0..20_000 {
                let (a, b) = (inner(), inner());
                let ray = spawn_ray_to(&a, &b);
                // Two points of one flat triangle see each other edge on, and no light arrives.
                let grazing = ray.direction.normalize().dot(a.normal).abs() < 1e-3;
                assert!(grazing || !scene.occluded(&ray), "{ray:?} {a:?} {b:?}");
            }
        }
    }
}

#[test]
fn the_offset_is_small_g19() {
    for k in [-20, 0, 20] {
        let scale = 2.0_f32.powi(k);
        // Concentric spheres, exact and as meshes.
        let spheres = [1.0, 1.0 + 4e-5].map(|r| Shape::from(Sphere::new(Vec3::ZERO, r * scale).expect("a sphere")));
        let gap = 64.0 * EPS;
        let sheet = |z: f32| {
            let corner = |x: f32, y: f32| [x * scale, y * scale, z * scale];
            let corners = vec![corner(-1.0, -1.0), corner(1.0, -1.0), corner(0.9, 1.1), corner(-1.0, 1.0)];
            Shape::from(Mesh::new(corners, vec![[0, 1, 2], [0, 2, 3]]).expect("valid"))
        };
        let scenes = [spheres.to_vec(), vec![sheet(1.0), sheet(1.0 + gap)]];
        let mut rng = generator(190);
        for (number, shapes) in scenes.into_iter().enumerate() {
            let scene = Geometry::build(shapes).expect("two shapes");
            for _ in 0..5000 {
                let towards = Vec3::new(rng.random_range(-0.6..0.6), rng.random_range(-0.6..0.6), 1.0);
                let ray = Ray::new(Vec3::ZERO, towards);
                let hit = scene.closest(&ray).expect("the first surface");
                assert_eq!(hit.shape, 0);
                let point = scene.surface(&ray, &hit);
                let next = spawn_ray(&point, towards);
                let moved = (next.origin - point.position).length();
                assert!(moved <= 32.0 * EPS * point.position.abs().max_element(), "{moved} at {scale}");
                assert_eq!(scene.closest(&next).map(|hit| hit.shape), Some(1), "scene {number} at {scale}");
            }
        }
    }
}

#[test]
fn spheres_and_disks_are_met_at_their_surface() {
    let ball = Sphere::new(Vec3::new(0.0, 0.0, 5.0), 2.0).expect("a sphere");
    let ring = Disk::new(Vec3::new(0.0, 0.0, -4.0), Vec3::Z * 3.0, 2.0, 1.0).expect("a ring");
    let scene = Geometry::build(vec![ball.into(), ring.into()]).expect("two shapes");
    let at = |origin: Vec3, direction: Vec3| scene.closest(&Ray::new(origin, direction)).map(|hit| (hit.shape, hit.t));
    assert_eq!(at(Vec3::ZERO, Vec3::Z), Some((0, 3.0)));
    assert_eq!(at(Vec3::new(0.0, 0.0, 5.0), Vec3::Z * 4.0), Some((0, 0.5)), "from inside");
    assert_eq!(at(Vec3::ZERO, Vec3::NEG_Z), None, "through the hole");
    assert_eq!(at(Vec3::new(1.5, 0.0, 0.0), Vec3::NEG_Z), Some((1, 4.0)));
    assert_eq!(at(Vec3::new(2.5, 0.0, 0.0), Vec3::NEG_Z), None, "beside it");
    let ray = Ray::new(Vec3::new(0.0, 1.5, 0.0), Vec3::NEG_Z);
    let hit = scene.closest(&ray).expect("the ring");
    let point = scene.surface(&ray, &hit);
    assert_eq!((point.position, point.normal), (Vec3::new(0.0, 1.5, -4.0), Vec3::Z));
    assert!((scene.parametric_at(&hit, point.position, 0.0)[1] - 0.5).abs() < 1e-6);
    let ray = Ray::new(Vec3::new(0.0, 0.0, 20.0), Vec3::NEG_Z);
    let hit = scene.closest(&ray).expect("the ball");
    let point = scene.surface(&ray, &hit);
    assert_eq!(
        (point.position.z, point.normal, scene.parametric_at(&hit, point.position, 0.0)[1]),
        (7.0, Vec3::Z, 1.0)
    );
}
