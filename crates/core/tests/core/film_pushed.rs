//! Films that are filled without the render loop: sample by sample, and from statistics of pixels.

use dapple_core::{Error, Estimate, Film, FirstHit, Frame, Needs, PixelStatistics, RgbMoments, SurfaceFeatures};

fn film(needs: Needs) -> Film {
    Film::new(Frame::new(2, 1).unwrap(), needs)
}

fn wall() -> FirstHit {
    FirstHit::new([1.0, 2.0, 3.0], [0.0, 0.0, -1.0], 4.0).with_albedo([0.5, 0.25, 0.125]).with_material(7)
}

/// Without this, a filter guided by features would run on colours alone and say nothing.
#[test]
fn a_film_filled_with_radiance_alone_is_refused_where_features_or_hits_are_read() {
    for (needs, what) in
        [(Needs::none().with_features(), "first-hit features"), (Needs::none().with_first_hits(1), "first hits")]
    {
        let mut film = film(needs);
        assert!(film.require("a filter", &needs).is_ok(), "an empty film lacks nothing");
        film.push(0, 0, [1.0; 3]);
        let error = film.require("a filter", &needs).unwrap_err();
        assert!(matches!(error, Error::NoneReported { .. }), "{error:?}");
        let message = error.to_string();
        assert!(message.contains(what) && message.contains("Film::push_estimate"), "{message}");
        assert!(film.require("a filter", &Needs::none()).is_ok(), "nothing of it is read");
        film.push_estimate(1, 0, &Estimate::new([1.0; 3]).with_first_hit(wall()));
        assert!(film.require("a filter", &needs).is_ok(), "one sample reports");
    }
}

#[test]
fn a_film_of_nothing_but_sky_has_its_features() {
    let needs = Needs::none().with_features().with_first_hits(1);
    let mut film = film(needs);
    (0..2).for_each(|i| film.push_estimate(i, 0, &Estimate::new([1.0; 3])));
    assert!(film.require("a filter", &needs).is_ok());
    assert_eq!(film.features(0).map(|f| (f.samples, f.hits)), Some((1, 0)));
}

#[test]
fn an_estimate_brings_all_that_the_film_records() {
    let needs = Needs::none().with_halves().with_features().with_first_hits(2).with_cost().with_emission();
    let mut film = film(needs);
    let behind = SurfaceFeatures::new([5.0; 3], [0.0, 1.0, 0.0], 9.0);
    film.push_estimate(0, 0, &Estimate::new([2.0; 3]).with_emission([1.0; 3]).with_cost(3).with_first_hit(wall()));
    film.push_estimate(0, 1, &Estimate::new([4.0; 3]).with_first_hit(wall().with_material(8)).with_features(behind));
    film.push_estimate(0, 0, &Estimate::new([0.0; 3]));
    film.push_estimate(0, 0, &Estimate::new([0.0; 3]).with_first_hit(FirstHit::new([f32::NAN; 3], [0.0; 3], 1.0)));
    assert_eq!([film.half(0, 0).unwrap().count, film.half(1, 0).unwrap().count], [3, 1]);
    assert!(film.emission(0, 0).is_some_and(|e| (e[0] - 1.0 / 3.0).abs() < 1e-6));
    let features = film.features(0).unwrap();
    assert_eq!((features.samples, features.hits, features.depth), (4, 2, 6.5));
    let materials: Vec<_> = film.first_hits(0).iter().map(|hit| hit.map(|hit| hit.material)).collect();
    assert_eq!(materials, [Some(7), Some(8)]);
    assert_eq!((film.cost(0), film.record().rays, film.record().samples), (Some(6), 6, 4));
}

#[test]
fn statistics_of_pixels_make_the_film_that_samples_would() {
    let mut pushed = film(Needs::none().with_variance().with_halves().with_features().with_emission());
    for (half, value) in [(0, 1.0), (0, 3.0), (1, 2.0), (1, 6.0)] {
        pushed.push_estimate(0, half, &Estimate::new([value; 3]).with_first_hit(wall()));
    }
    let half = |h| pushed.half(h, 0).unwrap();
    let moments = [0, 1].map(|h| RgbMoments::new(2, half(h).mean, half(h).variance().unwrap()));
    let made = Film::from_pixels(*pushed.frame(), |i| match i {
        0 => PixelStatistics::new(moments).with_features((&wall()).into(), [0.0; 10], 1.0),
        _ => PixelStatistics::default(),
    })
    .unwrap();
    assert_eq!((made.moments(0), made.features(0), made.count(1)), (pushed.moments(0), pushed.features(0), 0));
    assert_eq!(made.squared_errors(), pushed.squared_errors());
    assert!(made.require("a filter", pushed.needs()).is_ok());
    assert_eq!(made.record().samples, 4);
}

#[test]
fn statistics_with_a_nan_are_refused_with_their_pixel() {
    let bad = [
        PixelStatistics::new([RgbMoments::new(1, [f64::NAN; 3], [0.0; 3]), RgbMoments::default()]),
        PixelStatistics::new([RgbMoments::new(2, [0.0; 3], [f64::INFINITY; 3]), RgbMoments::default()]),
        PixelStatistics::default().with_features(SurfaceFeatures::new([f32::NAN; 3], [0.0; 3], 1.0), [0.0; 10], 1.0),
        PixelStatistics::default().with_emission([f32::INFINITY; 3]),
    ];
    for pixel in bad {
        let of = |i| if i == 1 { pixel } else { PixelStatistics::default() };
        let message = Film::from_pixels(Frame::new(2, 1).unwrap(), of).unwrap_err().to_string();
        assert!(message.contains("pixel (1, 0)"), "{message}");
    }
}
