//! Models by themselves: the scenes that they make, and the errors of broken ones.

use dapple_scene::model::{ModelOptions, UpAxis, read_obj, read_stl};
use dapple_scene::{
    AnyOptions, Color, Geometry, MaterialKind, MeshData, ReadError, Scene, TextureKind, read_any, read_any_from,
};
use rand::{RngExt, SeedableRng};
use std::collections::BTreeMap;
use std::path::PathBuf;

const TETRAHEDRON: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";

fn files(named: &[(&str, &[u8])]) -> BTreeMap<PathBuf, Vec<u8>> {
    named.iter().map(|(name, bytes)| (PathBuf::from(name), bytes.to_vec())).collect()
}

fn read(named: &[(&str, &[u8])]) -> Result<Scene, ReadError> {
    read_any_from(&files(named), named[0].0, &AnyOptions::default())
}

fn mesh(scene: &Scene, shape: usize) -> &MeshData {
    match &scene.shapes[shape].geometry {
        Geometry::Mesh(mesh) => mesh,
        other => panic!("{other:?}"),
    }
}

fn reflectance(scene: &Scene, shape: usize) -> Color {
    match scene.materials[scene.shapes[shape].material.0 as usize].kind {
        MaterialKind::Diffuse { reflectance } => reflectance,
        ref other => panic!("{other:?}"),
    }
}

/// A binary STL file of these facets.
fn binary_stl(header: &[u8; 80], facets: &[[[f32; 3]; 3]]) -> Vec<u8> {
    let mut bytes = header.to_vec();
    bytes.extend((facets.len() as u32).to_le_bytes());
    for facet in facets {
        bytes.extend([0; 12]);
        bytes.extend(facet.as_flattened().iter().flat_map(|c| c.to_le_bytes()));
        bytes.extend([0; 2]);
    }
    bytes
}

const FACETS: [[[f32; 3]; 3]; 2] =
    [[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], [[1.0, 0.0, 0.0], [1.0, 1.0, 0.5], [-0.0, 1.0, 0.0]]];

const TEXT_STL: &str = "solid first\n facet normal 0 0 1\n  outer loop\n   vertex 0 0 0\n   vertex 1 0 0\n   vertex 0 1 0\n  endloop\n endfacet\nendsolid first\nSOLID SECOND\n\nFACET NORMAL 0 0 1\nOUTER LOOP\nVERTEX 1 0 0\nVERTEX 1E0 1 0.5\nVERTEX 0 1 0\nENDLOOP\nENDFACET\nENDSOLID\n";

#[test]
fn a_model_alone_is_a_lit_scene() {
    let plate = b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
    let binary = binary_stl(&[0; 80], &FACETS);
    for (name, bytes) in
        [("a/Model.OBJ", TETRAHEDRON.as_bytes()), ("m.ply", plate), ("m.stl", TEXT_STL.as_bytes()), ("M.Stl", &binary)]
    {
        let scene = read(&[(name, bytes)]).unwrap();
        assert!(scene.name.eq_ignore_ascii_case("model") || scene.name.eq_ignore_ascii_case("m"));
        assert_eq!((scene.shapes.len(), scene.lights.len(), scene.notices.len()), (2, 1, 0), "{name}");
        assert!(mesh(&scene, 0).normals.is_empty());
    }
}

#[test]
fn the_up_axis_is_ys_or_zs_and_can_be_chosen() {
    let height = |name: &str, bytes: &[u8], options: ModelOptions| {
        let scene =
            read_any_from(&files(&[(name, bytes)]), name, &AnyOptions { model: options, ..AnyOptions::default() })
                .unwrap();
        let up = scene.camera.to_world.matrix3.y_axis;
        if up.y > up.z { 'y' } else { 'z' }
    };
    let default = ModelOptions::default();
    assert_eq!(height("m.obj", TETRAHEDRON.as_bytes(), default), 'y');
    assert_eq!(height("m.stl", TEXT_STL.as_bytes(), default), 'z');
    assert_eq!(height("m.obj", TETRAHEDRON.as_bytes(), ModelOptions { up: Some(UpAxis::Z), ..default }), 'z');
}

