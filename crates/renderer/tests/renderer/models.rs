//! Models by themselves: what is read, and what is refused with which words.

#![allow(clippy::print_stderr)] // What is skipped, and what each file holds, is told.

use dapple_core::{Frame, Limits, Render};
use dapple_geometry::{Geometry as Tree, Mesh, Preset, Ray, Shape};
use dapple_renderer::model::{ModelOptions, UpAxis, read_model_from, read_obj, read_stl};
use dapple_renderer::pbrt::ReadError;
use dapple_renderer::registry::{self, Setting};
use dapple_renderer::scene::{Color, Geometry, MaterialKind, MeshData, Scene, TextureKind};
use dapple_renderer::{AnyOptions, Stage, World, integrator, read_any, read_any_from};
use glam::DVec3;
use rand::{RngExt, SeedableRng};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

const TETRAHEDRON: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";

fn files(named: &[(&str, &[u8])]) -> BTreeMap<PathBuf, Vec<u8>> {
    named.iter().map(|(name, bytes)| (PathBuf::from(name), bytes.to_vec())).collect()
}

fn read(named: &[(&str, &[u8])]) -> Result<Scene, ReadError> {
    read_model_from(&files(named), named[0].0, &ModelOptions::default())
}

fn mesh(scene: &Scene, shape: usize) -> &MeshData {
    match &scene.shapes[shape].geometry {
        Geometry::Mesh(mesh) => mesh,
        other => panic!("{other:?}"),
    }
}

fn reflectance(scene: &Scene, shape: usize) -> Color {
    match scene.materials[scene.shapes[shape].material.0 as usize].kind {
        MaterialKind::Diffuse { reflectance } => reflectance,
        ref other => panic!("{other:?}"),
    }
}

/// A binary STL file of these facets.
fn binary_stl(header: &[u8; 80], facets: &[[[f32; 3]; 3]]) -> Vec<u8> {
    let mut bytes = header.to_vec();
    bytes.extend((facets.len() as u32).to_le_bytes());
    for facet in facets {
        bytes.extend([0; 12]);
        bytes.extend(facet.as_flattened().iter().flat_map(|c| c.to_le_bytes()));
        bytes.extend([0; 2]);
    }
    bytes
}

const FACETS: [[[f32; 3]; 3]; 2] =
    [[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], [[1.0, 0.0, 0.0], [1.0, 1.0, 0.5], [-0.0, 1.0, 0.0]]];

const TEXT_STL: &str = "solid first\n facet normal 0 0 1\n  outer loop\n   vertex 0 0 0\n   vertex 1 0 0\n   vertex 0 1 0\n  endloop\n endfacet\nendsolid first\nSOLID SECOND\n\nFACET NORMAL 0 0 1\nOUTER LOOP\nVERTEX 1 0 0\nVERTEX 1E0 1 0.5\nVERTEX 0 1 0\nENDLOOP\nENDFACET\nENDSOLID\n";

#[test]
fn a_model_alone_is_a_scene_that_can_be_built() {
    let plate = b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
    let binary = binary_stl(&[0; 80], &FACETS);
    for (name, bytes) in
        [("a/Model.OBJ", TETRAHEDRON.as_bytes()), ("m.ply", plate), ("m.stl", TEXT_STL.as_bytes()), ("M.Stl", &binary)]
    {
        let scene = read(&[(name, bytes)]).unwrap();
        assert!(scene.name.eq_ignore_ascii_case("model") || scene.name.eq_ignore_ascii_case("m"));
        assert_eq!((scene.shapes.len(), scene.lights.len(), scene.notices.len()), (1, 1, 0), "{name}");
        assert!(mesh(&scene, 0).normals.is_empty());
        World::with_resolution(&scene, [8, 8]).unwrap();
    }
}

