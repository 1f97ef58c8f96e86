//! Metrics against closed forms, an independent implementation, scikit-image and numpy; means of blocks and averages.

use crate::support::{Random, SIZE, pixels, test_image};
use approx::assert_relative_eq;
use dapple_metrics::{
    Comparison, MetricsError, Pixels, WORST_BLOCK_SIZE, block_means, block_ratios, compare, downsample,
};
use proptest::prelude::*;

fn figures(c: &Comparison) -> [f64; 9] {
    let worst = c.worst_block.rel_mse;
    [c.mse, c.rel_mse, c.rel_mse_trimmed, c.smape, c.display_mse, c.psnr, c.srgb8_mse, c.mean_ratio, worst]
}

/// An independent implementation: plain sums, `powf`, planes instead of pixels.
fn oracle(size: [u32; 2], image: &[[f32; 3]], reference: &[[f32; 3]]) -> ([f64; 9], [f64; 3]) {
    let plane = |p: &[[f32; 3]], c: usize| -> Vec<f64> {
        p.iter().map(|v| if v[c].is_finite() { f64::from(v[c]) } else { 0.0 }).collect()
    };
    let curve = |v: f64| match v {
        v if v <= 0.0 => 0.0,
        v if v >= 1.0 => 1.0,
        v if v <= 0.0031308 => v * 12.92,
        v => 1.055 * v.powf(1.0 / 2.4) - 0.055,
    };
    let n = image.len();
    let mut relative = vec![0.0; n];
    let [mut mse, mut smape, mut display, mut sum_x, mut sum_r] = [0.0; 5];
    let mut ratios = [0.0; 3];
    for (c, ratio) in ratios.iter_mut().enumerate() {
        let (x, r) = (plane(image, c), plane(reference, c));
        for i in 0..n {
            mse += (x[i] - r[i]).powi(2);
            relative[i] += (x[i] - r[i]).powi(2) / (r[i].powi(2) + 0.01) / 3.0;
            if x[i] != 0.0 || r[i] != 0.0 {
                smape += 2.0 * (x[i] - r[i]).abs() / (x[i].abs() + r[i].abs());
            }
            display += (curve(x[i]) - curve(r[i])).powi(2);
        }
        *ratio = x.iter().sum::<f64>() / r.iter().sum::<f64>();
        sum_x += x.iter().sum::<f64>();
        sum_r += r.iter().sum::<f64>();
    }
    let count = 3.0 * n as f64;
    let mut worst: f64 = 0.0;
    let side = WORST_BLOCK_SIZE as usize;
    let [w, h] = size.map(|s| s as usize);
    for by in 0..h.div_ceil(side) {
        for bx in 0..w.div_ceil(side) {
            let inside = |i: &usize| (i % w) / side == bx && (i / w) / side == by;
            let block: Vec<f64> = (0..n).filter(inside).map(|i| relative[i]).collect();
            worst = worst.max(block.iter().sum::<f64>() / block.len() as f64);
        }
    }
    let rel_mse = relative.iter().sum::<f64>() / n as f64;
    relative.sort_by(f64::total_cmp);
    let cut = n - ((n as f64) * 0.001).round() as usize;
    let trimmed = relative[..cut].iter().sum::<f64>() / cut as f64;
    let display = display / count;
    let psnr = 10.0 * (1.0 / display).log10();
    let figures =
        [mse / count, rel_mse, trimmed, smape / count, display, psnr, display * 65025.0, sum_x / sum_r, worst];
    (figures, ratios)
}

#[test]
fn every_metric_agrees_with_an_independent_implementation_f11() {
    let mut random = Random(11);
    for size in [[37, 41], [100, 50], [1, 7], [16, 16]] {
        let count = (size[0] * size[1]) as usize;
        // Negative, black, dark and very bright values, and some NaN and infinities.
        let mut image = random.image(count, |u| (8.0 * u - 4.0).exp() - 0.1);
        let reference = random.image(count, |u| if u < 0.1 { 0.0 } else { (8.0 * u - 4.0).exp() - 0.1 });
        image[count / 2] = [f32::NAN, f32::INFINITY, 1.0];
        image[count / 3][2] = f32::NEG_INFINITY;
        let found = compare(pixels(size, &image), pixels(size, &reference)).unwrap();
        let (expected, ratios) = oracle(size, &image, &reference);
        assert_relative_eq!(figures(&found)[..], expected[..], max_relative = 1e-6);
        assert_relative_eq!(found.channel_ratios[..], ratios[..], max_relative = 1e-6);
        assert_eq!(found.non_finite, 3);
    }
}

