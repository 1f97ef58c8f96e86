//! Warps, discrete choices, frames and weights of multiple importance sampling.

use crate::statistics::{FAMILY, chi_square, integrate, sidak};
use dapple_renderer::shading::trigonometry::turn_of;
use dapple_renderer::shading::warp::*;
use dapple_renderer::shading::{Discrete, Error, PiecewiseConstant2d, ShadingFrame, power_heuristic};
use glam::{Vec2, Vec3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;
use std::f64::consts::TAU;

const BELOW_ONE: f32 = 1.0 - 0.5 * f32::EPSILON;

/// A map from the square to directions, with inverse and density.
struct Warp {
    name: &'static str,
    sample: fn([f32; 2]) -> Vec3,
    invert: fn(Vec3) -> [f32; 2],
    pdf: fn(Vec3) -> f32,
    /// The least sampled cosine.
    lowest: f64,
}

/// Inverts [`uniform_sphere`]. At the poles the second coordinate is undefined, and 0 is returned for it.
fn invert_uniform_sphere(w: Vec3) -> [f32; 2] {
    [below_one(0.5 * (1.0 - w.z)), turn_of(w.y, w.x)]
}

/// Inverts [`uniform_hemisphere`].
fn invert_uniform_hemisphere(w: Vec3) -> [f32; 2] {
    [below_one(1.0 - w.z), turn_of(w.y, w.x)]
}

/// Inverts [`concentric_disk`].
fn invert_concentric_disk(p: Vec2) -> [f32; 2] {
    let radius = p.length();
    // In eighths of a turn from the axis of the triangle that the point lies in.
    let eighths = 8.0 * turn_of(p.y, p.x);
    let (a, b) = if !(1.0..7.0).contains(&eighths) {
        let from_axis = if eighths >= 7.0 { eighths - 8.0 } else { eighths };
        (radius, radius * from_axis)
    } else if eighths < 3.0 {
        (radius * (2.0 - eighths), radius)
    } else if eighths < 5.0 {
        (-radius, radius * (4.0 - eighths))
    } else {
        (radius * (eighths - 6.0), -radius)
    };
    [below_one(0.5 * (a + 1.0)), below_one(0.5 * (b + 1.0))]
}

/// Inverts [`cosine_hemisphere`].
fn invert_cosine_hemisphere(w: Vec3) -> [f32; 2] {
    invert_concentric_disk(Vec2::new(w.x, w.y))
}

/// Inverts [`uniform_triangle`].
fn invert_uniform_triangle(b: [f32; 3]) -> [f32; 2] {
    let sum = b[0] + b[1];
    if b[1] > b[0] { [below_one(2.0 * b[0]), below_one(sum)] } else { [below_one(sum), below_one(2.0 * b[1])] }
}

/// Inverts [`uniform_cone`]. Cones with `1 - cos` below about 1e-2 are inverted by the distance from the axis, which is
/// more precise than the cosine.
fn invert_uniform_cone(w: Vec3, cone: f32) -> [f32; 2] {
    let sin2 = w.x * w.x + w.y * w.y;
    let height = if w.z > 0.0 { one_minus_cos(sin2) } else { 1.0 - w.z };
    [below_one(height / cone), turn_of(w.y, w.x)]
}

/// Returns an inverted coordinate clamped to `[0, 1)` against rounding.
fn below_one(u: f32) -> f32 {
    u.clamp(0.0, BELOW_ONE)
}

/// `1 - cos` of the cone tested.
const CONE: f32 = 0.1;

fn directions() -> Vec<Warp> {
    vec![
        Warp {
            name: "sphere",
            sample: uniform_sphere,
            invert: invert_uniform_sphere,
            pdf: |_| uniform_sphere_pdf(),
            lowest: -1.0,
        },
        Warp {
            name: "hemisphere",
            sample: uniform_hemisphere,
            invert: invert_uniform_hemisphere,
            pdf: |_| uniform_hemisphere_pdf(),
            lowest: 0.0,
        },
        Warp {
            name: "cosine hemisphere",
            sample: cosine_hemisphere,
            invert: invert_cosine_hemisphere,
            pdf: |w| cosine_hemisphere_pdf(w.z),
            lowest: 0.0,
        },
        Warp {
            name: "cone",
            sample: |u| uniform_cone(u, CONE),
            invert: |w| invert_uniform_cone(w, CONE),
            pdf: |_| uniform_cone_pdf(CONE),
            lowest: 1.0 - f64::from(CONE),
        },
    ]
}

/// The corners' neighbourhoods and 10^6 random points.
fn squares() -> impl Iterator<Item = [f32; 2]> {
    let ends = [0.0, 0.5 * f32::EPSILON, 0.5, BELOW_ONE];
    let corners = ends.into_iter().flat_map(move |a| ends.into_iter().map(move |b| [a, b]));
    let mut random = Pcg32::seed_from_u64(10);
    corners.chain((0..1_000_000).map(move |_| [random.random(), random.random()]))
}

/// The distance of two points of the square. The second coordinate may be an angle, whose ends are equal.
fn apart(a: [f32; 2], b: [f32; 2], angle: bool) -> f32 {
    let second = (a[1] - b[1]).abs();
    (a[0] - b[0]).abs().max(if angle { second.min(1.0 - second) } else { second })
}

#[test]
fn warps_stay_in_range_at_corners_s10() {
    for Warp { name, sample, invert, pdf, .. } in directions() {
        for u in squares() {
            let w = sample(u);
            let length = (f64::from(w.x).powi(2) + f64::from(w.y).powi(2) + f64::from(w.z).powi(2)).sqrt();
            assert!((length - 1.0).abs() <= 3e-7, "{name}({u:?}) = {w}: length {length}");
            assert!(pdf(w) > 0.0, "{name}({u:?}) = {w}: pdf {}", pdf(w));
            let back = invert(w);
            assert!(back.iter().all(|x| (0.0..1.0).contains(x)), "{name}({u:?}): {back:?}");
            // A pole and the concentric map's centre have no angle.
            let angle = name != "cosine hemisphere";
            if Vec2::new(w.x, w.y).length() > 1e-6 {
                assert!(apart(back, u, angle) < 1e-5, "{name}({u:?}) = {w}: inverted to {back:?}");
            }
        }
    }
}

#[test]
fn disk_and_triangle_warps_stay_in_range_at_corners_s10() {
    for u in squares() {
        let p = concentric_disk(u);
        assert!(p.is_finite() && p.length() <= 1.0 + 3e-7, "{u:?}: {p}");
        assert!(apart(invert_concentric_disk(p), u, false) < 1e-5, "{u:?}: {p} {:?}", invert_concentric_disk(p));
        let b = uniform_triangle(u);
        assert!(b.iter().all(|x| (0.0..=1.0).contains(x)), "{u:?}: {b:?}");
        assert!((b.iter().sum::<f32>() - 1.0).abs() <= 3e-7, "{u:?}: {b:?}");
        assert!(apart(invert_uniform_triangle(b), u, false) < 1e-5, "{u:?}: {b:?} {:?}", invert_uniform_triangle(b));
    }
    assert!(concentric_disk_pdf() > 0.0 && uniform_triangle_pdf(0.5) == 2.0);
}

/// The p-value of 10^6 samples of a direction warp on a grid of cosine x angle, against `pdf`, and the integral of
/// `pdf`.
fn chi_square_of(warp: &Warp, pdf: impl Fn(Vec3) -> f32, seed: u64) -> (f64, f64) {
    const ROWS: usize = 10;
    const COLUMNS: usize = 20;
    const SAMPLES: usize = 1_000_000;
    let span = 1.0 - warp.lowest;
    let mut random = Pcg32::seed_from_u64(seed);
    let mut observed = vec![0u64; ROWS * COLUMNS];
    for _ in 0..SAMPLES {
        let w = (warp.sample)([random.random(), random.random()]);
        let row = ((f64::from(w.z) - warp.lowest) / span * ROWS as f64) as usize;
        let turn = (f64::from(w.y).atan2(f64::from(w.x)) / TAU).rem_euclid(1.0);
        observed[row.min(ROWS - 1) * COLUMNS + ((turn * COLUMNS as f64) as usize).min(COLUMNS - 1)] += 1;
    }
    let density = |z: f64, phi: f64| {
        let r = (1.0 - z * z).max(0.0).sqrt();
        f64::from(pdf(Vec3::new((r * phi.cos()) as f32, (r * phi.sin()) as f32, z as f32)))
    };
    let mut expected = Vec::new();
    for row in 0..ROWS {
        let z = [row, row + 1].map(|i| warp.lowest + span * i as f64 / ROWS as f64);
        for column in 0..COLUMNS {
            let phi = [column, column + 1].map(|i| TAU * i as f64 / COLUMNS as f64);
            expected.push(SAMPLES as f64 * integrate(&density, z, phi, 1e-9, 4));
        }
    }
    (chi_square(&observed, &expected), expected.iter().sum::<f64>() / SAMPLES as f64)
}

#[test]
fn warps_match_their_densities_s10() {
    let warps = directions();
    for (seed, warp) in warps.iter().enumerate() {
        let (p, integral) = chi_square_of(warp, warp.pdf, seed as u64);
        assert!((integral - 1.0).abs() < 1e-3, "{}: pdf integrates to {integral}", warp.name);
        assert!(p > sidak(FAMILY, warps.len()), "{}: p = {p:e}", warp.name);
    }
}

#[test]
fn disk_and_triangle_warps_match_their_densities_s10() {
    // Exact areas: rings x sectors of the disk; strips of a triangle by b0, halved by b1 / (1 - b0).
    let mut random = Pcg32::seed_from_u64(11);
    let (mut disk, mut triangle) = (vec![0u64; 200], vec![0u64; 200]);
    for _ in 0..1_000_000 {
        let u = [random.random(), random.random()];
        let p = concentric_disk(u);
        let ring = ((f64::from(p.length_squared()) * 10.0) as usize).min(9);
        let turn = (f64::from(p.y).atan2(f64::from(p.x)) / TAU).rem_euclid(1.0);
        disk[ring * 20 + ((turn * 20.0) as usize).min(19)] += 1;
        let b = uniform_triangle(u).map(f64::from);
        let strip = (((1.0 - (1.0 - b[0]).powi(2)) * 10.0) as usize).min(9);
        triangle[strip * 20 + ((b[1] / (1.0 - b[0]).max(1e-30) * 20.0) as usize).min(19)] += 1;
    }
    let expected = vec![5000.0; 200];
    for observed in [disk, triangle] {
        let p = chi_square(&observed, &expected);
        assert!(p > sidak(FAMILY, 2), "p = {p:e}");
    }
}

/// Negative control: samples proportional to the cosine are neither uniform nor those of a power of the cosine 5 %
/// higher.
#[test]
fn chi_square_rejects_a_wrong_pdf_s10() {
    let warp = &directions()[2];
    let level = sidak(FAMILY, 4);
    assert!(chi_square_of(warp, |_| uniform_hemisphere_pdf(), 1).0 < level);
    let steeper = |w: Vec3| 0.5 * 2.05 / std::f32::consts::PI * w.z.max(0.0).powf(1.05);
    assert!(chi_square_of(warp, steeper, 2).0 < level);
}

#[test]
fn narrow_cones_stay_finite_s10() {
    for cone in [1e-12, 1e-7, 1e-3, 2.0] {
        for u in squares().take(100_000) {
            let w = uniform_cone(u, cone);
            assert!((w.length() - 1.0).abs() <= 3e-7 && uniform_cone_pdf(cone) > 0.0);
            if cone < 1.0 && u[0] > 1e-3 {
                assert!(apart(invert_uniform_cone(w, cone), u, true) < 1e-5, "{cone} {u:?} {w}");
            }
        }
    }
}

#[test]
fn degenerate_weights_are_refused_or_handled_s09() {
    let coordinates = [0.0, 0.5 * f32::EPSILON, 0.3, 0.5, BELOW_ONE];
    for empty in [vec![], vec![0.0], vec![0.0; 1000], vec![-0.0; 3]] {
        let d = Discrete::new(&empty).unwrap();
        assert!(d.is_empty() && d.total() == 0.0 && coordinates.iter().all(|&u| d.sample(u).is_none()));
        assert!((0..d.len()).all(|i| d.pmf(i) == 0.0));
    }
    for (weights, only) in [(vec![2.0], 0), (vec![1e-45, 0.0, 0.0], 0), (vec![0.0, 0.0, 3e38], 2)] {
        let d = Discrete::new(&weights).unwrap();
        for u in coordinates {
            let choice = d.sample(u).unwrap();
            assert_eq!((choice.index, choice.pmf, choice.u), (only, 1.0, u));
        }
    }
    for bad in [f32::NAN, -1.0, f32::INFINITY, -f32::INFINITY] {
        assert!(matches!(Discrete::new(&[1.0, bad]), Err(Error::Weight { index: 1, .. })));
        assert!(matches!(PiecewiseConstant2d::new(&[1.0, bad], [2, 1]), Err(Error::Weight { index: 1, .. })));
    }
    // Extremes side by side: sums do not overflow, and the light one is never chosen by rounding.
    let d = Discrete::new(&[1e-38, 1e38, 1e38, 1e-38]).unwrap();
    assert_eq!(d.sample(BELOW_ONE).unwrap().index, 2);
    assert_eq!([d.pmf(1), d.pmf(2)], [0.5, 0.5]);
}

#[test]
fn discrete_samples_match_their_weights_s09() {
    let mut random = Pcg32::seed_from_u64(9);
    let mut weights: Vec<f32> = (0..1_000_000)
        .map(|_| if random.random::<f32>() < 0.3 { 0.0 } else { random.random::<f32>().powi(8) })
        .collect();
    (weights[0], weights[999_999]) = (0.0, 0.0);
    let d = Discrete::new(&weights).unwrap();
    let sum: f64 = (0..d.len()).map(|i| f64::from(d.pmf(i))).sum();
    assert!((sum - 1.0).abs() <= 1e-6, "{sum}");
    // Groups of 1000 items: single ones are below a coordinate's resolution.
    let mut observed = vec![0u64; 1000];
    let mut places = vec![0u64; 64];
    let draw = |u: f32| {
        let choice = d.sample(u).unwrap();
        assert!(weights[choice.index] > 0.0 && choice.pmf > 0.0 && (0.0..1.0).contains(&choice.u));
        assert_eq!(choice.pmf, d.pmf(choice.index));
        choice
    };
    for u in [0.0, BELOW_ONE] {
        draw(u);
    }
    let samples = 1_000_000;
    for _ in 0..samples {
        observed[draw(random.random()).index / 1000] += 1;
    }
    let expected: Vec<f64> = (0..1000)
        .map(|g| f64::from(samples) * (0..1000).map(|i| f64::from(d.pmf(1000 * g + i))).sum::<f64>())
        .collect();
    let p = chi_square(&observed, &expected);
    assert!(p > sidak(FAMILY, 3), "p = {p:e}");
    // Few items: single frequencies, and the remapped coordinate is uniform.
    let few = Discrete::new(&[3.0, 0.0, 1.0, 1e-3, 0.0]).unwrap();
    let mut seen = vec![0u64; 5];
    for _ in 0..samples {
        let choice = few.sample(random.random()).unwrap();
        seen[choice.index] += 1;
        places[(choice.u * 64.0) as usize] += 1;
    }
    let expected: Vec<f64> = (0..5).map(|i| f64::from(samples) * f64::from(few.pmf(i))).collect();
    assert!(chi_square(&seen, &expected) > sidak(FAMILY, 3), "{seen:?} {expected:?}");
    assert!(chi_square(&places, &[f64::from(samples) / 64.0; 64]) > sidak(FAMILY, 3), "{places:?}");
    // Negative control: one weight 5 % off.
    let wrong = Discrete::new(&[3.0, 0.0, 1.05, 1e-3, 0.0]).unwrap();
    let expected: Vec<f64> = (0..5).map(|i| f64::from(samples) * f64::from(wrong.pmf(i))).collect();
    assert!(chi_square(&seen, &expected) < sidak(FAMILY, 3));
}

#[test]
fn grid_samples_match_their_weights_s09() {
    for size in [[7, 5], [1, 9], [9, 1], [1000, 300]] {
        let mut random = Pcg32::seed_from_u64(size[0] as u64);
        let weights: Vec<f32> =
            (0..size[0] * size[1]).map(|i| if i % 3 == 0 { 0.0 } else { random.random::<f32>().powi(4) }).collect();
        let grid = PiecewiseConstant2d::new(&weights, size).unwrap();
        let total: f64 = weights.iter().map(|&w| f64::from(w)).sum();
        assert!((grid.mean() - total / weights.len() as f64).abs() < 1e-9);
        let mut observed = vec![0u64; weights.len()];
        let samples = 300_000;
        let corners = [0.0, BELOW_ONE].into_iter().flat_map(|a| [0.0, BELOW_ONE].map(|b| [a, b]));
        let corners: Vec<_> = corners.collect();
        for i in 0..samples + corners.len() {
            let u = corners.get(i).copied().unwrap_or_else(|| [random.random(), random.random()]);
            let (uv, pdf) = grid.sample(u).unwrap();
            assert!(uv.iter().all(|x| (0.0..1.0).contains(x)), "{uv:?}");
            let [x, y] = [0, 1].map(|k| (f64::from(uv[k]) * size[k] as f64) as usize);
            let index = y * size[0] + x;
            assert!(weights[index] > 0.0 && pdf > 0.0, "{u:?} {uv:?}");
            assert_eq!(pdf, grid.pdf(uv));
            let exact = f64::from(weights[index]) / total * weights.len() as f64;
            assert!((f64::from(pdf) / exact - 1.0).abs() < 1e-5 || exact < 1e-6, "{pdf} {exact}");
            observed[index] += u64::from(i >= corners.len());
        }
        let expected: Vec<f64> = weights.iter().map(|&w| samples as f64 * f64::from(w) / total).collect();
        let p = chi_square(&observed, &expected);
        assert!(p > sidak(FAMILY, 4), "{size:?}: p = {p:e}");
    }
    assert!(PiecewiseConstant2d::new(&[0.0; 6], [3, 2]).unwrap().sample([0.5, 0.5]).is_none());
    assert!(PiecewiseConstant2d::new(&[], [0, 0]).unwrap().is_empty());
    assert!(matches!(PiecewiseConstant2d::new(&[1.0; 5], [3, 2]), Err(Error::Shape { .. })));
}

fn worst_of(frame: &ShadingFrame) -> f64 {
    let axes = [frame.tangent, frame.bitangent, frame.normal].map(|v| v.as_dvec3());
    let mut worst: f64 = (axes[0].cross(axes[1]) - axes[2]).abs().max_element();
    for i in 0..3 {
        for j in 0..=i {
            worst = worst.max((axes[i].dot(axes[j]) - f64::from(u8::from(i == j))).abs());
        }
    }
    if worst.is_finite() { worst } else { f64::INFINITY }
}

#[test]
fn frames_are_orthonormal_l12() {
    let mut random = Pcg32::seed_from_u64(12);
    let mut normals = vec![
        Vec3::Z,
        -Vec3::Z,
        Vec3::new(1.0, 0.0, -0.0),
        Vec3::new(0.0, -1.0, -0.0),
        Vec3::new(-0.0, -0.0, -1.0),
        Vec3::new(-0.6, 0.8, -0.0),
    ];
    for tilt in [1e-30, 1e-9, 1e-7, 3e-4, 1e-3] {
        for z in [1.0, -1.0] {
            normals.push(Vec3::new(tilt, -0.7 * tilt, z).normalize());
            normals.push(Vec3::new(1.0, 0.3, z * tilt).normalize());
        }
    }
    normals.extend((0..100_000).map(|_| uniform_sphere([random.random(), random.random()])));
    for n in normals {
        // f32 cannot represent every unit vector; the frame is no worse than its normal.
        let frame = ShadingFrame::from_normal(n);
        assert!(worst_of(&frame) <= 3e-7, "{n}: {frame:?} off by {:e}", worst_of(&frame));
        let w = uniform_sphere([random.random(), random.random()]);
        assert!((frame.to_world(frame.to_local(w)) - w).length() < 1e-6);
        for scale in [1e-30, 1.0, 1e30] {
            let frame = ShadingFrame::from_normal_and_tangent(n, scale * w);
            assert!(worst_of(&frame) <= 3e-7, "{n} {w}: {frame:?} off by {:e}", worst_of(&frame));
        }
        for bad in [Vec3::ZERO, n, -1e20 * n, Vec3::NAN, Vec3::INFINITY] {
            assert!(worst_of(&ShadingFrame::from_normal_and_tangent(n, bad)) <= 3e-7, "{n} {bad}");
        }
    }
}

#[test]
fn shading_normals_stay_on_the_geometric_side_l12() {
    let geometric = Vec3::new(0.0, 0.6, 0.8);
    for bad in [Vec3::ZERO, Vec3::splat(1e-8), Vec3::NAN, Vec3::INFINITY] {
        assert_eq!(ShadingFrame::from_shading_normal(bad, geometric, None).normal, geometric);
    }
    // Behind the surface: turned around, at any length.
    for length in [1e-5, 1.0, 1e30] {
        let frame = ShadingFrame::from_shading_normal(-length * Vec3::Z, geometric, Some(Vec3::X));
        assert_eq!(frame.normal, Vec3::Z);
        assert!(worst_of(&frame) <= 3e-7);
    }
}

#[test]
fn mis_weights_add_up_to_one_l09() {
    let pdfs = [0.0, 1e-45, 1e-38, 1e-3, 1.0, 7.5, 1e20, f32::MAX, f32::INFINITY];
    for a in pdfs {
        for b in pdfs {
            let (x, y) = (power_heuristic(a, b), power_heuristic(b, a));
            assert!((0.0..=1.0).contains(&x), "{a} {b}: {x}");
            let sum = if a == 0.0 && b == 0.0 { 0.0 } else { 1.0 };
            assert!((x + y - sum).abs() <= 1e-6, "{a} {b}: {x} + {y}");
        }
    }
    assert!((power_heuristic(3.0, 4.0) - 9.0 / 25.0).abs() < 1e-7);
    assert_eq!(power_heuristic(f32::NAN, 1.0), 0.0);
}
