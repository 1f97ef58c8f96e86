//! Effects of a scene: each is found with its object, and idle objects call for none.

use crate::support::*;
use dapple_scene::image::Image;
use dapple_scene::{CalledEffect, Effect, Effects};
use dapple_scene::{
    Coating, Color, ConductorFresnel, Emission, EnvironmentRadiance, Geometry, Instance, Light, LightKind, Material,
    MaterialId, MaterialKind, Medium, MediumId, MediumInterface, Object, ObjectId, Roughness, Scalar, Scene, Shape,
    SpotFalloff, Texture, TextureId, TextureKind,
};
use glam::{DAffine3, DVec3};
use std::sync::Arc;

/// A grey floor and a lamp over it, seen through a pinhole; made of material 0, at lines 10 and 11.
fn plain() -> Scene {
    let mut scene = scene([8, 8], 40.0, DVec3::new(0.0, -3.0, 2.0), DVec3::ZERO);
    let grey = add_material(&mut scene, diffuse(0.5));
    add(&mut scene, rectangle(DVec3::ZERO, 20.0 * DVec3::X, 20.0 * DVec3::Y), DAffine3::IDENTITY, grey, None);
    add(&mut scene, rectangle(DVec3::new(0.0, 0.0, 3.5), DVec3::Y, DVec3::X), DAffine3::IDENTITY, grey, Some(4.0));
    scene.max_depth = Some(1);
    scene
}

fn with(change: impl FnOnce(&mut Scene)) -> Effects {
    let mut scene = plain();
    change(&mut scene);
    Effects::of(&scene)
}

/// The effects besides the lamp's, with the first object's line and the count of objects.
fn more(change: impl FnOnce(&mut Scene)) -> Vec<(Effect, u32, usize)> {
    let effects = with(change);
    let own = |c: &&CalledEffect| c.effect != Effect::SoftShadows;
    effects.called().iter().filter(own).map(|c| (c.effect, c.source.line, c.objects)).collect()
}

const NONE: [(Effect, u32, usize); 0] = [];

/// One more shape of a material of its own; gives its number.
fn wear(scene: &mut Scene, kind: MaterialKind) -> usize {
    let material = add_material(scene, kind);
    add(scene, Geometry::Sphere { radius: 0.2 }, DAffine3::IDENTITY, material, None)
}

fn glass(alpha: f32) -> MaterialKind {
    let white = Color::Constant([1.0; 3]);
    let roughness = Roughness::constant(alpha, alpha, false);
    MaterialKind::Dielectric { eta: 1.5, roughness, reflectance: white, transmittance: white }
}

/// A texture of two colors, at line 300 and on.
fn add_texture(scene: &mut Scene) -> TextureId {
    let colors = [[0.2; 3], [0.6; 3]].map(Color::Constant);
    let kind = TextureKind::Checkerboard { scale: [4.0; 2], shift: [0.0; 2], colors };
    let number = scene.textures.len() as u32;
    scene.textures.push(Texture { name: format!("texture{number}"), kind, source: line(300 + number) });
    TextureId(number)
}

fn add_light(scene: &mut Scene, kind: LightKind) {
    let number = scene.lights.len() as u32;
    scene.lights.push(Light { kind, to_world: DAffine3::IDENTITY, source: line(200 + number) });
}

fn spot(intensity: f32) -> LightKind {
    let falloff = SpotFalloff::Smoothstep;
    LightKind::Spot { intensity: [intensity; 3], cone: 30.0, falloff_start: 20.0, falloff }
}

fn add_medium(scene: &mut Scene, absorption: f32, scattering: f32) -> MediumId {
    let number = scene.media.len() as u32;
    let (absorption, scattering) = ([absorption; 3], [0.0, scattering, 0.0]);
    let name = format!("medium{number}");
    scene.media.push(Medium { name, absorption, scattering, g: 0.0, source: line(500 + number) });
    MediumId(number)
}

