//! The description of a render.

use crate::check_integrator;
use dapple_registry::{DEFAULT_FILTER, DEFAULT_POINTS, DEFAULT_SAMPLER};
use dapple_renderer::light::LightSelection;
use dapple_scene::Effect;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// The version of the JSON format that [`RenderSpec::to_json`] writes.
pub const SPEC_VERSION: u32 = 1;
/// The default budget of a render, in mean samples per pixel.
pub const DEFAULT_SPP: f64 = 16.0;
/// The limit on the mean samples per pixel if the budget is [`BudgetSpec::Error`] and `max_spp` is not set.
pub const ERROR_SPP: u32 = 16384;
/// The longest time limit of a render in seconds: a year.
pub const MOST_SECONDS: f64 = 31_557_600.0;
/// The name of the default integrator, which selects `photons` or `path`. It selects `photons` if a path tracer finds the
/// scene's caustics by chance only, except for parts and motion blur.
pub const DEFAULT_INTEGRATOR: &str = "auto";

/// A description of a render: all settings that decide the pixels of an image.
///
/// Parts and checkpoints store the description as JSON, and `dapple render --spec FILE` reads it. Paths are text, or a list of
/// bytes if they are not UTF-8. Fields missing from the JSON have the values of [`RenderSpec::new`]; unknown fields are
/// refused. The most common fields have setter functions of the same names.
///
/// ```
/// use dapple_job::{BudgetSpec, RenderSpec};
///
/// let spec = RenderSpec::new("teapot").sampler("uniform").budget(BudgetSpec::Spp(16.0)).seed(7);
/// assert_eq!(RenderSpec::from_json(&spec.to_json()?)?, spec);
/// # Ok::<(), dapple_job::SpecError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default = "RenderSpec::unnamed")]
pub struct RenderSpec {
    /// The version of the JSON format: [`SPEC_VERSION`].
    pub version: u32,
    /// The scene: the path of a scene or model file, or the name of a bundled scene.
    #[serde(with = "crate::files::path")]
    pub scene: PathBuf,
    /// The sampler (how many samples each pixel gets), `NAME` or `NAME:key=value,…`.
    pub sampler: String,
    /// The point set (where samples lie), `NAME` or `NAME:key=value,…`.
    pub points: String,
    /// The filter (denoiser), `NAME` or `NAME:key=value,…`; with `none`, each pixel is the mean of its own samples.
    pub filter: String,
    /// The integrator, `NAME` or `NAME:key=value,…`. The default is [`DEFAULT_INTEGRATOR`].
    pub integrator: String,
    /// The rule by which light sampling selects one of several lights. With `None`, [`RenderSpec::selection`] returns the
    /// default.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub light_selection: Option<LightSelection>,
    /// The condition that ends the render.
    pub budget: BudgetSpec,
    /// The image, filtered or unfiltered, whose error [`BudgetSpec::Error`] limits.
    #[serde(skip_serializing_if = "ErrorOf::is_default")]
    pub error_of: ErrorOf,
    /// The smallest number of samples per pixel.
    pub min_spp: u32,
    /// The largest number of samples per pixel; `None` for no bound. With [`BudgetSpec::Error`], it bounds the mean, too; `None`
    /// then means [`ERROR_SPP`] for the mean.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_spp: Option<u32>,
    /// Width and height of the full image in pixels; `None` uses the scene's resolution.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub resolution: Option<[u32; 2]>,
    /// A factor above 0 on the scene's width and height; `None` means 1. Setting `resolution` as well is an error.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scale: Option<f64>,
    /// The part of the image to render.
    pub crop: CropSpec,
    /// Seed of all random numbers.
    pub seed: u64,
    /// The largest number of scattering events between camera and light; `None` uses the scene's limit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_depth: Option<u32>,
    /// The pixel filter: the scene's, or a box one pixel wide.
    pub pixel_filter: PixelFilterSpec,
    /// Effects (kinds of light transport) that are left out of the scene.
    #[serde(with = "names::effects", skip_serializing_if = "Vec::is_empty")]
    pub without: Vec<Effect>,
    /// If `true`, unsupported directives of a scene are warnings instead of errors.
    pub allow_unsupported: bool,
    /// The part (a subset of the image's rows) to render; `None` renders the whole image.
    #[serde(with = "crate::part::text", rename = "shard", skip_serializing_if = "Option::is_none")]
    pub part: Option<crate::PartNumber>,
}

