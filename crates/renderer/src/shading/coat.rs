//! A dielectric coat over Lambert's reflection.
//!
//! Light enters through the coat, is scattered by the base, may be reflected back down from below the coat
//! and scattered again, and leaves. pbrt-v4 walks that at random at each evaluation. Lambert's base forgets
//! where light came from, so the walk's mean is a product, whatever the coat's roughness:
//!
//! `f = f_coat + T(wo) T(wi) rho / (pi eta^2) * sum_{k < K} (rho F)^k`
//!
//! * `T(w)`: share of the light from `w` that arrives at the base, in one pass through the coat;
//! * `F`: share of the base's light that comes back to the base from below the coat;
//! * `eta^2`: radiance spreads over fewer directions beyond the interface; light leaving from `wi` to `wo`
//!   has `T(wo) / eta^2` by the interface's own reciprocity;
//! * `K`: pbrt-v4's walk of depth `d` meets the base `ceil(d / 2)` times and then drops what is left, 4 % of
//!   the base's light for `d = 10` and `rho = 0.9`.
//!
//! Both `T` and `F` include, as pbrt-v4's coat does without saying so, absorption `exp(-thickness / |cos|)`
//! on every crossing: 1 % a crossing at the default thickness. They are integrated over visible microfacet
//! normals when the material is made; `T` is a table over the cosine. So `f` is reciprocal to the last bit,
//! and takes no random numbers.

use super::microfacet::TrowbridgeReitz;
use super::{Error, fresnel};
use dapple_scene::effectively_smooth;
use glam::Vec3;
use std::f32::consts::FRAC_1_PI;

/// The number of cells of the tables over the cosine. A smooth coat's transmittance, the hardest to tabulate, is within
/// 1e-4 (relatively, within 1e-3 at a cosine of 0.01).
const CELLS: usize = 256;

/// The parameters of a [`Coat`], as pbrt-v4's `coateddiffuse` has them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CoatOptions {
    /// Index of refraction over the outside's, in `[0.1, 10]`.
    pub eta: f32,
    /// Microfacet widths along the tangents; smooth where
    /// [`effectively_smooth`] returns true, or where `eta` is 1.
    pub alpha: [f32; 2],
    /// Optical thickness along the normal, from 0: light that crosses the coat at an angle with cosine `c`
    /// (inside) keeps `exp(-thickness / c)`. Where the coat scatters with an albedo, what it scatters mostly
    /// goes on: multiply the thickness by `1 - albedo`.
    pub thickness: f32,
    /// The largest number of events of pbrt-v4's random walk between the layers; `u32::MAX` for all.
    pub max_depth: u32,
}

impl Default for CoatOptions {
    /// Returns pbrt-v4's defaults, a smooth coat.
    fn default() -> Self {
        Self { eta: 1.5, alpha: [0.0; 2], thickness: 0.01, max_depth: 10 }
    }
}

/// A coat over a diffuse base, tabulated once per material: some 10 ms (0.3 ms if smooth) and 2 KiB. The base's reflectance may
/// vary from hit to hit.
#[derive(Clone, Debug, PartialEq)]
pub struct Coat {
    eta: f32,
    microfacets: Option<TrowbridgeReitz>,
    /// Transmittance to the base and directional reflectance, at cosine `i / CELLS`.
    table: Box<[[f32; 2]]>,
    average_transmittance: f32,
    internal_reflectance: f32,
    terms: u32,
}

impl Coat {
    /// Tabulates the coat with these parameters.
    ///
    /// An anisotropic coat transmits like the isotropic one of width `sqrt(alpha_x alpha_y)`; its own
    /// reflection is anisotropic.
    ///
    /// # Errors
    ///
    /// [`Error::Eta`], [`Error::Thickness`] or [`Error::Roughness`] for a value out of range.
    pub fn new(options: CoatOptions) -> Result<Self, Error> {
        let CoatOptions { eta, alpha, thickness, max_depth } = options;
        if !(0.1..=10.0).contains(&eta) {
            return Err(Error::Eta { value: eta });
        }
        if !(thickness >= 0.0 && thickness.is_finite()) {
            return Err(Error::Thickness { value: thickness });
        }
        let rough = TrowbridgeReitz::new(alpha)?;
        let smooth = effectively_smooth(alpha) || eta == 1.0;
        let interface = Interface {
            microfacets: if smooth {
                None
            } else {
                Some(TrowbridgeReitz::new([(alpha[0].max(1e-4) * alpha[1].max(1e-4)).sqrt(); 2])?)
            },
            thickness: f64::from(thickness),
            nodes: gauss_legendre(24),
        };
        let table: Box<[_]> = (0..=CELLS).map(|i| interface.seen_from_outside(i as f32 / CELLS as f32, eta)).collect();
        let average_transmittance = interface.average(&[0.0, 1.0], |mu| interface.seen_from_outside(mu, eta)[0]);
        // Reflection from below has a kink at the critical angle: integrate each side of it.
        let critical = (1.0 - f64::from(eta).powi(2).recip()).max(0.0).sqrt();
        let internal_reflectance =
            interface.average(&[0.0, critical, 1.0], |mu| interface.returned_from_below(mu, eta));
        Ok(Self {
            eta,
            microfacets: (!smooth).then_some(rough),
            table,
            average_transmittance: average_transmittance as f32,
            internal_reflectance: internal_reflectance as f32,
            terms: max_depth.div_ceil(2),
        })
    }

