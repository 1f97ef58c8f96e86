//! The predicted error of the filtered image against the true one, on bundled scenes.

#![expect(clippy::print_stderr, reason = "the ratios of scenes are read in the output")]

use dapple_core::Filtered;
use dapple_denoise::relative_errors;
use dapple_job::{BudgetSpec, Job, PixelFilterSpec, RenderSpec};

fn spec(scene: &str, [width, height]: [u32; 2]) -> RenderSpec {
    RenderSpec { pixel_filter: PixelFilterSpec::Box, ..RenderSpec::new(scene).resolution(width, height) }
}

/// Two independent references. Their noise cancels in the product of the differences from both.
type Truth = [Vec<[f32; 3]>; 2];

fn truth(scene: &str, size: [u32; 2], goal: f64) -> Truth {
    // The reference's noise is proportional to the error to measure.
    let spp = BudgetSpec::Spp((0.36 / goal).clamp(80.0, 160.0));
    [98, 99].map(|seed| {
        let spec = spec(scene, size).sampler("uniform").filter("none").budget(spp).seed(seed);
        Job::prepare(&spec).and_then(|mut job| job.render()).unwrap().filtered.radiance
    })
}

/// The relMSE, as in `dapple compare`.
fn relmse(image: &Filtered, [a, b]: &Truth) -> f64 {
    let of = |i: usize| -> f64 {
        let (x, a, b) = (image.radiance[i].map(f64::from), a[i].map(f64::from), b[i].map(f64::from));
        (0..3).map(|c| (x[c] - a[c]) * (x[c] - b[c]) / (0.25 * (a[c] + b[c]).powi(2) + 0.01)).sum()
    };
    (0..a.len()).map(of).sum::<f64>() / (3 * a.len()) as f64
}

/// Mean ratios over seeds: corrected prediction to true relMSE, the filter's own prediction to true relMSE, and true to
/// requested relMSE.
#[derive(Debug)]
struct Ratios {
    predicted: f64,
    own: f64,
    reached: f64,
}

fn ratios(scene: &str, size: [u32; 2], goal: f64, seeds: u64) -> Ratios {
    let truth = truth(scene, size, goal);
    let (mut predicted, mut own, mut measured) = (0.0, 0.0, 0.0);
    for seed in 1..=seeds {
        let spec = spec(scene, size).budget(BudgetSpec::Error(goal)).seed(seed);
        let image = Job::prepare(&spec).and_then(|mut job| job.render()).unwrap();
        predicted += image.film.record().filtered_relmse.expect("a prediction");
        let errors = relative_errors(&image.filtered, 0.01).expect("the filter's own error");
        own += errors.iter().map(|e| f64::from(*e)).sum::<f64>() / errors.len() as f64;
        measured += relmse(&image.filtered, &truth);
    }
    let ratios =
        Ratios { predicted: predicted / measured, own: own / measured, reached: measured / seeds as f64 / goal };
    eprintln!("{scene}, relMSE {goal}: {ratios:.2?}");
    ratios
}

/// Predicted over true relMSE is 0.8 to 1.25, over 4 seeds. True over requested relMSE may be lower, since a budget can grow by
/// more than it needs. The control is the filter's own estimate, which fails for glass. `DAPPLE_THOROUGH=1` adds a scene whose
/// error the filter exaggerates.
#[test]
fn later_samples_calibrate_the_filters_own_error() {
    let glass = ratios("glass", [96, 72], 0.004, 4);
    let cornell = std::env::var_os("DAPPLE_THOROUGH").map(|_| ratios("cornell", [96, 72], 0.0008, 4));
    for found in cornell.iter().chain([&glass]) {
        assert!((0.8..1.25).contains(&found.predicted), "{found:?}");
        assert!((0.65..1.25).contains(&found.reached), "{found:?}");
    }
    assert!(!(0.8..1.25).contains(&glass.own), "the control is no control: {glass:?}");
}

/// More scenes and seeds; takes some minutes:
/// `cargo test --release -p dapple-job --test job predicted_error -- --ignored --nocapture`
#[test]
#[ignore = "takes some minutes"]
fn more_scenes_are_calibrated_within_a_factor_of_two() {
    let goals = [("lens", 0.006), ("tea", 0.01), ("terrain", 0.003), ("teapot", 0.003), ("room", 0.003)];
    for (scene, goal) in goals {
        let found = ratios(scene, [96, 72], goal, 8);
        assert!((0.5..2.0).contains(&found.predicted), "{scene}: {found:?}");
    }
}
