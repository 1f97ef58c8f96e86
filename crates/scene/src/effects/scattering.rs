//! Effects of repeated scattering: interreflection, absorbing and scattering media.

use super::Found;
use super::visible::Visible;
use crate::{Color, MaterialKind, Medium, MediumId, Scene, Shape, Source};

pub(super) fn find_interreflection(visible: &Visible<'_>, found: &mut Found) {
    let scene = visible.scene;
    let scatters = visible.shapes.iter().any(|shape| !is_black(scene, shape))
        || visible.media().any(|medium| medium.scattering != [0.0; 3]);
    if !scatters || scene.max_depth.is_some_and(|depth| depth <= 1) {
        return;
    }
    let because = || match scene.max_depth {
        Some(depth) => format!("up to {depth} scattering events are asked for"),
        None => "paths of any length are asked for".into(),
    };
    found.add(because, &Source { line: 0, ..scene.camera.source.clone() });
}

/// Returns true if a shape scatters no light: a black diffuse surface, or an interface between media.
fn is_black(scene: &Scene, shape: &Shape) -> bool {
    match scene.materials.get(shape.material.0 as usize).map(|m| &m.kind) {
        Some(MaterialKind::Diffuse { reflectance }) => *reflectance == Color::Constant([0.0; 3]),
        Some(MaterialKind::Interface) => true,
        _ => false,
    }
}

pub(super) fn find_absorption(visible: &Visible<'_>, found: &mut Found) {
    find_media(visible, found, "absorbs", |medium| medium.absorption);
}

pub(super) fn find_scattering(visible: &Visible<'_>, found: &mut Found) {
    find_media(visible, found, "scatters", |medium| medium.scattering);
}

fn find_media(visible: &Visible<'_>, found: &mut Found, does: &str, coefficient: fn(&Medium) -> [f32; 3]) {
    for medium in visible.media() {
        let what = coefficient(medium);
        if what != [0.0; 3] {
            found.add(|| format!("medium \"{}\" {does} {what:?} per unit", medium.name), &medium.source);
        }
    }
}

/// Edits each medium by `thin`, and removes media that are left without any coefficient.
pub(super) fn thin_media(scene: &mut Scene, thin: fn(&mut Medium)) {
    scene.media.iter_mut().for_each(thin);
    let filled: Vec<bool> = scene.media.iter().map(|m| m.absorption != [0.0; 3] || m.scattering != [0.0; 3]).collect();
    let clear = |medium: &mut Option<MediumId>| {
        *medium = medium.filter(|m| filled.get(m.0 as usize).copied().unwrap_or(true));
    };
    clear(&mut scene.camera.medium);
    let shapes = scene.objects.iter_mut().flat_map(|o| &mut o.shapes).chain(&mut scene.shapes);
    for media in shapes.filter_map(|s| s.media.as_mut()) {
        clear(&mut media.inside);
        clear(&mut media.outside);
    }
}
