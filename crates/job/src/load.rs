//! Reading of scenes, and building of worlds (scenes ready for tracing).

use crate::memory::{MemoryEstimate, MemoryLimit, resident};
use crate::registry::{self, PointSettings};
use crate::{
    BudgetSpec, ContentHash, CropSpec, DEFAULT_INTEGRATOR, DEFAULT_SPP, ERROR_SPP, Job, JobError, PixelFilterSpec,
    RenderSpec, Warning,
};
use dapple_core::{Error, Frame, Limits, PointSet, limits::Budget};
use dapple_renderer::{IntegratorError, World};
use dapple_scene::bundled::{self, Bundle};
use dapple_scene::files::{Disk, Files};
use dapple_scene::model::ModelOptions;
use dapple_scene::pbrt::ReadOptions;
use dapple_scene::{AnyOptions, CalledEffect, Effect, Effects, Geometry, PixelFilter, Scene, Shape, read_any_from};
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// Options for reading a scene.
#[derive(Clone, Copy, Debug)]
pub struct LoadOptions {
    /// The memory limit of the render; scene files larger than this are not read.
    pub limit: MemoryLimit,
    /// If `true`, hashes every byte read. Checkpoints and parts need the hash.
    pub digest: bool,
}

impl Default for LoadOptions {
    /// Options without a memory limit and with a digest.
    fn default() -> Self {
        Self { limit: MemoryLimit::none(), digest: true }
    }
}

/// A scene as read, with the description of the render.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct LoadedScene {
    /// The description of the render.
    pub spec: RenderSpec,
    /// The scene, changed as the description requires: depth limit, pixel filter and left-out effects.
    pub scene: Arc<Scene>,
    /// A hash of all bytes read for the scene; `None` if no hash was requested.
    pub digest: Option<ContentHash>,
    /// The image's resolution, and the window of the image to render.
    pub frame: Frame,
    /// The effects (kinds of light transport) that are left out of the image.
    pub without: Vec<Effect>,
    /// Warnings about adjusted or ignored directives of the scene file, area lights without area, left-out effects, and lights
    /// that a path tracer finds only by chance. [`build`](Self::build) adds a warning about triangles without area.
    pub warnings: Vec<Warning>,
    /// An estimated lower bound on the peak memory of the render.
    pub memory: MemoryEstimate,
    /// Wall-clock seconds spent on reading the scene.
    pub seconds: f64,
    /// The files that were read for the scene, each once: scene, meshes, textures. Empty for a bundled scene.
    pub files: Vec<PathBuf>,
}

/// A scene with the world built from it, ready for tracing. Clones are cheap and share the world.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct PreparedScene {
    /// The scene from which the world was built.
    pub loaded: LoadedScene,
    /// The world: the scene prepared for ray tracing.
    pub world: Arc<World>,
    /// Wall-clock seconds spent on building the world.
    pub build_seconds: f64,
}

impl LoadedScene {
    /// Reads the scene named in a description.
    ///
    /// # Errors
    ///
    /// [`JobError`] if the scene cannot be read, or the description is invalid or leaves out an effect that the scene does not
    /// use.
    pub fn read(spec: &RenderSpec, options: &LoadOptions) -> Result<Self, JobError> {
        spec.check()?;
        let clock = Instant::now();
        let (scene, digest, files) = read(spec, options)?;
        let loaded = Self::from_scene(spec, scene)?;
        Ok(Self { files, digest, seconds: clock.elapsed().as_secs_f64(), ..loaded })
    }

