//! Light selection probabilities, learned per cell of space and orientation.

mod grid;

use crate::Error;
use grid::Grid;
use rayon::prelude::*;

/// The parameters of [`LightCells`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightCellOptions {
    /// The number of voxels along the longest side of the bounding box, from 1 to 1024. With many lights, fewer voxels are
    /// used, which limits the size of the table.
    pub resolution: u32,
    /// The weight of a light's expected squared contribution in a cell's mean, above 0. Each measured sample has weight 1.
    pub prior: f32,
    /// The fraction of samples for which a light is selected uniformly, above 0 and at most 1. Each light's probability is
    /// at least `defensive / lights`, up to rounding.
    pub defensive: f32,
}

impl Default for LightCellOptions {
    /// Returns a resolution of 24 voxels, a prior of 4 samples and a uniform fraction of 0.1.
    fn default() -> Self {
        Self { resolution: 24, prior: 4.0, defensive: 0.1 }
    }
}

/// The choice between a distribution for each cell and a single distribution for the whole scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Guidance {
    /// Each cell selects lights by its own distribution.
    Cells,
    /// All cells select lights by one common distribution, because distributions per cell would reduce the variance too little.
    Global,
}

/// A table of light selection probabilities, with one distribution per cell. A cell is a voxel of space combined with
/// an orientation (the axis nearest to the surface normal, with its sign).
///
/// Let `X_e` be the contribution of light `e` before division by its selection probability `p_e`. The variance is minimal
/// if `p_e` is proportional to the square root of the second moment `E[X_e^2]`. Second moments are learned from samples
/// that are traced anyway. Cells with few samples fall back on an expected `X_e`, scaled by light `e`'s ratio of measured to
/// expected values over all cells. A fraction of the selection is uniform ([`LightCellOptions::defensive`]). A table is
/// read-only while samples are traced, and learns between passes ([`LightCells::learn`]).
///
/// *Guarantees*: in every cell, each light keeps the fraction [`LightCellOptions::defensive`] of its uniform
/// probability, up to rounding. An estimator that divides by [`LightCells::pmf`] is therefore unbiased, whatever the
/// table has learned. Probabilities are positive multiples of 2^-24, so random numbers of 24 bits select lights with
/// exactly these probabilities. Learning is deterministic.
///
/// *Weaknesses*: a cell ignores the direction of view, which matters for glossy surfaces. The two sides of a wall
/// thinner than a voxel share a cell where their normals agree.
///
/// Positions, normals and light indices are plain numbers, so that any renderer can use the table.
#[derive(Clone, Debug, PartialEq)]
pub struct LightCells {
    grid: Grid,
    lights: usize,
    options: LightCellOptions,
    /// The index in `ends` of each cell's row: its own row once the cell has samples, its neighbourhood's row before.
    rows: Vec<u32>,
    /// The cumulative probabilities: per row and light, the sum up to and including the light. The row of the global
    /// distribution comes first, then one row per neighbourhood (expected contributions only), then one per cell with
    /// samples.
    ends: Vec<f32>,
    /// The number of rows before the cells' own: one global row and one per neighbourhood.
    shared: usize,
    /// The expected square root of the second moment, per cell with samples and per light. Its mean over a cell's lights is 1.
    expected: Vec<f32>,
    /// The number of samples and the sum of their squared contributions, per cell with samples and per light.
    seen: Vec<[f32; 2]>,
    guidance: Guidance,
}

/// The number of values of a 24-bit random number, 2^24.
const STEPS: f32 = (1 << 24) as f32;
/// The largest number of pairs of a cell and a light in a table. 2^21 pairs take 34 MB if every cell gets samples.
const MOST: usize = 1 << 21;
/// The largest number of lights for which a light is found by counting. A binary search would miss the cache repeatedly,
/// and mispredict half of its branches.
const COUNTED: usize = 64;
/// The number of voxels along each side of a neighbourhood. Cells without samples share a row per neighbourhood and
/// orientation, so 27 times fewer rows are needed (9 times in a flat box).
const NEIGHBOURHOOD: u32 = 3;
/// The threshold for a distribution per cell: the predicted second moment, relative to that with the global distribution.
/// Above it, the global distribution is used.
const WORTH: f64 = 0.97;

