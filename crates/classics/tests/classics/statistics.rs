//! Recorded sums and samples, and sums over windows.

use crate::recorders::{SampleSums, Singles, ThirdMoments};
use crate::support::{Traced, frame, random};
use crate::windows::{convolve, gaussian_taps, window_sums};
use dapple_core::film::Recorder;
use dapple_core::integrator::Trajectory;
use dapple_core::point_set::mix;
use dapple_core::samplers::Uniform;
use dapple_core::{Block, Draws, Error, Estimate, Film, Limits, Needs, PointSet as _, Render, Worker};
use std::sync::Arc;

const KINDS: [SampleSums; 3] = [SampleSums::Logs, SampleSums::Roots, SampleSums::RootMoments];

/// Recorders of everything.
fn everything() -> Vec<Arc<dyn Recorder>> {
    let singles = [Singles::All, Singles::Moving, Singles::First].into_iter().flat_map(Singles::list);
    KINDS.into_iter().flat_map(SampleSums::list).chain(singles).collect()
}

/// All values of the sums in two passes: of `x ln x`, of roots, and the moments of transformed roots.
fn two_passes(samples: &[[f32; 3]]) -> [[f64; 3]; 5] {
    let of = |f: &dyn Fn(f64) -> f64| -> [f64; 3] {
        [0, 1, 2].map(|c: usize| samples.iter().map(|x| f(f64::from(x[c]))).sum::<f64>())
    };
    let root = |x: f64| 2.0 * (x.sqrt() - 1.0);
    let mean = of(&root).map(|sum| sum / samples.len().max(1) as f64);
    let power = |k: i32| {
        [0, 1, 2].map(|c: usize| samples.iter().map(|x| (root(f64::from(x[c])) - mean[c]).powi(k)).sum::<f64>())
    };
    [of(&|x| if x > 0.0 { x * x.ln() } else { 0.0 }), of(&f64::sqrt), mean, power(2), power(3)]
}

#[track_caller]
fn close(film: &Film, i: usize, samples: &[[f32; 3]]) {
    let [logs, roots, moments] = KINDS.map(|kind| kind.of(film, "a test").unwrap());
    let ThirdMoments { count, mean, m2, m3 } = moments.moments(i);
    assert_eq!(count, samples.len() as u64);
    let found = [logs.sum(i), roots.sum(i), mean, m2, m3];
    for (k, (a, b)) in found.as_flattened().iter().zip(two_passes(samples).as_flattened()).enumerate() {
        assert!((a - b).abs() <= 1e-11 * (1.0 + b.abs()), "value {k}: {a} is not {b}");
    }
}

/// Values over a wide range, some of them 0.
fn values(count: u64) -> Vec<[f32; 3]> {
    let unit = |k: u64| (mix(11 + k) >> 40) as f32 / (1 << 24) as f32;
    let of = |k: u64| [unit(3 * k), 40.0 * unit(3 * k + 1).powi(5), if unit(3 * k + 2) < 0.5 { 0.0 } else { 2.0 }];
    (0..count).map(of).collect()
}

fn film(needs: Needs, samples: &[[f32; 3]], half: impl Fn(usize) -> usize) -> Film {
    let mut film = Film::with_recorders(frame([2, 1]), needs, everything());
    samples.iter().enumerate().for_each(|(k, &x)| film.push(1, half(k), x));
    film
}

#[test]
fn sums_agree_with_two_passes_for_any_number_of_samples() {
    for count in [0, 1, 2, 3, 7, 500] {
        let all = values(count);
        close(&film(Needs::none(), &all, |_| 0), 1, &all);
        close(&film(Needs::none(), &all, |_| 0), 0, &[]);
        for cut in [0, 1, count / 2, count] {
            close(&film(Needs::none().with_halves(), &all, |k| usize::from(k as u64 >= cut)), 1, &all);
        }
    }
}

#[test]
fn rejected_samples_count_as_zero() {
    let film = film(Needs::none(), &[[0.25; 3], [f32::NAN; 3], [4.0; 3], [-1.0; 3]], |_| 0);
    close(&film, 1, &[[0.25; 3], [0.0; 3], [4.0; 3], [0.0; 3]]);
    let samples = Singles::All.of(&film, "a test").unwrap();
    assert!(samples.of_half(0, 1).map(|(x, _)| x[0]).eq([0.25, 0.0, 4.0, 0.0]));
}

#[test]
fn films_without_a_recorder_are_refused() {
    let film = Film::with_recorders(frame([1, 1]), Needs::none(), Singles::First.list());
    assert!(Singles::First.of(&film, "reader").is_ok());
    for refused in [Singles::All, Singles::Moving].map(|singles| singles.of(&film, "reader").err()) {
        assert!(refused.is_some_and(|error| error.to_string().starts_with("reader reads individual samples")));
    }
    assert!(matches!(SampleSums::Logs.of(&film, "reader"), Err(Error::NotRecorded { .. })));
}

