//! Scenes with one of their effects left out: other descriptions for the same renderer.

use crate::support::*;
use dapple_core::samplers::Uniform;
use dapple_core::{Frame, Limits};
use dapple_low_discrepancy::Sobol;
use dapple_scene::image::Image;
use dapple_scene::{
    Color, ConductorFresnel, Emission, Geometry, LightKind, MaterialKind, Medium, MediumId, MediumInterface, Object,
    Roughness, Scalar, Scene, Shape, Texture, TextureId, TextureKind, WithoutError, Wrap,
};
use dapple_scene::{Effect, Effects};
use glam::{DAffine3, DVec3};
use std::f64::consts::PI;
use std::sync::Arc;

const SIZE: [u32; 2] = [24, 16];

/// A room with lamps, metals, a coat and a sky, through a lens, with a texture on the floor.
fn full() -> Scene {
    let mut scene = room(SIZE);
    (scene.camera.lens_radius, scene.camera.focal_distance) = (0.05, 4.5);
    let colors = [[0.2; 3], [0.6; 3]].map(Color::Constant);
    let kind = TextureKind::Checkerboard { scale: [8.0; 2], shift: [0.0; 2], colors };
    scene.textures.push(Texture { name: "tiles".into(), kind, source: line(300) });
    let tiled = add_material(&mut scene, MaterialKind::Diffuse { reflectance: Color::Texture(TextureId(0)) });
    scene.shapes[0].material = tiled;
    scene
}

fn without(scene: &Scene, effect: Effect) -> Scene {
    dapple_renderer::without(scene, effect).unwrap_or_else(|e| panic!("{e}"))
}

/// The room's effects can be left out one by one, in any order. Each time another scene remains, with another image.
#[test]
fn each_effect_goes_alone_and_all_go_together() {
    let scene = full();
    let called: Vec<Effect> = Effects::of(&scene).called().iter().map(|c| c.effect).collect();
    let expected = [
        Effect::SoftShadows,
        Effect::SeveralLights,
        Effect::Glossy,
        Effect::Mirror,
        Effect::Interreflection,
        Effect::Textures,
        Effect::Environment,
        Effect::DepthOfField,
    ];
    assert_eq!(called, expected);
    let whole = hash(&image(&scene, 4, 1));
    for &effect in &called {
        let less = without(&scene, effect);
        assert!(!Effects::of(&less).has(effect), "{effect}");
        assert_ne!(hash(&image(&less, 4, 1)), whole, "{effect}");
    }
    // The choice among the remaining lights comes last: with the sky as the strongest, no other light would remain.
    let others = called.iter().copied().filter(|e| *e != Effect::SeveralLights);
    for mut order in [others.clone().collect::<Vec<_>>(), others.rev().collect()] {
        order.push(Effect::SeveralLights);
        let less = order.iter().fold(scene.clone(), |scene, effect| without(&scene, *effect));
        assert_eq!(Effects::of(&less).called(), [], "{order:?}");
        assert!(mean(&image(&less, 4, 1))[0] > 0.0);
    }
}

/// Leaving out an absent effect changes no bit.
#[test]
fn leaving_out_absent_effects_changes_no_bit_l14() {
    let mut plain = scene(SIZE, 40.0, DVec3::new(0.0, -3.0, 2.0), DVec3::ZERO);
    let grey = add_material(&mut plain, diffuse(0.5));
    add(&mut plain, rectangle(DVec3::ZERO, DVec3::X, DVec3::Y), DAffine3::IDENTITY, grey, None);
    add(&mut plain, Geometry::Sphere { radius: 0.3 }, DAffine3::from_translation(DVec3::Z), grey, Some(4.0));
    // Unused objects of every kind, which the edits could touch.
    add_material(&mut plain, metal(0.2));
    add_material(&mut plain, metal(0.0));
    let colors = [Color::Constant([1.0; 3]), Color::Constant([0.0; 3])];
    let kind = TextureKind::Checkerboard { scale: [4.0; 2], shift: [0.0; 2], colors };
    plain.textures.push(Texture { name: "unused".into(), kind, source: line(300) });
    add_material(&mut plain, MaterialKind::Diffuse { reflectance: Color::Texture(TextureId(0)) });
    add_sky(&mut plain, 0.0);
    let expected = hash(&image(&plain, 8, 1));
    let idle = Effect::ALL.into_iter().filter(|e| !Effects::of(&plain).has(*e));
    let mut tried = 0;
    for effect in idle {
        assert_eq!(hash(&image(&without(&plain, effect), 8, 1)), expected, "{effect}");
        tried += 1;
    }
    assert_eq!(tried, 11, "all but soft shadows and interreflection");
    // The control.
    let less = without(&plain, Effect::Interreflection);
    assert_ne!(hash(&image(&less, 8, 1)), expected);
}

