//! The error of means of 4x4 pixels.

use dapple_metrics::{Measurement, Metric, Pixels};

const SIDE: u32 = 256;

fn measured(image: &[[f32; 3]], reference: &[[f32; 3]], variance: Option<&[[f32; 3]]>) -> f64 {
    let pixels = |values| Pixels::new([SIDE, SIDE], values).expect("an image");
    let measurement = Measurement::new(pixels(image), pixels(reference), variance.map(pixels)).expect("a comparison");
    (Metric::find("srgb8_mse4").expect("an entry").of)(&measurement).expect("a value")
}

/// An image of 0.5 with uniform noise of this width.
fn image(seed: u64, width: f32) -> Vec<[f32; 3]> {
    let noise = |i: u64| {
        let hash = (i + (seed << 32) + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        ((hash ^ hash >> 29).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 40) as f32 / (1 << 24) as f32 - 0.5
    };
    (0..u64::from(SIDE * SIDE)).map(|i| [0, 1, 2].map(|c| 0.5 + width * noise(3 * i + c))).collect()
}

#[test]
fn noise_of_pixels_counts_for_a_sixteenth_and_that_of_the_reference_not_at_all() {
    let (flat, noisy) = (image(1, 0.0), image(1, 0.2));
    // The slope of the display's curve at 0.5, and the variance of uniform noise.
    let slope = 255.0 * 1.055 / 2.4 * 0.5_f64.powf(1.0 / 2.4 - 1.0);
    let expected = slope * slope * 0.04 / 12.0 / 16.0;
    let alone = measured(&noisy, &flat, None) / expected;
    // A relative deviation of 1.3 %: 4096 blocks of 3 channels.
    assert!((alone - 1.0).abs() < 0.06, "{alone}");

    // Two halves, each as noisy as the image: their mean and its variance.
    let (a, b) = (image(2, 0.2), image(3, 0.2));
    let of_halves = |f: fn(f32, f32) -> f32| -> Vec<[f32; 3]> {
        a.iter().zip(&b).map(|(a, b)| std::array::from_fn(|c| f(a[c], b[c]))).collect()
    };
    let mean = of_halves(|a, b| 0.5 * (a + b));
    let variance = of_halves(|a, b| 0.25 * (a - b).powi(2));
    let crossed = measured(&noisy, &mean, Some(&variance)) / expected;
    assert!((crossed - 1.0).abs() < 0.1, "{crossed}");
    // The control: without its variance, the reference's noise adds a half.
    let wrong = measured(&noisy, &mean, None) / expected;
    assert!((wrong - 1.5).abs() < 0.1, "{wrong}");
}
