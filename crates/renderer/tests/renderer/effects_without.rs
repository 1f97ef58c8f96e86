//! Scenes with one of their effects left out.

use crate::support::*;

const SIZE: [u32; 2] = [24, 16];

/// Returns a room with lamps, metals, a coat, an environment and a textured floor, seen through a lens.
fn full() -> Scene {
    let mut scene = room(SIZE);
    (scene.camera.lens_radius, scene.camera.focal_distance) = (0.05, 4.5);
    let tiles = add_texture(&mut scene, "tiles", checks(8.0, [0.2, 0.6]));
    scene.shapes[0].material = add_material(&mut scene, MaterialKind::Diffuse { reflectance: Color::Texture(tiles) });
    scene
}

fn without(scene: &Scene, effect: Effect) -> Scene {
    dapple_renderer::without(scene, effect).unwrap_or_else(|e| panic!("{e}"))
}

/// The room's effects can be left out one by one, in any order. Each step changes the scene and the image.
#[test]
fn each_effect_goes_alone_and_all_go_together() {
    let scene = full();
    let called: Vec<Effect> = Effects::of(&scene).called().iter().map(|c| c.effect).collect();
    use Effect::*;
    let expected = [SoftShadows, SeveralLights, Glossy, Mirror, Interreflection, Textures, Environment, DepthOfField];
    assert_eq!(called, expected);
    let whole = hash(&image(&scene, 4, 1));
    for &effect in &called {
        let less = without(&scene, effect);
        assert!(!Effects::of(&less).has(effect) && hash(&image(&less, 4, 1)) != whole, "{effect}");
    }
    // The choice among the remaining lights comes last: with the sky as the strongest, no other light would remain.
    let others = called.iter().copied().filter(|e| *e != SeveralLights);
    for mut order in [others.clone().collect::<Vec<_>>(), others.rev().collect()] {
        order.push(SeveralLights);
        let less = order.iter().fold(scene.clone(), |scene, effect| without(&scene, *effect));
        assert!(Effects::of(&less).called().is_empty() && mean(&image(&less, 4, 1))[0] > 0.0, "{order:?}");
    }
    // Camera, film, materials and shapes stay with the sky gone.
    let less = without(&scene, Environment);
    assert_eq!((&less.camera, &less.film, &less.materials), (&scene.camera, &scene.film, &scene.materials));
    assert_eq!((less.shapes.len(), less.max_depth), (scene.shapes.len(), scene.max_depth));
}

/// The last light cannot be left out. Of several lights, the strongest stays; shapes that emitted stay as well.
#[test]
fn the_strongest_light_stays() {
    let mut sky = ground(SIZE);
    add_sky(&mut sky, 1.0);
    let error = dapple_renderer::without(&sky, Effect::Environment).err();
    assert_eq!(error, Some(WithoutError::NoLight { effect: Effect::Environment }));
    sky.lights.clear();
    assert!(dapple_renderer::without(&sky, Effect::Environment).is_ok());
    // The world's lights are the shapes 4 and 5, then the sky.
    let lit = |i: usize, scene: &Scene| match i {
        2 => !scene.lights.is_empty(),
        i => scene.shapes[4 + i].emission.is_some(),
    };
    for brighter in [None, Some(4), Some(5)] {
        let mut scene = full();
        if let Some(number) = brighter {
            scene.shapes[number].emission = Some(Emission::even([1e3; 3], false));
        }
        let world = world(&scene);
        let strongest = (0..3).max_by(|&a, &b| world.lights().pmf(a).total_cmp(&world.lights().pmf(b)));
        assert!(brighter.is_none_or(|number| strongest == Some(number as u32 - 4)));
        let less = without(&scene, Effect::SeveralLights);
        assert_eq!((0..3).filter(|i| lit(*i as usize, &less)).collect::<Vec<_>>(), Vec::from_iter(strongest));
        assert_eq!(less.shapes.len(), scene.shapes.len(), "bodies stay");
    }
}

