//! Fresnel reflectance of smooth interfaces, for unpolarised light.

use glam::Vec3;

/// Returns the Fresnel reflectance of a dielectric interface.
///
/// `cos` is the cosine on the side that light comes from, in `[0, 1]` (clamped); `eta` the index of
/// refraction beyond the interface over that before it. 1 on total internal reflection. Fresnel's
/// equations as in [Pharr et al. 2023, eq. 9.6].
#[inline]
pub fn dielectric(cos: f32, eta: f32) -> f32 {
    match transmitted_cosine(cos, eta) {
        None => 1.0,
        Some(cos_t) => dielectric_between(cos.clamp(0.0, 1.0), cos_t, eta),
    }
}

/// Returns the Fresnel reflectance of [`dielectric`] from the cosines on both sides, each in `[0, 1]`, not both 0.
#[inline]
pub(crate) fn dielectric_between(cos: f32, cos_t: f32, eta: f32) -> f32 {
    let parallel = (eta * cos - cos_t) / (eta * cos + cos_t);
    let perpendicular = (cos - eta * cos_t) / (cos + eta * cos_t);
    0.5 * (parallel * parallel + perpendicular * perpendicular)
}

/// Returns the reflectance of a pane: both of its faces and all reflections between them, `R + T^2 R / (1 - R^2)` for a
/// face's `R = 1 - T` [Pharr et al. 2023, sec. 9.5.2]. The rest of the light passes straight through.
#[inline]
pub fn pane(cos: f32, eta: f32) -> f32 {
    let face = dielectric(cos, eta);
    // The sum in short. A face that reflects all is a pane that does.
    2.0 * face / (1.0 + face)
}

/// Returns the cosine beyond a dielectric interface by Snell's law, with the arguments of [`dielectric`]; `None` on
/// total internal reflection.
#[inline]
pub fn transmitted_cosine(cos: f32, eta: f32) -> Option<f32> {
    let cos = cos.clamp(0.0, 1.0);
    let sin2 = (1.0 - cos) * (1.0 + cos) / (eta * eta);
    (sin2 < 1.0).then(|| (1.0 - sin2).sqrt())
}

/// A metal's index of refraction `eta + i k` over that of the medium around it, per channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ComplexIor {
    /// The real part of the index, per channel.
    pub eta: Vec3,
    /// The imaginary part of the index, per channel.
    pub k: Vec3,
}

impl ComplexIor {
    /// Returns the index with real part 1 that reflects `reflectance` at normal incidence, as pbrt-v4's conductor with
    /// a reflectance does: `k = 2 sqrt(r / (1 - r))`, `r` clamped to `[0, 0.9999]`.
    pub fn from_reflectance(reflectance: Vec3) -> Self {
        let k = reflectance.to_array().map(|r| {
            let r = if r > 0.0 { r.min(0.9999) } else { 0.0 };
            2.0 * (r / (1.0 - r)).sqrt()
        });
        Self { eta: Vec3::ONE, k: Vec3::from_array(k) }
    }

    /// Returns the reflectance per channel at this cosine, clamped to `[0, 1]`.
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

/// Returns the reflectance of a conductor at a cosine, in real arithmetic. With `(a + i b)^2 = (eta + i k)^2 - sin^2`,
/// `Rs = |cos - (a + i b)|^2 / |cos + (a + i b)|^2` and `Rp = Rs |cos (a + i b) - sin^2|^2 / |cos (a + i b) +
/// sin^2|^2`.
#[inline]
fn conductor(cos: f32, eta: f32, k: f32) -> f32 {
    let cos2 = cos * cos;
    let sin2 = 1.0 - cos2;
    // eta^2 - k^2 - sin^2, without cancellation where eta is near 1.
    let real = (eta - 1.0) * (eta + 1.0) - k * k + cos2;
    let imaginary = 2.0 * eta * k;
    let modulus = (real * real + imaginary * imaginary).sqrt();
    // Of the two roots of the modulus +- the real part, take the one without cancellation; a b = eta k.
    let larger = (0.5 * (modulus + real.abs())).sqrt();
    let smaller = if larger > 0.0 { 0.5 * imaginary / larger } else { 0.0 };
    let a = if real >= 0.0 { larger } else { smaller };
    let s = modulus + cos2;
    let d = 2.0 * cos * a;
    let rs = (s - d) / (s + d);
    let p = cos2 * modulus + sin2 * sin2;
    let q = d * sin2;
    // Grazing along a medium that is no medium (eta 1, k 0) is 0/0: nothing is reflected there.
    if !(s + d > 0.0) || !(p + q > 0.0) {
        return 0.0;
    }
    (0.5 * rs * (1.0 + (p - q) / (p + q))).clamp(0.0, 1.0)
}
