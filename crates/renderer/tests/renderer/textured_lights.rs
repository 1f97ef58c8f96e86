//! Lamps whose emission is a texture, surfaces that only the camera sees, and vertex colours.

use crate::support::*;
use dapple_geometry::Ray;
use dapple_renderer::light::Target;
use std::f32::consts::FRAC_1_PI;

/// The number of tests of means in this file, which determines the false-alarm rate of each.
const TESTS: usize = 32;

/// 4x4 texels in row-major order from the top: some are black, and one is bright.
const TEXELS: [f32; 16] = [0.0, 0.0, 1.0, 2.0, 0.5, 0.0, 0.0, 0.0, 8.0, 0.0, 0.25, 0.0, 1.0, 1.0, 0.0, 0.5];

/// Returns a square `[-1, 1]^2` at height 1 that emits downwards: a grid of `side * side` squares of two triangles each.
fn panel(side: u32) -> MeshData {
    let mut mesh = MeshData::default();
    let at = |k: u32| f64::from(k) / f64::from(side);
    for (i, j) in (0..=side).flat_map(|j| (0..=side).map(move |i| (i, j))) {
        mesh.positions.push(DVec3::new(2.0 * at(i) - 1.0, 2.0 * at(j) - 1.0, 1.0));
        mesh.uvs.push([at(i) as f32, at(j) as f32]);
    }
    let vertex = |i: u32, j: u32| j * (side + 1) + i;
    for (i, j) in (0..side).flat_map(|j| (0..side).map(move |i| (i, j))) {
        let [a, b, c, d] = [vertex(i, j), vertex(i, j + 1), vertex(i + 1, j + 1), vertex(i + 1, j)];
        mesh.triangles.extend([[a, b, c], [a, c, d]]);
    }
    mesh
}

/// The panel with a texture that multiplies a radiance of 3.
fn lit(side: u32, two_sided: bool) -> Scene {
    let mut scene = scene([8, 8], 40.0, DVec3::new(0.0, -3.0, -2.0), DVec3::new(0.0, 0.0, -1.0));
    let black = add_material(&mut scene, diffuse(0.0));
    let image = grey_image([4, 4], |x, y| TEXELS[(4 * y + x) as usize]);
    let kind =
        TextureKind::Image { image, scale: [1.0; 2], shift: [0.0; 2], factor: 1.0, invert: false, wrap: Wrap::Clamp };
    let texture = add_texture(&mut scene, "panel", kind);
    let number = add(&mut scene, Geometry::Mesh(Arc::new(panel(side))), DAffine3::IDENTITY, black, None);
    scene.shapes[number].emission = Some(Emission { texture: Some(texture), ..Emission::even([3.0; 3], two_sided) });
    scene
}

/// The radiance at a place of the panel, by bilinear interpolation between the centres of texels.
fn expected(x: f32, y: f32) -> f32 {
    let [u, v] = [2.0 * x + 1.5, 1.5 - 2.0 * y];
    let texel = |i: f32, j: f32| TEXELS[(4.0 * j.clamp(0.0, 3.0) + i.clamp(0.0, 3.0)) as usize];
    let ([i, j], [a, b]) = ([u.floor(), v.floor()], [u - u.floor(), v - v.floor()]);
    let row = |j: f32| texel(i, j) * (1.0 - a) + texel(i + 1.0, j) * a;
    3.0 * (row(j) * (1.0 - b) + row(j + 1.0) * b)
}

/// A ray from a place in the scene file's space.
fn ray(world: &World, from: DVec3, direction: Vec3) -> Ray {
    Ray::new(world.space().point(from).as_vec3(), direction)
}

