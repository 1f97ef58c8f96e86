//! Effects that materials call for.

use super::visible::Visible;
use super::{Effect, Effects, visible};
use crate::{
    Color, ConductorFresnel, Material, MaterialKind, Roughness, Scalar, Scene, Source, TextureId, effectively_smooth,
    roughness_to_alpha,
};

/// A non-diffuse lobe of a material.
pub(super) struct Lobe<'m> {
    /// The lobe's description for messages, such as "a metal".
    pub(super) what: &'static str,
    /// Microfacet roughness of the lobe; `None` for a perfectly smooth lobe.
    pub(super) roughness: Option<&'m Roughness>,
    /// True if the lobe transmits light.
    pub(super) refracts: bool,
}

impl Lobe<'_> {
    /// Returns two flags: the lobe may be smooth, and the lobe may be rough. A textured roughness sets both.
    pub(super) fn smooth_or_rough(&self) -> [bool; 2] {
        let Some(alpha) = self.roughness.map(alpha) else { return [true, false] };
        match alpha {
            None => [true, true],
            Some(alpha) => {
                let smooth = effectively_smooth(alpha);
                [smooth, !smooth]
            }
        }
    }
}

/// Returns the microfacet widths (alpha) along u and v; `None` if a texture sets either.
fn alpha(roughness: &Roughness) -> Option<[f32; 2]> {
    let remapped = |r| if roughness.remap { roughness_to_alpha(r) } else { r };
    roughness.constants().map(|r| r.map(remapped))
}

/// Returns the non-diffuse lobes of a material.
pub(super) fn lobes(kind: &MaterialKind) -> Vec<Lobe<'_>> {
    let black = |color: &Color| *color == Color::Constant([0.0; 3]);
    let reflecting = |what, roughness| Lobe { what, roughness: Some(roughness), refracts: false };
    match kind {
        MaterialKind::Conductor { roughness, .. } => vec![reflecting("a metal", roughness)],
        MaterialKind::Dielectric { roughness, reflectance, transmittance, .. } => {
            if black(reflectance) && black(transmittance) {
                return Vec::new();
            }
            vec![Lobe { what: "glass", roughness: Some(roughness), refracts: true }]
        }
        MaterialKind::ThinDielectric { .. } => vec![Lobe { what: "a pane", roughness: None, refracts: true }],
        MaterialKind::CoatedDiffuse { coat, .. } => vec![reflecting("coated", &coat.roughness)],
        MaterialKind::CoatedConductor { roughness, coat, .. } => {
            vec![reflecting("coated", &coat.roughness), reflecting("a coated metal", roughness)]
        }
        MaterialKind::Mirror { reflectance } if !black(reflectance) => {
            vec![Lobe { what: "a mirror", roughness: None, refracts: false }]
        }
        MaterialKind::Plastic { specular, roughness, .. } if !black(specular) => {
            vec![reflecting("plastic", roughness)]
        }
        MaterialKind::Substrate { roughness, .. } => vec![reflecting("coated", roughness)],
        MaterialKind::Layered { metallic: Scalar::Constant(1.0), roughness, .. } => {
            vec![reflecting("a metal", roughness)]
        }
        MaterialKind::Layered { roughness, .. } => vec![reflecting("plastic", roughness)],
        MaterialKind::Mirror { .. }
        | MaterialKind::Plastic { .. }
        | MaterialKind::Diffuse { .. }
        | MaterialKind::DiffuseTransmission { .. }
        | MaterialKind::Mix { .. }
        | MaterialKind::Interface => Vec::new(),
    }
}