/// The condition that ends a render.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum BudgetSpec {
    /// The scene file's number of samples per pixel, clamped to the bounds of the description. [`DEFAULT_SPP`] if the file
    /// states none. Loading the scene replaces this variant by [`Spp`](Self::Spp).
    Scene,
    /// Exactly this mean number of samples per pixel.
    Spp(f64),
    /// Exactly this number of samples in total.
    Samples(u64),
    /// The render ends when the predicted relMSE of the image is at most this value; [`RenderSpec::error_of`] selects
    /// the filtered or the unfiltered image.
    Error(f64),
    /// About this many seconds for clustering, planning, tracing and filtering together; at most [`MOST_SECONDS`]. Each pixel
    /// gets [`RenderSpec::min_spp`] samples, however long that takes.
    Seconds(f64),
}

/// The image to which an error limit applies.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ErrorOf {
    /// The filtered image. If the filter does not estimate its own error (`oidn`, for example), the limit applies to the
    /// unfiltered image.
    #[default]
    Filtered,
    /// The unfiltered image.
    Unfiltered,
}

impl ErrorOf {
    /// Returns `true` for the default, which JSON leaves out.
    #[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
    fn is_default(&self) -> bool {
        *self == Self::Filtered
    }
}

impl BudgetSpec {
    /// Resolves [`Scene`](Self::Scene) for a scene file that states `spp` samples per pixel, clamped to `min` and `max`.
    pub(crate) fn of_scene(self, spp: Option<u32>, [min, max]: [u32; 2]) -> Self {
        match self {
            Self::Scene => Self::Spp(spp.map_or(DEFAULT_SPP, f64::from).max(f64::from(min)).min(f64::from(max))),
            given => given,
        }
    }

    /// The budget's key in the JSON of a description: `scene`, `spp`, `samples`, `error` or `seconds`.
    pub const fn field(self) -> &'static str {
        match self {
            Self::Scene => "scene",
            Self::Spp(_) => "spp",
            Self::Samples(_) => "samples",
            Self::Error(_) => "error",
            Self::Seconds(_) => "seconds",
        }
    }
}

impl Default for BudgetSpec {
    fn default() -> Self {
        Self::Spp(DEFAULT_SPP)
    }
}

/// The part of an image to render.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CropSpec {
    /// The crop window in the scene file; the whole image if the file has none.
    #[default]
    Scene,
    /// The whole image, even if the scene file has a crop window.
    Whole,
    /// The rectangle `[x0, y0, x1, y1]` in pixels, with column `x1` and row `y1` excluded.
    Window([u32; 4]),
}

/// The choice of the pixel filter, which weights samples around a pixel's centre.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PixelFilterSpec {
    /// The pixel filter in the scene file.
    #[default]
    Scene,
    /// A box filter that is one pixel wide.
    Box,
}

/// An error in the description of a render.
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub enum SpecError {
    /// Text that is not JSON, a missing or unknown field, or a value of another type.
    #[error("the render's description cannot be read: {0}; correct the description")]
    Json(#[from] serde_json::Error),
    /// A description in another version of the JSON format than [`SPEC_VERSION`].
    #[error(
        "the render's description has version {found}, but this Dapple reads version {SPEC_VERSION}; use the version of \
         Dapple that wrote it, or write a new description"
    )]
    Version {
        /// The format version in the description.
        found: u64,
    },
    /// A value out of range, or a value that contradicts another field.
    #[error("{field}: {what}")]
    Field {
        /// The name of the wrong field of [`RenderSpec`].
        field: &'static str,
        /// The problem with the field's value, and the remedy.
        what: String,
    },
}

impl RenderSpec {
    /// Describes a render of `scene` with the default sampler, point set, filter and integrator, [`DEFAULT_SPP`] samples per pixel
    /// and seed 1.
    pub fn new(scene: impl Into<PathBuf>) -> Self {
        Self {
            version: SPEC_VERSION,
            scene: scene.into(),
            sampler: DEFAULT_SAMPLER.into(),
            points: DEFAULT_POINTS.into(),
            filter: DEFAULT_FILTER.into(),
            integrator: DEFAULT_INTEGRATOR.into(),
            light_selection: None,
            budget: BudgetSpec::default(),
            error_of: ErrorOf::Filtered,
            min_spp: 1,
            max_spp: None,
            resolution: None,
            scale: None,
            crop: CropSpec::Scene,
            seed: 1,
            max_depth: None,
            pixel_filter: PixelFilterSpec::Scene,
            without: Vec::new(),
            allow_unsupported: false,
            part: None,
        }
    }

