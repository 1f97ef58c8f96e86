//! Studies with known results, each with a control that must differ.

use crate::common::{Place, in_process};
use dapple_metrics::log_log_fit;
use dapple_study::{Method, PlanSettings, Run, RunBudget};

impl Place {
    /// The runs of uniform sampling with these points.
    fn runs(&self, points: &str, spp: &[u64], seeds: std::ops::Range<u64>, folder: &str) -> Vec<Run> {
        let method = Method::new("uniform", points, "none");
        let seeds: Vec<u64> = seeds.collect();
        let mut settings = self.settings(&method);
        (settings.spp, settings.seeds, settings.reference_spp) = (Some(spp.to_vec()), Some(seeds), 2048);
        self.study(settings.resolve().unwrap(), folder, &mut in_process()).runs().to_vec()
    }

    /// Settings for a single method, without equal-time runs.
    fn settings(&self, method: &Method) -> PlanSettings {
        let settings = self.plan(&["time_of=0", "resolution=20x20"]).settings;
        PlanSettings { samplers: None, methods: vec![method.clone()], baseline: method.clone(), ..settings }
    }
}

fn mse(runs: &[Run], spp: u64) -> Vec<f64> {
    runs.iter().filter(|r| r.budget == RunBudget::Spp(spp)).map(|r| r.errors.get("mse")).collect()
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// The MSE of independent samples falls with slope -1 +- 0.06.
#[test]
fn independent_sampling_has_slope_minus_one() {
    let place = Place::new();
    let spp = [4, 16, 64, 256];
    let slope = |points: &str| {
        let runs = place.runs(points, &spp, 1..9, points);
        let errors = spp.map(|n| mean(&mse(&runs, n)));
        log_log_fit(&spp.map(|n| n as f64), &errors, 0.95).unwrap().slope.value
    };
    let independent = slope("random");
    assert!((independent + 1.0).abs() < 0.06, "{independent}");
    // The control: points that are not independent converge faster.
    let scrambled = slope("sobol");
    assert!(scrambled < -1.06, "{scrambled}");
}

/// E (a - b)^2 = 2 var a for two independent images.
#[test]
fn two_seeds_differ_by_twice_the_variance() {
    let place = Place::new();
    // Against the reference: each image's variance.
    let spp = 16;
    let alone = place.runs("random", &[spp, 4 * spp], 1..9, "alone");
    let against = |file: &str| {
        let method = Method::new("uniform", "random", "none");
        let mut settings = place.settings(&method);
        // The first seed's image is the reference.
        (settings.spp, settings.seeds) = (Some(vec![spp]), Some((2..9).collect()));
        settings.scenes[0].reference = Some(place.path("alone").join(file));
        let folder = file.replace(['/', '.'], "-");
        let study = place.study(settings.resolve().unwrap(), &folder, &mut in_process());
        assert!(study.runs().iter().all(|r| !r.corrected), "an image's own variance is not known");
        mean(&mse(study.runs(), spp))
    };
    let variance = mean(&mse(&alone, spp));
    let pairs = against("images/tiny/uniform-none-16spp.exr");
    // With 1200 values per image, 7 pairs give the ratio within about 4 %.
    assert!((pairs / (2.0 * variance) - 1.0).abs() < 0.12, "{pairs} and {variance}");
    // The control: an image of four times the samples adds only a quarter.
    let other = against("images/tiny/uniform-none-64spp.exr");
    assert!((other / (2.0 * variance) - 0.625).abs() < 0.12, "{other} and {variance}");
}