#[test]
fn an_image_has_no_error_against_itself_f11() {
    let image = Random(1).image(60, |u| 100.0 * u);
    for image in [image, vec![[0.0; 3]; 60], vec![[f32::MAX, -1.0, 0.0]; 60]] {
        let found = compare(pixels([10, 6], &image), pixels([10, 6], &image)).unwrap();
        let errors = [found.mse, found.rel_mse, found.rel_mse_trimmed, found.smape, found.display_mse, found.srgb8_mse];
        assert_eq!((errors, found.psnr, found.mean_ratio), ([0.0; 6], 200.0, 1.0));
        assert_eq!((found.channel_ratios, found.worst_block.rel_mse, found.non_finite), ([1.0; 3], 0.0, 0));
    }
}

#[test]
fn metrics_against_a_black_reference_are_finite_f11() {
    for value in [0.5, f32::MAX, f32::MIN_POSITIVE, -1.0, f32::NAN] {
        let found = compare(pixels([3, 1], &[[value; 3]; 3]), pixels([3, 1], &[[0.0; 3]; 3])).unwrap();
        assert!(figures(&found).iter().chain(&found.channel_ratios).all(|f| f.is_finite()), "{value}: {found:?}");
    }
    let found = compare(pixels([3, 1], &[[0.5; 3]; 3]), pixels([3, 1], &[[0.0; 3]; 3])).unwrap();
    assert_relative_eq!(found.rel_mse, 25.0, max_relative = 1e-12);
    assert_eq!((found.mse, found.smape), (0.25, 2.0));
}

#[test]
fn different_sizes_and_non_finite_references_are_refused_f11() {
    let mut reference = vec![[0.0; 3]; 6];
    let wide = compare(pixels([3, 2], &reference), pixels([2, 3], &reference)).unwrap_err();
    assert_eq!(wide, MetricsError::Sizes { image: [3, 2], reference: [2, 3] });
    assert!(wide.to_string().contains("3x2") && wide.to_string().contains("2x3"));
    reference[4][1] = f32::NAN;
    reference[5][0] = f32::INFINITY;
    let error = compare(pixels([3, 2], &[[0.0; 3]; 6]), pixels([3, 2], &reference)).unwrap_err();
    assert!(matches!(error, MetricsError::NonFiniteReference { pixel: [1, 1], .. }), "{error}");
    assert!(error.to_string().contains("column 1, row 1"));
    assert!(matches!(Pixels::new([3, 2], &reference[1..]), Err(MetricsError::PixelCount { found: 5, .. })));
    assert!(matches!(Pixels::new([0, 2], &[]), Err(MetricsError::Empty { .. })));
}

#[test]
fn trimming_leaves_out_the_worst_0_1_percent_of_pixels() {
    let reference = vec![[1.0; 3]; 3000];
    let mut image = reference.clone();
    image[0] = [1.1; 3];
    for fireflies in 1..5 {
        image[fireflies * 7] = [1000.0; 3];
        let found = compare(pixels([60, 50], &image), pixels([60, 50], &reference)).unwrap();
        // Of 3000 pixels three are left out: one firefly, two, three, but not the fourth.
        assert_eq!(found.rel_mse_trimmed > 1.0, fireflies == 4, "{fireflies}: {found:?}");
        assert_eq!(found.worst_block.position, [0, 0]);
    }
}

#[test]
fn the_worst_block_is_found_at_the_edge() {
    let reference = vec![[1.0; 3]; 40 * 20];
    let mut image = reference.clone();
    image[19 * 40 + 39] = [2.0; 3];
    let worst = compare(pixels([40, 20], &image), pixels([40, 20], &reference)).unwrap().worst_block;
    assert_eq!((worst.position, worst.size), ([32, 16], [8, 4]));
    assert_relative_eq!(worst.rel_mse, 1.0 / 1.01 / 32.0, max_relative = 1e-12);
}

#[test]
fn srgb8_mse_is_the_squared_step_of_8_bit_files() {
    // Bytes 100 and 103 decoded from sRGB.
    let decode = |b: f64| ((b / 255.0 + 0.055) / 1.055).powf(2.4) as f32;
    let found = compare(pixels([1, 1], &[[decode(103.0); 3]]), pixels([1, 1], &[[decode(100.0); 3]])).unwrap();
    assert_relative_eq!(found.srgb8_mse, 9.0, max_relative = 1e-4);
    let clipped = compare(pixels([1, 1], &[[7.0, 1.0, -3.0]]), pixels([1, 1], &[[1.0, 90.0, 0.0]])).unwrap();
    assert_eq!((clipped.srgb8_mse, clipped.psnr), (0.0, 200.0));
}

/// Image, reference; MSE, PSNR and MSE of sRGB values, SMAPE of scikit-image and numpy, printed by `oracle.py` in the folder
/// above.
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
        let found = compare(pixels(SIZE, &image), pixels(SIZE, &reference)).unwrap();
        let found = [found.mse, found.psnr, found.display_mse, found.smape];
        assert_relative_eq!(found[..], expected[..], max_relative = 1e-12);
    }
}

