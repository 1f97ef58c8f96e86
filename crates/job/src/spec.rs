//! The description of a render.

mod names;
mod shard;

pub use shard::Shard;

use crate::check_integrator;
use dapple_renderer::light::LightSelection;
use dapple_scene::Effect;
use serde::{Deserialize, Serialize};

/// The version of the JSON format that [`RenderSpec::to_json`] writes.
pub const SPEC_VERSION: u32 = 1;
/// The default budget of a render, in mean samples per pixel.
pub const DEFAULT_SPP: f64 = 64.0;
/// The largest number of samples per pixel if the budget is [`BudgetSpec::Error`] and `max_spp` is not set.
pub const ERROR_SPP: u32 = 16384;
/// The longest time limit of a render in seconds: a year.
pub const MOST_SECONDS: f64 = 31_557_600.0;
/// The name of the default integrator: `photons` for scenes whose caustics a path tracer finds by chance only, else `path`.
pub const DEFAULT_INTEGRATOR: &str = "auto";

/// A description of a render: all settings that decide the pixels of an image.
///
/// Shards and checkpoints store the description as JSON, and `dapple render --spec FILE` reads it. Paths are text.
/// Fields that are missing from the JSON have the values of [`RenderSpec::new`]; unknown fields are refused.
///
/// ```
/// use dapple_job::{BudgetSpec, RenderSpec};
///
/// let spec = RenderSpec::new("teapot").sampler("uniform").budget(BudgetSpec::Spp(16.0)).seed(7);
/// assert_eq!(RenderSpec::from_json(&spec.to_json()?)?, spec);
/// # Ok::<(), dapple_job::SpecError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct RenderSpec {
    /// The version of the JSON format: [`SPEC_VERSION`].
    pub version: u32,
    /// The scene: the path of a scene or model file, or the name of a bundled scene.
    pub scene: String,
    /// The sampler (how many samples each pixel gets), `NAME` or `NAME:key=value,…`.
    #[serde(default = "names::sampler")]
    pub sampler: String,
    /// The point set (where samples lie), `NAME` or `NAME:key=value,…`.
    #[serde(default = "names::points")]
    pub points: String,
    /// The filter (denoiser), `NAME` or `NAME:key=value,…`; `none` leaves each pixel the mean of its samples.
    #[serde(default = "names::filter")]
    pub filter: String,
    /// The integrator, `NAME` or `NAME:key=value,…`. `auto` takes `photons` if the scene calls for it, else `path`.
    #[serde(default = "names::integrator")]
    pub integrator: String,
    /// The rule by which light sampling selects one of several lights. `None` stands for the default that
    /// [`RenderSpec::selection`] returns.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub light_selection: Option<LightSelection>,
    /// The condition that ends the render.
    #[serde(default)]
    pub budget: BudgetSpec,
    /// The image that a [`BudgetSpec::Error`] concerns.
    #[serde(default, skip_serializing_if = "ErrorOf::is_default")]
    pub error_of: ErrorOf,
    /// The smallest number of samples that each pixel gets.
    #[serde(default = "names::one")]
    pub min_spp: u32,
    /// Largest number of samples per pixel. `None` sets no bound, or [`ERROR_SPP`] if the budget is
    /// [`BudgetSpec::Error`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_spp: Option<u32>,
    /// Width and height of the full image in pixels; `None` takes the resolution in the scene.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub resolution: Option<[u32; 2]>,
    /// A factor of the width and height in the scene, instead of `resolution`: 0.5 renders a quarter of the pixels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scale: Option<f64>,
    /// The part of the image to render.
    #[serde(default)]
    pub crop: CropSpec,
    /// Seed of all random numbers.
    #[serde(default = "names::seed")]
    pub seed: u64,
    /// The largest number of scattering events between camera and light; `None` takes the limit in the scene.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_depth: Option<u32>,
    /// The pixel filter: the scene's, or a box one pixel wide.
    #[serde(default)]
    pub pixel_filter: PixelFilterSpec,
    /// Effects (kinds of light transport) that are left out of the scene.
    #[serde(default, with = "names::effects", skip_serializing_if = "Vec::is_empty")]
    pub without: Vec<Effect>,
    /// If `true`, unsupported directives of a scene are warnings instead of errors.
    #[serde(default)]
    pub allow_unsupported: bool,
    /// The shard (a run of rows of the image) to render; `None` renders the whole image.
    #[serde(default, with = "names::shard", skip_serializing_if = "Option::is_none")]
    pub shard: Option<Shard>,
}

