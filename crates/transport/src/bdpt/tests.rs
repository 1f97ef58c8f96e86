//! Each strategy alone, and all together, find the path tracer's light. The weights of all that can make one path sum to one.
#![allow(clippy::print_stderr, reason = "figures of tests")]

use super::vertex::{From, Kind, Vertex};
use super::weights::Ends;
use super::{Bdpt, BdptOptions};
use crate::support::*;
use dapple_core::{Estimate, Options as _, PointSet};
use dapple_low_discrepancy::Random;

/// A change of weights, for tests of single strategies and as an injected error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Fault {
    None,
    /// Only the strategy with these numbers of vertices, unweighted.
    Only {
        s: usize,
        t: usize,
    },
    /// Weights of light sampling (s = 1) are too large by this share.
    Sampled(f32),
}

impl Fault {
    pub(super) fn applied(self, weight: f32, s: usize, t: usize) -> f32 {
        match self {
            Self::None => weight,
            Self::Only { s: only_s, t: only_t } => f32::from(u8::from(s == only_s && t == only_t)),
            Self::Sampled(share) => weight * if s == 1 { 1.0 + share } else { 1.0 },
        }
    }
}

fn bdpt<'w>(world: &'w World, options: &str) -> Bdpt<'w> {
    let options = BdptOptions::parse(options).unwrap_or_else(|e| panic!("{e}"));
    Bdpt::new(world, &options).unwrap_or_else(|e| panic!("{e}"))
}

/// A room, the inside of a ball, that `camera` looks into, with a ball of the third material.
fn hall(camera: Camera, middle: MaterialKind, lamp: bool) -> Scene {
    let mut scene = Scene { max_depth: Some(3), camera, ..Scene::default() };
    scene.film.resolution = [8; 2];
    let [wall, bulb, middle] = [diffuse(0.6), diffuse(0.2), middle].map(|kind| add_material(&mut scene, kind));
    add_sphere(&mut scene, DVec3::ZERO, 3.0, wall, 0.0);
    add_sphere(&mut scene, DVec3::new(-0.4, -0.3, 1.4), 0.5, middle, 0.0);
    if lamp {
        add_sphere(&mut scene, DVec3::new(0.9, 0.8, 0.9), 0.6, bulb, 10.0);
    }
    scene
}

/// Rough glass, which scales radiance and importance differently.
fn rough_glass() -> MaterialKind {
    let (roughness, white) = (Roughness::constant(0.5, 0.5, false), Color::Constant([1.0; 3]));
    MaterialKind::Dielectric { eta: 1.5, roughness, reflectance: white, transmittance: white }
}

