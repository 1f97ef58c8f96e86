//! Errors of wrong scenes, word for word, and the descriptions of right ones.

use dapple_scene::ReadError;
use dapple_scene::pbrt::{ReadOptions, read_scene_from};
use dapple_scene::{
    Color, ConductorFresnel, Emission, EnvironmentRadiance, Geometry, LightKind, MaterialKind, PixelFilter, Projection,
    Scene, TextureKind,
};
use glam::{DVec3, dvec3};

const HEAD: &str =
    "Film \"rgb\" \"integer xresolution\" 4 \"integer yresolution\" 3\nCamera \"perspective\"\nWorldBegin\n";
const TAIL: &str = "LightSource \"infinite\"\nShape \"sphere\"\n";

fn read_with(text: &str, options: &ReadOptions) -> Result<Scene, ReadError> {
    let loop_a = b"Include \"loop-b.pbrt\"\n";
    let loop_b = b"Include \"./loop-a.pbrt\"\n";
    let files: &[(&str, &[u8])] = &[
        ("s.pbrt", text.as_bytes()),
        ("loop-a.pbrt", loop_a),
        ("loop-b.pbrt", loop_b),
        ("part.pbrt", b"Shape \"sphere\"\n"),
        ("broken.pbrt", b"Shape \"sphere\" \"float radius\" -1\n"),
        ("packed.ply", b"\x1f\x8b\x08\x00"),
    ];
    read_scene_from(files, "s.pbrt", options)
}

fn read(text: &str) -> Result<Scene, ReadError> {
    read_with(text, &ReadOptions::default())
}

/// A scene with this text in its world.
fn world(text: &str) -> Scene {
    read(&format!("{HEAD}{text}\n{TAIL}")).unwrap_or_else(|e| panic!("{text}: {e}"))
}

/// The errors of this text in an otherwise valid world; its first line is line 4.
fn complaint(text: &str) -> String {
    read(&format!("{HEAD}{text}\n{TAIL}")).map(|_| ()).expect_err(text).to_string()
}

/// The errors of this text before an otherwise valid world; its first line is line 1.
fn option_complaint(text: &str) -> String {
    let head = if text.contains("Film") { "Camera \"perspective\"\nWorldBegin\n" } else { HEAD };
    read(&format!("{text}\n{head}{TAIL}")).map(|_| ()).expect_err(text).to_string()
}

fn notices(text: &str) -> Vec<String> {
    world(text).notices.iter().map(|n| format!("{}: {}", n.source, n.message)).collect()
}

#[test]
fn small_scene() {
    let scene = read(include_str!("../scenes/small.pbrt")).unwrap();
    assert_eq!(scene.film.resolution, [40, 30]);
    assert_eq!((scene.film.spp, scene.film.file_name.as_deref()), (Some(16), Some("small.exr")));
    assert_eq!(scene.film.pixel_filter, PixelFilter::Box { radius: [0.5, 0.5] });
    assert_eq!(
        (scene.max_depth, scene.camera.projection, scene.name.as_str()),
        (Some(7), Projection::Perspective { fov: 45.0 }, "s")
    );
    assert!((scene.camera.to_world.transform_point3(DVec3::ZERO) - dvec3(0.0, 0.0, -5.0)).length() < 1e-12);
    assert_eq!(scene.shapes.len(), 3);
    let kind = |shape: usize| &scene.materials[scene.shapes[shape].material.0 as usize].kind;
    assert!(matches!(kind(0), MaterialKind::Diffuse { reflectance: Color::Texture(_) }));
    let MaterialKind::Conductor { fresnel: ConductorFresnel::EtaK { eta, .. }, roughness } = kind(1) else { panic!() };
    assert_eq!((eta[0], roughness.constants(), roughness.remap), (0.200_437_7, Some([0.1, 0.1]), true));
    assert!(scene.shapes[0].emission.is_none() && scene.shapes[1].emission.is_none());
    assert_eq!(scene.shapes[2].emission, Some(Emission { radiance: [8.0, 6.0, 4.0], two_sided: false }));
    assert_eq!(scene.shapes[2].to_world.transform_point3(DVec3::ZERO), dvec3(0.0, 3.0, 0.0));
    assert_eq!((scene.shapes[0].source.line, scene.shapes[2].source.line), (15, 21));
    assert!(matches!(scene.textures[0].kind, TextureKind::Checkerboard { scale: [4.0, 4.0], .. }));
}

