//! Code of effects that a scene does not need changes no bit and requests no random numbers.

#[path = "renderer/statistics/mod.rs"]
mod statistics;
#[path = "renderer/support/mod.rs"]
mod support;

use dapple_core::samplers::Uniform;
use dapple_core::{Frame, Limits, Render};
use dapple_low_discrepancy::Sobol;
use dapple_renderer::{World, code, integrator_with};
use dapple_scene::bundled;
use support::*;

const SIZE: [u32; 2] = [24, 16];
const SPP: u64 = 2;
const CODES: [(&str, u32); 9] = [
    ("none", 0),
    ("several lights", code::SEVERAL_LIGHTS),
    ("environment", code::ENVIRONMENT),
    ("roulette", code::ROULETTE),
    ("transmission", code::TRANSMISSION),
    ("rare", code::RARE),
    ("varied", code::VARIED),
    ("learned selection", code::LEARNED_SELECTION),
    ("all", code::SEVERAL_LIGHTS | code::ENVIRONMENT | code::ROULETTE | code::TRANSMISSION | code::RARE | code::VARIED),
];

/// A hash of the image, the number of blocks requested, and the number of rays traced.
fn rendered(world: &World, idle: u32, seed: u64) -> (u64, u64, u64) {
    let frame = Frame::new(SIZE[0], SIZE[1]).expect("not empty");
    let limits = Limits::samples(SPP * frame.pixels() as u64);
    let mut sampler = Uniform::new(Sobol::new(seed));
    let mut integrator = integrator_with(world, idle);
    let film = Render::new(frame, &limits).run(&mut *integrator, &mut sampler).expect("it renders");
    (hash(&film), film.record().blocks, film.record().rays)
}

#[test]
fn idle_code_changes_no_bit_l14() {
    for name in bundled::names() {
        let scene = bundled::files(name).expect("bundled").read().expect("it reads");
        let world = World::with_resolution(&scene, SIZE).unwrap_or_else(|e| panic!("{name}: {e}"));
        let expected = rendered(&world, 0, 1);
        for (idle, bits) in CODES {
            assert_eq!(rendered(&world, bits, 1), expected, "{name} with the code of {idle}");
        }
        // Negative control: the hash depends on the samples.
        assert!(rendered(&world, 0, 2).0 != expected.0, "{name}");
    }
}
