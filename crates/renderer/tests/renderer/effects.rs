//! A scene's effects are rendered, rejected, or left out on request. They cost nothing in scenes without them.
#![allow(clippy::print_stderr)]

use crate::support::*;
use dapple_conformance::toys::Points;
use dapple_geometry::{Ray, SurfacePoint, spawn_ray, spawn_ray_to};
use dapple_renderer::camera::{Lens, Pinhole};
use dapple_renderer::light::Target;
use dapple_renderer::shading::{ShadingFrame, power_heuristic, warp};
use dapple_renderer::without;
use std::collections::BTreeMap;
use std::f32::consts::FRAC_1_PI;
use std::hint::black_box;
use std::process::Command;
use std::sync::Mutex;

const SIZE: [u32; 2] = [16, 12];
const SPP: u64 = 8;
const SAMPLES: u64 = SIZE[0] as u64 * SIZE[1] as u64 * SPP;

/// Returns a diffuse floor that fills the view, lit directly by a lamp out of view.
fn direct() -> Scene {
    let mut scene = empty(SIZE);
    let grey = add_material(&mut scene, diffuse(0.5));
    plate(&mut scene, [DVec3::ZERO, 20.0 * DVec3::X, 20.0 * DVec3::Y], grey, None);
    plate(&mut scene, [DVec3::new(0.0, 0.0, 3.5), DVec3::Y, DVec3::X], grey, Some(4.0));
    scene.max_depth = Some(1);
    scene
}

/// The number of requests of each block, and the number of rays.
type Cost = (BTreeMap<u32, u64>, u64);

/// Returns an image's hash and cost.
fn counted(scene: &Scene) -> (u64, Cost) {
    let (asked, points) = (Mutex::new(BTreeMap::new()), Sobol::new(1));
    let recorded = Points(|id, block| {
        *asked.lock().expect("no test panics here").entry(block).or_default() += 1;
        points.block(id, block)
    });
    let film = film_of(&world(scene), SIZE, SPP, recorded);
    let asked = asked.into_inner().expect("no test panics here");
    assert_eq!(film.record().blocks, asked.values().sum::<u64>(), "the record counts every block");
    (hash(&film), (asked, film.record().rays))
}

/// Adds unused materials, textures and lights.
fn add_unused(scene: &mut Scene) {
    add_material(scene, metal(0.1));
    add_material(scene, metal(0.0));
    add_material(scene, coated(0.5, 0.0));
    let texture = add_texture(scene, "unused", checks(4.0, [1.0, 0.0]));
    add_material(scene, MaterialKind::Diffuse { reflectance: Color::Texture(texture) });
    scene.camera.focal_distance = 3.0;
    add_sky(scene, 0.0);
}

/// Returns the floor with a sphere, unused objects and one more effect. All these scenes have soft shadows.
fn with(effect: Effect) -> Scene {
    let mut scene = direct();
    let own = add_material(&mut scene, diffuse(0.5));
    let number = ball(&mut scene, DVec3::new(0.0, 0.0, 0.5), 0.5, own, None);
    add_unused(&mut scene);
    let tiled = scene.materials[5].kind.clone();
    let (body, kind) = (&mut scene.shapes[number], &mut scene.materials[1].kind);
    let mut fill = |absorption, scattering| {
        scene.media.push(fog([absorption; 3], [scattering; 3], 0.0));
        Some(MediumId(0))
    };
    let mut medium = None;
    match effect {
        Effect::SoftShadows => {}
        Effect::SeveralLights => body.emission = Some(Emission::even([1.0; 3], false)),
        Effect::Glossy => *kind = metal(0.2),
        Effect::Mirror => (*kind, scene.max_depth) = (metal(0.0), Some(2)),
        Effect::Refraction => {
            let (roughness, white) = (Roughness::constant(0.0, 0.0, false), Color::Constant([1.0; 3]));
            *kind = MaterialKind::Dielectric { eta: 1.5, roughness, reflectance: white, transmittance: white };
            scene.max_depth = Some(4);
        }
        Effect::Interreflection => scene.max_depth = Some(3),
        Effect::Textures => *kind = tiled,
        Effect::Environment => add_sky(&mut scene, 0.3),
        Effect::DepthOfField => (scene.camera.lens_radius, scene.camera.focal_distance) = (0.2, 1.0),
        Effect::MotionBlur => body.moves_to = Some(at(1.0, 0.0, 0.0)),
        Effect::Transparency => body.alpha = Some(Scalar::Constant(0.7)),
        Effect::AbsorbingMedia => medium = fill(0.2, 0.0),
        Effect::ScatteringMedia => medium = fill(0.0, 0.2),
        other => panic!("a new effect needs a scene: {other}"),
    }
    if medium.is_some() {
        scene.camera.medium = medium;
        scene.shapes.iter_mut().for_each(|s| s.media = Some(MediumInterface { inside: medium, outside: medium }));
    }
    scene
}

