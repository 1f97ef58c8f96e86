//! The logarithm that features take.

use super::*;

#[test]
fn logarithms_are_accurate() {
    let near_one = (0..20_000).map(|k| 0.5 + k as f32 * 1e-4);
    let all = (-59..=59).map(|e| 2.0f32.powi(e) * 1.1).chain(near_one).chain([1e-18, 1e18, 2e18, f32::MIN_POSITIVE]);
    for x in all {
        let (got, wanted) = (f64::from(ln(x)), f64::from(x).ln());
        assert!((got - wanted).abs() <= 2.4e-7 * wanted.abs().max(1.0), "{x}: {got}, not {wanted}");
    }
    assert_eq!(ln(1.0), 0.0);
}
