//! Properties of inputs, fits and error estimates that images alone hardly show.

use crate::ClusterRegression;
use crate::cluster_regression::BLEND;
use crate::error_map::{self, ERROR, Estimate as ErrorEstimate, Radii, raw_error, select, shrink};
use crate::graph::Graph;
use crate::inputs::{Inputs, Reads};
use crate::light::{Light, Part};
use crate::normal_equations::{Fit, Sums, solve};
use crate::one_sample::LAMP;
use crate::planes::{Pair, Plane, planes_of};
use dapple_core::point_set::mix;
use dapple_core::samplers::Uniform;
use dapple_core::{
    Block, Draws, Estimate, Film, Filtered, FirstHit, Frame, Integrator, Limits, Needs, Render, SurfaceFeatures, Worker,
};
use dapple_low_discrepancy::Sobol;
use pulp::Scalar;

pub(super) const SIDE: usize = 24;
pub(super) const PIXELS: usize = SIDE * SIDE;
const NEEDS: Needs = Needs::none().with_variance().with_halves().with_features();
const RECORDED: Needs = NEEDS.with_emission();

/// The planes that `of` makes of a film's inputs.
pub(super) fn planes<'a, const N: usize>(
    film: &'a Film,
    of: impl FnOnce(&Graph<'a>, &Inputs) -> [Plane; N],
) -> [Vec<f32>; N] {
    let graph = Graph::new(film.frame().size().map(|n| n as usize));
    let inputs = Inputs::new(&graph, Light::all(film), &Reads::default());
    let planes = of(&graph, &inputs);
    graph.collect(planes)
}

/// The filtered image of a film whose halves `image` makes, with its error.
fn filtered<'a>(film: &'a Film, image: impl FnOnce(&Graph<'a>, &Inputs) -> Pair) -> Filtered {
    let (graph, light) = (Graph::new([SIDE, SIDE]), Light::all(film));
    let inputs = Inputs::new(&graph, light, &Reads::default());
    let image = image(&graph, &inputs);
    let estimate = ErrorEstimate::new(&graph, &inputs, light, image, ERROR);
    let (image, []) = error_map::filtered(graph, &[estimate], []);
    image
}

/// One half of a film's samples in the units of the planes: colours, variances and counts.
struct HalfValues {
    colour: [Vec<f32>; 3],
    variance: [Vec<f32>; 3],
    count: Vec<f32>,
}

/// Both halves, and the radiance of their unit.
fn values(film: &Film) -> ([HalfValues; 2], f32) {
    let mut level = 0.0;
    let halves = [0, 1].map(|h: usize| {
        let [r, g, b, vr, vg, vb, count] = planes(film, |_, inputs| {
            level = inputs.level();
            let ([r, g, b], [vr, vg, vb]) = (inputs.halves[h].colour, inputs.halves[h].variance);
            [r, g, b, vr, vg, vb, inputs.halves[h].count]
        });
        HalfValues { colour: [r, g, b], variance: [vr, vg, vb], count }
    });
    (halves, level)
}

/// A film with `count(pixel)` samples in each pixel, in turns to either half: `sample(pixel, number)`.
fn film_of(needs: Needs, count: impl Fn(usize) -> usize, sample: impl Fn(usize, usize) -> Estimate) -> Film {
    let mut film = Film::new(Frame::new(SIDE as u32, SIDE as u32).unwrap(), needs);
    for pixel in 0..PIXELS {
        (0..count(pixel)).for_each(|k| film.push_estimate(pixel, k % 2, &sample(pixel, k)));
    }
    film
}

/// A film with one grey sample per half: `value(pixel, half)`.
pub(super) fn film(value: impl Fn(usize, usize) -> f32) -> Film {
    film_of(NEEDS, |_| 2, |pixel, half| Estimate::new([value(pixel, half); 3]))
}

