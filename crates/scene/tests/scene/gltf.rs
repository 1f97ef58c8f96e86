//! glTF files: the scenes that they make, and the errors of broken ones.

#![allow(clippy::print_stderr, reason = "tests say when they skip")]

use base64::Engine;
use dapple_scene::{
    AnyOptions, ClearCoat, Color, Geometry, LightKind, Material, MaterialKind, Projection, ReadError, Scalar, Scene,
    TextureKind, read_any_from,
};
use glam::DVec3;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::PathBuf;

pub(crate) fn uri(bytes: &[u8]) -> String {
    format!("data:application/octet-stream;base64,{}", base64::engine::general_purpose::STANDARD.encode(bytes))
}

pub(crate) fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

pub(crate) fn png() -> Vec<u8> {
    let mut bytes = Vec::new();
    let pixels = image::RgbaImage::from_raw(2, 1, vec![255, 128, 0, 255, 0, 64, 255, 64]).expect("four channels");
    pixels.write_to(&mut Cursor::new(&mut bytes), image::ImageFormat::Png).expect("encoded");
    bytes
}

/// The bytes of a square's buffer: 4 positions, 4 normals, 4 texture coordinates, 6 indices.
pub(crate) fn square() -> Vec<u8> {
    let mut bytes = floats(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0]);
    bytes.extend(floats(&[0.0, 0.0, 1.0].repeat(4)));
    bytes.extend(floats(&[0.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0]));
    bytes.extend([0_u16, 1, 2, 0, 2, 3].iter().flat_map(|i| i.to_le_bytes()));
    bytes
}

