//! The estimated memory of a render before it starts, and the refusal of renders that do not fit.
//!
//! All memory that grows with the image is counted ([`ImageMemory`]). Memory already in use is measured if the system
//! reports it, else estimated. While a scene is read, only the length of each of its files is limited.

use super::{ImageMemory, WorldMemory, of_scene, of_world, resident};
use crate::JobError;
use dapple_core::{Film, Frame, Needs};
use dapple_scene::Scene;
use std::fmt;

/// Working memory per thread in bytes, mostly for a filter's image tile. Measured: 0.6 to 1.1 MiB.
const THREAD: u64 = 1 << 20;
/// The assumed memory of the program itself in bytes, used if the system does not report it.
const PROGRAM: u64 = 16 << 20;

/// A limit on the memory of a render.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MemoryLimit {
    bytes: u64,
    given: bool,
}

impl MemoryLimit {
    /// Makes a limit that no render exceeds.
    pub const fn none() -> Self {
        Self { bytes: u64::MAX, given: false }
    }

    /// A limit of `bytes` set by the user.
    pub const fn given(bytes: u64) -> Self {
        Self { bytes, given: true }
    }

    /// The memory of this machine as the limit; no limit if the system does not report it.
    pub fn of_machine() -> Self {
        Self { bytes: super::available().unwrap_or(u64::MAX), given: false }
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

/// The suggested remedy for a render that does not fit into memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum MemoryAdvice {
    /// The scene alone is too large: simplify it.
    Scene,
    /// The filter needs most of the memory, and the film alone would fit: use another filter.
    Filter,
    /// The image is too large: lower the resolution.
    Image,
    /// The operating system cannot provide so large an address space.
    AddressSpace,
}

/// The peak memory of a render in bytes, part by part.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MemoryEstimate {
    /// Bytes of the program and its threads, the scene and the world.
    scene: u64,
    film: u64,
    /// Bytes of the sampler's state.
    sampler: u64,
    /// Bytes of light that the integrator prepares.
    integrator: u64,
    /// Bytes of learned light selection, at most.
    training: u64,
    /// The name of each stage of the render, and its bytes; only one stage at a time is in memory.
    stages: Vec<(&'static str, u64)>,
    /// Peak memory in bytes until the film is allocated.
    before: u64,
}

impl MemoryEstimate {
    /// The least memory of a render of `scene`, estimated before the world is built.
    pub fn of_scene(scene: &Scene, frame: &Frame) -> Self {
        let WorldMemory { built, building } = of_world(scene);
        let now = resident().map_or_else(|| PROGRAM + of_scene(scene), |[now, _]| now);
        let film = frame.bytes(Film::bytes_per_pixel(&Needs::none()));
        Self {
            scene: now + built,
            film,
            sampler: 0,
            integrator: 0,
            training: 0,
            stages: Vec::new(),
            before: now + building,
        }
    }

    /// The memory of a prepared render. `before` is the estimate from its scene. `files` is the peak in bytes for
    /// writing a file, besides film and image. `keeps` states that the film is also encoded as bytes, for a checkpoint
    /// or shard. Of several processes with their rows each, it passes in pieces.
    pub(crate) fn of_render(before: &Self, memory: &ImageMemory, files: u64, keeps: bool) -> Self {
        let [now, most] = resident().unwrap_or([before.scene, 0]);
        let snapshot = if keeps { memory.snapshot() } else { 0 };
        let stages = vec![
            ("planning", memory.planning),
            (if keeps { "checkpoint" } else { "plan" }, memory.tracing.saturating_add(snapshot)),
            ("filter", memory.filter.applying),
            ("files", memory.filter.image.saturating_add(files)),
        ];
        let scene = now + THREAD * rayon::current_num_threads() as u64;
        Self {
            scene,
            film: memory.film,
            sampler: memory.sampler,
            integrator: 0,
            training: 0,
            stages,
            before: before.before.max(most),
        }
    }

    /// Adds the light that the integrator prepares ([`Integrator::memory`](dapple_core::Integrator::memory)).
    pub(crate) fn with_integrator(self, bytes: u64) -> Self {
        Self { integrator: bytes, ..self }
    }

    /// Adds the copy of the image of `frame` that is shown while the render goes on: radiance, counts and errors, and their
    /// encoding.
    #[must_use]
    pub fn with_live_image(mut self, frame: &Frame) -> Self {
        /// Bytes per pixel: 20 of planes, 8 of counts as they are copied, 12 of a packet or a PNG file. Rows of several processes
        /// come in pieces.
        const COPY: usize = 40;
        self.stages.iter_mut().for_each(|(_, bytes)| *bytes = bytes.saturating_add(frame.bytes(COPY)));
        self
    }

    /// Adds the most that learning takes, and a stage of `bytes` before the render: training passes of the whole image.
    #[must_use]
    pub(crate) fn with_training(self, training: u64) -> Self {
        Self { training, ..self }
    }

    /// Adds a stage that holds `copies` of the render's state of `bytes`: files of a render in stages, or a checkpoint to resume
    /// from.
    #[must_use]
    pub(crate) fn with_copies(mut self, name: &'static str, copies: u64, bytes: u64) -> Self {
        self.stages.push((name, bytes.saturating_mul(copies)));
        self
    }

    /// Counts the film only once if it is in memory already, as that of merged shards is.
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
            return if fits { Ok(()) } else { refused(MemoryAdvice::AddressSpace) };
        }
        let with_film = self.scene.saturating_add(self.film);
        refused(match self.largest_stage() {
            _ if self.before.max(self.scene) > limit.bytes => MemoryAdvice::Scene,
            Some((name, _)) if name == "filter" && with_film <= limit.bytes => MemoryAdvice::Filter,
            _ => MemoryAdvice::Image,
        })
    }

    /// The peak memory of the whole render in bytes.
    pub fn peak(&self) -> u64 {
        let lasting = [self.film, self.sampler, self.integrator, self.training];
        let lasting = lasting.into_iter().fold(self.scene, u64::saturating_add);
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
        if self.sampler > 0 {
            write!(f, ", sampler {}", size(self.sampler))?;
        }
        if self.integrator > 0 {
            write!(f, ", light {}", size(self.integrator))?;
        }
        if self.training > 0 {
            write!(f, ", light selection at most {}", size(self.training))?;
        }
        if let Some((name, bytes)) = self.largest_stage() {
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
