//! A dielectric coat over Lambertian reflection, as a closed formula.
//!
//! Light enters through the coat and is scattered by the base. Part of it is reflected back down by the coat and
//! scattered again before it leaves. pbrt-v4 estimates this by a random walk at every evaluation. A Lambertian base
//! scatters in the same way whatever the incident direction, so the walk's mean is a product, for any roughness of the
//! coat:
//!
//! `f = f_coat + T(wo) T(wi) rho / (pi eta^2) * sum_{k < K} (rho F)^k`
//!
//! * `f_coat`: the coat's own reflection.
//! * `rho`: the reflectance of the base; `eta`: the coat's index of refraction relative to the outside's.
//! * `T(w)`: the fraction of light from `w` that reaches the base in one pass through the coat. By reciprocity, light that
//!   leaves towards `wo` is multiplied by `T(wo) / eta^2`.
//! * `F`: the fraction of the base's light that the coat reflects back to the base.
//! * `K`: the largest number of reflections from the base. pbrt-v4's walk of depth `d` has `K = ceil(d / 2)` and drops
//!   the rest: 4 % of the base's light for `d = 10` and `rho = 0.9`.
//!
//! `T` and `F` include absorption by `exp(-thickness / |cos|)` on every crossing, as in pbrt-v4 (undocumented): 1 % per
//! crossing at the default thickness. Both are integrated over visible microfacet normals when the material is made; `T` is a
//! table over the cosine. The formula is exactly reciprocal and needs no random numbers.

use super::microfacet::TrowbridgeReitz;
use super::{Error, fresnel, interpolate};
use dapple_scene::effectively_smooth;
use glam::Vec3;
use std::f32::consts::FRAC_1_PI;

/// The number of cells of the tables over the cosine. The hardest case, the transmittance of a smooth coat, has an error below
/// 1e-4 (a relative error below 1e-3 at a cosine of 0.01).
const CELLS: usize = 256;

/// The parameters of a [`Coat`], as in pbrt-v4's `coateddiffuse` material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CoatOptions {
    /// The coat's index of refraction relative to the outside's, in `[0.1, 10]`.
    pub eta: f32,
    /// The microfacet widths along the two tangents. The coat is smooth if [`effectively_smooth`] returns true for
    /// them or `eta` is 1.
    pub alpha: [f32; 2],
    /// The optical thickness along the normal, at least 0. A crossing of the coat transmits the fraction `exp(-thickness / c)`
    /// of light, where `c` is the cosine to the normal inside the coat.
    pub thickness: f32,
    /// The largest number of events in pbrt-v4's random walk between the layers; `u32::MAX` for no limit.
    pub max_depth: u32,
}

impl Default for CoatOptions {
    /// Returns pbrt-v4's defaults: a smooth coat of index 1.5 and thickness 0.01, with at most 10 events.
    fn default() -> Self {
        Self { eta: 1.5, alpha: [0.0; 2], thickness: 0.01, max_depth: 10 }
    }
}

/// A dielectric coat over a diffuse base, tabulated once per material. The tables take 2 KiB, and about 10 ms to compute
/// (0.3 ms for a smooth coat). The reflectance of the base may vary from hit to hit.
#[derive(Clone, Debug, PartialEq)]
pub struct Coat {
    eta: f32,
    microfacets: Option<TrowbridgeReitz>,
    /// The transmittance to the base and the reflectance of the coat, at cosine `i / CELLS`.
    table: Box<[[f32; 2]]>,
    average_transmittance: f32,
    internal_reflectance: f32,
    terms: u32,
}

impl Coat {
    /// Makes a coat with these parameters and computes its tables.
    ///
    /// An anisotropic coat has the transmittance of the isotropic coat of width `sqrt(alpha_x alpha_y)`. Its own
    /// reflection is anisotropic.
    ///
    /// # Errors
    ///
    /// [`Error::Eta`], [`Error::Thickness`] or [`Error::Roughness`] if `eta`, `thickness` or a width is out of range.
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
        // Reflection from below has a kink at the critical angle, so each side of it is integrated separately.
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