fn cameras() -> [(&'static str, Camera); 3] {
    let to_world = DAffine3::from_mat3_translation(DMat3::from_rotation_y(0.1), DVec3::new(0.1, 0.0, -1.5));
    let pinhole = Camera { to_world, projection: Projection::Perspective { fov: 60.0 }, ..Camera::default() };
    let lens = Camera { lens_radius: 0.3, focal_distance: 2.0, ..pinhole.clone() };
    let to_world = DAffine3::from_scale_rotation_translation(DVec3::splat(0.8), glam::DQuat::IDENTITY, DVec3::Z * -1.0);
    let orthographic = Camera { to_world, projection: Projection::Orthographic, ..Camera::default() };
    [("pinhole", pinhole), ("lens", lens), ("orthographic", orthographic)]
}

/// Asserts that single strategies have the same mean, for each number of scattering events. The false-alarm rate of 64
/// comparisons is 1e-6. Strategies with fewer than `fewest` vertices from the light cannot make such paths.
fn strategies_agree(name: &str, scene: &Scene, fewest: usize, spp: u64) {
    let world = world(scene);
    for events in 1..=2_usize {
        let n = events + 2;
        let found: Vec<(usize, Mean)> = (fewest..n)
            .map(|s| {
                let mut single = bdpt(&world, "");
                single.fault = Fault::Only { s, t: n - s };
                (s, means_by(&mut single, [8; 2], spp, 0..12))
            })
            .collect();
        let (reference, others) = found.split_first().expect("a strategy");
        for (s, mean) in others {
            let test = mean.against_estimate(&reference.1);
            let told = format!("{name}, {events} events, s = {s}: {mean:?}; s = {}: {:?}", reference.0, reference.1);
            assert!(test.standard_error < 0.1 * reference.1.mean, "too noisy a test: {told}");
            assert!(test.p() > sidak(FAMILY, 64), "{told}");
        }
    }
}

/// By a lens; thoroughly, by all cameras, through rough glass, and from a point, which no ray can hit.
#[test]
fn every_strategy_alone_finds_the_same_light() {
    let [pinhole, lens, orthographic] = cameras();
    for (name, camera) in &[lens, pinhole.clone(), orthographic][..thorough(1, 3)] {
        strategies_agree(name, &hall(camera.clone(), diffuse(0.7), true), 0, thorough(32, 64));
    }
    if thorough(false, true) {
        strategies_agree("rough glass", &hall(pinhole.1.clone(), rough_glass(), true), 0, 64);
        let mut scene = hall(pinhole.1, diffuse(0.7), false);
        let (to_world, source) = (DAffine3::from_translation(DVec3::new(0.5, 0.6, 0.3)), line(200));
        scene.lights.push(Light { kind: LightKind::Point { intensity: [5.0; 3] }, to_world, source });
        strategies_agree("point", &scene, 1, 64);
    }
}

/// A ball before two disks that face each other at an angle, in the light of the sky and of the sun.
#[test]
fn every_strategy_alone_finds_the_same_light_from_infinity() {
    let [(_, camera), ..] = cameras();
    let mut scene = hall(camera, diffuse(0.7), false);
    scene.shapes.remove(0);
    for (turn, x) in [(-0.9, -0.8), (0.9, 0.8)] {
        let disk = Geometry::Disk { height: 0.0, radius: 1.5, inner_radius: 0.0 };
        let to_world = DAffine3::from_mat3_translation(DMat3::from_rotation_y(turn), DVec3::new(x, 0.0, 1.8));
        add(&mut scene, disk, to_world, MaterialId(0), None);
    }
    let sky = LightKind::Infinite { radiance: EnvironmentRadiance::Constant([0.7; 3]) };
    for (name, kind, fewest) in [("sky", sky, 0), ("sun", LightKind::Distant { irradiance: [2.0; 3] }, 1)] {
        scene.lights = vec![Light { kind, to_world: DAffine3::from_rotation_x(2.0), source: line(200) }];
        strategies_agree(name, &scene, fewest, thorough(96, 256));
    }
}

/// Replicates of an image by an integrator.
fn replicates(integrator: &mut dyn Integrator, size: [u32; 2], spp: u64, seed: u64) -> Vec<Vec<[f64; 3]>> {
    (0..16).map(|i| pixels(&film_by(integrator, size, spp, seed + i))).collect()
}

const SIZE: [u32; 2] = [24, 16];

/// The p-value of equal expectations, and the largest deviation of the image's mean in standard errors of the difference.
fn compared(a: &[Vec<[f64; 3]>], b: &[Vec<[f64; 3]>]) -> (f64, f64) {
    let mean = |set: &[Vec<[f64; 3]>], c: usize| -> Mean {
        set.iter().map(|image| image.iter().map(|p| p[c]).sum::<f64>() / image.len() as f64).collect()
    };
    let z = (0..3).map(|c| mean(a, c).against_estimate(&mean(b, c)).z().abs()).fold(0.0, f64::max);
    (images(SIZE[0] as usize, a, b).p(), z)
}

/// On two scenes, thoroughly on six: images by 1e-6 over all, and means within 3 standard errors of the difference. That
/// alone gives a false alarm with probability 0.03 for six scenes of three channels with other seeds. Negative control: light
/// sampling counts 20 % too much.
#[test]
fn means_are_the_path_tracers() {
    for name in &["cornell", "lens", "teapot", "motion", "room", "plates"][..thorough(2, 6)] {
        let mut world = bundle(name, SIZE);
        world.set_max_depth(world.max_depth().min(6));
        let by_path = replicates(&mut *integrator(&world), SIZE, 16, 100);
        for options in ["splat=0", "splat=1"] {
            let (p, z) = compared(&replicates(&mut bdpt(&world, options), SIZE, 8, 200), &by_path);
            eprintln!("{name}, {options}: p {p:.2e}, {z:.2} standard errors");
            assert!(p > sidak(FAMILY, 12) && z < 3.0, "{name}, {options}: p {p:e}, {z} standard errors");
        }
        if *name == "cornell" {
            let mut wrong = bdpt(&world, "");
            wrong.fault = Fault::Sampled(0.2);
            let (p, _) = compared(&replicates(&mut wrong, SIZE, 8, 200), &by_path);
            assert!(p < sidak(FAMILY, 12), "the test sees nothing: p {p:e}");
        }
    }
}

/// The geometric series, whatever the strategies.
#[test]
fn furnaces_have_their_closed_form() {
    for (depth, rho) in [(Some(0), 0.5), (Some(1), 0.5), (Some(2), 0.8), (Some(5), 0.8), (None, 0.5)] {
        let (scene, expected) = furnace(rho, depth, false);
        let world = world(&scene);
        for options in ["splat=0", "splat=1"] {
            let mean = means_by(&mut bdpt(&world, options), [8; 2], 32, 0..16);
            assert_near(&format!("depth {depth:?}, {options}"), &mean, &expected, 5e-6, 0.02);
        }
    }
}

#[test]
fn media_and_transparency_are_refused_with_their_object() {
    let refused =
        Bdpt::new(&bundle("glass", SIZE), &BdptOptions::default()).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(refused.contains("scene.pbrt:") && refused.contains("--without"), "{refused}");
}

/// A window of the image shows the light that the whole image has there, splats included.
#[test]
fn a_window_shows_the_light_of_the_whole_image() {
    let size = [32, 24];
    let world = bundle("caustic", size);
    let whole = Frame::new(size[0], size[1]).expect("not empty");
    let window = whole.crop(15, 12, 23, 20).expect("inside");
    for request in ["bdpt", "metropolis:length=64"] {
        let mean = |frame: Frame, spp: u64| -> Mean {
            let limits = Limits::samples(spp * frame.pixels() as u64);
            let of = |seed| {
                let mut integrator = made(request, &world);
                let film = Render::new(frame, &limits).run(&mut *integrator, &mut Uniform::new(Sobol::new(seed)));
                let image = pixels(&film.unwrap_or_else(|e| panic!("{e}")));
                let [x, y] = [0, 1].map(|axis| (window.origin()[axis] - frame.origin()[axis]) as usize);
                let row = |row: usize| &image[(y + row) * frame.size()[0] as usize + x..][..8];
                (0..8).flat_map(|i| row(i).iter()).map(|p| p[1]).sum::<f64>() / 64.0
            };
            (0..thorough(8, 16)).map(of).collect()
        };
        // About as many light paths in either.
        let (expected, found) = (mean(whole, 8), mean(window, 96));
        let test = found.against_estimate(&expected);
        assert!(test.standard_error < 0.1 * expected.mean, "{request}: too noisy a test: {found:?}, {expected:?}");
        assert!(test.p() > sidak(FAMILY, 2), "{request}: {found:?} in the window, {expected:?} in the image");
    }
}

/// Films of splats have the same bits for any threads, and when resumed.
#[test]
fn bits_do_not_depend_on_threads_or_interruptions() {
    let scene = bundled::files("cornell").expect("bundled").read().expect("it reads");
    for request in ["bdpt", "metropolis:length=16"] {
        with_the_same_bits_on_any_threads_and_resumed(&scene, request);
    }
}

/// Light of a lamp of a hundredth of a ball's radius through the ball of glass. Two methods that share no weights of strategies
/// with the path tracer agree on the focus, of which it finds nothing.
#[test]
fn splats_and_chains_find_the_light_of_a_tiny_lamp_through_glass() {
    let size = [32, 24];
    let world = bundle("caustic", size);
    let focus = |request: &str| -> Mean {
        let mean = |seed| {
            let image = pixels(&film(&world, request, size, 12, seed));
            (14..17).flat_map(|y| (17..21).map(move |x| y * 32 + x)).map(|i: usize| image[i][1]).sum::<f64>() / 12.0
        };
        (0..16).map(mean).collect()
    };
    let [path, bdpt, chains] = ["path", "bdpt", "metropolis"].map(focus);
    let test = bdpt.against_estimate(&chains);
    eprintln!("path {path:?}, bdpt {bdpt:?}, metropolis {chains:?}");
    assert!(test.p() > FAMILY && test.standard_error < 0.1 * chains.mean, "bdpt {bdpt:?}, metropolis {chains:?}");
    assert!(path.mean < 0.2 * chains.mean, "path {path:?}, metropolis {chains:?}");
}

/// Errors of the caustic's image at equal samples; see docs/results/transport-bidirectional.md.
#[test]
#[ignore = "minutes: cargo test --release -p dapple-transport --lib errors_of_the_caustic -- --ignored --nocapture"]
fn errors_of_the_caustic() {
    let size = [48, 36];
    let world = bundle("caustic", size);
    let image = |request: &str, spp, seed| {
        let film = film(&world, request, size, spp, seed);
        (pixels(&film), film.record().rays as f64 / film.record().samples as f64)
    };
    let [(chains, _), (bdpt, _)] = ["metropolis", "bdpt"].map(|request| image(request, 4096, 99));
    for (name, reference) in [("metropolis", &chains), ("bdpt", &bdpt)] {
        for spp in [16, 256] {
            for request in ["path", "bdpt:splat=0", "bdpt", "metropolis"] {
                let (found, rays) = image(request, spp, 1);
                let squared = |(a, b): (&[f64; 3], &[f64; 3])| (a[1] - b[1]).powi(2) / (b[1] * b[1] + 0.01);
                let error = found.iter().zip(reference).map(squared).sum::<f64>() / found.len() as f64;
                eprintln!("beside {name}, {spp} spp, {request}: relMSE {error:.5}, {rays:.1} rays a sample");
            }
        }
    }
}

/// `depth=` cuts paths as the scene's own limit does, and nothing shines in the dark.
#[test]
fn depth_limits_paths_and_a_dark_scene_is_black() {
    let [(_, camera), ..] = cameras();
    let mut lit = world(&hall(camera.clone(), diffuse(0.7), true));
    let image = |world: &World, options: &str| pixels(&film_by(&mut bdpt(world, options), [8; 2], 4, 1));
    let limited = image(&lit, "depth=2");
    lit.set_max_depth(2);
    assert_eq!(limited, image(&lit, ""));
    lit.set_max_depth(3);
    assert_ne!(limited, image(&lit, ""));
    let dark = world(&hall(camera, diffuse(0.7), false));
    assert!(image(&dark, "").iter().all(|p| *p == [0.0; 3]));
}

/// The same random numbers give the same first hit, features and emission with and without light. Paths end before roulette, which
/// features alone do not play.
#[test]
fn features_without_light_are_those_of_whole_samples() {
    const SIZE: [u32; 2] = [40, 30];
    let points = Sobol::new(3);
    for (name, fewest) in [("cornell", 0), ("caustic", 400)] {
        let mut world = bundle(name, SIZE);
        world.set_max_depth(4);
        for request in ["bdpt", "bdpt:depth=1", "metropolis"] {
            let integrator = made(request, &world);
            let (mut behind, mut lit, mut worker) = (0, 0, Worker::default());
            for i in 0..4 * SIZE[0] * SIZE[1] {
                let id = SampleId::new([i % 40, i / 40 % 30], streams::WHOLE, u64::from(i / 1200));
                let draws = Draws::for_film(&points, id, Needs::none().with_features().with_emission());
                let whole = integrator.estimate(&draws, &mut worker);
                let alone = integrator.features_alone(&draws).expect("paths have features");
                let told = || format!("{name}, {request}, {id:?}");
                assert_eq!((alone.first_hit, alone.features), (whole.first_hit, whole.features), "{}", told());
                assert!(alone.cost <= whole.cost && alone.radiance == [0.0; 3], "{}", told());
                assert_eq!(alone.emission, whole.emission, "{}", told());
                lit += u32::from(alone.emission != [0.0; 3]);
                behind += u32::from(alone.features.is_some());
            }
            assert!(lit > 20, "{name}, {request}: {lit} samples see a lamp");
            assert!(behind >= fewest, "{name}, {request}: {behind} samples see something behind glass or in a mirror");
        }
    }
}

/// The unit direction from one vertex to another.
fn towards(from: &Vertex<'_>, to: &Vertex<'_>) -> Vec3 {
    (to.point.position - from.point.position).normalize()
}

/// Computes the densities of a path from the camera to a lamp anew, vertex by vertex, as both ends would sample them.
/// Returns `None` if a vertex scatters nothing, or if two vertices are so close that rounding turns their direction.
fn complete(path: &mut [Vertex<'_>]) -> Option<()> {
    let n = path.len();
    if path.windows(2).any(|pair| pair[0].point.position.distance(pair[1].point.position) < 0.05) {
        return None;
    }
    for i in 1..n {
        path[i].wo = towards(&path[i], &path[i - 1]);
        if i >= 2 {
            let density = path[i - 1].connect(From::Camera, -path[i].wo)?.forward;
            path[i].forward = path[i].density_from(path[i - 1].point.position, density);
        }
    }
    for i in 0..n - 2 {
        let density = path[i + 1].connect(From::Camera, towards(&path[i + 1], &path[i + 2]))?.backward;
        path[i].backward = path[i].density_from(path[i + 1].point.position, density);
    }
    Some(())
}

/// The vertices of a complete path from the lamp on, as a light path samples them.
fn from_light<'w>(world: &World, path: &[Vertex<'w>]) -> Option<Vec<Vertex<'w>>> {
    let (n, lights) = (path.len(), world.lights());
    let mut light: Vec<Vertex<'w>> = path.iter().rev().take(n - 1).copied().collect();
    let index = light[0].lamp()?;
    let direction = towards(&light[0], &light[1]);
    let pdf = lights.emission_pdf(index, light[0].facing(direction), direction);
    light[0] = Vertex { kind: Kind::Lamp { light: index }, wo: Vec3::ZERO, ..light[0] };
    light[0].forward = pdf.position * lights.pmf(index);
    for j in 1..light.len() {
        light[j].wo = towards(&light[j], &light[j - 1]);
        let density = if j == 1 { pdf.direction } else { light[j - 1].connect(From::Light, -light[j].wo)?.forward };
        light[j].forward = light[j].density_from(light[j - 1].point.position, density);
    }
    for j in 0..light.len().saturating_sub(2) {
        let density = light[j + 1].connect(From::Light, towards(&light[j + 1], &light[j + 2]))?.backward;
        light[j].backward = light[j].density_from(light[j + 1].point.position, density);
    }
    light.iter_mut().for_each(|vertex| vertex.throughput = Vec3::ONE);
    Some(light)
}

