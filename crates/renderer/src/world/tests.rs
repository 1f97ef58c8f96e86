//! Tests of instances against copies, of moving shapes against shapes at rest, and of the derivatives by u and v.

use crate::Space;
use crate::support::*;
use dapple_geometry::Ray;
use rand_pcg::Pcg64Mcg;

fn vector(rng: &mut Pcg64Mcg) -> DVec3 {
    DVec3::from_array(std::array::from_fn(|_| rng.random_range(-1.0..1.0)))
}

/// Returns a random map that rotates, stretches and moves, and mirrors in half of the cases.
fn map(rng: &mut Pcg64Mcg) -> DAffine3 {
    let turn = DMat3::from_axis_angle(vector(rng).normalize(), rng.random_range(-3.0..3.0));
    let stretch = DMat3::from_diagonal(DVec3::from_array(std::array::from_fn(|_| rng.random_range(0.3..2.0))));
    let side = if rng.random() { -1.0 } else { 1.0 };
    DAffine3 { matrix3: turn * stretch * side, translation: vector(rng) * 4.0 }
}

/// Returns a tent of triangles, with or without normals and texture coordinates.
fn tent(is_smooth: bool) -> Geometry {
    let positions = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0], [0.0, -0.2, 1.0]].map(DVec3::from).into();
    let (mut normals, mut uvs) = (vec![], vec![]);
    if is_smooth {
        normals = vec![[-0.5, -0.4, 1.0], [0.5, -0.4, 1.0], [0.0, 0.9, 0.5], [0.0, 0.1, 2.0]];
        uvs = vec![[0.0, 0.0], [2.0, 0.0], [1.0, 3.0], [1.0, 0.5]];
    }
    Geometry::Mesh(Arc::new(MeshData {
        positions,
        normals,
        uvs,
        triangles: vec![[0, 1, 3], [1, 2, 3]],
        ..MeshData::default()
    }))
}

fn sphere(radius: f64, line_number: u32, material: u32) -> Shape {
    Shape::new(Geometry::Sphere { radius }, DAffine3::IDENTITY, MaterialId(material), line(line_number))
}

/// Returns every kind of shape, some with reversed orientation, each with its own transform.
fn shapes(rng: &mut Pcg64Mcg) -> Vec<Shape> {
    let disk = Geometry::Disk { height: 0.5, radius: 1.0, inner_radius: 0.2 };
    let kinds = [tent(false), tent(true), Geometry::Sphere { radius: 0.7 }, disk];
    let shape = |(number, geometry)| Shape {
        reversed: rng.random(),
        ..Shape::new(geometry, map(rng), MaterialId(number), line(10 + number))
    };
    (0..).zip(kinds).map(shape).collect()
}

/// Returns a scene of shapes, objects, and instances of objects with their transform and the end of their motion.
fn scene(shapes: Vec<Shape>, objects: Vec<Vec<Shape>>, instances: &[(u32, DAffine3, Option<DAffine3>)]) -> Scene {
    let mut scene = Scene { shapes, ..Scene::default() };
    for _ in 0..8 {
        add_material(&mut scene, diffuse(0.5));
    }
    scene.objects = objects.into_iter().map(|shapes| Object { name: "o".into(), shapes, source: line(5) }).collect();
    let instance = |&(object, to_world, moves_to): &(u32, _, _)| Instance {
        object: ObjectId(object),
        to_world,
        moves_to,
        source: line(20 + object),
    };
    scene.instances = instances.iter().map(instance).collect();
    scene
}

