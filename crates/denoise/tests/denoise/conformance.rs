//! The filters of this crate pass the conformance tests of all filters.

use dapple_conformance as conformance;
use dapple_core::Frame;
use dapple_denoise::{
    Bilateral, BilateralOptions, ClusterGaussian, ClusterGaussianOptions, ClusterLookup, ClusterRegression, Gaussian,
    NlMeans, NlMeansOptions,
};
use std::sync::Arc;

#[test]
fn gaussian_conforms() {
    conformance::filter(|| Box::new(Gaussian::default()));
    for (alpha, radius) in [(2.0, 0.3), (2.0, 1.5), (1e-4, 64.0), (1e9, 3.0)] {
        conformance::filter(|| Box::new(Gaussian::new(alpha, radius).unwrap()));
    }
}

/// Blocks of 5x4 pixels, every third of them background.
fn map(frame: &Frame) -> ClusterGaussian {
    let [width, height] = frame.size();
    let cluster = |x, y| if (x / 5 + y / 4) % 3 == 0 { u32::MAX } else { x / 5 + 100 * (y / 4) };
    let clusters = (0..height).flat_map(|y| (0..width).map(move |x| cluster(x, y))).collect();
    ClusterGaussian::from_map([width, height], clusters).unwrap()
}

#[test]
fn cluster_gaussian_from_a_map_conforms() {
    for outside in [0.0, ClusterGaussianOptions::default().outside, 1.0] {
        conformance::filter_on_frames(|frame| {
            Box::new(map(frame).with_options(ClusterGaussianOptions::default().outside(outside)).unwrap())
        });
    }
}

#[test]
fn cluster_gaussian_from_hits_conforms() {
    let label: ClusterLookup = Arc::new(|shape, primitive| (primitive != 1).then_some(shape + 10 * primitive));
    for (k, outside) in [(1, 0.1), (4, 0.0), (8, 0.1)] {
        let options = ClusterGaussianOptions::default().hits(k).outside(outside);
        let make = || ClusterGaussian::from_hits(label.clone()).with_options(options).unwrap();
        conformance::filter(|| Box::new(make()));
    }
}

#[test]
fn nl_means_conform() {
    conformance::filter(|| Box::new(NlMeans::default()));
    let options = NlMeansOptions::default().window(3).patch(1).k(0.6).features(Some(0.6));
    conformance::filter(|| Box::new(NlMeans::with_options(options).unwrap()));
}

#[test]
fn bilateral_conforms() {
    let label: ClusterLookup = Arc::new(|shape, _| Some(shape));
    conformance::filter(|| Box::new(Bilateral::default()));
    let plain = Bilateral::with_options(BilateralOptions::default().outside(0.0)).unwrap();
    conformance::filter(|| Box::new(plain.clone().with_clusters(label.clone(), "")));
}

#[test]
fn cluster_regression_conforms() {
    let label: ClusterLookup = Arc::new(|shape, primitive| (primitive != 1).then_some(shape + 10 * primitive));
    for plain in [ClusterRegression::new(), ClusterRegression::new().one_pass()] {
        conformance::filter(|| Box::new(plain.clone().with_clusters(label.clone(), "")));
    }
    conformance::filter(|| Box::new(ClusterRegression::new()));
}
