//! Scenes of others, found through `DAPPLE_SCENES`.
#![allow(clippy::print_stderr)]

use dapple_scene::model::read_ply;
use dapple_scene::pbrt::{ReadOptions, read_scene};
use dapple_scene::{
    ConductorFresnel, EnvironmentRadiance, Geometry, Light, LightKind, MaterialKind, Projection, Scene,
};
use std::collections::BTreeSet;
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

/// Names of a scene's materials' kinds, each once.
fn kinds(scene: &Scene) -> BTreeSet<&'static str> {
    let kind = |kind: &MaterialKind| match kind {
        MaterialKind::Diffuse { .. } => "diffuse",
        MaterialKind::Conductor { .. } => "conductor",
        MaterialKind::Dielectric { .. } => "dielectric",
        MaterialKind::CoatedDiffuse { .. } => "coateddiffuse",
        MaterialKind::Mirror { .. } => "mirror",
        MaterialKind::Plastic { .. } => "plastic",
        MaterialKind::Substrate { .. } => "substrate",
        _ => "other",
    };
    scene.materials.iter().map(|m| kind(&m.kind)).collect()
}

#[test]
fn scenes_of_the_fourth_version() {
    // Kinds of materials; the numbers of shapes, triangles and lights; the size of the image, and the depth.
    for (name, expected_kinds, counts, film) in [
        ("coffee", &["coateddiffuse", "conductor", "dielectric", "diffuse"][..], [23, 235_271, 0], [800, 1000, 17]),
        ("cornell-box", &["diffuse"], [8, 36, 0], [1024, 1024, 65]),
        ("dining-room", &["coateddiffuse", "conductor", "diffuse"], [53, 269_538, 2], [960, 540, 8]),
        ("staircase2", &["coateddiffuse", "conductor", "dielectric", "diffuse"], [32, 30_927, 0], [1024, 1024, 65]),
        ("teapot", &["coateddiffuse", "diffuse"], [3, 126_050, 1], [1280, 720, 65]),
        ("veach-bidir", &["conductor", "dielectric", "diffuse"], [14, 11_544, 0], [1024, 1024, 7]),
        ("veach-mis", &["conductor", "diffuse"], [9, 52, 0], [1280, 720, 3]),
        ("water-caustic", &["dielectric", "diffuse"], [10, 103_487, 0], [1024, 1024, 9]),
    ] {
        let Some(scene) = read(&format!("pbrt-v4/{name}/scene-v4.pbrt")) else { return };
        assert_eq!(kinds(&scene), expected_kinds.iter().copied().collect(), "{name}");
        let emitters: Vec<_> = scene.shapes.iter().filter(|s| s.emission.is_some()).collect();
        assert_eq!([scene.shapes.len(), triangles(&scene), scene.lights.len()], counts, "{name}");
        let [width, height] = scene.film.resolution;
        assert_eq!([width, height, scene.max_depth.unwrap()], film, "{name}");
        let environment = |kind: &LightKind| kind.environment().and_then(|e| e.image()).map(|image| image.size);
        match name {
            "cornell-box" => {
                assert_eq!((scene.film.spp, scene.materials.len(), emitters.len()), (Some(64), 8, 1));
                assert_eq!(scene.materials[emitters[0].material.0 as usize].name, "Light");
                assert_eq!(scene.camera.projection, Projection::Perspective { fov: 19.5 });
                // The camera stands 6.8 in front of the box, 1 up, and looks along -z.
                let camera = scene.camera.to_world;
                assert!((camera.translation - glam::dvec3(0.0, 1.0, 6.8)).length() < 1e-9, "{camera}");
                assert!((camera.transform_vector3(glam::DVec3::Z) + glam::DVec3::Z).length() < 1e-9, "{camera}");
            }
            "veach-mis" => {
                assert_eq!(scene.camera.projection, Projection::Perspective { fov: 20.114292 });
                assert_eq!(emitters.iter().filter(|s| matches!(s.geometry, Geometry::Sphere { .. })).count(), 3);
            }
            "staircase2" => {
                assert_eq!((scene.media[0].name.as_str(), scene.media[0].absorption), ("green", [0.5, 0.2, 0.4]));
                assert_eq!(scene.shapes.iter().filter(|s| s.media.is_some()).count(), 1);
            }
            "dining-room" => {
                let square = |l: &Light| {
                    matches!(l.kind, LightKind::Infinite { radiance: EnvironmentRadiance::EqualArea { .. } })
                };
                assert!(scene.lights.iter().any(square));
                assert!(scene.lights.iter().any(|l| matches!(l.kind, LightKind::Distant { .. })));
            }
            "teapot" => {
                assert_eq!((environment(&scene.lights[0].kind), scene.textures.len()), (Some([1024, 512]), 1));
                let Geometry::Mesh(mesh) = &scene.shapes[1].geometry else { panic!("a mesh") };
                assert_eq!((mesh.normals.len(), mesh.uvs.len()), (mesh.positions.len(), mesh.positions.len()));
            }
            _ => {}
        }
    }
}

#[test]
fn scenes_of_older_versions() {
    let Some(scene) = read("pbrt-v3/killeroo/killeroo-simple.pbrt") else { return };
    assert_eq!((scene.shapes.len(), triangles(&scene), scene.max_depth), (5, 66_532, Some(5)));
    assert_eq!((kinds(&scene), scene.film.resolution), (["diffuse", "plastic"].into(), [700, 700]));
    let Some(scene) = read("pbrt-v2/metal.pbrt") else { return };
    assert_eq!((scene.shapes.len(), scene.max_depth), (2257, Some(7)));
    assert_eq!(kinds(&scene), ["conductor", "substrate"].into());
    assert!(scene.materials[0].bump.is_some());
    let MaterialKind::Conductor { fresnel: ConductorFresnel::EtaK { eta, k }, .. } = &scene.materials[1].kind else {
        panic!("gold")
    };
    // The file's spectra of gold, against Tungsten's colours of gold.
    for (found, expected) in eta.iter().chain(k).zip([0.14312, 0.37496, 1.44248, 3.98316, 2.38572, 1.60322]) {
        assert!((found / expected - 1.0).abs() < 0.01, "{found} {expected}");
    }
    let Some(scene) = read("pbrt-v2/anim-moving-reflection.pbrt") else { return };
    assert_eq!(kinds(&scene), ["mirror", "plastic"].into());
    assert_eq!(scene.camera.projection, Projection::Perspective { fov: 40.0 });
    assert!(scene.shapes[0].moves_to.is_some() && scene.shapes[1].moves_to.is_none());
    // It turns and stretches around where it then is.
    let end = scene.shapes[0].moves_to.unwrap();
    assert!(end.translation.length() < 1e-12 && (end.matrix3.determinant() - 1.5).abs() < 1e-12);
    assert!(scene.notices.iter().any(|n| n.message.starts_with("a second Camera")));
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
