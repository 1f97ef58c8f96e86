//! The visible part of a scene: objects that can affect its image. Effects of the camera and of repeated scattering:
//! depth of field, motion blur, interreflection, absorbing and scattering media.

use super::{FirstCause, found};
use crate::{Color, Instance, Material, MaterialId, MaterialKind, Medium, MediumId, Scalar, Scene, Shape, Source};

/// The shapes, instances, materials and media of a scene that can affect its image.
pub(super) struct Visible<'s> {
    pub(super) scene: &'s Scene,
    /// Shapes placed in the world, directly or through an instance, each once.
    pub(super) shapes: Vec<&'s Shape>,
    /// Instances of objects that have shapes.
    pub(super) instances: Vec<&'s Instance>,
    /// True for each material that a visible shape uses, directly or in a mix. Indexed by material.
    materials: Vec<bool>,
    /// True for each medium that borders on a visible shape or surrounds the camera. Indexed by medium.
    media: Vec<bool>,
}

impl<'s> Visible<'s> {
    pub(super) fn of(scene: &'s Scene) -> Self {
        let object = |i: &Instance| scene.objects.get(i.object.0 as usize);
        let instances: Vec<_> =
            scene.instances.iter().filter(|i| object(i).is_some_and(|o| !o.shapes.is_empty())).collect();
        let mut stands = vec![false; scene.objects.len()];
        for instance in &instances {
            stands[instance.object.0 as usize] = true;
        }
        let objects = scene.objects.iter().zip(stands).filter_map(|(object, stands)| stands.then_some(object));
        let shapes: Vec<_> = scene.shapes.iter().chain(objects.flat_map(|o| &o.shapes)).collect();
        let (materials, media) = (vec![false; scene.materials.len()], vec![false; scene.media.len()]);
        let mut visible = Self { scene, shapes, instances, materials, media };
        let interfaces = visible.shapes.iter().filter_map(|shape| shape.media);
        let sides = interfaces.flat_map(|media| [media.inside, media.outside]).chain([scene.camera.medium]);
        for medium in sides.flatten() {
            visible.media.get_mut(medium.0 as usize).into_iter().for_each(|visible| *visible = true);
        }
        for shape in &visible.shapes {
            worn(scene, shape.material, &mut visible.materials);
        }
        visible
    }

    /// Returns the materials that a visible shape uses.
    pub(super) fn materials(&self) -> impl Iterator<Item = &'s Material> {
        self.scene.materials.iter().zip(&self.materials).filter_map(|(material, worn)| worn.then_some(material))
    }

    /// Returns the media that border on a visible shape or surround the camera.
    pub(super) fn media(&self) -> impl Iterator<Item = &'s Medium> {
        self.scene.media.iter().zip(&self.media).filter_map(|(medium, used)| used.then_some(medium))
    }
}

/// Returns a material and all materials that it mixes, without materials marked in `seen`. Marks the returned ones, so that
/// circular mixes end.
pub(super) fn worn<'s>(scene: &'s Scene, first: MaterialId, seen: &mut [bool]) -> Vec<&'s Material> {
    let (mut waiting, mut worn) = (vec![first], Vec::new());
    while let Some(id) = waiting.pop() {
        match seen.get_mut(id.0 as usize) {
            Some(seen) if !*seen => *seen = true,
            _ => continue,
        }
        let material = &scene.materials[id.0 as usize];
        if let MaterialKind::Mix { materials, amount } = &material.kind {
            waiting.extend(mixed(materials, *amount));
        }
        worn.push(material);
    }
    worn
}

/// Returns the materials of a mix whose weight is above 0: one or both.
fn mixed(materials: &[MaterialId; 2], amount: Scalar) -> impl Iterator<Item = MaterialId> {
    let [without_first, without_second] = match amount {
        Scalar::Constant(amount) => [amount >= 1.0, amount <= 0.0],
        Scalar::Texture(_) => [false; 2],
    };
    let [first, second] = *materials;
    (!without_first).then_some(first).into_iter().chain((!without_second).then_some(second))
}

