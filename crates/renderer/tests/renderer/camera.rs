//! Camera rays.

use crate::support::*;
use dapple_conformance::toys::Points;
use dapple_geometry::Ray;
use dapple_renderer::camera::{CameraView, General, Lens, Pinhole, ThinLens};
use dapple_renderer::pixel_filter::FilterSampler;
use dapple_renderer::{SceneError, Space};

fn try_view(camera: &Camera, size: [u32; 2]) -> Result<CameraView, SceneError> {
    CameraView::new(camera, size, &Space::of(&Scene::default()))
}

fn view(camera: &Camera, size: [u32; 2]) -> CameraView {
    try_view(camera, size).unwrap_or_else(|e| panic!("{e}"))
}

/// Returns a transform that rotates, scales by 1.5 and moves.
fn placed() -> DAffine3 {
    DAffine3::from_mat3_translation(DMat3::from_rotation_y(0.7) * 1.5, DVec3::new(3.0, -2.0, 5.0))
}

/// Clip coordinates x, y, z and w of a point.
fn clip(view: &CameraView, p: Vec3) -> [f32; 4] {
    view.world_to_clip().map(|r: [f32; 4]| r[0] * p.x + r[1] * p.y + r[2] * p.z + r[3])
}

/// Returns perspective and orthographic cameras, with and without a lens, with an off-centre window, under a shear.
fn sheared() -> Vec<(Camera, CameraView)> {
    let shear = DMat3::from_cols(DVec3::new(1.1, 0.2, 0.0), DVec3::new(0.0, 0.9, 0.1), DVec3::new(0.1, 0.0, 1.4));
    let turn = DMat3::from_rotation_y(0.7) * DMat3::from_rotation_x(-0.4);
    let to_world = DAffine3::from_mat3_translation(turn * shear, DVec3::new(0.3, -0.2, 0.5));
    let perspective = Projection::Perspective { fov: 70.0 };
    let view = |(projection, lens_radius)| {
        let camera = Camera { to_world, projection, lens_radius, focal_distance: 2.0, ..Camera::default() };
        let camera = Camera { screen_window: Some([-0.5, 1.0, -0.2, 0.9]), ..camera };
        let view = view(&camera, [60, 44]);
        assert!(
            view.is_general() == (projection == Projection::Orthographic) && view.has_lens() == (lens_radius > 0.0)
        );
        (camera, view)
    };
    [(perspective, 0.0), (perspective, 0.2), (Projection::Orthographic, 0.0), (Projection::Orthographic, 0.2)]
        .map(view)
        .into()
}

/// Points along camera rays connect to the same rays, and project to the rays' image positions. Orthographic rays are parallel,
/// at equal distances.
#[test]
fn points_of_camera_rays_lead_back_to_their_rays() {
    for (camera, view) in sheared() {
        let is_flat = camera.projection == Projection::Orthographic;
        for (pixel, u) in [([0, 0], [0.1, 0.9]), ([59, 43], [0.5, 0.5]), ([17, 30], [0.8, 0.3])] {
            let (ray, middle) = (view.ray(pixel, Vec2::new(0.3, -0.2), u), [0.5; 2]);
            let expected = Vec2::new(pixel[0] as f32 + 0.8, pixel[1] as f32 + 0.3);
            for t in [0.1, 1.0, 50.0] {
                let found = view.connect(ray.at(t), u, 0.0).unwrap_or_else(|| panic!("{camera:?}"));
                let tolerance = 1e-4 * t.max(1.0);
                assert!((found.place - expected).length() < 2e-3, "{camera:?} at {t}: {found:?}, {expected}");
                assert!((found.position - ray.origin).length() < tolerance, "{camera:?} at {t}: {found:?}");
                assert!((found.direction - ray.direction).length() < 1e-4, "{camera:?} at {t}: {found:?}");
                assert!((found.distance - t).abs() < tolerance, "{camera:?} at {t}: {found:?}");
                let [x, y, z, w] = clip(&view, view.ray(pixel, Vec2::new(0.3, -0.2), middle).at(t));
                let place = Vec2::new((x / w + 1.0) * 30.0, (y / w + 1.0) * 22.0);
                assert!((place - expected).length() < 2e-3, "{camera:?} at {t}: {place} is not {expected}");
                assert!(w > 0.0 && (!is_flat || w == 1.0 && z > 0.0));
            }
            assert_eq!(view.connect(ray.at(-1.0), u, 0.0), None, "{camera:?}: behind the camera");
            if is_flat && camera.lens_radius == 0.0 {
                let [x, y] = expected.as_dvec2().to_array();
                let on_screen = DVec3::new(-0.5 + 1.5 * x / 60.0, 0.9 - 1.1 * y / 44.0, 0.0);
                let origin = camera.to_world.transform_point3(on_screen).as_vec3();
                assert!((ray.origin - origin).length() < 1e-5, "{} for {origin}", ray.origin);
            }
        }
    }
    // A pixel is equally wide at all distances: 4 / 60 of camera space, which is larger by half.
    let camera = Camera { to_world: placed(), screen_window: Some([-3.0, 1.0, -0.5, 2.5]), ..Camera::default() };
    let flat = view(&Camera { projection: Projection::Orthographic, ..camera }, [60, 45]);
    assert!([0.1, 1.0, 1e3].into_iter().all(|distance| (flat.footprint(distance) - 0.1).abs() < 1e-6));
}

