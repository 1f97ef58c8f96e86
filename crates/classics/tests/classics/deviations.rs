//! Samplers that go by the deviation of each pixel's samples.

use crate::support::{ANY, Field, Points, frame, next_counts, planned_until_done, random, run};
use dapple_classics::{
    Ears, EarsOptions, SamplingMethod as _, UpperConfidence, UpperConfidenceOptions, VarianceThreshold,
    VarianceThresholdOptions,
};
use dapple_conformance::statistics::{Bernoulli, normal_tail, student_tail};
use dapple_core::plan::{BudgetLeft, Feedback, Plan, Stopping};
use dapple_core::{Estimate, Film, Limits, Sampler as _};

fn with(options: VarianceThresholdOptions, seed: u64) -> VarianceThreshold<Points> {
    VarianceThreshold::with_options(random(seed), options).unwrap()
}

/// The standard deviation of samples of mean 1 that are nearly normal: sums of four uniform numbers.
const DEVIATION: f64 = 0.25;

/// The side of images.
const SIDE: usize = 40;
const PIXELS: f64 = (SIDE * SIDE) as f64;

/// The counts at which pixels of such samples stop, and the share whose interval contains the expectation.
fn stopped(options: VarianceThresholdOptions) -> (Vec<f64>, f64) {
    let mut near_normal = Field(|_, u: [f32; 4]| {
        let sum = u.iter().map(|&u| f64::from(u) - 0.5).sum::<f64>();
        [(1.0 + DEVIATION * 3f64.sqrt() * sum) as f32; 3]
    });
    let mut sampler = with(options.mode(Stopping::Threshold), 3);
    let film = run(&mut near_normal, &mut sampler, [SIDE as u32; 2], &Limits::spp(10_000.0));
    let covered = (0..SIDE * SIDE).filter(|&i| {
        let (moments, n) = (film.moments(i), film.count(i) as f64);
        let error = (moments.variance().unwrap()[0] / n).sqrt();
        2.0 * student_tail((moments.mean[0] - 1.0).abs() / error, n - 1.0) >= options.alpha
    });
    let share = covered.count() as f64 / PIXELS;
    (film.counts().iter().map(|&n| n as f64).collect(), share)
}

#[test]
fn counts_concentrate_where_the_interval_is_as_wide_as_allowed() {
    for threshold in [0.05, 0.025] {
        let (counts, covered) = stopped(VarianceThresholdOptions::default().threshold(threshold));
        let expected = (1.96 * DEVIATION / threshold).powi(2);
        let mean = counts.iter().sum::<f64>() / PIXELS;
        let near = counts.iter().filter(|&n| (n / expected - 1.0).abs() < 0.35).count();
        assert!((mean / expected - 1.0).abs() < 0.1, "{mean} for {expected}");
        assert!(near as f64 > 0.85 * PIXELS && covered >= 0.9, "{near} of {PIXELS}, {covered}");
    }
    // The control: an interval of 80 % covers less than 90 %.
    let (_, covered) = stopped(VarianceThresholdOptions::default().alpha(0.2));
    assert!(covered < 0.85, "{covered}");
}

/// The defect that pooling removes: nothing ever samples a pixel again whose pilot saw no light.
#[test]
fn pixels_with_equal_samples_stop_for_long() {
    let options = VarianceThresholdOptions::default().mode(Stopping::Threshold);
    let film = run(&mut Bernoulli(0.01), &mut with(options, 4), [SIDE as u32; 2], &Limits::spp(60.0));
    let stopped = film.counts().iter().filter(|&&n| n == 8).count() as f64;
    let share = 0.99f64.powi(8);
    assert!((stopped - share * PIXELS).abs() < 5.0 * (share * (1.0 - share) * PIXELS).sqrt(), "{stopped}");
}

#[test]
fn a_budget_goes_to_the_noisy_half() {
    let mut field = Field(|[x, _]: [u32; 2], u: [f32; 4]| [if x < 16 { 0.5 } else { u[0] }; 3]);
    let mut sampler = with(VarianceThresholdOptions::default(), 5);
    let counts = run(&mut field, &mut sampler, [32, 32], &Limits::spp(32.0)).counts();
    let (flat, noisy): (Vec<_>, Vec<_>) = counts.chunks(32).map(|row| row.split_at(16)).unzip();
    assert!(flat.concat().iter().all(|&n| n == 8), "flat pixels keep the pilot");
    assert_eq!(noisy.concat().iter().sum::<u64>(), 56 * 512);
    // A few pixels keep 8 or a little more, since their first samples happen to agree.
    let near = noisy.concat().iter().filter(|&n| (32..=96).contains(n)).count();
    assert!(near > 486, "{near} of 512 pixels, {noisy:?}");
}

/// Samples of mean 1 and deviation 0.3, in turns.
fn alternating(k: u64) -> Estimate {
    Estimate::new([if k.is_multiple_of(2) { 0.7 } else { 1.3 }; 3])
}