#[test]
fn the_last_light_does_not_go() {
    let mut scene = scene(SIZE, 40.0, DVec3::new(0.0, -3.0, 2.0), DVec3::ZERO);
    let grey = add_material(&mut scene, diffuse(0.5));
    add(&mut scene, rectangle(DVec3::ZERO, DVec3::X, DVec3::Y), DAffine3::IDENTITY, grey, None);
    add_sky(&mut scene, 1.0);
    let error = dapple_renderer::without(&scene, Effect::Environment).err();
    assert_eq!(error, Some(WithoutError::NoLight { effect: Effect::Environment }));
    // A dark scene has none to lose.
    scene.lights.clear();
    assert!(dapple_renderer::without(&scene, Effect::Environment).is_ok());
}

/// Small lights replace lamps: the same power, and the same image from afar.
#[test]
fn lamps_become_points_of_the_same_power() {
    let far = |geometry: Geometry, to_world: DAffine3, two_sided: bool| {
        let mut scene = scene([8, 8], 40.0, DVec3::new(0.0, -3.0, 2.0), DVec3::ZERO);
        let grey = add_material(&mut scene, diffuse(0.5));
        add(&mut scene, rectangle(DVec3::ZERO, DVec3::X, DVec3::Y), DAffine3::IDENTITY, grey, None);
        let lamp = add(&mut scene, geometry, to_world, grey, Some(100.0));
        scene.shapes[lamp].emission = Some(Emission { radiance: [100.0, 50.0, 25.0], two_sided });
        scene.max_depth = Some(1);
        let points = without(&scene, Effect::SoftShadows);
        assert_eq!(points.shapes.len(), 1, "the lamp's body goes");
        let (lamp, point) = (mean(&image(&scene, 256, 1)), mean(&image(&points, 256, 1)));
        for c in 0..3 {
            assert!((point[c] / lamp[c] - 1.0).abs() < 0.01, "{point:?} {lamp:?}");
        }
        points
    };
    let up = DAffine3::from_translation(DVec3::new(0.0, 0.0, 12.0));
    let down = rectangle(DVec3::ZERO, 0.25 * DVec3::Y, 0.25 * DVec3::X);
    let one = far(down.clone(), up, false);
    assert!(matches!(one.lights[0].kind, LightKind::Spot { intensity, .. } if (intensity[0] - 25.0).abs() < 1e-4));
    assert!(one.lights.len() == 1 && one.lights[0].source.line == 11);
    let two = far(down, up, true);
    assert_eq!(two.lights.len(), 2);
    let disk = Geometry::Disk { height: 0.0, radius: 0.3, inner_radius: 0.1 };
    far(disk, up * DAffine3::from_rotation_x(PI), false);
    let sphere = far(Geometry::Sphere { radius: 0.3 }, up, false);
    assert!(
        matches!(sphere.lights[0].kind, LightKind::Point { intensity } if (intensity[0] as f64 - PI * 9.0).abs() < 1e-3)
    );
    // A box looks smaller face on than on average. Its power stays.
    let mut box_lamp = full();
    box_lamp.shapes[5].geometry = Geometry::Mesh(Arc::new(cube()));
    let lights = without(&box_lamp, Effect::SoftShadows).lights;
    let LightKind::Point { intensity } = lights[2].kind else { panic!("{:?}", lights[2]) };
    assert!((f64::from(intensity[0]) - 24.0 * 12.0 / 4.0).abs() < 1e-3, "24 units of area, radiance 12: {intensity:?}");
}

