//! The best of a bank of filters by Stein's estimate of their errors.

use crate::bank::{FILTERS, NEEDS, Planes, apply};
use crate::support::{Field, Traced, frame, image, mean_of_columns, normal, random, run, squared_error};
use crate::windows::{FEATURES, Means};
use dapple_classics::{Sure, SureFilter, SureFilterOptions, SureOptions};
use dapple_conformance::statistics::Mean;
use dapple_core::samplers::Uniform;
use dapple_core::{Block, Draws, Estimate, Film, Filter as _, FirstHit, Limits, Render, Worker};

/// Noise of deviation 0.1 about an edge, whose features do not show it.
fn edge_with_noise() -> Film {
    let mut field = Field(|[x, _]: [u32; 2], u: [f32; 4]| {
        let noise = u.iter().map(|u| u - 0.5).sum::<f32>() * 0.346;
        [if x < 16 { 0.5 } else { 1.0 } + noise; 3]
    });
    let (mut sampler, limits) = (Uniform::new(random(3)), Limits::spp(16.0));
    Render::new(frame([32, 32]), &limits).needs(NEEDS).run(&mut field, &mut sampler).unwrap()
}

fn filter(options: SureFilterOptions) -> SureFilter {
    SureFilter::with_options(options).unwrap()
}

#[test]
fn the_best_filter_keeps_edges_and_removes_noise() {
    let film = edge_with_noise();
    let filtered = filter(SureFilterOptions::default().window(7)).apply(&film).unwrap();
    let truth = |i: usize| if i % 32 < 16 { 0.5 } else { 1.0 };
    let [error, before] = [&filtered.radiance, &film.image()].map(|image| squared_error(image, truth));
    assert!(error < 0.1 * before, "{error} of {before}");
    // The reported error is that of the image.
    let reported = f64::from(filtered.error.unwrap().iter().sum::<f32>()) / 1024.0;
    assert!((reported / error - 1.0).abs() < 0.7, "{reported} for {error}");
}

#[test]
fn fast_searches_five_pixels() {
    let film = edge_with_noise();
    let of = |options| image(&filter(options), &film);
    let [five, four] = [5, 4].map(|window| of(SureFilterOptions::default().window(window)));
    assert!(of(SureFilterOptions::default().fast(true)) == five && five != four);
    assert!(SureFilter::with_options(SureFilterOptions::default().window(21)).is_err());
}

#[test]
fn samples_go_where_filters_err() {
    // A wall: flat on the left; stripes of one pixel under noise on the right, which no filter can smooth.
    let mut wall = Traced(|draws: &Draws<'_>, _: &mut Worker| {
        let ([x, y], [u, ..]) = (draws.pixel(), draws.block(Block::new(0)));
        let stripe = if x >= 16 && (x + y) % 2 == 0 { 0.8 } else { 0.2 };
        let radiance = [if x < 16 { 0.5 } else { stripe + 0.3 * u }; 3];
        Estimate::new(radiance).with_first_hit(FirstHit::new([0.0; 3], [0.0, 0.0, 1.0], 1.0))
    });
    let mut sampler = Sure::with_options(random(1), SureOptions::default().window(5)).unwrap();
    let film = run(&mut wall, &mut sampler, [32, 32], &Limits::spp(32.0));
    let [flat, striped] = [0..12, 20..32].map(|x| mean_of_columns(&film, x, |i| film.count(i) as f64));
    assert!(flat < 12.0 && striped > 45.0, "{flat} {striped}");
}

const SIDE: usize = 24;

/// An image without features, whose pixels have this colour and variance.
fn planes(colour: impl Fn(usize) -> [f64; 3], variance: f64) -> Planes {
    let pixels = SIDE * SIDE;
    Planes {
        size: [SIDE; 2],
        means: Means {
            colour: (0..pixels).map(colour).collect(),
            variance: vec![[variance; 3]; pixels],
            known: vec![true; pixels],
        },
        features: vec![[[0.0; FEATURES]; 2]; pixels],
    }
}

/// Three normal numbers of variance 1 for each pixel.
fn noise(seed: u64, i: usize) -> [f64; 3] {
    [0, 1, 2].map(|c| normal((seed << 32) | (i as u64 * 4 + c)))
}

#[test]
fn an_identity_has_the_error_of_its_pixel() {
    for pixel in apply(&planes(|i| noise(2, i), 0.7), 0) {
        // In channels and filters alike.
        assert!(pixel.error[1..].iter().all(|e| (e - 0.7).abs() < 1e-12), "{:?}", pixel.error);
        assert!((pixel.error[0] - 1.4).abs() < 1e-12);
    }
}

/// Stein's estimate minus the squared error, averaged over an image with an edge, of each filter: with the derivative and
/// without it.
fn excesses(seed: u64) -> [[f64; 2]; FILTERS] {
    let deviation: f64 = 0.1;
    let truth = |i: usize| if i % SIDE < SIDE / 2 { 0.2 } else { 0.3 };
    let planes = planes(|i| noise(seed, i).map(|z| truth(i) + deviation * z), deviation * deviation);
    let mut excesses = [[0.0; 2]; FILTERS];
    for (i, pixel) in apply(&planes, 3).iter().enumerate() {
        for (filter, excess) in excesses.iter_mut().enumerate() {
            let mean = |of: &dyn Fn(f64, usize) -> f64| {
                (0..3).map(|c| of(f64::from(pixel.filtered[filter][c]), c)).sum::<f64>() / (3 * SIDE * SIDE) as f64
            };
            let error = mean(&|value, _| (value - truth(i)).powi(2));
            excess[0] += pixel.error[1 + filter] / (SIDE * SIDE) as f64 - error;
            excess[1] += mean(&|value, c| (value - planes.means.colour[i][c]).powi(2) - deviation * deviation) - error;
        }
    }
    excesses
}

/// 8 tests within 5 standard errors of 128 replicates fail by chance with probability 2e-5.
#[test]
fn steins_estimate_is_the_squared_error_on_average() {
    let all: Vec<_> = (10..138).map(excesses).collect();
    // The widest filter is nearly a box; the fourth follows the noise.
    for filter in [0, 1, 2, 3] {
        let [with, without] = [0, 1].map(|k| all.iter().map(|of| of[filter][k]).collect::<Mean>());
        assert!(with.deviation(0.0).abs() < 5.0, "{filter}: {with:?}");
        // The control: without the derivative it is far too low.
        assert!(without.deviation(0.0) < -10.0, "{filter}: {without:?}");
    }
}