#[test]
fn stl_text_and_binary_agree_whatever_the_header_says() {
    let text = read_stl(TEXT_STL.as_bytes()).unwrap();
    assert_eq!((text.data.triangles.len(), text.data.positions.len()), (2, 4), "two solids, shared corners");
    let mut solid = [b' '; 80];
    solid[..5].copy_from_slice(b"solid");
    for header in [[0; 80], solid] {
        let binary = read_stl(&binary_stl(&header, &FACETS)).unwrap();
        assert_eq!((binary.data, binary.doubt), (text.data.clone(), None));
    }
    let extra = [binary_stl(&solid, &FACETS), vec![0; 7]].concat();
    assert!(read_stl(&extra).unwrap().doubt.unwrap().contains("7 bytes"));
}

#[test]
fn obj_corners_resolve_or_are_errors_with_lines_i05() {
    let faces = |text: &str| read_obj(format!("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n{text}").as_bytes());
    let corners = |text: &str| {
        let model = faces(text).unwrap();
        let data = &model.meshes[0].data;
        let at = |c: &u32| data.positions[*c as usize].truncate().to_array();
        data.triangles.iter().flatten().map(at).collect::<Vec<_>>()
    };
    let triangle = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]];
    for text in [
        "f 1 2 3",
        "f -4 -3 -2 # behind",
        "f 1// 2// 3//\n",
        "f \\\n 1 2 \\\r\n3\r\n",
        "vn 0 0 1\nf 1//1 2//-1 3//1",
        "l 1 2 3 4\nf 1 2 3\np 1",
    ] {
        assert_eq!(corners(text), triangle, "{text}");
    }
    assert_eq!(corners("f 1 2 3 4").len(), 6);
    // Faces before their vertices, and texture coordinates for some only.
    let model = read_obj(b"f 1 2 3\nvt 0 1\nf 1/1 2/1 3/1\nf 1/1 2/1 3\nv 0 0 0\nv 1 0 0\nv 0 1 0\n").unwrap();
    let uvs: Vec<usize> = model.meshes.iter().map(|m| m.data.uvs.len()).collect();
    assert_eq!((uvs, model.meshes[0].data.triangles.len()), (vec![0, 3], 2));
    for (text, what) in [
        ("f 1 2 0", "indices of vertices start at 1"),
        ("f 1 2 5", "only 4 vertices"),
        ("f 1 2 -5", "only 4 vertices so far"),
        ("f 1 2 2147483648", "only 4 vertices"),
        ("f 1 2 99999999999999999999", "is not a number"),
        ("f 1/7 2/7 3/7", "only 0 texture coordinates"),
        ("f 1//-9223372036854775808 2 3", "only 0 normals so far"),
        ("f 1/1/1/1 2 3", "more than three"),
        ("f //1 2 3", "has no vertex"),
        ("f 1 2", "3 corners or more, not 2"),
        ("f 1 2 x", "\"x\" is not a number"),
    ] {
        let message = faces(text).unwrap_err().to_string();
        assert!(message.starts_with("line 5: ") && message.contains(what), "{text}: {message}");
    }
    assert!(faces("").unwrap_err().to_string().contains("no faces"));
}

#[test]
fn numbers_of_models_are_finite_or_errors_with_lines_i04() {
    for (line, what) in [
        ("v nan 0 0", "not finite"),
        ("v 0 inf 0", "not finite"),
        ("v 1e400 0 0", "not finite"),
        ("v 1,5 0 0", "\"1,5\" is not a number"),
        ("v 0x10 0 0", "is not a number"),
        ("v 1 2", "needs 3 numbers, not 2"),
        ("vt", "needs 2 numbers"),
    ] {
        let message = read(&[("bad.obj", format!("{TETRAHEDRON}{line}\n").as_bytes())]).unwrap_err().to_string();
        assert!(message.starts_with("bad.obj:9: ") && message.contains(what), "{line}: {message}");
    }
    let digits = format!("v 0.1{} 0 0\n{TETRAHEDRON}", "0".repeat(1000));
    assert_eq!(read_obj(digits.replace("f 1 3 2", "f 1 4 2").as_bytes()).unwrap().meshes[0].data.positions[0].x, 0.1);
    let mut facets = FACETS;
    facets[1][2][0] = f32::NAN;
    let message = read(&[("bad.stl", &binary_stl(&[0; 80], &facets))]).unwrap_err().to_string();
    assert_eq!(message, "bad.stl: facet 1: a corner is not finite; repair the mesh");
    let message = read(&[("bad.stl", TEXT_STL.replace("1E0", "nan").as_bytes())]).unwrap_err().to_string();
    assert!(message.starts_with("bad.stl:12: "), "{message}");
    // Too far apart to be seen, and nothing to be seen.
    let far = TETRAHEDRON.replace("v 1 0 0", "v 1e308 0 0").replace("v 0 1 0", "v -1e308 0 0");
    assert!(read(&[("far.obj", far.as_bytes())]).unwrap_err().to_string().contains("the size of the model overflows"));
    let point = "v 1 1 1\nf 1 1 1\n";
    assert!(read(&[("point.obj", point.as_bytes())]).unwrap_err().to_string().contains("coincide"));
}

