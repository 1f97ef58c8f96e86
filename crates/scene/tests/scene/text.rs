//! Text as people have it: encodings, line ends, white space, quotes and comments, for every format that is text.

use dapple_scene::model::{read_obj, read_ply, read_stl};
use dapple_scene::text::decode;
use dapple_scene::{AnyOptions, Color, Geometry, MaterialKind, ReadError, Scene, TextureKind, read_any, read_any_from};
use std::collections::BTreeMap;
use std::path::PathBuf;

fn read(named: &[(&str, &[u8])]) -> Result<Scene, ReadError> {
    let files: BTreeMap<PathBuf, Vec<u8>> = named.iter().map(|(name, bytes)| (name.into(), bytes.to_vec())).collect();
    read_any_from(&files, named[0].0, &AnyOptions::default())
}

/// The scene, which must have been read without a notice.
fn clean(named: &[(&str, &[u8])]) -> Scene {
    let scene = read(named).unwrap_or_else(|e| panic!("{e}"));
    assert!(scene.notices.is_empty(), "{:?}", scene.notices);
    scene
}

fn color(scene: &Scene, shape: usize) -> Color {
    match scene.materials[scene.shapes[shape].material.0 as usize].kind {
        MaterialKind::Diffuse { reflectance } => reflectance,
        ref other => panic!("{other:?}"),
    }
}

fn triangles(scene: &Scene) -> usize {
    let count = |geometry: &Geometry| if let Geometry::Mesh(mesh) = geometry { mesh.triangles.len() } else { 0 };
    scene.shapes.iter().map(|shape| count(&shape.geometry)).sum()
}

const FACES: &str = "v 0 0 0\nv 1 0 0\nv 0 0 1\nusemtl NAME\nf 1 2 3\n";
const RED: &[u8] = b"newmtl red\nKd 1 0 0\n";
const PLY: &str = "ply\nformat ascii 1.0\ncomment made\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 0 1\n3 0 1 2\n";
const FACET: &str = "facet normal 0 1 0\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 0 1\nendloop\nendfacet\n";
const PBRT: &str = "Film \"rgb\"\nCamera \"perspective\"\nWorldBegin\nLightSource \"infinite\"\nShape \"sphere\"\n";

#[test]
fn decoded_text_has_no_mark_and_ends_lines_with_lf() {
    assert_eq!(decode(b"\xef\xbb\xbfa\r\nb\rc\n\r\rd\r").unwrap(), "a\nb\nc\n\n\nd\n");
    assert_eq!(decode("\u{fc}".as_bytes()).unwrap(), "\u{fc}");
    assert_eq!(decode(b"caf\xe9 \xc3\xa9").unwrap(), "caf\u{e9} \u{e9}", "Latin-1 and UTF-8 are the same name");
    for wide in [&b"\xff\xfev\0 \0"[..], b"\xfe\xff\0v\0 ", b"v\0 \0", b"\0v\0 ", b"\0\0\xfe\xff\0\0\0v"] {
        assert_eq!(decode(wide), Err("this text is in UTF-16; save it as UTF-8"));
    }
}

#[test]
fn utf_16_is_named_whatever_the_format() {
    let wide =
        |text: &str| [0xfeff].into_iter().chain(text.encode_utf16()).flat_map(u16::to_le_bytes).collect::<Vec<u8>>();
    for (name, text) in [
        ("a.obj", FACES),
        ("a.ply", PLY),
        ("a.stl", FACET),
        ("a.gltf", "{\"asset\": {}}"),
        ("a.pbrt", PBRT),
        ("a", "?"),
    ] {
        let found = read(&[(name, &wide(text))]).unwrap_err().to_string();
        assert_eq!(found, format!("{name}: this text is in UTF-16; save it as UTF-8"));
    }
    let found = [read_obj(&wide(FACES)).map(drop), read_ply(&wide(PLY)).map(drop), read_stl(&wide(FACET)).map(drop)];
    assert!(found.into_iter().all(|found| found.unwrap_err().to_string().contains("UTF-16")));
    let obj = FACES.replace("NAME", "red") + "mtllib a.mtl\n";
    let scene = read(&[("a.obj", obj.as_bytes()), ("a.mtl", &wide("newmtl red\nKd 1 0 0\n"))]).unwrap();
    assert!(scene.notices[0].message.contains("a.mtl cannot be read (this text is in UTF-16; save it as UTF-8)"));
}

