//! Edits of materials that remove glossy, mirror, refraction or texture effects from a scene.

use super::Albedo;
use crate::description::texture_mean::texture_mean;
use crate::effects::{Effect, surface_calls_for};
use crate::{
    Color, ConductorFresnel, Material, MaterialKind, Roughness, Scalar, Scene, Texture, TextureId, TextureKind,
};

impl Scene {
    /// Replaces, in all materials, the lobes that call for `effect` (glossy, mirror or refraction).
    pub(super) fn replace_lobes(&mut self, effect: Effect, albedo: &Albedo<'_>) {
        let Self { materials, textures, .. } = self;
        for material in materials.iter_mut().filter(|m| surface_calls_for(&m.kind, effect)) {
            match (&mut material.kind, effect) {
                (
                    kind @ (MaterialKind::Dielectric { .. } | MaterialKind::ThinDielectric { .. }),
                    Effect::Refraction,
                ) => {
                    *kind = MaterialKind::Interface;
                }
                (MaterialKind::Dielectric { roughness, .. }, _) => *roughness = Roughness::constant(0.0, 0.0, false),
                _ => {
                    if let Some(reflectance) = diffuse_color(material, textures, albedo) {
                        material.kind = MaterialKind::Diffuse { reflectance };
                    }
                }
            }
        }
    }

    /// Replaces every texture in use by its mean, and removes bump and normal maps.
    pub(super) fn flatten_textures(&mut self) {
        let means = Means(&self.textures);
        for material in &mut self.materials {
            (material.bump, material.normal_map) = (None, None);
            means.flatten(&mut material.kind);
        }
        for shape in self.objects.iter_mut().flat_map(|o| &mut o.shapes).chain(&mut self.shapes) {
            shape.alpha = shape.alpha.map(|alpha| means.scalar(alpha));
        }
    }
}

/// Returns the reflectance of a diffuse material with the same albedo at normal incidence as `material`. `None` for an
/// invalid material, which the renderer reports later.
fn diffuse_color(material: &Material, textures: &mut Vec<Texture>, albedo: &Albedo<'_>) -> Option<Color> {
    if let MaterialKind::Mirror { reflectance } = &material.kind {
        return Some(*reflectance);
    }
    let means = Means(textures);
    let textured = base(&material.kind);
    let mut plain = material.clone();
    (plain.bump, plain.normal_map) = (None, None);
    means.flatten(&mut plain.kind);
    let albedo = albedo(&plain)?.map(|a| a.clamp(0.0, 1.0));
    let Some(Color::Texture(id)) = textured else { return Some(Color::Constant(albedo)) };
    let mean = texture_mean(means.0, id);
    let ratio = std::array::from_fn(|c| if mean[c] > 0.0 { albedo[c] / mean[c] } else { 1.0 });
    let factors = [Color::Texture(id), Color::Constant(ratio)];
    let name = format!("{} made diffuse", material.name);
    textures.push(Texture { name, kind: TextureKind::Product { factors }, source: material.source.clone() });
    Some(Color::Texture(TextureId(textures.len() as u32 - 1)))
}

/// Returns the colour parameter that a material's albedo depends on most; `None` for a kind without one.
fn base(kind: &MaterialKind) -> Option<Color> {
    match kind {
        MaterialKind::CoatedDiffuse { reflectance: color, .. }
        | MaterialKind::Plastic { diffuse: color, .. }
        | MaterialKind::Substrate { diffuse: color, .. }
        | MaterialKind::Layered { base: color, .. }
        | MaterialKind::Conductor { fresnel: ConductorFresnel::Reflectance(color), .. }
        | MaterialKind::CoatedConductor { fresnel: ConductorFresnel::Reflectance(color), .. } => Some(*color),
        _ => None,
    }
}

/// The textures of a scene, and methods that replace uses of them by their means.
struct Means<'t>(&'t [Texture]);

impl Means<'_> {
    fn color(&self, color: Color) -> [f32; 3] {
        match color {
            Color::Constant(rgb) => rgb,
            Color::Texture(id) => texture_mean(self.0, id),
        }
    }

    fn scalar(&self, scalar: Scalar) -> Scalar {
        match scalar {
            Scalar::Texture(id) => Scalar::Constant(texture_mean(self.0, id)[0]),
            constant => constant,
        }
    }

    /// Replaces each texture in a material's parameters by its mean.
    fn flatten(&self, kind: &mut MaterialKind) {
        let color = |color: &mut Color| *color = Color::Constant(self.color(*color));
        let scalar = |scalar: &mut Scalar| *scalar = self.scalar(*scalar);
        let roughness = |roughness: &mut Roughness| {
            scalar(&mut roughness.u);
            scalar(&mut roughness.v);
        };
        let fresnel = |fresnel: &mut ConductorFresnel| {
            if let ConductorFresnel::Reflectance(reflectance) = fresnel {
                color(reflectance);
            }
        };
        match kind {
            MaterialKind::Diffuse { reflectance } | MaterialKind::Mirror { reflectance } => color(reflectance),
            MaterialKind::DiffuseTransmission { reflectance, transmittance } => {
                color(reflectance);
                color(transmittance);
            }
            MaterialKind::Conductor { fresnel: f, roughness: r } => {
                fresnel(f);
                roughness(r);
            }
            MaterialKind::Dielectric { roughness: r, reflectance, transmittance, .. } => {
                roughness(r);
                color(reflectance);
                color(transmittance);
            }
            MaterialKind::CoatedDiffuse { reflectance, coat } => {
                color(reflectance);
                roughness(&mut coat.roughness);
                color(&mut coat.albedo);
            }
            MaterialKind::CoatedConductor { fresnel: f, roughness: r, coat } => {
                fresnel(f);
                roughness(r);
                roughness(&mut coat.roughness);
                color(&mut coat.albedo);
            }
            MaterialKind::Mix { amount, .. } => scalar(amount),
            MaterialKind::Layered { base, metallic, roughness: r, .. } => {
                color(base);
                scalar(metallic);
                roughness(r);
            }
            MaterialKind::Plastic { diffuse, specular, roughness: r }
            | MaterialKind::Substrate { diffuse, specular, roughness: r } => {
                color(diffuse);
                color(specular);
                roughness(r);
            }
            MaterialKind::ThinDielectric { .. } | MaterialKind::Interface => {}
        }
    }
}
