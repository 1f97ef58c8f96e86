//! What one sample is worth.

use crate::Draws;
use rayon::prelude::*;

/// The cluster label of a ray that meets nothing.
pub const BACKGROUND: u32 = u32::MAX;

/// The first surface a sample met. The integrator reports it; samplers and filters label it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FirstHit {
    /// Where, in the integrator's own units.
    pub position: [f32; 3],
    /// Unit normal of the geometry, on the side the ray came from.
    pub geometric_normal: [f32; 3],
    /// Unit shading normal, on the side the ray came from.
    pub shading_normal: [f32; 3],
    /// Share of light reflected, linear RGB in `[0, 1]`; 1 for emitters, clear glass and mirrors.
    pub albedo: [f32; 3],
    /// Distance along the ray, in the units of `position`.
    pub depth: f32,
    /// Width of a pixel at the hit, in the units of `position`.
    pub footprint: f32,
    /// Microfacet roughness in `[0, 1]`: 0 a mirror, 1 diffuse.
    pub roughness: f32,
    /// The integrator's number for the material.
    pub material: u32,
    /// The integrator's number for the shape (mesh, sphere, …).
    pub shape: u32,
    /// The triangle within the shape; 0 for shapes that are one piece.
    pub primitive: u32,
}

impl FirstHit {
    /// Whether every number is one. A hit that is not counts as a miss.
    pub(crate) fn is_finite(&self) -> bool {
        let Self { position, geometric_normal, shading_normal, albedo, depth, footprint, roughness, .. } = self;
        let vectors = [position, geometric_normal, shading_normal, albedo];
        vectors.into_iter().flatten().chain([depth, footprint, roughness]).all(|v| v.is_finite())
    }
}

/// What one sample found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Radiance estimate, linear RGB, finite and not negative; anything else is rejected and counted.
    pub radiance: [f32; 3],
    /// The first hit, if [`Draws::wants_first_hit`] asks for it and the sample met a surface. One with
    /// a NaN or an infinity in it counts as a miss.
    pub first_hit: Option<FirstHit>,
    /// What the sample cost, in rays.
    pub cost: u32,
}

/// Estimates a pixel from one sample's coordinates. Knows no sampler.
pub trait Integrator: Sync {
    /// One estimate of the radiance of pixel `draws.pixel()`: a pure function of the coordinates (and
    /// of what was learned in finished rounds).
    fn estimate(&self, draws: &Draws<'_>, observed: &mut TrainingLog) -> Estimate;

    /// Whether this integrator writes to [`TrainingLog`] and wants [`Integrator::learn`] called. Asked anew
    /// after each training pass: one that has learned enough says so, and costs no more.
    fn wants_training(&self) -> bool {
        false
    }

    /// Called at the barrier after a training pass with everything observed in it, merged in a fixed order:
    /// what is learned does not depend on threads. A training pass is one sample a pixel at first, then as
    /// many as were traced before it, and at most what is left of the round: 1, 1, 2, 4, … where
    /// rounds are long.
    ///
    /// What is learned must follow from the training passes alone: a render that is resumed from a [`Snapshot`](crate::Snapshot)
    /// takes them again, in their order, without a sample traced. So there is nothing else to save.
    fn learn(&mut self, pass: &TrainingData) {
        let _ = pass;
    }
}

/// What an integrator notes down while it traces, under keys of its own.
#[derive(Debug, Default)]
pub struct TrainingLog {
    notes: Vec<(u64, f32)>,
}

impl TrainingLog {
    /// Notes a value. Non-finite values are dropped.
    #[inline]
    pub fn note(&mut self, key: u64, value: f32) {
        if value.is_finite() {
            self.notes.push((key, value));
        }
    }

    /// Sums the notes up by key, in the order in which they were made, and forgets them.
    pub(crate) fn summarise(&mut self) -> Vec<TrainingSum> {
        self.notes.sort_by_key(|n| n.0);
        let mut sums: Vec<TrainingSum> = Vec::new();
        for &(key, value) in &self.notes {
            let value = f64::from(value);
            let note = TrainingSum { key, count: 1, sum: value, sum_of_squares: value * value };
            match sums.last_mut() {
                Some(last) if last.key == key => last.add(&note),
                _ => sums.push(note),
            }
        }
        self.notes.clear();
        sums
    }
}

/// Everything noted under one key in one training pass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrainingSum {
    /// The integrator's key.
    pub key: u64,
    /// How many values were noted.
    pub count: u64,
    /// Their sum.
    pub sum: f64,
    /// The sum of their squares.
    pub sum_of_squares: f64,
}

impl TrainingSum {
    fn add(&mut self, other: &TrainingSum) {
        self.count += other.count;
        self.sum += other.sum;
        self.sum_of_squares += other.sum_of_squares;
    }
}

/// All observations of a training pass, sorted by key. Sums were made in blocks of 16x16 pixels, added up in order along rows
/// of blocks, and then row by row, so they are the same bits for any number of threads.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TrainingData {
    entries: Vec<TrainingSum>,
}

impl TrainingData {
    /// Merges sums of parts of the image, which must come in their order.
    pub(crate) fn merge(parts: &[Vec<TrainingSum>]) -> Self {
        Self::merged(parts, |entries| entries.par_sort_by_key(|e| e.key))
    }

    /// The same on the thread that asks: a task that waited for help would begin others meanwhile.
    pub(crate) fn merge_here(parts: &[Vec<TrainingSum>]) -> Self {
        Self::merged(parts, |entries| entries.sort_by_key(|e| e.key))
    }

    /// `sort` is stable: equal keys stay in order. A tree would take several times as long.
    fn merged(parts: &[Vec<TrainingSum>], sort: impl FnOnce(&mut [TrainingSum])) -> Self {
        let mut entries = parts.concat();
        sort(&mut entries);
        entries.dedup_by(|next, kept| {
            let same = next.key == kept.key;
            if same {
                kept.add(next);
            }
            same
        });
        // Kept for long, and mostly much shorter now.
        entries.shrink_to_fit();
        Self { entries }
    }

    /// These entries, if their keys ascend.
    pub(crate) fn sorted(entries: Vec<TrainingSum>) -> Option<Self> {
        entries.is_sorted_by(|a, b| a.key < b.key).then_some(Self { entries })
    }

    pub(crate) fn into_entries(self) -> Vec<TrainingSum> {
        self.entries
    }

    /// The entries, in ascending order of key.
    pub fn entries(&self) -> &[TrainingSum] {
        &self.entries
    }
}
