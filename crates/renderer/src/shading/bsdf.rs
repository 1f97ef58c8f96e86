//! The BSDF at a point of a surface.

use super::coat::Coat;
use super::dielectric::{self, DiffuseTransmission, RoughDielectric, SmoothDielectric, Tint};
use super::fresnel::{self, ComplexIor};
use super::layered::{Layered, Plastic, Substrate};
use super::metal_coat::MetalCoat;
use super::microfacet::{TrowbridgeReitz, half_angle_cosine};
use super::{BsdfSample, ShadingFrame, mirror, warp};
use dapple_scene::effectively_smooth;
use glam::Vec3;
use std::f32::consts::{FRAC_1_PI, PI};

/// The largest microfacet width of a lobe that counts as smooth for the denoiser's features.
///
/// A lobe of width 0.02 spans 2 degrees, so that its reflections show detail. With a limit of 0.1, features blur more than they
/// preserve on four of six scenes.
const NARROW: f32 = 0.02;

/// The BSDF at a surface point, with its textures already evaluated.
///
/// A small `Copy` value made at each hit. Opaque surfaces transmit nothing and scatter alike on both sides: if `wo` is below
/// the surface, `wo` and `wi` are negated.
///
/// All directions are unit vectors in the shading frame and point away from the surface. Shading and geometric normals may
/// differ, so the caller must reject directions that would leak through the geometric surface.
#[derive(Clone, Copy, Debug)]
pub enum Bsdf<'m> {
    /// Lambertian reflection.
    Diffuse {
        /// The fraction of light reflected, per channel.
        reflectance: Vec3,
    },
    /// A rough metal.
    Conductor {
        /// The metal's complex index of refraction relative to the outside's.
        ior: ComplexIor,
        /// The metal's microfacet distribution.
        microfacets: TrowbridgeReitz,
    },
    /// A smooth metal, which reflects like a mirror.
    SmoothConductor {
        /// The metal's complex index of refraction relative to the outside's.
        ior: ComplexIor,
    },
    /// A dielectric coat, rough or smooth, over Lambertian reflection; made by [`Bsdf::coated_diffuse`].
    CoatedDiffuse {
        /// The coat, with its tables.
        coat: &'m Coat,
        /// The base's contribution to `f` with all repeated reflections, but without the coat's transmittance in both
        /// directions.
        base: Vec3,
    },
    /// A dielectric coat over a metal; each layer is rough or smooth. Made by [`Bsdf::coated_conductor`].
    CoatedConductor {
        /// The coat, with its tables for light reflected by the metal below.
        coat: &'m MetalCoat,
        /// The metal's complex index of refraction relative to the coat's.
        ior: ComplexIor,
        /// The metal's approximate reflectance, which determines the probability of sampling the coat's own
        /// reflection.
        bright: f32,
    },
    /// A rough interface of glass; made by [`Bsdf::dielectric`].
    Dielectric(RoughDielectric),
    /// A smooth interface of glass; made by [`Bsdf::dielectric`].
    SmoothDielectric(SmoothDielectric),
    /// A thin pane of glass, with the reflections of both faces.
    ThinDielectric {
        /// The index of refraction of the glass relative to the outside's.
        eta: f32,
    },
    /// Lambertian reflection, and Lambertian transmission to the other side.
    DiffuseTransmission(DiffuseTransmission),
    /// A mirror whose reflectance does not depend on the angle.
    Mirror {
        /// The fraction of light reflected, per channel.
        reflectance: Vec3,
    },
    /// The sum of Lambertian and glossy reflection, as pbrt-v3's `plastic`.
    Plastic(Plastic),
    /// Lambertian reflection below a glossy layer that reduces it [Ashikhmin and Shirley 2000].
    Substrate(Substrate),
    /// Lambertian reflection below a glossy layer and a clear coat, as in glTF.
    Layered(Layered<'m>),
}

impl<'m> Bsdf<'m> {
    /// Makes a metal with microfacet widths `alpha`. The metal is smooth if [`effectively_smooth`] returns true for `alpha`,
    /// else rough.
    ///
    /// # Errors
    ///
    /// The errors of [`TrowbridgeReitz::new`].
    pub fn conductor(ior: ComplexIor, alpha: [f32; 2]) -> Result<Self, super::Error> {
        let microfacets = TrowbridgeReitz::new(alpha)?;
        Ok(if effectively_smooth(alpha) { Self::SmoothConductor { ior } } else { Self::Conductor { ior, microfacets } })
    }

