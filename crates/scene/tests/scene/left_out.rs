//! Every feature of the formats' specifications that is known and not read is named: by a warning, or by an error. The
//! tables below are the list of these features.

use crate::gltf::{bare, notices, with_material};
use dapple_scene::pbrt::ReadOptions;
use dapple_scene::{AnyOptions, Scene, read_any_from};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::PathBuf;

fn read(files: &[(&str, Vec<u8>)], options: &AnyOptions) -> Result<Scene, String> {
    let all: BTreeMap<PathBuf, Vec<u8>> = files.iter().cloned().map(|(name, bytes)| (name.into(), bytes)).collect();
    read_any_from(&all, files[0].0, options).map_err(|e| e.to_string())
}

/// Asserts that one warning, of the first file or of one of these lines, contains a text, and that the file without the
/// feature has no warning of it.
fn assert_named(what: &str, with: &Scene, line: u32, without: &Scene) {
    let count = |scene: &Scene| scene.notices.iter().filter(|notice| notice.message.contains(what)).count();
    assert_eq!(count(with), 1, "{what}: {:?}", notices(with));
    assert_eq!(count(without), 0, "{what} without the feature: {:?}", notices(without));
    let found = with.notices.iter().find(|notice| notice.message.contains(what)).expect("counted above");
    assert_eq!(found.source.line, line, "{found:?}");
    assert!(!found.source.file.as_os_str().is_empty());
}

/// Statements of OBJ, and of programs that extend it, and what their warning contains.
const OBJ: [(&str, &str); 50] = [
    ("l 1 2", "\"l\" is not a surface"),
    ("p 1", "\"p\" is not a surface"),
    ("vp 0.5 0.5", "\"vp\" belongs to curves"),
    ("cstype bspline", "\"cstype\" belongs to curves"),
    ("deg 3 3", "\"deg\" belongs to curves"),
    ("bmat u 1 0 0 1", "\"bmat\" belongs to curves"),
    ("step 1 1", "\"step\" belongs to curves"),
    ("curv 0 1 1 2", "\"curv\" belongs to curves"),
    ("curv2 1 2", "\"curv2\" belongs to curves"),
    ("surf 0 1 0 1 1 2 3", "\"surf\" belongs to curves"),
    ("parm u 0 1", "\"parm\" belongs to curves"),
    ("trim 0 1 1", "\"trim\" belongs to curves"),
    ("hole 0 1 1", "\"hole\" belongs to curves"),
    ("scrv 0 1 1", "\"scrv\" belongs to curves"),
    ("sp 1", "\"sp\" belongs to curves"),
    ("end", "\"end\" belongs to curves"),
    ("con 1 0 1 1 2 0 1 1", "\"con\" belongs to curves"),
    ("mg 1 0.5", "\"mg\" belongs to curves"),
    ("ctech cparm 1", "\"ctech\" belongs to curves"),
    ("stech cparma 1 1", "\"stech\" belongs to curves"),
    ("bsp 1 2 3", "\"bsp\" belongs to curves"),
    ("bzp 1 2 3", "\"bzp\" belongs to curves"),
    ("cdc 1 2 3", "\"cdc\" belongs to curves"),
    ("cdp 1 2 3", "\"cdp\" belongs to curves"),
    ("res 2 2", "\"res\" belongs to curves"),
    ("call other.obj", "\"call\" runs other files"),
    ("csh echo", "\"csh\" runs other files"),
    ("maplib a.map", "\"maplib\" is a texture outside"),
    ("usemap brick", "\"usemap\" is a texture outside"),
    ("bevel on", "\"bevel\" controls how other renderers"),
    ("c_interp on", "\"c_interp\" controls how other renderers"),
    ("d_interp on", "\"d_interp\" controls how other renderers"),
    ("lod 5", "\"lod\" controls how other renderers"),
    ("shadow_obj a.obj", "\"shadow_obj\" controls how other renderers"),
    ("trace_obj a.obj", "\"trace_obj\" controls how other renderers"),
    ("#MRGB ff808080", "colours in ZBrush's own form"),
    ("weather rainy", "\"weather\" is unknown"),
    ("v 0 0 0 0.5", "has a weight"),
    ("s 1\nf 1 2 3", "smooths faces without normals"),
    ("mtllib missing.mtl", "missing.mtl cannot be read"),
    ("usemtl unknown\nf 1 2 3", "unknown material \"unknown\""),
    ("mtllib Ks.mtl", "Ks ignored"),
    ("mtllib Ke.mtl", "Ke ignored"),
    ("mtllib Tf.mtl", "Tf ignored"),
    ("mtllib d.mtl", "d ignored"),
    ("mtllib Tr.mtl", "Tr ignored"),
    ("mtllib illum.mtl", "illum ignored"),
    ("mtllib map_Ke.mtl", "map_Ke ignored"),
    ("mtllib pbr.mtl", "Pc, Pm, Pr, Ps, aniso ignored"),
    ("mtllib maps.mtl", "bump, decal, disp, map_Bump, map_Ks, map_Pr, map_d, norm, refl ignored"),
];

