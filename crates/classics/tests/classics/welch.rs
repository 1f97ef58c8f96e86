//! Means over the pixels that a test cannot tell apart.

use crate::support::{Field, frame, image, normal, random, squared_error};
use dapple_classics::{TestDegrees, Welch, WelchOptions};
use dapple_core::samplers::Uniform;
use dapple_core::{Estimate, Film, Filter as _, FirstHit, Limits, Render};

/// An empty film of what the filter reads.
fn empty(size: [u32; 2]) -> Film {
    Film::with_recorders(frame(size), Welch::default().needs(), Welch::default().recorders())
}

fn push(film: &mut Film, i: usize, x: f32) {
    let hit = FirstHit::new([0.0; 3], [0.0, 0.0, 1.0], 1.0);
    film.push_estimate(i, 0, &Estimate::new([x; 3]).with_first_hit(Some(hit)));
}

/// The number of pairs of pixels in a row.
const PAIRS: usize = 250;

/// Pairs of pixels of 16 samples that are normal after the transform, the second shifted by `shift`. Pairs are far from each
/// other's brightness.
fn pairs(rows: usize, shift: f64) -> Film {
    let mut film = empty([2 * PAIRS as u32, rows as u32]);
    for i in 0..film.frame().pixels() {
        let (x, y) = (i / 2 % PAIRS, i / 2 / PAIRS);
        let base = 100.0 * (1 + x % 2 + 2 * (y % 2)) as f64 + if i % 2 == 1 { shift } else { 0.0 };
        for k in 0..16 {
            let transformed = base + normal((i as u64) << 8 | k);
            push(&mut film, i, (0.5 * transformed + 1.0).powi(2) as f32);
        }
    }
    film
}

/// The share of pairs that are told apart.
fn told_apart(film: &Film, degrees: TestDegrees) -> f64 {
    let filter = Welch::with_options(WelchOptions::default().radius(1).df(degrees)).unwrap();
    let image = image(&filter, film);
    let is_own = |i: usize| image[i][0] == film.mean(i)[0] as f32;
    let pairs = (0..image.len()).step_by(2);
    assert!(pairs.clone().all(|i| is_own(i) == is_own(i + 1)), "of a pair, one is joined");
    pairs.clone().filter(|&i| is_own(i)).count() as f64 / pairs.len() as f64
}

/// Shares lie within 5 standard errors of those of an exact t-test, or of the figures in its place.
#[test]
fn pixels_of_equal_expectation_are_told_apart_at_the_level() {
    let rows = 160;
    let film = pairs(rows, 0.0);
    let found = told_apart(&film, TestDegrees::Counts);
    // Near-normal samples and the correction for skewness add a tenth to the level of 0.005.
    assert!((found - 0.0055).abs() < 5.0 * (0.0055 / (PAIRS * rows) as f64).sqrt(), "{found}");
    let welch = told_apart(&film, TestDegrees::Welch);
    assert!(welch <= found && welch > 0.003, "{welch}");
    // The control: of pairs that are two standard errors of their difference apart, a sixth are told.
    assert!(told_apart(&pairs(20, 0.75), TestDegrees::Counts) > 0.15);
}

#[test]
fn pixels_of_one_sample_join_nobody() {
    for (samples, joins) in [(&[2.0][..], false), (&[2.0, 1.5, 2.5], true)] {
        let mut film = empty([2, 1]);
        samples.iter().for_each(|&x| push(&mut film, 0, x));
        [1.2f32, 2.6, 1.9].iter().for_each(|&x| push(&mut film, 1, x));
        let found = [0, 1].map(|i| image(&Welch::default(), &film)[i][0] != film.mean(i)[0] as f32);
        assert_eq!(found, [joins; 2]);
    }
}

#[test]
fn noise_is_removed_and_an_edge_without_features_stays() {
    let truth = |i: usize| if i % 48 < 24 { 0.3 } else { 0.9 };
    let mut field = Field(|[x, _]: [u32; 2], u: [f32; 4]| [if x < 24 { 0.3 } else { 0.9 } * (0.5 + u[0]); 3]);
    let (filter, limits) = (Welch::default(), Limits::spp(32.0));
    let film = Render::new(frame([48, 48]), &limits).needs(filter.needs()).recorders(filter.recorders());
    let film = film.run(&mut field, &mut Uniform::new(random(3))).unwrap();
    let filtered = filter.apply(&film).unwrap();
    let [after, before] = [&filtered.radiance, &film.image()].map(|image| squared_error(image, truth));
    assert!(after < 0.02 * before, "{after} of {before}");
    // The reported variance is that of the result, but for pixels that noise has told apart.
    let reported = f64::from(filtered.error.unwrap().iter().sum::<f32>()) / 2304.0;
    assert!(reported < after && reported > 0.2 * after, "{reported} for {after}");
}
