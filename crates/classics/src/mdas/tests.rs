use super::*;
use crate::Role;
use crate::tree::test_scenes::{Made, domain, film_points, render};
use dapple_core::{Film, Filter as _, samplers::Uniform};
use dapple_low_discrepancy::{Random, Sobol};

fn mdas(roles: &[Role], seed: u64) -> Mdas<Sobol> {
    Mdas::new(Sobol::new(seed), &domain(roles), MdasOptions::default()).unwrap()
}

fn boxes(points: FilmPoints) -> MdasBoxes {
    MdasBoxes::new(points, MdasBoxesOptions::default()).unwrap()
}

/// The image of mdas and its filter, in samples per pixel.
fn image(made: Made, roles: &[Role], spp: f64, size: [u32; 2]) -> (Film, Vec<[f32; 3]>) {
    let mut sampler = mdas(roles, 5);
    let points = film_points(Sobol::new(5), roles, Some(sampler.placed()));
    let film = render(made, &mut sampler, size, spp);
    let image = boxes(points).apply(&film).unwrap().radiance;
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
        let (_, image) = image(step, &[Role::Time], spp, [16, 16]);
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
    let (film, image) = image(half, &[Role::Time], 16.0, [8, 8]);
    let count = |columns: std::ops::Range<usize>| -> u64 {
        (0..8).flat_map(|y| columns.clone().map(move |x| (x, y))).map(|(x, y)| film.count(8 * y + x)).sum()
    };
    assert_eq!(count(0..8), 16 * 64);
    // The constant half hardly gets more than the pilot.
    let pilot = 4 * 32;
    assert!((pilot..pilot + pilot / 10).contains(&count(0..4)), "{} and {}", count(4..8), count(0..4));
    assert!(image.iter().step_by(8).all(|x| (x[0] - 0.5).abs() < 1e-6));
}

#[test]
fn a_product_of_place_and_time_is_integrated_to_its_closed_form() {
    let product = |[x, y]: [f32; 2], rest: [f32; 4]| (1.0 + (x * 0.7).sin() * (y * 0.4).cos()) * (0.2 + rest[2]);
    let integral = |low: f64, scale: f64, of: fn(f64) -> f64| (of((low + 1.0) * scale) - of(low * scale)) / scale;
    let error = |spp: f64| {
        let (_, found) = image(product, &[Role::Time], spp, [9, 7]);
        let square = |(i, found): (usize, &[f32; 3])| {
            let (x, y) = ((i % 9) as f64, (i / 9) as f64);
            let exact = 0.7 * (1.0 + integral(x, 0.7, |x| -x.cos()) * integral(y, 0.4, f64::sin));
            (f64::from(found[0]) - exact).powi(2)
        };
        (found.iter().enumerate().map(square).sum::<f64>() / found.len() as f64).sqrt()
    };
    let errors = [32.0, 256.0].map(error);
    // Eight times the samples halve the boxes in all three dimensions, and each box has a random error of its own.
    assert!(errors[1] < 0.4 * errors[0] && errors[1] < 0.01, "{errors:?}");
}

#[test]
fn the_plain_mean_is_biased_towards_refined_parts_and_the_boxes_are_not() {
    // Bright waves in half of the time.
    let flash = |place: [f32; 2], rest: [f32; 4]| {
        if rest[2] < 0.5 { 5.0 * (1.0 + (40.0 * (rest[2] * 97.0 + place[0])).sin()) } else { 1.0 }
    };
    let mut sampler = mdas(&[Role::Time], 2);
    let points = film_points(Sobol::new(2), &[Role::Time], Some(sampler.placed()));
    let film = render(flash, &mut sampler, [16, 16], 48.0);
    let mean = |image: &[[f32; 3]]| image.iter().map(|x| f64::from(x[0])).sum::<f64>() / image.len() as f64;
    let (plain, boxes) = (mean(&film.image()), mean(&boxes(points).apply(&film).unwrap().radiance));
    assert!(plain > 3.75 && (boxes - 3.0).abs() < 0.15, "the means are {plain} and {boxes}, and must be 3");
}

