//! Metrics against scikit-image and numpy; `oracle.py` in the folder above prints the expected values.

use crate::common::{SIZE, test_image};
use approx::assert_relative_eq;
use dapple_metrics::{Pixels, compare};

/// Image, reference; MSE, PSNR and MSE of sRGB values, SMAPE.
#[allow(clippy::excessive_precision)]
const EXPECTED: [(&str, &str, [f64; 4]); 4] = [
    ("noisy", "smooth", [1.298656066258748e-03, 29.702846712007, 1.070817176265140e-03, 9.707145595643646e-02]),
    ("brighter", "smooth", [1.518295870886909e-03, 29.738738744090, 1.062003934190194e-03, 1.056066785568985e-01]),
    ("shifted", "smooth", [1.795450846354167e-03, 27.442052223588, 1.802165940622338e-03, 3.400569584285602e-02]),
    ("noise", "smooth", [1.334537929958767e-01, 10.777586973012, 8.360674249827491e-02, 6.839478185780016e-01]),
];

#[test]
fn metrics_match_scikit_image() {
    for (image, reference, expected) in EXPECTED {
        let [image, reference] = [image, reference].map(test_image);
        let found = compare(Pixels::new(SIZE, &image).unwrap(), Pixels::new(SIZE, &reference).unwrap()).unwrap();
        let found = [found.mse, found.psnr, found.display_mse, found.smape];
        assert_relative_eq!(found[..], expected[..], max_relative = 1e-12);
    }
}