/// A square that stands on the y axis, in one node, without materials.
pub(crate) fn bare() -> Value {
    let view = |offset: usize, length: usize| json!({"buffer": 0, "byteOffset": offset, "byteLength": length});
    json!({
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": 140, "uri": uri(&square())}],
        "bufferViews": [view(0, 48), view(48, 48), view(96, 32), view(128, 12)],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]},
            {"bufferView": 1, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 2, "componentType": 5126, "count": 4, "type": "VEC2"},
            {"bufferView": 3, "componentType": 5123, "count": 6, "type": "SCALAR"}
        ],
        "meshes": [{"name": "square", "primitives": [
            {"attributes": {"POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2}, "indices": 3}]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
        "scene": 0
    })
}

/// A square of a material.
pub(crate) fn with_material(material: Value) -> Value {
    let mut document = bare();
    document["materials"] = json!([material]);
    document["meshes"][0]["primitives"][0]["material"] = json!(0);
    document["images"] = json!([{"uri": "texture.png"}]);
    document["textures"] = json!([{"source": 0}]);
    document
}

fn files(document: &Value) -> BTreeMap<PathBuf, Vec<u8>> {
    [("m.gltf", document.to_string().into_bytes()), ("texture.png", png())]
        .map(|(name, bytes)| (PathBuf::from(name), bytes))
        .into()
}

pub(crate) fn read(document: &Value) -> Result<Scene, ReadError> {
    read_any_from(&files(document), "m.gltf", &AnyOptions::default())
}

/// A scene of a square of a material, in which nothing is left out.
pub(crate) fn quiet(material: Value) -> Scene {
    let scene = read(&with_material(material)).unwrap();
    assert!(scene.notices.is_empty(), "{:?}", notices(&scene));
    scene
}

/// The first values of an image's pixels that a parameter reads, and the factor.
pub(crate) fn texels(scene: &Scene, scalar: Scalar) -> ([f32; 2], f32) {
    let Scalar::Texture(id) = scalar else { panic!("{scalar:?}") };
    let TextureKind::Image { image, factor, .. } = &scene.textures[id.0 as usize].kind else { panic!("an image") };
    ([image.pixels[0][0], image.pixels[1][0]], *factor)
}

/// A binary file (GLB) of a document whose buffer is in its own chunk.
fn binary(mut document: Value) -> Vec<u8> {
    document["buffers"][0].as_object_mut().expect("an object").remove("uri");
    let padded = |mut bytes: Vec<u8>, with: u8| {
        bytes.resize(bytes.len().next_multiple_of(4), with);
        bytes
    };
    let chunks = [(b"JSON", padded(document.to_string().into_bytes(), b' ')), (b"BIN\0", padded(square(), 0))];
    let length: usize = 12 + chunks.iter().map(|(_, bytes)| 8 + bytes.len()).sum::<usize>();
    let mut file = [b"glTF".as_slice(), &2_u32.to_le_bytes(), &(length as u32).to_le_bytes()].concat();
    for (kind, bytes) in chunks {
        file.extend((bytes.len() as u32).to_le_bytes());
        file.extend(kind);
        file.extend(bytes);
    }
    file
}

pub(crate) fn material(scene: &Scene) -> &Material {
    &scene.materials[scene.shapes[0].material.0 as usize]
}

pub(crate) fn notices(scene: &Scene) -> Vec<String> {
    scene.notices.iter().map(|notice| notice.message.clone()).collect()
}

#[test]
fn a_bare_file_stands_on_a_ground_and_fills_the_frame() {
    let scene = read(&bare()).unwrap();
    assert_eq!((scene.shapes.len(), scene.lights.len()), (2, 1), "the square, a ground, a sky");
    assert!(scene.notices.is_empty() && matches!(scene.shapes[1].geometry, Geometry::Disk { .. }));
    let Geometry::Mesh(mesh) = &scene.shapes[0].geometry else { panic!("a mesh") };
    assert_eq!((mesh.positions.len(), mesh.normals.len(), mesh.triangles.len()), (4, 4, 2));
    assert_eq!(mesh.uvs[0], [0.0, 0.0], "v = 1 is the bottom edge in glTF, v = 0 in ours");
    assert!(
        matches!(material(&scene).kind, MaterialKind::Diffuse { reflectance: Color::Constant(c) } if c == [0.8; 3])
    );
    let other =
        read_any_from(&BTreeMap::from([(PathBuf::from("m.scan"), binary(bare()))]), "m.scan", &AnyOptions::default());
    let Geometry::Mesh(same) = &other.unwrap().shapes[0].geometry else { panic!("a mesh") };
    assert_eq!(mesh, same, "a binary file, by its content, holds the same mesh");
}

#[test]
fn cameras_and_lights_are_read() {
    let mut document = bare();
    document["cameras"] =
        json!([{"type": "perspective", "perspective": {"yfov": 1.0, "aspectRatio": 2.0, "znear": 0.1}}]);
    document["extensionsUsed"] = json!(["KHR_lights_punctual"]);
    document["extensions"] = json!({"KHR_lights_punctual": {"lights": [
        {"type": "point", "intensity": 683.0, "color": [1.0, 0.5, 0.25]},
        {"type": "directional", "intensity": 1366.0},
        {"type": "spot", "intensity": 683.0, "spot": {"innerConeAngle": 0.1, "outerConeAngle": 0.2}}]}});
    let light = |k: usize| json!({"extensions": {"KHR_lights_punctual": {"light": k}}, "translation": [0, 0, k]});
    document["nodes"] = json!([{"mesh": 0}, {"camera": 0, "translation": [0, 0, 5]}, light(0), light(1), light(2)]);
    document["scenes"] = json!([{"nodes": [0, 1, 2, 3, 4]}]);
    let scene = read(&document).unwrap();
    assert!(scene.notices.is_empty() && scene.shapes.len() == 1, "no ground of ours");
    assert_eq!(scene.film.resolution, [1440, 720]);
    let camera = &scene.camera;
    assert_eq!(camera.to_world.translation, DVec3::new(0.0, 0.0, 5.0));
    assert_eq!(camera.to_world.matrix3.z_axis, DVec3::NEG_Z, "glTF's cameras look along -z");
    assert!(matches!(camera.projection, Projection::Perspective { fov } if (fov - 1.0f64.to_degrees()).abs() < 1e-5));
    let kinds: Vec<&LightKind> = scene.lights.iter().map(|light| &light.kind).collect();
    assert!(matches!(kinds[0], LightKind::Point { intensity } if *intensity == [1.0, 0.5, 0.25]), "683 lm are 1 W");
    assert!(matches!(kinds[1], LightKind::Distant { irradiance } if *irradiance == [2.0; 3]));
    let LightKind::Spot { cone, falloff_start, .. } = kinds[2] else { panic!("{:?}", kinds[2]) };
    assert!((cone - 0.2f32.to_degrees()).abs() < 1e-4 && (falloff_start - 0.1f32.to_degrees()).abs() < 1e-4);
    let shines = scene.lights[2].to_world.matrix3.z_axis;
    assert_eq!(shines, DVec3::NEG_Z, "the spot shines along -z of its node");
}

#[test]
fn materials_become_layers_metals_glass_and_lamps() {
    let kind = |value: Value| material(&quiet(value)).kind.clone();
    let plain = kind(json!({"pbrMetallicRoughness": {
        "baseColorFactor": [0.5, 0.25, 0.125, 1], "metallicFactor": 0.5, "roughnessFactor": 0.5}}));
    let MaterialKind::Layered { base, metallic, normal, grazing, roughness, coat } = plain else { panic!("{plain:?}") };
    assert_eq!((base, metallic), (Color::Constant([0.5, 0.25, 0.125]), Scalar::Constant(0.5)));
    assert!((normal[0] - 0.04).abs() < 1e-6 && grazing == 1.0 && coat.is_none());
    assert_eq!(roughness.constants(), Some([0.25; 2]), "alpha is the square of the roughness");
    let metal = kind(json!({"pbrMetallicRoughness": {"metallicFactor": 1, "roughnessFactor": 0}}));
    assert!(matches!(metal, MaterialKind::Conductor { .. }), "{metal:?}");
    let matte = kind(json!({"pbrMetallicRoughness": {"metallicFactor": 0},
        "extensions": {"KHR_materials_specular": {"specularFactor": 0}}}));
    assert!(matches!(matte, MaterialKind::Diffuse { .. }), "{matte:?}");
    let coated = kind(json!({"pbrMetallicRoughness": {"metallicFactor": 0},
        "extensions": {"KHR_materials_clearcoat": {"clearcoatFactor": 0.5, "clearcoatRoughnessFactor": 0.5}}}));
    let MaterialKind::Layered { coat, .. } = coated else { panic!("{coated:?}") };
    assert_eq!(coat, Some(ClearCoat { amount: 0.5, alpha: 0.25 }));
    let pane = json!({"pbrMetallicRoughness": {"metallicFactor": 0, "roughnessFactor": 0},
        "extensions": {"KHR_materials_transmission": {"transmissionFactor": 1}}});
    assert!(matches!(kind(pane.clone()), MaterialKind::ThinDielectric { eta } if eta == 1.5));
    let mut glass = pane;
    glass["extensions"]["KHR_materials_volume"] =
        json!({"thicknessFactor": 1, "attenuationDistance": 2, "attenuationColor": [1, 0.5, 1]});
    glass["extensions"]["KHR_materials_ior"] = json!({"ior": 1.3});
    let scene = read(&with_material(glass)).unwrap();
    assert!(matches!(material(&scene).kind, MaterialKind::Dielectric { eta, .. } if eta == 1.3));
    let absorbed = scene.media[0].absorption;
    assert!((absorbed[1] - 0.5 * std::f32::consts::LN_2).abs() < 1e-6 && absorbed[0] == 0.0);
    let lamp = read(&with_material(json!({"emissiveFactor": [1, 0.5, 0],
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 4}}})));
    let lamp = lamp.unwrap();
    assert_eq!(lamp.shapes[0].emission.unwrap().radiance, [4.0, 2.0, 0.0]);
    assert!(lamp.lights.is_empty() && lamp.shapes.len() == 1, "a file that shines gets no sky and no ground");
}

