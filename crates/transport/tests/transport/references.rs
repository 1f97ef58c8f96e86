//! Published scenes compared with pbrt-v4's images, rendered by its photon mapping and bidirectional path tracing.
//!
//! ```sh
//! cargo test --release -p dapple-transport --test transport -- --ignored references --nocapture
//! ```
#![allow(clippy::print_stderr, reason = "figures of a slow test")]

use crate::support::*;
use dapple_scene::image::{Encoding, Image, read_image};
use dapple_scene::pbrt::{ReadOptions, read_scene};
use std::path::PathBuf;

/// A window of pixels, as ranges of columns and rows.
type Window = [std::ops::Range<usize>; 2];

/// Returns a scene in the size of its reference, with a box filter; `None` if the files are missing.
fn case(name: &str, image: &str) -> Option<(World, Image)> {
    let beside = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/scenes"));
    let scenes = std::env::var_os("DAPPLE_SCENES").map_or(beside, PathBuf::from);
    let file = scenes.join(format!("pbrt-v4/{name}/scene-v4.pbrt"));
    let image = scenes.join(format!("../references/{image}.exr"));
    if let Some(missing) = [&file, &image].into_iter().find(|path| !path.exists()) {
        eprintln!("skipped: {} is not there", missing.display());
        return None;
    }
    let mut scene = read_scene(&file, &ReadOptions::default()).unwrap_or_else(|e| panic!("{e}"));
    let bytes = std::fs::read(&image).expect("it is there");
    let reference = read_image(&bytes, name, Encoding::Auto).unwrap_or_else(|e| panic!("{e}"));
    scene.film.resolution = reference.size;
    scene.film.pixel_filter = PixelFilter::default();
    Some((world(&scene), reference))
}

/// Returns the ratio of the means of Dapple's images and of the reference, per window and channel, over four seeds. Pixels in
/// `hidden` and pixels brighter than `glint` are left out.
fn ratios(
    (world, reference): &(World, Image),
    integrator: &str,
    spp: u64,
    windows: &[Window],
    (hidden, glint): (&Window, f64),
) -> Vec<[Mean; 3]> {
    let films: Vec<_> = (900..904).map(|seed| film(world, integrator, reference.size, spp, seed)).collect();
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
    windows.iter().map(ratio).collect()
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
    let Some(case) = case("water-caustic", "water-caustic-rgb") else { return };
    let found = ratios(&case, "photons:radius=0.0025", 16, &windows, (&hidden, 100.0));
    for ((ratio, bound), name) in found.iter().zip([0.01, 0.02]).zip(["whole", "caustic"]) {
        eprintln!("water-caustic, {name}: {}", told(ratio));
        assert!(ratio.iter().all(|r| (r.mean - 1.0).abs() < bound), "{name}: {}", told(ratio));
    }
}

/// Photons are compared with the RGB reference, which has 1.03 % of noise. The spectral reference has 0.2 %, and RGB differs by
/// at most 1 %.
#[test]
#[ignore = "slow: minutes"]
fn veach_bidir_is_that_of_bidirectional_paths() {
    for (image, request, spp, bound) in [
        ("veach-bidir-rgb", "photons", 32, 0.03),
        ("veach-bidir", "bdpt:splat=0", 4, 0.01),
        ("veach-bidir", "bdpt", 4, 0.01),
        ("veach-bidir", "metropolis", 4, 0.01),
    ] {
        let Some(case) = case("veach-bidir", image) else { return };
        let all = [0..case.1.size[0] as usize, 0..case.1.size[1] as usize];
        let found = ratios(&case, request, spp, &[all], (&[0..0, 0..0], f64::INFINITY));
        eprintln!("{image}, {request}: {}", told(&found[0]));
        assert!(found[0].iter().all(|r| (r.mean - 1.0).abs() < bound), "{request}: {}", told(&found[0]));
    }
}