/// A ball of a material as an object, at line 400; it stands `places` times, at lines 410 and on.
fn add_object(scene: &mut Scene, material: MaterialId, places: u32) -> usize {
    let ball = Shape::new(Geometry::Sphere { radius: 0.1 }, DAffine3::IDENTITY, material, line(401));
    scene.objects.push(Object { name: "ball".into(), shapes: vec![ball], source: line(400) });
    let object = ObjectId(scene.objects.len() as u32 - 1);
    for i in 0..places {
        let to_world = DAffine3::from_translation(DVec3::X * f64::from(i));
        scene.instances.push(Instance { object, to_world, moves_to: None, source: line(410 + i) });
    }
    object.0 as usize
}

#[test]
fn lights_that_give_light() {
    assert_eq!(
        with(|_| {}).called().iter().map(|c| (c.effect, c.objects)).collect::<Vec<_>>(),
        [(Effect::SoftShadows, 1)]
    );
    let lamps = with(|s| {
        s.shapes[0].emission = s.shapes[1].emission;
        add_light(s, LightKind::Point { intensity: [0.0, 1.0, 0.0] });
        add_light(s, spot(1.0));
        add_light(s, LightKind::Distant { irradiance: [1.0; 3] });
        add_sky(s, 1.0);
    });
    let found: Vec<_> = lamps.called().iter().map(|c| (c.effect, c.source.line, c.objects)).collect();
    assert_eq!(found, [(Effect::SoftShadows, 10, 2), (Effect::SeveralLights, 11, 6), (Effect::Environment, 200, 1)]);
    // Idle: no light, no area.
    assert_eq!(
        more(|s| {
            add_light(s, LightKind::Point { intensity: [0.0; 3] });
            add_light(s, spot(0.0));
            add_light(s, LightKind::Distant { irradiance: [0.0; 3] });
            add_sky(s, 0.0);
            let black = Image::filled([2, 2], [0.0; 3]).expect("not empty");
            let lit = Arc::new(Image::filled([2, 2], [1.0; 3]).expect("not empty"));
            let (image, scale) = (Arc::new(black), 1.0);
            for radiance in [
                EnvironmentRadiance::LatLong { image: image.clone(), scale },
                EnvironmentRadiance::EqualArea { image, scale },
                EnvironmentRadiance::EqualArea { image: lit, scale: 0.0 },
            ] {
                add_light(s, LightKind::Infinite { radiance });
            }
            s.shapes[0].emission = Some(Emission::even([0.0; 3], true));
            let point = add(s, polygon(&[DVec3::Z; 3]), DAffine3::IDENTITY, MaterialId(0), Some(9.0));
            assert_eq!(point, 2);
        }),
        NONE
    );
    // What is no number is called for: the world refuses it.
    assert!(with(|s| s.shapes[0].emission = Some(Emission::even([f32::NAN; 3], false))).has(Effect::SeveralLights));
}