/// Instances match copies from all sides, including normals and orientation. A copy's vertex normals are transformed before
/// they are interpolated, so these maps stretch all axes equally. Only rays along an edge may differ.
#[test]
fn instances_look_like_copies() {
    let mut rng = Pcg64Mcg::seed_from_u64(41);
    let (mut hits, mut odd) = (0, 0);
    for _ in 0..40 {
        let shapes = shapes(&mut rng);
        let mut even = || {
            let DAffine3 { matrix3: m, translation } = map(&mut rng);
            let [x, y, z] = [m.x_axis, m.y_axis, m.z_axis].map(DVec3::normalize);
            DAffine3 { matrix3: DMat3::from_cols(x, y, z), translation }
        };
        let places = [even(), even()];
        let copy = |place: &DAffine3, shape: &Shape| Shape { to_world: *place * shape.to_world, ..shape.clone() };
        let mut copies: Vec<Shape> =
            places.iter().flat_map(|place| shapes.iter().map(|shape| copy(place, shape))).collect();
        // Boxes of objects are larger than their contents. The same small spheres at rest give both scenes the same space.
        let dots = [-15.0, 15.0].map(|x| Shape { to_world: at(x, x, x), ..sphere(1e-3, 30, 7) });
        copies.extend(dots.clone());
        let placed = world(&scene(dots.into(), vec![shapes], &places.map(|place| (0, place, None))));
        let copied = world(&scene(copies, vec![], &[]));
        assert_eq!(placed.space(), copied.space());
        assert!(!placed.moves && placed.geometry().triangle_count() * 2 == copied.geometry().triangle_count());
        for _ in 0..1500 {
            let origin = vector(&mut rng).as_vec3() * 0.8;
            let ray = Ray::new(origin, (vector(&mut rng).as_vec3() * 0.3 - origin).normalize());
            let (found, expected) = (placed.closest_hit(&ray, 0.0), copied.closest_hit(&ray, 0.0));
            assert_eq!(placed.occluded(&ray, 0.0), found.is_some());
            let (Some(found), Some(expected)) = (&found, &expected) else {
                odd += u32::from(found.is_some() != expected.is_some());
                continue;
            };
            if (found.hit.t - expected.hit.t).abs() > 1e-4 {
                odd += 1;
                continue;
            }
            hits += 1;
            assert_eq!((found.part.material, found.part.light), (expected.part.material, expected.part.light));
            assert!((found.point.position - expected.point.position).length() < 1e-5);
            assert!((found.point.normal - expected.point.normal).length() < 2e-4, "{found:?} {expected:?}");
            let [n, m] = [found.shading_normal, expected.shading_normal].map(Vec3::normalize_or_zero);
            let [[u, v], [s, t]] = [placed.uv(found), copied.uv(expected)];
            let turns = (u - s).abs().min(1.0 - (u - s).abs());
            assert!((n - m).length() < 1e-3 && turns < 2e-3 && (v - t).abs() < 2e-3, "{n} {m}, {u} {v}, {s} {t}");
        }
    }
    assert!(hits > 3000 && odd <= 40 * 7, "{hits} hits, {odd} rays decided otherwise");
}

#[test]
fn what_moves_stands_where_its_time_says() {
    let mut rng = Pcg64Mcg::seed_from_u64(42);
    let (mut hits, mut odd) = (0, 0);
    for _ in 0..20 {
        let (start, mut end) = (map(&mut rng), map(&mut rng));
        if start.matrix3.determinant() * end.matrix3.determinant() < 0.0 {
            end.matrix3 *= -1.0;
        }
        let kinds = shapes(&mut rng);
        let stand = |to_world, moves_to| {
            let shapes = kinds.iter().map(|shape| Shape { to_world, moves_to, ..shape.clone() });
            world(&scene(shapes.collect(), vec![], &[]))
        };
        let moving = stand(start, Some(end));
        assert!(moving.moves && moving.geometry().moves());
        for (time, place) in [(0.0, start), (1.0, end)] {
            let seen = stand(place, None);
            for _ in 0..200 {
                let origin = place.translation + vector(&mut rng) * 5.0;
                let target = place.translation + vector(&mut rng) * 0.5;
                // Rays are compared in the file's space.
                let ray = |space: &Space| {
                    let [from, to] = [origin, target].map(|p| space.point(p).as_vec3());
                    Ray::new(from, to - from)
                };
                let found = moving.closest_hit(&ray(moving.space()), time);
                let expected = seen.closest_hit(&ray(seen.space()), 0.0);
                let [t, s] = [&found, &expected].map(|at| at.as_ref().map_or(-1.0, |at| at.hit.t));
                if (t - s).abs() < 1e-4 && t > 0.0 {
                    hits += 1;
                    let [n, m] = [&found, &expected].map(|at| at.as_ref().map_or(Vec3::ZERO, |at| at.point.normal));
                    assert!((n - m).length() < 1e-3, "{n} {m} at {time}");
                } else {
                    // Only for a ray along an edge may the results differ.
                    odd += u32::from(t != s);
                }
            }
        }
    }
    assert!(hits > 2000 && odd <= 8, "{hits} hits, {odd} of 8000 rays decided otherwise");
}

