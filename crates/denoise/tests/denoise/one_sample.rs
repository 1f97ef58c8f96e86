//! One sample per pixel: all of it lies in one half.

use crate::support::Noise;
use dapple_core::{Estimate, Film, Filter, Filtered, Frame, Needs, SurfaceFeatures};
use dapple_denoise::{Bilateral, ClusterRegression, Gaussian, NlMeans};

const SIDE: u32 = 48;
const PIXELS: usize = (SIDE * SIDE) as usize;

/// A film of a white wall with one sample in each pixel: `light(x, noise)` with emission `emission(x, noise)`.
fn film(light: impl Fn(usize, f32) -> f32, emission: impl Fn(usize, f32) -> f32) -> Film {
    let needs = Needs::none().with_variance().with_halves().with_features().with_emission();
    let mut film = Film::new(Frame::new(SIDE, SIDE).unwrap(), needs);
    let mut noise = Noise::new(11);
    for pixel in 0..PIXELS {
        let (x, value) = (pixel % SIDE as usize, noise.next());
        let place = [x as f32, (pixel / SIDE as usize) as f32, 0.0];
        let features = SurfaceFeatures::new(place, [0.0, 0.0, 1.0], 10.0).with_albedo([0.8; 3]);
        let emitted = emission(x, value);
        let estimate = Estimate::new([light(x, value) + emitted; 3]).with_emission([emitted; 3]);
        film.push_estimate(pixel, 0, &estimate.with_features(features));
    }
    film
}

/// The filters over halves.
fn filters() -> [Box<dyn Filter>; 3] {
    [Box::new(ClusterRegression::new()), Box::new(Bilateral::default()), Box::new(NlMeans::default())]
}

/// The mean of a column, and the mean squared difference of its pixels from `wanted`.
fn column(image: &Filtered, x: usize, wanted: f32) -> [f32; 2] {
    let pixels = image.radiance.iter().skip(x).step_by(SIDE as usize).map(|[red, ..]| *red);
    let sum = pixels.fold([0.0; 2], |[mean, square], v| [mean + v, square + (v - wanted) * (v - wanted)]);
    sum.map(|sum| sum / SIDE as f32)
}

/// The edge of a shadow on a wall without features is left, and the noise beside it removed.
#[test]
fn an_edge_of_light_is_kept() {
    let lit = |x: usize| if x < 24 { 1.0 } else { 0.05 };
    let film = film(|x, noise| lit(x) * (0.5 + noise), |_, _| 0.0);
    let is_kept = |filter: &dyn Filter| {
        let image = filter.apply(&film).unwrap();
        let [near, far] = [column(&image, 22, 1.0)[0], column(&image, 25, 0.05)[0]];
        let noise: f32 = (4..20).map(|x| column(&image, x, 1.0)[1]).sum::<f32>() / 16.0;
        (near > 0.85 && far < 0.2 && noise < 0.25 / 12.0, format!("{}: {near}, {far}, {noise}", filter.describe()))
    };
    for filter in filters() {
        let (kept, found) = is_kept(&*filter);
        assert!(kept, "{found}");
    }
    assert!(!is_kept(&Gaussian::new(0.05, 12.0).unwrap()).0, "a blur keeps no edge");
}

/// A lamp that covers half of each pixel in some columns is not left as white and black pixels.
#[test]
fn the_edge_of_a_lamp_is_smooth() {
    let is_lamp = |x: usize| x < 3;
    let half = |x: usize, noise: f32| if is_lamp(x) && noise < 0.5 { 20.0 } else { 0.0 };
    let film = film(|_, noise| 0.5 + noise, half);
    let image = ClusterRegression::new().apply(&film).unwrap();
    let [mean, square] = column(&image, 1, 11.0);
    // Unfiltered, the square is 100.
    assert!((mean - 11.0).abs() < 2.5 && square < 25.0, "{mean}, {square}");
}

/// The filtered image has the light of its samples, and an error of the right size.
#[test]
fn light_is_kept_and_the_error_known() {
    let film = film(|_, noise| if noise < 0.05 { 8.0 } else { 0.5 + noise }, |_, _| 0.0);
    let wanted = (0..PIXELS).map(|i| film.mean(i)[0]).sum::<f64>() / PIXELS as f64;
    let truth = 0.05 * 8.0 + (0.5 * (1.5f64.powi(2) - 0.55f64.powi(2)));
    for filter in filters() {
        let image = filter.apply(&film).unwrap();
        let mean = image.radiance.iter().map(|[red, ..]| f64::from(*red)).sum::<f64>() / PIXELS as f64;
        assert!((mean / wanted - 1.0).abs() < 0.05, "{}: {mean}, not {wanted}", filter.describe());
        let error = image.error.unwrap().iter().map(|e| f64::from(*e)).sum::<f64>() / PIXELS as f64;
        let square = |[red, ..]: &[f32; 3]| (f64::from(*red) - truth).powi(2);
        let real = image.radiance.iter().map(square).sum::<f64>() / PIXELS as f64;
        assert!((0.2..5.0).contains(&(error / real)), "{}: {error}, not {real}", filter.describe());
    }
}
