//! A frequency-based sampler and its filter. Samples go where cosines fitted to blocks of pixels leave the largest error.

mod cosines;

pub use cosines::{CosineOptions, CosineScale};

use crate::method::{FilterMethod, MethodFilter, counts_so_far, total};
use crate::recorders::{FilmSamples, Singles};
use crate::tree::{Cell, Cells, Known, image_of_cells, seed_of};
use crate::{Domain, FilmPoints};
use cosines::{Fit, SIDE, masking, weight};
use dapple_core::options::Options as _;
use dapple_core::plan::{Feedback, PilotPolicy, Plan, Progress, SamplerMemory, allocate};
use dapple_core::point_set::mix;
use dapple_core::{Error, Film, Filtered, Frame, Limits, Needs, PointSet, Sampler, film::Recorder, parallel};
use std::sync::Arc;

dapple_core::options! {
    /// The parameters of [`Dct`].
    pub struct DctOptions {
        /// Pilot samples per 2x2 pixels; more if --min-spp requires them.
        pub pilot: u32 = 1, |n| (1..=1024).contains(&n), "1 to 1024 samples";
        /// A block's cosines are fitted again once its samples have grown by this fraction.
        pub growth: f64 = 0.5, |growth| (0.01..=4.0).contains(&growth), "0.01 to 4";
        /// 1: weight errors by the eye's sensitivity to their frequency (JPEG's tables); 0: weight all equally.
        pub visible: u8 = 1, |visible| visible <= 1, "0 or 1";
        /// Exponent of the masking of errors by luminance; 0: no masking.
        pub masking: f64 = 0.65, |exponent| (0.0..=4.0).contains(&exponent), "0 to 4";
        /// keep: samples used to set counts stay in the image (biased, as published); the only value.
        pub policy: PilotPolicy = PilotPolicy::Keep => "keep",
            |policy| policy == PilotPolicy::Keep, "only keep";
    }
}

/// The side of a cell in pixels. Samples are planned per cell.
const CELL: u32 = 2;

/// The least error of a cell, as a fraction of the mean error.
const LEAST: f64 = 0.01;

/// The largest error of a cell, so that sums and scores stay finite.
const HIGHEST: f64 = 1e200;

/// The fraction of a block's squared luminance below which deviations are rounding errors.
const ROUNDING: f64 = 1e-12;

/// A sampler that adds samples where cosines fitted to blocks leave the largest visible error [after Bolin and Meyer 1995].
///
/// Blocks of 8x8 pixels start with one sample in each cell of 2x2 pixels, or more if `--min-spp` is above 0. Luminance and two
/// colour differences of each block are fitted by cosines, the lowest frequencies first. Luminance has half as many cosines as
/// the block has samples, and each colour difference a quarter. A cell's error is the mean squared deviation of its samples
/// from the fit, plus the energy expected in the first frequencies that the fit leaves out. This energy is extrapolated from
/// lower frequencies by `1 / frequency^2`. Errors are weighted by the eye's sensitivity to these frequencies, and masked by the
/// block's luminance. The next sample goes to the cell whose error it reduces most. Between two fits, the sample count of a
/// block grows at most by [`DctOptions::growth`].
///
/// The number of cosines and the refinement by frequency are from the paper. Dapple adds the opponent colour space, the penalty
/// `lambda`, JPEG's tables as sensitivity, and masking. It also counts the block's mean squared deviation as one more sample of
/// each cell. For `n` samples so far, a round adds at most `max(growth n / 2, blocks)` samples.
///
/// The image is made by [`DctFilter`].
///
/// *Guarantees*: spends the budget exactly. A cell's error is at least 1 % of the mean error. *Bias*: the values of samples
/// determine where later ones lie, and all samples are kept [Kirk and Arvo 1991]. *Weaknesses*: the fit mistakes noise for
/// detail. Sensitivity and masking leave busy and bright regions coarse, which raises the squared error.
pub struct Dct<P> {
    points: P,
    domain: Domain,
    options: DctOptions,
    cosines: CosineOptions,
    known: Known<BlockErrors>,
}

/// The fitted errors of one block.
#[derive(Clone, Debug, Default)]
struct BlockErrors {
    samples: usize,
    luminance: f64,
    /// The number of each cell, and the cell's squared error before masking.
    cells: Vec<(u32, f64)>,
}

