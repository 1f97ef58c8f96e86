//! Reader of glTF 2.0 files (`.gltf` and `.glb`) [Khronos 2021].
//!
//! Metal and roughness become a metal, a coated diffuse surface or a mix of both; transmission becomes glass. Lights of
//! `KHR_lights_punctual` are in candela and lux, converted at 683 lumens per watt as in Blender. Emission values are
//! radiance. A file without a camera gets the default camera of models. A file without lights gets their default environment
//! map; textured emission, and emission of at most 1, do not count as lights. Skins and morph targets are read in their rest
//! pose; animations are not read.

mod buffers;
mod materials;
mod nodes;
mod primitives;
mod textures;

use crate::files::Files;
use crate::image::Image;
use crate::model::{ModelError as Fault, UpAxis, scene_of, studio};
use crate::scene_reader::SceneReader;
use crate::{Emission, Notice, ObjectId, Scene, Source, text};
use ::gltf::json::validation::Checked;
use ::gltf::{Document, json};
use buffers::Buffers;
use std::collections::BTreeMap;
use std::sync::Arc;

/// The largest number of scattering events on a path of a glTF scene, as in Cycles.
const MAX_DEPTH: u32 = 12;
/// The extensions that this reader supports. Validation refuses a file that requires any other.
const KNOWN: &str = "KHR_lights_punctual KHR_materials_clearcoat KHR_materials_emissive_strength KHR_materials_ior \
    KHR_materials_pbrSpecularGlossiness KHR_materials_specular KHR_materials_transmission KHR_materials_unlit \
    KHR_materials_volume KHR_mesh_quantization KHR_texture_transform KHR_xmp_json_ld";
/// Extensions that compress data, and the command that removes each.
const PACKED: [(&str, &str); 5] = [
    ("KHR_draco_mesh_compression", "gltf-transform copy IN.glb OUT.glb"),
    ("EXT_meshopt_compression", "gltf-transform copy IN.glb OUT.glb"),
    ("KHR_texture_basisu", "gltf-transform png IN.glb OUT.glb"),
    ("EXT_texture_webp", "gltf-transform png IN.glb OUT.glb"),
    ("EXT_texture_avif", "gltf-transform png IN.glb OUT.glb"),
];

/// The reader of glTF 2.0 files.
pub(crate) const READER: SceneReader = SceneReader {
    name: "glTF",
    extensions: &["gltf", "glb"],
    recognizes: |content| {
        let start = text::without_mark(content).unwrap_or_default().trim_ascii_start();
        let head = &start[..start.len().min(1 << 16)];
        let asset = || head.windows(7).any(|window| window == b"\"asset\"");
        content.starts_with(b"glTF") || (head.starts_with(b"{") && asset())
    },
    read: |files, path, options| {
        scene_of(files, path, |scene, bytes, source| {
            scene.max_depth = Some(MAX_DEPTH);
            let wanted = add_file(scene, &bytes, files, source)?;
            Ok(studio::set(scene, options.model.stage(UpAxis::Y), wanted, source)?)
        })
    },
};

/// The reader of one file: the scene so far, the file's contents, and caches of converted objects.
struct Reader<'a> {
    scene: &'a mut Scene,
    document: &'a Document,
    buffers: Buffers<'a>,
    files: &'a dyn Files,
    source: &'a Source,
    /// Decoded images, by index and by the part of the pixels that is read; `None` for an unreadable image.
    images: BTreeMap<(usize, textures::Part), Option<Arc<Image>>>,
    /// Converted materials, by index and by a flag that is true for meshes with vertex colours.
    surfaces: BTreeMap<(Option<usize>, bool), materials::Surface>,
    /// Parts of meshes by the mesh's index.
    meshes: BTreeMap<usize, Vec<primitives::Part>>,
    objects: BTreeMap<usize, ObjectId>,
}

impl Reader<'_> {
    /// Adds a warning, unless the same warning exists already.
    fn warn(&mut self, message: String) {
        let notice = Notice::warning(self.source.clone(), message);
        if !self.scene.notices.contains(&notice) {
            self.scene.notices.push(notice);
        }
    }

    /// Warns about animations and scenes that are left out.
    fn name_left_out(&mut self) {
        let (document, animations) = (self.document, self.document.animations().len());
        if animations > 0 {
            self.warn(format!("animations are left out ({animations}); the rest pose is used"));
        }
        if let Some(scene) = nodes::shown_scene(document) {
            let others = document.scenes().filter(|other| other.index() != scene.index() && other.nodes().len() > 0);
            let others: Vec<String> = others.map(|other| named("scene", other.index(), other.name())).collect();
            if !others.is_empty() {
                let name = named("scene", scene.index(), scene.name());
                self.warn(format!("{name} is used; left out: {}", others.join(", ")));
            }
        }
    }
}

