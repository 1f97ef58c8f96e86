//! Furnaces: scenes whose radiance is known, since it is the same everywhere.
#![allow(clippy::print_stderr)]

use crate::support::*;

/// The smallest distance between seeds, so that tests never share samples, even after doubling.
const SEED: u64 = 7100;
/// The number of tests in this file, which determines the false-alarm rate of each.
const TESTS: usize = 64;

/// Tests equivalence with `reference` within the relative tolerance `delta`. Samples are doubled while undecided, up to `most`
/// spp. With 255 degrees of freedom Student's t is 1.03 times as large as a normal deviate.
fn equivalent(scene: &Scene, reference: f64, delta: f64, most: u64) -> Verdict {
    let z = 1.03 * critical(sidak(FAMILY, TESTS));
    let mut spp = 16;
    loop {
        let found = pixel_mean(&image(scene, spp, SEED + spp), 1);
        let verdict = found.equals(reference, delta * reference, z);
        if verdict != Verdict::Undecided || spp >= most {
            eprintln!("  {spp} spp: {found:?} of {reference}, {verdict:?}");
            return verdict;
        }
        spp *= 2;
    }
}

/// Returns the inside of a closed surface with albedo `rho` and emission 1.
fn furnace(inside: Geometry, rho: f32, depth: Option<u32>) -> Scene {
    let mut scene = scene([32, 32], 70.0, DVec3::new(0.2, 0.3, -0.1), DVec3::new(-0.9, 0.5, 0.4));
    let wall = add_material(&mut scene, diffuse(rho));
    let number = add(&mut scene, inside, DAffine3::IDENTITY, wall, Some(1.0));
    scene.shapes[number].reversed = true;
    scene.max_depth = depth;
    scene
}

fn insides() -> [Geometry; 2] {
    [Geometry::Sphere { radius: 1.0 }, Geometry::Mesh(Arc::new(cube()))]
}

fn closed_form(rho: f32, depth: Option<u32>) -> f64 {
    let rho = f64::from(rho);
    let lost = depth.map_or(0.0, |d| rho.powi(d as i32 + 1));
    (1.0 - lost) / (1.0 - rho)
}

fn check_furnaces(cases: &[(f32, Option<u32>, f64)], most: u64) {
    for inside in insides() {
        for &(rho, depth, delta) in cases {
            let scene = furnace(inside.clone(), rho, depth);
            let verdict = equivalent(&scene, closed_form(rho, depth), delta, most);
            assert_eq!(verdict, Verdict::Pass, "{}, albedo {rho}, depth {depth:?}, within {delta}", inside.name());
        }
    }
}

/// Tolerances of noisy cases are 0.4 to 10 %. The slow test has 0.1 %, which takes minutes with roulette.
#[test]
fn closed_furnace_has_its_closed_form_l01() {
    let rhos = thorough(&[0.5, 0.99][..], &[0.0, 0.5, 0.9, 0.99]);
    let exact = rhos.iter().flat_map(|rho| [0, 1, 3].map(|d| (*rho, Some(d), 1e-3)));
    let noisy =
        [(0.5, None, 4e-3), (0.9, Some(30), 3e-2), (0.5, Some(12), 4e-3), (0.9, None, 3e-2), (0.99, None, 1e-1)];
    check_furnaces(&exact.chain(noisy.into_iter().take(thorough(2, 5))).collect::<Vec<_>>(), 1024);
}

#[test]
#[ignore = "half an hour: cargo test --release -p dapple-renderer --test renderer -- --ignored furnace::l01"]
fn closed_furnace_to_a_thousandth_l01() {
    check_furnaces(&[(0.5, Some(12), 1e-3), (0.5, None, 1e-3), (0.9, Some(30), 1e-3), (0.9, None, 1e-3)], 1 << 16);
    check_furnaces(&[(0.99, None, 5e-3)], 1 << 16);
}