#[test]
fn rays_see_the_texel_that_they_hit() {
    for side in [1, 3] {
        let world = world(&lit(side, false));
        for (x, y) in (0..40).map(|k| (0.049 * k as f32 - 0.95, (0.37 * k as f32).sin() * 0.95)) {
            let up = ray(&world, DVec3::new(f64::from(x), f64::from(y), 0.0), Vec3::Z);
            let found = world.emitter(&up).expect("the panel").radiance.x;
            assert!((found - expected(x, y)).abs() < 1e-4, "{x} {y} of {side}: {found}, not {}", expected(x, y));
            let down = ray(&world, DVec3::new(f64::from(x), f64::from(y), 2.0), Vec3::NEG_Z);
            assert_eq!(world.emitter(&down).expect("the panel").radiance, Vec3::ZERO, "the dark side");
        }
    }
}

/// Returns the irradiance at a point with an upward normal, by light sampling and by cosine-weighted directions.
fn irradiances(world: &World, from: DVec3, samples: u64, seed: u64) -> [Mean; 2] {
    let mut random = Pcg32::seed_from_u64(seed);
    let point = world.space().point(from).as_vec3();
    let sampled = |random: &mut Pcg32| {
        let sample = world.lights().sample(point, random.random(), random.random());
        sample.map_or(0.0, |light| f64::from(light.radiance.x * light.wi.z.max(0.0) / light.pdf))
    };
    let hit = |random: &mut Pcg32| {
        // Directions follow the cosine.
        let wi = dapple_renderer::shading::warp::cosine_hemisphere(random.random());
        let found = world.emitter(&Ray::new(point, wi));
        found.map_or(0.0, |found| f64::from(found.radiance.x) * PI)
    };
    [(0..samples).map(|_| sampled(&mut random)).collect(), (0..samples).map(|_| hit(&mut random)).collect()]
}

/// Points below the middle, beside it, so near that triangles are sampled by solid angle, and far away.
const PLACES: [DVec3; 4] =
    [DVec3::new(0.0, 0.0, 0.0), DVec3::new(1.4, -0.3, 0.5), DVec3::new(-0.6, -0.2, 0.9), DVec3::new(0.2, 0.5, -2.5)];

/// False alarms: `FAMILY` for all tests of this file. Negative control: a lamp of the same mean, without its texture, has
/// another irradiance at some of these points.
#[test]
fn a_textured_lamp_sampled_is_the_lamp_hit() {
    let z = critical(sidak(FAMILY, TESTS));
    let mut differ = 0;
    for side in [1, 4] {
        let textured = world(&lit(side, false));
        let mut flat = lit(side, false);
        let mean = TEXELS.iter().sum::<f32>() / 16.0;
        flat.shapes[0].emission = Some(Emission::even([3.0 * mean; 3], false));
        let flat = world(&flat);
        for (seed, from) in PLACES.into_iter().enumerate() {
            let [sampled, hit] = irradiances(&textured, from, 200_000, seed as u64);
            let off = sampled.against_estimate(&hit).z().abs();
            assert!(off < z, "{side} at {from}: {sampled:?}, {hit:?}");
            differ +=
                usize::from(irradiances(&flat, from, 200_000, seed as u64)[0].against_estimate(&hit).z().abs() > z);
        }
    }
    assert!(differ >= 6, "a lamp without its texture is told from one with it {differ} times of 8");
}

/// The density of a direction equals the density of the sample, and integrates to 1 over all directions to the lamp.
#[test]
fn densities_of_textured_lamps_are_those_of_their_samples() {
    let z = critical(sidak(FAMILY, TESTS));
    for (seed, from) in PLACES.into_iter().enumerate() {
        let world = world(&lit(4, false));
        let (lights, point) = (world.lights(), world.space().point(from).as_vec3());
        let mut random = Pcg32::seed_from_u64(seed as u64);
        let mut number = 0;
        for _ in 0..2000 {
            let Some(sample) = lights.sample(point, random.random(), random.random()) else { continue };
            let Target::Surface(on) = &sample.target else { panic!("a surface") };
            let pdf = lights.pdf(0, point, on);
            assert!((pdf / sample.pdf - 1.0).abs() < 1e-3, "{pdf} {sample:?}");
            number += 1;
        }
        assert!(number > 500, "{number} samples with light");
        let found: Mean = (0..200_000)
            .map(|_| {
                let wi = dapple_renderer::shading::warp::cosine_hemisphere(random.random());
                let hit = world.emitter(&Ray::new(point, wi));
                hit.map_or(0.0, |hit| f64::from(lights.pdf(0, point, &hit.point) / (wi.z * FRAC_1_PI)))
            })
            .collect();
        let off = (found.mean - 1.0) / found.standard_error();
        assert!(off.abs() < z, "{from}: {found:?}");
    }
}