    /// Uses `scene` instead of reading the scene named in the description. The result has no digest, so the render can
    /// write no checkpoints or parts.
    ///
    /// # Errors
    ///
    /// [`JobError`] if the description is invalid, or leaves out an effect that the scene does not use.
    pub fn from_scene(spec: &RenderSpec, mut scene: Scene) -> Result<Self, JobError> {
        spec.check()?;
        let bounds = [spec.min_spp, spec.max_spp.unwrap_or(u32::MAX)];
        let spec = &RenderSpec { budget: spec.budget.of_scene(scene.film.spp, bounds), ..spec.clone() };
        scene.max_depth = spec.max_depth.or(scene.max_depth);
        if spec.pixel_filter == PixelFilterSpec::Box {
            scene.film.pixel_filter = PixelFilter::default();
        }
        let without = called_for(&spec.without, &scene)?;
        let frame = frame(spec, &scene)?;
        check_capacity(spec, frame)?;
        if let Some(part) = spec.part.filter(|part| part.of() > frame.size()[1]) {
            let rows = frame.size()[1];
            let why = format!("the rendered window has {rows} rows; use at most {rows} parts");
            return Err(JobError::NoParts { part, why });
        }
        let memory = MemoryEstimate::of_scene(&scene, &frame);
        let mut warnings = notices(spec, &scene);
        let called = Effects::of(&scene);
        for &effect in &without {
            scene = dapple_renderer::without(&scene, effect).map_err(|source| JobError::Without { effect, source })?;
            let by = called.called().iter().find(|called| called.effect == effect).cloned();
            warnings.push(Warning::LeftOut { effect, by });
        }
        let (name, because) = chosen_integrator(spec, &scene);
        warnings.extend(match because {
            Some(called) => Some(Warning::Photons(called)),
            None if finds_caustics(&name) => None,
            None => Effects::found_by_chance(&scene).map(Warning::FoundByChance),
        });
        Ok(Self {
            spec: spec.clone(),
            scene: Arc::new(scene),
            digest: None,
            frame,
            without,
            warnings,
            memory,
            seconds: 0.0,
            files: Vec::new(),
        })
    }

    /// Builds the world (the scene prepared for ray tracing).
    ///
    /// # Errors
    ///
    /// [`JobError::World`] with every problem of the scene.
    pub fn build(mut self) -> Result<PreparedScene, JobError> {
        let clock = Instant::now();
        let mut world = World::with_resolution(&self.scene, self.frame.resolution())?;
        world.set_light_selection(self.spec.selection());
        if world.dropped_triangles() > 0 {
            self.warnings.push(Warning::DroppedTriangles(world.dropped_triangles()));
        }
        Ok(PreparedScene { loaded: self, world: Arc::new(world), build_seconds: clock.elapsed().as_secs_f64() })
    }
}

impl PreparedScene {
    /// Prepares a job (one render) on this world. `spec` may differ from the description of this world in sampler, point set,
    /// filter, integrator, budget, crop and seed.
    ///
    /// # Errors
    ///
    /// [`JobError::OtherWorld`] if the description needs another world; otherwise the errors of [`Job::prepare`].
    pub fn job(&self, spec: &RenderSpec) -> Result<Job, JobError> {
        Job::on(spec, self.clone())
    }
}

/// The warnings about directives of the scene file.
fn notices(spec: &RenderSpec, scene: &Scene) -> Vec<Warning> {
    let mut warnings = Vec::new();
    // Notices of bundled scenes are about directives for other renderers, which do not concern the user.
    if bundle(&spec.scene).is_none() {
        warnings.extend(scene.notices.iter().cloned().map(Warning::Notice));
    }
    let dark = scene.shapes.iter().filter(|shape| is_dark_lamp(shape));
    warnings.extend(dark.map(|shape| Warning::LampWithoutArea(shape.source.clone())));
    warnings
}

/// Returns `true` for an emissive mesh whose triangles all have zero area.
fn is_dark_lamp(shape: &Shape) -> bool {
    let (Some(_), Geometry::Mesh(mesh)) = (&shape.emission, &shape.geometry) else { return false };
    mesh.triangles.iter().all(|triangle| {
        let [a, b, c] = triangle.map(|corner| shape.to_world.transform_point3(mesh.positions[corner as usize]));
        (b - a).cross(c - a).length_squared() == 0.0
    })
}

/// The bundled scene called `name`; `None` if there is none, or if a file has this name.
fn bundle(name: &Path) -> Option<Bundle> {
    if name.is_file() { None } else { name.to_str().and_then(bundled::files) }
}

