//! Models by themselves, wherever a scene is taken.

mod common;

use common::Folder;

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