/// A scene's effects are rendered, or rejected by name and line; never left out silently. Leaving an effect out on request
/// changes the image if the scene has it, and no bit otherwise. All pairs of effects are tested.
#[test]
fn needed_effects_are_rendered_and_absent_ones_change_no_bit_l14() {
    for present in Effect::ALL {
        let scene = with(present);
        let effects = Effects::of(&scene);
        assert!(effects.has(present), "{present}");
        match World::new(&scene) {
            Err(refused) => {
                assert!(refused.problems.iter().all(|p| p.starts_with("made.pbrt:")), "{present}: {refused}");
            }
            Ok(world) => {
                let expected = hash(&film_of(&world, SIZE, 4, Sobol::new(1)));
                for effect in Effect::ALL {
                    let less = without(&scene, effect).unwrap_or_else(|e| panic!("{present} without {effect}: {e}"));
                    assert!(!Effects::of(&less).has(effect), "{effect}");
                    let is_same = hash(&image(&less, 4, 1)) == expected;
                    assert_eq!(is_same, !effects.has(effect), "{present} without {effect}");
                }
            }
        }
    }
}

/// Clear air, an opacity of 1, unused objects and a black image need no effect: the path tracer without code for effects
/// renders the same bits at the same cost.
#[test]
fn what_does_nothing_changes_no_bit_l14() {
    let plain = with(Effect::SoftShadows);
    let mut clear = with(Effect::ScatteringMedia);
    clear.media[0].scattering = [0.0; 3];
    let mut opaque = with(Effect::Transparency);
    opaque.shapes[2].alpha = Some(Scalar::Constant(1.0));
    let mut black = plain.clone();
    let kind = LightKind::Infinite { radiance: lat_long([2, 1], |_, _| 0.0) };
    add_light(&mut black, kind, DAffine3::IDENTITY);
    for (name, scene) in [("clear air", clear), ("an opacity of 1", opaque), ("a black sky", black)] {
        assert_eq!(Effects::of(&scene).called(), Effects::of(&plain).called(), "{name}");
        assert_eq!(hash(&image(&scene, 4, 1)), hash(&image(&plain, 4, 1)), "{name}");
    }
    let mut more = direct();
    add_unused(&mut more);
    assert_eq!((counted(&more), Effects::of(&more)), (counted(&direct()), Effects::of(&direct())));
    // The control.
    assert_ne!(hash(&image(&with(Effect::ScatteringMedia), 4, 1)), hash(&image(&plain, 4, 1)));
}

