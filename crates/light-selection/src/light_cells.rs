//! Which of many lights a point is worth asking: learned per cell of space and orientation.

mod grid;

use crate::Error;
use grid::Grid;
use rayon::prelude::*;

/// Parameters of [`LightCells`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightCellOptions {
    /// Voxels along the longest side of the box; fewer where there are many lights.
    pub resolution: u32,
    /// Weight of what is expected beforehand, in samples.
    pub prior: f32,
    /// Share of choices that are uniform whatever was learned: no weight is above one over this times the number of
    /// lights.
    pub defensive: f32,
}

impl Default for LightCellOptions {
    /// FEASIBILITY 2's: 24 voxels, 4 samples, a tenth.
    fn default() -> Self {
        Self { resolution: 24, prior: 4.0, defensive: 0.1 }
    }
}

/// What was found to be worth using.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Guidance {
    /// A mix of lights per cell.
    Cells,
    /// One mix for all: cells differ too little.
    Global,
}

/// Probabilities of lights, one distribution for each cell of space (a voxel) and orientation (the axis that the normal
/// is nearest to): the clusters of [Lan 2016] evaluated at the point that is lit.
///
/// The variance of a light chosen with probability `p_e` is least for `p_e` in proportion to the root of the second
/// moment `E[X_e^2]` of what light `e` then contributes (before division by `p_e`). Moments are learned from samples that
/// are traced anyway, shrunk to what is expected of the cell and, over all cells, of the light; a tenth of the choices is
/// uniform. A table is read-only while samples are traced, and learns between ([`LightCells::learn`]).
///
/// *Guarantees*: each light has a probability of at least a tenth of its uniform share in every cell, so that an
/// estimator that divides by [`LightCells::pmf`] is unbiased whatever was learned; probabilities are whole multiples of
/// 2^-24, so that coordinates of 24 bits choose exactly as often; learning is deterministic. *Weaknesses*: a cell knows
/// nothing of the view (gloss), and what straddles a border (a wall thinner than a voxel, seen from both sides with the
/// same normal) is mixed.
///
/// Nothing here knows a light, a scene or a ray: another renderer passes plain numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct LightCells {
    grid: Grid,
    lights: usize,
    options: LightCellOptions,
    /// The row of each cell: one of its own since it was first seen, before that its neighbourhood's.
    rows: Vec<u32>,
    /// Row by row: the end of each light's share of the unit interval. First comes the global mix, then what is expected of
    /// each neighbourhood, then the rows of cells that were seen.
    ends: Vec<f32>,
    /// How many rows there are before those of cells.
    shared: usize,
    /// Per seen cell and light: what is expected of the root of the second moment, up to a factor.
    expected: Vec<f32>,
    /// Per seen cell and light: samples, and the sum of their squares.
    seen: Vec<[f32; 2]>,
    guidance: Guidance,
}

/// Different values of a coordinate of 24 bits.
const STEPS: f32 = (1 << 24) as f32;
/// Most numbers in a table: 2^21 of each kind take 34 MB in all, if every cell is seen.
const MOST: usize = 1 << 21;
/// Voxels along each side of a neighbourhood: until a cell is seen, a 27th of the rows will do (a ninth in a flat box).
const NEIGHBOURHOOD: u32 = 3;
/// Cells pay when they promise less than this share of the global mix's second moment.
const WORTH: f64 = 0.97;

