//! Effects are rendered, refused or left out on request, and cost nothing in scenes without them.

use crate::support::*;
use dapple_core::{PointSet, SampleId};
use dapple_low_discrepancy::Sobol;
use dapple_renderer::{World, blocks, without};
use dapple_scene::{
    Color, Emission, Geometry, MaterialKind, Medium, MediumId, MediumInterface, Roughness, Scalar, Scene, Texture,
    TextureId, TextureKind,
};
use dapple_scene::{Effect, Effects};
use glam::{DAffine3, DVec3};
use std::collections::BTreeMap;
use std::sync::Mutex;

const SIZE: [u32; 2] = [16, 12];
const SPP: u64 = 8;

/// A ball on a floor under a lamp of the least size that still emits: direct light only.
fn plain() -> Scene {
    let mut scene = scene(SIZE, 40.0, DVec3::new(0.0, -3.0, 2.0), DVec3::new(0.0, 0.0, 0.3));
    let grey = add_material(&mut scene, diffuse(0.5));
    let ball = add_material(&mut scene, diffuse(0.5));
    add(&mut scene, rectangle(DVec3::ZERO, 2.0 * DVec3::X, 2.0 * DVec3::Y), DAffine3::IDENTITY, grey, None);
    let up = DAffine3::from_translation(DVec3::new(0.0, 0.0, 0.5));
    add(&mut scene, Geometry::Sphere { radius: 0.5 }, up, ball, None);
    add(&mut scene, rectangle(DVec3::new(0.0, 0.0, 3.5), DVec3::Y, DVec3::X), DAffine3::IDENTITY, grey, Some(4.0));
    scene.max_depth = Some(1);
    scene
}

/// The plain scene with one more effect (it has soft shadows).
fn with(effect: Effect) -> Scene {
    let mut scene = plain();
    let white = Color::Constant([1.0; 3]);
    let add_medium = |scene: &mut Scene, absorption, scattering| {
        let name = "fog".into();
        scene.media.push(Medium {
            name,
            absorption: [absorption; 3],
            scattering: [scattering; 3],
            g: 0.0,
            source: line(500),
        });
        scene.camera.medium = Some(MediumId(0));
        let around = MediumInterface { inside: Some(MediumId(0)), outside: Some(MediumId(0)) };
        scene.shapes.iter_mut().for_each(|s| s.media = Some(around));
    };
    match effect {
        Effect::SoftShadows => {}
        Effect::SeveralLights => {
            scene.shapes[1].emission = Some(Emission { radiance: [1.0; 3], two_sided: false });
        }
        Effect::Glossy => scene.materials[1].kind = metal(0.2),
        Effect::Mirror => {
            scene.materials[1].kind = metal(0.0);
            scene.max_depth = Some(2);
        }
        Effect::Refraction => {
            let roughness = Roughness::constant(0.0, 0.0, false);
            scene.materials[1].kind =
                MaterialKind::Dielectric { eta: 1.5, roughness, reflectance: white, transmittance: white };
            scene.max_depth = Some(4);
        }
        Effect::Interreflection => scene.max_depth = Some(3),
        Effect::Textures => {
            let colors = [[0.2; 3], [0.8; 3]].map(Color::Constant);
            let kind = TextureKind::Checkerboard { scale: [4.0; 2], shift: [0.0; 2], colors };
            scene.textures.push(Texture { name: "tiles".into(), kind, source: line(300) });
            scene.materials[0].kind = MaterialKind::Diffuse { reflectance: Color::Texture(TextureId(0)) };
        }
        Effect::Environment => add_sky(&mut scene, 0.3),
        Effect::DepthOfField => (scene.camera.lens_radius, scene.camera.focal_distance) = (0.2, 1.0),
        Effect::MotionBlur => scene.shapes[1].moves_to = Some(DAffine3::from_translation(DVec3::X)),
        Effect::Transparency => scene.shapes[1].alpha = Some(Scalar::Constant(0.7)),
        Effect::AbsorbingMedia => add_medium(&mut scene, 0.2, 0.0),
        Effect::ScatteringMedia => add_medium(&mut scene, 0.0, 0.2),
        other => panic!("a new effect needs a scene: {other}"),
    }
    scene
}

