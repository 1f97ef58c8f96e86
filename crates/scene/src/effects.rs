//! Effects that a scene calls for, with the reason for each.

mod caustics;
mod lights;
mod materials;
mod visible;

use crate::{Camera, MaterialKind, Scene, Source};
use dapple_core::nearest_name;
use std::fmt;
use std::str::FromStr;
use visible::Visible;

/// Declares the effects in the order of reports: each with its name, and a phrase for the scene without it.
macro_rules! effects {
    ($($(#[$about:meta])* $variant:ident: $name:literal, $left_out:literal;)*) => {
        /// A rendering effect, such as soft shadows, that costs render time in scenes that call for it.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        #[non_exhaustive]
        pub enum Effect {
            $($(#[$about])* $variant,)*
        }

        impl Effect {
            /// All effects, in the order of reports.
            pub const ALL: [Self; [$($name),*].len()] = [$(Self::$variant),*];

            /// Returns the effect's name on the command line, such as `soft-shadows`.
            pub const fn name(self) -> &'static str {
                match self { $(Self::$variant => $name,)* }
            }

            /// Returns a short phrase that describes the scene without the effect, as [`Scene::without`] returns it.
            pub const fn left_out(self) -> &'static str {
                match self { $(Self::$variant => $left_out,)* }
            }
        }
    };
}

effects! {
    /// Soft shadows, cast by lights with an area.
    SoftShadows: "soft-shadows", "each area light is a point light of the same power, and invisible";
    /// More than one light, so that a renderer selects among them.
    SeveralLights: "several-lights", "only the most powerful light shines";
    /// Glossy reflection or transmission: rough metals, coats and glass.
    Glossy: "glossy", "rough surfaces are diffuse and equally bright, rough glass is clear";
    /// Mirror reflection: smooth metals, smooth coats and perfect mirrors.
    Mirror: "mirror", "mirrors are diffuse and equally bright";
    /// Transmission through surfaces such as glass, water and panes.
    Refraction: "refraction", "light passes straight through glass, without reflection";
    /// Light that is scattered more than once on its path.
    Interreflection: "interreflection", "light scatters once";
    /// Values that vary over a surface: reflectance, roughness, bumps, mix weights, opacity.
    Textures: "textures", "every texture is its mean, and bumps are gone";
    /// Light from an environment, constant or an image.
    Environment: "environment", "the environment is black";
    /// Depth of field: a lens with an aperture.
    DepthOfField: "depth-of-field", "the lens is a pinhole";
    /// Motion blur: the camera, a shape or an instance moves while the shutter is open.
    MotionBlur: "motion-blur", "everything stands still, at its place in the middle of the exposure";
    /// Surfaces with an opacity below 1.
    Transparency: "transparency", "partly transparent surfaces are opaque, mostly transparent ones are gone";
    /// Participating media that absorb light.
    AbsorbingMedia: "absorbing-media", "media do not absorb";
    /// Participating media that scatter light.
    ScatteringMedia: "scattering-media", "media do not scatter";
}

impl fmt::Display for Effect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// The error of an unknown effect name, found when a name is parsed as an [`Effect`].
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("unknown effect \"{name}\"; {}", advice(name))]
pub struct UnknownEffect {
    name: String,
}

/// Returns advice on an unknown effect name: the nearest known name, or the list of all names.
fn advice(name: &str) -> String {
    let known = Effect::ALL.map(Effect::name);
    match nearest_name(name, known) {
        Some(near) => format!("did you mean \"{near}\"?"),
        None => format!("choose among {}", known.join(", ")),
    }
}

impl FromStr for Effect {
    type Err = UnknownEffect;

    fn from_str(name: &str) -> Result<Self, UnknownEffect> {
        Self::ALL.into_iter().find(|e| e.name() == name).ok_or_else(|| UnknownEffect { name: name.to_owned() })
    }
}

/// An effect that a scene calls for, and the reason.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Called {
    /// The effect that the scene calls for.
    pub effect: Effect,
    /// The reason, as a short phrase about the first object that calls for the effect.
    pub because: String,
    /// File and line of the first object that calls for the effect.
    pub source: Source,
    /// Number of objects that call for the effect (lamps, lights, materials, shapes, media, moving things); at least 1.
    pub objects: usize,
}

