//! Error estimates are calibrated, and adaptive sampling loses little where it cannot win.

use dapple::core::{Block, Draws, Estimate, Film, Frame, Integrator, Limits, Needs, Render, Sampler, Worker};
use dapple::job::registry::{self, MethodInputs, Setting};
use dapple::metrics::{ratio_interval, student_t_quantile};
use dapple::renderer::{World, integrator};
use dapple_scene::bundled;

/// The same noise in every pixel: exponential, of mean and variance 1.
struct EqualNoise;

impl Integrator for EqualNoise {
    fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
        let [u, ..] = draws.block(Block::new(0));
        Estimate::new([-(1.0 - u).ln(); 3])
    }
}

fn sampler(words: &str, points: &str, seed: u64) -> Box<dyn Sampler> {
    let points = registry::points(points, Setting { seed, spp: None }).expect("points");
    registry::sampler(words, points, &MethodInputs::default()).expect("a sampler").sampler
}

fn mse_of_one(film: &Film) -> f64 {
    let pixels = film.frame().pixels();
    (0..pixels).map(|i| (film.mean(i)[0] - 1.0).powi(2)).sum::<f64>() / pixels as f64
}

/// The ratio of MSE of independent points over uniform counts: low, value and high of the 95 % interval, 24 seeds.
fn lost(words: &str) -> [f64; 3] {
    const SEEDS: u64 = 24;
    let frame = Frame::new(48, 48).expect("a frame");
    let limits = Limits::samples(32 * frame.pixels() as u64);
    let errors = |words: &str| -> Vec<f64> {
        let run = |seed| {
            let mut sampler = sampler(words, "random", seed);
            Render::new(frame, &limits).run(&mut EqualNoise, &mut *sampler).expect("a film")
        };
        (1..=SEEDS).map(|seed| mse_of_one(&run(seed))).collect()
    };
    let found = ratio_interval(&errors(words), &errors("uniform"), 0.95).expect("seeds");
    [found.low, found.value, found.high]
}

/// With equal noise everywhere little is lost: the upper 95 % bound is at most 1.05 of uniform's MSE at 32 spp.
#[test]
fn equal_noise_loses_little_against_uniform_counts_a13() {
    let [_, value, high] = lost("variance");
    assert!(high <= 1.05, "variance: {value} up to {high}");
    // Negative control: contrast within a pixel carries no information here, and following it costs a lot.
    let [low, value, _] = lost("mitchell:mode=budget");
    assert!(low > 1.05, "mitchell: {value}, from {low}");
}

const SIDE: u32 = 32;

/// A scene by uniform sampling, `spp` samples per pixel.
fn rendered(world: &World, points: &str, seed: u64, spp: u64, needs: Needs) -> Film {
    let frame = Frame::new(SIDE, SIDE).expect("a frame");
    let limits = Limits::samples(spp * frame.pixels() as u64);
    let mut sampler = sampler("uniform", points, seed);
    Render::new(frame, &limits).needs(needs).run(&mut *integrator(world), &mut *sampler).expect("a film")
}

/// The fraction of pixels and channels whose 95 % interval contains the reference, and the root of predicted over real
/// variance. Predictions are pooled over 8x8 pixels.
fn forecast(films: &[Film], reference: &[[f64; 3]], noise: &[[f64; 3]], widen: f64) -> [f64; 2] {
    let quantile = student_t_quantile(0.975, 64.0);
    let (mut held, mut all, mut told, mut real) = (0.0, 0.0, 0.0, 0.0);
    for film in films {
        for block in 0..(SIDE / 8 * SIDE / 8) as usize {
            let (x, y) = (block % (SIDE as usize / 8) * 8, block / (SIDE as usize / 8) * 8);
            let pixels: Vec<usize> = (0..64).map(|i| (y + i / 8) * SIDE as usize + x + i % 8).collect();
            for c in 0..3 {
                let variance = pixels.iter().map(|&i| film.squared_error(i).expect("halves")[c]).sum::<f64>() / 64.0;
                for &i in &pixels {
                    let off = film.mean(i)[c] - reference[i][c];
                    let reach = (widen * quantile * variance.sqrt()).hypot(1.96 * noise[i][c].sqrt());
                    held += f64::from(u8::from(off.abs() <= reach));
                    all += 1.0;
                    told += widen * widen * variance;
                    real += off * off - noise[i][c];
                }
            }
        }
    }
    [held / all, (told / real).sqrt()]
}

