//! The side that a shape emits from: pbrt-v4's rules of normals, mirrors and `ReverseOrientation`, as in
//! `scene::Shape`. Environments have the same radiance by evaluation and by sampling.

use crate::support::*;
use dapple_geometry::Ray;
use dapple_renderer::SceneError;
use dapple_renderer::World;
use dapple_renderer::light::{Environment, Target};
use dapple_scene::image::Image;
use dapple_scene::{EnvironmentRadiance, Geometry, Light, LightKind, MeshData, Scene, Source};
use glam::{DAffine3, DMat3, DVec3, Vec3};
use std::sync::Arc;

/// True if the shape emits towards an eye above (+z), and below; checks that light sampling agrees.
fn shines(geometry: Geometry, to_world: DAffine3, reversed: bool) -> [bool; 2] {
    let mut scene = scene([1, 1], 40.0, DVec3::new(0.0, -3.0, 2.0), DVec3::ZERO);
    let grey = add_material(&mut scene, diffuse(0.5));
    let lamp = add(&mut scene, geometry, to_world, grey, Some(1.0));
    scene.shapes[lamp].reversed = reversed;
    let world = world(&scene);
    [1.0, -1.0].map(|side| {
        // Off the centre, where rings have a hole.
        let eye = world.space().point(DVec3::new(0.6, 0.1, 4.0 * side)).as_vec3();
        let met = world.emitter(&Ray::new(eye, Vec3::Z * -side as f32)).expect("it is in the way");
        let seen = met.radiance != Vec3::ZERO;
        let drawn = (0..64).any(|i| {
            let u = [(i % 8) as f32 / 8.0 + 0.05, (i / 8) as f32 / 8.0 + 0.05];
            world.lights().sample(eye, 0.5, u).is_some()
        });
        assert_eq!(seen, drawn, "what is seen and what is sampled, side {side}");
        assert_eq!(f64::from(met.point.normal.z) * side > 0.0, seen, "the normal points to the side that shines");
        seen
    })
}

fn up(normals: Option<f32>) -> Geometry {
    let Geometry::Mesh(mesh) = rectangle(DVec3::ZERO, DVec3::X, DVec3::Y) else { unreachable!("a mesh") };
    let normals = normals.map_or(Vec::new(), |z| vec![[0.1, 0.0, z]; 4]);
    Geometry::Mesh(Arc::new(MeshData { normals, ..(*mesh).clone() }))
}

#[test]
fn shapes_emit_from_the_side_of_their_normal_l12() {
    let plain = DAffine3::IDENTITY;
    // A mirror across the lamp's plane turns its normal with it; one along the plane does not.
    let across = DAffine3::from_scale(DVec3::new(1.0, 1.0, -1.0));
    let along = DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0));
    let (above, below) = ([true, false], [false, true]);
    let disk = || Geometry::Disk { height: 0.0, radius: 1.0, inner_radius: 0.25 };
    for (name, make) in
        [("mesh", (|| up(None)) as fn() -> Geometry), ("disk", disk), ("mesh with normals", || up(Some(1.0)))]
    {
        assert_eq!(shines(make(), plain, false), above, "{name}");
        assert_eq!(shines(make(), plain, true), below, "{name}, reversed");
        assert_eq!(shines(make(), along, false), above, "{name}, mirrored along");
        assert_eq!(shines(make(), along, true), below, "{name}, mirrored along, reversed");
        assert_eq!(shines(make(), across, false), below, "{name}, mirrored across");
        assert_eq!(shines(make(), across, true), above, "{name}, mirrored across, reversed");
    }
    // Vertex normals override the winding.
    assert_eq!(shines(up(Some(-1.0)), plain, false), below);
    assert_eq!(shines(up(Some(-1.0)), plain, true), above);
    assert_eq!(shines(up(Some(-1.0)), along, false), below);
    // A sphere emits outwards, mirrored or not.
    for map in [plain, along, across, DAffine3::from_scale(DVec3::splat(-2.0))] {
        assert_eq!(shines(Geometry::Sphere { radius: 1.0 }, map, false), [true; 2]);
        assert_eq!(shines(Geometry::Sphere { radius: 1.0 }, map, true), [false; 2]);
    }
}

#[test]
fn stretched_round_lamps_are_refused_l06() {
    for geometry in [Geometry::Sphere { radius: 1.0 }, Geometry::Disk { height: 0.5, radius: 1.0, inner_radius: 0.0 }] {
        let mut scene = scene([1, 1], 40.0, DVec3::new(0.0, -3.0, 2.0), DVec3::ZERO);
        let grey = add_material(&mut scene, diffuse(0.5));
        let stretch = DAffine3::from_scale(DVec3::new(1.0, 2.0, 1.0));
        add(&mut scene, geometry, stretch, grey, Some(1.0));
        let message = World::new(&scene).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(message.starts_with("made.pbrt:10: an emitting sphere or disk must not be stretched"), "{message}");
        // Without emission it is allowed.
        scene.shapes[0].emission = None;
        assert!(World::new(&scene).is_ok());
    }
}

fn lat_long(size: [u32; 2], value: impl Fn(u32, u32) -> f32) -> EnvironmentRadiance {
    let pixels = (0..size[0] * size[1]).map(|i| [value(i % size[0], i / size[0]); 3]).collect();
    EnvironmentRadiance::LatLong { image: Arc::new(Image::new(size, pixels).expect("as many")), scale: 1.0 }
}

