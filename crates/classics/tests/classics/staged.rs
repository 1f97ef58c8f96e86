//! Means of means over ever larger cells.

use crate::support::{Made, domain, film_at, film_points, image, mean_of, random, render, sobol, squared_error};
use dapple_classics::{FilmPoints, Staged, StagedOptions, Subdivision, SubdivisionOptions};
use dapple_core::samplers::Uniform;

fn staged(points: FilmPoints, width: f64) -> Staged {
    Staged::new(points, StagedOptions::default().width(width)).expect("a width in range")
}

/// The staged mean of grey samples: places in a pixel, and values.
fn staged_mean(samples: impl IntoIterator<Item = ([f32; 2], f32)>) -> f64 {
    let samples: Vec<_> = samples.into_iter().map(|(at, value)| (at, [value; 3])).collect();
    let (film, points) = film_at([1, 1], &samples);
    f64::from(image(&staged(points, 1.0), &film)[0][0])
}

/// The middles of all cells of 1/`side` pixel.
fn middles(side: usize) -> impl Iterator<Item = [f32; 2]> + Clone {
    (0..side * side).map(move |i| [i % side, i / side].map(|k| (k as f32 + 0.5) / side as f32))
}

#[test]
fn a_clump_of_samples_counts_as_one_cell() {
    // The clump's place, and that of a sample of value 0 in the other box of 1/2 pixel, and so on.
    let (clump, elsewhere) = ([0.55, 0.3], middles(2).filter(|at| !(at[0] > 0.5 && at[1] < 0.5)));
    for count in [1, 2, 7, 1000] {
        let clump = (0..count).map(|k| ([clump[0] + 0.0001 * k as f32 / 2.0, clump[1]], 1.0));
        let rest = elsewhere.clone().map(|at| (at, 0.0));
        // The plain mean is count / (count + 3).
        assert_eq!(staged_mean(clump.clone().chain(rest.clone())), 0.25, "{count}");
        // Two samples in one other box of 1/4 pixel, in different cells.
        let quarter = [([0.8, 0.3], 0.0), ([0.95, 0.3], 0.0)];
        assert_eq!(staged_mean(clump.clone().chain(quarter).chain(rest.clone())), 0.125, "{count}");
        // The other three cells in the clump's box of 1/4 pixel.
        let cells = [([0.7, 0.3], 0.0), ([0.55, 0.45], 0.0), ([0.7, 0.45], 0.0)];
        assert_eq!(staged_mean(clump.chain(quarter).chain(cells).chain(rest)), 0.25 / 2.0 / 4.0, "{count}");
    }
}

#[test]
fn one_sample_in_each_cell_gives_the_plain_mean() {
    let value = |at: [f32; 2]| at[0] * at[0] + 3.0 * at[1];
    for side in [1, 2, 4, 8] {
        let samples: Vec<_> = middles(side).map(|at| (at, value(at))).collect();
        let plain = samples.iter().map(|x| f64::from(x.1)).sum::<f64>() / samples.len() as f64;
        let found = staged_mean(samples);
        assert!((found - plain).abs() < 1e-6 * plain, "{side}: {found}, not {plain}");
    }
    assert_eq!(staged_mean([]), 0.0);
}

#[test]
fn wider_boxes_count_neighbours_by_their_overlap() {
    // Pixels of the values 0, 1, 4 and 9, with samples in each box of 1/2 pixel.
    let film = render(|at, _| at[0].floor() * at[0].floor(), &mut Uniform::new(sobol(5)), [4, 1], 16.0);
    for (width, expected) in [
        (1.0, [0.0, 1.0, 4.0, 9.0]),
        (1.5, [0.5 / 2.5, 4.0 / 3.0, (0.5 + 8.0 + 4.5) / 3.0, (2.0 + 18.0) / 2.5]),
        (2.0, [1.0 / 3.0, 1.5, 4.5, 22.0 / 3.0]),
        (3.0, [0.5, 5.0 / 3.0, 14.0 / 3.0, 6.5]),
    ] {
        let image = image(&staged(film_points(sobol(5), &[], None), width), &film);
        for (found, expected) in image.iter().zip(expected) {
            assert!((f64::from(found[0]) - expected).abs() < 1e-5, "{width}: {image:?}");
        }
    }
}

const EDGE: Made = |at, _| f32::from(u8::from(at[0].fract() < 0.2));

/// A false alarm at five standard errors has a probability of 6e-7.
#[test]
fn independent_samples_have_no_bias() {
    let film = render(EDGE, &mut Uniform::new(random(6)), [64; 2], 6.0);
    let image = image(&staged(film_points(random(6), &[], None), 1.0), &film);
    let mean = mean_of(&image);
    let error = (squared_error(&image, |_| mean) / 4095.0).sqrt();
    let off = |truth: f64| (mean - truth).abs() / error;
    assert!(off(0.2) < 5.0 && off(0.23) > 5.0 && off(0.17) > 5.0, "{mean} with an error of {error}");
}

#[test]
fn samples_placed_at_an_edge_count_less_than_in_the_plain_mean() {
    let mut sampler = Subdivision::new(sobol(4), &domain(&[]), SubdivisionOptions::default()).expect("axes");
    let filter = staged(film_points(sobol(4), &[], Some(sampler.placed())), 1.0);
    let film = render(EDGE, &mut sampler, [8, 8], 200.0);
    let [plain, staged] = [film.image(), image(&filter, &film)].map(|image| squared_error(&image, |_| 0.2));
    assert!(plain > 0.01 && staged < 0.01 * plain, "{plain} and {staged}");
}
