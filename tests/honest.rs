//! Whether what is said of errors is so: HARD_CASES A13 and T03.

use dapple::core::{
    Block, Draws, Estimate, Film, Frame, Integrator, Limits, Needs, NoWatch, Observed, Sampler, render,
};
use dapple::metrics::{ratio_interval, student_t_quantile};
use dapple::renderer::registry::{self, Setting};
use dapple::renderer::{Stage, World, bundled, integrator};

/// The same noise in every pixel: exponential, of mean and variance 1.
struct EqualNoise;

impl Integrator for EqualNoise {
    fn estimate(&self, draws: &Draws<'_>, _: &mut Observed) -> Estimate {
        let [u, ..] = draws.block(Block::new(0));
        Estimate { radiance: [-(1.0 - u).ln(); 3], first_hit: None, cost: 1 }
    }
}

fn sampler(words: &str, points: &str, seed: u64) -> Box<dyn Sampler> {
    let points = registry::points(points, Setting { seed, spp: None }).expect("points");
    registry::sampler(words, points, &Stage::empty()).expect("a sampler")
}

fn mse_of_one(film: &Film) -> f64 {
    let pixels = film.frame().pixels();
    (0..pixels).map(|i| (film.mean(i)[0] - 1.0).powi(2)).sum::<f64>() / pixels as f64
}

/// Of independent points over uniform counts, 95 % interval of the ratio of MSE, 24 seeds.
fn lost(words: &str) -> [f64; 3] {
    const SEEDS: u64 = 24;
    let frame = Frame::new(48, 48).expect("a frame");
    let limits = Limits::samples(32 * frame.pixels() as u64);
    let errors = |words: &str| -> Vec<f64> {
        let run = |seed| {
            let mut sampler = sampler(words, "random", seed);
            render(&mut EqualNoise, &mut *sampler, Needs::none(), frame, &limits, &mut NoWatch).expect("a film")
        };
        (1..=SEEDS).map(|seed| mse_of_one(&run(seed))).collect()
    };
    let found = ratio_interval(&errors(words), &errors("uniform"), 0.95).expect("seeds");
    [found.low, found.value, found.high]
}

/// Where nothing can be won, little is lost: an upper 95 % bound of 1.05 of uniform's MSE at 32 spp.
#[test]
fn a13_no_free_lunch_lost() {
    let [_, value, high] = lost("variance");
    assert!(high <= 1.05, "variance: {value} up to {high}");
    // Negative control: contrast in a pixel's own samples says nothing here, and to follow it costs a lot.
    let [low, value, _] = lost("mitchell:mode=budget");
    assert!(low > 1.05, "mitchell: {value}, from {low}");
}

const SIDE: u32 = 32;

/// The bundled Cornell box with halves, `spp` samples per pixel.
fn cornell(world: &World, points: &str, seed: u64, spp: u64, needs: Needs) -> Film {
    let frame = Frame::new(SIDE, SIDE).expect("a frame");
    let limits = Limits::samples(spp * frame.pixels() as u64);
    let mut sampler = sampler("uniform", points, seed);
    render(&mut *integrator(world), &mut *sampler, needs, frame, &limits, &mut NoWatch).expect("a film")
}

/// Share of pixels and channels whose 95 % interval holds the reference, with forecasts pooled over 8x8 pixels, and the
/// root of what was forecast over what is so.
fn forecast(films: &[Film], reference: &[[f64; 3]], noise: &[[f64; 3]], widen: f64) -> [f64; 2] {
    let quantile = student_t_quantile(0.975, 64.0);
    let (mut held, mut all, mut told, mut real) = (0.0, 0.0, 0.0, 0.0);
    for film in films {
        for block in 0..(SIDE / 8 * SIDE / 8) as usize {
            let (x, y) = (block % (SIDE as usize / 8) * 8, block / (SIDE as usize / 8) * 8);
            let pixels: Vec<usize> = (0..64).map(|i| (y + i / 8) * SIDE as usize + x + i % 8).collect();
            for c in 0..3 {
                let variance = pixels.iter().map(|&i| film.squared_error(i).expect("halves")[c]).sum::<f64>() / 64.0;
                for &i in &pixels {
                    let off = film.mean(i)[c] - reference[i][c];
                    let reach = (widen * quantile * variance.sqrt()).hypot(1.96 * noise[i][c].sqrt());
                    held += f64::from(u8::from(off.abs() <= reach));
                    all += 1.0;
                    told += widen * widen * variance;
                    real += off * off - noise[i][c];
                }
            }
        }
    }
    [held / all, (told / real).sqrt()]
}

/// Intervals of 95 % hold 93 to 97 % over 64 seeds, and forecasts are within a tenth of what is so.
#[test]
fn t03_honest_forecast() {
    let scene = bundled::files("cornell").expect("bundled").read().expect("it reads");
    let world = World::with_resolution(&scene, [SIDE; 2]).expect("sound");
    let exact = cornell(&world, "random", 1 << 32, 4096, Needs::none().with_variance());
    let pixels = (SIDE * SIDE) as usize;
    let reference: Vec<[f64; 3]> = (0..pixels).map(|i| exact.mean(i)).collect();
    let noise: Vec<[f64; 3]> =
        (0..pixels).map(|i| exact.moments(i).variance().expect("many samples").map(|v| v / 4096.0)).collect();
    let films: Vec<Film> =
        (1..=64).map(|seed| cornell(&world, "sobol", seed, 16, Needs::none().with_halves())).collect();
    let [share, ratio] = forecast(&films, &reference, &noise, 1.0);
    assert!((0.93..=0.97).contains(&share) && (0.9..=1.1).contains(&ratio), "{share} held, forecast / real {ratio}");
    // Negative control: a sixth off is noticed.
    for widen in [0.85, 1.18] {
        let [share, ratio] = forecast(&films, &reference, &noise, widen);
        assert!(!((0.93..=0.97).contains(&share) && (0.9..=1.1).contains(&ratio)), "{widen}: {share} {ratio}");
    }
}
