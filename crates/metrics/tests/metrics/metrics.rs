//! Every metric against closed forms, an independent implementation and statistics.

use approx::assert_relative_eq;
use dapple_metrics::{Comparison, MetricsError, Pixels, WORST_BLOCK_SIZE, compare};

/// Uniform numbers in [0, 1) by SplitMix64 [after Steele 2014].
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ z >> 31) >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn image(&mut self, count: usize, value: impl Fn(f64) -> f64) -> Vec<[f32; 3]> {
        (0..count).map(|_| std::array::from_fn(|_| value(self.next()) as f32)).collect()
    }
}

fn pixels(size: [u32; 2], values: &[[f32; 3]]) -> Pixels<'_> {
    Pixels::new(size, values).unwrap()
}

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

/// Student's t of the mean MSE of 64 pairs of 64x64 noise images of variance 1/12 against `expected`. `shared` is the
/// share of the first image's noise in the second.
fn t_of_noise_pairs(seed: u64, expected: f64, shared: f64) -> f64 {
    let replicates = 64;
    let size = [64, 64];
    let mut random = Random(seed);
    let found: Vec<f64> = (0..replicates)
        .map(|_| {
            let a = random.image(64 * 64, |u| u);
            let mut b = random.image(64 * 64, |u| u);
            for (b, a) in b.iter_mut().flatten().zip(a.iter().flatten()) {
                *b += shared as f32 * (a - 0.5);
            }
            compare(pixels(size, &a), pixels(size, &b)).unwrap().mse
        })
        .collect();
    let n = f64::from(replicates);
    let mean = found.iter().sum::<f64>() / n;
    let variance = found.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / (n - 1.0);
    (mean - expected) / (variance / n).sqrt()
}

#[test]
fn the_mse_of_two_independent_noise_images_is_twice_their_variance_f11() {
    // Student's t with 63 degrees of freedom exceeds 5.43 either way in 9.6e-7 of all runs.
    const BOUND: f64 = 5.43;
    let t = t_of_noise_pairs(2026, 2.0 / 12.0, 0.0);
    assert!(t.abs() < BOUND, "t = {t}");
    // Negative controls: a twentieth of the noise shared, and an expectation 1 % too high.
    let t = t_of_noise_pairs(2026, 2.0 / 12.0, 0.05);
    assert!(t < -BOUND, "the control passed: t = {t}");
    let t = t_of_noise_pairs(2026, 2.0 / 12.0 * 1.01, 0.0);
    assert!(t < -BOUND, "the control passed: t = {t}");
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
