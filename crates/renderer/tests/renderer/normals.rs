//! Shading normals in images: those of vertices, bump maps and normal maps.
#![allow(clippy::print_stderr)]

use crate::statistics::{FAMILY, critical, sidak};
use crate::support::*;
use dapple_core::Film;
use dapple_low_discrepancy::Sobol;
use dapple_scene::image::Image;
use dapple_scene::{
    Color, Geometry, Light, LightKind, MaterialKind, MeshData, Roughness, Scalar, Scene, Texture, TextureId,
    TextureKind, Wrap,
};
use glam::{DAffine3, DVec3};
use std::f64::consts::{FRAC_1_PI, PI, TAU};
use std::sync::Arc;

const SEED: u64 = 12_000;

fn add_image(scene: &mut Scene, size: [u32; 2], pixels: Vec<[f32; 3]>, wrap: Wrap) -> TextureId {
    let image = Arc::new(Image::new(size, pixels).expect("as many as its size"));
    let (scale, shift) = ([1.0; 2], [0.0; 2]);
    let kind = TextureKind::Image { image, scale, shift, factor: 1.0, invert: false, wrap };
    scene.textures.push(Texture { name: "relief".into(), kind, source: line(300) });
    TextureId(scene.textures.len() as u32 - 1)
}

/// Numbers from -1 to 1 without a pattern.
fn noise(count: u32) -> Vec<[f32; 3]> {
    let number = |i: u32| (i.wrapping_mul(0x9e37_79b9) >> 8) as f32 / (1u32 << 23) as f32 - 1.0;
    (0..count).map(|i| [0, 1, 2].map(|c| number(3 * i + c + 1))).collect()
}

fn kinds() -> Vec<MaterialKind> {
    let white = Color::Constant([1.0; 3]);
    let roughness = Roughness::constant(0.2, 0.2, false);
    vec![
        diffuse(1.0),
        metal(0.0),
        metal(0.3),
        coated(0.8, 0.0),
        coated(0.8, 0.2),
        MaterialKind::Plastic { diffuse: white, specular: white, roughness },
        MaterialKind::Substrate { diffuse: white, specular: white, roughness },
    ]
}

/// A sheet that fills the view, of 8 x 8 squares with random vertex normals.
fn crumpled() -> Geometry {
    let corners = (0..81).map(|i| DVec3::new(f64::from(i % 9) - 4.0, f64::from(i / 9) - 4.0, 0.0));
    let squares = (0..64).map(|i| i / 8 * 9 + i % 8);
    Geometry::Mesh(Arc::new(MeshData {
        positions: corners.collect(),
        triangles: squares.flat_map(|a| [[a, a + 1, a + 10], [a, a + 10, a + 9]]).collect(),
        normals: noise(81),
        uvs: (0..81).map(|i| [(i % 9) as f32 / 8.0, (i / 9) as f32 / 8.0]).collect(),
    }))
}

/// The maps that tilt the normals of the sheet, besides its vertices.
#[derive(Clone, Copy, Debug)]
enum Tilt {
    Vertices,
    Bump,
    NormalMap,
}

/// The sheet between the camera above and a lamp. The lamp lies below without reaching past the sheet, or hangs above.
fn sheet(kind: MaterialKind, tilt: Tilt, lit_from_below: bool) -> Scene {
    let mut scene = scene([16, 16], 40.0, DVec3::new(0.0, -2.0, 3.0), DVec3::ZERO);
    let material = add_material(&mut scene, kind);
    let image = add_image(&mut scene, [16, 16], noise(256), Wrap::Repeat);
    match tilt {
        Tilt::Vertices => {}
        Tilt::Bump => scene.materials[0].bump = Some(Scalar::Texture(image)),
        Tilt::NormalMap => scene.materials[0].normal_map = Some(image),
    }
    add(&mut scene, crumpled(), DAffine3::IDENTITY, material, None);
    let black = add_material(&mut scene, diffuse(0.0));
    let lamp = match lit_from_below {
        true => rectangle(DVec3::new(0.0, 0.0, -1.0), DVec3::X, DVec3::Y),
        false => rectangle(DVec3::new(0.0, 0.0, 4.0), DVec3::Y, DVec3::X),
    };
    add(&mut scene, lamp, DAffine3::IDENTITY, black, Some(10.0));
    scene
}

fn sound(film: &Film) -> bool {
    film.record().rejected == 0 && film.image().iter().flatten().all(|&x| x.is_finite() && x >= 0.0)
}

