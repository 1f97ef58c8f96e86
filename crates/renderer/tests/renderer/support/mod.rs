//! Small scenes made by hand, and short ways to render them.
//!
//! Not every test program that has this uses all of it.
#![allow(dead_code, unreachable_pub)]

use dapple_core::samplers::Uniform;
use dapple_core::{Film, Frame, Limits, Needs, NoMonitor, PointSet, Sampler, render};
use dapple_low_discrepancy::Sobol;
use dapple_renderer::scene::{
    Camera, Coating, Color, ConductorFresnel, Emission, EnvironmentRadiance, Geometry, Light, LightKind, Material,
    MaterialId, MaterialKind, MeshData, Projection, Roughness, Scene, Shape, Source,
};
use dapple_renderer::{World, integrator};
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
    let emission = shines.map(|l| Emission { radiance: [l; 3], two_sided: false });
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

/// A world, or the reasons why there is none.
pub fn world(scene: &Scene) -> World {
    World::new(scene).unwrap_or_else(|e| panic!("{e}"))
}

/// `spp` samples in every pixel of the whole frame.
pub fn film_of(world: &World, size: [u32; 2], spp: u64, points: impl PointSet) -> Film {
    let frame = Frame::new(size[0], size[1]).expect("the size is at least 1x1");
    film_in(world, frame, &mut Uniform::new(points), &Limits::samples(spp * frame.pixels() as u64))
}

pub fn film_in(world: &World, frame: Frame, sampler: &mut dyn Sampler, limits: &Limits) -> Film {
    render(&mut *integrator(world), sampler, Needs::none(), frame, limits, &mut NoMonitor).expect("it renders")
}

/// `spp` Sobol' samples in every pixel of the scene's image.
pub fn image(scene: &Scene, spp: u64, seed: u64) -> Film {
    film_of(&world(scene), scene.film.resolution, spp, Sobol::new(seed))
}

/// Mean of all pixels, per channel.
pub fn mean(film: &Film) -> [f64; 3] {
    let pixels = film.frame().pixels();
    let mut sum = [0.0; 3];
    for i in 0..pixels {
        let m = film.mean(i);
        (0..3).for_each(|c| sum[c] += m[c]);
    }
    sum.map(|s| s / pixels as f64)
}

/// FNV-1a of the means' and counts' bits.
pub fn hash(film: &Film) -> u64 {
    let values =
        (0..film.frame().pixels()).flat_map(|i| film.mean(i).map(f64::to_bits).into_iter().chain([film.count(i)]));
    let mut hash = 0xcbf2_9ce4_8422_2325_u64;
    for byte in values.flat_map(u64::to_le_bytes) {
        hash = (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
    }
    hash
}

/// Largest deviations between two sets of independent images, in standard normal units.
#[derive(Clone, Copy, Debug)]
pub struct Agreement {
    /// Of any 8x8 block and channel.
    pub worst: f64,
    /// Blocks times channels.
    pub tests: usize,
    /// Of the mean of the whole image, any channel.
    pub whole: f64,
    /// True if blocks without variance were equal to the bit.
    pub exact: bool,
}

impl Agreement {
    /// Welch's t of block means between replicates.
    pub fn of(a: &[Film], b: &[Film]) -> Self {
        let [a, b] = [a, b].map(|films| films.iter().map(block_means).collect::<Vec<_>>());
        Self::of_blocks(&a, &b)
    }

    /// The same of block means, `[replicate][block]`.
    pub fn of_blocks(a: &[Vec<[f64; 3]>], b: &[Vec<[f64; 3]>]) -> Self {
        let blocks = a[0].len();
        let mut found = Self { worst: 0.0, tests: 3 * blocks, whole: 0.0, exact: true };
        for c in 0..3 {
            for block in 0..blocks {
                let of = |set: &[Vec<[f64; 3]>]| summary(set.iter().map(|r| r[block][c]));
                match welch(of(a), of(b)) {
                    Some(z) => found.worst = found.worst.max(z),
                    None => found.exact &= of(a).0 == of(b).0,
                }
            }
            let of = |set: &[Vec<[f64; 3]>]| summary(set.iter().map(|r| r.iter().map(|m| m[c]).sum::<f64>()));
            found.whole = found.whole.max(welch(of(a), of(b)).unwrap_or(0.0));
        }
        found
    }

    /// Returns true if nothing differs at this false-alarm rate, Sidak over all tests.
    pub fn holds(&self, alpha: f64) -> bool {
        let level = |tests: usize| super::statistics::critical(super::statistics::sidak(alpha / 2.0, tests) / 2.0);
        self.exact && self.worst < level(self.tests) && self.whole < level(3)
    }
}

/// Means of 8x8 blocks, those at the border smaller, row by row.
pub fn block_means(film: &Film) -> Vec<[f64; 3]> {
    let [w, h] = film.frame().size().map(|n| n as usize);
    let pixels: Vec<[f64; 3]> = (0..w * h).map(|i| film.mean(i)).collect();
    block_means_of([w, h], &pixels)
}

pub fn block_means_of([w, h]: [usize; 2], pixels: &[[f64; 3]]) -> Vec<[f64; 3]> {
    let corners = (0..h).step_by(8).flat_map(|y| (0..w).step_by(8).map(move |x| (x, y)));
    corners
        .map(|(x, y)| {
            let (x1, y1) = ((x + 8).min(w), (y + 8).min(h));
            let inside = (y..y1).flat_map(|row| pixels[row * w + x..row * w + x1].iter());
            let sum = inside.fold([0.0; 3], |s: [f64; 3], p| std::array::from_fn(|c| s[c] + p[c]));
            sum.map(|s| s / ((x1 - x) * (y1 - y)) as f64)
        })
        .collect()
}

/// Mean, squared standard error, and degrees of freedom.
pub fn summary(values: impl Iterator<Item = f64> + Clone) -> (f64, f64, f64) {
    let n = values.clone().count() as f64;
    let mean = values.clone().sum::<f64>() / n;
    let squares: f64 = values.map(|v| (v - mean).powi(2)).sum();
    (mean, squares / (n - 1.0) / n, n - 1.0)
}

/// Deviation of two means as a standard normal one of the same probability, after Wallace 1959; `None`
/// without variance.
pub fn welch((a, va, na): (f64, f64, f64), (b, vb, nb): (f64, f64, f64)) -> Option<f64> {
    let variance = va + vb;
    // Rounding is no variance.
    if variance.is_nan() || variance <= 1e-24 * (a * a + b * b) {
        return None;
    }
    let freedom = variance * variance / (va * va / na + vb * vb / nb);
    let t2 = (a - b).powi(2) / variance;
    Some((8.0 * freedom + 1.0) / (8.0 * freedom + 3.0) * (freedom * (t2 / freedom).ln_1p()).sqrt())
}