#[test]
fn transforms_apply_right_to_left() {
    let scene = world(
        "Translate 1 0 0\nRotate 90 0 0 1\nScale 2 2 2\nShape \"sphere\"\nCoordinateSystem \"here\"\nIdentity\nShape \"sphere\"\nCoordSysTransform \"here\"\nConcatTransform [1 0 0 0 0 1 0 0 0 0 1 0 5 0 0 1]\nShape \"sphere\"\nCoordSysTransform \"camera\"\nReverseOrientation",
    );
    let at = |i: usize, p| scene.shapes[i].to_world.transform_point3(p);
    assert!((at(0, DVec3::X) - dvec3(1.0, 2.0, 0.0)).length() < 1e-12);
    assert_eq!(at(1, DVec3::X), DVec3::X);
    assert!((at(2, DVec3::ZERO) - dvec3(1.0, 10.0, 0.0)).length() < 1e-12);
    assert_eq!(scene.shapes.iter().map(|s| s.reversed).collect::<Vec<_>>(), [false, false, false, true]);
}

#[test]
fn what_may_be_written_either_way() {
    let text = "Material \"conductor\" \"bool remaproughness\" \"false\" \"rgb reflectance\" [.1 .2 .3]\nShape \"sphere\" \"float radius\" [ 2 ]\nMaterial \"conductor\" \"bool remaproughness\" false\nShape \"disk\" \"float innerradius\" .5";
    let scene = world(text);
    assert_eq!(scene.shapes.len(), 3);
    assert!(matches!(scene.shapes[0].geometry, Geometry::Sphere { radius: 2.0 }));
    for text in [text.replace('\n', "\r\n"), format!("\u{feff}{HEAD}{text}\n{TAIL}")] {
        let whole = if text.starts_with('\u{feff}') { text } else { format!("{HEAD}{text}\n{TAIL}") };
        assert_eq!(format!("{:?}", read(&whole).unwrap()), format!("{scene:?}"));
    }
}

#[test]
fn names_are_looked_up_at_the_end() {
    let scene = world("NamedMaterial \"late\"\nShape \"disk\"\nMakeNamedMaterial \"late\" \"string type\" \"diffuse\"");
    assert_eq!(scene.materials[scene.shapes[0].material.0 as usize].name, "late");
    assert_eq!(
        complaint("MakeNamedMaterial \"late\" \"string type\" \"diffuse\"\nNamedMaterial \"lade\""),
        "s.pbrt:5: unknown material \"lade\"; did you mean \"late\"?"
    );
}

#[test]
fn textures_are_folded() {
    let scene = world(
        "Texture \"c\" \"spectrum\" \"constant\" \"rgb value\" [.4 .2 .8]\nTexture \"half\" \"float\" \"constant\" \"float value\" .5\nTexture \"d\" \"spectrum\" \"scale\" \"texture tex\" \"c\" \"texture scale\" \"half\"\nMaterial \"diffuse\" \"texture reflectance\" \"d\"",
    );
    assert_eq!(scene.materials[0].kind, MaterialKind::Diffuse { reflectance: Color::Constant([0.2, 0.1, 0.4]) });
    assert!(scene.textures.is_empty());
}

#[test]
fn attributes_add_parameters() {
    let scene = world(
        "AttributeBegin\nAttribute \"shape\" \"float radius\" 3\nShape \"sphere\"\nShape \"disk\" \"float radius\" 4\nAttributeEnd",
    );
    assert!(matches!(scene.shapes[0].geometry, Geometry::Sphere { radius: 3.0 }));
    assert!(matches!(scene.shapes[1].geometry, Geometry::Disk { radius: 4.0, .. }));
    assert!(matches!(scene.shapes[2].geometry, Geometry::Sphere { radius: 1.0 }));
}