/// Material files of [`OBJ`].
const MTL: [(&str, &str); 9] = [
    ("Ks.mtl", "newmtl a\nKs 0.5 0.5 0.5\n"),
    ("Ke.mtl", "newmtl a\nKe 1 1 1\n"),
    ("Tf.mtl", "newmtl a\nTf 0.5 1 1\n"),
    ("d.mtl", "newmtl a\nd 0.5\n"),
    ("Tr.mtl", "newmtl a\nTr 0.5\n"),
    ("illum.mtl", "newmtl a\nillum 5\n"),
    ("map_Ke.mtl", "newmtl a\nmap_Ke a.png\n"),
    ("pbr.mtl", "newmtl a\nPr 0.5\nPm 1\nPs 1\nPc 1\naniso 0.5\n"),
    (
        "maps.mtl",
        "newmtl a\nbump a.png\ndecal a.png\ndisp a.png\nmap_Bump a.png\nmap_Ks a.png\nmap_Pr a.png\nmap_d a.png\n\
         norm a.png\nrefl a.png\n",
    ),
];

#[test]
fn statements_of_obj_and_mtl_that_are_left_out_are_named() {
    let base = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    let files = |text: &str| {
        let mut files = vec![("m.obj", format!("{base}{text}\n").into_bytes())];
        files.extend(MTL.map(|(name, text)| (name, text.as_bytes().to_vec())));
        read(&files, &AnyOptions::default()).unwrap_or_else(|e| panic!("{text}: {e}"))
    };
    let plain = files("o a\ng b\ns off\n# comment");
    assert!(plain.notices.is_empty(), "{:?}", notices(&plain));
    for (statement, what) in OBJ {
        // A material file is named as a whole.
        let line = match statement {
            _ if what.ends_with("ignored") => 0,
            _ if statement.starts_with("s 1") => 6,
            _ => 5,
        };
        assert_named(what, &files(statement), line, &plain);
    }
}

