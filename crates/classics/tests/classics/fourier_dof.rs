//! Fourier depth of field: bandwidths of the image through a lens, counts, and the filter.

use crate::bandwidth::{LensBandwidth, LensBandwidthOptions as MapOptions};
use crate::support::{Field, Points, frame, image, next_counts, random, run, sobol};
use dapple_classics::{FourierDof, FourierDofOptions, LensBandwidthOptions, Splat, SplatOptions, TraceLensHit};
use dapple_core::{Film, FirstHit, Limits, Needs};
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

const SIZE: [u32; 2] = [96, 64];

/// A diffuse plane of grey albedo, seen face on, with a circle of confusion of one radius.
fn plane(confusion: f32, albedo: impl Fn([u32; 2]) -> f64 + Send + Sync + 'static) -> TraceLensHit {
    Arc::new(move |pixel| (Some(hit(pixel, 1.0).with_albedo([albedo(pixel) as f32; 3])), confusion))
}

fn hit(pixel: [u32; 2], depth: f32) -> FirstHit {
    FirstHit::new([pixel[0] as f32, pixel[1] as f32, depth], [0.0, 0.0, -1.0], depth)
}

/// A strip, `scale` times 12 pixels wide, before a wall; both are white. Radii are `scale` times those given.
fn strip(scale: u32, [strip, wall]: [f32; 2]) -> TraceLensHit {
    Arc::new(move |pixel| {
        let is_strip = (30 * scale..42 * scale).contains(&pixel[0]);
        let (depth, confusion) = if is_strip { (1.0, strip) } else { (30.0, wall) };
        (Some(hit(pixel, depth).with_shape(u32::from(is_strip))), confusion * scale as f32)
    })
}

fn map(first_hits: &TraceLensHit, size: [u32; 2]) -> LensBandwidth {
    LensBandwidth::of(&frame(size), &**first_hits, &MapOptions::default(), Some(0.25))
}

fn sampler_with(options: FourierDofOptions, first_hits: &TraceLensHit) -> FourierDof<Points> {
    FourierDof::new(sobol(7), first_hits.clone(), options, LensBandwidthOptions::default()).expect("options in range")
}

fn sampler(first_hits: &TraceLensHit) -> FourierDof<Points> {
    sampler_with(FourierDofOptions::default(), first_hits)
}

/// The counts of one plan.
fn counts(sampler: &mut FourierDof<Points>, size: [u32; 2], spp: u64) -> Vec<u32> {
    let film = Film::new(frame(size), Needs::none());
    let counts = next_counts(sampler, &film, spp * film.frame().pixels() as u64, [0, u32::MAX]);
    assert_eq!(counts.iter().map(|&n| u64::from(n)).sum::<u64>(), spp * film.frame().pixels() as u64);
    counts
}

fn splat(first_hits: &TraceLensHit) -> Splat {
    Splat::new(first_hits.clone(), SplatOptions::default(), LensBandwidthOptions::default()).expect("options in range")
}

/// Every kind of surface: no hits, steps, textures, mirrors, broken numbers.
fn mixed() -> TraceLensHit {
    Arc::new(|pixel| {
        let [x, y] = pixel;
        let albedo = if x.is_multiple_of(5) { 0.9 } else { 0.2 };
        let broken = if y == 3 { f32::NAN } else { 1.0 };
        let hit = (y % 7 != 2).then(|| hit(pixel, broken).with_shape(x / 9).with_roughness(0.5 * (y % 3) as f32));
        let confusion = [0.0, -2.5, f32::INFINITY, f32::NAN, 4.0][(x / 4 + y / 4) as usize % 5];
        (hit.map(|hit| hit.with_albedo([albedo; 3])), confusion)
    })
}

#[test]
fn fourier_dof_conforms() {
    dapple_conformance::sampler(|| Box::new(sampler(&mixed())));
}

#[test]
fn splat_conforms() {
    dapple_conformance::filter(|| Box::new(splat(&mixed())));
}

/// The variance over the lens of a sinusoid of amplitude 1, averaged over its phase.
fn variance_over_lens(x: f64) -> f64 {
    // The mean of cos(x u) over a disk of radius 1: a sum over strips, 2 sqrt(1 - u^2) / pi wide.
    let strips = 4000;
    let strip = |k: usize| {
        let u = (2 * k + 1) as f64 / strips as f64 - 1.0;
        libm::cos(x * u) * (1.0 - u * u).sqrt() * 2.0 / PI * 2.0 / strips as f64
    };
    let kept: f64 = (0..strips).map(strip).sum();
    // Over its phase, cos^2 and the square of the mean both average to half of their largest value.
    0.5 * (1.0 - kept * kept)
}

