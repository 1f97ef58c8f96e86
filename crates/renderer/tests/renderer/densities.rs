//! Chi-square tests of samples against their density, for directions on a grid around an axis and for BSDFs in cells that
//! follow the lobe.

use crate::support::*;
use dapple_renderer::shading::{Bsdf, BsdfSample};
use rayon::prelude::*;

/// A grid over the directions within `angle` of `axis`. All other directions and rejected samples form one separate cell.
pub(crate) struct Cone {
    pub(crate) axis: DVec3,
    pub(crate) angle: f64,
}

impl Cone {
    const ROWS: usize = 16;
    const COLUMNS: usize = 24;
    /// The number of quadrature points per cell, since a density may end anywhere in it. They are Roberts' R2 sequence [after
    /// Roberts 2018].
    const POINTS: usize = 2048;

    /// Returns the p-value of `samples` draws against the [`masses`](Self::masses) of a density.
    pub(crate) fn test(&self, samples: u64, mut draw: impl FnMut() -> Option<Vec3>, masses: &[f64]) -> f64 {
        let (rows, columns) = (Self::ROWS, Self::COLUMNS);
        let (x, y) = self.axis.any_orthonormal_pair();
        let cell = |w: DVec3| {
            // Computed from the chord, which keeps the digits of narrow cones.
            let angle = 2.0 * (0.5 * (w - self.axis).length()).min(1.0).asin();
            let turn = (w.dot(y).atan2(w.dot(x)) / TAU).rem_euclid(1.0);
            let row = (angle / self.angle * rows as f64) as usize;
            let column = ((turn * columns as f64) as usize).min(columns - 1);
            (row < rows || angle <= self.angle).then(|| row.min(rows - 1) * columns + column)
        };
        let mut observed = vec![0u64; rows * columns + 1];
        for _ in 0..samples {
            let at = draw().and_then(|w| cell(w.as_dvec3().normalize()));
            observed[at.unwrap_or(rows * columns)] += 1;
        }
        let rest = (1.0 - masses.iter().sum::<f64>()).max(0.0);
        // Above the rule's own error, so that no cell is impossible.
        let expected = masses.iter().chain([&rest]).map(|e| (samples as f64 * e).max(1e-6));
        chi_square(&observed, &expected.collect::<Vec<_>>())
    }

    /// Returns the integrals of `pdf` over the cells.
    pub(crate) fn masses(&self, pdf: impl Fn(Vec3) -> f32) -> Vec<f64> {
        let (rows, columns) = (Self::ROWS, Self::COLUMNS);
        let (x, y) = self.axis.any_orthonormal_pair();
        let [dt, dp] = [self.angle / rows as f64, TAU / columns as f64];
        let mass = |i: usize| {
            let point = |j: usize| {
                // A rank-1 lattice that continues from cell to cell, so that it never aligns with a density's border.
                let n = (i * Self::POINTS + j) as f64;
                let [a, b] = [n * 0.754_877_666_246_692_8, n * 0.569_840_290_998_053_3].map(|x| x.fract());
                let (sin, cos) = (((i / columns) as f64 + a) * dt).sin_cos();
                let phi = ((i % columns) as f64 + b) * dp;
                let w = self.axis * cos + (x * phi.cos() + y * phi.sin()) * sin;
                f64::from(pdf(w.as_vec3())) * sin
            };
            (0..Self::POINTS).map(point).sum::<f64>() / Self::POINTS as f64 * dt * dp
        };
        (0..rows * columns).map(mass).collect()
    }
}

/// The scattering below a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Below {
    /// No light is scattered there.
    Nothing,
    /// Refraction by microfacets, with the index inside relative to the index outside.
    Refracted(f64),
    /// The lobe of reflection, mirrored at the surface.
    Mirrored,
}

/// A BSDF under test.
pub(crate) struct Case<'m> {
    /// The name in messages.
    pub(crate) name: String,
    /// The BSDF under test.
    pub(crate) bsdf: Bsdf<'m>,
    /// The widths of the narrowest lobe.
    pub(crate) alpha: [f32; 2],
    /// The layout of cells below the surface.
    pub(crate) below: Below,
}