/// Point lights replace lamps, with the same power and the same image from afar.
#[test]
fn lamps_become_points_of_the_same_power() {
    let far = |geometry: &Geometry, to_world: DAffine3, two_sided: bool| {
        let mut scene = ground([8, 8]);
        let lamp = add(&mut scene, geometry.clone(), to_world, MaterialId(0), None);
        scene.shapes[lamp].emission = Some(Emission::even([100.0, 50.0, 25.0], two_sided));
        scene.max_depth = Some(1);
        let points = without(&scene, Effect::SoftShadows);
        assert_eq!(points.shapes.len(), 1, "the lamp's body goes");
        let [lamp, point] = [&scene, &points].map(|scene| mean(&image(scene, 256, 1)));
        assert!((0..3).all(|c| (point[c] / lamp[c] - 1.0).abs() < 0.01), "{point:?} {lamp:?}");
        points.lights
    };
    let up = at(0.0, 0.0, 12.0);
    let down = rectangle(DVec3::ZERO, 0.25 * DVec3::Y, 0.25 * DVec3::X);
    let one = far(&down, up, false);
    assert!(matches!(one[0].kind, LightKind::Spot { intensity, .. } if (intensity[0] - 25.0).abs() < 1e-4));
    assert!(one.len() == 1 && one[0].source.line == 11 && far(&down, up, true).len() == 2);
    let disk = Geometry::Disk { height: 0.0, radius: 0.3, inner_radius: 0.1 };
    far(&disk, up * DAffine3::from_rotation_x(PI), false);
    let power = |lights: &[Light], i: usize| match lights[i].kind {
        LightKind::Point { intensity } => f64::from(intensity[0]),
        _ => panic!("{:?}", lights[i]),
    };
    let sphere = far(&Geometry::Sphere { radius: 0.3 }, up, false);
    assert!((power(&sphere, 0) - PI * 9.0).abs() < 1e-3);
    // A box looks smaller face on than on average. Its power stays: 24 units of area, radiance 12.
    let mut box_lamp = full();
    box_lamp.shapes[5].geometry = Geometry::Mesh(Arc::new(cube()));
    let lights = without(&box_lamp, Effect::SoftShadows).lights;
    assert!((power(&lights, 2) - 24.0 * 12.0 / 4.0).abs() < 1e-3, "{lights:?}");
}

/// Energy is preserved: under a constant environment, a plane looks the same from above.
#[test]
fn shiny_surfaces_become_diffuse_of_equal_brightness() {
    let color = Color::Constant([0.9, 0.6, 0.3]);
    let smooth = Roughness::constant(0.0, 0.0, false);
    let tinted = MaterialKind::Conductor { fresnel: ConductorFresnel::Reflectance(color), roughness: smooth };
    for (kind, effect) in [
        (tinted, Effect::Mirror),
        (metal(0.0), Effect::Mirror),
        (coated(0.5, 0.0), Effect::Mirror),
        (metal(0.05), Effect::Glossy),
        (coated(0.7, 0.05), Effect::Glossy),
    ] {
        let mut scene = scene([4, 4], 1.0, DVec3::new(0.0, 0.0, 10.0), DVec3::ZERO);
        let material = add_material(&mut scene, kind.clone());
        plate(&mut scene, [DVec3::ZERO, DVec3::X, DVec3::Y], material, None);
        add_sky(&mut scene, 1.0);
        scene.max_depth = Some(3);
        let less = without(&scene, effect);
        assert!(matches!(less.materials[0].kind, MaterialKind::Diffuse { .. }));
        let (with, without) = (mean(&image(&scene, 256, 1)), mean(&image(&less, 256, 2)));
        // Microfacets of alpha 0.05 lose almost nothing.
        assert!((0..3).all(|c| (with[c] - without[c]).abs() < 0.01), "{kind:?}: {with:?} {without:?}");
    }
    let mut scene = full();
    scene.materials[0].kind = MaterialKind::Mirror { reflectance: color };
    let less = without(&scene, Effect::Mirror);
    assert_eq!(less.materials[0].kind, MaterialKind::Diffuse { reflectance: color });
    assert_eq!(less.materials[1], scene.materials[1], "rough ones stay");
}