/// No light crosses a sheet, whatever its shading normals. The negative control hangs the lamp above it.
#[test]
fn no_light_crosses_a_surface_l12() {
    for kind in kinds() {
        for tilt in [Tilt::Vertices, Tilt::Bump, Tilt::NormalMap] {
            let below = image(&sheet(kind.clone(), tilt, true), 16, SEED);
            assert!(sound(&below) && below.image().iter().all(|p| *p == [0.0; 3]), "{kind:?} {tilt:?}");
            let above = image(&sheet(kind.clone(), tilt, false), 16, SEED);
            assert!(sound(&above) && mean(&above)[0] > 1e-3, "{kind:?} {tilt:?}: {:?}", mean(&above));
        }
    }
}

/// Opposed, missing and equal normals, as in real files.
#[test]
fn bad_vertices_render_l12() {
    let MeshData { positions, triangles, .. } = match crumpled() {
        Geometry::Mesh(mesh) => mesh.as_ref().clone(),
        _ => unreachable!("it is a mesh"),
    };
    let up = |i: usize| if i.is_multiple_of(2) { [0.0, 0.0, 1.0] } else { [0.0, 0.0, -1.0] };
    let normals: [Vec<[f32; 3]>; 4] =
        [(0..81).map(up).collect(), vec![[0.0; 3]; 81], vec![[0.0, 0.0, -1.0]; 81], vec![[1.0, 0.0, -0.0]; 81]];
    for normals in normals {
        for kind in kinds() {
            let stretched = match kind {
                MaterialKind::Substrate { diffuse, specular, .. } => {
                    MaterialKind::Substrate { diffuse, specular, roughness: Roughness::constant(0.1, 0.5, false) }
                }
                other => other,
            };
            for tilt in [Tilt::Vertices, Tilt::Bump, Tilt::NormalMap] {
                let mut scene = sheet(stretched.clone(), tilt, false);
                let (positions, triangles) = (positions.clone(), triangles.clone());
                let mesh = MeshData { positions, triangles, normals: normals.clone(), uvs: vec![[0.5; 2]; 81] };
                scene.shapes[0].geometry = Geometry::Mesh(Arc::new(mesh));
                assert!(sound(&image(&scene, 4, SEED)), "{stretched:?} {tilt:?}");
            }
        }
    }
}

