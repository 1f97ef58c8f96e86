//! Means over windows and values of pixels.

use super::*;
use crate::ClusterRegression;
use dapple_core::{Estimate, Film, Filter, Frame, Needs};
use std::sync::atomic::Ordering;

/// Windows are summed part by part; the parts of 32 rows or more must not show.
#[test]
fn means_over_windows_are_those_of_all_their_pixels() {
    for ([width, height], radius) in [([37, 150], 1), ([70, 97], 3), ([5, 200], 10), ([64, 33], 20), ([1, 1], 2)] {
        let plane: Plane = (0..width * height).map(|i| ((i * 7919) % 1009) as f32).collect();
        let mean = box_mean(&plane, [width, height], radius);
        let near = |k: usize, end: usize| (0..=2 * radius).map(move |d| (k + d).saturating_sub(radius).min(end - 1));
        for (i, found) in mean.iter().enumerate() {
            let value = |y: usize| near(i % width, width).map(|x| f64::from(plane[y * width + x])).sum::<f64>();
            let wanted = near(i / width, height).map(value).sum::<f64>() / ((2 * radius + 1) as f64).powi(2);
            let apart = (f64::from(*found) - wanted).abs();
            assert!(apart <= 1e-5 * wanted, "{found}, not {wanted}: {i}, radius {radius}");
        }
    }
}

#[test]
fn planes_hold_what_is_computed_of_each_pixel() {
    let planes: [Plane; 2] = std::array::from_fn(|k| (0..10_000).map(|i| (i * (k + 1)) as f32).collect());
    let [sum, difference] = map([&planes[0], &planes[1]], |[a, b]| [a + b, b - a]);
    assert!((0..10_000).all(|i| sum[i] == (3 * i) as f32 && difference[i] == i as f32));
    let mut both = sum.clone();
    update(&mut both, [&difference], |sum, [difference]| sum - 3.0 * difference);
    assert!(both.iter().all(|value| *value == 0.0));
}

/// Windows of several vectors overlap, so sums over them must not depend on the vectors' width.
#[test]
fn images_have_the_same_bits_for_any_number_of_lanes() {
    let [width, height] = [200, 30];
    let mut film =
        Film::new(Frame::new(width, height).unwrap(), Needs::none().with_variance().with_halves().with_features());
    let mut state = 1u32;
    for pixel in 0..(width * height) as usize {
        for sample in 0..4 {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let noise = (state >> 8) as f32 / 16_777_216.0;
            let radiance = if noise < 0.02 { 40.0 } else { 0.2 + noise };
            film.push_estimate(pixel, sample % 2, &Estimate::new([radiance; 3]));
        }
    }
    let image = |lanes| {
        LANES.store(lanes, Ordering::Relaxed);
        let image = ClusterRegression::new().apply(&film).unwrap();
        LANES.store(0, Ordering::Relaxed);
        image.radiance.iter().flatten().map(|v| v.to_bits()).collect::<Vec<_>>()
    };
    let wanted = image(0);
    let emulated = if cfg!(all(debug_assertions, target_arch = "x86_64")) { None } else { Some(4) };
    for lanes in [1, 8].into_iter().chain(emulated) {
        assert!(image(lanes) == wanted, "{lanes} lanes");
    }
}