/// Features of glTF 2.0 and its extensions [Khronos 2021], as values put at places of a file, and what their warning
/// contains.
fn gltf_features() -> Vec<(Vec<(&'static str, Value)>, &'static str)> {
    let material = |value: Value| vec![("/materials/0", value)];
    let texture = || json!({"index": 0});
    let with = |name: &str, value: Value| json!({"extensions": {name: value}});
    let mut features = vec![
        (vec![("/animations", json!([{"channels": [], "samplers": []}]))], "animations are left out (1)"),
        (vec![("/scenes", json!([{"nodes": [0]}, {"name": "b", "nodes": [0]}]))], "left out: scene 1 \"b\""),
        (vec![("/meshes/0/primitives/1", json!({"attributes": {"POSITION": 0}, "mode": 0}))], "points or lines"),
        (vec![("/meshes/0/primitives/1", json!({"attributes": {"POSITION": 0}, "mode": 1}))], "points or lines"),
        (
            vec![
                (
                    "/cameras",
                    json!([{"type": "orthographic", "orthographic": {"xmag": 1, "ymag": 1, "znear": 0, "zfar": 9}}, {"type": "orthographic", "orthographic": {"xmag": 1, "ymag": 1, "znear": 0, "zfar": 9}}]),
                ),
                ("/nodes", json!([{"mesh": 0, "children": [1, 2]}, {"camera": 0}, {"camera": 1}])),
            ],
            "left out: camera 1",
        ),
        (material(json!({"occlusionTexture": texture()})), "occlusion texture is left out"),
        (material(json!({"emissiveFactor": [1, 1, 1], "alphaMode": "BLEND"})), "its opacity is left out"),
        (
            material(json!({"normalTexture": texture(), "emissiveTexture": {"index": 0, "texCoord": 1}})),
            "set 1 is used for all",
        ),
        (
            vec![
                ("/materials/0", json!({"normalTexture": texture()})),
                ("/accessors/4", json!({"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC4"})),
                ("/meshes/0/primitives/0/attributes/TANGENT", json!(4)),
            ],
            "its tangents are left out",
        ),
        (
            vec![
                ("/materials/0", json!({"pbrMetallicRoughness": {"baseColorTexture": texture()}})),
                ("/samplers", json!([{"magFilter": 9728}])),
                ("/textures/0/sampler", json!(0)),
            ],
            "not the nearest ones as in the file",
        ),
        (
            vec![
                ("/materials/0", json!({"pbrMetallicRoughness": {"baseColorTexture": texture()}})),
                ("/samplers", json!([{"wrapS": 33648, "wrapT": 33648}])),
                ("/textures/0/sampler", json!(0)),
            ],
            "repeats without the mirroring",
        ),
        (
            vec![
                ("/materials/0", json!({"pbrMetallicRoughness": {"baseColorTexture": texture()}})),
                ("/samplers", json!([{"wrapS": 33071, "wrapT": 10497}])),
                ("/textures/0/sampler", json!(0)),
            ],
            "both use that of u",
        ),
        (
            vec![
                ("/materials/0", json!({"pbrMetallicRoughness": {"baseColorTexture": texture()}})),
                ("/images/0/uri", json!("missing.png")),
            ],
            "image 0 cannot be read",
        ),
        (
            material(json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "extensions":
                {"KHR_texture_transform": {"rotation": 1}}}}})),
            "rotation of its coordinates is left out",
        ),
        (material(with("KHR_materials_ior", json!({"ior": 0}))), "index of refraction 0 is invalid"),
        (
            material(with("KHR_materials_specular", json!({"specularTexture": texture()}))),
            "textures of its specular reflection are left out",
        ),
        (
            material(with("KHR_materials_clearcoat", json!({"clearcoatFactor": 1, "clearcoatTexture": texture()}))),
            "textures of its clear coat are left out",
        ),
        (
            material(with("KHR_materials_volume", json!({"thicknessFactor": 1, "thicknessTexture": texture()}))),
            "its thickness texture is left out",
        ),
        (
            vec![
                ("/extensionsUsed", json!(["KHR_lights_punctual"])),
                ("/extensions", json!({"KHR_lights_punctual": {"lights": [{"type": "point", "range": 3}]}})),
                ("/nodes/0/extensions", json!({"KHR_lights_punctual": {"light": 0}})),
            ],
            "light 0: its range is left out",
        ),
        (
            vec![
                ("/extensionsUsed", json!(["KHR_lights_punctual"])),
                ("/extensions", json!({"KHR_lights_punctual": {"lights": [{"type": "point", "intensity": 0}]}})),
                ("/nodes/0/extensions", json!({"KHR_lights_punctual": {"light": 0}})),
            ],
            "light 0 has no intensity or no direction",
        ),
        (
            vec![("/nodes", json!([{"mesh": 0, "scale": [0, 1, 1]}, {"mesh": 0}])), ("/scenes/0/nodes", json!([0, 1]))],
            "node 0 has no extent",
        ),
    ];
    // Extensions by name: all that Khronos has ratified and vendors' common ones.
    for name in [
        "KHR_animation_pointer",
        "KHR_materials_anisotropy",
        "KHR_materials_diffuse_transmission",
        "KHR_materials_dispersion",
        "KHR_materials_iridescence",
        "KHR_materials_sheen",
        "KHR_materials_variants",
        "KHR_node_visibility",
        "KHR_xmp",
        "EXT_lights_ies",
        "EXT_lights_image_based",
        "EXT_mesh_gpu_instancing",
        "EXT_texture_webp",
        "MSFT_lod",
        "MSFT_texture_dds",
        "KHR_texture_basisu",
        "KHR_draco_mesh_compression",
        "EXT_meshopt_compression",
    ] {
        features.push((vec![("/extensionsUsed", json!([name]))], name));
    }
    features
}