/// Over 64 seeds, 93 to 97 % of the 95 % intervals contain the reference, and predictions are within a tenth.
#[test]
fn predicted_errors_are_calibrated_t03() {
    let scene = bundled::files("cornell").expect("bundled").read().expect("it reads");
    let world = World::with_resolution(&scene, [SIDE; 2]).expect("sound");
    let exact = rendered(&world, "random", 1 << 32, 4096, Needs::none().with_variance());
    let pixels = (SIDE * SIDE) as usize;
    let reference: Vec<[f64; 3]> = (0..pixels).map(|i| exact.mean(i)).collect();
    let noise: Vec<[f64; 3]> =
        (0..pixels).map(|i| exact.moments(i).variance().expect("many samples").map(|v| v / 4096.0)).collect();
    let films: Vec<Film> =
        (1..=64).map(|seed| rendered(&world, "sobol", seed, 16, Needs::none().with_halves())).collect();
    let [share, ratio] = forecast(&films, &reference, &noise, 1.0);
    assert!((0.93..=0.97).contains(&share) && (0.9..=1.1).contains(&ratio), "{share} held, forecast / real {ratio}");
    // Negative control: an error of a sixth is detected.
    for widen in [0.85, 1.18] {
        let [share, ratio] = forecast(&films, &reference, &noise, widen);
        assert!(!((0.93..=0.97).contains(&share) && (0.9..=1.1).contains(&ratio)), "{widen}: {share} {ratio}");
    }
}

/// The squared error that `gem` predicts for its image, over the real one: sums over all pixels and 4 seeds, 16 spp of
/// independent points, the reference's noise subtracted. `scale` multiplies the prediction.
fn gem_forecast(scene: &str, scale: f64) -> f64 {
    let scene = bundled::files(scene).expect("bundled").read().expect("it reads");
    let world = World::with_resolution(&scene, [SIDE; 2]).expect("sound");
    let filter = registry::filter("gem", &MethodInputs::default()).expect("a filter").filter;
    let exact = rendered(&world, "sobol", 1 << 32, 1024, Needs::none().with_variance());
    let (mut told, mut real) = (0.0, 0.0);
    for seed in 1..=4 {
        let film = rendered(&world, "random", seed, 16, filter.needs());
        let filtered = filter.apply(&film).expect("an image");
        let errors = filtered.error.expect("an estimate");
        for (i, (pixel, error)) in filtered.radiance.iter().zip(errors).enumerate() {
            let noise = exact.moments(i).variance().expect("many samples").map(|v| v / 1024.0);
            told += scale * f64::from(error);
            real += (0..3).map(|c| (f64::from(pixel[c]) - exact.mean(i)[c]).powi(2) - noise[c]).sum::<f64>() / 3.0;
        }
    }
    told / real
}

/// The sum over pixels is within a factor of 2 of the truth; not on lens, where most pixels' samples miss the light.
#[test]
fn errors_that_gem_predicts_are_within_a_factor_of_two() {
    let within = |ratio: &f64| (0.5..=2.0).contains(ratio);
    let found = ["cornell", "teapot", "glass", "motion"].map(|scene| (scene, gem_forecast(scene, 1.0)));
    assert!(found.iter().all(|(_, ratio)| within(ratio)), "{found:?}");
    let lens = gem_forecast("lens", 1.0);
    assert!(lens < 0.5, "the lens is no exception any more: {lens}");
    // Negative control: a third of the error is detected.
    let scaled = gem_forecast("cornell", 1.0 / 3.0);
    assert!(!within(&scaled), "{scaled}");
}

/// A floor of two triangles under a lamp, and a ball of 10^5 triangles that casts a shadow on it.
fn ornament() -> String {
    let (rows, columns) = (160, 320);
    let mut text = String::from(
        "LookAt 0 3 5  0 .6 0  0 1 0\nCamera \"perspective\" \"float fov\" [45]\nWorldBegin\nAttributeBegin\n\
         AreaLightSource \"diffuse\" \"rgb L\" [12 12 12]\nShape \"trianglemesh\" \"integer indices\" [0 1 2 0 2 3]\n\
         \"point3 P\" [-1.5 4 -.5  -.5 4 -.5  -.5 4 .5  -1.5 4 .5]\nAttributeEnd\nMaterial \"diffuse\"\n\
         Shape \"trianglemesh\" \"integer indices\" [0 1 2 0 2 3] \"point3 P\" [-4 0 -4  -4 0 4  4 0 4  4 0 -4]\n\
         Shape \"trianglemesh\" \"integer indices\" [",
    );
    for (i, j) in (0..rows).flat_map(|i| (0..columns).map(move |j| (i, j))) {
        let at = |i: usize, j: usize| i * columns + j % columns;
        let corners = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j), at(i + 1, j + 1), at(i, j + 1)];
        text.extend(corners.map(|c| format!("{c} ")));
    }
    text.push_str("] \"point3 P\" [");
    for (i, j) in (0..=rows).flat_map(|i| (0..columns).map(move |j| (i, j))) {
        let (theta, phi) =
            (std::f64::consts::PI * i as f64 / rows as f64, std::f64::consts::TAU * j as f64 / columns as f64);
        let (r, y) = (0.8 * theta.sin(), 0.9 + 0.8 * theta.cos());
        text += &format!("{:.5} {y:.5} {:.5} ", r * phi.cos(), r * phi.sin());
    }
    text.push_str("]\n");
    text
}