    /// Returns the share of light at this cosine that reaches the base, and the share that the coat reflects.
    #[inline]
    pub(crate) fn transmittance_and_reflectance(&self, cos: f32) -> [f32; 2] {
        let x = cos.clamp(0.0, 1.0) * CELLS as f32;
        let cell = (x as usize).min(CELLS - 1);
        let t = x - cell as f32;
        let (a, b) = (self.table[cell], self.table[cell + 1]);
        [a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])]
    }

    /// Returns the transmittance averaged over a cosine-weighted hemisphere.
    pub(crate) fn average_transmittance(&self) -> f32 {
        self.average_transmittance
    }

    /// Returns the coat's microfacets; `None` for a smooth coat.
    #[inline]
    pub fn microfacets(&self) -> Option<&TrowbridgeReitz> {
        self.microfacets.as_ref()
    }

    /// Returns the coat's index of refraction over that of the outside.
    #[inline]
    pub fn eta(&self) -> f32 {
        self.eta
    }

    /// Returns the Fresnel reflectance of the coat from outside.
    #[inline]
    pub(super) fn fresnel(&self, cos: f32) -> f32 {
        fresnel::dielectric(cos, self.eta)
    }

    /// The base's part of `f`, without `T(wo) T(wi)`: `rho / (pi eta^2) sum_{k < K} (rho F)^k`, for a base
    /// of reflectance `rho`.
    #[inline]
    pub(crate) fn base(&self, reflectance: Vec3) -> Vec3 {
        let ratio = reflectance * self.internal_reflectance;
        let mut last = Vec3::ONE;
        let (mut factor, mut n) = (ratio, self.terms);
        while n > 0 {
            if n & 1 == 1 {
                last *= factor;
            }
            factor *= factor;
            n >>= 1;
        }
        reflectance * (FRAC_1_PI / (self.eta * self.eta)) * (Vec3::ONE - last) / (Vec3::ONE - ratio)
    }
}

/// The coat's interface, seen from either side, with the quadrature to average over it.
struct Interface {
    microfacets: Option<TrowbridgeReitz>,
    thickness: f64,
    nodes: Vec<[f64; 2]>,
}

impl Interface {
    /// Returns transmittance to the base, and reflectance, from outside at cosine `mu`.
    fn seen_from_outside(&self, mu: f32, eta: f32) -> [f32; 2] {
        let mut sums = [0.0; 2];
        self.for_each_facet(mu, |w, m, weight| {
            let cos = w.dot(m);
            let reflectance = fresnel::dielectric(cos, eta);
            let up = 2.0 * cos * m - w;
            if up.z > 0.0 {
                sums[1] += weight * f64::from(reflectance * self.shadowing(w, up));
            }
            let Some(cos_t) = fresnel::transmitted_cosine(cos, eta) else { return };
            let down = (cos / eta - cos_t) * m - w / eta;
            if down.z < 0.0 {
                sums[0] += weight * f64::from((1.0 - reflectance) * self.shadowing(w, down)) * self.crossing(down);
            }
        });
        sums.map(|x| x as f32)
    }

    /// Returns the share of light from below at cosine `mu` that returns to the base, after two crossings of the coat.
    fn returned_from_below(&self, mu: f32, eta: f32) -> f32 {
        let mut sum = 0.0;
        self.for_each_facet(mu, |w, m, weight| {
            let cos = w.dot(m);
            let back = 2.0 * cos * m - w;
            if back.z > 0.0 {
                let reflectance = fresnel::dielectric(cos, 1.0 / eta) * self.shadowing(w, back);
                sum += weight * f64::from(reflectance) * self.crossing(w) * self.crossing(back);
            }
        });
        sum as f32
    }