/// The area between neighbouring rays, perpendicular to the ray, is the reciprocal of the density.
#[test]
fn the_density_is_that_of_rays_at_uniform_places() {
    for (camera, view) in sheared() {
        for (place, t) in [[-25.0, 13.0], [0.0, 0.0], [20.0, -19.0]].into_iter().flat_map(|p| [(p, 0.7_f32), (p, 3.0)])
        {
            let ray_at = |offset: Vec2| view.ray_at(Vec2::from(place) + offset, [0.3, 0.7], 0.0);
            let ray = ray_at(Vec2::ZERO);
            // The point at which a ray crosses the plane perpendicular to the middle ray.
            let (middle, normal) = (ray.at(t).as_dvec3(), ray.direction.as_dvec3());
            let meets = |offset: Vec2| {
                let [origin, direction] = [ray_at(offset).origin, ray_at(offset).direction].map(|v| v.as_dvec3());
                origin + direction * ((middle - origin).dot(normal) / direction.dot(normal))
            };
            let step = |axis: Vec2| meets(axis) - meets(-axis);
            let expected = 4.0 / (step(Vec2::X).cross(step(Vec2::Y)).length() * 60.0 * 44.0);
            let found = f64::from(view.density(ray.direction, t, 0.0));
            assert!((found / expected - 1.0).abs() < 2e-3, "{camera:?}, {place:?} at {t}: {found} {expected}");
            assert_eq!(view.density(-ray.direction, 1.0, 0.0), 0.0);
        }
    }
}

#[test]
fn sample_stays_in_its_pixel_r01() {
    let view = view(&Camera::default(), [65536, 3]);
    let filter = FilterSampler::new(&PixelFilter::default());
    for u in [0.0, 0.5, BELOW_ONE] {
        for x in 0..65536 {
            let place = view.place([x, 1], filter.sample([u, u])).x;
            let centre = f64::from(x) + 0.5 - 32768.0;
            assert!((f64::from(place) - centre).abs() <= 0.5, "u = {u}, x = {x}: {place}");
        }
    }
    // No sample falls into a neighbouring pixel: sample counts are exact even with the worst points.
    let mut scene = room([65536, 1]);
    scene.max_depth = Some(1);
    let film = film_of(&world(&scene), [65536, 1], 2, Points(|_, _| [BELOW_ONE; 4]));
    assert!(film.counts().iter().all(|&n| n == 2) && film.record().rejected == 0);
}

#[test]
fn odd_image_sizes_cover_every_pixel_r02() {
    for size in [[1, 1], [1, 4097], [4097, 1], [7, 13]] {
        let film = image(&room(size), 3, 1);
        assert_eq!(film.counts(), vec![3; (size[0] * size[1]) as usize], "{size:?}");
        assert!(film.record().rejected == 0 && mean(&film)[0] > 0.0, "{size:?} is black");
    }
    assert!(Frame::new(0, 5).is_err() && World::with_resolution(&room([4, 4]), [0, 5]).is_err());
}

