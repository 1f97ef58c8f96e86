//! glTF's surface [Khronos 2021, app. B]: a mixture of metal and of Lambertian reflection below a glossy layer, with a clear
//! coat above both.
//!
//! glTF's formulas reflect more light than arrives at grazing angles. Here each layer receives only the light that the layers
//! above do not reflect, by their albedo `E` from a table. Energy is therefore conserved, and the BSDF is reciprocal:
//!
//! `f = (1 - m) b / pi * (1 - E(wo)) (1 - E(wi)) / (1 - mean E) + F D G / (4 cos cos) + f_more`
//!
//! * `b`: the base colour; `m`: the fraction of metal; `E`: the albedo of the glossy layer above the diffuse part.
//! * `F`: Schlick's Fresnel reflectance of the mixture, which is `b` along the normal for a metal; `D`, `G`: the microfacet
//!   terms.
//! * `f_more`: the light reflected more than once between microfacets [Kulla and Conty 2017], which rough metals would
//!   otherwise lose.
//! * A clear coat multiplies the diffuse part in the same way. It multiplies the glossy part by the smaller of its
//!   transmittances for the two directions.
//!
//! The module also has the glossy reflection above diffuse reflection of pbrt-v3's `plastic` and `substrate` materials.
//!
//! All functions expect directions on the side `z > 0`.

use super::microfacet::{TrowbridgeReitz, half_angle_cosine};
use super::{cell, fresnel, mirror, warp};
use glam::{Vec2, Vec3};
use std::f32::consts::{FRAC_1_PI, PI};
use std::sync::LazyLock;

/// The number of intervals of the table along the cosine, and along the square root of the microfacet width.
const CELLS: usize = 32;
/// The number of microfacet normals per side of a square grid, for one entry of the table.
const NORMALS: usize = 24;
/// The Fresnel reflectance of a clear coat along the normal, for an index of refraction of 1.5.
const COAT_NORMAL: f32 = 0.04;
/// The Fresnel reflectance of a clear coat along the normal and at grazing angles.
const COAT: Vec2 = Vec2::new(COAT_NORMAL, 1.0);

/// A metal, or a diffuse surface below a glossy layer, or a mixture of both.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layered<'m> {
    /// The base colour, 0 to 1 per channel: the diffuse reflectance, and the metal's reflectance along the normal.
    pub base: Vec3,
    /// The fraction of metal, 0 to 1.
    pub metallic: f32,
    /// The microfacet distribution of the glossy layer and of the metal.
    pub microfacets: TrowbridgeReitz,
    /// The parameters that do not vary over the surface.
    pub layers: &'m Layers,
}

/// The parameters of a [`Layered`] surface that are the same everywhere on it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layers {
    /// The Fresnel reflectance of the glossy layer along the normal, 0 to 1 per channel.
    pub normal: Vec3,
    /// The Fresnel reflectance of the glossy layer at grazing angles, 0 to 1.
    pub grazing: f32,
    /// The fraction of the surface under a clear coat, 0 to 1, and the coat's microfacet distribution.
    pub coat: Option<(f32, TrowbridgeReitz)>,
}

/// The values of a surface that depend only on `wo`.
struct Seen {
    /// The fraction of light reflected by the glossy layer above the diffuse part, per channel.
    layer: Vec3,
    /// The fraction of light reflected by the coat.
    coat: f32,
    /// The probabilities of sampling the coat, and of sampling the coat or the glossy layer.
    chances: [f32; 2],
}

