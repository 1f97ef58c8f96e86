//! Images by chains have the path tracer's light.
#![allow(clippy::print_stderr, reason = "figures of tests")]

use crate::bidirectional::{compared, replicates};
use crate::support::*;

const SIZE: [u32; 2] = [24, 16];

/// This includes discarded samples, so that the halves of the film stay independent.
#[test]
fn samples_of_a_half_take_the_image_of_that_half() {
    let world = bundle("cornell", SIZE);
    let [mut all, mut direct] = ["metropolis", "bdpt:depth=1,splat=0"].map(|request| made(request, &world));
    film_by(&mut *all, SIZE, 2, 1);
    film_by(&mut *direct, SIZE, 2, 1);
    let points = Sobol::new(1);
    let light = |half: usize| -> f32 {
        let samples = [(streams::HALVES, 0), (streams::HALVES, 1), (streams::DISCARDED_HALVES, 0)];
        let of_pixel = |i: u32| {
            let [one, two, discarded] = samples.map(|(stream, index)| {
                let draws = Draws::new(&points, SampleId::new([i % 24, i / 24], stream[half], index));
                let [all, direct] = [&all, &direct].map(|by| by.estimate(&draws, &mut Worker::default()).radiance[1]);
                all - direct
            });
            assert!((one - two).abs().max((one - discarded).abs()) < 1e-4, "half {half}: {one}, {two}, {discarded}");
            one
        };
        (0..384).map(of_pixel).sum()
    };
    let halves = [0, 1].map(light);
    assert!(halves[0] > 0.0 && (halves[0] / halves[1] - 1.0).abs() > 1e-3, "other chains make other light: {halves:?}");
}

/// Cases: any fraction of large steps, including 1 (independent samples), few seeds, and chains of one step, which only use
/// their start. Negative controls: light is missing without chains, and 10 % more light is detected in `cornell`.
#[test]
fn the_mean_is_the_path_tracers() {
    let all = ["", "large=1", "large=0.02,length=64", "seeds=1,length=1"];
    for (name, cases) in &[("cornell", &all[..]), ("lens", &all[..1])][..thorough(1, 2)] {
        let mut world = bundle(name, SIZE);
        world.set_max_depth(4);
        let expected = replicates(&mut *integrator(&world), SIZE, 16, 100);
        let of = |options: &str| replicates(&mut *made(&format!("metropolis:{options}"), &world), SIZE, 4, 0);
        for options in *cases {
            let mut found = of(options);
            let (p, z) = compared(&found, &expected);
            eprintln!("{name}, {options}: p {p:.2e}, {z:+.2} standard errors");
            assert!(p > sidak(FAMILY, 5) && z < 3.5, "{name}, {options}: p {p:e}, {z} standard errors");
            found.iter_mut().flatten().flatten().for_each(|light| *light *= 1.1);
            let (_, z) = compared(&found, &expected);
            assert!(*name != "cornell" || z > 3.5, "{name}, {options}: the test does not see 10 %");
        }
        let (p, _) = compared(&of("depth=1"), &expected);
        assert!(p < FAMILY, "{name}: the test sees nothing, p {p:e}");
    }
}