#[test]
fn errors_name_the_line_whatever_ends_lines() {
    let bad_ply = PLY.replace("1 0 0", "1 x 0");
    for (name, text, line) in [
        ("a.obj", "v 0 0 0\n\nv 1 x 0\n".to_owned(), 3),
        ("a.ply", bad_ply, 12),
        ("a.stl", format!("solid\n{FACET}\nfacet\n"), 10),
        ("a.pbrt", "# a\nWorldBegin\nShape \"cube\"\n".to_owned(), 3),
        ("a.gltf", "{\"asset\":\n{\"version\": \"2.0\"},\n]".to_owned(), 3),
    ] {
        for end in ["\n", "\r\n", "\r"] {
            let found = read(&[(name, text.replace('\n', end).as_bytes())]).unwrap_err().to_string();
            assert!(found.contains(&format!("{name}:{line}: ")), "{end:?}: {found}");
        }
    }
}

#[test]
fn a_comment_that_ends_in_a_backslash_continues_nothing() {
    for comment in ["# in C:\\", "f 1 2 3 # in C:\\", "v 9 9 9 #\\"] {
        let obj = format!("v 0 0 0\nv 1 0 0\nv 0 0 1\n{comment}\nf 1 2 3\n");
        let model = read_obj(obj.as_bytes()).unwrap();
        assert_eq!(model.meshes[0].data.triangles.len(), if comment.starts_with('f') { 2 } else { 1 }, "{comment}");
    }
}

#[test]
fn materials_are_found_by_names_in_quotes_latin_1_and_with_comments() {
    let red = Color::Constant([1.0, 0.0, 0.0]);
    for (asked, named) in [
        ("red", "red"),
        ("\"red\"", "red"),
        ("red", "\"red\""),
        ("deep  red \t", " deep  red"),
        ("red # the deep one", "red"),
        ("red", "red # the deep one"),
        ("Material #25", "Material #25"),
        ("caf\u{e9}", "caf\u{e9}"),
    ] {
        let (obj, mtl) =
            (format!("mtllib a.mtl\n{}", FACES.replace("NAME", asked)), format!("newmtl {named}\nKd 1 0 0\n"));
        let latin = |text: &str| text.chars().map(|c| c as u8).collect::<Vec<u8>>();
        for (obj, mtl) in [
            (obj.clone().into_bytes(), mtl.clone().into_bytes()),
            (latin(&obj), mtl.clone().into_bytes()),
            (obj.clone().into_bytes(), latin(&mtl)),
            (latin(&obj), latin(&mtl)),
        ] {
            assert_eq!(color(&clean(&[("a.obj", &obj), ("a.mtl", &mtl)]), 0), red, "{asked}, {named}");
        }
    }
    let other = format!("mtllib a.mtl\n{}", FACES.replace("NAME", "Material #26"));
    let scene = read(&[("a.obj", other.as_bytes()), ("a.mtl", b"newmtl Material #25\nKd 1 0 0\n")]).unwrap();
    assert!(scene.notices[0].message.contains("unknown material \"Material #26\""), "{:?}", scene.notices);
}

#[test]
fn one_statement_names_several_libraries_whose_names_may_hold_blanks() {
    let blue = b"newmtl blue\nKd 0 0 1\n";
    for (statement, libraries) in [
        ("a.mtl b.mtl", ["a.mtl", "b.mtl"]),
        ("\"a.mtl\" \"b.mtl\"", ["a.mtl", "b.mtl"]),
        ("\"my a.mtl\"\tb.mtl # both", ["my a.mtl", "b.mtl"]),
        ("my a.mtl B.MTL", ["my a.mtl", "B.MTL"]),
        ("a b", ["a", "b"]),
    ] {
        let obj = format!("mtllib {statement}\n{}usemtl blue\nf 1 2 3\n", FACES.replace("NAME", "red"));
        let scene = clean(&[("a.obj", obj.as_bytes()), (libraries[0], RED), (libraries[1], blue)]);
        let colors = [0, 1].map(|shape| color(&scene, shape));
        assert_eq!(colors, [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]].map(Color::Constant), "{statement}");
    }
    let obj = format!("mtllib my a b.mtl\n{}", FACES.replace("NAME", "red"));
    clean(&[("a.obj", obj.as_bytes()), ("my a b.mtl", RED)]);
    let scene = read(&[("a.obj", obj.replace("b.mtl", "b.mtl c.mtl").as_bytes()), ("my a b.mtl", RED)]).unwrap();
    assert_eq!(scene.notices.len(), 1);
    assert!(scene.notices[0].message.starts_with("the materials of c.mtl cannot be read"));
}