#[test]
fn a_textured_plane_in_focus_gets_the_same_count_in_every_pixel() {
    let checks = plane(0.0, |[x, y]| f64::from((x + y) % 2));
    let found = map(&checks, SIZE);
    assert!(found.bandwidth.iter().all(|&w| w == 0.5) && found.deviation.iter().all(|&d| d == 0.0));
    assert!(counts(&mut sampler(&checks), SIZE, 5).iter().all(|&n| n == 5));
    // Negative control: without texture the bandwidth is the least one, and one pixel in 64 gets all samples.
    let plain = counts(&mut sampler(&plane(0.0, |_| 0.5)), SIZE, 5);
    let chosen = plain.iter().filter(|&&n| n > 0).count();
    assert!(chosen.abs_diff(plain.len() / 64) <= 8, "{chosen} of {}", plain.len());
    assert!(plain.iter().all(|&n| n == 0 || (250..400).contains(&n)));
}

#[test]
fn the_deviation_of_a_blurred_sinusoid_is_its_closed_form() {
    let (period, amplitude) = (16.0, 0.2);
    let mut last = 0.0;
    for confusion in 1..=9 {
        let texture = plane(confusion as f32, move |[x, _]| 0.5 + amplitude * libm::sin(TAU * f64::from(x) / period));
        let found = map(&texture, SIZE);
        let middle = 32 * 96 + 40;
        // A window of a whole number of periods holds the sinusoid's own variance: 17 pixels do nearly.
        let deviation = found.deviation[middle..middle + 16].iter().map(|d| d * d).sum::<f64>() / 16.0;
        assert!(deviation > last, "{confusion}: {deviation} after {last}");
        last = deviation;
        let expected = (1.0f64 / period).min(0.61 / f64::from(confusion));
        let bandwidth = found.bandwidth[middle..middle + 16].iter().sum::<f64>() / 16.0;
        assert!((bandwidth / expected - 1.0).abs() < 0.01, "{confusion}: {bandwidth} {expected}");
        if confusion == 8 {
            let expected = amplitude * amplitude * variance_over_lens(TAU / period * 8.0);
            assert!((deviation / expected - 1.0).abs() < 0.06, "{deviation} {expected}");
        }
    }
}

#[test]
fn twice_the_resolution_halves_the_bandwidth_of_blurred_edges() {
    for radii in [[-6.0, 0.0], [0.0, 6.0], [-6.0, 5.0]] {
        let [small, large] = [1, 2].map(|scale| map(&strip(scale, radii), SIZE.map(|n| n * scale)).bandwidth);
        for x in [22, 25, 27, 33, 36, 39, 44, 47] {
            let [a, b] = [small[32 * 96 + x], large[64 * 192 + 2 * x]];
            // Beside a sharp edge the width of a pixel counts, which stays the same.
            let off = 1.0 / b - 2.0 / a;
            let is_in_circle = radii[0] < 0.0 && (25..=46).contains(&x);
            assert!(off.abs() < if is_in_circle { 1e-4 } else { 3.0 }, "{radii:?} at {x}: {a} and {b}");
        }
        let middle = small[32 * 96 + 25];
        let expected = if radii[0] < 0.0 { 0.61 / 6.0 } else { 1.0 / 7.0 };
        assert!((middle - expected).abs() < 0.03, "{radii:?}: {middle} {expected}");
    }
}

#[test]
fn a_near_edge_spreads_its_circle_over_the_wall_in_focus_and_a_far_one_does_not_spread() {
    let at = |x: usize| 32 * 96 + x;
    let near = map(&strip(1, [-6.0, 0.0]), SIZE);
    assert!(near.deviation[at(26)] == 0.0, "white before white");
    let dark: TraceLensHit = Arc::new(|pixel| {
        let (hit, confusion) = strip(1, [-6.0, 0.0])(pixel);
        (hit.map(|hit| hit.with_albedo([0.5 * hit.shape as f32; 3])), confusion)
    });
    let near = map(&dark, SIZE);
    assert!(near.deviation[at(26)] > 0.15 && near.deviation[at(36)] > 0.1);
    assert!(near.bandwidth[at(29)] < 0.11 && near.bandwidth[at(26)] < 0.11, "no sharp edge");
    assert!(near.deviation[at(20)] == 0.0 && near.deviation[at(60)] == 0.0);
    // A strip in focus before a blurred wall: its own pixels are sharp.
    let far = map(&strip(1, [0.0, 6.0]), SIZE);
    assert!(far.bandwidth[at(30)] == 0.5 && far.deviation[at(32)] == 0.0);
}

