//! Directives of pbrt-v4, materials and textures: the descriptions that they make.

use crate::reader_messages::*;
use dapple_scene::pbrt::{ReadOptions, read_scene_from};
use dapple_scene::{
    Color, ConductorFresnel, EnvironmentRadiance, Geometry, LightKind, MaterialKind, MediumInterface, Projection,
    Scalar, SpotFalloff, TextureKind, Wrap,
};
use glam::{DVec3, dvec3};
use std::f32::consts::PI;

#[test]
fn small_lights() {
    let (kind, to_world) = light("LightSource \"point\" \"rgb I\" [1 2 3] \"float scale\" 2 \"point3 from\" [1 2 3]");
    assert!(matches!(kind, LightKind::Point { intensity: [2.0, 4.0, 6.0] }));
    assert_eq!(to_world.transform_point3(DVec3::ZERO), dvec3(1.0, 2.0, 3.0));
    let LightKind::Point { intensity } = light("LightSource \"point\" \"float power\" 100").0 else { panic!() };
    assert!(close(intensity, [100.0 / (4.0 * PI); 3], 1e-5));

    let text =
        "LightSource \"spot\" \"rgb I\" [8 8 8] \"point3 from\" [0 5 0] \"point3 to\" [0 0 0] \"float coneangle\" 40";
    let (kind, to_world) = light(text);
    let LightKind::Spot { intensity, cone, falloff_start, falloff } = kind else { panic!() };
    assert_eq!((intensity, cone, falloff_start, falloff), ([8.0; 3], 40.0, 35.0, SpotFalloff::Smoothstep));
    assert!((to_world.transform_vector3(DVec3::Z) + DVec3::Y).length() < 1e-12);
    assert_eq!(to_world.transform_point3(DVec3::ZERO), DVec3::Y * 5.0);
    // A spot that fills everything, without a falloff, is a point.
    let text = "LightSource \"spot\" \"float power\" 100 \"float coneangle\" 180 \"float conedeltaangle\" 0";
    let LightKind::Spot { intensity, .. } = light(text).0 else { panic!() };
    assert!(close(intensity, [100.0 / (4.0 * PI); 3], 1e-5));

    let text = "LightSource \"distant\" \"rgb L\" [1 2 3] \"float illuminance\" 10 \"point3 from\" [0 9 0] \"point3 to\" [0 0 0]";
    let (kind, to_world) = light(text);
    let LightKind::Distant { irradiance } = kind else { panic!() };
    assert_eq!(irradiance, [10.0, 20.0, 30.0]);
    // Its light comes out of +z.
    assert!((to_world.transform_vector3(DVec3::Z) - DVec3::Y).length() < 1e-12);

    let say = |text: &str| complaint(text);
    assert_eq!(
        say("LightSource \"spot\" \"float coneangle\" 10 \"float conedeltaangle\" 20"),
        "s.pbrt:4: parameter conedeltaangle of LightSource \"spot\" must be at least 0 and at most coneangle, not 20"
    );
    assert_eq!(
        say("LightSource \"distant\" \"point3 from\" [1 1 1] \"point3 to\" [1 1 1]"),
        "s.pbrt:4: parameters from and to of LightSource \"distant\" must differ"
    );
    assert!(say("LightSource \"point\" \"float power\" 1e39 \"rgb I\" [1e30 1 1]").contains("brighter than 3.4e38"));
}

#[test]
fn environments_have_two_layouts() {
    let radiance = |text: &str| match light(text).0 {
        LightKind::Infinite { radiance } => radiance,
        other => panic!("{other:?}"),
    };
    let square = radiance("LightSource \"infinite\" \"string filename\" \"square.pfm\" \"float scale\" 2");
    assert!(matches!(square, EnvironmentRadiance::EqualArea { scale: 2.0, .. }));
    let wide = radiance("LightSource \"infinite\" \"string filename\" \"wide.pfm\"");
    assert!(matches!(wide, EnvironmentRadiance::LatLong { scale: 1.0, .. }));
    // The whole sky at radiance 1 gives pi.
    let EnvironmentRadiance::Constant(rgb) = radiance("LightSource \"infinite\" \"float illuminance\" 6") else {
        panic!()
    };
    assert!(close(rgb, [6.0 / PI; 3], 1e-5));
    let text = "LightSource \"infinite\" \"string filename\" \"square.pfm\" \"float illuminance\" 6";
    let EnvironmentRadiance::EqualArea { scale, .. } = radiance(text) else { panic!() };
    let luminance = 0.2126 + 2.0 * 0.7152 + 3.0 * 0.0722;
    // Twice as bright as asked, since pbrt-v4 weighs the square as half a sphere.
    assert!((scale * luminance * PI / 12.0 - 1.0).abs() < 0.01, "{scale}");
}

