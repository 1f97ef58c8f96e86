//! Error estimates are calibrated, adaptive sampling loses little where it cannot win, and unbiased modes are unbiased on real
//! scenes.
//!
//! The samplers' own crates test these against closed forms (`bias.rs` of their tests). A false alarm of the tests of bias
//! has a probability of about 1e-6, since the tails of pooled values are approximate.

use dapple_conformance::statistics::{
    Calibration, FAMILY, Mean, Pixels, count_trend, image_mean, images, power, sidak, two_sided,
};
use dapple_core::{Block, Draws, Estimate, Film, Frame, Integrator, Limits, Needs, Render, Sampler, Worker};
use dapple_job::registry::{self, MethodInputs, PointSettings, SAMPLERS};
use dapple_metrics::{ratio_interval, student_t_quantile};
use dapple_renderer::{World, integrator};
use dapple_scene::bundled;
use dapple_scene::{Scene, pbrt};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

fn sampler(words: &str, points: &str, seed: u64, spp: u64, inputs: &MethodInputs) -> Box<dyn Sampler> {
    let points = registry::points(points, PointSettings { seed, spp: Some(spp) }).expect("points");
    registry::sampler(words, points, inputs).unwrap_or_else(|e| panic!("{e}")).sampler
}

/// A scene to render, square.
struct Place {
    world: Arc<World>,
    inputs: MethodInputs,
    frame: Frame,
}

impl Place {
    fn new(scene: &Scene, side: u32) -> Self {
        let world = Arc::new(World::with_resolution(scene, [side; 2]).expect("sound"));
        Self { inputs: MethodInputs::of(world.clone()), world, frame: Frame::new(side, side).expect("a frame") }
    }

    fn bundled(name: &str, side: u32) -> Self {
        Self::new(&bundled::files(name).expect("bundled").read().expect("it reads"), side)
    }

    fn film(&self, [words, points]: [&str; 2], seed: u64, spp: u64, needs: Needs) -> Film {
        let mut sampler = sampler(words, points, seed, spp, &self.inputs);
        let limits = Limits::samples(spp * self.frame.pixels() as u64);
        Render::new(self.frame, &limits).needs(needs).run(&mut *integrator(&self.world), &mut *sampler).expect("a film")
    }
}

/// The scene of a pbrt file.
fn read(text: String) -> Scene {
    let files = BTreeMap::from([(PathBuf::from("s.pbrt"), text.into_bytes())]);
    pbrt::read_scene_from(&files, "s.pbrt", &Default::default()).expect("it reads")
}

/// The same noise in every pixel: exponential, of mean and variance 1.
struct EqualNoise;

impl Integrator for EqualNoise {
    fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
        let [u, ..] = draws.block(Block::new(0));
        Estimate::new([-(1.0 - u).ln(); 3])
    }
}

