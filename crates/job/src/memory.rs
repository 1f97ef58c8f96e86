//! Estimates of the memory of scenes, worlds and renders, before they exist.
//!
//! All memory that grows with the image is counted (`ImageMemory`). In scenes, only meshes and images are counted: names,
//! materials and lights are too small to matter. Memory already in use is taken from the system if it reports it, else
//! estimated. While a scene is read, the limit applies to the length of each file.

use crate::JobError;
use dapple_core::limits::Budget;
use dapple_core::plan::SamplerMemory;
use dapple_core::{Film, Filter, Frame, Limits, Needs, Render, Sampler, film::Recorder, filter::FilterMemory};
use dapple_scene::image::Image;
use dapple_scene::{EnvironmentRadiance, Geometry, LightKind, MeshData, Scene, Shape, TextureKind};
use std::collections::BTreeMap;
use std::fmt;
use std::sync::Arc;

/// Bytes of the bounding volume hierarchy per triangle. Measured: 51 to 52 on meshes of 0.1 to 50 million triangles
/// (docs/results/rays.md).
const TREE: u64 = 53;
/// Peak bytes per triangle while the bounding volume hierarchy is built, not counting the meshes. Measured: 155 on a mesh of 4
/// million triangles.
const BUILDING: u64 = 160;
/// Bytes per pixel of an environment map's packed texels and sampling tables.
const ENVIRONMENT: u64 = 5;

/// Returns the bytes of a scene's meshes and images; shared ones count once.
pub fn of_scene(scene: &Scene) -> u64 {
    let meshes = once(meshes(scene))
        .into_iter()
        .map(|mesh| of_slice(&mesh.positions) + of_slice(&mesh.triangles) + attributes(mesh));
    let images = once(images(scene)).into_iter().map(|p| of_slice(&p.pixels) + of_slice(&p.alpha));
    meshes.chain(images).sum()
}

/// Returns the bytes of a mesh's normals, texture coordinates and colours.
fn attributes(mesh: &MeshData) -> u64 {
    of_slice(&mesh.normals) + of_slice(&mesh.uvs) + of_slice(&mesh.colors)
}

/// Estimates the bytes of the world that [`World::new`](dapple_renderer::World::new) builds for a scene: after building, and at
/// the peak while building. The scene itself is not counted. For large meshes the estimates are within 10 %.
pub fn of_world(scene: &Scene) -> [u64; 2] {
    // Positions are stored in single precision; normals, texture coordinates and triangles are copied; each triangle
    // gets a normal.
    let copied = |mesh: &Arc<MeshData>| {
        let vertices = mesh.positions.len() as u64 * 12 + attributes(mesh);
        vertices + 2 * of_slice(&mesh.triangles)
    };
    let copies: u64 = meshes(scene).map(copied).sum();
    let triangles: u64 = meshes(scene).map(|mesh| mesh.triangles.len() as u64).sum();
    let tables: u64 = environments(scene).map(|image| ENVIRONMENT * image.pixels.len() as u64).sum();
    [TREE, BUILDING].map(|tree| copies + tables + tree * triangles)
}

fn of_slice<T>(values: &[T]) -> u64 {
    size_of_val(values) as u64
}

/// The meshes of all shapes. An object's meshes occur once, however many instances it has.
fn meshes(scene: &Scene) -> impl Iterator<Item = &Arc<MeshData>> {
    let shapes = scene.shapes.iter().chain(scene.objects.iter().flat_map(|object| &object.shapes));
    shapes.filter_map(|shape: &Shape| if let Geometry::Mesh(mesh) = &shape.geometry { Some(mesh) } else { None })
}

fn environments(scene: &Scene) -> impl Iterator<Item = &Arc<Image>> {
    scene.lights.iter().filter_map(|light| match &light.kind {
        LightKind::Infinite {
            radiance: EnvironmentRadiance::LatLong { image, .. } | EnvironmentRadiance::EqualArea { image, .. },
        } => Some(image),
        _ => None,
    })
}