#[test]
fn area_lights_by_their_power() {
    let emission = |shape: &str, more: &str| {
        let text = format!("AttributeBegin\nAreaLightSource \"diffuse\" {more}\n{shape}\nAttributeEnd");
        world(&text).shapes[0].emission.unwrap()
    };
    let sphere = emission("Scale 2 2 2\nShape \"sphere\" \"float radius\" .5", "\"float power\" 100");
    assert!(close(sphere.radiance, [100.0 / (PI * 4.0 * PI); 3], 1e-4) && !sphere.two_sided);
    let disk =
        emission("Shape \"disk\"", "\"float power\" 100 \"bool twosided\" true \"rgb L\" [1 0 2] \"float scale\" 3");
    assert!(close(disk.radiance, [300.0 / (2.0 * PI * PI), 0.0, 600.0 / (2.0 * PI * PI)], 1e-4));
    let quad = "Scale 3 1 1\nShape \"bilinearmesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0 1 1 0]";
    assert!(close(emission(quad, "\"float power\" 6").radiance, [2.0 / PI; 3], 1e-5));
    let text = "AreaLightSource \"diffuse\" \"float power\" 1\nScale 1 2 1";
    assert!(complaint(text).contains("the area of a stretched sphere or disk is not computed"), "{}", complaint(text));
}

#[test]
fn area_lights_shine_an_image() {
    let light = "AreaLightSource \"diffuse\" \"string filename\" \"wide.pfm\" \"float scale\" 3";
    let quad = "Shape \"bilinearmesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0 1 1 0]";
    let scene = world(&format!("AttributeBegin\n{light}\n{quad}\nAttributeEnd"));
    let emission = scene.shapes[0].emission.unwrap();
    assert_eq!(emission.radiance, [3.0; 3]);
    let kind = &scene.textures[emission.texture.unwrap().0 as usize].kind;
    assert!(matches!(kind, TextureKind::Image { image, wrap: Wrap::Clamp, .. } if image.size == [4, 2]), "{kind:?}");
    let say = |text: &str| complaint(text);
    assert!(say(light).contains("an area light image on a sphere (use a mesh) is not supported"), "{}", say(light));
    let both = format!("{light} \"rgb L\" [1 1 1]\n{quad}\nAttributeBegin");
    assert!(say(&both).contains("has both L and filename; remove one"), "{}", say(&both));
    assert!(say(&format!("{light} \"float power\" 9")).contains("parameter power of an area light with an image"));
    assert!(say(&light.replace("wide", "no")).contains("no.pfm"));
}

#[test]
fn spectra_become_colours() {
    let l = |spectrum: &str| match light(&format!("LightSource \"infinite\" {spectrum}")).0 {
        LightKind::Infinite { radiance: EnvironmentRadiance::Constant(rgb) } => rgb,
        other => panic!("{other:?}"),
    };
    let y = |[r, g, b]: [f32; 3]| 0.2126 * r + 0.7152 * g + 0.0722 * b;
    assert_eq!(l("\"spectrum L\" \"stdillum-D65\""), [1.0; 3]);
    for light in [
        "\"spectrum L\" \"stdillum-A\"",
        "\"spectrum L\" \"stdillum-F11\"",
        "\"spectrum L\" [400 3 700 3]",
        "\"blackbody L\" 3000",
        "\"spectrum L\" \"flat.spd\"",
    ] {
        let rgb = l(light);
        assert!((y(rgb) - 1.0).abs() < 2e-3 && rgb[0] > rgb[2], "{light} {rgb:?}");
    }
    let reflectance = |spectrum: &str| match kind(&format!("Material \"diffuse\" {spectrum}")) {
        MaterialKind::Diffuse { reflectance: Color::Constant(rgb) } => rgb,
        other => panic!("{other:?}"),
    };
    assert_eq!(reflectance("\"spectrum reflectance\" \"flat.spd\""), [0.25; 3]);
    let red = reflectance("\"spectrum reflectance\" [400 0 580 0 620 .8 700 .8]");
    assert!(red[0] > 0.5 && red[1] < 0.2 && red[2] < 0.05, "{red:?}");
    assert_eq!(reflectance("\"xyz reflectance\" [0 0 0]"), [0.0; 3]);
    let white = reflectance("\"xyz reflectance\" [.47523 .5 .54441]");
    assert!(close(white, [0.5; 3], 1e-3), "{white:?}");
    // A share is cut to 1 rather than refused.
    world("Material \"diffuse\" \"spectrum reflectance\" [400 1 500 2]");
}

