//! Variance per pixel from few samples: pooled over neighbours, over cells, or both.

use crate::{Cells, Error};
use dapple_core::RgbMoments;

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
    let plane = |f: &dyn Fn(&RgbMoments) -> f64| -> Vec<f64> { moments.iter().map(f).collect() };
    let freedom = plane(&|m| m.count.saturating_sub(1) as f64);
    let seen = box_sums(&plane(&|m| f64::from(u8::from(m.count > 0))), w, h, radius);
    let mut sums = vec![0.0; w * h];
    for c in 0..3 {
        let deviations = plane(&|m| match (m.count.saturating_sub(1) as f64, m.m2[c]) {
            (freedom, m2) if freedom > 0.0 && m2.is_finite() => freedom * power(m2.max(0.0) / freedom, pooling.power),
            _ => 0.0,
        });
        let means = box_sums(&plane(&|m| m.mean[c]), w, h, radius);
        let pools = pools(&deviations, &freedom, pooling, [w, h], &first, cells);
        for (i, sum) in sums.iter_mut().enumerate() {
            let mean = means[i] / seen[i].max(1.0);
            let variance = match pooling.prior {
                prior if prior == f64::INFINITY => pools[i],
                prior => (deviations[i] + prior * pools[i]) / (freedom[i] + prior),
            };
            *sum += power(variance, 1.0 / pooling.power) / (mean * mean + pooling.epsilon);
        }
    }
    Ok(sums)
}

fn power(x: f64, power: f64) -> f64 {
    if power == 1.0 { x } else { x.powf(power) }
}

/// The pooled power of the variance of each pixel.
fn pools(
    deviations: &[f64],
    freedom: &[f64],
    pooling: &Pooling,
    [w, h]: [usize; 2],
    first: &[u32],
    cells: Option<&Cells>,
) -> Vec<f64> {
    let radius = pooling.radius as usize;
    let ratio = |a: &f64, b: &f64| if *b > 0.0 { a / b } else { 0.0 };
    let divide = |a: &[f64], b: &[f64]| -> Vec<f64> { a.iter().zip(b).map(|(a, b)| ratio(a, b)).collect() };
    if pooling.pool == Pool::Cell {
        let mut sums = vec![[0.0; 2]; cells.map_or(0, Cells::len)];
        for (i, &cell) in first.iter().enumerate() {
            let sum = &mut sums[cell as usize];
            *sum = [sum[0] + deviations[i], sum[1] + freedom[i]];
        }
        return first.iter().map(|&cell| ratio(&sums[cell as usize][0], &sums[cell as usize][1])).collect();
    }
    let window = divide(&box_sums(deviations, w, h, radius), &box_sums(freedom, w, h, radius));
    if pooling.pool == Pool::Window {
        return window;
    }
    let inside = |i: usize| {
        let near = |at: usize, end: usize| at.saturating_sub(radius + 1)..(at + radius + 2).min(end);
        let mut sum = [0.0; 2];
        for k in near(i / w, h).flat_map(|y| near(i % w, w).map(move |x| y * w + x)) {
            if first[k] == first[i] {
                sum = [sum[0] + deviations[k], sum[1] + freedom[k]];
            }
        }
        ratio(&sum[0], &sum[1])
    };
    window.iter().enumerate().map(|(i, all)| (2.0 * all + inside(i)) / 3.0).collect()
}

/// Sums over `2 radius + 1` pixels squared, cut off at the borders.
fn box_sums(plane: &[f64], w: usize, h: usize, radius: usize) -> Vec<f64> {
    let pass = |from: &[f64], length: usize, stride: usize, start: usize, to: &mut [f64]| {
        for i in 0..length {
            let near = i.saturating_sub(radius)..(i + radius + 1).min(length);
            to[start + i * stride] = near.map(|k| from[start + k * stride]).sum();
        }
    };
    let mut rows = vec![0.0; plane.len()];
    (0..h).for_each(|y| pass(plane, w, 1, y * w, &mut rows));
    let mut sums = vec![0.0; plane.len()];
    (0..w).for_each(|x| pass(&rows, h, w, x, &mut sums));
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
