//! Fresnel reflectance of smooth interfaces, for unpolarised light.

use glam::Vec3;

/// Returns the Fresnel reflectance of a dielectric interface.
///
/// `cos` is the cosine of the angle of incidence, clamped to `[0, 1]`. `eta` is the index of refraction on the transmitted side
/// relative to the incident side. The result is 1 on total internal reflection [Pharr et al. 2023, eq. 9.6].
#[inline]
pub fn dielectric(cos: f32, eta: f32) -> f32 {
    match transmitted_cosine(cos, eta) {
        None => 1.0,
        Some(cos_t) => dielectric_between(cos.clamp(0.0, 1.0), cos_t, eta),
    }
}

/// Returns the reflectance as [`dielectric`] does, from the cosines on both sides, each in `[0, 1]` and not both 0.
#[inline]
pub(crate) fn dielectric_between(cos: f32, cos_t: f32, eta: f32) -> f32 {
    let parallel = (eta * cos - cos_t) / (eta * cos + cos_t);
    let perpendicular = (cos - eta * cos_t) / (cos + eta * cos_t);
    0.5 * (parallel * parallel + perpendicular * perpendicular)
}

/// Returns the reflectance of a thin pane, with all reflections between its two faces: `R + T^2 R / (1 - R^2)`, where `R` is
/// the reflectance [`dielectric`]`(cos, eta)` of one face and `T = 1 - R` [Pharr et al. 2023, sec. 9.5.2].
#[inline]
pub fn pane(cos: f32, eta: f32) -> f32 {
    let face = dielectric(cos, eta);
    // The closed form of the sum; it is also valid for a face of reflectance 1.
    2.0 * face / (1.0 + face)
}

/// Returns the cosine of the angle of refraction by Snell's law, or `None` on total internal reflection. `cos` and `eta` are as
/// in [`dielectric`].
#[inline]
pub fn transmitted_cosine(cos: f32, eta: f32) -> Option<f32> {
    let cos = cos.clamp(0.0, 1.0);
    let sin2 = (1.0 - cos) * (1.0 + cos) / (eta * eta);
    (sin2 < 1.0).then(|| (1.0 - sin2).sqrt())
}

/// A metal's complex index of refraction `eta + i k` relative to the surrounding medium, per channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ComplexIor {
    /// The real part of the index, per linear RGB channel.
    pub eta: Vec3,
    /// The imaginary part of the index, per linear RGB channel.
    pub k: Vec3,
}

impl ComplexIor {
    /// Returns the index with `eta = 1` and this reflectance at normal incidence, as in pbrt-v4: `k = 2 sqrt(r / (1 - r))`,
    /// where `r` is `reflectance` clamped to `[0, 0.9999]`.
    pub fn from_reflectance(reflectance: Vec3) -> Self {
        let k = reflectance.to_array().map(|r| {
            let r = if r > 0.0 { r.min(0.9999) } else { 0.0 };
            2.0 * (r / (1.0 - r)).sqrt()
        });
        Self { eta: Vec3::ONE, k: Vec3::from_array(k) }
    }

    /// Returns the reflectance per channel. `cos` is the cosine of the angle of incidence, clamped to `[0, 1]`.
    #[inline]
    pub fn reflectance(&self, cos: f32) -> Vec3 {
        let cos = cos.clamp(0.0, 1.0);
        Vec3::new(
            conductor(cos, self.eta.x, self.k.x),
            conductor(cos, self.eta.y, self.k.y),
            conductor(cos, self.eta.z, self.k.z),
        )
    }
}

/// Returns the reflectance of a conductor at a cosine, computed in real arithmetic. Let
/// `(a + i b)^2 = (eta + i k)^2 - sin^2`. The reflectance is the mean of `Rs = |cos - (a + i b)|^2 / |cos + (a + i b)|^2`
/// and `Rp = Rs |cos (a + i b) - sin^2|^2 / |cos (a + i b) + sin^2|^2`.
#[inline]
fn conductor(cos: f32, eta: f32, k: f32) -> f32 {
    let cos2 = cos * cos;
    let sin2 = 1.0 - cos2;
    // eta^2 - k^2 - sin^2, without cancellation if eta is near 1.
    let real = (eta - 1.0) * (eta + 1.0) - k * k + cos2;
    let imaginary = 2.0 * eta * k;
    let modulus = (real * real + imaginary * imaginary).sqrt();
    // One of the two roots (modulus plus or minus the real part) has no cancellation; the other follows from a b = eta
    // k.
    let larger = (0.5 * (modulus + real.abs())).sqrt();
    let smaller = if larger > 0.0 { 0.5 * imaginary / larger } else { 0.0 };
    let a = if real >= 0.0 { larger } else { smaller };
    let s = modulus + cos2;
    let d = 2.0 * cos * a;
    let rs = (s - d) / (s + d);
    let p = cos2 * modulus + sin2 * sin2;
    let q = d * sin2;
    // Grazing incidence on a medium equal to its surroundings (eta 1, k 0) is 0/0; nothing is reflected there.
    if !(s + d > 0.0) || !(p + q > 0.0) {
        return 0.0;
    }
    (0.5 * rs * (1.0 + (p - q) / (p + q))).clamp(0.0, 1.0)
}