/// The ratio of MSE of independent points over uniform counts: low, value and high of the 95 % interval, 24 seeds.
fn lost(words: &str) -> [f64; 3] {
    const SEEDS: u64 = 24;
    let frame = Frame::new(48, 48).expect("a frame");
    let limits = Limits::samples(32 * frame.pixels() as u64);
    let errors = |words: &str| -> Vec<f64> {
        let error = |seed| {
            let mut sampler = sampler(words, "random", seed, 32, &MethodInputs::default());
            let film = Render::new(frame, &limits).run(&mut EqualNoise, &mut *sampler).expect("a film");
            (0..frame.pixels()).map(|i| (film.mean(i)[0] - 1.0).powi(2)).sum()
        };
        (1..=SEEDS).map(error).collect()
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

/// Predicted errors of films against real ones, pooled over 8x8 pixels and multiplied by `widen`.
fn calibration(films: &[Film], exact: &Film, widen: f64) -> Calibration {
    let quantile = student_t_quantile(0.975, 64.0);
    let [width, height] = exact.frame().size().map(|n| n as usize);
    let mut found = Calibration::default();
    for film in films {
        for (y, x) in (0..height).step_by(8).flat_map(|y| (0..width).step_by(8).map(move |x| (y, x))) {
            let pixels: Vec<usize> = (0..64).map(|i| (y + i / 8) * width + x + i % 8).collect();
            for c in 0..3 {
                let variance = pixels.iter().map(|&i| film.squared_error(i).expect("halves")[c]).sum::<f64>() / 64.0;
                for &i in &pixels {
                    found.add(
                        film.mean(i)[c],
                        widen * widen * variance,
                        exact.mean(i)[c],
                        noise(exact, i)[c],
                        quantile,
                    );
                }
            }
        }
    }
    found
}

/// The variance of a pixel's mean, by its samples.
fn noise(film: &Film, i: usize) -> [f64; 3] {
    film.moments(i).variance().expect("many samples").map(|v| v / film.count(i) as f64)
}

/// Over 64 seeds, 93 to 97 % of the 95 % intervals contain the reference, and predictions are within a tenth.
#[test]
fn predicted_errors_are_calibrated_t03() {
    let place = Place::bundled("cornell", 32);
    let exact = place.film(["uniform", "random"], 1 << 32, 1024, Needs::none().with_variance());
    let film = |seed| place.film(["uniform", "sobol"], seed, 16, Needs::none().with_halves());
    let films: Vec<Film> = (1..=64).map(film).collect();
    // Negative control: an error of a sixth is detected.
    for (widen, is_honest) in [(1.0, true), (0.85, false), (1.18, false)] {
        let found = calibration(&films, &exact, widen);
        assert_eq!(
            found.is_honest(),
            is_honest,
            "{widen}: {} held, forecast / real {}",
            found.coverage(),
            found.ratio()
        );
    }
}

/// The squared error that `gem` predicts for its image, over the real one: sums over all pixels and 4 seeds, 16 spp of
/// independent points, the reference's noise subtracted.
fn gem_forecast(scene: &str) -> f64 {
    let place = Place::bundled(scene, 32);
    let filter = registry::filter("gem", &MethodInputs::default()).expect("a filter").filter;
    let exact = place.film(["uniform", "random"], 1 << 32, 256, Needs::none().with_variance());
    let (mut told, mut real) = (0.0, 0.0);
    for seed in 1..=4 {
        let filtered = filter.apply(&place.film(["uniform", "random"], seed, 16, filter.needs())).expect("an image");
        for (i, (pixel, error)) in filtered.radiance.iter().zip(filtered.error.expect("an estimate")).enumerate() {
            let (mean, noise) = (exact.mean(i), noise(&exact, i));
            told += f64::from(error);
            real += (0..3).map(|c| (f64::from(pixel[c]) - mean[c]).powi(2) - noise[c]).sum::<f64>() / 3.0;
        }
    }
    told / real
}

/// The sum over pixels is within a factor of 2 of the truth; not on lens, where most pixels' samples miss the light.
#[test]
fn errors_that_gem_predicts_are_within_a_factor_of_two() {
    let within = |ratio: f64| (0.5..=2.0).contains(&ratio);
    let found = ["cornell", "teapot", "glass", "motion"].map(|scene| (scene, gem_forecast(scene)));
    assert!(found.iter().all(|(_, ratio)| within(*ratio)), "{found:?}");
    let lens = gem_forecast("lens");
    assert!(lens < 0.5, "the lens is no exception any more: {lens}");
    // Negative control: a third of the error is detected.
    assert!(!within(found[0].1 / 3.0), "{found:?}");
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
    const SEEDS: u64 = 24;
    let place = Place::new(&read(ornament()), 64);
    let reference = place.film(["uniform", "sobol"], 1 << 32, 4096, Needs::none().with_first_hits(1));
    // The floor is the second shape.
    let floor: Vec<usize> =
        (0..place.frame.pixels()).filter(|&i| reference.first_hits(i)[0].is_some_and(|hit| hit.shape == 1)).collect();
    assert!(floor.len() > 1000, "{}", floor.len());
    let all: Vec<usize> = (0..place.frame.pixels()).collect();
    let errors = |words: &str, pixels: &[usize]| -> Vec<f64> {
        let error = |seed| {
            let film = place.film([words, "sobol"], seed, 16, Needs::none());
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
        let text = text.to_owned();
        let clock = std::time::Instant::now();
        let world = World::with_resolution(&read(text), [8, 8]).expect("sound");
        assert_eq!(world.geometry().triangle_count(), 2 * SHAPES);
        clock.elapsed().as_secs_f64()
    };
    let best = |text: &str| (0..3).map(|_| seconds(text)).fold(f64::INFINITY, f64::min);
    let [many, one] = [best(&many), best(&one)];
    assert!(many <= 3.0 * one, "{many} s for many, {one} s for one");
}

const REPLICATES: u64 = 48;
/// Every unbiased mode of every sampler but `uniform`, the reference of the comparison.
const UNBIASED: [&str; 9] = [
    "variance:policy=discard",
    "variance:policy=cross",
    "adaptive:epsilon=0.01,policy=discard",
    "adaptive:epsilon=0.01,policy=cross",
    "mitchell:policy=discard",
    "mitchell-pbrt:policy=discard",
    "cluster-thesis",
    "fourier-dof:force=1",
    "sequence:first=cluster-thesis,spp=2,second=adaptive/epsilon=0.01/policy=discard",
];

/// Samplers without an unbiased mode, as published. In Cycles the difference between the two halves of the image decides; others
/// place samples by those that stay.
const BIASED: [&str; 14] = [
    "cycles",
    "variance-threshold",
    "ucb",
    "ears",
    "sure",
    "divergence",
    "gem",
    "nlm-loop",
    "awr",
    "perceptual",
    "mdas",
    "subdivision",
    "hierarchical",
    "dct",
];

/// Images by one sampler, each with its own seed.
fn films(place: &Place, sampler: &str, spp: u64, first_seed: u64) -> Vec<Film> {
    (0..REPLICATES).map(|seed| place.film([sampler, "sobol"], first_seed + seed, spp, Needs::none())).collect()
}

fn means(films: &[Film]) -> Vec<Vec<[f64; 3]>> {
    films.iter().map(|film| (0..film.frame().pixels()).map(|i| film.mean(i)).collect()).collect()
}

fn unbiased_on(scene: &str) {
    const SIDE: usize = 24;
    let place = Place::bundled(scene, SIDE as u32);
    let reference = films(&place, "uniform", 16, 1 << 40);
    let reference_means = means(&reference);
    // Two tests for each mode, and at most two scenes in a run.
    let level = sidak(FAMILY, 4 * UNBIASED.len());
    let mut first = None;
    for (k, words) in UNBIASED.into_iter().enumerate() {
        let found = films(&place, words, 8, (k as u64 + 1) << 20);
        first.get_or_insert_with(|| found.iter().map(image_mean).collect::<Mean>());
        let test = images(SIDE, &means(&found), &reference_means);
        assert!(test.p() > level, "{scene}, {words}: {test:?}");
        // Counts are independent of values; except with `cross`, where the other half has a part in a pixel's count.
        if !words.ends_with("cross") {
            let pixels: Vec<Pixels> = found.iter().map(Pixels::of).collect();
            let trend = count_trend(&pixels);
            assert!(two_sided(trend) > level, "{scene}, {words}: values depend on counts, {trend}");
        }
    }
    // Negative control: pbrt-v2's published rule fails by its mean, and by counts that depend on values.
    let found = films(&place, "mitchell-pbrt:mode=threshold", 40, 1 << 30);
    let test = images(SIDE, &means(&found), &reference_means);
    assert!(test.global < FAMILY && test.p() < level, "{scene}: the published rule is not caught: {test:?}");
    let pixels: Vec<Pixels> = found.iter().map(Pixels::of).collect();
    assert!(
        two_sided(count_trend(&pixels)) < level,
        "{scene}: missed dependence of values on counts: {}",
        count_trend(&pixels)
    );
    // Power: a bias of 6 % of the image's mean would be detected.
    let (a, b) = (first.expect("a mode"), reference.iter().map(image_mean).collect::<Mean>());
    let test = a.against_estimate(&b);
    let seen = power(0.06 * b.mean / test.standard_error, sidak(level, 12), test.degrees_of_freedom);
    assert!(seen > 0.99, "{scene}: {seen}, standard error {} of {}", test.standard_error, b.mean);
}

#[test]
fn unbiased_modes_match_uniform_on_the_cornell_box_a01() {
    unbiased_on("cornell");
}

#[test]
#[ignore = "T2: another scene"]
fn unbiased_modes_match_uniform_on_the_teapot_a01() {
    unbiased_on("teapot");
}

/// Every sampler either decides its counts a priori or has a parameter `policy`. A sequence has those of its samplers.
#[test]
fn every_sampler_names_its_policy() {
    let inputs = Place::bundled("cornell", 24).inputs;
    for entry in SAMPLERS {
        let words = match entry.name {
            "mdas" => "mdas:force=1",
            "fourier-dof" => "fourier-dof:force=1",
            name => name,
        };
        let sampler = sampler(words, "sobol", 1, 8, &inputs);
        let policies = entry.parameters.iter().flat_map(|p| p.iter()).filter(|p| p.name == "policy").count();
        let says = sampler.describe().contains("policy=");
        let own = policies == usize::from(entry.name != "sequence");
        assert!(sampler.a_priori() || (own && says), "{} has no policy", sampler.describe());
        let unbiased = UNBIASED.iter().any(|words| words.split(':').next() == Some(entry.name));
        if BIASED.contains(&entry.name) {
            // The sampler has no other policy, and its description names the one that it has.
            let chosen = ["discard", "cross", "refined"].map(|policy| {
                let points = registry::points("sobol", PointSettings { seed: 1, spp: Some(8) }).expect("points");
                registry::sampler(&format!("{}:policy={policy}", entry.name), points, &inputs).is_ok()
            });
            assert!(chosen == [false; 3] && sampler.describe().contains("policy=keep"), "{}", sampler.describe());
            continue;
        }
        assert!(unbiased || entry.name == "uniform", "no unbiased mode of {} is tested here", entry.name);
    }
}