/// Returns a sphere that moves from x = 0 to x = 8.
fn rolling(motion_times: [f64; 2], shutter: [f64; 2]) -> Scene {
    let ball = Shape { moves_to: Some(at(8.0, 0.0, 0.0)), ..sphere(1.0, 10, 0) };
    let mut scene = scene(vec![ball], vec![], &[]);
    (scene.motion_times, scene.camera) = (motion_times, Camera { shutter, ..Camera::default() });
    scene
}

/// If the shutter opens and closes at the same time, the sphere is at rest and rays need no time. The space includes both ends
/// of a motion.
#[test]
fn the_shutter_sees_its_part_of_the_motion() {
    for (times, shutter, expected) in [
        ([0.0, 0.0], [0.0, 1.0], [0.0, 8.0]),
        ([0.0, 1.0], [0.25, 0.5], [2.0, 4.0]),
        ([2.0, 4.0], [3.0, 4.0], [4.0, 8.0]),
        ([0.0, 2.0], [-1.0, 1.0], [0.0, 4.0]),
        ([0.0, 1.0], [0.5, 9.0], [4.0, 8.0]),
        ([0.0, 1.0], [0.5, 0.5], [4.0; 2]),
        ([0.0, 1.0], [3.0, 3.0], [8.0; 2]),
        ([0.0, 1.0], [2.0, 3.0], [8.0; 2]),
    ] {
        let world = world(&rolling(times, shutter));
        assert_eq!(world.moves, expected[0] != expected[1]);
        // The x coordinate of the ball's hits at a time.
        let ball_at = |time: f32| {
            let is_met = |x: &f64| {
                let from = world.space().point(DVec3::new(*x, 0.0, -20.0)).as_vec3();
                world.closest_hit(&Ray::new(from, Vec3::Z), time).is_some()
            };
            (-100..=1000).map(|i| f64::from(i) * 0.01).filter(is_met).collect::<Mean>().mean
        };
        let seen = [0.0, 1.0].map(|u| ball_at(world.time(u)));
        assert!(seen.iter().zip(expected).all(|(a, b)| (a - b).abs() < 0.02), "{times:?} {shutter:?}: {seen:?}");
    }
    let rolled = world(&rolling([0.0, 1.0], [0.0, 1.0]));
    let placed = scene(vec![], vec![vec![sphere(1.0, 10, 0)]], &[(0, at(1.0, 0.0, 0.0), Some(at(7.0, 0.0, 0.0)))]);
    for (world, p) in [(&rolled, [-1.0, -1.0, -1.0]), (&rolled, [9.0, 1.0, 1.0]), (&world(&placed), [8.0, 0.0, 0.0])] {
        assert!(world.space().point(DVec3::from(p)).abs().max_element() <= 1.0);
    }
}

