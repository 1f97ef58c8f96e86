//! What a scene calls for, and why.

mod chance;
mod lights;
mod materials;
mod used;

use crate::{Camera, MaterialKind, Scene, Source};
use std::fmt;
use std::str::FromStr;
use used::Used;

/// Something that a scene may call for, and that costs time where it does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[non_exhaustive]
pub enum Effect {
    /// Lamps with an area: shadows with soft borders.
    SoftShadows,
    /// More than one light to choose among.
    SeveralLights,
    /// Rough metals, coats and glass.
    Glossy,
    /// Smooth metals and coats, and mirrors.
    Mirror,
    /// Glass and water: light that goes through surfaces.
    Refraction,
    /// Light that was scattered more than once.
    Interreflection,
    /// Anything that varies over a surface: reflectances, roughness, bumps, shares of a mix, holes.
    Textures,
    /// Light from beyond the scene.
    Environment,
    /// A lens with an opening.
    DepthOfField,
    /// Something moves while the shutter is open.
    MotionBlur,
    /// Surfaces with holes: an opacity below 1.
    Transparency,
    /// Media that swallow light.
    AbsorbingMedia,
    /// Media that scatter light.
    ScatteringMedia,
}

impl Effect {
    /// Every effect, in the order in which they are told.
    pub const ALL: [Self; 13] = [
        Self::SoftShadows,
        Self::SeveralLights,
        Self::Glossy,
        Self::Mirror,
        Self::Refraction,
        Self::Interreflection,
        Self::Textures,
        Self::Environment,
        Self::DepthOfField,
        Self::MotionBlur,
        Self::Transparency,
        Self::AbsorbingMedia,
        Self::ScatteringMedia,
    ];

    /// Its name on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::SoftShadows => "soft-shadows",
            Self::SeveralLights => "several-lights",
            Self::Glossy => "glossy",
            Self::Mirror => "mirror",
            Self::Refraction => "refraction",
            Self::Interreflection => "interreflection",
            Self::Textures => "textures",
            Self::Environment => "environment",
            Self::DepthOfField => "depth-of-field",
            Self::MotionBlur => "motion-blur",
            Self::Transparency => "transparency",
            Self::AbsorbingMedia => "absorbing-media",
            Self::ScatteringMedia => "scattering-media",
        }
    }

    /// What a scene is without it, as a short phrase: what [`Scene::without`] makes of it.
    pub const fn left_out(self) -> &'static str {
        match self {
            Self::SoftShadows => "each lamp is a point of the same power, and cannot be seen",
            Self::SeveralLights => "only the most powerful light shines",
            Self::Glossy => "what is rough is diffuse and as bright, rough glass is clear",
            Self::Mirror => "what mirrors is diffuse and as bright",
            Self::Refraction => "light goes straight through glass, and none is reflected",
            Self::Interreflection => "light is scattered once",
            Self::Textures => "every texture is its mean, and nothing is bumpy",
            Self::Environment => "no light comes from beyond the scene",
            Self::DepthOfField => "the lens is a pinhole",
            Self::MotionBlur => "everything stands where it is at the middle of the exposure",
            Self::Transparency => "what has holes has none, and what is mostly hole is gone",
            Self::AbsorbingMedia => "media swallow nothing",
            Self::ScatteringMedia => "media scatter nothing",
        }
    }
}

impl fmt::Display for Effect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A word that is no effect's name.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("there is no effect \"{word}\": there are {}", Effect::ALL.map(Effect::name).join(", "))]
pub struct UnknownEffect {
    word: String,
}

impl FromStr for Effect {
    type Err = UnknownEffect;

    fn from_str(word: &str) -> Result<Self, UnknownEffect> {
        Self::ALL.into_iter().find(|e| e.name() == word).ok_or_else(|| UnknownEffect { word: word.to_owned() })
    }
}

/// An effect with what calls for it.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Called {
    /// The effect.
    pub effect: Effect,
    /// Why, as a short phrase about the first object that calls for it.
    pub because: String,
    /// Where the first object that calls for it is.
    pub source: Source,
    /// How many objects do: lamps, lights, materials, shapes, media, things that move. At least 1.
    pub objects: usize,
}

/// The effects that a scene calls for, each once, with the first object that does.
///
/// Only what can be seen counts: a material that no shape wears, an object that stands nowhere, a light without
/// light, a medium that does nothing, an opacity of 1, a shutter that opens and closes at once call for nothing.
/// What cannot be decided from the description (a number out of range, what a texture looks like) counts as
/// called for. A sheet of paper ([`DiffuseTransmission`](crate::MaterialKind::DiffuseTransmission)) and a
/// border of media are no effects of their own.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Effects {
    called: Vec<Called>,
    max_depth: Option<u32>,
}

impl Effects {
    /// Walks the scene once.
    pub fn of(scene: &Scene) -> Self {
        let mut effects = Self { called: Vec::new(), max_depth: scene.max_depth };
        let used = Used::of(scene);
        effects.add_lights(scene);
        effects.add_materials(scene, &used);
        effects.add_shapes(&used);
        effects.add_media(scene, &used);
        effects.add_depth(scene, &used);
        effects.add_camera(&scene.camera);
        effects.add_motion(scene, &used);
        effects.called.sort_by_key(|c| c.effect);
        effects
    }

