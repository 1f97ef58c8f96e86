//! Surfaces of glTF files beside plain materials: vertex colours, emissive textures, unlit colours, many joints.

use crate::gltf::{bare, floats, material, notices, quiet, read, uri, with_material};
use dapple_scene::{Color, Geometry, MaterialKind, MeshData, Scene, TextureKind};
use glam::DVec3;
use serde_json::{Value, json};

/// Adds a buffer with an accessor to a document. Returns the accessor's index.
fn add(document: &mut Value, bytes: &[u8], accessor: Value) -> usize {
    let list = |document: &mut Value, key: &str, value: Value| {
        let list = document[key].as_array_mut().expect("a list");
        list.push(value);
        list.len() - 1
    };
    let buffer = list(document, "buffers", json!({"byteLength": bytes.len(), "uri": uri(bytes)}));
    let view = list(document, "bufferViews", json!({"buffer": buffer, "byteLength": bytes.len()}));
    let mut accessor = accessor;
    accessor["bufferView"] = json!(view);
    list(document, "accessors", accessor)
}

fn attributes(document: &mut Value) -> &mut Value {
    &mut document["meshes"][0]["primitives"][0]["attributes"]
}

fn mesh(scene: &Scene) -> &MeshData {
    let Geometry::Mesh(mesh) = &scene.shapes[0].geometry else { panic!("a mesh") };
    mesh
}

/// The base colour's texture, and the factors of a product.
fn base(scene: &Scene) -> Vec<Color> {
    let (MaterialKind::Diffuse { reflectance: color } | MaterialKind::Layered { base: color, .. }) =
        material(scene).kind
    else {
        panic!("{:?}", material(scene).kind)
    };
    let Color::Texture(id) = color else { return vec![color] };
    match &scene.textures[id.0 as usize].kind {
        TextureKind::Product { factors } => factors.to_vec(),
        _ => vec![color],
    }
}

