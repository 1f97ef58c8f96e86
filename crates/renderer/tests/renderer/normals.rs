//! Shading normals in images: vertex normals, bump maps and normal maps.
#![allow(clippy::print_stderr)]

use crate::support::*;

const SEED: u64 = 12_000;

fn relief(scene: &mut Scene, size: [u32; 2], pixels: Vec<[f32; 3]>, wrap: Wrap) -> TextureId {
    let image = Arc::new(Image::new(size, pixels).expect("as many as its size"));
    let (scale, shift) = ([1.0; 2], [0.0; 2]);
    add_texture(scene, "relief", TextureKind::Image { image, scale, shift, factor: 1.0, invert: false, wrap })
}

/// Returns pseudorandom numbers from -1 to 1.
fn noise(count: u32) -> Vec<[f32; 3]> {
    let number = |i: u32| (i.wrapping_mul(0x9e37_79b9) >> 8) as f32 / (1u32 << 23) as f32 - 1.0;
    (0..count).map(|i| [0, 1, 2].map(|c| number(3 * i + c + 1))).collect()
}

/// Returns materials of several kinds; the substrate has these microfacet widths.
fn kinds(u: f32, v: f32) -> Vec<MaterialKind> {
    let white = Color::Constant([1.0; 3]);
    let roughness = Roughness::constant(u, v, false);
    vec![
        diffuse(1.0),
        metal(0.0),
        metal(0.3),
        coated(0.8, 0.0),
        coated(0.8, 0.2),
        MaterialKind::Plastic { diffuse: white, specular: white, roughness: Roughness::constant(0.2, 0.2, false) },
        MaterialKind::Substrate { diffuse: white, specular: white, roughness },
    ]
}

/// Returns a mesh of `side[0]` x `side[1]` squares over a grid of points, with texture coordinates from 0 to 1.
fn grid(side: [u32; 2], point: impl Fn(u32, u32) -> DVec3, normals: Vec<[f32; 3]>) -> MeshData {
    let columns = side[0] + 1;
    let points = (0..columns * (side[1] + 1)).map(|i| (i % columns, i / columns));
    let squares = (0..side[0] * side[1]).map(|i| i / side[0] * columns + i % side[0]);
    let uv = |(x, y): (u32, u32)| [x as f32 / side[0] as f32, y as f32 / side[1] as f32];
    let triangles = squares.flat_map(|a| [[a, a + 1, a + columns + 1], [a, a + columns + 1, a + columns]]).collect();
    let positions = points.clone().map(|(x, y)| point(x, y)).collect();
    MeshData { positions, triangles, normals, uvs: points.map(uv).collect(), ..MeshData::default() }
}

/// The maps that tilt the normals of the sheet, in addition to vertex normals.
#[derive(Clone, Copy, Debug)]
enum Tilt {
    Vertices,
    Bump,
    NormalMap,
}

const TILTS: [Tilt; 3] = [Tilt::Vertices, Tilt::Bump, Tilt::NormalMap];

/// Returns a sheet with these vertex normals that fills the view of a camera above. A lamp is below and hidden by the sheet, or
/// above.
fn sheet(kind: MaterialKind, tilt: Tilt, normals: Vec<[f32; 3]>, is_lit_from_below: bool) -> Scene {
    let mut scene = scene([16, 16], 40.0, DVec3::new(0.0, -2.0, 3.0), DVec3::ZERO);
    let material = add_material(&mut scene, kind);
    let image = relief(&mut scene, [16, 16], noise(256), Wrap::Repeat);
    match tilt {
        Tilt::Vertices => {}
        Tilt::Bump => scene.materials[0].bump = Some(Scalar::Texture(image)),
        Tilt::NormalMap => scene.materials[0].normal_map = Some(image),
    }
    let mesh = grid([8, 8], |x, y| DVec3::new(f64::from(x) - 4.0, f64::from(y) - 4.0, 0.0), normals);
    add(&mut scene, Geometry::Mesh(Arc::new(mesh)), DAffine3::IDENTITY, material, None);
    let black = add_material(&mut scene, diffuse(0.0));
    let lamp = match is_lit_from_below {
        true => [-DVec3::Z, DVec3::X, DVec3::Y],
        false => [4.0 * DVec3::Z, DVec3::Y, DVec3::X],
    };
    plate(&mut scene, lamp, black, Some(10.0));
    scene
}