#[test]
fn the_up_axis_is_ys_or_zs_and_can_be_chosen() {
    let height = |name: &str, bytes: &[u8], options: ModelOptions| {
        let scene = read_model_from(&files(&[(name, bytes)]), name, &options).unwrap();
        let up = scene.camera.to_world.matrix3.y_axis;
        if up.y > up.z { 'y' } else { 'z' }
    };
    let default = ModelOptions::default();
    assert_eq!(height("m.obj", TETRAHEDRON.as_bytes(), default), 'y');
    assert_eq!(height("m.stl", TEXT_STL.as_bytes(), default), 'z');
    assert_eq!(height("m.obj", TETRAHEDRON.as_bytes(), default.with_up(UpAxis::Z)), 'z');
}

#[test]
fn stl_text_and_binary_agree_whatever_the_header_says() {
    let text = read_stl(TEXT_STL.as_bytes()).unwrap();
    assert_eq!((text.data.triangles.len(), text.data.positions.len()), (2, 4), "two solids, shared corners");
    let mut solid = [b' '; 80];
    solid[..5].copy_from_slice(b"solid");
    for header in [[0; 80], solid] {
        let binary = read_stl(&binary_stl(&header, &FACETS)).unwrap();
        assert_eq!((binary.data, binary.doubt), (text.data.clone(), None));
    }
    let extra = [binary_stl(&solid, &FACETS), vec![0; 7]].concat();
    assert!(read_stl(&extra).unwrap().doubt.unwrap().contains("7 bytes"));
}

#[test]
fn i05_obj_corners() {
    let faces = |text: &str| read_obj(format!("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n{text}").as_bytes());
    let corners = |text: &str| {
        let model = faces(text).unwrap();
        let data = &model.meshes[0].data;
        let at = |c: &u32| data.positions[*c as usize].truncate().to_array();
        data.triangles.iter().flatten().map(at).collect::<Vec<_>>()
    };
    let triangle = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]];
    for text in [
        "f 1 2 3",
        "f -4 -3 -2 # behind",
        "f 1// 2// 3//\n",
        "f \\\n 1 2 \\\r\n3\r\n",
        "vn 0 0 1\nf 1//1 2//-1 3//1",
        "l 1 2 3 4\nf 1 2 3\np 1",
    ] {
        assert_eq!(corners(text), triangle, "{text}");
    }
    assert_eq!(corners("f 1 2 3 4").len(), 6);
    // Faces before their vertices, and texture coordinates for some only.
    let model = read_obj(b"f 1 2 3\nvt 0 1\nf 1/1 2/1 3/1\nf 1/1 2/1 3\nv 0 0 0\nv 1 0 0\nv 0 1 0\n").unwrap();
    let uvs: Vec<usize> = model.meshes.iter().map(|m| m.data.uvs.len()).collect();
    assert_eq!((uvs, model.meshes[0].data.triangles.len()), (vec![0, 3], 2));
    for (text, what) in [
        ("f 1 2 0", "count from 1"),
        ("f 1 2 5", "only 4 vertices"),
        ("f 1 2 -5", "only 4 vertices so far"),
        ("f 1 2 2147483648", "only 4 vertices"),
        ("f 1 2 99999999999999999999", "is no number"),
        ("f 1/7 2/7 3/7", "only 0 texture coordinates"),
        ("f 1//-9223372036854775808 2 3", "only 0 normals so far"),
        ("f 1/1/1/1 2 3", "more than three"),
        ("f //1 2 3", "has no vertex"),
        ("f 1 2", "3 corners or more, not 2"),
        ("f 1 2 x", "'x' is no number"),
    ] {
        let message = faces(text).unwrap_err().to_string();
        assert!(message.starts_with("line 5: ") && message.contains(what), "{text}: {message}");
    }
    assert!(faces("").unwrap_err().to_string().contains("no faces"));
}

