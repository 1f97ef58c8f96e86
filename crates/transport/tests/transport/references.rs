//! Published scenes beside pbrt-v4's images of them, by its photons and its bidirectional paths.
//!
//! ```sh
//! cargo test --release -p dapple-transport --test transport -- --ignored references --nocapture
//! ```
#![allow(clippy::print_stderr, reason = "figures of a slow test")]

use crate::support::film;
use dapple_renderer::World;
use dapple_scene::image::{Encoding, read_image};
use dapple_scene::pbrt::{ReadOptions, read_scene};
use dapple_scene::{PixelFilter, Scene};
use std::path::PathBuf;

/// A window of pixels: columns and rows.
type Window = [std::ops::Range<usize>; 2];

/// The ratios of means of Dapple's image to the reference in windows, per channel; `None` without the files.
fn ratios(name: &str, integrator: &str, spp: u64, windows: &[Window], hidden: &Window) -> Option<Vec<[f64; 3]>> {
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
    let film = film(&world, integrator, reference.size, spp, 900);
    let width = reference.size[0] as usize;
    let ratio = |[columns, rows]: &Window| {
        let pixels = rows.clone().flat_map(|y| columns.clone().map(move |x| (x, y)));
        let (mut ours, mut theirs) = ([0.0; 3], [0.0; 3]);
        for (x, y) in pixels.filter(|(x, y)| !(hidden[0].contains(x) && hidden[1].contains(y))) {
            let i = y * width + x;
            (0..3).for_each(|c| {
                ours[c] += film.mean(i)[c];
                theirs[c] += f64::from(reference.pixels[i][c]);
            });
        }
        std::array::from_fn(|c| ours[c] / theirs[c])
    };
    Some(windows.iter().map(ratio).collect())
}

#[test]
#[ignore = "slow: minutes"]
fn water_caustic_is_that_of_photon_mapping() {
    // The lamp itself is painted over in the reference.
    let hidden = [157..162, 23..28];
    let windows = [[0..320, 0..320], [30..290, 110..300]];
    let Some(found) = ratios("water-caustic", "photons:radius=0.005", 16, &windows, &hidden) else { return };
    eprintln!("water-caustic: whole {:.4?}, caustic {:.4?}", found[0], found[1]);
    for (ratio, bound) in found.iter().zip([0.01, 0.02]) {
        assert!(ratio.iter().all(|r| (r - 1.0).abs() < bound), "{found:.4?}");
    }
}

#[test]
#[ignore = "slow: minutes"]
fn veach_bidir_is_that_of_bidirectional_paths() {
    let windows = [[0..320, 0..320]];
    let Some(found) = ratios("veach-bidir", "photons", 32, &windows, &[0..0, 0..0]) else { return };
    eprintln!("veach-bidir: whole {:.4?}", found[0]);
    // The reference's mean has a noise of 1.03 %.
    assert!(found[0].iter().all(|r| (r - 1.0).abs() < 0.03), "{found:.4?}");
}