#[test]
fn lights_are_scaled() {
    let scene = world("LightSource \"infinite\" \"rgb L\" [1 2 3] \"float scale\" 2");
    let LightKind::Infinite { radiance: EnvironmentRadiance::Constant(rgb) } = scene.lights[0].kind else { panic!() };
    assert_eq!(rgb, [2.0, 4.0, 6.0]);
    let scene = world("AreaLightSource \"diffuse\" \"blackbody L\" 6500 \"bool twosided\" true");
    let Emission { radiance: [r, g, b], two_sided } = scene.shapes[0].emission.unwrap();
    assert!((r - 1.0).abs() < 0.1 && (g - 1.0).abs() < 0.1 && (b - 1.0).abs() < 0.1 && two_sided, "{r} {g} {b}");
}

#[test]
fn crop_windows_round_up() {
    let read = |film: &str| {
        let text = format!(
            "Film \"rgb\" \"integer xresolution\" 10 \"integer yresolution\" 10 {film}\nCamera \"perspective\"\nWorldBegin\n{TAIL}"
        );
        read(&text).unwrap().film.crop
    };
    assert_eq!(read("\"float cropwindow\" [.25 .5 0 1]"), Some([3, 0, 5, 10]));
    assert_eq!(read("\"integer pixelbounds\" [1 5 2 20]"), Some([1, 2, 5, 10]));
    assert_eq!(read(""), None);
}

#[test]
fn messages_about_words() {
    for (text, expected) in [
        ("Shap \"sphere\"", "s.pbrt:4: unknown directive \"Shap\"; did you mean \"Shape\"?"),
        ("Frobnicate 1 2", "s.pbrt:4: unknown directive \"Frobnicate\"; remove it or correct its spelling"),
        ("\n17", "s.pbrt:5: a directive should stand here, not \"17\""),
        ("Translate 1 2", "s.pbrt:5: Translate takes 3 numbers: number 3 of 3 is missing"),
        ("Scale 1 0 1", "s.pbrt:4: with this, the transform flattens space or overflows; it must have an inverse"),
        ("Rotate 1 0 0 0", "s.pbrt:4: Rotate needs an axis; its last three numbers must not all be 0"),
        ("AttributeBegin", "s.pbrt:4: this AttributeBegin is never closed"),
        ("AttributeEnd", "s.pbrt:4: AttributeEnd without AttributeBegin; remove it"),
        (
            "AttributeBegin\nTransformEnd",
            "s.pbrt:5: TransformEnd closes the AttributeBegin of s.pbrt:4; they must match",
        ),
        ("CoordSysTransform \"word\"", "s.pbrt:4: unknown coordinate system \"word\"; did you mean \"world\"?"),
        ("Camera \"perspective\"", "s.pbrt:4: Camera belongs before WorldBegin; move it there"),
        ("WorldBegin", "s.pbrt:4: a second WorldBegin (the first is at s.pbrt:3); remove one"),
        (
            "Include \"none.pbrt\"",
            "s.pbrt:4: cannot read none.pbrt: no such file; check the name and that the file is there",
        ),
        ("Include \"loop-a.pbrt\"", "loop-b.pbrt:1: loop-a.pbrt includes itself; remove this Include"),
        ("Include \"broken.pbrt\"", "broken.pbrt:1: parameter radius of Shape \"sphere\" must be above 0, not -1"),
        (
            "MediumInterface \"a\" \"b\"",
            "s.pbrt:4: unknown medium \"a\"; make it by MakeNamedMedium\ns.pbrt:4: unknown medium \"b\"; make it by MakeNamedMedium",
        ),
        (
            "Material \"hair\"",
            "s.pbrt:4: Material \"hair\" is not supported; remove it, or allow unsupported directives",
        ),
        (
            "LightSource \"goniometric\"",
            "s.pbrt:4: LightSource \"goniometric\" is not supported; remove it, or allow unsupported directives",
        ),
        (
            "LightSource \"infinite\" \"point3 portal\" [0 0 0]",
            "s.pbrt:4: parameter portal of LightSource \"infinite\" is not supported; remove it, or allow unsupported directives",
        ),
        (
            "Shape \"cone\" \"float height\" 2",
            "s.pbrt:4: Shape \"cone\" is not supported; remove it, or allow unsupported directives",
        ),
        (
            "Shape \"disk\" \"float innerradius\" 1",
            "s.pbrt:4: parameter innerradius of Shape \"disk\" must be at least 0 and below radius, not 1",
        ),
    ] {
        assert_eq!(complaint(text), expected);
    }
}

