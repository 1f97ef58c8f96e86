//! Scenes edited to do without one of their effects.

mod surfaces;

use super::light_power::{LampShape, LightNumber, powers};
use super::{Light, LightKind, Material, Scalar, Scene, Shape, SpotFalloff};
use crate::effects::{Effect, Effects};
use glam::{DAffine3, DMat3, DVec3};

/// The error of a scene that cannot be edited to do without an effect.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum WithoutError {
    /// The edit would remove all lights.
    #[error("without {effect} no light is left, and the image would be black; keep the effect")]
    NoLight {
        /// The effect.
        effect: Effect,
    },
}

/// A function that returns the albedo at normal incidence of a material without textures, or `None`: see
/// [`Scene::without`].
pub type Albedo<'a> = dyn Fn(&Material) -> Option<[f32; 3]> + 'a;

/// Least length of the mean normal of a lamp that counts as flat: a lamp that emits to one side only.
const FLAT: f64 = 0.9;

impl Scene {
    /// Returns an edited scene without an effect, so that a renderer needs no switch. A scene that does not call for
    /// the effect is returned unchanged.
    ///
    /// * [`SoftShadows`](Effect::SoftShadows): each lamp becomes a light without extent of the same power at its
    ///   area-weighted middle, where it stands first. Of a flat one-sided lamp (area `A`, radiance `L`) that is a
    ///   spot of 90 degrees along its normal with intensity `A L` on the axis and a smooth-step falloff, which has
    ///   the lamp's intensity `A L` on the axis and, like its cosine, the power `pi A L`; of a flat two-sided
    ///   lamp two of them, back to back; of any other (a sphere, a lamp that turns) a point of equal intensity in
    ///   all directions, `power / 4 pi`. The lamp's shape goes: it would shut the point in.
    /// * [`SeveralLights`](Effect::SeveralLights): only the light of the highest power shines (the first of
    ///   equals); other lamps stay as dark bodies.
    /// * [`Glossy`](Effect::Glossy): materials with a rough lobe become diffuse, with their whole albedo at normal
    ///   incidence. A textured color stays, times what its mean changes by. Rough glass becomes smooth glass.
    /// * [`Mirror`](Effect::Mirror): materials with a smooth reflecting lobe become diffuse in the same way.
    /// * [`Refraction`](Effect::Refraction): glass and panes become
    ///   [`Interface`](super::MaterialKind::Interface)s; what they reflect or tint is lost.
    /// * [`Interreflection`](Effect::Interreflection): at most one scattering event.
    /// * [`Textures`](Effect::Textures): each becomes its mean over the unit square of texture coordinates (of a
    ///   product the product of means); bumps and normal maps go.
    /// * [`Environment`](Effect::Environment): infinite lights go.
    /// * [`DepthOfField`](Effect::DepthOfField): the lens has radius 0.
    /// * [`MotionBlur`](Effect::MotionBlur): the shutter opens and closes at the middle of its time, so that
    ///   everything stands where it is then.
    /// * [`Transparency`](Effect::Transparency): shapes with a constant opacity below one half go, unless they
    ///   shine; all others are opaque.
    /// * [`AbsorbingMedia`](Effect::AbsorbingMedia), [`ScatteringMedia`](Effect::ScatteringMedia): their
    ///   coefficients become 0, and media with nothing left go.
    ///
    /// `albedo` returns the albedo at normal incidence of a material without textures, bump and normal maps, which only
    /// a renderer knows. `None` (for a material that the renderer refuses) leaves the material as it is.
    ///
    /// # Errors
    ///
    /// [`WithoutError::NoLight`] where the edit would take the last light away.
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

/// Returns the transform from a space whose +z is `axis`, with this origin.
fn along(axis: DVec3, origin: DVec3) -> DAffine3 {
    let x = axis.any_orthonormal_vector();
    DAffine3 { matrix3: DMat3::from_cols(x, axis.cross(x), axis), translation: origin }
}