fn ucb_counts(bonus: f64, total: u64, sample: impl Fn(usize, u64) -> Estimate) -> Vec<u64> {
    let options = UpperConfidenceOptions::default().bonus(bonus);
    let mut sampler = UpperConfidence::with_options(random(1), options).unwrap();
    planned_until_done(&mut sampler, [10, 10], total, sample).counts()
}

#[test]
fn pixels_whose_pilot_saw_nothing_get_half_of_the_uniform_count() {
    // Samples of the last pixel are all equal, with the mean of the others.
    let sample = |pixel: usize, k: u64| if pixel == 99 { Estimate::new([1.0; 3]) } else { alternating(k) };
    let counts = ucb_counts(0.5, 3200, sample);
    // The fixed point of n = 32 (bound of the pixel) / (mean bound) is 15.
    assert!((14..=16).contains(&counts[99]), "{}", counts[99]);
    let (least, most) = (counts[..99].iter().min().unwrap(), counts[..99].iter().max().unwrap());
    assert!(most - least <= 1, "{least} .. {most}");
    // The control: without the bonus it keeps its pilot.
    assert_eq!(ucb_counts(0.0, 3200, sample)[99], 4);
}

/// A step of 1e-4 to either side of the threshold at which a pixel of mean 2 stops brackets the level.
#[test]
fn critical_values_have_their_probability() {
    for freedom in [1, 2, 3, 4, 5, 7, 11, 30, 254, 100_000] {
        let mut film = Film::new(frame([1, 1]), VarianceThresholdOptions::default().needs());
        (0..=freedom).for_each(|k| film.push(0, 0, [if k % 2 == 0 { 1.5 } else { 2.5 }; 3]));
        let (moments, freedom) = (film.moments(0), f64::from(freedom));
        let error = (moments.variance().unwrap()[0] / (freedom + 1.0)).sqrt() / moments.mean[0];
        for t in [0.9, 1.7, 2.3, 3.1, 4.5, 12.0, 70.0] {
            let alpha = 2.0 * if freedom < 1e5 { student_tail(t, freedom) } else { normal_tail(t) };
            let stops = |threshold: f64| {
                let options = VarianceThresholdOptions::default().mode(Stopping::Threshold).alpha(alpha);
                stops(options.threshold(threshold), &film)
            };
            if (1e-6..=0.5).contains(&alpha) {
                let found = [0.9999, 1.0001].map(|k| stops(k * t * error));
                assert_eq!(found, [false, true], "{freedom}: {t} has {alpha}");
            }
        }
    }
}

/// True if the next round has no samples.
fn stops(options: VarianceThresholdOptions, film: &Film) -> bool {
    let budget = BudgetLeft::new(1 << 40).with_spent(film.record().samples);
    let mut plan = Plan::empty(1);
    options.refine(&Feedback::new(1, film, budget), 1, &mut None, &mut plan).unwrap();
    plan.total() == 0
}

#[test]
fn factors_are_the_published_ones_within_their_clamps() {
    // One pixel of 1024 has this deviation and cost. The filtered image, to which deviations are relative, is 1.
    let factor = |deviation: f32, cost: u32, outliers: u32| {
        let options = EarsOptions::default().radius(0).rounds(1).pilot(4).outliers(outliers);
        let mut ears = Ears::with_options(random(1), options).unwrap();
        let mut film = Film::new(frame([32, 32]), ears.needs());
        for (i, k) in (0..1024).flat_map(|i| [-1.0, 1.0, 1.0, -1.0].map(|k| (i, k))) {
            let (deviation, cost) = if i == 500 { (deviation, cost) } else { (0.05, 100) };
            film.push_estimate(i, 0, &Estimate::new([1.0 + k * deviation; 3]).with_cost(cost));
        }
        let counts = next_counts(&mut ears, &film, 10_000 * 1024, ANY);
        f64::from(counts[500] + 4) / f64::from(counts[0] + 4)
    };
    for (deviation, cost, expected) in
        [(0.1, 100, 2.0), (0.05, 400, 0.5), (0.05, 25, 2.0), (0.0, 100, 0.05), (0.9, 1, 20.0)]
    {
        let found = factor(deviation, cost, 10);
        assert!((found / expected - 1.0).abs() < 0.01, "{deviation}, {cost}: {found}");
    }
    // The control: with outliers, one pixel raises the variance of the image.
    assert!(factor(0.9, 1, 0) > 22.0);
}

/// The counts of pixels with equal deviations, whose right half costs four times as many rays.
#[test]
fn counts_of_two_regions_go_with_the_inverse_root_of_their_costs() {
    let options = EarsOptions::default().radius(0).rounds(1);
    let mut ears = Ears::with_options(random(1), options).unwrap();
    let sample = |i: usize, k: u64| alternating(k).with_cost(if i % 16 < 8 { 1 } else { 4 });
    let counts = planned_until_done(&mut ears, [16, 16], 48 * 256, sample).counts();
    // Denoised pixels differ from 1 by rounding only.
    let is_near = |(i, n): (usize, &u64)| n.abs_diff(if i % 16 < 8 { 64 } else { 32 }) <= 1;
    assert!(counts.iter().enumerate().all(is_near), "{counts:?}");
}