fn images(scene: &Scene) -> impl Iterator<Item = &Arc<Image>> {
    let textures = scene.textures.iter().filter_map(|texture| match &texture.kind {
        TextureKind::Image { image, .. } => Some(image),
        _ => None,
    });
    textures.chain(environments(scene))
}

/// The shared values, each once.
fn once<'a, T>(all: impl Iterator<Item = &'a Arc<T>>) -> Vec<&'a Arc<T>> {
    let mut all: Vec<&Arc<T>> = all.collect();
    all.sort_by_key(|one| Arc::as_ptr(one));
    all.dedup_by_key(|one| Arc::as_ptr(one));
    all
}

/// Working memory per thread in bytes, mostly for a filter's image tile. Measured: 0.6 to 1.1 MiB.
const THREAD: u64 = 1 << 20;
/// The assumed memory of the program itself in bytes, used if the system does not report it.
const PROGRAM: u64 = 16 << 20;

/// The bytes of a render's film, plans and filter, computed from the planes that each part holds at its peak.
///
/// The figures are equal on machines with the same number of threads. Under a time or error limit they assume more than one
/// round; a single round needs less.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct ImageMemory {
    /// The statistics that the film records.
    pub(crate) needs: Needs,
    /// The film (including discarded samples), and the filtered image that is kept under an error limit.
    pub(crate) film: u64,
    /// The state of the sampler between rounds.
    pub(crate) sampler: u64,
    /// The peak while a round is planned, excluding the film and the sampler's state.
    pub(crate) planning: u64,
    /// The plan of the round that is being traced.
    pub(crate) tracing: u64,
    pub(crate) filter: FilterMemory,
}

impl ImageMemory {
    /// The memory of a render with these settings, and of applying `filter` to its film. `judged` is `true` if an error limit
    /// applies to the filtered image.
    ///
    /// [Recorders](Recorder) are assumed to record the budget's mean number of samples per pixel and half.
    pub(crate) fn new(
        sampler: &dyn Sampler,
        (filter, judged): (&dyn Filter, bool),
        needs: Needs,
        frame: &Frame,
        limits: &Limits,
    ) -> Self {
        let is_error = matches!(limits.budget, Budget::Error { .. });
        let needs = needs.and(sampler.needs());
        let needs = if is_error { needs.with_halves() } else { needs };
        let SamplerMemory { discarded, state, planning, plan, .. } = sampler.memory(frame, &needs, limits);
        // One sample per pixel goes to the first half. The second half's zeros are never written, so they take no memory.
        let single = limits.budget.samples(frame).is_some_and(|total| total <= frame.pixels() as u64);
        let unwritten = if needs.halves && single { Film::half_bytes_per_pixel(&needs) } else { 0 };
        let kept = frame.bytes(if is_error && judged { Render::ERROR_OF_BYTES } else { 0 });
        let film = frame.bytes(Film::bytes_per_pixel(&needs) - unwritten).saturating_add(discarded);
        let recorders = sampler.recorders().into_iter().chain(filter.recorders());
        let recorders: BTreeMap<String, Arc<dyn Recorder>> = recorders.map(|one| (one.name().into(), one)).collect();
        let (pixels, halves) = (frame.pixels() as u64, if needs.halves { 2 } else { 1 });
        let each = limits.expected_samples(frame).div_ceil(pixels).div_ceil(halves);
        let words = recorders.values().map(|one| one.bytes(each) + size_of::<Vec<u32>>() as u64).sum::<u64>();
        let film = film.saturating_add((pixels * halves).saturating_mul(words)).saturating_add(kept);
        Self { needs, film, sampler: state, planning, tracing: plan, filter: filter.memory(frame, &needs) }
    }

    /// The bytes of a snapshot. A resumed render initially holds its snapshot in addition to the film.
    pub(crate) fn snapshot(&self) -> u64 {
        self.film.saturating_add(self.tracing)
    }
}

/// A limit on the memory of a render.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MemoryLimit {
    bytes: u64,
    given: bool,
}