fn ramp(count: usize) -> Vec<[f32; 3]> {
    (0..count).map(|i| [i as f32, 2.0 * i as f32, 1.0]).collect()
}

#[test]
fn block_means_are_those_of_whole_blocks() {
    let image = ramp(35);
    let blocks = block_means(pixels([7, 5], &image), [3, 2]).unwrap();
    assert_eq!(blocks.count, [2, 2]);
    // The first block: 0, 1, 2, 7, 8, 9; the next is 3 to the right, then 14 down.
    assert_eq!(blocks.means.iter().map(|m| m[0]).collect::<Vec<_>>(), [4.5, 7.5, 18.5, 21.5]);
    assert_eq!(blocks.means[3], [21.5, 43.0, 1.0]);
    for block in [[0, 1], [8, 1], [1, 6]] {
        assert_eq!(block_means(pixels([7, 5], &image), block), Err(MetricsError::Block { block, size: [7, 5] }));
    }
}

#[test]
fn dark_blocks_do_not_count_in_ratios_and_percentiles() {
    // Blocks of one pixel. The median is 2; 2 % of it is 0.04, so 0 and 0.03 do not count, 0.05 does.
    let reference = [0.0, 0.03, 0.05, 2.0, 2.0, 4.0, 8.0].map(|v| [v; 3]);
    let image = [9.0, 9.0, 0.05, 1.0, 2.0, 6.0, 16.0].map(|v| [v, v, 0.0]);
    let ratios = block_ratios(pixels([7, 1], &image), pixels([7, 1], &reference), [1, 1]).unwrap();
    assert_eq!(ratios.count(0), 5);
    assert_eq!(ratios.sorted(1), [0.5, 1.0, 1.0, 1.5, 2.0]);
    assert_eq!([ratios.percentile(0.0)[0], ratios.percentile(50.0)[0], ratios.percentile(100.0)[0]], [0.5, 1.0, 2.0]);
    assert_relative_eq!(ratios.percentile(90.0)[1], 1.8, max_relative = 1e-12);
    assert_eq!(ratios.percentile(50.0)[2], 0.0);
    // A channel that is dark beside the others does not count: 2 % of the median of 1, 1 and 0.01 is 0.02.
    let blue = block_ratios(pixels([1, 1], &image[..1]), pixels([1, 1], &[[1.0, 1.0, 0.01]]), [1, 1]).unwrap();
    assert_eq!([0, 1, 2].map(|c| blue.count(c)), [1, 1, 0]);
    let black = [[0.0; 3]; 7];
    let none = block_ratios(pixels([7, 1], &image), pixels([7, 1], &black), [1, 1]).unwrap();
    assert!(none.count(0) == 0 && none.percentile(50.0)[0].is_nan());
}

#[test]
fn downsampling_averages_by_area() {
    let image = ramp(6);
    // Three columns to two: each new one holds an old one and half of the middle one.
    let found = downsample(pixels([3, 2], &image), [2, 1]).unwrap();
    // Columns hold 0, 3 | 1, 4 | 2, 5: means 1.5, 2.5, 3.5.
    assert_relative_eq!(found[0][0], (1.5 + 0.5 * 2.5) / 1.5, max_relative = 1e-6);
    assert_relative_eq!(found[1][0], (0.5 * 2.5 + 3.5) / 1.5, max_relative = 1e-6);
    assert_eq!(downsample(pixels([3, 2], &image), [3, 2]).unwrap(), image);
    for target in [[4, 2], [3, 3], [0, 1]] {
        assert_eq!(downsample(pixels([3, 2], &image), target), Err(MetricsError::Target { size: [3, 2], target }));
    }
}

fn wild() -> impl Strategy<Value = Vec<[f32; 3]>> {
    let value = prop_oneof![-1.0_f32..4.0, Just(0.0), 1e-6_f32..1e-3, 10.0_f32..1e6];
    proptest::collection::vec([value.clone(), value.clone(), value], 45)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(100))]

    #[test]
    fn powers_of_two_scale_exactly(a in wild(), b in wild(), k in -10_i32..10) {
        let by = 2.0_f32.powi(k);
        let of = |by: f32| {
            let [a, b] = [&a, &b].map(|image| image.iter().map(|p| p.map(|v| v * by)).collect::<Vec<_>>());
            compare(pixels([9, 5], &a), pixels([9, 5], &b)).unwrap()
        };
        let [plain, scaled] = [of(1.0), of(by)];
        prop_assert_eq!(scaled.mse, plain.mse * f64::from(by) * f64::from(by));
        prop_assert_eq!((scaled.smape, scaled.mean_ratio), (plain.smape, plain.mean_ratio));
    }

    #[test]
    fn downsampling_keeps_the_mean_and_the_range(a in wild(), w in 1_u32..=9, h in 1_u32..=5) {
        let small = downsample(pixels([9, 5], &a), [w, h]).unwrap();
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
