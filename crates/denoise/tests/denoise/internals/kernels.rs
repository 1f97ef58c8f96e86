//! Loops over tiles and windows. In debug builds a second copy of them would take as long to compile as all other tests of this
//! crate together, and `tests/golden.rs` sees any change.

use super::images::{PIXELS, SIDE, inputs, unfiltered_pair};
use crate::averaging::{VANISHING, Window, average};
use crate::inputs::{Guide, Inputs, guide};
use crate::planes::{LANES, Pair};
use crate::regression::regress;
use crate::tile::Likeness;
use crate::{ClusterRegression, ClusterRegressionOptions};
use dapple_core::{Estimate, Film, Filter, Frame, Needs};
use std::sync::atomic::Ordering;

/// A noisy image with the mean 1.
fn noisy() -> Inputs {
    inputs(|pixel, half| 0.75 + 0.5 * ((pixel * 7919 + half * 104_729) % 1009) as f32 / 1009.0)
}

/// The images of both halves for a change of one half's guide, against those before: true where they differ.
fn changed(image: impl Fn(&[Guide; 2]) -> Pair, inputs: &Inputs, half: usize) -> [bool; 2] {
    let guides = || [0, 1].map(|half| guide(inputs, half, true, false));
    let before = image(&guides());
    let mut other = guides();
    for (i, value) in other[half].colour.iter_mut().flat_map(|plane| plane.iter_mut().enumerate()) {
        *value += if i % 3 == 0 { 0.5 } else { 0.0 };
    }
    let after = image(&other);
    [0, 3].map(|first| before.0[first..first + 3] != after.0[first..first + 3])
}

const LIKE: Likeness = Likeness { patch: 1, colour: 2.0, features: None, outside: 1.0 };

/// With its own weights, a half would keep the noise that these follow.
#[test]
fn fits_predictions_and_averages_of_a_half_take_all_weights_from_the_other_half() {
    let inputs = noisy();
    let beside = unfiltered_pair(&inputs);
    let fitted = |guides: &[Guide; 2]| regress(&inputs, guides, &LIKE, &beside, 0.1);
    let window = Window { radius: 4, disc: None, cut: VANISHING, falloff: 0.05 };
    let values = [0, 1].map(|half: usize| &inputs.halves[half].colour);
    let averaged = |guides: &[Guide; 2]| average(&inputs, values, guides, &LIKE, &window, |_| true);
    for (half, expected) in [[false, true], [true, false]].into_iter().enumerate() {
        assert_eq!(changed(fitted, &inputs, half), expected);
        assert_eq!(changed(averaged, &inputs, half), expected);
    }
}

/// A single bright pixel reaches the pixels that its window holds: 9x9, or those at most the root of 18 away.
#[test]
fn averages_over_a_disc_leave_out_the_corners_of_its_square() {
    let inputs = noisy();
    let guides = [0, 1].map(|half| guide(&inputs, half, true, false));
    let one = |i: usize| if i == PIXELS / 2 + SIDE / 2 { 1.0 } else { 0.0 };
    let value = std::array::from_fn(|_| (0..PIXELS).map(one).collect());
    let reached = |disc| {
        let window = Window { radius: 4, disc, cut: VANISHING, falloff: 0.05 };
        let Pair([red, ..]) = average(&inputs, [&value, &value], &guides, &LIKE, &window, |_| true);
        red.iter().filter(|v| **v > 0.0).count()
    };
    assert_eq!([None, Some(18)].map(reached), [81, 61]);
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
    for lanes in [1, 4, 8] {
        assert!(image(lanes) == wanted, "{lanes} lanes");
    }
}