/// Returns the textures that a material looks up, each with the name of its use, such as "roughness".
fn textures(material: &Material) -> Vec<(TextureId, &'static str)> {
    let mut found = Vec::new();
    let mut color = |color: &Color, what| {
        if let Color::Texture(id) = color {
            found.push((*id, what));
        }
    };
    match &material.kind {
        MaterialKind::Diffuse { reflectance } | MaterialKind::Mirror { reflectance } => color(reflectance, "color"),
        MaterialKind::DiffuseTransmission { reflectance, transmittance }
        | MaterialKind::Dielectric { reflectance, transmittance, .. } => {
            color(reflectance, "color");
            color(transmittance, "transmitted color");
        }
        MaterialKind::Conductor { fresnel, .. } => {
            if let ConductorFresnel::Reflectance(reflectance) = fresnel {
                color(reflectance, "color");
            }
        }
        MaterialKind::CoatedDiffuse { reflectance, coat } => {
            color(reflectance, "color");
            color(&coat.albedo, "albedo of the coat");
        }
        MaterialKind::CoatedConductor { fresnel, coat, .. } => {
            if let ConductorFresnel::Reflectance(reflectance) = fresnel {
                color(reflectance, "color");
            }
            color(&coat.albedo, "albedo of the coat");
        }
        MaterialKind::Layered { base, .. } => color(base, "color"),
        MaterialKind::Plastic { diffuse, specular, .. } | MaterialKind::Substrate { diffuse, specular, .. } => {
            color(diffuse, "color");
            color(specular, "specular color");
        }
        MaterialKind::ThinDielectric { .. } | MaterialKind::Mix { .. } | MaterialKind::Interface => {}
    }
    let mut scalar = |scalar: Scalar, what| {
        if let Scalar::Texture(id) = scalar {
            found.push((id, what));
        }
    };
    match &material.kind {
        MaterialKind::Mix { amount, .. } => scalar(*amount, "share of a mix"),
        kind => {
            for roughness in lobes(kind).iter().filter_map(|l| l.roughness) {
                scalar(roughness.u, "roughness");
                scalar(roughness.v, "roughness");
            }
        }
    }
    if let MaterialKind::Layered { metallic, .. } = &material.kind {
        scalar(*metallic, "share of metal");
    }
    material.bump.into_iter().for_each(|bump| scalar(bump, "bump"));
    material.normal_map.into_iter().for_each(|id| found.push((id, "normals")));
    found
}

impl Effects {
    pub(super) fn add_materials(&mut self, scene: &Scene, visible: &Visible<'_>) {
        let worn =
            scene.materials.iter().zip(&visible.materials).filter_map(|(material, worn)| worn.then_some(material));
        for material in worn {
            self.add_texture(scene, &format!("material \"{}\"", material.name), &textures(material), &material.source);
            let lobes = lobes(&material.kind);
            for effect in [Effect::Glossy, Effect::Mirror, Effect::Refraction] {
                let Some(lobe) = lobes.iter().find(|lobe| calls_for(lobe, effect)) else { continue };
                let because = || describe(material, lobe);
                self.add(effect, because, &material.source);
            }
        }
        for shape in &visible.shapes {
            if let (Some(Scalar::Texture(id)), Some(_)) = (shape.alpha, visible::holes(shape)) {
                self.add_texture(scene, "a shape", &[(id, "opacity")], &shape.source);
            }
        }
    }

    fn add_texture(&mut self, scene: &Scene, who: &str, textures: &[(TextureId, &str)], source: &Source) {
        let Some((id, what)) = textures.first() else { return };
        let because = || {
            let texture = scene.textures.get(id.0 as usize).map_or("?", |t| &t.name);
            format!("{who} uses texture \"{texture}\" ({what})")
        };
        self.add(Effect::Textures, because, source);
    }
}

/// Returns true if a lobe calls for an effect of surfaces (glossy, mirror or refraction). The reflection of smooth
/// glass counts as refraction, not as mirror.
pub(super) fn calls_for(lobe: &Lobe<'_>, effect: Effect) -> bool {
    let [smooth, rough] = lobe.smooth_or_rough();
    match effect {
        Effect::Glossy => rough,
        Effect::Mirror => smooth && !lobe.refracts,
        Effect::Refraction => lobe.refracts,
        _ => false,
    }
}

fn describe(material: &Material, lobe: &Lobe<'_>) -> String {
    let (name, what) = (&material.name, lobe.what);
    match lobe.roughness.map(alpha) {
        None => format!("material \"{name}\" is {what}"),
        Some(None) => format!("material \"{name}\" is {what}, rough by a texture"),
        Some(Some([u, v])) => format!("material \"{name}\" is {what} with alpha {u}, {v}"),
    }
}