#[test]
fn one_number_is_grey_and_textures_may_have_blanks_quotes_and_options() {
    let pfm = b"PF\n1 1\n-1.0\n\0\0\0\x3f\0\0\0\x3f\0\0\0\x3f";
    let obj = format!("mtllib a.mtl\n{}", FACES.replace("NAME", "red").replace("f 1 2 3", "vt 0 0\nf 1/1 2/1 3/1"));
    let of = |statement: &str, file: &str| {
        let mtl = format!("\u{feff}newmtl red\n{statement}\n");
        read(&[("a.obj", obj.as_bytes()), ("a.mtl", mtl.as_bytes()), (file, pfm)]).unwrap()
    };
    assert_eq!(color(&of("Kd 0.9", ""), 0), Color::Constant([0.9; 3]));
    assert_eq!(color(&of("Kd\t0.9 # three", ""), 0), Color::Constant([0.9; 3]));
    for (statement, file) in [
        ("map_Kd wood.pfm", "wood.pfm"),
        ("map_Kd brick wall.pfm\t ", "brick wall.pfm"),
        ("map_Kd \"brick wall.pfm\"", "brick wall.pfm"),
        ("map_Kd wood.pfm # from the shop", "wood.pfm"),
        ("map_Kd -s 2 2 1 brick wall.pfm", "brick wall.pfm"),
        ("map_Kd -blendu on -o 1 -mm 0 1 wood.pfm", "wood.pfm"),
    ] {
        let scene = of(statement, file);
        let Color::Texture(id) = color(&scene, 0) else { panic!("{statement}: {:?}", scene.notices) };
        assert!(matches!(scene.textures[id.0 as usize].kind, TextureKind::Image { .. }));
        assert_eq!(scene.notices.len(), usize::from(statement.contains(" -")), "only options are left out");
    }
}

#[test]
fn ascii_ply_is_separated_by_any_white_space_and_comments_are_any_bytes() {
    let plain = read_ply(PLY.as_bytes()).unwrap();
    let body = PLY.find("0 0 0").unwrap();
    let oneline = format!("{}{}\n", &PLY[..body], PLY[body..].trim_end().replace('\n', " "));
    let spread = format!("{}\n\n{}", &PLY[..body], PLY[body..].replace(' ', "\n\t"));
    let latin: Vec<u8> = PLY.replace("made", "\u{e9}\u{e9}").chars().map(|c| c as u8).collect();
    for (what, text) in [
        ("mark", format!("\u{feff}{PLY}").into_bytes()),
        ("CRLF", PLY.replace('\n', "\r\n").into_bytes()),
        ("CR", PLY.replace('\n', "\r").into_bytes()),
        ("one line", oneline.into_bytes()),
        ("many lines", spread.into_bytes()),
        ("trailing blanks", PLY.replace('\n', " \t\n").into_bytes()),
        ("blank lines", PLY.replace('\n', "\n\n").into_bytes()),
        ("Latin-1", latin),
        ("end of DOS", format!("{PLY}\u{1a}\n").into_bytes()),
    ] {
        let mesh = read_ply(&text).unwrap_or_else(|e| panic!("{what}: {e}"));
        assert_eq!((mesh.data, mesh.doubt), (plain.data.clone(), None), "{what}");
        assert_eq!(triangles(&clean(&[("whatever", &text)])), 1, "{what}");
    }
    let longer = PLY.replace("0 0 1\n3", "0 0 1\n7 3");
    assert!(read_ply(longer.as_bytes()).is_err());
    let doubt = read_ply(format!("{PLY}3 0 1 2\n").as_bytes()).unwrap().doubt.unwrap();
    assert!(doubt.starts_with("\"3\" in line 15 and everything after it is not read"), "{doubt}");
}