#[test]
fn textures_set_color_roughness_metal_normals_and_opacity() {
    let texture = json!({"index": 0});
    let scene = quiet(json!({
        "pbrMetallicRoughness": {"baseColorTexture": texture, "metallicRoughnessTexture": texture},
        "normalTexture": texture, "alphaMode": "MASK", "alphaCutoff": 0.5}));
    let pixels = |scalar: Scalar| texels(&scene, scalar).0;
    let MaterialKind::Layered { base: Color::Texture(_), metallic, roughness, .. } = material(&scene).kind else {
        panic!("{:?}", material(&scene).kind)
    };
    assert_eq!(pixels(metallic), [0.0, 1.0], "the blue channel");
    let green = [128.0f32 / 255.0, 64.0 / 255.0].map(|g| g * g);
    pixels(roughness.u).iter().zip(green).for_each(|(a, b)| assert!((a - b).abs() < 1e-5, "{a} {b}"));
    assert!(material(&scene).normal_map.is_some());
    assert_eq!(pixels(scene.shapes[0].alpha.unwrap()), [1.0, 0.0], "opaque, and cut out");
}

#[test]
fn transforms_move_normal_maps_and_emission_too() {
    let transform = json!({"KHR_texture_transform": {"offset": [0.25, 0.5], "scale": [2, 3]}});
    let mut document = with_material(json!({"normalTexture": {"index": 0, "extensions": transform}}));
    document["extensionsUsed"] = json!(["KHR_texture_transform"]);
    let scene = read(&document).unwrap();
    let map = material(&scene).normal_map.unwrap();
    let TextureKind::Image { scale, shift, .. } = scene.textures[map.0 as usize].kind else { panic!("an image") };
    assert_eq!((scale, shift), ([2.0, 3.0], [0.25, -2.5]), "v runs upwards here");
    document["materials"][0]["normalTexture"]["extensions"]["KHR_texture_transform"]["rotation"] = json!(1);
    assert_eq!(notices(&read(&document).unwrap()), ["texture 0: the rotation of its coordinates is left out"]);
    let lamp = json!({"emissiveFactor": [1, 1, 1], "emissiveTexture": {"index": 0, "extensions": transform}});
    let scene = read(&with_material(lamp)).unwrap();
    let map = scene.shapes[0].emission.unwrap().texture.unwrap();
    let TextureKind::Image { scale, shift, .. } = scene.textures[map.0 as usize].kind else { panic!("an image") };
    assert_eq!((scale, shift), ([2.0, 3.0], [0.25, -2.5]));
}