    /// Makes the BSDF of a coat over a diffuse base with this `reflectance`, clamped to `[0, 1]`.
    #[inline]
    pub fn coated_diffuse(coat: &'m Coat, reflectance: Vec3) -> Self {
        Self::CoatedDiffuse { coat, base: coat.base(reflectance.clamp(Vec3::ZERO, Vec3::ONE)) }
    }

    /// Makes a coat over a metal. `ior` is the metal's index of refraction relative to the medium outside the coat.
    #[inline]
    pub fn coated_conductor(coat: &'m MetalCoat, ior: ComplexIor) -> Self {
        let ior = coat.below(ior);
        Self::CoatedConductor { coat, ior, bright: ior.reflectance(1.0).element_sum() / 3.0 }
    }

    /// Makes glass with microfacet widths `alpha`. `eta` is the index of refraction inside relative to the one
    /// outside. The glass is smooth if [`effectively_smooth`] returns true for `alpha` or if `eta` is 1, else rough.
    ///
    /// # Errors
    ///
    /// [`Error::Eta`](super::Error::Eta) if `eta` is outside `[0.1, 10]`. The errors of [`TrowbridgeReitz::new`] for
    /// `alpha`.
    pub fn dielectric(eta: f32, alpha: [f32; 2], tint: Tint) -> Result<Self, super::Error> {
        if !(0.1..=10.0).contains(&eta) {
            return Err(super::Error::Eta { value: eta });
        }
        let microfacets = TrowbridgeReitz::new(alpha)?;
        Ok(if effectively_smooth(alpha) || eta == 1.0 {
            Self::SmoothDielectric(SmoothDielectric { eta, tint })
        } else {
            Self::Dielectric(RoughDielectric { eta, microfacets, tint })
        })
    }

    /// Returns the world-space direction `v` in the shading frame. For Lambertian reflection, which needs only z, x and y are
    /// 0.
    #[inline(always)]
    pub(crate) fn local(&self, frame: &ShadingFrame, v: Vec3) -> Vec3 {
        match self {
            Self::Diffuse { .. } => Vec3::new(0.0, 0.0, v.dot(frame.normal)),
            _ => frame.to_local(v),
        }
    }

    /// Returns `f(wo, wi)` per steradian, without the cosine. Returns 0 for specular lobes, and for directions on
    /// different sides of an opaque surface.
    #[inline]
    pub fn evaluate(&self, wo: Vec3, wi: Vec3) -> Vec3 {
        self.evaluate_and_pdf(wo, wi).0
    }

    /// Returns the solid-angle density with which [`sample`](Self::sample) samples `wi`. Returns 0 for specular lobes,
    /// and for directions on different sides of an opaque surface.
    #[inline]
    pub fn pdf(&self, wo: Vec3, wi: Vec3) -> f32 {
        self.evaluate_and_pdf(wo, wi).1
    }

    /// Returns [`evaluate`](Self::evaluate) and [`pdf`](Self::pdf), which is faster than two calls.
    #[inline(always)]
    pub fn evaluate_and_pdf(&self, wo: Vec3, wi: Vec3) -> (Vec3, f32) {
        if let Self::Diffuse { reflectance } = self {
            // The most common BSDF is inlined, with the same numbers as in `evaluate_above`.
            let same_side = (wo.z > 0.0 && wi.z > 0.0) || (wo.z < 0.0 && wi.z < 0.0);
            return if same_side { (*reflectance * FRAC_1_PI, wi.z.abs() * FRAC_1_PI) } else { (Vec3::ZERO, 0.0) };
        }
        self.evaluate_others(wo, wi)
    }

    /// Samples `wi` with density [`pdf`](Self::pdf). `lobe` in `[0, 1)` selects the lobe, and `u` in `[0, 1)^2` the
    /// direction. Returns `None` if nothing is scattered; the sample then contributes 0.
    #[inline(always)]
    pub fn sample(&self, wo: Vec3, u: [f32; 2], lobe: f32) -> Option<BsdfSample> {
        let Self::Diffuse { reflectance } = self else { return self.sample_others(wo, u, lobe) };
        let side = if wo.z > 0.0 { 1.0 } else { -1.0 };
        if !(side * wo.z > 0.0) {
            return None;
        }
        // The cosine in the weight cancels with the one in the density.
        let wi = warp::cosine_hemisphere(u);
        let pdf = wi.z * FRAC_1_PI;
        Some(BsdfSample { wi: side * wi, weight: *reflectance, pdf, specular: false, eta: 1.0 })
    }

