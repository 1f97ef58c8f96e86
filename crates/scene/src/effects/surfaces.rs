//! Effects of surfaces: glossy and mirror reflection, refraction, textures, transparency.

use super::visible::Visible;
use super::{Albedo, FirstCause, found};
use crate::description::{Lobe, Parameter, texture_mean};
use crate::{Color, Material, MaterialKind, Roughness, Scalar, Scene, Shape, Texture, TextureId, TextureKind};

/// Returns true for a lobe that may be rough.
pub(super) fn is_glossy(lobe: &Lobe<'_>) -> bool {
    lobe.smooth_or_rough()[1]
}

/// Returns true for a lobe that may reflect like a mirror. The reflection of smooth glass counts as refraction.
pub(super) fn is_mirror(lobe: &Lobe<'_>) -> bool {
    lobe.smooth_or_rough()[0] && !lobe.refracts
}

/// Finds visible materials with a lobe for which `wanted` returns true.
pub(super) fn find_lobes(visible: &Visible<'_>, wanted: fn(&Lobe<'_>) -> bool) -> FirstCause {
    let materials = visible.materials().filter_map(|m| Some((m, m.kind.lobes().into_iter().find(wanted)?)));
    found(materials, |(material, lobe)| (describe(material, &lobe), material.source.clone()))
}

fn describe(material: &Material, lobe: &Lobe<'_>) -> String {
    let (name, what) = (&material.name, lobe.what);
    match lobe.roughness.map(Roughness::alpha) {
        None => format!("material \"{name}\" is {what}"),
        Some(None) => format!("material \"{name}\" is {what} with a textured roughness"),
        Some(Some([u, v])) => format!("material \"{name}\" is {what} with alpha {u}, {v}"),
    }
}

/// Replaces all materials with a lobe for which `wanted` returns true: rough glass by smooth glass, others by diffuse
/// materials.
pub(super) fn replace_lobes(scene: &mut Scene, albedo: &Albedo<'_>, wanted: fn(&Lobe<'_>) -> bool) {
    let Scene { materials, textures, .. } = scene;
    for material in materials.iter_mut().filter(|m| m.kind.lobes().iter().any(wanted)) {
        if let MaterialKind::Dielectric { roughness, .. } = &mut material.kind {
            *roughness = Roughness::constant(0.0, 0.0, false);
        } else if let Some(reflectance) = diffuse_color(material, textures, albedo) {
            material.kind = MaterialKind::Diffuse { reflectance };
        }
    }
}

/// Replaces glass and panes by interfaces.
pub(super) fn remove_glass(scene: &mut Scene) {
    for material in &mut scene.materials {
        if material.kind.lobes().iter().any(|lobe| lobe.refracts) {
            material.kind = MaterialKind::Interface;
        }
    }
}

/// Returns the reflectance of a diffuse material with the same albedo at normal incidence as `material`. `None` for an
/// invalid material, which the renderer reports later.
fn diffuse_color(material: &Material, textures: &mut Vec<Texture>, albedo: &Albedo<'_>) -> Option<Color> {
    if let MaterialKind::Mirror { reflectance } = &material.kind {
        return Some(*reflectance);
    }
    let mut plain = material.clone();
    let mut textured = None;
    plain.kind.each_parameter(|what, parameter| {
        if let ("color", Parameter::Color(Color::Texture(id))) = (what, parameter) {
            textured = Some(*id);
        }
    });
    flatten(&mut plain, textures);
    let albedo = albedo(&plain)?.map(|a| a.clamp(0.0, 1.0));
    let Some(id) = textured else { return Some(Color::Constant(albedo)) };
    let mean = texture_mean(textures, id);
    let ratio = std::array::from_fn(|c| if mean[c] > 0.0 { albedo[c] / mean[c] } else { 1.0 });
    let factors = [Color::Texture(id), Color::Constant(ratio)];
    let name = format!("{} made diffuse", material.name);
    textures.push(Texture { name, kind: TextureKind::Product { factors }, source: material.source.clone() });
    Some(Color::Texture(TextureId(textures.len() as u32 - 1)))
}

