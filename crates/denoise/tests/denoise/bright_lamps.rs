//! Light that stays in its pixel: lamps seen directly, and outliers.

use crate::support::Noise;
use dapple_core::{Estimate, Film, Filter, Frame, Needs};
use dapple_denoise::{Bilateral, ClusterGaussian, ClusterRegression, Gaussian, NlMeans, NlMeansOptions};

const SIDE: u32 = 24;
const PIXELS: usize = (SIDE * SIDE) as usize;
/// The samples of each half of a pixel.
const SAMPLES: usize = 4;
/// The radiance of a bright lamp, and the samples of a pixel.
const BRIGHT: (f32, usize) = (2000.0, 2 * SAMPLES);

/// The filters over halves.
fn over_halves() -> Vec<Box<dyn Filter>> {
    let guided = NlMeansOptions::default().features(Some(1.0));
    vec![
        Box::new(NlMeans::default()),
        Box::new(NlMeans::with_options(guided).unwrap()),
        Box::new(Bilateral::default()),
        Box::new(ClusterRegression::new().one_pass()),
        Box::new(ClusterRegression::new()),
    ]
}

/// All filters.
fn filters() -> Vec<Box<dyn Filter>> {
    let mut all = over_halves();
    all.push(Box::new(Gaussian::default()));
    all.push(Box::new(ClusterGaussian::from_map([SIDE; 2], vec![0; PIXELS]).unwrap()));
    all
}

/// The statistics that any filter reads, with or without emission.
fn needs(emission: bool) -> Needs {
    let needs = Needs::none().with_variance().with_halves().with_features();
    if emission { needs.with_emission() } else { needs }
}

/// A film of noise in 0.5 to 1.5, with one sample of radiance `outlier` amid them.
fn with_outlier(outlier: f32) -> Film {
    let mut film = Film::new(Frame::new(SIDE, SIDE).unwrap(), needs(false));
    let mut noise = Noise::new(5);
    for pixel in 0..PIXELS {
        for sample in 0..2 * SAMPLES {
            let value = 0.5 + noise.next();
            let is_outlier = pixel == 10 * SIDE as usize + 11 && sample == 2;
            film.push_estimate(pixel, sample % 2, &Estimate::new([if is_outlier { outlier } else { value }; 3]));
        }
    }
    film
}

fn total(image: &[[f32; 3]]) -> f64 {
    image.iter().map(|colour| f64::from(colour[0])).sum()
}

/// A clamp at 10^9 times the image's level would lose nearly all of it.
#[test]
fn images_keep_the_light_of_an_outlier_of_any_radiance() {
    for outlier in [1e13, 1e20, 1e30, 3e38] {
        let film = with_outlier(outlier);
        let expected = total(&film.image());
        for filter in filters() {
            let image = filter.apply(&film).unwrap();
            let name = format!("{} at {outlier:e}", filter.describe());
            assert!(image.radiance.iter().flatten().all(|v| v.is_finite() && *v >= 0.0), "{name}");
            assert!(image.error.as_ref().unwrap().iter().all(|e| *e >= 0.0), "{name}: NaN or negative error");
            let ratio = total(&image.radiance) / expected;
            assert!((ratio - 1.0).abs() < 1e-3, "{name}: {ratio} of the light is left");
        }
    }
}

/// A lamp of some radiance before a wall of 0.03, with so many samples in each pixel. Returns the film, and the number of samples of each pixel that see the
/// lamp.
fn lamp(emission: bool, (radiance, samples): (f32, usize)) -> (Film, Vec<usize>) {
    let mut film = Film::new(Frame::new(SIDE, SIDE).unwrap(), needs(emission));
    let mut noise = Noise::new(9);
    let mut seen = vec![0; PIXELS];
    for (pixel, seen) in seen.iter_mut().enumerate() {
        let [x, y] = [pixel % SIDE as usize, pixel / SIDE as usize].map(|p| p as f32);
        for sample in 0..samples {
            let [u, v, w] = [(); 3].map(|()| noise.next());
            let wall = 0.06 * w;
            if (x + u - 12.3).hypot(y + v - 11.6) < 3.2 {
                *seen += 1;
                let estimate = Estimate::new([radiance + wall; 3]).with_emission([radiance; 3]);
                film.push_estimate(pixel, sample % 2, &estimate);
            } else {
                film.push_estimate(pixel, sample % 2, &Estimate::new([wall; 3]));
            }
        }
    }
    (film, seen)
}

