//! Shapes and random numbers shared by the tests.

use dapple_geometry::{Geometry, Mesh, Ray, Shape};
use glam::{DMat3, DVec3, Vec3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::f64::consts::PI;

pub(crate) fn generator(seed: u64) -> Pcg64Mcg {
    Pcg64Mcg::seed_from_u64(seed)
}

/// A closed sphere of `2 n` meridians and `n` parallels, as vertices and triangles facing outward.
pub(crate) fn lat_long(n: u32, radius: f64, centre: DVec3) -> Soup {
    let around = 2 * n;
    let point = |i: u32, j: u32| {
        let (theta, phi) =
            (std::f64::consts::PI * f64::from(i) / f64::from(n), std::f64::consts::PI * f64::from(j) / f64::from(n));
        let p = DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
        (centre + p * radius).as_vec3().to_array()
    };
    let mut positions = vec![point(0, 0)];
    positions.extend((1..n).flat_map(|i| (0..around).map(move |j| (i, j))).map(|(i, j)| point(i, j)));
    positions.push(point(n, 0));
    let ring = |i: u32, j: u32| 1 + (i - 1) * around + j % around;
    let last = positions.len() as u32 - 1;
    let mut triangles = Vec::new();
    for j in 0..around {
        triangles.push([0, ring(1, j), ring(1, j + 1)]);
        for i in 1..n - 1 {
            triangles.push([ring(i, j), ring(i + 1, j), ring(i + 1, j + 1)]);
            triangles.push([ring(i, j), ring(i + 1, j + 1), ring(i, j + 1)]);
        }
        triangles.push([ring(n - 1, j), last, ring(n - 1, j + 1)]);
    }
    (positions, triangles)
}

/// A box with six faces of two triangles, facing outward.
pub(crate) fn cuboid(low: Vec3, high: Vec3) -> Soup {
    let positions = (0..8)
        .map(|i| {
            let side = |bit: u32, axis: usize| if i >> bit & 1 == 0 { low[axis] } else { high[axis] };
            [side(0, 0), side(1, 1), side(2, 2)]
        })
        .collect();
    let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = faces.iter().flat_map(|f| [[f[0], f[1], f[2]], [f[0], f[2], f[3]]]).collect();
    (positions, triangles)
}

/// Vertices and triangles.
pub(crate) type Soup = (Vec<[f32; 3]>, Vec<[u32; 3]>);

pub(crate) fn geometry(meshes: Vec<Soup>) -> Geometry {
    let shapes = meshes.into_iter().map(|(p, t)| Shape::from(Mesh::new(p, t).expect("a valid mesh"))).collect();
    Geometry::build(shapes).expect("few triangles")
}

/// Returns a direction, uniform on the sphere.
pub(crate) fn direction(rng: &mut Pcg64Mcg) -> Vec3 {
    loop {
        let v = DVec3::from_array(std::array::from_fn(|_| rng.random_range(-1.0..1.0)));
        if (0.01..1.0).contains(&v.length_squared()) {
            return v.normalize().as_vec3();
        }
    }
}

pub(crate) fn point_in(rng: &mut Pcg64Mcg, low: Vec3, high: Vec3) -> Vec3 {
    Vec3::from_array(std::array::from_fn(|i| low[i] + (high[i] - low[i]) * rng.random::<f32>()))
}

/// A magnitude of 10^U(-exponent, exponent) with a random sign.
pub(crate) fn wild(rng: &mut Pcg64Mcg, exponent: f64) -> f32 {
    let size = 10.0_f64.powf(rng.random_range(-exponent..exponent));
    (if rng.random() { size } else { -size }) as f32
}

pub(crate) fn scaled_ray(ray: &Ray, scale: f32) -> Ray {
    Ray { origin: ray.origin * scale, tmin: ray.tmin * scale, tmax: ray.tmax * scale, ..*ray }
}

/// A random rotation and stretch whose scales are `size` times up to `10^decades` or its inverse, mirrored if requested.
pub(crate) fn turned_and_stretched(rng: &mut Pcg64Mcg, size: f64, decades: f64, mirror: bool) -> DMat3 {
    let turn =
        |rng: &mut Pcg64Mcg| DMat3::from_axis_angle(direction(rng).as_dvec3().normalize(), rng.random_range(-PI..PI));
    let mut scale = || size * 10.0_f64.powf(rng.random_range(-decades..decades));
    let stretch = DVec3::new(scale(), scale(), if mirror { -scale() } else { scale() });
    turn(rng) * DMat3::from_diagonal(stretch) * turn(rng)
}
