//! Errors that are blue noise over the image, by shifts and by scrambling keys.

use crate::keys::{Seed, halves, mix64};
use crate::support::id;
use dapple_core::{PointSet, SampleId};
use dapple_low_discrepancy::{BlueNoise, BlueNoiseKeys, Random, Sobol};

/// Returns the mean squared error of the pixels, and 16 times the mean squared error of means over 4 x 4 pixels. For white
/// noise, the two are equal. There is one image of 128 x 128 pixels for each of four blocks of random numbers.
fn mean_squares(points: &dyn PointSet, spp: u64, f: fn(f64, f64) -> f64, mean: f64) -> [f64; 2] {
    let error = |x: u32, y: u32, block: u32| {
        let value = |index| {
            let [a, b, ..] = points.block(SampleId::new([x, y], 0, index), block).map(f64::from);
            f(a, b) - mean
        };
        (0..spp).map(value).sum::<f64>() / spp as f64
    };
    let mut sums = [0.0; 2];
    for (block, corner) in (0..4).flat_map(|block| (0..1024).map(move |corner| (block, corner))) {
        let [x, y] = [corner % 32 * 4, corner / 32 * 4];
        let own: [f64; 16] = std::array::from_fn(|k| error(x + k as u32 % 4, y + k as u32 / 4, block));
        sums[0] += own.iter().map(|e| e * e).sum::<f64>();
        sums[1] += own.iter().sum::<f64>().powi(2);
    }
    sums.map(|s| s / f64::from(4 << 14))
}

/// With white noise, the mean square of 4096 block means has a standard error of 2.2 %.
#[test]
fn errors_have_little_energy_at_low_frequencies() {
    let disk = |x: f64, y: f64| f64::from(u8::from(x * x + y * y < 1.0));
    let ramp = |x: f64, _: f64| x;
    let quarter = std::f64::consts::FRAC_PI_4;
    for (what, f, mean, spp, most) in [
        ("ramp", ramp as fn(f64, f64) -> f64, 0.5, 1, 0.3),
        ("ramp", ramp, 0.5, 4, 0.4),
        ("disk", disk, quarter, 1, 0.8),
    ] {
        let of = |points: &dyn PointSet| {
            let [pixels, blocks] = mean_squares(points, spp, f, mean);
            blocks / pixels
        };
        let [blue, white] = [of(&BlueNoise::new(3, Sobol::new(3))), of(&Sobol::new(3))];
        assert!(blue < most, "{what}, {spp} spp: {blue:.3} of white noise");
        assert!((white - 1.0).abs() < 0.2, "{what}, {spp} spp: the control has {white:.3}");
    }
}

/// A point set whose coordinates are all the same number.
struct Constant(f32);

impl PointSet for Constant {
    fn describe(&self) -> String {
        "constant".into()
    }

    fn block(&self, _: SampleId, _: u32) -> [f32; 4] {
        [self.0; 4]
    }
}

/// The side of the tile of shifts.
const SIDE: usize = 128;
const PIXELS: usize = SIDE * SIDE;

/// Returns the shifted number in each pixel of a tile, in row-major order, in steps of 2^-24.
fn shifted(u: f32) -> Vec<u32> {
    let points = BlueNoise::new(3, Constant(u));
    let pixel = |p| id([p % SIDE as u32, p / SIDE as u32], 0, 0);
    (0..PIXELS as u32).map(|p| (points.block(pixel(p), 0)[0] * 16_777_216.0) as u32).collect()
}

/// Each rank occurs once in the tile, and shifts are equal to the ranks.
#[test]
fn shifts_are_exact_and_stay_below_one() {
    for u in [0, 1 << 22, 3 << 22, (1 << 24) - 1] {
        let mut found = shifted(u as f32 / 16_777_216.0);
        let mut wanted: Vec<u32> = (0..PIXELS as u32).map(|rank| (u + rank * 1024) % (1 << 24)).collect();
        found.sort_unstable();
        wanted.sort_unstable();
        assert!(found == wanted, "{u}");
    }
}

#[test]
fn independence_is_that_of_the_inner_set() {
    assert!(BlueNoise::new(0, Random::new(0)).is_independent() && !BlueNoise::new(0, Sobol::new(0)).is_independent());
}

/// Each block of 32 x 32 pixels has equally many pixels below a threshold. Independent pixels, the negative control, deviate by
/// `sqrt(1024 p (1 - p))` pixels.
#[test]
fn every_threshold_is_evenly_spread() {
    let rms = |ranks: &[u16], below: usize| {
        let block = |b: usize| {
            let places = (0..1024).map(|k| (b / 4 * 32 + k / 32) * SIDE + b % 4 * 32 + k % 32);
            places.filter(|p| usize::from(ranks[*p]) < below).count() as f64
        };
        let wanted = 1024.0 * below as f64 / PIXELS as f64;
        ((0..16).map(|b| (block(b) - wanted).powi(2)).sum::<f64>() / 16.0).sqrt()
    };
    let ranks: Vec<u16> = shifted(0.0).iter().map(|steps| (steps / 1024) as u16).collect();
    let mut shuffled = ranks.clone();
    shuffled.sort_unstable_by_key(|rank| mix64(u64::from(*rank)));
    for share in [0.1, 0.25, 0.5, 0.75, 0.9_f64] {
        let below = (share * PIXELS as f64) as usize;
        let white = (1024.0 * share * (1.0 - share)).sqrt();
        let (found, control) = (rms(&ranks, below), rms(&shuffled, below));
        assert!(found < 0.3 * white, "{share}: {found:.2} pixels, {white:.2} for white noise");
        assert!((control / white - 1.0).abs() < 0.6, "{share}: the control has {control:.2}, not {white:.2}");
    }
}