#[test]
fn i04_numbers_of_models() {
    for (line, what) in [
        ("v nan 0 0", "not finite"),
        ("v 0 inf 0", "not finite"),
        ("v 1e400 0 0", "not finite"),
        ("vn 1e39 0 0", "not finite"),
        ("vt nan", "not finite"),
        ("v 1,5 0 0", "'1,5' is no number"),
        ("v 0x10 0 0", "is no number"),
        ("v 1 2", "needs 3 numbers, not 2"),
        ("vt", "needs 2 numbers"),
    ] {
        let message = read(&[("bad.obj", format!("{TETRAHEDRON}{line}\n").as_bytes())]).unwrap_err().to_string();
        assert!(message.starts_with("bad.obj:9: ") && message.contains(what), "{line}: {message}");
    }
    let digits = format!("v 0.1{} 0 0\n{TETRAHEDRON}", "0".repeat(1000));
    assert_eq!(read_obj(digits.replace("f 1 3 2", "f 1 4 2").as_bytes()).unwrap().meshes[0].data.positions[0].x, 0.1);
    let mut facets = FACETS;
    facets[1][2][0] = f32::NAN;
    let message = read(&[("bad.stl", &binary_stl(&[0; 80], &facets))]).unwrap_err().to_string();
    assert_eq!(message, "bad.stl: facet 1: a corner is not finite: mend the mesh");
    let message = read(&[("bad.stl", TEXT_STL.replace("1E0", "nan").as_bytes())]).unwrap_err().to_string();
    assert!(message.starts_with("bad.stl:12: "), "{message}");
    // Too far apart to be seen, and nothing to be seen.
    let far = TETRAHEDRON.replace("v 1 0 0", "v 1e308 0 0").replace("v 0 1 0", "v -1e308 0 0");
    assert!(read(&[("far.obj", far.as_bytes())]).unwrap_err().to_string().contains("too large"));
    let point = "v 1 1 1\nf 1 1 1\n";
    assert!(read(&[("point.obj", point.as_bytes())]).unwrap_err().to_string().contains("one point"));
}

#[test]
fn materials_of_obj_files() {
    let obj = format!(
        "mtllib m.mtl\n{}usemtl odd\nf 1 2 3\nusemtl\nf 1 2 3\n",
        TETRAHEDRON.replace("f 1 2 4", "usemtl red\nf 1 2 4").replace("f 1 4 3", "usemtl wood\nf 1 4 3")
    );
    let mtl = "newmtl red\nKd 1 0 0\nKs 1 1 1\nnewmtl wood\nKd 0.5 0.5 0.5\nmap_Kd tex\\wood.pfm\n";
    let pfm = b"PF\n1 1\n-1.0\n\0\0\0\x3f\0\0\0\x3f\0\0\0\x3f";
    let scene = read(&[("d/a.obj", obj.as_bytes()), ("d/m.mtl", mtl.as_bytes()), ("d/tex/wood.pfm", pfm)]).unwrap();
    let colors: Vec<Color> = (0..4).map(|shape| reflectance(&scene, shape)).collect();
    assert_eq!([colors[0], colors[1], colors[3]], [[0.5; 3], [1.0, 0.0, 0.0], [0.5; 3]].map(Color::Constant));
    let Color::Texture(id) = colors[2] else { panic!("{:?}", colors[2]) };
    assert!(matches!(scene.textures[id.0 as usize].kind, TextureKind::Image { factor: 0.5, .. }));
    let notices: Vec<String> = scene.notices.iter().map(|n| format!("{}: {}", n.source, n.message)).collect();
    assert!(notices[0].starts_with("d/m.mtl: ") && notices[0].contains("Ks not followed"), "{notices:?}");
    assert_eq!(notices[1], "d/a.obj:12: there is no material 'odd': grey instead");
    // Nothing but the model: grey, and said.
    let alone = read(&[("d/a.obj", obj.as_bytes())]).unwrap();
    assert!(alone.notices[0].message.contains("d/m.mtl cannot be read"), "{:?}", alone.notices);
    assert!((0..4).all(|shape| reflectance(&alone, shape) == Color::Constant([0.5; 3])));
    let untextured = read(&[("d/a.obj", obj.as_bytes()), ("d/m.mtl", mtl.as_bytes())]).unwrap();
    assert!(untextured.notices.iter().any(|n| n.message.contains("Kd stands for it")));
}

