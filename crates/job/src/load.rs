//! Reading of scenes, and building of worlds (scenes ready for tracing).

use crate::chosen;
use crate::memory::{MemoryEstimate, MemoryLimit, resident};
use crate::registry::{self, Setting};
use crate::{
    BudgetSpec, ContentHash, CropSpec, DEFAULT_SPP, ERROR_SPP, Job, JobError, PixelFilterSpec, RenderSpec, Warning,
};
use dapple_core::{Budget, Error, Frame, Limits, PointSet};
use dapple_renderer::World;
use dapple_scene::bundled::{self, Bundle};
use dapple_scene::files::{Disk, Files};
use dapple_scene::model::ModelOptions;
use dapple_scene::pbrt::ReadOptions;
use dapple_scene::{AnyOptions, Effect, Effects, Geometry, PixelFilter, Scene, Shape, read_any_from};
use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// Options for reading a scene.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct LoadOptions {
    /// The largest memory of the render; scene files longer than this are not read.
    pub limit: MemoryLimit,
    /// If `true`, hashes every byte read. Checkpoints and shards need this digest.
    pub digest: bool,
    /// Width over height of the image, which a bare model should fill; `None` is 4:3.
    pub aspect: Option<f64>,
}

impl Default for LoadOptions {
    /// Options without a memory limit and with a digest.
    fn default() -> Self {
        Self { limit: MemoryLimit::none(), digest: true, aspect: None }
    }
}

impl LoadOptions {
    /// Sets the memory limit of the render.
    #[must_use]
    pub fn with_limit(self, limit: MemoryLimit) -> Self {
        Self { limit, ..self }
    }

    /// Reads without a digest, so that the render has no checkpoints or shards.
    #[must_use]
    pub fn without_digest(self) -> Self {
        Self { digest: false, ..self }
    }
}

/// A scene that was read, with the description of its render.
#[derive(Clone, Debug)]
pub struct LoadedScene {
    spec: RenderSpec,
    scene: Arc<Scene>,
    digest: Option<ContentHash>,
    frame: Frame,
    without: Vec<Effect>,
    warnings: Vec<Warning>,
    expected: MemoryEstimate,
    load_seconds: f64,
    files: Vec<PathBuf>,
}

/// A scene with the world built from it, ready for tracing. Clones are cheap and share the world.
#[derive(Clone, Debug)]
pub struct PreparedScene {
    pub(crate) spec: RenderSpec,
    pub(crate) scene: Arc<Scene>,
    pub(crate) world: Arc<World>,
    pub(crate) digest: Option<ContentHash>,
    pub(crate) without: Vec<Effect>,
    pub(crate) warnings: Vec<Warning>,
    pub(crate) expected: MemoryEstimate,
    pub(crate) load_seconds: f64,
    pub(crate) build_seconds: f64,
}

impl LoadedScene {
    /// Reads the scene named in a description.
    ///
    /// # Errors
    ///
    /// [`JobError`] if the description is invalid, the scene cannot be read, or an effect is left out that the scene
    /// does not use.
    pub fn read(spec: &RenderSpec, options: &LoadOptions) -> Result<Self, JobError> {
        spec.check()?;
        let clock = Instant::now();
        let aspect = spec.resolution.map(|[width, height]| f64::from(width) / f64::from(height.max(1)));
        let options = LoadOptions { aspect: aspect.or(options.aspect), ..*options };
        let (scene, digest, files) = read_with_files(&spec.scene, spec.allow_unsupported, &options)?;
        let mut loaded = Self::from_scene(spec, scene)?;
        loaded.files = files;
        loaded.digest = digest;
        loaded.load_seconds = clock.elapsed().as_secs_f64();
        Ok(loaded)
    }

