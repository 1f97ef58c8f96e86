//! Models by themselves, wherever a scene is taken.

use crate::common::Folder;

const BOX: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\n\
    f 1 4 3 2\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";

#[test]
fn a_model_is_rendered_and_described() {
    let folder = Folder::new();
    std::fs::write(folder.path("Box.OBJ"), BOX).expect("written");
    let json = folder.json("Box.OBJ -o a.png --spp 4 --resolution 32x24");
    assert_eq!(json["resolution"], serde_json::json!([32, 24]));
    assert!(!folder.read("a.png").is_empty());
    let info = folder.done("info Box.OBJ");
    assert!(info.contains("triangles   12") && info.contains("1 environment image"), "{info}");
}

#[test]
fn what_cannot_be_shown_is_refused_with_its_place() {
    let folder = Folder::new();
    for (name, text, said) in [
        ("bad.obj", "v 0 0 0\nf 1 2 3\n", "error: bad.obj:2: a corner has number 3, but there are only 1 vertices\n"),
        ("m.gltf", "{}", "error: m.gltf:1: missing field `asset`"),
        ("m.stl", "", "error: m.stl: 0 bytes that do not begin with `solid` are no STL file"),
    ] {
        std::fs::write(folder.path(name), text).expect("written");
        for command in ["info", "render"] {
            let run = folder.run(&format!("{command} {name}"));
            assert_eq!(run.status, Some(1));
            assert!(run.err.starts_with(said), "{}", run.err);
        }
    }
}

#[test]
fn the_files_own_name_and_number_of_samples_are_used() {
    let folder = Folder::new();
    let scene = "Film \"rgb\" \"integer xresolution\" 8 \"integer yresolution\" 6 \"string filename\" \"there/night.png\"\n\
        Sampler \"sobol\" \"integer pixelsamples\" 3\nCamera \"perspective\"\nWorldBegin\nLightSource \"infinite\"\n\
        Translate 0 0 4\nShape \"sphere\"\n";
    std::fs::write(folder.path("scene-v4.pbrt"), scene).expect("written");
    let json = folder.json("scene-v4.pbrt");
    assert_eq!(json["spp"], serde_json::json!(3.0));
    for name in ["night.exr", "night.png", "night-samples.png"] {
        assert!(!folder.read(name).is_empty(), "{name}");
    }
    // Options have the last word, and bounds hold.
    assert_eq!(folder.json("scene-v4.pbrt --spp 2 -o a.png")["spp"], serde_json::json!(2.0));
    assert_eq!(folder.json("scene-v4.pbrt --max-spp 1 -o b.png")["spp"], serde_json::json!(1.0));
    assert!(!folder.read("a.png").is_empty());
}

/// A triangle in glTF with a camera and a lamp, as a data URI: positions of 3 corners, little endian.
#[test]
fn a_gltf_scene_is_rendered_by_its_own_camera() {
    let folder = Folder::new();
    let corners = "AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA";
    let scene = format!(
        r#"{{"asset":{{"version":"2.0"}},"buffers":[{{"byteLength":36,"uri":"data:;base64,{corners}"}}],
"bufferViews":[{{"buffer":0,"byteLength":36}}],"accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}}],
"materials":[{{"emissiveFactor":[1,1,1],"doubleSided":true}}],
"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"material":0}}]}}],
"cameras":[{{"type":"perspective","perspective":{{"yfov":0.8,"aspectRatio":1.5,"znear":0.1}}}}],
"nodes":[{{"mesh":0}},{{"camera":0,"translation":[0.3,0.3,3]}}],"scenes":[{{"nodes":[0,1]}}],"scene":0}}"#
    );
    std::fs::write(folder.path("lamp.gltf"), scene).expect("written");
    let json = folder.json("lamp.gltf --spp 4 --resolution 24x16 --filter none -o lamp.png");
    assert_eq!(json["resolution"], serde_json::json!([24, 16]));
    let info = folder.done("info lamp.gltf");
    assert!(info.contains("triangles   1") && info.contains("1 area"), "{info}");
}

#[test]
fn a_lamp_without_area_is_named() {
    let folder = Folder::new();
    let scene = "Camera \"perspective\"\nWorldBegin\nLightSource \"infinite\"\nAttributeBegin\nAreaLightSource \"diffuse\"\n\
        Shape \"trianglemesh\" \"point3 P\" [0 0 3 0 0 3 0 1 3] \"integer indices\" [0 1 2]\nAttributeEnd\nShape \"sphere\"\n";
    std::fs::write(folder.path("dark.pbrt"), scene).expect("written");
    let said = folder.run("render dark.pbrt --spp 1 --resolution 8x8 -o a.png").err;
    assert!(
        said.contains("warning: dark.pbrt:6: this lamp has no area and gives off no light; make it larger"),
        "{said}"
    );
}

/// Formats of others are known by their content, under any name, and lead to a converter.
#[test]
fn other_formats_are_refused_with_what_converts_them() {
    let folder = Folder::new();
    for (name, text, message) in [
        (
            "a.usda",
            "#usda 1.0\ndef Xform \"a\" {}\n",
            "USD files are not supported; open it in Blender and export glTF",
        ),
        ("b.pbrt", "PXR-USDC\0\0", "USD files are not supported; open it in Blender and export glTF"),
        ("c.xml", "<scene version=\"3.0.0\"></scene>\n", "Mitsuba XML files are not supported; import it into Blender"),
        (
            "d.obj",
            "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
            "OFF files are not supported; convert it by `assimp export",
        ),
    ] {
        std::fs::write(folder.path(name), text).expect("written");
        for command in ["info", "render"] {
            let run = folder.run(&format!("{command} {name}"));
            assert_eq!(run.status, Some(1), "{name}: {}", run.err);
            assert!(run.err.starts_with(&format!("error: {name}: {message}")), "{}", run.err);
        }
    }
}
