//! Errors of wrong scenes, word for word, and the descriptions of right ones.

use dapple_scene::ReadError;
use dapple_scene::image::{Image, encode_pfm};
use dapple_scene::pbrt::{ReadOptions, read_scene_from};
use dapple_scene::{
    Color, ConductorFresnel, Emission, EnvironmentRadiance, Geometry, LightKind, MaterialKind, PixelFilter, Projection,
    Scene, TextureKind,
};
use glam::{DVec3, dvec3};
use image::{ImageFormat, RgbaImage};
use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::PathBuf;

pub(crate) const HEAD: &str = "Film \"rgb\" \"integer xresolution\" 4 \"integer yresolution\" 3\n";
pub(crate) const WORLD: &str = "Camera \"perspective\"\nWorldBegin\n";
pub(crate) const TAIL: &str = "LightSource \"infinite\"\nShape \"sphere\"\n";

pub(crate) fn pfm(size: [u32; 2], pixel: impl Fn(u32) -> [f32; 3]) -> Vec<u8> {
    let pixels = (0..size[0] * size[1]).map(pixel).collect();
    encode_pfm(&Image::new(size, pixels).unwrap()).unwrap()
}

/// Two pixels side by side.
fn rgba(format: ImageFormat, pixels: [[u8; 4]; 2]) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let image = RgbaImage::from_raw(2, 1, pixels.concat()).unwrap();
    image.write_to(&mut bytes, format).unwrap();
    bytes.into_inner()
}

pub(crate) fn read_with(text: &str, options: &ReadOptions) -> Result<Scene, ReadError> {
    let mut files: BTreeMap<PathBuf, Vec<u8>> = BTreeMap::new();
    files.insert("s.pbrt".into(), text.as_bytes().to_vec());
    files.insert("square.pfm".into(), pfm([32, 32], |_| [1.0, 2.0, 3.0]));
    files.insert("wide.pfm".into(), pfm([4, 2], |i| [i as f32, 0.5, 0.25]));
    // Two pixels each: the first one a fifth opaque but in the last file, the second one opaque.
    files.insert("leaf.png".into(), rgba(ImageFormat::Png, [[60, 120, 180, 51], [0, 0, 0, 255]]));
    files.insert("leaf.tga".into(), rgba(ImageFormat::Tga, [[60, 120, 180, 51], [0, 0, 0, 255]]));
    files.insert("opaque.png".into(), rgba(ImageFormat::Png, [[60, 120, 180, 255], [0, 0, 0, 255]]));
    files.insert("flat.spd".into(), b"# no colour\n400 0.25\n700 0.25\n".to_vec());
    files.insert("bad.spd".into(), b"400 1\n500 one\n".to_vec());
    files.insert("nan.spd".into(), b"400 nan\n".to_vec());
    files.insert("bytes.spd".into(), b"\xff".to_vec());
    files.insert("glass.spd".into(), b"# glass\n500 1.5\r\n600 2e0 # end\n".to_vec());
    files.insert("loop-a.pbrt".into(), b"Include \"loop-b.pbrt\"\n".to_vec());
    files.insert("loop-b.pbrt".into(), b"Include \"./loop-a.pbrt\"\n".to_vec());
    files.insert("part.pbrt".into(), b"Shape \"sphere\"\n".to_vec());
    files.insert("broken.pbrt".into(), b"Shape \"sphere\" \"float radius\" -1\n".to_vec());
    files.insert("packed.ply".into(), b"\x1f\x8b\x08\x00".to_vec());
    read_scene_from(&files, "s.pbrt", options)
}

pub(crate) fn read(text: &str) -> Result<Scene, ReadError> {
    read_with(text, &ReadOptions::default())
}

pub(crate) fn world(text: &str) -> Scene {
    read(&format!("{HEAD}{WORLD}{text}\n{TAIL}")).unwrap_or_else(|e| panic!("{text}: {e}"))
}

