//! Colours of vertices and facets in OBJ, PLY and STL files.

use dapple_scene::model::{read_obj, read_ply, read_stl};
use dapple_scene::{AnyOptions, Color, Geometry, MaterialKind, MeshData, Scene, TextureKind, read_any_from};
use std::collections::BTreeMap;
use std::path::PathBuf;

fn scene(files: &[(&str, &[u8])]) -> Scene {
    let all: BTreeMap<PathBuf, Vec<u8>> =
        files.iter().map(|(name, bytes)| (PathBuf::from(name), bytes.to_vec())).collect();
    read_any_from(&all, files[0].0, &AnyOptions::default()).unwrap_or_else(|e| panic!("{e}"))
}

fn mesh(scene: &Scene, shape: usize) -> &MeshData {
    let Geometry::Mesh(mesh) = &scene.shapes[shape].geometry else { panic!("a mesh") };
    mesh
}

/// The factors of a shape's reflectance; `None` stands for the vertex colours.
fn factors(scene: &Scene, shape: usize) -> Vec<Option<Color>> {
    let kind = &scene.materials[scene.shapes[shape].material.0 as usize].kind;
    let MaterialKind::Diffuse { reflectance } = kind else { panic!("{kind:?}") };
    let of = |color: &Color| match color {
        Color::Texture(id) if matches!(scene.textures[id.0 as usize].kind, TextureKind::VertexColor) => None,
        other => Some(*other),
    };
    match reflectance {
        Color::Texture(id) => match &scene.textures[id.0 as usize].kind {
            TextureKind::Product { factors } => factors.iter().map(of).collect(),
            _ => vec![of(reflectance)],
        },
        Color::Constant(_) => vec![of(reflectance)],
    }
}

/// The linear value of an sRGB value [IEC 61966-2-1].
fn linear(srgb: f64) -> f32 {
    (if srgb <= 0.040_45 { srgb / 12.92 } else { ((srgb + 0.055) / 1.055).powf(2.4) }) as f32
}

fn assert_colors(found: &[[f32; 3]], expected: &[[f64; 3]], what: &str) {
    assert_eq!(found.len(), expected.len(), "{what}: {found:?}");
    for (found, expected) in found.iter().zip(expected) {
        let close = (0..3).all(|c| (found[c] - linear(expected[c])).abs() < 1e-5);
        assert!(close, "{what}: {found:?} of {expected:?}");
    }
}

const TRIANGLE: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 0.5, 0.0], [0.2, 0.4, 0.6]];

#[test]
fn colours_of_obj_vertices_are_srgb() {
    let plain = "v -1 0 0 1 0 0\nv 1 0 0 0 0.5 0\nv 0 1 0 0.2 0.4 0.6\nf 1 2 3\n";
    assert_colors(&read_obj(plain.as_bytes()).unwrap().meshes[0].data.colors, &TRIANGLE, "0 to 1");
    let bytes = "v -1 0 0 255 0 0 1\nv 1 0 0 0 127.5 0 1\nv 0 1 0 51 102 153 1\nf 1 2 3\n";
    assert_colors(&read_obj(bytes.as_bytes()).unwrap().meshes[0].data.colors, &TRIANGLE, "0 to 255, with an opacity");
    let of_scene = scene(&[("c.obj", plain.as_bytes())]);
    assert_eq!(factors(&of_scene, 0), [None], "no grey in the colours' place");
    assert!(of_scene.notices.is_empty());
}

/// Some vertices have colours: the others of their mesh are white, and meshes without any are as they would be alone.
#[test]
fn obj_meshes_have_colours_if_one_of_their_vertices_has() {
    let text = "mtllib a.mtl\nv 0 0 0\nv 1 0 0 0.5 0.5 0.5\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 0 1 1\n\
        f 1 2 3\nusemtl red\nf 4 5 6\nf 4 2 6\nusemtl blue\nf 4 5 6\n";
    let library = b"newmtl red\nKd 0.5 0 0\nnewmtl blue\nKd 0 0 0.5\n";
    let scene = scene(&[("c.obj", text.as_bytes()), ("a.mtl", library)]);
    assert_colors(&mesh(&scene, 0).colors, &[[1.0; 3], [0.5; 3], [1.0; 3]], "without material");
    assert_eq!(factors(&scene, 0), [None]);
    assert_eq!(factors(&scene, 1), [Some(Color::Constant([0.5, 0.0, 0.0])), None], "Kd times the vertices'");
    assert_eq!(factors(&scene, 2), [Some(Color::Constant([0.0, 0.0, 0.5]))]);
    assert!(mesh(&scene, 2).colors.is_empty());
}

fn ply(colors: &str, rows: &[&str]) -> Vec<u8> {
    let header = format!(
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n{colors}\
         element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    );
    let at = ["-1 0 0", "1 0 0", "0 1 0"];
    let vertices: String = at.iter().zip(rows).map(|(at, color)| format!("{at} {color}\n")).collect();
    format!("{header}{vertices}3 0 1 2\n").into_bytes()
}

