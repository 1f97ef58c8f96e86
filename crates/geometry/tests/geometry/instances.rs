//! Instances of objects.

use crate::support::*;
use dapple_geometry::{
    Disk, Error, Geometry, Hit, Instance, Mesh, Motion, PlacedShape, PrimitiveId, Ray, Shape, Sphere, SurfacePoint,
    spawn_ray, spawn_ray_to,
};
use glam::{DAffine3, DMat3, DVec3, Vec3};
use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use std::sync::Arc;

/// A random rotation and stretch with scales of 10^±3 (within 10^±1 of each other), every other one mirrored, moved by
/// up to `far`.
fn map(rng: &mut Pcg64Mcg, far: f64) -> DAffine3 {
    let (size, mirror) = (10.0_f64.powf(rng.random_range(-3.0..3.0)), rng.random());
    let matrix3 = turned_and_stretched(rng, size, 0.5, mirror);
    DAffine3 { matrix3, translation: direction(rng).as_dvec3() * far * rng.random_range(0.0..1.0) }
}

fn still(object: u32, map: DAffine3) -> Instance {
    Instance::new(object, Motion::still(map))
}

fn mesh((positions, triangles): Soup) -> Shape {
    Mesh::new(positions, triangles).expect("a valid mesh").into()
}

fn object(shapes: Vec<Shape>) -> Arc<Geometry> {
    Arc::new(Geometry::build(shapes).expect("few shapes"))
}

fn scene(shapes: Vec<Shape>, objects: Vec<Arc<Geometry>>, instances: Vec<Instance>) -> Geometry {
    Geometry::with_instances(shapes, objects, instances).expect("a sound scene")
}

fn soup(rng: &mut Pcg64Mcg, count: u32) -> Soup {
    let positions = (0..3 * count).map(|_| std::array::from_fn(|_| rng.random_range(-1.0..1.0))).collect();
    (positions, (0..count).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect())
}

/// `n` x `n` quads in the plane z = 0 over the square of half width 1 around `centre`.
fn sheet(n: u32, centre: Vec3) -> Soup {
    let at = |i: u32| -1.0 + 2.0 * i as f32 / n as f32;
    let positions = (0..=n).flat_map(|j| (0..=n).map(move |i| (i, j)));
    let positions = positions.map(|(i, j)| (Vec3::new(at(i), at(j), 0.0) + centre).to_array()).collect();
    let quads = (0..n).flat_map(|j| (0..n).map(move |i| j * (n + 1) + i));
    let triangles = quads.flat_map(|a| [[a, a + 1, a + n + 2], [a, a + n + 2, a + n + 1]]).collect();
    (positions, triangles)
}

/// The first hit of triangles in f64 [Moeller and Trumbore 1997], and true if it is clear: no edge and no other hit is so near
/// that rounding matters.
fn reference(triangles: &[[DVec3; 3]], ray: &Ray) -> (Option<(f64, usize)>, bool) {
    let (o, d) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
    let (mut hits, mut clear) = (Vec::new(), true);
    for (number, &[a, b, c]) in triangles.iter().enumerate() {
        let (ab, ac) = (b - a, c - a);
        let p = d.cross(ac);
        let determinant = ab.dot(p);
        let q = (o - a).cross(ab);
        let (u, v, t) = ((o - a).dot(p) / determinant, d.dot(q) / determinant, ac.dot(q) / determinant);
        let size = ab.length().max(ac.length());
        let flatness = determinant.abs() / (d.length() * size * size);
        // Sixteen roundings of all inputs; objects are a few triangles large.
        let rounding = f64::from(f32::EPSILON) * 8.0 * (o.length() + a.length() + b.length() + c.length() + 8.0 * size);
        let slack = rounding / (size * flatness);
        let margin = u.min(v).min(1.0 - u - v);
        if margin.abs() <= slack || !slack.is_finite() {
            clear = false;
        } else if margin > 0.0 && t > 0.0 {
            hits.push((t, number, slack * size / d.length()));
        }
    }
    hits.sort_by(|a, b| a.0.total_cmp(&b.0));
    if let [first, second, ..] = hits[..] {
        clear &= second.0 - first.0 > first.2 + second.2;
    }
    (hits.first().map(|&(t, number, _)| (t, number)), clear)
}