#[test]
fn surfaces_by_their_lobes() {
    use Effect::{Glossy, Mirror, Refraction};
    let (white, black) = (Color::Constant([1.0; 3]), Color::Constant([0.0; 3]));
    let rough = |alpha| Roughness::constant(alpha, alpha, false);
    let metal_of = |roughness| {
        let fresnel = ConductorFresnel::Reflectance(white);
        MaterialKind::Conductor { fresnel, roughness }
    };
    let lacquer = |metal, coat| MaterialKind::CoatedConductor {
        fresnel: ConductorFresnel::Reflectance(white),
        roughness: rough(metal),
        coat: Coating { roughness: rough(coat), ..Coating::default() },
    };
    let plastic = |specular, alpha| MaterialKind::Plastic { diffuse: white, specular, roughness: rough(alpha) };
    let cases: [(MaterialKind, &[Effect]); 21] = [
        (diffuse(0.2), &[]),
        (MaterialKind::DiffuseTransmission { reflectance: white, transmittance: white }, &[]),
        (metal(0.2), &[Glossy]),
        (metal(0.0), &[Mirror]),
        // Roughness 1e-8, remapped, is alpha 1e-4: smooth. The wider of two decides.
        (metal_of(Roughness::constant(1e-8, 1e-8, true)), &[Mirror]),
        (metal_of(Roughness::constant(0.0, 0.1, false)), &[Glossy]),
        (coated(0.5, 0.0), &[Mirror]),
        (coated(0.5, 0.1), &[Glossy]),
        (lacquer(0.1, 0.0), &[Glossy, Mirror]),
        (lacquer(0.1, 0.1), &[Glossy]),
        (plastic(white, 0.1), &[Glossy]),
        (plastic(white, 0.0), &[Mirror]),
        (plastic(black, 0.1), &[]),
        // It reflects at grazing angles.
        (MaterialKind::Substrate { diffuse: white, specular: black, roughness: rough(0.1) }, &[Glossy]),
        (MaterialKind::Mirror { reflectance: white }, &[Mirror]),
        (MaterialKind::Mirror { reflectance: black }, &[]),
        (glass(0.0), &[Refraction]),
        (glass(0.3), &[Glossy, Refraction]),
        (MaterialKind::ThinDielectric { eta: 1.5 }, &[Refraction]),
        (MaterialKind::Dielectric { eta: 1.5, roughness: rough(0.0), reflectance: black, transmittance: black }, &[]),
        (MaterialKind::Interface, &[]),
    ];
    for (kind, expected) in cases {
        let found = more(|s| s.materials[0].kind = kind.clone());
        assert_eq!(found, expected.iter().map(|effect| (*effect, 100, 1)).collect::<Vec<_>>(), "{kind:?}");
    }
}

#[test]
fn only_what_can_be_seen() {
    use Effect::{Glossy, Mirror, Refraction};
    // Unused.
    assert_eq!(more(|s| _ = add_material(s, metal(0.1))), NONE);
    assert_eq!(
        more(|s| {
            let gold = add_material(s, metal(0.1));
            add_object(s, gold, 0);
        }),
        NONE,
        "the object stands nowhere"
    );
    // Through an instance.
    let gold = more(|s| {
        let gold = add_material(s, metal(0.1));
        add_object(s, gold, 3);
    });
    assert_eq!(gold, [(Glossy, 101, 1)]);
    // Two materials, the first in the file is told.
    let two = more(|s| {
        wear(s, metal(0.3));
        wear(s, coated(0.5, 0.1));
    });
    assert_eq!(two, [(Glossy, 101, 2)]);
    // Through a mix: what the share lets through, also of mixes, also in circles.
    let mix = |amount: Scalar| {
        more(|s| {
            let (rough, smooth) = (add_material(s, metal(0.2)), add_material(s, metal(0.0)));
            let inner = add_material(s, MaterialKind::Mix { materials: [rough, smooth], amount });
            let amount = Scalar::Constant(0.5);
            let outer = MaterialKind::Mix { materials: [inner, MaterialId(5)], amount };
            wear(s, outer);
            let glass = add_material(s, glass(0.0));
            assert_eq!(glass, MaterialId(5));
        })
    };
    let all = [(Glossy, 101, 1), (Mirror, 102, 1), (Refraction, 105, 1)];
    assert_eq!(mix(Scalar::Constant(0.5)), all);
    assert_eq!(mix(Scalar::Constant(f32::NAN)), all, "not decided: called for");
    assert_eq!(mix(Scalar::Constant(0.0)), [all[0], all[2]]);
    assert_eq!(mix(Scalar::Constant(1.0)), [all[1], all[2]]);
    let textured = mix(Scalar::Texture(TextureId(0)));
    assert_eq!(textured, [all[0], all[1], all[2], (Effect::Textures, 103, 1)]);
    let circle = more(|s| {
        let amount = Scalar::Constant(0.5);
        s.materials[0].kind = MaterialKind::Mix { materials: [MaterialId(0), MaterialId(9)], amount };
    });
    assert_eq!(circle, NONE, "and it ends");
}