#[test]
fn objects_and_instances() {
    let text = "ObjectInstance \"late\"\nTranslate 1 0 0\nObjectBegin \"late\"\nTranslate 0 2 0\nShape \"disk\"\nShape \"sphere\"\nObjectEnd\nTranslate 0 0 3\nObjectInstance \"late\"\nActiveTransform EndTime\nScale 2 2 2\nObjectInstance \"late\"\nObjectBegin \"nothing\"\nObjectEnd\nObjectInstance \"nothing\"\nIdentity";
    let scene = world(text);
    assert_eq!((scene.shapes.len(), scene.objects.len(), scene.instances.len()), (1, 2, 3));
    assert_eq!((scene.objects[0].name.as_str(), scene.objects[0].shapes.len()), ("late", 2));
    assert_eq!(scene.objects[0].shapes[0].to_world.translation, dvec3(1.0, 2.0, 0.0));
    let places: Vec<DVec3> = scene.instances.iter().map(|i| i.to_world.translation).collect();
    assert_eq!(places, [DVec3::ZERO, dvec3(1.0, 0.0, 3.0), dvec3(1.0, 0.0, 3.0)]);
    assert!(scene.instances[1].moves_to.is_none());
    assert_eq!(scene.instances[2].moves_to.unwrap().transform_point3(DVec3::X), dvec3(3.0, 0.0, 3.0));
    let unplaced =
        read(&format!("{HEAD}{WORLD}LightSource \"infinite\"\nObjectBegin \"o\"\nShape \"disk\"\nObjectEnd\n"));
    assert_eq!(
        unplaced.unwrap_err().to_string(),
        "s.pbrt: no shape is placed in the world; place an object with ObjectInstance"
    );
}

#[test]
fn what_moves() {
    let scene = options(
        "TransformTimes 1 3\nActiveTransform EndTime\nTranslate 0 0 5\nActiveTransform All\nTranslate 0 1 0\nCamera \"perspective\" \"float shutteropen\" 1 \"float shutterclose\" 2",
    );
    assert_eq!((scene.motion_times, scene.camera.shutter), ([1.0, 3.0], [1.0, 2.0]));
    assert_eq!(scene.camera.to_world.translation, dvec3(0.0, -1.0, 0.0));
    assert_eq!(scene.camera.moves_to.unwrap().translation, dvec3(0.0, -1.0, -5.0));
    // The world begins anew.
    assert!(scene.shapes[0].moves_to.is_none());
    let scene = world(
        "AttributeBegin\nTranslate 1 0 0\nActiveTransform EndTime\nTranslate 0 1 0\nShape \"disk\"\nAttributeEnd\nShape \"disk\"",
    );
    assert_eq!(scene.shapes[0].to_world.translation, DVec3::X);
    assert_eq!(scene.shapes[0].moves_to.unwrap().translation, dvec3(1.0, 1.0, 0.0));
    assert!(scene.shapes[1].moves_to.is_none());
    assert_eq!(
        complaint("ActiveTransform Never"),
        "s.pbrt:4: ActiveTransform takes All, StartTime or EndTime, not \"Never\""
    );
    assert_eq!(
        complaint("ActiveTransform EndTime\nTranslate 1 0 0\nAreaLightSource \"diffuse\"").lines().next().unwrap(),
        "s.pbrt:8: an area light that moves is not supported; remove it, or allow unsupported directives"
    );
    let times = read(&format!("TransformTimes 2 2\n{HEAD}{WORLD}{TAIL}")).unwrap_err();
    assert_eq!(times.to_string(), "s.pbrt:1: TransformTimes takes a start before an end, not 2 and 2");
    assert_eq!(complaint("TransformTimes 0 1"), "s.pbrt:4: TransformTimes belongs before WorldBegin; move it there");
    let swapped = options("Camera \"perspective\" \"float shutteropen\" 2 \"float shutterclose\" 1");
    assert_eq!(swapped.camera.shutter, [1.0, 2.0]);
    assert!(swapped.notices.iter().any(|n| n.message.contains("swapped")));
}

