//! Ratios of known curves.

use super::*;
use dapple_study::Phases;

const SEEDS: std::ops::RangeInclusive<u64> = 1..=8;

/// A run whose error is `error`, times a factor for even or odd seeds, in `time` seconds.
fn run(method: &Method, spp: u64, seed: u64, error: f64, time: f64) -> Run {
    let e = error * if seed.is_multiple_of(2) { 1.1 } else { 1.0 / 1.1 };
    let errors = ["relmse", "srgb8_mse", "flip"].map(|metric| (metric, e)).into_iter().collect();
    {
        let mut run = Run::default();
        run.scene = "plain".into();
        run.method = method.clone();
        run.budget = RunBudget::Spp(spp);
        run.seed = seed;
        run.asked = spp;
        run.samples = spp;
        run.spp = spp as f64;
        run.rays = spp;
        run.seconds = Phases::default();
        run.render_s = time;
        run.errors = errors;
        run.corrected = true;
        run.rejected = 0;
        run.fresh = true;
        run
    }
}

/// Uniform sampling with error 1/n in n seconds, at 4 to 64 samples, and a method with half of that error in twice the
/// time.
fn board() -> (Board, Method) {
    let mut board = Board {
        manifests: Vec::new(),
        scenes: vec!["plain".into()],
        methods: Vec::new(),
        spp: vec![4, 8, 16, 32, 64],
        uniform: Method::new("uniform", "sobol", "none"),
        missing: 0,
        cells: BTreeMap::new(),
    };
    let other = Method::new("other", "sobol", "none");
    let curve = |spp: u64, seed| {
        let n = spp as f64;
        [run(&board.uniform, spp, seed, 1.0 / n, n), run(&other, spp, seed, 0.5 / n, 2.0 * n)]
    };
    let runs: Vec<Run> = [4, 8, 16, 32, 64]
        .into_iter()
        .flat_map(|spp| SEEDS.map(move |seed| (spp, seed)))
        .flat_map(|(n, s)| curve(n, s))
        .collect();
    board.take(runs);
    (board, other)
}

#[test]
fn half_the_error_in_twice_the_time_is_a_draw_at_equal_time() {
    let (board, other) = board();
    let ratio = |at| board.mean(&["plain"], &other, &board.uniform, at, Metric::RelMse).unwrap();
    let equal_spp = ratio(At::Spp(16));
    assert!((equal_spp.value - 0.5).abs() < 1e-12 && equal_spp.mark == Mark::Plain);
    for (spp, mark) in [(8, Mark::Plain), (16, Mark::Plain), (32, Mark::Plain), (64, Mark::Plain)] {
        let equal_time = ratio(At::TimeOf(spp));
        assert!((equal_time.value - 1.0).abs() < 1e-9 && equal_time.mark == mark, "{spp}: {}", equal_time.value);
    }
    // The least budget takes twice the time of 4 samples. It is marked, and the curve is not followed downwards.
    let least = ratio(At::TimeOf(4));
    assert!((least.value - 0.5).abs() < 1e-12 && least.mark == Mark::Slower(2.0), "{}", least.value);
}

#[test]
fn time_to_equal_error_is_that_of_the_longer_curve() {
    let (board, other) = board();
    // The error of 16 is that of uniform at 32, in the same time. The error of 64 lies beyond the curve.
    let within = board.time_to_error("plain", &other, 16, Metric::Srgb).unwrap();
    assert!((within.value - 1.0).abs() < 0.01 && within.mark == Mark::Plain, "{}", within.value);
    let beyond = board.time_to_error("plain", &other, 64, Metric::Srgb).unwrap();
    assert!((beyond.value - 1.0).abs() < 0.01 && beyond.mark == Mark::Beyond, "{}", beyond.value);
}

#[test]
fn a_scene_without_a_ratio_takes_the_mean_with_it() {
    let (mut board, other) = board();
    let mean = |board: &Board| board.mean(&["plain", "missing"], &other, &board.uniform, At::Spp(16), Metric::Flip);
    assert!(mean(&board).is_none());
    let copies: Vec<Run> = board
        .runs()
        .map(|run| {
            let mut run = run.clone();
            run.scene = "missing".into();
            run
        })
        .collect();
    board.take(copies);
    assert!(mean(&board).is_some());
}
