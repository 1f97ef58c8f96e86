//! The bundled scenes as the reader finds them.

use dapple_scene::bundled::{DEFAULT, files, names};
use dapple_scene::{Geometry, MaterialKind};
use std::collections::{BTreeMap, BTreeSet};

fn checksum(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x100_0000_01b3))
}

/// Jobs and results name bundled scenes, so that their bytes do not change.
#[test]
fn bundles_are_known_by_name_and_hold_the_files_of_the_table() {
    assert_eq!(names()[0], DEFAULT);
    let mut found = String::new();
    for name in names() {
        let bundle = files(name).unwrap();
        assert_eq!((bundle.name, bundle.main.as_str()), (*name, "scene.pbrt"));
        assert_eq!(bundle.file(&bundle.main), Some(bundle.files[0].1.as_slice()));
        let sums = bundle.files.iter().map(|(file, bytes)| format!("{:016x} {name}/{file}\n", checksum(bytes)));
        found.extend(sums);
    }
    // FNV-1a, 64 bits, in the order of the bundles.
    assert_eq!(found, include_str!("../scenes/checksums.txt"));
    assert_eq!((files("Teapot"), files("")), (None, None));
}

#[test]
fn every_bundle_reads_and_says_what_its_text_says() {
    // Shapes within objects are not counted.
    for (name, shapes, lights, emitters) in [
        ("teapot", 2, 1, 0),
        ("terrain", 5, 1, 1),
        ("cornell", 8, 0, 1),
        ("furnace", 1, 0, 1),
        ("plates", 9, 1, 4),
        ("lens", 20, 1, 13),
        ("motion", 5, 1, 1),
        ("glass", 9, 1, 1),
        ("door", 15, 0, 1),
        ("tea", 15, 0, 2),
        ("cabin", 84, 1, 76),
        ("many-lights", 10_004, 0, 10_000),
        ("caustic", 3, 1, 1),
        ("chess", 3, 1, 1),
        ("zone-plate", 1, 1, 0),
        ("penumbra", 3, 0, 1),
    ] {
        let scene = files(name).unwrap().read().unwrap();
        assert_eq!(scene.name, name);
        assert_eq!((scene.shapes.len(), scene.lights.len()), (shapes, lights), "{name}");
        assert_eq!(scene.shapes.iter().filter(|shape| shape.emission.is_some()).count(), emitters, "{name}");
        // A left-handed camera on right-handed data mirrors; the furnace has no handedness to keep.
        assert_eq!(scene.camera.to_world.matrix3.determinant() < 0.0, name != "furnace", "{name}");
        assert!(
            scene.notices.iter().all(|notice| notice.message.starts_with("Sampler")),
            "{name}: {:?}",
            scene.notices
        );
    }
}

/// Glass, tea and the tea's surface meet in one ring of points, so that no ray slips between them.
#[test]
fn the_glass_of_tea_is_closed() {
    let scene = files("tea").unwrap().read().unwrap();
    let meshes: Vec<_> = scene
        .shapes
        .iter()
        .filter(|shape| matches!(scene.materials[shape.material.0 as usize].kind, MaterialKind::Dielectric { .. }))
        .map(|shape| match &shape.geometry {
            Geometry::Mesh(mesh) => mesh.clone(),
            other => panic!("{other:?}"),
        })
        .collect();
    assert_eq!(meshes.len(), 3);
    let rims = meshes.iter().map(|mesh| {
        let edges = mesh.triangles.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]);
        let mut open: BTreeMap<(u32, u32), i32> = BTreeMap::new();
        for (a, b) in edges {
            *open.entry((a.min(b), a.max(b))).or_default() += 1;
        }
        let open = open.into_iter().filter(|(_, uses)| *uses == 1).flat_map(|((a, b), _)| [a, b]);
        let point = |corner: u32| mesh.positions[corner as usize].to_array().map(f64::to_bits);
        open.map(point).collect::<BTreeSet<[u64; 3]>>()
    });
    let rims: Vec<_> = rims.collect();
    assert!(rims[0].len() > 100 && rims[0] == rims[1] && rims[1] == rims[2], "{:?}", [0, 1, 2].map(|i| rims[i].len()));
}

#[test]
fn a_bundle_without_one_of_its_files_does_not_read() {
    let mut bundle = files("teapot").unwrap();
    bundle.files.retain(|(file, _)| file != "studio.pfm");
    assert!(bundle.read().is_err());
}

#[test]
fn terrains_sun_shines_on_the_ground_and_the_furnace_inwards() {
    let scene = files("terrain").unwrap().read().unwrap();
    let sun = scene.shapes.iter().find(|shape| shape.emission.is_some()).unwrap();
    let (centre, facing) = (sun.to_world.translation, sun.to_world.matrix3.z_axis.normalize());
    let towards = (glam::dvec3(0.0, 8.0, 0.0) - centre).normalize();
    assert!(facing.dot(towards) > 0.999_999, "the sun faces {facing}, the ground lies towards {towards}");
    assert!((centre.distance(glam::dvec3(0.0, 8.0, 0.0)) - 60.0).abs() < 1e-9 && centre.z > 20.0);
    let scene = files("furnace").unwrap().read().unwrap();
    assert!(scene.shapes[0].reversed && !scene.shapes[0].emission.unwrap().two_sided);
}