/// One huge triangle under a cluster of small ones gets enough samples, at the shadow's edge on the floor. `adaptive`
/// passes. The published `cluster-thesis` undersamples it by design; its ratios are printed.
#[test]
#[ignore = "T2: 10^5 triangles, 24 seeds"]
#[allow(clippy::print_stderr)] // The published sampler's ratios are printed.
fn one_huge_triangle_gets_enough_samples_k11() {
    const SIDE: u32 = 64;
    const SEEDS: u64 = 24;
    let files = std::collections::BTreeMap::from([(std::path::PathBuf::from("s.pbrt"), ornament().into_bytes())]);
    let scene = dapple::scene::pbrt::read_scene_from(&files, "s.pbrt", &Default::default()).expect("it reads");
    let world = std::sync::Arc::new(World::with_resolution(&scene, [SIDE; 2]).expect("sound"));
    let inputs = MethodInputs::of(world.clone());
    let frame = Frame::new(SIDE, SIDE).expect("a frame");
    let film = |words: &str, spp: u64, seed: u64, needs: Needs| {
        let points = registry::points("sobol", Setting { seed, spp: Some(spp) }).expect("points");
        let mut sampler = registry::sampler(words, points, &inputs).expect("a sampler").sampler;
        let limits = Limits::samples(spp * frame.pixels() as u64);
        Render::new(frame, &limits).needs(needs).run(&mut *integrator(&world), &mut *sampler).expect("a film")
    };
    let reference = film("uniform", 4096, 1 << 32, Needs::none().with_first_hits(1));
    // The floor is the second shape.
    let floor: Vec<usize> =
        (0..frame.pixels()).filter(|&i| reference.first_hits(i)[0].is_some_and(|hit| hit.shape == 1)).collect();
    assert!(floor.len() > 1000, "{}", floor.len());
    let all: Vec<usize> = (0..frame.pixels()).collect();
    let errors = |words: &str, pixels: &[usize]| -> Vec<f64> {
        let error = |seed| {
            let film = film(words, 16, seed, Needs::none());
            let off = |i: &usize| (0..3).map(|c| (film.mean(*i)[c] - reference.mean(*i)[c]).powi(2)).sum::<f64>();
            pixels.iter().map(off).sum::<f64>()
        };
        (1..=SEEDS).map(error).collect()
    };
    for (words, asserted) in [("adaptive:epsilon=0.01", true), ("cluster-thesis", false)] {
        let [wall, whole] =
            [&floor, &all].map(|p| ratio_interval(&errors(words, p), &errors("uniform", p), 0.95).expect("seeds"));
        eprintln!("{words}: floor {:.3} ({:.3}, {:.3})", wall.value, wall.low, wall.high);
        eprintln!("{words}: all {:.3} ({:.3}, {:.3})", whole.value, whole.low, whole.high);
        assert!(!asserted || (wall.low <= 1.1 && whole.low <= 1.0), "{words}");
    }
}

/// 10^5 shapes of 2 triangles, compared with one mesh of as many triangles.
#[test]
#[ignore = "T2: timing, wants a quiet machine"]
fn many_small_shapes_load_as_fast_as_one_mesh_z05() {
    use std::fmt::Write;
    const SHAPES: usize = 100_000;
    let head = "Camera \"perspective\"\nWorldBegin\nLightSource \"infinite\"\n";
    let corners = |i: usize| {
        let (x, y) = ((i % 316) as f64, (i / 316) as f64);
        format!("{x} {y} 5  {} {y} 5  {} {} 5  {x} {} 5\n", x + 0.9, x + 0.9, y + 0.9, y + 0.9)
    };
    let mut many = String::from(head);
    let (mut indices, mut positions) = (String::new(), String::new());
    for i in 0..SHAPES {
        let at = corners(i);
        let _ = writeln!(many, "Shape \"trianglemesh\" \"integer indices\" [0 1 2 0 2 3] \"point3 P\" [{at}]");
        let n = 4 * i;
        let _ = writeln!(indices, "{n} {} {} {n} {} {}", n + 1, n + 2, n + 2, n + 3);
        positions += &at;
    }
    let one = format!("{head}Shape \"trianglemesh\" \"integer indices\" [{indices}] \"point3 P\" [{positions}]\n");
    let seconds = |text: &str| {
        let files = std::collections::BTreeMap::from([(std::path::PathBuf::from("s.pbrt"), text.as_bytes().to_vec())]);
        let clock = std::time::Instant::now();
        let scene = dapple::scene::pbrt::read_scene_from(&files, "s.pbrt", &Default::default()).expect("it reads");
        let world = World::with_resolution(&scene, [8, 8]).expect("sound");
        assert_eq!(world.geometry().triangle_count(), 2 * SHAPES);
        clock.elapsed().as_secs_f64()
    };
    let best = |text: &str| (0..3).map(|_| seconds(text)).fold(f64::INFINITY, f64::min);
    let [many, one] = [best(&many), best(&one)];
    assert!(many <= 3.0 * one, "{many} s for many, {one} s for one");
}
