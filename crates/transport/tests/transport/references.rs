//! Published scenes beside pbrt-v4's images of them, by its photons and its bidirectional paths.
//!
//! ```sh
//! cargo test --release -p dapple-transport --test transport -- --ignored references --nocapture
//! ```
#![allow(clippy::print_stderr, reason = "figures of a slow test")]

use crate::support::film;
use dapple_conformance::statistics::Mean;
use dapple_core::Film;
use dapple_renderer::World;
use dapple_scene::image::{Encoding, read_image};
use dapple_scene::pbrt::{ReadOptions, read_scene};
use dapple_scene::{PixelFilter, Scene};
use std::path::PathBuf;

/// A window of pixels: columns and rows.
type Window = [std::ops::Range<usize>; 2];

/// Seeds that are averaged.
const SEEDS: std::ops::Range<u64> = 900..904;

/// The ratios of means of Dapple's images to the reference in windows, per channel, over seeds; `None` without the files.
/// Pixels in `hidden` and those brighter than `glint` are left out.
fn ratios(
    name: &str,
    integrator: &str,
    spp: u64,
    windows: &[Window],
    (hidden, glint): (&Window, f64),
) -> Option<Vec<[Mean; 3]>> {
    let beside = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/scenes"));
    let scenes = std::env::var_os("DAPPLE_SCENES").map_or(beside, PathBuf::from);
    let file = scenes.join(format!("pbrt-v4/{name}/scene-v4.pbrt"));
    let image = scenes.join(format!("../references/{name}-rgb.exr"));
    if let Some(missing) = [&file, &image].into_iter().find(|path| !path.exists()) {
        eprintln!("skipped: {} is not there", missing.display());
        return None;
    }
    let mut scene: Scene = read_scene(&file, &ReadOptions::default()).unwrap_or_else(|e| panic!("{e}"));
    let bytes = std::fs::read(&image).expect("it is there");
    let reference = read_image(&bytes, name, Encoding::Auto).unwrap_or_else(|e| panic!("{e}"));
    scene.film.resolution = reference.size;
    scene.film.pixel_filter = PixelFilter::default();
    let world = World::new(&scene).unwrap_or_else(|e| panic!("{e}"));
    let films: Vec<_> = SEEDS.map(|seed| film(&world, integrator, reference.size, spp, seed)).collect();
    let width = reference.size[0] as usize;
    let ratio_of = |film: &Film, [columns, rows]: &Window| -> [f64; 3] {
        let pixels = rows.clone().flat_map(|y| columns.clone().map(move |x| (x, y)));
        let (mut ours, mut theirs) = ([0.0; 3], [0.0; 3]);
        for (x, y) in pixels.filter(|(x, y)| !(hidden[0].contains(x) && hidden[1].contains(y))) {
            let i = y * width + x;
            if film.mean(i)[1] > glint {
                continue;
            }
            (0..3).for_each(|c| {
                ours[c] += film.mean(i)[c];
                theirs[c] += f64::from(reference.pixels[i][c]);
            });
        }
        std::array::from_fn(|c| ours[c] / theirs[c])
    };
    let ratio = |window: &Window| -> [Mean; 3] {
        let of_films: Vec<[f64; 3]> = films.iter().map(|film| ratio_of(film, window)).collect();
        std::array::from_fn(|c| of_films.iter().map(|ratio| ratio[c]).collect())
    };
    Some(windows.iter().map(ratio).collect())
}

/// Ratios with their standard errors.
fn told(ratios: &[Mean; 3]) -> String {
    ratios.each_ref().map(|r| format!("{:.4} +- {:.4}", r.mean, r.standard_error())).join(", ")
}

#[test]
#[ignore = "slow: minutes"]
fn water_caustic_is_that_of_photon_mapping() {
    // The lamp itself is painted over in the reference. One sample that sees its mirror image in the water is as bright as
    // all others together; the brightest surfaces have a radiance of some 2.
    let hidden = [157..162, 23..28];
    let windows = [[0..320, 0..320], [30..290, 110..300]];
    let Some(found) = ratios("water-caustic", "photons:radius=0.0025", 16, &windows, (&hidden, 100.0)) else { return };
    eprintln!("water-caustic: whole {}; caustic {}", told(&found[0]), told(&found[1]));
    for ((ratio, bound), name) in found.iter().zip([0.01, 0.02]).zip(["whole", "caustic"]) {
        assert!(ratio.iter().all(|r| (r.mean - 1.0).abs() < bound), "{name}: {}", told(ratio));
    }
}

#[test]
#[ignore = "slow: minutes"]
fn veach_bidir_is_that_of_bidirectional_paths() {
    let windows = [[0..320, 0..320]];
    let Some(found) = ratios("veach-bidir", "photons", 32, &windows, (&[0..0, 0..0], f64::INFINITY)) else { return };
    eprintln!("veach-bidir: {}", told(&found[0]));
    // The reference's mean has a noise of 1.03 %.
    assert!(found[0].iter().all(|r| (r.mean - 1.0).abs() < 0.03), "{}", told(&found[0]));
}
