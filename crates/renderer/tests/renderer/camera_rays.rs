//! Camera rays.

use crate::support::*;
use dapple_core::samplers::Uniform;
use dapple_core::{Frame, Limits, PointSet, SampleId};
use dapple_low_discrepancy::Sobol;
use dapple_renderer::SceneError;
use dapple_renderer::camera::{CameraView, General, Lens, Pinhole, ThinLens};
use dapple_renderer::pixel_filter::FilterSampler;
use dapple_renderer::{Space, World};
use dapple_scene::{Camera, Geometry, PixelFilter, Projection, Scene};
use glam::{DAffine3, DMat3, DVec3, Vec2, Vec3};
use std::sync::Arc;

/// A point set that always gives the last number below 1.
struct Corner;

const BELOW_ONE: f32 = 1.0 - f32::EPSILON / 2.0;

impl PointSet for Corner {
    fn describe(&self) -> String {
        "corner".into()
    }

    fn block(&self, _: SampleId, _: u32) -> [f32; 4] {
        [BELOW_ONE; 4]
    }

    fn capacity(&self) -> u64 {
        u64::MAX
    }
}

fn view(camera: &Camera, size: [u32; 2]) -> Result<CameraView, SceneError> {
    CameraView::new(camera, size, &Space::of(&Scene::default()))
}

/// Points along camera rays project back to the rays' points on the film, with a window off the centre.
#[test]
fn clip_space_undoes_camera_rays() {
    let to_world = DAffine3::from_mat3_translation(DMat3::from_rotation_y(0.7) * 1.5, DVec3::new(3.0, -2.0, 5.0));
    let camera = Camera { to_world, screen_window: Some([-0.5, 1.0, -0.2, 0.9]), ..Camera::default() };
    let view = view(&camera, [60, 44]).expect("a sound camera");
    let rows = view.world_to_clip();
    for pixel in [[0, 0], [59, 43], [17, 30], [30, 22]] {
        let ray = view.ray(pixel, Vec2::new(0.3, -0.2), [0.5; 2]);
        for t in [0.1, 1.0, 50.0] {
            let p = ray.at(t);
            let row = |r: [f32; 4]| r[0] * p.x + r[1] * p.y + r[2] * p.z + r[3];
            let (x, y, w) = (row(rows[0]), row(rows[1]), row(rows[3]));
            let place = Vec2::new((x / w + 1.0) * 30.0, (y / w + 1.0) * 22.0);
            let expected = Vec2::new(pixel[0] as f32 + 0.8, pixel[1] as f32 + 0.3);
            assert!(w > 0.0 && (place - expected).length() < 2e-3, "{pixel:?} at {t}: {place} is not {expected}");
        }
    }
}

#[test]
fn sample_stays_in_its_pixel_r01() {
    let view = view(&Camera::default(), [65536, 3]).expect("a sound camera");
    let filter = FilterSampler::new(&PixelFilter::default());
    for u in [0.0, 0.5, BELOW_ONE] {
        let offset = filter.sample([u, u]);
        for x in 0..65536 {
            let place = view.place([x, 1], offset).x;
            let centre = f64::from(x) + 0.5 - 32768.0;
            assert!((f64::from(place) - centre).abs() <= 0.5, "u = {u}, x = {x}: {place}");
        }
    }
    // No sample counts for a neighbour: counts are exact with the worst points.
    let mut scene = room([65536, 1]);
    scene.max_depth = Some(1);
    let film = film_of(&world(&scene), [65536, 1], 2, Corner);
    assert!(film.counts().iter().all(|&n| n == 2));
    assert_eq!(film.record().rejected, 0);
}

#[test]
fn odd_image_sizes_cover_every_pixel_r02() {
    for size in [[1, 1], [1, 4097], [4097, 1], [7, 13]] {
        let film = image(&room(size), 3, 1);
        assert_eq!(film.counts(), vec![3; (size[0] * size[1]) as usize], "{size:?}");
        assert_eq!(film.record().rejected, 0, "{size:?}");
        assert!(mean(&film)[0] > 0.0, "{size:?} is black");
    }
    assert!(Frame::new(0, 5).is_err());
    assert!(World::with_resolution(&room([4, 4]), [0, 5]).is_err());
}