#[test]
fn degenerate_poses_are_refused_r03() {
    let check = |expected: &str, change: &dyn Fn(&mut Camera)| {
        let mut scene = room([8, 8]);
        change(&mut scene.camera);
        let message = refusal(&scene);
        assert!(message.contains(expected) && message.is_empty() == expected.is_empty(), "{message}: {expected}");
    };
    // An up vector along the view and an eye at its target give no basis: division by 0 makes NaN or zero columns.
    let flat = DAffine3::from_mat3(DMat3::from_cols(DVec3::X, DVec3::X, DVec3::Z));
    let lost = [look_at(DVec3::ZERO, DVec3::Z, DVec3::Z), look_at(DVec3::X, DVec3::X, DVec3::Z)];
    for pose in lost.into_iter().chain([flat, DAffine3::ZERO, at(f64::NAN, 0.0, 0.0), at(f64::INFINITY, 0.0, 0.0)]) {
        check("made.pbrt:1: the camera's transform", &|c| c.to_world = pose);
    }
    for fov in [0.0, 180.0, -10.0, f64::NAN, f64::INFINITY] {
        check("made.pbrt:1: a field of view of", &|c| c.projection = Projection::Perspective { fov });
    }
    for window in [[1.0, -1.0, -1.0, 1.0], [0.0, 0.0, 0.0, 1.0], [f64::NAN; 4], [-1e300, 1e300, -1.0, 1.0]] {
        check("the screen window", &|c| c.screen_window = Some(window));
        check("the screen window", &|c| (c.screen_window, c.projection) = (Some(window), Projection::Orthographic));
    }
    for (lens_radius, focal_distance) in [(0.1, 0.0), (0.1, -1.0), (0.1, f64::INFINITY), (0.1, f64::NAN), (-0.1, 3.0)]
        .into_iter()
        .chain([(f64::NAN, 3.0), (f64::INFINITY, 3.0), (1e300, 3.0), (0.1, 1e-300)])
    {
        check("a lens of radius", &|c| (c.lens_radius, c.focal_distance) = (lens_radius, focal_distance));
    }
    let flat_lens = Camera { projection: Projection::Orthographic, lens_radius: 0.1, ..Camera::default() };
    for focal_distance in [0.0, f64::INFINITY] {
        let error = try_view(&Camera { focal_distance, ..flat_lens.clone() }, [8, 8]).expect_err("no lens");
        assert!(error.what.starts_with("a lens of radius "), "{}", error.what);
    }
    let mirrored = Some(DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0)));
    let moving = try_view(&Camera { moves_to: mirrored, ..Camera::default() }, [8, 8]);
    assert!(moving.is_err_and(|e| e.what.starts_with("the camera's motion is invalid: ")));
    check("aspect", &|c| c.aspect = Some(0.0));
    check("aspect", &|c| c.aspect = Some(f64::NAN));
    check("", &|c| c.projection = Projection::Perspective { fov: 179.9 });
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
        let view = view(&Camera { projection: Projection::Perspective { fov: 50.0 }, ..Camera::default() }, size);
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
        let view = view(&Camera { to_world, ..Camera::default() }, [7, 5]);
        let centre = Pinhole::ray(&view, view.place([3, 2], Vec2::ZERO), [0.0; 2]).direction;
        assert_eq!(centre, to_world.matrix3.z_axis.as_vec3().normalize(), "towards {target}");
    }
}

#[test]
fn cameras_on_and_inside_surfaces_render_r05() {
    let mut scene = room([16, 16]);
    let shade = add_material(&mut scene, diffuse(0.5));
    let shell = DVec3::new(0.0, -5.0, 3.0);
    add(&mut scene, Geometry::Mesh(Arc::new(cube())), DAffine3::from_translation(shell), shade, None);
    let two_sided = ball(&mut scene, shell, 0.5, shade, Some(2.0));
    scene.shapes[two_sided].emission.as_mut().expect("it shines").two_sided = true;
    for (place, eye) in [
        ("on the floor", [0.0, 0.0, 0.0]),
        ("on a lamp", [0.0, 0.0, 2.5]),
        ("on a corner", [-1.4, -0.1, 0.0]),
        ("in a closed mesh", [0.9, -5.9, 3.9]),
        ("on an edge of the mesh", [1.0, -6.0, 3.0]),
        ("in the middle of a lamp", [0.0, -5.0, 3.0]),
        ("on a lamp's sphere", [0.5, -5.0, 3.0]),
        ("in a lamp that shines outwards", [1.2, -0.5, 0.9]),
    ] {
        for lens in [0.0, 0.05] {
            let eye = DVec3::from(eye);
            scene.camera.to_world = look_at(eye, eye + DVec3::new(0.3, 1.0, 0.2), DVec3::Z);
            (scene.camera.lens_radius, scene.camera.focal_distance) = (lens, 2.0);
            let film = image(&scene, 16, 5);
            let is_sound = film.record().rejected == 0 && mean(&film).iter().all(|m| m.is_finite());
            assert!(is_sound, "{place}, lens {lens}");
        }
    }
}

