use super::*;
use crate::test_scenes::{Field, frame, run};
use crate::tree::test_scenes::{Made, domain, film_points, render};
use dapple_core::{Film, Filter, samplers::Uniform};
use dapple_low_discrepancy::{Random, Sobol};

fn dct(seed: u64, options: DctOptions) -> Dct<Random> {
    Dct::new(Random::new(seed), &domain(&[]), options, CosineOptions::default()).unwrap()
}

fn filter(seed: u64, options: CosineOptions) -> DctFilter {
    DctFilter::new(film_points(Random::new(seed), &[], None), options).unwrap()
}

#[test]
fn constant_and_black_images_get_equal_counts() {
    for value in [0.0, 0.7] {
        for size in [[16, 16], [19, 11]] {
            let mut constant = Field(|_: [u32; 2], _: [f32; 4]| [value, 0.5 * value, 0.25 * value]);
            let mut sampler = dct(2, DctOptions::default());
            let film = run(&mut constant, &mut sampler, frame(size[0], size[1]), &Limits::spp(8.0));
            let (low, high) = film.counts().iter().fold((u64::MAX, 0), |(low, high), &n| (low.min(n), high.max(n)));
            // Counts of cells of one and two pixels are rounded.
            let spread = if size == [16, 16] { 0 } else { 2 };
            assert!(high - low <= spread, "{size:?}, {value}: {low} to {high}");
        }
    }
}

/// The mean count of the pixels in some columns.
fn mean_count(film: &Film, columns: std::ops::Range<usize>) -> f64 {
    let width = film.frame().size()[0] as usize;
    let counts = (0..film.frame().pixels()).filter(|i| columns.contains(&(i % width))).map(|i| film.count(i));
    counts.sum::<u64>() as f64 / (columns.len() * film.frame().size()[1] as usize) as f64
}

#[test]
fn what_low_frequencies_explain_takes_no_samples() {
    // From the left: a block of one cosine, a constant, an edge within the block.
    let scene: Made = |[x, y], _| match x as u32 / 8 {
        0 => 1.0 + 0.5 * (std::f32::consts::PI * y / 8.0).cos(),
        1 => 1.0,
        _ => f32::from(u8::from(x + 0.37 * y < 22.0)) + 0.5,
    };
    let film = render(scene, &mut dct(5, DctOptions::default()), [24, 24], 16.0);
    let [cosine, flat, edge] = [0..8, 8..16, 16..24].map(|columns| mean_count(&film, columns));
    assert!(edge > 3.0 * cosine && cosine < 1.6 * flat, "{cosine}, {flat} and {edge} samples");
}

#[test]
fn bright_parts_get_fewer_samples_unless_nothing_masks_errors() {
    // Noise of equal deviation, on dark and on bright ground.
    let noise = || Field(|[x, _]: [u32; 2], u: [f32; 4]| [if x < 16 { 0.5 } else { 4.0 } + 0.5 * u[2]; 3]);
    let ratio = |options: DctOptions| {
        let film = run(&mut noise(), &mut dct(3, options), frame(32, 32), &Limits::spp(16.0));
        mean_count(&film, 0..16) / mean_count(&film, 16..32)
    };
    let (masked, plain) = (ratio(DctOptions::default()), ratio(DctOptions::default().masking(0.0)));
    assert!(masked > 2.0 && (0.8..1.25).contains(&plain), "{masked} and {plain}");
}

/// The image of `made` in closed form: the mean over each pixel, by the midpoints of 32x32 parts.
fn exact(made: Made, [width, height]: [u32; 2]) -> Vec<f64> {
    let pixel = |i: u32| {
        let part = |k: u32| (k as f32 + 0.5) / 32.0;
        let at = |k: u32| [(i % width) as f32 + part(k % 32), (i / width) as f32 + part(k / 32)];
        (0..1024).map(|k| f64::from(made(at(k), [0.0; 4]))).sum::<f64>() / 1024.0
    };
    (0..width * height).map(pixel).collect()
}

fn rms(image: &[[f32; 3]], exact: &[f64]) -> f64 {
    let square = image.iter().zip(exact).map(|(x, e)| (f64::from(x[0]) - e).powi(2)).sum::<f64>();
    (square / exact.len() as f64).sqrt()
}

