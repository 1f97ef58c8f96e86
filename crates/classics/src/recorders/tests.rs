use super::*;
use crate::test_scenes::{Field, frame, run};
use dapple_core::samplers::Uniform;
use dapple_core::{
    Block, Draws, Estimate, Feedback, Integrator, Limits, Plan, PointSet, Progress, Render, SampleId, Sampler, Worker,
    mix, streams,
};
use dapple_low_discrepancy::Random;
use std::ops::Range;

const KINDS: [SampleSums; 3] = [SampleSums::Logs, SampleSums::Roots, SampleSums::RootMoments];

/// Recorders of everything.
fn everything() -> Vec<Arc<dyn Recorder>> {
    let singles = [Singles::ALL, Singles::MOVING, Singles::first(3)].into_iter().flat_map(Singles::list);
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
    let mut film = Film::with_recorders(frame(2, 1), needs, everything());
    samples.iter().enumerate().for_each(|(k, &x)| film.push(1, half(k), x));
    film
}

#[test]
fn sums_agree_with_two_passes_for_any_number_of_samples() {
    for count in [0, 1, 2, 3, 7, 500] {
        let all = values(count);
        close(&film(Needs::none(), &all, |_| 0), 1, &all);
        close(&film(Needs::none(), &all, |_| 0), 0, &[]);
    }
}

#[test]
fn merged_halves_are_those_of_all_values() {
    let all = values(40);
    for cut in [0, 1, 2, 13, 39, 40] {
        close(&film(Needs::none().with_halves(), &all, |k| usize::from(k >= cut)), 1, &all);
    }
}

#[test]
fn rejected_samples_count_as_zero() {
    let film = film(Needs::none(), &[[0.25; 3], [f32::NAN; 3], [4.0; 3], [-1.0; 3]], |_| 0);
    close(&film, 1, &[[0.25; 3], [0.0; 3], [4.0; 3], [0.0; 3]]);
    let samples = Singles::ALL.of(&film, "a test").unwrap();
    assert!(samples.of_half(0, 1).map(|(x, _)| x[0]).eq([0.25, 0.0, 4.0, 0.0]));
}

#[test]
fn films_without_a_recorder_are_refused() {
    let film = Film::with_recorders(frame(1, 1), Needs::none(), Singles::first(3).list());
    assert!(Singles::first(3).of(&film, "reader").is_ok());
    for refused in [Singles::first(4), Singles::ALL, Singles::MOVING].map(|singles| singles.of(&film, "reader").err()) {
        assert!(refused.is_some_and(|error| error.to_string().starts_with("reader reads samples one by one")));
    }
    assert!(matches!(SampleSums::Logs.of(&film, "reader"), Err(Error::NotRecorded { .. })));
}

/// Noise with a trajectory, which is NaN in one sample of eight.
struct Moving;

fn noise(u: [f32; 4]) -> [f32; 3] {
    if u[3] < 0.125 { [f32::NAN, 1.0, 1.0] } else { [u[0], 8.0 * u[1], u[2] * u[3]] }
}

fn trajectory(u: [f32; 4]) -> Trajectory {
    Trajectory::new(if u[3] < 0.125 { f32::NAN } else { u[0] }, [u[1], -u[2], u[3]])
}

impl Integrator for Moving {
    fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
        let u = draws.block(Block::new(0));
        Estimate::new(noise(u)).with_trajectory(draws.wants_trajectory().then(|| trajectory(u)))
    }
}

/// The words that are recorded of a sample with these random numbers.
fn expected(u: [f32; 4]) -> ([f32; 3], Trajectory) {
    if u[3] < 0.125 { ([0.0; 3], Trajectory::default()) } else { (noise(u), trajectory(u)) }
}

#[test]
fn samples_are_those_of_the_points_in_either_half() {
    for halves in [false, true] {
        let needs = Singles::MOVING.needs();
        let needs = if halves { needs.with_halves() } else { needs };
        let limits = Limits::samples(40 * 9 + 7);
        let render = Render::new(frame(8, 5), &limits).needs(needs).recorders(everything());
        let film = render.run(&mut Moving, &mut Uniform::new(Random::new(3))).unwrap();
        let of = |singles: Singles| singles.of(&film, "a test").unwrap();
        let mut read = 0;
        for (i, (half, (number, sample))) in (0..40).flat_map(|i| of(Singles::MOVING).of_pixel(i).map(move |s| (i, s)))
        {
            let id = film.sample_id(half, i, number);
            assert_eq!(sample, expected(Random::new(3).block(id, 0)), "{id:?}");
            assert_eq!(of(Singles::ALL).of_half(half, i).nth(number), Some((sample.0, Trajectory::default())));
            let first = of(Singles::first(3)).of_half(half, i).nth(number).map(|(x, _)| x);
            assert_eq!(first, (number < 3).then_some(sample.0));
            read += 1;
        }
        assert_eq!(read, film.record().samples);
    }
}

/// Keeps 4 samples, then withdraws those of pixel 1 and keeps 6.
struct Withdrawing(Random);

impl Sampler for Withdrawing {
    fn name(&self) -> &str {
        "withdrawing"
    }

    fn recorders(&self) -> Vec<Arc<dyn Recorder>> {
        everything()
    }

    fn points(&self) -> &dyn PointSet {
        &self.0
    }

    fn next_round(&mut self, seen: &Feedback<'_>, plan: &mut Plan) -> Result<Progress, Error> {
        plan.counts.fill([4, 6, 0][seen.round.min(2) as usize]);
        plan.withdraw = (seen.round == 1).then(|| vec![false, true]);
        Ok(if seen.round < 2 { Progress::Trace } else { Progress::Done })
    }
}

#[test]
fn withdrawn_samples_take_what_is_recorded_along() {
    let points = Random::new(5);
    let film = run(&mut Field(|_, u| noise(u)), &mut Withdrawing(points), frame(2, 1), &Limits::samples(100));
    let of = |x: u32, indices: Range<u64>| -> Vec<[f32; 3]> {
        indices.map(|k| expected(points.block(SampleId::new([x, 0], streams::WHOLE, k), 0)).0).collect()
    };
    let kept = Singles::ALL.of(&film, "a test").unwrap();
    for (i, samples) in [(0, of(0, 0..10)), (1, of(1, 4..10))] {
        assert_eq!(kept.of_half(0, i).map(|(x, _)| x).collect::<Vec<_>>(), samples);
        close(&film, i, &samples);
    }
    let withdrawn: Vec<u32> = of(1, 0..4).as_flattened().iter().map(|x| x.to_bits()).collect();
    assert_eq!(film.recorded("samples").unwrap().discarded(0, 1), withdrawn);
}