pub(super) fn find_lens(visible: &Visible<'_>) -> FirstCause {
    let camera = &visible.scene.camera;
    let open = camera.lens_radius != 0.0;
    open.then(|| (format!("the lens has radius {}", camera.lens_radius), camera.source.clone(), 1))
}

pub(super) fn find_motion(visible: &Visible<'_>) -> FirstCause {
    let camera = &visible.scene.camera;
    let [open, close] = camera.shutter;
    let [first, second] = visible.scene.motion();
    // Nothing moves before and after the motion. NaN counts as an open shutter.
    if open == close || close <= first || open >= second {
        return None;
    }
    let camera = [("the camera", camera.to_world, camera.moves_to, &camera.source)];
    let instances = visible.instances.iter().map(|i| ("an instance", i.to_world, i.moves_to, &i.source));
    let shapes = visible.shapes.iter().map(|s| ("a shape", s.to_world, s.moves_to, &s.source));
    let moving = camera.into_iter().chain(instances).chain(shapes);
    let moving = moving.filter(|(_, to_world, moves_to, _)| moves_to.is_some_and(|to| to != *to_world));
    found(moving, |(what, .., source)| (format!("{what} moves while the shutter is open"), source.clone()))
}

/// Opens and closes the shutter at the middle of the exposure.
pub(super) fn stop_motion(scene: &mut Scene) {
    let [open, close] = scene.camera.shutter;
    scene.camera.shutter = [open + (close - open) * 0.5; 2];
}

pub(super) fn find_interreflection(visible: &Visible<'_>) -> FirstCause {
    let scene = visible.scene;
    let scatters = visible.shapes.iter().any(|shape| !is_black(scene, shape))
        || visible.media().any(|medium| medium.scattering != [0.0; 3]);
    let because = match scene.max_depth {
        _ if !scatters => return None,
        Some(..=1) => return None,
        Some(depth) => format!("paths have up to {depth} scattering events"),
        None => "paths may have any length".into(),
    };
    Some((because, Source { line: 0, ..scene.camera.source.clone() }, 1))
}

/// Returns true if a shape scatters no light: a black diffuse surface, an interface between media, or an unlit surface.
fn is_black(scene: &Scene, shape: &Shape) -> bool {
    match scene.materials.get(shape.material.0 as usize).map(|m| &m.kind) {
        Some(MaterialKind::Diffuse { reflectance }) => *reflectance == Color::Constant([0.0; 3]),
        Some(MaterialKind::Interface | MaterialKind::Unlit { .. }) => true,
        _ => false,
    }
}

pub(super) fn find_media(visible: &Visible<'_>, does: &str, coefficient: fn(&Medium) -> [f32; 3]) -> FirstCause {
    let media = visible.media().filter(|medium| coefficient(medium) != [0.0; 3]);
    let because = |medium: &Medium| format!("medium \"{}\" {does} {:?} per unit", medium.name, coefficient(medium));
    found(media, |medium| (because(medium), medium.source.clone()))
}

/// Applies `thin` to each medium, and removes media whose coefficients are then all 0.
pub(super) fn thin_media(scene: &mut Scene, thin: fn(&mut Medium)) {
    scene.media.iter_mut().for_each(thin);
    let filled: Vec<bool> = scene.media.iter().map(|m| m.absorption != [0.0; 3] || m.scattering != [0.0; 3]).collect();
    let clear = |medium: &mut Option<MediumId>| {
        *medium = medium.filter(|m| filled.get(m.0 as usize).copied().unwrap_or(true));
    };
    clear(&mut scene.camera.medium);
    for media in scene.shapes_mut().filter_map(|s| s.media.as_mut()) {
        clear(&mut media.inside);
        clear(&mut media.outside);
    }
}
