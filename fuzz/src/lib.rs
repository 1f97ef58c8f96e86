//! What the fuzz targets do with their bytes; `crates/renderer/tests/fuzz_corpus.rs` does the same with the seeds.

use dapple_renderer::Effects;
use dapple_renderer::image::{Encoding, read_attributes, read_channels, read_picture};
use dapple_renderer::model::{read_obj, read_stl};
use dapple_renderer::pbrt::{ReadOptions, read_scene_from};
use dapple_renderer::ply::read_ply;

/// A scene file beside a mesh, a picture and a file to include.
pub fn scene(data: &[u8]) {
    let mesh = b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
        element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
    let files: &[(&str, &[u8])] = &[
        ("scene.pbrt", data),
        ("m.ply", mesh),
        ("p.pfm", b"PF\n1 1\n-1.0\n\0\0\x80\x3f\0\0\x80\x3f\0\0\x80\x3f"),
        ("i.pbrt", b"Shape \"sphere\"\n"),
    ];
    for allow in [false, true] {
        let options = ReadOptions::default().with_allow_unsupported(allow);
        match read_scene_from(files, "scene.pbrt", &options) {
            Ok(scene) => drop(Effects::of(&scene)),
            Err(e) => assert!(!e.to_string().is_empty()),
        }
    }
}

/// A PLY mesh.
pub fn ply(data: &[u8]) {
    if let Ok(mesh) = read_ply(data) {
        mesh.data.check().expect("what is read is whole");
    }
}

/// An OBJ mesh; its materials are read by the same bytes.
pub fn obj(data: &[u8]) {
    let files: &[(&str, &[u8])] = &[("m.obj", data), ("m.mtl", data)];
    if let Ok(model) = read_obj(data) {
        model.meshes.iter().for_each(|mesh| mesh.data.check().expect("what is read is whole"));
    }
    let _ = dapple_renderer::model::read_model_from(files, "m.obj", &Default::default());
}

/// An STL mesh.
pub fn stl(data: &[u8]) {
    if let Ok(mesh) = read_stl(data) {
        mesh.data.check().expect("what is read is whole");
    }
}

/// A picture of any format: TGA alone goes by its name.
pub fn image(data: &[u8]) {
    for encoding in [Encoding::Auto, Encoding::Linear] {
        if let Ok(picture) = read_picture(data, "a.tga", encoding) {
            let count = picture.width() * picture.height();
            assert!(picture.pixels.len() == count && (picture.alpha.is_empty() || picture.alpha.len() == count));
        }
    }
    let _ = read_channels(data, "a.exr");
    let _ = read_attributes(data, "a.exr");
}