#[test]
fn i02_models_cut_at_any_byte() {
    // A cut behind a whole facet or face leaves a shorter mesh that nothing tells from one that was meant in OBJ
    // files; STL files tell.
    let stl = TEXT_STL.as_bytes();
    let ends: Vec<usize> = TEXT_STL.match_indices("endsolid").map(|(at, _)| at + 8).collect();
    for end in 0..stl.len() {
        if let Ok(found) = read_stl(&stl[..end]) {
            let first = (ends[0]..=TEXT_STL.find("SOLID").unwrap()).contains(&end);
            assert!(found.data.triangles.len() == 2 || first, "cut at byte {end}");
        }
    }
    let binary = binary_stl(&[0; 80], &FACETS);
    for end in 0..binary.len() {
        assert!(read_stl(&binary[..end]).is_err(), "cut at byte {end}");
    }
    let mut random = rand_pcg::Pcg64::seed_from_u64(4);
    for sample in [stl, &binary, TETRAHEDRON.as_bytes()] {
        for _ in 0..4000 {
            let mut bytes = sample.to_vec();
            for _ in 0..random.random_range(1..4) {
                let at = random.random_range(0..bytes.len());
                bytes[at] ^= 1 << random.random_range(0..8);
            }
            let (obj, stl) = (read_obj(&bytes).is_ok(), read_stl(&bytes));
            assert!(!obj || sample == TETRAHEDRON.as_bytes());
            if let Ok(mesh) = stl {
                mesh.data.check().unwrap();
            }
        }
    }
}

#[test]
fn i03_models_that_lie() {
    let mut lie = binary_stl(&[0; 80], &FACETS);
    lie[80..84].copy_from_slice(&u32::MAX.to_le_bytes());
    assert!(read_stl(&lie).unwrap_err().to_string().contains("promises 4294967295 facets, and only 100 bytes"));
    for (name, bytes, what) in [
        ("a.stl", b"".as_slice(), "no STL file"),
        ("a.stl", b"solid nothing\nendsolid\n", "no triangles"),
        ("a.stl", b"solid nothing\n", "cut off"),
        ("a.obj", b"", "no faces"),
        ("a.obj", b"\x1f\x8b\x08\x00", "gzip"),
        ("a.ply", b"\x28\xb5\x2f\xfd", "zstd"),
        ("a.stl", b"PK\x03\x04", "compressed"),
        ("a.gltf", b"{}", "none of .obj, .ply, .stl"),
    ] {
        let message = read(&[(name, bytes)]).unwrap_err().to_string();
        assert!(message.starts_with(name) && message.contains(what), "{message}");
    }
}