#[test]
fn meshes_used_twice_become_instances_and_skins_rest() {
    let mut document = bare();
    document["nodes"] =
        json!([{"mesh": 0}, {"mesh": 0, "translation": [2, 0, 0], "scale": [2, 2, 2]}, {"children": [0, 1]}]);
    document["scenes"] = json!([{"nodes": [2]}]);
    let scene = read(&document).unwrap();
    assert_eq!((scene.objects.len(), scene.instances.len(), scene.shapes.len()), (1, 2, 1), "and the ground");
    assert_eq!(scene.instances[1].to_world.transform_point3(DVec3::ONE), DVec3::new(4.0, 2.0, 2.0));
    // A mesh with a morph target of weight 1 moves up by one.
    document["nodes"] = json!([{"mesh": 0, "weights": [1.0]}]);
    document["scenes"] = json!([{"nodes": [0]}]);
    document["meshes"][0]["primitives"][0]["targets"] = json!([{"POSITION": 1}]);
    let scene = read(&document).unwrap();
    let Geometry::Mesh(mesh) = &scene.shapes[0].geometry else { panic!("a mesh") };
    assert!(mesh.positions.iter().all(|p| p.z == 1.0));
}

#[test]
fn what_is_left_out_is_named_once() {
    let mut document = with_material(json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}));
    document["extensionsUsed"] = json!(["KHR_materials_sheen", "KHR_materials_variants"]);
    document["images"][0]["uri"] = json!("missing.png");
    let scene = read(&document).unwrap();
    let said = notices(&scene);
    let count = |what: &str| said.iter().filter(|notice| notice.contains(what)).count();
    for what in ["\"KHR_materials_sheen\" is left out", "missing.png"] {
        assert_eq!(count(what), 1, "{what}: {said:?}");
    }
}

#[test]
fn textures_of_coats_and_of_thickness_are_left_out_by_name() {
    let material = |with_textures: bool| {
        let mut coat = json!({"clearcoatFactor": 0.5});
        let mut volume = json!({"thicknessFactor": 1, "attenuationDistance": 2, "attenuationColor": [1, 0.5, 1]});
        if with_textures {
            coat["clearcoatRoughnessTexture"] = json!({"index": 0});
            volume["thicknessTexture"] = json!({"index": 0});
        }
        let document = json!({"name": "car", "pbrMetallicRoughness": {"metallicFactor": 0},
            "extensions": {"KHR_materials_clearcoat": coat, "KHR_materials_volume": volume,
                "KHR_materials_transmission": {"transmissionFactor": 0.5}}});
        notices(&read(&with_material(document)).unwrap())
    };
    let said = material(true);
    assert_eq!(said.len(), 2, "{said:?}");
    for what in
        ["material 0 \"car\": the textures of its clear coat are", "material 0 \"car\": its thickness texture is"]
    {
        assert!(said.iter().any(|notice| notice.starts_with(what)), "{what}: {said:?}");
    }
    assert!(material(false).is_empty());
}

