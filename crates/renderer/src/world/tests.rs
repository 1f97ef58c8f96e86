//! Instances against copies, motion against what stands still.

use crate::World;
use dapple_geometry::Ray;
use dapple_scene::{
    Camera, Color, Emission, Geometry, Instance, Material, MaterialId, MaterialKind, MeshData, Object, ObjectId, Scene,
    Shape, Source,
};
use glam::{DAffine3, DMat3, DVec3, Vec3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::sync::Arc;

fn source(line: u32) -> Source {
    Source { file: Arc::new("made.pbrt".into()), line }
}

fn vector(rng: &mut Pcg64Mcg) -> DVec3 {
    DVec3::from_array(std::array::from_fn(|_| rng.random_range(-1.0..1.0)))
}

/// Turned, stretched, every other time mirrored, moved.
fn map(rng: &mut Pcg64Mcg) -> DAffine3 {
    let turn = DMat3::from_axis_angle(vector(rng).normalize(), rng.random_range(-3.0..3.0));
    let mut scale = || rng.random_range(0.3..2.0);
    let stretch = DMat3::from_diagonal(DVec3::new(scale(), scale(), scale()));
    let side = if rng.random() { -1.0 } else { 1.0 };
    DAffine3 { matrix3: turn * stretch * side, translation: vector(rng) * 4.0 }
}

/// A tent of two triangles, with or without normals and texture coordinates.
fn tent(normals: bool) -> Geometry {
    let positions = vec![DVec3::new(-1.0, -1.0, 0.0), DVec3::new(1.0, -1.0, 0.0), DVec3::Y, DVec3::new(0.0, -0.2, 1.0)];
    let (normals, uvs) = match normals {
        true => (
            vec![[-0.5, -0.4, 1.0], [0.5, -0.4, 1.0], [0.0, 0.9, 0.5], [0.0, 0.1, 2.0]],
            vec![[0.0, 0.0], [2.0, 0.0], [1.0, 3.0], [1.0, 0.5]],
        ),
        false => (vec![], vec![]),
    };
    Geometry::Mesh(Arc::new(MeshData { positions, normals, uvs, triangles: vec![[0, 1, 3], [1, 2, 3]] }))
}

/// Every kind of shape, some turned around, placed by maps of their own.
fn shapes(rng: &mut Pcg64Mcg) -> Vec<Shape> {
    let disk = Geometry::Disk { height: 0.5, radius: 1.0, inner_radius: 0.2 };
    let kinds = [tent(false), tent(true), Geometry::Sphere { radius: 0.7 }, disk];
    let shape = |(number, geometry)| Shape {
        reversed: rng.random(),
        ..Shape::new(geometry, map(rng), MaterialId(number), source(10 + number))
    };
    (0..).zip(kinds).map(shape).collect()
}

fn scene(shapes: Vec<Shape>, objects: Vec<Vec<Shape>>, instances: Vec<(u32, DAffine3, Option<DAffine3>)>) -> Scene {
    let kind = || MaterialKind::Diffuse { reflectance: Color::Constant([0.5; 3]) };
    let objects = objects.into_iter().map(|shapes| Object { name: "o".into(), shapes, source: source(5) });
    let instance = |(object, to_world, moves_to)| Instance {
        object: ObjectId(object),
        to_world,
        moves_to,
        source: source(20 + object),
    };
    Scene {
        materials: (0..8).map(|i| Material::new(format!("m{i}"), kind(), source(i))).collect(),
        shapes,
        objects: objects.collect(),
        instances: instances.into_iter().map(instance).collect(),
        ..Scene::default()
    }
}

fn world(scene: &Scene) -> World {
    World::new(scene).unwrap_or_else(|e| panic!("{e}"))
}

fn refused(scene: &Scene) -> String {
    World::new(scene).map(|_| ()).expect_err("it is refused").to_string()
}

/// The same hits, seen from all sides, at these times.
fn assert_alike(rng: &mut Pcg64Mcg, one: &World, other: &World, [a, b]: [f32; 2], rays: u32) -> u32 {
    let mut hits = 0;
    for _ in 0..rays {
        let origin = vector(rng).as_vec3() * 0.8;
        let ray = Ray::new(origin, (vector(rng).as_vec3() * 0.3 - origin).normalize());
        let (found, expected) = (one.closest_hit(&ray, a), other.closest_hit(&ray, b));
        assert_eq!(one.occluded(&ray, a), found.is_some());
        let (Some(found), Some(expected)) = (found, expected) else {
            // Only a ray along an edge may be decided otherwise.
            hits += u32::from(found.is_some() != expected.is_some()) << 16;
            continue;
        };
        if (found.hit.t - expected.hit.t).abs() > 1e-4 {
            hits += 1 << 16;
            continue;
        }
        assert_eq!((found.part.material, found.part.light), (expected.part.material, expected.part.light));
        assert!((found.point.position - expected.point.position).length() < 1e-5);
        assert!((found.point.normal - expected.point.normal).length() < 2e-4, "{found:?} {expected:?}");
        let [n, m] = [found.shading_normal, expected.shading_normal].map(Vec3::normalize_or_zero);
        assert!((n - m).length() < 1e-3, "{n} {m}");
        let [[u, v], [s, t]] = [one.uv(&found), other.uv(&expected)];
        let turns = (u - s).abs().min(1.0 - (u - s).abs());
        assert!(turns < 2e-3 && (v - t).abs() < 2e-3, "{u} {v}, {s} {t}");
        hits += 1;
    }
    let odd = hits >> 16;
    assert!(odd <= rays / 200, "{odd} of {rays} rays were decided otherwise");
    hits & 0xffff
}

/// Instances look like copies, normals and sides included. A copy's vertex normals are taken to the world before they
/// are interpolated: so maps here stretch them alike.
#[test]
fn instances_look_like_copies() {
    let mut rng = Pcg64Mcg::seed_from_u64(41);
    let mut hits = 0;
    for _ in 0..40 {
        let shapes = shapes(&mut rng);
        let even = |mut map: DAffine3| {
            map.matrix3.x_axis = map.matrix3.x_axis.normalize();
            map.matrix3.y_axis = map.matrix3.y_axis.normalize();
            map.matrix3.z_axis = map.matrix3.z_axis.normalize();
            map
        };
        let places = [even(map(&mut rng)), even(map(&mut rng))];
        let placed = scene(vec![], vec![shapes.clone()], places.iter().map(|&place| (0, place, None)).collect());
        let copy = |place: &DAffine3, shape: &Shape| Shape { to_world: *place * shape.to_world, ..shape.clone() };
        let copies = places.iter().flat_map(|place| shapes.iter().map(move |shape| copy(place, shape))).collect();
        let (mut placed, copied) = (placed, scene(copies, vec![], vec![]));
        // The boxes of objects are larger than what is in them: a still dot each makes both spaces the same.
        let far = [-1.0, 1.0].map(|side| DVec3::splat(side * 15.0));
        let dots = far.map(|p| {
            let geometry = Geometry::Sphere { radius: 1e-3 };
            Shape::new(geometry, DAffine3::from_translation(p), MaterialId(7), source(30))
        });
        let mut copied = copied;
        placed.shapes.extend(dots.clone());
        copied.shapes.extend(dots);
        let (placed, copied) = (world(&placed), world(&copied));
        assert_eq!(placed.space(), copied.space());
        assert!(!placed.moves && placed.geometry().triangle_count() * 2 == copied.geometry().triangle_count());
        hits += assert_alike(&mut rng, &placed, &copied, [0.0; 2], 1500);
    }
    assert!(hits > 3000, "{hits} hits");
}

#[test]
fn what_moves_stands_where_its_time_says() {
    let mut rng = Pcg64Mcg::seed_from_u64(42);
    let (mut hits, mut odd) = (0, 0);
    for _ in 0..20 {
        let (start, end) = (map(&mut rng), map(&mut rng));
        let side = start.matrix3.determinant() * end.matrix3.determinant();
        let end = if side < 0.0 { DAffine3 { matrix3: end.matrix3 * -1.0, ..end } } else { end };
        let kinds = shapes(&mut rng);
        let stand = |place, moves_to| {
            kinds.iter().map(|shape| Shape { to_world: place, moves_to, ..shape.clone() }).collect::<Vec<_>>()
        };
        let moving = world(&scene(stand(start, Some(end)), vec![], vec![]));
        assert!(moving.moves && moving.geometry().moves());
        for (time, place) in [(0.0, start), (1.0, end)] {
            let seen = world(&scene(stand(place, None), vec![], vec![]));
            // Compared in the file's space.
            let (here, there) = (moving.space(), seen.space());
            for _ in 0..200 {
                let origin = place.translation + vector(&mut rng) * 5.0;
                let target = place.translation + vector(&mut rng) * 0.5;
                let ray = |space: &crate::Space| {
                    let [from, to] = [origin, target].map(|p| space.point(p).as_vec3());
                    Ray::new(from, to - from)
                };
                let found = moving.closest_hit(&ray(here), time);
                let expected = seen.closest_hit(&ray(there), 0.0);
                let [t, s] = [&found, &expected].map(|at| at.map_or(-1.0, |at| at.hit.t));
                if (t - s).abs() < 1e-4 && t > 0.0 {
                    hits += 1;
                    let normals = [&found, &expected].map(|at| at.map_or(Vec3::ZERO, |at| at.point.normal));
                    assert!((normals[0] - normals[1]).length() < 1e-3, "{normals:?} at {time}");
                } else {
                    // Only a ray along an edge may be decided otherwise.
                    odd += u32::from(t != s);
                }
            }
        }
    }
    assert!(hits > 2000 && odd <= 8, "{hits} hits, {odd} of 8000 rays decided otherwise");
}

/// A ball that goes from x = 0 to x = 8.
fn rolling(motion_times: [f64; 2], shutter: [f64; 2]) -> Scene {
    let ball = Shape {
        moves_to: Some(DAffine3::from_translation(DVec3::X * 8.0)),
        ..Shape::new(Geometry::Sphere { radius: 1.0 }, DAffine3::IDENTITY, MaterialId(0), source(10))
    };
    let mut scene = scene(vec![ball], vec![], vec![]);
    (scene.motion_times, scene.camera) = (motion_times, Camera { shutter, ..Camera::default() });
    scene
}

/// The x coordinate of the ball's hit at a time of the world.
fn ball_at(world: &World, time: f32) -> f64 {
    let middle = |x: f64| {
        let from = world.space().point(DVec3::new(x, 0.0, -20.0)).as_vec3();
        world.closest_hit(&Ray::new(from, Vec3::Z), time).is_some()
    };
    let met: Vec<f64> = (-100..=1000).map(|i| f64::from(i) * 0.01).filter(|&x| middle(x)).collect();
    met.iter().sum::<f64>() / met.len() as f64
}

#[test]
fn the_shutter_sees_its_part_of_the_motion() {
    let cases = [
        ([0.0, 0.0], [0.0, 1.0], [0.0, 8.0]),
        ([0.0, 1.0], [0.25, 0.5], [2.0, 4.0]),
        ([2.0, 4.0], [3.0, 4.0], [4.0, 8.0]),
        ([0.0, 2.0], [-1.0, 1.0], [0.0, 4.0]),
        ([0.0, 1.0], [0.5, 9.0], [4.0, 8.0]),
    ];
    for (times, shutter, expected) in cases {
        let world = world(&rolling(times, shutter));
        assert!(world.moves);
        let seen = [0.0, 1.0].map(|u| ball_at(&world, world.time(u)));
        assert!(seen.iter().zip(expected).all(|(a, b)| (a - b).abs() < 0.02), "{times:?} {shutter:?}: {seen:?}");
    }
    // Closed, it sees the ball at rest; rays need no time then.
    for (shutter, expected) in [([0.5, 0.5], 4.0), ([3.0, 3.0], 8.0), ([2.0, 3.0], 8.0)] {
        let world = world(&rolling([0.0, 1.0], shutter));
        assert!(!world.moves && (ball_at(&world, 0.0) - expected).abs() < 0.02, "{shutter:?}");
    }
}

#[test]
fn the_space_holds_both_ends_of_a_motion() {
    let world = world(&rolling([0.0, 1.0], [0.0, 1.0]));
    for p in [DVec3::new(-1.0, -1.0, -1.0), DVec3::new(9.0, 1.0, 1.0)] {
        assert!(world.space().point(p).abs().max_element() <= 1.0);
    }
    let moved = |x: f64| DAffine3::from_translation(DVec3::X * x);
    let ball = Shape::new(Geometry::Sphere { radius: 1.0 }, DAffine3::IDENTITY, MaterialId(0), source(10));
    let placed = self::world(&scene(vec![], vec![vec![ball]], vec![(0, moved(-3.0), Some(moved(7.0)))]));
    assert!(placed.space().point(DVec3::X * 8.0).x <= 1.0 && placed.space().point(DVec3::X * -4.0).x >= -1.0);
}

#[test]
fn what_cannot_be_placed_is_told_with_its_line() {
    let ball = || Shape::new(Geometry::Sphere { radius: 1.0 }, DAffine3::IDENTITY, MaterialId(0), source(10));
    let shines = Some(Emission { radiance: [1.0; 3], two_sided: false });
    let moves_to = Some(DAffine3::from_translation(DVec3::X));
    let mirror = DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0));
    let flat = DAffine3::from_scale(DVec3::new(0.0, 1.0, 1.0));
    let object = |shape: Shape| scene(vec![], vec![vec![shape]], vec![(0, DAffine3::IDENTITY, None)]);
    let placed = |object, place, end| scene(vec![], vec![vec![ball()]], vec![(object, place, end)]);
    let cases = [
        (object(Shape { emission: shines, ..ball() }), "made.pbrt:10: a shape of an object cannot emit light"),
        (object(Shape { moves_to, ..ball() }), "made.pbrt:10: a shape of an object cannot move"),
        (object(Shape { material: MaterialId(9), ..ball() }), "made.pbrt:10: the shape has material 9"),
        (placed(3, DAffine3::IDENTITY, None), "made.pbrt:23: the instance is one of object 3"),
        (placed(0, flat, None), "made.pbrt:20: the transform"),
        (placed(0, DAffine3::IDENTITY, Some(mirror)), "made.pbrt:20: a motion's determinant is -1"),
        (
            scene(vec![Shape { emission: shines, moves_to, ..ball() }], vec![], vec![]),
            "made.pbrt:10: a shape that moves cannot emit light",
        ),
        (rolling([1.0, 0.0], [0.0, 1.0]), "the shutter is open from 0 to 1"),
        (rolling([0.0, 1.0], [0.0, f64::NAN]), "the shutter is open"),
    ];
    for (scene, expected) in cases {
        let told = refused(&scene);
        assert!(told.contains(expected), "{told:?} does not say {expected:?}");
    }
    // Objects that stand nowhere, and empty ones, are fine.
    let spare = scene(vec![ball()], vec![vec![ball()], vec![]], vec![(1, DAffine3::IDENTITY, None)]);
    assert!(world(&spare).closest_hit(&Ray::new(Vec3::ZERO, Vec3::X), 0.0).is_some());
}