#[test]
fn materials_of_obj_files_are_diffuse_with_notices() {
    let obj = format!(
        "mtllib m.mtl\n{}usemtl odd\nf 1 2 3\nusemtl\nf 1 2 3\n",
        TETRAHEDRON.replace("f 1 2 4", "usemtl red\nf 1 2 4").replace("f 1 4 3", "usemtl wood\nf 1 4 3")
    );
    let mtl = "newmtl red\nKd 1 0 0\nKs 1 1 1\nnewmtl wood\nKd 0.5 0.5 0.5\nmap_Kd tex\\wood.pfm\n";
    let pfm = b"PF\n1 1\n-1.0\n\0\0\0\x3f\0\0\0\x3f\0\0\0\x3f";
    let scene = read(&[("d/a.obj", obj.as_bytes()), ("d/m.mtl", mtl.as_bytes()), ("d/tex/wood.pfm", pfm)]).unwrap();
    let colors: Vec<Color> = (0..4).map(|shape| reflectance(&scene, shape)).collect();
    assert_eq!([colors[0], colors[1], colors[3]], [[0.5; 3], [1.0, 0.0, 0.0], [0.5; 3]].map(Color::Constant));
    let Color::Texture(id) = colors[2] else { panic!("{:?}", colors[2]) };
    assert!(matches!(scene.textures[id.0 as usize].kind, TextureKind::Image { factor: 0.5, .. }));
    let notices: Vec<String> = scene.notices.iter().map(|n| format!("{}: {}", n.source, n.message)).collect();
    assert!(notices[0].starts_with("d/m.mtl: ") && notices[0].contains("Ks ignored"), "{notices:?}");
    assert!(notices[1].starts_with("d/a.obj:9: the mesh of \"wood\": it has textures but no"), "{notices:?}");
    assert_eq!(notices[2], "d/a.obj:12: unknown material \"odd\"; grey is used");
    // Nothing but the model: grey, and said.
    let alone = read(&[("d/a.obj", obj.as_bytes())]).unwrap();
    assert!(alone.notices[0].message.contains("d/m.mtl cannot be read"), "{:?}", alone.notices);
    assert!((0..4).all(|shape| reflectance(&alone, shape) == Color::Constant([0.5; 3])));
    let untextured = read(&[("d/a.obj", obj.as_bytes()), ("d/m.mtl", mtl.as_bytes())]).unwrap();
    assert!(untextured.notices.iter().any(|n| n.message.contains("Kd is used instead")));
}

#[test]
fn models_cut_at_any_byte_are_errors_or_shorter_meshes_i02() {
    // A cut behind a whole facet or face leaves a shorter mesh that nothing tells from one that was meant in OBJ
    // files; STL files tell.
    let stl = TEXT_STL.as_bytes();
    let ends: Vec<usize> = TEXT_STL.match_indices("endsolid").map(|(at, _)| at + 8).collect();
    for end in 0..stl.len() {
        if let Ok(found) = read_stl(&stl[..end]) {
            let first = (ends[0]..=TEXT_STL.find("SOLID").unwrap()).contains(&end);
            assert!(found.data.triangles.len() == 2 || first, "cut at byte {end}");
        }
    }
    let binary = binary_stl(&[0; 80], &FACETS);
    for end in 0..binary.len() {
        assert!(read_stl(&binary[..end]).is_err(), "cut at byte {end}");
    }
    let mut random = rand_pcg::Pcg64::seed_from_u64(4);
    for sample in [stl, &binary, TETRAHEDRON.as_bytes()] {
        for _ in 0..4000 {
            let mut bytes = sample.to_vec();
            for _ in 0..random.random_range(1..4) {
                let at = random.random_range(0..bytes.len());
                bytes[at] ^= 1 << random.random_range(0..8);
            }
            let (obj, stl) = (read_obj(&bytes).is_ok(), read_stl(&bytes));
            assert!(!obj || sample == TETRAHEDRON.as_bytes());
            if let Ok(mesh) = stl {
                mesh.data.check().unwrap();
            }
        }
    }
}