type Integrand = fn(f64, f64) -> f64;

/// Two integrands on which no key was optimised, with their means.
const INTEGRANDS: [(&str, Integrand, f64); 2] =
    [("half-plane", |x, y| f64::from(u8::from(y < 0.3 + 0.4 * x)), 0.5), ("x y", |x, y| x * y, 0.25)];

/// The samples of [`BlueNoiseKeys`], with random keys in place of the optimised ones.
struct WhiteKeys(BlueNoiseKeys);

impl PointSet for WhiteKeys {
    fn describe(&self) -> String {
        "white keys".into()
    }

    fn block(&self, id: SampleId, block: u32) -> [f32; 4] {
        let shared = SampleId::new(id.pixel.map(|c| c / 64 * 64), id.stream, id.index);
        let [x, y] = halves(Seed::new(9).key(&id, block, 0));
        let of = self.0.block(shared, block);
        std::array::from_fn(|k| (((of[k] * 16_777_216.0) as u32) ^ [x, y][k % 2] >> 8) as f32 / 16_777_216.0)
    }
}

/// The energy of errors at low frequencies is compared with independent pixels. The mean square of 4096 block means has a
/// standard error of 2.2 %. Negative control: with random keys, errors are white noise.
#[test]
fn errors_of_keys_have_little_energy_at_low_frequencies() {
    let (optimised, white, independent) = (BlueNoiseKeys::new(3), WhiteKeys(BlueNoiseKeys::new(3)), Sobol::new(3));
    for ((what, f, mean), most) in INTEGRANDS.into_iter().zip([[0.45, 0.6, 0.9], [0.4, 0.2, 0.5]]) {
        for (spp, most) in [1, 4, 16].into_iter().zip(most) {
            let [of, control, alone] =
                [&optimised as &dyn PointSet, &white, &independent].map(|points| mean_squares(points, spp, f, mean));
            let found = of[1] / alone[1];
            assert!(found < most, "{what}, {spp} spp: {found:.3} of independent pixels");
            let blue = of[1] / of[0];
            assert!(blue < 0.75, "{what}, {spp} spp: {blue:.3} of white noise");
            let flat = control[1] / control[0];
            assert!((flat - 1.0).abs() < 0.15, "{what}, {spp} spp: the control has {flat:.3} of white noise");
        }
    }
}

/// Keys preserve nets, which shifts do not. Random keys preserve nets as well, with equally large errors.
#[test]
fn nets_that_stay_whole_have_less_error_than_shifted_ones() {
    let [_, (_, f, mean)] = INTEGRANDS;
    let shifted = mean_squares(&BlueNoise::new(3, Sobol::new(3)), 16, f, mean);
    let optimised = mean_squares(&BlueNoiseKeys::new(3), 16, f, mean);
    let white = mean_squares(&WhiteKeys(BlueNoiseKeys::new(3)), 16, f, mean);
    assert!(8.0 * optimised[0] < shifted[0], "{} and {}", optimised[0], shifted[0]);
    assert!(16.0 * optimised[1] < shifted[1], "{} and {}", optimised[1], shifted[1]);
    assert!((optimised[0] / white[0] - 1.0).abs() < 0.05, "{} and {}", optimised[0], white[0]);
    assert!(optimised[1] < 0.75 * white[1], "{} and {}", optimised[1], white[1]);
}

/// Returns the bits of a pixel's first coordinate, combined by exclusive or with its sample 0, which removes the pixel's key.
fn unkeyed(pixel: [u32; 2], block: u32, index: u64) -> u32 {
    let of = |index| (BlueNoiseKeys::new(3).block(id(pixel, 0, index), block)[0] * 16_777_216.0) as u32;
    of(index) ^ of(0)
}

#[test]
fn shuffles_keep_every_prefix_of_a_power_of_two() {
    let mut moved = 0;
    for block in 1..4 {
        for k in 0..10 {
            let [a, b] = [0, block].map(|block| (0..1 << k).map(|i| unkeyed([5, 70], block, i)).collect::<Vec<_>>());
            moved += a.iter().zip(&b).filter(|(a, b)| a != b).count();
            let sorted = [a, b].map(|mut points| {
                points.sort_unstable();
                points
            });
            assert_eq!(sorted[0], sorted[1], "2^{k}, block {block}");
        }
    }
    assert!(moved > 1000, "{moved} samples moved");
}

/// Returns the bits of sample 0 in the pixels of a tile. The upper 6 bits of x and y are the keys, up to a constant.
fn keyed() -> Vec<[u32; 2]> {
    let points = BlueNoiseKeys::new(3);
    let of = |p: u32| points.block(id([p % 64, p / 64], 0, 0), 0).map(|u| (u * 16_777_216.0) as u32);
    (0..64 * 64).map(of).map(|[x, y, ..]| [x >> 18, y >> 18]).collect()
}

#[test]
fn every_key_occurs_once() {
    let mut seen = vec![false; 64 * 64];
    for [x, y] in keyed() {
        assert!(!std::mem::replace(&mut seen[(y << 6 | x) as usize], true), "{x} {y} twice");
    }
}

/// A change of the tile changes every image of the point set.
#[test]
fn the_tile_never_changes() {
    let digest = keyed().iter().fold(0, |digest, [x, y]| mix64(digest ^ u64::from(y << 6 | x)));
    assert_eq!(digest, 0xbfdf_8215_3d24_24ce, "{digest:#x}");
}