    /// Returns the fraction of light from outside at this cosine that reaches the base, and the fraction that the coat
    /// reflects.
    #[inline]
    pub(crate) fn transmittance_and_reflectance(&self, cos: f32) -> [f32; 2] {
        interpolate::<CELLS>(&self.table, cos)
    }

    /// Returns the mean transmittance over a cosine-weighted hemisphere.
    pub(crate) fn average_transmittance(&self) -> f32 {
        self.average_transmittance
    }

    /// Returns the coat's microfacet distribution; `None` for a smooth coat.
    #[inline]
    pub fn microfacets(&self) -> Option<&TrowbridgeReitz> {
        self.microfacets.as_ref()
    }

    /// Returns the coat's index of refraction relative to the outside's.
    #[inline]
    pub fn eta(&self) -> f32 {
        self.eta
    }

    /// Returns the Fresnel reflectance of the coat's interface, from outside at this cosine.
    #[inline]
    pub(super) fn fresnel(&self, cos: f32) -> f32 {
        fresnel::dielectric(cos, self.eta)
    }

    /// Returns the base's part of `f` without `T(wo) T(wi)`, for a base of this reflectance `rho`: `rho / (pi eta^2)
    /// sum_{k < K} (rho F)^k`.
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

/// The coat's interface, for light from either side, with the quadrature nodes for averages.
struct Interface {
    microfacets: Option<TrowbridgeReitz>,
    thickness: f64,
    nodes: Vec<[f64; 2]>,
}

impl Interface {
    /// Returns the transmittance to the base and the reflectance, for light from outside at cosine `mu`.
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

    /// Returns the fraction of light from below at cosine `mu` that the coat reflects back to the base, including absorption
    /// in two crossings.
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

    /// Calls `visit(w, m, weight)` for microfacet normals `m` visible from the direction `w` with cosine `mu`. The weights sum
    /// to 1.
    fn for_each_facet(&self, mu: f32, mut visit: impl FnMut(Vec3, Vec3, f64)) {
        let w = Vec3::new(((1.0 - mu) * (1.0 + mu)).sqrt(), 0.0, mu);
        let Some(microfacets) = &self.microfacets else {
            return visit(w, Vec3::Z, 1.0);
        };
        // The integrand is periodic and even in the azimuth, so equal steps over half a turn converge fastest. Towards
        // the horizon, the normal's height is proportional to the root of 1 - u; substituting 1 - u = s^2 removes the
        // root.
        const AZIMUTHS: usize = 16;
        for j in 0..AZIMUTHS {
            let turn = 0.5 * (j as f32 + 0.5) / AZIMUTHS as f32;
            for &[s, weight] in &self.nodes {
                let m = microfacets.sample_visible(w, [turn, (1.0 - s * s) as f32]);
                visit(w, m, weight * 2.0 * s / AZIMUTHS as f64);
            }
        }
    }

    /// Returns the probability that light scattered by a visible facet from `wo` towards `wi` is not shadowed: `G(wo, wi) /
    /// G1(wo)`.
    fn shadowing(&self, wo: Vec3, wi: Vec3) -> f32 {
        self.microfacets.as_ref().map_or(1.0, |m| {
            let (co, ci) = (wo.z.abs(), wi.z.abs());
            let (so, si) = (m.stretched(wo), m.stretched(wi));
            (co + so) * ci / (so * ci + si * co)
        })
    }

    /// Returns the fraction of light that one crossing of the coat along `w` does not absorb.
    fn crossing(&self, w: Vec3) -> f64 {
        (-self.thickness / f64::from(w.z.abs())).exp()
    }

    /// Returns the cosine-weighted average of `f` over the hemisphere. The intervals between consecutive `cosines` are
    /// integrated separately; `f` may behave like a square root at the start of each.
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

/// Returns the nodes and weights of Gauss-Legendre quadrature on `[0, 1]`, computed by Newton's method.
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
