//! Hard cases of filters. Test names end with their catalogue ids.

use crate::support::{self, HALVES, Noise, grey, label, over_halves, rendered};
use dapple_conformance::statistics::Mean;
use dapple_core::{Block, Draws, Estimate, Film, Filter, FirstHit, Frame, Needs};
use dapple_denoise::{ClusterGaussian, ClusterGaussianOptions, ClusterRegression, Gaussian};

/// A film of `size` pixels with `count(x, y)` samples per pixel of `signal(x, y)` plus noise in 0 .. 1.
fn film(
    size: [u32; 2],
    seed: u64,
    count: impl Fn(u32, u32) -> u32,
    signal: impl Fn(u32, u32, &mut Noise) -> f32,
) -> Film {
    let count = |x, y| count(x, y) as usize;
    support::film(size, Needs::none().with_variance(), seed, count, |[x, y], _, noise| grey(signal(x, y, noise)))
}

/// The wrong rule, as control: splatting every sample with the kernel's weight, `sum(w f) / sum(w)`, for samples spread
/// evenly over their pixels. This is a weighted mean with weights `count w`.
fn splatted(film: &Film, weights: &[f64]) -> Vec<f64> {
    let [width, height] = film.frame().size().map(|n| n as isize);
    let n = (weights.len() / 2) as isize;
    let pixel = |i: isize| {
        let (x, y) = (i % width, i / width);
        let (mut sum, mut total) = (0.0, 0.0);
        for (sy, sx) in (y - n..=y + n).flat_map(|sy| (x - n..=x + n).map(move |sx| (sy, sx))) {
            if (0..width).contains(&sx) && (0..height).contains(&sy) {
                let j = (sy * width + sx) as usize;
                let w = weights[(sx - x + n) as usize] * weights[(sy - y + n) as usize] * film.count(j) as f64;
                sum += w * film.mean(j)[0];
                total += w;
            }
        }
        sum / total
    };
    (0..width * height).map(pixel).collect()
}

/// The last dark pixel beside the edge.
///
/// Along x the kernel is `exp(-2 x^2) - exp(-4.5)`, `|x| <= 1.5`. The bright pixel next to it covers 1/2 .. 3/2; the
/// others are out of reach.
/// So the pixel is `integral(1/2 .. 3/2) / integral(-3/2 .. 3/2)` = 0.186_045 / 1.216_610 = 0.152_921. Nothing changes
/// along y.
const EDGE: f64 = 0.152_920_846_231_744;
const COUNTS: [[u32; 2]; 4] = [[4, 4], [4, 16], [4, 256], [256, 4]];

fn outside(outside: f64) -> ClusterGaussianOptions {
    ClusterGaussianOptions::default().outside(outside)
}

fn edge_filters() -> [(Box<dyn Filter>, f64); 4] {
    let kernel = Gaussian::new(2.0, 1.5).unwrap();
    let map = |clusters: Vec<u32>| ClusterGaussian::from_map([8, 5], clusters).unwrap().with_kernel(kernel.clone());
    let one = map(vec![9; 40]);
    let two = map((0..40).map(|i| u32::from(i % 8 >= 4)).collect());
    let crossing = 0.25 * EDGE / (0.25 * EDGE + (1.0 - EDGE));
    [
        (Box::new(kernel), EDGE),
        (Box::new(one.with_options(outside(0.1)).unwrap()), EDGE),
        (Box::new(two.clone().with_options(outside(0.25)).unwrap()), crossing),
        (Box::new(two.with_options(outside(0.0)).unwrap()), 0.0),
    ]
}