/// Two images, given in the units of the planes.
fn pair<'a>(graph: &Graph<'a>, value: impl Fn(usize, usize) -> f32 + Sync + 'a) -> Pair {
    Pair(planes_of(graph, move |i| std::array::from_fn(|k| value(i, k / 3))))
}

fn plain(graph: &Graph<'_>) -> Plane {
    let [plane] = planes_of(graph, |_| [1.0]);
    plane
}

/// Regressors that are equal but for rounding: elimination leaves a pivot near 0, of either sign.
#[test]
fn slopes_of_regressors_that_are_equal_but_for_rounding_stay_bounded() {
    let simd = Scalar::new();
    let mut largest = 0.0f32;
    for k in 0..400 {
        let mut sums: Sums<Scalar, 5, 3> = [[0.0; 5]; 3];
        let between = 256.0 + k as f32 * 3.1e-5 - 2e-3;
        (sums[1][0], sums[1][1], sums[2][0], sums[2][1]) = (256.0, between, between, 256.0);
        for c in 0..3 {
            (sums[1][2 + c], sums[2][2 + c]) = (10.0, 10.01);
        }
        let fit: Fit<Scalar, 2> = solve(simd, 1.0, &sums, 2, &[0.0; 3]);
        let steepest =
            fit.slopes.iter().flatten().fold(0.0f32, |most, s| if s.is_nan() { f32::NAN } else { most.max(s.abs()) });
        assert!(steepest < 6.0, "{steepest} at {k}");
        largest = largest.max(steepest);
    }
    assert!(largest > 1.0, "the control: {largest} is the slope for the difference of the two");
}

/// The unfiltered halves are 1 + d and 1 - d for this pixel.
const NOISE: f32 = 0.25;

fn unfiltered(half: usize) -> f32 {
    if half == 0 { 1.0 + NOISE } else { 1.0 - NOISE }
}

fn near(found: &[f32], expected: f32) -> bool {
    found.iter().all(|v| (v - expected).abs() < 1e-4)
}

/// The mean of both halves is exact, so its error is 0; without the common part it would be `d^2`.
#[test]
fn errors_of_halves_that_cancel_are_no_error_of_their_mean() {
    let film = film(|_, _| 1.0);
    let [whole, variance] = planes(&film, |graph, inputs| {
        let image = pair(graph, |_, half| if half == 0 { 1.1 } else { 0.9 });
        raw_error(graph, inputs, image, plain(graph))
    });
    assert!(near(&whole, 0.0) && near(&variance, 0.01), "{} {}", whole[0], variance[0]);
}

#[test]
fn raw_errors_are_squared_bias_where_halves_agree_and_noise_where_they_do_not() {
    let film = film(|_, half| unfiltered(half));
    let [whole, variance] = planes(&film, |graph, inputs| raw_error(graph, inputs, inputs.unfiltered(), plain(graph)));
    let noise = NOISE * NOISE;
    assert!(near(&whole, noise) && near(&variance, noise), "{} {}", whole[0], variance[0]);
    let [whole, variance] =
        planes(&film, |graph, inputs| raw_error(graph, inputs, pair(graph, |_, _| 1.5), plain(graph)));
    // The halves' own noise is subtracted: 0.25 + d^2 - 2 d^2.
    assert!(near(&whole, 0.25 - noise) && near(&variance, 0.0), "{} {}", whole[0], variance[0]);
}

/// The image that `select` takes if the filtered image has `ratio` times the error of the unfiltered one: true for the
/// filtered image.
fn takes_filtered(ratio: f32) -> bool {
    let film = film(|_, half| unfiltered(half));
    // The error of a constant image without noise is its squared bias less d^2.
    let bias = ((ratio + 1.0) * NOISE * NOISE).sqrt();
    let of_first = planes(&film, |graph, inputs| {
        let image = pair(graph, move |_, _| 1.0 + bias);
        [select(graph, inputs, &[image], plain(graph), 2, true), inputs.unfiltered()].map(|image| image.0[0])
    });
    let [found, own] = of_first.map(|plane| plane[PIXELS / 2]);
    (found - 1.0 - bias).abs() < (found - own).abs()
}