#[test]
fn cameras() {
    let scene = options(
        "Camera \"orthographic\" \"float screenwindow\" [-2 2 -1 1] \"float lensradius\" .1 \"float focaldistance\" 3",
    );
    assert_eq!(
        (scene.camera.projection, scene.camera.screen_window),
        (Projection::Orthographic, Some([-2.0, 2.0, -1.0, 1.0]))
    );
    assert_eq!((scene.camera.lens_radius, scene.camera.focal_distance), (0.1, 3.0));
}

#[test]
fn media() {
    let scene = options(
        "MakeNamedMedium \"fog\" \"string type\" \"homogeneous\" \"rgb sigma_a\" [1 2 3] \"rgb sigma_s\" [0 1 0] \"float scale\" 2 \"float g\" .5\nMediumInterface \"\" \"fog\"\nCamera \"perspective\"",
    );
    let fog = scene.media.iter().position(|m| m.name == "fog").map(|i| dapple_scene::MediumId(i as u32));
    assert_eq!(scene.camera.medium, fog);
    let medium = &scene.media[0];
    assert_eq!((medium.absorption, medium.scattering, medium.g), ([2.0, 4.0, 6.0], [0.0, 2.0, 0.0], 0.5));
    // The state goes on into the world.
    assert_eq!(scene.shapes[0].media, Some(MediumInterface { inside: None, outside: fog }));
    let scene = world(
        "MediumInterface \"late\" \"\"\nShape \"disk\"\nMediumInterface \"late\"\nShape \"disk\"\nMakeNamedMedium \"late\" \"string type\" \"homogeneous\"\nMediumInterface \"\"",
    );
    let late = Some(dapple_scene::MediumId(0));
    assert_eq!(scene.shapes[0].media, Some(MediumInterface { inside: late, outside: None }));
    assert_eq!((scene.shapes[1].media, scene.shapes[2].media), (None, None));
    assert_eq!(scene.media[0].absorption, [0.0011, 0.0024, 0.014]);
}

#[test]
fn made_shapes() {
    let mesh = |text: &str| {
        let scene = world(text);
        let Geometry::Mesh(mesh) = &scene.shapes[0].geometry else { panic!("{text}") };
        (mesh.as_ref().clone(), scene.notices.len())
    };
    let (quad, said) = mesh("Shape \"bilinearmesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0 1 1 0]");
    assert_eq!((quad.triangles, said), (vec![[0, 1, 3], [0, 3, 2]], 0));
    let (saddle, said) = mesh("Shape \"bilinearmesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0 1 1 1]");
    assert_eq!((saddle.triangles.len(), said), (512, 1));
    assert_eq!(mesh("Shape \"cylinder\" \"float phimax\" 90").0.triangles.len(), 128);
    let (dome, _) = mesh("Shape \"sphere\" \"float radius\" 2 \"float zmin\" 0");
    assert!(dome.positions.iter().all(|p| p.z > -1e-12 && (p.length() - 2.0).abs() < 1e-12));
    let tetrahedron = "\"point3 P\" [1 1 1 -1 -1 1 -1 1 -1 1 -1 -1] \"integer indices\" [0 1 2 0 3 1 0 2 3 1 3 2]";
    assert_eq!(mesh(&format!("Shape \"loopsubdiv\" {tetrahedron}")).0.triangles.len(), 4 * 64);
    assert_eq!(mesh(&format!("Shape \"loopsubdiv\" \"integer levels\" 1 {tetrahedron}")).0.triangles.len(), 16);
}