    /// Samples as [`sample`](Self::sample) does, for all BSDFs but Lambertian reflection.
    fn sample_others(&self, wo: Vec3, u: [f32; 2], lobe: f32) -> Option<BsdfSample> {
        let side = if wo.z > 0.0 { 1.0 } else { -1.0 };
        let given = wo;
        let wo = side * wo;
        if !(wo.z > 0.0) {
            return None;
        }
        let mirrored = |weight: Vec3, pdf: f32| {
            let wi = side * Vec3::new(-wo.x, -wo.y, wo.z);
            Some(BsdfSample { wi, weight, pdf, specular: true, eta: 1.0 })
        };
        let drawn = |wi: Vec3, (f, pdf): (Vec3, f32)| {
            let weight = f * (wi.z / pdf);
            (pdf > 0.0).then(|| BsdfSample { wi: side * wi, weight, pdf, specular: false, eta: 1.0 })
        };
        let glossy = |m: &TrowbridgeReitz, chance: f32| match lobe < chance {
            true => mirror(wo, m.sample_visible(wo, u)),
            false => warp::cosine_hemisphere(u),
        };
        let wi;
        let found = match self {
            Self::Dielectric(glass) => return glass.sample(given, u, lobe),
            Self::SmoothDielectric(glass) => return glass.sample(given, lobe),
            Self::ThinDielectric { eta } => return Some(dielectric::sample_pane(*eta, given, lobe)),
            Self::DiffuseTransmission(sheet) => {
                let chance = sheet.chance();
                let wi = warp::cosine_hemisphere(u);
                let (weight, pdf, side) = match lobe < chance {
                    true => (sheet.reflectance / chance, chance, side),
                    false => (sheet.transmittance / (1.0 - chance), 1.0 - chance, -side),
                };
                let pdf = pdf * wi.z * FRAC_1_PI;
                return Some(BsdfSample { wi: side * wi, weight, pdf, specular: false, eta: 1.0 });
            }
            Self::Mirror { reflectance } => return mirrored(*reflectance, 1.0),
            Self::SmoothConductor { ior } => return mirrored(ior.reflectance(wo.z), 1.0),
            Self::CoatedConductor { coat, ior, bright } => {
                let sample = coat.sample(ior, *bright, wo, u, lobe)?;
                return Some(BsdfSample { wi: side * sample.wi, ..sample });
            }
            Self::Diffuse { .. } => {
                wi = warp::cosine_hemisphere(u);
                self.evaluate_above(wo, wi)
            }
            Self::Conductor { microfacets, .. } => {
                wi = mirror(wo, microfacets.sample_visible(wo, u));
                self.evaluate_above(wo, wi)
            }
            Self::CoatedDiffuse { coat, base } => {
                let seen = CoatSeen::new(coat, *base, wo);
                wi = match coat.microfacets() {
                    None if lobe < seen.chance => {
                        return mirrored(Vec3::splat(coat.fresnel(wo.z) / seen.chance), seen.chance);
                    }
                    Some(microfacets) => glossy(microfacets, seen.chance),
                    None => warp::cosine_hemisphere(u),
                };
                seen.evaluate_above(coat, *base, wo, wi)
            }
            Self::Plastic(plastic) => {
                let chance = plastic.chance(wo);
                wi = glossy(&plastic.microfacets, chance);
                plastic.evaluate_above(wo, wi, chance)
            }
            Self::Substrate(substrate) => {
                let chance = substrate.chance(wo);
                wi = glossy(&substrate.microfacets, chance);
                substrate.evaluate_above(wo, wi, chance)
            }
            Self::Layered(layered) => {
                wi = layered.sample(wo, u, lobe);
                layered.evaluate_above(wo, wi)
            }
        };
        if wi.z > 0.0 { drawn(wi, found) } else { None }
    }

    /// Returns true if every lobe is specular, so that light sampling finds nothing.
    #[inline]
    pub fn is_specular(&self) -> bool {
        match self {
            Self::SmoothConductor { .. }
            | Self::SmoothDielectric { .. }
            | Self::ThinDielectric { .. }
            | Self::Mirror { .. } => true,
            Self::CoatedConductor { coat, .. } => coat.is_specular(),
            _ => false,
        }
    }