/// The errors of this text in an otherwise valid world; its first line is line 4.
pub(crate) fn complaint(text: &str) -> String {
    read(&format!("{HEAD}{WORLD}{text}\n{TAIL}")).map(|_| ()).expect_err(text).to_string()
}

pub(crate) fn options(text: &str) -> Scene {
    read(&format!("{HEAD}{text}\nWorldBegin\n{TAIL}")).unwrap_or_else(|e| panic!("{text}: {e}"))
}

pub(crate) fn kind(text: &str) -> MaterialKind {
    let scene = world(&format!("{text}\nShape \"disk\""));
    scene.materials[scene.shapes[0].material.0 as usize].kind.clone()
}

pub(crate) fn light(text: &str) -> (LightKind, glam::DAffine3) {
    let light = world(text).lights[0].clone();
    (light.kind, light.to_world)
}

pub(crate) fn close(a: [f32; 3], b: [f32; 3], within: f32) -> bool {
    (0..3).all(|i| (a[i] - b[i]).abs() <= within)
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
    assert_eq!(scene.shapes[2].emission, Some(Emission::even([8.0, 6.0, 4.0], false)));
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
    // Matrices are column-major. Seen along +x with z up, y runs to the right: the directions of a viewer.
    let matrix = world("Transform [1 2 3 0 4 5 6 0 7 8 10 0 11 12 13 1]\nShape \"disk\"").shapes[0].to_world;
    assert_eq!(matrix.transform_point3(DVec3::X), dvec3(12.0, 14.0, 16.0));
    let view = world("LookAt 0 0 0 1 0 0 0 0 1\nShape \"disk\"").shapes[0].to_world;
    let seen = [DVec3::X, DVec3::Z, DVec3::Y].map(|axis| view.transform_vector3(axis));
    assert!(seen.iter().zip([DVec3::Z, DVec3::Y, DVec3::X]).all(|(a, b)| (*a - b).length() < 1e-12), "{seen:?}");
}