#[test]
fn the_strongest_light_stays() {
    let scene = full();
    let world = world(&scene);
    let strongest = (0..3).max_by(|&a, &b| world.lights().pmf(a).total_cmp(&world.lights().pmf(b)));
    let less = without(&scene, Effect::SeveralLights);
    let kept = (
        less.shapes.iter().position(|s| s.emission.is_some()),
        less.lights.iter().position(|l| matches!(l.kind, LightKind::Infinite { .. })),
    );
    // The world's lights are the shapes 4 and 5, then the sky.
    let expected = [(Some(4), None), (Some(5), None), (None, Some(0))];
    assert_eq!(Some(kept), strongest.map(|i| expected[i as usize]), "{strongest:?}");
    assert_eq!(less.shapes.len(), scene.shapes.len(), "bodies stay");
    // Either lamp may be the stronger one.
    for (i, radiance) in [(4, 1e3), (5, 1e3)] {
        let mut scene = scene.clone();
        scene.shapes[i].emission = Some(Emission { radiance: [radiance; 3], two_sided: false });
        let less = without(&scene, Effect::SeveralLights);
        assert_eq!(less.shapes.iter().position(|s| s.emission.is_some()), Some(i));
        assert!(less.lights.is_empty());
    }
}

/// Energy is kept: under a constant sky, a plane looks the same from straight above.
#[test]
fn shiny_surfaces_become_diffuse_of_equal_brightness() {
    let tint = ConductorFresnel::Reflectance(Color::Constant([0.9, 0.6, 0.3]));
    let tinted = MaterialKind::Conductor { fresnel: tint, roughness: Roughness::constant(0.0, 0.0, false) };
    let mirror = MaterialKind::Mirror { reflectance: Color::Constant([0.5, 0.4, 0.3]) };
    let kinds = [
        (tinted, Effect::Mirror),
        (metal(0.0), Effect::Mirror),
        (coated(0.5, 0.0), Effect::Mirror),
        (metal(0.05), Effect::Glossy),
        (coated(0.7, 0.05), Effect::Glossy),
    ];
    for (kind, effect) in kinds {
        let mut scene = scene([4, 4], 1.0, DVec3::new(0.0, 0.0, 10.0), DVec3::ZERO);
        let material = add_material(&mut scene, kind.clone());
        add(&mut scene, rectangle(DVec3::ZERO, DVec3::X, DVec3::Y), DAffine3::IDENTITY, material, None);
        add_sky(&mut scene, 1.0);
        scene.max_depth = Some(3);
        let less = without(&scene, effect);
        assert!(matches!(less.materials[0].kind, MaterialKind::Diffuse { .. }));
        let (with, without) = (mean(&image(&scene, 256, 1)), mean(&image(&less, 256, 2)));
        for c in 0..3 {
            // Microfacets of alpha 0.05 lose almost nothing.
            assert!((with[c] - without[c]).abs() < 0.01, "{kind:?}: {with:?} {without:?}");
        }
    }
    let mut scene = full();
    scene.materials[0].kind = mirror;
    let less = without(&scene, Effect::Mirror);
    let kept = MaterialKind::Diffuse { reflectance: Color::Constant([0.5, 0.4, 0.3]) };
    assert_eq!(less.materials[0].kind, kept);
    assert_eq!(less.materials[1], scene.materials[1], "rough ones stay");
}

#[test]
fn a_textured_coat_keeps_its_texture() {
    let mut scene = full();
    let MaterialKind::CoatedDiffuse { reflectance, .. } = &mut scene.materials[3].kind else { panic!("a coat") };
    *reflectance = Color::Texture(TextureId(0));
    let less = without(&scene, Effect::Glossy);
    let MaterialKind::Diffuse { reflectance: Color::Texture(id) } = less.materials[3].kind else { panic!("{less:?}") };
    let TextureKind::Product { factors } = &less.textures[id.0 as usize].kind else { panic!("a product") };
    let Color::Constant(ratio) = factors[1] else { panic!("{factors:?}") };
    assert_eq!(factors[0], Color::Texture(TextureId(0)));
    // The mean is the coat's albedo over a base of the texture's mean, 0.4.
    let mut plain = scene.clone();
    plain.materials[3].kind = coated(0.4, 0.1);
    let MaterialKind::Diffuse { reflectance: Color::Constant(albedo) } =
        without(&plain, Effect::Glossy).materials[3].kind
    else {
        panic!("a diffuse surface")
    };
    assert!((ratio[1] * 0.4 - albedo[1]).abs() < 1e-6, "{ratio:?} {albedo:?}");
}

