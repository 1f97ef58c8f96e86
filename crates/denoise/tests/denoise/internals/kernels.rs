//! Loops over tiles and windows. In debug builds a second copy of them would take as long to compile as all other tests of this
//! crate together, and `tests/golden.rs` sees any change.

use super::images::{PIXELS, SIDE, film, planes};
use crate::ClusterRegression;
use crate::averaging::{VANISHING, Window, average};
use crate::graph::Graph;
use crate::inputs::{Guide, Inputs, guide};
use crate::planes::{LANES, Pair, map_to_one, planes_of};
use crate::regression::regress;
use crate::tile::Likeness;
use dapple_core::{Estimate, Film, Filter, Frame, Needs};
use std::sync::atomic::Ordering;

/// A noisy image with the mean 1.
fn noisy() -> Film {
    film(|pixel, half| 0.75 + 0.5 * ((pixel * 7919 + half * 104_729) % 1009) as f32 / 1009.0)
}

/// The images of both halves for a change of one half's guide, against those before: true where they differ.
fn changed(image: impl Fn(&Graph<'_>, &Inputs, [Guide; 2]) -> Pair, film: &Film, half: usize) -> [bool; 2] {
    let [before, after] = [0.0, 0.5].map(|change| {
        planes(film, |graph, inputs| {
            let mut guides = [0, 1].map(|half| guide(graph, inputs, half, true, false));
            let [step] = planes_of(graph, move |i| [if i % 3 == 0 { change } else { 0.0 }]);
            let moved = guides[half].colour.map(|plane| map_to_one(graph, [plane, step], |[v, step]| v + step));
            guides[half].colour = moved;
            image(graph, inputs, guides).0
        })
    });
    [0, 3].map(|first| before[first..first + 3] != after[first..first + 3])
}

const LIKE: Likeness = Likeness { patch: 1, colour: 2.0, features: None, outside: 1.0 };

/// With its own weights, a half would keep the noise that these follow.
#[test]
fn fits_predictions_and_averages_of_a_half_take_all_weights_from_the_other_half() {
    let fitted = |graph: &Graph<'_>, inputs: &Inputs, guides: [Guide; 2]| {
        regress(graph, inputs, guides, LIKE, (inputs.unfiltered(), 0.1))
    };
    let window = Window { radius: 4, disc: None, cut: VANISHING, falloff: 0.05 };
    let averaged = |graph: &Graph<'_>, inputs: &Inputs, guides: [Guide; 2]| {
        average(graph, inputs, inputs.halves.map(|half| half.colour), guides, (LIKE, window), Vec::new())
    };
    for (half, expected) in [[false, true], [true, false]].into_iter().enumerate() {
        assert_eq!(changed(fitted, &noisy(), half), expected);
        assert_eq!(changed(averaged, &noisy(), half), expected);
    }
}

/// A single bright pixel reaches the pixels that its window holds: 9x9, or those at most the root of 18 away.
#[test]
fn averages_over_a_disc_leave_out_the_corners_of_its_square() {
    let film = noisy();
    let reached = |disc| {
        let window = Window { radius: 4, disc, cut: VANISHING, falloff: 0.05 };
        let [red] = planes(&film, |graph, inputs| {
            let guides = [0, 1].map(|half| guide(graph, inputs, half, true, false));
            let value = planes_of(graph, |i| [if i == PIXELS / 2 + SIDE / 2 { 1.0 } else { 0.0 }; 3]);
            let Pair([red, ..]) = average(graph, inputs, [value; 2], guides, (LIKE, window), Vec::new());
            [red]
        });
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