#[test]
fn textures_wherever_they_are() {
    let (grey, rough) = (Color::Constant([0.5; 3]), Roughness::constant(0.1, 0.1, false));
    let metal_of = |fresnel, roughness| MaterialKind::Conductor { fresnel, roughness };
    let id = TextureId(0);
    let color = Color::Texture(id);
    let (v, eta) = (Scalar::Constant(0.1), ConductorFresnel::EtaK { eta: [1.0; 3], k: [1.0; 3] });
    let scratched = metal_of(eta, Roughness { u: Scalar::Texture(id), v, remap: false });
    let textured = |kind: MaterialKind| {
        with(|s| {
            add_texture(s);
            s.materials[0].kind = kind;
        })
    };
    for (kind, what) in [
        (MaterialKind::Diffuse { reflectance: color }, "color"),
        (metal_of(ConductorFresnel::Reflectance(color), rough), "color"),
        (MaterialKind::DiffuseTransmission { reflectance: grey, transmittance: color }, "transmitted color"),
        (scratched.clone(), "roughness"),
        (MaterialKind::Substrate { diffuse: grey, specular: color, roughness: rough }, "specular color"),
    ] {
        let effects = textured(kind);
        let called = effects.called().iter().find(|c| c.effect == Effect::Textures).expect(what);
        assert_eq!(called.because, format!("material \"material0\" uses texture \"texture0\" ({what})"));
    }
    // A textured roughness may be smooth here and rough there.
    let either = textured(scratched);
    assert!(either.has(Effect::Glossy) && either.has(Effect::Mirror));
    // Bumps, normals, holes.
    let bump = |bump: fn(&mut Material, TextureId)| {
        more(|s| {
            let id = add_texture(s);
            bump(&mut s.materials[0], id);
        })
    };
    let textures = [(Effect::Textures, 100, 1)];
    assert_eq!(bump(|m, id| m.bump = Some(Scalar::Texture(id))), textures);
    assert_eq!(bump(|m, id| m.normal_map = Some(id)), textures);
    assert_eq!(bump(|m, _| m.bump = Some(Scalar::Constant(2.0))), NONE, "a constant height is none");
    let holes = more(|s| {
        let id = add_texture(s);
        s.shapes[0].alpha = Some(Scalar::Texture(id));
    });
    assert_eq!(holes, [(Effect::Textures, 10, 1), (Effect::Transparency, 10, 1)]);
    assert_eq!(more(|s| _ = add_texture(s)), NONE, "unused");
    let unworn = more(|s| {
        let id = add_texture(s);
        add_material(s, MaterialKind::Diffuse { reflectance: Color::Texture(id) });
    });
    assert_eq!(unworn, NONE);
}

#[test]
fn holes() {
    let alpha = |alpha| more(|s| s.shapes[0].alpha = Some(Scalar::Constant(alpha)));
    let found = [(Effect::Transparency, 10, 1)];
    assert_eq!((alpha(0.5), alpha(0.0), alpha(f32::NAN)), (found.to_vec(), found.to_vec(), found.to_vec()));
    assert_eq!((alpha(1.0), alpha(2.0)), (NONE.to_vec(), NONE.to_vec()), "idle");
    let inside = |places| {
        more(|s| {
            let object = add_object(s, MaterialId(0), places);
            s.objects[object].shapes[0].alpha = Some(Scalar::Constant(0.5));
        })
    };
    assert_eq!(inside(0), NONE);
    assert_eq!(inside(2), [(Effect::Transparency, 401, 1)]);
}

