//! Edits that remove one effect, such as soft shadows, from a scene.

mod surfaces;

use super::light_power::{LampShape, LightNumber, powers};
use super::{Light, LightKind, Material, Scalar, Scene, Shape, SpotFalloff};
use crate::effects::{Effect, Effects};
use glam::{DAffine3, DMat3, DVec3};

/// The error of an effect that cannot be removed from a scene.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum WithoutError {
    /// Removing the effect would remove all lights.
    #[error("without {effect} no light is left, and the image would be black; keep the effect")]
    NoLight {
        /// The effect to be removed.
        effect: Effect,
    },
}

/// A function that returns the albedo at normal incidence of a material without textures, or `None` for a material that
/// the renderer refuses. [`Scene::without`] calls it.
pub type Albedo<'a> = dyn Fn(&Material) -> Option<[f32; 3]> + 'a;

/// Least length of a lamp's mean normal at which the lamp counts as flat and is replaced by spots, not by a point.
const FLAT: f64 = 0.9;

impl Scene {
    /// Returns a copy of the scene edited so that it lacks an effect. A renderer thus needs no switch for effects. A
    /// scene that does not call for the effect is returned unchanged.
    ///
    /// * [`SoftShadows`](Effect::SoftShadows): each area light (lamp) is replaced by a light without extent and of the
    ///   same power, at the lamp's area-weighted centroid in its first pose. The lamp's shape is removed, since it
    ///   would enclose the new light. A flat one-sided lamp of area `A` and radiance `L` becomes a 90 degree spot along
    ///   its normal with smooth-step falloff. This spot has the lamp's axial intensity `A L` and its power `pi A L`. A
    ///   flat two-sided lamp becomes two such spots, back to back. Any other lamp (a sphere, a curved mesh) becomes a
    ///   point of intensity `power / 4 pi`.
    /// * [`SeveralLights`](Effect::SeveralLights): only the light of the highest power (the first of equals) emits.
    ///   Other lamps remain as shapes without emission.
    /// * [`Glossy`](Effect::Glossy): materials with a rough lobe become diffuse, with their whole albedo at normal
    ///   incidence as reflectance. A textured colour keeps its texture, scaled to the new mean. Rough glass becomes
    ///   smooth glass.
    /// * [`Mirror`](Effect::Mirror): materials with a smooth reflecting lobe become diffuse in the same way.
    /// * [`Refraction`](Effect::Refraction): glass and panes become [`Interface`](super::MaterialKind::Interface)s;
    ///   their reflection and tint are lost.
    /// * [`Interreflection`](Effect::Interreflection): paths have at most one scattering event.
    /// * [`Textures`](Effect::Textures): each texture becomes its mean over the unit square of texture coordinates (for
    ///   a product, the product of means). Bump and normal maps are removed.
    /// * [`Environment`](Effect::Environment): infinite lights are removed.
    /// * [`DepthOfField`](Effect::DepthOfField): the lens has radius 0.
    /// * [`MotionBlur`](Effect::MotionBlur): the shutter opens and closes at the middle of the exposure, so that
    ///   nothing moves.
    /// * [`Transparency`](Effect::Transparency): shapes with a constant opacity below one half are removed unless they
    ///   emit light. All other shapes become opaque.
    /// * [`AbsorbingMedia`](Effect::AbsorbingMedia), [`ScatteringMedia`](Effect::ScatteringMedia): the coefficients of
    ///   this kind become 0. Media left without any coefficient are removed.
    ///
    /// `albedo` returns the albedo at normal incidence of a material without textures, bump map and normal map, which
    /// only a renderer knows. `None` (for a material that the renderer refuses) leaves the material unchanged.
    ///
    /// # Errors
    ///
    /// [`WithoutError::NoLight`] if the edit would remove the last light.
    pub fn without(&self, effect: Effect, albedo: &Albedo<'_>) -> Result<Self, WithoutError> {
        let mut scene = self.clone();
        if !Effects::of(self).has(effect) {
            return Ok(scene);
        }
        match effect {
            Effect::SoftShadows => scene.shrink_lamps(),
            Effect::SeveralLights => scene.keep_strongest_light(),
            Effect::Glossy | Effect::Mirror | Effect::Refraction => scene.replace_lobes(effect, albedo),
            Effect::Interreflection => scene.max_depth = Some(1),
            Effect::Textures => scene.flatten_textures(),
            Effect::Environment => scene.lights.retain(|l| l.kind.environment().is_none()),
            Effect::DepthOfField => scene.camera.lens_radius = 0.0,
            Effect::MotionBlur => {
                let [open, close] = scene.camera.shutter;
                scene.camera.shutter = [open + (close - open) * 0.5; 2];
            }
            Effect::Transparency => scene.fill_holes(),
            Effect::AbsorbingMedia | Effect::ScatteringMedia => scene.thin_media(effect),
        }
        let lost = powers(&scene).is_empty() && !powers(self).is_empty();
        if lost { Err(WithoutError::NoLight { effect }) } else { Ok(scene) }
    }

