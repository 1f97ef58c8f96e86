//! Safeguards of the film: precise statistics, and rejection of invalid samples.

use super::image::Image;
use super::pairs::{in_turn, of_whole, pairs, seconds};
use super::{Break, Effort, Ratio, Result, Row};
use dapple_core::{
    Draws, Estimate, Frame, Integrator, Limits, Needs, RejectedReason, Render, RgbMoments, SampleId, Worker,
};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::hint::black_box;

/// A pixel of a typical small renderer: sums and sums of squares in f32.
#[derive(Clone, Copy, Default)]
struct Sums {
    count: u32,
    sum: [f32; 3],
    squares: [f32; 3],
}

impl Sums {
    #[inline]
    fn push(&mut self, value: [f32; 3]) {
        self.count += 1;
        for (c, x) in value.into_iter().enumerate() {
            self.sum[c] += x;
            self.squares[c] += x * x;
        }
    }

    fn mean(&self) -> f64 {
        f64::from(self.sum[0] / self.count as f32)
    }

    fn variance(&self) -> f64 {
        let n = self.count as f32;
        f64::from((self.squares[0] - self.sum[0] * self.sum[0] / n) / (n - 1.0))
    }
}

/// Samples per pixel of the sums.
const SPP: usize = 16;

/// Samples to sum up, in the order of pixels.
fn noise() -> Vec<[f32; 3]> {
    let mut rng = Pcg64Mcg::seed_from_u64(5);
    (0..4096 * SPP).map(|_| std::array::from_fn(|_| rng.random_range(0.0..2.0))).collect()
}

/// The price of a part of the work on each sample, relative to a whole render.
fn of_render<A, B>(
    effort: Effort,
    image: &Image,
    mut with: impl FnMut(&[[f32; 3]]) -> A,
    mut without: impl FnMut(&[[f32; 3]]) -> B,
) -> Result<(Ratio, f64)> {
    let (count, runs) = match effort {
        Effort::Quick => (6, 4),
        Effort::Full => (15, 64),
    };
    let samples = noise();
    let per_sample = 1.0 / (samples.len() * runs) as f64;
    let mut parts = Vec::new();
    let ratio = pairs(count, |number| {
        let [with, without] = in_turn(
            number,
            || Ok::<_, super::Error>(seconds(|| (0..runs).for_each(|_| drop(black_box(with(black_box(&samples))))))),
            || Ok(seconds(|| (0..runs).for_each(|_| drop(black_box(without(black_box(&samples))))))),
        )?;
        let part = (with - without) * per_sample;
        parts.push(part * 1e9);
        Ok::<_, super::Error>(of_whole(image.seconds(Needs::none())? / image.samples() as f64, part))
    })?;
    Ok((ratio, Ratio::of(parts).median))
}

/// Statistics in f64 by Welford's method, against sums in f32.
pub(crate) fn sums(effort: Effort, image: &Image) -> Result<Row> {
    let (price, part) = of_render(
        effort,
        image,
        |samples| {
            let mut pixels = vec![RgbMoments::default(); samples.len() / SPP];
            for (pixel, samples) in pixels.iter_mut().zip(samples.chunks(SPP)) {
                samples.iter().for_each(|sample| pixel.push(*sample));
            }
            pixels
        },
        |samples| {
            let mut pixels = vec![Sums::default(); samples.len() / SPP];
            for (pixel, samples) in pixels.iter_mut().zip(samples.chunks(SPP)) {
                samples.iter().for_each(|sample| pixel.push(*sample));
            }
            pixels
        },
    )?;
    Ok(Row {
        safeguard: "film",
        does: "means and variances are kept in f64, by Welford's steps",
        price,
        price_of: format!("{}: {part:.1} ns a sample more than f32 sums of values and squares", image.describe()),
        breaks: vec![variances(), means()],
    })
}

/// Bright, smooth pixels whose variance is off by more than a factor of two.
fn variances() -> Break {
    const PIXELS: usize = 1000;
    let mut rng = Pcg64Mcg::seed_from_u64(6);
    let [mut without, mut with] = [0; 2];
    for _ in 0..PIXELS {
        let samples: [f32; SPP] = std::array::from_fn(|_| rng.random_range(999.9..1000.1));
        let mean = samples.iter().map(|x| f64::from(*x)).sum::<f64>() / SPP as f64;
        let exact = samples.iter().map(|x| (f64::from(*x) - mean).powi(2)).sum::<f64>() / (SPP - 1) as f64;
        let wrong = |variance: f64| !(0.5 * exact..=2.0 * exact).contains(&variance);
        let (mut sums, mut moments) = (Sums::default(), RgbMoments::default());
        for x in samples {
            sums.push([x; 3]);
            moments.push([x; 3]);
        }
        without += u64::from(wrong(sums.variance()));
        with += u64::from(wrong(moments.variance().map_or(f64::NAN, |v| v[0])));
    }
    Break {
        input: format!("pixels of radiance 1000 +- .1, {SPP} spp: their variance off by more than a factor of 2"),
        seen: "samples go where nothing is noisy, or stop where something is; error estimates are negative",
        of: PIXELS as u64,
        without,
        with,
    }
}