#[test]
fn what_may_be_written_either_way() {
    let text = "Material \"conductor\" \"bool remaproughness\" \"false\" \"rgb reflectance\" [.1 .2 .3]\nShape \"sphere\" \"float radius\" [ 2 ]\nMaterial \"conductor\" \"bool remaproughness\" false\nShape \"disk\" \"float innerradius\" .5";
    let scene = world(text);
    assert_eq!(scene.shapes.len(), 3);
    assert!(matches!(scene.shapes[0].geometry, Geometry::Sphere { radius: 2.0 }));
    for text in [text.replace('\n', "\r\n"), format!("\u{feff}{HEAD}{WORLD}{text}\n{TAIL}")] {
        let whole = if text.starts_with('\u{feff}') { text } else { format!("{HEAD}{WORLD}{text}\n{TAIL}") };
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
    let Emission { radiance: [r, g, b], two_sided, .. } = scene.shapes[0].emission.unwrap();
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

/// Directives and their messages of `messages.txt`: those in the world, and those before it.
fn messages() -> [Vec<(String, String)>; 2] {
    let text: String = include_str!("../scenes/messages.txt")
        .lines()
        .filter(|l| !l.starts_with("# "))
        .map(|l| l.to_owned() + "\n")
        .collect();
    let (world, options) = text.split_once("==\n").expect("two parts");
    [world, options].map(|part| {
        let blocks = part.split("\n\n").map(str::trim).filter(|block| !block.is_empty());
        let join = |lines: Vec<&str>| lines.join("\n");
        let block = |block: &str| {
            let (said, text): (Vec<&str>, Vec<&str>) = block.lines().partition(|line| line.starts_with("> "));
            (join(text), join(said.iter().map(|line| &line[2..]).collect()))
        };
        blocks.map(block).collect()
    })
}

#[test]
fn messages_about_parameters() {
    let [world, _] = messages();
    assert!(world.len() > 70, "{}", world.len());
    world.iter().for_each(|(text, expected)| assert_eq!(&complaint(text), expected, "{text}"));
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
}

#[test]
fn impossible_settings_are_errors_i06() {
    let [_, options] = messages();
    assert!(options.len() > 10, "{}", options.len());
    for (text, expected) in &options {
        let head = if text.contains("Film") { WORLD.to_owned() } else { format!("{HEAD}{WORLD}") };
        let read = read(&format!("{text}\n{head}{TAIL}")).map(|_| ());
        assert_eq!(&read.expect_err(text).to_string(), expected);
    }
    let none = read("Film \"rgb\"\nWorldBegin\n").map(|_| ()).unwrap_err().to_string();
    assert_eq!(
        none,
        "s.pbrt: there is no Camera; add one before WorldBegin, as in Camera \"perspective\"\ns.pbrt: there are no shapes; add a Shape after WorldBegin\ns.pbrt: there are no lights; add a LightSource, or an AreaLightSource before a Shape"
    );
    let empty = read("").map(|_| ()).unwrap_err().to_string();
    assert_eq!(empty, "s.pbrt: there is no WorldBegin; the file holds no scene, or is cut off");
    // The light belongs to no shape.
    let lost =
        read(&format!("{HEAD}{WORLD}AttributeBegin\nAreaLightSource \"diffuse\"\nAttributeEnd\nShape \"sphere\"\n"));
    assert!(lost.map(|_| ()).unwrap_err().to_string().starts_with("s.pbrt: no lights remain"));
}

#[test]
fn deviations_from_the_file_are_listed_i06() {
    let unknown = notices("Shape \"sphere\" \"float raduis\" 2");
    assert_eq!(unknown, ["s.pbrt:4: Shape \"sphere\" has no parameter \"raduis\"; ignored; did you mean \"radius\"?"]);
    let thrice = "Shape \"sphere\" \"float raduis\" 2\n".repeat(3);
    let once = notices(&thrice);
    assert!(once.len() == 1 && once[0].ends_with("did you mean \"radius\"? (and 2 more times)"), "{once:?}");
    let cameras = format!("Camera \"perspective\" \"float fov\" 20\n{HEAD}{WORLD}{TAIL}");
    let scene = read(&cameras).unwrap();
    assert_eq!(scene.notices[0].message, "a second Camera (the first is at s.pbrt:1); this one is used");
    assert_eq!(scene.camera.projection, Projection::Perspective { fov: 90.0 });
    let scene =
        read(&format!("Integrator \"bdpt\" \"integer maxdepth\" 9\nSampler \"halton\"\n{HEAD}{WORLD}{TAIL}")).unwrap();
    let said: Vec<&str> = scene.notices.iter().map(|n| n.message.as_str()).collect();
    assert_eq!(
        said,
        ["Integrator \"bdpt\" is ignored; by default, the scene's effects determine the integrator; for \
             bidirectional path tracing, use --integrator bdpt"],
        "samplers are chosen here"
    );
    let volumes = read(&format!("Integrator \"volpath\"\n{HEAD}{WORLD}{TAIL}")).unwrap().notices;
    assert_eq!(volumes[0].message, "Integrator \"volpath\" is ignored; path tracing is used");
    assert_eq!((scene.max_depth, scene.film.spp), (Some(9), None));
    assert_eq!(world("").max_depth, Some(5));
}

#[test]
fn unsupported_things_can_be_left_out() {
    let text = format!(
        "{HEAD}{WORLD}MakeNamedMedium \"a\" \"string type\" \"cloud\"\nNamedMaterial \"m\"\nMakeNamedMaterial \"m\" \"string type\" \"hair\" \"float x\" 1\nLightSource \"projection\"\nShape \"cone\" \"float y\" 3\nShape \"disk\"\nObjectBegin \"o\"\nAreaLightSource \"diffuse\"\nShape \"sphere\"\nObjectEnd\n{TAIL}"
    );
    assert_eq!(read(&text).unwrap_err().problems.len(), 5);
    let scene = read_with(&text, &ReadOptions { allow_unsupported: true, memory: None }).unwrap();
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
