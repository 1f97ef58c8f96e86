use super::*;
use crate::test_films::normal;

#[test]
fn margins_mirror_the_image_however_small_it_is() {
    let plane = Mirrored::new([3, 1], 4, &[0.0, 1.0, 2.0]);
    assert_eq!(plane.row(0, [-4, 0], 11), [0.0, 1.0, 2.0, 1.0, 0.0, 1.0, 2.0, 1.0, 0.0, 1.0, 2.0]);
    assert_eq!(plane.row(0, [0, 4], 3), [0.0, 1.0, 2.0]);
    assert_eq!(Mirrored::new([1, 1], 2, &[7.0]).row(0, [-2, 1], 5), [7.0; 5]);
}

#[test]
fn exponentials_are_accurate() {
    for k in 0..20_000 {
        let x = k as f32 * 1e-3;
        let wanted = libm::exp(-f64::from(x));
        assert!((f64::from(exp_minus(x)) / wanted - 1.0).abs() < 1e-5, "{x}");
    }
    assert!(exp_minus(0.0) == 1.0 && exp_minus(f32::INFINITY) < 1e-34);
}

/// Two images of the same truth and the same variance.
fn noisy(size: [usize; 2], seed: u64, image: impl Fn(usize) -> f64) -> [Vec<f32>; 2] {
    let value = |half: u64, i: usize| (image(i) + normal((seed << 40) + 2 * i as u64 + half)) as f32;
    [0, 1].map(|half| (0..size[0] * size[1]).map(|i| value(half, i)).collect())
}

fn guide(size: [usize; 2], values: &[f32], variance: f32) -> PatchGuide {
    let variances = vec![variance; values.len()];
    let plane = |values: &[f32]| std::array::from_fn(|_| Mirrored::new(size, 10, values));
    PatchGuide { colour: plane(values), variance: plane(&variances) }
}

const LIKE: Patches = Patches { window: 5, patch: 3, k: 0.45, alpha: 1.0 };

#[test]
fn squared_differences_of_equal_means_are_noise_alone() {
    let size = [128, 128];
    for (alpha, wanted) in [(1.0, 0.0), (0.5, 0.5 / (0.45 * 0.45))] {
        let mut all = 0.0;
        for seed in 0..4 {
            let [a, _] = noisy(size, seed, |_| 0.0);
            let mut band = Band::new(size, 0..128, Patches { alpha, ..LIKE });
            band.compare(&guide(size, &a, 1.0), [3, -2]);
            let middle = (0..128 * 128).filter(|i| (4..124).contains(&(i % 128)) && (4..124).contains(&(i / 128)));
            all += middle.map(|i| f64::from(band.planes[0][i]) / 3.0).sum::<f64>() / (4.0 * 120.0 * 120.0);
        }
        // The standard error is sqrt(2) / 0.45^2 / 240 = 0.03, about.
        assert!((all - wanted).abs() < 0.12, "{alpha}: {all}, not {wanted}");
    }
}

#[test]
fn means_agree_with_the_sums_over_all_pixels() {
    // Window 1 and patches of one pixel, without symmetry: a step, so that pairs across it are no more similar.
    let size = [7, 5];
    let image: Vec<f32> = (0..35).map(|i| if i % 7 < 3 { 0.0 } else { 9.0 }).collect();
    let like = Patches { window: 1, patch: 0, k: 1.0, alpha: 1.0 };
    let values = [&image, &vec![1.0; 35]].map(|values| Mirrored::new(size, 10, values));
    let means = patch_means(size, &guide(size, &image, 1.0), &values, like);
    for (i, [mean, weight]) in means.into_iter().enumerate() {
        assert_eq!(mean, image[i], "nothing crosses the step");
        let across = i % 7 == 2 || i % 7 == 3;
        assert_eq!(weight, if across { 6.0 } else { 9.0 }, "pixel {i}");
    }
}

#[test]
fn noise_falls_and_bands_leave_no_seams() {
    let size = [64, 80];
    let [a, b] = noisy(size, 9, |_| 0.0);
    let values = [&a, &vec![1.0; a.len()]].map(|values| Mirrored::new(size, 10, values));
    let means = patch_means(size, &guide(size, &b, 1.0), &values, LIKE);
    let variance = |rows: std::ops::Range<usize>| {
        let all = &means[rows.start * 64..rows.end * 64];
        all.iter().map(|mean| f64::from(mean[0] * mean[0])).sum::<f64>() / all.len() as f64
    };
    let whole = variance(0..80);
    assert!(whole < 0.05, "{whole} of the variance is left");
    let [seam, middle] = [28..36, 12..20].map(variance);
    assert!(seam < 4.0 * middle && middle < 4.0 * seam, "{seam} at a seam, {middle} within a band");
    let rows = |rows: std::ops::Range<usize>| {
        let mut band = Band::new(size, rows, LIKE);
        band.compare(&guide(size, &b, 1.0), [1, -2]);
        band.weigh();
        let at = (40 - band.wide.start) * 64;
        band.planes[0][at..at + 64].to_vec()
    };
    assert_eq!(rows(32..64), rows(40..41), "a row's weights do not depend on its band");
}