#[test]
fn materials_of_the_fourth_version() {
    let MaterialKind::Dielectric { eta, roughness, .. } =
        kind("Material \"dielectric\" \"spectrum eta\" \"glass-BK7\" \"float uroughness\" .3")
    else {
        panic!()
    };
    assert_eq!((eta, roughness.constants(), roughness.remap), (1.5168, Some([0.3, 0.0]), true));
    assert!(matches!(kind("Material \"thindielectric\" \"float eta\" 1.3"), MaterialKind::ThinDielectric { eta: 1.3 }));
    let sampled = "Material \"dielectric\" \"spectrum eta\" [487.6 1 687.6 3]";
    assert!(matches!(kind(sampled), MaterialKind::Dielectric { eta: 2.0, .. }));
    let MaterialKind::Conductor { fresnel: ConductorFresnel::EtaK { eta, k }, .. } =
        kind("Material \"conductor\" \"spectrum eta\" \"metal-TiO2-eta\" \"spectrum k\" \"metal-MgO-k\"")
    else {
        panic!()
    };
    assert!(close(eta, [3.457, 2.802, 2.905], 1e-3) && k == [0.0; 3]);
    let MaterialKind::CoatedConductor { fresnel, roughness, coat } = kind(
        "Material \"coatedconductor\" \"float conductor.roughness\" .2 \"float interface.roughness\" .1 \"float interface.eta\" 1.4 \"spectrum conductor.eta\" \"metal-Au-eta\" \"integer maxdepth\" 7",
    ) else {
        panic!()
    };
    assert_eq!((roughness.constants(), coat.roughness.constants()), (Some([0.2; 2]), Some([0.1; 2])));
    assert_eq!((coat.eta, coat.max_depth, coat.samples), (1.4, 7, 1));
    // k is left at copper's.
    assert!(matches!(fresnel, ConductorFresnel::EtaK { eta, k } if eta[0] < 0.15 && k[0] < 3.92));
    let paper = "Material \"diffusetransmission\" \"rgb reflectance\" [.4 .4 .4] \"float scale\" .5";
    assert!(matches!(
        kind(paper),
        MaterialKind::DiffuseTransmission {
            reflectance: Color::Constant([0.2, 0.2, 0.2]),
            transmittance: Color::Constant([0.125, 0.125, 0.125])
        }
    ));
    let textured = "Texture \"t\" \"spectrum\" \"checkerboard\"\nMaterial \"diffusetransmission\" \"texture reflectance\" \"t\" \"float scale\" .5";
    let scene = world(textured);
    let scaled = scene.textures.iter().find(|texture| matches!(texture.kind, TextureKind::Product { .. }));
    let TextureKind::Product { factors } = scaled.expect("a scaled texture").kind else { unreachable!() };
    assert_eq!(factors[1], Color::Constant([0.5; 3]), "the scale goes into the texture");
    assert!(matches!(kind("Material \"interface\""), MaterialKind::Interface));
}

#[test]
fn mixes_are_settled_at_the_end() {
    let text = "MakeNamedMaterial \"m\" \"string type\" \"mix\" \"string materials\" [\"a\" \"b\"] \"float amount\" .25\nNamedMaterial \"m\"\nShape \"disk\"\nMakeNamedMaterial \"b\" \"string type\" \"diffuse\"\nMakeNamedMaterial \"a\" \"string type\" \"interface\"";
    let scene = world(text);
    let MaterialKind::Mix { materials, amount } = scene.materials[0].kind else { panic!() };
    assert_eq!(
        (materials.map(|m| scene.materials[m.0 as usize].name.clone()), amount),
        (["a".into(), "b".into()], Scalar::Constant(0.25))
    );
}

