//! Counts by divergences, whose scores are those of their definitions.

use crate::support::{Field, VARIANCE, frame, mean_of_columns, random, run};
use dapple_classics::{Divergence, DivergenceOptions, SamplingMethod as _};
use dapple_core::options::Options as _;
use dapple_core::plan::{BudgetLeft, Feedback, Plan, Stopping};
use dapple_core::{Error, Estimate, Film, FirstHit, Limits, Needs, Sampler as _};

fn options(values: &str) -> DivergenceOptions {
    DivergenceOptions::parse(values).unwrap()
}

#[test]
fn only_scores_of_single_samples_store_any() {
    for by in ["kl", "chi2", "hellinger", "entropy", "geometric", "tsallis", "fuzzy", "gh"] {
        let recorders = options(&format!("by={by}")).recorders();
        let bytes: Vec<_> = recorders.iter().map(|one| [5, 8, 99].map(|n| one.bytes(n))).collect();
        let stores = ["fuzzy", "gh"].contains(&by);
        assert!(bytes.iter().all(|&[a, b, c]| if stores { [a, b, c] == [60, 96, 96] } else { a == c }), "{by}");
        assert!(!stores || bytes.len() == 1);
    }
}

/// Flat on the left, noise on the right.
fn half_noise() -> impl dapple_core::Integrator {
    Field(|[x, _]: [u32; 2], u: [f32; 4]| [if x < 16 { 0.5 } else { u[0] }; 3])
}

#[test]
fn noise_gets_the_samples_by_every_divergence() {
    for by in ["kl", "chi2", "hellinger", "entropy", "tsallis", "fuzzy", "gh"] {
        let mut sampler = Divergence::with_options(random(2), options(&format!("by={by}"))).unwrap();
        let film = run(&mut half_noise(), &mut sampler, [32, 32], &Limits::spp(32.0));
        let flat = mean_of_columns(&film, 0..16, |i| film.count(i) as f64);
        assert!((8.0..12.0).contains(&flat), "{by}: {flat} samples in flat pixels");
    }
}

#[test]
fn a_threshold_stops_where_scores_are_below_it() {
    let options = options("by=chi2,mode=threshold,cap=1000,threshold=0.006");
    let mut sampler = Divergence::with_options(random(3), options).unwrap();
    let film = run(&mut half_noise(), &mut sampler, [32, 32], &Limits::spp(1e4));
    for i in 0..1024 {
        let (moments, n) = (film.moments(i), film.count(i) as f64);
        let score = moments.m2[0] / moments.mean[0] / (n * n);
        assert!(score <= 0.006 && (i % 32 >= 16 || n == 8.0), "pixel {i}: {score}");
        // The score falls with the inverse of the count.
        assert!(i % 32 < 16 || n < 200.0, "{n}");
    }
    let mean = mean_of_columns(&film, 0..32, |i| film.count(i) as f64);
    assert!(mean > 16.0, "{mean}");
}

#[test]
fn saved_states_of_others_are_refused() {
    let mut sampler = Divergence::new(random(1));
    assert!(sampler.restore(&0.25f64.to_le_bytes()).is_ok() && sampler.save() == 0.25f64.to_le_bytes());
    for bytes in [&[1u8, 2][..], &f64::NAN.to_le_bytes(), &(-1f64).to_le_bytes()] {
        assert!(matches!(sampler.restore(bytes), Err(Error::BadSnapshot { .. })));
    }
}

/// The mean score of a film's pixels: the threshold that a sampler chooses and keeps.
fn mean_score(values: &str, film: &Film) -> f64 {
    let budget = BudgetLeft::new(1 << 40).with_spent(film.record().samples);
    let (mut chosen, mut plan) = (None, Plan::empty(film.frame().pixels()));
    let options = options(values).mode(Stopping::Threshold);
    options.refine(&Feedback::new(1, film, budget), 1, &mut chosen, &mut plan).unwrap();
    chosen.unwrap()
}

fn empty(values: &str, needs: Needs, size: [u32; 2]) -> Film {
    Film::with_recorders(frame(size), options(values).needs().and(needs), options(values).recorders())
}

/// The score of one pixel of grey samples.
fn score(values: &str, samples: &[f64]) -> f64 {
    let mut film = empty(values, Needs::none(), [1, 1]);
    samples.iter().for_each(|&x| film.push(0, 0, [x as f32; 3]));
    mean_score(values, &film)
}