#[test]
fn i10_extensions_tell_and_directories_are_refused() {
    let options = AnyOptions::default();
    let given = files(&[
        ("m.Obj", TETRAHEDRON.as_bytes()),
        ("s.PBRT", b"Camera \"perspective\"\nWorldBegin\nLightSource \"infinite\"\nShape \"sphere\"\n"),
        ("z.pbrt", b"\x1f\x8b\x08 not text"),
        ("m.fbx", b""),
        ("plain", b"Camera \"perspective\"\nWorldBegin\nLightSource \"infinite\"\nShape \"sphere\"\n"),
        ("m.obj.gz", b""),
    ]);
    assert_eq!(read_any_from(&given, "m.Obj", &options).unwrap().name, "m");
    assert_eq!(read_any_from(&given, "s.PBRT", &options).unwrap().name, "s");
    assert_eq!(read_any_from(&given, "plain", &options).unwrap().name, "plain", "no extension: a scene");
    for (name, what) in [
        ("m.fbx", "the extension 'fbx' is none that is read: .pbrt (scenes), .obj, .ply and .stl (models)"),
        ("m.obj.gz", "unpack the file first"),
        ("z.pbrt", "compressed by gzip"),
        ("missing.stl", "cannot read missing.stl: no such file; check the name"),
        ("missing.fbx", "cannot read missing.fbx: no such file"),
    ] {
        let message = read_any_from(&given, name, &options).unwrap_err().to_string();
        assert!(message.starts_with(name) && message.contains(what) && message.lines().count() == 1, "{message}");
    }
    let folder = tempfile::tempdir().unwrap();
    for name in ["folder.obj", "folder.ply", "folder.stl", "folder.pbrt"] {
        let path = folder.path().join(name);
        std::fs::create_dir(&path).unwrap();
        assert!(read_any(&path, &options).unwrap_err().to_string().contains("not a regular file"));
    }
}

/// Rays at the middles of triangles hit what a loop over all triangles in f64 finds first, however the tree was built.
fn rays_agree(name: &str, geometry: &Tree) {
    let shapes = geometry.shapes().to_vec();
    let other = Tree::build(shapes.clone(), Preset::Fastest).unwrap();
    let corners = |mesh: &Mesh, n: u32| mesh.corners(n).map(|corner| corner.as_dvec3());
    let meshes: Vec<_> = shapes.iter().filter_map(Shape::mesh).collect();
    let triangles: Vec<[DVec3; 3]> = meshes
        .iter()
        .flat_map(|mesh| {
            (0..mesh.triangles().len() as u32).filter(|&n| !mesh.is_degenerate(n)).map(|n| corners(mesh, n))
        })
        .collect();
    let [low, high] = geometry.bounds().unwrap().map(|corner| corner.as_dvec3());
    let mut hits = 0;
    for i in 0..64 {
        let [a, b, c] = triangles[i * triangles.len() / 64];
        let turn = i as f64 * 2.4;
        let eye =
            (low + high) * 0.5 + DVec3::new(turn.cos(), 0.3 - i as f64 / 64.0, turn.sin()) * (high - low).length();
        let (origin, aim) = (eye.as_vec3(), (a + b + c) / 3.0);
        let ray = Ray::new(origin, (aim - origin.as_dvec3()).as_vec3());
        let found = geometry.closest(&ray);
        assert_eq!(found, other.closest(&ray), "{name}: {ray:?}");
        let first = triangles.iter().filter_map(|t| meet(t, &ray)).fold(f64::INFINITY, f64::min);
        // Rays at edges and at slivers are for the tests of geometry.
        if let (Some(hit), true) = (found, first.is_finite()) {
            hits += 1;
            assert!((f64::from(hit.t) - first).abs() < 1e-3 || f64::from(hit.t) < first, "{name}: {hit:?}, {first}");
        }
        assert!(found.is_some() || first.is_infinite(), "{name}: {ray:?} meets nothing, {first}");
    }
    assert!(hits > 32, "{name}: {hits} of 64");
}

/// Moeller and Trumbore, well inside the triangle only.
fn meet([a, b, c]: &[DVec3; 3], ray: &Ray) -> Option<f64> {
    let (origin, direction) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
    let (ab, ac, ao) = (b - a, c - a, origin - a);
    let p = direction.cross(ac);
    let determinant = ab.dot(p);
    let u = ao.dot(p) / determinant;
    let q = ao.cross(ab);
    let (v, t) = (direction.dot(q) / determinant, ac.dot(q) / determinant);
    (u > 1e-3 && v > 1e-3 && u + v < 0.999 && t > 0.0).then_some(t)
}

