//! The plain files of the corpus, with their right values, and its files that are not text.

use super::{Base, Case, Form};

/// The form of files that a main file names.
pub(super) const SIDE: Form = OBJ;
const OBJ: Form = Form { comment: Some(("#", 1)), comments_follow: true, free: false, whole: false };
const PLY: Form = Form { comment: Some(("comment", 2)), comments_follow: false, free: false, whole: true };
const STL: Form = Form { comment: None, comments_follow: false, free: true, whole: false };
const PBRT: Form = Form { comment: Some(("#", 0)), comments_follow: false, free: true, whole: true };

const RED: &str = "1 triangle, area 0.5, colour 1 0 0";
const GREY: &str = "1 triangle, area 0.5, colour 0.5 0.5 0.5";
const TWO: &str = "2 triangles, area 1, colour 0.5 0.5 0.5";

/// Every base.
pub(super) fn all() -> Vec<Base> {
    let mut bases = Vec::new();
    let mut add = |target, right, form, texts: &[(&'static str, &str)]| {
        let texts = texts.iter().map(|(name, text)| (*name, (*text).to_owned())).collect();
        bases.push(Base { target, right, texts, bytes: Vec::new(), form });
    };
    const CORNERS: &str = "v 0 0 0\nv 1 0 0\nv 0 0 1\n";
    let obj = |before: &str, after: &str| format!("{before}\n{CORNERS}{after}");
    add("obj", GREY, OBJ, &[("m.obj", &obj("o caf\u{e9}", "f 1 ^2 ^3"))]);
    add("obj", GREY, OBJ, &[("m.obj", &obj("g caf\u{e9}", "vt 0 0\nvn 0 1 0\nf 1/1/1 2/1/1 3/1/1"))]);
    add("obj", RED, OBJ, &[("m.obj", &obj("mtllib m.mtl", "usemtl red\nf 1 2 3")), ("m.mtl", "newmtl red\nKd 1 0 0")]);
    add(
        "obj",
        RED,
        OBJ,
        &[
            ("m.obj", &obj("mtllib my~caf\u{e9}.mtl", "usemtl brick~\u{e9}\nf 1 2 3")),
            ("my caf\u{e9}.mtl", "newmtl brick~\u{e9}\nKd 1 0 0"),
        ],
    );
    add(
        "obj",
        RED,
        OBJ,
        &[
            ("m.obj", &obj("mtllib \"my~a.mtl\" b.mtl", "usemtl \"brick~\u{e9}\"\nf 1 2 3")),
            ("my a.mtl", "newmtl other\nKd 0 1 0"),
            ("b.mtl", "newmtl brick~\u{e9}\nKd 1 0 0"),
        ],
    );
    add(
        "obj",
        TWO,
        OBJ,
        &[
            ("m.obj", "mtllib a.mtl my~b.mtl\nv 0 0 0\nv 1 0 0\nv 1 0 1\nv 0 0 1\nusemtl grey\nf -4 -3 -2 -1"),
            ("a.mtl", "newmtl a\nKd 0 1 0"),
            ("my b.mtl", "newmtl grey\nKd 0.5"),
        ],
    );
    for rows in [
        "0 0 0\n1 0 0\n0 0 1\n3 0 1 2",
        "0 0 0 1 0 0 0 0 1 3 0 1 2",
        "0\n0\n0\n1\n0 0\n0 0\n1 3\n0\n1\n2",
        "0 0 0\n1 0 0\n0 0 1 3\n0 1 2",
    ] {
        add("ply", GREY, PLY, &[("m.ply", &format!("{}{rows}", ply_header("ascii")))]);
    }
    let facet = "facet normal 0 1 0\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 0 1\nendloop\nendfacet";
    let solid = |facets: &str| format!("solid~caf\u{e9}\n{facets}\nendsolid~caf\u{e9}");
    for text in [
        solid(facet),
        solid(&facet.replace("0 1 0", "nan nan -nan(ind)")),
        solid(&facet.replace("0 1 0", "-1.#IND00 1.#QNAN inf")),
        solid(&facet.replace("facet normal 0 1 0", "facet normal")),
        solid(&facet.replace("end", "end ")).replace("endsolid", "end~solid"),
    ] {
        add("stl", GREY, STL, &[("m.stl", &text)]);
    }
    let corners = "vertex 1 0 0\nvertex 1 0 1\nvertex 0 0 1";
    let other = facet.replace("vertex 0 0 0\nvertex 1 0 0\nvertex 0 0 1", corners);
    add("stl", TWO, STL, &[("m.stl", &format!("{}\n{}", solid(facet), solid(&other).to_uppercase()))]);
    for scenes in ["\"scene\": 0, \"scenes\": [{ \"nodes\": [0] }],", "\"scenes\": [{}, { \"nodes\": [0] }],", ""] {
        let right = if scenes.contains("{}") { "1 triangle, area 0.5, 1 notice" } else { "1 triangle, area 0.5" };
        add("gltf", right, STL, &[("m.gltf", &gltf(scenes))]);
    }
    let shape = "Shape \"trianglemesh\" \"point3~P\" [ 0 0 0 1 0 0 0 0 1 ] \"integer~indices\" [ 0 1 2 ]";
    let red = "MakeNamedMaterial \"\u{e9}\" \"string~type\" \"diffuse\" \"rgb~reflectance\" [ 1 0 0 ]\nNamedMaterial \"\u{e9}\"";
    let head = "Film \"rgb\" \"integer~xresolution\" 8\nCamera \"perspective\"\nWorldBegin\nLightSource \"infinite\"";
    add("scene", GREY, PBRT, &[("scene.pbrt", &format!("{head}\n{shape}"))]);
    add("scene", RED, PBRT, &[("scene.pbrt", &format!("{head}\n{red}\n{shape}"))]);
    add(
        "scene",
        RED,
        PBRT,
        &[("scene.pbrt", &format!("{head}\n{red}\nInclude \"i.pbrt\"")), ("i.pbrt", &format!("{shape}\n\n"))],
    );
    bases.extend(ply_binary());
    bases
}

fn ply_header(format: &str) -> String {
    let number = |name: &str| format!("property float {name}\n");
    let numbers = ["x", "y", "z"].map(number).concat();
    let faces = "element face 1\nproperty list uchar int vertex_indices\nend_header\n";
    format!("ply\nformat {format} 1.0\nelement vertex 3\n{numbers}{faces}")
}

const POSITIONS: [f32; 9] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];

