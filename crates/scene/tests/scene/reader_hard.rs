//! Files that are truncated, inconsistent or noise.

use dapple_scene::Scene;
use dapple_scene::model::read_ply;
use dapple_scene::pbrt::{ReadOptions, read_scene_from};
use proptest::prelude::*;
use std::collections::BTreeMap;
use std::path::PathBuf;

const SMALL: &str = include_str!("../scenes/small.pbrt");

fn read(text: &[u8]) -> Result<Scene, String> {
    let files: &[(&str, &[u8])] = &[("s.pbrt", text)];
    read_scene_from(files, "s.pbrt", &ReadOptions::default()).map_err(|e| e.to_string())
}

/// The scene's blocks close in its last line, so every cut is noticed; a cut of only the last line break
/// leaves the same scene.
#[test]
fn truncated_scenes_are_errors_or_noticed_i02() {
    let whole = format!("{:?}", read(SMALL.as_bytes()).unwrap().shapes);
    for end in 0..SMALL.len() {
        match read(&SMALL.as_bytes()[..end]) {
            Err(_) => {}
            Ok(scene) => {
                assert_eq!(end, SMALL.len() - 1, "cut at byte {end}");
                assert_eq!(format!("{:?}", scene.shapes), whole);
                assert!(scene.notices.iter().any(|n| n.message.contains("no line break")));
            }
        }
    }
}

/// Without blocks around it, a cut between two lines leaves a shorter scene that nothing tells from one
/// that was meant; any other cut is an error or leaves a notice.
#[test]
fn truncated_scenes_without_blocks_are_errors_or_noticed_i02() {
    let text = "Film \"rgb\"\nCamera \"perspective\"\nWorldBegin\nLightSource \"infinite\"\nShape \"sphere\"\nTranslate 0 0 123\nShape \"disk\"\n";
    for end in 0..text.len() {
        if let Ok(scene) = read(&text.as_bytes()[..end])
            && !text[..end].ends_with('\n')
        {
            assert!(scene.notices.iter().any(|n| n.message.contains("no line break")), "cut at byte {end}");
        }
    }
}

fn ply(format: &str, body: &[u8]) -> Vec<u8> {
    let header = format!(
        "ply\nformat {format} 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nproperty float s\nproperty float t\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
    );
    [header.as_bytes(), body].concat()
}

const CORNERS: [[f32; 5]; 4] =
    [[0.0, 0.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 1.0, 0.0], [1.0, 1.0, 0.0, 1.0, 1.0], [0.0, 1.0, 0.0, 0.0, 1.0]];

fn binary(order: fn(u32) -> [u8; 4]) -> Vec<u8> {
    let vertices = CORNERS.iter().flatten().flat_map(|v| order(v.to_bits()));
    vertices.chain([4]).chain((0..4).flat_map(order)).collect()
}

fn samples() -> [Vec<u8>; 3] {
    let ascii = "0 0 0 0 0\n1 0 0 1 0\n1 1 0 1 1\n0 1 0 0 1\n4 0 1 2 3\n";
    [
        ply("ascii", ascii.as_bytes()),
        ply("binary_little_endian", &binary(u32::to_le_bytes)),
        ply("binary_big_endian", &binary(u32::to_be_bytes)),
    ]
}

