//! Effects that a scene uses, with the reason for each, and edits that remove an effect from a scene.
//!
//! The table below declares each effect with a function that finds it in a scene and one that removes it. Both functions of
//! an effect are in the same module.

mod lights;
mod surfaces;
mod visible;

use crate::{Material, Scene, Source};
use dapple_core::options::nearest_name;
use std::fmt;
use std::str::FromStr;
use visible::Visible;

/// Declares the effects in the order of reports: each with its name, the function that finds the objects that use it, the
/// function that removes it from a scene, and a phrase that describes the scene without it.
macro_rules! effects {
    ($($(#[$about:meta])* $variant:ident $name:literal: $find:expr, $remove:expr, $left_out:literal;)*) => {
        /// A rendering effect, such as soft shadows, that costs render time in scenes that use it.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        #[non_exhaustive]
        pub enum Effect {
            $($(#[$about])* $variant,)*
        }

        impl Effect {
            /// All effects, in the order of the enum.
            pub const ALL: [Self; [$($name),*].len()] = [$(Self::$variant),*];

            /// Returns the effect's name on the command line, such as `soft-shadows`.
            pub const fn name(self) -> &'static str {
                match self { $(Self::$variant => $name,)* }
            }

            /// Returns a short description of the result of [`Scene::without`], such as "media do not scatter".
            pub const fn left_out(self) -> &'static str {
                match self { $(Self::$variant => $left_out,)* }
            }

            fn find(self) -> fn(&Visible<'_>) -> FirstCause {
                match self { $(Self::$variant => $find,)* }
            }

            fn remove(self) -> fn(&mut Scene, &Albedo<'_>) {
                match self { $(Self::$variant => $remove,)* }
            }
        }
    };
}

effects! {
    /// Soft shadows, cast by lights with an area.
    SoftShadows "soft-shadows": lights::find_lamps, |scene, _| lights::shrink_lamps(scene),
        "each area light is an invisible point light of the same power";
    /// More than one light, so that a renderer selects among them.
    SeveralLights "several-lights": lights::find_several, |scene, _| lights::keep_strongest(scene),
        "only the most powerful light emits";
    /// Glossy reflection or transmission: rough metals, coats and glass.
    Glossy "glossy": |visible| surfaces::find_lobes(visible, surfaces::is_glossy),
        |scene, albedo| surfaces::replace_lobes(scene, albedo, surfaces::is_glossy),
        "glossy surfaces are diffuse and equally bright, rough glass is smooth";
    /// Mirror reflection: smooth metals, smooth coats and perfect mirrors.
    Mirror "mirror": |visible| surfaces::find_lobes(visible, surfaces::is_mirror),
        |scene, albedo| surfaces::replace_lobes(scene, albedo, surfaces::is_mirror),
        "mirrors are diffuse and equally bright";
    /// Transmission through surfaces such as glass, water and panes.
    Refraction "refraction": |visible| surfaces::find_lobes(visible, |lobe| lobe.refracts),
        |scene, _| surfaces::remove_glass(scene),
        "light passes straight through glass, without reflection";
    /// Light that is scattered more than once on its path.
    Interreflection "interreflection": visible::find_interreflection, |scene, _| scene.max_depth = Some(1),
        "light scatters once";
    /// Values that vary over a surface: reflectance, roughness, bumps, mix weights, opacity.
    Textures "textures": surfaces::find_textures, |scene, _| surfaces::flatten_textures(scene),
        "every texture is replaced by its mean, and bumps are removed";
    /// Light from an environment, constant or an image.
    Environment "environment": lights::find_environments,
        |scene, _| scene.lights.retain(|light| light.kind.environment().is_none()),
        "the environment is black";
    /// Depth of field: a lens with an aperture.
    DepthOfField "depth-of-field": visible::find_lens, |scene, _| scene.camera.lens_radius = 0.0,
        "the lens is a pinhole";
    /// Motion blur: the camera, a shape or an instance moves while the shutter is open.
    MotionBlur "motion-blur": visible::find_motion, |scene, _| visible::stop_motion(scene),
        "everything stands still, at its place in the middle of the exposure";
    /// Surfaces with an opacity below 1.
    Transparency "transparency": surfaces::find_holes, |scene, _| surfaces::fill_holes(scene),
        "mostly transparent surfaces are removed, all others are opaque";
    /// Participating media that absorb light.
    AbsorbingMedia "absorbing-media": |visible| visible::find_media(visible, "absorbs", |medium| medium.absorption),
        |scene, _| visible::thin_media(scene, |medium| medium.absorption = [0.0; 3]),
        "media do not absorb";
    /// Participating media that scatter light.
    ScatteringMedia "scattering-media": |visible| visible::find_media(visible, "scatters", |medium| medium.scattering),
        |scene, _| visible::thin_media(scene, |medium| medium.scattering = [0.0; 3]),
        "media do not scatter";
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

/// An effect that a scene uses, and the object that requires it.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct CalledEffect {
    /// The effect that the scene uses.
    pub effect: Effect,
    /// The reason, as a short phrase about an object of the scene.
    pub because: String,
    /// File and line of the first object that uses the effect; of the second light for [`Effect::SeveralLights`].
    pub source: Source,
    /// Number of lights, materials, shapes, media or moving objects that use the effect; at least 1.
    pub objects: usize,
}

/// The reason and the place of the first object that uses an effect, and the number of all objects that use it.
type FirstCause = Option<(String, Source, usize)>;

/// Counts the objects that use an effect. `describe` returns the reason and the place of the first one.
fn found<T>(objects: impl IntoIterator<Item = T>, describe: impl FnOnce(T) -> (String, Source)) -> FirstCause {
    let mut objects = objects.into_iter();
    let (because, source) = describe(objects.next()?);
    Some((because, source, 1 + objects.count()))
}

/// The effects that a scene uses, each once, with the first object that uses it.
///
/// Objects that cannot affect the image are ignored: unused materials, objects without instances, black lights, media whose
/// coefficients are 0, opacities of 1 and shutters without duration. An object with a texture or an invalid number is
/// assumed to use each effect that depends on it. Diffuse transmission
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
    called: Vec<CalledEffect>,
    max_depth: Option<u32>,
}

impl Effects {
    /// Returns the effects that a scene uses.
    pub fn of(scene: &Scene) -> Self {
        let visible = Visible::of(scene);
        let find = |effect: Effect| {
            let (because, source, objects) = effect.find()(&visible)?;
            Some(CalledEffect { effect, because, source, objects })
        };
        Self { called: Effect::ALL.into_iter().filter_map(find).collect(), max_depth: scene.max_depth }
    }

    /// Returns true if the scene uses `effect`.
    pub fn has(&self, effect: Effect) -> bool {
        self.called.iter().any(|c| c.effect == effect)
    }

    /// Returns the effects that the scene uses with their reasons, in the order of [`Effect::ALL`].
    pub fn called(&self) -> &[CalledEffect] {
        &self.called
    }

    /// Returns the largest number of scattering events on a path from camera to light; `None` is unlimited.
    pub fn max_depth(&self) -> Option<u32> {
        self.max_depth
    }

    /// Finds caustics from small lights through smooth glass, which a path tracer samples only by chance. Returns `None` for a
    /// scene without them.
    ///
    /// Light sampling cannot connect a point to a light through a refracting surface. Only scattered rays that hit the light
    /// by chance carry its light. A diffusely scattered ray hits it with a probability of at most `solid angle / pi`.
    ///
    /// A light counts if paths may scatter twice and all of these conditions hold:
    /// * The scene has a refracting shape that is smooth (see [`effectively_smooth`](crate::effectively_smooth)) or has a
    ///   textured roughness.
    /// * The light covers less than 1e-3 sr, seen from the centre of the shape. Point, spot and distant lights cover 0 sr.
    /// * The light has at least 0.01 of the power of all lights, and is not an environment.
    ///
    /// The solid angle of a light is taken to be `area / distance^2`, an upper bound, or a quarter of this if the light is a
    /// sphere. In the result, `source` is the first light that counts, and `objects` the number of these lights.
    pub fn found_by_chance(scene: &Scene) -> Option<CalledEffect> {
        lights::found_by_chance(&Visible::of(scene))
    }
}

/// The error of an effect that cannot be removed from a scene.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum WithoutError {
    /// Removing the effect would remove all lights.
    #[error("no light remains without {effect}, and the image would be black; keep the effect")]
    NoLight {
        /// The effect to be removed.
        effect: Effect,
    },
}