    /// The defaults of fields that are missing from JSON. The scene is never missing.
    fn unnamed() -> Self {
        Self::new("")
    }

    /// Sets the sampler, `NAME` or `NAME:key=value,…`.
    #[must_use]
    pub fn sampler(self, sampler: impl Into<String>) -> Self {
        Self { sampler: sampler.into(), ..self }
    }

    /// Sets the point set, `NAME` or `NAME:key=value,…`.
    #[must_use]
    pub fn points(self, points: impl Into<String>) -> Self {
        Self { points: points.into(), ..self }
    }

    /// Sets the filter (denoiser), `NAME` or `NAME:key=value,…`; with `none`, each pixel is the mean of its own samples.
    #[must_use]
    pub fn filter(self, filter: impl Into<String>) -> Self {
        Self { filter: filter.into(), ..self }
    }

    /// Sets the integrator, `NAME` or `NAME:key=value,…`.
    #[must_use]
    pub fn integrator(self, integrator: impl Into<String>) -> Self {
        Self { integrator: integrator.into(), ..self }
    }

    /// Sets the condition that ends the render.
    #[must_use]
    pub fn budget(self, budget: BudgetSpec) -> Self {
        Self { budget, ..self }
    }

    /// Sets width and height of the full image in pixels.
    #[must_use]
    pub fn resolution(self, width: u32, height: u32) -> Self {
        Self { resolution: Some([width, height]), ..self }
    }

    /// Sets the seed of all random numbers.
    #[must_use]
    pub fn seed(self, seed: u64) -> Self {
        Self { seed, ..self }
    }

    /// The rule in effect for selecting one of several lights: [`light_selection`](Self::light_selection) if it is set.
    /// The default is [`LightSelection::Learned`] for a whole image and [`LightSelection::Power`] for a part.
    ///
    /// A part cannot use learned selection, because training needs samples of the whole image.
    pub fn selection(&self) -> LightSelection {
        let default = if self.part.is_some() { LightSelection::Power } else { LightSelection::Learned };
        self.light_selection.unwrap_or(default)
    }

    /// Encodes the description as one line of JSON.
    ///
    /// # Errors
    ///
    /// [`SpecError::Json`] for a number that JSON cannot hold (NaN, infinity).
    pub fn to_json(&self) -> Result<String, SpecError> {
        Ok(serde_json::to_string(self)?)
    }

    /// Encodes the description as indented JSON.
    ///
    /// # Errors
    ///
    /// [`SpecError::Json`] for a number that JSON cannot hold (NaN, infinity).
    pub fn to_json_pretty(&self) -> Result<String, SpecError> {
        Ok(serde_json::to_string_pretty(self)?)
    }

    /// Parses a description from JSON.
    ///
    /// # Errors
    ///
    /// [`SpecError::Version`] for another version, before any other error; [`SpecError::Json`] for unknown fields and
    /// wrong types; [`SpecError::Field`] for a value that [`RenderSpec::check`] refuses.
    pub fn from_json(json: &str) -> Result<Self, SpecError> {
        #[derive(Deserialize)]
        struct Version {
            version: u64,
        }
        #[derive(Deserialize)]
        struct Named {
            #[serde(rename = "scene", with = "crate::files::path")]
            _scene: PathBuf,
        }
        let Version { version } = serde_json::from_str(json)?;
        if version != u64::from(SPEC_VERSION) {
            return Err(SpecError::Version { found: version });
        }
        let _: Named = serde_json::from_str(json)?;
        let spec: Self = serde_json::from_str(json)?;
        spec.check()?;
        Ok(spec)
    }