#[test]
fn meshes_in_three_encodings() {
    for bytes in samples() {
        let mesh = read_ply(&bytes).unwrap();
        assert_eq!(mesh.data.triangles, [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(mesh.data.positions[2], glam::dvec3(1.0, 1.0, 0.0));
        assert_eq!(mesh.data.uvs[1], [1.0, 0.0]);
        assert!(mesh.data.normals.is_empty() && mesh.doubt.is_none());
    }
}

#[test]
fn truncated_meshes_are_errors_i02() {
    for bytes in samples() {
        let whole = read_ply(&bytes).unwrap().data;
        for end in 0..bytes.len() {
            // The last digit of an ascii file may be cut off: that is doubted, since nobody can tell.
            if let Ok(mesh) = read_ply(&bytes[..end]) {
                assert!(mesh.doubt.is_some() || mesh.data == whole, "cut at byte {end}");
            }
        }
    }
}

#[test]
fn false_mesh_headers_are_errors_i03() {
    let lie =
        |element: &str| format!("ply\nformat binary_little_endian 1.0\n{element}end_header\nabcdefgh").into_bytes();
    let vertices = "property float x\nproperty float y\nproperty float z\n";
    for element in [
        format!("element vertex 4294967295\n{vertices}"),
        format!("element vertex 18446744073709551615\n{vertices}"),
        "element nothing 4294967295\n".to_owned(),
        "element face 4294967295\nproperty list uchar int vertex_indices\n".to_owned(),
    ] {
        let error = read_ply(&lie(&element)).unwrap_err().to_string();
        assert!(
            error.starts_with("the header declares ") && error.contains("only 8 bytes follow"),
            "{element}: {error}"
        );
    }
    let list = "element face 1\nproperty list uint int vertex_indices\n";
    let mut bytes = lie(list);
    bytes.truncate(bytes.len() - 8);
    bytes.extend([0xff; 8]);
    let error = read_ply(&bytes).unwrap_err().to_string();
    assert!(error.starts_with("face 0 cannot be read ("), "{error}");
}

#[test]
fn names_declared_twice_are_refused() {
    let text = String::from_utf8(samples()[0].clone()).unwrap();
    let twice = text.replace("property float y\n", "property float y\nproperty float y\n");
    let error = read_ply(twice.as_bytes()).unwrap_err().to_string();
    assert!(error.starts_with("line 6: the PLY header cannot be read ("), "{error}");
}

#[test]
fn deep_nesting_is_an_error_i03() {
    let deep = format!("Camera \"perspective\"\nWorldBegin\n{}", "AttributeBegin\n".repeat(1_000_000));
    let error = read(deep.as_bytes()).unwrap_err();
    assert_eq!(error, "s.pbrt:4099: blocks are nested too deep; at most 4096 may be open; the rest is not read");
    let brackets = format!("Shape \"sphere\" \"float radius\" {}", "[".repeat(1_000_000));
    assert!(read(brackets.as_bytes()).is_err());
}

#[test]
fn endless_includes_are_errors_i03() {
    let name = |i: usize| PathBuf::from(format!("{i}.pbrt"));
    // Each file includes the next one often: 10^40 files in all.
    let text = |i: usize| format!("Include \"{}.pbrt\"\n", i + 1).repeat(10).into_bytes();
    let mut files: BTreeMap<PathBuf, Vec<u8>> = (0..20).map(|i| (name(i), text(i))).collect();
    files.insert(name(20), b"# empty\n".to_vec());
    let error = read_scene_from(&files, "0.pbrt", &ReadOptions::default()).unwrap_err();
    assert!(error.to_string().contains("more than 10000 files are included"));
    let mut files: BTreeMap<PathBuf, Vec<u8>> =
        (0..100).map(|i| (name(i), format!("Include \"{}.pbrt\"\n", i + 1).into_bytes())).collect();
    files.insert(name(100), Vec::new());
    let error = read_scene_from(&files, "0.pbrt", &ReadOptions::default()).unwrap_err();
    assert!(error.to_string().contains("includes are nested too deep"), "{error}");
}

#[test]
fn invalid_faces_are_errors_with_their_number_i05() {
    let faces = |positions: &str, faces: &str| {
        let count = |text: &str| text.lines().count();
        let text = format!(
            "ply\nformat ascii 1.0\nelement vertex {}\nproperty double x\nproperty double y\nproperty double z\nelement face {}\nproperty list uchar int vertex_index\nend_header\n{positions}{faces}",
            count(positions),
            count(faces)
        );
        read_ply(text.as_bytes()).map(|m| m.data.triangles).map_err(|e| e.to_string())
    };
    let square = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n";
    assert_eq!(faces(square, "3 0 1 1\n").unwrap(), [[0, 1, 1]]);
    assert_eq!(
        faces(square, "3 0 1 4\n").unwrap_err(),
        "face 0: vertex index 4 is too large; indices must be below 4, the number of vertices"
    );
    assert_eq!(
        faces(square, "3 0 1 2\n3 0 1 -1\n").unwrap_err(),
        "face 1: vertex index -1 is negative; indices start at 0"
    );
    assert_eq!(faces(square, "2 0 1\n").unwrap_err(), "face 0: a face needs 3 corners or more, not 2; remove it");
    assert_eq!(faces(square, "").unwrap_err(), "the mesh has no triangles; remove it");
    assert!(faces("0 0 0\n1 0 0\nnan 1 0\n", "3 0 1 2\n").is_err());
    // A dart: only a fan around its notch or its tip covers it.
    assert_eq!(faces("0 0 0\n4 4 0\n0 1 0\n-4 4 0\n", "4 1 2 3 0\n").unwrap(), [[2, 3, 0], [2, 0, 1]]);
}

/// Tokens of the format, and some foreign ones.
const WORDS: &str = r#"
Shape|"sphere"|"trianglemesh"|"point3 P"|"integer indices"|[|]|0|1|-2.5e3|"float radius"|WorldBegin|Camera|
"perspective"|AttributeBegin|AttributeEnd|Material|"diffuse"|"rgb reflectance"|"texture reflectance"|"t"|
Texture|"spectrum"|"scale"|"checkerboard"|"constant"|"texture tex"|Transform|LookAt|Translate|Scale|nan|true|
"|#||Include|"s.pbrt"|Attribute|"shape"|ObjectBegin|ObjectEnd|LightSource|"infinite"|"rgb L"|
AreaLightSource|"blackbody L"|Film|"rgb"|"integer xresolution"|MakeNamedMaterial|NamedMaterial|"string type"|
"conductor"|"spectrum eta"|"metal-Cu-eta"|CoordSysTransform|"camera"|TransformBegin|TransformEnd|Sampler|
Option|MediumInterface|MakeNamedMedium|"homogeneous"|ObjectInstance|ActiveTransform|EndTime|TransformTimes|
"matte"|"color Kd"|"mix"|"string materials"|"loopsubdiv"|"bilinearmesh"|"cylinder"|"float power"|"spot"|
"distant"|"texture alpha"|"float"|"spectrum L"|WorldEnd|Renderer|"orthographic"|4000"#;

fn any_words() -> impl Strategy<Value = String> {
    let words: Vec<&str> = WORDS.split('|').chain(["\n"]).collect();
    prop::collection::vec(prop::sample::select(words), 0..120).prop_map(|words| words.join(" "))
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn noise_never_panics_i01(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        let _ = read(&bytes);
        let _ = read_ply(&bytes);
    }

    #[test]
    fn random_directives_never_panic_i01(words in any_words(), allow in any::<bool>()) {
        let text = format!("Camera \"perspective\"\nWorldBegin\n{words}");
        let files: &[(&str, &[u8])] = &[("s.pbrt", text.as_bytes())];
        let options = ReadOptions { allow_unsupported: allow, memory: None };
        let _ = read_scene_from(files, "s.pbrt", &options);
    }

    /// The same without the words that make it a scene of pbrt-v4.
    #[test]
    fn random_old_directives_never_panic_i01(words in any_words(), second in any::<bool>()) {
        let mark = if second { "Renderer \"sampler\"" } else { "Integrator \"path\"" };
        let text = format!("{mark} Film \"image\" Camera \"perspective\"\nWorldBegin\n{words}");
        let _ = read(text.as_bytes());
    }

    #[test]
    fn flipped_bits_never_panic_i02(at in 0usize..SMALL.len(), bit in 0u32..8, which in 0usize..3) {
        let mut text = SMALL.as_bytes().to_vec();
        text[at] ^= 1 << bit;
        let _ = read(&text);
        let mut mesh = samples()[which].clone();
        let at = at % mesh.len();
        mesh[at] ^= 1 << bit;
        let _ = read_ply(&mesh);
    }
}

#[test]
fn normals_that_are_not_finite_give_way_to_the_faces_own_i04() {
    let normals = "property float nx\nproperty float ny\nproperty float nz\n";
    let text = format!(
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n{normals}element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0 nan 0 1\n1 0 0 0 0 1\n0 1 0 inf 0 0\n3 0 1 2\n"
    );
    let mesh = read_ply(text.as_bytes()).unwrap();
    assert_eq!(mesh.data.normals, [[0.0; 3], [0.0, 0.0, 1.0], [0.0; 3]]);
    assert_eq!(mesh.doubt.unwrap(), "2 normals are not finite; face normals are used instead");
}