#[test]
fn chosen_pixels_are_evenly_spread_at_the_density_of_their_bandwidth() {
    // The bandwidth is 0.61 / 5 everywhere: checks under a circle of five pixels.
    let checks = plane(5.0, |[x, y]| f64::from((x / 2 + y / 2) % 2));
    let found = counts(&mut sampler(&checks), [128, 128], 4);
    let density = (2.0f64 * 0.61 / 5.0).powi(2);
    let chosen = found.iter().filter(|&&n| n > 0).count() as f64 / found.len() as f64;
    assert!((chosen - density).abs() < 0.002, "{chosen} {density}");
    // Blocks of 16 x 16 pixels hold 15.2 chosen ones; random thinning would have a variance of 14.3.
    let blocks = (0..64).map(|b| {
        let pixels = (0..256).map(|k| (b / 8 * 16 + k / 16) * 128 + b % 8 * 16 + k % 16);
        pixels.filter(|&i: &usize| found[i] > 0).count() as f64
    });
    let variance = blocks.map(|n| (n - 256.0 * density).powi(2)).sum::<f64>() / 64.0;
    assert!(variance < 5.0, "{variance}");
}

#[test]
fn counts_follow_the_deviation_over_the_lens() {
    // An edge under a circle of five pixels: its pixels get more samples than those of the flat parts.
    let edge = plane(5.0, |[x, _]| if x < 48 { 0.1 } else { 0.9 });
    let found = counts(&mut sampler_with(FourierDofOptions::default().floor(0.1), &edge), SIZE, 8);
    let largest = |columns: std::ops::Range<usize>| {
        columns.flat_map(|x| (0..64).map(move |y| y * 96 + x)).map(|i| found[i]).max().unwrap_or(0)
    };
    let (at_edge, flat) = (largest(46..50), largest(4..20));
    // The deviation is 0.4 at the edge; elsewhere the floor holds.
    assert!((3.5..4.5).contains(&(f64::from(at_edge) / f64::from(flat))), "{at_edge} {flat}");
}

#[test]
fn splat_fills_a_smooth_image_from_few_pixels_and_leaves_sharp_pixels_alone() {
    let smooth = plane(8.0, |_| 0.5);
    let ramp = |[x, y]: [u32; 2]| [0.5 + 0.004 * x as f32, 0.3 + 0.002 * y as f32, 0.2];
    let mut limits = Limits::spp(1.0);
    limits.min_spp = 0;
    let render = |first_hits: &TraceLensHit| {
        let film = run(&mut Field(move |pixel, _| ramp(pixel)), &mut sampler(first_hits), SIZE, &limits);
        let image = image(&splat(first_hits), &film);
        (film, image)
    };
    let (film, image) = render(&smooth);
    let empty = (0..image.len()).filter(|&i| film.count(i) == 0).count();
    assert!(empty * 20 > image.len() * 19, "{empty} pixels without samples");
    for (i, value) in image.iter().enumerate() {
        let pixel = film.frame().pixel(i);
        let inside = (24..72).contains(&pixel[0]) && (24..40).contains(&pixel[1]);
        let off = value.iter().zip(ramp(pixel)).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        // The largest difference within one standard deviation of a Gaussian, 16 pixels.
        assert!(off < if inside { 0.02 } else { 0.08 }, "{pixel:?}: {off}");
    }
    let (film, image) = render(&plane(0.0, |[x, y]| f64::from((x + y) % 2)));
    assert!((0..image.len()).all(|i| image[i] == film.mean(i).map(|v| v as f32)));
}

#[test]
fn splat_trusts_pixels_with_many_samples_more() {
    // Under a circle of two pixels, every second pixel has 24 samples and the others have one, which is wrong.
    let first_hits = plane(2.0, |[x, y]| f64::from((x + y) % 2));
    let is_few = |i: usize| (i % 96 + i / 96) % 2 == 1;
    let mut film = Film::new(frame(SIZE), Needs::none());
    for i in 0..96 * 64 {
        (0..if is_few(i) { 1 } else { 24 }).for_each(|_| film.push(i, 0, [f32::from(u8::from(is_few(i))); 3]));
    }
    let image = image(&splat(&first_hits), &film);
    // Shares of the mean count of 12.5: 1 / 13.5 and 24 / 36.5. Weighted alike, half of the pixels would be wrong.
    let middle = image[32 * 96 + 48][0];
    assert!(middle < 0.2, "{middle}");
}

#[test]
fn parameters_out_of_range_are_refused() {
    let make = |options, bandwidth| FourierDof::new(random(1), plane(0.0, |_| 0.5), options, bandwidth).is_ok();
    let (options, bandwidth) = (FourierDofOptions::default(), LensBandwidthOptions::default());
    assert!(make(options, bandwidth) && !make(options.floor(f64::NAN), bandwidth));
    assert!(!make(options, bandwidth.window(0)));
}
