//! A scene renders with exactly the effects that it needs.

use crate::support::*;
use dapple_core::{Film, Needs, PointSet, SampleId};
use dapple_low_discrepancy::Sobol;
use dapple_renderer::{World, blocks};
use dapple_scene::image::Image;
use dapple_scene::{
    Color, Emission, EnvironmentRadiance, Geometry, Light, LightKind, Material, MaterialKind, Roughness, Scene,
    Texture, TextureId, TextureKind,
};
use dapple_scene::{Effect, Effects};
use glam::{DAffine3, DVec3};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};

const SIZE: [u32; 2] = [16, 12];
const SPP: u64 = 8;

/// A diffuse floor that fills the view and a lamp above it, out of sight.
fn direct() -> Scene {
    let mut scene = scene(SIZE, 40.0, DVec3::new(0.0, -3.0, 2.0), DVec3::new(0.0, 0.0, 0.0));
    let grey = add_material(&mut scene, diffuse(0.5));
    add(&mut scene, rectangle(DVec3::ZERO, 20.0 * DVec3::X, 20.0 * DVec3::Y), DAffine3::IDENTITY, grey, None);
    add(&mut scene, rectangle(DVec3::new(0.0, 0.0, 3.5), DVec3::Y, DVec3::X), DAffine3::IDENTITY, grey, Some(4.0));
    scene.max_depth = Some(1);
    scene
}

/// The number of requests of each block.
struct Counted {
    points: Sobol,
    asked: Mutex<BTreeMap<u32, u64>>,
}

impl PointSet for &Counted {
    fn describe(&self) -> String {
        self.points.describe()
    }

    fn block(&self, id: SampleId, block: u32) -> [f32; 4] {
        *self.asked.lock().expect("no test panics here").entry(block).or_default() += 1;
        self.points.block(id, block)
    }

    fn capacity(&self) -> u64 {
        self.points.capacity()
    }
}

fn counted(scene: &Scene) -> (Film, BTreeMap<u32, u64>) {
    let counted = Counted { points: Sobol::new(1), asked: Mutex::default() };
    let film = film_of(&world(scene), scene.film.resolution, SPP, &counted);
    let asked = counted.asked.into_inner().expect("no test panics here");
    assert_eq!(film.record().blocks, asked.values().sum::<u64>(), "the record counts every block");
    (film, asked)
}

const SAMPLES: u64 = SIZE[0] as u64 * SIZE[1] as u64 * SPP;

#[test]
fn direct_light_requests_two_blocks_and_three_rays_l14() {
    let (film, asked) = counted(&direct());
    let expected = BTreeMap::from([(blocks::CAMERA.number(), SAMPLES), (blocks::scatter(0).number(), SAMPLES)]);
    assert_eq!(asked, expected);
    // One from the camera, one to the lamp, and one scattered by the floor.
    assert_eq!(film.record().rays, 3 * SAMPLES);
    assert!(mean(&film)[0] > 0.1);
}

#[test]
fn without_scattering_or_hits_a_sample_takes_one_block_and_one_ray_l14() {
    let mut unlit = direct();
    unlit.max_depth = Some(0);
    let mut empty = direct();
    empty.shapes.clear();
    add_sky(&mut empty, 1.0);
    for scene in [unlit, empty] {
        let (film, asked) = counted(&scene);
        assert_eq!(asked, BTreeMap::from([(blocks::CAMERA.number(), SAMPLES)]));
        assert_eq!(film.record().rays, SAMPLES);
    }
}

#[test]
fn each_effect_requests_its_own_blocks_l14() {
    // Half of the view misses. Those samples request nothing more.
    let mut half = direct();
    half.camera.to_world = look_at(DVec3::new(0.0, -30.0, 1.0), DVec3::new(0.0, 0.0, 1.0), DVec3::Z);
    let (film, asked) = counted(&half);
    let hits = asked[&blocks::scatter(0).number()];
    assert!(hits > 0 && hits < SAMPLES && asked.len() == 2, "{asked:?}");
    assert!(film.record().rays <= SAMPLES + 2 * hits);

    // A second light takes a choice at each scattering event.
    let mut two = direct();
    add_sky(&mut two, 0.5);
    let (_, asked) = counted(&two);
    assert_eq!(asked.get(&blocks::choose(0).number()), Some(&SAMPLES), "{asked:?}");
    assert_eq!(asked.len(), 3);

    // Long paths take a choice (roulette) from the fifth event on, and none before.
    let mut long = direct();
    long.max_depth = Some(12);
    let corner = rectangle(DVec3::new(0.0, 1.0, 2.0), 20.0 * DVec3::X, 20.0 * DVec3::Z);
    let grey = long.shapes[0].material;
    add(&mut long, corner, DAffine3::IDENTITY, grey, None);
    let (_, asked) = counted(&long);
    assert!((0..4).all(|v| !asked.contains_key(&blocks::choose(v).number())), "{asked:?}");
    assert!(asked.contains_key(&blocks::choose(4).number()), "{asked:?}");
}

