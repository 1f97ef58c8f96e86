//! Planning of rounds that place samples in the boxes with the largest scores.

use super::{At, Cell, Cells, Division, Known, Leaf, leaves, seed_of};
use crate::method::{counts_so_far, total, with_extra};
use crate::recorders::{FilmSamples, Singles};
use crate::{Domain, Placed, PlacedHandle};
use dapple_core::plan::{Feedback, Plan, Progress, SamplerMemory, allocate};
use dapple_core::point_set::mix;
use dapple_core::{Error, Frame, Limits, Needs, PointSet, Sampler, film::Recorder, options::Options, parallel};
use std::mem;
use std::sync::Arc;

/// A rule that scores the boxes of its `Division`, and places samples in them.
pub trait Refinement: Division + Options + Copy + Send {
    /// The sampler's name.
    const NAME: &'static str;
    /// The side of a cell in pixels.
    const SIDE: u32;

    /// The dimensions in which samples are placed; all by default.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] for a domain that the method rejects.
    fn dimensions(&self, domain: &Domain) -> Result<Domain, Error> {
        Ok(domain.clone())
    }

    /// Returns `true` if the sampler spends the whole budget.
    fn is_exact(&self) -> bool {
        true
    }

    /// The samples per pixel of the pilot.
    fn pilot_samples(&self) -> u32;

    /// The coordinates of the pilot's sample `number` in a pixel; if `None`, they come from the point set. `seed` depends on
    /// the pixel.
    fn pilot_sample(&self, number: u32, seed: u64) -> Option<At> {
        let _ = (number, seed);
        None
    }

