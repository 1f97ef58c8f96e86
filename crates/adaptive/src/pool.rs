//! Estimates of pixel variance from few samples, pooled over neighbours.

use crate::similar_pool::{Surfaces, SurfacesOfRows, over_similar};
use dapple_core::{Error, film::RgbMoments, options::OutOfRange, parallel};
use std::ops::Range;

/// The set of pixels whose variance is pooled with a pixel's own.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PoolShape {
    /// The square window of pixels around the pixel.
    #[default]
    Window,
    /// The same window, but near pixels with similar surfaces weigh more. A pixel with few similar pixels around it has a
    /// higher score.
    ///
    /// Surfaces are the features of the film: normal, albedo and depth. The similarity of two surfaces is `1 / (1 + d^2)^2`.
    /// `d` is their difference without its noise, in units of 0.3 (normals), 0.1 (albedos) and 10 % (depths). The score is
    /// divided by the square root of the mean similarity to pixels 6 and 12 rows and columns away, in the same band of 16 rows.
    /// With [`Sources::Odd`] and [`Sources::Even`], the mean surface of the pixel's nearest sources replaces its own.
    ///
    /// If the film has no features, as without a filter, weights depend on the distance alone. The same holds for
    /// [`PilotPolicy::Cross`](dapple_core::plan::PilotPolicy::Cross), because films record no features per half.
    Similar,
}

dapple_core::choices!(PoolShape { Window = "window", Similar = "similar" });

/// The pixels of the window that contribute to a pixel's score.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Sources {
    /// All pixels, including the pixel itself.
    #[default]
    All,
    /// Pixels whose column and row offsets add up to an odd number: the other colour of a chessboard.
    Odd,
    /// Pixels whose offsets add up to an even number, except the pixel itself.
    Even,
}

/// The parameters of [`relative_variance`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pooling {
    /// The weights of the window's pixels.
    pub pool: PoolShape,
    /// The radius of the window, which is `2 radius + 1` pixels wide and high.
    pub radius: u32,
    /// The weight of the pooled variance, 0 or above. The variance of the pixel's own `n` samples has the weight `n - 1`. If
    /// `prior` is infinite, only the pooled variance is used.
    pub prior: f64,
    /// The exponent, above 0, to which variances are raised before averaging. With 1, variances are averaged. With 2, the
    /// noisiest pixels weigh more, which helps if a few of many samples carry most of the error.
    pub power: f64,
    /// The number added to the squared mean in the denominator, so that black pixels have a finite relative variance.
    pub epsilon: f64,
    /// The pixels whose samples count. `prior` applies only with [`Sources::All`].
    pub sources: Sources,
}

/// The relative variance of each pixel's samples: `v~ / (m^2 + epsilon)`, summed over channels.
///
/// `v~` is the pooled variance: `v~^q = ((n - 1) v^q + prior P) / (n - 1 + prior)`. `v` is the pixel's sample variance, `n` its
/// count and `q` the power. `P` is the mean of `v^q` over the window, weighted by degrees of freedom, and `m` the channel's
/// mean radiance over the window. The result is 0 or above; it is 0 if no pixel of the window has two samples.
///
/// `moments` are in row order, for an image of `size` pixels.
///
/// With [`PoolShape::Similar`], the weight of a neighbour depends on its distance alone, since surfaces are unknown here.
///
/// With [`Sources::Odd`] and [`Sources::Even`], `v~^q` is `P`, and the pixel itself contributes neither to `P` nor to `m`.
///
/// # Errors
///
/// [`Error::OutOfRange`] if the number of `moments` does not match `size`.
pub fn relative_variance(moments: &[RgbMoments], size: [u32; 2], pooling: &Pooling) -> Result<Vec<f64>, Error> {
    let [w, h] = size.map(|n| n as usize);
    if moments.len() != w * h {
        let (value, allowed) = (moments.len().to_string(), "one for each pixel of the image");
        return Err(OutOfRange { name: "moments", value, allowed }.into());
    }
    Ok(pooled_variance(|i| moments[i], [w, h], pooling, &|_| None))
}