    fn shrink_lamps(&mut self) {
        let lamp = |shape: &Shape| LampShape::of(shape).map(|lamp| (lamp, shape.source.clone()));
        let lamps: Vec<_> = self.shapes.iter().filter_map(lamp).collect();
        self.shapes.retain(|shape| LampShape::of(shape).is_none());
        for (lamp, source) in lamps {
            let points = point_lights(&lamp).into_iter();
            self.lights.extend(points.map(|(kind, to_world)| Light { kind, to_world, source: source.clone() }));
        }
    }

    fn keep_strongest_light(&mut self) {
        let stronger = |best: (LightNumber, f64), next: (LightNumber, f64)| if next.1 > best.1 { next } else { best };
        let kept = powers(self).into_iter().reduce(stronger).map(|(light, _)| light);
        for (i, shape) in self.shapes.iter_mut().enumerate() {
            if kept != Some(LightNumber::Shape(i)) {
                shape.emission = None;
            }
        }
        let mut number = 0..;
        self.lights.retain(|_| kept == number.next().map(LightNumber::Light));
    }

    fn fill_holes(&mut self) {
        let every = self.objects.iter_mut().map(|o| &mut o.shapes).chain([&mut self.shapes]);
        for shapes in every {
            let hole = |s: &Shape| matches!(s.alpha, Some(Scalar::Constant(alpha)) if alpha < 0.5);
            shapes.retain(|s| s.emission.is_some() || !hole(s));
            shapes.iter_mut().for_each(|s| s.alpha = None);
        }
    }

    fn thin_media(&mut self, effect: Effect) {
        for medium in &mut self.media {
            match effect {
                Effect::AbsorbingMedia => medium.absorption = [0.0; 3],
                _ => medium.scattering = [0.0; 3],
            }
        }
        let filled: Vec<bool> =
            self.media.iter().map(|m| m.absorption != [0.0; 3] || m.scattering != [0.0; 3]).collect();
        let clear = |medium: &mut Option<super::MediumId>| {
            *medium = medium.filter(|m| filled.get(m.0 as usize).copied().unwrap_or(true));
        };
        clear(&mut self.camera.medium);
        let shapes = self.objects.iter_mut().flat_map(|o| &mut o.shapes).chain(&mut self.shapes);
        for media in shapes.filter_map(|s| s.media.as_mut()) {
            clear(&mut media.inside);
            clear(&mut media.outside);
        }
    }
}

/// Returns the lights without extent that replace a lamp, each with its light-to-world transform.
fn point_lights(lamp: &LampShape) -> Vec<(LightKind, DAffine3)> {
    if lamp.facing.length() < FLAT {
        let intensity = lamp.power().map(|p| (p / (4.0 * std::f64::consts::PI)) as f32);
        return vec![(LightKind::Point { intensity }, DAffine3::from_translation(lamp.centre))];
    }
    let intensity = lamp.emission.radiance.map(|l| (f64::from(l) * lamp.area) as f32);
    let kind = LightKind::Spot { intensity, cone: 90.0, falloff_start: 0.0, falloff: SpotFalloff::Smoothstep };
    let axis = lamp.facing.normalize();
    let directions = if lamp.emission.two_sided { vec![axis, -axis] } else { vec![axis] };
    directions.into_iter().map(|axis| (kind.clone(), along(axis, lamp.centre))).collect()
}

/// Returns the transform to world space from a space with this origin whose +z axis is the unit vector `axis`.
fn along(axis: DVec3, origin: DVec3) -> DAffine3 {
    let x = axis.any_orthonormal_vector();
    DAffine3 { matrix3: DMat3::from_cols(x, axis.cross(x), axis), translation: origin }
}
