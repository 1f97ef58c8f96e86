//! The scene `veach-bidir` beside pbrt-v4's bidirectional image (`shared/references`): same size, depth and box filter.
#![allow(clippy::print_stderr)]

use dapple_conformance::statistics::Mean;
use dapple_core::samplers::Uniform;
use dapple_core::{Frame, Limits, Render};
use dapple_low_discrepancy::Sobol;
use dapple_renderer::World;
use dapple_scene::image::{Encoding, read_image};
use dapple_scene::pbrt::{ReadOptions, read_scene};
use dapple_scene::{PixelFilter, Scene};
use dapple_transport::make_integrator;
use std::path::PathBuf;

/// The scene, and the reference's means; `None` if they are not there.
fn case() -> Option<(Scene, [f64; 3])> {
    let beside = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/scenes"));
    let scenes = std::env::var_os("DAPPLE_SCENES").map_or(beside, PathBuf::from);
    let file = scenes.join("pbrt-v4/veach-bidir/scene-v4.pbrt");
    let image = scenes.join("../references/veach-bidir.exr");
    if let Some(missing) = [&file, &image].into_iter().find(|p| !p.exists()) {
        eprintln!("skipped: {} is not there", missing.display());
        return None;
    }
    let mut scene = read_scene(&file, &ReadOptions::default()).unwrap_or_else(|e| panic!("{e}"));
    let bytes = std::fs::read(&image).expect("it is there");
    let reference = read_image(&bytes, "veach-bidir", Encoding::Auto).unwrap_or_else(|e| panic!("{e}"));
    scene.film.resolution = reference.size;
    scene.film.pixel_filter = PixelFilter::default();
    let sum = reference.pixels.iter().fold([0.0; 3], |s: [f64; 3], p| std::array::from_fn(|c| s[c] + f64::from(p[c])));
    Some((scene, sum.map(|s| s / reference.pixels.len() as f64)))
}

/// The reference is spectral; its own mean is known to 0.2 %, and plain RGB differs by 1 % at most.
#[test]
#[ignore = "minutes: cargo test --release -p dapple-transport --test transport veach_bidir -- --ignored --nocapture"]
fn the_mean_is_the_references() {
    let Some((scene, expected)) = case() else { return };
    let size = scene.film.resolution;
    let world = World::new(&scene).unwrap_or_else(|e| panic!("{e}"));
    for (request, spp) in [("bdpt:splat=0", 4), ("bdpt", 4), ("metropolis", 4)] {
        let mut means = [Mean::default(); 3];
        for seed in 0..4 {
            let mut integrator = make_integrator(request, &world).unwrap_or_else(|e| panic!("{e}"));
            let frame = Frame::new(size[0], size[1]).expect("not empty");
            let limits = Limits::samples(spp * frame.pixels() as u64);
            let film = Render::new(frame, &limits).run(&mut *integrator, &mut Uniform::new(Sobol::new(seed)));
            let film = film.unwrap_or_else(|e| panic!("{e}"));
            assert_eq!(film.record().rejected, 0, "{request}");
            let rays = film.record().rays as f64 / film.record().samples as f64;
            let mean = |c: usize| (0..frame.pixels()).map(|i| film.mean(i)[c]).sum::<f64>() / frame.pixels() as f64;
            (0..3).for_each(|c| means[c].add(mean(c)));
            eprintln!("{request}, seed {seed}: {:?}, {rays:.1} rays a sample", [0, 1, 2].map(mean));
        }
        let ratio: Vec<f64> = (0..3).map(|c| means[c].mean / expected[c]).collect();
        let error: Vec<f64> = (0..3).map(|c| means[c].standard_error() / expected[c]).collect();
        eprintln!("{request}, 4 x {spp} spp: means {ratio:.4?} +- {error:.4?} of the reference's");
        assert!(ratio.iter().all(|r| (r - 1.0).abs() < 0.01), "{request}: {ratio:?}");
    }
}