/// A scene's effects are rendered, or refused by name and line; never left out silently. Leaving one out on request
/// gives another image.
#[test]
fn needed_effects_are_rendered_or_refused_l14() {
    for effect in Effect::ALL {
        let scene = with(effect);
        assert!(Effects::of(&scene).has(effect), "{effect}");
        let less = without(&scene, effect).unwrap_or_else(|e| panic!("{effect}: {e}"));
        assert!(!Effects::of(&less).has(effect), "{effect}");
        match World::new(&scene) {
            Err(refused) => {
                assert!(refused.problems.iter().all(|p| p.starts_with("made.pbrt:")), "{effect}: {refused}");
            }
            Ok(world) => {
                let whole = film_of(&world, SIZE, SPP, Sobol::new(1));
                let less = World::new(&less).unwrap_or_else(|e| panic!("without {effect}: {e}"));
                assert_ne!(hash(&whole), hash(&film_of(&less, SIZE, SPP, Sobol::new(1))), "{effect}");
            }
        }
    }
}

/// Leaving out an absent effect changes nothing: for every effect, in a scene with every other one.
#[test]
fn leaving_out_unused_effects_changes_no_bit_l14() {
    for present in Effect::ALL {
        let scene = with(present);
        let Ok(world) = World::new(&scene) else { continue };
        let expected = hash(&film_of(&world, SIZE, 4, Sobol::new(1)));
        let effects = Effects::of(&scene);
        for absent in Effect::ALL.into_iter().filter(|e| !effects.has(*e)) {
            let same = without(&scene, absent).unwrap_or_else(|e| panic!("{absent}: {e}"));
            assert_eq!(hash(&image(&same, 4, 1)), expected, "{present} without {absent}");
        }
    }
}

/// Clear air and an opacity of 1 call for no effect: the path tracer without code for media and alpha renders the same
/// bits as a scene without either.
#[test]
fn clear_media_and_opaque_alpha_change_no_bit_l14() {
    let expected = hash(&image(&plain(), 4, 1));
    let mut clear = with(Effect::ScatteringMedia);
    clear.media[0].scattering = [0.0; 3];
    let mut opaque = with(Effect::Transparency);
    opaque.shapes[1].alpha = Some(Scalar::Constant(1.0));
    for (name, scene) in [("clear air", clear), ("an opacity of 1", opaque)] {
        assert_eq!(Effects::of(&scene).called(), Effects::of(&plain()).called(), "{name}");
        assert_eq!(hash(&image(&scene, 4, 1)), expected, "{name}");
    }
    // The control.
    let thin = with(Effect::ScatteringMedia);
    assert_ne!(hash(&image(&thin, 4, 1)), expected);
}

/// The number of requests of each block.
struct Counted(Sobol, Mutex<BTreeMap<u32, u64>>);

impl PointSet for &Counted {
    fn describe(&self) -> String {
        self.0.describe()
    }

    fn block(&self, id: SampleId, block: u32) -> [f32; 4] {
        *self.1.lock().expect("no test panics here").entry(block).or_default() += 1;
        self.0.block(id, block)
    }

    fn capacity(&self) -> u64 {
        self.0.capacity()
    }
}

fn asked(scene: &Scene) -> (BTreeMap<u32, u64>, u64) {
    let counted = Counted(Sobol::new(1), Mutex::default());
    let film = film_of(&world(scene), SIZE, SPP, &counted);
    (counted.1.into_inner().expect("no test panics here"), film.record().rays)
}

/// The simplest scene requests the blocks of the camera and of the first event. Choices, lens and later events cost
/// nothing until an effect needs them. Leaving that effect out saves exactly its cost.
#[test]
fn absent_effects_request_no_blocks_and_no_rays_l14() {
    let scene = plain();
    let (plain, rays) = asked(&scene);
    assert_eq!(plain.keys().copied().collect::<Vec<_>>(), [blocks::CAMERA.number(), blocks::scatter(0).number()]);
    for effect in [Effect::SeveralLights, Effect::Environment, Effect::Interreflection, Effect::DepthOfField] {
        let more = with(effect);
        let (with, with_rays) = asked(&more);
        assert_ne!((&with, with_rays), (&plain, rays), "{effect}");
        let less = without(&more, effect).unwrap_or_else(|e| panic!("{effect}: {e}"));
        let again = (effect != Effect::SeveralLights).then(|| asked(&less));
        assert!(again.is_none_or(|again| again == (plain.clone(), rays)), "{effect}");
    }
    let (two, _) = asked(&with(Effect::SeveralLights));
    let chosen = two.get(&blocks::choose(0).number());
    assert!(chosen.is_some_and(|&n| n > 0) && !plain.contains_key(&blocks::choose(0).number()));
}