/// Finds visible materials that look up textures, and visible shapes whose opacity or emission is a texture.
pub(super) fn find_textures(visible: &Visible<'_>) -> FirstCause {
    let materials = visible.materials().filter_map(|material| {
        let (id, what) = first_texture(material)?;
        Some((Some(&material.name), id, what, &material.source))
    });
    let shapes = visible.shapes.iter().filter_map(|shape| match shape.alpha {
        Some(Scalar::Texture(id)) => Some((None, id, "opacity", &shape.source)),
        _ => shape.emission.and_then(|emission| Some((None, emission.texture?, "emission", &shape.source))),
    });
    found(materials.chain(shapes), |(material, id, what, source)| {
        let who = material.map_or("a shape".into(), |name| format!("material \"{name}\""));
        let texture = visible.scene.textures.get(id.0 as usize).map_or("?", |t| &t.name);
        (format!("{who} uses texture \"{texture}\" ({what})"), source.clone())
    })
}

/// Returns the first texture that a material looks up and the name of the textured parameter, such as "roughness".
fn first_texture(material: &Material) -> Option<(TextureId, &'static str)> {
    let mut first = None;
    // The roughness of a material without lobes has no effect.
    let matt = material.kind.lobes().is_empty();
    material.kind.clone().each_parameter(|what, parameter| {
        let (Parameter::Color(Color::Texture(id)) | Parameter::Scalar(Scalar::Texture(id))) = parameter else { return };
        if first.is_none() && !(matt && what == "roughness") {
            first = Some((*id, what));
        }
    });
    let bump = material.bump.and_then(|bump| match bump {
        Scalar::Texture(id) => Some((id, "bump")),
        Scalar::Constant(_) => None,
    });
    first.or(bump).or(material.normal_map.map(|id| (id, "normals")))
}

/// Replaces every texture in use by its mean, and removes bump and normal maps.
pub(super) fn flatten_textures(scene: &mut Scene) {
    let Scene { materials, textures, .. } = scene;
    materials.iter_mut().for_each(|material| flatten(material, textures));
    let textures = std::mem::take(&mut scene.textures);
    for shape in scene.shapes_mut() {
        shape.alpha = shape.alpha.map(|alpha| mean_scalar(alpha, &textures));
        shape.emission = shape.emission.map(|emission| emission.mean(&textures));
    }
    scene.textures = textures;
}

fn flatten(material: &mut Material, textures: &[Texture]) {
    (material.bump, material.normal_map) = (None, None);
    material.kind.each_parameter(|_, parameter| match parameter {
        Parameter::Color(color) => {
            if let Color::Texture(id) = *color {
                *color = Color::Constant(texture_mean(textures, id));
            }
        }
        Parameter::Scalar(scalar) => *scalar = mean_scalar(*scalar, textures),
    });
}

fn mean_scalar(scalar: Scalar, textures: &[Texture]) -> Scalar {
    match scalar {
        Scalar::Texture(id) => Scalar::Constant(texture_mean(textures, id)[0]),
        constant => constant,
    }
}

pub(super) fn find_holes(visible: &Visible<'_>) -> FirstCause {
    let opaque = |alpha: &Scalar| matches!(alpha, Scalar::Constant(alpha) if *alpha >= 1.0);
    let holes = visible.shapes.iter().filter_map(|shape| Some((shape, shape.alpha.filter(|alpha| !opaque(alpha))?)));
    found(holes, |(shape, alpha)| {
        let alpha = match alpha {
            Scalar::Constant(alpha) => alpha.to_string(),
            Scalar::Texture(_) => "a texture".to_owned(),
        };
        (format!("a shape has an opacity of {alpha}"), shape.source.clone())
    })
}

/// Removes mostly transparent shapes that emit no light, and makes all others opaque.
pub(super) fn fill_holes(scene: &mut Scene) {
    for shapes in scene.objects.iter_mut().map(|o| &mut o.shapes).chain([&mut scene.shapes]) {
        let hole = |s: &Shape| matches!(s.alpha, Some(Scalar::Constant(alpha)) if alpha < 0.5);
        shapes.retain(|s| s.emission.is_some() || !hole(s));
        shapes.iter_mut().for_each(|s| s.alpha = None);
    }
}