    /// Uses `scene` instead of reading the scene named in the description. The result has no digest, so the render can
    /// write no checkpoints or shards.
    ///
    /// # Errors
    ///
    /// [`JobError`] if the description is invalid, or leaves out an effect that the scene does not use.
    pub fn from_scene(spec: &RenderSpec, mut scene: Scene) -> Result<Self, JobError> {
        spec.check()?;
        let bounds = [spec.min_spp, spec.max_spp.unwrap_or(u32::MAX)];
        let spec = &RenderSpec { budget: spec.budget.of_scene(scene.film.spp, bounds), ..spec.clone() };
        if let Some(depth) = spec.max_depth {
            scene.max_depth = Some(depth);
        }
        if spec.pixel_filter == PixelFilterSpec::Box {
            scene.film.pixel_filter = PixelFilter::default();
        }
        let without = called_for(&spec.without, &scene)?;
        let frame = frame(spec, &scene)?;
        check_capacity(spec, frame)?;
        if let Some(shard) = spec.shard.filter(|shard| shard.of() > frame.size()[1]) {
            let rows = frame.size()[1];
            let why = format!("a window of {rows} rows has {rows} shards at most");
            return Err(JobError::NoShard { shard, why });
        }
        let expected = MemoryEstimate::of_scene(&scene, &frame);
        let mut warnings = notices(spec, &scene);
        let called = Effects::of(&scene);
        for &effect in &without {
            scene = dapple_renderer::without(&scene, effect).map_err(|source| JobError::Without { effect, source })?;
            let by = called.called().iter().find(|called| called.effect == effect).cloned();
            warnings.push(Warning::LeftOut { effect, by });
        }
        let (name, because) = chosen::integrator(spec, &scene);
        warnings.extend(match because {
            Some(called) => Some(Warning::Photons(called)),
            None if chosen::finds_caustics(&name) => None,
            None => Effects::found_by_chance(&scene).map(Warning::FoundByChance),
        });
        Ok(Self {
            spec: spec.clone(),
            scene: Arc::new(scene),
            digest: None,
            frame,
            without,
            warnings,
            expected,
            load_seconds: 0.0,
            files: Vec::new(),
        })
    }

    /// The scene, changed as the description requires: depth limit, pixel filter and left-out effects.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// The files that were read for the scene, each once: scene, meshes, textures. Empty for a bundled scene.
    pub fn files(&self) -> &[PathBuf] {
        &self.files
    }

    /// The image's resolution, and the window of it that is rendered.
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// The description of the render.
    pub fn spec(&self) -> &RenderSpec {
        &self.spec
    }

    /// The warnings so far: adjusted or ignored directives of the scene file, another suggested number of samples,
    /// effects that are left out, and lights found by chance only.
    pub fn warnings(&self) -> &[Warning] {
        &self.warnings
    }

    /// An estimate of the least memory of the render.
    pub fn memory(&self) -> &MemoryEstimate {
        &self.expected
    }

    /// Builds the world: the scene in the form in which rays are traced.
    ///
    /// # Errors
    ///
    /// [`JobError::World`] with every problem of the scene.
    pub fn build(self) -> Result<PreparedScene, JobError> {
        let clock = Instant::now();
        let mut world = World::with_resolution(&self.scene, self.frame.resolution())?;
        world.set_light_selection(self.spec.selection());
        let mut warnings = self.warnings;
        if world.dropped_triangles() > 0 {
            warnings.push(Warning::DroppedTriangles(world.dropped_triangles()));
        }
        Ok(PreparedScene {
            spec: self.spec,
            scene: self.scene,
            world: Arc::new(world),
            digest: self.digest,
            without: self.without,
            warnings,
            expected: self.expected,
            load_seconds: self.load_seconds,
            build_seconds: clock.elapsed().as_secs_f64(),
        })
    }
}

impl PreparedScene {
    /// The scene description from which the world was built.
    pub fn scene(&self) -> &Arc<Scene> {
        &self.scene
    }

    /// The world: the scene in the form in which rays are traced.
    pub fn world(&self) -> &Arc<World> {
        &self.world
    }

    /// The digest: a hash of all bytes read for the scene. `None` if the scene was read without a digest.
    pub fn digest(&self) -> Option<&ContentHash> {
        self.digest.as_ref()
    }

    /// Wall seconds of reading the scene.
    pub fn load_seconds(&self) -> f64 {
        self.load_seconds
    }

    /// Wall seconds of building the world.
    pub fn build_seconds(&self) -> f64 {
        self.build_seconds
    }

    /// The effects (kinds of light transport) that are left out of the image.
    pub fn without(&self) -> &[Effect] {
        &self.without
    }

    /// The warnings of reading the scene and building the world.
    pub fn warnings(&self) -> &[Warning] {
        &self.warnings
    }