    /// Returns true if light may be transmitted, that is, scattered to the other side of the surface.
    #[inline]
    pub fn transmits(&self) -> bool {
        matches!(
            self,
            Self::Dielectric(_)
                | Self::SmoothDielectric(_)
                | Self::ThinDielectric { .. }
                | Self::DiffuseTransmission(_)
        )
    }

    /// Returns the approximate fraction of light scattered, per channel. It is a feature for denoisers, not used for
    /// light transport.
    pub fn albedo(&self) -> Vec3 {
        match self {
            Self::Diffuse { reflectance } | Self::Mirror { reflectance } => *reflectance,
            Self::Conductor { ior, .. } | Self::SmoothConductor { ior } => ior.reflectance(1.0),
            Self::CoatedDiffuse { coat, base } => {
                let [transmittance, reflectance] = coat.transmittance_and_reflectance(1.0);
                *base * (PI * transmittance * coat.average_transmittance()) + reflectance
            }
            Self::CoatedConductor { coat, ior, .. } => coat.albedo(ior.reflectance(1.0)),
            Self::Dielectric(RoughDielectric { eta, tint, .. })
            | Self::SmoothDielectric(SmoothDielectric { eta, tint }) => {
                let reflectance = fresnel::dielectric(1.0, *eta);
                tint.reflectance * reflectance + tint.transmittance * (1.0 - reflectance)
            }
            Self::ThinDielectric { .. } => Vec3::ONE,
            Self::DiffuseTransmission(sheet) => sheet.reflectance + sheet.transmittance,
            Self::Plastic(plastic) => plastic.albedo(),
            Self::Substrate(substrate) => substrate.albedo(),
            Self::Layered(layered) => layered.albedo(),
        }
    }

    /// Returns the width of the widest lobe: 0 for a mirror, 1 for Lambertian reflection. It is a feature for
    /// denoisers, not used for light transport.
    pub fn roughness(&self) -> f32 {
        let width = |m: &TrowbridgeReitz| (m.alpha()[0] * m.alpha()[1]).sqrt();
        match self {
            Self::Diffuse { .. }
            | Self::CoatedDiffuse { .. }
            | Self::DiffuseTransmission(_)
            | Self::Plastic(_)
            | Self::Substrate(_) => 1.0,
            Self::Layered(layered) if layered.diffuse() == Vec3::ZERO => width(&layered.microfacets),
            Self::Layered(_) => 1.0,
            Self::Conductor { microfacets, .. } => width(microfacets),
            Self::Dielectric(glass) => width(&glass.microfacets),
            Self::CoatedConductor { coat, .. } => coat.roughness(),
            Self::SmoothConductor { .. }
            | Self::SmoothDielectric(_)
            | Self::ThinDielectric { .. }
            | Self::Mirror { .. } => 0.0,
        }
    }

    /// Returns true if [`sample`](Self::sample) with this `lobe` samples a non-specular lobe so narrow that its reflections and
    /// refractions show detail. The result affects features for denoisers, but not light transport.
    #[inline(never)]
    pub fn samples_narrow_lobe(&self, wo: Vec3, lobe: f32) -> bool {
        let narrow = |m: &TrowbridgeReitz| m.alpha()[0].max(m.alpha()[1]) <= NARROW;
        let wo = Vec3::new(wo.x, wo.y, wo.z.abs());
        match self {
            Self::Conductor { microfacets, .. } => narrow(microfacets),
            Self::Dielectric(glass) => narrow(&glass.microfacets),
            Self::CoatedDiffuse { coat, base } => {
                coat.microfacets().is_some_and(narrow) && lobe < CoatSeen::new(coat, *base, wo).chance
            }
            Self::CoatedConductor { coat, bright, .. } => match coat.samples_coat(*bright, wo, lobe) {
                true => coat.coat().microfacets().is_some_and(narrow),
                false => coat.roughness() <= NARROW,
            },
            Self::Plastic(plastic) => narrow(&plastic.microfacets) && lobe < plastic.chance(wo),
            Self::Substrate(substrate) => narrow(&substrate.microfacets) && lobe < substrate.chance(wo),
            Self::Layered(layered) => layered.sampled(wo, lobe).is_some_and(narrow),
            _ => false,
        }
    }

