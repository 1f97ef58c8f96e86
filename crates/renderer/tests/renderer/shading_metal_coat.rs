//! The closed form of a coat over a metal against walks between the layers, event by event.
// The tests print their measurements.
#![allow(clippy::print_stderr)]

use crate::scattering::walk::{Base, Walk};
use crate::statistics::Mean;
use dapple_renderer::shading::{Bsdf, CoatOptions, ComplexIor, MetalCoat};
use glam::{DVec3, Vec3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Bins of the distance between leaving and mirror direction, in half-vector slopes.
const BINS: usize = 6;

fn bin(wo: DVec3, wi: DVec3) -> usize {
    let h = wo + wi;
    let slope = h.x.hypot(h.y) / h.z;
    [0.02, 0.06, 0.2, 0.5, 1.0].iter().position(|&edge| slope < edge).unwrap_or(BINS - 1)
}

/// Fractions of light by bin, and in total: the walk's with standard errors, and the closed form's.
struct Found {
    walk: [Mean; BINS + 1],
    closed: [Mean; BINS + 1],
}

fn compare(coat: f32, metal: f32, cos: f64, walks: u64) -> Found {
    let options = CoatOptions { alpha: [coat; 2], ..Default::default() };
    let (made, ior) = (MetalCoat::new(options, [metal; 2]).unwrap(), [0.92, 2.45]);
    let splat = ior.map(|x| Vec3::splat(x as f32));
    let bsdf = Bsdf::coated_conductor(&made, ComplexIor { eta: splat[0], k: splat[1] });
    // The coat's own reflection: the same coat over a metal that reflects nothing.
    let dark = Bsdf::coated_conductor(&made, ComplexIor { eta: Vec3::splat(1.5), k: Vec3::ZERO });
    let wo = DVec3::new((1.0 - cos * cos).sqrt(), 0.0, cos);
    let base = Base::Metal { alpha: metal.into(), ior };
    let mut walk = Walk { coat: coat.into(), base, random: Pcg64Mcg::seed_from_u64(5) };
    let mut found = Found { walk: [Mean::default(); BINS + 1], closed: [Mean::default(); BINS + 1] };
    let add = |means: &mut [Mean; BINS + 1], to: usize, weight: f64| {
        means.iter_mut().enumerate().for_each(|(i, m)| m.add(if i == to || i == BINS { weight } else { 0.0 }));
    };
    let mut random = Pcg64Mcg::seed_from_u64(6);
    for _ in 0..walks {
        let (to, weight) = walk.leave(wo).map_or((BINS, 0.0), |(wi, weight)| (bin(wo, wi), weight));
        add(&mut found.walk, to, weight);
        let u = [random.random(), random.random()];
        let (to, weight) = match bsdf.sample(wo.as_vec3(), u, random.random()) {
            Some(sample) if !sample.specular => {
                let both = bsdf.evaluate(wo.as_vec3(), sample.wi).x;
                let coat = dark.evaluate(wo.as_vec3(), sample.wi).x;
                let weight = f64::from((both - coat) * sample.wi.z / sample.pdf);
                (bin(wo, sample.wi.as_dvec3()), weight)
            }
            _ => (BINS, 0.0),
        };
        add(&mut found.closed, to, weight);
    }
    found
}

/// Differences in all the light, and the largest in a bin, both as fractions of all the light, less 5 standard errors.
fn differences(coat: f32, metal: f32, cos: f64, walks: u64) -> [f64; 2] {
    let Found { walk, closed } = compare(coat, metal, cos, walks);
    let all = walk[BINS].mean;
    let difference = |i: usize| {
        let noise = walk[i].standard_error().hypot(closed[i].standard_error());
        [(closed[i].mean - walk[i].mean) / all, noise / all]
    };
    let text: Vec<String> = (0..=BINS).map(|i| format!("{:+.3}", difference(i)[0])).collect();
    eprintln!(
        "coat {coat} metal {metal} cosine {cos}: walk {all:.4}, bins {} (+- {:.4})",
        text.join(" "),
        difference(BINS)[1]
    );
    let beyond = |i: usize| (difference(i)[0].abs() - 5.0 * difference(i)[1]).max(0.0);
    [beyond(BINS), (0..BINS).map(beyond).fold(0.0, f64::max)]
}

const PAIRS: [[f32; 2]; 8] =
    [[0.0, 0.1], [0.0, 0.3], [0.0, 1.0], [0.1, 0.0], [0.1, 0.1], [0.3, 0.1], [0.3, 0.5], [0.6, 0.6]];

/// The closed form is accurate for smooth and rough coats, from above and at grazing angles.
#[test]
fn closed_form_meets_the_walk() {
    for [coat, metal] in PAIRS {
        for cos in [1.0, 0.6, 0.15] {
            let [all, bin] = differences(coat, metal, cos, 20_000);
            let most = if coat == 0.0 {
                0.03
            } else if cos > 0.5 {
                0.05
            } else {
                0.12
            };
            assert!(all < most && bin < 0.06, "coat {coat} metal {metal} cosine {cos}: {all} {bin}");
        }
    }
}

/// Negative control: a coat of another width is detected.
#[test]
fn closed_form_of_another_coat_misses_the_walk() {
    let Found { walk, .. } = compare(0.3, 0.1, 1.0, 20_000);
    let Found { closed, .. } = compare(0.1, 0.1, 1.0, 20_000);
    assert!((0..BINS).any(|i| (walk[i].mean - closed[i].mean).abs() > 0.1 * walk[BINS].mean));
}

#[test]
#[ignore = "a measurement: about a minute"]
fn closed_form_meets_long_walks() {
    for [coat, metal] in PAIRS {
        for cos in [1.0, 0.8, 0.5, 0.2, 0.05] {
            differences(coat, metal, cos, 1_000_000);
        }
    }
}