#[test]
fn messages_about_parameters() {
    for (text, expected) in [
        (
            "Shape \"sphere\" \"string radius\" \"1\"",
            "s.pbrt:4: parameter radius of Shape \"sphere\" is declared string; write \"float radius\"",
        ),
        ("Shape \"sphere\" \"flaot radius\" 1", "s.pbrt:4: unknown parameter type \"flaot\"; did you mean \"float\"?"),
        (
            "Shape \"sphere\" \"radius\" 1",
            "s.pbrt:4: \"radius\" declares no parameter; write a type and a name, as in \"float radius\"",
        ),
        (
            "Shape \"sphere\" \"float radius\" [1 2]",
            "s.pbrt:4: parameter radius of Shape \"sphere\" takes one value, not 2",
        ),
        (
            "Shape \"sphere\" \"float radius\" []",
            "s.pbrt:4: parameter radius of Shape \"sphere\" takes one value, not 0",
        ),
        (
            "Shape \"sphere\"\n\"float radius\" 1\n\"float radius\" 2",
            "s.pbrt:6: parameter \"radius\" of Shape \"sphere\" is given twice; remove one",
        ),
        ("Shape \"sphere\" \"float radius\" [ 1\nIdentity", "s.pbrt:5: a ] is missing after \"float radius\""),
        ("Shape \"sphere\" \"float radius\" \"1\"", "s.pbrt:4: a parameter of type float takes numbers, not \"1\""),
        (
            "Material \"conductor\" \"bool remaproughness\" 1",
            "s.pbrt:4: a parameter of type bool takes true or false, not \"1\"",
        ),
        (
            "Material \"diffuse\" \"rgb reflectance\" [1 1]",
            "s.pbrt:4: parameter reflectance of Material \"diffuse\" takes 3 numbers, not 2",
        ),
        (
            "Material \"diffuse\" \"rgb reflectance\" [1 1 1.5]",
            "s.pbrt:4: parameter reflectance of Material \"diffuse\" must be within 0..=1 in every channel, not 1 1 1.5",
        ),
        (
            "Material \"diffuse\" \"texture reflectance\" \"wood\"",
            "s.pbrt:4: unknown texture \"wood\"; make it by Texture above this line",
        ),
        (
            "Texture \"t\" \"spectrum\" \"imagemap\" \"string filename\" \"t.png\"",
            "s.pbrt:4: cannot read t.png: no such file; check the name and that the file is there",
        ),
        (
            "Shape \"plymesh\" \"string filename\" \"m.ply\"",
            "s.pbrt:4: cannot read m.ply: no such file; check the name and that the file is there",
        ),
        (
            "Shape \"plymesh\" \"string filename\" \"packed.ply\"",
            "s.pbrt:4: packed.ply is compressed with gzip; unpack it and name the unpacked file",
        ),
        ("Shape \"plymesh\"", "s.pbrt:4: Shape \"plymesh\" lacks \"string filename\""),
        (
            "Shape \"trianglemesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0]\n\"integer indices\" [0 1 2 0 1 3]",
            "s.pbrt:5: triangle 1 of Shape \"trianglemesh\" has vertex index 3; indices are whole numbers from 0 to 2",
        ),
        (
            "Shape \"trianglemesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0] \"integer indices\" [0 1 -1]",
            "s.pbrt:4: triangle 0 of Shape \"trianglemesh\" has vertex index -1; indices are whole numbers from 0 to 2",
        ),
        (
            "Shape \"trianglemesh\" \"point3 P\" [0 0 0 1 0 0 0 1] \"integer indices\" [0 1 2]",
            "s.pbrt:4: parameter P of Shape \"trianglemesh\" takes a multiple of 3 numbers, not 8",
        ),
        (
            "Shape \"trianglemesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0] \"normal N\" [0 0 1]",
            "s.pbrt:4: Shape \"trianglemesh\": there are 1 normals for 3 vertices; give one for each, or none",
        ),
        (
            "Shape \"trianglemesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0] \"point2 uv\" [0 0]",
            "s.pbrt:4: Shape \"trianglemesh\": there are 1 texture coordinates for 3 vertices; give one for each, or none",
        ),
        (
            "Shape \"trianglemesh\" \"point3 P\" [0 0 0 1 0 0 0 1 nan]",
            "s.pbrt:4: \"nan\" is not a number; only finite numbers are allowed",
        ),
    ] {
        assert_eq!(complaint(text), expected);
    }
}

