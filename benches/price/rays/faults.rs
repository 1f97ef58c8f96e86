//! Inputs on which rays fail without a safeguard, the smallest of those tried.

use super::super::soup::{Soup, build, direction, grid, sphere};
use super::super::{Break, Result};
use super::broken;
use dapple_geometry::safeguards::{
    All, Safeguards, WithoutExact, WithoutOffsets, WithoutPadding, WithoutTies, closest, occluded, spawn_ray,
};
use dapple_geometry::{Preset, PrimitiveId, Ray};
use glam::{DVec3, Vec3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Failures, and trials.
type Count = (usize, usize);

/// The first input that fails without the safeguard (else the last), with the failures without and with it.
fn first_broken<T>(
    inputs: impl IntoIterator<Item = T>,
    without: impl Fn(&T) -> Result<Count>,
    with: impl Fn(&T) -> Result<Count>,
) -> Result<Option<(T, Count, Count)>> {
    let mut last = None;
    for input in inputs {
        let counts = (without(&input)?, with(&input)?);
        let found = counts.0.0 > 0;
        last = Some((input, counts.0, counts.1));
        if found {
            break;
        }
    }
    Ok(last)
}

pub(super) fn exact() -> Result<Vec<Break>> {
    let ((without, of), (with, _)) = (met_again::<WithoutExact, All>()?, met_again::<All, All>()?);
    let input =
        "rays that leave a single triangle, of any size from 1e-4 to 1e4, by a walk that is not told from where";
    let seen = "surfaces shadow themselves: dark dots";
    Ok(vec![broken(input.into(), seen, of, without, with)])
}

pub(super) fn padding() -> Result<Vec<Break>> {
    let spheres = [2, 3, 4, 6, 8, 12, 16, 25, 50];
    let found = first_broken(spheres, |n| escapes::<WithoutPadding>(*n), |n| escapes::<All>(*n))?;
    let seen = "closed models leak: light comes in, dark rooms have bright dots";
    Ok(found
        .into_iter()
        .map(|(n, without, with)| {
            let triangles = 4 * n * n;
            let input = format!(
                "rays from inside a closed sphere of {triangles} triangles to its vertices and edges, at three places"
            );
            broken(input, seen, without.1, without.0, with.0)
        })
        .collect())
}

pub(super) fn ties() -> Result<Vec<Break>> {
    let layers = [(1, 1), (2, 1), (2, 2), (3, 2), (4, 3), (6, 4), (8, 5)];
    let found =
        first_broken(layers, |sizes| other_winners::<WithoutTies>(*sizes), |sizes| other_winners::<All>(*sizes))?;
    let seen = "which of two coinciding surfaces is seen changes with how the tree was built: other images from the same scene";
    Ok(found
        .into_iter()
        .map(|((n, m), without, with)| {
            let triangles = 2 * (n * n + m * m);
            let input = format!("two layers in one plane, {triangles} triangles, trees of two presets");
            broken(input, seen, without.1, without.0, with.0)
        })
        .collect())
}

pub(super) fn offsets() -> Result<Vec<Break>> {
    let ((without, of), (with, _)) = (met_again::<All, WithoutOffsets>()?, met_again::<All, All>()?);
    let input =
        "rays that leave a single triangle, of any size from 1e-4 to 1e4, by a walk that is not told from where";
    let again = broken(input.into(), "large surfaces shadow themselves: dark dots", of, without, with);
    let gaps = [1e-2, 1e-3, 2e-4, 9e-5, 1e-5];
    let found = first_broken(gaps, |gap| passed_over::<WithoutOffsets>(*gap), |gap| passed_over::<All>(*gap))?;
    let seen = "light leaks through thin layers: what lies close above a surface is passed over";
    let over = found.map(|(gap, without, with)| {
        let input = format!("rays from a sheet of two triangles to another one {gap:.0e} above it");
        broken(input, seen, without.1, without.0, with.0)
    });
    Ok(std::iter::once(again).chain(over).collect())
}

/// Rays that escape from a closed sphere. They start inside, far from the origin and near it, and aim at its vertices
/// and the middles of its edges.
fn escapes<S: Safeguards>(n: u32) -> Result<Count> {
    let (mut count, mut tried) = (0, 0);
    for centre in [DVec3::ZERO, DVec3::new(0.3, -0.7, 0.11), DVec3::new(148_376.0, 1_234.0, -223_423.0)] {
        let soup = sphere(n, centre);
        let scene = build::<S>(vec![soup.clone()], Preset::default())?;
        for offset in [DVec3::ZERO, DVec3::new(0.5, -0.25, 0.125), DVec3::new(-0.7, 0.9, 0.3)] {
            let eye = (centre + offset).as_vec3();
            for triangle in &soup.1 {
                let [a, b, c] = triangle.map(|v| Vec3::from_array(soup.0[v as usize]));
                for aim in [a, b, c, (a + b) * 0.5, (b + c) * 0.5, (c + a) * 0.5] {
                    tried += 1;
                    count += usize::from(closest::<S>(&scene, &Ray::new(eye, (aim - eye).normalize())).is_none());
                }
            }
        }
    }
    Ok((count, tried))
}

/// Rays onto two layers in one plane whose nearest hit differs between presets.
fn other_winners<S: Safeguards>((n, m): (u32, u32)) -> Result<Count> {
    const RAYS: usize = 10_000;
    let layer = |n: u32| grid(n, n, |u, v| DVec3::new(u * 8.0 - 4.0, v * 8.0 - 4.0, 0.0));
    let scene = |preset| build::<S>(vec![layer(n), layer(m)], preset);
    let [one, other] = [scene(Preset::Fastest)?, scene(Preset::VerySlow)?];
    let mut rng = Pcg64Mcg::seed_from_u64(2);
    let differ = |_: &usize| {
        let [x, y] = [(); 2].map(|()| rng.random_range(-4.0..4.0));
        let ray = Ray::new(Vec3::new(x, y, 5.0), Vec3::NEG_Z);
        let winner = |scene| closest::<S>(scene, &ray).map(|hit| (hit.shape, hit.primitive));
        winner(&one) != winner(&other)
    };
    Ok(((0..RAYS).filter(differ).count(), RAYS))
}

/// Rays that leave triangles of many sizes with offsets by `L`, and hit them again in a traversal by `W` without
/// knowledge of their start.
fn met_again<W: Safeguards, L: Safeguards>() -> Result<Count> {
    let mut rng = Pcg64Mcg::seed_from_u64(3);
    let (mut count, mut tried) = (0, 0);
    for _ in 0..1000 {
        let size = 10.0_f32.powf(rng.random_range(-4.0..4.0));
        let corners: Vec<[f32; 3]> = (0..3).map(|_| std::array::from_fn(|_| rng.random_range(-size..size))).collect();
        let middle = corners.iter().fold(Vec3::ZERO, |sum, p| sum + Vec3::from_array(*p) / 3.0);
        let scene = build::<W>(vec![(corners, vec![[0, 1, 2]])], Preset::Fastest)?;
        let eye = middle + direction(&mut rng) * size;
        let ray = Ray::new(eye, middle - eye);
        let Some(hit) = scene.closest(&ray) else { continue };
        let point = scene.surface(&ray, &hit);
        for _ in 0..100 {
            let next = Ray { ends: [PrimitiveId::NONE; 2], ..spawn_ray::<L>(&point, direction(&mut rng)) };
            tried += 1;
            count += usize::from(occluded::<W>(&scene, &next));
        }
    }
    Ok((count, tried))
}

/// Rays from a sheet straight at another one just above it that miss it.
fn passed_over<L: Safeguards>(gap: f64) -> Result<Count> {
    const RAYS: usize = 1000;
    let sheet = |z: f64| -> Soup { grid(1, 1, |u, v| DVec3::new(u, v, z)) };
    let mut rng = Pcg64Mcg::seed_from_u64(4);
    let scene = build::<All>(vec![sheet(0.0), sheet(gap)], Preset::default())?;
    let mut count = 0;
    for _ in 0..RAYS {
        let [x, y] = [(); 2].map(|()| rng.random_range(0.1..0.9));
        let ray = Ray::new(Vec3::new(x, y, -1.0), Vec3::Z);
        let Some(hit) = scene.closest(&ray) else { continue };
        let next = spawn_ray::<L>(&scene.surface(&ray, &hit), Vec3::Z);
        count += usize::from(scene.closest(&next).is_none_or(|hit| hit.shape != 1));
    }
    Ok((count, RAYS))
}