impl BlockErrors {
    /// The masked error of each cell, in an image of this mean luminance.
    fn errors(&self, mean: f64, exponent: f64) -> impl Iterator<Item = f64> {
        let mask = masking(self.luminance, mean, exponent);
        self.cells.iter().map(move |&(_, error)| (mask * error).min(HIGHEST))
    }
}

/// A sample that a cell may get: the error that the sample would remove, and the cell's number.
type Gain = (f64, u32);

impl<P: PointSet> Dct<P> {
    /// Creates a sampler over `points`; `domain` gives the meaning of their dimensions.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] for the first parameter out of range.
    pub fn new(points: P, domain: &Domain, options: DctOptions, cosines: CosineOptions) -> Result<Self, Error> {
        options.check_ranges()?;
        cosines.check_ranges()?;
        Ok(Self { points, domain: domain.place(), options, cosines, known: Known::default() })
    }

    /// Plans the samples that cells and pixels still lack for the pilot and for their floors.
    fn plan_pilot(&self, seen: &Feedback<'_>, round: &mut Round) -> Result<(), Error> {
        let cells = Cells::new(seen.frame(), CELL);
        let (least, most) = (seen.budget.min_spp, seen.budget.max_spp);
        let (mut floors, mut scores, mut total) = (Vec::new(), Vec::new(), round.kept());
        for number in 0..cells.count() {
            let (mut now, mut floor, mut room) = (0u32, 0u32, 0u32);
            for i in cells.pixels(number) {
                now = now.saturating_add(round.now[i]);
                floor = floor.saturating_add(round.now[i].max(least));
                room = room.saturating_add(most);
            }
            let wanted = self.options.pilot.min(room).max(floor);
            total += u64::from(wanted - now);
            scores.push(f64::from(u8::from(floor < wanted)));
            floors.push(floor);
        }
        let total = total.min(round.kept() + seen.budget.left());
        let ceiling = floors.iter().copied().fold(self.options.pilot, u32::max);
        let counts = allocate(&scores, &floors, ceiling, total)?.counts;
        for (number, count) in counts.into_iter().enumerate() {
            let more = cells.pixels(number).fold(count, |more, i| more.saturating_sub(round.now[i]));
            round.give(cells, number, more, seen);
        }
        Ok(())
    }

    /// The samples that each block may get before it is fitted again, each with the error that it would remove.
    fn gains(&self, seen: &Feedback<'_>, now: &[u32]) -> Vec<Gain> {
        let (cells, exponent) = (Cells::new(seen.frame(), CELL), self.options.masking);
        let known = || self.known.0.iter().map(|(_, known)| known);
        let mean = known().map(|known| known.luminance).sum::<f64>() / self.known.0.len() as f64;
        let sum: f64 = known().flat_map(|known| known.errors(mean, exponent)).sum();
        // Without errors, all pixels have the same score.
        let least = if sum > 0.0 { LEAST * sum / cells.count() as f64 } else { 1.0 };
        let gains = |(_, known): &(_, BlockErrors)| {
            let open = known.cells.iter().zip(known.errors(mean, exponent));
            let mut open: Vec<Open> = open
                .map(|(&(number, _), error)| {
                    let (mut pixels, mut samples, mut room) = (0, 0u32, 0);
                    for i in cells.pixels(number as usize) {
                        pixels += 1;
                        samples = samples.saturating_add(now[i]);
                        room += u64::from(seen.budget.max_spp.saturating_sub(now[i]));
                    }
                    // With n samples, the squared errors of the cell's pixels sum to pixels^2 * error / n.
                    Open { number, score: f64::from(pixels * pixels) * error.max(least), samples, room }
                })
                .collect();
            let quota = libm::ceil(self.options.growth * known.samples as f64);
            greedy(&mut open, quota.max(1.0) as u64)
        };
        parallel::map(self.known.0.len(), |i| gains(&self.known.0[i])).into_iter().flatten().collect()
    }