/// The weight of each strategy that can make a complete path, for s = 0, 1, …; `None` if rounding hides one vertex from
/// another. `wrong` is a factor of the density of the vertex that the lamp lights.
fn weights<'w>(bdpt: &Bdpt<'w>, draws: &Draws<'_>, path: &[Vertex<'w>], wrong: f32) -> Option<Vec<f32>> {
    let (n, world) = (path.len(), bdpt.world);
    let mut light = from_light(world, path)?;
    light[1].forward *= wrong;
    let mut found = Vec::new();
    for s in 0..n {
        let (lit, camera) = (&light[..s], &path[..n - s]);
        let ends = match s {
            0 => bdpt.found(camera)?.ends,
            1 => sampled_ends(world, &light[0], camera)?,
            _ if s < n - 1 => bdpt.connected(lit, camera, (0.0, &mut 0))?.ends,
            _ if bdpt.splats => {
                let mut seen = None;
                bdpt.seen(draws, lit, (0.0, &mut 0), |_, vertices, found| {
                    seen = seen.or((vertices == s).then_some(found.ends));
                });
                seen?
            }
            _ => continue,
        };
        found.push(bdpt.weight(lit, camera, &ends));
    }
    Some(found)
}

/// The densities at the ends of light sampling, by the vertices alone.
fn sampled_ends(world: &World, lamp: &Vertex<'_>, camera: &[Vertex<'_>]) -> Option<Ends> {
    let (last, before) = (&camera[camera.len() - 1], &camera[camera.len() - 2]);
    let to = towards(last, lamp);
    let connected = last.connect(From::Camera, to)?;
    let pdf = world.lights().emission_pdf(lamp.lamp()?, lamp.facing(-to), -to);
    let eye = [
        last.density_from(lamp.point.position, pdf.direction),
        before.density_from(last.point.position, connected.backward),
    ];
    Some(Ends { eye, light: [lamp.density_from(last.point.position, connected.forward), 0.0] })
}