/// Returns twenty outgoing directions, including the normal, 89.99 degrees, a cosine of 1e-6 and directions below the surface.
pub(crate) fn outgoing() -> Vec<Vec3> {
    let at = |cos: f64, turn: f64| {
        let sin = (1.0 - cos * cos).sqrt();
        DVec3::new(sin * (TAU * turn).cos(), sin * (TAU * turn).sin(), cos).as_vec3()
    };
    let mut list = vec![Vec3::Z, -Vec3::Z, at(89.99f64.to_radians().cos(), 0.1), at(1e-6, 0.6), at(-1e-6, 0.3)];
    for i in 0..15 {
        let cos = 0.99 - 0.065 * f64::from(i);
        list.push(at(if i % 5 == 4 { -cos } else { cos }, 0.377 * f64::from(i)));
    }
    list
}

/// Polar cells over the half vector's slopes, in units of the lobe's widths. They resolve any lobe and any hemisphere. Cells
/// above the surface come first, then the cells below.
struct Rings {
    /// The outgoing direction, mirrored to lie above.
    wo: DVec3,
    side: f64,
    alpha: [f64; 2],
    below: Below,
    /// The index below over the index above, as seen from `wo`.
    eta: f64,
    /// The squared outer radii of the rings, except the last, which is infinite.
    borders: [f64; RINGS - 1],
}

const RINGS: usize = 12;
const SECTORS: usize = 20;
const CELLS: usize = RINGS * SECTORS;
/// Rings end at radius 0, `FIRST`, then in geometric progression up to `LAST / alpha`, and at infinity.
const FIRST: f64 = 0.3;
const LAST: f64 = 10.0;

impl Rings {
    fn new(wo: Vec3, case: &Case<'_>) -> Self {
        let side = f64::from(wo.z.signum());
        let eta = match case.below {
            Below::Refracted(eta) if side > 0.0 => eta,
            Below::Refracted(eta) => 1.0 / eta,
            _ => 1.0,
        };
        let alpha = case.alpha.map(f64::from);
        let borders = [0.0; RINGS - 1];
        let mut rings = Self { wo: wo.as_dvec3() * side, side, alpha, below: case.below, eta, borders };
        rings.borders = std::array::from_fn(|i| rings.radius(i as f64 + 1.0).0.powi(2));
        rings
    }

    /// Returns the number of hemispheres with cells.
    fn sides(&self) -> usize {
        if self.below == Below::Nothing { 1 } else { 2 }
    }

    /// Returns the radius of a continuous ring number, and its derivative.
    fn radius(&self, ring: f64) -> (f64, f64) {
        let n = (RINGS - 2) as f64;
        let last = LAST / self.alpha[0].min(self.alpha[1]);
        if ring <= 1.0 {
            (FIRST * ring, FIRST)
        } else if ring <= n + 1.0 {
            let rate = (last / FIRST).ln() / n;
            let radius = FIRST * (rate * (ring - 1.0)).exp();
            (radius, rate * radius)
        } else {
            let left = (n + 2.0 - ring).max(1e-12);
            (last / left, last / (left * left))
        }
    }

    fn cell(&self, wi: Vec3) -> usize {
        let wi = wi.as_dvec3() * self.side;
        let beyond = wi.z < 0.0;
        let h = match self.below {
            Below::Refracted(_) if beyond => self.wo + wi * self.eta,
            Below::Mirrored if beyond => self.wo + wi * DVec3::new(1.0, 1.0, -1.0),
            _ => self.wo + wi,
        };
        // Slopes are the same for a half vector that points down.
        let (x, y) = (h.x / (self.alpha[0] * h.z), h.y / (self.alpha[1] * h.z));
        let ring = self.borders.iter().position(|border| x * x + y * y < *border).unwrap_or(RINGS - 1);
        let turn = (y.atan2(x) / TAU).rem_euclid(1.0);
        ring * SECTORS + ((turn * SECTORS as f64) as usize).min(SECTORS - 1) + if beyond { CELLS } else { 0 }
    }