#[test]
fn binary_ply_may_begin_with_a_line_feed_after_any_line_end() {
    for end in ["\n", "\r\n", "\r"] {
        let header = "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n";
        let mut bytes = header.replace('\n', end).into_bytes();
        // The first byte of the first number is a line feed.
        let first = f32::from_le_bytes([b'\n', 0, 0, 0x40]);
        bytes.extend([first, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0].into_iter().flat_map(f32::to_le_bytes));
        bytes.push(3);
        bytes.extend([0, 1, 2].into_iter().flat_map(i32::to_le_bytes));
        assert_eq!(read_ply(&bytes).unwrap().data.positions[0].x, f64::from(first), "{end:?}");
    }
}

#[test]
fn facets_of_stl_are_read_whatever_their_normals_and_line_ends() {
    let plain = read_stl(format!("solid x\n{FACET}endsolid x\n").as_bytes()).unwrap().data;
    let solid = |facet: &str| format!("solid x\n{facet}endsolid x\n");
    for normal in ["nan nan nan", "inf 0 0", "-1.#IND00 0 0", "-nan(ind) -nan(ind) -nan(ind)", "", "0 1", "x"] {
        let facet = FACET.replace("0 1 0", normal);
        assert_eq!(read_stl(solid(&facet).as_bytes()).unwrap().data, plain, "{normal}");
    }
    let no_normal = FACET.replace(" normal 0 1 0", "");
    let apart = FACET.replace("end", "end ").replace("facet", "FACET");
    for text in [
        solid(&no_normal),
        solid(&apart).replace("endsolid", "end solid"),
        solid(FACET).replace('\n', "\r"),
        solid(FACET).replace('\n', "\r\n\r\n"),
        solid(FACET).replace('\n', " \t\n"),
        solid(FACET).replace('\n', " "),
        solid(FACET).replace(' ', "\n").replacen("solid\n", "solid ", 1).replace("endsolid\n", "endsolid "),
        format!("\u{feff}{}", solid(FACET)),
        solid(FACET).replace(" x", ""),
        solid(FACET).replace(" x", " facet of a solid"),
    ] {
        let mesh = read_stl(text.as_bytes()).unwrap_or_else(|e| panic!("{text}: {e}"));
        assert_eq!(mesh.data, plain, "{text}");
        assert_eq!(triangles(&clean(&[("whatever", text.as_bytes())])), 1);
    }
    let row = format!("{}{}solid y\n{FACET}solid z\n{FACET}endsolid\n", solid(FACET), solid(""));
    for text in [row.clone(), row.replace('\n', " ")] {
        assert_eq!(read_stl(text.as_bytes()).unwrap().data.triangles.len(), 3, "{text}");
    }
    let infinite = FACET.replace("vertex 1", "vertex 1.#INF");
    assert!(read_stl(solid(&infinite).as_bytes()).unwrap_err().to_string().contains("not finite"));
}