/// The relative variance of the pixels of an image of this size. `surfaces` returns the visible surfaces, if known.
pub(crate) fn pooled_variance(
    moments: impl Fn(usize) -> RgbMoments + Sync,
    size: [usize; 2],
    pooling: &Pooling,
    surfaces: &SurfacesOfRows<'_>,
) -> Vec<f64> {
    let score = |Terms([freedom, _, own @ ..]): &Terms, sums: &Terms| {
        let Terms([freedoms, seen, ..]) = *sums;
        // Starting from 0 is required, since an empty sum of floats is -0.
        (0..3).fold(0.0, |sum, c| {
            let (pool, mean) = (ratio(sums.deviation(c), freedoms), ratio(sums.mean(c), seen));
            let variance = match (pooling.sources, pooling.prior) {
                (Sources::Odd | Sources::Even, _) | (_, f64::INFINITY) => pool,
                (Sources::All, prior) => (own[c] + prior * pool) / (freedom + prior),
            };
            sum + root(variance, pooling.power) / (mean * mean + pooling.epsilon)
        })
    };
    let window = (pooling.radius as usize, pooling.sources);
    let of = |i: usize| Terms::of(&moments(i), pooling.power);
    match pooling.pool {
        PoolShape::Similar => over_similar(size, window, surfaces, of, score),
        PoolShape::Window => over_windows(size, window, of, score),
    }
}

/// The terms of a pixel that are summed over its pool: degrees of freedom (1), 1 if there are samples (1), powers of the
/// variance times degrees of freedom (3), and means (3). Eight contiguous numbers are added in SIMD lanes.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Terms([f64; 8]);

impl Terms {
    #[inline]
    pub(crate) fn of(m: &RgbMoments, q: f64) -> Self {
        let freedom = m.count.saturating_sub(1) as f64;
        let deviation = |c: usize| match m.m2[c] {
            m2 if freedom > 0.0 && m2.is_finite() => freedom * power(m2.max(0.0) / freedom, q),
            _ => 0.0,
        };
        let [r, g, b] = m.mean;
        Self([freedom, f64::from(u8::from(m.count > 0)), deviation(0), deviation(1), deviation(2), r, g, b])
    }

    #[inline]
    fn add(&mut self, other: &Self) {
        self.0.iter_mut().zip(&other.0).for_each(|(sum, x)| *sum += x);
    }

    #[inline]
    pub(crate) fn add_weighted(&mut self, other: &Self, weight: f64) {
        self.0.iter_mut().zip(&other.0).for_each(|(sum, x)| *sum += weight * x);
    }

    fn deviation(&self, channel: usize) -> f64 {
        self.0[2 + channel]
    }

    pub(crate) fn mean(&self, channel: usize) -> f64 {
        self.0[5 + channel]
    }
}

/// The least number of pixels per task.
const SERIAL: usize = 4096;

/// `x` raised to `power`. The usual powers 1 and 2 need no logarithm.
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

fn ratio(a: f64, b: f64) -> f64 {
    if b > 0.0 { a / b } else { 0.0 }
}

/// The indices of `0..end` that are at most `radius` away from `at`.
pub(crate) fn near(at: usize, radius: usize, end: usize) -> Range<usize> {
    at.saturating_sub(radius)..(at + radius + 1).min(end)
}

/// The number of pixel rows that one task computes.
fn rows_of_task(width: usize, radius: usize) -> usize {
    (SERIAL / width.max(1)).max(2 * radius).max(1)
}

/// The working memory of `threads` threads for an image of this size, in bytes. Each thread holds the terms of its rows and of
/// `radius` rows above and below, sums of columns, and surfaces if `has_surfaces`.
pub(crate) fn bytes_of_windows([w, h]: [usize; 2], radius: usize, threads: usize, has_surfaces: bool) -> usize {
    let own = rows_of_task(w, radius);
    let around = (own + 2 * radius).min(h);
    let task = w.saturating_mul(around + 2).saturating_mul(size_of::<Terms>());
    let surfaces = if has_surfaces { Surfaces::bytes(w, own.min(h)) } else { 0 };
    let task = task.saturating_add(surfaces);
    task.saturating_mul(threads.min(h.div_ceil(own)))
}

