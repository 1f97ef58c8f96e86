//! Properties that hold for all images.

use dapple_metrics::{Pixels, compare, downsample};
use proptest::prelude::*;

const SIZE: [u32; 2] = [9, 5];

fn image() -> impl Strategy<Value = Vec<[f32; 3]>> {
    let value = prop_oneof![-1.0_f32..4.0, Just(0.0), 1e-6_f32..1e-3, 10.0_f32..1e6];
    proptest::collection::vec([value.clone(), value.clone(), value], 45)
}

fn close(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-12 * a.abs().max(b.abs())
}

fn pixels(values: &[[f32; 3]]) -> Pixels<'_> {
    Pixels::new(SIZE, values).unwrap()
}

fn map(values: &[[f32; 3]], f: impl Fn(f32) -> f32) -> Vec<[f32; 3]> {
    values.iter().map(|p| p.map(&f)).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn symmetric_metrics_do_not_depend_on_the_order_of_the_images(a in image(), b in image()) {
        let [ab, ba] = [compare(pixels(&a), pixels(&b)).unwrap(), compare(pixels(&b), pixels(&a)).unwrap()];
        prop_assert_eq!((ab.mse, ab.smape, ab.display_mse, ab.psnr), (ba.mse, ba.smape, ba.display_mse, ba.psnr));
        prop_assert!(ab.mean_ratio == 1.0 || close(ab.mean_ratio * ba.mean_ratio, 1.0));
    }

    #[test]
    fn powers_of_two_scale_exactly(a in image(), b in image(), k in -10_i32..10) {
        let by = 2.0_f32.powi(k);
        let plain = compare(pixels(&a), pixels(&b)).unwrap();
        let scaled = compare(pixels(&map(&a, |v| v * by)), pixels(&map(&b, |v| v * by))).unwrap();
        prop_assert_eq!(scaled.mse, plain.mse * f64::from(by) * f64::from(by));
        prop_assert_eq!((scaled.smape, scaled.mean_ratio), (plain.smape, plain.mean_ratio));
    }

    #[test]
    fn metrics_stay_in_their_ranges(a in image(), b in image()) {
        let found = compare(pixels(&a), pixels(&b)).unwrap();
        prop_assert!(found.mse >= 0.0 && found.rel_mse >= 0.0 && (0.0..=2.0).contains(&found.smape));
        prop_assert!((0.0..=1.0).contains(&found.display_mse) && found.psnr >= 0.0);
        prop_assert!(found.rel_mse_trimmed <= found.rel_mse && found.worst_block.rel_mse >= found.rel_mse * 0.999_999);
        prop_assert!(found.rel_mse <= 100.0 * found.mse * 1.000_001);
    }

    #[test]
    fn metrics_do_not_depend_on_the_order_of_pixels(a in image(), b in image()) {
        let turned = |p: &[[f32; 3]]| p.iter().rev().copied().collect::<Vec<_>>();
        let plain = compare(pixels(&a), pixels(&b)).unwrap();
        let turned = compare(pixels(&turned(&a)), pixels(&turned(&b))).unwrap();
        let figures = |c: &dapple_metrics::Comparison| [c.mse, c.rel_mse, c.rel_mse_trimmed, c.smape, c.display_mse];
        prop_assert!(figures(&plain).iter().zip(figures(&turned)).all(|(&a, b)| close(a, b)));
    }

    #[test]
    fn downsampling_keeps_the_mean_and_the_range(a in image(), w in 1_u32..=9, h in 1_u32..=5) {
        let small = downsample(pixels(&a), [w, h]).unwrap();
        for c in 0..3 {
            let mean = |p: &[[f32; 3]]| p.iter().map(|v| f64::from(v[c])).sum::<f64>() / p.len() as f64;
            let size = a.iter().map(|v| f64::from(v[c].abs())).sum::<f64>() / 45.0;
            prop_assert!((mean(&small) - mean(&a)).abs() <= 1e-6 * size);
            let most = a.iter().map(|v| v[c]).fold(f32::MIN, f32::max);
            let least = a.iter().map(|v| v[c]).fold(f32::MAX, f32::min);
            prop_assert!(small.iter().all(|v| (least..=most).contains(&v[c])));
        }
    }
}
