//! Clusters of a world's shapes.

use dapple_job::WorldTriangles;
use dapple_renderer::World;
use dapple_scene::pbrt::{ReadOptions, read_scene_from};

const PLACES: [&str; 2] =
    ["Translate 3 0 1 Rotate 30 0 1 0 Scale 2 1 0.5", "Translate -2 1 0 Rotate 70 1 0.5 0 Scale -1 1 1"];
const TENTS: &str = "Shape \"trianglemesh\" \"integer indices\" [ 0 1 3 1 2 3 ] \
    \"point3 P\" [ -1 -1 0  1 -1 0  0 1 0  0 -0.2 1 ]\n Material \"conductor\"\n Shape \"trianglemesh\" \
    \"integer indices\" [ 0 1 2 ] \"point3 P\" [ 0 0 2  1 0 2  0 1 3 ]\n";

/// Triangles, and their vertices in the units of the file.
fn triangles(shapes: &str) -> (WorldTriangles, Vec<[f64; 3]>) {
    let file = format!("LookAt 0 0 9 0 0 0 0 1 0 Camera \"perspective\"\nWorldBegin\nLightSource \"point\"\n{shapes}");
    let files: &[(&str, &[u8])] = &[("scene.pbrt", file.as_bytes())];
    let scene = read_scene_from(files, "scene.pbrt", &ReadOptions::default()).unwrap();
    let world = World::new(&scene).unwrap();
    let triangles = WorldTriangles::of(&world);
    let positions = triangles.positions.iter().map(|&p| world.space().world(p)).collect();
    (triangles, positions)
}

#[test]
fn clusters_see_the_triangles_of_instances_as_those_of_copies() {
    let placed = |shapes: &str| PLACES.map(|place| format!("AttributeBegin {place} {shapes} AttributeEnd\n")).concat();
    let (instances, of_instances) =
        triangles(&format!("ObjectBegin \"tents\" {TENTS} ObjectEnd\n{}", placed("ObjectInstance \"tents\"")));
    let (copies, of_copies) = triangles(&placed(TENTS));
    assert_eq!(instances.indices, copies.indices);
    assert_eq!(instances.indices.len(), 6);
    assert_eq!(instances.positions.len(), 14);
    for (p, q) in of_instances.iter().zip(&of_copies) {
        assert!(p.iter().zip(q).all(|(a, b)| (a - b).abs() < 1e-5), "{p:?} {q:?}");
    }
}
