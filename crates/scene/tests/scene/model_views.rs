//! The camera and the ground of bare models.

use dapple_scene::model::{ModelOptions, UpAxis};
use dapple_scene::{AnyOptions, Geometry, Projection, ReadError, Scene, read_any_from};
use glam::DVec3;
use std::fmt::Write;

/// The part of the image's width or height that a model fills.
const FILLED: f64 = 0.88;

/// The axis that points up, and width over height of the image.
type Stage = (UpAxis, Option<f64>);

/// The scene of an OBJ file with one mesh.
fn scene(positions: &[DVec3], triangles: &[[usize; 3]], (up, aspect): Stage) -> Result<Scene, ReadError> {
    let mut text = String::new();
    positions.iter().for_each(|p| writeln!(text, "v {} {} {}", p.x, p.y, p.z).unwrap());
    triangles.iter().for_each(|[a, b, c]| writeln!(text, "f {} {} {}", a + 1, b + 1, c + 1).unwrap());
    let files: &[(&str, &[u8])] = &[("m.obj", text.as_bytes())];
    let model = ModelOptions { up: Some(up), aspect };
    read_any_from(files, "m.obj", &AnyOptions { model, ..AnyOptions::default() })
}

/// A box whose faces point outwards; `faces` of its six are there: left, right, bottom, top, back, front.
fn cuboid([low, high]: [DVec3; 2], faces: &[usize], inwards: bool, stage: Stage) -> Scene {
    let corner = |i: usize| DVec3::new([low.x, high.x][i & 1], [low.y, high.y][i >> 1 & 1], [low.z, high.z][i >> 2]);
    let quads = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let turned = |t: [usize; 3]| if inwards { [t[0], t[2], t[1]] } else { t };
    let quads = faces.iter().map(|&face| quads[face]);
    let triangles: Vec<_> = quads.flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]].map(turned)).collect();
    scene(&(0..8).map(corner).collect::<Vec<_>>(), &triangles, stage).expect("a model")
}

const ALL: [usize; 6] = [0, 1, 2, 3, 4, 5];

/// The largest |x| and |y| of a scene's corners in the image, in units of half its width and height.
fn reach(scene: &Scene) -> [f64; 2] {
    let Geometry::Mesh(mesh) = &scene.shapes[0].geometry else { unreachable!("it is a mesh") };
    let Projection::Perspective { fov } = scene.camera.projection else { panic!("{:?}", scene.camera) };
    let to_camera = scene.camera.to_world.inverse();
    let [width, height] = scene.film.resolution.map(f64::from);
    let sides = [width, height].map(|side| (0.5 * fov).to_radians().tan() * side / width.min(height));
    let seen: Vec<DVec3> = mesh.positions.iter().map(|p| to_camera.transform_point3(*p)).collect();
    assert!(seen.iter().all(|p| p.z > 0.0));
    let most = |f: fn(&DVec3) -> f64, side: f64| seen.iter().map(|p| f(p).abs() / p.z / side).fold(0.0, f64::max);
    [most(|p| p.x, sides[0]), most(|p| p.y, sides[1])]
}

#[test]
fn models_fill_the_image_without_leaving_it() {
    let thin = [DVec3::new(10.0, 1.0, 1.0), DVec3::new(1.0, 8.0, 1.0), DVec3::new(1e-9, 2e-9, 1e-9)];
    let sizes = thin.into_iter().chain([DVec3::ONE, DVec3::splat(1e12)]);
    for (size, aspect) in sizes.flat_map(|s| [None, Some(1.0), Some(0.5), Some(2.0)].map(|a| (s, a))) {
        for up in [UpAxis::Y, UpAxis::Z] {
            let reach = reach(&cuboid([3.0 * size, 4.0 * size], &ALL, false, (up, aspect)));
            let most = reach[0].max(reach[1]);
            assert!((most - FILLED).abs() < 1e-12, "{size} {aspect:?} {up:?}: {reach:?}");
        }
    }
}

#[test]
fn a_model_stands_upright_on_the_ground() {
    for (up, axis) in [(UpAxis::Y, DVec3::Y), (UpAxis::Z, DVec3::Z)] {
        let scene = cuboid([DVec3::splat(5.0), DVec3::splat(7.0)], &ALL, false, (up, None));
        let camera = scene.camera.to_world.matrix3;
        assert!(camera.y_axis.dot(axis) > 0.5 && camera.z_axis.dot(axis) < 0.0, "it looks down, with up above");
        assert!(camera.x_axis.x > 0.0);
        let ground = &scene.shapes[1].to_world;
        let below = 5.0 - ground.translation.dot(axis);
        assert!(below > 0.0 && below < 1e-3 && ground.matrix3.z_axis == axis, "{below}");
    }
}

#[test]
fn an_open_room_is_seen_from_its_open_side() {
    let unit = [DVec3::ZERO, DVec3::ONE];
    let forward = |scene: Scene| scene.camera.to_world.matrix3.z_axis;
    // Walls that face inwards, without the side at +z, or at -x.
    for (faces, open) in [([0, 1, 2, 3, 4], DVec3::Z), ([1, 2, 3, 4, 5], DVec3::NEG_X)] {
        let seen = forward(cuboid(unit, &faces, true, (UpAxis::Y, None)));
        assert!(seen.dot(open) < -0.9, "{seen}");
    }
    // A closed model is seen as usual: from the front, the right and above.
    let usual = DVec3::new(0.6, 0.45, 1.0).normalize();
    assert!(forward(cuboid(unit, &ALL, false, (UpAxis::Y, None))).dot(usual) < -0.999);
}

#[test]
fn a_model_without_extent_is_refused() {
    let error = |positions: &[DVec3]| scene(positions, &[[0, 1, 2]], (UpAxis::Y, None)).unwrap_err().to_string();
    assert!(error(&[DVec3::ONE; 3]).contains("coincide"));
    assert!(error(&[DVec3::splat(-1e308), DVec3::splat(1e308), DVec3::ZERO]).contains("size of the model overflows"));
}
