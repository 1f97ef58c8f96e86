//! Scenes made by hand, as descriptions.
//!
//! The tests of the renderer include this file as well; no test program uses all of it.
#![allow(dead_code, unreachable_pub)]

use dapple_scene::{
    Camera, Coating, Color, ConductorFresnel, Emission, EnvironmentRadiance, Geometry, Light, LightKind, Material,
    MaterialId, MaterialKind, MeshData, Projection, Roughness, Scene, Shape, Source,
};
use glam::{DAffine3, DMat3, DVec3};
use std::sync::Arc;

/// From camera space to world space: at `eye`, looking at `target`, `up` upwards, x to the right as pbrt has it.
pub fn look_at(eye: DVec3, target: DVec3, up: DVec3) -> DAffine3 {
    let z = (target - eye).normalize();
    let x = up.cross(z).normalize();
    DAffine3 { matrix3: DMat3::from_cols(x, z.cross(x), z), translation: eye }
}

/// An object of line `line` of `made.pbrt`.
pub fn line(line: u32) -> Source {
    Source { file: Arc::new("made.pbrt".into()), line }
}

/// An empty scene of `size` pixels seen from `eye` towards `target`.
pub fn scene(size: [u32; 2], fov: f64, eye: DVec3, target: DVec3) -> Scene {
    let mut scene = Scene { name: "made".into(), max_depth: Some(5), ..Scene::default() };
    let up = if (target - eye).normalize().z.abs() > 0.9 { DVec3::Y } else { DVec3::Z };
    scene.camera = Camera {
        to_world: look_at(eye, target, up),
        projection: Projection::Perspective { fov },
        source: line(1),
        ..Camera::default()
    };
    scene.film.resolution = size;
    scene
}

/// Adds a material and gives its number.
pub fn add_material(scene: &mut Scene, kind: MaterialKind) -> MaterialId {
    let number = scene.materials.len() as u32;
    scene.materials.push(Material::new(format!("material{number}"), kind, line(100 + number)));
    MaterialId(number)
}

pub fn diffuse(rho: f32) -> MaterialKind {
    MaterialKind::Diffuse { reflectance: Color::Constant([rho; 3]) }
}

pub fn metal(alpha: f32) -> MaterialKind {
    let fresnel = ConductorFresnel::EtaK { eta: [0.2, 0.9, 1.1], k: [3.9, 2.4, 2.2] };
    MaterialKind::Conductor { fresnel, roughness: Roughness::constant(alpha, alpha, false) }
}

pub fn coated(rho: f32, alpha: f32) -> MaterialKind {
    MaterialKind::CoatedDiffuse {
        reflectance: Color::Constant([rho; 3]),
        coat: Coating {
            roughness: Roughness::constant(alpha, alpha, false),
            thickness: 0.0,
            max_depth: 100,
            ..Coating::default()
        },
    }
}

/// Adds a shape with this material, and radiance if it shines; gives its number.
pub fn add(
    scene: &mut Scene,
    geometry: Geometry,
    to_world: DAffine3,
    material: MaterialId,
    shines: Option<f32>,
) -> usize {
    let number = scene.shapes.len() as u32;
    let emission = shines.map(|l| Emission::even([l; 3], false));
    scene.shapes.push(Shape { emission, ..Shape::new(geometry, to_world, material, line(10 + number)) });
    number as usize
}

/// A flat polygon fan around its first corner.
pub fn polygon(corners: &[DVec3]) -> Geometry {
    let triangles = (1..corners.len() as u32 - 1).map(|i| [0, i, i + 1]).collect();
    Geometry::Mesh(Arc::new(MeshData { positions: corners.to_vec(), triangles, ..MeshData::default() }))
}

/// A rectangle around `centre` with these half axes, whose normal is `u x v`.
pub fn rectangle(centre: DVec3, u: DVec3, v: DVec3) -> Geometry {
    polygon(&[centre - u - v, centre + u - v, centre + u + v, centre - u + v])
}

/// The cube `[-1, 1]^3`, normals outwards.
pub fn cube() -> MeshData {
    let corner = |i: u32| DVec3::from([0, 1, 2].map(|bit| if i >> bit & 1 == 1 { 1.0 } else { -1.0 }));
    let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    MeshData { positions: (0..8).map(corner).collect(), triangles, ..MeshData::default() }
}

/// Light from everywhere.
pub fn add_sky(scene: &mut Scene, radiance: f32) {
    let kind = LightKind::Infinite { radiance: EnvironmentRadiance::Constant([radiance; 3]) };
    scene.lights.push(Light { kind, to_world: DAffine3::IDENTITY, source: line(200) });
}

/// A room with a floor, two boxes, a lamp and a smooth ball: every kind of material, an environment seen
/// through its open side, several lights.
pub fn room(size: [u32; 2]) -> Scene {
    let mut scene = scene(size, 60.0, DVec3::new(0.0, -4.5, 1.2), DVec3::new(0.0, 0.0, 0.8));
    let grey = add_material(&mut scene, diffuse(0.7));
    let rough = add_material(&mut scene, metal(0.2));
    let mirror = add_material(&mut scene, metal(0.0));
    let coat = add_material(&mut scene, coated(0.5, 0.1));
    let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
    add(&mut scene, rectangle(DVec3::ZERO, 3.0 * x, 3.0 * y), DAffine3::IDENTITY, grey, None);
    add(&mut scene, rectangle(DVec3::new(0.0, 2.0, 1.0), 2.0 * x, z), DAffine3::IDENTITY, coat, None);
    let small = DAffine3::from_scale(DVec3::splat(0.4));
    let at = |p: DVec3| DAffine3::from_translation(p) * small;
    add(&mut scene, Geometry::Mesh(Arc::new(cube())), at(DVec3::new(-1.0, 0.3, 0.4)), rough, None);
    add(&mut scene, Geometry::Sphere { radius: 1.0 }, at(DVec3::new(0.1, 0.0, 0.5)), mirror, None);
    add(&mut scene, Geometry::Sphere { radius: 0.5 }, at(DVec3::new(1.2, -0.5, 0.9)), grey, Some(6.0));
    add(&mut scene, rectangle(DVec3::new(0.0, 0.0, 2.5), 0.5 * y, 0.5 * x), DAffine3::IDENTITY, grey, Some(12.0));
    add_sky(&mut scene, 0.3);
    scene.max_depth = Some(8);
    scene
}
