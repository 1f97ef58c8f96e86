//! Denoising from buffers: all of them are used, and faulty ones are refused.

use crate::support::{Noise, grey};
use dapple_core::{Error, Film, Filter, FirstHit, Frame, Needs};
use dapple_denoise::{
    Bilateral, ClusterRegression, Gaussian, NlMeans, NlMeansOptions, SampleBuffers, Variance, Warning, denoise,
    denoise_whole,
};

const SIZE: [u32; 2] = [48, 32];
const PIXELS: usize = 48 * 32;
const SPP: u32 = 8;

type Colours = Vec<[f32; 3]>;

/// A wall with a checked albedo, and a lit floor before it, under noise.
#[derive(Default)]
struct Image {
    truth: Colours,
    halves: [Colours; 2],
    variances: [Colours; 2],
    normal: Colours,
    albedo: Colours,
    position: Colours,
    depth: Vec<f32>,
}

impl Image {
    fn new() -> Self {
        let (mut noise, mut image) = (Noise::new(11), Self::default());
        for i in 0..PIXELS {
            let [x, y] = [i % 48, i / 48];
            let floor = y >= 20;
            let depth = if floor { 60.0 / (y as f32 - 14.0) } else { 10.0 };
            let albedo = if (x / 6 + y / 6) % 2 == 0 { 0.8 } else { 0.3 };
            let light = 0.5 + 0.01 * x as f32;
            image.truth.push([albedo * light; 3]);
            for h in 0..2 {
                let samples: Vec<f32> = (0..SPP / 2).map(|_| albedo * light * 2.0 * noise.next()).collect();
                let mean = samples.iter().sum::<f32>() / samples.len() as f32;
                let m2: f32 = samples.iter().map(|s| (s - mean).powi(2)).sum();
                image.halves[h].push([mean; 3]);
                image.variances[h].push([m2 / (samples.len() - 1) as f32; 3]);
            }
            image.normal.push(if floor { [0.0, 1.0, 0.0] } else { [0.0, 0.0, 1.0] });
            image.albedo.push([albedo; 3]);
            image.position.push([(x as f32 - 24.0) / 48.0 * depth, (y as f32 - 16.0) / 48.0 * depth, depth]);
            image.depth.push(depth);
        }
        image
    }

    fn sets(&self) -> [SampleBuffers<'_>; 2] {
        [0, 1].map(|h| SampleBuffers::new(&self.halves[h], SPP / 2).variance(Variance::OfSamples(&self.variances[h])))
    }

    fn mean(&self) -> Colours {
        let [a, b] = &self.halves;
        a.iter().zip(b).map(|(a, b)| [0, 1, 2].map(|c| 0.5 * (a[c] + b[c]))).collect()
    }

    fn error(&self, image: &[[f32; 3]]) -> f32 {
        let squares = image.iter().zip(&self.truth).map(|(a, b)| (a[0] - b[0]).powi(2));
        squares.sum::<f32>() / PIXELS as f32
    }
}

/// Each feature lowers the error, whatever it is given as; so do halves.
#[test]
fn images_from_buffers_have_less_error_the_more_the_buffers_hold() {
    let image = Image::new();
    let noisy = image.error(&image.mean());
    let [a, b] = image.sets();
    let bare = denoise(SIZE, &a, &b).run().unwrap();
    let deep = denoise(SIZE, &a, &b).normal(&image.normal).albedo(&image.albedo).depth(&image.depth).run().unwrap();
    let full = denoise(SIZE, &a, &b).normal(&image.normal).albedo(&image.albedo).position(&image.position).run();
    let full = full.unwrap();
    assert!(full.error.as_ref().is_some_and(|e| e.len() == PIXELS && e.iter().all(|e| *e >= 0.0)));
    let [bare, deep, full] = [bare, deep, full].map(|i| image.error(&i.radiance));
    assert!(bare < 0.8 * noisy && deep < 0.3 * bare && full < 0.3 * bare, "{noisy}: {bare}, {deep}, {full}");

    let means = [0, 1].map(|h| SampleBuffers::new(&image.halves[h], SPP / 2));
    let guided = denoise(SIZE, &means[0], &means[1]).normal(&image.normal).albedo(&image.albedo).depth(&image.depth);
    let without = image.error(&guided.run().unwrap().radiance);
    assert!(without < 1.3 * deep, "halves show the variance: {without} for {deep}");
}

