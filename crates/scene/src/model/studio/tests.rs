use super::*;
use crate::{MaterialId, MeshData};

#[test]
fn the_angle_and_its_tangent_agree() {
    assert!((TAN_HALF_FOV - (FOV / 2.0).to_radians().tan()).abs() < 1e-15);
}

/// A scene with one mesh.
fn scene(positions: Vec<DVec3>, triangles: Vec<[u32; 3]>) -> Scene {
    let mesh = MeshData { positions, triangles, ..MeshData::default() };
    let shape = Shape::new(Geometry::Mesh(Arc::new(mesh)), DAffine3::IDENTITY, MaterialId(0), Source::default());
    Scene { shapes: vec![shape], ..Scene::default() }
}

/// A box whose faces point outwards; `faces` of its six are there: left, right, bottom, top, back, front.
fn cuboid(low: DVec3, high: DVec3, faces: &[usize], inwards: bool) -> Scene {
    let corner = |i: usize| DVec3::new([low.x, high.x][i & 1], [low.y, high.y][i >> 1 & 1], [low.z, high.z][i >> 2]);
    let quads = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let mut triangles = Vec::new();
    for [a, b, c, d] in faces.iter().map(|&face| quads[face]) {
        triangles.extend(if inwards { [[a, c, b], [a, d, c]] } else { [[a, b, c], [a, c, d]] });
    }
    scene((0..8).map(corner).collect(), triangles)
}

const ALL: [usize; 6] = [0, 1, 2, 3, 4, 5];
const BARE: Wanted = Wanted { camera: true, sky: true, ground: true };

/// The largest |x| and |y| of a scene's corners in the image, in units of half its width and height.
fn reach(scene: &Scene, corners: &[DVec3]) -> [f64; 2] {
    let to_camera = scene.camera.to_world.inverse();
    let [width, height] = scene.film.resolution.map(f64::from);
    let sides = [width, height].map(|side| TAN_HALF_FOV * side / width.min(height));
    let seen: Vec<DVec3> = corners.iter().map(|p| to_camera.transform_point3(*p)).collect();
    assert!(seen.iter().all(|p| p.z > 0.0));
    let most = |f: fn(&DVec3) -> f64, side: f64| seen.iter().map(|p| f(p).abs() / p.z / side).fold(0.0, f64::max);
    [most(|p| p.x, sides[0]), most(|p| p.y, sides[1])]
}

#[test]
fn models_fill_the_image_without_leaving_it() {
    let sizes = [
        DVec3::ONE,
        DVec3::new(10.0, 1.0, 1.0),
        DVec3::new(1.0, 8.0, 1.0),
        DVec3::new(1e-9, 2e-9, 1e-9),
        DVec3::splat(1e12),
    ];
    for (size, aspect) in sizes.into_iter().flat_map(|s| [None, Some(1.0), Some(0.5), Some(2.0)].map(|a| (s, a))) {
        for up in [UpAxis::Y, UpAxis::Z] {
            let mut scene = cuboid(3.0 * size, 4.0 * size, &ALL, false);
            let Geometry::Mesh(mesh) = scene.shapes[0].geometry.clone() else { unreachable!("it is a mesh") };
            set(&mut scene, Stage { up, aspect }, BARE, &Source::default()).unwrap();
            let reach = reach(&scene, &mesh.positions);
            let most = reach[0].max(reach[1]);
            assert!((FILLED - 1e-6..FILLED + 1e-6).contains(&most), "{size} {aspect:?} {up:?}: {reach:?}");
        }
    }
}

#[test]
fn up_is_up_and_right_is_right() {
    for (up, axis) in [(UpAxis::Y, DVec3::Y), (UpAxis::Z, DVec3::Z)] {
        let mut scene = cuboid(DVec3::ZERO, DVec3::ONE, &ALL, false);
        set(&mut scene, Stage { up, aspect: None }, BARE, &Source::default()).unwrap();
        let camera = scene.camera.to_world.matrix3;
        assert!(camera.y_axis.dot(axis) > 0.5 && camera.z_axis.dot(axis) < 0.0, "the camera looks down, with up above");
        assert!(camera.x_axis.x > 0.0);
    }
}

#[test]
fn a_model_stands_on_the_ground() {
    let mut scene = cuboid(DVec3::splat(5.0), DVec3::splat(7.0), &ALL, false);
    set(&mut scene, Stage { up: UpAxis::Z, aspect: None }, BARE, &Source::default()).unwrap();
    let ground = &scene.shapes[1];
    let below = 5.0 - ground.to_world.translation.z;
    assert!(below > 0.0 && below < 1e-3, "{below}");
    assert_eq!(ground.to_world.matrix3.z_axis, DVec3::Z);
}

#[test]
fn an_open_room_is_seen_from_its_open_side() {
    // Walls that face inwards, without the side at +z, or at -x.
    for (faces, open) in [(vec![0, 1, 2, 3, 4], DVec3::Z), (vec![1, 2, 3, 4, 5], DVec3::NEG_X)] {
        let mut scene = cuboid(DVec3::ZERO, DVec3::ONE, &faces, true);
        set(&mut scene, Stage { up: UpAxis::Y, aspect: None }, BARE, &Source::default()).unwrap();
        assert!(scene.camera.to_world.matrix3.z_axis.dot(open) < -0.9, "{:?}", scene.camera.to_world);
    }
    // A closed model is seen as usual.
    let mut scene = cuboid(DVec3::ZERO, DVec3::ONE, &ALL, false);
    set(&mut scene, Stage { up: UpAxis::Y, aspect: None }, BARE, &Source::default()).unwrap();
    let usual = view::direction(view::USUAL, [DVec3::Z, DVec3::X, DVec3::Y]);
    assert!(scene.camera.to_world.matrix3.z_axis.dot(usual) < -0.999);
}

#[test]
fn a_model_without_extent_is_refused() {
    let mut same = scene(vec![DVec3::ONE; 3], vec![[0, 1, 2]]);
    assert!(set(&mut same, Stage { up: UpAxis::Y, aspect: None }, BARE, &Source::default()).is_err());
    let mut huge = scene(vec![DVec3::splat(-1e308), DVec3::splat(1e308), DVec3::ZERO], vec![[0, 1, 2]]);
    assert!(set(&mut huge, Stage { up: UpAxis::Y, aspect: None }, BARE, &Source::default()).is_err());
}