fn unused_features(scene: &mut Scene) {
    add_material(scene, metal(0.1));
    add_material(scene, coated(0.5, 0.0));
    let colors = [Color::Constant([1.0; 3]), Color::Constant([0.0; 3])];
    let kind = TextureKind::Checkerboard { scale: [4.0; 2], shift: [0.0; 2], colors };
    scene.textures.push(Texture { name: "unused".into(), kind, source: line(300) });
    let reflectance = Color::Texture(TextureId(0));
    let source = line(301);
    scene.materials.push(Material::new("checked", MaterialKind::Diffuse { reflectance }, source));
    scene.camera.focal_distance = 3.0;
    let black = LightKind::Infinite { radiance: EnvironmentRadiance::Constant([0.0; 3]) };
    scene.lights.push(Light { kind: black, to_world: DAffine3::IDENTITY, source: line(302) });
}

#[test]
fn unused_features_change_no_bit_l14() {
    let plain = direct();
    let mut more = plain.clone();
    unused_features(&mut more);
    let ((a, asked_a), (b, asked_b)) = (counted(&plain), counted(&more));
    assert_eq!(hash(&a), hash(&b));
    assert_eq!((asked_a, a.record().rays), (asked_b, b.record().rays));
    assert_eq!(Effects::of(&plain), Effects::of(&more));
}

/// Features are reported on request only, and the request changes no bit.
#[test]
fn features_change_no_bit_l14() {
    let scene = room(SIZE);
    let world = world(&scene);
    let plain = film_of(&world, SIZE, SPP, Sobol::new(1));
    let frame = dapple_core::Frame::new(SIZE[0], SIZE[1]).expect("not empty");
    let mut sampler = dapple_core::samplers::Uniform::new(Sobol::new(1));
    let needs = Needs::none().with_features().with_variance().with_cost();
    let limits = dapple_core::Limits::samples(SAMPLES);
    let mut integrator = dapple_renderer::integrator(&world);
    let full = dapple_core::Render::new(frame, &limits).needs(needs).run(&mut *integrator, &mut sampler);
    let full = full.expect("it renders");
    assert_eq!(hash(&plain), hash(&full));
    // Features alone take one ray and one block, and more only behind what is smooth.
    let features: u64 = (0..frame.pixels()).map(|i| u64::from(full.features(i).expect("recorded").samples)).sum();
    let alone = features - SAMPLES;
    assert!(alone >= 4 * frame.pixels() as u64);
    let more = full.record().rays - plain.record().rays;
    assert!(more >= alone && more < alone + alone / 10, "{more} rays for {alone} samples of features");
    let more = full.record().blocks - plain.record().blocks;
    assert!(more >= alone && more < 2 * alone, "{more} blocks for {alone} samples of features");
}