#[test]
fn a_crop_is_a_part_of_the_full_frame_r06() {
    for filter in [
        PixelFilter::default(),
        PixelFilter::Gaussian { radius: [2.0, 2.0], sigma: 0.7 },
        PixelFilter::Triangle { radius: [2.0, 1.0] },
    ] {
        let mut scene = room([23, 17]);
        scene.film.pixel_filter = filter;
        let world = world(&scene);
        let full = film_of(&world, [23, 17], 4, Sobol::new(3));
        for [x0, y0, x1, y1] in [[0, 0, 1, 1], [22, 16, 23, 17], [3, 5, 20, 11], [0, 0, 23, 1], [7, 0, 8, 17]] {
            let frame = Frame::new(23, 17).and_then(|whole| whole.crop(x0, y0, x1, y1)).expect("inside");
            let limits = Limits::samples(4 * frame.pixels() as u64);
            let part = film_in(&world, frame, Needs::none(), &mut Uniform::new(Sobol::new(3)), &limits);
            for i in 0..frame.pixels() {
                let [x, y] = frame.pixel(i);
                assert_eq!(part.mean(i), full.mean((y * 23 + x) as usize), "{filter:?}, pixel {x}, {y}");
            }
        }
    }
}

/// Negative control: a lens of another radius changes the image.
#[test]
fn a_lens_of_radius_0_is_a_pinhole_r07() {
    let with = |radius: f64, distance: f64| {
        let mut scene = room([12, 9]);
        (scene.camera.lens_radius, scene.camera.focal_distance) = (radius, distance);
        hash(&image(&scene, 4, 2))
    };
    let expected = hash(&image(&room([12, 9]), 4, 2));
    for distance in [0.0, -1.0, 3.0, f64::INFINITY, f64::NAN] {
        assert_eq!(with(0.0, distance), expected, "focus at {distance}");
    }
    assert_ne!(with(0.2, 3.0), expected);
}

/// Rays of one pixel meet in the focal plane, and the ray through the middle of the lens is the pinhole's. This also
/// holds for a scaled or stretched camera: pbrt-v4 measures lens and focus in camera space.
#[test]
fn lens_rays_meet_in_focus_r07() {
    for projection in [Projection::Perspective { fov: 40.0 }, Projection::Orthographic] {
        for scale in [DVec3::ONE, DVec3::splat(0.25), DVec3::new(1.0, 2.0, 0.5)] {
            let to_world = look_at(DVec3::new(1.0, 2.0, 3.0), DVec3::ZERO, DVec3::Z) * DAffine3::from_scale(scale);
            let camera = Camera { to_world, lens_radius: 0.1, focal_distance: 4.0, projection, ..Camera::default() };
            let view = view(&camera, [20, 10]);
            for pixel in [[0, 0], [9, 4], [19, 9]] {
                let place = view.place(pixel, Vec2::splat(0.2));
                let middle = view.ray_at(place, [0.5; 2], 0.0);
                let pinhole = self::view(&Camera { lens_radius: 0.0, ..camera.clone() }, [20, 10]);
                assert_eq!(middle.direction, pinhole.ray_at(place, [0.5; 2], 0.0).direction);
                let back = to_world.inverse();
                let start = back.transform_point3(middle.origin.as_dvec3());
                let in_focus = |u: [f32; 2]| {
                    let ray = view.ray_at(place, u, 0.0);
                    let o = back.transform_point3(ray.origin.as_dvec3());
                    let d = back.transform_vector3(ray.direction.as_dvec3());
                    let (off, edge) = ((o - start).length(), if u == [0.5, 0.0] { 0.1 } else { 0.0 });
                    assert!(o.z.abs() < 1e-5 && (edge - 1e-5..0.1 + 1e-5).contains(&off), "{o} is not on the lens");
                    (o + d * ((4.0 - o.z) / d.z)).as_vec3()
                };
                let points = [[0.1, 0.9], [0.5, 0.0], [0.99, 0.99]].map(in_focus);
                assert!(points.iter().all(|p| p.distance(points[0]) < 1e-4), "{points:?}");
            }
        }
    }
}