/// A diffuse floor of albedo 1/2, seen from straight above, under one far lamp in this direction.
fn floor(towards_light: DVec3) -> Scene {
    let mut scene = scene([8, 8], 20.0, DVec3::new(0.0, 0.0, 3.0), DVec3::ZERO);
    let material = add_material(&mut scene, diffuse(0.5));
    let Geometry::Mesh(mesh) = rectangle(DVec3::ZERO, 2.0 * DVec3::X, 2.0 * DVec3::Y) else {
        unreachable!("it is a mesh")
    };
    // u along x, v along y.
    let uvs = vec![[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    let mesh = Geometry::Mesh(Arc::new(MeshData { uvs, ..mesh.as_ref().clone() }));
    add(&mut scene, mesh, DAffine3::IDENTITY, material, None);
    let to_world = look_at(DVec3::ZERO, towards_light, DVec3::Z);
    scene.lights.push(Light { kind: LightKind::Distant { irradiance: [PI as f32; 3] }, to_world, source: line(200) });
    scene.max_depth = Some(1);
    scene
}

fn assert_floor(scene: &Scene, normal: DVec3, light: DVec3, what: &str) {
    let expected = 0.5 * FRAC_1_PI * PI * normal.dot(light).max(0.0);
    let film = image(scene, 4, SEED);
    for i in 0..film.frame().pixels() {
        let found = film.mean(i)[1];
        assert!((found - expected).abs() < 2e-3 * expected.max(0.1), "{what}, {light}: {found}, not {expected}");
    }
}

/// A constant slope shades like its normal.
#[test]
fn slopes_shade_like_their_normals_l12() {
    for light in [DVec3::new(0.3, 0.2, 1.0), DVec3::new(-0.6, 0.1, 0.7), DVec3::new(0.1, -0.8, 0.5)] {
        let light = light.normalize();
        assert_floor(&floor(light), DVec3::Z, light, "level");
        for [du, dv] in [[0.8, 0.0], [0.0, -1.2], [0.5, 0.9]] {
            // Heights of u and v from 0 to 1 over 64 pixels, 4 long; the border is out of view.
            let mut bumped = floor(light);
            let height = |i: u32| {
                let [u, v] = [i % 64, 63 - i / 64].map(|x| (f64::from(x) + 0.5) / 64.0);
                [(du * u + dv * v) as f32; 3]
            };
            let image = add_image(&mut bumped, [64, 64], (0..64 * 64).map(height).collect(), Wrap::Clamp);
            bumped.materials[0].bump = Some(Scalar::Texture(image));
            let normal = DVec3::new(-du / 4.0, -dv / 4.0, 1.0).normalize();
            assert_floor(&bumped, normal, light, "bump");
            // The same by a normal map, whose numbers are the normal's over 2, plus 0.5.
            let mut mapped = floor(light);
            let pixel = ((normal + 1.0) * 0.5).as_vec3().to_array();
            let image = add_image(&mut mapped, [1, 1], vec![pixel], Wrap::Repeat);
            mapped.materials[0].normal_map = Some(image);
            assert_floor(&mapped, normal, light, "normal map");
        }
    }
}

/// A ball of `rings` rings and twice as many columns, with the normals of a sphere or none.
fn ball(rings: u32, smooth: bool) -> Geometry {
    let columns = 2 * rings;
    let point = |ring: u32, column: u32| {
        let (theta, phi) = (PI * f64::from(ring) / f64::from(rings), TAU * f64::from(column) / f64::from(columns));
        DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos())
    };
    let positions: Vec<DVec3> = (0..=rings).flat_map(|r| (0..=columns).map(move |c| point(r, c))).collect();
    let squares = (0..rings).flat_map(|r| (0..columns).map(move |c| r * (columns + 1) + c));
    let triangles = squares.flat_map(|a| {
        let b = a + columns + 1;
        [[a, b, b + 1], [a, b + 1, a + 1]]
    });
    let normals = if smooth { positions.iter().map(|p| p.as_vec3().to_array()).collect() } else { vec![] };
    Geometry::Mesh(Arc::new(MeshData { triangles: triangles.collect(), positions, normals, uvs: vec![] }))
}

/// The width of the terminator's image.
const SIDE: u32 = 40;
/// Rings of the coarse ball: triangles of 1.5 pixels.
const RINGS: u32 = 40;

/// Replicates of a ball of radius 1 that fills the view, lit from the right.
fn lit(geometry: Geometry) -> Vec<Film> {
    let mut scene = scene([SIDE; 2], 2.0 * (0.1_f64).asin().to_degrees(), DVec3::new(0.0, -10.0, 0.0), DVec3::ZERO);
    let grey = add_material(&mut scene, diffuse(0.8));
    add(&mut scene, geometry, DAffine3::IDENTITY, grey, None);
    let black = add_material(&mut scene, diffuse(0.0));
    let lamp = Geometry::Sphere { radius: 3.0 };
    add(&mut scene, lamp, DAffine3::from_translation(DVec3::new(20.0, 0.0, 0.0)), black, Some(10.0));
    scene.max_depth = Some(1);
    let world = world(&scene);
    (0..12).map(|r| film_of(&world, [SIDE; 2], 16, Sobol::new(SEED + r))).collect()
}

/// The largest deviation of a pixel outside a band of two pixels about the terminator and the rim, and the number of
/// such pixels. The lamp's angular radius is 8.6 degrees. It sets where the ball turns away from it by up to this angle
/// on either side.
fn deviation(a: &[Film], b: &[Film]) -> (f64, usize) {
    let half = f64::from(SIDE) / 2.0;
    let (mut worst, mut tests) = (0.0_f64, 0);
    for i in 0..SIDE * SIDE {
        let [x, y] = [i % SIDE, i / SIDE].map(|p| f64::from(p) + 0.5 - half);
        let setting = half * (3.0_f64 / 20.0) + 2.0;
        if x.hypot(y) > half - 2.0 || x.abs() < setting {
            continue;
        }
        let of = |films: &[Film]| summary(films.iter().map(|f| f.mean(i as usize)[1]));
        worst = worst.max(welch(of(a), of(b)).unwrap_or(0.0));
        tests += 1;
    }
    (worst, tests)
}

/// A coarse ball with smooth normals looks round. Triangles that turn from the light before their normals leave no
/// black specks beyond a band of two pixels. Negative control: without the normals they do.
#[test]
fn the_terminator_of_a_coarse_ball_shows_no_facets_l12() {
    let fine = lit(Geometry::Sphere { radius: 1.0 });
    let [smooth, flat] = [true, false].map(|smooth| lit(ball(RINGS, smooth)));
    assert!(smooth.iter().all(sound));
    let (found, tests) = deviation(&smooth, &fine);
    let (control, _) = deviation(&flat, &fine);
    let allowed = critical(sidak(FAMILY, tests) / 2.0);
    eprintln!("{tests} pixels: {found:.2} smooth, {control:.2} flat, {allowed:.2} allowed");
    assert!(tests > 500 && found < allowed && control > allowed, "{found} {control}");
}
