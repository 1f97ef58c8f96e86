//! Errors that a film predicts of itself, and its size.

use crate::common::{Field, Independent, ToySampler, frame, run};
use dapple_core::plan::{Combine, Feedback, Plan, Progress};
use dapple_core::{Film, Frame, Limits, Needs};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// A count takes 4 bytes, a mean 24, squared deviations, emission or indirect lighting 12, features 60, a surface 8, and splats 48.
#[test]
fn bytes_per_pixel_are_those_of_all_planes() {
    let none = Needs::none();
    let features = none.with_feature_halves();
    let all = features.with_variance().with_surfaces().with_first_hits(3).with_cost().with_emission().with_indirect();
    for (needs, bytes) in [
        (none, 28),
        (none.with_variance(), 40),
        (none.with_halves(), 56),
        (none.with_halves().with_variance(), 56 + 12),
        (none.with_half_variance(), 56 + 24),
        (none.with_features(), 88),
        (none.with_surfaces(), 36),
        (none.with_cost(), 36),
        (none.with_emission(), 40),
        (none.with_indirect(), 40),
        (none.with_splats().with_halves(), 2 * (28 + 48)),
        (features, 2 * 28 + 3 * 60),
        (all, 2 * (28 + 24) + 2 * 12 + 3 * 60 + 3 * 76 + 8 + 8),
    ] {
        assert_eq!(Film::bytes_per_pixel(&needs), bytes, "{needs:?}");
    }
}

/// `E (A - B)^2 = var A + var B`, divided by count, against the spread of the mean over 20,000 pixels. The relative
/// deviation of either is sqrt(2 / 20000) = 1 %; 6 of both together are 8 %.
#[test]
#[cfg_attr(miri, ignore = "statistics: too many samples for Miri")]
fn squared_error_is_that_of_the_combined_mean() {
    for (count, combine) in
        [(8, Combine::ByCount), (5, Combine::ByCount), (5, Combine::Equally), (5, Combine::Fixed(0.2))]
    {
        let (pixels, needs) = (20_000, Needs::none().with_halves());
        let plan = move |seen: &Feedback<'_>, plan: &mut Plan| {
            plan.counts.fill(count);
            plan.combine = combine;
            if seen.round == 0 { Progress::Trace } else { Progress::Done }
        };
        let mut sampler = ToySampler { points: Independent::new(5), needs, plan };
        let limits = Limits::samples(8 * u64::from(pixels));
        let film = run(&mut Field(|_, u: [f32; 4]| [u[0]; 3]), &mut sampler, needs, frame(pixels, 1), &limits).unwrap();
        let average = |f: &dyn Fn(usize) -> f64| (0..pixels as usize).map(f).sum::<f64>() / f64::from(pixels);
        let (predicted, actual) =
            (average(&|i| film.squared_error(i).unwrap()[0]), average(&|i| (film.mean(i)[0] - 0.5).powi(2)));
        assert!((predicted / actual - 1.0).abs() < 0.08, "{count}, {combine:?}: {predicted} for {actual}");
    }
}

/// Keeping three rows of means at a time gives the bits of the formula over the whole image, for any height.
#[test]
fn predicted_errors_are_those_of_the_whole_image() {
    let mut rng = Pcg64Mcg::seed_from_u64(2026);
    for [w, h] in [[1, 1], [5, 1], [1, 2], [1, 5], [2, 3], [7, 4], [6, 11]] {
        let mut film = Film::new(Frame::new(w as u32, h as u32).expect("not empty"), Needs::none().with_halves());
        for i in 0..w * h {
            (0..4).for_each(|k| film.push(i, k & 1, [rng.random::<f32>() * (i + 1) as f32; 3]));
        }
        let mut sum = 0.0;
        for i in 0..w * h {
            let (x, y) = (i % w, i / w);
            let near = |at: usize, end: usize| at.saturating_sub(1)..(at + 2).min(end);
            let count = (near(y, h).len() * near(x, w).len()) as f64;
            let mut level = [0.0; 3];
            for mean in near(y, h).flat_map(|y| near(x, w).map(move |x| y * w + x)).map(|k| film.mean(k)) {
                (0..3).for_each(|c| level[c] += mean[c] / count);
            }
            let error = film.squared_error(i).expect("halves");
            sum += (0..3).map(|c| error[c] / (level[c] * level[c] + 0.01)).sum::<f64>();
        }
        let whole = sum / (3 * w * h) as f64;
        assert_eq!(film.predicted_relmse().map(f64::to_bits), Some(whole.to_bits()), "{w}x{h}");
    }
}

/// One sample in ten carries all the light, so a pixel's own mean is large where its error is.
#[test]
#[cfg_attr(miri, ignore = "statistics: too many samples for Miri")]
fn a_predicted_error_is_not_hidden_by_the_error_itself() {
    const SIDE: u32 = 64;
    const SPP: usize = 16;
    let frame = Frame::new(SIDE, SIDE).expect("not empty");
    let mut film = Film::new(frame, Needs::none().with_halves());
    let mut rng = Pcg64Mcg::seed_from_u64(2016);
    for i in 0..frame.pixels() {
        for k in 0..SPP {
            let value = if rng.random::<f32>() < 0.1 { 10.0 } else { 0.0 };
            film.push(i, k & 1, [value; 3]);
        }
    }
    // Mean 1, variance 9.
    let truth = 9.0 / SPP as f64 / 1.01;
    // The variance of the level adds about 3 * 9 / 144 = 0.19 to the mean of its inverse square. The pixel is one of
    // the nine, which subtracts some.
    let ratio = film.predicted_relmse().expect("halves") / truth;
    assert!((0.9..1.2).contains(&ratio), "{ratio}");
    // Negative control: the pixel's own mean stands for the truth.
    let own: f64 = (0..frame.pixels())
        .map(|i| film.squared_error(i).expect("halves")[0] / (film.mean(i)[0] * film.mean(i)[0] + 0.01))
        .sum();
    let ratio = own / frame.pixels() as f64 / truth;
    assert!(!(0.9..1.2).contains(&ratio), "{ratio}");
}
