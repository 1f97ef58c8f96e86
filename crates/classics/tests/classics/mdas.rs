//! Multidimensional adaptive sampling, and its boxes.

use crate::support::{
    Made, domain, film_points, image, mean_of_columns, random, render, render_with, sobol, squared_error,
};
use dapple_classics::{Mdas, MdasBoxes, MdasBoxesOptions, MdasOptions, Role};
use dapple_conformance::toys;
use dapple_core::samplers::Uniform;
use dapple_core::{Film, Needs, PointSet as _};
use std::sync::Arc;

/// The film and the image of mdas and its filter, in samples per pixel.
fn integrated(made: Made, needs: Needs, spp: f64, size: [u32; 2]) -> (Film, Vec<[f32; 3]>) {
    let mut sampler = Mdas::new(sobol(5), &domain(&[Role::Time]), MdasOptions::default()).unwrap();
    let points = film_points(sobol(5), &[Role::Time], Some(sampler.placed()));
    let film = render_with(needs, made, &mut sampler, size, spp);
    let image = image(&MdasBoxes::new(points, MdasBoxesOptions::default()).unwrap(), &film);
    (film, image)
}

/// A step over time: 1 before 1/3, in all pixels.
fn step(_: [f32; 2], rest: [f32; 4]) -> f32 {
    f32::from(u8::from(rest[2] < 1.0 / 3.0))
}

#[test]
fn a_step_over_time_is_integrated_ever_better() {
    // The median, since cells in which the pilot misses the step starve.
    let errors = [4.0, 16.0, 64.0].map(|spp| {
        let (_, image) = integrated(step, Needs::none(), spp, [16, 16]);
        let mut errors: Vec<f64> = image.iter().map(|x| (f64::from(x[0]) - 1.0 / 3.0).abs()).collect();
        errors.sort_by(f64::total_cmp);
        errors[errors.len() / 2]
    });
    // The step is a surface in three dimensions. Four times the samples there halve its boxes, and four times as many
    // boxes share a pixel's error.
    assert!(errors.windows(2).all(|pair| pair[1] < 0.25 * pair[0]), "{errors:?}");
    // 64 random samples have an error of 0.059, and a median of 0.04.
    assert!(errors[2] < 0.005, "{errors:?}");
}

#[test]
fn samples_gather_where_the_function_varies() {
    // Columns 0 to 3 are constant, columns 4 to 7 have the step.
    let half = |place: [f32; 2], rest: [f32; 4]| if place[0] < 4.0 { 0.5 } else { step(place, rest) };
    let (film, image) = integrated(half, Needs::none(), 16.0, [8, 8]);
    let mean = |columns| mean_of_columns(&film, columns, |i| film.count(i) as f64);
    // The constant half hardly gets more than the pilot.
    assert!(mean(0..8) == 16.0 && (4.0..4.4).contains(&mean(0..4)), "{}", mean(0..4));
    assert!(image.iter().step_by(8).all(|x| (x[0] - 0.5).abs() < 1e-6));
}

/// With one set of samples and with two halves.
#[test]
fn a_product_of_place_and_time_is_integrated_to_its_closed_form() {
    let product = |[x, y]: [f32; 2], rest: [f32; 4]| (1.0 + (x * 0.7).sin() * (y * 0.4).cos()) * (0.2 + rest[2]);
    let integral =
        |low: usize, scale: f64, of: fn(f64) -> f64| (of((low + 1) as f64 * scale) - of(low as f64 * scale)) / scale;
    let exact = |i: usize| 0.7 * (1.0 + integral(i % 9, 0.7, |x| -x.cos()) * integral(i / 9, 0.4, f64::sin));
    for needs in [Needs::none(), Needs::none().with_halves()] {
        let errors = [32.0, 256.0].map(|spp| squared_error(&integrated(product, needs, spp, [9, 7]).1, exact).sqrt());
        // Eight times the samples halve the boxes in all three dimensions, and each box has a random error of its own.
        assert!(errors[1] < 0.4 * errors[0] && errors[1] < 0.01, "{errors:?}");
    }
}

#[test]
fn exchanged_axes_of_the_lens_make_the_same_image() {
    let points = random(3);
    let inner = points.clone();
    let exchanged = toys::Points(move |id, block| {
        let [a, b, c, d] = inner.block(id, block);
        if block == 0 { [a, b, c, d] } else { [b, a, c, d] }
    });
    let film = render(|place, rest| place[0] + rest[0] * rest[1], &mut Uniform::new(points.clone()), [4, 3], 40.0);
    let of = |points| {
        image(&MdasBoxes::new(film_points(points, &[Role::Lens; 2], None), MdasBoxesOptions::default()).unwrap(), &film)
    };
    for (a, b) in of(points).iter().zip(of(Arc::new(exchanged))) {
        assert!((a[0] - b[0]).abs() < 1e-6, "{a:?} {b:?}");
    }
}

#[test]
fn scenes_with_random_numbers_outside_the_domain_are_refused_unless_forced() {
    let noisy = domain(&[Role::Time]).with_outside("light that scatters more than once");
    let made = |options| Mdas::new(random(1), &noisy, options);
    let error = made(MdasOptions::default()).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(error.contains("light that scatters more than once") && error.contains("force=1"), "{error}");
    assert!(made(MdasOptions::default().force(1)).is_ok());
}