/// A function for [`Scene::without`]: takes a material without textures, and returns the albedo of the material at normal
/// incidence, or `None` if the renderer rejects the material.
pub type Albedo<'a> = dyn Fn(&Material) -> Option<[f32; 3]> + 'a;

impl Scene {
    /// Returns a copy of the scene without `effect`; an unchanged copy if the scene does not use the effect.
    ///
    /// * [`SoftShadows`](Effect::SoftShadows): each area light is replaced by a point or spot light of the same power, at the
    ///   area light's centroid in the pose `to_world`. The shape is removed, since it would enclose the new light.
    ///   A flat one-sided light of area `A` and radiance `L` becomes a spot along its normal, 90 degrees from axis to edge,
    ///   with smooth-step falloff. This spot has the same axial intensity `A L` and power `pi A L`. A flat two-sided light
    ///   becomes two such spots, back to back. Any other area light becomes a point of intensity `power / (4 pi)`.
    /// * [`SeveralLights`](Effect::SeveralLights): only the light of the highest power emits. Other area lights remain as
    ///   shapes without emission.
    /// * [`Glossy`](Effect::Glossy): materials with a rough lobe become diffuse. The reflectance is the albedo of all lobes at
    ///   normal incidence. A textured colour keeps its texture, scaled so that its mean is this albedo. Rough glass becomes
    ///   smooth glass.
    /// * [`Mirror`](Effect::Mirror): materials with a smooth reflecting lobe become diffuse in the same way.
    /// * [`Refraction`](Effect::Refraction): glass and panes become [`Interface`](crate::MaterialKind::Interface)s;
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
    /// * [`AbsorbingMedia`](Effect::AbsorbingMedia), [`ScatteringMedia`](Effect::ScatteringMedia): the absorption or
    ///   scattering coefficients become 0. Media whose coefficients are all 0 are removed.
    ///
    /// `albedo` takes a material without textures, bump map and normal map, and returns its albedo at normal incidence. A
    /// material for which it returns `None` stays unchanged.
    ///
    /// # Errors
    ///
    /// [`WithoutError::NoLight`] if the edit would remove the last light.
    pub fn without(&self, effect: Effect, albedo: &Albedo<'_>) -> Result<Self, WithoutError> {
        let mut scene = self.clone();
        if !Effects::of(self).has(effect) {
            return Ok(scene);
        }
        effect.remove()(&mut scene, albedo);
        let lost = lights::powers(&scene).is_empty() && !lights::powers(self).is_empty();
        if lost { Err(WithoutError::NoLight { effect }) } else { Ok(scene) }
    }
}