impl LightCells {
    /// Makes a table for points inside `bounds` and for `lights` lights. Points outside `bounds` belong to the nearest
    /// cell.
    ///
    /// `expected` takes the centre of a voxel, half its diagonal, a cell's axis (a unit vector) and the index of a
    /// light. It returns the light's approximate contribution to the cell, in any unit, or 1 if nothing is known.
    ///
    /// Returns `None` for fewer than two lights, which need no selection, and for more than 2^16, which are too many
    /// for a table.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] if an option is out of its range, or if the corners of `bounds` are not finite or not in
    /// order.
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
            return Err(Error::range("defensive", options.defensive, "a fraction above 0 and at most 1"));
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

    /// Returns the index of the cell of a point. `normal` is the surface normal on the side that is lit.
    #[inline]
    pub fn cell(&self, position: [f32; 3], normal: [f32; 3]) -> u32 {
        self.grid.cell(position, normal)
    }

    /// The number of cells: voxels times six orientations.
    pub fn cells(&self) -> usize {
        self.rows.len()
    }

    /// The number of lights.
    pub fn lights(&self) -> usize {
        self.lights
    }

    /// An upper bound on the bytes of the table after [`LightCells::learn`] has received `notes` items.
    pub fn memory(&self, notes: u64) -> u64 {
        let bytes = size_of::<f32>() + size_of::<f32>() + size_of::<[f32; 2]>();
        let rows = (self.cells() as u64).min(notes) * (self.lights * bytes) as u64;
        rows + (self.shared * self.lights * size_of::<f32>() + self.cells() * size_of::<u32>()) as u64
    }

    /// Returns the index of the light that a random number `u` in `[0, 1)` selects in a cell, and its probability.
    #[inline]
    pub fn sample(&self, cell: u32, u: f32) -> (u32, f32) {
        let row = self.row(cell);
        // Clamped below: the last cumulative probability is 1, but `u` may be 1.
        let light = if row.len() <= COUNTED {
            // Wrapping, since a check for overflow would prevent vectorisation.
            row.iter().fold(0_u32, |below, end| below.wrapping_add(u32::from(u >= *end))) as usize
        } else {
            row.partition_point(|end| u >= *end)
        };
        let light = light.min(row.len() - 1);
        (light as u32, share(row, light))
    }

    /// Returns the probability that a cell selects a light.
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

    /// Returns the key that identifies a pair of a cell and a light in [`LightCells::learn`].
    #[inline]
    pub fn key(&self, cell: u32, light: u32) -> u64 {
        u64::from(cell) * self.lights as u64 + u64::from(light)
    }

