//! Variance per pixel from few samples: pooled over neighbours, over cells, or both.

use crate::{Cells, Error};
use dapple_core::RgbMoments;
use rayon::prelude::*;

/// Over what a pixel's variance is pooled, besides its own.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Pool {
    /// The pixels around it (FEASIBILITY 1: hard to beat).
    #[default]
    Window,
    /// Those, and with half their weight the ones of them that see the same cell first.
    Inside,
    /// All pixels that see the same cell first, wherever they are (THESIS D11).
    Cell,
}

impl Pool {
    /// Its name: `window`, `inside` or `cell`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Window => "window",
            Self::Inside => "inside",
            Self::Cell => "cell",
        }
    }
}

/// How [`relative_variance`] pools.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pooling {
    /// Over what.
    pub pool: Pool,
    /// The window is `2 radius + 1` pixels squared.
    pub radius: u32,
    /// The pool's weight beside a pixel's own `n - 1` degrees of freedom; infinite: the pool alone.
    pub prior: f64,
    /// What is averaged is this power of the variance, above 0: 1 for variances, 2 to let the noisiest of a
    /// neighbourhood speak for it, as it should where a few samples in many carry the error.
    pub power: f64,
    /// What is added to the squared mean before the variance is divided by it.
    pub epsilon: f64,
}

/// The relative variance of each pixel's samples, summed over channels: `v~ / (m^2 + epsilon)`, with
/// `v~^q = ((n - 1) v^q + prior pool(v^q)) / (n - 1 + prior)` (FEASIBILITY 4, step 5, has `q = 1`), `v` the sample variance, `q` the power, `n` the count
/// and `m` the mean over the window. Not negative; 0 where neither a pixel nor its pool has two samples.
///
/// `moments` are row by row, for a picture `size` pixels large. A pool is the variance of its pixels weighted by their
/// degrees of freedom, so that pixels with less than two samples take part in none.
///
/// # Errors
///
/// [`Error::OutOfRange`] where `moments` do not fill the picture, or the pool asks for cells and there are none, or of
/// another size.
pub fn relative_variance(
    moments: &[RgbMoments],
    size: [u32; 2],
    pooling: &Pooling,
    cells: Option<&Cells>,
) -> Result<Vec<f64>, Error> {
    let [w, h] = size.map(|n| n as usize);
    if moments.len() != w * h {
        return Err(Error::range("moments", moments.len(), "one for each pixel of the picture"));
    }
    let first: Vec<u32> = match (pooling.pool, cells) {
        (Pool::Window, _) => Vec::new(),
        (_, Some(cells)) if cells.pixels() == w * h => (0..w * h).map(|i| cells.of_pixel(i)[0]).collect(),
        _ => return Err(Error::range("cells", "none of this size", "the cells of this picture")),
    };
    let radius = pooling.radius as usize;
    let box_sums = |plane: &[f64]| box_sums(plane, [w, h], radius);
    let freedom = plane(moments, |m| m.count.saturating_sub(1) as f64);
    let freedoms = if pooling.pool == Pool::Cell { Vec::new() } else { box_sums(&freedom) };
    let seen = box_sums(&plane(moments, |m| f64::from(u8::from(m.count > 0))));
    let mut sums = vec![0.0; w * h];
    for c in 0..3 {
        let deviations = plane(moments, |m| match (m.count.saturating_sub(1) as f64, m.m2[c]) {
            (freedom, m2) if freedom > 0.0 && m2.is_finite() => freedom * power(m2.max(0.0) / freedom, pooling.power),
            _ => 0.0,
        });
        let means = box_sums(&plane(moments, |m| m.mean[c]));
        let pools = match pooling.pool {
            Pool::Cell => over_cells(&deviations, &freedom, &first, cells.map_or(0, Cells::len)),
            Pool::Window => divided(&box_sums(&deviations), &freedoms),
            Pool::Inside => {
                let window = divided(&box_sums(&deviations), &freedoms);
                inside(&window, &deviations, &freedom, pooling, [w, h], &first)
            }
        };
        sums.par_iter_mut().with_min_len(SERIAL).enumerate().for_each(|(i, sum)| {
            let mean = means[i] / seen[i].max(1.0);
            let variance = match pooling.prior {
                prior if prior == f64::INFINITY => pools[i],
                prior => (deviations[i] + prior * pools[i]) / (freedom[i] + prior),
            };
            *sum += root(variance, pooling.power) / (mean * mean + pooling.epsilon);
        });
    }
    Ok(sums)
}

/// Pixels that one task takes at least.
const SERIAL: usize = 4096;

/// Powers of 1 and 2, which are the ones in use, without a logarithm.
fn power(x: f64, power: f64) -> f64 {
    match power {
        1.0 => x,
        2.0 => x * x,
        _ => x.powf(power),
    }
}

fn root(x: f64, power: f64) -> f64 {
    match power {
        1.0 => x,
        2.0 => x.sqrt(),
        _ => x.powf(1.0 / power),
    }
}