#[test]
fn colours_of_ply_vertices_are_srgb_by_their_type() {
    let of =
        |kind: &str, [r, g, b]: [&str; 3]| format!("property {kind} {r}\nproperty {kind} {g}\nproperty {kind} {b}\n");
    let names = ["red", "green", "blue"];
    for (properties, rows) in [
        (of("uchar", names), ["255 0 0", "0 128 0", "51 102 153"]),
        (of("uint8", ["diffuse_red", "diffuse_green", "diffuse_blue"]), ["255 0 0", "0 128 0", "51 102 153"]),
        (of("ushort", names), ["65535 0 0", "0 32896 0", "13107 26214 39321"]),
        (of("float", ["r", "g", "b"]), ["1 0 0", "0 0.50196078 0", "0.2 0.4 0.6"]),
        (of("float", names), ["255 0 0", "0 128 0", "51 102 153"]),
        (of("uchar", names) + "property uchar alpha\n", ["255 0 0 255", "0 128 0 255", "51 102 153 255"]),
    ] {
        let mesh = read_ply(&ply(&properties, &rows)).unwrap();
        let expected = [[1.0, 0.0, 0.0], [0.0, 128.0 / 255.0, 0.0], [0.2, 0.4, 0.6]];
        assert_colors(&mesh.data.colors, &expected, &properties);
        assert!(mesh.left_out.is_empty(), "{:?}", mesh.left_out);
    }
    let clear = of("uchar", names) + "property uchar alpha\n";
    let mesh = read_ply(&ply(&clear, &["255 0 0 255", "0 128 0 9", "51 102 153 255"])).unwrap();
    assert_eq!(mesh.left_out, ["property alpha of vertex"]);
    let scene = scene(&[("c.ply", &ply(&of("uchar", names), &["255 0 0", "0 128 0", "51 102 153"]))]);
    assert_eq!(factors(&scene, 0), [None]);
}

/// A square of two faces, each with its colour: the vertices that they share are doubled.
#[test]
fn colours_of_ply_faces_are_shown_where_vertices_have_none() {
    let text = |of_vertices: &str, rest: &str| {
        format!(
            "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n{of_vertices}\
             element face 2\nproperty list uchar int vertex_indices\nproperty uchar red\nproperty uchar green\n\
             property uchar blue\nend_header\n{rest}3 0 1 2 255 0 0\n3 0 2 3 0 0 255\n"
        )
    };
    let plain = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n";
    let mesh = read_ply(text("", plain).as_bytes()).unwrap();
    assert_eq!((mesh.data.positions.len(), mesh.data.triangles.len()), (6, 2));
    for (triangle, expected) in mesh.data.triangles.iter().zip([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]) {
        assert!(triangle.iter().all(|v| mesh.data.colors[*v as usize] == expected), "{:?}", mesh.data);
    }
    assert!(mesh.data.check().is_ok() && mesh.left_out.is_empty());
    let own = "property uchar red\nproperty uchar green\nproperty uchar blue\n";
    let mesh = read_ply(text(own, &plain.replace('\n', " 0 255 0\n")).as_bytes()).unwrap();
    assert!(mesh.data.colors.iter().all(|rgb| *rgb == [0.0, 1.0, 0.0]));
    assert_eq!(mesh.left_out, ["colours of faces, since vertices have their own"]);
}

/// A binary STL file of two facets with these attributes.
fn stl(header: &[u8], attributes: [u16; 2]) -> Vec<u8> {
    let mut bytes = [header, &vec![b' '; 80 - header.len()], &2u32.to_le_bytes()].concat();
    for (facet, attribute) in attributes.into_iter().enumerate() {
        let corners = [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, facet as f32]];
        bytes.extend([[0.0f32; 3]].iter().chain(&corners).flatten().flat_map(|c| c.to_le_bytes()));
        bytes.extend(attribute.to_le_bytes());
    }
    bytes
}