#[test]
fn degenerate_poses_are_refused_r03() {
    let sound = room([8, 8]);
    let error = |change: &dyn Fn(&mut Camera)| {
        let mut scene = sound.clone();
        change(&mut scene.camera);
        World::new(&scene).err().map(|e| e.to_string())
    };
    // An up vector along the view and an eye at its target give no basis: division by 0 makes NaN or zero columns.
    let up_along = look_at(DVec3::ZERO, DVec3::Z, DVec3::Z);
    let at_target = look_at(DVec3::X, DVec3::X, DVec3::Z);
    let flat = DAffine3::from_mat3(DMat3::from_cols(DVec3::X, DVec3::X, DVec3::Z));
    let nowhere = DAffine3::from_translation(DVec3::new(f64::NAN, 0.0, 0.0));
    let beyond = DAffine3::from_translation(DVec3::new(f64::INFINITY, 0.0, 0.0));
    for pose in [up_along, at_target, flat, DAffine3::ZERO, nowhere, beyond] {
        let message = error(&|c| c.to_world = pose).unwrap_or_else(|| panic!("{pose:?} is no pose"));
        assert!(message.starts_with("made.pbrt:1: the camera's transform"), "{message}");
    }
    for fov in [0.0, 180.0, -10.0, f64::NAN, f64::INFINITY] {
        let message =
            error(&|c| c.projection = Projection::Perspective { fov }).unwrap_or_else(|| panic!("{fov} is no angle"));
        assert!(message.starts_with("made.pbrt:1: a field of view of"), "{message}");
    }
    for window in [[1.0, -1.0, -1.0, 1.0], [0.0, 0.0, 0.0, 1.0], [f64::NAN; 4], [-1e300, 1e300, -1.0, 1.0]] {
        let message = error(&|c| c.screen_window = Some(window)).unwrap_or_else(|| panic!("{window:?} is no window"));
        assert!(message.contains("the screen window"), "{message}");
    }
    assert!(error(&|c| c.aspect = Some(0.0)).is_some() && error(&|c| c.aspect = Some(f64::NAN)).is_some());
    assert_eq!(error(&|c| c.projection = Projection::Perspective { fov: 179.9 }), None);
}

#[test]
fn scaled_cameras_see_the_same_r03() {
    let scene = room([9, 7]);
    let expected = hash(&image(&scene, 2, 1));
    for exponent in [-200, -64, -1, 1, 64, 200] {
        let mut scaled = scene.clone();
        scaled.camera.to_world.matrix3 *= f64::from(exponent).exp2();
        assert_eq!(hash(&image(&scaled, 2, 1)), expected, "axes scaled by 2^{exponent}");
    }
}

#[test]
fn a_mirrored_scene_renders_a_mirrored_image_r04() {
    for size in [[7, 5], [1, 1], [641, 479]] {
        let view = view(&Camera { projection: Projection::Perspective { fov: 50.0 }, ..Camera::default() }, size)
            .expect("a sound camera");
        let pixels = (0..size[0]).step_by(7).flat_map(|x| (0..size[1]).step_by(3).map(move |y| [x, y]));
        for ([x, y], k) in pixels.zip(0..) {
            let offset = Vec2::new((k * 37 % 101) as f32 / 101.0 - 0.5, (k * 53 % 97) as f32 / 97.0 - 0.5);
            let ray = |pixel, offset| Pinhole::ray(&view, view.place(pixel, offset), [0.5; 2]).direction.to_array();
            let d = ray([x, y], offset);
            let across = ray([size[0] - 1 - x, y], Vec2::new(-offset.x, offset.y));
            let down = ray([x, size[1] - 1 - y], Vec2::new(offset.x, -offset.y));
            assert_eq!(across.map(f32::to_bits), [-d[0], d[1], d[2]].map(f32::to_bits), "{size:?} {x} {y}");
            assert_eq!(down.map(f32::to_bits), [d[0], -d[1], d[2]].map(f32::to_bits), "{size:?} {x} {y}");
        }
    }
    for target in [DVec3::X, DVec3::new(1.0, 2.0, -3.0), DVec3::new(-0.3, 0.0, 1e-3)] {
        let to_world = look_at(DVec3::ZERO, target, DVec3::Y);
        let view = view(&Camera { to_world, ..Camera::default() }, [7, 5]).expect("a sound camera");
        let centre = Pinhole::ray(&view, view.place([3, 2], Vec2::ZERO), [0.0; 2]).direction;
        assert_eq!(centre, to_world.matrix3.z_axis.as_vec3().normalize(), "towards {target}");
    }
}