#[test]
fn the_filter_recovers_smooth_images_and_its_error_falls_with_the_count() {
    let smooth: Made = |[x, y], _| 2.0 + (0.21 * x).sin() + (0.17 * y + 0.05 * x).cos();
    let size = [20, 17];
    let errors = [2.0, 8.0].map(|spp| {
        let film = render(smooth, &mut Uniform::new(Random::new(4)), size, spp);
        let image = filter(4, CosineOptions::default()).apply(&film).unwrap().radiance;
        let found = [rms(&image, &exact(smooth, size)), rms(&film.image(), &exact(smooth, size))];
        assert!(found[0] < 0.5 * found[1], "{spp} samples: {found:?}");
        found[0]
    });
    // Both fits have all 64 cosines. To them, higher frequencies are noise: four times the samples halve the error, about.
    assert!(errors[1] < 0.6 * errors[0], "{errors:?}");
}

#[test]
fn unequal_densities_do_not_move_an_image() {
    // Sampler and filter together, on a gradient with an edge: the mean is that of the image.
    let scene: Made = |[x, y], _| 0.2 * x + f32::from(u8::from(x + 0.5 * y > 12.3));
    let size = [24, 16];
    let cosines = CosineOptions::default();
    let mut sampler = Dct::new(Sobol::new(9), &domain(&[]), DctOptions::default(), cosines).unwrap();
    let film = render(scene, &mut sampler, size, 24.0);
    let points = film_points(Sobol::new(9), &[], None);
    let image = DctFilter::new(points, cosines).unwrap().apply(&film).unwrap().radiance;
    let exact = exact(scene, size);
    let mean = |all: f64| all / exact.len() as f64;
    let (found, expected) = (mean(image.iter().map(|x| f64::from(x[0])).sum()), mean(exact.iter().sum()));
    assert!((found - expected).abs() < 0.01, "{found}, not {expected}");
    assert!(rms(&image, &exact) < 0.12, "{}", rms(&image, &exact));
}

#[test]
fn the_pilot_has_a_sample_in_each_cell_if_pixels_need_none() {
    let mut limits = Limits::samples(35);
    limits.min_spp = 0;
    let mut constant = Field(|_: [u32; 2], _: [f32; 4]| [1.0; 3]);
    let film = run(&mut constant, &mut dct(1, DctOptions::default()), frame(13, 10), &limits);
    let cells = Cells::new(film.frame(), CELL);
    assert_eq!(cells.count(), 35);
    for number in 0..35 {
        assert_eq!(cells.pixels(number).map(|i| film.count(i)).sum::<u64>(), 1, "cell {number}");
    }
    // In large cells the sample is in any of the four pixels.
    let corners = (0..35).filter(|&number| cells.pixels(number).next().is_some_and(|i| film.count(i) == 1)).count();
    assert!((6..25).contains(&corners), "{corners}");
}

#[test]
fn samples_go_where_the_error_falls_most_as_far_as_there_is_room() {
    let open = |score: f64, samples| Open { number: samples, score, samples, room: 100 };
    let gains = greedy(&mut [open(1.0, 4), open(8.0, 5), open(0.0, 0)], 4);
    let numbers: Vec<u32> = gains.iter().map(|gain| gain.1).collect();
    // First the empty cell, then by score / (n (n + 1)): 8 / 30, 8 / 42, 8 / 56 before 1 / 20.
    assert_eq!(numbers, [0, 5, 5, 5]);
    assert!(gains.is_sorted_by(|a, b| a.0 >= b.0));
    let mut full = [Open { room: 2, ..open(1.0, 1) }];
    assert_eq!(greedy(&mut full, 9).len(), 2);
}

#[test]
fn states_of_others_are_refused() {
    let mut sampler = dct(1, DctOptions::default());
    assert!(sampler.save().is_empty() && sampler.restore(&[]).is_ok());
    assert!(matches!(sampler.restore(&[1]), Err(Error::BadSnapshot { .. })));
    let cosines = CosineOptions::default().share(2.0);
    let error = Dct::new(Random::new(1), &domain(&[]), DctOptions::default(), cosines).err();
    assert!(matches!(error, Some(Error::OutOfRange { name: "share", .. })));
}