#[test]
fn textures_of_numbers_and_colours() {
    let imagemap = "\"imagemap\" \"string filename\" \"wide.pfm\"";
    let text = format!(
        "Texture \"f\" \"float\" {imagemap} \"string wrap\" \"clamp\" \"bool invert\" true\nTexture \"c\" \"spectrum\" {imagemap} \"float uscale\" 3\nTexture \"b\" \"float\" \"checkerboard\" \"float tex1\" .25 \"texture tex2\" \"f\"\nTexture \"m\" \"spectrum\" \"mix\" \"texture tex1\" \"c\" \"rgb tex2\" [1 0 0] \"texture amount\" \"b\"\nTexture \"p\" \"spectrum\" \"scale\" \"texture tex\" \"m\" \"texture scale\" \"f\"\nTexture \"h\" \"float\" \"scale\" \"texture tex\" \"f\" \"float scale\" -2\nMaterial \"conductor\" \"texture roughness\" \"b\" \"texture reflectance\" \"p\" \"texture displacement\" \"h\"\nShape \"disk\" \"texture alpha\" \"f\"\nMaterial \"diffuse\" \"string normalmap\" \"square.pfm\"\nShape \"disk\" \"float alpha\" .5\nShape \"disk\" \"float alpha\" 1"
    );
    let scene = world(&text);
    let texture = |name: &str| {
        let found = scene.textures.iter().position(|t| t.name == name);
        found.unwrap_or_else(|| panic!("{name}: {:?}", scene.textures.iter().map(|t| &t.name).collect::<Vec<_>>()))
    };
    let id = |name: &str| dapple_scene::TextureId(texture(name) as u32);
    let TextureKind::Image { image, invert, wrap, .. } = &scene.textures[texture("f")].kind else { panic!() };
    // The mean of the channels; 4 is the first pixel of the lower row.
    assert_eq!((image.pixels[4], *invert, *wrap), ([4.75 / 3.0; 3], true, Wrap::Clamp));
    let TextureKind::Image { image, scale, .. } = &scene.textures[texture("c")].kind else { panic!() };
    assert_eq!((image.pixels[4], *scale), ([4.0, 0.5, 0.25], [3.0, 1.0]));
    let TextureKind::Checkerboard { colors, .. } = scene.textures[texture("b")].kind else { panic!() };
    assert_eq!(colors, [Color::Constant([0.25; 3]), Color::Texture(id("f"))]);
    let TextureKind::Mix { colors, amount } = scene.textures[texture("m")].kind else { panic!() };
    assert_eq!((colors[0], amount), (Color::Texture(id("c")), Scalar::Texture(id("b"))));
    let TextureKind::Product { factors } = scene.textures[texture("p")].kind else { panic!() };
    assert_eq!(factors, [Color::Texture(id("m")), Color::Texture(id("f"))]);
    // What is inverted cannot take a factor in.
    assert!(matches!(scene.textures[texture("h")].kind, TextureKind::Product { .. }));
    let material = &scene.materials[scene.shapes[0].material.0 as usize];
    let MaterialKind::Conductor { fresnel: ConductorFresnel::Reflectance(r), roughness } = &material.kind else {
        panic!()
    };
    assert_eq!(
        (*r, roughness.u, material.bump),
        (Color::Texture(id("p")), Scalar::Texture(id("b")), Some(Scalar::Texture(id("h"))))
    );
    assert_eq!(scene.shapes[0].alpha, Some(Scalar::Texture(id("f"))));
    assert_eq!((scene.shapes[1].alpha, scene.shapes[2].alpha), (Some(Scalar::Constant(0.5)), None));
    assert!(scene.materials[scene.shapes[1].material.0 as usize].normal_map.is_some());

    let nest: String =
        (0..9).map(|i| format!("Texture \"t{}\" \"float\" \"mix\" \"texture tex1\" \"t{i}\"\n", i + 1)).collect();
    let nested = format!("Texture \"t0\" \"float\" {imagemap}\n{nest}");
    assert!(
        complaint(&nested).starts_with("s.pbrt:12: textures are nested too deep; at most 8"),
        "{}",
        complaint(&nested)
    );
}

/// An image as a texture: of numbers, then of colours.
fn image_of(file: &str) -> [Vec<[f32; 3]>; 2] {
    let image = format!("\"imagemap\" \"string filename\" \"{file}\" \"string encoding\" \"linear\"");
    let scene = world(&format!(
        "Texture \"n\" \"float\" {image}\nTexture \"c\" \"spectrum\" {image}\nMaterial \"diffuse\" \"texture reflectance\" \"c\"\nShape \"disk\" \"texture alpha\" \"n\""
    ));
    ["n", "c"].map(|name| {
        let texture = scene.textures.iter().find(|t| t.name == name).expect("it is used");
        let TextureKind::Image { image, .. } = &texture.kind else { panic!("{name} is an image") };
        image.pixels.clone()
    })
}