#[test]
fn numbers_of_scenes_are_finite_or_errors_i04() {
    let say = |value: &str| complaint(&format!("Shape \"sphere\"\n\"float radius\" [ {value} ]"));
    assert_eq!(say("inf"), "s.pbrt:5: \"inf\" is not a number; only finite numbers are allowed");
    assert_eq!(say("1e400"), "s.pbrt:5: \"1e400\" is too large; at most 1.8e308 can be stored");
    assert_eq!(say("0x10"), "s.pbrt:5: \"0x10\" is not a number; write it as in -1.5e3");
    let comma = "write a point, not a comma, before decimals, and spaces between numbers";
    assert_eq!(say("1,5"), format!("s.pbrt:5: \"1,5\" is not a number; {comma}"));
    let long = format!("0.1{}1", "0".repeat(1000));
    let scene = world(&format!("Shape \"sphere\" \"float radius\" {long}\nShape \"sphere\" \"float radius\" 1e-50"));
    assert!(matches!(scene.shapes[0].geometry, Geometry::Sphere { radius: 0.1 }));
    assert!(matches!(scene.shapes[1].geometry, Geometry::Sphere { radius: 1e-50 }));
    let files: &[(&str, &[u8])] = &[("s.pbrt", b"# a\nFilm \"rgb\" # \xe9\n")];
    let error = read_scene_from(files, "s.pbrt", &ReadOptions::default()).map(|_| ()).unwrap_err();
    assert_eq!(error.to_string(), "s.pbrt:2: the byte at offset 17 is not UTF-8; save the file as UTF-8");
}

#[test]
fn impossible_settings_are_errors_i06() {
    for (text, expected) in [
        (
            "Sampler \"sobol\" \"integer pixelsamples\" 0",
            "s.pbrt:1: parameter pixelsamples of Sampler \"sobol\" must be a whole number at least 1, not 0",
        ),
        (
            "Sampler \"sobol\" \"integer pixelsamples\" -4",
            "s.pbrt:1: parameter pixelsamples of Sampler \"sobol\" must be a whole number at least 1, not -4",
        ),
        (
            "Film \"rgb\" \"integer xresolution\" 0",
            "s.pbrt:1: parameter xresolution of Film \"rgb\" must be a whole number at least 1, not 0",
        ),
        (
            "Film \"rgb\" \"integer yresolution\" 2.5",
            "s.pbrt:1: parameter yresolution of Film \"rgb\" must be a whole number at least 1, not 2.5",
        ),
        (
            "Film \"rgb\" \"float cropwindow\" [1 1 0 1]",
            "s.pbrt:1: the crop window holds no pixel; give it as x0 x1 y0 y1 with x0 < x1 and y0 < y1",
        ),
        (
            "PixelFilter \"box\" \"float xradius\" 0",
            "s.pbrt:1: parameter xradius of PixelFilter \"box\" must be above 0, not 0",
        ),
        (
            "PixelFilter \"box\" \"float xradius\" nan",
            "s.pbrt:1: \"nan\" is not a number; only finite numbers are allowed",
        ),
        (
            "PixelFilter \"mitchell\"",
            "s.pbrt:1: PixelFilter \"mitchell\" (other than box, triangle and gaussian) is not supported; remove it, or allow unsupported directives",
        ),
        (
            "Camera \"perspective\" \"float fov\" 180",
            "s.pbrt:1: parameter fov of Camera \"perspective\" must be between 0 and 180 degrees, not 180",
        ),
        (
            "Camera \"spherical\"",
            "s.pbrt:1: Camera \"spherical\" is not supported; use Camera \"perspective\" or \"orthographic\"",
        ),
        (
            "Integrator \"path\" \"integer maxdepth\" -1",
            "s.pbrt:1: parameter maxdepth of Integrator \"path\" must be a whole number at least 0, not -1",
        ),
        (
            "ColorSpace \"rec2020\"",
            "s.pbrt:1: ColorSpace \"rec2020\" is not supported; remove it, or allow unsupported directives",
        ),
        ("Shape \"sphere\"", "s.pbrt:1: Shape belongs after WorldBegin; move it there"),
    ] {
        assert_eq!(option_complaint(text), expected);
    }
    let none = read("Film \"rgb\"\nWorldBegin\n").map(|_| ()).unwrap_err().to_string();
    assert_eq!(
        none,
        "s.pbrt: there is no Camera; add one before WorldBegin, as in Camera \"perspective\"\ns.pbrt: there are no shapes; add a Shape after WorldBegin\ns.pbrt: nothing gives off light; add a LightSource, or an AreaLightSource before a Shape"
    );
    let empty = read("").map(|_| ()).unwrap_err().to_string();
    assert_eq!(empty, "s.pbrt: there is no WorldBegin; the file holds no scene, or is cut off");
    // The light belongs to no shape.
    let lost = read(&format!("{HEAD}AttributeBegin\nAreaLightSource \"diffuse\"\nAttributeEnd\nShape \"sphere\"\n"));
    assert!(lost.map(|_| ()).unwrap_err().to_string().starts_with("s.pbrt: no lights remain"));
}

