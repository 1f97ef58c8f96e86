//! Warps, discrete choices, frames and weights of multiple importance sampling.

use crate::support::*;
use dapple_renderer::shading::warp::*;
use dapple_renderer::shading::{Discrete, Error, GridCell, PiecewiseConstant2d, ShadingFrame, power_heuristic};

/// Returns points near the corners and 10^6 random points.
fn squares() -> impl Iterator<Item = [f32; 2]> {
    let ends = [0.0, 0.5 * f32::EPSILON, 0.5, BELOW_ONE];
    let corners = ends.into_iter().flat_map(move |a| ends.into_iter().map(move |b| [a, b]));
    let mut random = Pcg32::seed_from_u64(10);
    corners.chain((0..1_000_000).map(move |_| [random.random(), random.random()]))
}

/// Directions have length 1. In narrow cones, the distance from the axis keeps its precision.
#[test]
fn warps_stay_in_range_at_corners_s10() {
    for u in squares() {
        for w in [uniform_sphere(u), cosine_hemisphere(u), uniform_cone(u, 0.1)] {
            assert!((w.as_dvec3().length() - 1.0).abs() <= 3e-7, "{u:?}: {w}");
        }
        let (p, b) = (concentric_disk(u), uniform_triangle(u));
        assert!(p.is_finite() && p.length() <= 1.0 + 3e-7 && cosine_hemisphere(u).z > 0.0, "{u:?}: {p}");
        assert!(b.iter().all(|x| (0.0..=1.0).contains(x)), "{u:?}: {b:?}");
        assert!((b.iter().sum::<f32>() - 1.0).abs() <= 3e-7, "{u:?}: {b:?}");
    }
    for (cone, u) in
        [1e-12, 1e-7, 1e-3, 2.0].into_iter().flat_map(|cone| squares().take(100_000).map(move |u| (cone, u)))
    {
        let w = uniform_cone(u, cone);
        let height = f64::from(u[0]) * f64::from(cone);
        let ratio = w.truncate().as_dvec2().length_squared() / (height * (2.0 - height));
        assert!((w.length() - 1.0).abs() <= 3e-7 && uniform_cone_pdf(cone) > 0.0);
        assert!(cone > 1.0 || u[0] < 1e-3 || (ratio - 1.0).abs() < 1e-5, "{cone} {u:?} {w}: {ratio}");
    }
}