#[test]
fn cameras_on_and_inside_surfaces_render_r05() {
    let mut scene = room([16, 16]);
    let shade = add_material(&mut scene, diffuse(0.5));
    let shell = DAffine3::from_translation(DVec3::new(0.0, -5.0, 3.0));
    add(&mut scene, Geometry::Mesh(Arc::new(cube())), shell, shade, None);
    let two_sided = add(&mut scene, Geometry::Sphere { radius: 0.5 }, shell, shade, Some(2.0));
    scene.shapes[two_sided].emission.as_mut().expect("it shines").two_sided = true;
    let eyes = [
        ("on the floor", DVec3::ZERO),
        ("on a lamp", DVec3::new(0.0, 0.0, 2.5)),
        ("on a corner", DVec3::new(-1.4, -0.1, 0.0)),
        ("in a closed mesh", DVec3::new(0.9, -5.9, 3.9)),
        ("on an edge of the mesh", DVec3::new(1.0, -6.0, 3.0)),
        ("in the middle of a lamp", DVec3::new(0.0, -5.0, 3.0)),
        ("on a lamp's sphere", DVec3::new(0.5, -5.0, 3.0)),
        ("in a lamp that shines outwards", DVec3::new(1.2, -0.5, 0.9)),
    ];
    for (place, eye) in eyes {
        for lens in [0.0, 0.05] {
            scene.camera.to_world = look_at(eye, eye + DVec3::new(0.3, 1.0, 0.2), DVec3::Z);
            (scene.camera.lens_radius, scene.camera.focal_distance) = (lens, 2.0);
            let film = image(&scene, 16, 5);
            assert_eq!(film.record().rejected, 0, "{place}, lens {lens}");
            assert!(mean(&film).iter().all(|m| m.is_finite()), "{place}, lens {lens}");
        }
    }
}

#[test]
fn a_crop_is_a_part_of_the_full_frame_r06() {
    let filters = [
        PixelFilter::default(),
        PixelFilter::Gaussian { radius: [2.0, 2.0], sigma: 0.7 },
        PixelFilter::Triangle { radius: [2.0, 1.0] },
    ];
    for filter in filters {
        let mut scene = room([23, 17]);
        scene.film.pixel_filter = filter;
        let world = world(&scene);
        let full = film_of(&world, [23, 17], 4, Sobol::new(3));
        let whole = Frame::new(23, 17).expect("not empty");
        for [x0, y0, x1, y1] in [[0, 0, 1, 1], [22, 16, 23, 17], [3, 5, 20, 11], [0, 0, 23, 1], [7, 0, 8, 17]] {
            let frame = whole.crop(x0, y0, x1, y1).expect("inside");
            let limits = Limits::samples(4 * frame.pixels() as u64);
            let part = film_in(&world, frame, &mut Uniform::new(Sobol::new(3)), &limits);
            for i in 0..frame.pixels() {
                let [x, y] = frame.pixel(i);
                assert_eq!(part.mean(i), full.mean((y * 23 + x) as usize), "{filter:?}, pixel {x}, {y}");
            }
        }
    }
}