/// The largest radiance of a pixel none of whose samples sees the lamp.
fn leak(filter: &dyn Filter, emission: bool, lamp_of: (f32, usize)) -> f32 {
    let (film, seen) = lamp(emission, lamp_of);
    let image = filter.apply(&film).unwrap();
    let dark = image.radiance.iter().zip(&seen).filter(|(_, seen)| **seen == 0);
    dark.map(|(colour, _)| colour[0]).fold(0.0, f32::max)
}

/// The largest radiance more than a pixel beyond a lamp of radiance 20 of which each pixel has one sample.
fn leak_beyond(filter: &dyn Filter) -> f32 {
    let (film, _) = lamp(true, (20.0, 1));
    let apart = |i: usize| {
        let [x, y] = [(i % SIDE as usize) as f32 - 12.3, (i / SIDE as usize) as f32 - 11.6];
        x.max(-x - 1.0).max(0.0).hypot(y.max(-y - 1.0).max(0.0)) - 3.2
    };
    let image = filter.apply(&film).unwrap();
    let dark = image.radiance.iter().enumerate().filter(|(i, _)| apart(*i) >= 1.0);
    dark.map(|(_, colour)| colour[0]).fold(0.0, f32::max)
}

#[test]
fn lamps_seen_directly_leak_far_less_than_without_their_emission() {
    for (radiance, samples) in [(20.0, 1), BRIGHT] {
        // At one sample, the halves smooth the edge of a lamp.
        for filter in filters().split_off(if samples == 1 { over_halves().len() } else { 0 }) {
            let [without, with] = [false, true].map(|emission| leak(&*filter, emission, (radiance, samples)));
            let most = (0.05 * without).max(0.2);
            assert!(with <= most, "{}, {samples} spp: {with} leaks, {without} without emission", filter.describe());
        }
        // The control: without emission there is a leak to see.
        assert!(over_halves().iter().any(|filter| leak(&**filter, false, (radiance, samples)) > 0.005 * radiance));
    }
}

/// A sample per pixel does not tell how much of a pixel at the edge a lamp covers. Farther away it does.
#[test]
fn lamps_of_one_sample_per_pixel_leak_one_pixel_far() {
    for filter in over_halves() {
        let [leak, without] = [leak_beyond(&*filter), leak(&*filter, false, (20.0, 1))];
        // The first pass alone has windows that no later one corrects.
        let most = if filter.describe().contains("passes=1") { 0.7 } else { (0.05 * without).max(0.2) };
        assert!(leak <= most, "{}: {leak} leaks", filter.describe());
    }
    assert!(leak_beyond(&Gaussian::new(0.05, 12.0).unwrap()) < 0.2, "filters without halves withhold all emission");
}

#[test]
fn pixels_keep_the_light_of_the_lamp_that_they_see() {
    let (film, seen) = lamp(true, BRIGHT);
    let unfiltered = film.image();
    for filter in filters() {
        let image = filter.apply(&film).unwrap();
        for (i, (found, own)) in image.radiance.iter().zip(&unfiltered).enumerate() {
            let apart = (found[0] - own[0]).abs();
            assert!(seen[i] == 0 || apart < 25.0, "{}: pixel {i} is {found:?}, not {own:?}", filter.describe());
        }
        let ratio = total(&image.radiance) / total(&unfiltered);
        assert!((ratio - 1.0).abs() < 2e-3, "{}: {ratio} of the light is left", filter.describe());
    }
}

/// In the middle of the lamp nothing is uncertain. At its edge the error holds the noise of the emission.
#[test]
fn errors_hold_the_noise_of_emission_at_edges_of_lamps() {
    let (film, seen) = lamp(true, BRIGHT);
    for filter in over_halves() {
        let error = filter.apply(&film).unwrap().error.unwrap();
        let mean = |is: &dyn Fn(usize) -> bool| {
            let of: Vec<f64> = (0..PIXELS).filter(|&i| is(seen[i])).map(|i| f64::from(error[i])).collect();
            of.iter().sum::<f64>() / of.len() as f64
        };
        let (edge, middle) = (mean(&|n| n > 0 && n < 2 * SAMPLES), mean(&|n| n == 2 * SAMPLES));
        // A pixel half covered has the variance 2000^2 / 4 / 8.
        assert!(edge > 3e4 && edge < 3e5 && middle < 0.01 * edge, "{}: {edge}, {middle}", filter.describe());
    }
}