#[test]
fn glass_goes_or_turns_smooth() {
    let white = Color::Constant([1.0; 3]);
    let roughness = Roughness::constant(0.3, 0.3, false);
    let mut scene = full();
    scene.materials[1].kind =
        MaterialKind::Dielectric { eta: 1.5, roughness, reflectance: white, transmittance: white };
    scene.materials[2].kind = MaterialKind::ThinDielectric { eta: 1.5 };
    let clear = without(&scene, Effect::Glossy);
    assert!(
        matches!(&clear.materials[1].kind, MaterialKind::Dielectric { roughness, .. } if roughness.constants() == Some([0.0; 2]))
    );
    let gone = without(&scene, Effect::Refraction);
    assert!(gone.materials[1..3].iter().all(|m| m.kind == MaterialKind::Interface));
    assert!(Effects::of(&gone).has(Effect::Glossy), "the coat's, which stays");
}

#[test]
fn textures_become_their_means() {
    let mut scene = full();
    let image = Image::new([2, 1], vec![[0.0, 0.25, 1.0], [1.0, 0.75, 1.0]]).expect("two pixels");
    let image = Arc::new(image);
    let image = |factor, invert| TextureKind::Image {
        image: image.clone(),
        scale: [3.0; 2],
        shift: [0.1; 2],
        factor,
        invert,
        wrap: Wrap::Repeat,
    };
    let (first, second) = (Color::Texture(TextureId(1)), Color::Texture(TextureId(2)));
    let kinds = [
        image(2.0, false),
        image(2.0, true),
        TextureKind::Product { factors: [first, Color::Constant([0.5, 1.0, 2.0])] },
        TextureKind::Mix { colors: [first, second], amount: Scalar::Constant(0.25) },
        TextureKind::Product { factors: [Color::Texture(TextureId(5)); 2] },
    ];
    let texture = |kind| Texture { name: String::new(), kind, source: line(301) };
    scene.textures.extend(kinds.into_iter().map(texture));
    let color = |id| Color::Texture(TextureId(id));
    let means = [
        (0, [0.4, 0.4, 0.4]),
        (1, [1.0, 1.0, 2.0]),
        // Values are clamped to 0 before the mean is taken: (1 - 0) and (1 - 2).
        (2, [0.5, 0.25, 0.0]),
        (3, [0.5, 1.0, 4.0]),
        (4, [0.875, 0.8125, 1.5]),
        (5, [0.0, 0.0, 0.0]),
        (77, [0.0, 0.0, 0.0]),
    ];
    for (id, mean) in means {
        scene.materials[0].kind = MaterialKind::Plastic {
            diffuse: color(id),
            specular: color(id),
            roughness: Roughness { u: Scalar::Texture(TextureId(id)), v: Scalar::Constant(0.3), remap: true },
        };
        (scene.materials[0].bump, scene.materials[0].normal_map) =
            (Some(Scalar::Texture(TextureId(id))), Some(TextureId(id)));
        scene.shapes[1].alpha = Some(Scalar::Texture(TextureId(id)));
        // A shape must use material 0.
        scene.shapes[1].material = scene.shapes[4].material;
        let less = without(&scene, Effect::Textures);
        let MaterialKind::Plastic { diffuse: Color::Constant(found), specular, roughness } =
            less.materials[0].kind.clone()
        else {
            panic!("{id}")
        };
        assert!((0..3).all(|c| (found[c] - mean[c]).abs() < 1e-6), "{id}: {found:?}");
        assert_eq!((specular, roughness.u), (Color::Constant(found), Scalar::Constant(found[0])));
        assert_eq!(less.shapes[1].alpha, Some(Scalar::Constant(found[0])));
        assert_eq!((less.materials[0].bump, less.materials[0].normal_map), (None, None));
        assert!(!Effects::of(&less).has(Effect::Textures));
    }
}