    /// Fits the blocks whose samples have changed, and plans a round of the samples that remove the most error.
    fn plan_round(&mut self, seen: &Feedback<'_>, recorded: &FilmSamples<'_>, round: &mut Round) {
        let (columns, visible) = (seen.frame().size()[0].div_ceil(CELL), self.options.visible == 1);
        let errors = |_, block: &Cell| errors(block, columns, &self.cosines, visible);
        self.known.refresh(Cells::new(seen.frame(), SIDE), recorded, &self.points, &self.domain, errors);
        let mut gains = self.gains(seen, &round.now);
        let step = (0.5 * self.options.growth * round.kept() as f64) as u64;
        let step = step.max(self.known.0.len() as u64).min(seen.budget.left());
        let step = usize::try_from(step).unwrap_or(usize::MAX);
        if step < gains.len() {
            let tie = |cell: u32| mix(round.seed ^ u64::from(cell));
            let order = |a: &Gain, b: &Gain| b.0.total_cmp(&a.0).then_with(|| tie(a.1).cmp(&tie(b.1)));
            gains.select_nth_unstable_by(step, order);
            gains.truncate(step);
        }
        let cells = Cells::new(seen.frame(), CELL);
        let mut counts = vec![0; cells.count()];
        gains.iter().for_each(|&(_, cell)| counts[cell as usize] += 1);
        for (number, count) in counts.into_iter().enumerate() {
            round.give(cells, number, count, seen);
        }
    }
}

/// The errors of a block's cells; `columns` is the number of cells in a row of the image.
fn errors(block: &Cell, columns: u32, cosines: &CosineOptions, visible: bool) -> BlockErrors {
    let [width, height] = block.size.map(|n| n.div_ceil(CELL));
    let number = |i: u32| (block.corner[1] / CELL + i / width) * columns + block.corner[0] / CELL + i % width;
    let Some(fit) = Fit::new(block, cosines) else {
        let cells = (0..width * height).map(|i| (number(i), 0.0)).collect();
        return BlockErrors { cells, ..BlockErrors::default() };
    };
    // For each cell, the squared deviations of its samples from the fit, summed per channel, and the number of samples.
    let mut cells = vec![[0.0; 4]; (width * height) as usize];
    for (at, &value) in block.at.iter().zip(&block.values) {
        let (fitted, colour) = (fit.at(at), cosines.scale.opponent(value));
        let [x, y] = [at[0], at[1]].map(|x| x as u32 / CELL);
        let cell = &mut cells[(y * width + x) as usize];
        cell[3] += 1.0;
        (0..3).for_each(|c| cell[c] += (colour[c] - fitted[c]).powi(2));
    }
    let luminance = fit.coefficients[0][0].max(0.0);
    let mut errors = vec![0.0; cells.len()];
    for c in 0..3 {
        let samples = block.at.len() as f64;
        let mean = cells.iter().map(|cell| cell[c]).sum::<f64>() / samples;
        // Fitted coefficients absorb a part of the deviations.
        let taken_up = samples / (samples - fit.coefficients[c].len() as f64).max(1.0);
        let (expected, weight) = (fit.expected_energy(c), if visible { weight(&fit, c) } else { 1.0 });
        for (error, cell) in errors.iter_mut().zip(&cells) {
            let square = (cell[c] + mean) / (cell[3] + 1.0) * taken_up + expected;
            *error += if square > ROUNDING * luminance * luminance { weight * square } else { 0.0 };
        }
    }
    BlockErrors { samples: block.at.len(), luminance, cells: (0..).map(number).zip(errors).collect() }
}

/// A cell that may get samples. `room` is the number of samples that its pixels can still take.
struct Open {
    number: u32,
    score: f64,
    samples: u32,
    room: u64,
}

/// The next `quota` samples of a block: each goes to the cell whose error `score / samples` falls most.
fn greedy(cells: &mut [Open], quota: u64) -> Vec<Gain> {
    let gain = |cell: &Open| {
        let n = f64::from(cell.samples);
        if cell.samples == 0 { f64::MAX } else { cell.score / (n * (n + 1.0)) }
    };
    let mut gains = Vec::new();
    for _ in 0..quota {
        let open = cells.iter_mut().filter(|cell| cell.room > 0);
        // Among equal cells, the first.
        let best = open.reduce(|best, cell| if gain(cell) > gain(best) { cell } else { best });
        let Some(best) = best else { break };
        gains.push((gain(best), best.number));
        best.samples = best.samples.saturating_add(1);
        best.room -= 1;
    }
    gains
}

/// The sample counts of a round while it is planned.
struct Round {
    seed: u64,
    /// The samples of each pixel before the round; `counts` holds the samples that the round adds.
    now: Vec<u32>,
    counts: Vec<u32>,
}

impl Round {
    /// The number of samples before the round.
    fn kept(&self) -> u64 {
        total(&self.now)
    }