/// Puts a value at a place of a document, and makes the objects and the end of a list on the way.
fn put(document: &mut Value, place: &str, value: Value) {
    let mut at = document;
    for key in place.split('/').skip(1) {
        at = match (key.parse::<usize>(), at) {
            (Ok(index), Value::Array(list)) => {
                if index == list.len() {
                    list.push(Value::Null);
                }
                &mut list[index]
            }
            (_, other) => &mut other[key],
        };
    }
    *at = value;
}

#[test]
fn features_of_gltf_that_are_left_out_are_named() {
    let read_one = |document: &Value| {
        let files = [("m.gltf", document.to_string().into_bytes()), ("texture.png", crate::gltf::png())];
        read(&files, &AnyOptions::default())
    };
    let plain = read_one(&with_material(json!({}))).unwrap();
    assert!(plain.notices.is_empty(), "{:?}", notices(&plain));
    for (changes, what) in gltf_features() {
        let mut document = with_material(json!({}));
        for (place, value) in changes {
            put(&mut document, place, value);
        }
        let scene = read_one(&document).unwrap_or_else(|e| panic!("{what}: {e}"));
        assert_named(what, &scene, 0, &plain);
    }
    // What a file requires and compresses is an error.
    for name in ["KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_texture_basisu", "EXT_texture_webp"] {
        let mut document = bare();
        document["extensionsRequired"] = json!([name]);
        document["extensionsUsed"] = json!([name]);
        assert!(read_one(&document).unwrap_err().contains(name), "{name}");
    }
}

#[test]
fn properties_of_ply_that_are_left_out_are_named() {
    let file = |comment: &str, of_vertex: &str, of_face: &str, element: &str| {
        let own = |text: &str| if text.is_empty() { "" } else { " 1" };
        let list = if of_face.contains("list") { " 2 1 1" } else { own(of_face) };
        let header = format!(
            "ply\nformat ascii 1.0\n{comment}element vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
             {of_vertex}element face 1\nproperty list uchar int vertex_indices\n{of_face}{element}end_header\n"
        );
        let vertices: String = ["0 0 0", "1 0 0", "0 1 0"].map(|at| format!("{at}{}\n", own(of_vertex))).concat();
        let last = if element.is_empty() { "" } else { "1\n" };
        let bytes = format!("{header}{vertices}3 0 1 2{list}\n{last}").into_bytes();
        read(&[("m.ply", bytes)], &AnyOptions::default()).unwrap_or_else(|e| panic!("{e}"))
    };
    let plain = file("comment made by hand\n", "", "", "");
    assert!(plain.notices.is_empty(), "{:?}", notices(&plain));
    for name in ["confidence", "intensity", "quality", "curvature", "material_index", "flags", "radius", "scalar_Class"]
    {
        let found = file("", &format!("property float {name}\n"), "", "");
        assert_named(&format!("left out: property {name} of vertex"), &found, 0, &plain);
        let found = file("", "", &format!("property int {name}\n"), "");
        assert_named(&format!("left out: property {name} of face"), &found, 0, &plain);
    }
    for name in ["texcoord", "texnumber", "vertex_colors"] {
        let found = file("", "", &format!("property list uchar float {name}\n"), "");
        assert_named(&format!("left out: property {name} of face"), &found, 0, &plain);
    }
    for name in ["edge", "material", "camera", "range_grid", "multi_texture_face"] {
        let found = file("", "", "", &format!("element {name} 1\nproperty int a\n"));
        assert_named(&format!("left out: element {name}"), &found, 0, &plain);
    }
    let found = file("comment TextureFile a b.png\n", "property float quality\n", "", "");
    assert_named("left out: texture file a b.png, property quality of vertex", &found, 0, &plain);
}

