#![allow(dead_code, reason = "shared by a bench and examples, each of which uses a part")]
//! Scenes of the benches (a box of 36 triangles, a displaced sphere of 70,000 in a room, a terrain of a million), and their
//! primary, bounce and shadow rays.

use dapple_geometry::{Geometry, Mesh, Ray, Shape, spawn_ray, spawn_ray_to};
use glam::{DVec3, Vec3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

pub(crate) type Soup = (Vec<[f32; 3]>, Vec<[u32; 3]>);

const SIDE: u32 = 512;

/// The Cornell box's room, light and two blocks, from rounded measurements in metres: 36 triangles.
fn cornell() -> Vec<Soup> {
    let quad = |a: [f32; 3], b: [f32; 3], c: [f32; 3], d: [f32; 3]| (vec![a, b, c, d], vec![[0, 1, 2], [0, 2, 3]]);
    let (w, h, l) = (5.5, 5.5, 5.6);
    let mut soups = vec![
        quad([0.0, 0.0, 0.0], [0.0, 0.0, l], [w, 0.0, l], [w, 0.0, 0.0]),
        quad([0.0, h, 0.0], [w, h, 0.0], [w, h, l], [0.0, h, l]),
        quad([0.0, 0.0, l], [0.0, h, l], [w, h, l], [w, 0.0, l]),
        quad([0.0, 0.0, 0.0], [0.0, h, 0.0], [0.0, h, l], [0.0, 0.0, l]),
        quad([w, 0.0, 0.0], [w, 0.0, l], [w, h, l], [w, h, 0.0]),
        quad([2.1, h - 0.01, 2.3], [3.4, h - 0.01, 2.3], [3.4, h - 0.01, 3.3], [2.1, h - 0.01, 3.3]),
    ];
    for (centre, half, height, turn) in [([1.85, 1.7], 0.82, 1.65, 0.3_f32), ([3.7, 3.5], 0.82, 3.3, -0.3)] {
        let corner = |i: usize, y: f32| {
            let angle = turn + std::f32::consts::FRAC_PI_4 * (1.0 + 2.0 * i as f32);
            [centre[0] + half * 1.414 * angle.cos(), y, centre[1] + half * 1.414 * angle.sin()]
        };
        soups.push(quad(corner(0, height), corner(1, height), corner(2, height), corner(3, height)));
        soups.push(quad(corner(0, 0.0), corner(3, 0.0), corner(2, 0.0), corner(1, 0.0)));
        let side = |i: usize| {
            let j = (i + 1) % 4;
            quad(corner(i, 0.0), corner(j, 0.0), corner(j, height), corner(i, height))
        };
        soups.extend((0..4).map(side));
    }
    soups
}

/// A grid of `n x m` quads mapped by `place`.
fn grid(n: u32, m: u32, place: impl Fn(f64, f64) -> DVec3) -> Soup {
    let points = (0..=m).flat_map(|j| (0..=n).map(move |i| (i, j)));
    let positions =
        points.map(|(i, j)| place(f64::from(i) / f64::from(n), f64::from(j) / f64::from(m)).as_vec3().to_array());
    let corner = |i: u32, j: u32| j * (n + 1) + i;
    let quads = (0..m).flat_map(|j| (0..n).map(move |i| (i, j)));
    let triangles = quads.flat_map(|(i, j)| {
        let [a, b, c, d] = [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)];
        [[a, b, c], [a, c, d]]
    });
    (positions.collect(), triangles.collect())
}

/// A sum of sines of increasing frequency and decreasing amplitude.
fn ripples(p: DVec3, octaves: i32) -> f64 {
    (0..octaves)
        .map(|k| {
            let f = 1.9_f64.powi(k);
            ((p.x * 3.1 + 0.7 * f64::from(k)) * f).sin() * ((p.y * 2.7 - p.z * 3.3) * f).cos() / f
        })
        .sum()
}

/// A displaced sphere of `4 n^2` triangles.
fn displaced_sphere(n: u32) -> Soup {
    grid(2 * n, n, |u, v| {
        let (phi, theta) = (u * std::f64::consts::TAU, v * std::f64::consts::PI);
        let p = DVec3::new(theta.sin() * phi.cos(), theta.cos(), theta.sin() * phi.sin());
        p * (1.0 + 0.1 * ripples(p, 6))
    })
}