fn environment(radiance: &EnvironmentRadiance, turn: DMat3) -> Result<Option<Environment>, SceneError> {
    Environment::new(radiance, turn, &Source::default())
}

fn sky_alone(radiance: EnvironmentRadiance, to_world: DAffine3) -> Scene {
    let mut scene = scene([1, 1], 40.0, DVec3::new(0.0, -3.0, 2.0), DVec3::ZERO);
    scene.lights.push(Light { kind: LightKind::Infinite { radiance }, to_world, source: line(200) });
    scene
}

/// Evaluation and sampling of an environment agree. Its density integrates to 1 and finds all its light.
#[test]
fn environment_samples_match_evaluation_l08() {
    let turn = DMat3::from_rotation_z(0.7) * DMat3::from_rotation_x(1.1);
    let mirrored = turn * DMat3::from_diagonal(DVec3::new(1.0, -3.0, 1.0));
    let mirrored = DMat3::from_cols(mirrored.x_axis * 3.0, mirrored.y_axis, mirrored.z_axis * 3.0);
    let maps: [(&str, EnvironmentRadiance); 5] = [
        ("constant", EnvironmentRadiance::Constant([0.5; 3])),
        ("one texel", lat_long([1, 1], |_, _| 0.7)),
        ("a bright texel at the pole", lat_long([16, 8], |x, y| if (x, y) == (3, 0) { 1000.0 } else { 0.1 })),
        ("a bright texel at the seam", lat_long([16, 8], |x, y| if (x, y) == (15, 4) { 50.0 } else { 0.0 })),
        ("a slope", lat_long([9, 5], |x, y| (x + 2 * y) as f32)),
    ];
    for (name, radiance) in maps {
        for map in [DMat3::IDENTITY, turn, mirrored] {
            let sky = environment(&radiance, map).expect("sound").expect("not black");
            let scene = sky_alone(radiance.clone(), DAffine3::from_mat3(map));
            let world = world(&scene);
            let unscaled = map.as_mat3();
            let (mut by_sphere, mut by_light, mut density) = (0.0, 0.0, 0.0);
            let side = 256;
            for i in 0..side * side {
                let u = [((i % side) as f32 + 0.5) / side as f32, ((i / side) as f32 + 0.5) / side as f32];
                // Uniform in angles, not areas: near a pole the density is one over the sine.
                let (theta, phi) = (u[0] * std::f32::consts::PI, u[1] * std::f32::consts::TAU);
                let w = Vec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
                let w = (unscaled * w).normalize();
                let measure = 2.0 * std::f64::consts::PI.powi(2) * f64::from(theta.sin());
                by_sphere += f64::from(sky.radiance(w).x) * measure;
                density += f64::from(sky.direction_pdf(w)) * measure;
                let Some(drawn) = world.lights().sample(Vec3::ZERO, 0.0, u) else { continue };
                assert!(matches!(drawn.target, Target::Far) && (drawn.wi.length() - 1.0).abs() < 3e-7);
                // The direction may round across a texel's border; these coordinates keep away from borders.
                assert_eq!(drawn.radiance, sky.radiance(drawn.wi));
                assert!(
                    (drawn.pdf / sky.direction_pdf(drawn.wi) - 1.0).abs() < 1e-3,
                    "{name}: {drawn:?} {}",
                    sky.direction_pdf(drawn.wi)
                );
                by_light += f64::from(drawn.radiance.x / drawn.pdf);
            }
            let n = f64::from(side * side);
            // A rule of 256^2 points on steps: exact to a texel's border, the light to a thousandth.
            assert!((density / n - 1.0).abs() < 0.02, "{name}: {}", density / n);
            assert!((by_light / by_sphere - 1.0).abs() < 0.02, "{name}: {by_light} {by_sphere}");
        }
    }
}

#[test]
fn invalid_environments_are_refused_l08() {
    let refused = |radiance: &EnvironmentRadiance| environment(radiance, DMat3::IDENTITY).err().map(|e| e.to_string());
    for bad in [f32::NAN, f32::INFINITY, -1.0] {
        let map = lat_long([4, 3], |x, y| if (x, y) == (2, 1) { bad } else { 1.0 });
        let message = refused(&map).unwrap_or_default();
        assert!(message.contains("texel (2, 1)"), "{message}");
        assert!(refused(&EnvironmentRadiance::Constant([1.0, bad, 1.0])).is_some());
    }
    assert!(environment(&lat_long([4, 3], |_, _| 0.0), DMat3::IDENTITY).expect("sound").is_none());
    assert!(environment(&EnvironmentRadiance::Constant([0.0; 3]), DMat3::IDENTITY).expect("sound").is_none());
    let map = lat_long([4, 3], |_, _| 1.0);
    for transform in [DMat3::ZERO, DMat3::from_diagonal(DVec3::new(1.0, 2.0, 1.0)), DMat3::from_diagonal(DVec3::NAN)] {
        assert!(environment(&map, transform).is_err(), "{transform}");
    }
    // Huge values give a finite image, without rejected samples.
    let bright = lat_long([8, 4], |x, y| if (x, y) == (1, 1) { 1e30 } else { 1.0 });
    let mut scene = sky_alone(bright, DAffine3::IDENTITY);
    let grey = add_material(&mut scene, diffuse(0.5));
    add(&mut scene, rectangle(DVec3::ZERO, DVec3::X, DVec3::Y), DAffine3::IDENTITY, grey, None);
    scene.film.resolution = [16, 16];
    assert_eq!(image(&scene, 16, 1).record().rejected, 0);
}