    /// The score of a box. Boxes get samples only if their score is above 0.
    fn score(&self, cell: &Cell, leaf: &Leaf<'_>) -> f64;

    /// The number of additional samples that lower the expected score of a box with `samples` samples from `score` to `level`.
    /// Falls as `level` rises.
    fn wanted(&self, score: f64, samples: u32, level: f64) -> u32;

    /// The fraction of the largest score down to which boxes get samples in a round, unless the round would be too small.
    fn least_share(&self) -> f64 {
        0.25
    }

    /// Appends at most `count` new samples of a box to `to`. `seed` depends on the box and the number of its samples.
    fn place(&self, cell: &Cell, leaf: &Leaf<'_>, count: u32, seed: u64, to: &mut Vec<At>);
}

/// A round has half a sample per pixel, or a quarter of the samples so far if that is more. The papers refine box by box.
const OF_PIXELS: u64 = 2;
const OF_SAMPLES: u64 = 4;
/// The pixels or the samples so far, whichever are more, divided by this number give the smallest round.
const LEAST: u64 = 16;

/// A sampler that places samples in the boxes with the largest scores.
pub struct TreeSampler<P, R> {
    points: Placed<P>,
    options: R,
    /// The boxes of each cell that may get samples.
    known: Known<Vec<Candidate>>,
}

/// A box that may get samples: its score, and its position among all boxes.
#[derive(Clone, Copy)]
struct Candidate {
    score: f64,
    cell: u32,
    leaf: u32,
    /// The number of samples in the box.
    samples: u32,
    /// The number of samples that the box gets.
    count: u32,
}

impl<P: PointSet, R: Refinement> Sampler for TreeSampler<P, R> {
    fn name(&self) -> &str {
        R::NAME
    }

    fn describe(&self) -> String {
        format!("{}:{}", R::NAME, self.options.describe())
    }

    fn recorders(&self) -> Vec<Arc<dyn Recorder>> {
        Singles::All.list()
    }

    /// The placed samples and a box per two samples. While a round is planned, also the boxes again, the new coordinates, and
    /// counts.
    fn memory(&self, frame: &Frame, needs: &Needs, limits: &Limits) -> SamplerMemory {
        let samples = limits.expected_samples(frame);
        let planned = samples / OF_SAMPLES * (size_of::<At>() + 8) as u64;
        let boxes = samples / 2 * size_of::<Candidate>() as u64;
        let mut memory = SamplerMemory::planning(frame, 64);
        let cells = Known::<Vec<Candidate>>::bytes(frame, R::SIDE);
        memory.state = self.points.domain().placed_bytes(frame, needs, limits).saturating_add(boxes + cells);
        memory.planning = memory.planning.saturating_add(planned).saturating_add(boxes);
        memory
    }

    fn points(&self) -> &dyn PointSet {
        &self.points
    }

    /// Plans the pilot, and then rounds of samples in the boxes with the largest scores. If the whole budget must be spent, the
    /// rest is spread evenly.
    fn next_round(&mut self, seen: &Feedback<'_>, plan: &mut Plan) -> Result<Progress, Error> {
        let samples = Singles::All.of(seen.film, R::NAME)?;
        if seen.round == 0 {
            self.points.clear();
            self.known.0.clear();
        }
        if seen.budget.left() == 0 {
            return Ok(Progress::Done);
        }
        let mut round = Round::new(seen, seed_of(&self.points));
        self.plan_pilot(seen, &mut round)?;
        if round.total == 0 {
            self.plan_boxes(seen, &samples, &mut round)?;
            if self.options.is_exact() {
                round.fill(seen)?;
            }
        }
        self.points.publish();
        plan.counts = round.counts;
        Ok(if plan.total() == 0 { Progress::Done } else { Progress::Trace })
    }

    fn save(&self) -> Vec<u8> {
        self.points.save()
    }

    fn restore(&mut self, saved: &[u8]) -> Result<(), Error> {
        self.known.0.clear();
        self.points.restore(saved)
    }
}

impl<P: PointSet, R: Refinement> TreeSampler<P, R> {
    /// Creates a sampler that takes all coordinates outside `domain` from this point set.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] for the first parameter out of range, and for a domain that the method rejects.
    pub fn new(points: P, domain: &Domain, options: R) -> Result<Self, Error> {
        options.check_ranges()?;
        let domain = options.dimensions(domain)?;
        Ok(Self { points: Placed::new(points, domain), options, known: Known::default() })
    }

    /// The samples placed by this sampler, for filters.
    pub fn placed(&self) -> PlacedHandle {
        self.points.handle()
    }

    /// Plans the samples that pixels lack for the pilot.
    fn plan_pilot(&mut self, seen: &Feedback<'_>, round: &mut Round) -> Result<(), Error> {
        let pilot = self.options.pilot_samples().max(seen.budget.min_spp).min(seen.budget.max_spp);
        let least = seen.budget.min_spp;
        let lacking: u64 = round.now.iter().map(|&now| u64::from(pilot.saturating_sub(now))).sum();
        if lacking == 0 {
            return Ok(());
        }
        let floors: Vec<u32> = round.now.iter().map(|&now| now.max(least)).collect();
        let scores: Vec<f64> = round.now.iter().map(|&now| f64::from(u8::from(now < pilot))).collect();
        let total = total(&round.now) + lacking.min(seen.budget.left());
        let wanted = allocate(&scores, &floors, pilot.max(floors.iter().copied().max().unwrap_or(0)), total)?.counts;
        for (i, &wanted) in wanted.iter().enumerate() {
            for number in round.now[i]..wanted {
                let seed = mix(round.seed ^ mix(i as u64));
                match self.options.pilot_sample(number, seed) {
                    Some(at) => self.add(seen, round, i, &at)?,
                    None => round.take(i),
                }
            }
        }
        Ok(())
    }

    /// Places samples in the boxes with the largest scores.
    fn plan_boxes(&mut self, seen: &Feedback<'_>, samples: &FilmSamples<'_>, round: &mut Round) -> Result<(), Error> {
        let cells = Cells::new(seen.frame(), R::SIDE);
        let chosen = self.choose(seen, samples, cells);
        let of_cell: Vec<&[Candidate]> = chosen.chunk_by(|a, b| a.cell == b.cell).collect();
        let seed = round.seed;
        let size = seen.frame().size();
        let placed = parallel::map(of_cell.len(), |k| {
            let (cell, chosen) = (&mut Cell::default(), of_cell[k]);
            let number = chosen[0].cell as usize;
            cells.read(number, samples, &self.points, self.points.domain(), cell);
            let (cell, mut places, mut leaf, mut next) = (&*cell, Vec::new(), 0, 0);
            leaves(&self.options, cell, &mut |at| {
                if let Some(&Candidate { count, .. }) = chosen.get(next).filter(|c| c.leaf == leaf) {
                    let name = mix(seed ^ mix(number as u64 ^ u64::from(leaf) << 32)) ^ mix(cell.at.len() as u64);
                    self.options.place(cell, at, count, name, &mut places);
                    next += 1;
                }
                leaf += 1;
            });
            places.iter().map(|at| pixel_of(size, cell.corner, at)).collect::<Vec<_>>()
        });
        for (pixel, inside) in placed.into_iter().flatten() {
            let i = pixel[1] as usize * size[0] as usize + pixel[0] as usize;
            if round.total < seen.budget.left() && round.now[i] + round.counts[i] < seen.budget.max_spp {
                self.add(seen, round, i, &inside)?;
            }
        }
        Ok(())
    }

    /// The boxes that get samples in this round, in the order of cells and boxes.
    fn choose(&mut self, seen: &Feedback<'_>, recorded: &FilmSamples<'_>, cells: Cells) -> Vec<Candidate> {
        let (budget, rule) = (seen.budget, self.options);
        self.known.refresh(cells, recorded, &self.points, self.points.domain(), |number, cell| {
            let (mut boxes, mut leaf) = (Vec::new(), 0);
            leaves(&rule, cell, &mut |at| {
                let (score, samples) = (rule.score(cell, at), at.items.len() as u32);
                if score > 0.0 {
                    boxes.push(Candidate { score, cell: number as u32, leaf, samples, count: 0 });
                }
                leaf += 1;
            });
            boxes
        });
        let is_open = |cell: usize| cells.pixels(cell).any(|i| seen.film.count(i) < u64::from(budget.max_spp));
        let open = self.known.0.iter().enumerate().filter(|(cell, _)| is_open(*cell));
        let mut all: Vec<Candidate> = open.flat_map(|(_, (_, boxes))| boxes).copied().collect();
        let step = (seen.pixels() as u64 / OF_PIXELS).max(budget.spent / OF_SAMPLES).max(1).min(budget.left());
        let least = (seen.pixels() as u64).max(budget.spent).div_ceil(LEAST).min(step);
        let level = rule.least_share() * all.iter().map(|c| c.score).fold(0.0, f64::max);
        let high: u64 = all.iter().map(|c| u64::from(rule.wanted(c.score, c.samples, level))).sum();
        hand_out(&rule, &mut all, high.clamp(least, step));
        all.retain(|candidate| candidate.count > 0);
        all
    }

    /// Places the next sample of pixel `i`.
    fn add(&mut self, seen: &Feedback<'_>, round: &mut Round, i: usize, at: &At) -> Result<(), Error> {
        let half = round.half(i);
        let id = seen.film.sample_id(half, i, round.taken[i][half] as usize);
        round.take(i);
        self.points.add(seen.frame(), id, &at[..self.points.domain().axes().len()])
    }
}

/// The pixel of a point in a cell, and the position in that pixel. A point that rounding moved beyond the cell stays in the
/// last pixel.
fn pixel_of(size: [u32; 2], corner: [u32; 2], at: &At) -> ([u32; 2], At) {
    let (mut pixel, mut inside) = ([0; 2], *at);
    for axis in 0..2 {
        pixel[axis] = (corner[axis] + at[axis] as u32).min(size[axis] - 1);
        inside[axis] = (at[axis] - (pixel[axis] - corner[axis]) as f32).min(1.0_f32.next_down());
    }
    (pixel, inside)
}

/// Distributes `step` samples so that the largest expected score afterwards is as small as possible. The result equals refining
/// the box with the largest score, one sample at a time. Boxes that tie for the last samples get them in their order.
fn hand_out(rule: &impl Refinement, all: &mut [Candidate], step: u64) {
    let wanted = |c: &Candidate, level: u64| rule.wanted(c.score, c.samples, f64::from_bits(level));
    let part = |some: &[Candidate], level: u64| some.iter().map(|c| u64::from(wanted(c, level))).sum::<u64>();
    let total = |level: u64| -> u64 {
        let parts: Vec<&[Candidate]> = all.chunks(4096).collect();
        parallel::map(parts.len(), |k| part(parts[k], level)).iter().sum()
    };
    // The bits of positive floats are in numerical order. At `high` at most `step` samples are needed.
    let (mut low, mut high) = (0, f64::MAX.to_bits());
    if total(1) > step {
        while high - low > 1 {
            let middle = low + (high - low) / 2;
            if total(middle) > step { low = middle } else { high = middle }
        }
    } else {
        (low, high) = (1, 1);
    }
    let mut left = step;
    for candidate in &mut *all {
        candidate.count = wanted(candidate, high);
        left -= u64::from(candidate.count);
    }
    for candidate in all {
        let more = u64::from(wanted(candidate, low) - candidate.count).min(left);
        candidate.count += more as u32;
        left -= more;
    }
}

/// The sample counts of a round while it is planned.
struct Round {
    seed: u64,
    /// The kept samples of each pixel before the round; `counts` holds the samples that the round adds.
    now: Vec<u32>,
    counts: Vec<u32>,
    total: u64,
    /// The number of samples in each half.
    taken: Vec<[u64; 2]>,
    halves: bool,
}

impl Round {
    fn new(seen: &Feedback<'_>, seed: u64) -> Self {
        let (film, pixels) = (seen.film, seen.pixels());
        let taken = |i| [0, 1].map(|half| film.half(half, i).map_or(film.count(i), |moments| moments.count));
        let (now, taken) = (counts_so_far(seen), (0..pixels).map(taken).collect());
        Self { seed, now, counts: vec![0; pixels], total: 0, taken, halves: film.needs().halves }
    }

    /// The half of pixel `i`'s next sample: the half with fewer samples, as in the render loop.
    fn half(&self, i: usize) -> usize {
        usize::from(self.halves && self.taken[i][1] < self.taken[i][0])
    }

    /// Adds a sample to pixel `i`.
    fn take(&mut self, i: usize) {
        let half = self.half(i);
        self.taken[i][half] += 1;
        self.counts[i] += 1;
        self.total += 1;
    }

    /// Spreads leftover samples of a small round evenly: the whole rest of the budget if the boxes got nothing, else the
    /// samples lost by pixels at their ceiling.
    fn fill(&mut self, seen: &Feedback<'_>) -> Result<(), Error> {
        let left = seen.budget.left();
        let target = if self.total == 0 { left } else { (seen.pixels() as u64 / OF_PIXELS).min(left) };
        if seen.budget.max_spp < u32::MAX || self.total == 0 {
            self.counts = with_extra(seen, mem::take(&mut self.counts), target.saturating_sub(self.total))?;
        }
        Ok(())
    }
}