/// Without noise, the counts have no effect.
#[test]
fn unequal_counts_do_not_move_an_edge_a08() {
    let mut naive = Vec::new();
    for [left, right] in COUNTS {
        let film = film([8, 5], 1, |x, _| if x < 4 { left } else { right }, |x, _, _| f32::from(u8::from(x >= 4)));
        for (filter, wanted) in edge_filters() {
            let image = filter.apply(&film).unwrap();
            for y in 0..5 {
                let got = f64::from(image.radiance[8 * y + 3][0]);
                assert!((got - wanted).abs() < 1e-7, "{}, {left}/{right}: {got}, not {wanted}", filter.describe());
            }
        }
        naive.push(splatted(&film, Gaussian::new(2.0, 1.5).unwrap().weights())[19]);
    }
    // The control moves the edge.
    for (got, wanted) in naive.iter().zip([EDGE, 0.419, 0.920, 0.0028]) {
        assert!((got - wanted).abs() < 5e-4, "{got}, not {wanted}");
    }
}

/// With noise: within 4 standard errors over 150 images. The 16 tests raise a false alarm with a probability of about
/// 1e-3; seeds are fixed. The control is rejected for every unequal pair.
#[test]
fn unequal_counts_do_not_move_an_edge_under_noise_a08() {
    const SEEDS: u64 = 150;
    for [left, right] in COUNTS {
        let films: Vec<Film> = (0..SEEDS)
            .map(|seed| {
                let count = |x, _| if x < 4 { left } else { right };
                film([8, 5], 1 + seed, count, |x, _, noise| f32::from(u8::from(x >= 4)) + noise.next())
            })
            .collect();
        for (filter, wanted) in edge_filters() {
            let value = |f: &Film| f64::from(filter.apply(f).unwrap().radiance[19][0]) - 0.5;
            let found: Mean = films.iter().map(value).collect();
            assert!((1e-4..0.02).contains(&found.standard_error()));
            assert!(found.deviation(wanted).abs() < 4.0, "{}, {left}/{right}: {found:?}", filter.describe());
        }
        if left != right {
            let kernel = Gaussian::new(2.0, 1.5).unwrap();
            let found: Mean = films.iter().map(|f| splatted(f, kernel.weights())[19] - 0.5).collect();
            assert!(found.deviation(EDGE).abs() > 4.0, "the naive rule passes at {left}/{right}: {found:?}");
        }
    }
}

/// Counts of 8 left and 128 right of the border between columns 15 and 16.
const SEAM: [u32; 2] = [32, 16];

/// The step across the border less the slope of the signal, averaged over the rows of one image.
fn step(image: &[f64], slope: f64) -> f64 {
    let width = SEAM[0] as usize;
    image.chunks(width).map(|row| row[16] - row[15]).sum::<f64>() / f64::from(SEAM[1]) - slope
}

/// The paired difference across the border over 64 images of a constant and of a gradient is 0 within 4 standard
/// errors.
///
/// The 6 tests raise a false alarm with a probability of about 4e-4; seeds are fixed. Splatting, the control, is
/// rejected on the gradient. On a constant it has no bias.
#[test]
fn sample_counts_that_jump_leave_no_seam_a09() {
    let map: Vec<u32> = (0..SEAM[0] * SEAM[1]).map(|i| u32::from(i % SEAM[0] >= 16)).collect();
    let cluster = ClusterGaussian::from_map(SEAM, vec![1; map.len()]).unwrap();
    let border = ClusterGaussian::from_map(SEAM, map).unwrap().with_options(outside(0.0)).unwrap();
    for slope in [0.0f32, 0.05] {
        let films: Vec<Film> = (0..64)
            .map(|seed| {
                let signal = |x, _, noise: &mut Noise| slope * x as f32 + noise.next();
                film(SEAM, 77 + seed, |x, _| if x < 16 { 8 } else { 128 }, signal)
            })
            .collect();
        let z = |filter: &dyn Fn(&Film) -> Vec<f64>| {
            let steps: Mean = films.iter().map(|f| step(&filter(f), slope.into())).collect();
            let error = steps.standard_error();
            assert!(error > 0.0 && error < 5e-3, "{error}");
            steps.deviation(0.0)
        };
        let radiance = |filter: &dyn Filter, film: &Film| -> Vec<f64> {
            filter.apply(film).unwrap().radiance.iter().map(|c| c[0].into()).collect()
        };
        // A symmetric kernel keeps the slope of a gradient. A border with `outside` 0 bends it by design, so that
        // filter is tested on the constant only.
        let filters: [&dyn Filter; 3] = [&Gaussian::default(), &cluster, &border];
        for filter in &filters[..if slope == 0.0 { 3 } else { 2 }] {
            let z = z(&|film| radiance(*filter, film));
            assert!(z.abs() < 4.0, "{}, slope {slope}: a step of {z} standard errors", filter.describe());
        }
        if slope > 0.0 {
            let kernel = Gaussian::default();
            let z = z(&|film| splatted(film, kernel.weights()));
            assert!(z.abs() > 4.0, "splatting passes: {z}");
        }
    }
}

