//! Edges of lamps, whose emission samples of features alone refine.

use dapple_core::samplers::Uniform;
use dapple_core::{Block, Draws, Estimate, Film, Filter, FirstHit, Frame, Integrator, Limits, Needs, Render, Worker};
use dapple_denoise::{Bilateral, ClusterRegression};
use dapple_low_discrepancy::Sobol;

const SIDE: u32 = 48;
const LAMP: f32 = 20.0;
const WALL: f32 = 0.1;
const PLACE: Block = Block::new(0);
const LIGHT: Block = Block::new(1);

/// A square lamp within a wall of the same normal, depth and albedo. Its edges cross pixels at 0.3 and 0.6 of their width.
struct Edge {
    /// False for an integrator whose samples of features alone report no emission.
    alone: bool,
}

impl Edge {
    fn is_lit([x, y]: [f64; 2]) -> bool {
        (16.3..32.6).contains(&x) && (16.3..32.6).contains(&y)
    }

    fn emission(draws: &Draws<'_>) -> [f32; 3] {
        let ([x, y], [u, v, ..]) = (draws.pixel(), draws.block(PLACE));
        let place = [f64::from(x) + f64::from(u), f64::from(y) + f64::from(v)];
        if Self::is_lit(place) { [LAMP; 3] } else { [0.0; 3] }
    }

    fn hit() -> FirstHit {
        FirstHit::new([0.0; 3], [0.0, 0.0, 1.0], 1.0).with_albedo([0.5; 3])
    }
}

impl Integrator for Edge {
    fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
        let emission = Self::emission(draws);
        let [u, ..] = draws.block(LIGHT);
        let estimate = Estimate::new(emission.map(|e| e + 2.0 * WALL * u)).with_first_hit(Self::hit());
        estimate.with_emission(emission)
    }

    fn features_alone(&self, draws: &Draws<'_>) -> Option<Estimate> {
        let estimate = Estimate::new([0.0; 3]).with_first_hit(Self::hit());
        Some(if self.alone { estimate.with_emission(Self::emission(draws)) } else { estimate })
    }
}

fn film(alone: bool, spp: f64, needs: Needs) -> Film {
    let (frame, limits) = (Frame::new(SIDE, SIDE).unwrap(), Limits::spp(spp));
    Render::new(frame, &limits).needs(needs).run(&mut Edge { alone }, &mut Uniform::new(Sobol::new(4))).unwrap()
}

/// The share of a pixel that the lamp covers.
fn covered(pixel: usize) -> f64 {
    let side = SIDE as usize;
    let along = |x: usize| match x {
        16 => 0.7,
        17..32 => 1.0,
        32 => 0.6,
        _ => 0.0,
    };
    along(pixel % side) * along(pixel / side)
}

/// The mean squared error of the pixels that the lamp covers partly, and that of their neighbours on the wall.
fn errors(filter: &dyn Filter, alone: bool, spp: f64) -> [f64; 2] {
    let image = filter.apply(&film(alone, spp, filter.needs())).unwrap();
    let square = |i: usize| {
        let wanted = covered(i) * f64::from(LAMP) + f64::from(WALL);
        (f64::from(image.radiance[i][0]) - wanted).powi(2)
    };
    let ring = |i: &usize| {
        let [x, y] = [i % SIDE as usize, i / SIDE as usize];
        let outer = |n: usize| (15..=33).contains(&n);
        outer(x) && outer(y) && (x == 15 || x == 33 || y == 15 || y == 33)
    };
    let mean = |of: Vec<usize>| of.iter().map(|&i| square(i)).sum::<f64>() / of.len() as f64;
    let all = || 0..(SIDE * SIDE) as usize;
    let edge = |i: &usize| covered(*i) > 0.0 && covered(*i) < 1.0;
    [mean(all().filter(edge).collect()), mean(all().filter(ring).collect())]
}

#[test]
fn edges_of_lamps_have_a_fraction_of_the_error_if_features_alone_report_emission() {
    let filters: [Box<dyn Filter>; 2] = [Box::new(ClusterRegression::new()), Box::new(Bilateral::default())];
    for filter in filters {
        for (spp, most) in [(1.0, [0.02, 0.005]), (4.0, [0.02, 0.005]), (16.0, [0.15, 0.05])] {
            let [without, with] = [false, true].map(|alone| errors(&*filter, alone, spp));
            let name = filter.describe();
            for (k, what) in ["at the edge", "beside it"].into_iter().enumerate() {
                let ratio = with[k] / without[k];
                assert!(
                    ratio < most[k],
                    "{name}, {spp} spp: {ratio} of the error {what}, {} to {}",
                    without[k],
                    with[k]
                );
            }
        }
    }
}

/// A small lamp in each pixel, at a place of its own, that covers 4 % of it.
struct Dots;

impl Dots {
    fn emission(draws: &Draws<'_>) -> [f32; 3] {
        let ([x, y], [u, v, ..]) = (draws.pixel(), draws.block(PLACE));
        let place = [x * 37 % 64 + y * 11 % 64, x * 23 % 64 + y * 53 % 64].map(|n| 0.8 * (n % 64) as f32 / 64.0);
        let is_lit = (0.0..0.2).contains(&(u - place[0])) && (0.0..0.2).contains(&(v - place[1]));
        if is_lit { [LAMP; 3] } else { [0.0; 3] }
    }
}

impl Integrator for Dots {
    fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
        let emission = Self::emission(draws);
        Estimate::new(emission).with_first_hit(Edge::hit()).with_emission(emission)
    }

    fn features_alone(&self, draws: &Draws<'_>) -> Option<Estimate> {
        Some(Estimate::new([0.0; 3]).with_first_hit(Edge::hit()).with_emission(Self::emission(draws)))
    }
}

/// Later samples of a low-discrepancy sequence lie where earlier ones leave gaps. If those that find an edge were of the same
/// sequence, the others would miss the lamp. The error is at most 4 standard errors (a false alarm in 15,000 seeds), 1.8 % of the
/// light; the pixels' own errors are not independent of the place of their lamp, so that the bound is on the safe side.
#[test]
fn refined_means_of_sobol_samples_keep_the_light() {
    const SIDE: u32 = 512;
    let needs = Needs::none().with_halves().with_features().with_emission();
    let (frame, limits) = (Frame::new(SIDE, SIDE).unwrap(), Limits::spp(4.0));
    let film = Render::new(frame, &limits).needs(needs).run(&mut Dots, &mut Uniform::new(Sobol::new(9))).unwrap();
    let n = f64::from(SIDE * SIDE);
    let values: Vec<f64> = (0..(SIDE * SIDE) as usize).map(|i| film.refined_mean(i)[0]).collect();
    let mean = values.iter().sum::<f64>() / n;
    let error = (values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / n / n).sqrt();
    let wanted = 0.04 * f64::from(LAMP);
    assert!((mean - wanted).abs() < 4.0 * error && error < 0.005 * wanted, "{mean} +- {error}, not {wanted}");
}