/// Reads the scene of a description from a file or from the bundled scenes. Returns the scene, its digest if the options
/// request one, and the files that were read.
fn read(spec: &RenderSpec, options: &LoadOptions) -> Result<(Scene, Option<ContentHash>, Vec<PathBuf>), JobError> {
    let path = &*Disk::locate(&spec.scene);
    let mut digest = ContentHash::new();
    if let Some(bundle) = bundle(&spec.scene) {
        for (name, bytes) in bundle.files.iter().filter(|_| options.digest) {
            digest.text(name);
            digest.add(bytes);
        }
        return Ok((bundle.read()?, options.digest.then_some(digest), Vec::new()));
    }
    if !path.exists() {
        return Err(JobError::NoScene { name: spec.scene.display().to_string() });
    }
    let memory = options.limit.bytes().map(|limit| limit.saturating_sub(resident().map_or(0, |[now, _]| now)));
    let read_options = ReadOptions { allow_unsupported: spec.allow_unsupported, memory };
    let files = Recorder { options: *options, read: RefCell::default() };
    // The camera of a model file depends on the aspect ratio, so that the model fills the image.
    let aspect = spec.resolution.map(|[width, height]| f64::from(width) / f64::from(height.max(1)));
    let model = ModelOptions { aspect, ..ModelOptions::default() };
    let scene = read_any_from(&files, path, &AnyOptions { scene: read_options, model })?;
    let read = files.read.into_inner();
    // Paths are hashed relative to the scene's folder, so that a moved scene has the same digest.
    let folder = path.parent().unwrap_or(Path::new(""));
    for (file, of_bytes) in &read {
        digest.text(&file.strip_prefix(folder).unwrap_or(file).to_string_lossy());
        digest.text(of_bytes);
    }
    Ok((scene, options.digest.then_some(digest), read.into_keys().collect()))
}

/// A file reader that limits the size of each file, lists the files, and hashes their bytes if the digest is requested.
struct Recorder {
    options: LoadOptions,
    read: RefCell<BTreeMap<PathBuf, String>>,
}

impl Files for Recorder {
    fn read(&self, path: &Path) -> std::io::Result<Vec<u8>> {
        let path = &*Disk::locate(path);
        if let Some(most) = self.options.limit.bytes() {
            let length = std::fs::metadata(path)?.len();
            if length > most {
                let (length, most) = (crate::memory::size(length), crate::memory::size(most));
                let what = format!("the file has {length}, but the memory limit is {most}");
                return Err(std::io::Error::new(std::io::ErrorKind::OutOfMemory, what));
            }
        }
        let bytes = Disk.read(path)?;
        let digest = if self.options.digest { ContentHash::of(&bytes).hex() } else { String::new() };
        self.read.borrow_mut().insert(path.to_owned(), digest);
        Ok(bytes)
    }
}

/// Checks the effects to leave out. Returns them without repetitions, in the order of their removal from the scene.
fn called_for(asked: &[Effect], scene: &Scene) -> Result<Vec<Effect>, JobError> {
    let effects = Effects::of(scene);
    let mut without = asked.to_vec();
    // `SeveralLights` comes last, so that the strongest of the lights that other removals leave is kept.
    without.sort_by_key(|&effect| (effect == Effect::SeveralLights, effect));
    without.dedup();
    if let Some(&effect) = without.iter().find(|&&effect| !effects.has(effect)) {
        let called = effects.called().iter().map(|called| called.effect).collect();
        return Err(JobError::NotCalledFor { effect, called });
    }
    Ok(without)
}

pub(crate) fn frame(spec: &RenderSpec, scene: &Scene) -> Result<Frame, JobError> {
    let full = scene.film.resolution;
    // A side is at least one pixel; beyond 32 bits, it saturates and the frame is refused.
    let scaled = |side: u32| spec.scale.map_or(side, |scale| (f64::from(side) * scale).round().max(1.0) as u32);
    let [w, h] = spec.resolution.unwrap_or(full.map(scaled));
    let frame = Frame::new(w, h)?;
    // At another resolution, the file's window covers the same part of the image, as in pbrt.
    let part = |at: u32, from: u32, to: u32| (u64::from(at) * u64::from(to)).div_ceil(u64::from(from.max(1))) as u32;
    let scaled = |corners: [u32; 4]| std::array::from_fn(|i| part(corners[i], full[i % 2], [w, h][i % 2]));
    let window = match spec.crop {
        CropSpec::Window(window) => Some(window),
        CropSpec::Scene => scene.film.crop.map(scaled),
        CropSpec::Whole => None,
    };
    Ok(window.map_or(Ok(frame), |[x0, y0, x1, y1]| frame.crop(x0, y0, x1, y1))?)
}

/// The settings of a point set: the seed, and the mean samples per pixel (`None` for budgets of error or time).
pub(crate) fn setting(spec: &RenderSpec, frame: Frame) -> PointSettings {
    let spp = match spec.budget {
        BudgetSpec::Scene => Some(DEFAULT_SPP as u64),
        BudgetSpec::Spp(spp) => Some(spp.ceil() as u64),
        BudgetSpec::Samples(samples) => Some(samples.div_ceil(frame.pixels() as u64)),
        BudgetSpec::Error(_) | BudgetSpec::Seconds(_) => None,
    };
    PointSettings { seed: spec.seed, spp }
}

