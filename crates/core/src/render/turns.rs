//! The order of a pixel's samples in a round, and the counts of the task that traces them.

use super::feature_samples::Cost;
use crate::film::{EmissionAlone, REJECTED_LISTED, Splats, Strip, keep_first};
use crate::plan::{Plan, Retention};
use crate::{Film, SampleId, film::Rejected, point_set::streams};

/// The streams of a round's samples, for each half.
pub(super) fn streams_of(retention: Retention, halves: bool) -> [u32; 2] {
    match (retention, halves) {
        (Retention::Keep, false) => [streams::WHOLE; 2],
        (Retention::Keep, true) => streams::HALVES,
        (Retention::Discard, false) => [streams::DISCARDED; 2],
        (Retention::Discard, true) => streams::DISCARDED_HALVES,
    }
}

/// The division of a pixel's samples between two halves.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Order {
    /// There is one half.
    Whole,
    /// Samples go to the half that has fewer, and alternate once both have equally many.
    Alternating,
    /// Each half has its own count. Samples alternate until the smaller count is reached.
    Counts,
}

impl Order {
    pub(super) fn of(plan: &Plan, halves: bool) -> Self {
        match (halves, &plan.second_half) {
            (false, _) => Self::Whole,
            (true, None) => Self::Alternating,
            (true, Some(_)) => Self::Counts,
        }
    }
}

/// The samples of one pixel that a task traces, in order.
#[derive(Clone, Copy)]
pub(super) struct Turns {
    /// The number of samples, and the number for the second half if each half has its own count.
    pub(super) counts: [u32; 2],
    /// The index of the next sample in each stream.
    pub(super) next: [u64; 2],
    /// The number of samples by which the first half leads at the start.
    pub(super) lead: i64,
}

impl Turns {
    /// Samples `start..end` of pixel `i` of the plan, which is pixel `local` of the strip.
    #[inline]
    pub(super) fn new(plan: &Plan, i: usize, [start, end]: [u32; 2], strip: &Strip<'_>, local: usize) -> Self {
        let planned = [plan.counts[i], plan.second_half.as_ref().map_or(0, |second| second[i])];
        let [a, b] = strip.counts(local);
        let counts = planned.map(|count| count.min(end) - count.min(start));
        Self { counts, next: strip.next(local), lead: a as i64 - b as i64 }
    }

    #[inline]
    pub(super) fn total(&self) -> u32 {
        self.counts[0] + self.counts[1]
    }

    /// The number of samples of each half.
    pub(super) fn halves(&self, order: Order) -> [u64; 2] {
        let [first, second] = self.counts.map(u64::from);
        match order {
            Order::Whole | Order::Counts => [first, second],
            Order::Alternating => {
                let own = (first as i64 - self.lead + 1).div_euclid(2).clamp(0, first as i64) as u64;
                [own, first - own]
            }
        }
    }

    /// The half and the index of sample number `turn`.
    #[inline]
    pub(super) fn sample(&self, order: Order, turn: u32) -> (usize, u64) {
        match order {
            Order::Whole => (0, self.next[0] + u64::from(turn)),
            Order::Alternating => {
                let behind = usize::from(self.lead > 0);
                let level = u64::from(turn).checked_sub(self.lead.unsigned_abs());
                let Some(after) = level else { return (behind, self.next[behind] + u64::from(turn)) };
                let half = (after & 1) as usize;
                let before = if half == behind { self.lead.unsigned_abs() } else { 0 };
                (half, self.next[half] + before + after / 2)
            }
            Order::Counts => {
                let both = self.counts[0].min(self.counts[1]);
                if turn < 2 * both {
                    let half = (turn & 1) as usize;
                    return (half, self.next[half] + u64::from(turn / 2));
                }
                let half = usize::from(self.counts[1] > self.counts[0]);
                (half, self.next[half] + u64::from(turn - both))
            }
        }
    }
}

/// The sums of a task besides the planes of its pixels.
#[derive(Default)]
pub(super) struct Tally {
    /// The number of samples in each half.
    samples: [u64; 2],
    rays: u64,
    blocks: u64,
    /// The number of samples that report neither a hit nor a miss, though the film records hits.
    pub(super) unreported: u64,
    /// The number of rejected samples.
    rejections: u64,
    /// The first rejected samples in order of pixel, stream and index; fewer than twice the number that the film lists.
    rejected: Vec<Rejected>,
    /// The first rejected sample in the order of tracing, with its radiance.
    pub(super) first_rejected: Option<(SampleId, [f32; 3])>,
    /// Half, pixel and radiance of splats.
    splats: Vec<(usize, [u32; 2], [f32; 3])>,
    /// Pixel and emission at the edges of light sources.
    lamp_edges: Vec<([u32; 2], EmissionAlone)>,
}

impl Tally {
    /// Keeps a splat of a kept sample, or rejects it.
    #[cold]
    pub(super) fn splat(&mut self, sample: SampleId, half: usize, pixel: [u32; 2], radiance: [f32; 3]) {
        match Splats::reason_to_reject(radiance) {
            Some(reason) => self.reject(Rejected { sample, reason }, radiance),
            None => self.splats.push((half, pixel, radiance)),
        }
    }

    /// Counts and lists a rejected sample. Not inlined, because it is rare. The list holds at most twice as many samples
    /// as the film's list.
    #[cold]
    #[inline(never)]
    pub(super) fn reject(&mut self, rejected: Rejected, value: [f32; 3]) {
        self.rejections += 1;
        self.first_rejected.get_or_insert((rejected.sample, value));
        self.rejected.push(rejected);
        if self.rejected.len() == 2 * REJECTED_LISTED {
            keep_first(&mut self.rejected);
        }
    }

    /// Counts a sample.
    #[inline]
    pub(super) fn count(&mut self, half: usize, rays: u32, blocks: u32) {
        self.samples[half] += 1;
        self.add_cost(&Cost { rays: u64::from(rays), blocks: u64::from(blocks) });
    }

    #[inline]
    pub(super) fn add_cost(&mut self, cost: &Cost) {
        self.rays += cost.rays;
        self.blocks += cost.blocks;
    }

    /// Adds the cost and the emission of a pixel's feature-only samples.
    pub(super) fn add_features(&mut self, pixel: [u32; 2], (cost, alone): (Cost, Option<EmissionAlone>)) {
        self.add_cost(&cost);
        self.lamp_edges.extend(alone.map(|alone| (pixel, alone)));
    }

    pub(super) fn total(&self) -> u64 {
        self.samples.iter().sum()
    }

    /// Adds all counts to a film.
    pub(super) fn add_to(self, film: &mut Film, retention: Retention) {
        film.record.samples += self.total();
        film.record.rays += self.rays;
        film.record.blocks += self.blocks;
        film.unreported += self.unreported;
        self.splats.into_iter().for_each(|(half, pixel, radiance)| film.splats.add(half, pixel, radiance));
        self.lamp_edges.into_iter().for_each(|(pixel, alone)| film.lamp_edges.set(&film.frame, pixel, alone));
        if retention == Retention::Keep {
            film.splats.count(self.samples);
        }
        if self.rejections > 0 {
            film.list_rejected(self.rejections, self.rejected);
        }
    }
}