#[test]
fn unfiltered_pixels_must_have_half_the_error_of_filtered_ones_to_be_taken() {
    let taken: Vec<bool> = [0.5, 1.5, 1.9, 2.1, 4.0].map(takes_filtered).to_vec();
    assert_eq!(taken, [true, true, true, false, false]);
}

/// The error map of an image without error in the upper half, and with errors in the lower half.
#[test]
fn errors_are_at_least_a_twentieth_of_their_mean() {
    let noisy = |i: usize| i >= PIXELS / 2;
    let film = film(|i, half| if noisy(i) { unfiltered(half) } else { 1.0 });
    let error = filtered(&film, |_, inputs| inputs.unfiltered()).error.unwrap();
    let mean = error.iter().sum::<f32>() / PIXELS as f32;
    let least = error.iter().copied().fold(f32::INFINITY, f32::min);
    // The floor itself adds some 2 % to the mean.
    assert!((0.045..0.0505).contains(&(least / mean)), "{least} of {mean}");
    // Between the halves the larger of two means counts, which the scale of the whole map evens out.
    assert!((error[PIXELS - 1] / (NOISE * NOISE) - 1.0).abs() < 0.02, "{}", error[PIXELS - 1]);
}

/// Differences of the halves show variance, even where the estimate of the whole error is 0 or below.
#[test]
fn errors_are_at_least_the_variance_of_the_filtered_image() {
    let exact = film(|_, _| 1.0);
    let error = filtered(&exact, |graph, _| pair(graph, |_, half| if half == 0 { 1.1 } else { 0.9 })).error.unwrap();
    assert!(near(&error, 0.01), "{}", error[0]);
    // Without bias or variance, the estimate is -d^2.
    let noisy = film(|_, half| unfiltered(half));
    let error = filtered(&noisy, |graph, _| pair(graph, |_, _| 1.0)).error.unwrap();
    assert!(error.iter().all(|e| *e == 0.0), "{}", error[0]);
}

/// Pixels with samples in one half get the other from their neighbours.
#[test]
fn errors_are_unknown_only_where_no_pixel_in_reach_has_samples() {
    let unknown = |first_rows: usize| -> Vec<f32> {
        let halves = |pixel: usize| if pixel / SIDE < 8 { first_rows } else { 2 };
        let film = film_of(NEEDS, halves, |_, half| Estimate::new([unfiltered(half); 3]));
        let error = filtered(&film, |_, inputs| inputs.unfiltered()).error.unwrap();
        let unknown: Vec<f32> = error.iter().map(|e| f32::from(u8::from(e.is_infinite()))).collect();
        unknown.chunks(SIDE).map(|row| row.iter().sum::<f32>() / SIDE as f32).collect()
    };
    let rows = unknown(0);
    // Variances reach 2 rows, whole errors 3.
    assert!(rows[..5].iter().all(|share| *share == 1.0) && rows[6..].iter().all(|share| *share == 0.0), "{rows:?}");
    assert!(unknown(1).iter().all(|share| *share == 0.0));
}

