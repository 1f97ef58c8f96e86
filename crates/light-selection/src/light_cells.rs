//! Probabilities of lights, learned per cell of space and orientation.

mod grid;

use crate::Error;
use grid::Grid;
use rayon::prelude::*;

/// The parameters of [`LightCells`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightCellOptions {
    /// The number of voxels along the longest side of the box; fewer if the table would otherwise be too large for the
    /// number of lights.
    pub resolution: u32,
    /// The weight of the expected contribution against the measured one, as a number of samples.
    pub prior: f32,
    /// The fraction of uniform selection in every distribution. It bounds a sample's weight by the number of lights
    /// over this fraction.
    pub defensive: f32,
}

impl Default for LightCellOptions {
    /// Returns a resolution of 24 voxels, a prior of 4 samples and a uniform fraction of 0.1.
    fn default() -> Self {
        Self { resolution: 24, prior: 4.0, defensive: 0.1 }
    }
}

/// The kind of distributions in use: one per cell, or one for all cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Guidance {
    /// One distribution per cell.
    Cells,
    /// One distribution for all cells, since cells differ too little.
    Global,
}

/// Probabilities of lights: one distribution for each cell of space (a voxel) and orientation (the axis nearest to the
/// normal).
///
/// The variance of light `e`, chosen with probability `p_e`, is least for `p_e` in proportion to the root of the
/// second moment `E[X_e^2]` of its contribution `X_e` (before division by `p_e`). Moments are learned from samples
/// that are traced anyway. They are shrunk to the expectation for the cell and, over all cells, for the light. A
/// tenth of the selection is uniform. A table is read-only while samples are traced, and learns in between
/// ([`LightCells::learn`]).
///
/// *Guarantees*: each light has a probability of at least a tenth of its uniform share in every cell, so that an
/// estimator that divides by [`LightCells::pmf`] is unbiased whatever the table has learned. Probabilities are whole
/// multiples of 2^-24: coordinates of 24 bits select exactly as often. Learning is deterministic. *Weaknesses*: a
/// cell does not know the direction of view (gloss). Two sides of a wall thinner than a voxel share a cell where
/// normals agree.
///
/// The table takes plain numbers, so that any renderer can use it.
#[derive(Clone, Debug, PartialEq)]
pub struct LightCells {
    grid: Grid,
    lights: usize,
    options: LightCellOptions,
    /// The row of each cell: its own since it was first seen, before that its neighbourhood's.
    rows: Vec<u32>,
    /// Row by row: the end of each light's share of the unit interval. First comes the global mix, then the
    /// expectation for each neighbourhood, then the rows of cells that were seen.
    ends: Vec<f32>,
    /// The number of rows before the cells' own: the global mix and the neighbourhoods.
    shared: usize,
    /// Per seen cell and light: the expected root of the second moment, up to a factor.
    expected: Vec<f32>,
    /// Per seen cell and light: samples, and the sum of their squares.
    seen: Vec<[f32; 2]>,
    guidance: Guidance,
}

/// The number of values of a 24-bit random number.
const STEPS: f32 = (1 << 24) as f32;
/// The most numbers in a table: 2^21 of each kind take 34 MB in all, if every cell is seen.
const MOST: usize = 1 << 21;
/// Voxels along each side of a neighbourhood: until a cell is seen, a 27th of the rows will do (a ninth in a flat box).
const NEIGHBOURHOOD: u32 = 3;
/// The fraction of the global distribution's second moment below which the cells' predicted second moment must lie for
/// cells to be used.
const WORTH: f64 = 0.97;

impl LightCells {
    /// Makes a table for the points inside `bounds` and for `lights` lights. Points outside belong to the nearest cell.
    ///
    /// `expected` takes the middle of a voxel, half its diagonal, a cell's axis (a unit vector) and a light. It
    /// returns the light's approximate contribution there, in any unit: `|..| 1.0` if nothing is known. The result is
    /// `None` with fewer than two lights, which need no selection, or more than 2^16, which no table can store.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] for options out of range, or for bounds that are not finite or not in order.
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

    /// The index of the cell of a point with this normal, which is on the side that is lit.
    #[inline]
    pub fn cell(&self, position: [f32; 3], normal: [f32; 3]) -> u32 {
        self.grid.cell(position, normal)
    }

    /// The number of cells.
    pub fn cells(&self) -> usize {
        self.rows.len()
    }

    /// The number of lights.
    pub fn lights(&self) -> usize {
        self.lights
    }

