//! Independent halves: the only honest error estimate of low-discrepancy samples.

use super::image::Image;
use super::pairs::{in_turn, pairs};
use super::{Break, Effort, Error, Result, Row};
use dapple_core::samplers::Uniform;
use dapple_core::{Block, Draws, Estimate, Film, Frame, Integrator, Limits, Needs, Render, Worker};
use dapple_low_discrepancy::Sobol;

pub(crate) fn row(effort: Effort, image: &Image) -> Result<Row> {
    let count = match effort {
        Effort::Quick => 6,
        Effort::Full => 15,
    };
    let price = pairs(count, |number| {
        let [with, without] =
            in_turn(number, || image.seconds(Needs::none().with_halves()), || image.seconds(Needs::none()))?;
        Ok::<_, Error>(with / without)
    })?;
    Ok(Row {
        safeguard: "halves",
        does: "errors are predicted from two independently scrambled halves, on request",
        price,
        price_of: format!("{}; besides, two short sequences are less even than a long one", image.describe()),
        breaks: vec![predictions()?],
    })
}

const SIDE: u32 = 32;
const SPP: u64 = 16;

/// Pixels that brighten from one corner to the opposite one: `4 u v` times a level, which is their mean.
struct Smooth;

impl Smooth {
    fn level([x, y]: [u32; 2]) -> f64 {
        0.2 + f64::from(x + y) / f64::from(2 * SIDE)
    }
}

impl Integrator for Smooth {
    fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
        let [u, v, ..] = draws.block(Block::new(0));
        let value = Self::level(draws.pixel()) as f32 * 4.0 * u * v;
        Estimate::new([value; 3])
    }
}

/// The number of images whose predicted relMSE is off by more than a factor of 2, from halves and from the samples'
/// variance.
fn predictions() -> Result<Break> {
    const IMAGES: u64 = 16;
    let frame = Frame::new(SIDE, SIDE)?;
    let limits = Limits::samples(SPP * frame.pixels() as u64);
    let [mut without, mut with] = [0; 2];
    for seed in 0..IMAGES {
        let film =
            |needs| Render::new(frame, &limits).needs(needs).run(&mut Smooth, &mut Uniform::new(Sobol::new(seed)));
        let halves = film(Needs::none().with_halves())?;
        with += u64::from(is_off(halves.predicted_relmse().unwrap_or(f64::NAN), &halves));
        let whole = film(Needs::none().with_variance())?;
        without += u64::from(is_off(from_variance(&whole), &whole));
    }
    Ok(Break {
        input: format!(
            "smooth images of {SIDE}x{SIDE} pixels, {SPP} spp of sobol: predicted relMSE off by more than a factor of 2"
        ),
        seen: "--error renders many times as long as it must, and error maps show where the image is bright",
        of: IMAGES,
        without,
        with,
    })
}

/// The prediction for independent samples: variance over count.
fn from_variance(film: &Film) -> f64 {
    let pixels = film.frame().pixels();
    let of_pixel = |i: usize| {
        let (moments, mean) = (film.moments(i), film.mean(i)[0]);
        let variance = moments.variance().map_or(f64::NAN, |v| v[0]);
        variance / moments.count as f64 / (mean * mean + 0.01)
    };
    (0..pixels).map(of_pixel).sum::<f64>() / pixels as f64
}

fn is_off(predicted: f64, film: &Film) -> bool {
    let pixels = film.frame().pixels();
    let of_pixel = |i: usize| {
        let level = Smooth::level(film.frame().pixel(i));
        (film.mean(i)[0] - level).powi(2) / (level * level + 0.01)
    };
    let true_error = (0..pixels).map(of_pixel).sum::<f64>() / pixels as f64;
    !(0.5 * true_error..=2.0 * true_error).contains(&predicted)
}