/// Height (or radius) and angle are mapped to coordinates that are uniform on the square if samples have the stated density.
/// Negative control: samples proportional to the cosine are neither uniform nor those of a power of the cosine 5 % higher.
#[test]
fn warps_match_their_densities_s10() {
    type Coordinates = fn([f32; 2]) -> [f64; 2];
    fn turn(w: Vec2) -> f64 {
        (f64::from(w.y).atan2(f64::from(w.x)) / TAU).rem_euclid(1.0)
    }
    fn of(w: Vec3, height: impl Fn(f64) -> f64) -> [f64; 2] {
        [height(w.z.into()), turn(w.truncate())]
    }
    let cases: [(&str, Coordinates, bool); 7] = [
        ("sphere", |u| of(uniform_sphere(u), |z| 0.5 * (1.0 - z)), true),
        ("cone", |u| of(uniform_cone(u, 0.1), |z| 10.0 * (1.0 - z)), true),
        ("cosine", |u| of(cosine_hemisphere(u), |z| 1.0 - z * z), true),
        ("cosine as uniform", |u| of(cosine_hemisphere(u), |z| 1.0 - z), false),
        ("cosine as steeper", |u| of(cosine_hemisphere(u), |z| 1.0 - z.powf(2.05)), false),
        ("disk", |u| [concentric_disk(u).as_dvec2().length_squared(), turn(concentric_disk(u))], true),
        (
            "triangle",
            |u| {
                let [b0, b1, _] = uniform_triangle(u).map(f64::from);
                [1.0 - (1.0 - b0).powi(2), b1 / (1.0 - b0).max(1e-30)]
            },
            true,
        ),
    ];
    for (seed, (name, coordinates, is_uniform)) in cases.into_iter().enumerate() {
        let mut random = Pcg32::seed_from_u64(seed as u64);
        let mut observed = vec![0u64; 200];
        for _ in 0..1_000_000 {
            let [x, y] = coordinates([random.random(), random.random()]);
            observed[((x * 10.0) as usize).min(9) * 20 + ((y * 20.0) as usize).min(19)] += 1;
        }
        let p = chi_square(&observed, &[5000.0; 200]);
        assert_eq!(p > sidak(FAMILY, 7), is_uniform, "{name}: p = {p:e}");
    }
    let inverses =
        [uniform_sphere_pdf() * 4.0, uniform_cone_pdf(0.1) * 0.2].map(|density| density * std::f32::consts::PI);
    assert!(inverses.iter().all(|one| (one - 1.0).abs() < 1e-6), "{inverses:?}");
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

/// A million items are tested in groups of 1000, since single items are below a coordinate's resolution; few items are tested
/// singly. Negative control: one weight 5 % off.
#[test]
fn discrete_samples_match_their_weights_s09() {
    let mut random = Pcg32::seed_from_u64(9);
    let mut weights: Vec<f32> = (0..1_000_000)
        .map(|_| if random.random::<f32>() < 0.3 { 0.0 } else { random.random::<f32>().powi(8) })
        .collect();
    (weights[0], weights[999_999]) = (0.0, 0.0);
    for (weights, group) in [(weights, 1000), (vec![3.0, 0.0, 1.0, 1e-3, 0.0], 1)] {
        let d = Discrete::new(&weights).unwrap();
        let sum: f64 = (0..d.len()).map(|i| f64::from(d.pmf(i))).sum();
        assert!((sum - 1.0).abs() <= 1e-6, "{sum}");
        let (mut observed, mut places) = (vec![0u64; weights.len() / group], vec![0u64; 64]);
        for i in 0..1_000_000 {
            let u = [0.0, BELOW_ONE].get(i).copied().unwrap_or_else(|| random.random());
            let choice = d.sample(u).unwrap();
            assert!(weights[choice.index] > 0.0 && choice.pmf > 0.0 && (0.0..1.0).contains(&choice.u));
            assert_eq!(choice.pmf, d.pmf(choice.index));
            observed[choice.index / group] += 1;
            places[(choice.u * 64.0) as usize] += 1;
        }
        let expected = |d: &Discrete| -> Vec<f64> {
            let of = |g: usize| (0..group).map(|i| f64::from(d.pmf(group * g + i))).sum::<f64>();
            (0..observed.len()).map(|g| 1e6 * of(g)).collect()
        };
        let level = sidak(FAMILY, 3);
        assert!(chi_square(&observed, &expected(&d)) > level);
        if group == 1 {
            assert!(chi_square(&places, &[1e6 / 64.0; 64]) > level, "the remapped coordinate is uniform: {places:?}");
            let wrong = Discrete::new(&[3.0, 0.0, 1.05, 1e-3, 0.0]).unwrap();
            assert!(chi_square(&observed, &expected(&wrong)) < level);
        }
    }
}

/// The rescaled random numbers are uniform in each cell.
#[test]
fn grid_samples_match_their_weights_s09() {
    for size in [[7, 5], [1, 9], [9, 1], [1000, 300]] {
        let mut random = Pcg32::seed_from_u64(size[0] as u64);
        let weights: Vec<f32> =
            (0..size[0] * size[1]).map(|i| if i % 3 == 0 { 0.0 } else { random.random::<f32>().powi(4) }).collect();
        let grid = PiecewiseConstant2d::new(&weights, size).unwrap();
        let total: f64 = weights.iter().map(|&w| f64::from(w)).sum();
        assert!((grid.total() / total - 1.0).abs() < 1e-9);
        let (mut observed, mut places) = (vec![0u64; weights.len()], vec![0u64; 64]);
        let samples = 300_000;
        let corners = [[0.0, 0.0], [0.0, BELOW_ONE], [BELOW_ONE, 0.0], [BELOW_ONE; 2]];
        for i in 0..samples + corners.len() {
            let u = corners.get(i).copied().unwrap_or_else(|| [random.random(), random.random()]);
            let GridCell { place, u } = grid.sample(u).unwrap();
            assert!(u.iter().all(|x| (0.0..1.0).contains(x)), "{u:?}");
            let index = place[1] * size[0] + place[0];
            assert!(weights[index] > 0.0, "{place:?}");
            observed[index] += u64::from(i >= corners.len());
            places[(u[0] * 8.0) as usize * 8 + (u[1] * 8.0) as usize] += u64::from(i >= corners.len());
        }
        let expected: Vec<f64> = weights.iter().map(|&w| samples as f64 * f64::from(w) / total).collect();
        for p in [chi_square(&observed, &expected), chi_square(&places, &[samples as f64 / 64.0; 64])] {
            assert!(p > sidak(FAMILY, 8), "{size:?}: p = {p:e}");
        }
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
    let odd = [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [1.0, 0.0, -0.0], [0.0, -1.0, -0.0], [-0.0, -0.0, -1.0]];
    let mut normals: Vec<Vec3> = odd.into_iter().chain([[-0.6, 0.8, -0.0]]).map(Vec3::from).collect();
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