/// 1 +- 2e-6 everywhere, for radii 0.3 to 4, 1 to 64 samples, borders, corners and a crop.
#[test]
fn a_constant_image_stays_constant_f06() {
    let whole = Frame::new(40, 30).unwrap();
    for frame in [whole, whole.crop(7, 3, 20, 8).unwrap(), whole.crop(39, 29, 40, 30).unwrap()] {
        for value in [1.0f32, 0.1, 3e-30, 7e30, 0.0] {
            let (mut film, mut noise) = (Film::new(frame, Needs::none().with_variance()), Noise(5));
            for i in 0..frame.pixels() {
                (0..1 + (noise.next() * 64.0) as u32).for_each(|_| film.push(i, 0, [value; 3]));
            }
            let map: Vec<u32> = (0..frame.pixels() as u32).map(|i| i / 5 % 3).collect();
            for radius in [0.3, 0.5, 0.7, 1.0, 2.0, 3.3, 4.0] {
                let kernel = Gaussian::new(0.5, radius).unwrap();
                let map = ClusterGaussian::from_map(frame.size(), map.clone()).unwrap().with_kernel(kernel.clone());
                let filters: [&dyn Filter; 2] = [&kernel, &map];
                for filter in filters {
                    for x in filter.apply(&film).unwrap().radiance.iter().flatten() {
                        assert!((x - value).abs() <= 1e-7 * value, "{}: {x}, not {value}", filter.describe());
                    }
                }
            }
        }
    }
}

/// Pixels without samples are filled from pixels in reach. Without any in reach they are black with an infinite error.
/// A kernel inside its own pixel fills nothing.
#[test]
fn pixels_without_samples_are_filled_or_marked_f09() {
    // One sampled pixel in the corner; the kernel reaches 4 pixels.
    let film = film([12, 12], 3, |x, y| if x + y == 0 { 4 } else { 0 }, |_, _, _| 2.0);
    let clusters = (0..144).collect();
    let map = ClusterGaussian::from_map([12, 12], clusters).unwrap().with_options(outside(0.0)).unwrap();
    let narrow = Gaussian::new(0.5, 0.4).unwrap();
    let filters: [(&dyn Filter, usize); 3] = [(&Gaussian::default(), 4), (&map, 4), (&narrow, 0)];
    for (filter, reach) in filters {
        let image = filter.apply(&film).unwrap();
        for (i, (value, error)) in image.radiance.iter().zip(image.error.unwrap()).enumerate() {
            let reached = i % 12 <= reach && i / 12 <= reach;
            let wanted = if reached { 2.0 } else { 0.0 };
            assert!(*value == [wanted; 3], "{}: pixel {i} is {value:?}", filter.describe());
            assert_eq!(error, if reached { 0.0 } else { f32::INFINITY }, "{}: pixel {i}", filter.describe());
        }
    }
}