/// The scores of an image's pixels, row by row. `score_row` gets the scores of a row and the row's number, the terms of
/// `radius` rows above and below with the number of the first of these rows, and the result of `prepare` for the rows of a
/// task.
pub(crate) fn scores_by_rows<T>(
    [w, h]: [usize; 2],
    radius: usize,
    terms: impl Fn(usize) -> Terms + Sync,
    prepare: impl Fn(Range<usize>) -> T + Sync,
    score_row: impl Fn(&mut [f64], usize, (&[Terms], usize), &T) + Sync,
) -> Vec<f64> {
    let mut scores = vec![0.0; w * h];
    let rows = rows_of_task(w, radius);
    parallel::chunks(&mut scores, rows * w.max(1), |task, scores| {
        let first = task * rows;
        let last = first + scores.len() / w - 1;
        let around = near(first, radius, h).start..near(last, radius, h).end;
        let all: Vec<Terms> = (around.start * w..around.end * w).map(&terms).collect();
        let prepared = prepare(first..last + 1);
        (first..)
            .zip(scores.chunks_mut(w))
            .for_each(|(y, scores)| score_row(scores, y, (&all, around.start), &prepared));
    });
    scores
}

/// The score of each pixel, from its own terms and the sums over `sources` in a window. The window is `2 radius + 1` pixels
/// wide and high, cut off at the borders.
///
/// Terms are added in the order of rows and columns. Running sums or differences of sums would retain the rounding error of a
/// firefly.
fn over_windows(
    [w, h]: [usize; 2],
    (radius, sources): (usize, Sources),
    terms: impl Fn(usize) -> Terms + Sync,
    score: impl Fn(&Terms, &Terms) -> f64 + Sync,
) -> Vec<f64> {
    scores_by_rows(
        [w, h],
        radius,
        terms,
        |_| (),
        |scores, y, (all, first), ()| {
            let row = |y: usize| &all[(y - first) * w..][..w];
            // Sums over rows an even number of steps away, and over the other rows unless all are added together.
            let mut columns = [0, 1].map(|_| vec![Terms::default(); w]);
            for k in near(y, radius, h) {
                let odd = usize::from(sources != Sources::All && k.abs_diff(y) % 2 == 1);
                columns[odd].iter_mut().zip(row(k)).for_each(|(sum, terms)| sum.add(terms));
            }
            for (x, place) in scores.iter_mut().enumerate() {
                let mut sums = Terms::default();
                let odd = |k: usize| k.abs_diff(x) % 2;
                match sources {
                    Sources::All => columns[0][near(x, radius, w)].iter().for_each(|column| sums.add(column)),
                    Sources::Odd => near(x, radius, w).for_each(|k| sums.add(&columns[1 - odd(k)][k])),
                    Sources::Even => {
                        near(x, radius, w).filter(|&k| k != x).for_each(|k| sums.add(&columns[odd(k)][k]));
                        let above_and_below = near(y, radius, h).filter(|&k| k != y && k.abs_diff(y) % 2 == 0);
                        above_and_below.for_each(|k| sums.add(&row(k)[x]));
                    }
                }
                *place = score(&row(y)[x], &sums);
            }
        },
    )
}

/// The ratio of the sums of `parts(i)[0]` and of `parts(i)[1]` over the window around each pixel; 0 if the latter is 0.
pub(crate) fn ratios_over_windows(
    size: [usize; 2],
    window: (usize, Sources),
    parts: impl Fn(usize) -> [f64; 2] + Sync,
) -> Vec<f64> {
    let terms = |i| {
        let [a, b] = parts(i);
        Terms([0.0, 0.0, 0.0, 0.0, 0.0, a, b, 0.0])
    };
    over_windows(size, window, terms, |_, sums| ratio(sums.mean(0), sums.mean(1)))
}