impl MemoryLimit {
    /// A limit that no render exceeds.
    pub const fn none() -> Self {
        Self { bytes: u64::MAX, given: false }
    }

    /// A limit of `bytes` set by the user.
    pub const fn given(bytes: u64) -> Self {
        Self { bytes, given: true }
    }

    /// The memory that this process may use ([`available`]) as the limit; no limit if the system does not report it.
    pub fn of_machine() -> Self {
        Self { bytes: available().unwrap_or(u64::MAX), given: false }
    }

    /// The limit in bytes; `None` without a limit.
    pub fn bytes(self) -> Option<u64> {
        (self.bytes < u64::MAX).then_some(self.bytes)
    }

    /// Returns `true` for a limit set by the user, `false` for the machine's memory or no limit.
    pub const fn is_given(self) -> bool {
        self.given
    }
}

/// An estimate of the peak memory of a render, in bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MemoryEstimate {
    /// Bytes of the program and its threads, the scene and the world.
    scene: u64,
    film: u64,
    /// Names and bytes of other data that last for the whole render: the sampler's state, the integrator's prepared light, and
    /// an upper bound for learned light selection.
    others: [(&'static str, u64); 3],
    /// The name of each stage of the render, and its bytes; only one stage at a time is in memory.
    stages: Vec<(&'static str, u64)>,
    /// Peak memory in bytes until the film is allocated.
    before: u64,
}

impl MemoryEstimate {
    /// A lower bound on the peak memory of rendering `scene`, estimated before the [`World`](dapple_renderer::World) is built.
    pub fn of_scene(scene: &Scene, frame: &Frame) -> Self {
        let [built, building] = of_world(scene);
        let now = resident().map_or_else(|| PROGRAM + of_scene(scene), |[now, _]| now);
        let film = frame.bytes(Film::bytes_per_pixel(&Needs::none()));
        Self { scene: now + built, film, others: [("", 0); 3], stages: Vec::new(), before: now + building }
    }

    /// The memory of a prepared render. `self` is the estimate from the scene. `files` is the peak in bytes for writing a file,
    /// excluding film and image. With `keeps`, the film is also encoded as bytes, for a checkpoint or a part. `light` is the
    /// bytes of the integrator's prepared light; `training` is an upper bound on the bytes of its training data.
    pub(crate) fn of_render(&self, memory: &ImageMemory, files: u64, keeps: bool, [light, training]: [u64; 2]) -> Self {
        let [now, most] = resident().unwrap_or([self.scene, 0]);
        let snapshot = if keeps { memory.snapshot() } else { 0 };
        let stages = vec![
            ("planning", memory.planning),
            (if keeps { "checkpoint" } else { "plan" }, memory.tracing.saturating_add(snapshot)),
            ("filter", memory.filter.applying),
            ("files", memory.filter.image.saturating_add(files)),
        ];
        let scene = now + THREAD * rayon::current_num_threads() as u64;
        let others = [("sampler", memory.sampler), ("light", light), ("light selection at most", training)];
        Self { scene, film: memory.film, others, stages, before: self.before.max(most) }
    }

    /// Adds the live view of `frame`: a copy of radiance, sample counts and errors, and the packet or PNG file made from it.
    #[must_use]
    pub fn with_live_image(mut self, frame: &Frame) -> Self {
        /// Bytes per pixel: 20 for the planes, 8 for copying sample counts, 12 for a network packet or a PNG file.
        const COPY: usize = 40;
        self.stages.iter_mut().for_each(|(_, bytes)| *bytes = bytes.saturating_add(frame.bytes(COPY)));
        self
    }

    /// Adds a stage called `name` that holds `copies` copies of the render's state, of `bytes` each. Examples are files of a
    /// render in stages, and a checkpoint to resume from.
    #[must_use]
    pub(crate) fn with_copies(mut self, name: &'static str, copies: u64, bytes: u64) -> Self {
        self.stages.push((name, bytes.saturating_mul(copies)));
        self
    }

    /// Subtracts a film that is already in memory, such as the film of merged parts, so that it is counted once.
    #[must_use]
    pub fn with_film_in_memory(self) -> Self {
        Self { scene: self.scene.saturating_sub(self.film), ..self }
    }

    /// Checks that a render fits into `limit`.
    ///
    /// # Errors
    ///
    /// [`JobError::Memory`] with a remedy if the render does not fit.
    pub fn check(&self, limit: MemoryLimit) -> Result<(), JobError> {
        let refused = |advice| Err(JobError::Memory { estimate: Box::new(self.clone()), limit, advice });
        if self.peak() <= limit.bytes {
            // A trial allocation finds films that are larger than the address space, even without a limit.
            let fits = usize::try_from(self.film).is_ok_and(|film| Vec::<u8>::new().try_reserve_exact(film).is_ok());
            return if fits { Ok(()) } else { refused("render smaller crops") };
        }
        let with_film = self.scene.saturating_add(self.film);
        refused(match self.largest_stage() {
            _ if self.before.max(self.scene) > limit.bytes => {
                "the scene alone does not fit; simplify the scene, or use a machine with more memory"
            }
            Some((name, _)) if name == "filter" && with_film <= limit.bytes => {
                "lower the resolution, leave the filter out, or render crops"
            }
            _ => "lower the resolution, or render crops",
        })
    }

    /// The peak memory of the whole render in bytes.
    pub fn peak(&self) -> u64 {
        let lasting = self.others.iter().map(|(_, bytes)| *bytes).chain([self.film]);
        let lasting = lasting.fold(self.scene, u64::saturating_add);
        lasting.saturating_add(self.largest_stage().map_or(0, |(_, bytes)| bytes)).max(self.before)
    }

    fn largest_stage(&self) -> Option<(&'static str, u64)> {
        self.stages.iter().copied().max_by_key(|&(_, bytes)| bytes)
    }
}

impl fmt::Display for MemoryEstimate {
    /// Formats the sum, then its parts: `80.1 MiB (scene 12.0 MiB, film 60.0 MiB, filter 8.1 MiB)`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let peak = self.peak();
        if peak == self.before {
            return write!(f, "{} (reading the scene and building its tree)", size(peak));
        }
        write!(f, "{} (scene {}, film {}", size(peak), size(self.scene), size(self.film))?;
        let others = self.others.iter().copied().filter(|(_, bytes)| *bytes > 0);
        for (name, bytes) in others.chain(self.largest_stage()) {
            write!(f, ", {name} {}", size(bytes))?;
        }
        f.write_str(")")
    }
}

/// Formats a number of bytes with a unit: `12 bytes`, `1.5 MiB`.
pub fn size(bytes: u64) -> String {
    const KIB: f64 = 1024.0;
    match bytes as f64 {
        n if n < KIB => format!("{n} bytes"),
        n if n < KIB * KIB => format!("{:.1} KiB", n / KIB),
        n if n < 1e4 * KIB * KIB => format!("{:.1} MiB", n / (KIB * KIB)),
        n => format!("{:.1} GiB", n / (KIB * KIB * KIB)),
    }
}

/// The resident memory of this process in bytes: the present value, then the peak so far. `None` if the system does not
/// report them.
pub fn resident() -> Option<[u64; 2]> {
    let status = read_text("/proc/self/status")?;
    Some([kibibytes(&status, "VmRSS:")?, kibibytes(&status, "VmHWM:")?])
}

/// The memory in bytes that this process may use in total: the part in use plus the system's free memory, at most the
/// control group's limit. `None` if the system does not report these values.
pub fn available() -> Option<u64> {
    let free = kibibytes(&read_text("/proc/meminfo")?, "MemAvailable:")?;
    let left = free.saturating_add(resident()?[0]);
    let group = read_text("/sys/fs/cgroup/memory.max").and_then(|most| most.trim().parse().ok());
    Some(left.min(group.unwrap_or(u64::MAX)))
}

fn read_text(path: &str) -> Option<String> {
    // Other systems may have another file of that name.
    if cfg!(target_os = "linux") { std::fs::read_to_string(path).ok() } else { None }
}

/// The value in bytes of the line `name 123 kB` in `text`; `None` without such a line.
fn kibibytes(text: &str, name: &str) -> Option<u64> {
    let rest = text.lines().find_map(|line| line.strip_prefix(name))?;
    rest.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}

#[cfg(test)]
mod tests {
    use super::*;
    use dapple_core::{HostNumbers, Unfiltered, film::RecordedSample, samplers::Uniform};
    use dapple_renderer::World;
    use dapple_scene::bundled;

    #[test]
    fn worlds_take_the_estimated_memory_z03() {
        let scene = bundled::files("terrain").unwrap().read().unwrap();
        let world = World::new(&scene).unwrap();
        let triangles: u64 = meshes(&scene).map(|mesh| mesh.triangles.len() as u64).sum();
        assert_eq!(triangles, world.geometry().triangle_count() as u64);
        let (tree, foreseen) = (world.geometry().memory_bytes() as f64, (TREE * triangles) as f64);
        assert!((0.85..=1.0).contains(&(tree / foreseen)), "{foreseen} estimated, {tree} bytes");
        let (meshes, [built, building]) = (of_scene(&scene), of_world(&scene));
        assert!(meshes > 24 * triangles && built > meshes && building > built);
    }

    fn of(frame: &Frame, budget: Budget) -> ImageMemory {
        let (sampler, limits) = (Uniform::new(HostNumbers), Limits::new(budget));
        ImageMemory::new(&sampler, (&Unfiltered, true), Needs::none(), frame, &limits)
    }

    #[test]
    fn the_forecast_counts_every_recorded_statistic() {
        let frame = Frame::new(100, 50).unwrap();
        let uniform = of(&frame, Budget::Samples(20_000));
        assert_eq!((uniform.film, uniform.filter.image), (5000 * 28, 5000 * 12));
        let halves = of(&frame, Budget::Error { relmse: 0.1, at_most: 20_000 });
        assert_eq!((halves.film, halves.filter.image), (5000 * (56 + 48), 5000 * 16));
        assert_eq!(halves.snapshot(), halves.film + halves.tracing);
    }

    #[test]
    fn the_largest_image_does_not_wrap_z03() {
        let frame = Frame::new(65535, 65537).unwrap();
        assert_eq!(of(&frame, Budget::Samples(1 << 40)).film, 28 * u64::from(u32::MAX));
        assert_eq!(frame.bytes(usize::MAX), u64::MAX);
    }

    /// Keeps a word of each sample.
    struct Words(&'static str);

    impl Recorder for Words {
        fn name(&self) -> &str {
            self.0
        }

        fn record(&self, words: &mut Vec<u32>, _: &RecordedSample<'_>) {
            words.push(0);
        }

        fn bytes(&self, samples: u64) -> u64 {
            4 * samples
        }
    }

    impl Filter for Words {
        fn name(&self) -> &str {
            self.0
        }

        fn recorders(&self) -> Vec<Arc<dyn Recorder>> {
            ["a", "a", "b"].map(|name| Arc::new(Words(name)) as Arc<dyn Recorder>).to_vec()
        }

        fn apply(&self, film: &Film) -> Result<dapple_core::Filtered, dapple_core::Error> {
            Unfiltered.apply(film)
        }
    }

    #[test]
    fn recorders_count_once_with_their_words() {
        let (frame, sampler) = (Frame::new(7, 5).unwrap(), Uniform::new(HostNumbers));
        for (needs, halves) in [(Needs::none(), 1), (Needs::none().with_halves(), 2)] {
            let memory = ImageMemory::new(&sampler, (&Words("words"), false), needs, &frame, &Limits::spp(8.0));
            let words = 2 * (4 * 8 / halves + size_of::<Vec<u32>>() as u64);
            assert_eq!(memory.film, 35 * halves * (28 + words));
        }
    }
}