#[test]
fn models_with_false_headers_are_errors_i03() {
    let mut lie = binary_stl(&[0; 80], &FACETS);
    lie[80..84].copy_from_slice(&u32::MAX.to_le_bytes());
    assert!(read_stl(&lie).unwrap_err().to_string().contains("declares 4294967295 facets, but only 100 bytes"));
    for (name, bytes, what) in [
        ("a.stl", b"".as_slice(), "not an STL file"),
        ("a.stl", b"solid nothing\nendsolid\n", "no triangles"),
        ("a.stl", b"solid nothing\n", "cut off"),
        ("a.obj", b"", "no faces"),
        ("a.obj", b"\x1f\x8b\x08\x00", "gzip"),
        ("a.ply", b"\x28\xb5\x2f\xfd", "zstd"),
        ("a.stl", b"PK\x03\x04", "compressed"),
        ("a.gltf", b"{}", "missing field `asset`"),
    ] {
        let message = read(&[(name, bytes)]).unwrap_err().to_string();
        assert!(message.starts_with(name) && message.contains(what), "{message}");
    }
}

#[test]
fn extensions_decide_and_directories_are_refused_i10() {
    let options = AnyOptions::default();
    let given = files(&[
        ("m.Obj", TETRAHEDRON.as_bytes()),
        ("s.PBRT", b"Camera \"perspective\"\nWorldBegin\nLightSource \"infinite\"\nShape \"sphere\"\n"),
        ("z.pbrt", b"\x1f\x8b\x08 not text"),
        ("m.fbx", b""),
        ("m.foo", b"?"),
        ("scan.dat", TEXT_STL.as_bytes()),
        ("plain", b"Camera \"perspective\"\nWorldBegin\nLightSource \"infinite\"\nShape \"sphere\"\n"),
        ("m.obj.gz", b""),
    ]);
    assert_eq!(read_any_from(&given, "m.Obj", &options).unwrap().name, "m");
    assert_eq!(read_any_from(&given, "s.PBRT", &options).unwrap().name, "s");
    assert_eq!(read_any_from(&given, "scan.dat", &options).unwrap().name, "scan", "content decides");
    assert_eq!(read_any_from(&given, "plain", &options).unwrap().name, "plain", "no extension: a scene");
    for (name, what) in [
        ("m.fbx", "FBX files are not supported; open the file in Blender and export glTF"),
        ("m.foo", "the file's format and extension \".foo\" are unknown; export pbrt, glTF, OBJ, PLY or STL"),
        ("m.obj.gz", "are compressed; unpack the file first"),
        ("z.pbrt", "compressed by gzip"),
        ("missing.stl", "cannot read missing.stl: no such file; check the name"),
        ("missing.fbx", "cannot read missing.fbx: no such file"),
    ] {
        let message = read_any_from(&given, name, &options).unwrap_err().to_string();
        assert!(message.starts_with(name) && message.contains(what) && message.lines().count() == 1, "{message}");
    }
    let folder = tempfile::tempdir().unwrap();
    for name in ["folder.obj", "folder.ply", "folder.stl", "folder.pbrt"] {
        let path = folder.path().join(name);
        std::fs::create_dir(&path).unwrap();
        assert!(read_any(&path, &options).unwrap_err().to_string().contains("not a regular file"));
    }
}

#[test]
fn wrong_statements_of_materials_are_left_out_and_noted() {
    let mtl = b"newmtl red\nKd 1 0 0\nKs 0.5 0.5 0.5\nd 1\nillum 2\n\
        newmtl\nnewmtl short\nKd 1 2\nmap_Kd -s 2 2 1 brick wall.png\nmap_Kd\n\
        newmtl a b\nKd nan 0 0\nKd 2 -1 0.5\nmap_Kd wood \xff.png\nd 0.5\nillum x\nNs\n";
    let face = |name: &str| format!("usemtl {name}\nf 1 2 3\n");
    let obj = ["mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\n".into(), face("red"), face("short"), face("a b")].concat();
    let scene = read(&[("m.obj", obj.as_bytes()), ("m.mtl", mtl)]).unwrap();
    let colors = [0, 1, 2].map(|shape| reflectance(&scene, shape));
    assert_eq!(colors, [[1.0, 0.0, 0.0], [0.5; 3], [1.0, 0.0, 0.5]].map(Color::Constant));
    let noted: Vec<_> = scene.notices.iter().map(|n| n.source.line).collect();
    assert_eq!(noted, [6, 8, 9, 10, 12, 13, 0, 7, 11]);
    for (notice, what) in [(6, "Ks, d ignored"), (7, "brick wall.png: "), (8, "wood \u{ff}.png: ")] {
        assert!(scene.notices[notice].message.contains(what), "{}", scene.notices[notice].message);
    }
}