/// Headers before rows in binary.
fn ply_binary() -> Vec<Base> {
    let rows = |number: fn(f32) -> [u8; 4], index: fn(i32) -> [u8; 4]| {
        let corners = [0, 1, 2].into_iter().flat_map(index);
        POSITIONS.into_iter().flat_map(number).chain([3]).chain(corners).collect()
    };
    let base = |format, bytes| {
        let texts = vec![("m.ply", ply_header(format))];
        Base { target: "ply", right: GREY, texts, bytes, form: PLY }
    };
    vec![
        base("binary_little_endian", rows(f32::to_le_bytes, i32::to_le_bytes)),
        base("binary_big_endian", rows(f32::to_be_bytes, i32::to_be_bytes)),
    ]
}

fn gltf(scenes: &str) -> String {
    let buffer = "data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAAAAAAIA/";
    [
        "{ \"asset\": { \"version\": \"2.0\", \"generator\": \"caf\u{e9}\" },",
        scenes,
        "\"nodes\": [{ \"mesh\": 0, \"name\": \"my~caf\u{e9}\" }],",
        "\"meshes\": [{ \"primitives\": [{ \"attributes\": { \"POSITION\": 0 } }] }],",
        "\"accessors\": [{ \"bufferView\": 0, \"componentType\": 5126, \"count\": 3, \"type\": \"VEC3\" }],",
        "\"bufferViews\": [{ \"buffer\": 0, \"byteLength\": 36 }],",
        &format!("\"buffers\": [{{ \"byteLength\": 36, \"uri\": \"{buffer}\" }}] }}"),
    ]
    .join("\n")
}