#[test]
fn json_may_have_a_mark_latin_1_and_scenes_without_nodes() {
    let gltf = r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],
        "meshes":[{"name":"caf","primitives":[{"attributes":{"POSITION":0}}]}],
        "accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}],
        "bufferViews":[{"buffer":0,"byteLength":36}],"buffers":[{"byteLength":36,"uri":"b%C3%A9.bin"}]}"#;
    let corners: Vec<u8> =
        [0.0_f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0].into_iter().flat_map(f32::to_le_bytes).collect();
    let latin: Vec<u8> = gltf.replace("caf", "caf\u{e9}").chars().map(|c| c as u8).collect();
    for (what, text) in [
        ("plain", gltf.as_bytes().to_vec()),
        ("mark", format!("\u{feff}\n{gltf}").into_bytes()),
        ("CR", gltf.replace('\n', "\r").into_bytes()),
        ("Latin-1", latin),
        ("escape in Latin-1", gltf.replace("%C3%A9", "%E9").into_bytes()),
        ("no nodes", gltf.replace(r#"{"nodes":[0]}"#, "{}").into_bytes()),
        ("other scene", gltf.replace(r#"{"nodes":[0]}"#, r#"{"name":"empty"},{"nodes":[0]}"#).into_bytes()),
        ("no scenes", gltf.replace(r#""scene":0,"scenes":[{"nodes":[0]}],"#, "").into_bytes()),
    ] {
        let scene = read(&[("whatever", &text), ("b\u{e9}.bin", &corners)]).unwrap_or_else(|e| panic!("{what}: {e}"));
        assert_eq!(triangles(&scene), 1, "{what}");
        let warned = ["no nodes", "other scene"].contains(&what);
        assert_eq!(scene.notices.len(), usize::from(warned), "{what}: {:?}", scene.notices);
    }
}

#[test]
fn pbrt_scenes_may_have_any_line_ends_and_latin_1() {
    let latin: Vec<u8> = format!("# caf\u{e9}\n{PBRT}").chars().map(|c| c as u8).collect();
    for text in [
        format!("\u{feff}{PBRT}").into_bytes(),
        PBRT.replace('\n', "\r").into_bytes(),
        format!("# a\r{}", PBRT.replace('\n', "\r")).into_bytes(),
        PBRT.replace('\n', " \t\r\n\r\n").into_bytes(),
        PBRT.replace(' ', "\n").into_bytes(),
        latin,
    ] {
        assert_eq!(clean(&[("whatever", &text)]).shapes.len(), 1, "{:?}", String::from_utf8_lossy(&text));
    }
}

#[cfg(unix)]
#[test]
fn files_are_found_by_names_in_utf_8_and_latin_1() {
    use std::ffi::OsStr;
    use std::os::unix::ffi::OsStrExt;
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &[u8]| folder.path().join(OsStr::from_bytes(name));
    let obj = FACES.replace("NAME", "red");
    std::fs::write(path(b"caf\xe9.mtl"), RED).unwrap();
    std::fs::write(path("bl\u{fc}.mtl".as_bytes()), RED).unwrap();
    for named in [&b"caf\xe9.mtl"[..], "caf\u{e9}.mtl".as_bytes(), b"bl\xfc.mtl", "bl\u{fc}.mtl".as_bytes()] {
        std::fs::write(path(b"\xe9.obj"), [b"mtllib ", named, b"\n", obj.as_bytes()].concat()).unwrap();
        let scene = read_any(path(b"\xe9.obj"), &AnyOptions::default()).unwrap();
        assert_eq!(color(&scene, 0), Color::Constant([1.0, 0.0, 0.0]), "{:?}", scene.notices);
    }
}

#[test]
fn names_that_end_in_a_backslash_continue_nothing() {
    for name in ["o a\\", "g C:\\", "usemtl a\\"] {
        let model = read_obj(format!("{name}\nv 0 0 0\nv 1 \\\n0 0\nv 0 0 1\nf 1 2 3\n").as_bytes()).unwrap();
        assert_eq!(model.meshes[0].data.positions.len(), 3, "{name}");
    }
}

#[test]
fn zeros_and_ctrl_z_at_the_end_are_no_text() {
    for end in ["\0", "\x1a", "\0\0\x1a\0", "\0\r\n\0\n"] {
        assert_eq!(decode(format!("v\n{end}").as_bytes()).unwrap(), "v\n");
        let ended = |text: &str| format!("{text}{end}").into_bytes();
        assert_eq!(triangles(&clean(&[("a.obj", &ended(&FACES.replace("usemtl NAME\n", "")))])), 1);
        assert_eq!(clean(&[("a.pbrt", &ended(PBRT))]).shapes.len(), 1);
    }
}

#[test]
fn text_stl_may_begin_with_comments_and_a_mark() {
    for start in ["; made\n# by hand\n", "\u{feff}", "// a solid\r\n\r\n", "\u{feff};\n"] {
        let stl = format!("{start}solid a\n{FACET}endsolid\n");
        assert_eq!(read_stl(stl.as_bytes()).unwrap().data.triangles.len(), 1, "{start:?}");
        assert_eq!(triangles(&clean(&[("a", stl.as_bytes())])), 1, "{start:?}: known without an extension");
    }
}