#[test]
fn triangles_agree_with_brute_force_in_f64_g08() {
    let mut rng = generator(101);
    let (mut hits, mut doubtful) = (0, 0);
    for case in 0..60 {
        let soups = [soup(&mut rng, 12), soup(&mut rng, 5)];
        let maps: Vec<DAffine3> = (0..4).map(|_| map(&mut rng, 5.0)).collect();
        let base = soup(&mut rng, 6);
        let objects = soups.iter().map(|soup| object(vec![mesh(soup.clone())])).collect();
        let instances = maps.iter().enumerate().map(|(i, &map)| still(i as u32 % 2, map)).collect();
        let scene = scene(vec![mesh(base.clone())], objects, instances);
        let mut triangles = Vec::new();
        let mut numbers = Vec::new();
        let placed = maps.iter().enumerate().map(|(i, map)| (&soups[i % 2], *map));
        for (shape, (soup, map)) in std::iter::once((&base, DAffine3::IDENTITY)).chain(placed).enumerate() {
            for (number, corners) in soup.1.iter().enumerate() {
                let corner = |v: u32| map.transform_point3(Vec3::from_array(soup.0[v as usize]).as_dvec3());
                triangles.push(corners.map(corner));
                numbers.push((shape as u32, number as u32));
            }
        }
        for _ in 0..300 {
            let target: DVec3 = triangles[rng.random_range(0..triangles.len())].iter().sum::<DVec3>() / 3.0;
            let origin = point_in(&mut rng, Vec3::splat(-8.0), Vec3::splat(8.0));
            let length = 10.0_f32.powf(rng.random_range(-3.0..3.0));
            let ray = Ray::new(origin, (target.as_vec3() - origin).normalize() * length);
            let (expected, clear) = reference(&triangles, &ray);
            let found = scene.closest(&ray);
            assert_eq!(scene.occluded(&ray), found.is_some(), "case {case}, {ray:?}");
            if !clear {
                doubtful += 1;
                continue;
            }
            let known = expected.map(|(_, n)| numbers[n]);
            assert_eq!(found.map(|hit| (hit.shape, hit.primitive)), known, "case {case}, {ray:?}");
            if let (Some(hit), Some((t, _))) = (found, expected) {
                hits += 1;
                let exact = ray.origin.as_dvec3() + ray.direction.as_dvec3() * t;
                let point = scene.surface(&ray, &hit);
                let [error, normal] = [point.error, point.normal].map(Vec3::as_dvec3);
                let off = (point.position.as_dvec3() - exact).dot(normal);
                assert!(off.abs() <= error.dot(normal.abs()), "{off} off, {error} allowed");
                let slant = normal.dot(ray.direction.as_dvec3()).abs();
                // Between its limits `t` is an f32, within sixteen roundings.
                let allowed = 16.0 * error.dot(normal.abs()) / slant + t * 1e-6;
                assert!((f64::from(hit.t) - t).abs() <= allowed, "{} for {t}, {allowed} allowed", hit.t);
            }
        }
    }
    assert!(hits > 8000 && doubtful < 8000, "{hits} hits, {doubtful} doubtful");
}

/// Hits obey the limits and do not depend on the tree.
#[test]
fn hits_lie_within_the_ray_whatever_the_tree() {
    let mut rng = generator(102);
    let mut cut = 0;
    for _ in 0..40 {
        let things = [object(vec![mesh(soup(&mut rng, 20)), Sphere::new(Vec3::ONE, 0.5).expect("valid").into()])];
        let instances: Vec<Instance> = (0..12).map(|_| still(0, map(&mut rng, 3.0))).collect();
        // The second tree holds everything twice, and the copies have larger numbers.
        let scenes = [1, 2].map(|copies| scene(vec![], things.to_vec(), vec![instances.clone(); copies].concat()));
        for _ in 0..200 {
            let origin = point_in(&mut rng, Vec3::splat(-4.0), Vec3::splat(4.0));
            let ray = Ray::new(origin, point_in(&mut rng, Vec3::splat(-2.0), Vec3::splat(2.0)) - origin);
            let Some(whole) = scenes[0].closest(&ray) else { continue };
            // From just before, at and behind the first hit; up to just before and at it.
            let t = whole.t;
            for (tmin, tmax) in [(t * 0.999, 1e30), (t, 1e30), (t * 1.001, 1e30), (0.0, t), (0.0, t * 1.001)] {
                let ray = Ray { tmin, tmax, ..ray };
                let hit = scenes[0].closest(&ray);
                for scene in &scenes {
                    assert_eq!(scene.closest(&ray), hit);
                    assert_eq!(scene.occluded(&ray), hit.is_some());
                }
                assert!(hit.is_none_or(|hit| hit.t > tmin && hit.t < tmax), "{hit:?} of {ray:?}");
                cut += usize::from(hit.is_none_or(|hit| hit != whole));
            }
        }
    }
    assert!(cut > 3000, "{cut} hits cut off");
}

