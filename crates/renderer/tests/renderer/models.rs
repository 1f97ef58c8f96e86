//! Single models: built, clustered, traced and rendered.

#![allow(clippy::print_stderr)] // Reports skipped files, and the size of each.

use dapple_core::{Frame, Limits, Render};
use dapple_geometry::{Geometry as Tree, Mesh, Ray, Shape};
use dapple_job::registry::{self, MethodInputs, Setting};
use dapple_renderer::{World, integrator};
use dapple_scene::{AnyOptions, read_any, read_any_from};
use glam::DVec3;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Models of each format.
const MODELS: [(&str, &str); 3] = [
    ("a/Model.OBJ", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"),
    (
        "m.ply",
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
    ),
    (
        "m.stl",
        "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid a\n",
    ),
];

#[test]
fn a_model_alone_can_be_built() {
    for (name, text) in MODELS {
        let files = BTreeMap::from([(PathBuf::from(name), text.as_bytes().to_vec())]);
        let scene = read_any_from(&files, name, &AnyOptions::default()).unwrap();
        World::with_resolution(&scene, [8, 8]).unwrap();
    }
}

/// Rays at the middles of triangles have the first hit of a loop over all triangles in f64, also in a tree that holds them twice.
fn rays_agree(name: &str, geometry: &Tree) {
    let shapes = geometry.shapes().to_vec();
    let other = Tree::build([shapes.clone(), shapes.clone()].concat()).unwrap();
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
        // Rays at edges and at slivers belong to the tests of geometry.
        if let (Some(hit), true) = (found, first.is_finite()) {
            hits += 1;
            assert!((f64::from(hit.t) - first).abs() < 1e-3 || f64::from(hit.t) < first, "{name}: {hit:?}, {first}");
        }
        assert!(found.is_some() || first.is_infinite(), "{name}: {ray:?} meets nothing, {first}");
    }
    assert!(hits > 32, "{name}: {hits} of 64");
}

/// Möller and Trumbore's intersection, well inside the triangle only.
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

/// Clusters the world and renders it with counts from clusters and with counts from samples, with and without a filter
/// across clusters. Every pixel is finite, every sample is spent, and the model is visible. Returns the number of
/// clusters.
fn rendered(name: &str, world: World) -> usize {
    let frame = Frame::new(32, 32).unwrap();
    let world = Arc::new(world);
    let mut inputs = MethodInputs::of(world.clone());
    let mut clusters = 0;
    for sampler in ["cluster-thesis", "cluster:policy=keep"] {
        let points = registry::points("sobol", Setting { seed: 1, spp: Some(2) }).unwrap();
        let made = registry::sampler(sampler, points, &inputs).unwrap_or_else(|e| panic!("{name}: {e}"));
        let mut sampler = made.sampler;
        inputs.clusters = made.clusters.or(inputs.clusters);
        let filter = registry::filter("cluster-gaussian", &inputs).unwrap_or_else(|e| panic!("{name}: {e}")).filter;
        let made = inputs.clusters.as_ref().expect("made by now");
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
            // A model stands before a sky of one brightness, and its pixels are darker.
            let levels: BTreeSet<u32> = image.iter().map(|p| p[1].to_bits()).collect();
            assert!(levels.len() > 20, "{name}: {} levels", levels.len());
        }
    }
    clusters
}

/// Every mesh of `../shared/scenes` is read, built, clustered, traced and rendered, or refused with the message listed
/// here.
#[test]
fn downloaded_meshes_render_or_are_refused() {
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
