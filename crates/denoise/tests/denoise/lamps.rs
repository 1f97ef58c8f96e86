//! Light that stays in its pixel: lamps seen directly, their edges, and outliers. One sample per pixel, all of which lies in one half.

use crate::support::{HALVES, film, grey, mean, over_halves, regressions, rendered, squared_error};
use dapple_core::samplers::Uniform;
use dapple_core::{
    Block, Draws, Estimate, Film, Filter, Filtered, FirstHit, Frame, Integrator, Limits, Needs, Render,
    SurfaceFeatures, Worker,
};
use dapple_denoise::{ClusterGaussian, ClusterRegression, Gaussian, NlMeans, NlMeansOptions};
use dapple_low_discrepancy::Sobol;

const EMITTING: Needs = HALVES.with_emission();
const SIDE: u32 = 24;
const PIXELS: usize = (SIDE * SIDE) as usize;
/// The samples of each half of a pixel.
const SAMPLES: usize = 4;
/// The radiance of a bright lamp, and the samples of a pixel.
const BRIGHT: (f32, usize) = (2000.0, 2 * SAMPLES);

/// The filters over halves, also with other parameters, then the two blurs.
fn filters() -> Vec<Box<dyn Filter>> {
    let guided = NlMeans::with_options(NlMeansOptions::default().features(Some(1.0))).unwrap();
    let blur = ClusterGaussian::from_map([SIDE; 2], vec![0; PIXELS]).unwrap();
    let more: [Box<dyn Filter>; 4] = [
        Box::new(guided),
        Box::new(ClusterRegression::new().one_pass()),
        Box::new(Gaussian::default()),
        Box::new(blur),
    ];
    over_halves().into_iter().chain(more).collect()
}

/// The number of [`filters`] that read halves.
const OVER_HALVES: usize = 5;

/// A clamp at 10^9 times the image's level would lose nearly all of it.
#[test]
fn images_keep_the_light_of_an_outlier_of_any_radiance() {
    for outlier in [1e13, 1e20, 1e30, 3e38] {
        let film = film(
            [SIDE; 2],
            HALVES,
            5,
            |_, _| 2 * SAMPLES,
            |place, k, noise| {
                let value = 0.5 + noise.next();
                grey(if place == [11, 10] && k == 2 { outlier } else { value })
            },
        );
        for filter in filters() {
            let image = filter.apply(&film).unwrap();
            let name = format!("{} at {outlier:e}", filter.describe());
            assert!(image.radiance.iter().flatten().all(|v| v.is_finite() && *v >= 0.0), "{name}");
            assert!(image.error.as_ref().unwrap().iter().all(|e| *e >= 0.0), "{name}: NaN or negative error");
            let ratio = mean(&image.radiance) / mean(&film.image());
            assert!((ratio - 1.0).abs() < 1e-3, "{name}: {ratio} of the light is left");
        }
    }
}

/// A lamp of some radiance before a wall of 0.03, with so many samples in each pixel. Returns the film, and the number of samples of
/// each pixel that see the lamp.
fn lamp(emission: bool, (radiance, samples): (f32, usize)) -> (Film, Vec<usize>) {
    let mut seen = vec![0; PIXELS];
    let needs = if emission { EMITTING } else { HALVES };
    let film = film(
        [SIDE; 2],
        needs,
        9,
        |_, _| samples,
        |[x, y], _, noise| {
            let [u, v, w] = [(); 3].map(|()| noise.next());
            let sees = (x as f32 + u - 12.3).hypot(y as f32 + v - 11.6) < 3.2;
            seen[(y * SIDE + x) as usize] += usize::from(sees);
            if sees { grey(radiance + 0.06 * w).with_emission([radiance; 3]) } else { grey(0.06 * w) }
        },
    );
    (film, seen)
}

/// The largest red value of the pixels that `is_dark` returns true for.
fn brightest(image: &Filtered, is_dark: impl Fn(usize) -> bool) -> f32 {
    let dark = image.radiance.iter().enumerate().filter(|(i, _)| is_dark(*i));
    dark.map(|(_, colour)| colour[0]).fold(0.0, f32::max)
}

/// The largest radiance of a pixel none of whose samples sees the lamp.
fn leak(filter: &dyn Filter, emission: bool, lamp_of: (f32, usize)) -> f32 {
    let (film, seen) = lamp(emission, lamp_of);
    brightest(&filter.apply(&film).unwrap(), |i| seen[i] == 0)
}

