//! Limits of error and of time.

use crate::common::*;
use dapple_core::limits::Schedule;
use dapple_core::render::{Control, Monitor, Status};
use dapple_core::{Error, Film, Filter, Filtered, Limits, Needs, Render};

const SIZE: u32 = 48;
const GOAL: f64 = 0.0004;

/// Means over 3x3 pixels. It claims `claim` times its true error, a ninth of the unfiltered one; `None` claims nothing.
fn blur(claim: Option<f32>) -> impl Filter {
    let apply = move |film: &Film| {
        let size = film.frame().size();
        let [width, height] = size.map(|n| n as usize);
        let (image, pixels) = (film.image(), width * height);
        let errors = film.squared_errors().unwrap_or_default();
        let near = |i: usize| {
            let (x, y) = (i % width, i / width);
            let at = move |dx, dy| (y + dy + height - 1) % height * width + (x + dx + width - 1) % width;
            (0..9).map(move |k| at(k % 3, k / 3))
        };
        let mean = |i: usize| std::array::from_fn(|c| near(i).map(|j| image[j][c]).sum::<f32>() / 9.0);
        let radiance = (0..pixels).map(mean).collect();
        let error = claim.map(|claim| {
            (0..pixels).map(|i| claim * near(i).map(|j| errors[j]).sum::<f32>() / 81.0).collect::<Vec<_>>()
        });
        Filtered::new(size, radiance).with_error(error)
    };
    ToyFilter { name: "blur", needs: Needs::none().with_halves(), apply }
}

fn field(_: [u32; 2], u: [f32; 4]) -> [f32; 3] {
    [0.5 + u[0], 2.0 * u[1], 0.1 + u[2] * u[2]]
}

fn limits() -> Limits {
    Limits::error(GOAL, 1 << 22).with_schedule(Schedule::default().with_progress_spp(1))
}

fn render(seed: u64, filter: &dyn Filter, monitor: &mut dyn Monitor) -> Film {
    let limits = limits();
    let render = Render::new(frame(SIZE, SIZE), &limits).error_of(filter).monitor(monitor);
    render.run(&mut Field(field), &mut uniform(seed)).unwrap()
}

fn true_relmse(image: &Filtered) -> f64 {
    let truth = [1.0, 1.0, 0.1 + 1.0 / 3.0];
    let of = |x: &[f32; 3]| -> f64 {
        (0..3).map(|c| (f64::from(x[c]) - truth[c]).powi(2) / (truth[c] * truth[c] + 0.01)).sum()
    };
    image.radiance.iter().map(of).sum::<f64>() / (3 * image.radiance.len()) as f64
}

/// Predicted over true relMSE and true over requested, over 12 images.
fn ratios(claim: f32) -> [f64; 2] {
    let filter = blur(Some(claim));
    let (mut predicted, mut measured) = (0.0, 0.0);
    for seed in 1..=12 {
        let film = render(seed, &filter, &mut |_: &Status<'_>| Control::Continue);
        predicted += film.record().filtered_relmse.unwrap() / 12.0;
        measured += true_relmse(&filter.apply(&film).unwrap()) / 12.0;
    }
    [predicted / measured, measured / GOAL]
}

#[test]
fn later_samples_correct_a_filter_that_misjudges_its_error() {
    for claim in [0.4, 1.0, 2.5] {
        let [predicted, reached] = ratios(claim);
        assert!((0.8..1.25).contains(&predicted), "claim {claim}: predicted over true {predicted}");
        assert!((0.7..1.25).contains(&reached), "claim {claim}: true over requested {reached}");
    }
    // Negative control: the claims themselves are outside of that range.
    let film = render(1, &blur(None), &mut |_: &Status<'_>| Control::Continue);
    let claimed = blur(Some(2.5)).apply(&film).unwrap();
    let own = claimed.error.as_ref().unwrap().iter().map(|e| f64::from(*e)).sum::<f64>();
    let right = blur(Some(1.0)).apply(&film).unwrap();
    let truth = right.error.unwrap().iter().map(|e| f64::from(*e)).sum::<f64>();
    assert!(own / truth > 2.4, "{}", own / truth);
}

/// The limit then ends by the unfiltered error, with more samples than the filtered image needs.
#[test]
fn a_filter_without_an_estimate_leaves_the_limit_with_the_unfiltered_image() {
    let goes = &mut |_: &Status<'_>| Control::Continue;
    let film = render(1, &blur(None), goes);
    assert_eq!(film.record().filtered_relmse, None);
    let limits = limits();
    let plain = Render::new(frame(SIZE, SIZE), &limits).run(&mut Field(field), &mut uniform(1));
    assert!(bits(&film) == bits(&plain.unwrap()));
    let filtered = render(1, &blur(Some(1.0)), goes);
    assert!(filtered.record().samples < film.record().samples / 3, "{}", filtered.record().samples);
}

#[test]
fn a_resumed_error_limit_ends_with_the_same_bits() {
    let filter = blur(Some(0.4));
    let mut keeper = Keeper::default();
    let film = render(7, &filter, &mut keeper);
    assert!(keeper.slices.len() > 3, "{}", keeper.slices.len());
    for snapshot in keeper.all() {
        let limits = limits();
        let resumed = on_threads(3, || {
            let render = Render::new(frame(SIZE, SIZE), &limits).error_of(&filter);
            render.resume(snapshot, &mut Field(field), &mut uniform(7)).unwrap()
        });
        assert!(bits(&resumed) == bits(&film));
        assert_eq!(resumed.record().filtered_relmse, film.record().filtered_relmse);
    }
}

/// A filter that refuses every film takes no time. A limit beyond any number of samples ends at the largest count, here 3.
#[test]
fn endless_time_limits_do_not_overflow() {
    for seconds in [1e30, f64::MAX] {
        let limits = Limits::seconds(seconds).with_max_spp(3);
        let mut reserved = None;
        let mut monitor = |status: &Status<'_>| {
            reserved = status.filter_seconds;
            Control::Continue
        };
        let render = Render::new(frame(5, 4), &limits).monitor(&mut monitor).error_of(&Refuses);
        let film = render.run(&mut Field(noise), &mut uniform(5)).unwrap();
        assert_eq!((film.record().samples, reserved), (60, Some(0.0)));
    }
}

struct Refuses;

impl Filter for Refuses {
    fn name(&self) -> &str {
        "refuses"
    }

    fn apply(&self, _: &Film) -> Result<Filtered, Error> {
        Err(Error::NotRecorded { who: "it".into(), what: "anything" })
    }
}