impl LightCells {
    /// A table for the points inside `bounds` (those outside belong to the nearest cell) and so many lights, of which
    /// `expected` says beforehand, for the middle of a voxel, half its diagonal, a cell's axis (a unit vector) and a
    /// light, about how much it contributes, in any unit: `|..| 1.0` if nothing is known. `None` where a choice cannot
    /// pay or be stored: with fewer than two lights, or more than 2^16.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] for options out of range, or bounds that are none.
    pub fn new(
        bounds: [[f32; 3]; 2],
        lights: usize,
        options: &LightCellOptions,
        expected: impl Fn([f32; 3], f32, [f32; 3], usize) -> f32 + Sync,
    ) -> Result<Option<Self>, Error> {
        if !(1..=1024).contains(&options.resolution) {
            return Err(Error::range("resolution", options.resolution, "1 to 1024 voxels"));
        }
        if !(options.prior > 0.0 && options.prior.is_finite()) {
            return Err(Error::range("prior", options.prior, "a number of samples above 0"));
        }
        if !(options.defensive > 0.0 && options.defensive <= 1.0) {
            return Err(Error::range("defensive", options.defensive, "a share above 0 and at most 1"));
        }
        if !(2..=1 << 16).contains(&lights) {
            return Ok(None);
        }
        let grid = Grid::new(bounds, options.resolution, MOST / lights)?;
        let around = grid.coarser(NEIGHBOURHOOD);
        let shared = 1 + around.cells();
        let rows = (0..grid.cells() as u32).into_par_iter().map(|cell| {
            let (middle, _, axis) = grid.cell_at(cell);
            1 + around.cell(middle, axis)
        });
        let mut made = Self {
            rows: rows.collect(),
            ends: vec![0.0; shared * lights],
            shared,
            expected: Vec::new(),
            seen: Vec::new(),
            guidance: Guidance::Cells,
            grid,
            lights,
            options: *options,
        };
        let mut ends = std::mem::take(&mut made.ends);
        ends.par_chunks_mut(lights).enumerate().for_each_init(Mixes::default, |mixes, (row, ends)| {
            let mut values = vec![1.0; lights];
            if let Some(neighbourhood) = row.checked_sub(1) {
                expect(&mut values, around.cell_at(neighbourhood as u32), &expected);
            }
            mixes.moments.clear();
            mixes.moments.extend(values.iter().map(|e| f64::from(*e) * f64::from(*e)));
            made.mix(mixes);
            set_ends(ends, &mixes.mix);
        });
        made.ends = ends;
        Ok(Some(made))
    }

    /// The cell of a point with this normal, on the side that is lit.
    #[inline]
    pub fn cell(&self, position: [f32; 3], normal: [f32; 3]) -> u32 {
        self.grid.cell(position, normal)
    }

    /// How many cells there are.
    pub fn cells(&self) -> usize {
        self.rows.len()
    }

    /// How many lights there are.
    pub fn lights(&self) -> usize {
        self.lights
    }

    /// The light that `u` in `[0, 1)` chooses in a cell, and its probability there.
    #[inline]
    pub fn sample(&self, cell: u32, u: f32) -> (u32, f32) {
        let row = self.row(cell);
        // The last end is 1, but `u` may be no number below it.
        let light = match row.len() {
            0..=8 => row.iter().map(|end| usize::from(u >= *end)).sum(),
            _ => row.partition_point(|end| u >= *end),
        };
        let light = light.min(row.len() - 1);
        (light as u32, share(row, light))
    }

    /// The probability of a light in a cell.
    #[inline]
    pub fn pmf(&self, cell: u32, light: u32) -> f32 {
        share(self.row(cell), light as usize)
    }

    #[inline]
    fn row(&self, cell: u32) -> &[f32] {
        let row = match self.guidance {
            Guidance::Cells => self.rows[cell as usize] as usize,
            Guidance::Global => 0,
        };
        &self.ends[row * self.lights..][..self.lights]
    }

    /// The number under which to note down what a light contributed in a cell.
    #[inline]
    pub fn key(&self, cell: u32, light: u32) -> u64 {
        u64::from(cell) * self.lights as u64 + u64::from(light)
    }

    /// Learns from samples: for each [`LightCells::key`], how many there were and the sum of the squares of what they
    /// contributed, not divided by the probability of the light, nor weighted by what the path before it lost. Samples
    /// that found nothing (the light was hidden) count as well. Keys out of range and sums that are no number are passed
    /// over. `expected` is what [`LightCells::new`] was given: cells that are seen for the first time ask it.
    pub fn learn(
        &mut self,
        notes: impl Iterator<Item = (u64, u64, f64)>,
        expected: impl Fn([f32; 3], f32, [f32; 3], usize) -> f32 + Sync,
    ) {
        let lights = self.lights as u64;
        let known = self.seen.len() / self.lights;
        let mut news = Vec::new();
        for (key, count, squares) in notes {
            if !(squares >= 0.0 && squares < f64::from(f32::MAX)) {
                continue;
            }
            let (cell, light) = (key / lights, (key % lights) as usize);
            let Some(row) = usize::try_from(cell).ok().and_then(|cell| self.rows.get_mut(cell)) else { continue };
            if (*row as usize) < self.shared {
                *row = (self.shared + known + news.len()) as u32;
                news.push(cell as u32);
                self.seen.resize(self.seen.len() + self.lights, [0.0; 2]);
            }
            let slot = &mut self.seen[(*row as usize - self.shared) * self.lights + light];
            *slot = [slot[0] + count as f32, slot[1] + squares as f32];
        }
        self.expected.resize(self.seen.len(), 0.0);
        self.ends.resize(self.shared * self.lights + self.seen.len(), 0.0);
        let of_news = self.expected[known * self.lights..].par_chunks_mut(self.lights).zip(news);
        of_news.for_each(|(row, cell)| expect(row, self.grid.cell_at(cell), &expected));
        self.settle();
    }

