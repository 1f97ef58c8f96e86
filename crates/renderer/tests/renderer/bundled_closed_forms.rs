//! Bundled scenes whose radiance has a closed form.
#![allow(clippy::print_stderr)]

use crate::support::*;
use dapple_low_discrepancy::Sobol;
use dapple_renderer::World;
use dapple_scene::Scene;

const SEED: u64 = 12_300;

fn bundled(name: &str) -> Scene {
    dapple_scene::bundled::files(name).expect("bundled").read().unwrap_or_else(|e| panic!("{name}: {e}"))
}

/// The integral of a function over `[0, 1]`, by Simpson's rule.
fn integral(f: impl Fn(f64) -> f64) -> f64 {
    let n = 20_000;
    let weight = |i: i32| if i == 0 || i == n { 1.0 } else { f64::from(2 + i % 2 * 2) };
    (0..=n).map(|i| weight(i) * f(f64::from(i) / f64::from(n))).sum::<f64>() / f64::from(3 * n)
}

/// The plate's mean reflectance: `sin(a + b) = sin a cos b + cos a sin b` makes it `0.5 + 0.9 s c`, with the Fresnel
/// integrals `s` and `c` of `k = 80 pi`. The mean without rings, the negative control, differs by twice the tolerance.
#[test]
fn the_zone_plate_has_the_mean_of_its_closed_form() {
    let k = 80.0 * std::f64::consts::PI;
    let wanted = 0.5 + 0.9 * integral(|t| (k * t * t).sin()) * integral(|t| (k * t * t).cos());
    let found = mean(&image(&bundled("zone-plate"), 16, SEED));
    eprintln!("{found:?}, closed form {wanted:.5}");
    assert!((wanted - 0.5).abs() > 1.2e-3, "the control is as good");
    assert!(found.iter().all(|m| (m - wanted).abs() < 6e-4), "{found:?}, not {wanted}");
}

/// The part of a lamp's rectangle from the foot of a point up to `(x, y)`, at this height: its irradiance at the point for
/// radiance 1, horizontal both. The classical form of Lambert's formula for a corner.
fn corner(x: f64, y: f64, height: f64) -> f64 {
    let [a, b] = [x, y].map(|c| (c * c + height * height).sqrt());
    0.5 * (x / a * (y / a).atan() + y / b * (x / b).atan())
}

/// The radiance of the floor at `(x, y)`. A card at height 2 to the left of `edge` hides the lamp's part with a smaller
/// x than `2 edge - x`.
fn floor(x: f64, y: f64, edge: f64) -> f64 {
    let from = (2.0 * edge - x).clamp(-0.6, 0.6);
    let part = |u: f64, v: f64| corner(u - x, v - y, 4.0);
    let irradiance = part(0.6, 0.6) - part(0.6, -0.6) - part(from, 0.6) + part(from, -0.6);
    0.8 / std::f64::consts::PI * 40.0 * irradiance
}

/// Column means of the image beside the closed form: 60 columns, each within 0.6 % of the largest radiance. A card that is
/// 0.02 further to the right, the negative control, is told apart.
#[test]
fn the_penumbra_has_its_closed_form() {
    let size = [60, 60];
    let world = World::with_resolution(&bundled("penumbra"), size).unwrap_or_else(|e| panic!("{e}"));
    let film = film_of(&world, size, 64, Sobol::new(SEED));
    let largest = |edge: f64| {
        let deviation = |column: usize| {
            let found: f64 = (0..60).map(|row| film.mean(row * 60 + column)[1]).sum::<f64>() / 60.0;
            // Four places along each axis of a pixel.
            let place = |k: usize| -2.0 + 4.0 * (k as f64 + 0.5) / 240.0;
            let places = (0..4).flat_map(|i| (0..240).map(move |j| (4 * column + i, j)));
            let wanted: f64 = places.map(|(i, j)| floor(place(i), place(j), edge)).sum::<f64>() / 960.0;
            (found - wanted).abs()
        };
        (0..60).map(deviation).fold(0.0, f64::max) / floor(1.0, 0.0, 0.0)
    };
    eprintln!("largest deviation {:.5}, with a wrong card {:.5}", largest(0.0), largest(0.02));
    assert!(largest(0.0) < 6e-3, "{}", largest(0.0));
    assert!(largest(0.02) > 0.02, "the control is as good: {}", largest(0.02));
}