#[test]
fn media_that_do_something() {
    use Effect::{AbsorbingMedia, Interreflection, ScatteringMedia};
    let around = |absorption, scattering| more(|s| s.camera.medium = Some(add_medium(s, absorption, scattering)));
    assert_eq!(around(0.5, 0.0), [(AbsorbingMedia, 500, 1)]);
    assert_eq!(around(0.0, 0.5), [(ScatteringMedia, 500, 1)]);
    assert_eq!(around(0.5, 0.5), [(AbsorbingMedia, 500, 1), (ScatteringMedia, 500, 1)]);
    assert_eq!(around(0.0, 0.0), NONE, "idle");
    assert_eq!(more(|s| _ = add_medium(s, 1.0, 1.0)), NONE, "unused");
    let border = more(|s| {
        let (water, fog) = (add_medium(s, 1.0, 0.0), add_medium(s, 0.0, 1.0));
        s.shapes[0].media = Some(MediumInterface { inside: Some(water), outside: Some(fog) });
    });
    assert_eq!(border, [(AbsorbingMedia, 500, 1), (ScatteringMedia, 501, 1)]);
    // Fog scatters, also where no surface does.
    let fog = more(|s| {
        s.camera.medium = Some(add_medium(s, 0.0, 1.0));
        s.materials[0].kind = diffuse(0.0);
        s.max_depth = None;
    });
    assert_eq!(fog, [(Interreflection, 0, 1), (ScatteringMedia, 500, 1)]);
}

#[test]
fn depth_and_lens() {
    let depth = |depth| more(|s| s.max_depth = depth);
    for called in [Some(2), Some(7), None] {
        assert_eq!(depth(called), [(Effect::Interreflection, 0, 1)]);
    }
    assert_eq!((depth(Some(1)), depth(Some(0))), (NONE.to_vec(), NONE.to_vec()));
    let black = more(|s| {
        s.max_depth = None;
        s.materials[0].kind = diffuse(0.0);
    });
    assert_eq!(black, NONE, "nothing scatters");
    let effects = with(|s| s.max_depth = Some(7));
    assert!(effects.called()[1].because.contains("up to 7 ") && effects.max_depth() == Some(7));

    assert_eq!(more(|s| s.camera.lens_radius = 0.1), [(Effect::DepthOfField, 1, 1)]);
    assert_eq!(more(|s| s.camera.lens_radius = f64::NAN), [(Effect::DepthOfField, 1, 1)]);
    assert_eq!(more(|s| s.camera.focal_distance = 2.0), NONE, "idle");
}

#[test]
fn motion_while_the_shutter_is_open() {
    let there = DAffine3::from_translation(DVec3::Z);
    let blur = |line, objects| vec![(Effect::MotionBlur, line, objects)];
    assert_eq!(more(|s| s.shapes[0].moves_to = Some(there)), blur(10, 1));
    assert_eq!(more(|s| s.camera.moves_to = Some(there)), blur(1, 1));
    let both = more(|s| {
        s.camera.moves_to = Some(there);
        s.shapes[1].moves_to = Some(there);
    });
    assert_eq!(both, blur(1, 2));
    let instance = |moves: bool, unused: bool| {
        more(|s| {
            let object = add_object(s, MaterialId(0), 2);
            s.instances[1].moves_to = moves.then_some(there);
            if unused {
                s.objects[object].shapes.clear();
            }
        })
    };
    assert_eq!(instance(true, false), blur(411, 1));
    assert_eq!((instance(false, false), instance(true, true)), (vec![], vec![]));
    // Idle: it moves to where it is, or never while the shutter is open.
    assert_eq!(more(|s| s.shapes[0].moves_to = Some(s.shapes[0].to_world)), NONE);
    for (shutter, motion_times, expected) in [
        ([0.5, 0.5], [0.0, 1.0], vec![]),
        // Equal times are 0 to 1, as in the renderer.
        ([0.0, 1.0], [0.0, 0.0], blur(10, 1)),
        ([0.0, 1.0], [2.0, 2.0], blur(10, 1)),
        ([2.0, 3.0], [2.0, 2.0], vec![]),
        ([0.0, 1.0], [1.0, 2.0], vec![]),
        ([2.0, 3.0], [1.0, 2.0], vec![]),
        ([0.0, 1.5], [1.0, 2.0], blur(10, 1)),
        ([f64::NAN, 1.0], [0.0, 1.0], blur(10, 1)),
    ] {
        let found = more(|s| {
            (s.shapes[0].moves_to, s.camera.shutter, s.motion_times) = (Some(there), shutter, motion_times);
        });
        assert_eq!(found, expected, "{shutter:?} {motion_times:?}");
    }
}

