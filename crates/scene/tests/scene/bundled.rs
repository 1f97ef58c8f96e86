//! The bundled scenes as the reader finds them.

use dapple_scene::bundled::{DEFAULT, files, names};
use dapple_scene::{Geometry, MaterialKind};
use std::collections::{BTreeMap, BTreeSet};

/// Each bundled file with its checksum (FNV-1a, 64 bits), in the order of the bundles.
const CHECKSUMS: [(&str, u64); 27] = [
    ("teapot/scene.pbrt", 0xdee0_4eaf_d319_eb4e),
    ("teapot/teapot.ply", 0x707e_f892_5443_feeb),
    ("teapot/studio.pfm", 0xe8d5_30b0_f235_28db),
    ("teapot/tiles.tga", 0xbd38_7ecf_678f_9c32),
    ("terrain/scene.pbrt", 0x6697_e684_9718_599e),
    ("terrain/grass.ply", 0x846d_03ce_f8d4_abe7),
    ("terrain/rock.ply", 0x731c_5328_5a00_6790),
    ("terrain/snow.ply", 0x69ba_88f8_2a64_21d1),
    ("terrain/sky.pfm", 0x4360_fe4b_2d15_f8e0),
    ("cornell/scene.pbrt", 0xe897_69f0_9ce3_d6dc),
    ("furnace/scene.pbrt", 0xa845_4f65_7c66_c136),
    ("plates/scene.pbrt", 0x2e21_b5af_7875_ec1b),
    ("lens/scene.pbrt", 0xcca6_8dfe_7ad5_6e42),
    ("motion/scene.pbrt", 0x8486_c8e7_2c05_01ec),
    ("glass/scene.pbrt", 0x3515_7ea0_d2e8_d9ef),
    ("glass/leaf.tga", 0x1926_1452_88a6_2dce),
    ("room/scene.pbrt", 0x9a6f_39ec_705f_501f),
    ("grass/scene.pbrt", 0x4346_fc4a_4541_446f),
    ("door/scene.pbrt", 0x72ae_1b4e_e643_1eb0),
    ("tea/scene.pbrt", 0x58bc_b7c2_0a38_4f55),
    ("cabin/scene.pbrt", 0xcdaa_ba65_7e4c_e0a2),
    ("many-lights/scene.pbrt", 0xf86c_a9a4_fb3d_c4b1),
    ("caustic/scene.pbrt", 0x1797_6459_9fa9_9d2f),
    ("chess/scene.pbrt", 0xb45a_e67b_088c_c9e5),
    ("zone-plate/scene.pbrt", 0xaac4_906d_9b0f_3d86),
    ("zone-plate/rings.tga", 0x9b8d_c0aa_a602_2c1e),
    ("penumbra/scene.pbrt", 0xef88_dca0_bb74_ff67),
];

fn checksum(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x100_0000_01b3))
}

/// Jobs and results name bundled scenes, so that their bytes do not change.
#[test]
fn bundles_are_known_by_name_and_hold_the_files_of_the_table() {
    assert_eq!(names()[0], DEFAULT);
    let mut found = Vec::new();
    for name in names() {
        let bundle = files(name).unwrap();
        assert_eq!((bundle.name, bundle.main.as_str()), (*name, "scene.pbrt"));
        assert_eq!(bundle.file(&bundle.main), Some(bundle.files[0].1.as_slice()));
        found.extend(bundle.files.iter().map(|(file, bytes)| (format!("{name}/{file}"), checksum(bytes))));
    }
    assert_eq!(found, CHECKSUMS.map(|(file, sum)| (file.to_owned(), sum)));
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
