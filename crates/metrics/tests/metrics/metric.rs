//! The table of metrics, and the sums below them.

use crate::support::pixels;
use dapple_metrics::{Better, METRICS, Measurement, Metric};
use sum::Sum;

#[path = "../../src/sum.rs"]
mod sum;

#[test]
fn small_terms_are_not_lost_beside_large_ones() {
    let terms = [1e100, 1.0, -1e100, 1.0];
    assert_eq!(terms.iter().sum::<f64>(), 1.0, "the control");
    assert_eq!(terms.into_iter().collect::<Sum>().value(), 2.0);
    assert_eq!([f64::MAX, f64::MAX].into_iter().collect::<Sum>().value(), f64::INFINITY);
}

#[test]
fn metrics_have_unique_names_and_equal_images_no_error() {
    let values = vec![[0.25, 0.5, 1.0]; 256];
    let image = pixels([16, 16], &values);
    let measurement = Measurement::new(image, image, None).expect("a comparison");
    for (at, metric) in METRICS.iter().enumerate() {
        assert!(METRICS[..at].iter().all(|other| other.name != metric.name), "{}", metric.name);
        let value = (metric.of)(&measurement).expect("a value");
        match metric.better {
            Better::Lower => assert_eq!(value, 0.0, "{}", metric.name),
            Better::NearOne => assert_eq!(value, 1.0, "{}", metric.name),
            Better::Higher => assert!(value > 100.0, "{}", metric.name),
        }
    }
    assert!(Metric::find("flip").is_some() && Metric::find("nonesuch").is_none());
}

#[test]
fn the_noise_of_the_reference_is_subtracted() {
    let [image, reference, variance] = [[0.6_f32; 3], [0.5; 3], [0.001; 3]].map(|value| vec![value; 64]);
    let [image, reference, variance] = [&image, &reference, &variance].map(|values| pixels([8, 8], values));
    let [plain, without] =
        [None, Some(variance)].map(|known| Measurement::new(image, reference, known).expect("a comparison"));
    for metric in METRICS {
        let [plain, without] = [&plain, &without].map(|m| (metric.of)(m).expect("a value"));
        let corrected = ["mse", "relmse", "srgb8_mse", "srgb8_mse4"].contains(&metric.name);
        assert_eq!(without < plain, corrected, "{}: {without} and {plain}", metric.name);
    }
    assert!(without.reference_limited() && !plain.reference_limited());
}