#[test]
fn numbers_are_opacity_where_an_image_has_any() {
    for file in ["leaf.png", "leaf.tga"] {
        let [numbers, colours] = image_of(file);
        // 51 of 255, and not the mean of the colours, 120 of 255.
        assert_eq!(numbers, [[0.2; 3], [1.0; 3]], "{file}");
        let expected = [60.0, 120.0, 180.0].map(|c: f32| c / 255.0);
        assert!(close(colours[0], expected, 1e-6), "{file}: {colours:?}");
    }
    // Opaque throughout, it is as if there were none.
    let [numbers, _] = image_of("opaque.png");
    assert!(close(numbers[0], [120.0 / 255.0; 3], 1e-6) && numbers[1] == [0.0; 3], "{numbers:?}");
}

/// The illuminance under an environment of radiance 1 is pi.
#[test]
fn white_skies() {
    let light = |size: [u32; 2], dark: u32| {
        let image = pfm(size, |i| [if i < dark { 0.0 } else { 1.0 }; 3]);
        let text = "Camera \"perspective\"\nWorldBegin\nShape \"sphere\"\nLightSource \"infinite\" \"string filename\" \"sky.pfm\" \"float illuminance\" 3.14159265\n";
        let files: &[(&str, &[u8])] = &[("s.pbrt", text.as_bytes()), ("sky.pfm", &image)];
        let scene = read_scene_from(files, "s.pbrt", &ReadOptions::default()).map_err(|e| e.to_string())?;
        match &scene.lights[0].kind {
            LightKind::Infinite { radiance: EnvironmentRadiance::LatLong { scale, .. } } => Ok(*scale),
            // pbrt-v4 takes half of what a square gives.
            LightKind::Infinite { radiance: EnvironmentRadiance::EqualArea { scale, .. } } => Ok(scale / 2.0),
            other => Err(format!("{other:?}")),
        }
    };
    for size in [[128, 64], [64, 64]] {
        assert!((light(size, 0).unwrap() - 1.0).abs() < 1e-3, "{size:?}");
    }
    assert!(light([8, 4], 16).is_err_and(|e| e.contains("has no light from above")));
}

#[test]
fn spectra_have_names_or_files() {
    let spectrum = |name: &str, eta: &str| format!("Material \"{name}\" \"spectrum eta\" \"{eta}\"");
    let metal = |name: &str| kind(&spectrum("conductor", name));
    assert!(format!("{:?}", metal("metal-Cu-eta")).contains("eta: [0.2004377, 0.9240334, 1.102212]"));
    let index = |name: &str| match kind(&spectrum("dielectric", name)) {
        MaterialKind::Dielectric { eta, .. } => eta,
        other => panic!("{other:?}"),
    };
    assert_eq!(index("glass-BK7"), 1.5168);
    // Each is known: others are errors.
    for line in include_str!("../../src/pbrt/spectra.tsv").lines() {
        let name = line.split('\t').next().expect("a name");
        match name.split('-').next() {
            Some("metal") => drop(metal(name)),
            Some("glass") => assert!(index(name) > 1.0, "{name}"),
            _ => drop(light(&format!("LightSource \"point\" \"spectrum I\" \"{name}\""))),
        }
    }
    for (material, name, what) in [
        ("conductor", "metal-Cu-j", "neither known by name nor a file"),
        ("conductor", "metal-Xx-k", "neither known by name nor a file"),
        ("conductor", "metal-Cu-etta", "; did you mean \"metal-Cu-eta\"?"),
        ("dielectric", "glass-BK", "neither known by name nor a file"),
        ("dielectric", "metal-Cu-k", "spectrum \"metal-Cu-k\" as eta of Material \"dielectric\" is not supported"),
        ("dielectric", "bad.spd", "bad.spd:2: \"one\" is not a number"),
        ("dielectric", "nan.spd", "nan.spd:1: \"nan\" is not a number"),
        ("dielectric", "bytes.spd", "bytes.spd:1: \"\u{ff}\" is not a number"),
    ] {
        let found = complaint(&spectrum(material, name));
        assert!(found.contains(what), "{found}");
    }
    // Between its values at 500 and 600 nm.
    assert!((index("glass.spd") - 1.938).abs() < 1e-6);
}