#[test]
fn instances_are_watertight() {
    let mut rng = generator(104);
    let (positions, triangles) = lat_long(16, 2.0, DVec3::new(3.0, -7.0, 1.0));
    let ball = object(vec![mesh((positions.clone(), triangles.clone()))]);
    for case in 0..24 {
        let far = [0.0, 10.0, 1e4][case % 3];
        let place = map(&mut rng, far);
        let scene = scene(vec![], vec![ball.clone()], vec![still(0, place)]);
        let world = |p: DVec3| place.transform_point3(p);
        let vertex = |v: u32| Vec3::from_array(positions[v as usize]).as_dvec3();
        let inside = DVec3::new(3.0, -7.0, 1.0) + direction(&mut rng).as_dvec3() * 0.5;
        let origin = world(inside).as_vec3();
        for corners in &triangles {
            for k in 0..3 {
                let (a, b) = (vertex(corners[k]), vertex(corners[(k + 1) % 3]));
                for target in [a, (a + b) * 0.5] {
                    let direction = (world(target) - origin.as_dvec3()).as_vec3();
                    assert!(scene.closest(&Ray::new(origin, direction)).is_some(), "case {case}: {target} missed");
                }
            }
        }
    }
}

/// Returns a hit from outside, with its ray.
fn hit_from(rng: &mut Pcg64Mcg, scene: &Geometry, target: DVec3, distance: f64) -> Option<(Ray, Hit)> {
    let origin = (target + direction(rng).as_dvec3() * distance).as_vec3();
    let ray = Ray::new(origin, (target - origin.as_dvec3()).as_vec3());
    scene.closest(&ray).map(|hit| (ray, hit))
}

/// Rays that leave a sheet, or a ball outwards, are unobstructed. `forget` omits the bound on the error.
fn meets_again(seed: u64, forget: bool) -> (usize, usize) {
    let mut rng = generator(seed);
    let (mut again, mut rays) = (0, 0);
    for case in 0..120 {
        let centre = if case % 2 == 0 { Vec3::ZERO } else { Vec3::new(40.0, -7.0, 3.0) };
        let shape = match case % 3 {
            0 => mesh(sheet(6, centre)),
            1 => Sphere::new(centre, 0.8).expect("valid").into(),
            _ => Disk::new(centre, Vec3::new(0.3, 0.1, 1.0), 1.0, 0.1).expect("valid").into(),
        };
        let place = map(&mut rng, [0.0, 1.0, 1e3, 1e6][case / 3 % 4]);
        let scene = scene(vec![], vec![object(vec![shape])], vec![still(0, place)]);
        for _ in 0..30 {
            let aside = point_in(&mut rng, Vec3::new(-0.9, -0.9, 0.0), Vec3::new(0.9, 0.9, 0.0));
            let target = place.transform_point3((centre + aside).as_dvec3());
            let distance = place.matrix3.x_axis.length() * 10.0_f64.powf(rng.random_range(-1.0..3.0));
            let Some((ray, hit)) = hit_from(&mut rng, &scene, target, distance) else { continue };
            let mut point = scene.surface(&ray, &hit);
            if forget {
                point = SurfacePoint { error: Vec3::ZERO, ..point };
            }
            for _ in 0..60 {
                let mut wanted = direction(&mut rng);
                let cosine = wanted.dot(point.normal);
                // Half of them nearly along the surface.
                if rng.random() {
                    wanted -= point.normal * (cosine * (1.0 - 10.0_f32.powf(rng.random_range(-5.0..0.0))));
                }
                if wanted.dot(point.normal).abs() < 1e-6 || (case % 3 == 1 && wanted.dot(point.normal) < 0.0) {
                    continue;
                }
                // The primitive at the start is omitted, so the offset must suffice.
                let ray = Ray { ends: [PrimitiveId::NONE; 2], ..spawn_ray(&point, wanted) };
                rays += 1;
                again += usize::from(scene.closest(&ray).is_some());
            }
        }
    }
    (again, rays)
}

#[test]
fn rays_that_leave_an_instance_do_not_meet_it_again_g18() {
    let (again, rays) = meets_again(105, false);
    assert!(again == 0 && rays > 100_000, "{again} of {rays} rays met what they left");
    // The negative control.
    let (again, rays) = meets_again(105, true);
    assert!(again > rays / 100, "without the error only {again} of {rays} rays met what they left");
}