    /// Whether the scene calls for an effect.
    pub fn has(&self, effect: Effect) -> bool {
        self.called.iter().any(|c| c.effect == effect)
    }

    /// The effects in a fixed order, with their reasons.
    pub fn called(&self) -> &[Called] {
        &self.called
    }

    /// Most scattering events between camera and light; `None` is unlimited.
    pub fn max_depth(&self) -> Option<u32> {
        self.max_depth
    }

    /// Light that a path tracer finds by chance only: it comes from lamps so small that hardly a path runs into
    /// them, through glass or water so smooth that no other way leads there.
    ///
    /// A path tracer aims at lamps, but not through a surface that bends light: whatever lies behind it (a
    /// caustic, a glass' shadow) is lit only where a scattered ray happens to leave through it and to meet the
    /// lamp. After a diffuse event that has probability (solid angle of the lamp) / pi at most. The scene is told
    /// apart where
    /// * a shape can be seen whose material refracts and is smooth (alpha below
    ///   [`effectively_smooth`](crate::effectively_smooth), which no light sample can go through; or rough by a
    ///   texture, which may be), and paths may be scattered twice,
    /// * and a lamp, seen from the middle of that shape, fills less than 1e-3 sr: fewer than one scattered ray in
    ///   3000 finds it, so that a pixel of some hundred samples sees none of its light, or a speck. Points, spots
    ///   and distant lights fill nothing, and what they send through glass is not found at all.
    /// * Lamps with less than a hundredth of all lamps' power do not count.
    ///
    /// The solid angle is `area / distance^2`, a quarter of that for a sphere: an upper bound. Small bright parts
    /// of an environment image are not looked for. The reason is about the first such lamp; `objects` counts
    /// them.
    pub fn found_by_chance(scene: &Scene) -> Option<Called> {
        chance::found_by_chance(scene, &Used::of(scene))
    }

    /// One more object that calls for `effect`; the first one is told.
    fn add(&mut self, effect: Effect, because: impl FnOnce() -> String, source: &Source) {
        match self.called.iter_mut().find(|c| c.effect == effect) {
            Some(called) => called.objects += 1,
            None => self.called.push(Called { effect, because: because(), source: source.clone(), objects: 1 }),
        }
    }

    /// Says how many objects call for an effect, where each alone would not.
    fn count(&mut self, effect: Effect, objects: usize) {
        self.called.iter_mut().filter(|c| c.effect == effect).for_each(|c| c.objects = objects);
    }

    fn add_shapes(&mut self, used: &Used<'_>) {
        for shape in &used.shapes {
            let Some(alpha) = used::holes(shape) else { continue };
            self.add(Effect::Transparency, || format!("a shape has an opacity of {alpha}"), &shape.source);
        }
    }

    fn add_media(&mut self, scene: &Scene, used: &Used<'_>) {
        for medium in scene.media.iter().zip(&used.media).filter_map(|(medium, used)| used.then_some(medium)) {
            let because = |does, what: &[f32; 3]| format!("medium \"{}\" {does} {what:?} per unit", medium.name);
            if medium.absorption != [0.0; 3] {
                self.add(Effect::AbsorbingMedia, || because("absorbs", &medium.absorption), &medium.source);
            }
            if medium.scattering != [0.0; 3] {
                self.add(Effect::ScatteringMedia, || because("scatters", &medium.scattering), &medium.source);
            }
        }
    }

    fn add_depth(&mut self, scene: &Scene, used: &Used<'_>) {
        let scatters = used.shapes.iter().any(|s| !used::is_black(scene, s)) || self.has(Effect::ScatteringMedia);
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

    fn add_motion(&mut self, scene: &Scene, used: &Used<'_>) {
        let [open, close] = scene.camera.shutter;
        let [first, second] = used::motion_span(scene);
        // Before and after the motion all stands still. Not a number counts as open.
        if open == close || close <= first || open >= second {
            return;
        }
        let camera = [("the camera", scene.camera.to_world, scene.camera.moves_to, &scene.camera.source)];
        let instances = used.instances.iter().map(|i| ("an instance", i.to_world, i.moves_to, &i.source));
        let shapes = used.shapes.iter().map(|s| ("a shape", s.to_world, s.moves_to, &s.source));
        for (what, to_world, moves_to, source) in camera.into_iter().chain(instances).chain(shapes) {
            if moves_to.is_some_and(|to| to != to_world) {
                self.add(Effect::MotionBlur, || format!("{what} moves while the shutter is open"), source);
            }
        }
    }
}

/// Whether a material, seen by itself, calls for one of the effects of surfaces (glossy, mirror, refraction).
pub(crate) fn surface_calls_for(kind: &MaterialKind, effect: Effect) -> bool {
    materials::lobes(kind).iter().any(|lobe| materials::calls_for(lobe, effect))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_told_apart_and_read_back() {
        for (i, effect) in Effect::ALL.into_iter().enumerate() {
            assert_eq!(effect.name().parse(), Ok(effect));
            assert_eq!(effect as usize, i, "in the order of ALL");
        }
        let wrong = "soft".parse::<Effect>().map_err(|e| e.to_string());
        assert!(wrong.is_err_and(|e| e.starts_with("there is no effect \"soft\": there are soft-shadows, several")));
    }
}