#[test]
fn vertex_colours_are_linear_and_multiply_the_base_colour() {
    let expected = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.2, 0.4, 0.6]];
    let bytes = |alpha: &[u8]| -> Vec<u8> {
        expected.iter().flat_map(|rgb| rgb.map(|c: f32| (c * 255.0) as u8).into_iter().chain(alpha.to_vec())).collect()
    };
    let shorts: Vec<u8> = expected.as_flattened().iter().flat_map(|c| ((c * 65_535.0) as u16).to_le_bytes()).collect();
    let cases = [
        (floats(expected.as_flattened()), json!({"componentType": 5126, "type": "VEC3"})),
        (bytes(&[255]), json!({"componentType": 5121, "type": "VEC4", "normalized": true})),
        (bytes(&[255]), json!({"componentType": 5121, "type": "VEC4"})),
        (shorts, json!({"componentType": 5123, "type": "VEC3", "normalized": true})),
    ];
    for (bytes, mut accessor) in cases {
        accessor["count"] = json!(4);
        let mut document = with_material(json!({"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.25, 1, 1]}}));
        let index = add(&mut document, &bytes, accessor.clone());
        attributes(&mut document)["COLOR_0"] = json!(index);
        let scene = read(&document).unwrap();
        let found = &mesh(&scene).colors;
        let close = found.as_flattened().iter().zip(expected.as_flattened()).all(|(a, b)| (a - b).abs() < 2e-5);
        assert!(close && found.len() == 4, "{accessor}: {found:?}");
        let factors = base(&scene);
        assert_eq!(factors[0], Color::Constant([0.5, 0.25, 1.0]), "the material's own colour");
        let Color::Texture(vertex) = factors[1] else { panic!("{factors:?}") };
        assert!(matches!(scene.textures[vertex.0 as usize].kind, TextureKind::VertexColor));
        assert!(notices(&scene).is_empty(), "{:?}", notices(&scene));
    }
}

#[test]
fn a_material_is_coloured_only_on_meshes_with_vertex_colours() {
    let mut document = with_material(json!({"pbrMetallicRoughness": {"metallicFactor": 0}}));
    let index = add(&mut document, &floats(&[0.5; 12]), json!({"componentType": 5126, "type": "VEC3", "count": 4}));
    let mut colored = document["meshes"][0].clone();
    colored["primitives"][0]["attributes"]["COLOR_0"] = json!(index);
    document["meshes"].as_array_mut().unwrap().push(colored);
    document["nodes"] = json!([{"mesh": 0}, {"mesh": 1}]);
    document["scenes"] = json!([{"nodes": [0, 1]}]);
    let scene = read(&document).unwrap();
    assert_eq!(base(&scene), [Color::Constant([1.0; 3])]);
    let other = Scene { shapes: scene.shapes[1..].to_vec(), ..scene };
    assert!(matches!(base(&other)[..], [Color::Texture(_)]), "white times the vertex colours");
}

#[test]
fn opacity_of_vertex_colours_and_their_further_sets_are_named() {
    let mut document = with_material(json!({"alphaMode": "BLEND"}));
    let accessor = json!({"componentType": 5126, "type": "VEC4", "count": 4});
    let index = add(&mut document, &floats(&[0.5; 16]), accessor);
    attributes(&mut document)["COLOR_0"] = json!(index);
    attributes(&mut document)["COLOR_1"] = json!(index);
    let said = notices(&read(&document).unwrap());
    let part = "mesh 0 \"square\", part 0";
    assert_eq!(
        said,
        [
            format!("{part}: only the first set of vertex colours is used"),
            format!("{part}: the opacity of its vertex colours is left out")
        ]
    );
}

#[test]
fn an_emissive_texture_is_the_texture_of_one_shape() {
    let document = with_material(json!({"emissiveFactor": [1, 0.5, 0.25], "emissiveTexture": {"index": 0}}));
    let scene = read(&document).unwrap();
    let emission = scene.shapes[0].emission.unwrap();
    assert_eq!(emission.radiance, [1.0, 0.5, 0.25]);
    let texture = &scene.textures[emission.texture.unwrap().0 as usize];
    let TextureKind::Image { image, factor, .. } = &texture.kind else { panic!("{texture:?}") };
    assert_eq!((image.size, *factor), ([2, 1], 1.0));
}

/// Base colour and texture show; emission, coat and lights do not.
#[test]
fn unlit_surfaces_show_their_base_colour() {
    let scene =
        quiet(json!({"extensions": {"KHR_materials_unlit": {}, "KHR_materials_clearcoat": {"clearcoatFactor": 1}},
        "emissiveFactor": [1, 1, 1], "alphaMode": "BLEND",
        "pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.25, 0.125, 0.5], "metallicFactor": 0}}));
    let MaterialKind::Unlit { color } = material(&scene).kind else { panic!("{:?}", material(&scene).kind) };
    assert_eq!(color, Color::Constant([0.5, 0.25, 0.125]));
    assert!(scene.shapes[0].emission.is_none() && scene.shapes[0].alpha.is_some());
}

/// Each vertex has four joints in each of two sets. All five or more of them move it by their weights.
#[test]
fn all_joints_of_a_vertex_move_it() {
    let mut document = bare();
    let joints = |first: u8| [first, first + 1, first + 2, first + 3].repeat(4);
    let bytes = |k: usize| json!({"componentType": if k == 0 { 5121 } else { 5126 }, "type": "VEC4", "count": 4});
    for (set, weights) in [[0.25, 0.25, 0.125, 0.125], [0.125, 0.125, 0.0, 0.0]].into_iter().enumerate() {
        let of_set = add(&mut document, &joints(4 * set as u8), bytes(0));
        attributes(&mut document)[format!("JOINTS_{set}")] = json!(of_set);
        let of_set = add(&mut document, &floats(&weights.repeat(4)), bytes(1));
        attributes(&mut document)[format!("WEIGHTS_{set}")] = json!(of_set);
    }
    // Joint k lies at x = 8 k.
    let mut nodes = vec![json!({"mesh": 0, "skin": 0})];
    nodes.extend((0..8).map(|k| json!({"translation": [8 * k, 0, 0]})));
    document["nodes"] = json!(nodes);
    document["scenes"] = json!([{"nodes": [0, 1, 2, 3, 4, 5, 6, 7, 8]}]);
    document["skins"] = json!([{"joints": [1, 2, 3, 4, 5, 6, 7, 8]}]);
    let scene = read(&document).unwrap();
    // 8 (0 + 0.25 + 0.25 + 0.375 + 0.5 + 0.625); with the first set alone, (0 + 0.25 + 0.25 + 0.375) / 0.75.
    assert!(
        (mesh(&scene).positions[0] - DVec3::new(16.0, 0.0, 0.0)).length() < 1e-5,
        "{:?}",
        mesh(&scene).positions[0]
    );
}

#[test]
fn what_only_glows_gets_a_sky_and_keeps_its_glow() {
    for glow in [
        json!({"emissiveFactor": [1, 1, 1], "emissiveTexture": {"index": 0}}),
        json!({"emissiveFactor": [1, 1, 1], "emissiveTexture": {"index": 0},
            "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 10}}}),
        json!({"emissiveFactor": [0, 0.05, 0]}),
        json!({"emissiveFactor": [1, 1, 1]}),
    ] {
        let scene = read(&with_material(glow.clone())).unwrap();
        assert_eq!((scene.shapes.len(), scene.lights.len()), (2, 1), "a ground and a sky: {glow}");
        assert!(scene.shapes[0].emission.is_some(), "{glow}");
        assert!(notices(&scene).iter().any(|notice| notice.contains("the default sky is added")), "{glow}");
    }
}

#[test]
fn attributes_of_others_are_left_out_with_one_warning_each() {
    let mut document = bare();
    attributes(&mut document)["_FEATURE_ID_0"] = json!(2);
    attributes(&mut document)["_BATCHID"] = json!(2);
    let scene = read(&document).unwrap();
    assert_eq!(mesh(&scene).positions.len(), 4);
    let mut found = notices(&scene);
    found.sort_unstable();
    assert_eq!(found, ["_BATCHID", "_FEATURE_ID_0"].map(|name| format!("vertex attribute \"{name}\" is left out")));
}

#[test]
fn textures_without_an_image_that_is_read_are_named() {
    let factor = json!({"pbrMetallicRoughness":
        {"baseColorTexture": {"index": 0}, "baseColorFactor": [0.5, 0.25, 0.125, 1], "metallicFactor": 0}});
    let webp = json!({"extensions": {"EXT_texture_webp": {"source": 0}}});
    for (texture, what) in [(webp, "its image needs EXT_texture_webp"), (json!({}), "it has none")] {
        let mut document = with_material(factor.clone());
        document["textures"][0] = texture;
        let scene = read(&document).unwrap();
        assert_eq!(base(&scene), [Color::Constant([0.5, 0.25, 0.125])]);
        let expected = format!("texture 0 has no supported image ({what}); a constant is used instead");
        assert_eq!(notices(&scene), [expected]);
    }
}

#[test]
fn textures_without_their_coordinates_are_named() {
    let mut document =
        with_material(json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "texCoord": 3}}}));
    let expected = "mesh 0 \"square\", part 0: it has textures but no texture coordinates of set 3; every triangle shows the same piece of the textures";
    assert_eq!(notices(&read(&document).unwrap()), [expected]);
    document["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["texCoord"] = json!(0);
    assert!(read(&document).unwrap().notices.is_empty());
}

#[test]
fn data_uris_may_lack_padding_and_hold_line_ends() {
    let mut document = bare();
    let data = uri(&crate::gltf::square());
    let (start, end) = data.trim_end_matches('=').split_at(60);
    assert!(data.ends_with('='), "padding that is left out below");
    document["buffers"][0]["uri"] = json!(format!("{start}\r\n  {end}\n"));
    assert_eq!(*mesh(&read(&document).unwrap()), *mesh(&read(&bare()).unwrap()));
}
