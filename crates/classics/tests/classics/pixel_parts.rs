//! Samplers that divide pixels into parts, and the filter that weighs these.

use crate::support::{Made, Points, domain, film_points, image, random, render, sobol, squared_error};
use dapple_classics::{
    Hierarchical, HierarchicalOptions, PartRule, Role, Subdivision, SubdivisionOptions, TreeMean, TreeMeanOptions,
};
use dapple_core::samplers::Uniform;

#[test]
fn a_step_over_time_has_less_error_than_random_samples() {
    let step = |_: [f32; 2], rest: [f32; 4]| f32::from(u8::from(rest[2] < 0.3));
    // Error of the parts' sum, of the plain mean of the same samples, and of random samples; 64 samples in one pixel.
    let errors = |seed| {
        let domain = domain(&[Role::Time]);
        let mut sampler = Hierarchical::new(random(seed), &domain, HierarchicalOptions::default()).unwrap();
        let points = film_points(random(seed), &[Role::Time], Some(sampler.placed()));
        let filter = TreeMean::new(points, TreeMeanOptions::default().tree(PartRule::Contrast)).unwrap();
        let film = render(step, &mut sampler, [1, 1], 64.0);
        let random = render(step, &mut Uniform::new(random(seed)), [1, 1], 64.0);
        [image(&filter, &film), film.image(), random.image()].map(|x| f64::from(x[0][0]) - 0.3)
    };
    let all: Vec<[f64; 3]> = (0..200).map(errors).collect();
    let mean = |of: &dyn Fn(&[f64; 3]) -> f64| all.iter().map(of).sum::<f64>() / all.len() as f64;
    let [parts, plain, random] = [0, 1, 2].map(|k| (mean(&|e| e[k] * e[k]), mean(&|e| e[k])));
    // The variance of random samples is 0.21 / 64 = 0.0033, with a standard error of 10 % over 200 pixels.
    assert!((random.0 - 0.0033).abs() < 0.0007, "{random:?}");
    assert!(parts.0 < 0.15 * random.0 && parts.1.abs() < 0.005, "parts {parts:?}, random {random:?}");
    assert!(plain.1.abs() > 0.03, "the plain mean of these samples is biased: {plain:?}");
}

fn subdivision(seed: u64) -> Subdivision<Points> {
    Subdivision::new(sobol(seed), &domain(&[]), SubdivisionOptions::default()).unwrap()
}

#[test]
fn areas_remove_the_bias_of_split_parts() {
    let edge = |place: [f32; 2], _: [f32; 4]| f32::from(u8::from(place[0].fract() < 0.2));
    let mut sampler = subdivision(4);
    let points = film_points(sobol(4), &[], Some(sampler.placed()));
    let film = render(edge, &mut sampler, [8, 8], 200.0);
    let image = image(&TreeMean::new(points, TreeMeanOptions::default()).unwrap(), &film);
    let [plain, weighted] = [film.image(), image].map(|image| squared_error(&image, |_| 0.2));
    assert!(plain > 0.01 && weighted < 0.01 * plain, "{plain} and {weighted}");
}

#[test]
fn a_constant_image_gets_four_samples_per_pixel_and_the_rest_by_index() {
    for (spp, counts) in [(4.0, [4; 10]), (7.6, [16, 16, 16, 4, 4, 4, 4, 4, 4, 4])] {
        assert_eq!(render(|_, _| 0.5, &mut subdivision(1), [10, 1], spp).counts(), counts);
    }
}

#[test]
fn the_pilot_has_one_sample_in_each_quadrant() {
    // 1, 2, 4 and 8: no other four of them have this mean.
    let quadrant: Made = |[x, y], _| f32::from(1u8 << (2 * u8::from(x.fract() < 0.5) + u8::from(y.fract() < 0.5)));
    assert!(render(quadrant, &mut subdivision(9), [10, 5], 4.0).image().iter().all(|x| x[0] == 3.75));
}
