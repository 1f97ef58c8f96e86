//! Patterns in image, lens and time, after Mitchell.

use crate::Sobol;
use crate::diffused::{pattern_index, pattern_jitter};
use crate::keys::{Seed, mix64, nth_key};
use crate::pixel_pattern::{PIXELS, ROUNDS, STEPS, coordinate, neighbour, net, order, places};
use dapple_core::{PointSet, SampleId};
use std::sync::LazyLock;

/// Positions, lens points and times that are chosen together over pixels [after Mitchell 1991].
///
/// Mitchell extends blue noise to the dimensions of distribution ray tracing: samples that are near in the image shall
/// be far apart on the lens and in time. The construction here is ours, from his aim:
///
/// 1. Positions are those of [`Diffused`](crate::Diffused).
/// 2. A pattern of 64 x 64 pixels and 16 rounds is filled in random order. Each sample takes the best of 16 candidates for
///    lens and time. The best is farthest from its nearest sample, by `|dxy|^2 / 16 + |dlens|^2 + dtime^2` with `dxy` in
///    pixels.
///    Candidates are compared with samples of the same round up to 4 pixels away, and with the pixel's own.
/// 3. The candidates of a round are a net on the lens and strata of time, each used once. So each sample is uniform.
///
/// Block 0 holds position and lens, block [`Mitchell1991::TIME_BLOCK`] the time, as in Dapple's integrators. All other
/// coordinates are those of [`Sobol`].
///
/// ```
/// use dapple_core::{PointSet, SampleId};
/// use dapple_low_discrepancy::Mitchell1991;
///
/// let points = Mitchell1991::new(7);
/// let [time, ..] = points.block(SampleId::new([3, 4], 0, 5), Mitchell1991::TIME_BLOCK);
/// assert!((0.0..1.0).contains(&time));
/// ```
///
/// # Limits
///
/// * It gains at one to a few samples per pixel. At 16 and more, [`Sobol`] wins.
/// * The pattern is finite. Each tile of 64 x 64 pixels, and each 16 samples, take it at another offset, with seams.
/// * Distances, candidates and the order of pixels are not the published ones.
///
/// Name: `mitchell-1991`. Parameters: `seed`.
#[derive(Clone, Copy, Debug)]
pub struct Mitchell1991 {
    seed: Seed,
    inner: Sobol,
}

impl Mitchell1991 {
    /// The block whose first coordinate is the time within the exposure: that of Dapple's integrators.
    pub const TIME_BLOCK: u32 = 1 << 30;

    /// Makes the point set of a seed. The pattern is the same for all seeds, at another offset.
    pub fn new(seed: u64) -> Self {
        Self { seed: Seed::new(seed), inner: Sobol::new(seed) }
    }
}

impl PointSet for Mitchell1991 {
    fn describe(&self) -> String {
        format!("mitchell-1991:seed={}", self.seed.given())
    }

    fn block(&self, id: SampleId, block: u32) -> [f32; 4] {
        if block != 0 && block != Self::TIME_BLOCK {
            return self.inner.block(id, block);
        }
        let at = pattern_index(&self.seed, &id);
        let jitter = pattern_jitter(&self.seed, &id, block);
        let bits = |k: u32| (jitter >> (12 * k)) as u32;
        let [u, v, time] = lens_and_time()[at];
        if block == Self::TIME_BLOCK {
            let inner = self.inner.block(id, block);
            return [coordinate(time, bits(0)), inner[1], inner[2], inner[3]];
        }
        let [x, y] = places()[at];
        [coordinate(x, bits(0)), coordinate(y, bits(1)), coordinate(u, bits(2)), coordinate(v, bits(3))]
    }

    fn capacity(&self) -> u64 {
        self.inner.capacity()
    }

    fn couples_pixels(&self) -> bool {
        true
    }
}

/// Candidates for each sample. Our choice.
const CANDIDATES: u64 = 16;
/// The distance in pixels up to which samples are compared, and the unit of distances in the image. Our choice.
const REACH: i32 = 4;

/// Lens point and time of each sample of the pattern, in steps: for each round all pixels, row by row.
fn lens_and_time() -> &'static [[u16; 3]] {
    static ALL: LazyLock<Vec<[u16; 3]>> = LazyLock::new(spread_lens_and_time);
    &ALL
}

/// A sample of the pattern in units of pixels, apertures and exposures.
type Sample = [f32; 5];

