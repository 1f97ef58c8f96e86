//! The corpus of `tests/corpus`: every reader reads every file to its right value.

#[path = "../../../../tests/corpus/mod.rs"]
pub(crate) mod files;

use dapple_scene::image::{Encoding, read_image};
use dapple_scene::{AnyOptions, Color, Geometry, MaterialKind, Scene, read_any_from};
use files::{Case, cases};
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

/// The value of a file in words, as the corpus has it.
fn value(case: &Case) -> String {
    let (name, bytes) = &case.files[0];
    if case.target == "image" {
        let image = read_image(bytes, name, Encoding::Auto).unwrap_or_else(|e| panic!("{}: {e}", case.name));
        let in_order = image.pixels.iter().zip(16_u8..).all(|(pixel, red)| pixel[0] == f32::from(red));
        let order = if in_order { "in order" } else { "in another order" };
        return format!("{}x{} pixels {order}", image.size[0], image.size[1]);
    }
    let files: BTreeMap<PathBuf, Vec<u8>> =
        case.files.iter().map(|(name, bytes)| (name.into(), bytes.clone())).collect();
    match read_any_from(&files, name, &AnyOptions::default()) {
        Ok(scene) => of_scene(&scene, case.target == "gltf"),
        Err(e) if case.right == "UTF-16" && e.to_string().contains("this text is in UTF-16") => "UTF-16".into(),
        Err(e) => e.to_string(),
    }
}

fn of_scene(scene: &Scene, is_gltf: bool) -> String {
    let (mut count, mut area, mut colors) = (0, 0.0, BTreeSet::new());
    for shape in &scene.shapes {
        let Geometry::Mesh(mesh) = &shape.geometry else { continue };
        count += mesh.triangles.len();
        for triangle in &mesh.triangles {
            let [a, b, c] = triangle.map(|corner| shape.to_world.transform_point3(mesh.positions[corner as usize]));
            area += 0.5 * (b - a).cross(c - a).length();
        }
        if let MaterialKind::Diffuse { reflectance: Color::Constant([r, g, b]) } =
            scene.materials[shape.material.0 as usize].kind
            && !is_gltf
        {
            colors.insert(format!(", colour {r} {g} {b}"));
        }
    }
    let triangles = if count == 1 { "triangle" } else { "triangles" };
    let notices = match scene.notices.len() {
        0 => String::new(),
        1 => ", 1 notice".into(),
        _ => format!(", {:?}", scene.notices),
    };
    format!("{count} {triangles}, area {area}{}{notices}", String::from_iter(colors))
}

#[test]
fn every_file_of_the_corpus_is_read_to_its_right_value() {
    let cases = cases();
    let wrong = cases.iter().map(|case| (case, value(case))).filter(|(case, found)| found != case.right);
    let shown = |(case, found): (&Case, String)| {
        let files = case.files.iter().map(|(name, bytes)| format!("\n  {name}: {:?}", String::from_utf8_lossy(bytes)));
        format!("{}: {found}, not {}{}", case.name, case.right, files.collect::<String>())
    };
    let wrong: Vec<String> = wrong.map(shown).collect();
    assert!(wrong.is_empty(), "{} of {}:\n{}", wrong.len(), cases.len(), wrong.join("\n"));
}

#[test]
fn the_corpus_is_the_same_everywhere_and_has_every_variation() {
    let cases = cases();
    let names: BTreeSet<&str> = cases.iter().map(|case| &*case.name).collect();
    assert_eq!((cases.len(), names.len()), (346, 346));
    // FNV-1a of all files.
    let bytes = cases.iter().flat_map(|case| &case.files).flat_map(|(name, bytes)| name.as_bytes().iter().chain(bytes));
    let hash =
        bytes.fold(0xcbf2_9ce4_8422_2325_u64, |hash, &byte| (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3));
    assert_eq!(hash, 0x7d71_ce4e_db22_c9db, "{hash:#x}");
    for target in ["obj", "ply", "stl", "gltf", "scene"] {
        let texts = || cases.iter().filter(|c| c.target == target && c.right != "UTF-16").map(|c| &c.files[0].1);
        let of = |has: &dyn Fn(&[u8]) -> bool| texts().filter(|bytes| has(bytes)).count();
        let holds = |part: &'static [u8]| move |bytes: &[u8]| bytes.windows(part.len()).any(|window| window == part);
        let marked = of(&|bytes| bytes.starts_with(b"\xef\xbb\xbf"));
        let [crlf, latin, utf_8] = [&b"\r\n"[..], b"f\xe9", b"f\xc3\xa9"].map(|part| of(&holds(part)));
        let cr = of(&|bytes| bytes.contains(&b'\r') && !holds(b"\r\n")(bytes));
        let lf = of(&|bytes| !bytes.contains(&b'\r'));
        let counts = [marked, texts().count() - marked, crlf, cr, lf, latin, utf_8];
        assert!(counts.iter().all(|&count| count > 6), "{target}: {counts:?}");
    }
}

/// Writes the corpus for `cargo fuzz` if `DAPPLE_WRITE_CORPUS` names a folder: a folder for each target.
#[test]
fn the_corpus_is_written_where_fuzzers_want_it() {
    let Some(folder) = std::env::var_os("DAPPLE_WRITE_CORPUS") else { return };
    for case in cases() {
        // The fuzz target of OBJ files reads MTL files, too.
        let folder = PathBuf::from(&folder).join(case.target);
        std::fs::create_dir_all(&folder).unwrap();
        for (name, bytes) in case.files {
            std::fs::write(folder.join(format!("{}-{name}", case.name)), bytes).unwrap();
        }
    }
}