    /// The light that `u` in `[0, 1)` selects in a cell, and its probability there.
    #[inline]
    pub fn sample(&self, cell: u32, u: f32) -> (u32, f32) {
        let row = self.row(cell);
        // The last end is 1, but `u` may be NaN or 1.
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

    /// The key under which a light's contribution in a cell is noted.
    #[inline]
    pub fn key(&self, cell: u32, light: u32) -> u64 {
        u64::from(cell) * self.lights as u64 + u64::from(light)
    }

    /// Learns from samples: for each [`LightCells::key`], their number and the sum of their squared contributions.
    ///
    /// Contributions are neither divided by the probability of the light nor weighted by the throughput of the path
    /// before it. Samples of a hidden light count as well. Keys out of range and sums that are NaN are skipped.
    /// `expected` is that of [`LightCells::new`]: cells that are seen for the first time call it.
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

    /// The kind of distributions in use: one per cell, or one for all cells.
    pub fn guidance(&self) -> Guidance {
        self.guidance
    }

    /// Recomputes the probabilities of lights from the learned second moments.
    fn update_distributions(&mut self) {
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

    /// The ratio of each light's second moments to the expected ones, relative to all lights; 1 for a light without
    /// samples.
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
        // A light without contributions so far may yet contribute: within bounds.
        let ratio =
            |[found, expected]: [f64; 2]| if expected > 0.0 && mean > 0.0 { found / expected * mean } else { 1.0 };
        sums.into_iter().map(|s| ratio(s).clamp(1e-4, 1e4)).collect()
    }

    /// The measured second moment for an expected contribution of 1, averaged over all cells.
    fn level(&self, ratios: &[f64]) -> f64 {
        let mut sums = [0.0; 2];
        for (expected, seen) in self.expected.chunks(self.lights).zip(self.seen.chunks(self.lights)) {
            let [found, wanted] = level_of(expected, seen, ratios);
            sums = [sums[0] + found, sums[1] + wanted];
        }
        if sums[0] > 0.0 { sums[0] / sums[1] } else { 1.0 }
    }

    /// A cell's second moments: those seen, with [`LightCellOptions::prior`] samples of those expected, at the cell's
    /// level.
    fn moments(&self, expected: &[f32], seen: &[[f32; 2]], ratios: &[f64], level: f64, mixes: &mut Mixes) {
        let prior = f64::from(self.options.prior);
        let [found, wanted] = level_of(expected, seen, ratios);
        // The cell's own level, weighted by its samples; the image's has the weight of one sample.
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

    /// Computes the distribution of least variance for second moments, mixed with the uniform one.
    fn mix(&self, mixes: &mut Mixes) {
        let Mixes { moments, mix } = mixes;
        mix.clear();
        mix.extend(moments.iter().map(|q| q.max(0.0).sqrt()));
        let sum: f64 = mix.iter().sum();
        let (n, uniform) = (mix.len() as f64, f64::from(self.options.defensive));
        let of = |root: f64| if sum > 0.0 && sum.is_finite() { root / sum } else { 1.0 / n };
        mix.iter_mut().for_each(|p| *p = (1.0 - uniform) * of(*p) + uniform / n);
    }

    /// The probabilities of the lights from the samples of all cells together.
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

/// Working memory: the second moments of a cell's lights, and the probabilities that follow from them.
#[derive(Default)]
struct Mixes {
    moments: Vec<f64>,
    mix: Vec<f64>,
}

/// Fills in the expectation for a cell's lights, 1 on average.
fn expect(
    row: &mut [f32],
    (middle, half, axis): ([f32; 3], f32, [f32; 3]),
    expected: impl Fn([f32; 3], f32, [f32; 3], usize) -> f32,
) {
    for (light, value) in row.iter_mut().enumerate() {
        let e = expected(middle, half, axis, light);
        *value = if e > 0.0 && e.is_finite() { e } else { 0.0 };
    }
    // Without any expectation all lights are alike.
    let sum: f32 = row.iter().sum();
    let scale = if sum > 0.0 && sum.is_finite() { row.len() as f32 / sum } else { 0.0 };
    row.iter_mut().for_each(|v| *v = if scale > 0.0 { (*v * scale).max(1e-6) } else { 1.0 });
}

/// The sum of squared contributions measured in a cell, and the expected sum for a level of 1.
fn level_of(expected: &[f32], seen: &[[f32; 2]], ratios: &[f64]) -> [f64; 2] {
    let each = expected.iter().zip(seen).zip(ratios);
    each.fold([0.0; 2], |sum, ((&e, &[n, squares]), ratio)| {
        let e = f64::from(e);
        [sum[0] + f64::from(squares), sum[1] + f64::from(n) * ratio * e * e]
    })
}

/// Sets the cumulative probabilities of a row from a mix of probabilities: whole multiples of 2^-24, each above the one
/// before.
fn set_ends(row: &mut [f32], mix: &[f64]) {
    let (mut sum, mut before) = (0.0, 0.0);
    let last = mix.len() - 1;
    for (i, (end, p)) in row.iter_mut().zip(mix).enumerate() {
        sum += p;
        // Leaves one step for each of the remaining lights.
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
