//! Samples distributed jointly over pixels.

use crate::support::id;
use dapple_core::PointSet;
use dapple_low_discrepancy::{Diffused, Mitchell1991, Random, Stratified};
use dapple_metrics::{SpectrumRing, image_spectrum, point_spectrum};

/// Returns the mean power at frequencies from `from` to `to`; it is 1 for white noise and independent points.
fn mean_power(rings: &[SpectrumRing], from: f64, to: f64) -> f64 {
    let inside = || rings.iter().filter(|ring| (from..to).contains(&ring.frequency));
    let count = inside().map(|ring| ring.count).sum::<usize>();
    inside().map(|ring| ring.power * ring.count as f64).sum::<f64>() / count as f64
}

/// The power is below 0.1 of white noise under a quarter of the Nyquist frequency (32 steps). Around the Nyquist frequency, it
/// is below half of a jittered grid's, which is `random` with independent positions.
#[test]
fn positions_have_little_power_up_to_the_nyquist_frequency() {
    for seed in 0..3 {
        // The sample positions of 64 x 64 pixels.
        let of = |points: &dyn PointSet| {
            let place = |p: u32| {
                let [x, y, ..] = points.block(id([p % 64, p / 64], 0, 0), 0).map(f64::from);
                [(f64::from(p % 64) + x) / 64.0, (f64::from(p / 64) + y) / 64.0]
            };
            point_spectrum(&(0..64 * 64).map(place).collect::<Vec<_>>(), 40)
        };
        let [ours, jittered] = [of(&Diffused::new(seed)), of(&Random::new(seed))];
        let low = mean_power(&ours, 0.5, 8.0);
        assert!(low < 0.1, "seed {seed}: {low:.3} of white noise");
        let [ours, jittered] = [ours, jittered].map(|rings| mean_power(&rings, 20.0, 40.0));
        assert!(ours < 0.5 * jittered, "seed {seed}: {ours:.3}, jittered {jittered:.3}");
    }
}

/// Each position of a round is used by one pixel of the pattern.
#[test]
fn each_round_is_a_net() {
    let points = Diffused::new(0);
    for round in 0..16 {
        let place = |p: u32| points.block(id([p % SIZE, p / SIZE], 0, round), 0).map(|u| (u * 4096.0) as usize);
        for (columns, rows) in [(12, 0), (6, 6), (0, 12), (9, 3)] {
            let mut seen = vec![false; 4096];
            for [x, y, ..] in (0..SIZE * SIZE).map(place) {
                let cell = x >> (12 - columns) << rows | y >> (12 - rows);
                assert!(!std::mem::replace(&mut seen[cell], true), "2^{columns} x 2^{rows}");
            }
        }
    }
}

const SIZE: u32 = 64;

#[test]
fn lens_and_time_have_little_power_at_low_frequencies() {
    let power = |points: &dyn PointSet, block, lane: usize| {
        let at = |p: u32| f64::from(points.block(id([p % SIZE, p / SIZE], 0, 0), block)[lane]);
        let rings = image_spectrum([SIZE; 2], &(0..SIZE * SIZE).map(at).collect::<Vec<_>>()).unwrap();
        // Below half of the Nyquist frequency.
        mean_power(&rings, 0.0, 0.25)
    };
    for (block, lane) in [(0, 2), (0, 3), (Mitchell1991::TIME_BLOCK, 0)] {
        let ours = power(&Mitchell1991::new(1), block, lane);
        let white = power(&Random::new(1), block, lane);
        assert!(ours < 0.75, "block {block}, lane {lane}: {ours:.3} of white noise");
        // 372 frequencies: a standard error of 0.05.
        assert!((white - 1.0).abs() < 0.2, "block {block}, lane {lane}: the control has {white:.3}");
    }
}

/// The edge of a half-plane crosses the whole image during the exposure; a sample is covered if its time is below a ramp. At
/// one sample per pixel, after a box filter of 4 x 4 pixels, the error is below independent and jittered samples.
#[test]
fn a_moving_edge_has_less_error_after_a_box_filter() {
    let error = |points: &dyn PointSet, seed_column: u32| {
        let covered = |x: u32, y: u32| {
            let id = id([seed_column * SIZE + x, y], 0, 0);
            let [place, ..] = points.block(id, 0);
            let [time, ..] = points.block(id, Mitchell1991::TIME_BLOCK);
            f64::from(u8::from(time < (x as f32 + place) / SIZE as f32))
        };
        let block = |b: u32| {
            let pixels = (0..16).map(|k| (b % 16 * 4 + k % 4, b / 16 * 4 + k / 4));
            let (found, wanted) = pixels.fold((0.0, 0.0), |(found, wanted), (x, y)| {
                (found + covered(x, y), wanted + (f64::from(x) + 0.5) / f64::from(SIZE))
            });
            ((found - wanted) / 16.0).powi(2)
        };
        (0..256).map(block).sum::<f64>() / 256.0
    };
    let mean = |points: &dyn PointSet| (0..4).map(|c| error(points, c)).sum::<f64>() / 4.0;
    let ours = mean(&Mitchell1991::new(1));
    let [random, jittered] = [mean(&Random::new(1)), mean(&Stratified::new(1, 4).unwrap())];
    assert!(ours < 0.8 * random && ours < 0.8 * jittered, "{ours:.6} against {random:.6} and {jittered:.6}");
}