/// The flux of emitted rays is pi times area times mean radiance on each side. Negative control: 3 % more.
#[test]
fn rays_that_leave_a_textured_lamp_carry_its_power() {
    let mean = 3.0 * f64::from(TEXELS.iter().sum::<f32>()) / 16.0;
    for two_sided in [false, true] {
        // Clamped edges widen the outer texels: the mean is that of the interpolated image.
        let points = (0..400).flat_map(|i| (0..400).map(move |j| [i, j].map(|k| (k as f32 + 0.5) / 200.0 - 1.0)));
        let interpolated = points.map(|[x, y]| f64::from(expected(x, y))).sum::<f64>() / 160_000.0;
        assert!((interpolated / mean - 1.0).abs() < 0.3, "{interpolated} {mean}");
        let world = world(&lit(4, two_sided));
        let unit = world.space().scale().powi(2);
        let mut random = Pcg32::seed_from_u64(5);
        let mut flux = || {
            let ray = world.lights().sample_emission(random.random(), random.random(), random.random());
            let Some(ray) = ray else { return 0.0 };
            let Target::Surface(point) = &ray.source else { panic!("a surface") };
            let pdf = world.lights().emission_pdf(0, point, ray.direction);
            assert!((pdf.position / ray.pdf.position - 1.0).abs() < 1e-3, "{pdf:?} {ray:?}");
            f64::from(ray.flux().x) / unit
        };
        let found: Mean = (0..400_000).map(|_| flux()).collect();
        let expected = PI * 4.0 * interpolated * if two_sided { 2.0 } else { 1.0 };
        let off = |expected: f64| ((found.mean - expected) / found.standard_error()).abs();
        let z = critical(sidak(FAMILY, TESTS));
        assert!(off(expected) < z && off(1.03 * expected) > z, "{found:?}, not {expected}");
        assert!((world.lights().power(0) / unit / expected - 1.0).abs() < 0.01, "{}", world.lights().power(0));
    }
}

#[test]
fn spheres_with_emissive_textures_are_refused() {
    let mut scene = lit(1, false);
    scene.shapes[0].geometry = Geometry::Sphere { radius: 1.0 };
    let message = refusal(&scene);
    assert!(message.contains("made.pbrt:10: a sphere cannot emit a texture; use a mesh"), "{message}");
}

/// Returns an unlit plate in front of a lamp and above a floor, with a mirror behind it.
fn with_plate(plate: Option<MaterialKind>) -> Scene {
    let mut scene = ground([48, 32]);
    let black = add_material(&mut scene, diffuse(0.0));
    crate::support::plate(&mut scene, [2.0 * DVec3::Z, 0.3 * DVec3::Y, 0.3 * DVec3::X], black, Some(8.0));
    let mirror = add_material(&mut scene, metal(0.0));
    crate::support::plate(&mut scene, [DVec3::new(0.0, 1.0, 0.5), DVec3::X, 0.5 * DVec3::Z], mirror, None);
    if let Some(kind) = plate {
        let material = add_material(&mut scene, kind);
        crate::support::plate(&mut scene, [DVec3::new(0.0, 0.0, 1.0), 0.4 * DVec3::X, 0.4 * DVec3::Y], material, None);
    }
    scene
}

