//! Models by themselves, wherever a scene is taken.

use crate::common::{Folder, Said};

const BOX: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\n\
    f 1 4 3 2\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";

#[test]
fn a_model_is_rendered_and_described() {
    let folder = Folder::new();
    folder.write("Box.OBJ", BOX);
    let json = folder.json("Box.OBJ -o a.png --spp 4 --resolution 32x24");
    assert_eq!(json["resolution"], serde_json::json!([32, 24]));
    assert!(!folder.read("a.png").is_empty());
    let info = folder.done("info Box.OBJ");
    assert!(info.contains("triangles   12") && info.contains("1 environment image"), "{info}");
}

#[test]
fn the_files_own_name_and_number_of_samples_are_used() {
    let folder = Folder::new();
    let scene = "Film \"rgb\" \"integer xresolution\" 8 \"integer yresolution\" 6 \"string filename\" \"there/night.png\"\n\
        Sampler \"sobol\" \"integer pixelsamples\" 3\nCamera \"perspective\"\nWorldBegin\nLightSource \"infinite\"\n\
        Translate 0 0 4\nShape \"sphere\"\n";
    folder.write("scene-v4.pbrt", scene);
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

#[test]
fn a_lamp_without_area_is_named() {
    let folder = Folder::new();
    let scene = "Camera \"perspective\"\nWorldBegin\nLightSource \"infinite\"\nAttributeBegin\nAreaLightSource \"diffuse\"\n\
        Shape \"trianglemesh\" \"point3 P\" [0 0 3 0 0 3 0 1 3] \"integer indices\" [0 1 2]\nAttributeEnd\nShape \"sphere\"\n";
    folder.write("dark.pbrt", scene);
    let warning = "warning: dark.pbrt:6: this area light has zero area and emits no light; make it larger";
    folder.says("render dark.pbrt --spp 1 --resolution 8x8 -o a.png", 0, &[warning]);
}

/// Every input and output of the program under a name that is not UTF-8.
#[cfg(target_os = "linux")] // Other systems refuse such names.
#[test]
fn paths_that_are_not_utf_8_are_read_and_written() {
    use std::ffi::OsString;
    use std::os::unix::ffi::OsStringExt;
    // "café" in Latin-1, and a name of both encodings.
    for stem in [&b"caf\xe9"[..], b"\xc3\xa9\xe9"] {
        let folder = Folder::new();
        let name = |end: &str| OsString::from_vec([stem, end.as_bytes()].concat());
        let run = |words: &str| {
            let mut command = folder.command("");
            command.args(words.split(' ').map(|word| word.strip_prefix('@').map_or_else(|| word.into(), &name)));
            let said = Said::of(command.output().expect("the program starts"));
            assert_eq!(said.status, Some(0), "{words}: {}", said.err);
            said.out
        };
        std::fs::write(folder.0.path().join(name(".obj")), BOX).expect("the model");
        assert!(run("info @.obj").contains("triangles   12"));
        let small = "--spp 4 --resolution 8x6";
        run(&format!("render @.obj -o @.exr -o @.png --maps @ --preview @-now.png --checkpoint @.ckpt {small}"));
        let spec = run(&format!("render @.obj --print-spec {small}"));
        std::fs::write(folder.0.path().join(name(".json")), spec).expect("the description");
        run("render --spec @.json -o @-2.exr");
        run(&format!("render @.obj --part 1/2 -o @-1.part {small} --sampler uniform"));
        run(&format!("render @.obj --part 2/2 -o @-2.part {small} --sampler uniform"));
        run("merge @-1.part @-2.part -o @-3.exr");
        run(&format!("render @.obj -o @.plan {small}"));
        run("render --from @.plan --part 1/1 -o @.part");
        run("plan @.part -o @-2.plan");
        run("compare @.exr @-2.exr");
        run("denoise @.exr -o @-4.exr");
        let read = |end: &str| std::fs::read(folder.0.path().join(name(end))).expect("the file");
        assert!(["-2.exr", "-3.exr", "-4.exr", ".png", "-now.png"].into_iter().all(|end| !read(end).is_empty()));
        run(&format!("render @.obj {small}"));
        let default = if stem[0] == b'c' { "caf\u{e9}.exr" } else { "\u{e9}\u{e9}.exr" };
        assert!(folder.path(default).exists(), "{:?}", folder.names());
    }
}
