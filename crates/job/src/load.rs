//! From a description to a scene, and from a scene to a world.

use crate::memory::{MemoryEstimate, MemoryLimit};
use crate::registry::{self, Setting};
use crate::{BudgetSpec, ContentHash, CropSpec, ERROR_SPP, Job, JobError, PixelFilterSpec, RenderSpec, Warning};
use dapple_core::{Budget, Error, Frame, Limits, PointSet};
use dapple_renderer::World;
use dapple_scene::bundled::{self, Bundle};
use dapple_scene::files::{Disk, Files};
use dapple_scene::pbrt::ReadOptions;
use dapple_scene::{AnyOptions, Effect, Effects, PixelFilter, Scene, read_any_from};
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// Settings of the reader.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct LoadOptions {
    /// The memory that the render may take. No longer file is read.
    pub limit: MemoryLimit,
    /// Hashes every byte that is read. Checkpoints and shards need the hash.
    pub digest: bool,
}

impl Default for LoadOptions {
    /// No limit of memory, with a digest.
    fn default() -> Self {
        Self { limit: MemoryLimit::none(), digest: true }
    }
}

impl LoadOptions {
    /// Sets the limit of memory.
    #[must_use]
    pub fn with_limit(self, limit: MemoryLimit) -> Self {
        Self { limit, ..self }
    }

    /// Leaves the digest out.
    #[must_use]
    pub fn without_digest(self) -> Self {
        Self { digest: false, ..self }
    }
}

/// A scene that was read, with the settings of its render.
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
}

/// A scene that is ready for rays. Cheap to clone; clones share.
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
    /// Reads the scene of a description.
    ///
    /// # Errors
    ///
    /// [`JobError`] for a description that is not valid, a scene that cannot be read, and effects that the scene does not
    /// call for.
    pub fn read(spec: &RenderSpec, options: &LoadOptions) -> Result<Self, JobError> {
        spec.check()?;
        let clock = Instant::now();
        let (scene, digest) = read_scene(&spec.scene, spec.allow_unsupported, options)?;
        let mut loaded = Self::from_scene(spec, scene)?;
        loaded.digest = digest;
        loaded.load_seconds = clock.elapsed().as_secs_f64();
        Ok(loaded)
    }

    /// Takes a scene that exists already in place of the one that the description names. It has no digest, so that its
    /// render has no checkpoints.
    ///
    /// # Errors
    ///
    /// As [`LoadedScene::read`].
    pub fn from_scene(spec: &RenderSpec, mut scene: Scene) -> Result<Self, JobError> {
        spec.check()?;
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
        warnings.extend(Effects::found_by_chance(&scene).map(Warning::FoundByChance));
        Ok(Self {
            spec: spec.clone(),
            scene: Arc::new(scene),
            digest: None,
            frame,
            without,
            warnings,
            expected,
            load_seconds: 0.0,
        })
    }

    /// The scene, with the changes that the description asks for.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Resolution and window.
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// The description.
    pub fn spec(&self) -> &RenderSpec {
        &self.spec
    }

    /// Warnings about directives that were adjusted or left out.
    pub fn warnings(&self) -> &[Warning] {
        &self.warnings
    }

    /// The memory that the render takes at least.
    pub fn memory(&self) -> &MemoryEstimate {
        &self.expected
    }

    /// Builds the world.
    ///
    /// # Errors
    ///
    /// [`JobError::World`] with everything that is wrong with the scene.
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
    /// The scene.
    pub fn scene(&self) -> &Arc<Scene> {
        &self.scene
    }

    /// The world.
    pub fn world(&self) -> &Arc<World> {
        &self.world
    }

    /// ContentHash of all bytes that were read for the scene.
    pub fn digest(&self) -> Option<&ContentHash> {
        self.digest.as_ref()
    }

    /// Seconds of reading the scene.
    pub fn load_seconds(&self) -> f64 {
        self.load_seconds
    }

    /// Seconds of building the world.
    pub fn build_seconds(&self) -> f64 {
        self.build_seconds
    }

    /// The effects that are left out.
    pub fn without(&self) -> &[Effect] {
        &self.without
    }

    /// The warnings of reading and building.
    pub fn warnings(&self) -> &[Warning] {
        &self.warnings
    }

    /// A job on this world, whose description may differ in its methods, budget and seed.
    ///
    /// # Errors
    ///
    /// [`JobError::OtherWorld`] for a description of another world; see [`Job::prepare`] for the rest.
    pub fn job(&self, spec: &RenderSpec) -> Result<Job, JobError> {
        Job::on(spec, self.clone())
    }
}

