//! Halves that pixels lack beside lamps.

use super::LAMP;
use crate::inputs::Inputs;
use crate::light::Light;
use crate::parameters::Reads;
use dapple_core::samplers::Uniform;
use dapple_core::{Block, Draws, Estimate, Film, FirstHit, Frame, Integrator, Limits, Needs, Render, Worker};
use dapple_low_discrepancy::Sobol;

const SIDE: usize = 48;
const WALL: f32 = 0.25;
const PLACE: Block = Block::new(0);

/// A wall, and a lamp of this radiance, from this place in column 20 to the end of column 29.
struct Lamp(f32, f32);

impl Lamp {
    fn emission(&self, draws: &Draws<'_>) -> [f32; 3] {
        let ([x, _], [u, ..]) = (draws.pixel(), draws.block(PLACE));
        [if (self.1..30.0).contains(&(x as f32 + u)) { self.0 } else { 0.0 }; 3]
    }
}

impl Integrator for Lamp {
    fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
        let (emission, hit) = (self.emission(draws), FirstHit::new([0.0; 3], [0.0, 0.0, 1.0], 1.0));
        Estimate::new(emission.map(|e| e + WALL)).with_first_hit(hit.with_albedo([0.5; 3])).with_emission(emission)
    }

    fn features_alone(&self, draws: &Draws<'_>) -> Option<Estimate> {
        Some(self.estimate(draws, &mut Worker::default()))
    }
}

/// One sample per pixel, the planes of its film, and the red of pixel `i` in the half that it lacks and in the other.
fn rendered(lamp: Lamp) -> (Film, Inputs, impl Fn(&Inputs, usize) -> [f32; 2]) {
    let needs = Needs::none().with_variance().with_halves().with_features().with_emission();
    let (frame, limits) = (Frame::new(SIDE as u32, SIDE as u32).unwrap(), Limits::spp(1.0));
    let (mut lamp, mut sampler) = (lamp, Uniform::new(Sobol::new(4)));
    let film = Render::new(frame, &limits).needs(needs).run(&mut lamp, &mut sampler).unwrap();
    let inputs = Inputs::new(Light::all(&film), &Reads::default());
    let halves = |inputs: &Inputs, i: usize| {
        let own = (i % SIDE + i / SIDE) % 2;
        [1 - own, own].map(|half| inputs.halves[half].colour[0][i] * inputs.level())
    };
    (film, inputs, halves)
}

/// The pixels at the edge, but for those at the border of the image.
fn edge() -> impl Iterator<Item = usize> {
    (1..SIDE - 1).map(|y| y * SIDE + 20)
}

#[test]
fn the_half_that_a_pixel_lacks_has_emission_of_its_own_samples() {
    let (film, inputs, halves) = rendered(Lamp(40.0, 20.37));
    let alone = |half, i| film.emission_alone(half, i).unwrap().1[0];
    assert!(edge().any(|i| alone(0, i) != alone(1, i)), "both halves are alike everywhere");
    for i in edge() {
        let unused = usize::from(film.half(0, i).unwrap().count > 0);
        let [lacking, own] = halves(&inputs, i);
        let wanted = alone(unused, i) + WALL;
        assert!((lacking - wanted).abs() < 1e-3 * wanted, "{lacking}, not {wanted}; {own} in the other half");
    }
}

/// Four samples miss a lamp that covers a tenth of a pixel in two of three pixels. Their light must not end at the lamp beside
/// them.
#[test]
fn pixels_that_may_hide_an_edge_get_light_of_the_lamp_beside_them() {
    let (film, inputs, halves) = rendered(Lamp(40.0, 20.9));
    let missed: Vec<usize> = edge().filter(|&i| film.emission_alone(0, i).is_none()).collect();
    assert!(missed.len() > 20, "{} pixels", missed.len());
    for i in missed.into_iter().filter(|&i| film.mean(i)[0] < 1.0) {
        let [lacking, _] = halves(&inputs, i);
        assert!(lacking >= 0.25 * 40.0, "{lacking}");
    }
}

#[test]
fn dim_emission_is_interpolated_like_other_light() {
    let (_, inputs, halves) = rendered(Lamp(WALL, 20.37));
    assert!(WALL < LAMP * inputs.level());
    for i in edge() {
        // All neighbours are alike.
        let wanted = [i - 1, i + 1, i - SIDE, i + SIDE].map(|j| halves(&inputs, j)[1]).iter().sum::<f32>() / 4.0;
        let [lacking, _] = halves(&inputs, i);
        assert!((lacking - wanted).abs() < 1e-3 * wanted, "{lacking}, not {wanted}");
    }
}

#[test]
fn emission_that_is_withheld_is_so_in_both_halves() {
    let (_, inputs, halves) = rendered(Lamp(1e12, 20.37));
    let most = |k: usize| (0..SIDE * SIDE).map(|i| halves(&inputs, i)[k]).fold(0.0, f32::max);
    let [lacking, own] = [most(0), most(1)];
    assert!(own > 1.0 && own < 1e10 && lacking <= 1.01 * own, "{lacking} interpolated, {own} sampled");
}