    /// Learns from samples. Each item of `notes` holds the [key](LightCells::key) of a cell and a light, their number of
    /// samples, and the sum of the squared contributions.
    ///
    /// A contribution is neither divided by the light's probability nor multiplied by the throughput of the path
    /// before it. An occluded light has the contribution 0. Items whose key is out of range or whose sum is NaN,
    /// negative or too large for f32 are skipped. `expected` is the function given to [`LightCells::new`]; it is called
    /// for cells that get their first samples.
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
        self.update_distributions();
    }

    /// The distributions in use, initially [`Guidance::Cells`]. Each call of [`LightCells::learn`] may change them.
    pub fn guidance(&self) -> Guidance {
        self.guidance
    }

    /// Recomputes all probabilities from the learned second moments, and decides between cells and the global
    /// distribution.
    fn update_distributions(&mut self) {
        let ratios = self.light_ratios();
        let level = self.level(&ratios);
        let global = self.global_mix();
        let lights = self.lights;
        let mut ends = std::mem::take(&mut self.ends);
        let (of_all, of_cells) = ends.split_at_mut(self.shared * lights);
        set_ends(&mut of_all[..lights], &global);
        let cells = self.expected.par_chunks(lights).zip(self.seen.par_chunks(lights));
        // The predicted second moments of each cell: with its own distribution and with the global one.
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

    /// Returns each light's measured second moment relative to its expected one, divided by the same ratio for all
    /// lights together. A light without samples gets 1; all ratios are clamped to 1e-4..1e4.
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
        // A light without contributions so far may still contribute, so its ratio stays above 0.
        let ratio =
            |[found, expected]: [f64; 2]| if expected > 0.0 && mean > 0.0 { found / expected * mean } else { 1.0 };
        sums.into_iter().map(|s| ratio(s).clamp(1e-4, 1e4)).collect()
    }

    /// Returns the measured second moment relative to the expected one, averaged over all cells.
    fn level(&self, ratios: &[f64]) -> f64 {
        let mut sums = [0.0; 2];
        for (expected, seen) in self.expected.chunks(self.lights).zip(self.seen.chunks(self.lights)) {
            let [found, wanted] = level_of(expected, seen, ratios);
            sums = [sums[0] + found, sums[1] + wanted];
        }
        if sums[0] > 0.0 { sums[0] / sums[1] } else { 1.0 }
    }

    /// Computes the second moments of a cell's lights: the measured ones averaged with [`LightCellOptions::prior`]
    /// samples of the expected ones, which are scaled to the cell's level (see `level`).
    fn moments(&self, expected: &[f32], seen: &[[f32; 2]], ratios: &[f64], level: f64, mixes: &mut Mixes) {
        let prior = f64::from(self.options.prior);
        let [found, wanted] = level_of(expected, seen, ratios);
        // The cell's own level is weighted by its number of samples; the level of all cells counts as one sample.
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

    /// Computes the minimum-variance distribution for the second moments, mixed with the uniform distribution.
    fn mix(&self, mixes: &mut Mixes) {
        let Mixes { moments, mix } = mixes;
        mix.clear();
        mix.extend(moments.iter().map(|q| q.max(0.0).sqrt()));
        let sum: f64 = mix.iter().sum();
        let (n, uniform) = (mix.len() as f64, f64::from(self.options.defensive));
        let of = |root: f64| if sum > 0.0 && sum.is_finite() { root / sum } else { 1.0 / n };
        mix.iter_mut().for_each(|p| *p = (1.0 - uniform) * of(*p) + uniform / n);
    }

    /// Returns the probabilities of the lights from the samples of all cells together.
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

/// Working memory for one cell: the second moments of its lights, and the probabilities computed from them.
#[derive(Default)]
struct Mixes {
    moments: Vec<f64>,
    mix: Vec<f64>,
}

/// Fills in the expected contributions of a cell's lights, scaled to 1 on average.
fn expect(
    row: &mut [f32],
    (middle, half, axis): ([f32; 3], f32, [f32; 3]),
    expected: impl Fn([f32; 3], f32, [f32; 3], usize) -> f32,
) {
    for (light, value) in row.iter_mut().enumerate() {
        let e = expected(middle, half, axis, light);
        *value = if e > 0.0 && e.is_finite() { e } else { 0.0 };
    }
    // If no light is expected to contribute, all get the same expectation.
    let sum: f32 = row.iter().sum();
    let scale = if sum > 0.0 && sum.is_finite() { row.len() as f32 / sum } else { 0.0 };
    row.iter_mut().for_each(|v| *v = if scale > 0.0 { (*v * scale).max(1e-6) } else { 1.0 });
}

/// Returns the sum of squared contributions measured in a cell, and the sum expected at a level of 1.
fn level_of(expected: &[f32], seen: &[[f32; 2]], ratios: &[f64]) -> [f64; 2] {
    let each = expected.iter().zip(seen).zip(ratios);
    each.fold([0.0; 2], |sum, ((&e, &[n, squares]), ratio)| {
        let e = f64::from(e);
        [sum[0] + f64::from(squares), sum[1] + f64::from(n) * ratio * e * e]
    })
}

/// Sets the cumulative probabilities of a row from a distribution. They are multiples of 2^-24, each larger than the
/// one before.
fn set_ends(row: &mut [f32], mix: &[f64]) {
    let (mut sum, mut before) = (0.0, 0.0);
    let last = mix.len() - 1;
    for (i, (end, p)) in row.iter_mut().zip(mix).enumerate() {
        sum += p;
        // The limit leaves one step of 2^-24 for each of the remaining lights.
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