/// The effects that a scene calls for, each once, with the first object that calls for it.
///
/// Only visible and effective objects count. A material on no shape, an object without instances, a black light, a
/// medium without coefficients, an opacity of 1 and a shutter without duration call for nothing. An undecidable case (a
/// number out of range, a texture's values) counts. Diffuse transmission
/// ([`DiffuseTransmission`](crate::MaterialKind::DiffuseTransmission)) and interfaces between media are not effects.
///
/// ```
/// use dapple_scene::{Effect, Effects, bundled};
///
/// let scene = bundled::files("cornell").expect("a bundled scene").read()?;
/// let effects = Effects::of(&scene);
/// assert!(effects.has(Effect::SoftShadows) && !effects.has(Effect::Refraction));
/// # Ok::<(), dapple_scene::ReadError>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Effects {
    called: Vec<Called>,
    max_depth: Option<u32>,
}

impl Effects {
    /// Returns the effects that a scene calls for.
    pub fn of(scene: &Scene) -> Self {
        let mut effects = Self { called: Vec::new(), max_depth: scene.max_depth };
        let visible = Visible::of(scene);
        effects.add_lights(scene);
        effects.add_materials(scene, &visible);
        effects.add_shapes(&visible);
        effects.add_media(scene, &visible);
        effects.add_depth(scene, &visible);
        effects.add_camera(&scene.camera);
        effects.add_motion(scene, &visible);
        effects.called.sort_by_key(|c| c.effect);
        effects
    }

    /// Returns true if the scene calls for `effect`.
    pub fn has(&self, effect: Effect) -> bool {
        self.called.iter().any(|c| c.effect == effect)
    }

    /// Returns the effects that the scene calls for with their reasons, in the order of [`Effect::ALL`].
    pub fn called(&self) -> &[Called] {
        &self.called
    }

    /// Returns the largest number of scattering events on a path from camera to light; `None` is unlimited.
    pub fn max_depth(&self) -> Option<u32> {
        self.max_depth
    }

    /// Returns the scene's caustics that a path tracer finds only by chance, if any: light of small lamps through
    /// smooth glass.
    ///
    /// A path tracer samples lamps directly, but not through a surface that refracts. Behind such a surface, light
    /// arrives only along scattered rays that happen to leave through it and to hit the lamp. After a diffuse event
    /// their probability is at most the solid angle of the lamp over pi. A scene has such caustics if
    /// * a visible shape refracts and is smooth (see [`effectively_smooth`](crate::effectively_smooth)) or has a
    ///   textured roughness, and paths may scatter twice,
    /// * and a lamp covers less than 1e-3 sr, seen from the middle of that shape. Fewer than one scattered ray in 3000
    ///   finds the lamp. Points, spots and distant lights have no solid angle, and are never found through glass.
    /// * Lamps with less than 0.01 of the power of all lamps do not count.
    ///
    /// The solid angle is the upper bound `area / distance^2`, a quarter of this for a sphere. Small bright parts of an
    /// environment map are not searched. The reason in the result names the first such lamp; its `objects` is the
    /// number of such lamps.
    pub fn found_by_chance(scene: &Scene) -> Option<Called> {
        caustics::found_by_chance(scene, &Visible::of(scene))
    }

    /// Counts one more object that calls for `effect`. The first such object gives the reason and the source.
    fn add(&mut self, effect: Effect, because: impl FnOnce() -> String, source: &Source) {
        match self.called.iter_mut().find(|c| c.effect == effect) {
            Some(called) => called.objects += 1,
            None => self.called.push(Called { effect, because: because(), source: source.clone(), objects: 1 }),
        }
    }

