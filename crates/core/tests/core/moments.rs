//! Running means and variances.

use dapple_core::film::{Moments, RgbMoments};

const VALUES: [f32; 7] = [3.0, -1.5, 0.25, 8.0, 1e3, 1e3 + 1.0, -7.0];

/// Mean and sum of squared deviations in two passes.
fn two_passes(values: &[f32]) -> (f64, f64) {
    let mean = values.iter().map(|&x| f64::from(x)).sum::<f64>() / values.len() as f64;
    (mean, values.iter().map(|&x| (f64::from(x) - mean).powi(2)).sum())
}

fn pushed(values: &[f32]) -> (Moments, RgbMoments) {
    let (mut one, mut rgb) = (Moments::default(), RgbMoments::default());
    for &x in values {
        one.push(f64::from(x));
        rgb.push([x, 2.0 * x, -x]);
    }
    (one, rgb)
}

fn check(one: &Moments, rgb: &RgbMoments, values: &[f32]) {
    let (mean, m2) = two_passes(values);
    let close = |a: f64, b: f64| (a - b).abs() <= 1e-9 * (1.0 + b.abs());
    assert!(one.count == values.len() as u64 && rgb.count == one.count);
    assert!(close(one.mean, mean) && close(one.m2, m2), "{one:?}");
    let variance = one.variance();
    assert_eq!(variance.is_some(), values.len() > 1);
    assert!(variance.is_none_or(|v| close(v, m2 / (values.len() - 1) as f64)));
    for (c, factor) in [1.0, 2.0, -1.0].into_iter().enumerate() {
        assert!(close(rgb.mean[c], factor * mean) && close(rgb.m2[c], factor * factor * m2), "{rgb:?}");
        let of_channel = rgb.variance().map(|v| v[c]);
        assert!(of_channel.is_none_or(|v| close(v, factor * factor * m2 / (values.len() - 1) as f64)));
        assert_eq!(of_channel.is_some(), values.len() > 1);
    }
}

#[test]
fn pushing_agrees_with_two_passes() {
    for n in 1..=VALUES.len() {
        let (one, rgb) = pushed(&VALUES[..n]);
        check(&one, &rgb, &VALUES[..n]);
    }
}

#[test]
fn merging_agrees_with_pushing_all() {
    for cut in 0..=VALUES.len() {
        let ((mut one, mut rgb), (other, others)) = (pushed(&VALUES[..cut]), pushed(&VALUES[cut..]));
        one.merge(&other);
        rgb.merge(&others);
        check(&one, &rgb, &VALUES);
    }
}