/// One image with either kind of variance.
#[test]
fn one_image_is_split_by_its_noise_and_keeps_its_light() {
    let image = Image::new();
    let mean = image.mean();
    let of_sample: Colours = (0..PIXELS).map(|i| [image.truth[i][0].powi(2) / 3.0; 3]).collect();
    let of_mean: Colours = of_sample.iter().map(|v| v.map(|v| v / SPP as f32)).collect();
    let run = |variance| {
        let all = SampleBuffers::new(&mean, SPP).variance(variance);
        let image = denoise_whole(SIZE, &all).normal(&image.normal).albedo(&image.albedo).depth(&image.depth);
        (image.film().unwrap(), image.run().unwrap())
    };
    let (film, found) = run(Variance::OfSamples(&of_sample));
    let (_, again) = run(Variance::OfMean(&of_mean));
    let apart = found.radiance.iter().zip(&again.radiance).map(|(a, b)| (a[0] - b[0]).abs()).fold(0.0, f32::max);
    assert!(apart < 1e-3, "both variances are the same: {apart}");
    assert!(image.error(&found.radiance) < 0.3 * image.error(&mean), "{}", image.error(&found.radiance));
    for i in 0..PIXELS {
        let (sum, given) = (film.mean(i)[0], f64::from(mean[i][0]));
        assert!((sum - given).abs() < 1e-12 * given.max(1.0), "pixel {i}: {sum} for {given}");
        let error = film.squared_error(i).unwrap()[0];
        let expected = f64::from(of_mean[i][0]);
        assert!((error - expected).abs() < 1e-6 * expected, "the halves show the error: {error} for {expected}");
    }
}

/// Halves of a dark pixel with large noise are negative; odd and single counts have halves, too.
#[test]
fn dark_pixels_with_large_noise_break_no_filter() {
    let mut noise = Noise::new(3);
    let mean: Colours = (0..PIXELS).map(|_| [0.01 * noise.next(); 3]).collect();
    let variance: Colours = (0..PIXELS).map(|i| [if i % 7 == 0 { 1e4 } else { 1.0 }; 3]).collect();
    let counts: Vec<u32> = (0..PIXELS as u32).map(|i| i % 4).collect();
    let emission = vec![[0.005; 3]; PIXELS];
    let all = SampleBuffers::new(&mean, &counts).variance(Variance::OfMean(&variance));
    let image = denoise_whole(SIZE, &all).emission(&emission);
    let guided = NlMeans::with_options(NlMeansOptions::default().features(Some(1.0))).unwrap();
    let filters: [&dyn Filter; 4] = [&Gaussian::default(), &guided, &Bilateral::default(), &ClusterRegression::new()];
    for filter in filters {
        let found = image.clone().filter(filter).run().unwrap();
        assert!(found.radiance.iter().flatten().all(|v| v.is_finite()), "{}", filter.name());
        assert!(found.error.unwrap().iter().all(|e| *e >= 0.0), "{}", filter.name());
    }
}

/// Three frames in one slice, by one filter.
#[test]
fn frames_in_place_have_the_bits_of_images_made_alone() {
    let (filter, mut out) = (ClusterRegression::new(), vec![[f32::NAN; 3]; PIXELS]);
    for seed in 1..=3 {
        let (image, coverage, emission) = lamp(seed);
        let sets = [0, 1].map(|h| SampleBuffers::new(&image.halves[h], SPP));
        let frame = denoise(SIZE, &sets[0], &sets[1]).depth(&image.depth).coverage(&coverage).emission(&emission);
        frame.clone().filter(&filter).strict().run_into(&mut out).unwrap();
        assert!(out == frame.run().unwrap().radiance, "frame {seed}");
        let error = frame.run_into(&mut out[1..]).unwrap_err().to_string();
        assert!(error.contains("\"out\"") && error.contains("1535 values"), "{error}");
    }
}