#[test]
fn a_lens_of_radius_0_is_a_pinhole_r07() {
    let scene = room([12, 9]);
    let with = |radius: f64, distance: f64| {
        let mut scene = scene.clone();
        (scene.camera.lens_radius, scene.camera.focal_distance) = (radius, distance);
        World::new(&scene)
    };
    let expected = hash(&image(&scene, 4, 2));
    for distance in [0.0, -1.0, 3.0, f64::INFINITY, f64::NAN] {
        let world = with(0.0, distance).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(hash(&film_of(&world, [12, 9], 4, Sobol::new(2))), expected, "focus at {distance}");
    }
    let bad = [(0.1, 0.0), (0.1, -1.0), (0.1, f64::INFINITY), (0.1, f64::NAN), (-0.1, 3.0), (f64::NAN, 3.0)];
    for (radius, distance) in bad.into_iter().chain([(f64::INFINITY, 3.0), (1e300, 3.0), (0.1, 1e-300)]) {
        let message = with(radius, distance).err().unwrap_or_else(|| panic!("{radius}, {distance} is no lens"));
        assert!(message.to_string().contains("a lens of radius"), "{message}");
    }
    // Conversely, a lens changes the image.
    let world = with(0.2, 3.0).unwrap_or_else(|e| panic!("{e}"));
    assert_ne!(hash(&film_of(&world, [12, 9], 4, Sobol::new(2))), expected);
}

/// Rays of one pixel meet in the focal plane, and the ray through the middle of the lens is the pinhole's. This also
/// holds for a scaled or stretched camera: pbrt-v4 measures lens and focus in camera space.
#[test]
fn lens_rays_meet_in_focus_r07() {
    for scale in [DVec3::ONE, DVec3::splat(0.25), DVec3::new(1.0, 2.0, 0.5)] {
        let to_world = look_at(DVec3::new(1.0, 2.0, 3.0), DVec3::ZERO, DVec3::Z) * DAffine3::from_scale(scale);
        let camera = Camera {
            to_world,
            lens_radius: 0.1,
            focal_distance: 4.0,
            projection: Projection::Perspective { fov: 40.0 },
            ..Camera::default()
        };
        let view = view(&camera, [20, 10]).expect("a sound camera");
        for pixel in [[0, 0], [9, 4], [19, 9]] {
            let place = view.place(pixel, Vec2::splat(0.2));
            let middle = ThinLens::ray(&view, place, [0.5; 2]);
            assert_eq!(middle.direction, Pinhole::ray(&view, place, [0.5; 2]).direction);
            // The distance of the focal plane along the view.
            let back = to_world.inverse();
            let in_focus = |u: [f32; 2]| {
                let ray = ThinLens::ray(&view, place, u);
                let o = back.transform_point3(ray.origin.as_dvec3());
                let d = back.transform_vector3(ray.direction.as_dvec3());
                assert!(o.z.abs() < 1e-5 && o.length() < 0.1 + 1e-5, "{o} is not on the lens");
                (o + d * ((4.0 - o.z) / d.z)).as_vec3()
            };
            let points: Vec<Vec3> = [[0.1, 0.9], [0.5, 0.0], [0.99, 0.99]].map(in_focus).into();
            assert!(points.iter().all(|p| p.distance(points[0]) < 1e-4), "{points:?}");
        }
    }
}

/// The general camera makes the same rays, bit for bit, as either of the two special ones.
/// A ray from the lens' edge leaves the one through its centre by the circle of confusion, in pixels of the image.
#[test]
fn circles_of_confusion_are_the_distances_of_lens_rays_in_pixels() {
    let to_world = DAffine3::from_mat3_translation(DMat3::from_rotation_y(0.7) * 1.5, DVec3::new(3.0, -2.0, 5.0));
    for projection in [Projection::Perspective { fov: 40.0 }, Projection::Orthographic] {
        let of = |lens_radius: f64| {
            let camera = Camera { to_world, projection, lens_radius, focal_distance: 2.0, ..Camera::default() };
            view(&camera, [60, 60]).expect("a sound camera")
        };
        let (small, large, none) = (of(0.1), of(0.2), of(0.0));
        let rows = small.world_to_clip();
        let depth = |p: Vec3| rows[2][0] * p.x + rows[2][1] * p.y + rows[2][2] * p.z + rows[2][3];
        let across = |p: Vec3| {
            let of = |r: [f32; 4]| r[0] * p.x + r[1] * p.y + r[2] * p.z + r[3];
            of(rows[0]) / of(rows[3]) * 30.0
        };
        let [middle, edge] = [[0.5, 0.5], [1.0, 0.5]].map(|lens| small.ray([17, 30], Vec2::ZERO, lens));
        for share in [0.25, 0.5, 1.0, 2.0, 8.0] {
            // Where rays meet is the plane in focus.
            let focus = 2.0 * 1.5;
            let near = small.circle_of_confusion(Some(middle.at(1e-3)), 0.0);
            assert!(near < 0.0);
            let at = |ray: &dapple_geometry::Ray| {
                let (a, b) = (depth(ray.at(0.0)), depth(ray.at(1.0)));
                let unit = depth(middle.at(focus)) - depth(middle.at(0.0));
                ray.at((share * unit + depth(middle.at(0.0)) - a) / (b - a))
            };
            let (p, q) = (at(&middle), at(&edge));
            let found = small.circle_of_confusion(Some(p), 0.0);
            let expected = across(p) - across(q);
            assert!((found - expected).abs() < 1e-3 * expected.abs().max(1.0), "{share}: {found} {expected}");
            assert!((large.circle_of_confusion(Some(p), 0.0) - 2.0 * found).abs() < 1e-3 * found.abs().max(1.0));
            assert_eq!(none.circle_of_confusion(Some(p), 0.0), 0.0);
        }
        let far = small.circle_of_confusion(None, 0.0);
        let is_limit = (far / small.circle_of_confusion(Some(middle.at(1e6)), 0.0) - 1.0).abs() < 1e-3;
        assert!(if projection == Projection::Orthographic { far == f32::INFINITY } else { is_limit }, "{far}");
    }
}