#[test]
fn effects_request_their_own_blocks_and_rays_l14() {
    let cost = |scene: &Scene| counted(scene).1;
    let (camera, scatter) = (blocks::CAMERA.number(), |v| blocks::scatter(v).number());
    let choose = |v| blocks::choose(v).number();
    // One ray from the camera, one to the lamp, and one scattered by the floor.
    assert_eq!(cost(&direct()), (BTreeMap::from([(camera, SAMPLES), (scatter(0), SAMPLES)]), 3 * SAMPLES));
    assert!(mean(&image(&direct(), SPP, 1))[0] > 0.1);
    // Without scattering or hits: one block and one ray.
    let mut unlit = direct();
    unlit.max_depth = Some(0);
    let mut empty = direct();
    empty.shapes.clear();
    add_sky(&mut empty, 1.0);
    for scene in [unlit, empty] {
        assert_eq!(cost(&scene), (BTreeMap::from([(camera, SAMPLES)]), SAMPLES));
    }
    // Half of the view misses. Those samples request nothing more.
    let mut half = direct();
    half.camera.to_world = look_at(DVec3::new(0.0, -30.0, 1.0), DVec3::new(0.0, 0.0, 1.0), DVec3::Z);
    let (asked, rays) = cost(&half);
    let hits = asked[&scatter(0)];
    assert!(hits > 0 && hits < SAMPLES && asked.len() == 2 && rays <= SAMPLES + 2 * hits, "{asked:?}");
    // With a second light, each scattering event requests a choice.
    let mut two = direct();
    add_sky(&mut two, 0.5);
    let (asked, _) = cost(&two);
    assert!(asked.get(&choose(0)) == Some(&SAMPLES) && asked.len() == 3, "{asked:?}");
    // Long paths request a choice (roulette) from the fifth event on, and none before.
    let mut long = direct();
    long.max_depth = Some(12);
    let grey = long.shapes[0].material;
    plate(&mut long, [DVec3::new(0.0, 1.0, 2.0), 20.0 * DVec3::X, 20.0 * DVec3::Z], grey, None);
    let (asked, _) = cost(&long);
    assert!((0..5).all(|v| asked.contains_key(&choose(v)) == (v == 4)), "{asked:?}");
    // Leaving an effect out saves exactly its cost.
    let plain = cost(&with(Effect::SoftShadows));
    assert_eq!(plain.0.keys().copied().collect::<Vec<_>>(), [camera, scatter(0)]);
    for effect in [Effect::SeveralLights, Effect::Environment, Effect::Interreflection, Effect::DepthOfField] {
        let more = with(effect);
        assert_ne!(cost(&more), plain, "{effect}");
        let less = without(&more, effect).unwrap_or_else(|e| panic!("{effect}: {e}"));
        assert!(effect == Effect::SeveralLights || cost(&less) == plain, "{effect}");
    }
}

/// Lights that emit nothing, have no area, or are invalid.
#[test]
fn lights_without_light_change_nothing_l06() {
    // Lights without area or emission are never chosen and change no bit.
    let mut worthless = direct();
    let grey = worthless.shapes[0].material;
    add(&mut worthless, polygon(&[DVec3::Z; 3]), DAffine3::IDENTITY, grey, Some(1000.0));
    worthless.shapes[0].emission = Some(Emission::even([0.0; 3], true));
    assert_eq!(counted(&worthless), counted(&direct()));
    assert_eq!((world(&worthless).lights().len(), world(&worthless).dropped_triangles()), (1, 1));
    // A lamp with one degenerate triangle emits the same light, none of it from that triangle.
    let mut part = direct();
    let (u, v, c) = (DVec3::Y, DVec3::X, DVec3::new(0.0, 0.0, 3.5));
    part.shapes[1].geometry = polygon(&[c - u - v, c - u - v, c + u - v, c + u + v, c - u + v]);
    assert_eq!(world(&part).dropped_triangles(), 1);
    let [with, without] = [(&part, 1), (&direct(), 2)].map(|(scene, seed)| mean(&image(scene, 64, seed)));
    assert!((with[0] / without[0] - 1.0).abs() < 5e-3, "{with:?} {without:?}");
    // Invalid emission is refused with its line, not rendered.
    for radiance in [[f32::NAN; 3], [1.0, -1.0, 1.0], [f32::INFINITY; 3]] {
        let mut bad = direct();
        bad.shapes[1].emission = Some(Emission::even(radiance, false));
        assert!(refusal(&bad).starts_with("made.pbrt:11: an emission of"), "{}", refusal(&bad));
    }
    // Several lights: the probabilities of those that emit sum to 1.
    let room = world(&room(SIZE));
    let sum: f32 = (0..room.lights().len() as u32).map(|l| room.lights().pmf(l)).sum();
    assert!((sum - 1.0).abs() < 1e-6 && room.lights().len() == 3, "{sum}");
}

