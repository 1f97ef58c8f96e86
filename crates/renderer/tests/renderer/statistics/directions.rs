//! Chi-square of sampled directions against their density, on a grid around an axis.

use super::chi_square;
use glam::{DVec3, Vec3};
use std::f64::consts::TAU;

const ROWS: usize = 16;
const COLUMNS: usize = 24;
/// Points of the rule in a cell, since a density may end anywhere in it. They are Roberts' R2 sequence [after Roberts
/// 2018].
const POINTS: usize = 4096;

/// Directions within `angle` of `axis`. All others, and refused samples, form one separate cell.
pub struct Cone {
    pub axis: DVec3,
    pub angle: f64,
}

impl Cone {
    /// All directions, in rings around an axis.
    pub fn sphere(axis: DVec3) -> Self {
        Self { axis, angle: std::f64::consts::PI }
    }

    /// p-value of `samples` draws against `pdf`, and the integral of `pdf` over the cone.
    pub fn test(&self, samples: u64, mut draw: impl FnMut() -> Option<Vec3>, pdf: impl Fn(Vec3) -> f32) -> (f64, f64) {
        let (x, y) = self.axis.any_orthonormal_pair();
        let cell = |w: DVec3| {
            // Computed from the chord, which keeps the digits of narrow cones.
            let angle = 2.0 * (0.5 * (w - self.axis).length()).min(1.0).asin();
            let turn = (w.dot(y).atan2(w.dot(x)) / TAU).rem_euclid(1.0);
            let row = (angle / self.angle * ROWS as f64) as usize;
            let column = ((turn * COLUMNS as f64) as usize).min(COLUMNS - 1);
            (row < ROWS || angle <= self.angle).then(|| row.min(ROWS - 1) * COLUMNS + column)
        };
        let mut observed = vec![0u64; ROWS * COLUMNS + 1];
        for _ in 0..samples {
            let at = draw().and_then(|w| cell(w.as_dvec3().normalize()));
            observed[at.unwrap_or(ROWS * COLUMNS)] += 1;
        }
        let mut expected = Vec::with_capacity(observed.len());
        let [dt, dp] = [self.angle / ROWS as f64, TAU / COLUMNS as f64];
        for i in 0..ROWS * COLUMNS {
            let point = |j: usize| {
                // A rank-1 lattice that continues from cell to cell, so that it never aligns with a density's border.
                let n = (i * POINTS + j) as f64;
                let [a, b] = [n * 0.754_877_666_246_692_8, n * 0.569_840_290_998_053_3].map(|x| x.fract());
                let (sin, cos) = (((i / COLUMNS) as f64 + a) * dt).sin_cos();
                let phi = ((i % COLUMNS) as f64 + b) * dp;
                let w = self.axis * cos + (x * phi.cos() + y * phi.sin()) * sin;
                f64::from(pdf(w.as_vec3())) * sin
            };
            expected.push((0..POINTS).map(point).sum::<f64>() / POINTS as f64 * dt * dp);
        }
        let integral: f64 = expected.iter().sum();
        expected.push((1.0 - integral).max(0.0));
        // Above the rule's own error, so that no cell is impossible.
        let least = 1e-6;
        let expected: Vec<f64> = expected.iter().map(|e| samples as f64 * e.max(least / samples as f64)).collect();
        (chi_square(&observed, &expected), integral)
    }
}