    /// What was found to be worth using.
    pub fn guidance(&self) -> Guidance {
        self.guidance
    }

    /// Turns what was seen into probabilities.
    fn settle(&mut self) {
        let ratios = self.light_ratios();
        let level = self.level(&ratios);
        let global = self.global_mix();
        let lights = self.lights;
        let mut ends = std::mem::take(&mut self.ends);
        let (of_all, of_cells) = ends.split_at_mut(self.shared * lights);
        set_ends(&mut of_all[..lights], &global);
        let cells = self.expected.par_chunks(lights).zip(self.seen.par_chunks(lights));
        // Second moments that cells promise, with their own mix and with the global one.
        let promised: Vec<[f64; 2]> = of_cells
            .par_chunks_mut(lights)
            .zip(cells)
            .map_init(Mixes::default, |mixes, (row, (expected, seen))| {
                let samples = f64::from(seen.iter().map(|s| s[0]).sum::<f32>());
                self.moments(expected, seen, &ratios, level, mixes);
                self.mix(mixes);
                set_ends(row, &mixes.mix);
                let cost = |mix: &[f64]| mixes.moments.iter().zip(mix).map(|(q, p)| q / p).sum::<f64>() * samples;
                [cost(&mixes.mix), cost(&global)]
            })
            .collect();
        self.ends = ends;
        let [own, shared] = promised.iter().fold([0.0; 2], |s, p| [s[0] + p[0], s[1] + p[1]]);
        let pays = shared == 0.0 || own < WORTH * shared;
        self.guidance = if pays { Guidance::Cells } else { Guidance::Global };
    }

    /// By how much each light's second moments differ from what was expected, relative to all lights; 1 where nothing
    /// was seen of one.
    fn light_ratios(&self) -> Vec<f64> {
        let mut sums = vec![[0.0; 2]; self.lights];
        for (expected, seen) in self.expected.chunks(self.lights).zip(self.seen.chunks(self.lights)) {
            for ((sum, e), s) in sums.iter_mut().zip(expected).zip(seen) {
                let e = f64::from(*e);
                *sum = [sum[0] + f64::from(s[1]), sum[1] + f64::from(s[0]) * e * e];
            }
        }
        let all = sums.iter().fold([0.0; 2], |a, s| [a[0] + s[0], a[1] + s[1]]);
        let mean = if all[0] > 0.0 { all[1] / all[0] } else { 0.0 };
        // A light that nobody saw so far may yet be seen: within bounds.
        let ratio =
            |[found, expected]: [f64; 2]| if expected > 0.0 && mean > 0.0 { found / expected * mean } else { 1.0 };
        sums.into_iter().map(|s| ratio(s).clamp(1e-4, 1e4)).collect()
    }

    /// The second moment that an expectation of 1 stands for, over all cells.
    fn level(&self, ratios: &[f64]) -> f64 {
        let mut sums = [0.0; 2];
        for (expected, seen) in self.expected.chunks(self.lights).zip(self.seen.chunks(self.lights)) {
            let [found, wanted] = level_of(expected, seen, ratios);
            sums = [sums[0] + found, sums[1] + wanted];
        }
        if sums[0] > 0.0 { sums[0] / sums[1] } else { 1.0 }
    }