    /// Adds samples to a cell, one by one to its pixel with the fewest samples below the ceiling. Ties are broken at random.
    fn give(&mut self, cells: Cells, number: usize, count: u32, seen: &Feedback<'_>) {
        for _ in 0..count {
            let samples = |i: usize| self.now[i].saturating_add(self.counts[i]);
            let turn = |i: usize| mix(self.seed ^ mix(i as u64) ^ u64::from(samples(i)) << 40);
            let open = cells.pixels(number).filter(|&i| samples(i) < seen.budget.max_spp);
            let Some(i) = open.min_by_key(|&i| (samples(i), turn(i))) else { return };
            self.counts[i] += 1;
        }
    }
}

impl<P: PointSet> Sampler for Dct<P> {
    fn name(&self) -> &str {
        "dct"
    }

    fn describe(&self) -> String {
        format!("{}:{},{}", self.name(), self.options.describe(), self.cosines.describe())
    }

    fn recorders(&self) -> Vec<Arc<dyn Recorder>> {
        Singles::All.list()
    }

    fn memory(&self, frame: &Frame, _: &Needs, limits: &Limits) -> SamplerMemory {
        let cells = Cells::new(frame, CELL).count() * size_of::<(u32, f64)>();
        let gains = limits.expected_samples(frame) as f64 * self.options.growth * size_of::<Gain>() as f64;
        let mut memory = SamplerMemory::planning(frame, 16);
        memory.state = cells as u64 + Known::<BlockErrors>::bytes(frame, SIDE);
        memory.planning = memory.planning.saturating_add(gains as u64);
        memory
    }

    fn points(&self) -> &dyn PointSet {
        &self.points
    }

    fn next_round(&mut self, seen: &Feedback<'_>, plan: &mut Plan) -> Result<Progress, Error> {
        let recorded = Singles::All.of(seen.film, self.name())?;
        if seen.round == 0 {
            self.known.0.clear();
        }
        if seen.budget.left() == 0 {
            return Ok(Progress::Done);
        }
        let (seed, now) = (seed_of(&self.points), counts_so_far(seen));
        let mut round = Round { seed, now, counts: vec![0; seen.pixels()] };
        self.plan_pilot(seen, &mut round)?;
        if round.counts.iter().all(|&count| count == 0) {
            self.plan_round(seen, &recorded, &mut round);
        }
        plan.counts = round.counts;
        Ok(if plan.total() == 0 { Progress::Done } else { Progress::Trace })
    }

    fn restore(&mut self, saved: &[u8]) -> Result<(), Error> {
        self.known.0.clear();
        match saved {
            [] => Ok(()),
            _ => Err(Error::BadSnapshot { what: "the data hold the state of a sampler, but the sampler dct has none" }),
        }
    }
}

/// Cosines fitted to the samples of each block of 8x8 pixels [after Bolin and Meyer 1995].
///
/// The fit is by least squares at the samples' positions in the image, so unequal densities do not move edges. Luminance has
/// half as many cosines as the block has samples, the lowest frequencies first. The colour differences (red and blue minus
/// luminance) have half as many as luminance. The option `lambda` penalises large coefficients of high frequencies. A pixel is
/// the mean of the cosines over its area, or 0 if the mean is negative.
///
/// The filter is made for the sampler `dct` but works with any sampler; [`FilmPoints`] provides the coordinates. Blocks without
/// samples are black. There is no error estimate. Not in the paper: the opponent colour space, the penalty, and the number of
/// cosines for colour differences.
///
/// *Bias*: from the frequencies that are left out. *Weaknesses*: block boundaries show; cosines ring at edges and around
/// lights.
pub type DctFilter = MethodFilter<CosineOptions, FilmPoints>;

impl FilterMethod<FilmPoints> for CosineOptions {
    const NAME: &'static str = "dct";
    const SAMPLES: Option<Singles> = Some(Singles::All);

    fn image(&self, film: &Film, points: &FilmPoints) -> Result<Filtered, Error> {
        image_of_cells((film, Self::NAME), SIDE, points, &points.domain().place(), |block, image| {
            let Some(fit) = Fit::new(block, self) else { return };
            let width = block.size[0] as usize;
            for (i, pixel) in image.iter_mut().enumerate() {
                *pixel = self.scale.radiance(fit.over_pixel([i % width, i / width]));
            }
        })
    }
}
