//! A 4-D group compared with two padded pairs.
//!
//! The group is the first four dimensions of Sobol's sequence with the direction numbers of [Joe 2008], Owen-scrambled:
//! `sobol_burley::sample(i, 0..4, seed)`.
//!
//! `cargo test --release -p dapple-low-discrepancy --test low-discrepancy four_dimensions:: -- --nocapture`

#![allow(clippy::print_stderr, reason = "tests print what they measure")]

use crate::common::{id, rms};
use dapple_core::PointSet;
use dapple_low_discrepancy::Sobol;

type Integrand4 = (&'static str, fn([f64; 4]) -> f64, f64);

fn one_if(inside: bool) -> f64 {
    f64::from(u8::from(inside))
}

/// Functions of (x, y) on the pixel and (z, w) on a lens or a light.
const INTEGRANDS: [Integrand4; 8] = [
    ("second pair, smooth: z w", |u| u[2] * u[3], 0.25),
    ("second pair, disk edge", |u| one_if(u[2] * u[2] + u[3] * u[3] < 1.0), std::f64::consts::FRAC_PI_4),
    ("sum of pairs: x y + z w", |u| u[0] * u[1] + u[2] * u[3], 0.5),
    ("product of all", |u| u.iter().product(), 0.0625),
    (
        "product of disks",
        |u| one_if(u[0] * u[0] + u[1] * u[1] < 1.0) * one_if(u[2] * u[2] + u[3] * u[3] < 1.0),
        std::f64::consts::FRAC_PI_4 * std::f64::consts::FRAC_PI_4,
    ),
    ("edge across pairs: x + z < 1", |u| one_if(u[0] + u[2] < 1.0), 0.5),
    ("blurred edge: x + (z - w)/4 < 1/2", |u| one_if(u[0] + 0.25 * (u[2] - u[3]) < 0.5), 0.5),
    ("half-space: sum < 2", |u| one_if(u.iter().sum::<f64>() < 2.0), 0.5),
];

#[test]
fn padded_pairs_serve_a_single_pair_better_than_a_group_of_four() {
    let points = Sobol::new(8);
    let scrambles = 1000;
    eprintln!("RMSE of two padded pairs over that of one 4-D group (above 1: the group is better)");
    eprintln!("{:>36} {:>7} {:>7} {:>7} {:>7}", "n", 8, 16, 64, 256);
    for (name, f, mean) in INTEGRANDS {
        let ratios: Vec<f64> = [8_u32, 16, 64, 256]
            .into_iter()
            .map(|n| {
                let mean_of =
                    |at: &dyn Fn(u32) -> [f64; 4]| (0..n).map(|i| f(at(i))).sum::<f64>() / f64::from(n) - mean;
                let padded = rms((0..scrambles)
                    .map(|p| mean_of(&|i| points.block(id([p % 64, p / 64], 0, i.into()), 1).map(f64::from))));
                let group = rms((0..scrambles)
                    .map(|seed| mean_of(&|i| [0, 1, 2, 3].map(|d| f64::from(sobol_burley::sample(i, d, seed))))));
                padded / group
            })
            .collect();
        let cells: String = ratios.iter().map(|r| format!(" {r:>7.2}")).collect();
        eprintln!("{name:>36}{cells}");
        // The advantage of pairs: an integrand of one pair must not be worse (standard error 3 %).
        assert!(!name.starts_with("second pair") || ratios.iter().all(|r| *r < 1.14), "{name}: {ratios:?}");
    }
}

/// The reason against the group as default: its second pair is not a net.
#[test]
fn the_second_pair_of_the_group_is_not_a_net() {
    // The first 8 points, in boxes of 2 x 4 and 4 x 2.
    let uneven = (0..20).any(|seed| {
        [[2.0, 4.0], [4.0, 2.0]].into_iter().any(|shape: [f32; 2]| {
            let mut seen = [false; 8];
            (0..8).any(|i| {
                let [x, y] = [0, 1].map(|k| (sobol_burley::sample(i, 2 + k as u32, seed) * shape[k]) as usize);
                std::mem::replace(&mut seen[x * shape[1] as usize + y], true)
            })
        })
    });
    assert!(uneven, "dimensions 3 and 4 are a net at 8 points after all");
}
