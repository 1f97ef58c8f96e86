//! Triangles of shapes that are no triangle meshes: subdivision surfaces, round shapes, bilinear patches.

use crate::reader_messages::{TAIL, WORLD, complaint, read, world};
use dapple_scene::{Geometry, MeshData};
use glam::{DVec3, dvec3};
use std::f64::consts::TAU;
use std::fmt::Write;

/// The mesh made of a shape, and the notices on it.
fn made(shape: &str) -> (MeshData, String) {
    let scene = world(&format!("Shape {shape}"));
    let Geometry::Mesh(mesh) = &scene.shapes[0].geometry else { panic!("{shape}") };
    assert!(mesh.check().is_ok(), "{shape}");
    (mesh.as_ref().clone(), scene.notices.iter().map(|n| n.message.as_str()).collect())
}

fn subdivision(positions: &[DVec3], faces: &[[u32; 3]], levels: u32) -> String {
    let mut text = format!("\"loopsubdiv\" \"integer levels\" {levels} \"point3 P\" [");
    positions.iter().for_each(|p| write!(text, "{} {} {} ", p.x, p.y, p.z).unwrap());
    write!(text, "] \"integer indices\" {:?}", faces.as_flattened()).unwrap();
    text.replace(',', "")
}

/// The limit of a corner is half as far from the centre, as calculated by hand: with valence 4,
/// gamma = 1 / (4 + 3 / (8 * 3/32)) = 1/8, and the neighbours of a corner have their mean at the origin.
#[test]
fn corners_of_an_octahedron() {
    let positions = [DVec3::X, -DVec3::X, DVec3::Y, -DVec3::Y, DVec3::Z, -DVec3::Z];
    let faces = [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]];
    for levels in 0..4 {
        let (mesh, _) = made(&subdivision(&positions, &faces, levels));
        assert_eq!(mesh.triangles.len(), 8 << (2 * levels));
        // Closed: Euler's formula.
        assert_eq!(mesh.positions.len(), mesh.triangles.len() / 2 + 2);
        // The limit of a corner does not depend on the level at which it is taken.
        assert!((mesh.positions[0] - DVec3::X * 0.5).length() < 1e-12, "{levels}: {}", mesh.positions[0]);
        // pbrt's normals point inwards for faces that wind outwards.
        assert!((DVec3::from_array(mesh.normals[4].map(f64::from)) + DVec3::Z).length() < 1e-6);
    }
}

/// A flat sheet stays flat, and its normals point opposite to the winding, as in pbrt.
#[test]
fn sheets_stay_flat() {
    let positions: Vec<DVec3> = (0..9).map(|i| dvec3(f64::from(i % 3), f64::from(i / 3), 7.0)).collect();
    let cell = |i: u32| [[i, i + 1, i + 4], [i, i + 4, i + 3]];
    let faces: Vec<[u32; 3]> = [0, 1, 3, 4].into_iter().flat_map(cell).collect();
    let (mesh, _) = made(&subdivision(&positions, &faces, 2));
    assert_eq!(mesh.triangles.len(), 128);
    assert!(mesh.positions.iter().all(|p| (p.z - 7.0).abs() < 1e-12));
    assert!(mesh.normals.iter().all(|n| (n[2] + 1.0).abs() < 1e-6), "{:?}", mesh.normals);
    assert!((mesh.positions[4] - dvec3(1.0, 1.0, 7.0)).length() < 1e-12);
}

#[test]
fn unfit_meshes_are_refused() {
    let points = |n: usize| (0..n).map(|i| dvec3(i as f64, (i * i) as f64, 1.0)).collect::<Vec<_>>();
    let shape = |n: usize, faces: &[[u32; 3]]| format!("Shape {}", subdivision(&points(n), faces, 3));
    assert!(complaint(&shape(3, &[[0, 1, 1]])).contains("triangle 0 has the same corner twice"));
    // Two triangles that turn against each other, and three on one edge: an answer, whatever it is.
    for faces in [&[[0, 1, 2], [0, 1, 3]][..], &[[0, 1, 2], [1, 0, 3], [0, 1, 4]], &[[0, 1, 2]; 5]] {
        let _ = read(&format!("{WORLD}{}\n{TAIL}", shape(5, faces)));
    }
    // A vertex without faces stays.
    assert_eq!(made(&subdivision(&points(4), &[[0, 1, 2]], 0)).0.positions[3], points(4)[3]);
}

fn area(mesh: &MeshData) -> f64 {
    let corner = |i: u32| mesh.positions[i as usize];
    let twice = |&[a, b, c]: &[u32; 3]| (corner(b) - corner(a)).cross(corner(c) - corner(a)).length();
    mesh.triangles.iter().map(twice).sum::<f64>() / 2.0
}

/// Compares areas with exact values, and checks that winding and normals agree.
#[test]
fn round_shapes_have_their_areas() {
    for (shape, expected) in [
        ("\"sphere\" \"float radius\" 2 \"float zmax\" 1.5", TAU * 2.0 * 3.5),
        ("\"sphere\" \"float radius\" 2 \"float zmin\" 0 \"float zmax\" 1 \"float phimax\" 180", TAU / 2.0 * 2.0),
        ("\"cylinder\" \"float radius\" 0.5 \"float zmax\" 2 \"float phimax\" 90", TAU / 4.0 * 0.5 * 3.0),
        ("\"disk\" \"float radius\" 2 \"float innerradius\" 1 \"float phimax\" 270", TAU / 2.0 * 3.0 * 0.75),
    ] {
        let (mesh, _) = made(shape);
        assert!((area(&mesh) / expected - 1.0).abs() < 5e-4, "{shape}: {} {expected}", area(&mesh));
        for [a, b, c] in mesh.triangles.iter().map(|t| t.map(|i| i as usize)) {
            let winding = (mesh.positions[b] - mesh.positions[a]).cross(mesh.positions[c] - mesh.positions[a]);
            let normal = glam::Vec3::from(mesh.normals[a]).as_dvec3();
            assert!(winding.length() < 1e-12 || winding.dot(normal) > 0.0, "{shape}");
        }
    }
}

#[test]
fn flat_patches_are_two_triangles() {
    let patch = |rest: &str| made(&format!("\"bilinearmesh\" \"point3 P\" [0 0 0  1 0 0  0 1 0  {rest}"));
    let (mesh, said) = patch("1 1 0]");
    assert_eq!((mesh.triangles, said), (vec![[0, 1, 3], [0, 3, 2]], String::new()));
    assert_eq!(mesh.uvs, [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]);
    assert!(mesh.normals.is_empty());
    let (mesh, said) = patch("1 1 1]");
    assert!(said.contains("has 1 curved patches"), "{said}");
    assert_eq!((mesh.triangles.len(), mesh.normals.len()), (512, 289));
    // The middle of a bilinear patch is the mean of its corners.
    assert!((mesh.positions[144] - dvec3(0.5, 0.5, 0.25)).length() < 1e-12);
    // Texture coordinates that bend need more than two triangles.
    assert!(patch("1 1 0] \"point2 uv\" [0 0  1 0  0 1  0.5 0.5]").1.contains("has 1 curved patches"));
}
