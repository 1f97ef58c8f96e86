//! Unbiased modes are unbiased on real scenes.
//!
//! The samplers' own crates test them against closed forms (`bias.rs` of their tests). A false alarm of the whole file
//! has a probability of about 1e-6, since the tails of pooled values are approximate.

use dapple::core::{Film, Frame, Limits, Render};
use dapple::job::registry::{self, MethodInputs, SAMPLERS, Setting};
use dapple::renderer::{World, integrator};
use dapple_conformance::statistics::{FAMILY, Pixels, count_trend, image_mean, images, power, sidak, two_sided};
use dapple_scene::bundled;
use std::sync::Arc;

const SIDE: u32 = 24;
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
    "then:first=cluster-thesis,spp=2,second=adaptive/epsilon=0.01/policy=discard",
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

fn world(scene: &str) -> Arc<World> {
    let scene = bundled::files(scene).expect("bundled").read().expect("it reads");
    Arc::new(World::with_resolution(&scene, [SIDE; 2]).expect("sound"))
}

/// Images by one sampler, each with its own seed.
fn films(world: &Arc<World>, sampler: &str, spp: u64, first_seed: u64) -> Vec<Film> {
    let inputs = MethodInputs::of(world.clone());
    let frame = Frame::new(SIDE, SIDE).expect("a frame");
    let film = |seed: u64| {
        let points = registry::points("sobol", Setting { seed: first_seed + seed, spp: Some(spp) }).expect("points");
        let made = registry::sampler(sampler, points, &inputs);
        let mut sampler = made.unwrap_or_else(|e| panic!("{e}")).sampler;
        let limits = Limits::samples(spp * frame.pixels() as u64);
        Render::new(frame, &limits).run(&mut *integrator(world), &mut *sampler).expect("a film")
    };
    (0..REPLICATES).map(film).collect()
}

fn means(films: &[Film]) -> Vec<Vec<[f64; 3]>> {
    films.iter().map(|film| (0..film.frame().pixels()).map(|i| film.mean(i)).collect()).collect()
}

fn unbiased_on(scene: &str) {
    let world = world(scene);
    let reference = films(&world, "uniform", 32, 1 << 40);
    let reference_means = means(&reference);
    // Two tests for each mode, and at most two scenes in a run.
    let level = sidak(FAMILY, 4 * UNBIASED.len());
    for (k, words) in UNBIASED.into_iter().enumerate() {
        let found = films(&world, words, 8, (k as u64 + 1) << 20);
        let test = images(SIDE as usize, &means(&found), &reference_means);
        assert!(test.p() > level, "{scene}, {words}: {test:?}");
        // Counts are independent of values; except with `cross`, where the other half has a part in a pixel's count.
        if !words.ends_with("cross") {
            let pixels: Vec<Pixels> = found.iter().map(Pixels::of).collect();
            let trend = count_trend(&pixels);
            assert!(two_sided(trend) > level, "{scene}, {words}: values depend on counts, {trend}");
        }
    }
    // Negative control: pbrt-v2's published rule fails by its mean, and by counts that depend on values.
    let found = films(&world, "mitchell-pbrt:mode=threshold", 40, 1 << 30);
    let test = images(SIDE as usize, &means(&found), &reference_means);
    assert!(test.global < FAMILY && test.p() < level, "{scene}: the published rule is not caught: {test:?}");
    let pixels: Vec<Pixels> = found.iter().map(Pixels::of).collect();
    assert!(
        two_sided(count_trend(&pixels)) < level,
        "{scene}: missed dependence of values on counts: {}",
        count_trend(&pixels)
    );
    // Power: a bias of 6 % of the image's mean would be detected.
    let [a, b] = [&films(&world, UNBIASED[0], 8, 1 << 20), &reference]
        .map(|films| films.iter().map(image_mean).collect::<dapple_conformance::statistics::Mean>());
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
    let inputs = MethodInputs::of(world("cornell"));
    for entry in SAMPLERS {
        let points = registry::points("sobol", Setting { seed: 1, spp: Some(8) }).expect("points");
        let words = match entry.name {
            "mdas" => "mdas:force=1",
            "fourier-dof" => "fourier-dof:force=1",
            name => name,
        };
        let sampler = registry::sampler(words, points, &inputs).expect("a sampler").sampler;
        let policies = entry.parameters.iter().flat_map(|p| p.iter()).filter(|p| p.name == "policy").count();
        let says = sampler.describe().contains("policy=");
        let own = policies == usize::from(entry.name != "then");
        assert!(sampler.a_priori() || (own && says), "{} has no policy", sampler.describe());
        let unbiased = UNBIASED.iter().any(|words| words.split(':').next() == Some(entry.name));
        if BIASED.contains(&entry.name) {
            // The sampler has no other policy, and its description names the one that it has.
            let chosen = ["discard", "cross", "refined"].map(|policy| {
                let points = registry::points("sobol", Setting { seed: 1, spp: Some(8) }).expect("points");
                registry::sampler(&format!("{}:policy={policy}", entry.name), points, &inputs).is_ok()
            });
            assert!(chosen == [false; 3] && sampler.describe().contains("policy=keep"), "{}", sampler.describe());
            continue;
        }
        assert!(unbiased || entry.name == "uniform", "no unbiased mode of {} is tested here", entry.name);
    }
}
