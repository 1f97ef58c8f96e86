//! The shared scenes, where they are: what the reader makes of them.
#![allow(clippy::print_stderr)]

use dapple_renderer::pbrt::{ReadOptions, read_scene};
use dapple_renderer::ply::read_ply;
use dapple_renderer::scene::{EnvironmentRadiance, Geometry, LightKind, Projection, Scene};
use std::path::PathBuf;

fn shared(name: &str) -> Option<PathBuf> {
    let beside = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/scenes"));
    let path = std::env::var_os("DAPPLE_SCENES").map_or(beside, PathBuf::from).join(name);
    if path.exists() {
        return Some(path);
    }
    eprintln!("skipped: {} is not there", path.display());
    None
}

fn read(name: &str) -> Option<Scene> {
    let scene = read_scene(shared(name)?, &ReadOptions::default());
    Some(scene.unwrap_or_else(|e| panic!("{e}")))
}

fn triangles(scene: &Scene) -> usize {
    let count = |g: &Geometry| if let Geometry::Mesh(mesh) = g { mesh.triangles.len() } else { 0 };
    scene.shapes.iter().map(|s| count(&s.geometry)).sum()
}

#[test]
fn cornell_box() {
    let Some(scene) = read("pbrt-v4/cornell-box/scene-v4.pbrt") else { return };
    assert_eq!((scene.shapes.len(), triangles(&scene)), (8, 36));
    assert_eq!((scene.film.resolution, scene.film.spp), ([1024, 1024], Some(64)));
    assert_eq!((scene.max_depth, scene.camera.projection), (Some(65), Projection::Perspective { fov: 19.5 }));
    assert_eq!((scene.lights.len(), scene.materials.len()), (0, 8));
    let shining: Vec<_> = scene.shapes.iter().filter(|s| s.emission.is_some()).collect();
    assert_eq!(shining.len(), 1);
    assert_eq!(scene.materials[shining[0].material.0 as usize].name, "Light");
    // The camera stands 6.8 in front of the box, 1 up, and looks along -z.
    let eye = scene.camera.to_world.transform_point3(glam::DVec3::ZERO);
    assert!((eye - glam::dvec3(0.0, 1.0, 6.8)).length() < 1e-9, "{eye}");
    let view = scene.camera.to_world.transform_vector3(glam::DVec3::Z);
    assert!((view + glam::DVec3::Z).length() < 1e-9, "{view}");
}

#[test]
fn veach_mis() {
    let Some(scene) = read("pbrt-v4/veach-mis/scene-v4.pbrt") else { return };
    assert_eq!((scene.shapes.len(), triangles(&scene)), (9, 52));
    assert_eq!((scene.film.resolution, scene.max_depth), ([1280, 720], Some(3)));
    assert_eq!(scene.camera.projection, Projection::Perspective { fov: 20.114292 });
    let spheres: Vec<_> = scene.shapes.iter().filter(|s| matches!(s.geometry, Geometry::Sphere { .. })).collect();
    assert_eq!(spheres.len(), 3);
    assert!(spheres.iter().all(|s| s.emission.is_some()));
    assert_eq!(scene.shapes.iter().filter(|s| s.emission.is_some()).count(), 3);
}

#[test]
fn teapot() {
    let Some(scene) = read("pbrt-v4/teapot/scene-v4.pbrt") else { return };
    assert_eq!((scene.shapes.len(), triangles(&scene)), (3, 126_050));
    assert_eq!((scene.film.resolution, scene.max_depth), ([1280, 720], Some(65)));
    assert_eq!((scene.lights.len(), scene.textures.len()), (1, 1));
    let LightKind::Infinite { radiance: EnvironmentRadiance::LatLong { picture, .. } } = &scene.lights[0].kind else {
        panic!("the environment is a picture")
    };
    assert_eq!(picture.size, [1024, 512]);
    let Geometry::Mesh(mesh) = &scene.shapes[1].geometry else { panic!("a mesh") };
    assert_eq!((mesh.normals.len(), mesh.uvs.len()), (mesh.positions.len(), mesh.positions.len()));
}

/// Scenes that need more than there is say so; nothing else is wrong with them.
#[test]
fn other_scenes_name_what_is_missing() {
    for name in ["coffee", "dining-room", "staircase2", "veach-bidir", "water-caustic"] {
        let Some(path) = shared(&format!("pbrt-v4/{name}/scene-v4.pbrt")) else { return };
        let error = read_scene(path, &ReadOptions::default()).map(|_| ()).expect_err(name);
        for problem in &error.problems {
            assert!(problem.message.contains("not supported"), "{problem}");
        }
    }
}

#[test]
fn loose_meshes() {
    for (name, triangles) in [
        ("pyvista/nut.ply", 1046),
        ("pyvista/airplane.ply", 2452),
        ("trimesh/cycloidal.ply", 43368),
        ("trimesh/mirror.ply", 286),
        // One quad.
        ("trimesh/plane.ply", 2),
    ] {
        let Some(path) = shared(&format!("meshes/{name}")) else { return };
        let mesh = read_ply(&std::fs::read(path).unwrap()).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert_eq!(mesh.data.triangles.len(), triangles, "{name}");
    }
    let Some(path) = shared("meshes/trimesh/empty.ply") else { return };
    assert!(read_ply(&std::fs::read(path).unwrap()).is_err());
}