/// Noise, which is NaN in one sample of eight.
fn noise(u: [f32; 4]) -> [f32; 3] {
    if u[3] < 0.125 { [f32::NAN, 1.0, 1.0] } else { [u[0], 8.0 * u[1], u[2] * u[3]] }
}

fn trajectory(u: [f32; 4]) -> Trajectory {
    Trajectory { inverse_depth: if u[3] < 0.125 { f32::NAN } else { u[0] }, motion: [u[1], -u[2], u[3]] }
}

/// The words that are recorded of a sample with these random numbers.
fn expected(u: [f32; 4]) -> ([f32; 3], Trajectory) {
    if u[3] < 0.125 { ([0.0; 3], Trajectory::default()) } else { (noise(u), trajectory(u)) }
}

#[test]
fn samples_are_those_of_the_points_in_either_half() {
    for halves in [false, true] {
        let needs = Singles::Moving.needs();
        let needs = if halves { needs.with_halves() } else { needs };
        let limits = Limits::samples(40 * 19 + 7);
        let render = Render::new(frame([8, 5]), &limits).needs(needs).recorders(everything());
        let mut moving = Traced(|draws: &Draws<'_>, _: &mut Worker| {
            let u = draws.block(Block::new(0));
            let mut estimate = Estimate::new(noise(u));
            estimate.trajectory = draws.wants_trajectory().then(|| trajectory(u));
            estimate
        });
        let film = render.run(&mut moving, &mut Uniform::new(random(3))).unwrap();
        let of = |singles: Singles| singles.of(&film, "a test").unwrap();
        let mut read = 0;
        for (i, (half, (number, sample))) in (0..40).flat_map(|i| of(Singles::Moving).of_pixel(i).map(move |s| (i, s)))
        {
            let id = film.sample_id(half, i, number);
            assert_eq!(sample, expected(random(3).block(id, 0)), "{id:?}");
            assert_eq!(of(Singles::All).of_half(half, i).nth(number), Some((sample.0, Trajectory::default())));
            let first = of(Singles::First).of_half(half, i).nth(number).map(|(x, _)| x);
            assert_eq!(first, (number < 8).then_some(sample.0));
            read += 1;
        }
        assert_eq!(read, film.record().samples);
    }
}

#[test]
fn convolution_agrees_with_the_double_sum() {
    let (size, taps) = ([5, 4], [0.2, 0.5, 0.3, 0.7, 0.1]);
    let values: Vec<[f64; 2]> = (0..20).map(|i| [f64::from(i * i % 7), f64::from(i % 3)]).collect();
    let got = convolve(size, &taps, &values);
    for (i, got) in got.iter().enumerate() {
        let mut wanted = [0.0; 2];
        for (j, value) in values.iter().enumerate() {
            let at = [j % 5 + 2, j / 5 + 2].into_iter().zip([i % 5, i / 5]);
            let weight: f64 = at.map(|(j, i)| taps.get(j.wrapping_sub(i)).copied().unwrap_or(0.0)).product();
            (0..2).for_each(|c| wanted[c] += weight * value[c]);
        }
        (0..2).for_each(|c| assert!((got[c] - wanted[c]).abs() < 1e-12, "{i}: {got:?}, not {wanted:?}"));
    }
}

#[test]
fn gaussians_have_their_deviation() {
    for sigma in [1.0, 2.0, 8.0] {
        let taps = gaussian_taps(sigma);
        let reach = (taps.len() / 2) as f64;
        let variance: f64 = taps.iter().enumerate().map(|(k, tap)| tap * (k as f64 - reach).powi(2)).sum();
        // The cut at 3 standard deviations leaves out up to 2.7 % of the variance.
        assert!((0.97..1.0).contains(&(variance / (sigma * sigma))), "{sigma}: {variance}");
        assert!((taps.iter().sum::<f64>() - 1.0).abs() < 1e-14);
    }
}

#[test]
fn window_sums_match_brute_force() {
    for ([w, h], radius) in [([5, 4], 1), ([5, 4], 7), ([1, 1], 2), ([9, 1], 3)] {
        let value = |i: usize| [(i * i % 17) as f64, 1.0];
        let sums = window_sums([w, h], radius, value);
        for (i, sum) in sums.iter().enumerate() {
            let inside = (0..w * h)
                .filter(|k| (k % w).abs_diff(i % w) <= radius && (k / w).abs_diff(i / w) <= radius)
                .map(value);
            let expected = inside.fold([0.0; 2], |a, b| [a[0] + b[0], a[1] + b[1]]);
            assert_eq!(*sum, expected, "{w}x{h}, radius {radius}, pixel {i}");
        }
    }
}