#[test]
fn what_cannot_be_placed_is_told_with_its_line() {
    let ball = || sphere(1.0, 10, 0);
    let shines = Some(Emission::even([1.0; 3], false));
    let (identity, moves_to) = (DAffine3::IDENTITY, Some(at(1.0, 0.0, 0.0)));
    let mirror = DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0));
    let object = |shape: Shape| scene(vec![], vec![vec![shape]], &[(0, identity, None)]);
    let placed = |object, place, end| scene(vec![], vec![vec![ball()]], &[(object, place, end)]);
    let moving_lamp = Shape { emission: shines, moves_to, ..ball() };
    for (scene, expected) in [
        (object(Shape { emission: shines, ..ball() }), "made.pbrt:10: a shape of an object cannot emit light"),
        (object(Shape { moves_to, ..ball() }), "made.pbrt:10: a shape of an object cannot move"),
        (object(Shape { material: MaterialId(9), ..ball() }), "made.pbrt:10: the shape has material 9"),
        (placed(3, identity, None), "made.pbrt:23: the instance refers to object 3"),
        (placed(0, DAffine3::from_scale(DVec3::new(0.0, 1.0, 1.0)), None), "made.pbrt:20: the transform"),
        (placed(0, identity, Some(mirror)), "made.pbrt:20: a motion's determinant is -1"),
        (scene(vec![moving_lamp], vec![], &[]), "made.pbrt:10: a shape that moves cannot emit light"),
        (rolling([1.0, 0.0], [0.0, 1.0]), "the shutter is open from 0 to 1"),
        (rolling([0.0, 1.0], [0.0, f64::NAN]), "the shutter is open"),
        // Objects without instances and empty objects are valid.
        (scene(vec![ball()], vec![vec![ball()], vec![]], &[(1, identity, None)]), ""),
    ] {
        let told = refusal(&scene);
        assert!(told.contains(expected) && told.is_empty() == expected.is_empty(), "{told:?}, not {expected:?}");
    }
}

/// Returns a ray from around the scene towards a random point of it. One in a few rays hits along an axis or a pole.
fn ray(rng: &mut Pcg64Mcg, world: &World) -> Ray {
    let [low, high] = world.shape_bounds(0);
    let (middle, size) = ((low + high) * 0.5, (high - low).length());
    let from = match rng.random_range(0..4) {
        0 => middle + Vec3::Z * size,
        1 => middle - Vec3::Z * size,
        _ => middle + vector(rng).as_vec3().normalize() * size,
    };
    let is_central = rng.random_range(0..4) == 0;
    let to = if is_central { middle } else { low + (vector(rng).as_vec3() * 0.5 + 0.5) * (high - low) };
    Ray::new(from, (to - from).normalize())
}

/// A step along the derivative by u changes only u, and likewise for v, on shapes that are rotated, stretched and mirrored.
#[test]
fn derivatives_of_spheres_and_disks_match_differences_l12() {
    let mut rng = Pcg64Mcg::seed_from_u64(13);
    let mut compared = 0;
    for case in 0..40 {
        let geometry = match case % 4 < 2 {
            true => Geometry::Sphere { radius: 0.8 },
            false => Geometry::Disk { height: 0.3, radius: 1.1, inner_radius: 0.2 },
        };
        let shape = Shape::new(geometry, map(&mut rng), MaterialId(0), line(10));
        let world = world(&scene(vec![shape], vec![], &[]));
        for _ in 0..50 {
            let Some(at) = world.closest_hit(&ray(&mut rng, &world), 0.0) else { continue };
            let here = world.uv(&at);
            // Not where u jumps from 1 to 0, nor near a pole, where a step is a turn.
            if !(0.02..0.98).contains(&here[0]) || !(0.1..0.9).contains(&here[1]) {
                continue;
            }
            for (axis, along) in world.derivatives(&at).into_iter().enumerate() {
                // Central differences of 1/256 in the middle of f32's range.
                let [before, after] = [-1.0, 1.0].map(|sign| {
                    let mut there = at;
                    there.point.position += along * (sign / 512.0);
                    world.uv(&there)
                });
                let worst = (0..2).map(|i| ((after[i] - before[i]) * 256.0 - f32::from(u8::from(i == axis))).abs());
                assert!(worst.fold(0.0, f32::max) < 2e-3, "case {case}, by {axis}: {before:?}, {after:?}");
                compared += 1;
            }
        }
    }
    assert!(compared > 1000, "{compared}");
}
