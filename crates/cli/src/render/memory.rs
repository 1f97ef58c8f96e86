//! The memory that a render will take, and the refusal of one that does not fit.
//!
//! Counted for whatever goes with the size of the image ([`Memory`]); what is there already is measured where the system
//! tells, and counted elsewhere. Reading a scene is bounded by the length of each of its files alone; its own memory is known
//! when it has been read.

use super::Options;
use crate::machine;
use crate::output::bytes;
use crate::{Failure, Result};
use dapple_core::{Film, Frame, Memory, Needs};
use dapple_job::memory::{WorldMemory, of_scene, of_world};
use dapple_scene::Scene;

/// What each thread works with at a time, a filter's tile above all: about .6 to 1.1 MiB.
const THREAD: u64 = 1 << 20;
/// The program by itself, where the system does not tell what it takes.
const PROGRAM: u64 = 16 << 20;

/// Memory that may be taken; unlimited where nobody says.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limit {
    bytes: u64,
    /// Whether the user said so.
    given: bool,
}

impl Limit {
    pub(super) fn new(options: &Options) -> Self {
        let bytes = options.memory.or_else(machine::memory).unwrap_or(u64::MAX);
        Self { bytes, given: options.memory.is_some() }
    }

    /// The longest file that can be read.
    pub(super) fn bytes(self) -> u64 {
        self.bytes
    }

    fn refuse(self, expected: &Expected, advice: &str) -> Failure {
        let limit = bytes(self.bytes);
        let of = if self.given { "the limit (--memory)" } else { "what there is (--memory SIZE sets another limit)" };
        Failure::new(format!("this render takes {}, and {limit} is {of}: {advice}", expected.sum()))
    }
}

/// A render's memory at its fullest.
#[derive(Clone, Debug)]
pub(super) struct Expected {
    /// The program and its threads with the scene, and what was made of it.
    scene: u64,
    film: u64,
    /// What the sampler keeps.
    sampler: u64,
    /// What comes one after the other, each when what was before it is gone.
    stages: Vec<(&'static str, u64)>,
    /// The most that there was before the film, or would be.
    before: u64,
}

impl Expected {
    /// Before the scene becomes a world, and sampler and filter are known: with the least film that there is.
    pub(super) fn of_scene(scene: &Scene, frame: &Frame) -> Self {
        let WorldMemory { built, building } = of_world(scene);
        let now = machine::resident().map_or_else(|| PROGRAM + of_scene(scene), |[now, _]| now);
        let film = frame.bytes(Film::bytes_per_pixel(&Needs::none()));
        Self { scene: now + built, film, sampler: 0, stages: Vec::new(), before: now + building }
    }

    /// When everything is made and nothing is traced.
    ///
    /// `files` are the bytes that making a file takes besides film and image, `keeps` whether the film is also kept as bytes.
    pub(super) fn of_render(before: &Self, memory: &Memory, files: u64, keeps: bool) -> Self {
        let [now, most] = machine::resident().unwrap_or([before.scene, 0]);
        let snapshot = if keeps { memory.snapshot() } else { 0 };
        let stages = vec![
            ("planning", memory.planning),
            (if keeps { "checkpoint" } else { "plan" }, memory.tracing.saturating_add(snapshot)),
            ("filter", memory.filter.applying),
            ("files", memory.filter.image.saturating_add(files)),
        ];
        let scene = now + THREAD * rayon::current_num_threads() as u64;
        Self { scene, film: memory.film, sampler: memory.sampler, stages, before: before.before.max(most) }
    }

    /// Refuses what does not fit.
    pub(super) fn check(&self, limit: Limit) -> Result<()> {
        if self.peak() <= limit.bytes {
            return self.check_address_space();
        }
        let with_film = self.scene.saturating_add(self.film);
        let advice = match self.largest_stage() {
            _ if self.before.max(self.scene) > limit.bytes => {
                "the scene alone does not fit; a simpler one, or more memory"
            }
            Some((name, _)) if name == "filter" && with_film <= limit.bytes => {
                "a smaller --resolution, --filter none, crops (--crop), or more memory"
            }
            _ => "a smaller --resolution, crops (--crop), or more memory",
        };
        Err(limit.refuse(self, advice))
    }

    /// Where no limit is known the system is asked for as much, and says at once if that is never to be had.
    fn check_address_space(&self) -> Result<()> {
        let fits = usize::try_from(self.film).ok().and_then(|film| Vec::<u8>::new().try_reserve_exact(film).ok());
        let refused = || Failure::new(format!("this render takes {}: smaller crops (--crop) fit", self.sum()));
        fits.ok_or_else(refused)
    }

    pub(super) fn peak(&self) -> u64 {
        let lasting = self.scene.saturating_add(self.film).saturating_add(self.sampler);
        lasting.saturating_add(self.largest_stage().map_or(0, |(_, bytes)| bytes)).max(self.before)
    }

    fn largest_stage(&self) -> Option<(&'static str, u64)> {
        self.stages.iter().copied().max_by_key(|&(_, bytes)| bytes)
    }

    /// All of it, then its parts.
    pub(super) fn sum(&self) -> String {
        let mut parts = vec![format!("scene {}", bytes(self.scene)), format!("film {}", bytes(self.film))];
        if self.sampler > 0 {
            parts.push(format!("sampler {}", bytes(self.sampler)));
        }
        parts.extend(self.largest_stage().map(|(name, size)| format!("{name} {}", bytes(size))));
        let peak = self.peak();
        if peak == self.before {
            parts = vec!["reading the scene and building its tree".to_owned()];
        }
        format!("{} ({})", bytes(peak), parts.join(", "))
    }

    /// What was expected beside what it was, for the summary.
    pub(super) fn line(&self) -> String {
        let taken = machine::resident().map_or_else(String::new, |[_, most]| format!("{} taken, ", bytes(most)));
        format!("memory: {taken}{} expected", self.sum())
    }
}