    /// Checks the settings that do not depend on the scene: the ranges of numbers, and the names of sampler, point set,
    /// filter and integrator.
    ///
    /// # Errors
    ///
    /// [`SpecError::Field`] for the first invalid field.
    pub fn check(&self) -> Result<(), SpecError> {
        self.check_budget()?;
        if let Some([w, h]) = self.resolution {
            fine("resolution", dapple_core::Frame::new(w, h))?;
        }
        if let Some(scale) = self.scale {
            refuse(self.resolution.is_some(), "scale", || {
                "a resolution is given as well; set either the scale or the resolution".into()
            })?;
            refuse(!is_above_zero(scale), "scale", || not_above_zero(scale))?;
        }
        fine("sampler", crate::registry::check_sampler(&self.sampler))?;
        fine("points", crate::registry::check_points(&self.points))?;
        fine("filter", crate::registry::check_filter(&self.filter))?;
        fine("integrator", check_integrator(&self.integrator))?;
        let learned = self.part.is_some() && self.selection() == LightSelection::Learned;
        refuse(learned, "light_selection", || {
            "learned light selection needs samples of the whole image and cannot be rendered in parts; use power, or render in stages"
                .into()
        })?;
        let open = self.part.is_some() && matches!(self.budget, BudgetSpec::Error(_) | BudgetSpec::Seconds(_));
        refuse(open, self.budget.field(), || "a part needs a fixed number of samples; set spp".into())
    }

    /// Checks the budget, and the bounds of samples per pixel.
    fn check_budget(&self) -> Result<(), SpecError> {
        let (min, most, field) = (self.min_spp, self.max_spp.unwrap_or(u32::MAX), self.budget.field());
        let above = |what: &dyn std::fmt::Display| {
            format!(
                "{what} is above the maximum number of samples per pixel, {most}; lower this number, or raise the maximum"
            )
        };
        refuse(min > most, "min_spp", || above(&min))?;
        match self.budget {
            BudgetSpec::Spp(x) | BudgetSpec::Error(x) | BudgetSpec::Seconds(x) if !is_above_zero(x) => {
                refuse(true, field, || not_above_zero(x))
            }
            BudgetSpec::Seconds(x) => refuse(x > MOST_SECONDS, field, || {
                format!("{x} is above the maximum of {MOST_SECONDS} seconds (a year); set fewer seconds, or set spp")
            }),
            BudgetSpec::Samples(n) => refuse(n == 0, field, || "0 samples make no image; use at least 1".into()),
            BudgetSpec::Spp(spp) => {
                refuse(spp < f64::from(min), field, || {
                    format!(
                        "{spp} is below the minimum number of samples per pixel, {min}; raise this number, or lower the minimum"
                    )
                })?;
                refuse(spp > f64::from(most), field, || above(&spp))
            }
            BudgetSpec::Scene | BudgetSpec::Error(_) => Ok(()),
        }
    }

    /// Returns `true` if both descriptions need the same world (scene built for tracing), so that one built world
    /// serves both.
    pub(crate) fn has_world_of(&self, other: &Self) -> bool {
        let world = |spec: &Self| Self {
            light_selection: Some(spec.selection()),
            max_depth: spec.max_depth,
            pixel_filter: spec.pixel_filter,
            resolution: spec.resolution,
            scale: spec.scale,
            without: spec.without.clone(),
            allow_unsupported: spec.allow_unsupported,
            ..Self::new(spec.scene.clone())
        };
        world(self) == world(other)
    }
}

/// Returns an error about `field` if its value is `wrong`.
fn refuse(wrong: bool, field: &'static str, what: impl FnOnce() -> String) -> Result<(), SpecError> {
    if wrong { Err(SpecError::Field { field, what: what() }) } else { Ok(()) }
}

/// Converts the error of a check to an error about `field`.
fn fine<T>(field: &'static str, checked: Result<T, impl ToString>) -> Result<(), SpecError> {
    checked.map(drop).map_err(|e| SpecError::Field { field, what: e.to_string() })
}

fn is_above_zero(x: f64) -> bool {
    x.is_finite() && x > 0.0
}

fn not_above_zero(x: f64) -> String {
    format!("{x} is not allowed; use a finite number above zero")
}

/// The serialisation of values that are names in JSON.
mod names {
    /// Serialisation of effects as a list of their names.
    pub(super) mod effects {
        use dapple_scene::Effect;
        use serde::{Deserialize, Deserializer, Serializer, de::Error};

        pub(crate) fn serialize<S: Serializer>(effects: &[Effect], to: S) -> Result<S::Ok, S::Error> {
            to.collect_seq(effects.iter().map(|effect| effect.name()))
        }

        pub(crate) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<Effect>, D::Error> {
            Vec::<String>::deserialize(from)?.iter().map(|name| name.parse().map_err(D::Error::custom)).collect()
        }
    }
}