#[test]
fn colours_of_stl_facets_follow_viscam_or_magics() {
    const SET: u16 = 1 << 15;
    let (red, blue) = ([1.0, 0.0, 0.0], [0.0, 0.0, 1.0]);
    let body = [51.0 / 255.0, 102.0 / 255.0, 153.0 / 255.0];
    let magics = b"COLOR=\x33\x66\x99\xff";
    let grey = [0.735_356_98; 3];
    for (header, attributes, expected) in [
        (&b"viscam"[..], [SET | 31 << 10, SET | 31], [red, blue]),
        (b"viscam", [SET | 16 << 5, 0], [[0.0, 16.0 / 31.0, 0.0], grey]),
        (magics, [31, 31 << 10], [red, blue]),
        (magics, [31, SET], [red, body]),
        (magics, [0, 0], [body, body]),
    ] {
        let mesh = read_stl(&stl(header, attributes)).unwrap();
        let of = |facet: usize| mesh.data.triangles[facet].map(|v| mesh.data.colors[v as usize]);
        for (facet, expected) in expected.into_iter().enumerate() {
            assert_colors(&of(facet), &[expected; 3], &format!("facet {facet} of {attributes:?}"));
        }
        assert!(mesh.left_out.is_empty(), "{:?}", mesh.left_out);
    }
    let plain = read_stl(&stl(b"", [0, 0])).unwrap();
    assert!(plain.data.colors.is_empty() && plain.data.positions.len() == 4 && plain.left_out.is_empty());
    let scene = scene(&[("c.stl", &stl(b"viscam", [SET | 31, SET | 31]))]);
    assert_eq!((factors(&scene, 0), mesh(&scene, 0).positions.len()), (vec![None], 4), "one colour doubles no vertex");
}

/// A colour that is no number loses itself alone: its vertex is white, with a warning.
#[test]
fn colours_that_are_not_finite_are_white() {
    let model = scene(&[("c.obj", b"v -1 0 0 1 0 0\nv 1 0 0 nan 0 0\nv 0 1 0 a b c\nf 1 2 3\n")]);
    assert_colors(&mesh(&model, 0).colors, &[[1.0, 0.0, 0.0], [1.0; 3], [1.0; 3]], "OBJ");
    let said: Vec<&str> = model.notices.iter().map(|notice| notice.message.as_str()).collect();
    assert_eq!(said, ["left out: \"v\" has a colour that is not three finite numbers"]);
    let colors = "property float red\nproperty float green\nproperty float blue\n";
    let found = read_ply(&ply(colors, &["1 0 0", "inf 0 0", "0 nan 0"])).unwrap();
    assert_colors(&found.data.colors, &[[1.0, 0.0, 0.0], [1.0; 3], [1.0; 3]], "PLY");
    assert_eq!(found.doubt.unwrap(), "2 colours are not finite; white is used instead");
}

#[test]
fn a_colour_just_above_1_is_clamped_and_leaves_the_others() {
    let expected = [[0.9, 0.2, 0.1], [1.0, 0.2, 0.1], [0.9, 0.2, 0.1]];
    for above in ["1.0000002", "1.05", "2", "100"] {
        let obj = format!("v -1 0 0 .9 .2 .1\nv 1 0 0 {above} .2 .1\nv 0 1 0 .9 .2 .1\nf 1 2 3\n");
        let found = scene(&[("c.obj", obj.as_bytes())]);
        assert_colors(&mesh(&found, 0).colors, &expected, above);
        assert_eq!(found.notices.len(), 1);
        assert_eq!(found.notices[0].message, "1 colour values are outside of 0 to 1 and are clamped");
        let head = "property float x\nproperty float y\nproperty float z\nproperty float red\nproperty float green\nproperty float blue";
        let face = "element face 1\nproperty list uchar int vertex_indices\nend_header";
        let rows = format!("0 0 0 .9 .2 .1\n1 0 0 {above} .2 .1\n0 1 0 .9 .2 .1\n3 0 1 2\n");
        let ply = format!("ply\nformat ascii 1.0\nelement vertex 3\n{head}\n{face}\n{rows}");
        let read = read_ply(ply.as_bytes()).unwrap();
        assert_colors(&read.data.colors, &expected, above);
        assert_eq!(read.doubt.unwrap(), found.notices[0].message);
    }
}

#[test]
fn whole_colours_of_bytes_may_be_written_as_floats() {
    let head = "property float x\nproperty float y\nproperty float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue";
    let face = "element face 1\nproperty list uchar int vertex_indices\nend_header";
    let ply = |red: &str| {
        let rows = format!("0 0 0 {red} 51.0 102\n1 0 0 {red} 51 102\n0 1 0 {red} 51 102\n3 0 1 2\n");
        read_ply(format!("ply\nformat ascii 1.0\nelement vertex 3\n{head}\n{face}\n{rows}").as_bytes())
    };
    assert_colors(&ply("255.0").unwrap().data.colors, &[[1.0, 0.2, 0.4]; 3], "255.0");
    for wrong in ["230.5", "256.0", "-1.0", "nan"] {
        assert!(ply(wrong).is_err(), "{wrong}");
    }
}

#[test]
fn a_vertex_with_other_numbers_than_a_colour_has_a_notice() {
    for numbers in ["0.9 0.2", "0.9 0.2 0.1 1 5"] {
        let obj = format!("v -1 0 0 {numbers}\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
        let found = scene(&[("c.obj", obj.as_bytes())]);
        assert!(mesh(&found, 0).colors.is_empty());
        assert!(found.notices[0].message.contains("must have 3, 4, 6 or 7 numbers"), "{:?}", found.notices);
        assert_eq!((found.notices.len(), found.notices[0].source.line), (1, 1));
    }
}