/// A small lamp over a glass ball, and what keeps its light from being found by chance only.
#[test]
fn light_found_by_chance() {
    let chance = |change: &dyn Fn(&mut Scene)| {
        let mut scene = plain();
        scene.max_depth = Some(5);
        scene.shapes[1].geometry = rectangle(DVec3::new(0.0, 0.0, 3.5), 0.01 * DVec3::Y, 0.01 * DVec3::X);
        wear(&mut scene, glass(0.0));
        change(&mut scene);
        Effects::found_by_chance(&scene)
    };
    let found = chance(&|_| {}).expect("4e-4 m2 at 3.5 m are 3.3e-5 sr");
    assert_eq!((found.effect, found.source.line, found.objects), (Effect::Refraction, 11, 1));
    assert!(
        found.because.contains("\"material1\" (made.pbrt:12) refracts light from a small source (3.3e-5 sr)"),
        "{found:?}"
    );

    let large = |s: &mut Scene| s.shapes[1].geometry = rectangle(DVec3::new(0.0, 0.0, 3.5), DVec3::Y, DVec3::X);
    assert_eq!(chance(&large), None);
    assert_eq!(chance(&|s| s.max_depth = Some(1)), None);
    assert_eq!(chance(&|s| s.materials[1].kind = glass(0.3)), None, "light samples go through what is rough");
    assert_eq!(chance(&|s| s.materials[1].kind = metal(0.0)), None);
    assert_eq!(chance(&|s| s.shapes[2].material = MaterialId(0)), None, "unused");
    // Beside a strong light, a weak one does not count.
    let strong = |s: &mut Scene| add_sky(s, 1.0);
    assert_eq!(chance(&strong), None);
    // Through an instance, or a mix.
    let instance = |s: &mut Scene| {
        s.shapes.truncate(2);
        add_object(s, MaterialId(1), 1);
    };
    assert_eq!(chance(&instance).map(|c| c.objects), Some(1));
    let mixed = |s: &mut Scene| {
        let materials = [MaterialId(2), MaterialId(1)];
        let mix = add_material(s, MaterialKind::Mix { materials, amount: Scalar::Constant(0.5) });
        s.shapes[2].material = mix;
    };
    assert_eq!(chance(&mixed).map(|c| c.objects), Some(1));
    // Points fill nothing.
    let point = |s: &mut Scene| {
        large(s);
        add_light(s, LightKind::Point { intensity: [1e3; 3] });
        add_light(s, spot(1e5));
    };
    let found = chance(&point).expect("a point");
    assert!((found.source.line, found.objects) == (200, 2) && found.because.contains("paths never hit"), "{found:?}");
}

#[test]
fn names_are_distinct_and_parse() {
    for (i, effect) in Effect::ALL.into_iter().enumerate() {
        assert_eq!(effect.name().parse(), Ok(effect));
        assert_eq!(effect as usize, i, "in the order of ALL");
    }
    let near = "soft-shadow".parse::<Effect>().map_err(|e| e.to_string());
    assert_eq!(near, Err("unknown effect \"soft-shadow\"; did you mean \"soft-shadows\"?".into()));
    let wrong = "soft".parse::<Effect>().map_err(|e| e.to_string());
    assert!(wrong.is_err_and(|e| e.starts_with("unknown effect \"soft\"; choose among soft-shadows, several")));
}