/// The condition that ends a render.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum BudgetSpec {
    /// The render takes the scene file's number of samples per pixel, within the bounds of the description;
    /// [`DEFAULT_SPP`] if the file states none. The loaded scene's description has the number.
    Scene,
    /// The render takes exactly this mean number of samples per pixel.
    Spp(f64),
    /// The render takes exactly this number of samples in total.
    Samples(u64),
    /// The render ends when the predicted relMSE of the image is at most this value; [`RenderSpec::error_of`] selects
    /// the filtered or the unfiltered image.
    Error(f64),
    /// The render takes about this many seconds for clustering, planning, tracing and filtering together, at most
    /// [`MOST_SECONDS`]. Each pixel gets its least number of samples, however long that takes.
    Seconds(f64),
}

/// The image that a limit of error concerns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ErrorOf {
    /// The filtered image. A filter without an estimate of its own error, such as `oidn`, leaves the limit with the
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
    /// The budget of a render of a scene whose file states `spp` samples per pixel.
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
    #[error("the render's description cannot be read: {0}")]
    Json(#[from] serde_json::Error),
    /// A description in another version of the JSON format than [`SPEC_VERSION`].
    #[error(
        "the render's description has version {found}, and this Dapple reads version {SPEC_VERSION}; use the version of \
         Dapple that wrote it, or describe the render again"
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
    /// Describes a render of `scene` with the default sampler, point set, filter and integrator, 64 samples per pixel
    /// and seed 1.
    pub fn new(scene: impl Into<String>) -> Self {
        Self {
            version: SPEC_VERSION,
            scene: scene.into(),
            sampler: names::sampler(),
            points: names::points(),
            filter: names::filter(),
            integrator: names::integrator(),
            light_selection: None,
            budget: BudgetSpec::default(),
            error_of: ErrorOf::Filtered,
            min_spp: 1,
            max_spp: None,
            resolution: None,
            scale: None,
            crop: CropSpec::Scene,
            seed: names::seed(),
            max_depth: None,
            pixel_filter: PixelFilterSpec::Scene,
            without: Vec::new(),
            allow_unsupported: false,
            shard: None,
        }
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

    /// Sets the filter (denoiser), `NAME` or `NAME:key=value,…`; `none` leaves each pixel the mean of its samples.
    #[must_use]
    pub fn filter(self, filter: impl Into<String>) -> Self {
        Self { filter: filter.into(), ..self }
    }

    /// Sets the integrator, `NAME` or `NAME:key=value,…`.
    #[must_use]
    pub fn integrator(self, integrator: impl Into<String>) -> Self {
        Self { integrator: integrator.into(), ..self }
    }

    /// Sets the rule by which light sampling selects one of several lights.
    #[must_use]
    pub fn light_selection(self, selection: LightSelection) -> Self {
        Self { light_selection: Some(selection), ..self }
    }

    /// Sets the condition that ends the render.
    #[must_use]
    pub fn budget(self, budget: BudgetSpec) -> Self {
        Self { budget, ..self }
    }

    /// Sets the image that a limit of error concerns: filtered or unfiltered.
    #[must_use]
    pub fn error_of(self, error_of: ErrorOf) -> Self {
        Self { error_of, ..self }
    }

    /// Sets the smallest and the largest number of samples per pixel; `None` sets no largest number.
    #[must_use]
    pub fn bounds(self, min_spp: u32, max_spp: Option<u32>) -> Self {
        Self { min_spp, max_spp, ..self }
    }

    /// Sets width and height of the full image in pixels.
    #[must_use]
    pub fn resolution(self, width: u32, height: u32) -> Self {
        Self { resolution: Some([width, height]), ..self }
    }

    /// Sets width and height of the full image to those in the scene times a factor.
    #[must_use]
    pub fn scale(self, scale: f64) -> Self {
        Self { scale: Some(scale), ..self }
    }

    /// Sets the part of the image to render.
    #[must_use]
    pub fn crop(self, crop: CropSpec) -> Self {
        Self { crop, ..self }
    }

    /// Sets the seed of all random numbers.
    #[must_use]
    pub fn seed(self, seed: u64) -> Self {
        Self { seed, ..self }
    }

    /// Sets the largest number of scattering events between camera and light; `None` takes the limit in the scene.
    #[must_use]
    pub fn max_depth(self, max_depth: Option<u32>) -> Self {
        Self { max_depth, ..self }
    }

    /// Sets the pixel filter: the scene's, or a box one pixel wide.
    #[must_use]
    pub fn pixel_filter(self, pixel_filter: PixelFilterSpec) -> Self {
        Self { pixel_filter, ..self }
    }

    /// Sets the effects (kinds of light transport) that are left out of the scene.
    #[must_use]
    pub fn without(self, without: impl IntoIterator<Item = Effect>) -> Self {
        Self { without: without.into_iter().collect(), ..self }
    }

    /// Makes unsupported directives of the scene file warnings (`true`) or errors (`false`).
    #[must_use]
    pub fn allow_unsupported(self, allow: bool) -> Self {
        Self { allow_unsupported: allow, ..self }
    }

    /// Sets the shard (a run of rows) to render; `None` renders the whole image.
    #[must_use]
    pub fn shard(self, shard: Option<Shard>) -> Self {
        Self { shard, ..self }
    }

    /// The rule in effect for selecting one of several lights: [`light_selection`](Self::light_selection) if it is set.
    /// The default is [`LightSelection::Learned`] for a whole image and [`LightSelection::Power`] for a shard.
    ///
    /// A shard cannot use learned selection, because training needs samples of the whole image.
    pub fn selection(&self) -> LightSelection {
        let default = if self.shard.is_some() { LightSelection::Power } else { LightSelection::Learned };
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
        let Version { version } = serde_json::from_str(json)?;
        if version != u64::from(SPEC_VERSION) {
            return Err(SpecError::Version { found: version });
        }
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
        let wrong = |field, what| Err(SpecError::Field { field, what });
        let (min, most) = (self.min_spp, self.max_spp.unwrap_or(u32::MAX));
        if min > most {
            return wrong(
                "min_spp",
                format!(
                    "{min} is above the largest number of samples per pixel, {most}; lower one, or raise the other"
                ),
            );
        }
        let field = self.budget.field();
        match self.budget {
            BudgetSpec::Spp(x) | BudgetSpec::Error(x) | BudgetSpec::Seconds(x) if !(x.is_finite() && x > 0.0) => {
                return wrong(field, format!("{x} is not a finite number above zero"));
            }
            BudgetSpec::Seconds(x) if x > MOST_SECONDS => {
                return wrong(
                    field,
                    format!("{x} is above {MOST_SECONDS} (a year); give spp for a render without end"),
                );
            }
            BudgetSpec::Samples(0) => return wrong(field, "0 samples make no image; give at least 1".into()),
            BudgetSpec::Spp(spp) if spp < f64::from(min) => {
                return wrong(
                    field,
                    format!(
                        "{spp} is below the smallest number of samples per pixel, {min}; raise one, or lower the other"
                    ),
                );
            }
            BudgetSpec::Spp(spp) if spp > f64::from(most) => {
                return wrong(
                    field,
                    format!(
                        "{spp} is above the largest number of samples per pixel, {most}; lower one, or raise the other"
                    ),
                );
            }
            _ => {}
        }
        if let Some([w, h]) = self.resolution
            && let Err(e) = dapple_core::Frame::new(w, h)
        {
            return wrong("resolution", e.to_string());
        }
        match self.scale {
            Some(_) if self.resolution.is_some() => {
                return wrong("scale", "a resolution is given too; give one of the two".into());
            }
            Some(scale) if !(scale.is_finite() && scale > 0.0) => {
                return wrong("scale", format!("{scale} is not a finite number above zero"));
            }
            _ => {}
        }
        let named = [
            ("sampler", crate::registry::check_sampler(&self.sampler)),
            ("points", crate::registry::check_points(&self.points)),
            ("filter", crate::registry::check_filter(&self.filter)),
        ];
        for (field, checked) in named {
            if let Err(e) = checked {
                return wrong(field, e.to_string());
            }
        }
        if let Err(e) = check_integrator(&self.integrator) {
            return wrong("integrator", e.to_string());
        }
        if self.shard.is_some() && self.selection() == LightSelection::Learned {
            let what = "learned light selection needs samples of the whole image, and cannot be sharded; use power, or render \
                        in stages";
            return wrong("light_selection", what.into());
        }
        if self.shard.is_some() && matches!(self.budget, BudgetSpec::Error(_) | BudgetSpec::Seconds(_)) {
            return wrong(field, "a shard needs a number of samples; give spp".into());
        }
        Ok(())
    }

    /// The mean samples per pixel of a [`BudgetSpec::Spp`]; `None` for other budgets.
    pub fn mean_spp(&self) -> Option<f64> {
        match self.budget {
            BudgetSpec::Spp(spp) => Some(spp),
            _ => None,
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