    /// Prepares a job (one render) on this world. Its description may differ from that of this world in sampler, point
    /// set, filter, integrator, budget, crop and seed.
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
    warnings
        .extend(scene.shapes.iter().filter(|s| is_dark_lamp(s)).map(|s| Warning::LampWithoutArea(s.source.clone())));
    warnings
}

/// Returns `true` for a shape that should shine, and has no triangle with an area.
fn is_dark_lamp(shape: &Shape) -> bool {
    let (Some(_), Geometry::Mesh(mesh)) = (&shape.emission, &shape.geometry) else { return false };
    mesh.triangles.iter().all(|triangle| {
        let [a, b, c] = triangle.map(|corner| shape.to_world.transform_point3(mesh.positions[corner as usize]));
        (b - a).cross(c - a).length_squared() == 0.0
    })
}

/// The bundled scene called `name`; `None` if there is none, or if a file has this name.
fn bundle(name: &str) -> Option<Bundle> {
    if Path::new(name).is_file() { None } else { bundled::files(name) }
}

/// Reads the scene called `name`, a file or a bundled scene, with a digest if the options request one.
///
/// # Errors
///
/// [`JobError::NoScene`] for an unknown name, [`JobError::Read`] for a scene that cannot be read.
pub fn read_scene(
    name: &str,
    allow_unsupported: bool,
    options: &LoadOptions,
) -> Result<(Scene, Option<ContentHash>), JobError> {
    read_with_files(name, allow_unsupported, options).map(|(scene, digest, _)| (scene, digest))
}

/// Reads a scene as [`read_scene`] does; also returns the files that were read.
fn read_with_files(
    name: &str,
    allow_unsupported: bool,
    options: &LoadOptions,
) -> Result<(Scene, Option<ContentHash>, Vec<PathBuf>), JobError> {
    let path = Path::new(name);
    if let Some(bundle) = bundle(name) {
        let mut digest = ContentHash::new();
        for (name, bytes) in bundle.files.iter().filter(|_| options.digest) {
            digest.text(name);
            digest.add(bytes);
        }
        return Ok((bundle.read()?, options.digest.then_some(digest), Vec::new()));
    }
    if !path.exists() {
        return Err(JobError::NoScene { name: name.to_owned() });
    }
    let memory = options.limit.bytes().map(|limit| limit.saturating_sub(resident().map_or(0, |[now, _]| now)));
    let read_options = ReadOptions { allow_unsupported, memory };
    let files =
        Recorder { limit: options.limit, read: options.digest.then(RefCell::default), seen: RefCell::default() };
    let mut model = ModelOptions::default();
    model.aspect = options.aspect;
    let scene = read_any_from(&files, path, &AnyOptions { scene: read_options, model })?;
    let digest = files.read.map(|read| {
        let mut digest = ContentHash::new();
        // Paths are hashed relative to the scene's folder, so that a moved scene has the same digest.
        let folder = path.parent().unwrap_or(Path::new(""));
        for (file, of_bytes) in read.into_inner() {
            digest.text(&file.strip_prefix(folder).unwrap_or(&file).to_string_lossy());
            digest.text(&of_bytes);
        }
        digest
    });
    Ok((scene, digest, files.seen.into_inner().into_iter().collect()))
}

/// A file reader that limits the size of each file, lists the files, and hashes their bytes.
struct Recorder {
    limit: MemoryLimit,
    seen: RefCell<BTreeSet<PathBuf>>,
    read: Option<RefCell<BTreeMap<PathBuf, String>>>,
}

impl Files for Recorder {
    fn read(&self, path: &Path) -> std::io::Result<Vec<u8>> {
        if let Some(most) = self.limit.bytes() {
            let length = std::fs::metadata(path)?.len();
            if length > most {
                let (length, most) = (crate::memory::size(length), crate::memory::size(most));
                let what = format!("it is {length} long, and the limit of memory is {most}");
                return Err(std::io::Error::new(std::io::ErrorKind::OutOfMemory, what));
            }
        }
        let bytes = Disk.read(path)?;
        self.seen.borrow_mut().insert(path.to_owned());
        if let Some(read) = &self.read {
            read.borrow_mut().insert(path.to_owned(), ContentHash::of(&bytes).hex());
        }
        Ok(bytes)
    }
}

