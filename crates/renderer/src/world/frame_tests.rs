//! L12 at hits: frames under bad vertex normals, texture coordinates and reliefs; derivatives by u and v.

use super::World;
use crate::shading::ShadingFrame;
use dapple_geometry::Ray;
use dapple_scene::image::Image;
use dapple_scene::{
    Color, Geometry, Material, MaterialId, MaterialKind, MeshData, Roughness, Scalar, Scene, Shape, Source, Texture,
    TextureId, TextureKind, Wrap,
};
use glam::{DAffine3, DMat3, DVec3, Vec3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::sync::Arc;

fn vector(rng: &mut Pcg64Mcg) -> Vec3 {
    Vec3::from_array(std::array::from_fn(|_| rng.random_range(-1.0..1.0)))
}

/// Largest deviation from an orthonormal right-handed frame.
fn off(frame: &ShadingFrame) -> f64 {
    let axes = [frame.tangent, frame.bitangent, frame.normal].map(|v| v.as_dvec3());
    let mut worst = (axes[0].cross(axes[1]) - axes[2]).abs().max_element();
    for i in 0..3 {
        for j in 0..=i {
            worst = worst.max((axes[i].dot(axes[j]) - f64::from(u8::from(i == j))).abs());
        }
    }
    if worst.is_finite() { worst } else { f64::INFINITY }
}

/// Materials that ask for a direction of u, or tilt their normals: with a smooth relief, one of noise, and steps.
fn materials(scene: &mut Scene) {
    let mut rng = Pcg64Mcg::seed_from_u64(5);
    let noise: Vec<[f32; 3]> = (0..64).map(|_| (vector(&mut rng) * 3.0).to_array()).collect();
    let image = |pixels: Vec<[f32; 3]>| TextureKind::Image {
        image: Arc::new(Image::new([8, 8], pixels).expect("64 pixels")),
        scale: [1.0; 2],
        shift: [0.0; 2],
        factor: 1.0,
        invert: false,
        wrap: Wrap::Repeat,
    };
    let steps = TextureKind::Checkerboard {
        scale: [7.0; 2],
        shift: [0.0; 2],
        colors: [Color::Constant([1e6; 3]), Color::Constant([0.0; 3])],
    };
    for kind in [image(noise), image(vec![[0.5, 0.5, 1.0]; 64]), steps] {
        let source = Source::default();
        scene.textures.push(Texture { name: "relief".into(), kind, source });
    }
    let kind = || MaterialKind::Substrate {
        diffuse: Color::Constant([0.5; 3]),
        specular: Color::Constant([0.1; 3]),
        roughness: Roughness::constant(0.1, 0.4, false),
    };
    let plain = Material::new("stretched", kind(), Source::default());
    scene.materials.push(plain.clone());
    scene.materials.push(Material { normal_map: Some(TextureId(0)), ..plain.clone() });
    let bumps = (0..3).map(|i| Material { bump: Some(Scalar::Texture(TextureId(i))), ..plain.clone() });
    scene.materials.extend(bumps);
}

/// Shapes whose normals or texture coordinates are as bad as files have them.
fn shapes() -> Vec<Geometry> {
    let positions = vec![DVec3::new(-1.0, -1.0, 0.0), DVec3::new(1.0, -1.0, 0.0), DVec3::new(0.0, 1.0, 0.3)];
    let mesh = |normals: Vec<[f32; 3]>, uvs: Vec<[f32; 2]>| {
        let positions = positions.clone();
        Geometry::Mesh(Arc::new(MeshData { positions, normals, uvs, triangles: vec![[0, 1, 2]] }))
    };
    let normals = [
        vec![],
        // They cancel halfway between two corners, or everywhere.
        vec![[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [0.0, 0.0, 1.0]],
        vec![[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]],
        vec![[0.0; 3]; 3],
        // Along the surface, and behind it.
        vec![[1.0, 0.0, -0.0], [0.0, 1.0, -0.0], [-1.0, 0.0, -0.0]],
        vec![[0.5, 0.0, -1.0], [-0.5, 0.0, -1.0], [0.0, 0.5, 1.0]],
    ];
    let uvs = [
        vec![],
        vec![[0.25, 0.5]; 3],
        vec![[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]],
        vec![[0.0, 0.0], [1e-12, 0.0], [0.0, 1e-12]],
        vec![[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]],
        vec![[0.0, 0.0], [-1e9, 0.0], [0.0, 1e9]],
    ];
    let mut all: Vec<Geometry> =
        normals.iter().flat_map(|n| uvs.iter().map(|uv| mesh(n.clone(), uv.clone()))).collect();
    all.push(Geometry::Sphere { radius: 1.0 });
    all.push(Geometry::Disk { height: 0.0, radius: 1.0, inner_radius: 0.0 });
    all
}

fn world(geometry: Geometry, to_world: DAffine3, material: u32) -> World {
    let mut scene = Scene::default();
    materials(&mut scene);
    scene.shapes.push(Shape::new(geometry, to_world, MaterialId(material), Source::default()));
    World::new(&scene).unwrap_or_else(|e| panic!("{e}"))
}

/// Rays from all around to all over the scene, of which one in a few hits along an axis or a pole.
fn ray(rng: &mut Pcg64Mcg, world: &World) -> Ray {
    let [low, high] = world.shape_bounds(0);
    let (middle, size) = ((low + high) * 0.5, (high - low).length());
    let from = match rng.random_range(0..4) {
        0 => middle + Vec3::Z * size,
        1 => middle - Vec3::Z * size,
        _ => middle + vector(rng).normalize() * size,
    };
    let to = if rng.random_range(0..4) == 0 { middle } else { low + (vector(rng) * 0.5 + 0.5) * (high - low) };
    Ray::new(from, (to - from).normalize())
}

#[test]
fn frames_of_hits_are_orthonormal_l12() {
    let mut rng = Pcg64Mcg::seed_from_u64(12);
    let mut hits = 0;
    for (number, geometry) in shapes().into_iter().enumerate() {
        for material in 0..5 {
            let world = world(geometry.clone(), DAffine3::IDENTITY, material);
            for _ in 0..200 {
                let Some(at) = world.closest_hit(&ray(&mut rng, &world), 0.0) else { continue };
                hits += 1;
                let frame = world.frame_of(&at, &world.surfaces[material as usize]);
                assert!(off(&frame) <= 3e-7, "shape {number}, material {material}: {frame:?} off by {:e}", off(&frame));
                assert!(frame.normal.dot(at.point.normal) >= -1e-6, "shape {number}, material {material}: behind");
            }
        }
    }
    assert!(hits > 10_000, "{hits}");
}

/// A step along the derivative by u changes u and nothing else, and so for v; of shapes turned, stretched, mirrored.
#[test]
fn derivatives_of_spheres_and_disks_match_differences_l12() {
    let mut rng = Pcg64Mcg::seed_from_u64(13);
    let mut compared = 0;
    for case in 0..40 {
        let turn = DMat3::from_axis_angle(vector(&mut rng).as_dvec3().normalize(), rng.random_range(-3.0..3.0));
        let stretch = DVec3::from_array(std::array::from_fn(|_| rng.random_range(0.4..2.0)));
        let side = if case % 2 == 0 { 1.0 } else { -1.0 };
        let to_world = DAffine3 { matrix3: turn * DMat3::from_diagonal(stretch * side), translation: DVec3::ONE };
        let geometry = match case % 4 < 2 {
            true => Geometry::Sphere { radius: 0.8 },
            false => Geometry::Disk { height: 0.3, radius: 1.1, inner_radius: 0.2 },
        };
        let world = world(geometry, to_world, 0);
        for _ in 0..50 {
            let Some(at) = world.closest_hit(&ray(&mut rng, &world), 0.0) else { continue };
            let here = world.uv(&at);
            // Not where u jumps from 1 to 0, nor near a pole, where a step is a turn.
            if !(0.02..0.98).contains(&here[0]) || !(0.1..0.9).contains(&here[1]) {
                continue;
            }
            for (axis, along) in world.derivatives(&at).into_iter().enumerate() {
                // Central differences of 1/256 in the middle of f32's range.
                let moved = [-1.0, 1.0].map(|sign| {
                    let mut there = at;
                    there.point.position += along * (sign / 512.0);
                    world.uv(&there)
                });
                let change = [0, 1].map(|i| (moved[1][i] - moved[0][i]) * 256.0);
                let expected = if axis == 0 { [1.0, 0.0] } else { [0.0, 1.0] };
                let worst = (0..2).map(|i| (change[i] - expected[i]).abs()).fold(0.0, f32::max);
                assert!(worst < 2e-3, "case {case}, by {axis}: {change:?}");
                compared += 1;
            }
        }
    }
    assert!(compared > 1000, "{compared}");
}