#[test]
fn an_unlit_surface_is_seen_and_changes_nothing_else() {
    let color = [0.75, 0.5, 0.25];
    let unlit = MaterialKind::Unlit { color: Color::Constant(color) };
    let seen = pixels(&image(&with_plate(Some(unlit)), 16, 3));
    let without = pixels(&image(&with_plate(None), 16, 3));
    let close = |a: &[f64; 3], b: &[f64; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 1e-4 * (a + b) + 1e-6);
    let shows = |p: &[f64; 3]| close(p, &color.map(f64::from));
    let full = seen.iter().filter(|p| shows(p)).count();
    let same = seen.iter().zip(&without).filter(|(a, b)| close(a, b)).count();
    assert!(full > 20 && same > 1400, "{full} pixels see the plate alone, {same} of {} are as without", seen.len());
    // Pixels at the plate's edge have part of it; a plate has no more than its outline.
    assert!(full + same > seen.len() - 60, "{full} and {same} of {}", seen.len());
    // Negative control: a matte plate of the same colour shades the floor.
    let matte = MaterialKind::Diffuse { reflectance: Color::Constant(color) };
    let shaded = pixels(&image(&with_plate(Some(matte)), 16, 3));
    assert!(shaded.iter().zip(&without).filter(|(a, b)| close(a, b)).count() < same - 50);
}

#[test]
fn the_albedo_of_an_unlit_surface_is_its_colour() {
    let color = [0.75, 0.5, 0.25];
    let world = world(&with_plate(Some(MaterialKind::Unlit { color: Color::Constant(color) })));
    let down = ray(&world, DVec3::new(0.38, 0.38, 1.5), Vec3::NEG_Z);
    let at = world.closest_hit(&down, 0.0).expect("the plate");
    assert_eq!(world.first_hit(&down, &at, 0.0).albedo, color);
    assert!(world.scattering(&at, || [0.5; 2]).is_none(), "other rays pass");
}

#[test]
fn vertex_colours_are_interpolated_and_multiply_textures() {
    let colors = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.5, 0.5, 0.5]];
    let mut scene = empty([4, 4]);
    let Geometry::Mesh(mesh) = rectangle(DVec3::ZERO, DVec3::X, DVec3::Y) else { panic!("a mesh") };
    let vertex = add_texture(&mut scene, "vertex", TextureKind::VertexColor);
    let factors = [Color::Constant([0.5, 1.0, 1.0]), Color::Texture(vertex)];
    let product = add_texture(&mut scene, "product", TextureKind::Product { factors });
    let material = add_material(&mut scene, MaterialKind::Diffuse { reflectance: Color::Texture(product) });
    let colored = MeshData { colors: colors.to_vec(), ..(*mesh).clone() };
    add(&mut scene, Geometry::Mesh(Arc::new(colored)), DAffine3::IDENTITY, material, None);
    // A shape without vertex colours counts as white.
    add(&mut scene, Geometry::Mesh(mesh), at(0.0, 0.0, -1.0), material, None);
    add_sky(&mut scene, 1.0);
    let world = world(&scene);
    let albedo = |x: f64, y: f64, z: f64| {
        let down = ray(&world, DVec3::new(x, y, z), Vec3::NEG_Z);
        let at = world.closest_hit(&down, 0.0).expect("a hit");
        world.bsdf(&at, 0.0).0.albedo()
    };
    for (x, y, expected) in [
        (-0.999, -0.999, [0.5, 0.0, 0.0]),
        (0.999, -0.999, [0.0, 1.0, 0.0]),
        (0.999, 0.999, [0.0, 0.0, 1.0]),
        (0.9995, 0.0, [0.0, 0.5, 0.5]),
        (0.0, 0.0, [0.25, 0.0, 0.5]),
    ] {
        let found = albedo(x, y, 1.0);
        assert!((found - Vec3::from_array(expected)).length() < 3e-3, "{x} {y}: {found}");
    }
    assert_eq!(albedo(0.1, 0.2, -0.5), Vec3::new(0.5, 1.0, 1.0));
}