/// An invalid sample counts as 0 and in n, and causes no NaN. Pixels out of the kernel's reach keep their bits.
#[test]
fn an_invalid_sample_does_not_spread_f05() {
    let good = film([16, 3], 9, |_, _| 5, |_, _, noise| noise.next());
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1.0] {
        let (mut with, mut zero) = (good.clone(), good.clone());
        with.push(16, 0, [bad; 3]);
        zero.push(16, 0, [0.0; 3]);
        let map = ClusterGaussian::from_map([16, 3], vec![0; 48]).unwrap();
        let filters: [&dyn Filter; 2] = [&Gaussian::default(), &map];
        for filter in filters {
            let [a, b, c] = [&with, &zero, &good].map(|film| filter.apply(film).unwrap());
            assert_eq!(a, b);
            for i in (0..48).filter(|i| i % 16 > 4) {
                assert_eq!(a.radiance[i].map(f32::to_bits), c.radiance[i].map(f32::to_bits));
            }
        }
    }
}

/// A render of samples that are 0 or 1 at random, on surfaces in stripes.
fn two_levels(frame: Frame, spp: u64) -> Film {
    rendered(frame, HALVES.with_first_hits(1).with_surfaces(), (3, spp), |draws: &Draws<'_>| {
        let [u, v, a, _] = draws.block(Block::new(0));
        let [x, y] = draws.pixel();
        let hit = FirstHit::new([x as f32 + u, y as f32 + v, 0.0], [0.0, 0.0, 1.0], 50.0 + u)
            .with_shading_normal(if x % 16 < 8 { [1.0, 0.0, 0.0] } else { [0.0, 0.0, 1.0] })
            .with_albedo([if y % 12 < 6 { 0.3 } else { 0.8 }; 3])
            .with_footprint(1.0)
            .with_shape(x / 16 % 3)
            .with_primitive(y / 6);
        let likely = if (x / 8 + y / 8).is_multiple_of(2) { 0.1 } else { 0.7 };
        Estimate::new([f32::from(u8::from(a < likely)); 3]).with_first_hit(hit)
    })
}

/// The blurs, which reach 4 pixels.
fn blurs() -> [Box<dyn Filter>; 3] {
    let narrow = Gaussian::new(0.5, 3.0).unwrap();
    [Box::new(Gaussian::default()), Box::new(narrow), Box::new(ClusterGaussian::from_hits(label()))]
}

/// An image of two levels stays within [-1, 2]: no sum of weights comes near 0 and no slope runs away.
#[test]
fn two_levels_stay_in_range_f07() {
    for (spp, side) in [(2, 280), (4, 120)] {
        let film = two_levels(Frame::new(side, side).unwrap(), spp);
        let clusters = ClusterRegression::new().with_clusters(label(), "");
        for filter in blurs().into_iter().chain(over_halves()).chain([Box::new(clusters) as Box<dyn Filter>]) {
            let image = filter.apply(&film).unwrap();
            let off = image.radiance.iter().flatten().find(|v| !(-1.0..=2.0).contains(*v));
            assert_eq!(off, None, "{} at {spp} spp", filter.describe());
        }
    }
}

/// A window of the image filtered by itself equals the whole image bit for bit, beyond the kernel's reach of its border. Filters
/// over halves use statistics of the whole image, so a window may differ.
#[test]
fn results_do_not_depend_on_tiles_f10() {
    let frame = Frame::new(150, 131).unwrap();
    let whole = two_levels(frame, 4);
    for filter in blurs() {
        let expected = filter.apply(&whole).unwrap().radiance;
        for [x0, y0, width, height] in [[0, 0, 97, 90], [2, 6, 140, 80], [34, 18, 100, 111]] {
            let window = frame.crop(x0, y0, x0 + width, y0 + height).unwrap();
            let cut = filter.apply(&two_levels(window, 4)).unwrap().radiance;
            let from = |origin: u32| if origin == 0 { 0 } else { 4 };
            for (x, y) in (from(x0)..width - 4).flat_map(|x| (from(y0)..height - 4).map(move |y| (x, y))) {
                let [got, there] = [cut[(y * width + x) as usize], expected[((y0 + y) * 150 + x0 + x) as usize]];
                assert_eq!(got.map(f32::to_bits), there.map(f32::to_bits), "{}, ({x}, {y})", filter.describe());
            }
        }
    }
}