/// Rays between two instances hit neither of them, from any point.
#[test]
fn rays_between_instances_meet_neither_g18() {
    let mut rng = generator(106);
    let sheets = object(vec![mesh(sheet(4, Vec3::ZERO))]);
    let mut rays = 0;
    for case in 0..200 {
        let size = 10.0_f64.powf(rng.random_range(-2.0..2.0));
        let scaled = DMat3::from_diagonal(DVec3::new(size, size, -1.0));
        let far = direction(&mut rng).as_dvec3() * [0.0, 1.0, 1e3][case % 3];
        let lower = DAffine3 { matrix3: scaled, translation: far };
        let turned = DMat3::from_rotation_x(rng.random_range(-0.5..0.5)) * scaled;
        let upper = DAffine3 { matrix3: turned, translation: far + DVec3::Z * size * 2.0 };
        let scene = scene(vec![], vec![sheets.clone()], vec![still(0, lower), still(0, upper)]);
        let seen = |rng: &mut Pcg64Mcg, place: &DAffine3, from: DVec3| {
            let aside = point_in(rng, Vec3::new(-0.9, -0.9, 0.0), Vec3::new(0.9, 0.9, 0.0));
            let origin = (place.translation + from * size).as_vec3();
            let target = place.transform_point3(aside.as_dvec3());
            let ray = Ray::new(origin, (target - origin.as_dvec3()).as_vec3());
            scene.closest(&ray).map(|hit| (scene.surface(&ray, &hit), hit.shape))
        };
        for _ in 0..20 {
            let a = seen(&mut rng, &lower, DVec3::Z);
            let b = seen(&mut rng, &upper, -DVec3::Z);
            let (Some((a, 0)), Some((b, 1))) = (a, b) else { continue };
            for (a, b) in [(a, b), (b, a)] {
                let ray = Ray { ends: [PrimitiveId::NONE; 2], ..spawn_ray_to(&a, &b) };
                assert!(!scene.occluded(&ray) && !scene.occluded(&spawn_ray_to(&a, &b)), "case {case}: {ray:?}");
                rays += 1;
            }
        }
    }
    assert!(rays > 5000, "{rays} rays");
}

#[test]
fn normals_are_taken_by_the_inverse_transpose() {
    let mut rng = generator(107);
    let tilted = Soup::from((vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.3], [0.0, 1.0, -0.2]], vec![[0, 1, 2]]));
    let [a, b, c] = [0, 1, 2].map(|i: usize| Vec3::from_array(tilted.0[i]).as_dvec3());
    let inner = (b - a).cross(c - a);
    let (mut mirrored, ball) = (0, Sphere::new(Vec3::ZERO, 1.0).expect("valid"));
    let objects = vec![object(vec![mesh(tilted)]), object(vec![ball.into()])];
    for _ in 0..300 {
        let place = map(&mut rng, 1.0);
        let expected = (place.matrix3.inverse().transpose() * inner).normalize();
        let scene = scene(vec![], objects.clone(), vec![still(0, place)]);
        let size = place.matrix3.x_axis.length();
        let middle = place.transform_point3((a + b + c) / 3.0);
        let (ray, hit) = hit_from(&mut rng, &scene, middle, size).expect("it is aimed at");
        let point = scene.surface(&ray, &hit);
        assert!((point.normal.as_dvec3() - expected).length() < 1e-6, "{} for {expected}", point.normal);
        // The winding in world space is the opposite if the map mirrors.
        let [a, b, c] = [a, b, c].map(|p| place.transform_point3(p));
        mirrored += usize::from((b - a).cross(c - a).dot(expected) < 0.0);
        // A ball's normals point outwards, mirrored or not.
        let scene = self::scene(vec![], objects.clone(), vec![still(1, place)]);
        let (ray, hit) = hit_from(&mut rng, &scene, place.translation, size * 40.0).expect("it is aimed at");
        assert!(scene.surface(&ray, &hit).normal.dot(ray.direction) < 0.0);
    }
    assert!((100..200).contains(&mirrored), "{mirrored} mirrored");
}