    /// Calls `visit(w, m, weight)` for microfacet normals `m` visible from `w`, whose cosine is `mu`; the
    /// weights sum to 1.
    fn for_each_facet(&self, mu: f32, mut visit: impl FnMut(Vec3, Vec3, f64)) {
        let w = Vec3::new(((1.0 - mu) * (1.0 + mu)).sqrt(), 0.0, mu);
        let Some(microfacets) = &self.microfacets else {
            return visit(w, Vec3::Z, 1.0);
        };
        // The normal's azimuth is periodic and even: equal steps on a half turn converge fastest. Towards
        // the horizon its height goes like the root of 1 - u, which 1 - u = s^2 takes away.
        const AZIMUTHS: usize = 16;
        for j in 0..AZIMUTHS {
            let turn = 0.5 * (j as f32 + 0.5) / AZIMUTHS as f32;
            for &[s, weight] in &self.nodes {
                let m = microfacets.sample_visible(w, [turn, (1.0 - s * s) as f32]);
                visit(w, m, weight * 2.0 * s / AZIMUTHS as f64);
            }
        }
    }

    /// Returns the probability that light from a facet visible from `wo` leaves towards `wi` unshadowed: `G(wo, wi) /
    /// G1(wo)`.
    fn shadowing(&self, wo: Vec3, wi: Vec3) -> f32 {
        self.microfacets.as_ref().map_or(1.0, |m| {
            let (co, ci) = (wo.z.abs(), wi.z.abs());
            let (so, si) = (m.stretched(wo), m.stretched(wi));
            (co + so) * ci / (so * ci + si * co)
        })
    }

    /// Returns the share of light that survives one crossing of the coat along `w`.
    fn crossing(&self, w: Vec3) -> f64 {
        (-self.thickness / f64::from(w.z.abs())).exp()
    }

    /// Returns the cosine-weighted average of `f` over the hemisphere. Integrates each interval between the given
    /// `cosines`, with the resolution of a square root at its start.
    fn average(&self, cosines: &[f64], f: impl Fn(f32) -> f32) -> f64 {
        let nodes = gauss_legendre(48);
        let mut sum = 0.0;
        for piece in cosines.windows(2) {
            let width = piece[1] - piece[0];
            for &[s, weight] in &nodes {
                let mu = piece[0] + width * s * s;
                sum += weight * width * 2.0 * s * 2.0 * mu * f64::from(f(mu as f32));
            }
        }
        sum
    }
}

/// Returns nodes and weights of Gauss-Legendre quadrature on `[0, 1]`, by Newton's method.
fn gauss_legendre(n: usize) -> Vec<[f64; 2]> {
    let node = |i: usize| {
        let mut x = (std::f64::consts::PI * (i as f64 + 0.75) / (n as f64 + 0.5)).cos();
        let mut derivative = 1.0;
        for _ in 0..8 {
            let (mut p, mut before) = (1.0, 0.0);
            for k in 1..=n {
                let k = k as f64;
                (p, before) = (((2.0 * k - 1.0) * x * p - (k - 1.0) * before) / k, p);
            }
            derivative = n as f64 * (x * p - before) / (x * x - 1.0);
            x -= p / derivative;
        }
        [0.5 * (1.0 - x), 1.0 / ((1.0 - x * x) * derivative * derivative)]
    };
    (0..n).map(node).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quadrature_is_exact_for_polynomials() {
        let nodes = gauss_legendre(24);
        for power in [0, 1, 2, 9, 47] {
            let sum: f64 = nodes.iter().map(|[x, w]| w * x.powi(power)).sum();
            assert!((sum - 1.0 / f64::from(power + 1)).abs() < 1e-13, "x^{power}: {sum}");
        }
    }

    #[test]
    fn smooth_average_reflectances_meet_published_values() {
        // Average Fresnel reflectance for index 1.5: 0.0918 from outside, 0.5963 from inside, computed here
        // by the relation 1 - inside = (1 - outside) / eta^2.
        let coat = Coat::new(CoatOptions { thickness: 0.0, ..Default::default() }).unwrap();
        let outside = 1.0 - coat.average_transmittance();
        assert!((outside - 0.0918).abs() < 1e-4, "{outside}");
        let inside = 1.0 - (1.0 - outside) / 2.25;
        assert!((coat.internal_reflectance - inside).abs() < 1e-5, "{} {inside}", coat.internal_reflectance);
    }

    #[test]
    fn parameters_out_of_range_are_refused() {
        let refuse = |options| Coat::new(options).unwrap_err();
        for value in [f32::NAN, 0.0, -1.5, 11.0, f32::INFINITY] {
            assert!(matches!(refuse(CoatOptions { eta: value, ..Default::default() }), Error::Eta { .. }));
        }
        for value in [f32::NAN, -0.01, f32::INFINITY] {
            assert!(matches!(refuse(CoatOptions { thickness: value, ..Default::default() }), Error::Thickness { .. }));
        }
        assert!(matches!(refuse(CoatOptions { alpha: [0.1, -0.1], ..Default::default() }), Error::Roughness { .. }));
    }
}
