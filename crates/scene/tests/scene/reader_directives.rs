//! Directives of pbrt-v4: the scenes that they make, and the errors of wrong ones.

use crate::snippets::*;
use dapple_scene::{
    Color, EnvironmentRadiance, Geometry, LightKind, MaterialKind, MediumInterface, Projection, SpotFalloff,
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
        "s.pbrt:4: LightSource \"distant\" needs from and to to differ"
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
    assert!(complaint(text).contains("the power of a stretched sphere or disk is not known"), "{}", complaint(text));
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
    for (text, expected) in [
        (
            "Material \"conductor\" \"spectrum eta\" \"metal-Cu-et\"",
            "s.pbrt:4: spectrum \"metal-Cu-et\" is neither known by name nor a file; did you mean \"metal-Cu-eta\"?",
        ),
        (
            "Material \"conductor\" \"spectrum eta\" \"bad.spd\"",
            "bad.spd:2: \"one\" is not a number; a spectrum file holds wavelengths and values",
        ),
        (
            "Material \"diffuse\" \"spectrum reflectance\" [500 1 400 1]",
            "s.pbrt:4: parameter reflectance of Material \"diffuse\" takes wavelengths that rise, not 400 after 500",
        ),
        (
            "Material \"diffuse\" \"spectrum reflectance\" [400 1 500 2]",
            "s.pbrt:4: parameter reflectance of Material \"diffuse\" must be at least 0",
        ),
        (
            "Material \"diffuse\" \"blackbody reflectance\" 5000",
            "s.pbrt:4: a black body as reflectance of Material \"diffuse\" is not supported; remove it, or allow unsupported directives",
        ),
        (
            "LightSource \"infinite\" \"spectrum L\" \"metal-Cu-k\"",
            "s.pbrt:4: spectrum \"metal-Cu-k\" as L of LightSource \"infinite\" is not supported; remove it, or allow unsupported directives",
        ),
    ] {
        // A share is cut to 1 rather than refused: the one row that is read well.
        match read(&format!("{HEAD}{WORLD}{text}\n{TAIL}")) {
            Ok(_) => assert!(expected.ends_with("at least 0"), "{text}"),
            Err(e) => assert_eq!(e.to_string(), expected),
        }
    }
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
    for (text, expected) in [
        (
            "ObjectInstance \"lake\"\nObjectBegin \"late\"\nObjectEnd",
            "s.pbrt:4: unknown object \"lake\"; did you mean \"late\"?",
        ),
        (
            "ObjectBegin \"a\"\nObjectEnd\nObjectBegin \"a\"\nObjectEnd",
            "s.pbrt:6: object \"a\" is made twice (first at s.pbrt:4); rename one",
        ),
        (
            "ObjectBegin \"a\"\nObjectInstance \"a\"\nObjectEnd",
            "s.pbrt:5: ObjectInstance within an object; objects hold shapes only, so move it out",
        ),
        (
            "ObjectBegin \"a\"\nObjectBegin \"b\"\nObjectEnd\nObjectEnd",
            "s.pbrt:5: ObjectBegin within object \"a\" of s.pbrt:4; close that first",
        ),
        ("ObjectBegin \"a\"", "s.pbrt:4: this ObjectBegin is never closed"),
        (
            "ObjectBegin \"a\"\nAreaLightSource \"diffuse\"\nShape \"disk\"\nObjectEnd",
            "s.pbrt:6: an area light in an object is not supported; remove it, or allow unsupported directives",
        ),
    ] {
        assert_eq!(complaint(text), expected);
    }
    let unplaced =
        read(&format!("{HEAD}{WORLD}LightSource \"infinite\"\nObjectBegin \"o\"\nShape \"disk\"\nObjectEnd\n"));
    assert_eq!(
        unplaced.unwrap_err().to_string(),
        "s.pbrt: no shape stands in the world; place an object by ObjectInstance"
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
    for (text, expected) in [
        (
            "MakeNamedMedium \"m\"",
            "s.pbrt:4: MakeNamedMedium \"m\" lacks its type; add \"string type\" \"homogeneous\"",
        ),
        (
            "MakeNamedMedium \"m\" \"string type\" \"homogeneous\" \"float g\" 1",
            "s.pbrt:4: parameter g of MakeNamedMedium \"m\" must be between -1 and 1, not 1",
        ),
        (
            "MakeNamedMedium \"m\" \"string type\" \"homogeneous\" \"string preset\" \"Skin1\"",
            "s.pbrt:4: parameter preset (give its sigma_a and sigma_s) of MakeNamedMedium \"m\" is not supported; remove it, or allow unsupported directives",
        ),
        (
            "MakeNamedMedium \"mist\" \"string type\" \"homogeneous\"\nMediumInterface \"must\" \"\"",
            "s.pbrt:5: unknown medium \"must\"; did you mean \"mist\"?",
        ),
    ] {
        assert_eq!(complaint(text), expected);
    }
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
    for (text, expected) in [
        (
            format!("Shape \"loopsubdiv\" \"integer levels\" 15 {tetrahedron}"),
            "s.pbrt:4: Shape \"loopsubdiv\" would make 4294967296 triangles, after 0 made of others; at most 4194304 may be made in all",
        ),
        (
            "Shape \"loopsubdiv\" \"point3 P\" [0 0 0 1 0 0 0 1 0] \"integer indices\" [0 1 1]".into(),
            "s.pbrt:4: Shape \"loopsubdiv\": triangle 0 has the same corner twice; remove it",
        ),
        (
            "Shape \"bilinearmesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0 1 1 0] \"integer indices\" [0 1 2 4]".into(),
            "s.pbrt:4: patch 0 of Shape \"bilinearmesh\" has vertex index 4; indices are whole numbers from 0 to 3",
        ),
        (
            "Shape \"cylinder\" \"float zmin\" 1".into(),
            "s.pbrt:4: Shape \"cylinder\" has no height; zmin and zmax must differ",
        ),
        (
            "Shape \"sphere\" \"float phimax\" 0".into(),
            "s.pbrt:4: parameter phimax of Shape \"sphere\" must be above 0, not 0",
        ),
    ] {
        assert_eq!(complaint(&text), expected);
    }
}