/// Calls `check` with the camera path of each of some samples.
fn camera_paths<'w>(bdpt: &Bdpt<'w>, mut check: impl FnMut(&Draws<'_>, &[Vertex<'w>])) {
    let points = Random::new(5);
    for i in 0..20_000 {
        let draws = Draws::new(&points as &dyn PointSet, SampleId::new([i % 8, i / 8 % 8], 0, u64::from(i / 64)));
        let mut camera = Vec::new();
        bdpt.camera_path(&draws, &mut camera, &mut Estimate::new([0.0; 3]));
        check(&draws, &camera);
    }
}

#[test]
fn weights_of_one_path_sum_to_one() {
    let [(_, pinhole), _, (_, orthographic)] = cameras();
    for (camera, middle) in [(pinhole.clone(), diffuse(0.7)), (pinhole, rough_glass()), (orthographic, diffuse(0.7))] {
        let world = world(&hall(camera, middle, true));
        for options in ["", "splat=0"] {
            let bdpt = bdpt(&world, options);
            let mut seen = [0_u32; 6];
            let mut wrong = (0, 0);
            camera_paths(&bdpt, |draws, camera| {
                for n in 3..=camera.len() {
                    let mut path = camera[..n].to_vec();
                    if bdpt.found(&path).is_none() || complete(&mut path).is_none() {
                        continue;
                    }
                    let Some(found) = weights(&bdpt, draws, &path, 1.0) else { continue };
                    let sum: f32 = found.iter().sum();
                    assert!((sum - 1.0).abs() < 2e-3, "{options}, {n} vertices: {found:?} sum to {sum}");
                    seen[n] += 1;
                    // Negative control: a density that is off by a half.
                    let Some(found) = weights(&bdpt, draws, &path, 1.5) else { continue };
                    wrong.0 += u32::from((found.iter().sum::<f32>() - 1.0).abs() > 0.02);
                    wrong.1 += 1;
                }
            });
            assert!(seen[3..=5].iter().all(|count| *count > 50), "{options}: {seen:?} paths");
            assert!(4 * wrong.0 > wrong.1, "{options}: a wrong density shows in {wrong:?} paths");
        }
    }
}

/// The densities that light sampling itself states give the weight that the vertices alone give.
#[test]
fn light_sampling_has_the_weight_of_its_path() {
    let [(_, pinhole), ..] = cameras();
    let world = world(&hall(pinhole, diffuse(0.7), true));
    let (bdpt, mut compared) = (bdpt(&world, ""), 0);
    camera_paths(&bdpt, |draws, camera| {
        for t in 2..=camera.len() {
            if !camera[t - 1].connects() {
                continue;
            }
            let Some((found, start)) = bdpt.sampled(&camera[..t], (0.0, &mut 0)) else { continue };
            let mut path = [&camera[..t], &[start]].concat();
            if complete(&mut path).is_none() {
                continue;
            }
            let Some(expected) = weights(&bdpt, draws, &path, 1.0) else { continue };
            let weight = bdpt.weight(&[start], &camera[..t], &found.ends);
            let places: Vec<Vec3> = path.iter().map(|vertex| vertex.point.position).collect();
            let told = || format!("{t} vertices: {weight}, not {expected:?}, at {places:?}");
            assert!((weight - expected[1]).abs() < 2e-3, "{}", told());
            compared += 1;
        }
    });
    assert!(compared > 10_000, "{compared} paths");
}