/// Every format in UTF-16, of either byte order, with a mark and without.
pub(super) fn wide() -> Vec<Case> {
    let first: Vec<Base> = all();
    let one = |target| first.iter().find(|base| base.target == target);
    let bases = ["obj", "ply", "stl", "gltf", "scene"].into_iter().filter_map(one);
    let wide = |base: &Base, little: bool, mark: bool| {
        let (name, text) = &base.texts[0];
        let text = text.replace('~', " ").replace('^', "");
        let units = mark.then_some(0xfeff).into_iter().chain(text.encode_utf16());
        let bytes = units.flat_map(|unit| if little { unit.to_le_bytes() } else { unit.to_be_bytes() }).collect();
        let case = format!("{}-utf-16-{little}-{mark}", base.target);
        Case { target: base.target, name: case, files: vec![((*name).to_owned(), bytes)], right: "UTF-16" }
    };
    let kinds = [[false, false], [false, true], [true, false], [true, true]];
    bases.flat_map(|base| kinds.map(|[little, mark]| wide(base, little, mark))).collect()
}

/// Files that are not text: STL, GLB, and Radiance images in the eight orders of their pixels.
pub(super) fn binary() -> Vec<Case> {
    let case = |target, name: &str, file: &str, bytes, right| Case {
        target,
        name: name.to_owned(),
        files: vec![(file.to_owned(), bytes)],
        right,
    };
    let mut cases = Vec::new();
    for (name, header, normal) in
        [("zeros", "", 0.0), ("solid", "solid caf\u{e9} facet normal", 1.0), ("no-normal", "solid", f32::NAN)]
    {
        let mut bytes: Vec<u8> = header.chars().map(|c| c as u8).collect();
        bytes.resize(80, if header.is_empty() { 0 } else { b' ' });
        bytes.extend([1, 0, 0, 0]);
        bytes.extend([normal; 3].into_iter().chain(POSITIONS).flat_map(f32::to_le_bytes));
        bytes.extend([0, 0]);
        cases.push(case("stl", &format!("stl-{name}"), "m.stl", bytes, GREY));
    }
    for (name, mark, padding) in [("blanks", "", b' '), ("zeros", "", 0), ("mark", "\u{feff}", b' ')] {
        let mut text = [mark, &gltf("\"scenes\": [{ \"nodes\": [0] }],")].concat().replace('~', " ").into_bytes();
        text.resize(text.len().next_multiple_of(4), padding);
        let numbers = [2, 20 + text.len() as u32, text.len() as u32].map(u32::to_le_bytes);
        let bytes = [b"glTF", numbers.as_flattened(), b"JSON", &text].concat();
        cases.push(case("gltf", &format!("gltf-{name}"), "m.glb", bytes, "1 triangle, area 0.5"));
    }
    cases.extend(radiance().map(|(name, bytes)| case("image", &name, "a.hdr", bytes, "2x8 pixels in order")));
    cases
}

/// Images 2 wide and 8 high, whose red counts pixels row by row from the top, plain and compressed by run length.
fn radiance() -> impl Iterator<Item = (String, Vec<u8>)> {
    ["-Y +X", "-Y -X", "+Y +X", "+Y -X", "+X -Y", "-X -Y", "+X +Y", "-X +Y"].into_iter().map(|order| {
        let sequence = |axis: &str, count: u8| -> Vec<u8> {
            let forth = order.contains(&format!("+{axis}")) == (axis == "X");
            if forth { (0..count).collect() } else { (0..count).rev().collect() }
        };
        let (xs, ys) = (sequence("X", 2), sequence("Y", 8));
        let by_rows = order[1..].starts_with('Y');
        let red = |x: u8, y: u8| 16 + 2 * y + x;
        let (first, second) = order.split_once(' ').unwrap_or_default();
        let (counts, scanlines): (_, Vec<Vec<u8>>) = if by_rows {
            ("8 2", ys.iter().map(|&y| xs.iter().map(|&x| red(x, y)).collect()).collect())
        } else {
            ("2 8", xs.iter().map(|&x| ys.iter().map(|&y| red(x, y)).collect()).collect())
        };
        let (n, m) = counts.split_once(' ').unwrap_or_default();
        let mut bytes = format!("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n{first} {n} {second} {m}\n").into_bytes();
        for scanline in scanlines {
            if scanline.len() < 8 {
                bytes.extend(scanline.into_iter().flat_map(|red| [red, 1, 1, 136]));
            } else {
                // Planes of red, green, blue and exponent: eight values as they stand, or a run of eight.
                bytes.extend([2, 2, 0, 8, 8]);
                bytes.extend(scanline);
                bytes.extend([136, 1, 136, 1, 136, 136]);
            }
        }
        (format!("image-{order}").replace(' ', ""), bytes)
    })
}