#[track_caller]
fn close(found: f64, expected: f64) {
    assert!((found - expected).abs() < 1e-9 * (1.0 + expected.abs()), "{found}, not {expected}");
}

/// To the digits of the film's squared deviations, which are `f32`.
#[track_caller]
fn close_in_f32(found: f64, expected: f64) {
    assert!((found - expected).abs() < 1e-7 * (1.0 + expected.abs()), "{found}, not {expected}");
}

/// Samples of some kinds: one with light, pairs, and others.
const SAMPLES: [&[f64]; 4] =
    [&[0.25, 1.5, 0.0, 3.0, 0.75], &[2.0, 2.5], &[1.0, 0.0, 0.0, 8.0], &[0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0]];

#[test]
fn scores_are_those_of_their_definitions() {
    for samples in SAMPLES {
        let (n, sum) = (samples.len() as f64, samples.iter().sum::<f64>());
        let mean = sum / n;
        let over = |f: &dyn Fn(f64) -> f64| samples.iter().map(|x| f(x / sum)).sum::<f64>();
        let entropy = -over(&|p| if p > 0.0 { p * p.ln() } else { 0.0 });
        let hellinger = over(&|p| (p.sqrt() - (1.0 / n).sqrt()).powi(2) / 2.0).sqrt();
        close(score("by=kl", samples), mean / n * (n.ln() - entropy));
        close_in_f32(score("by=chi2", samples), mean / n * over(&|p| (p - 1.0 / n).powi(2) * n));
        close(score("by=hellinger", samples), mean / n * hellinger);
        close(score("by=entropy", samples), mean * (1.0 - entropy / n.ln()));
        for q in [0.5, 2.0] {
            let tsallis = (1.0 - over(&|p| p.powf(q))) / (q - 1.0);
            let contrast = 1.0 - tsallis / ((1.0 - n.powf(1.0 - q)) / (q - 1.0));
            close_in_f32(score(&format!("by=tsallis,q={q}"), samples), mean * contrast);
        }
        close(score("by=tsallis,q=1", samples), mean * (1.0 - entropy / n.ln()));
        // One half is Hellinger's, and 1 the total variation.
        close(score("by=gh,a=0.5", samples), mean / n * hellinger);
        for a in [0.25, 0.75, 1.0] {
            let power = over(&|p| (p.powf(a) - (1.0 / n).powf(a)).abs().powf(1.0 / a)) / 2.0;
            close(score(&format!("by=gh,a={a}"), samples), mean / n * power.powf(a));
        }
    }
    // The mean is 1, and all samples deviate by 1: a membership of one half, whose entropy is one bit.
    close(score("by=fuzzy", &[0.0, 2.0, 0.0, 2.0]), (4.0f64 / 3.0).sqrt());
    // The mean is 2: two samples deviate by 2, two are the mean.
    close(score("by=fuzzy", &[0.0, 4.0, 2.0, 2.0]), 0.5 * (8.0f64 / 3.0).sqrt());
    // A membership of 3/4.
    let entropy = -(0.75f64.log2() * 0.75 + 0.25f64.log2() * 0.25);
    close(score("by=fuzzy,k=3", &[0.0, 2.0]), entropy * 2.0f64.sqrt());
}

#[test]
fn scores_are_weighted_by_channels_and_black_pixels_have_none() {
    let mut film = Film::new(frame([2, 1]), VARIANCE);
    for x in [1.0, 3.0] {
        film.push(0, 0, [0.0, x, 0.0]);
        film.push(1, 0, [0.0; 3]);
    }
    // Green: mean 2, population variance 1, n = 2. The mean of two pixels.
    close(mean_score("by=chi2", &film), 0.5 * 0.715 * 0.25 * 2.0 / 2.0);
}