impl Layered<'_> {
    /// Samples a direction: `lobe` selects the layer, and `u` the direction.
    #[inline]
    pub(super) fn sample(&self, wo: Vec3, u: [f32; 2], lobe: f32) -> Vec3 {
        let [coat, glossy] = self.seen(wo).chances;
        match &self.layers.coat {
            Some((_, microfacets)) if lobe < coat => mirror(wo, microfacets.sample_visible(wo, u)),
            _ if lobe < glossy => mirror(wo, self.microfacets.sample_visible(wo, u)),
            _ => warp::cosine_hemisphere(u),
        }
    }

    /// Returns the microfacet distribution of the layer that [`sample`](Self::sample) selects; `None` for the diffuse layer.
    pub(super) fn sampled(&self, wo: Vec3, lobe: f32) -> Option<&TrowbridgeReitz> {
        let [coat, glossy] = self.seen(wo).chances;
        match &self.layers.coat {
            Some((_, microfacets)) if lobe < coat => Some(microfacets),
            _ => (lobe < glossy).then_some(&self.microfacets),
        }
    }

    /// Returns `f` and the density.
    #[inline]
    pub(super) fn evaluate_above(&self, wo: Vec3, wi: Vec3) -> (Vec3, f32) {
        let (seen, width) = (self.seen(wo), width(&self.microfacets));
        let h = wo + wi;
        let beyond = fifth_power(1.0 - half_angle_cosine(h).min(1.0));
        let [there, back, mean] = [TABLE.at(wo.z, width), TABLE.at(wi.z, width), TABLE.mean(width)];
        // Light after several reflections between microfacets.
        let more = self.mixed(|fresnel| fresnel.repeated(mean))
            * ((1.0 - there.element_sum()) * (1.0 - back.element_sum()) / (1.0 - mean.element_sum()).max(1e-6));
        let layer = self.layer();
        let passed = (Vec3::ONE - seen.layer) * (Vec3::ONE - layer.reflected(back, mean));
        let passed = passed / (Vec3::ONE - layer.reflected(mean, mean)).max(Vec3::splat(1e-6));
        let mut diffuse = (self.diffuse() * passed + more) * FRAC_1_PI;
        let mut glossy = self.mixed(|fresnel| fresnel.at(beyond)) * self.microfacets.reflection(wo, wi, h);
        let [first, second] = seen.chances;
        let mut pdf = (second - first) * self.microfacets.reflection_pdf(wo, h) + (1.0 - second) * (wi.z * FRAC_1_PI);
        if let Some((amount, coat)) = &self.layers.coat {
            let width = self::width(coat);
            let share = |at: Split| *amount * at.dot(COAT);
            let (there, mean) = (share(TABLE.at(wi.z, width)), share(TABLE.mean(width)));
            diffuse *= (1.0 - seen.coat) * (1.0 - there) / (1.0 - mean);
            glossy *= 1.0 - seen.coat.max(there);
            let fresnel = *amount * (COAT_NORMAL + beyond * (1.0 - COAT_NORMAL));
            glossy += fresnel * coat.reflection(wo, wi, h);
            pdf += first * coat.reflection_pdf(wo, h);
        }
        (diffuse + glossy, pdf)
    }

    /// Returns the approximate fraction of light reflected at normal incidence, per channel.
    pub(super) fn albedo(&self) -> Vec3 {
        let glossy = self.mixed(|fresnel| fresnel.normal);
        let coat = self.layers.coat.map_or(0.0, |(amount, _)| amount * COAT_NORMAL);
        (glossy + self.diffuse() * (Vec3::ONE - self.layers.normal)) * (1.0 - coat) + coat
    }

    /// Returns the diffuse reflectance below the glossy layer.
    #[inline]
    pub(super) fn diffuse(&self) -> Vec3 {
        self.base * (1.0 - self.metallic)
    }

    #[inline]
    fn seen(&self, wo: Vec3) -> Seen {
        let width = width(&self.microfacets);
        let (at, mean) = (TABLE.at(wo.z, width), TABLE.mean(width));
        let layer = self.layer().reflected(at, mean);
        let coat = self
            .layers
            .coat
            .as_ref()
            .map_or(0.0, |(amount, microfacets)| *amount * TABLE.at(wo.z, self::width(microfacets)).dot(COAT));
        let shares = [self.mixed(|fresnel| fresnel.reflected(at, mean)), self.diffuse() * (Vec3::ONE - layer)];
        let shares = shares.map(|share| share.element_sum() * ((1.0 - coat) / 3.0));
        let sum = coat + shares[0] + shares[1];
        let chances = if sum > 0.0 { [coat / sum, (coat + shares[0]) / sum] } else { [0.0; 2] };
        Seen { layer, coat, chances }
    }

    /// Returns the Fresnel reflectance of the glossy layer above the diffuse part.
    #[inline]
    fn layer(&self) -> Schlick {
        Schlick { normal: self.layers.normal, grazing: self.layers.grazing }
    }

    /// Returns `f` of the glossy layer's Fresnel reflectance and of the metal's, mixed by the fraction of metal.
    #[inline]
    fn mixed(&self, f: impl Fn(Schlick) -> Vec3) -> Vec3 {
        let metal = Schlick { normal: self.base, grazing: 1.0 };
        match self.metallic {
            0.0 => f(self.layer()),
            1.0 => f(metal),
            share => f(self.layer()).lerp(f(metal), share),
        }
    }
}