#[test]
fn the_general_camera_agrees_with_the_special_ones_r07() {
    let to_world = DAffine3::from_mat3_translation(DMat3::from_rotation_x(0.4) * 0.7, DVec3::new(1.0, 2.0, -3.0));
    for lens_radius in [0.0, 0.1] {
        let camera = Camera { to_world, lens_radius, focal_distance: 3.0, ..Camera::default() };
        let view = view(&camera, [31, 17]).expect("a sound camera");
        assert!(!view.is_general());
        for place in [Vec2::ZERO, Vec2::new(-15.5, 3.25), Vec2::new(7.0, -8.5)] {
            let on_lens = [0.3, 0.9];
            let special = match lens_radius {
                0.0 => Pinhole::ray(&view, place, on_lens),
                _ => ThinLens::ray(&view, place, on_lens),
            };
            assert_eq!(General::ray(&view, place, on_lens), special);
            assert_eq!(General::ray_at(&view, place, on_lens, 0.7), special);
            assert_eq!(view.ray_at(place, on_lens, 0.7), special);
        }
    }
}

/// Orthographic rays are parallel, a fixed distance apart, and project back to the film.
#[test]
fn orthographic_rays_are_parallel() {
    let turn = DMat3::from_rotation_y(0.7);
    let to_world = DAffine3::from_mat3_translation(turn * 1.5, DVec3::new(3.0, -2.0, 5.0));
    let screen_window = Some([-3.0, 1.0, -0.5, 2.5]);
    let projection = Projection::Orthographic;
    let camera = Camera { to_world, projection, screen_window, ..Camera::default() };
    let view = view(&camera, [60, 45]).expect("a sound camera");
    assert!(view.is_general() && !view.has_lens());
    let forward = (turn * DVec3::Z).as_vec3();
    let rows = view.world_to_clip();
    for pixel in [[0, 0], [59, 44], [17, 30], [30, 22]] {
        let ray = view.ray(pixel, Vec2::new(0.3, -0.2), [0.5; 2]);
        assert!((ray.direction - forward).length() < 1e-6);
        let [x, y] = [f64::from(pixel[0]) + 0.8, f64::from(pixel[1]) + 0.3];
        let on_screen = DVec3::new(-3.0 + 4.0 * x / 60.0, 2.5 - 3.0 * y / 45.0, 0.0);
        let expected = to_world.transform_point3(on_screen).as_vec3();
        assert!((ray.origin - expected).length() < 1e-5, "{} for {expected}", ray.origin);
        for t in [0.1, 50.0] {
            let p = ray.at(t);
            let row = |r: [f32; 4]| r[0] * p.x + r[1] * p.y + r[2] * p.z + r[3];
            let place = DVec3::new(f64::from(row(rows[0]) + 1.0) * 30.0, f64::from(row(rows[1]) + 1.0) * 22.5, 0.0);
            assert!((place - DVec3::new(x, y, 0.0)).length() < 2e-3, "{place} for {x} {y}");
            assert!(row(rows[3]) == 1.0 && row(rows[2]) > 0.0);
        }
    }
    // A pixel is equally wide at all distances: 4 / 60 of camera space.
    for distance in [0.1, 1.0, 1e3] {
        assert!((view.footprint(distance) - 0.1).abs() < 1e-6);
    }
}