/// The budget of a description and its bounds on samples per pixel.
pub(crate) fn limits(spec: &RenderSpec, frame: Frame) -> Limits {
    let at_most = frame.pixels() as u64 * u64::from(spec.max_spp.unwrap_or(ERROR_SPP));
    let per_pixel = |spp| Budget::Samples(Budget::PerPixel(spp).samples(&frame).unwrap_or(1));
    let budget = match spec.budget {
        BudgetSpec::Scene => per_pixel(DEFAULT_SPP),
        // At least one sample in total; a mean below the minimum of samples per pixel is an error elsewhere.
        BudgetSpec::Spp(spp) => per_pixel(spp),
        BudgetSpec::Samples(samples) => Budget::Samples(samples),
        BudgetSpec::Error(relmse) => Budget::Error { relmse, at_most },
        BudgetSpec::Seconds(seconds) => Budget::Seconds(seconds),
    };
    let mut limits = Limits::new(budget);
    limits.min_spp = spec.min_spp;
    limits.max_spp = spec.max_spp.unwrap_or(u32::MAX);
    limits
}

/// Returns an error if the point set has fewer points per pixel than the budget requires.
fn check_capacity(spec: &RenderSpec, frame: Frame) -> Result<(), JobError> {
    let setting = setting(spec, frame);
    let points = registry::points(&spec.points, setting)?;
    let (capacity, requested) = (points.capacity(), setting.spp.unwrap_or(0));
    if requested > capacity {
        return Err(Error::SequenceExhausted { points: points.describe(), capacity, requested }.into());
    }
    Ok(())
}

/// Checks the description of an integrator: `auto`, or a known name with known parameters.
///
/// # Errors
///
/// [`IntegratorError`] if the integrator or a parameter is unknown.
pub fn check_integrator(request: &str) -> Result<(), IntegratorError> {
    if request == DEFAULT_INTEGRATOR { Ok(()) } else { dapple_transport::check_integrator(request) }
}

/// The integrator of a render, `NAME` or `NAME:key=value,…`. Also returns the caustics for which the default selects photons,
/// if it does.
///
/// The default selects `photons` for a scene with [caustics that paths find by chance only](Effects::found_by_chance), else
/// `path`. With motion blur, or in parts, it is always `path`: photons have no time, and each part would trace the photons of the
/// whole image.
pub(crate) fn chosen_integrator(spec: &RenderSpec, scene: &Scene) -> (String, Option<CalledEffect>) {
    if spec.integrator != DEFAULT_INTEGRATOR {
        return (spec.integrator.clone(), None);
    }
    let excluded = spec.part.is_some() || Effects::of(scene).has(Effect::MotionBlur);
    match Effects::found_by_chance(scene) {
        Some(called) if !excluded => ("photons".to_owned(), Some(called)),
        _ => ("path".to_owned(), None),
    }
}

/// Returns `true` if an integrator renders caustics from small light sources. Photon mapping does, and so do methods that
/// connect light paths to the camera.
fn finds_caustics(integrator: &str) -> bool {
    let name = integrator.split(':').next().unwrap_or_default().trim();
    matches!(name, "photons" | "metropolis") || name == "bdpt" && !integrator.contains("splat=0")
}

#[cfg(test)]
mod tests {
    use super::{bundle, chosen_integrator};
    use crate::RenderSpec;

    fn chosen(spec: &RenderSpec) -> String {
        let scene = bundle(&spec.scene).expect("a bundled scene").read().expect("a scene");
        let (name, because) = chosen_integrator(spec, &scene);
        assert_eq!(because.is_some(), name == "photons" && spec.integrator == "auto");
        name
    }

    #[test]
    fn the_default_takes_photons_where_the_scene_calls_for_them() {
        assert_eq!(chosen(&RenderSpec::new("caustic")), "photons");
        for scene in ["cornell", "glass", "tea", "teapot", "many-lights", "motion"] {
            assert_eq!(chosen(&RenderSpec::new(scene)), "path", "{scene}");
        }
        assert_eq!(chosen(&RenderSpec::new("caustic").integrator("path")), "path");
        assert_eq!(chosen(&RenderSpec::new("cornell").integrator("photons:what=all")), "photons:what=all");
        let part = "1/2".parse().expect("a part");
        assert_eq!(chosen(&RenderSpec { part: Some(part), ..RenderSpec::new("caustic") }), "path");
    }
}
