//! Microfacet models of rough surfaces: the Trowbridge-Reitz (GGX) distribution with Smith's masking and shadowing.

use super::Error;
use super::trigonometry::sin_cos_turn;
use glam::Vec3;
use std::f32::consts::PI;

/// The Trowbridge-Reitz (GGX) distribution of microfacet normals, with widths `alpha` along the x and y axes.
///
/// All directions are in the shading frame. All but half vectors `h` are unit vectors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrowbridgeReitz {
    alpha: [f32; 2],
}

impl TrowbridgeReitz {
    /// Makes the distribution with these widths, each in `[0, 10]`. Widths below 1e-4 are raised to 1e-4, as in
    /// pbrt-v4.
    ///
    /// # Errors
    ///
    /// [`Error::Roughness`] if a width is NaN or outside `[0, 10]`.
    pub fn new(alpha: [f32; 2]) -> Result<Self, Error> {
        match alpha.into_iter().find(|a| !(0.0..=10.0).contains(a)) {
            Some(value) => Err(Error::Roughness { value }),
            None => Ok(Self { alpha: alpha.map(|a| a.max(1e-4)) }),
        }
    }

    /// Makes the distribution with these widths clamped to `[1e-4, 10]`. NaN becomes 1e-4.
    #[inline]
    #[expect(clippy::manual_clamp, reason = "`max` takes the other where one is NaN")]
    pub fn nearest(alpha: [f32; 2]) -> Self {
        Self { alpha: alpha.map(|a| a.max(1e-4).min(10.0)) }
    }

    /// Returns the widths along the x and y axes.
    pub fn alpha(&self) -> [f32; 2] {
        self.alpha
    }

    /// Returns the density `D` of microfacet normals in the direction of `h` (of any length, `h.z > 0`), per unit area
    /// of the surface and per steradian [Walter et al. 2007, eq. 33, anisotropic].
    #[inline]
    pub fn normals(&self, h: Vec3) -> f32 {
        let [ax, ay] = self.alpha;
        let (x, y) = (h.x / ax, h.y / ay);
        let ratio = h.length_squared() / (x * x + y * y + h.z * h.z);
        ratio * ratio / (PI * ax * ay)
    }

    /// Returns the length `|(ax x, ay y, z)|` for `w = (x, y, z)` and the widths `[ax, ay]`. Smith's `Lambda(w)` is
    /// `(stretched(w) / |w.z| - 1) / 2`.
    #[inline]
    pub fn stretched(&self, w: Vec3) -> f32 {
        let (x, y) = (self.alpha[0] * w.x, self.alpha[1] * w.y);
        (x * x + y * y + w.z * w.z).sqrt()
    }

    /// Returns Smith's masking term `G1`: the fraction of the microfacets facing `w` that are visible from `w`.
    #[inline]
    pub(crate) fn masking(&self, w: Vec3) -> f32 {
        let cos = w.z.abs();
        2.0 * cos / (cos + self.stretched(w))
    }

    /// Returns the height-correlated masking and shadowing term, `1 / (1 + Lambda(wo) + Lambda(wi))` [Heitz 2014, eq.
    /// 99]. The two directions may be on different sides.
    #[inline]
    pub(crate) fn masking_shadowing(&self, wo: Vec3, wi: Vec3) -> f32 {
        let (co, ci) = (wo.z.abs(), wi.z.abs());
        2.0 * co * ci / (self.stretched(wo) * ci + self.stretched(wi) * co)
    }

    /// Samples the unit normal of a microfacet visible from `w`, for `w.z > 0`, by spherical caps [Dupuy and Benyoub
    /// 2023].
    #[inline]
    pub(crate) fn sample_visible(&self, w: Vec3, u: [f32; 2]) -> Vec3 {
        let [ax, ay] = self.alpha;
        let v = Vec3::new(ax * w.x, ay * w.y, w.z).normalize();
        let (sin, cos) = sin_cos_turn(u[0]);
        // The cap's point c has z = (1 - u)(1 + v.z) - v.z. Its sine and c.z + v.z are computed without cancellation,
        // which would cost half the digits at a grazing v or if u is near 0 or 1.
        let below = u[1] * (1.0 + v.z);
        let above = (1.0 - u[1]) * (1.0 + v.z);
        let one_minus_v = (v.x * v.x + v.y * v.y) / (1.0 + v.z);
        let radius = (below * (above + one_minus_v)).sqrt();
        Vec3::new(ax * (radius * cos + v.x), ay * (radius * sin + v.y), above).normalize()
    }

    /// Returns the solid-angle density of reflecting `wo` at a visible normal, given `h = wo + wi`. It is the density
    /// of visible normals, `G1(wo) max(0, wo . wm) D(wm) / wo.z`, divided by `4 wo . wm`; the scalar product cancels.
    #[inline]
    pub(super) fn reflection_pdf(&self, wo: Vec3, h: Vec3) -> f32 {
        self.normals(h) / (2.0 * (wo.z + self.stretched(wo)))
    }

    /// Returns `D G / (4 cos cos)`, the reflection lobe without its Fresnel term, given `h = wo + wi`. It is exactly
    /// symmetric in the two directions.
    #[inline]
    pub(super) fn reflection(&self, wo: Vec3, wi: Vec3, h: Vec3) -> f32 {
        self.normals(h) / (2.0 * (self.stretched(wo) * wi.z + self.stretched(wi) * wo.z))
    }
}

/// Returns the cosine between two unit vectors' half vector and either of them: half the length of their sum `h`. Unlike a
/// scalar product, it is exactly symmetric and precise at grazing angles.
#[inline]
pub(super) fn half_angle_cosine(h: Vec3) -> f32 {
    0.5 * h.length()
}
