//! Filters applied to some rows at a time, against the image of the whole film.

use crate::support::Noise;
use dapple_core::{
    Error, Estimate, Film, FilmRows, Filter, Filtered, FirstHit, Frame, Needs, SurfaceFeatures, Unfiltered,
    apply_in_rows,
};
use dapple_denoise::{
    Bilateral, BilateralOptions, ClusterGaussian, ClusterLookup, ClusterRegression, Gaussian, NlMeans, NlMeansOptions,
};
use std::sync::Arc;

const NEEDS: Needs = Needs::none().with_variance().with_halves().with_features().with_emission().with_first_hits(1);

/// A noisy film with edges, outliers, a lamp, unequal counts and pixels without samples.
fn film([width, height]: [u32; 2], seed: u64) -> Film {
    let mut film = Film::new(Frame::new(width, height).unwrap(), NEEDS);
    let mut noise = Noise::new(seed);
    let mut next = || noise.next();
    for pixel in 0..(width * height) as usize {
        let (x, y) = ((pixel as u32 % width) as f32, (pixel as u32 / width) as f32);
        // Of some rows, one half has no samples.
        let most = if (y / 20.0).fract() < 0.2 { 0.0 } else { 6.0 };
        let count = if next() < 0.01 { 0 } else { 1 + usize::from(most > 0.0) + (most * next() * next()) as usize };
        for sample in 0..count {
            let far = (0.02 * y).sin() + 0.1 * x;
            let tilt = if (y / 40.0).fract() < 0.5 { 0.6 } else { 0.8 };
            let albedo = [0.3 + 0.2 * (0.1 * x).sin(), 0.5, 0.6 + 0.05 * next()];
            let lamp = if x > 20.0 && (30.0..36.0).contains(&y) && next() < 0.7 { 2000.0 } else { 0.0 };
            let bright = if next() < 0.002 { 60.0 } else { 0.4 + next() };
            let place = [0.1 * x, 0.1 * y, far + 0.01 * next()];
            let (normal, depth) = ([0.0, tilt, (1.0f32 - tilt * tilt).sqrt()], 10.0 + far + 0.1 * next());
            let features = SurfaceFeatures::new(place, normal, depth).with_albedo(albedo);
            let hit = FirstHit::new(place, normal, depth).with_material((y / 60.0) as u32);
            let radiance = albedo.map(|a| a * bright + lamp);
            let estimate = Estimate::new(radiance).with_first_hit(Some(hit)).with_features(features);
            film.push_estimate(pixel, sample % 2, &estimate.with_emission([lamp; 3]));
        }
    }
    film
}

fn label() -> ClusterLookup {
    Arc::new(|hit| Some(hit.material))
}

/// All filters with a reach, for images of this size.
fn filters(size: [u32; 2]) -> Vec<Box<dyn Filter>> {
    let clusters = (0..size[0] * size[1]).map(|i| i / 77).collect();
    let bilateral = Bilateral::with_options(BilateralOptions::default().outside(0.2)).unwrap();
    vec![
        Box::new(Unfiltered),
        Box::new(Gaussian::default()),
        Box::new(ClusterGaussian::from_map(size, clusters).unwrap()),
        Box::new(ClusterGaussian::from_hits(label())),
        Box::new(NlMeans::default()),
        Box::new(NlMeans::with_options(NlMeansOptions::default().features(Some(1.0))).unwrap()),
        Box::new(bilateral.with_clusters(label(), "")),
        Box::new(Bilateral::default().without_features()),
    ]
}

fn bits(image: &Filtered) -> Vec<u32> {
    image.radiance.iter().flatten().chain(image.error.iter().flatten()).map(|value| value.to_bits()).collect()
}

#[test]
fn rows_have_the_bits_of_the_whole_image() {
    for (size, cuts) in [([34, 300], &[150, 64, 37][..]), ([9, 50], &[1, 16, 49]), ([70, 3], &[2, 1000])] {
        let film = film(size, 7);
        for filter in filters(size) {
            let whole = filter.apply(&film).unwrap();
            for &at_once in cuts {
                let image = apply_in_rows(&*filter, &film, at_once).unwrap();
                assert_eq!(image.size, whole.size);
                assert!(bits(&image) == bits(&whole), "{} at {size:?}, {at_once} rows at once", filter.describe());
            }
        }
    }
}

/// Rows of a crop of an image without samples of the second half: which half a pixel lacks follows from its place.
#[test]
fn rows_of_a_crop_with_one_sample_per_pixel_have_the_bits_of_the_whole_image() {
    let frame = Frame::new(40, 90).unwrap().crop(3, 7, 21, 61).unwrap();
    let (mut film, mut noise) = (Film::new(frame, NEEDS), Noise::new(3));
    (0..film.frame().pixels()).for_each(|i| film.push_estimate(i, 0, &Estimate::new([noise.next(); 3])));
    for filter in [Box::new(NlMeans::default()) as Box<dyn Filter>, Box::new(Gaussian::default())] {
        let image = apply_in_rows(&*filter, &film, 25).unwrap();
        assert!(bits(&image) == bits(&filter.apply(&film).unwrap()), "{}", filter.describe());
    }
}

/// A filter that claims a smaller reach.
struct Short<'a>(&'a dyn Filter, u32);

impl Filter for Short<'_> {
    fn name(&self) -> &str {
        self.0.name()
    }

    fn needs(&self) -> Needs {
        self.0.needs()
    }

    fn apply(&self, film: &Film) -> Result<Filtered, Error> {
        self.0.apply(film)
    }

    fn reach(&self, frame: &Frame) -> Option<u32> {
        self.0.reach(frame).map(|reach| reach - self.1)
    }

    fn survey(&self, film: &Film) -> Result<Vec<f64>, Error> {
        self.0.survey(film)
    }

    fn apply_rows(&self, rows: &FilmRows<'_>, survey: &[f64]) -> Result<Filtered, Error> {
        self.0.apply_rows(rows, survey)
    }
}

/// The reach of filters over halves is the sum of all radii. Much of it carries little weight, so that fewer rows happen to give
/// the same bits: there the control reads as many less as were found to be missed.
#[test]
fn images_differ_if_filters_read_too_few_rows() {
    let size = [34, 120];
    let film = film(size, 3);
    let missed = [1, 1, 1, 1, 8, 8, 8, 8];
    for (filter, short) in filters(size).into_iter().zip(missed).skip(1) {
        let image = apply_in_rows(&Short(&*filter, short), &film, 30).unwrap();
        assert!(bits(&image) != bits(&filter.apply(&film).unwrap()), "{}: {short} rows fewer", filter.describe());
    }
}

#[test]
fn a_filter_without_a_reach_gets_the_whole_film() {
    let (filter, film) = (ClusterRegression::new(), film([20, 30], 1));
    assert_eq!(filter.reach(film.frame()), None);
    assert!(bits(&apply_in_rows(&filter, &film, 8).unwrap()) == bits(&filter.apply(&film).unwrap()));
    let refused = filter.apply_rows(&FilmRows::whole(&film), &[]).unwrap_err().to_string();
    assert!(refused.contains("reads the whole film"), "{refused}");
    let refused = NlMeans::default().apply_rows(&FilmRows::whole(&film), &[]).unwrap_err().to_string();
    assert!(refused.contains("Filter::survey"), "{refused}");
}