/// The boxes of a cell with these samples.
fn divided(at: Vec<At>, axes: usize, values: Vec<[f32; 3]>) -> (Cell, Vec<(Bounds, Vec<u32>)>) {
    let cell = Cell { at, values, size: [2, 2], corner: [0, 0], axes };
    let mut found = Vec::new();
    leaves(&MedianGap { leaf: 4, pixel: 0.5 }, &cell, &mut |leaf| found.push((*leaf.bounds, leaf.items.to_vec())));
    (cell, found)
}

fn random_samples(count: u64, axes: usize) -> Vec<At> {
    let of = |k: u64| {
        let mut at = At::default();
        (0..axes).for_each(|axis| at[axis] = unit(k * 8 + axis as u64) * if axis < 2 { 2.0 } else { 1.0 });
        at
    };
    (0..count).map(of).collect()
}

#[test]
fn boxes_partition_the_cell_and_hold_their_samples() {
    for (count, axes) in [(0, 3), (4, 2), (5, 2), (300, 5), (300, 6), (77, 3)] {
        let (cell, found) = divided(random_samples(count, axes), axes, vec![[1.0; 3]; count as usize]);
        let volume: f64 = found.iter().map(|(bounds, _)| bounds.volume(axes)).sum();
        assert!((volume - 4.0).abs() < 1e-5, "{count} samples in {axes} axes: {volume}");
        assert_eq!(found.iter().map(|(_, items)| items.len()).sum::<usize>(), count as usize);
        for (bounds, items) in &found {
            assert!(items.len() <= 4);
            for &item in items {
                let at = &cell.at[item as usize];
                assert!((0..axes).all(|axis| bounds.low[axis] <= at[axis] && at[axis] < bounds.high[axis]));
            }
        }
    }
}

#[test]
fn equal_samples_stay_in_one_box() {
    let (_, found) = divided(vec![[0.5; Domain::MOST]; 40], 4, vec![[1.0; 3]; 40]);
    assert_eq!((found.len(), found[0].1.len()), (1, 40));
}

#[test]
fn exchanged_axes_of_the_lens_exchange_the_boxes() {
    let samples = random_samples(200, 4);
    let mut exchanged = samples.clone();
    exchanged.iter_mut().for_each(|at| at.swap(2, 3));
    let boxes = |samples| {
        let mut found = divided(samples, 4, vec![[1.0; 3]; 200]).1;
        found.iter_mut().for_each(|(_, items)| items.sort_unstable());
        found.sort_by_key(|(_, items)| items[0]);
        found
    };
    let mut expected = boxes(samples);
    for (bounds, _) in &mut expected {
        bounds.low.swap(2, 3);
        bounds.high.swap(2, 3);
    }
    assert!(expected.len() > 50 && boxes(exchanged) == expected);
}

#[test]
fn one_white_sample_of_four_has_an_error_of_one_and_a_half_per_channel() {
    let values = vec![[0.0; 3], [0.0; 3], [0.0; 3], [1.0; 3]];
    let (cell, _) = divided(random_samples(4, 2), 2, values);
    let bounds = Bounds { low: At::default(), high: [2.0; Domain::MOST] };
    let found = error(&cell, &Leaf { bounds: &bounds, items: &[0, 1, 2, 3], depth: 0 });
    assert!((found - 4.0 * (1e-5 + 3.0 * 1.5)).abs() < 1e-12, "{found}");
}

#[test]
fn scenes_with_random_numbers_outside_the_domain_are_refused_unless_forced() {
    let noisy = domain(&[Role::Time]).with_outside("light that scatters more than once");
    let made = |options| Mdas::new(Random::new(1), &noisy, options);
    let error = made(MdasOptions::default()).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(error.contains("light that scatters more than once") && error.contains("force=1"), "{error}");
    assert!(made(MdasOptions::default().force(1)).is_ok());
}

#[test]
fn the_boxes_integrate_uniform_samples_too() {
    let points = film_points(Sobol::new(9), &[Role::Time], None);
    let film = render(step, &mut Uniform::new(Sobol::new(9)), [8, 8], 32.0);
    let image = boxes(points).apply(&film).unwrap().radiance;
    let worst = image.iter().map(|x| (f64::from(x[0]) - 1.0 / 3.0).abs()).fold(0.0, f64::max);
    assert!(worst < 0.1, "{worst}");
}