#[test]
fn no_light_is_black_and_an_unseen_one_too_l06() {
    let mut dark = direct();
    dark.shapes[1].emission = None;
    dark.max_depth = None;
    // A lamp enclosed by its own box.
    let mut unseen = dark.clone();
    let grey = unseen.shapes[0].material;
    add(&mut unseen, Geometry::Mesh(Arc::new(cube())), at(0.0, 10.0, 5.0), grey, None);
    ball(&mut unseen, DVec3::new(0.0, 10.0, 5.0), 0.5, grey, Some(100.0));
    unseen.max_depth = Some(5);
    for scene in [dark, unseen] {
        let film = image(&scene, SPP, 1);
        assert!(film.image().iter().all(|p| *p == [0.0; 3]) && film.record().rejected == 0);
    }
}

const ALBEDO: f32 = 0.6;
/// The index of the lamp's shape.
const LAMP: u32 = 2;

/// Returns a pinhole camera and two diffuse rectangles under a lamp, with direct light only.
fn simplest() -> World {
    let mut scene = scene([32, 32], 45.0, DVec3::new(0.0, -4.0, 2.0), DVec3::new(0.0, 0.0, 0.5));
    scene.max_depth = Some(1);
    scene.film.pixel_filter = PixelFilter::default();
    let grey = add_material(&mut scene, diffuse(ALBEDO));
    let black = add_material(&mut scene, diffuse(0.0));
    plate(&mut scene, [DVec3::ZERO, DVec3::X * 3.0, DVec3::Y * 3.0], grey, None);
    plate(&mut scene, [DVec3::new(0.0, 1.5, 1.0), DVec3::X * 2.0, DVec3::Z], grey, None);
    plate(&mut scene, [DVec3::new(0.0, 0.0, 2.5), DVec3::X * 0.5, DVec3::NEG_Y * 0.5], black, Some(5.0));
    world(&scene)
}

/// Computes the same estimate with only the code that this scene needs. The lamp's triangles come from the world's geometry,
/// and numbers are added in the same order.
#[inline(never)]
fn by_hand(world: &World, draws: &Draws<'_>) -> [f32; 3] {
    let (geometry, lights, view) = (world.geometry(), world.lights(), world.camera());
    let u = draws.block(blocks::CAMERA);
    let ray = Pinhole::ray(view, view.place(draws.pixel(), Vec2::new(u[0] - 0.5, u[1] - 0.5)), [u[2], u[3]]);
    let shone = |ray: &Ray, at: &SurfacePoint| lights.emitted(0, at, -at.normal.dot(ray.direction));
    let Some(hit) = geometry.closest(&ray) else { return [0.0; 3] };
    let at = geometry.surface(&ray, &hit);
    if hit.shape == LAMP {
        return shone(&ray, &at).to_array();
    }
    let frame = ShadingFrame::from_normal(at.normal);
    let outside = -at.normal.dot(ray.direction);
    let u = draws.block(blocks::scatter(0));
    let mut radiance = Vec3::ZERO;
    if let Some(light) = lights.sample(at.position, 0.0, [u[0], u[1]])
        && at.normal.dot(light.wi) * outside > 0.0
        && let Target::Surface(point) = &light.target
        && !geometry.occluded(&spawn_ray_to(&at, point))
    {
        let cosine = light.wi.dot(frame.normal).abs();
        let weight = power_heuristic(light.pdf, cosine * FRAC_1_PI) / light.pdf;
        radiance += Vec3::splat(ALBEDO * FRAC_1_PI) * light.radiance * (cosine * weight);
    }
    let side = if outside > 0.0 { 1.0 } else { -1.0 };
    let local = warp::cosine_hemisphere([u[2], u[3]]);
    let wi = frame.to_world(side * local);
    if !(local.z > 0.0 && at.normal.dot(wi) * outside > 0.0) {
        return radiance.to_array();
    }
    let next = spawn_ray(&at, wi);
    if let Some(hit) = geometry.closest(&next)
        && hit.shape == LAMP
    {
        let point = geometry.surface(&next, &hit);
        let found = shone(&next, &point);
        if found != Vec3::ZERO {
            let pdf = lights.pdf(0, at.position, &point);
            radiance += ALBEDO * found * power_heuristic(local.z * FRAC_1_PI, pdf);
        }
    }
    radiance.to_array()
}