/// Lights that emit nothing, have no area, or are invalid.
#[test]
fn lights_without_light_change_nothing_l06() {
    let plain = direct();
    let expected = counted(&plain);

    // Lights without area or emission are never chosen and change no bit.
    let mut worthless = plain.clone();
    let grey = worthless.shapes[0].material;
    let point = polygon(&[DVec3::Z, DVec3::Z, DVec3::Z]);
    add(&mut worthless, point, DAffine3::IDENTITY, grey, Some(1000.0));
    worthless.shapes[0].emission = Some(Emission { radiance: [0.0; 3], two_sided: true });
    let found = counted(&worthless);
    assert_eq!((hash(&found.0), found.1), (hash(&expected.0), expected.1));
    assert_eq!(world(&worthless).lights().len(), 1);
    assert_eq!(world(&worthless).dropped_triangles(), 1);

    // A lamp with one degenerate triangle emits the same light, none of it from that triangle.
    let mut part = plain.clone();
    let (u, v, c) = (DVec3::Y, DVec3::X, DVec3::new(0.0, 0.0, 3.5));
    part.shapes[1].geometry = polygon(&[c - u - v, c - u - v, c + u - v, c + u + v, c - u + v]);
    assert_eq!(world(&part).dropped_triangles(), 1);
    let (with, without) = (mean(&image(&part, 64, 1)), mean(&image(&plain, 64, 2)));
    assert!((with[0] / without[0] - 1.0).abs() < 5e-3, "{with:?} {without:?}");

    // Invalid emission is refused with its line, not rendered.
    for radiance in [[f32::NAN; 3], [1.0, -1.0, 1.0], [f32::INFINITY; 3]] {
        let mut bad = plain.clone();
        bad.shapes[1].emission = Some(Emission { radiance, two_sided: false });
        let message = World::new(&bad).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(message.starts_with("made.pbrt:11: an emission of"), "{message}");
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
    // A lamp shut in its own box.
    let mut unseen = dark.clone();
    let grey = unseen.shapes[0].material;
    let far = DAffine3::from_translation(DVec3::new(0.0, 10.0, 5.0));
    add(&mut unseen, Geometry::Mesh(Arc::new(cube())), far, grey, None);
    add(&mut unseen, Geometry::Sphere { radius: 0.5 }, far, grey, Some(100.0));
    unseen.max_depth = Some(5);
    for scene in [dark, unseen] {
        let film = image(&scene, SPP, 1);
        assert!(film.image().iter().all(|p| *p == [0.0; 3]));
        assert_eq!(film.record().rejected, 0);
    }
}

/// The effects of a scene by name, each with the line that needs it.
fn called(scene: &Scene) -> Vec<(&'static str, u32)> {
    Effects::of(scene).called().iter().map(|c| (c.effect.name(), c.source.line)).collect()
}

#[test]
fn effects_each_with_its_object() {
    assert_eq!(called(&direct()), [("soft-shadows", 11)]);
    let with = |change: &dyn Fn(&mut Scene)| {
        let mut scene = direct();
        change(&mut scene);
        called(&scene)
    };
    let lamp = ("soft-shadows", 11);
    assert_eq!(with(&|s| add_sky(s, 1.0)), [lamp, ("several-lights", 200), ("environment", 200)]);
    assert_eq!(with(&|s| s.shapes[0].emission = s.shapes[1].emission), [("soft-shadows", 10), ("several-lights", 11)]);
    let kind = |kind: fn() -> MaterialKind| with(&move |s| s.materials[0].kind = kind());
    assert_eq!(kind(|| metal(0.2)), [lamp, ("glossy", 100)]);
    assert_eq!(kind(|| metal(0.0)), [lamp, ("mirror", 100)]);
    assert_eq!(kind(|| coated(0.5, 0.3)), [lamp, ("glossy", 100)]);
    assert_eq!(kind(|| coated(0.5, 0.0)), [lamp, ("mirror", 100)]);
    let remapped = Roughness::constant(1e-8, 1e-8, true);
    let MaterialKind::Conductor { fresnel, .. } = metal(0.2) else { unreachable!("a metal is a conductor") };
    let tiny = MaterialKind::Conductor { fresnel, roughness: remapped };
    assert_eq!(with(&|s| s.materials[0].kind = tiny.clone()), [lamp, ("mirror", 100)], "alpha is 1e-4");
    assert_eq!(with(&|s| s.camera.lens_radius = 0.1), [lamp, ("depth-of-field", 1)]);
    assert_eq!(with(&|s| s.max_depth = None)[1].0, "interreflection");
    assert_eq!(with(&|s| s.max_depth = Some(2))[1].0, "interreflection");
    assert_eq!(with(&|s| s.shapes[1].emission = None), []);
    assert_eq!(with(&|s| s.max_depth = Some(0)), [lamp]);

    let mut textured = direct();
    unused_features(&mut textured);
    textured.shapes[0].material = dapple_scene::MaterialId(3);
    assert_eq!(called(&textured), [lamp, ("textures", 301)]);
    assert!(Effects::of(&textured).called()[1].because.contains("\"unused\""), "the texture by its name");
}

type Change<'a> = &'a dyn Fn(&mut Scene);

/// Each effect that a scene needs is rendered: each changes the image.
#[test]
fn no_effect_is_skipped_l14() {
    let plain = hash(&image(&direct(), 4, 1));
    let black = Image::filled([2, 1], [0.0; 3]).expect("not empty");
    let changes: [(Effect, Change<'_>); 8] = [
        (Effect::SoftShadows, &|s| s.shapes[0].emission = s.shapes[1].emission),
        (Effect::SeveralLights, &|s| s.shapes[0].emission = s.shapes[1].emission),
        (Effect::Glossy, &|s| s.materials[0].kind = metal(0.2)),
        (Effect::Mirror, &|s| s.materials[0].kind = coated(0.5, 0.0)),
        (Effect::Interreflection, &|s| {
            s.max_depth = Some(2);
            let grey = s.shapes[0].material;
            let wall = rectangle(DVec3::new(0.0, 1.0, 1.0), DVec3::X, DVec3::Z);
            add(s, wall, DAffine3::IDENTITY, grey, None);
        }),
        (Effect::Textures, &|s| {
            unused_features(s);
            s.shapes[0].material = dapple_scene::MaterialId(3);
        }),
        (Effect::Environment, &|s| add_sky(s, 0.1)),
        (Effect::DepthOfField, &|s| {
            (s.camera.lens_radius, s.camera.focal_distance) = (0.2, 1.0);
            s.shapes[0].geometry = rectangle(DVec3::ZERO, DVec3::X, DVec3::Y);
        }),
    ];
    for (effect, change) in changes {
        let mut scene = direct();
        change(&mut scene);
        assert!(Effects::of(&scene).has(effect), "{effect}");
        assert_ne!(hash(&image(&scene, 4, 1)), plain, "{effect}");
    }
    // An image without light is no environment.
    let mut scene = direct();
    let radiance = EnvironmentRadiance::LatLong { image: Arc::new(black), scale: 1.0 };
    let kind = LightKind::Infinite { radiance };
    scene.lights.push(Light { kind, to_world: DAffine3::IDENTITY, source: line(200) });
    assert!(!Effects::of(&scene).has(Effect::Environment));
    assert_eq!(hash(&image(&scene, 4, 1)), plain);
}