/// Each half has the samples of its own squares of a chessboard, and means of these elsewhere.
#[test]
fn a_sample_of_a_pixel_without_others_counts_in_one_half() {
    let film = |changed: usize| {
        let value = |i: usize| if i == changed { 3.0 } else { 1.0 + 0.1 * (i % 7) as f32 };
        values(&film_of(NEEDS, |_| 1, |i, _| Estimate::new([value(i); 3])))
    };
    let (before, level) = film(usize::MAX);
    for changed in [5 * SIDE + 4, 5 * SIDE + 5] {
        let (after, other) = film(changed);
        let scale = other / level;
        let differs = |half: usize, i: usize| {
            let [was, is] = [&before, &after].map(|halves| halves[half].colour[0][i]);
            (is * scale - was).abs() > 1e-3
        };
        let own = (changed % SIDE + changed / SIDE) % 2;
        let found: Vec<usize> = (0..PIXELS).filter(|&i| differs(own, i)).collect();
        assert_eq!(found, [changed - SIDE, changed - 1, changed, changed + 1, changed + SIDE], "half {own}");
        assert!((0..PIXELS).all(|i| !differs(1 - own, i)), "the other half");
    }
    assert!(before.iter().all(|half| half.count.iter().all(|count| *count == 0.5)));
}

/// Between its samples, a half is their mean on the same surface, in proportion to albedo.
#[test]
fn a_half_is_interpolated_on_its_surface_and_without_its_albedo() {
    let albedo = |i: usize| if i.is_multiple_of(2) { 0.8 } else { 0.2 };
    let is_left = |i: usize| i % SIDE < SIDE / 2;
    let light = |i: usize| if is_left(i) { 1.0 } else { 5.0 };
    let film = |turns: bool| {
        film_of(
            RECORDED,
            |_| 1,
            |i, _| {
                let place = [(i % SIDE) as f32, (i / SIDE) as f32, 0.0];
                let normal = if turns && is_left(i) { [1.0, 0.0, 0.0] } else { [0.0, 0.0, 1.0] };
                let features = SurfaceFeatures::new(place, normal, 10.0).with_albedo([albedo(i); 3]);
                Estimate::new([albedo(i) * light(i); 3]).with_features(features)
            },
        )
    };
    let worst = |film: &Film| -> f32 {
        let (halves, level) = values(film);
        let apart = |half: &HalfValues, i: usize| (half.colour[0][i] * level / (albedo(i) * light(i)) - 1.0).abs();
        halves.iter().flat_map(|half| (0..PIXELS).map(move |i| apart(half, i))).fold(0.0, f32::max)
    };
    let [corner, flat] = [true, false].map(|turns| worst(&film(turns)));
    // A quarter of the light beyond the edge crosses it on one surface, and a 41st part of that weight crosses a corner.
    assert!(corner < 0.06 && flat > 0.5, "{corner}, {flat}");
}

/// The variance of one sample per pixel is that of its noise, and a quarter of it between samples.
#[test]
fn one_sample_per_pixel_has_the_variance_of_its_noise() {
    let noise = |i: usize| (mix(i as u64) >> 40) as f32 / 16_777_216.0;
    let (halves, level) = values(&film_of(NEEDS, |_| 1, |i, _| Estimate::new([0.5 + noise(i); 3])));
    let of = |is_own: bool| -> f32 {
        let half = |i: usize| (i % SIDE + i / SIDE + usize::from(!is_own)) % 2;
        let inside = (0..PIXELS).filter(|i| (2..SIDE - 2).contains(&(i % SIDE)) && (2..SIDE - 2).contains(&(i / SIDE)));
        let values: Vec<f32> = inside.map(|i| halves[half(i)].variance[0][i]).collect();
        values.iter().sum::<f32>() / values.len() as f32 * level * level * 12.0
    };
    let [own, between] = [of(true), of(false)];
    assert!((0.85..1.15).contains(&own) && (0.85..1.15).contains(&(4.0 * between)), "{own}, {between}");
}