fn sample(place: [u16; 2], by: [i32; 2], values: [u16; 3]) -> Sample {
    let unit = |step: u16| (f32::from(step) + 0.5) / STEPS as f32;
    let place = [0, 1].map(|k| (unit(place[k]) + by[k] as f32) / REACH as f32);
    [place[0], place[1], unit(values[0]), unit(values[1]), unit(values[2])]
}

fn distance(a: &Sample, b: &Sample) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
}

fn spread_lens_and_time() -> Vec<[u16; 3]> {
    let places = places();
    let mut all: Vec<[u16; 3]> = Vec::with_capacity(ROUNDS * PIXELS);
    for round in 0..ROUNDS {
        let (first, salt) = (round * PIXELS, (ROUNDS + round) as u64);
        let mut pool: Vec<[u16; 3]> =
            net(mix64(!salt)).iter().zip(order(3 * salt)).map(|([u, v], time)| [*u, *v, time as u16]).collect();
        let mut now: Vec<Option<[u16; 3]>> = vec![None; PIXELS];
        for pixel in order(2 * salt) {
            let mut near = Vec::with_capacity(128);
            for by in (-REACH..=REACH).flat_map(|dy| (-REACH..=REACH).map(move |dx| [dx, dy])) {
                let from = neighbour(pixel, by);
                near.extend(now[from].map(|values| sample(places[first + from], by, values)));
            }
            near.extend((0..round).map(|r| r * PIXELS + pixel).map(|at| sample(places[at], [0, 0], all[at])));
            let key = nth_key(mix64(pixel as u64), salt);
            let candidate = |c| (nth_key(key, c) % pool.len() as u64) as usize;
            let nearest = |at: usize| {
                let at = sample(places[first + pixel], [0, 0], pool[at]);
                near.iter().map(|other| distance(&at, other)).fold(f32::INFINITY, f32::min)
            };
            let best =
                (0..CANDIDATES).map(candidate).map(|at| (nearest(at), at)).reduce(|a, b| if b.0 > a.0 { b } else { a });
            now[pixel] = Some(pool.swap_remove(best.map_or(0, |best| best.1)));
        }
        all.extend(now.into_iter().flatten());
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Random, Stratified};

    const SIZE: u32 = 64;

    /// An image of one value per pixel, less its expected mean of 1/2.
    fn image(value: impl Fn(u32, u32) -> f64) -> Vec<f64> {
        (0..SIZE * SIZE).map(|p| value(p % SIZE, p / SIZE) - 0.5).collect()
    }

    /// The image's mean power at frequencies below half of the Nyquist frequency, over its variance: white noise has 1.
    fn low_power(image: &[f64]) -> f64 {
        let (mut sum, mut count) = (0.0, 0.0);
        for (u, v) in (0..16_i32).flat_map(|v| (-15..16_i32).map(move |u| (u, v))) {
            if (u, v) == (0, 0) || u * u + v * v >= 256 {
                continue;
            }
            let (mut re, mut im) = (0.0, 0.0);
            for (p, value) in image.iter().enumerate() {
                let [x, y] = [p as i32 % SIZE as i32, p as i32 / SIZE as i32];
                let phase = std::f64::consts::TAU * f64::from((u * x + v * y) % SIZE as i32) / f64::from(SIZE);
                re += value * phase.cos();
                im += value * phase.sin();
            }
            sum += re * re + im * im;
            count += 1.0;
        }
        sum / count / image.iter().map(|x| x * x).sum::<f64>()
    }

    #[test]
    fn lens_and_time_have_little_power_at_low_frequencies() {
        let power = |points: &dyn PointSet, block, lane: usize| {
            low_power(&image(|x, y| f64::from(points.block(SampleId::new([x, y], 0, 0), block)[lane])))
        };
        for (block, lane) in [(0, 2), (0, 3), (Mitchell1991::TIME_BLOCK, 0)] {
            let ours = power(&Mitchell1991::new(1), block, lane);
            let white = power(&Random::new(1), block, lane);
            assert!(ours < 0.75, "block {block}, lane {lane}: {ours:.3} of white noise");
            // 372 frequencies: a standard error of 0.05.
            assert!((white - 1.0).abs() < 0.2, "block {block}, lane {lane}: the control has {white:.3}");
        }
    }

    /// A half-plane whose edge crosses the whole image during the exposure, one sample per pixel: covered if the time is
    /// below a ramp. After a box of 4 x 4 pixels its error is below that of independent and of jittered samples.
    #[test]
    fn a_moving_edge_has_less_error_after_a_box_filter() {
        let error = |points: &dyn PointSet, seed_column: u32| {
            let covered = |x: u32, y: u32| {
                let id = SampleId::new([seed_column * SIZE + x, y], 0, 0);
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
}