#[test]
fn pixels_without_samples_are_filled_even_where_buffers_are_nan() {
    let image = Image::new();
    let [mut a, b] = image.halves.clone();
    let mut counts = vec![SPP / 2; PIXELS];
    for i in [5, 700] {
        (a[i], counts[i]) = ([f32::NAN; 3], 0);
    }
    let halves = (SampleBuffers::new(&a, &counts), SampleBuffers::new(&b, &counts));
    let found = denoise(SIZE, &halves.0, &halves.1).normal(&image.normal).albedo(&image.albedo).run().unwrap();
    for i in [5, 700] {
        let (x, truth) = (found.radiance[i][0], image.truth[i][0]);
        assert!((x - truth).abs() < 0.5 * truth, "pixel {i}: {x} for {truth}");
    }
}

/// A lamp before a black background and a wall, with features and emission of the image's own samples.
fn lamp(seed: u64) -> (Image, Vec<f32>, Colours) {
    let (mut noise, mut image) = (Noise::new(seed), Image::default());
    let (mut coverage, mut emission) = (Vec::new(), Vec::new());
    for i in 0..PIXELS {
        let [x, y] = [i % 48, i / 48].map(|n| n as f32);
        let (mut hits, mut depth, mut normal, mut albedo, mut seen) = (0.0, 0.0, [0.0; 3], 0.0, 0.0);
        for h in 0..2 {
            let samples: Vec<f32> = (0..SPP)
                .map(|_| {
                    let [x, y] = [x + noise.next(), y + noise.next()];
                    let (n, z, light) = match ((x - 24.3).hypot(y - 15.7) < 9.0, y > 19.2) {
                        (true, _) => ([0.0, 0.6, 0.8], 4.0, 300.0),
                        (false, true) => ([0.0, 0.0, 1.0], 8.0, 0.0),
                        (false, false) => return 0.0,
                    };
                    (hits, depth, albedo, seen) = (hits + 1.0, depth + z, albedo + 0.5, seen + light);
                    (0..3).for_each(|k| normal[k] += n[k]);
                    light + noise.next()
                })
                .collect();
            let mean = samples.iter().sum::<f32>() / SPP as f32;
            let m2: f32 = samples.iter().map(|s| (s - mean).powi(2)).sum();
            image.halves[h].push([mean; 3]);
            image.variances[h].push([m2 / (SPP - 1) as f32; 3]);
        }
        let share = 1.0 / f32::max(hits, 1.0);
        image.normal.push(normal.map(|v| v * share));
        image.albedo.push([albedo * share; 3]);
        image.depth.push(depth * share);
        coverage.push(hits / (2 * SPP) as f32);
        emission.push([seen / (2 * SPP) as f32; 3]);
    }
    (image, coverage, emission)
}

/// Partly covered pixels at the edge do not join the depth of the lamp and that of the background.
#[test]
fn a_lamp_does_not_light_the_background_beside_it() {
    for seed in 1..=3 {
        let (image, coverage, emission) = lamp(seed);
        let sets = [0, 1]
            .map(|h| SampleBuffers::new(&image.halves[h], SPP).variance(Variance::OfSamples(&image.variances[h])));
        let guided = denoise(SIZE, &sets[0], &sets[1]).normal(&image.normal).albedo(&image.albedo).depth(&image.depth);
        let covered = guided.clone().coverage(&coverage);
        for (name, image) in [("none", guided), ("coverage", covered.clone()), ("both", covered.emission(&emission))] {
            let found = image.run().unwrap().radiance;
            let leak = (0..PIXELS).filter(|i| coverage[*i] == 0.0).map(|i| found[i][0]).fold(0.0, f32::max);
            assert!(leak < 0.1, "{leak} of 300 with {name}, seed {seed}");
        }
    }
}