#[test]
fn bytes_of_stl_that_are_left_out_are_named() {
    let file = |header: &[u8], attribute: u16, more: &[u8]| {
        let mut bytes = [header, &vec![b' '; 80 - header.len()], &1u32.to_le_bytes(), &[0; 12]].concat();
        bytes.extend([0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0].iter().flat_map(|c| c.to_le_bytes()));
        bytes.extend(attribute.to_le_bytes());
        bytes.extend(more);
        read(&[("m.stl", bytes)], &AnyOptions::default()).unwrap_or_else(|e| panic!("{e}"))
    };
    let plain = file(b"made by hand", 0, b"");
    assert!(plain.notices.is_empty(), "{:?}", notices(&plain));
    let material = [b"COLOR=\x33\x66\x99\xff,MATERIAL=".as_slice(), &[0x40; 12]].concat();
    for (found, what) in [
        (file(b"", 7, b""), "left out: attributes of facets that are not colours (facet 0)"),
        (file(&material, 0, b""), "left out: MATERIAL of the header"),
        (file(b"", 0, b"more"), "4 bytes follow the last of 1 facets"),
    ] {
        assert_named(what, &found, 0, &plain);
    }
}

/// Features of pbrt-v4 that Dapple lacks.
const PBRT: [&str; 56] = [
    "Camera \"spherical\"",
    "Camera \"realistic\"",
    "PixelFilter \"mitchell\"",
    "PixelFilter \"sinc\"",
    "Film \"gbuffer\"",
    "Film \"spectral\"",
    "Film \"rgb\" \"string sensor\" \"canon_eos_5d\"",
    "Film \"rgb\" \"float iso\" 400",
    "Integrator \"volpath\"",
    "Integrator \"path\" \"bool regularize\" true",
    "Integrator \"path\" \"string lightsampler\" \"uniform\"",
    "Sampler \"halton\"",
    "Shape \"curve\"",
    "Shape \"cone\"",
    "Shape \"paraboloid\"",
    "Shape \"hyperboloid\"",
    "Shape \"plymesh\" \"string filename\" \"m.ply\" \"texture displacement\" \"t\"",
    "Shape \"bilinearmesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0 1 1 0] \"string emissionfilename\" \"a.png\"",
    "LightSource \"goniometric\"",
    "LightSource \"projection\"",
    "LightSource \"infinite\" \"point3 portal\" [0 0 0 1 0 0 1 1 0 0 1 0]",
    "AreaLightSource \"projective\"",
    "Material \"hair\"",
    "Material \"subsurface\"",
    "Material \"measured\"",
    "Texture \"t\" \"spectrum\" \"ptex\"",
    "Texture \"t\" \"float\" \"fbm\"",
    "Texture \"t\" \"float\" \"wrinkled\"",
    "Texture \"t\" \"spectrum\" \"marble\"",
    "Texture \"t\" \"float\" \"windy\"",
    "Texture \"t\" \"spectrum\" \"dots\"",
    "Texture \"t\" \"float\" \"directionmix\"",
    "Texture \"t\" \"spectrum\" \"imagemap\" \"string filename\" \"texture.png\" \"string wrap\" \"octahedralsphere\"",
    "Texture \"t\" \"spectrum\" \"checkerboard\" \"integer dimension\" 3",
    "Texture \"t\" \"spectrum\" \"checkerboard\" \"string mapping\" \"spherical\"",
    "Texture \"t\" \"spectrum\" \"checkerboard\" \"string mapping\" \"cylindrical\"",
    "Texture \"t\" \"spectrum\" \"checkerboard\" \"string mapping\" \"planar\"",
    "MakeNamedMedium \"m\" \"string type\" \"uniformgrid\"",
    "MakeNamedMedium \"m\" \"string type\" \"rgbgrid\"",
    "MakeNamedMedium \"m\" \"string type\" \"cloud\"",
    "MakeNamedMedium \"m\" \"string type\" \"nanovdb\"",
    "MakeNamedMedium \"m\" \"string type\" \"homogeneous\" \"rgb Le\" [1 1 1]",
    "MakeNamedMedium \"m\" \"string type\" \"homogeneous\" \"string preset\" \"no such\"",
    "ColorSpace \"rec2020\"",
    "ColorSpace \"aces2065-1\"",
    "ColorSpace \"dci-p3\"",
    "Option \"bool forcediffuse\" true",
    "Option \"bool wavefront\" true",
    "Option \"bool disablepixeljitter\" true",
    "Option \"string rendercoordsys\" \"camera\"",
    "Option \"float displacementedgescale\" 2",
    "Accelerator \"bvh\"",
    "Shape \"sphere\" \"float no\" 1",
    "Material \"diffuse\" \"float no\" 1",
    "LightSource \"point\" \"float no\" 1",
    "Nothing",
];