/// A lamp of radiance 10^5 covers pixel 300 partly; one sample in four sees it. The wall varies by 0.1.
#[test]
fn variances_at_edges_of_lamps_are_those_of_the_light_that_filters_get() {
    let film = film_of(
        RECORDED,
        |_| 8,
        |pixel, sample| {
            let wall = if sample < 4 { 0.95 } else { 1.05 };
            let lamp = if pixel == 300 && sample % 4 < 2 && sample < 4 { 1e5 } else { 0.0 };
            Estimate::new([wall + lamp; 3]).with_emission([lamp; 3])
        },
    );
    let (halves, _) = values(&film);
    for half in &halves {
        let (colour, largest) = (half.colour[0][300], half.variance[0].iter().copied().fold(0.0f32, f32::max));
        assert!(colour > 10.0 && colour < 100.0, "{colour}: most of the lamp is withheld");
        assert!(largest < 0.1, "{largest}");
    }
    assert_eq!(halves[0].colour[0][300], halves[1].colour[0][300], "both halves see it alike");
}

/// The mean square of `narrow - 1` that a blend with the image 1 keeps.
fn kept(radii: Radii, evidence: f32, narrow: impl Fn(usize, usize) -> f32 + Sync) -> f32 {
    let film = film(|_, _| 1.0);
    let [image, narrow] = planes(&film, |graph, inputs| {
        let [narrow, smooth] = [pair(graph, narrow), pair(graph, |_, _| 1.0)];
        [shrink(graph, inputs, narrow, smooth, radii, evidence), narrow].map(|image| image.0[0])
    });
    let square = |image: &[f32]| image.iter().map(|v| (v - 1.0) * (v - 1.0)).sum::<f32>();
    square(&image) / square(&narrow)
}

/// Patches of 4x4 pixels with noise of their own in each half, some of it strong, and lines in both halves among such patches.
/// Seeds are fixed. As the control, three times as much noise stays if every pixel counts.
#[test]
fn patches_of_noise_are_taken_out_and_detail_that_both_halves_see_stays() {
    let noise = |seed: usize, patch: usize, half: usize| {
        let mut hash = (seed * 72 + patch * 2 + half) as u32;
        for _ in 0..2 {
            hash = (hash ^ (hash >> 16)).wrapping_mul(0x45d9_f3b5).wrapping_add(0x9e37_79b9);
        }
        let uniform = (hash >> 8) as f32 / (1 << 23) as f32 - 1.0;
        0.4 * uniform * uniform * uniform
    };
    let patch = |i: usize| i / SIDE / 4 * 6 + i % SIDE / 4;
    let evidence = 2.0;
    let mean = |radii: Radii| {
        (0..40).map(|seed| kept(radii, evidence, |i, half| 1.0 + noise(seed, patch(i), half))).sum::<f32>() / 40.0
    };
    let (alike, alone) = (mean(BLEND), mean(Radii { alike: 0, ..BLEND }));
    let lines = |i: usize, half: usize| if i % 12 == 5 { 1.5 } else { 1.0 + 0.1 * noise(1, patch(i), half) };
    let detail = kept(BLEND, evidence, lines);
    assert!(alike < 0.02 && alone > 0.04, "{alike} of the noise stays, {alone} in the control");
    assert!(detail > 0.95, "{detail} of the detail stays");
}

#[test]
fn a_first_pass_precedes_two_others_for_direct_light_by_itself_only() {
    for (part, is_direct) in [(Part::All, false), (Part::Direct, true), (Part::Indirect, false)] {
        assert_eq!(ClusterRegression::new().has_first(part), is_direct);
        assert!(ClusterRegression::new().one_pass().has_first(part));
    }
}

/// The width of an image with a lamp.
const WIDTH: usize = 48;
const WALL: f32 = 0.25;
const PLACE: Block = Block::new(0);

/// A wall, and a lamp of this radiance, from this place in column 20 to the end of column 29.
struct Lamp(f32, f32);

impl Lamp {
    fn emission(&self, draws: &Draws<'_>) -> [f32; 3] {
        let ([x, _], [u, ..]) = (draws.pixel(), draws.block(PLACE));
        [if (self.1..30.0).contains(&(x as f32 + u)) { self.0 } else { 0.0 }; 3]
    }
}