/// The scene's warnings.
fn notices(spec: &RenderSpec, scene: &Scene) -> Vec<Warning> {
    let mut warnings = Vec::new();
    // The text of a bundled scene has advice for other renderers, which is not news for its user.
    if bundle(&spec.scene).is_none() {
        warnings.extend(scene.notices.iter().cloned().map(Warning::Notice));
    }
    if let (Some(suggested), Some(spp)) = (scene.film.spp, spec.mean_spp())
        && f64::from(suggested) != spp
    {
        warnings.push(Warning::SuggestedSpp { scene: spec.scene.clone(), suggested, spp });
    }
    warnings
}

/// The bundled scene of a name that is not a file's.
fn bundle(name: &str) -> Option<Bundle> {
    if Path::new(name).is_file() { None } else { bundled::files(name) }
}

/// Reads a scene by its name, with a digest where the options ask for one.
///
/// # Errors
///
/// [`JobError::NoScene`] or [`JobError::Read`].
pub fn read_scene(
    name: &str,
    allow_unsupported: bool,
    options: &LoadOptions,
) -> Result<(Scene, Option<ContentHash>), JobError> {
    let path = Path::new(name);
    if let Some(bundle) = bundle(name) {
        let mut digest = ContentHash::new();
        for (name, bytes) in bundle.files.iter().filter(|_| options.digest) {
            digest.text(name);
            digest.add(bytes);
        }
        return Ok((bundle.read()?, options.digest.then_some(digest)));
    }
    if !path.exists() {
        return Err(JobError::NoScene { name: name.to_owned() });
    }
    let read_options = ReadOptions::default().with_allow_unsupported(allow_unsupported);
    let files = Recorder { limit: options.limit, read: options.digest.then(RefCell::default) };
    let scene = read_any_from(&files, path, &AnyOptions::default().with_scene(read_options))?;
    let digest = files.read.map(|read| {
        let mut digest = ContentHash::new();
        // The place of the scene does not matter.
        let folder = path.parent().unwrap_or(Path::new(""));
        for (file, of_bytes) in read.into_inner() {
            digest.text(&file.strip_prefix(folder).unwrap_or(&file).to_string_lossy());
            digest.text(&of_bytes);
        }
        digest
    });
    Ok((scene, digest))
}

/// The disk, with a limit for each file, and a digest of each that is read.
struct Recorder {
    limit: MemoryLimit,
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
        if let Some(read) = &self.read {
            read.borrow_mut().insert(path.to_owned(), ContentHash::of(&bytes).hex());
        }
        Ok(bytes)
    }
}

/// The effects to leave out, once each, in the order in which they go.
fn called_for(asked: &[Effect], scene: &Scene) -> Result<Vec<Effect>, JobError> {
    let effects = Effects::of(scene);
    let mut without = asked.to_vec();
    // The selection among lights comes last, so that the strongest of those that are left stays.
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
    let [w, h] = spec.resolution.unwrap_or(full);
    let frame = Frame::new(w, h)?;
    let scaled = |[x0, y0, x1, y1]: [u32; 4]| {
        // The file's window at another resolution, as in pbrt: the same part of the image.
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

/// Seed and samples per pixel, for point sets.
pub(crate) fn setting(spec: &RenderSpec, frame: Frame) -> Setting {
    let spp = match spec.budget {
        BudgetSpec::Spp(spp) => Some(spp.ceil() as u64),
        BudgetSpec::Samples(samples) => Some(samples.div_ceil(frame.pixels() as u64)),
        BudgetSpec::Error(_) | BudgetSpec::Seconds(_) => None,
    };
    Setting { seed: spec.seed, spp }
}

/// The budget and bounds of a description.
pub(crate) fn limits(spec: &RenderSpec, frame: Frame) -> Limits {
    let pixels = frame.pixels() as u64;
    let budget = match spec.budget {
        // At least one sample: a mean that rounds to none is refused by its bounds.
        BudgetSpec::Spp(spp) => Budget::Samples(((spp * pixels as f64).round() as u64).max(1)),
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

/// Refuses at once a point set that would be exhausted after the first round.
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