fn plane(moments: &[RgbMoments], f: impl Fn(&RgbMoments) -> f64 + Sync + Send) -> Vec<f64> {
    moments.par_iter().with_min_len(SERIAL).map(f).collect()
}

fn ratio(a: f64, b: f64) -> f64 {
    if b > 0.0 { a / b } else { 0.0 }
}

fn divided(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| ratio(*a, *b)).collect()
}

/// The power of the variance of all pixels that see the same cell first.
fn over_cells(deviations: &[f64], freedom: &[f64], first: &[u32], cells: usize) -> Vec<f64> {
    let mut sums = vec![[0.0; 2]; cells];
    for (i, &cell) in first.iter().enumerate() {
        let sum = &mut sums[cell as usize];
        *sum = [sum[0] + deviations[i], sum[1] + freedom[i]];
    }
    first.iter().map(|&cell| ratio(sums[cell as usize][0], sums[cell as usize][1])).collect()
}

/// That of the window, and with half its weight that of the pixels near by that see the same cell first.
fn inside(
    window: &[f64],
    deviations: &[f64],
    freedom: &[f64],
    pooling: &Pooling,
    [w, h]: [usize; 2],
    first: &[u32],
) -> Vec<f64> {
    let radius = pooling.radius as usize;
    let of = |(i, all): (usize, &f64)| {
        let near = |at: usize, end: usize| at.saturating_sub(radius + 1)..(at + radius + 2).min(end);
        let mut sum = [0.0; 2];
        for k in near(i / w, h).flat_map(|y| near(i % w, w).map(move |x| y * w + x)) {
            if first[k] == first[i] {
                sum = [sum[0] + deviations[k], sum[1] + freedom[k]];
            }
        }
        (2.0 * all + ratio(sum[0], sum[1])) / 3.0
    };
    window.par_iter().with_min_len(SERIAL).enumerate().map(of).collect()
}

/// Sums over `2 radius + 1` pixels squared, cut off at the borders. Whole rows are added at a time, each pixel's terms in the
/// order of rows and columns; a running sum would keep what a firefly rounded away.
fn box_sums(plane: &[f64], [w, h]: [usize; 2], radius: usize) -> Vec<f64> {
    let near = |at: usize, end: usize| at.saturating_sub(radius)..(at + radius + 1).min(end);
    let mut sums = vec![0.0; plane.len()];
    let sum_row = |column: &mut Vec<f64>, (y, sums): (usize, &mut [f64])| {
        column.clear();
        column.resize(w, 0.0);
        for k in near(y, h) {
            column.iter_mut().zip(&plane[k * w..(k + 1) * w]).for_each(|(sum, x)| *sum += x);
        }
        // Shifted copies added up, but where the window is cut off.
        let whole = w.saturating_sub(2 * radius);
        let (inner, edge) = if whole > 0 { (radius..radius + whole, radius) } else { (0..0, w) };
        for k in 0..=2 * radius {
            sums[inner.clone()].iter_mut().zip(&column[k.min(w)..]).for_each(|(sum, x)| *sum += x);
        }
        for x in (0..edge).chain(inner.end.max(edge)..w) {
            sums[x] = column[near(x, w)].iter().sum();
        }
    };
    let rows = (SERIAL / w.max(1)).max(1);
    sums.par_chunks_mut(w.max(1)).with_min_len(rows).enumerate().for_each_init(Vec::new, sum_row);
    sums
}

/// What geometry alone says of each pixel's relative variance: the variance of albedo over its probes (THESIS D10,
/// texture, and D8, edges between materials), relative to its squared mean, and the share of pairs of probes in different
/// cells times half the squared difference of their normals (D8, edges of shape). Not negative, without unit.
///
/// `albedos` and `normals` hold what the probes of `cells` met, black and zero where they met nothing.
pub fn geometric_variance(cells: &Cells, albedos: &[[f32; 3]], normals: &[[f32; 3]], epsilon: f64) -> Vec<f64> {
    let k = cells.labels().len() / cells.pixels().max(1);
    let of = |pixel: usize| {
        let probes = pixel * k..(pixel + 1) * k;
        let mut sum = 0.0;
        for c in 0..3 {
            let mean = albedos[probes.clone()].iter().map(|a| f64::from(a[c])).sum::<f64>() / k as f64;
            let squares = albedos[probes.clone()].iter().map(|a| (f64::from(a[c]) - mean).powi(2)).sum::<f64>();
            sum += squares / (k.max(2) - 1) as f64 / (mean * mean + epsilon);
        }
        let pairs = probes.clone().flat_map(|a| (probes.start..a).map(move |b| (a, b)));
        let apart = pairs.filter(|&(a, b)| cells.labels()[a] != cells.labels()[b]);
        let difference = |(a, b): (usize, usize)| -> f64 {
            (0..3).map(|c| f64::from(normals[a][c] - normals[b][c]).powi(2)).sum::<f64>() * 0.5
        };
        sum + 3.0 * apart.map(difference).sum::<f64>() / (k * (k - 1) / 2).max(1) as f64
    };
    (0..cells.pixels()).map(of).collect()
}
