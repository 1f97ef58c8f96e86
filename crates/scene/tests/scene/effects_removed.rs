//! Scenes without an effect: the lights in place of lamps, the means in place of textures.

use crate::support::*;
use dapple_scene::image::Image;
use dapple_scene::{Color, Effect, Geometry, Light, LightKind, MaterialKind, MeshData, Scalar, Scene, Texture};
use dapple_scene::{TextureId, TextureKind, Wrap};
use glam::{DAffine3, DVec3};
use std::f64::consts::PI;
use std::sync::Arc;

fn without(scene: &Scene, effect: Effect) -> Scene {
    scene.without(effect, &|_| None).expect("a light is left")
}

/// The intensity per radiance of the only light in place of a lamp, its place, and its axis.
fn light_of(geometry: Geometry, to_world: DAffine3) -> (f64, DVec3, Option<DVec3>) {
    let mut scene = scene([4, 4], 40.0, DVec3::Y, DVec3::ZERO);
    let grey = add_material(&mut scene, diffuse(0.5));
    let lamp = add(&mut scene, geometry, to_world, grey, None);
    assert!(without(&scene, Effect::SoftShadows).lights.is_empty(), "dark");
    scene.shapes[lamp].emission = Some(dapple_scene::Emission::even([1.0, 2.0, 3.0], false));
    let scene = without(&scene, Effect::SoftShadows);
    let [Light { kind, to_world, .. }] = &scene.lights[..] else { panic!("{:?}", scene.lights) };
    let (intensity, axis) = match kind {
        LightKind::Point { intensity } => (intensity, None),
        LightKind::Spot { intensity, .. } => (intensity, Some(to_world.matrix3.z_axis)),
        other => panic!("{other:?}"),
    };
    let [r, g, b] = intensity.map(f64::from);
    assert!((g - 2.0 * r).abs() < 1e-5 && (b - 3.0 * r).abs() < 1e-5, "{intensity:?}");
    (r, to_world.translation, axis)
}

#[test]
fn areas_middles_and_sides() {
    let at = DAffine3::from_translation(DVec3::new(1.0, 2.0, 3.0)) * DAffine3::from_scale(DVec3::splat(2.0));
    // A point of the power of a sphere of area 4 pi.
    let (intensity, place, axis) = light_of(Geometry::Sphere { radius: 0.5 }, at);
    assert!((intensity - PI).abs() < 1e-6 && axis.is_none(), "{intensity}");
    assert_eq!(place, DVec3::new(1.0, 2.0, 3.0));
    let (area, place, axis) = light_of(Geometry::Disk { height: 1.0, radius: 0.5, inner_radius: 0.25 }, at);
    assert!((area - PI * (1.0 - 0.25)).abs() < 1e-6, "{area}");
    assert_eq!((place, axis), (DVec3::new(1.0, 2.0, 5.0), Some(DVec3::Z)));

    // Two triangles of areas 2 and 1, of which the middle is nearer to the larger.
    let positions = [[0.0, 0.0], [2.0, 0.0], [0.0, 2.0], [3.0, 0.0], [4.0, 0.0], [3.0, 2.0]];
    let positions = positions.map(|[x, y]| DVec3::new(x, y, 0.0)).to_vec();
    let triangles = vec![[0, 1, 2], [3, 4, 5]];
    let mesh = Geometry::Mesh(Arc::new(MeshData { positions, triangles, ..MeshData::default() }));
    let up = |axis: Option<DVec3>| axis.is_some_and(|axis| (axis - DVec3::Z).length() < 1e-12);
    let (area, place, axis) = light_of(mesh.clone(), DAffine3::IDENTITY);
    assert!((area - 3.0).abs() < 1e-6 && up(axis), "{area} {axis:?}");
    let middle = (2.0 * DVec3::new(2.0, 2.0, 0.0) + DVec3::new(10.0, 2.0, 0.0)) / 9.0;
    assert!((place - middle).length() < 1e-12, "{place}");
    // A mirror does not turn the side.
    assert!(up(light_of(mesh, DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0))).2));
}

#[test]
fn means_of_nested_textures() {
    // Top row 0.1 0.2, bottom row 0.3 0.4.
    let pixels = [0.1, 0.2, 0.3, 0.4].map(|v| [v, 2.0 * v, 0.0]).to_vec();
    let image = Arc::new(Image::new([2, 2], pixels).expect("four pixels"));
    let (scale, shift, wrap) = ([1.0; 2], [0.0; 2], Wrap::Repeat);
    let image = TextureKind::Image { image, scale, shift, factor: 1.0, invert: false, wrap };
    let (half, dot) = (Color::Constant([0.5; 3]), Color::Texture(TextureId(0)));
    let colors = [half, Color::Constant([0.1; 3])];
    let mut scene = scene([4, 4], 40.0, DVec3::Y, DVec3::ZERO);
    for kind in [
        image.clone(),
        image,
        TextureKind::Product { factors: [half, dot] },
        TextureKind::Mix { colors: [half, dot], amount: Scalar::Texture(TextureId(0)) },
        TextureKind::Checkerboard { scale, shift, colors },
    ] {
        let reflectance = Color::Texture(TextureId(scene.textures.len() as u32));
        scene.textures.push(Texture { name: String::new(), kind, source: line(300) });
        let material = add_material(&mut scene, MaterialKind::Diffuse { reflectance });
        add(&mut scene, Geometry::Sphere { radius: 1.0 }, DAffine3::IDENTITY, material, None);
    }
    let flat = without(&scene, Effect::Textures);
    for (material, mean) in flat.materials.iter().zip([0.25, 0.25, 0.125, 0.4375, 0.3]) {
        let MaterialKind::Diffuse { reflectance: Color::Constant(found) } = material.kind else {
            panic!("{material:?}")
        };
        assert!((found[0] - mean).abs() < 1e-6, "{found:?} {mean}");
    }
}