fn terrain() -> Soup {
    grid(724, 724, |u, v| {
        let p = DVec3::new(u * 2.0 - 1.0, 0.0, v * 2.0 - 1.0);
        p + DVec3::Y * 0.12 * ripples(p * 3.0, 9)
    })
}

/// A mesh enclosed in a room, as in published measurements of other ray tracers.
fn enclosed(soup: Soup) -> Vec<Soup> {
    let mut soups = vec![soup];
    for axis in 0..3 {
        for side in [-4.0, 4.0] {
            soups.push(grid(1, 1, |u, v| {
                let mut p = DVec3::ZERO;
                (p[axis], p[(axis + 1) % 3], p[(axis + 2) % 3]) = (side, u * 8.0 - 4.0, v * 8.0 - 4.0);
                p
            }));
        }
    }
    soups
}

pub(crate) fn shapes(soups: &[Soup]) -> Vec<Shape> {
    soups.iter().map(|(p, t)| Shape::from(Mesh::new(p.clone(), t.clone()).expect("valid"))).collect()
}

/// Primary rays of a square image, diffuse bounces from their hits, shadow rays to a light above.
pub(crate) fn rays(scene: &Geometry, [eye, target, light]: [Vec3; 3]) -> [Vec<Ray>; 3] {
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    let forward = (target - eye).normalize();
    let right = forward.cross(Vec3::Y).normalize() * 0.36;
    let up = right.cross(forward);
    let [mut primary, mut bounce, mut shadow] = [(); 3].map(|()| Vec::new());
    for (i, j) in (0..SIDE).flat_map(|j| (0..SIDE).map(move |i| (i, j))) {
        let mut screen = |k: u32| (k as f32 + rng.random::<f32>()) / SIDE as f32 * 2.0 - 1.0;
        let ray = Ray::new(eye, forward + right * screen(i) + up * screen(j));
        primary.push(ray);
        let Some(hit) = scene.closest(&ray) else { continue };
        let point = scene.surface(&ray, &hit);
        let normal = if point.normal.dot(ray.direction) > 0.0 { -point.normal } else { point.normal };
        let random = loop {
            let v = Vec3::from_array(std::array::from_fn(|_| rng.random_range(-1.0..1.0)));
            if (0.01..1.0).contains(&v.length_squared()) {
                break v.normalize();
            }
        };
        bounce.push(spawn_ray(&point, normal + random * 0.999));
        let aside = Vec3::new(rng.random_range(-0.5..0.5), 0.0, rng.random_range(-0.5..0.5));
        let lamp = dapple_geometry::SurfacePoint {
            position: light + aside,
            error: Vec3::ZERO,
            normal: Vec3::NEG_Y,
            primitive: dapple_geometry::PrimitiveId::NONE,
        };
        shadow.push(spawn_ray_to(&point, &lamp));
    }
    [primary, bounce, shadow]
}

/// A scene: name, triangles, and the positions of eye, target and light.
pub(crate) struct Scene {
    pub(crate) name: &'static str,
    pub(crate) soups: Vec<Soup>,
    pub(crate) views: [Vec3; 3],
}

/// All scenes.
pub(crate) fn scenes() -> [Scene; 4] {
    let box_views = [Vec3::new(2.75, 2.75, -8.0), Vec3::new(2.75, 2.75, 0.0), Vec3::new(2.75, 5.4, 2.8)];
    let views = [Vec3::new(1.0, 1.6, -3.2), Vec3::ZERO, Vec3::new(1.0, 3.5, -1.0)];
    let far_views = [Vec3::new(0.3, 0.7, -1.3), Vec3::ZERO, Vec3::new(1.0, 2.5, 0.0)];
    [
        Scene { name: "cornell 36", soups: cornell(), views: box_views },
        Scene { name: "sphere 70k", soups: enclosed(displaced_sphere(132)), views },
        Scene { name: "sphere 270k", soups: enclosed(displaced_sphere(260)), views },
        Scene { name: "terrain 1M", soups: vec![terrain()], views: far_views },
    ]
}