/// Schlick's approximation of a Fresnel reflectance [Schlick 1994, eq. 15], given by its values along the normal and at
/// grazing angles.
#[derive(Clone, Copy)]
struct Schlick {
    normal: Vec3,
    grazing: f32,
}

impl Schlick {
    /// Returns the reflectance at the cosine for which `beyond` is `(1 - cos)^5`.
    #[inline]
    fn at(self, beyond: f32) -> Vec3 {
        self.normal + beyond * (self.at_grazing() - self.normal)
    }

    /// Returns the fraction of light that a layer reflects, from the table's value at a cosine and the table's mean.
    #[inline]
    fn reflected(self, at: Split, mean: Split) -> Vec3 {
        let once = self.normal * at.x + self.at_grazing() * at.y;
        (once + self.repeated(mean) * (1.0 - at.element_sum())).min(Vec3::ONE)
    }

    /// Returns the factor of light reflected several times between microfacets [Kulla and Conty 2017], from the mean values of
    /// the table.
    #[inline]
    fn repeated(self, mean: Split) -> Vec3 {
        // The mean of Schlick's reflectance over cosine-weighted directions has a 21st of the grazing part.
        let average = self.normal + (self.at_grazing() - self.normal) / 21.0;
        average * average * mean.element_sum()
            / (Vec3::ONE - average * (1.0 - mean.element_sum())).max(Vec3::splat(1e-6))
    }

    #[inline]
    fn at_grazing(self) -> Vec3 {
        self.normal.max(Vec3::splat(self.grazing))
    }
}

/// The two coefficients of a layer's albedo: of its Fresnel reflectance along the normal (x) and at grazing angles (y).
type Split = Vec2;

/// The albedos of microfacets by cosine and width, and their cosine-weighted means over the hemisphere.
struct Table {
    /// The albedos, indexed by width, then by cosine.
    at: Box<[[Split; CELLS + 1]; CELLS + 1]>,
    means: [Split; CELLS + 1],
}

/// The table for all widths, computed at first use in about 10 ms.
static TABLE: LazyLock<Table> = LazyLock::new(Table::new);

impl Table {
    fn new() -> Self {
        let mut table =
            Self { at: Box::new([[Split::default(); CELLS + 1]; CELLS + 1]), means: [Split::default(); CELLS + 1] };
        for (i, row) in table.at.iter_mut().enumerate() {
            let root = i as f32 / CELLS as f32;
            let microfacets = TrowbridgeReitz::nearest([root * root; 2]);
            for (j, entry) in row.iter_mut().enumerate() {
                // Cosines lie closer together near 0, where albedos change most.
                let cosine = (j as f32 / CELLS as f32).powi(2).max(1e-4);
                *entry = albedo(&microfacets, cosine);
            }
            // With mu = x^2, the weight 2 mu dmu becomes 4 x^3 dx; both ends of each interval are averaged.
            let mut mean = Split::default();
            for (j, pair) in row.windows(2).enumerate() {
                let [a, b] = [j, j + 1].map(|k| (k as f32 / CELLS as f32).powi(4));
                let middle = pair[0].lerp(pair[1], 0.5);
                mean += (b - a) * middle;
            }
            table.means[i] = mean;
        }
        table
    }