    /// Returns the density over (ring number, sector number) for a density over `wi`.
    fn density(&self, pdf: impl Fn(Vec3) -> f32, beyond: bool, ring: f64, sector: f64) -> f64 {
        let [ax, ay] = self.alpha;
        let phi = TAU * sector / SECTORS as f64;
        let (radius, slope) = self.radius(ring);
        let h = DVec3::new(ax * radius * phi.cos(), ay * radius * phi.sin(), 1.0);
        let inverse = h.length_recip();
        let cos = self.wo.dot(h) * inverse;
        if cos <= 0.0 {
            return 0.0;
        }
        // The direction for this half vector, and the ratio of solid angles around it and around the half vector.
        let (wi, ratio) = if beyond && self.below != Below::Mirrored {
            let eta = self.eta;
            let sin2 = (1.0 - cos * cos) / (eta * eta);
            if sin2 >= 1.0 {
                return 0.0;
            }
            let cos_t = (1.0 - sin2).sqrt();
            let wi = (cos / eta - cos_t) * inverse * h - self.wo / eta;
            (wi, (self.wo + eta * wi).length_squared() / (eta * eta * cos_t))
        } else {
            (2.0 * cos * inverse * h - self.wo, 4.0 * cos)
        };
        let wi = if beyond && self.below == Below::Mirrored { wi * DVec3::new(1.0, 1.0, -1.0) } else { wi };
        if (wi.z < 0.0) != beyond || wi.z == 0.0 {
            return 0.0;
        }
        let area = ax * ay * radius * slope * TAU / SECTORS as f64;
        f64::from(pdf((self.side * wi).as_vec3())) * ratio * inverse.powi(3) * area
    }

    /// Returns the integral of a density over each cell.
    fn integrals(&self, pdf: impl Fn(Vec3) -> f32, samples: u32) -> Vec<f64> {
        // Halvings of a quarter cell at most: the horizon cuts the density off, and more samples show more.
        let depth = if samples > 200_000 { 9 } else { 5 };
        let tolerance = 0.1 / f64::from(samples);
        let mut list = Vec::new();
        for beyond in (0..self.sides()).map(|side| side == 1) {
            let f = |ring: f64, sector: f64| self.density(&pdf, beyond, ring, sector);
            for (ring, sector) in (0..RINGS).flat_map(|ring| (0..SECTORS).map(move |sector| (ring, sector))) {
                // Started from 2 x 2 parts, so that no lobe between the nodes is missed; off the rings' seams.
                let half = |start: usize, i: usize| {
                    [i, i + 1].map(|i| start as f64 + (0.5 * i as f64).clamp(1e-9, 1.0 - 1e-9))
                };
                let parts = (0..4).map(|i| integrate(&f, half(ring, i / 2), half(sector, i % 2), tolerance, depth));
                list.push(parts.sum());
            }
        }
        list
    }
}

/// Returns the p-value of `samples` samples against `gain * pdf`. Checks the pdf and weight of every fifth sample.
pub(crate) fn chi_square_of(case: &Case<'_>, wo: Vec3, samples: u32, gain: impl Fn(Vec3) -> f32, seed: u64) -> f64 {
    let Case { name, bsdf, .. } = case;
    let rings = Rings::new(wo, case);
    let mut random = Pcg32::seed_from_u64(seed);
    let mut observed = vec![0u64; rings.sides() * CELLS + 1];
    let refused = observed.len() - 1;
    for i in 0..samples {
        let u = [random.random(), random.random()];
        let cell = match bsdf.sample(wo, u, random.random()) {
            Some(sample) if !sample.specular => {
                if i % 5 == 0 {
                    check_sample(case, wo, &sample);
                }
                rings.cell(sample.wi)
            }
            // Rejected and specular samples share one cell, with the rest of the density to 1.
            _ => refused,
        };
        observed[cell] += 1;
    }
    let n = f64::from(samples);
    let mut expected = rings.integrals(|wi| gain(wi) * bsdf.pdf(wo, wi), samples);
    let integral: f64 = expected.iter().sum();
    assert!(integral <= 1.0 + 1e-3, "{name} at {wo}: pdf integrates to {integral}");
    // The last cell is a difference, which quadrature leaves uncertain by about 1e-6.
    expected.push((1.0 - integral).max(5e-6));
    expected.iter_mut().for_each(|e| *e *= n);
    chi_square(&observed, &expected)
}