#[test]
fn emission_of_other_samples_is_warned_of() {
    let ((image, _, own), (_, _, other)) = (lamp(1), lamp(2));
    let sets = [0, 1].map(|h| SampleBuffers::new(&image.halves[h], SPP));
    let plain = || denoise(SIZE, &sets[0], &sets[1]);
    assert_eq!(plain().emission(&own).warnings().unwrap(), []);
    let found = plain().emission(&other).warnings().unwrap();
    assert!(matches!(found[..], [Warning::Emission { share }] if share > 0.02), "{found:?}");
    assert!(found[0].to_string().contains("different samples; pass the emission of the image's own samples, or none"));
}

/// Pixels of another id weigh less: a step of light that no other feature shows is kept better.
#[test]
fn ids_separate_pixels() {
    let mut noise = Noise::new(8);
    let step = |i: usize| if i % 48 < 24 { 0.2 } else { 0.5 };
    let half = |noise: &mut Noise| (0..PIXELS).map(|i| [step(i) * 3.0 * noise.next(); 3]).collect::<Colours>();
    let (a, b) = (half(&mut noise), half(&mut noise));
    let ids: Vec<u32> = (0..PIXELS as u32).map(|i| u32::from(i % 48 < 24)).collect();
    let normal = vec![[0.0, 0.0, 1.0]; PIXELS];
    let sets = (SampleBuffers::new(&a, 4), SampleBuffers::new(&b, 4));
    let plain = denoise(SIZE, &sets.0, &sets.1).normal(&normal);
    let beside = |image: &[[f32; 3]]| -> f32 {
        (0..PIXELS).filter(|i| (22..26).contains(&(i % 48))).map(|i| (image[i][0] - 1.5 * step(i)).powi(2)).sum()
    };
    let without = beside(&plain.run().unwrap().radiance);
    let with = beside(&plain.ids(&ids).run().unwrap().radiance);
    assert!(with < without, "{with} with ids, {without} without");
}

#[test]
fn wrong_buffers_are_refused_with_their_name_and_advice() {
    let image = Image::new();
    let [a, b] = image.sets();
    let mean = image.mean();
    let message = |result: Result<dapple_core::Filtered, Error>| result.unwrap_err().to_string();
    let holds = |message: String, parts: &[&str]| {
        assert!(parts.iter().all(|part| message.contains(part)), "{message}");
    };
    let plain = || denoise(SIZE, &a, &b);

    holds(message(denoise([0, 4], &a, &b).run()), &["empty"]);
    holds(message(denoise([48, 31], &a, &b).run()), &["\"mean of half a\"", "1536 values", "48x31", "need 1488"]);
    holds(message(plain().normal(&image.normal[1..]).run()), &["\"normal\"", "1535 values", "need 1536"]);
    holds(message(plain().depth(&[]).run()), &["\"depth\"", "0 values"]);
    holds(message(plain().ids(&[3]).run()), &["\"ids\"", "1 values"]);
    holds(message(plain().coverage(&vec![2.0; PIXELS]).run()), &["\"coverage\"", "pixel (0, 0)", "0 to 1"]);
    holds(message(plain().depth(&vec![-1.0; PIXELS]).run()), &["\"depth\"", "negative"]);

    let mut broken = image.albedo.clone();
    broken[49][1] = f32::NAN;
    holds(message(plain().albedo(&broken).run()), &["\"albedo\"", "pixel (1, 1)", "NaN"]);
    let mut infinite = mean.clone();
    infinite[2][0] = f32::INFINITY;
    let other = SampleBuffers::new(&infinite, 4);
    holds(message(denoise(SIZE, &a, &other).strict().run()), &["without a finite sample are filled", ": 1"]);

    let none = SampleBuffers::new(&mean, 0);
    holds(message(denoise(SIZE, &none, &b).run()), &["\"count of half a\"", "no pixel has a sample"]);
    let short = vec![1; 3];
    let short = SampleBuffers::new(&mean, &short);
    holds(message(denoise(SIZE, &a, &short).run()), &["\"count of half b\"", "3 values"]);
    let negative = vec![[0.0, -1.0, 0.0]; PIXELS];
    let negative = SampleBuffers::new(&mean, 4).variance(Variance::OfMean(&negative));
    holds(message(denoise_whole(SIZE, &negative).run()), &["\"variance\"", "pixel (0, 0)", "negative"]);

    let copy = image.halves[0].clone();
    for same in [&image.halves[0], &copy] {
        let same = SampleBuffers::new(same, 4);
        holds(message(denoise(SIZE, &a, &same).run()), &["\"mean of half b\"", "equals", "different seeds"]);
    }
    let alone = SampleBuffers::new(&mean, 8);
    holds(message(denoise_whole(SIZE, &alone).run()), &["\"variance\"", "missing", "different seeds"]);
}