/// Checks the effects to leave out; returns each once, in the order in which they are removed from the scene.
fn called_for(asked: &[Effect], scene: &Scene) -> Result<Vec<Effect>, JobError> {
    let effects = Effects::of(scene);
    let mut without = asked.to_vec();
    // `SeveralLights` comes last, so that the strongest of the lights that other removals leave is kept.
    without.sort_by_key(|&effect| (effect == Effect::SeveralLights, effect));
    without.dedup();
    match without.iter().find(|&&effect| !effects.has(effect)) {
        None => Ok(without),
        Some(&effect) => {
            let called = effects.called().iter().map(|called| called.effect).collect();
            Err(JobError::NotCalledFor { effect, called })
        }
    }
}

pub(crate) fn frame(spec: &RenderSpec, scene: &Scene) -> Result<Frame, JobError> {
    let full = scene.film.resolution;
    // A side is at least one pixel; beyond 32 bits, it saturates and the frame is refused.
    let scaled = |side: u32| spec.scale.map_or(side, |scale| (f64::from(side) * scale).round().max(1.0) as u32);
    let [w, h] = spec.resolution.unwrap_or(full.map(scaled));
    let frame = Frame::new(w, h)?;
    let scaled = |[x0, y0, x1, y1]: [u32; 4]| {
        // At another resolution, the file's window covers the same part of the image, as in pbrt.
        let part =
            |at: u32, from: u32, to: u32| (u64::from(at) * u64::from(to)).div_ceil(u64::from(from.max(1))) as u32;
        [part(x0, full[0], w), part(y0, full[1], h), part(x1, full[0], w), part(y1, full[1], h)]
    };
    let window = match spec.crop {
        CropSpec::Window(window) => Some(window),
        CropSpec::Scene => scene.film.crop.map(scaled),
        CropSpec::Whole => None,
    };
    match window {
        Some([x0, y0, x1, y1]) => Ok(frame.crop(x0, y0, x1, y1)?),
        None => Ok(frame),
    }
}

/// The settings of a point set: the seed, and the mean samples per pixel (`None` for budgets of error or time).
pub(crate) fn setting(spec: &RenderSpec, frame: Frame) -> Setting {
    let spp = match spec.budget {
        BudgetSpec::Scene => Some(DEFAULT_SPP as u64),
        BudgetSpec::Spp(spp) => Some(spp.ceil() as u64),
        BudgetSpec::Samples(samples) => Some(samples.div_ceil(frame.pixels() as u64)),
        BudgetSpec::Error(_) | BudgetSpec::Seconds(_) => None,
    };
    Setting { seed: spec.seed, spp }
}

/// The budget in samples, error or seconds, and the bounds of samples per pixel, from a description.
pub(crate) fn limits(spec: &RenderSpec, frame: Frame) -> Limits {
    let pixels = frame.pixels() as u64;
    let per_pixel = |spp| Budget::Samples(Budget::PerPixel(spp).samples(&frame).unwrap_or(1));
    let budget = match spec.budget {
        BudgetSpec::Scene => per_pixel(DEFAULT_SPP),
        // At least one sample in total; the bounds refuse a mean that is too small for one sample per pixel.
        BudgetSpec::Spp(spp) => per_pixel(spp),
        BudgetSpec::Samples(samples) => Budget::Samples(samples),
        BudgetSpec::Error(relmse) => {
            Budget::Error { relmse, at_most: pixels * u64::from(spec.max_spp.unwrap_or(ERROR_SPP)) }
        }
        BudgetSpec::Seconds(seconds) => Budget::Seconds(seconds),
    };
    let mut limits = Limits::new(budget);
    limits.min_spp = spec.min_spp;
    limits.max_spp = spec.max_spp.unwrap_or(u32::MAX);
    limits
}

/// Refuses a point set with fewer points per pixel than the budget needs at least.
fn check_capacity(spec: &RenderSpec, frame: Frame) -> Result<(), JobError> {
    let setting = setting(spec, frame);
    let points = registry::points(&spec.points, setting)?;
    match setting.spp {
        Some(asked) if asked > points.capacity() => {
            let (points, capacity) = (points.describe(), points.capacity());
            Err(Error::SequenceExhausted { points, capacity, requested: asked }.into())
        }
        _ => Ok(()),
    }
}