/// A textured coat keeps its texture, multiplied by the coat's albedo over a base of 0.4, the texture's mean.
#[test]
fn a_textured_coat_keeps_its_texture() {
    let mut scene = full();
    let MaterialKind::CoatedDiffuse { reflectance, .. } = &mut scene.materials[3].kind else { panic!("a coat") };
    *reflectance = Color::Texture(TextureId(0));
    let reflectance = |scene: &Scene| {
        let less = without(scene, Effect::Glossy);
        let MaterialKind::Diffuse { reflectance } = less.materials[3].kind else { panic!("a diffuse surface") };
        (reflectance, less.textures)
    };
    let (Color::Texture(id), textures) = reflectance(&scene) else { panic!("a texture") };
    let TextureKind::Product { factors } = &textures[id.0 as usize].kind else { panic!("a product") };
    assert_eq!(factors[0], Color::Texture(TextureId(0)));
    scene.materials[3].kind = coated(0.4, 0.1);
    let (Color::Constant(ratio), (Color::Constant(albedo), _)) = (factors[1], reflectance(&scene)) else {
        panic!("constants")
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
    let clear = &without(&scene, Effect::Glossy).materials[1].kind;
    let MaterialKind::Dielectric { roughness, .. } = clear else { panic!("{clear:?}") };
    assert_eq!(roughness.constants(), Some([0.0; 2]));
    let gone = without(&scene, Effect::Refraction);
    assert!(gone.materials[1..3].iter().all(|m| m.kind == MaterialKind::Interface));
    assert!(Effects::of(&gone).has(Effect::Glossy), "the coat's, which stays");
}

#[test]
fn textures_become_their_means() {
    let mut scene = full();
    let image = Arc::new(Image::new([2, 1], vec![[0.0, 0.25, 1.0], [1.0, 0.75, 1.0]]).expect("two pixels"));
    let image = |factor, invert| TextureKind::Image {
        image: image.clone(),
        scale: [3.0; 2],
        shift: [0.1; 2],
        factor,
        invert,
        wrap: Wrap::Repeat,
    };
    let color = |id| Color::Texture(TextureId(id));
    for (kind, mean) in [
        (image(2.0, false), [1.0, 1.0, 2.0]),
        // Values are clamped to 0 before the mean is taken: (1 - 0) and (1 - 2).
        (image(2.0, true), [0.5, 0.25, 0.0]),
        (TextureKind::Product { factors: [color(1), Color::Constant([0.5, 1.0, 2.0])] }, [0.5, 1.0, 4.0]),
        (TextureKind::Mix { colors: [color(1), color(2)], amount: Scalar::Constant(0.25) }, [0.875, 0.8125, 1.5]),
        // One made of itself, and one of a texture that is not there.
        (TextureKind::Product { factors: [color(5); 2] }, [0.0; 3]),
        (TextureKind::Product { factors: [color(77); 2] }, [0.0; 3]),
        (checks(1.0, [0.2, 0.6]), [0.4; 3]),
    ] {
        let id = add_texture(&mut scene, "", kind);
        let (scalar, both) = (Scalar::Texture(id), Color::Texture(id));
        let roughness = Roughness { u: scalar, v: Scalar::Constant(0.3), remap: true };
        scene.materials[0].kind = MaterialKind::Plastic { diffuse: both, specular: both, roughness };
        (scene.materials[0].bump, scene.materials[0].normal_map) = (Some(scalar), Some(id));
        scene.shapes[1].alpha = Some(scalar);
        // A shape must use material 0.
        scene.shapes[1].material = scene.shapes[4].material;
        let less = without(&scene, Effect::Textures);
        let MaterialKind::Plastic { diffuse: Color::Constant(found), specular, roughness } = less.materials[0].kind
        else {
            panic!("{id:?}")
        };
        assert!((0..3).all(|c| (found[c] - mean[c]).abs() < 1e-6), "{id:?}: {found:?}");
        assert_eq!((specular, roughness.u), (Color::Constant(found), Scalar::Constant(found[0])));
        assert_eq!(less.shapes[1].alpha, Some(Scalar::Constant(found[0])));
        assert_eq!((less.materials[0].bump, less.materials[0].normal_map), (None, None));
        assert!(!Effects::of(&less).has(Effect::Textures));
    }
}

#[test]
fn lens_shutter_and_holes() {
    let mut scene = full();
    scene.shapes[0].moves_to = Some(at(1.0, 0.0, 0.0));
    scene.camera.shutter = [0.25, 0.75];
    let still = without(&scene, Effect::MotionBlur);
    assert_eq!(still.camera.shutter, [0.5, 0.5]);
    assert_eq!(still.shapes[0].moves_to, scene.shapes[0].moves_to, "it stands where it is then");
    assert_eq!(without(&scene, Effect::DepthOfField).camera.lens_radius, 0.0);
    assert_eq!(without(&scene, Effect::Interreflection).max_depth, Some(1));

    let mut holes = full();
    let leaf = Shape::new(Geometry::Sphere { radius: 1.0 }, DAffine3::IDENTITY, holes.shapes[0].material, line(400));
    let leaf = Shape { alpha: Some(Scalar::Constant(0.0)), ..leaf };
    holes.objects.push(Object { name: "leaf".into(), shapes: vec![leaf], source: line(401) });
    let texture = Scalar::Texture(TextureId(0));
    for (shape, alpha) in [0.6, 0.4].map(Scalar::Constant).into_iter().chain([texture]).enumerate() {
        holes.shapes[shape].alpha = Some(alpha);
    }
    holes.shapes[5].alpha = Some(Scalar::Constant(0.0));
    let filled = without(&holes, Effect::Transparency);
    let lines: Vec<u32> = filled.shapes.iter().map(|s| s.source.line).collect();
    assert_eq!(lines, [10, 12, 13, 14, 15], "the lamp stays");
    assert!(filled.shapes.iter().all(|s| s.alpha.is_none()) && filled.objects[0].shapes.is_empty());
}

#[test]
fn media_thin_out() {
    let mut scene = full();
    scene.media = [(1.0, 0.0), (0.0, 1.0), (1.0, 1.0)].map(|(a, s)| fog([a; 3], [s; 3], 0.0)).into();
    let [water, mist, milk] = [0, 1, 2].map(|i| Some(MediumId(i)));
    scene.camera.medium = mist;
    scene.shapes[2].media = Some(MediumInterface { inside: milk, outside: water });
    let between = |s: &Scene| (s.camera.medium, s.shapes[2].media.map(|m| [m.inside, m.outside]));
    let clear = without(&scene, Effect::AbsorbingMedia);
    assert_eq!(between(&clear), (mist, Some([milk, None])));
    assert_eq!((clear.media[2].absorption, clear.media[2].scattering), ([0.0; 3], [1.0; 3]));
    assert_eq!(between(&without(&scene, Effect::ScatteringMedia)), (None, Some([milk, water])));
    let none = without(&clear, Effect::ScatteringMedia);
    assert_eq!(between(&none), (None, Some([None, None])), "nothing on both sides");
}