#[test]
fn constant_black_and_single_samples_have_a_score_of_zero() {
    let sums = ["kl", "chi2", "hellinger", "entropy", "tsallis,q=0.5", "tsallis,q=2"];
    let singles = ["fuzzy,k=0.001", "fuzzy", "fuzzy,k=1000", "gh,a=0.000000001", "gh,a=0.01", "gh,a=0.5", "gh"];
    let equal = [0.1f32, 0.7, 1e20, f32::MAX].into_iter().flat_map(|x| [2, 5, 8].map(|n| vec![f64::from(x); n]));
    for samples in [vec![], vec![3.0], vec![0.0], vec![0.0; 8]].into_iter().chain(equal) {
        for by in singles.iter().chain(&sums) {
            assert_eq!(score(&format!("by={by}"), &samples), 0.0, "{samples:?}, {by}");
        }
    }
    // Powers that underflow without their common factor.
    for samples in [&[1.0, 2.0][..], &[f64::from(f32::MAX), 0.0], &[1e-45, 0.0, 0.0]] {
        let scale = samples.iter().map(|&x| f64::from(x as f32)).sum::<f64>() / (samples.len() as f64).powi(2);
        for by in singles {
            let range = if by.starts_with("gh") { 1e-12 * scale..=1.000_001 * scale } else { 0.0..=1e39 };
            assert!(range.contains(&score(&format!("by={by}"), samples)), "{samples:?}, {by}");
        }
    }
}

#[test]
fn scores_read_the_first_samples_of_all_halves_and_no_more() {
    let values: Vec<f32> = (0..24).map(|k| 1.0 + (k * k % 7) as f32).collect();
    let score = |needs: Needs, pilot: u32, taken: usize| {
        let values_of = format!("by=fuzzy,pilot={pilot}");
        let mut film = empty(&values_of, needs, [1, 1]);
        let half = |k: usize| if needs.halves { k % 2 } else { 0 };
        (0..taken).for_each(|k| film.push(0, half(k), [0.0, values[k], 0.0]));
        mean_score(&values_of, &film)
    };
    for (pilot, taken, read) in [(8, 24, 8), (5, 24, 5), (20, 24, 8), (8, 3, 3)] {
        for needs in [Needs::none(), Needs::none().with_halves()] {
            close(score(needs, pilot, taken), score(Needs::none(), 128, read));
        }
    }
}

const EYE: [f64; 3] = [3.0, -2.0, 5.0];

/// A hit on a surface that faces along the last axis.
fn hit(position: [f32; 3]) -> FirstHit {
    let d: f64 = (0..3).map(|c| (f64::from(position[c]) - EYE[c]).powi(2)).sum();
    FirstHit::new(position, [0.0, 0.0, 1.0], d.sqrt() as f32)
}

/// The contrast of non-negative values: 1 less the entropy of their shares, relative to the largest one.
fn contrast(values: &[f64]) -> f64 {
    let sum: f64 = values.iter().sum();
    let entropy = values.iter().filter(|&&v| v > 0.0).map(|v| v / sum * (v / sum).ln()).sum::<f64>();
    if sum > 0.0 { 1.0 + entropy / (values.len() as f64).ln() } else { 0.0 }
}

/// Surfaces count by `cos / d^2`; where all lie in a plane, the camera is unknown, and the cosine is taken as 1.
#[test]
fn geometric_scores_are_those_of_hits_seen_from_the_camera() {
    let near = |i: usize, k: u32| hit([3.0 + 0.01 * i as f32, -2.0 + 0.01 * k as f32, 0.01 * (i * i % 5) as f32]);
    let scene = |scene: u32, i: usize, k: u32| match (scene, i) {
        (0, _) => Some(hit([i as f32, k as f32, (i * i % 7) as f32])),
        (1, _) => Some(hit([i as f32, k as f32, 0.0])),
        // One sample of four misses.
        (2, 0) => (k > 0).then(|| near(i, k)),
        // One sample of four sees a surface at twice the distance.
        (2, 1) if k == 0 => Some(hit([3.0, -2.0, -5.0])),
        (2, 2) | (3, _) => None,
        _ => Some(near(i, k)),
    };
    for number in 0..4 {
        let mut film = empty("by=geometric,pilot=4", Needs::none(), [4, 4]);
        let mut expected = 0.0;
        for i in 0..16 {
            let hits = [0, 1, 2, 3].map(|k| scene(number, i, k));
            hits.iter().for_each(|&h| film.push_estimate(i, 0, &Estimate::new([1.0; 3]).with_first_hit(h)));
            let seen = |hit: FirstHit| {
                let d = f64::from(hit.depth);
                (if number == 1 { d } else { EYE[2] - f64::from(hit.position[2]) }) / d.powi(3)
            };
            expected += contrast(&hits.map(|hit| hit.map_or(0.0, seen))) / 16.0;
        }
        let found = mean_score("by=geometric,pilot=4", &film);
        assert!((found - expected).abs() <= 1e-5 * expected, "{number}: {found}, not {expected}");
    }
}