fn check_sample(case: &Case<'_>, wo: Vec3, sample: &BsdfSample) {
    let Case { name, bsdf, below, .. } = case;
    let BsdfSample { wi, weight, pdf, eta, .. } = *sample;
    assert!((wi.length() - 1.0).abs() < 1e-6, "{name} at {wo}: {wi}");
    let crossed = match below {
        _ if wi.z * wo.z > 0.0 => 1.0,
        Below::Nothing => panic!("{name} at {wo}: light through the surface, {wi}"),
        Below::Refracted(index) if wo.z > 0.0 => *index,
        Below::Refracted(index) => 1.0 / index,
        Below::Mirrored => 1.0,
    };
    assert!((f64::from(eta) - crossed).abs() < 1e-6, "{name} {wo} {wi}: {eta}");
    let (f, again) = bsdf.evaluate_and_pdf(wo, wi);
    assert!(pdf > 0.0 && pdf.is_finite() && (pdf - again).abs() <= 1e-4 * pdf, "{name} {wo} {wi}: {pdf} {again}");
    let f = f * (wi.z.abs() / pdf);
    assert!((f - weight).abs().max_element() <= 1e-4 * f.max_element().max(1e-30), "{name} {wo} {wi}: {f} {weight}");
}

/// True if f32 directions resolve the lobe. Reflected within about `alpha` of the surface, half vectors have length
/// `alpha`. Their slopes of order `alpha` have a relative error of 6e-8 / alpha^2, and directions form a lattice of
/// that spacing. With 10^6 samples an alpha of 0.01 also shows it in the tails.
pub(crate) fn resolved(case: &Case<'_>, wo: Vec3, samples: u32) -> bool {
    let narrowest = if samples > 200_000 { 0.02 } else { 2e-3 };
    wo.z.abs() > 1e-3 || case.alpha[0].max(case.alpha[1]) > narrowest
}

/// Asserts that samples agree with the density, for the directions that f32 resolves or for the others. Each case uses one in
/// `step` of the directions, in pairs, which differ from case to case.
pub(crate) fn check_agreement(cases: &[Case<'_>], outgoing: &[Vec3], samples: u32, resolvable: bool, step: usize) {
    let level = sidak(FAMILY, cases.len() * outgoing.len());
    let failure = |(i, j): (usize, usize)| {
        let (case, wo) = (&cases[i], outgoing[j]);
        if resolved(case, wo, samples) != resolvable {
            return None;
        }
        let p = chi_square_of(case, wo, samples, |_| 1.0, (1000 * i + j) as u64);
        (p < level).then(|| format!("{} at {wo}: p = {p:e}", case.name))
    };
    let pairs = (0..cases.len()).flat_map(|i| (0..outgoing.len()).map(move |j| (i, j)));
    let pairs: Vec<_> = pairs.filter(|(i, j)| (i + j / 2) % step == 0).collect();
    let failures: Vec<String> = pairs.into_par_iter().filter_map(failure).collect();
    assert!(failures.is_empty(), "{failures:#?}");
}

/// Returns the verdict of `judge` on the mean weight of flux, which lacks the factor of refraction on radiance. Samples are
/// doubled while it is undecided.
pub(crate) fn albedo(
    bsdf: &Bsdf<'_>,
    wo: Vec3,
    gain: f64,
    seed: u64,
    judge: impl Fn(&Mean) -> Verdict,
) -> (Verdict, Mean) {
    let mut random = Pcg32::seed_from_u64(seed);
    let mut mean = Mean::default();
    loop {
        let u = [random.random(), random.random()];
        let weight = |s: BsdfSample| f64::from(s.weight.max_element() * s.eta * s.eta);
        mean.add(gain * bsdf.sample(wo, u, random.random()).map_or(0.0, weight));
        if mean.n >= 1 << 12 && mean.n.is_power_of_two() {
            let verdict = judge(&mean);
            if verdict != Verdict::Undecided || mean.n == 1 << 22 {
                return (verdict, mean);
            }
        }
    }
}