fn sound(film: &Film) -> bool {
    film.record().rejected == 0 && film.image().iter().flatten().all(|&x| x.is_finite() && x >= 0.0)
}

/// No light crosses a sheet, whatever its shading normals. Negative control: a lamp above the sheet lights it.
#[test]
fn no_light_crosses_a_surface_l12() {
    for (kind, tilt) in kinds(0.2, 0.2).into_iter().flat_map(|kind| TILTS.map(|tilt| (kind.clone(), tilt))) {
        let [below, above] = [true, false].map(|side| image(&sheet(kind.clone(), tilt, noise(81), side), 16, SEED));
        assert!(sound(&below) && below.image().iter().all(|p| *p == [0.0; 3]), "{kind:?} {tilt:?}");
        assert!(sound(&above) && mean(&above)[0] > 1e-3, "{kind:?} {tilt:?}: {:?}", mean(&above));
    }
}

/// The cases are opposed, missing and equal normals with equal texture coordinates, as in real files.
#[test]
fn bad_vertices_render_l12() {
    let opposed = (0..81).map(|i| [0.0, 0.0, if i % 2 == 0 { 1.0 } else { -1.0 }]).collect();
    for normals in [opposed, vec![[0.0; 3]; 81], vec![[0.0, 0.0, -1.0]; 81], vec![[1.0, 0.0, -0.0]; 81]] {
        for (kind, tilt) in kinds(0.1, 0.5).into_iter().flat_map(|kind| TILTS.map(|tilt| (kind.clone(), tilt))) {
            let mut scene = sheet(kind.clone(), tilt, normals.clone(), false);
            let Geometry::Mesh(mesh) = &mut scene.shapes[0].geometry else { unreachable!("it is a mesh") };
            Arc::make_mut(mesh).uvs = vec![[0.5; 2]; 81];
            assert!(sound(&image(&scene, 4, SEED)), "{kind:?} {tilt:?}");
        }
    }
}

/// A bump map or normal map of constant slope is shaded like its normal. The scene is a diffuse floor of albedo 1/2 under one
/// far lamp, seen from above.
#[test]
fn slopes_shade_like_their_normals_l12() {
    let lights = [[0.3, 0.2, 1.0], [-0.6, 0.1, 0.7], [0.1, -0.8, 0.5]].map(|light| DVec3::from(light).normalize());
    for (light, [du, dv]) in
        lights.into_iter().flat_map(|light| [[0.0, 0.0], [0.8, 0.0], [0.0, -1.2], [0.5, 0.9]].map(|d| (light, d)))
    {
        let mut floor = scene([8, 8], 20.0, DVec3::new(0.0, 0.0, 3.0), DVec3::ZERO);
        let material = add_material(&mut floor, diffuse(0.5));
        // u along x, v along y.
        let mesh = grid([1, 1], |x, y| DVec3::new(4.0 * f64::from(x) - 2.0, 4.0 * f64::from(y) - 2.0, 0.0), vec![]);
        add(&mut floor, Geometry::Mesh(Arc::new(mesh)), DAffine3::IDENTITY, material, None);
        let towards = look_at(DVec3::ZERO, light, DVec3::Z);
        add_light(&mut floor, LightKind::Distant { irradiance: [PI as f32; 3] }, towards);
        floor.max_depth = Some(1);
        // Heights of u and v from 0 to 1 over 64 pixels, 4 long; the border is out of view.
        let mut bumped = floor.clone();
        let height = |i: u32| {
            let [u, v] = [i % 64, 63 - i / 64].map(|x| (f64::from(x) + 0.5) / 64.0);
            [(du * u + dv * v) as f32; 3]
        };
        let image = relief(&mut bumped, [64, 64], (0..64 * 64).map(height).collect(), Wrap::Clamp);
        bumped.materials[0].bump = Some(Scalar::Texture(image));
        let normal = DVec3::new(-du / 4.0, -dv / 4.0, 1.0).normalize();
        // The same by a normal map, whose numbers are the normal's over 2, plus 0.5.
        let mut mapped = floor.clone();
        let pixel = ((normal + 1.0) * 0.5).as_vec3().to_array();
        mapped.materials[0].normal_map = Some(relief(&mut mapped, [1, 1], vec![pixel], Wrap::Repeat));
        for (what, scene, normal) in [("level", floor, DVec3::Z), ("bump", bumped, normal), ("map", mapped, normal)] {
            let expected = 0.5 * normal.dot(light).max(0.0);
            let near = |p: &[f64; 3]| (p[1] - expected).abs() < 2e-3 * expected.max(0.1);
            let film = crate::support::image(&scene, 4, SEED);
            assert!(pixels(&film).iter().all(near), "{what}, {light}, {du} {dv}: not {expected}");
        }
    }
}