    /// Evaluates as [`evaluate_and_pdf`](Self::evaluate_and_pdf) does, for all BSDFs but Lambertian reflection.
    fn evaluate_others(&self, wo: Vec3, wi: Vec3) -> (Vec3, f32) {
        match (self, to_upper_side(wo, wi)) {
            (Self::Dielectric(glass), _) => glass.evaluate_and_pdf(wo, wi),
            (Self::DiffuseTransmission(sheet), Some((_, wi))) => {
                (sheet.reflectance * FRAC_1_PI, sheet.chance() * (wi.z * FRAC_1_PI))
            }
            (Self::DiffuseTransmission(sheet), None) => match to_upper_side(wo, -wi) {
                Some((_, wi)) => (sheet.transmittance * FRAC_1_PI, (1.0 - sheet.chance()) * (wi.z * FRAC_1_PI)),
                None => (Vec3::ZERO, 0.0),
            },
            (_, Some((wo, wi))) => self.evaluate_above(wo, wi),
            (_, None) => (Vec3::ZERO, 0.0),
        }
    }

    /// Returns `f` and the density of an opaque surface for two directions with positive z.
    #[inline]
    fn evaluate_above(&self, wo: Vec3, wi: Vec3) -> (Vec3, f32) {
        match self {
            Self::Diffuse { reflectance } => (*reflectance * FRAC_1_PI, wi.z * FRAC_1_PI),
            Self::Conductor { ior, microfacets } => {
                let h = wo + wi;
                let f = ior.reflectance(half_angle_cosine(h)) * microfacets.reflection(wo, wi, h);
                (f, microfacets.reflection_pdf(wo, h))
            }
            Self::CoatedDiffuse { coat, base } => CoatSeen::new(coat, *base, wo).evaluate_above(coat, *base, wo, wi),
            Self::CoatedConductor { coat, ior, bright } => coat.evaluate_above(ior, *bright, wo, wi),
            Self::Plastic(plastic) => plastic.evaluate_above(wo, wi, plastic.chance(wo)),
            Self::Substrate(substrate) => substrate.evaluate_above(wo, wi, substrate.chance(wo)),
            Self::Layered(layered) => layered.evaluate_above(wo, wi),
            Self::SmoothConductor { .. }
            | Self::Mirror { .. }
            | Self::Dielectric(_)
            | Self::SmoothDielectric(_)
            | Self::ThinDielectric { .. }
            | Self::DiffuseTransmission(_) => (Vec3::ZERO, 0.0),
        }
    }
}

/// The values of a coat over Lambertian reflection that depend only on `wo`.
struct CoatSeen {
    transmittance: f32,
    /// The probability of sampling the coat's own reflection: its fraction of the reflected light.
    chance: f32,
}

impl CoatSeen {
    #[inline]
    fn new(coat: &Coat, base: Vec3, wo: Vec3) -> Self {
        let [transmittance, reflectance] = coat.transmittance_and_reflectance(wo.z);
        let below = base.element_sum() / 3.0 * (PI * transmittance * coat.average_transmittance());
        let sum = reflectance + below;
        // Nothing is reflected if the index is 1 over a black base; sampling the base then gives 0.
        Self { transmittance, chance: if sum > 0.0 { reflectance / sum } else { 0.0 } }
    }

    /// Returns `f` and the density for two directions with positive z. `wo` must be the direction given to
    /// [`CoatSeen::new`].
    #[inline]
    fn evaluate_above(&self, coat: &Coat, base: Vec3, wo: Vec3, wi: Vec3) -> (Vec3, f32) {
        let Self { transmittance: to, chance } = *self;
        let [ti, _] = coat.transmittance_and_reflectance(wi.z);
        let (f, pdf) = (base * (to * ti), (1.0 - chance) * (wi.z * FRAC_1_PI));
        match coat.microfacets() {
            Some(microfacets) => {
                let h = wo + wi;
                let coated = coat.fresnel(half_angle_cosine(h)) * microfacets.reflection(wo, wi, h);
                (f + coated, pdf + chance * microfacets.reflection_pdf(wo, h))
            }
            None => (f, pdf),
        }
    }
}

/// Returns both directions mirrored to the side `z > 0`. Returns `None` if they are on different sides, along the
/// surface or NaN.
#[inline]
fn to_upper_side(wo: Vec3, wi: Vec3) -> Option<(Vec3, Vec3)> {
    if wo.z > 0.0 && wi.z > 0.0 {
        Some((wo, wi))
    } else if wo.z < 0.0 && wi.z < 0.0 {
        Some((-wo, -wi))
    } else {
        None
    }
}