#[test]
fn an_orthographic_lens_is_sharp_in_its_focal_plane() {
    let projection = Projection::Orthographic;
    let to_world = DAffine3::from_scale(DVec3::splat(2.0));
    let camera = Camera { to_world, projection, lens_radius: 0.25, focal_distance: 4.0, ..Camera::default() };
    let view = view(&camera, [8, 8]).expect("a sound camera");
    let place = Vec2::new(2.5, -1.5);
    // A quarter of the screen's half width per pixel, twice that in the world.
    let expected = Vec3::new(2.5 * 0.5, 1.5 * 0.5, 8.0);
    let mut widest = 0.0_f32;
    for i in 0..64 {
        let ray = view.ray_at(place, [i as f32 / 64.0, 0.999], 0.0);
        let focus = ray.at((expected.z - ray.origin.z) / ray.direction.z);
        assert!((focus - expected).length() < 1e-5, "{focus} for {expected}");
        widest = widest.max((ray.origin - expected.with_z(0.0)).length());
    }
    assert!((0.3..=0.5).contains(&widest), "{widest}");
    for (lens_radius, focal_distance) in [(0.1, 0.0), (0.1, f64::INFINITY), (f64::NAN, 1.0)] {
        let wrong = Camera { lens_radius, focal_distance, ..camera.clone() };
        assert!(self::view(&wrong, [8, 8]).is_err_and(|e| e.what.starts_with("a lens of radius ")));
    }
    let empty = Camera { screen_window: Some([0.0, 0.0, -1.0, 1.0]), ..camera };
    assert!(self::view(&empty, [8, 8]).is_err_and(|e| e.what.starts_with("the screen window ")));
}

/// At the ends of its motion the camera equals a still one; in between it turns evenly.
#[test]
fn a_moving_camera_follows_its_time() {
    let pose = |angle: f64, x: f64| {
        DAffine3::from_mat3_translation(DMat3::from_rotation_y(angle) * 1.5, DVec3::new(x, 1.0, 2.0))
    };
    for (projection, lens_radius) in [
        (Projection::Perspective { fov: 50.0 }, 0.0),
        (Projection::Perspective { fov: 50.0 }, 0.2),
        (Projection::Orthographic, 0.0),
    ] {
        let still = |angle, x| {
            let camera =
                Camera { to_world: pose(angle, x), projection, lens_radius, focal_distance: 2.0, ..Camera::default() };
            (view(&camera, [20, 20]).expect("a sound camera"), camera)
        };
        let (start, camera) = still(0.0, 0.0);
        let moving = Camera { moves_to: Some(pose(1.0, 4.0)), ..camera };
        let moving = view(&moving, [20, 20]).expect("a sound camera");
        assert!(moving.is_general() && moving.moves() && !start.moves());
        assert_eq!(moving.world_to_clip(), start.world_to_clip());
        for (time, angle, x) in [(0.0, 0.0, 0.0), (0.5, 0.5, 2.0), (1.0, 1.0, 4.0)] {
            let place = Vec2::new(3.5, -6.0);
            let found = moving.ray_at(place, [0.2, 0.7], time);
            let expected = still(angle, x).0.ray_at(place, [0.2, 0.7], 0.0);
            assert!((found.origin - expected.origin).length() < 1e-6, "{found:?} for {expected:?}");
            assert!((found.direction - expected.direction).length() < 1e-6, "{found:?} for {expected:?}");
        }
    }
    let mirrored = DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0));
    let camera = Camera { moves_to: Some(mirrored), ..Camera::default() };
    assert!(view(&camera, [8, 8]).is_err_and(|e| e.what.starts_with("the camera's motion is invalid: ")));
}