    /// Sets the number of objects of an effect that only several objects together call for.
    fn count(&mut self, effect: Effect, objects: usize) {
        self.called.iter_mut().filter(|c| c.effect == effect).for_each(|c| c.objects = objects);
    }

    fn add_shapes(&mut self, visible: &Visible<'_>) {
        for shape in &visible.shapes {
            let Some(alpha) = visible::holes(shape) else { continue };
            self.add(Effect::Transparency, || format!("a shape has an opacity of {alpha}"), &shape.source);
        }
    }

    fn add_media(&mut self, scene: &Scene, visible: &Visible<'_>) {
        for medium in scene.media.iter().zip(&visible.media).filter_map(|(medium, used)| used.then_some(medium)) {
            let because = |does, what: &[f32; 3]| format!("medium \"{}\" {does} {what:?} per unit", medium.name);
            if medium.absorption != [0.0; 3] {
                self.add(Effect::AbsorbingMedia, || because("absorbs", &medium.absorption), &medium.source);
            }
            if medium.scattering != [0.0; 3] {
                self.add(Effect::ScatteringMedia, || because("scatters", &medium.scattering), &medium.source);
            }
        }
    }

    fn add_depth(&mut self, scene: &Scene, visible: &Visible<'_>) {
        let scatters = visible.shapes.iter().any(|s| !visible::is_black(scene, s)) || self.has(Effect::ScatteringMedia);
        if !scatters || scene.max_depth.is_some_and(|d| d <= 1) {
            return;
        }
        let because = || match scene.max_depth {
            Some(depth) => format!("up to {depth} scattering events are asked for"),
            None => "paths of any length are asked for".into(),
        };
        let source = Source { line: 0, ..scene.camera.source.clone() };
        self.add(Effect::Interreflection, because, &source);
    }

    fn add_camera(&mut self, camera: &Camera) {
        if camera.lens_radius != 0.0 {
            let because = || format!("the lens has radius {}", camera.lens_radius);
            self.add(Effect::DepthOfField, because, &camera.source);
        }
    }

    fn add_motion(&mut self, scene: &Scene, visible: &Visible<'_>) {
        let [open, close] = scene.camera.shutter;
        let [first, second] = visible::motion_span(scene);
        // Nothing moves before and after the motion. NaN counts as an open shutter.
        if open == close || close <= first || open >= second {
            return;
        }
        let camera = [("the camera", scene.camera.to_world, scene.camera.moves_to, &scene.camera.source)];
        let instances = visible.instances.iter().map(|i| ("an instance", i.to_world, i.moves_to, &i.source));
        let shapes = visible.shapes.iter().map(|s| ("a shape", s.to_world, s.moves_to, &s.source));
        for (what, to_world, moves_to, source) in camera.into_iter().chain(instances).chain(shapes) {
            if moves_to.is_some_and(|to| to != to_world) {
                self.add(Effect::MotionBlur, || format!("{what} moves while the shutter is open"), source);
            }
        }
    }
}

/// Returns true if a material by itself calls for an effect of surfaces (glossy, mirror, refraction).
pub(crate) fn surface_calls_for(kind: &MaterialKind, effect: Effect) -> bool {
    materials::lobes(kind).iter().any(|lobe| materials::calls_for(lobe, effect))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_distinct_and_parse() {
        for (i, effect) in Effect::ALL.into_iter().enumerate() {
            assert_eq!(effect.name().parse(), Ok(effect));
            assert_eq!(effect as usize, i, "in the order of ALL");
        }
        let near = "soft-shadow".parse::<Effect>().map_err(|e| e.to_string());
        assert_eq!(near, Err("unknown effect \"soft-shadow\"; did you mean \"soft-shadows\"?".into()));
        let wrong = "soft".parse::<Effect>().map_err(|e| e.to_string());
        assert!(wrong.is_err_and(|e| e.starts_with("unknown effect \"soft\"; choose among soft-shadows, several")));
    }
}
