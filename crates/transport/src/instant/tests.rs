//! Virtual lights and the paths beside them make the path tracer's mean.
#![allow(clippy::print_stderr, reason = "figures of tests")]

use super::{InstantOptions, VirtualLights};
use dapple_conformance::statistics::Mean;
use dapple_core::samplers::Uniform;
use dapple_core::{Frame, Integrator, Limits, Options as _, Render};
use dapple_low_discrepancy::Sobol;
use dapple_renderer::{World, integrator, path_tracer_with};
use dapple_scene::bundled;

const SIZE: [u32; 2] = [24, 16];

/// The image's mean, one value for each of 16 seeds.
fn means(integrator: &mut dyn Integrator, spp: u64, first_seed: u64) -> Mean {
    let frame = Frame::new(SIZE[0], SIZE[1]).expect("not empty");
    let limits = Limits::samples(spp * frame.pixels() as u64);
    let mean = |seed| {
        let film = Render::new(frame, &limits).run(integrator, &mut Uniform::new(Sobol::new(seed)));
        let film = film.unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(film.record().rejected, 0);
        (0..frame.pixels()).map(|i| film.mean(i)[1]).sum::<f64>() / frame.pixels() as f64
    };
    (first_seed..first_seed + 16).map(mean).collect()
}

fn instant<'w>(world: &'w World, options: &str, compensates: bool) -> Box<dyn Integrator + 'w> {
    let options = InstantOptions::parse(options).unwrap_or_else(|e| panic!("{e}"));
    path_tracer_with(world, VirtualLights { compensates, ..VirtualLights::new(world, options) })
}

/// Within 3 standard errors, which alone gives a false alarm with probability 0.03 for other seeds. A low bound leaves much
/// of the light to paths.
#[test]
fn means_are_the_path_tracers_in_a_box() {
    check_means(&["cornell"]);
}

#[test]
#[ignore = "18 s: five scenes; one more is tested always"]
fn means_are_the_path_tracers_on_five_more_scenes() {
    check_means(&["lens", "tea", "teapot", "room", "door"]);
}

fn check_means(names: &[&str]) {
    for &name in names {
        let scene = bundled::files(name).expect("bundled").read().expect("it reads");
        let mut world = World::with_resolution(&scene, SIZE).unwrap_or_else(|e| panic!("{name}: {e}"));
        world.set_max_depth(world.max_depth().min(6));
        let expected = means(&mut *integrator(&world), 128, 100);
        let found = means(&mut *instant(&world, "paths=32,clamp=2", true), 32, 200);
        let (z, bias) = (found.against_estimate(&expected).z(), found.mean / expected.mean - 1.0);
        let error = found.standard_error() / expected.mean;
        eprintln!("{name}: {bias:+.4} +- {error:.4}, {z:.2} standard errors");
        assert!(z.abs() < 3.0 && error < 0.02, "{name}: {bias:+.4} +- {error:.4}, {z:.2}");
        if name == "cornell" {
            // Negative control: what the bound takes is lost.
            let less = means(&mut *instant(&world, "paths=32,clamp=2", false), 32, 200);
            assert!(less.against_estimate(&expected).z() < -5.0, "the test sees nothing: {less:?}");
        }
    }
}