#[test]
fn lens_shutter_and_holes() {
    let mut scene = full();
    scene.shapes[0].moves_to = Some(DAffine3::from_translation(DVec3::X));
    scene.camera.shutter = [0.25, 0.75];
    let still = without(&scene, Effect::MotionBlur);
    assert_eq!(still.camera.shutter, [0.5, 0.5]);
    assert_eq!(still.shapes[0].moves_to, scene.shapes[0].moves_to, "it stands where it is then");
    assert_eq!(without(&scene, Effect::DepthOfField).camera.lens_radius, 0.0);
    assert_eq!(without(&scene, Effect::Interreflection).max_depth, Some(1));

    let mut holes = full();
    let leaf = Shape::new(Geometry::Sphere { radius: 1.0 }, DAffine3::IDENTITY, holes.shapes[0].material, line(400));
    holes.objects.push(Object { name: "leaf".into(), shapes: vec![leaf], source: line(401) });
    holes.objects[0].shapes[0].alpha = Some(Scalar::Constant(0.0));
    holes.shapes[0].alpha = Some(Scalar::Constant(0.6));
    holes.shapes[1].alpha = Some(Scalar::Constant(0.4));
    holes.shapes[2].alpha = Some(Scalar::Texture(TextureId(0)));
    holes.shapes[5].alpha = Some(Scalar::Constant(0.0));
    let filled = without(&holes, Effect::Transparency);
    let lines = |s: &Scene| s.shapes.iter().map(|s| s.source.line).collect::<Vec<_>>();
    assert_eq!(lines(&filled), [10, 12, 13, 14, 15], "the lamp stays");
    assert!(filled.shapes.iter().all(|s| s.alpha.is_none()) && filled.objects[0].shapes.is_empty());
}

#[test]
fn media_thin_out() {
    let mut scene = full();
    let mut medium = |absorption, scattering| {
        let name = String::new();
        scene.media.push(Medium {
            name,
            absorption: [absorption; 3],
            scattering: [scattering; 3],
            g: 0.0,
            source: line(500),
        });
        Some(MediumId(scene.media.len() as u32 - 1))
    };
    let (water, fog, milk) = (medium(1.0, 0.0), medium(0.0, 1.0), medium(1.0, 1.0));
    scene.camera.medium = fog;
    scene.shapes[2].media = Some(MediumInterface { inside: milk, outside: water });
    let clear = without(&scene, Effect::AbsorbingMedia);
    assert_eq!(
        (clear.camera.medium, clear.shapes[2].media),
        (fog, Some(MediumInterface { inside: milk, outside: None }))
    );
    assert_eq!((clear.media[2].absorption, clear.media[2].scattering), ([0.0; 3], [1.0; 3]));
    let still = without(&scene, Effect::ScatteringMedia);
    assert_eq!(
        (still.camera.medium, still.shapes[2].media),
        (None, Some(MediumInterface { inside: milk, outside: water }))
    );
    let none = without(&clear, Effect::ScatteringMedia);
    assert_eq!(none.shapes[2].media, Some(MediumInterface::default()), "nothing on both sides");
}

/// Camera, film, materials and shapes stay, and crops and samplers work as before.
#[test]
fn the_rest_is_untouched() {
    let scene = full();
    let less = without(&scene, Effect::Environment);
    assert_eq!((&less.camera, &less.film, &less.materials), (&scene.camera, &scene.film, &scene.materials));
    assert_eq!((less.shapes.len(), less.max_depth), (scene.shapes.len(), scene.max_depth));
    let frame = Frame::new(SIZE[0], SIZE[1]).and_then(|f| f.crop(2, 2, 6, 6)).expect("inside");
    let film = film_in(&world(&less), frame, &mut Uniform::new(Sobol::new(1)), &Limits::samples(64));
    assert_eq!(film.record().samples, 64);
}