    #[inline]
    fn at(&self, cosine: f32, width: (usize, f32)) -> Split {
        let (j, t) = cell(cosine.sqrt(), CELLS);
        let row = |i: usize| self.at[i][j].lerp(self.at[i][j + 1], t);
        row(width.0).lerp(row(width.0 + 1), width.1)
    }

    #[inline]
    fn mean(&self, width: (usize, f32)) -> Split {
        self.means[width.0].lerp(self.means[width.0 + 1], width.1)
    }
}

/// Returns the table row of a microfacet distribution, and the weight of the next row for interpolation.
#[inline]
fn width(microfacets: &TrowbridgeReitz) -> (usize, f32) {
    let [x, y] = microfacets.alpha();
    cell((x * y).sqrt().sqrt(), CELLS)
}

/// Returns the albedo of microfacets for one direction, integrated over a grid of visible normals.
fn albedo(microfacets: &TrowbridgeReitz, cosine: f32) -> Split {
    let wo = Vec3::new((1.0 - cosine * cosine).max(0.0).sqrt(), 0.0, cosine);
    let mut sum = [0.0f64; 2];
    let middle = |i: usize| (i as f32 + 0.5) / NORMALS as f32;
    for (i, j) in (0..NORMALS * NORMALS).map(|k| (k / NORMALS, k % NORMALS)) {
        let wi = mirror(wo, microfacets.sample_visible(wo, [middle(i), middle(j)]));
        if wi.z > 0.0 {
            let h = wo + wi;
            let passed = microfacets.reflection(wo, wi, h) * wi.z / microfacets.reflection_pdf(wo, h);
            let beyond = fifth_power(1.0 - half_angle_cosine(h).min(1.0));
            sum[0] += f64::from(passed * (1.0 - beyond));
            sum[1] += f64::from(passed * beyond);
        }
    }
    Split::from(sum.map(|s| (s / (NORMALS * NORMALS) as f64) as f32))
}

#[inline]
fn fifth_power(x: f32) -> f32 {
    (x * x) * (x * x) * x
}

/// The index of refraction of [`Plastic`]'s glossy reflection.
const PLASTIC_ETA: f32 = 1.5;

/// The sum of Lambertian reflection and a rough dielectric's reflection, as in pbrt-v3's `plastic`. It may reflect more light
/// than arrives, since the glossy part does not reduce the diffuse part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plastic {
    /// The fraction of light reflected diffusely, per channel.
    pub diffuse: Vec3,
    /// The factor of the glossy reflection, per channel, which multiplies the Fresnel reflectance for an index of 1.5.
    pub specular: Vec3,
    /// The microfacet distribution of the glossy reflection.
    pub microfacets: TrowbridgeReitz,
}

impl Plastic {
    /// Returns the probability of sampling the glossy lobe: approximately its fraction of the light reflected to `wo`.
    #[inline]
    pub(super) fn chance(&self, wo: Vec3) -> f32 {
        let glossy = self.specular.element_sum() * fresnel::dielectric(wo.z, PLASTIC_ETA);
        share(glossy, self.diffuse.element_sum())
    }

    /// Returns `f` and the density. `chance` is the probability of sampling the glossy lobe at `wo`.
    #[inline]
    pub(super) fn evaluate_above(&self, wo: Vec3, wi: Vec3, chance: f32) -> (Vec3, f32) {
        let h = wo + wi;
        let reflectance = fresnel::dielectric(half_angle_cosine(h), PLASTIC_ETA);
        let glossy = self.specular * (reflectance * self.microfacets.reflection(wo, wi, h));
        let pdf = chance * self.microfacets.reflection_pdf(wo, h) + (1.0 - chance) * (wi.z * FRAC_1_PI);
        (self.diffuse * FRAC_1_PI + glossy, pdf)
    }

    /// Returns the approximate fraction of light reflected at normal incidence, per channel.
    pub(super) fn albedo(&self) -> Vec3 {
        self.diffuse + self.specular * fresnel::dielectric(1.0, PLASTIC_ETA)
    }
}