#[test]
fn deviations_from_the_file_are_listed_i06() {
    let unknown = notices("Shape \"sphere\" \"float raduis\" 2");
    assert_eq!(unknown, ["s.pbrt:4: Shape \"sphere\" has no parameter \"raduis\"; ignored; did you mean \"radius\"?"]);
    let thrice = "Shape \"sphere\" \"float raduis\" 2\n".repeat(3);
    let once = notices(&thrice);
    assert!(once.len() == 1 && once[0].ends_with("did you mean \"radius\"? (and 2 more times)"), "{once:?}");
    let cameras = format!("Camera \"perspective\" \"float fov\" 20\n{HEAD}{TAIL}");
    let scene = read(&cameras).unwrap();
    assert_eq!(scene.notices[0].message, "a second Camera (the first is at s.pbrt:1); this one counts");
    assert_eq!(scene.camera.projection, Projection::Perspective { fov: 90.0 });
    let scene = read(&format!("Integrator \"bdpt\" \"integer maxdepth\" 9\nSampler \"halton\"\n{HEAD}{TAIL}")).unwrap();
    let said: Vec<&str> = scene.notices.iter().map(|n| n.message.as_str()).collect();
    assert_eq!(
        said,
        ["Integrator \"bdpt\" is ignored; by default, the scene's effects decide how light is transported; for \
             bidirectional path tracing, use --integrator bdpt"],
        "samplers are chosen here"
    );
    let volumes = read(&format!("Integrator \"volpath\"\n{HEAD}{TAIL}")).unwrap().notices;
    assert_eq!(volumes[0].message, "Integrator \"volpath\" is ignored; light is transported by path tracing");
    assert_eq!((scene.max_depth, scene.film.spp), (Some(9), None));
    assert_eq!(world("").max_depth, Some(5));
}

#[test]
fn unsupported_things_can_be_left_out() {
    let text = format!(
        "{HEAD}MakeNamedMedium \"a\" \"string type\" \"cloud\"\nNamedMaterial \"m\"\nMakeNamedMaterial \"m\" \"string type\" \"hair\" \"float x\" 1\nLightSource \"projection\"\nShape \"cone\" \"float y\" 3\nShape \"disk\"\nObjectBegin \"o\"\nAreaLightSource \"diffuse\"\nShape \"sphere\"\nObjectEnd\n{TAIL}"
    );
    assert_eq!(read(&text).unwrap_err().problems.len(), 5);
    let scene = read_with(&text, &ReadOptions::default().with_allow_unsupported(true)).unwrap();
    assert_eq!((scene.notices.len(), scene.shapes.len(), scene.lights.len()), (5, 2, 1));
    assert_eq!(
        scene.notices[0].message,
        "a medium of type \"cloud\" (other than homogeneous) is not supported; left out"
    );
    assert_eq!(scene.materials[scene.shapes[0].material.0 as usize].name, "m");
}

#[test]
fn all_problems_come_at_once() {
    let error = read(&"Shap 1\nFilm \"rgb\" \"integer xresolution\" -1\n".repeat(150)).unwrap_err();
    // 150 of each and the missing WorldBegin; "a second Film" is only a notice.
    assert_eq!((error.problems.len(), error.more), (100, 201));
    assert!(error.to_string().ends_with("… and 201 more problems"));
    assert_eq!(world("Include \"part.pbrt\"\nImport \"part.pbrt\"").shapes.len(), 3);
}