/// Clusters the world, and renders it by counts that come from clusters and by counts that come from samples, filtered across
/// clusters and not: every pixel finite, every sample spent, and something to be seen. Tells how many clusters there are.
fn rendered(name: &str, world: World) -> usize {
    let frame = Frame::new(32, 32).unwrap();
    let world = Arc::new(world);
    let stage = Stage::new(world.clone());
    let mut clusters = 0;
    for sampler in ["cluster-thesis", "cluster:geometry=2"] {
        let points = registry::points("sobol", Setting { seed: 1, spp: Some(2) }).unwrap();
        let mut sampler = registry::sampler(sampler, points, &stage).unwrap_or_else(|e| panic!("{name}: {e}"));
        let filter = registry::filter("cluster-gaussian", &stage).unwrap_or_else(|e| panic!("{name}: {e}"));
        let made = stage.first_clusters().expect("made by now");
        let used: BTreeSet<u32> = made.labels().iter().copied().collect();
        clusters = made.clusters().len();
        assert!(used.len() <= clusters && used.iter().all(|&label| (label as usize) < clusters), "{name}");
        let needs = filter.needs();
        let film =
            Render::new(frame, &Limits::samples(4 * 1024)).needs(needs).run(&mut *integrator(&world), &mut *sampler);
        let film = film.unwrap_or_else(|e| panic!("{name}: {e}"));
        assert_eq!((film.record().samples, film.record().rejected), (4 * 1024, 0), "{name}");
        let filtered = filter.apply(&film).unwrap_or_else(|e| panic!("{name}: {e}"));
        for image in [film.image(), filtered.radiance] {
            assert!(image.iter().flatten().all(|v| v.is_finite() && *v >= 0.0), "{name}: not finite");
            // A model stands before a sky of one brightness: where it is seen, it is darker.
            let levels: BTreeSet<u32> = image.iter().map(|p| p[1].to_bits()).collect();
            assert!(levels.len() > 20, "{name}: {} levels", levels.len());
        }
    }
    clusters
}

/// Every mesh of `../shared/scenes`: it is read, can be built, clustered and rendered, and is met by rays; or it is refused as
/// said here.
#[test]
fn meshes_of_other_people() {
    let beside = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/scenes"));
    let scenes = std::env::var_os("DAPPLE_SCENES").map_or(beside.to_owned(), PathBuf::from);
    let folder = scenes.join("meshes");
    if !folder.is_dir() {
        eprintln!("skipped: {} is not there; set DAPPLE_SCENES", folder.display());
        return;
    }
    let mut waiting = vec![folder];
    let mut paths = Vec::new();
    while let Some(folder) = waiting.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                waiting.push(path);
            } else if path.extension().is_some_and(|e| e != "md") {
                paths.push(path);
            }
        }
    }
    paths.sort();
    let refused = [("empty.ply", "no triangles"), ("points_emptyface.ply", "no triangles")];
    for path in paths {
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        let expected = refused.iter().find(|(refused, _)| *refused == name);
        match (read_any(&path, &AnyOptions::default()), expected) {
            (Ok(scene), None) => {
                let world = World::with_resolution(&scene, [16, 16]).unwrap();
                let (all, dropped) = (world.geometry().triangle_count(), world.dropped_triangles());
                assert!(all > 0);
                rays_agree(&name, world.geometry());
                let clusters = rendered(&name, world);
                eprintln!(
                    "{name}: {all} triangles, {dropped} without area, {clusters} clusters, {} shapes, {:?}",
                    scene.shapes.len(),
                    scene.notices.iter().map(|n| &n.message).collect::<Vec<_>>()
                );
            }
            (Err(e), Some((_, what))) => {
                let message = e.to_string();
                assert!(message.starts_with(&*path.to_string_lossy()) && message.contains(what), "{message}");
                eprintln!("{name}: {}", message.rsplit('/').next().unwrap_or_default());
            }
            (outcome, _) => panic!("{name}: {:?}", outcome.err()),
        }
    }
}