impl Integrator for Lamp {
    fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
        let (emission, hit) = (self.emission(draws), FirstHit::new([0.0; 3], [0.0, 0.0, 1.0], 1.0));
        Estimate::new(emission.map(|e| e + WALL)).with_first_hit(hit.with_albedo([0.5; 3])).with_emission(emission)
    }

    fn features_alone(&self, draws: &Draws<'_>) -> Option<Estimate> {
        Some(self.estimate(draws, &mut Worker::default()))
    }
}

/// One sample per pixel, the unit of its planes, and the red of pixel `i` in the half that it lacks and in the other.
fn rendered(lamp: Lamp) -> (Film, f32, impl Fn(usize) -> [f32; 2]) {
    let needs = Needs::none().with_variance().with_halves().with_features().with_emission();
    let (frame, limits) = (Frame::new(WIDTH as u32, WIDTH as u32).unwrap(), Limits::spp(1.0));
    let (mut lamp, mut sampler) = (lamp, Uniform::new(Sobol::new(4)));
    let film = Render::new(frame, &limits).needs(needs).run(&mut lamp, &mut sampler).unwrap();
    let (halves, level) = values(&film);
    let red = move |i: usize| {
        let own = (i % WIDTH + i / WIDTH) % 2;
        [1 - own, own].map(|half| halves[half].colour[0][i] * level)
    };
    (film, level, red)
}

/// The pixels at the edge, but for those at the border of the image.
fn edge() -> impl Iterator<Item = usize> {
    (1..WIDTH - 1).map(|y| y * WIDTH + 20)
}

#[test]
fn the_half_that_a_pixel_lacks_has_emission_of_its_own_samples() {
    let (film, _, halves) = rendered(Lamp(40.0, 20.37));
    let alone = |half, i| film.emission_alone(half, i).unwrap().1[0];
    assert!(edge().any(|i| alone(0, i) != alone(1, i)), "both halves are alike everywhere");
    for i in edge() {
        let unused = usize::from(film.half(0, i).unwrap().count > 0);
        let [lacking, own] = halves(i);
        let wanted = alone(unused, i) + WALL;
        assert!((lacking - wanted).abs() < 1e-3 * wanted, "{lacking}, not {wanted}; {own} in the other half");
    }
}

/// Four samples miss a lamp that covers a tenth of a pixel in two of three pixels. Their light must not end at the lamp beside
/// them.
#[test]
fn pixels_that_may_hide_an_edge_get_light_of_the_lamp_beside_them() {
    let (film, _, halves) = rendered(Lamp(40.0, 20.9));
    let missed: Vec<usize> = edge().filter(|&i| film.emission_alone(0, i).is_none()).collect();
    assert!(missed.len() > 20, "{} pixels", missed.len());
    for i in missed.into_iter().filter(|&i| film.mean(i)[0] < 1.0) {
        let [lacking, _] = halves(i);
        assert!(lacking >= 0.25 * 40.0, "{lacking}");
    }
}

#[test]
fn dim_emission_is_interpolated_like_other_light() {
    let (_, level, halves) = rendered(Lamp(WALL, 20.37));
    assert!(WALL < LAMP * level);
    for i in edge() {
        // All neighbours are alike.
        let wanted = [i - 1, i + 1, i - WIDTH, i + WIDTH].map(|j| halves(j)[1]).iter().sum::<f32>() / 4.0;
        let [lacking, _] = halves(i);
        assert!((lacking - wanted).abs() < 1e-3 * wanted, "{lacking}, not {wanted}");
    }
}

#[test]
fn emission_that_is_withheld_is_so_in_both_halves() {
    let (_, _, halves) = rendered(Lamp(1e12, 20.37));
    let most = |k: usize| (0..WIDTH * WIDTH).map(|i| halves(i)[k]).fold(0.0, f32::max);
    let [lacking, own] = [most(0), most(1)];
    assert!(own > 1.0 && own < 1e10 && lacking <= 1.01 * own, "{lacking} interpolated, {own} sampled");
}