/// Directives that change no image in the limit of many samples.
const WITHOUT_EFFECT: [&str; 2] = ["Accelerator", "Sampler"];

#[test]
fn directives_of_pbrt_that_are_left_out_are_named() {
    let with = |directive: &str| {
        let settings = ["Option", "Camera", "PixelFilter", "Film", "Integrator", "Sampler"];
        let is_setting = settings.iter().any(|word| directive.starts_with(word));
        let (before, behind) = if is_setting { (directive, "") } else { ("", directive) };
        let film = if directive.starts_with("Film") { "" } else { "Film \"rgb\"\n" };
        let camera = if directive.starts_with("Camera") { "" } else { "Camera \"perspective\"\n" };
        // Textures of numbers are reported where they are used.
        let used =
            if directive.contains("\"float\"") { "Material \"dielectric\" \"texture roughness\" \"t\"" } else { "" };
        let used = if directive.starts_with("Texture") { used } else { "" };
        let text =
            format!("{before}\n{film}{camera}WorldBegin\nLightSource \"point\"\n{behind}\n{used}\nShape \"sphere\"\n");
        let options = |allow| AnyOptions {
            scene: ReadOptions { allow_unsupported: allow, memory: None },
            ..AnyOptions::default()
        };
        let ply = b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
            element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
        let files = [("m.pbrt", text.into_bytes()), ("m.ply", ply.to_vec()), ("texture.png", crate::gltf::png())];
        [false, true].map(|allow| read(&files, &options(allow)))
    };
    let [plain, _] = with("");
    let plain = notices(&plain.expect("a scene"));
    let mut silent = Vec::new();
    for directive in PBRT {
        let [strict, lenient] = with(directive);
        let is_named = match (&strict, &lenient) {
            // An error with the line, whose remedy `--allow-unsupported` leaves it out with a warning.
            (Err(error), Ok(scene)) => error.starts_with("m.pbrt:") && notices(scene) != plain,
            (Err(error), Err(_)) => error.starts_with("m.pbrt:"),
            (Ok(scene), _) => notices(scene) != plain,
        };
        if is_named == WITHOUT_EFFECT.iter().any(|name| directive.starts_with(name)) {
            silent.push(format!("{directive}: {:?}", strict.map(|scene| notices(&scene))));
        }
    }
    assert!(silent.is_empty(), "{silent:#?}, beside {plain:?}");
}

#[test]
fn colours_of_a_plymesh_are_named_once() {
    let ply = |colors: &str, row: &str| {
        let head = format!(
            "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n{colors}"
        );
        let rows = format!("0 0 0 {row}\n1 0 0 {row}\n0 1 0 {row}\n3 0 1 2\n");
        format!("{head}element face 1\nproperty list uchar int vertex_indices\nend_header\n{rows}").into_bytes()
    };
    let colored = ply("property uchar red\nproperty uchar green\nproperty uchar blue\n", "255 0 0");
    let shape = "Shape \"plymesh\" \"string filename\" \"m.ply\"\n";
    let pbrt = format!("Camera \"perspective\"\nWorldBegin\nLightSource \"infinite\"\n{shape}{shape}");
    let scene =
        |mesh: Vec<u8>| read(&[("a.pbrt", pbrt.clone().into()), ("m.ply", mesh)], &AnyOptions::default()).unwrap();
    assert_named("colours of a plymesh are left out, as in pbrt", &scene(colored), 4, &scene(ply("", "")));
}