/// Adds everything in a glTF file to a scene. Returns the parts that the file lacks: camera and light.
fn add_file(scene: &mut Scene, bytes: &[u8], files: &dyn Files, source: &Source) -> Result<studio::Wanted, Fault> {
    let (text, blob) = split(bytes)?;
    let document = &document(text, scene, source)?;
    let buffers = Buffers::read(document, blob, files, &source.file)?;
    let placed = nodes::place(document)?;
    if let Some(empty) = nodes::first_scene(document).filter(|first| first.nodes().len() == 0) {
        let name = named("scene", empty.index(), empty.name());
        scene.warn(source, format!("{name} has no nodes; the nodes of another scene, or all nodes, are used"));
    }
    let (images, surfaces, meshes, objects) = Default::default();
    let mut reader = Reader { scene, document, buffers, files, source, images, surfaces, meshes, objects };
    reader.name_left_out();
    reader.add_shapes(&placed)?;
    reader.add_lights(&placed);
    let has_camera = reader.set_camera(&placed)?;
    let is_lamp = |e: &Emission| e.texture.is_none() && e.radiance.iter().any(|c| *c > 1.0);
    let emissions = || scene.shapes.iter().filter_map(|shape| shape.emission.as_ref());
    let has_light = !scene.lights.is_empty() || emissions().any(is_lamp);
    if !has_light && emissions().next().is_some() {
        let glows = "emission from textures, or of at most 1, does not count as a light; the default sky is added";
        scene.warn(source, glows);
    }
    if scene.shapes.is_empty() && scene.instances.is_empty() {
        return Err("the file has no triangles; export meshes".into());
    }
    Ok(studio::Wanted { camera: !has_camera, sky: !has_light, ground: !has_camera && !has_light })
}

/// Splits the bytes of a file into its JSON text and, for a binary file (GLB), its binary chunk.
fn split(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>), Fault> {
    let word = |at: usize| bytes.get(at..at + 4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    if !bytes.starts_with(b"glTF") {
        return Ok((bytes, None));
    }
    match word(4) {
        Some(2) => {}
        Some(version) => return Err(format!("the file has glTF version {version}; export version 2").into()),
        None => return Err(truncated(bytes.len())),
    }
    let (mut at, mut text, mut blob) = (12, None, None);
    let end = bytes.len().min(word(8).unwrap_or(0) as usize);
    while let (Some(length), Some(kind)) = (word(at), word(at + 4)) {
        if at + 8 > end {
            break;
        }
        let chunk = bytes.get(at + 8..at + 8 + length as usize).ok_or_else(|| truncated(bytes.len()))?;
        match kind {
            // "JSON" and "BIN\0".
            0x4e4f_534a => text = text.or(Some(chunk)),
            0x004e_4942 => blob = blob.or(Some(chunk)),
            _ => {}
        }
        at += 8 + length as usize;
    }
    text.map(|text| (text, blob)).ok_or_else(|| truncated(bytes.len()))
}

fn truncated(length: usize) -> Fault {
    format!("the file is cut off after {length} bytes; copy it again").into()
}

/// Parses and checks the JSON part of a file. Extensions that are left out become notices.
fn document(text: &[u8], scene: &mut Scene, source: &Source) -> Result<Document, Fault> {
    let mut root =
        root(&text::decode(text)?).map_err(|e| Fault::at(e.line() as u32, format!("{e}; export the file again")))?;
    if !root.asset.version.starts_with("2.") {
        let version = &root.asset.version;
        return Err(format!("the file has glTF version {version:?}; export version 2.0").into());
    }
    for name in &root.extensions_required {
        if let Some((_, command)) = PACKED.iter().find(|(packed, _)| packed == name) {
            return Err(format!("the file is compressed ({name}); unpack it: {command}").into());
        }
    }
    for name in root.extensions_used.iter().filter(|name| KNOWN.split(' ').all(|known| known != *name)) {
        scene.warn(source, format!("extension {name:?} is left out"));
    }
    // The notices above name the required extensions.
    root.extensions_required.clear();
    complete(&mut root)?;
    Document::from_json(root).map_err(|e| match e {
        ::gltf::Error::Validation(faults) => match faults.first() {
            Some((path, fault)) => format!("{}: {fault}; export the file again", path.as_str()).into(),
            None => "the file is invalid; export it again".into(),
        },
        other => other.to_string().into(),
    })
}

/// Parses the JSON part of a file.
fn root(text: &str) -> serde_json::Result<json::Root> {
    json::Root::from_str(text).or_else(|e| {
        // The library requires the nodes of a scene; the specification does not.
        let Ok(mut value) = serde_json::from_str::<serde_json::Value>(text) else { return Err(e) };
        let scenes = value.get_mut("scenes").and_then(|scenes| scenes.as_array_mut());
        let scenes = scenes.into_iter().flatten().filter_map(|scene| scene.as_object_mut());
        scenes.for_each(|scene| _ = scene.entry("nodes").or_insert_with(|| serde_json::json!([])));
        serde_json::from_value(value).or(Err(e))
    })
}

/// Adds missing bounds of positions. Validation requires them; this reader does not use them.
fn complete(root: &mut json::Root) -> Result<(), Fault> {
    let primitives = root.meshes.iter().flat_map(|mesh| &mesh.primitives);
    let positions = primitives.filter_map(|p| p.attributes.get(&Checked::Valid(json::mesh::Semantic::Positions)));
    for index in positions {
        let accessor = root.accessors.get_mut(index.value());
        // Validation would panic at an index that is out of range.
        let accessor = accessor.ok_or_else(|| format!("accessor {index} does not exist; export the file again"))?;
        for bound in [&mut accessor.min, &mut accessor.max] {
            bound.get_or_insert_with(|| serde_json::json!([0.0, 0.0, 0.0]));
        }
    }
    Ok(())
}

/// A name for messages: the kind of thing, its index, and its name in the file.
pub(super) fn named(kind: &str, index: usize, name: Option<&str>) -> String {
    match name {
        Some(name) => format!("{kind} {index} {name:?}"),
        None => format!("{kind} {index}"),
    }
}