/// The largest radiance more than a pixel beyond a lamp of radiance 20 of which each pixel has one sample.
fn leak_beyond(filter: &dyn Filter) -> f32 {
    let (film, _) = lamp(true, (20.0, 1));
    let apart = |i: usize| {
        let [x, y] = [(i % SIDE as usize) as f32 - 12.3, (i / SIDE as usize) as f32 - 11.6];
        x.max(-x - 1.0).max(0.0).hypot(y.max(-y - 1.0).max(0.0)) - 3.2
    };
    brightest(&filter.apply(&film).unwrap(), |i| apart(i) >= 1.0)
}

#[test]
fn lamps_seen_directly_leak_far_less_than_without_their_emission() {
    for (radiance, samples) in [(20.0, 1), BRIGHT] {
        // At one sample, the halves smooth the edge of a lamp.
        for filter in filters().split_off(if samples == 1 { OVER_HALVES } else { 0 }) {
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
    for filter in filters().into_iter().take(OVER_HALVES) {
        let [leak, without] = [leak_beyond(&*filter), leak(&*filter, false, (20.0, 1))];
        // The first pass alone has windows that no later one corrects.
        let most = if filter.describe().contains("passes=1") { 0.7 } else { (0.05 * without).max(0.2) };
        assert!(leak <= most, "{}: {leak} leaks", filter.describe());
    }
    assert!(leak_beyond(&Gaussian::new(0.05, 12.0).unwrap()) < 0.2, "filters without halves withhold all emission");
}

/// In the middle of the lamp nothing is uncertain. At its edge the error holds the noise of the emission.
#[test]
fn pixels_keep_the_light_of_the_lamp_that_they_see_and_errors_hold_its_noise_at_edges() {
    let (film, seen) = lamp(true, BRIGHT);
    let unfiltered = film.image();
    for (k, filter) in filters().into_iter().enumerate() {
        let (image, name) = (filter.apply(&film).unwrap(), filter.describe());
        for (i, (found, own)) in image.radiance.iter().zip(&unfiltered).enumerate() {
            let apart = (found[0] - own[0]).abs();
            assert!(seen[i] == 0 || apart < 25.0, "{name}: pixel {i} is {found:?}, not {own:?}");
        }
        let ratio = mean(&image.radiance) / mean(&unfiltered);
        assert!((ratio - 1.0).abs() < 2e-3, "{name}: {ratio} of the light is left");
        let error = image.error.unwrap();
        let mean = |is: &dyn Fn(usize) -> bool| {
            let of: Vec<f64> = (0..PIXELS).filter(|&i| is(seen[i])).map(|i| f64::from(error[i])).collect();
            of.iter().sum::<f64>() / of.len() as f64
        };
        let (edge, middle) = (mean(&|n| n > 0 && n < 2 * SAMPLES), mean(&|n| n == 2 * SAMPLES));
        // A pixel half covered has the variance 2000^2 / 4 / 8.
        let is_known = edge > 3e4 && edge < 3e5 && middle < 0.01 * edge;
        assert!(k >= OVER_HALVES || is_known, "{name}: {edge}, {middle}");
    }
}

const LAMP: f32 = 20.0;
const WALL: f32 = 0.1;
const PLACE: Block = Block::new(0);
const LIGHT: Block = Block::new(1);

/// Lamps within a wall of the same normal, depth and albedo. `lit` returns true at places of a pixel that a lamp covers.
struct Lit<F> {
    lit: F,
    /// The mean radiance of the wall.
    wall: f32,
    /// False for an integrator whose samples of features alone report no emission.
    alone: bool,
}

impl<F: Fn([u32; 2], [f32; 2]) -> bool + Sync> Lit<F> {
    fn sample(&self, draws: &Draws<'_>, wall: f32, emits: bool) -> Estimate {
        let [u, v, ..] = draws.block(PLACE);
        let emission = if emits && (self.lit)(draws.pixel(), [u, v]) { LAMP } else { 0.0 };
        let hit = FirstHit::new([0.0; 3], [0.0, 0.0, 1.0], 1.0).with_albedo([0.5; 3]);
        grey(emission + wall).with_first_hit(hit).with_emission([emission; 3])
    }

    fn film(mut self, side: u32, seed: u64, spp: f64, needs: Needs) -> Film {
        let (frame, limits) = (Frame::new(side, side).unwrap(), Limits::spp(spp));
        Render::new(frame, &limits).needs(needs).run(&mut self, &mut Uniform::new(Sobol::new(seed))).unwrap()
    }
}

impl<F: Fn([u32; 2], [f32; 2]) -> bool + Sync> Integrator for Lit<F> {
    fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
        self.sample(draws, 2.0 * self.wall * draws.block(LIGHT)[0], true)
    }

    fn features_alone(&self, draws: &Draws<'_>) -> Option<Estimate> {
        Some(self.sample(draws, 0.0, self.alone))
    }
}

/// The mean squared error of the pixels that a square lamp covers partly, and that of their neighbours on the wall. The lamp's edges
/// cross pixels at 0.3 and 0.6 of their width.
fn errors(filter: &dyn Filter, alone: bool, spp: f64) -> [f64; 2] {
    const SIDE: usize = 48;
    let within = |x: u32, u: f32| (16.3..32.6).contains(&(f64::from(x) + f64::from(u)));
    let lit = |[x, y]: [u32; 2], [u, v]: [f32; 2]| within(x, u) && within(y, v);
    let image = filter.apply(&Lit { lit, wall: WALL, alone }.film(SIDE as u32, 4, spp, filter.needs())).unwrap();
    let along = |x: usize| match x {
        16 => 0.7,
        17..32 => 1.0,
        32 => 0.6,
        _ => 0.0,
    };
    let covered = |i: usize| along(i % SIDE) * along(i / SIDE);
    let square = |i: usize| (f64::from(image.radiance[i][0]) - covered(i) * f64::from(LAMP) - f64::from(WALL)).powi(2);
    let ring = |i: usize| {
        let places = [i % SIDE, i / SIDE];
        places.iter().all(|n| (15..=33).contains(n)) && places.iter().any(|n| [15, 33].contains(n))
    };
    let mean = |of: &dyn Fn(usize) -> bool| {
        let of: Vec<f64> = (0..SIDE * SIDE).filter(|&i| of(i)).map(square).collect();
        of.iter().sum::<f64>() / of.len() as f64
    };
    [mean(&|i| covered(i) > 0.0 && covered(i) < 1.0), mean(&ring)]
}

#[test]
fn edges_of_lamps_have_a_fraction_of_the_error_if_features_alone_report_emission() {
    for filter in &over_halves()[..2] {
        for (spp, most) in [(1.0, [0.02, 0.005]), (4.0, [0.02, 0.005]), (16.0, [0.15, 0.05])] {
            let [without, with] = [false, true].map(|alone| errors(&**filter, alone, spp));
            let ratios = [0, 1].map(|k| with[k] / without[k]);
            let name = filter.describe();
            assert!(
                ratios[0] < most[0] && ratios[1] < most[1],
                "{name}, {spp} spp: {ratios:?}, {with:?} of {without:?}"
            );
        }
    }
}

/// Later samples of a low-discrepancy sequence lie where earlier ones leave gaps. If those that find an edge were of the same
/// sequence, the others would miss the lamp. In each pixel a small lamp, at a place of its own, covers 4 %. The error is at most 4
/// standard errors (a false alarm in 15,000 seeds), 1.8 % of the light; the pixels' own errors are not independent of the place of
/// their lamp, so that the bound is on the safe side.
#[test]
fn refined_means_of_sobol_samples_keep_the_light() {
    let lit = |[x, y]: [u32; 2], [u, v]: [f32; 2]| {
        let place = [x * 37 % 64 + y * 11 % 64, x * 23 % 64 + y * 53 % 64].map(|n| 0.8 * (n % 64) as f32 / 64.0);
        (0.0..0.2).contains(&(u - place[0])) && (0.0..0.2).contains(&(v - place[1]))
    };
    let needs = Needs::none().with_halves().with_features().with_emission();
    let film = Lit { lit, wall: 0.0, alone: true }.film(512, 9, 4.0, needs);
    let values: Vec<f64> = (0..512 * 512).map(|i| film.refined_mean(i)[0]).collect();
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let error = (values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / n / n).sqrt();
    let wanted = 0.04 * f64::from(LAMP);
    assert!((mean - wanted).abs() < 4.0 * error && error < 0.005 * wanted, "{mean} +- {error}, not {wanted}");
}

/// A film of a white wall with one sample in each of 48x48 pixels: `light(x, noise)` with emission `emission(x, noise)`.
fn single(light: impl Fn(u32, f32) -> f32, emission: impl Fn(u32, f32) -> f32) -> Film {
    film(
        [48; 2],
        EMITTING,
        11,
        |_, _| 1,
        |[x, y], _, noise| {
            let value = noise.next();
            let features = SurfaceFeatures::new([x as f32, y as f32, 0.0], [0.0, 0.0, 1.0], 10.0).with_albedo([0.8; 3]);
            let emitted = emission(x, value);
            grey(light(x, value) + emitted).with_emission([emitted; 3]).with_features(features)
        },
    )
}

/// The mean of a column, and the mean squared difference of its pixels from `wanted`.
fn column(image: &Filtered, x: usize, wanted: f32) -> [f64; 2] {
    let pixels: Vec<_> = image.radiance.iter().skip(x).step_by(48).copied().collect();
    [mean(&pixels), squared_error(&pixels, |_| wanted)]
}

/// The edge of a shadow on a wall without features is left, and the noise beside it removed.
#[test]
fn an_edge_of_light_is_kept_at_one_sample_per_pixel() {
    let lit = |x: u32| if x < 24 { 1.0 } else { 0.05 };
    let film = single(|x, noise| lit(x) * (0.5 + noise), |_, _| 0.0);
    let is_kept = |filter: &dyn Filter| {
        let image = filter.apply(&film).unwrap();
        let [near, far] = [column(&image, 22, 1.0)[0], column(&image, 25, 0.05)[0]];
        let noise = (4..20).map(|x| column(&image, x, 1.0)[1]).sum::<f64>() / 16.0;
        (near > 0.85 && far < 0.2 && noise < 0.25 / 12.0, format!("{}: {near}, {far}, {noise}", filter.describe()))
    };
    for filter in over_halves() {
        let (kept, found) = is_kept(&*filter);
        assert!(kept, "{found}");
    }
    assert!(!is_kept(&Gaussian::new(0.05, 12.0).unwrap()).0, "a blur keeps no edge");
}

/// A lamp that covers half of each pixel in some columns is not left as white and black pixels.
#[test]
fn the_edge_of_a_lamp_is_smooth_at_one_sample_per_pixel() {
    let film = single(|_, noise| 0.5 + noise, |x, noise| if x < 3 && noise < 0.5 { 20.0 } else { 0.0 });
    let [mean, square] = column(&ClusterRegression::new().apply(&film).unwrap(), 1, 11.0);
    // Unfiltered, the square is 100.
    assert!((mean - 11.0).abs() < 2.5 && square < 25.0, "{mean}, {square}");
}

/// The filtered image has the light of its samples, and an error of the right size.
#[test]
fn light_is_kept_and_the_error_known_at_one_sample_per_pixel() {
    let film = single(|_, noise| if noise < 0.05 { 8.0 } else { 0.5 + noise }, |_, _| 0.0);
    let wanted = mean(&film.image());
    let truth = 0.05 * 8.0 + (0.5 * (1.5f32.powi(2) - 0.55f32.powi(2)));
    for filter in over_halves().into_iter().chain([Box::new(regressions()) as Box<dyn Filter>]) {
        let image = filter.apply(&film).unwrap();
        let ratio = mean(&image.radiance) / wanted;
        assert!((ratio - 1.0).abs() < 0.05, "{}: {ratio} of the light", filter.describe());
        let error = image.error.unwrap().iter().map(|e| f64::from(*e)).sum::<f64>() / 2304.0;
        let real = squared_error(&image.radiance, |_| truth);
        // The network takes fireflies out, which the estimate of the regressions still counts.
        let most = if filter.describe().contains("network=true") { 12.0 } else { 5.0 };
        assert!((0.2..most).contains(&(error / real)), "{}: {error}, not {real}", filter.describe());
    }
}

/// Out of focus, features share the noise of the radiance: each sample hits a bright surface or a dark one of another normal. A
/// regression on unfiltered features would keep that noise. The filter leaves less than a quarter of the squared error, on average
/// over four seeds.
#[test]
fn noise_shared_with_features_is_filtered() {
    let share = |x: u32| 0.1 + 0.8 * (x as f32 + 0.5) / 48.0;
    let blurred = |draws: &Draws<'_>| {
        let bright = draws.block(PLACE)[0] < share(draws.pixel()[0]);
        let (radiance, normal) = if bright { (1.0, [0.0, 0.0, 1.0]) } else { (0.1, [1.0, 0.0, 0.0]) };
        let (place, depth) = if bright { ([0.0; 3], 2.0) } else { ([5.0, 0.0, 3.0], 5.0) };
        let hit = FirstHit::new(place, normal, depth).with_albedo([radiance; 3]).with_footprint(0.01);
        grey(radiance).with_first_hit(hit.with_shape(u32::from(bright)))
    };
    // 0.13 and 0.11; without the prefilter 0.99.
    for filter in [regressions(), ClusterRegression::new()] {
        let (mut before, mut after) = (0.0, 0.0);
        for seed in 1..=4 {
            let film = rendered(Frame::new(48, 48).unwrap(), filter.needs(), (seed, 8), blurred);
            let error = |image: &[[f32; 3]]| squared_error(image, |i| 0.1 + 0.9 * share(i as u32 % 48));
            before += error(&film.image());
            after += error(&filter.apply(&film).unwrap().radiance);
        }
        assert!(after < 0.25 * before, "{}: {} of the error is left", filter.describe(), after / before);
    }
}