fn walk(samples: u64, mut estimate: impl FnMut(&Draws<'_>) -> [f32; 3]) {
    let points = Sobol::new(3);
    for index in 0..samples {
        let pixel = [index as u32 % 32, index as u32 / 32 % 32];
        black_box(estimate(&Draws::new(&points, SampleId::new(pixel, 0, index / 1024))));
    }
}

#[test]
fn the_hand_written_loop_is_the_same_estimator_l14() {
    let world = simplest();
    let integrator = integrator(&world);
    let mut bright = 0;
    walk(1 << 14, |draws| {
        let hand = by_hand(&world, draws);
        let ours = integrator.estimate(draws, &mut Worker::default()).radiance;
        assert!((hand[0] - ours[0]).abs() <= 1e-5 * hand[0].max(1e-3), "{:?}: {hand:?} {ours:?}", draws.pixel());
        bright += u32::from(hand[0] > 0.0);
        hand
    });
    assert!(bright > 5000, "{bright} samples see light");
}

/// The environment variable that selects the loop to run under callgrind, and the number of iterations.
const ROLE: &str = "DAPPLE_L14";

/// Returns the number of instructions per sample, without the start of the process.
fn instructions(role: &str) -> Option<f64> {
    const SAMPLES: u64 = 20_000;
    let counted = |samples: u64| {
        let test = "effects::idle_effects_cost_at_most_one_percent_l14";
        let output = Command::new("valgrind")
            .args(["--tool=callgrind", "--callgrind-out-file=/dev/null"])
            .arg(std::env::current_exe().ok()?)
            .args([test, "--exact", "--ignored", "--test-threads=1"])
            .env(ROLE, format!("{role}:{samples}"))
            .output()
            .ok()?;
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        text.lines().find(|l| l.contains("Collected"))?.rsplit(' ').next()?.trim().parse::<f64>().ok()
    };
    Some((counted(2 * SAMPLES)? - counted(SAMPLES)?) / SAMPLES as f64)
}

#[test]
#[ignore = "needs valgrind: cargo test --release -p dapple-renderer --test renderer -- --ignored --nocapture idle_effects"]
fn idle_effects_cost_at_most_one_percent_l14() {
    let world = simplest();
    let integrator = integrator(&world);
    if let Ok(role) = std::env::var(ROLE) {
        let (name, samples) = role.split_once(':').expect("name:samples");
        let samples: u64 = samples.parse().expect("a number");
        match name {
            "hand" => walk(samples, |draws| by_hand(&world, draws)),
            _ => walk(samples, |draws| integrator.estimate(draws, &mut Worker::default()).radiance),
        }
        return;
    }
    let Some((hand, ours)) = instructions("hand").zip(instructions("ours")) else {
        eprintln!("skipped: valgrind does not run");
        return;
    };
    eprintln!("instructions a sample: {hand:.0} by hand, {ours:.0} specialised, ratio {:.4}", ours / hand);
    assert!(ours <= 1.01 * hand, "{ours} against {hand}");
}