/// Negative control: the test detects a loss of half a percent of reflected light. A wrong reference is refuted, not merely
/// undecided.
#[test]
fn sees_a_leak_of_half_a_percent_l01() {
    for (inside, (rho, wrong)) in
        insides().into_iter().flat_map(|i| [(0.4975, 1.0), (0.5, 1.002)].map(|c| (i.clone(), c)))
    {
        let reference = wrong * closed_form(0.5, Some(3));
        assert_eq!(equivalent(&furnace(inside, rho, Some(3)), reference, 1e-3, 1024), Verdict::Fail);
    }
}

/// The bundled furnace is white for any seed of the sampler.
#[test]
fn bundled_furnace_is_white_l01() {
    let scene = bundle("furnace");
    let found: Mean = (0..4).flat_map(|seed| pixels(&image(&scene, 4, SEED + seed))).map(|p| p[0]).collect();
    assert_eq!(found.equals(1.0, 5e-3, critical(sidak(FAMILY, TESTS))), Verdict::Pass, "{found:?}");
}

/// Returns a body of albedo `rho` in the middle of the view, under an environment of radiance `sky`.
fn white_body(body: &MeshData, rho: f32, sky: f32) -> Scene {
    let mut scene = scene([16, 16], 35.0, DVec3::new(2.5, -3.5, 2.0), DVec3::new(0.0, 0.0, 0.1));
    let white = add_material(&mut scene, diffuse(rho));
    add(&mut scene, Geometry::Mesh(Arc::new(body.clone())), DAffine3::IDENTITY, white, None);
    add_sky(&mut scene, sky);
    scene.max_depth = None;
    scene
}

/// Returns a cube without its lid, in which light is reflected repeatedly. Its walls have no thickness.
fn open_box() -> MeshData {
    let mut body = cube();
    let lid = |t: &[u32; 3]| t.iter().all(|&v| body.positions[v as usize].z > 0.0);
    body.triangles = body.triangles.iter().filter(|t| !lid(t)).copied().collect();
    body
}

#[test]
fn white_body_is_invisible_l02() {
    for body in &[open_box(), cube()][..thorough(1, 2)] {
        assert_eq!(equivalent(&white_body(body, 1.0, 1.0), 1.0, 1e-3, 8192), Verdict::Pass);
        // A sky brighter by a power of two gives the same image, to the bit.
        let [half, one, two] = [0.5, 1.0, 2.0].map(|sky| pixels(&image(&white_body(body, 1.0, sky), 4, SEED)));
        let scaled = |by: f64| -> Vec<_> { one.iter().map(|p| p.map(|x| by * x)).collect() };
        assert!(half == scaled(0.5) && two == scaled(2.0));
        // Negative control: a body that absorbs one percent.
        assert_eq!(equivalent(&white_body(body, 0.99, 1.0), 1.0, 1e-3, 2048), Verdict::Fail);
    }
}

/// No single pixel deviates. Samples are independent, so that each pixel's error can be estimated.
#[test]
fn no_pixel_stands_out_l02() {
    let world = world(&white_body(&open_box(), 1.0, 1.0));
    let film = film_with(&world, [16, 16], 1024, Needs::none().with_variance(), Random::new(SEED));
    let deviation = |i: usize| {
        let moments = film.moments(i);
        let error = (moments.variance().expect("many samples")[0] / moments.count as f64).sqrt();
        let off = (moments.mean[0] - 1.0).abs();
        // Pixels of the sky have rounding errors only: no variance, no deviation.
        if off > 1e-6 { off / error } else { 0.0 }
    };
    let worst = (0..film.frame().pixels()).map(deviation).fold(0.0, f64::max);
    assert!(worst < critical(sidak(FAMILY, 16 * 16) / 2.0), "a pixel is off by {worst} standard errors");
}

/// Paths end even without an exit, with albedo 1 and unlimited depth.
#[test]
fn endless_paths_end_l13() {
    for inside in insides() {
        let mut scene = furnace(inside, 1.0, None);
        scene.film.resolution = [8, 8];
        let film = image(&scene, 16, SEED);
        let length = film.record().rays as f64 / film.record().samples as f64;
        // Five events before roulette, 100 after it on average; two rays each.
        assert!(film.record().rejected == 0 && (100.0..400.0).contains(&length), "{length} rays a sample");
    }
}