#[test]
fn blended_opacity_is_the_textures_times_the_factor() {
    let scene = quiet(json!({"alphaMode": "BLEND",
        "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0.5], "baseColorTexture": {"index": 0}}}));
    let ([first, second], factor) = texels(&scene, scene.shapes[0].alpha.unwrap());
    assert_eq!((first, factor), (1.0, 0.5));
    assert!((second - 64.0 / 255.0).abs() < 1e-6, "the alpha of the second pixel");
    let even = |mode: &str| {
        let material = json!({"alphaMode": mode, "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0.25]}});
        read(&with_material(material)).unwrap().shapes[0].alpha
    };
    assert_eq!(even("BLEND"), Some(Scalar::Constant(0.25)));
    assert_eq!(even("OPAQUE"), None);
}

#[test]
fn specular_and_glossiness_become_a_coated_surface() {
    let read_old = |old: Value| quiet(json!({"extensions": {"KHR_materials_pbrSpecularGlossiness": old}}));
    let scene = read_old(json!({"diffuseFactor": [0.5, 0.25, 0.125, 1], "specularFactor": [0.25, 0.125, 0.0625],
        "glossinessFactor": 0.75}));
    let MaterialKind::Substrate { diffuse, specular, roughness } = material(&scene).kind else {
        panic!("{:?}", material(&scene).kind)
    };
    assert_eq!(diffuse, Color::Constant([0.5, 0.25, 0.125]));
    assert_eq!(specular, Color::Constant([0.25, 0.125, 0.0625]));
    assert_eq!(roughness.constants(), Some([0.0625; 2]), "alpha is the square of 1 minus the glossiness");
    let scene = read_old(json!({"glossinessFactor": 0.5, "specularGlossinessTexture": {"index": 0}}));
    let MaterialKind::Substrate { roughness, .. } = material(&scene).kind else { panic!("as above") };
    assert_eq!(texels(&scene, roughness.u).0[0], 0.25, "an alpha of 1 times 0.5 is the glossiness");
}

#[test]
fn orthographic_cameras_show_their_magnification() {
    let mut document = bare();
    document["cameras"] =
        json!([{"type": "orthographic", "orthographic": {"xmag": 3, "ymag": 1.5, "znear": 0, "zfar": 9}}]);
    document["nodes"] = json!([{"mesh": 0}, {"camera": 0, "translation": [0, 0, 5]}]);
    document["scenes"] = json!([{"nodes": [0, 1]}]);
    let scene = read(&document).unwrap();
    assert!(matches!(scene.camera.projection, Projection::Orthographic), "{:?}", scene.camera.projection);
    // pbrt's order: least x, largest x, least y, largest y. The magnifications are half of the width and of the height.
    assert_eq!(scene.camera.screen_window, Some([-3.0, 3.0, -1.5, 1.5]));
    assert_eq!(scene.film.resolution, [1440, 720]);
    document["cameras"][0]["orthographic"]["xmag"] = json!(0);
    let message = read(&document).map(|_| ()).unwrap_err().to_string();
    assert!(message.contains("camera 0: its angle of view is invalid"), "{message}");
}

/// Files of Khronos and Bevy: their triangles, lamps and textures. Nothing is left out.
#[test]
fn shared_files_are_read() {
    let beside = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/scenes"));
    let folder = std::env::var_os("DAPPLE_SCENES").map_or(beside, PathBuf::from).join("gltf");
    // A file's name, and its numbers of triangles, of shining shapes, and of textures.
    for (name, expected) in [
        ("BoxTextured/glTF-Binary/BoxTextured.glb", [12, 0, 1]),
        ("Suzanne/glTF/Suzanne.gltf", [3936, 0, 3]),
        ("bevy/CornellBox/CornellBox.glb", [36, 1, 2]),
    ] {
        let path = folder.join(name);
        if !path.exists() {
            eprintln!("skipped: {} is not there", path.display());
            continue;
        }
        let scene = dapple_scene::read_any(&path, &AnyOptions::default()).unwrap();
        let count = |geometry: &Geometry| if let Geometry::Mesh(mesh) = geometry { mesh.triangles.len() } else { 0 };
        let triangles = scene.shapes.iter().map(|shape| count(&shape.geometry)).sum();
        let shining = scene.shapes.iter().filter(|shape| shape.emission.is_some()).count();
        assert_eq!([triangles, shining, scene.textures.len()], expected, "{name}");
        assert!(scene.notices.is_empty(), "{name}: {:?}", notices(&scene));
    }
}

#[test]
fn broken_files_are_errors_that_say_what_to_do_i03() {
    let changed = |pointer: &str, value: Value| {
        let mut document = bare();
        let (parent, key) = pointer.rsplit_once('/').expect("a pointer");
        let parent = document.pointer_mut(parent).expect("a place");
        match parent {
            Value::Array(list) => list[key.parse::<usize>().expect("an index")] = value,
            _ => parent[key] = value,
        }
        document
    };
    let mut packed = bare();
    packed["extensionsUsed"] = json!(["KHR_draco_mesh_compression"]);
    packed["extensionsRequired"] = json!(["KHR_draco_mesh_compression"]);
    let cases = [
        (changed("/accessors/0/count", json!(4_000_000_000_u64)), "accessor 0"),
        (changed("/accessors/3/count", json!(7)), "accessor 3"),
        (changed("/meshes/0/primitives/0/attributes", json!({"POSITION": 9})), "accessor 9 does not exist"),
        (changed("/meshes/0/primitives/0/attributes", json!({"POSITION": 3})), "accessor 3"),
        (changed("/meshes/0/primitives/0/indices", json!(0)), "accessor 0: must hold unsigned integers"),
        (changed("/bufferViews/0/byteLength", json!(1_000_000)), "buffer"),
        (changed("/buffers/0/byteLength", json!(1_000)), "buffer 0: has only 140 of 1000 bytes; copy its file again"),
        (changed("/buffers/0/uri", json!("square.bin")), "cannot read square.bin"),
        (changed("/buffers/0/uri", json!("data:;base64,*")), "cannot be decoded"),
        (changed("/nodes/0", json!({"mesh": 9})), "nodes"),
        (changed("/nodes/0", json!({"mesh": 0, "children": [0]})), "has two parents"),
        (changed("/nodes/0", json!({"mesh": 0, "scale": [1e39, 1, 1]})), "m.gltf"),
        (changed("/asset/version", json!("1.0")), "export version 2.0"),
        (changed("/meshes/0/primitives/0/mode", json!(1)), "no triangles; export meshes"),
        (packed, "gltf-transform copy IN.glb OUT.glb"),
    ];
    for (document, what) in cases {
        let message = read(&document).map(|_| ()).unwrap_err().to_string();
        assert!(message.starts_with("m.gltf") && message.contains(what), "{what}: {message}");
    }
}

#[test]
fn files_cut_at_any_byte_are_errors_i02() {
    let whole = binary(bare());
    for length in 0..whole.len() {
        let files = BTreeMap::from([(PathBuf::from("m.glb"), whole[..length].to_vec())]);
        let read = read_any_from(&files, "m.glb", &AnyOptions::default());
        // The last bytes are padding.
        assert!(read.is_err() || length + 4 > whole.len(), "{length} of {} bytes", whole.len());
    }
}

#[test]
fn other_formats_are_refused_with_a_converter() {
    for (name, content, what) in [
        ("a.usda", "#usda 1.0\n", "USD files are not supported; open the file in Blender and export glTF"),
        ("scene.txt", "<?xml version='1.0'?>\n<!-- ours -->\n<scene version=\"3.0.0\"/>", "Mitsuba XML files are not"),
        ("mesh", "OFF\n3 1 0\n", "OFF files are not supported; convert the file by `assimp export"),
    ] {
        let files = BTreeMap::from([(PathBuf::from(name), content.as_bytes().to_vec())]);
        let message = read_any_from(&files, name, &AnyOptions::default()).map(|_| ()).unwrap_err().to_string();
        assert!(message.starts_with(name) && message.contains(what), "{message}");
    }
}
