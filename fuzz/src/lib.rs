//! The bodies of the fuzz targets. `crates/scene/tests/fuzz_corpus.rs` runs them on the seeds.

use dapple_geometry::{Geometry, Hit, Mesh, Ray, Shape};
use dapple_scene::Effects;
use dapple_scene::image::{Encoding, read_attributes, read_channels, read_image};
use dapple_scene::model::{read_obj, read_ply, read_stl};
use dapple_scene::pbrt::{ReadOptions, read_scene_from};
use glam::Vec3;

/// Reads `data` as a scene file, next to a mesh, an image and a file to include.
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
        let options = ReadOptions { allow_unsupported: allow, memory: None };
        match read_scene_from(files, "scene.pbrt", &options) {
            Ok(scene) => drop(Effects::of(&scene)),
            Err(e) => assert!(!e.to_string().is_empty()),
        }
    }
}

/// Reads `data` as a PLY mesh.
pub fn ply(data: &[u8]) {
    if let Ok(mesh) = read_ply(data) {
        mesh.data.check().expect("what is read is whole");
    }
}

/// Reads `data` as an OBJ mesh whose material file has the same bytes.
pub fn obj(data: &[u8]) {
    let files: &[(&str, &[u8])] = &[("m.obj", data), ("m.mtl", data)];
    if let Ok(model) = read_obj(data) {
        model.meshes.iter().for_each(|mesh| mesh.data.check().expect("what is read is whole"));
    }
    let _ = dapple_scene::read_any_from(files, "m.obj", &Default::default());
}

/// Reads `data` as a glTF file, text or binary, whose image has the same bytes.
pub fn gltf(data: &[u8]) {
    let files: &[(&str, &[u8])] = &[("m.gltf", data), ("p.png", data)];
    match dapple_scene::read_any_from(files, "m.gltf", &Default::default()) {
        Ok(scene) => drop(Effects::of(&scene)),
        Err(e) => assert!(!e.to_string().is_empty()),
    }
}

/// Reads `data` as an STL mesh.
pub fn stl(data: &[u8]) {
    if let Ok(mesh) = read_stl(data) {
        mesh.data.check().expect("what is read is whole");
    }
}

/// Reads `data` as an image of any format. The file name is that of a TGA image, because TGA has no signature.
pub fn image(data: &[u8]) {
    for encoding in [Encoding::Auto, Encoding::Linear] {
        if let Ok(image) = read_image(data, "a.tga", encoding) {
            let count = image.width() * image.height();
            assert!(image.pixels.len() == count && (image.alpha.is_empty() || image.alpha.len() == count));
        }
    }
    let _ = read_channels(data, "a.exr");
    let _ = read_attributes(data, "a.exr");
}

/// Intersects triangles with rays. `data` holds the number of vertices, the vertices, and triangles with one byte per index.
/// Some rays run from vertex to vertex; others are made from the bytes of the triangles.
pub fn geometry(data: &[u8]) {
    let Some((&count, rest)) = data.split_first() else { return };
    let (numbers, rest) = rest.split_at((usize::from(count) * 12).min(rest.len() / 12 * 12));
    let float = |bytes: &[u8]| f32::from_le_bytes(bytes.try_into().expect("four bytes"));
    let point = |bytes: &[u8]| [float(&bytes[..4]), float(&bytes[4..8]), float(&bytes[8..12])];
    let positions: Vec<[f32; 3]> = numbers.chunks_exact(12).map(point).collect();
    let triangles: Vec<[u32; 3]> = rest.chunks_exact(3).take(256).map(|c| [c[0], c[1], c[2]].map(u32::from)).collect();
    let Ok(mesh) = Mesh::new(positions.clone(), triangles) else { return };
    let shape = Shape::from(mesh);
    let one = Geometry::build(vec![shape.clone()]).expect("few");
    // The copy has the larger number, so that it is never hit.
    let other = Geometry::build(vec![shape.clone(), shape]).expect("few");
    let between = positions.windows(2).map(|p| {
        let [from, to] = [p[0], p[1]].map(Vec3::from_array);
        Ray::new(from, to - from)
    });
    let wild = rest.chunks_exact(32).take(16).map(|c| {
        let [origin, direction] = [point(c), point(&c[12..])].map(Vec3::from_array);
        Ray::new(origin, direction).with_limits(float(&c[24..28]), float(&c[28..32]))
    });
    for ray in between.take(32).chain(wild) {
        let found = one.closest(&ray);
        let bits = |hit: Option<Hit>| hit.map(|hit| (hit.t.to_bits(), hit.primitive));
        assert_eq!(bits(found), bits(other.closest(&ray)), "{ray:?}");
        assert_eq!(found.is_some(), one.occluded(&ray), "{ray:?}");
        if let Some(hit) = found {
            assert!(hit.t > ray.tmin && hit.t < ray.tmax, "{hit:?} of {ray:?}");
            let point = one.surface(&ray, &hit);
            assert!(point.position.is_finite() && point.error.is_finite() && point.normal.is_normalized(), "{point:?}");
        }
    }
}