    /// A cell's second moments: what was seen, with [`LightCellOptions::prior`] samples of what was expected, at the level
    /// of what was seen in it.
    fn moments(&self, expected: &[f32], seen: &[[f32; 2]], ratios: &[f64], level: f64, mixes: &mut Mixes) {
        let prior = f64::from(self.options.prior);
        let [found, wanted] = level_of(expected, seen, ratios);
        // The cell's own level, as far as it has samples; the image's has a sample's weight.
        let samples: f64 = seen.iter().map(|s| f64::from(s[0])).sum();
        let own = if wanted > 0.0 { found / wanted } else { level };
        let level = (samples * own + level) / (samples + 1.0);
        let each = expected.iter().zip(seen).zip(ratios).map(|((&e, &[n, squares]), ratio)| {
            let wanted = level * ratio * f64::from(e) * f64::from(e);
            (f64::from(squares) + prior * wanted) / (f64::from(n) + prior)
        });
        mixes.moments.clear();
        mixes.moments.extend(each);
    }

    /// The best mix for second moments, with its uniform share.
    fn mix(&self, mixes: &mut Mixes) {
        let Mixes { moments, mix } = mixes;
        mix.clear();
        mix.extend(moments.iter().map(|q| q.max(0.0).sqrt()));
        let sum: f64 = mix.iter().sum();
        let (n, uniform) = (mix.len() as f64, f64::from(self.options.defensive));
        let of = |root: f64| if sum > 0.0 && sum.is_finite() { root / sum } else { 1.0 / n };
        mix.iter_mut().for_each(|p| *p = (1.0 - uniform) * of(*p) + uniform / n);
    }

    /// The mix for all cells together.
    fn global_mix(&self) -> Vec<f64> {
        let mut sums = vec![[0.0; 2]; self.lights];
        for seen in self.seen.chunks(self.lights) {
            for (sum, s) in sums.iter_mut().zip(seen) {
                *sum = [sum[0] + f64::from(s[0]), sum[1] + f64::from(s[1])];
            }
        }
        let moment = |[n, squares]: [f64; 2]| if n > 0.0 { squares / n } else { 0.0 };
        let mut mixes = Mixes { moments: sums.into_iter().map(moment).collect(), mix: Vec::new() };
        self.mix(&mut mixes);
        mixes.mix
    }
}

/// Second moments of a cell's lights and the mix they make: room to work in.
#[derive(Default)]
struct Mixes {
    moments: Vec<f64>,
    mix: Vec<f64>,
}

/// Fills in what is expected of a cell's lights, 1 on average.
fn expect(
    row: &mut [f32],
    (middle, half, axis): ([f32; 3], f32, [f32; 3]),
    expected: impl Fn([f32; 3], f32, [f32; 3], usize) -> f32,
) {
    for (light, value) in row.iter_mut().enumerate() {
        let e = expected(middle, half, axis, light);
        *value = if e > 0.0 && e.is_finite() { e } else { 0.0 };
    }
    // What is expected of nobody is expected of all alike.
    let sum: f32 = row.iter().sum();
    let scale = if sum > 0.0 && sum.is_finite() { row.len() as f32 / sum } else { 0.0 };
    row.iter_mut().for_each(|v| *v = if scale > 0.0 { (*v * scale).max(1e-6) } else { 1.0 });
}

/// The sum of squares seen in a cell, and what an expectation of 1 would have made it.
fn level_of(expected: &[f32], seen: &[[f32; 2]], ratios: &[f64]) -> [f64; 2] {
    let each = expected.iter().zip(seen).zip(ratios);
    each.fold([0.0; 2], |sum, ((&e, &[n, squares]), ratio)| {
        let e = f64::from(e);
        [sum[0] + f64::from(squares), sum[1] + f64::from(n) * ratio * e * e]
    })
}

/// Sets the ends of the shares of a mix: whole multiples of 2^-24, each above the one before.
fn set_ends(row: &mut [f32], mix: &[f64]) {
    let (mut sum, mut before) = (0.0, 0.0);
    let last = mix.len() - 1;
    for (i, (end, p)) in row.iter_mut().zip(mix).enumerate() {
        sum += p;
        // Room is left for the lights to come: a step each.
        let most = STEPS - (last - i) as f32;
        let steps = ((sum * f64::from(STEPS)).round() as f32).clamp(before + 1.0, most);
        before = if i == last { STEPS } else { steps };
        *end = before / STEPS;
    }
}

#[inline]
fn share(row: &[f32], light: usize) -> f32 {
    row[light] - if light > 0 { row[light - 1] } else { 0.0 }
}