/// The width of the terminator's image.
const SIDE: u32 = 40;

/// A coarse sphere with smooth normals looks round: its triangles of 1.5 pixels leave no black pixels farther than two pixels
/// from the terminator and the rim. Negative control: without normals, they do.
#[test]
fn the_terminator_of_a_coarse_ball_shows_no_facets_l12() {
    let coarse = |smooth: bool| {
        let point = |column: u32, ring: u32| {
            let (theta, phi) = (PI * f64::from(ring) / 40.0, TAU * f64::from(80 - column) / 80.0);
            DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos())
        };
        let mut mesh = grid([80, 40], point, vec![]);
        if smooth {
            mesh.normals = mesh.positions.iter().map(|p| p.as_vec3().to_array()).collect();
        }
        Geometry::Mesh(Arc::new(MeshData { uvs: vec![], ..mesh }))
    };
    // Replicates of a ball of radius 1 that fills the view, lit from the right.
    let [fine, smooth, flat] = [Geometry::Sphere { radius: 1.0 }, coarse(true), coarse(false)].map(|geometry| {
        let mut scene = scene([SIDE; 2], 2.0 * (0.1_f64).asin().to_degrees(), DVec3::new(0.0, -10.0, 0.0), DVec3::ZERO);
        let grey = add_material(&mut scene, diffuse(0.8));
        add(&mut scene, geometry, DAffine3::IDENTITY, grey, None);
        let black = add_material(&mut scene, diffuse(0.0));
        ball(&mut scene, DVec3::new(20.0, 0.0, 0.0), 3.0, black, Some(10.0));
        scene.max_depth = Some(1);
        replicates(&world(&scene), [SIDE; 2], 16, SEED)
    });
    // The lamp's angular radius is 8.6 degrees. It sets where the ball turns away from it by up to this angle on either
    // side.
    let half = f64::from(SIDE) / 2.0;
    let is_seen = |i: &u32| {
        let [x, y] = [i % SIDE, i / SIDE].map(|p| f64::from(p) + 0.5 - half);
        x.hypot(y) <= half - 2.0 && x.abs() >= half * (3.0_f64 / 20.0) + 2.0
    };
    let deviation = |a: &[Film], b: &[Film]| {
        let of = |i: u32| {
            let [a, b] = [a, b].map(|films| films.iter().map(|f| f.mean(i as usize)[1]).collect::<Mean>());
            a.against_estimate(&b).z().abs()
        };
        (0..SIDE * SIDE).filter(is_seen).map(of).fold(0.0, f64::max)
    };
    let tests = (0..SIDE * SIDE).filter(is_seen).count();
    let (found, control) = (deviation(&smooth, &fine), deviation(&flat, &fine));
    let allowed = critical(sidak(FAMILY, tests) / 2.0);
    eprintln!("{tests} pixels: {found:.2} smooth, {control:.2} flat, {allowed:.2} allowed");
    assert!(smooth.iter().all(sound) && tests > 500 && found < allowed && control > allowed, "{found} {control}");
}