/// A black frame, or one of a single colour, is equal in two renders.
#[test]
fn an_image_of_one_colour_may_come_twice() {
    for value in [0.0, 0.5] {
        let (a, b) = (vec![[value; 3]; PIXELS], vec![[value; 3]; PIXELS]);
        let found = denoise(SIZE, &SampleBuffers::new(&a, 1), &SampleBuffers::new(&b, 1)).run().unwrap();
        assert!(found.radiance.iter().flatten().all(|v| (v - value).abs() <= 1e-5 * value));
    }
}

#[test]
fn filters_that_read_features_refuse_radiance_alone_until_told_that_there_are_none() {
    let make = |needs: Needs, push: &dyn Fn(&mut Film, usize, usize, f32)| {
        let (mut film, mut noise) = (Film::new(Frame::new(16, 16).unwrap(), needs), Noise::new(4));
        (0..256 * 4).for_each(|i| push(&mut film, i / 4, i % 2, 0.5 + noise.next()));
        film
    };
    let needs = ClusterRegression::new().needs();
    let bare = make(needs, &|film, i, half, v| film.push(i, half, [v; 3]));
    let missed = make(needs, &|film, i, half, v| film.push_estimate(i, half, &grey(v)));
    let without = ClusterRegression::new().without_features();
    let small = make(without.needs(), &|film, i, half, v| film.push(i, half, [v; 3]));
    for filter in [&ClusterRegression::new() as &dyn Filter, &Bilateral::default()] {
        let error = filter.apply(&bare).unwrap_err();
        assert!(matches!(error, Error::NoneReported { .. }), "{error}");
        assert!(filter.apply(&missed).is_ok(), "misses are features");
        assert!(matches!(filter.apply(&small), Err(Error::NotRecorded { .. })));
    }
    let of_misses = ClusterRegression::new().apply(&missed).unwrap();
    assert_eq!(without.apply(&bare).unwrap(), of_misses);
    assert_eq!(without.apply(&small).unwrap(), of_misses);
    assert!(without.describe().ends_with(",features=none"), "{}", without.describe());
    assert!(!without.needs().features && Bilateral::default().without_features().apply(&small).is_ok());
    // A film with features is filtered without them.
    let hit = FirstHit::new([0.0; 3], [0.0, 0.0, 1.0], 1.0);
    let known = make(needs, &|film, i, half, v| {
        film.push_estimate(i, half, &grey(v).with_first_hit(hit));
    });
    assert_eq!(without.apply(&known).unwrap(), of_misses);
}

/// Half of the image has no samples, or NaN.
#[test]
fn wide_holes_are_filled() {
    let mut noise = Noise::new(3);
    for bad in [0.0, f32::NAN] {
        let hole = |i: usize| i % 48 >= 24;
        let half = |noise: &mut Noise| -> Colours {
            (0..PIXELS).map(|i| [if hole(i) { bad } else { 0.5 + noise.next() }; 3]).collect()
        };
        let (a, b) = (half(&mut noise), half(&mut noise));
        let counts: Vec<u32> = (0..PIXELS).map(|i| if hole(i) && bad == 0.0 { 0 } else { 8 }).collect();
        let image = denoise(SIZE, &SampleBuffers::new(&a, &counts), &SampleBuffers::new(&b, &counts)).run().unwrap();
        let dark = image.radiance.iter().filter(|colour| colour[0] < 0.7).count();
        assert!(dark == 0 && image.error.unwrap().iter().all(|error| error.is_finite()), "{dark} for {bad}");
    }
}