#[test]
fn shapes_of_instances_are_numbered_after_the_base() {
    let ball = |x: f32| Shape::from(Sphere::new(Vec3::new(x, 0.0, 0.0), 0.4).expect("valid"));
    let objects = vec![object(vec![ball(0.0), ball(1.0)]), object(vec![]), object(vec![ball(0.0)])];
    let up = |y: f64| DAffine3::from_translation(DVec3::new(0.0, y, 0.0));
    let instances = vec![still(2, up(1.0)), still(1, up(9.0)), still(0, up(2.0)), still(0, up(3.0))];
    let scene = scene(vec![ball(0.0), ball(1.0)], objects, instances);
    assert_eq!(scene.shape_count(), 7);
    let placed = |instance: u32, object: u32, shape: u32| Some((instance, object, shape));
    let expected = [None, None, placed(0, 2, 0), placed(2, 0, 0), placed(2, 0, 1), placed(3, 0, 0), placed(3, 0, 1)];
    let originals = [0, 1, 4, 2, 3, 2, 3];
    let places = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.0, 2.0], [1.0, 2.0], [0.0, 3.0], [1.0, 3.0]];
    for number in 0..7 {
        let index = number as usize;
        let found = scene.placed(number).map(|it: PlacedShape| (it.instance, it.object, it.shape));
        assert_eq!((found, scene.original(number)), (expected[index], originals[index]));
        let [x, y] = places[index];
        let hit = scene.closest(&Ray::new(Vec3::new(x, y, -5.0), Vec3::Z)).expect("a ball is there");
        assert_eq!(hit.shape, number);
        let [low, high] = scene.shape(number).bounds().expect("a ball");
        let moved = scene.to_world(number, 0.0).map_or(0.0, |map| map.translation.y as f32);
        assert_eq!(((low + high) * 0.5).truncate().to_array(), [x, y - moved]);
    }
    assert_eq!((scene.placed(7), scene.placed(u32::MAX)), (None, None));
    let [low, high] = scene.bounds().expect("not empty");
    assert!(low.y <= -0.4 && low.y > -0.45 && high.y >= 3.4 && high.y < 3.45, "{low} {high}");
    let nothing = self::scene(vec![], vec![object(vec![])], vec![still(0, DAffine3::IDENTITY); 3]);
    assert!(nothing.bounds().is_none() && nothing.closest(&Ray::new(Vec3::ZERO, Vec3::X)).is_none());
}

#[test]
fn ten_thousand_instances_hold_one_mesh() {
    let ball = object(vec![mesh(lat_long(100, 1.0, DVec3::ZERO))]);
    let place = |i: u32| DAffine3::from_translation(DVec3::new(f64::from(i % 100), f64::from(i / 100), 0.0) * 3.0);
    let instances = (0..10_000).map(|i| still(0, place(i))).collect();
    let scene = scene(vec![], vec![ball.clone()], instances);
    let (one, all) = (ball.memory_bytes(), scene.memory_bytes());
    let each = (all - one) / 10_000;
    assert!(one > 1_000_000 && each < 400, "{one} bytes for the object, {each} more for each instance");
    assert_eq!(scene.triangle_count(), ball.triangle_count());
    assert!(scene.objects().all(|object| Arc::ptr_eq(object, &ball)));
    for i in [0, 1234, 9999] {
        let centre = place(i).translation.as_vec3();
        let hit = scene.closest(&Ray::new(centre + Vec3::new(0.1, 0.2, -50.0), Vec3::Z)).expect("a ball is there");
        assert_eq!((hit.shape, scene.placed(hit.shape).map(|placed| placed.instance)), (i, Some(i)));
    }
}

#[test]
fn invalid_instances_are_refused() {
    let ball = object(vec![Sphere::new(Vec3::ZERO, 1.0).expect("valid").into()]);
    let build =
        |object: &Arc<Geometry>, instance| Geometry::with_instances(vec![], vec![object.clone()], vec![instance]);
    let flat = DAffine3::from_scale(DVec3::new(1.0, 1.0, 0.0));
    assert!(matches!(build(&ball, still(0, flat)), Err(Error::BadParameter { .. })));
    let lost = DAffine3::from_translation(DVec3::new(0.0, f64::NAN, 0.0));
    assert!(matches!(build(&ball, still(0, lost)), Err(Error::BadParameter { .. })));
    let far = DAffine3::from_translation(DVec3::X * 1e18);
    assert!(matches!(build(&ball, still(0, far)), Err(Error::ScaleOutOfRange { .. })));
    let unknown = build(&ball, still(1, DAffine3::IDENTITY)).expect_err("there is one object");
    assert_eq!(
        unknown.to_string(),
        "instance 0 refers to object 1, but object indices must be below 1; correct the index"
    );
    let nested = Arc::new(build(&ball, still(0, DAffine3::IDENTITY)).expect("sound"));
    assert_eq!(build(&nested, still(0, DAffine3::IDENTITY)).err(), Some(Error::Nested { object: 0 }));
}