#[test]
fn kd_is_read_whole_or_left_out() {
    let read_kd = |mtl: &str| {
        let obj = b"mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\n";
        let scene = read(&[("m.obj", obj), ("m.mtl", mtl.as_bytes())]).unwrap();
        let notices: Vec<(u32, String)> = scene.notices.iter().map(|n| (n.source.line, n.message.clone())).collect();
        (reflectance(&scene, 0), notices)
    };
    for (kd, color) in [
        ("Kd 1 \\\n0.5 0", [1.0, 0.5, 0.0]),
        ("Kd 1 0.5 0 # 1", [1.0, 0.5, 0.0]),
        ("Kd .25 # grey", [0.25; 3]),
        ("Kd 1 0.5 0 1", [1.0, 0.5, 0.0]),
    ] {
        assert_eq!(read_kd(&format!("newmtl m\n{kd}\n")), (Color::Constant(color), vec![]), "{kd}");
    }
    for (kd, color, what) in [
        ("Kd 1 0,5 0", [0.5; 3], "not \"1 0,5 0\"; left out"),
        ("Kd 0.9 x 0.1", [0.5; 3], "not \"0.9 x 0.1\"; left out"),
        ("Kd 255 128 0", [1.0, 1.0, 0.0], "Kd 255 128 0 is outside of 0 to 1"),
        ("Kd -1 0.5 0", [0.0, 0.5, 0.0], "Kd -1 0.5 0 is outside of 0 to 1"),
        ("newmtl\nKd 0 1 0", [0.5; 3], "newmtl has no name"),
        ("newmtl m\nKd 0 1 0", [0.0, 1.0, 0.0], "material \"m\" is defined twice; the last is used"),
    ] {
        let (found, notices) = read_kd(&format!("newmtl m\n{kd}\n"));
        assert_eq!(found, Color::Constant(color), "{kd}");
        assert!(notices.len() == 1 && notices[0].0 == 2 && notices[0].1.contains(what), "{notices:?}");
    }
}

#[test]
fn obj_normals_and_coordinates_that_are_not_finite_are_mended() {
    let obj =
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn nan nan nan\nvn 0 0 1\nvt -nan 0\nvt 0.5 1e99\nvt 1 1\nf 1/1/1 2/2/2 3/3/2\n";
    let scene = read(&[("m.obj", obj.as_bytes())]).unwrap();
    assert_eq!(mesh(&scene, 0).normals, [[0.0; 3], [0.0, 0.0, 1.0], [0.0, 0.0, 1.0]]);
    assert_eq!(mesh(&scene, 0).uvs, [[0.0; 2], [0.0; 2], [1.0; 2]]);
    let found: Vec<(u32, &str)> =
        scene.notices.iter().map(|n| (n.source.line, &n.message["left out: ".len()..][..4])).collect();
    assert_eq!(found, [(4, "\"vn\""), (6, "\"vt\"")]);
}

#[test]
fn an_image_on_a_mesh_without_coordinates_has_a_notice() {
    let mut png = Vec::new();
    let pixel = image::RgbImage::from_raw(1, 1, vec![255, 0, 0]).unwrap();
    pixel.write_to(&mut std::io::Cursor::new(&mut png), image::ImageFormat::Png).unwrap();
    let mtl = b"newmtl m\nKd 1 1 1\nmap_Kd t.png\n";
    let obj = |face: &str| format!("mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl m\n{face}\n");
    let notices = |face: &str| {
        let scene = read(&[("m.obj", obj(face).as_bytes()), ("m.mtl", mtl), ("t.png", &png)]).unwrap();
        scene.notices.into_iter().map(|n| (n.source.line, n.message)).collect::<Vec<_>>()
    };
    let found = notices("f 1 2 3");
    assert!(found.len() == 1 && found[0].0 == 6 && found[0].1.contains("no texture coordinates"), "{found:?}");
    assert_eq!(notices("f 1/1 2/1 3/1"), []);
}