/// Pixels of one colour, many samples.
fn means() -> Break {
    const PIXELS: u32 = 16;
    const MANY: u32 = 1 << 20;
    let [mut without, mut with] = [0; 2];
    for pixel in 1..=PIXELS {
        let radiance = 0.1 * pixel as f32;
        let wrong = |mean: f64| (mean / f64::from(radiance) - 1.0).abs() > 1e-3;
        let (mut sums, mut moments) = (Sums::default(), RgbMoments::default());
        for _ in 0..MANY {
            let sample = black_box([radiance; 3]);
            sums.push(sample);
            moments.push(sample);
        }
        without += u64::from(wrong(sums.mean()));
        with += u64::from(wrong(moments.mean[0]));
    }
    Break {
        input: "pixels of one colour, .1 to 1.6, 2^20 spp: more than .1 % off".to_owned(),
        seen: "references and merged shards drift by up to a percent, each colour by another",
        of: PIXELS.into(),
        without,
        with,
    }
}

/// The test that each sample is a valid radiance.
pub(crate) fn invalid(effort: Effort, image: &Image) -> Result<Row> {
    let (price, part) = of_render(
        effort,
        image,
        |samples| {
            let mut pixels = vec![RgbMoments::default(); samples.len() / SPP];
            let mut rejected = 0_u64;
            for (pixel, samples) in pixels.iter_mut().zip(samples.chunks(SPP)) {
                for sample in samples {
                    let radiance = match RejectedReason::of(*sample) {
                        None => *sample,
                        Some(_) => {
                            rejected += 1;
                            [0.0; 3]
                        }
                    };
                    pixel.push(radiance);
                }
            }
            (pixels, rejected)
        },
        |samples| {
            let mut pixels = vec![RgbMoments::default(); samples.len() / SPP];
            for (pixel, samples) in pixels.iter_mut().zip(samples.chunks(SPP)) {
                samples.iter().for_each(|sample| pixel.push(*sample));
            }
            (pixels, 0)
        },
    )?;
    Ok(Row {
        safeguard: "invalid",
        does: "samples that are NaN, infinite or negative are rejected, counted and listed",
        price,
        price_of: format!("{}: {part:.1} ns a sample", image.describe()),
        breaks: vec![holes()?],
    })
}

/// A grey image in which three samples are invalid.
struct Faulty;

const SIDE: u32 = 64;

impl Faulty {
    fn radiance(pixel: [u32; 2], index: u64) -> [f32; 3] {
        match (pixel, index) {
            ([9, 20], 3) => [f32::NAN, 1.0, 1.0],
            ([31, 31], 0) => [1.0, f32::INFINITY, 1.0],
            ([50, 7], 15) => [1.0, 1.0, -1e6],
            _ => [1.0; 3],
        }
    }
}

impl Integrator for Faulty {
    fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
        let SampleId { pixel, index, .. } = draws.id();
        Estimate::new(Self::radiance(pixel, index))
    }
}

/// Invalid pixels in an image smoothed over 5x5 pixels, caused by three invalid samples.
fn holes() -> Result<Break> {
    let frame = Frame::new(SIDE, SIDE)?;
    let limits = Limits::samples(u64::from(SIDE * SIDE) * SPP as u64);
    let film = Render::new(frame, &limits).run(&mut Faulty, &mut Image::sampler())?;
    let with: Vec<[f64; 3]> = (0..frame.pixels()).map(|i| film.mean(i)).collect();
    let without: Vec<[f64; 3]> = (0..frame.pixels())
        .map(|i| {
            let mut moments = RgbMoments::default();
            (0..SPP as u64).for_each(|index| moments.push(Faulty::radiance(frame.pixel(i), index)));
            moments.mean
        })
        .collect();
    Ok(Break {
        input: format!(
            "three bad samples (NaN, infinite, -1e6) of {}, smoothed over 5x5 pixels: pixels that are no radiance",
            SIDE * SIDE * SPP as u32
        ),
        seen: "black or white squares in the image; its exposure, error and denoiser see nothing else",
        of: frame.pixels() as u64,
        without: no_radiance(&without),
        with: no_radiance(&with),
    })
}

fn no_radiance(image: &[[f64; 3]]) -> u64 {
    let side = SIDE as usize;
    let around = |i: usize| i.saturating_sub(2)..(i + 3).min(side);
    let wrong = |(x, y): &(usize, usize)| {
        let mut sum = [0.0; 3];
        let window = around(*y).flat_map(|y| around(*x).map(move |x| image[y * side + x]));
        window.for_each(|value| (0..3).for_each(|c| sum[c] += value[c]));
        sum.iter().any(|s| !(s.is_finite() && *s >= 0.0))
    };
    (0..side).flat_map(|y| (0..side).map(move |x| (x, y))).filter(wrong).count() as u64
}