/// The circle of confusion is the distance, in pixels, between the rays from the lens' edge and from its centre.
#[test]
fn circles_of_confusion_are_the_distances_of_lens_rays_in_pixels() {
    for projection in [Projection::Perspective { fov: 40.0 }, Projection::Orthographic] {
        let [small, large, none] = [0.1, 0.2, 0.0].map(|lens_radius| {
            let camera = Camera { to_world: placed(), projection, lens_radius, ..Camera::default() };
            view(&Camera { focal_distance: 2.0, ..camera }, [60, 60])
        });
        let depth = |p: Vec3| clip(&small, p)[2];
        let across = |p: Vec3| clip(&small, p)[0] / clip(&small, p)[3] * 30.0;
        let [middle, edge] = [[0.5, 0.5], [1.0, 0.5]].map(|lens| small.ray([17, 30], Vec2::ZERO, lens));
        assert!(small.circle_of_confusion(Some(middle.at(1e-3)), 0.0) < 0.0);
        for share in [0.25, 0.5, 1.0, 2.0, 8.0] {
            let at = |ray: &Ray| {
                let (a, b) = (depth(ray.at(0.0)), depth(ray.at(1.0)));
                // Where rays meet is the plane in focus, 2 units of camera space away.
                let unit = depth(middle.at(2.0 * 1.5)) - depth(middle.at(0.0));
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

/// The general camera's rays are bit-identical to the rays of both special cameras. At the ends of its motion, a camera equals
/// a camera at rest; in between it turns at constant speed.
#[test]
fn the_general_camera_agrees_with_the_special_ones_r07() {
    let pose = |angle: f64, x: f64| {
        DAffine3::from_mat3_translation(DMat3::from_rotation_y(angle) * 1.5, DVec3::new(x, 1.0, 2.0))
    };
    let perspective = Projection::Perspective { fov: 50.0 };
    let on_lens = [0.3, 0.9];
    for (projection, lens_radius) in [(perspective, 0.0), (perspective, 0.2), (Projection::Orthographic, 0.0)] {
        let camera = Camera { projection, lens_radius, focal_distance: 2.0, ..Camera::default() };
        let still = |angle, x| view(&Camera { to_world: pose(angle, x), ..camera.clone() }, [31, 17]);
        let start = still(0.0, 0.0);
        let moves_to = Some(pose(1.0, 4.0));
        let moving = view(&Camera { moves_to, to_world: pose(0.0, 0.0), ..camera.clone() }, [31, 17]);
        assert!(moving.is_general() && moving.moves() && !start.moves());
        assert_eq!((moving.world_to_clip(), start.is_general()), (start.world_to_clip(), projection != perspective));
        for place in [Vec2::ZERO, Vec2::new(-15.5, 3.25), Vec2::new(7.0, -8.5)] {
            if !start.is_general() {
                let special = match lens_radius {
                    0.0 => Pinhole::ray(&start, place, on_lens),
                    _ => ThinLens::ray(&start, place, on_lens),
                };
                assert_eq!(General::ray(&start, place, on_lens), special);
                assert_eq!(General::ray_at(&start, place, on_lens, 0.7), special);
                assert_eq!(start.ray_at(place, on_lens, 0.7), special);
            }
            for (time, angle, x) in [(0.0, 0.0, 0.0), (0.5, 0.5, 2.0), (1.0, 1.0, 4.0)] {
                let found = moving.ray_at(place, on_lens, time);
                let expected = still(angle, x).ray_at(place, on_lens, 0.0);
                assert!((found.origin - expected.origin).length() < 1e-6, "{found:?} for {expected:?}");
                assert!((found.direction - expected.direction).length() < 1e-6, "{found:?} for {expected:?}");
            }
        }
    }
}
