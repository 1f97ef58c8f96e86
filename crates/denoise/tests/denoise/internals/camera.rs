//! Depths from positions.

use super::*;

#[test]
fn depths_of_noisy_positions_follow_the_distance() {
    // A floor that runs away from the camera: row y is 1 / (y + 1) wide per pixel. Every place is off by up to half a step.
    let size = [24, 16];
    let row = |i: usize| (i / 24) as f32;
    let noise = |i: usize| ((i * 7919) % 1009) as f32 / 1009.0 - 0.5;
    let width = |i: usize| 1.0 + 0.02 * row(i);
    let position: Vec<[f32; 3]> =
        (0..384).map(|i| [width(i) * ((i % 24) as f32 - 12.0 + 0.3 * noise(i)), 0.0, 4.0 * row(i)]).collect();
    let found = depths(size, &position, |_| true);
    for (i, depth) in found.iter().enumerate() {
        let relative = depth / (STEPS * width(i));
        assert!((0.8..1.1).contains(&relative), "pixel {i}: {relative}");
    }
}

#[test]
fn misses_have_no_depth_and_lone_pixels_a_finite_one() {
    let found = depths([3, 1], &[[1.0, 2.0, 3.0], [0.0; 3], [5.0, 2.0, 3.0]], |i| i != 1);
    assert!(found[1] == 0.0 && found[0] > 0.0 && found[2].is_finite(), "{found:?}");
}