/// A glossy coat over a diffuse base [Ashikhmin and Shirley 2000] with a Trowbridge-Reitz (GGX) microfacet
/// distribution, as pbrt-v3's `substrate`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Substrate {
    /// The reflectance of the base, per channel.
    pub diffuse: Vec3,
    /// The reflectance of the coat at normal incidence, per channel.
    pub specular: Vec3,
    /// The microfacet distribution of the coat.
    pub microfacets: TrowbridgeReitz,
}

impl Substrate {
    /// Returns the probability of sampling the coat's lobe: approximately its fraction of the light reflected to `wo`.
    #[inline]
    pub(super) fn chance(&self, wo: Vec3) -> f32 {
        let diffuse = self.diffuse * (Vec3::ONE - self.specular);
        share(schlick(self.specular, wo.z).element_sum(), diffuse.element_sum())
    }

    /// Returns `f` and the density [Ashikhmin and Shirley 2000, eq. 4 and 5; the coat's lobe after Pharr et al. 2016,
    /// sec. 8.5]. `chance` is the probability of sampling the coat's lobe at `wo`.
    #[inline]
    pub(super) fn evaluate_above(&self, wo: Vec3, wi: Vec3, chance: f32) -> (Vec3, f32) {
        // The factor 28 / 23 normalises the two powers, so that energy is conserved.
        const SCALE: f32 = 28.0 / (23.0 * PI);
        let beyond = |cos: f32| 1.0 - fifth_power(1.0 - 0.5 * cos);
        let diffuse = self.diffuse * (Vec3::ONE - self.specular) * (SCALE * beyond(wi.z) * beyond(wo.z));
        let h = wo + wi;
        let cos = half_angle_cosine(h);
        let lobe = self.microfacets.normals(h) / (4.0 * cos * wi.z.max(wo.z));
        let pdf = chance * self.microfacets.reflection_pdf(wo, h) + (1.0 - chance) * (wi.z * FRAC_1_PI);
        (diffuse + schlick(self.specular, cos) * lobe, pdf)
    }

    /// Returns the approximate fraction of light reflected at normal incidence, per channel.
    pub(super) fn albedo(&self) -> Vec3 {
        self.specular + self.diffuse * (Vec3::ONE - self.specular)
    }
}

/// Returns Schlick's approximation of the Fresnel reflectance at a cosine, from the one at normal incidence [Schlick
/// 1994, eq. 15].
#[inline]
fn schlick(normal: Vec3, cos: f32) -> Vec3 {
    normal + fifth_power(1.0 - cos.min(1.0)) * (Vec3::ONE - normal)
}

/// Returns `a / (a + b)`; 0 if both are 0.
#[inline]
fn share(a: f32, b: f32) -> f32 {
    if a + b > 0.0 { a / (a + b) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A white metal without absorption reflects all light at every roughness and angle: the albedos of single and repeated
    /// reflections sum to 1.
    #[test]
    fn albedos_of_a_white_metal_are_one() {
        let metal = Schlick { normal: Vec3::ONE, grazing: 1.0 };
        for alpha in [0.0, 0.01, 0.1, 0.3, 0.6, 1.0] {
            let width = width(&TrowbridgeReitz::nearest([alpha; 2]));
            for cosine in [0.05, 0.3, 0.7, 1.0] {
                let all = metal.reflected(TABLE.at(cosine, width), TABLE.mean(width)).x;
                assert!((all - 1.0).abs() < 1e-5, "{alpha} {cosine}: {all}");
            }
        }
    }

    /// A smooth layer's albedo is Schlick's reflectance.
    #[test]
    fn a_smooth_layer_has_the_albedo_of_its_fresnel_term() {
        for cosine in [0.1f32, 0.35, 0.8, 1.0] {
            let at = TABLE.at(cosine, width(&TrowbridgeReitz::nearest([0.0; 2])));
            let expected = 0.04 + 0.96 * fifth_power(1.0 - cosine);
            let found = at.dot(COAT);
            assert!((found - expected).abs() < 4e-3, "{cosine}: {found} {expected}");
        }
    }
}
