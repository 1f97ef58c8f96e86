//! Variances of pixel means, the uniform first samples that these come from, and the rounds that follow.

use crate::convolution::{convolve, gaussian_taps};
use dapple_core::{Error, Feedback, Film, Plan, allocate, saturating_u32};
use rayon::prelude::*;

/// The variance of each pixel's mean, averaged over the channels.
///
/// A pixel whose sample variance is 0 or unknown takes the mean sample variance of the 3x3 pixels around it. If none of
/// these has two samples, it takes that of the image. If no pixel has two samples, the variance is that of the means of 3x3
/// pixels, and infinite where only one of these has samples. It is 0 in pixels without samples.
pub(crate) fn variances_of_means(film: &Film) -> Vec<f64> {
    let size = film.frame().size().map(|n| n as usize);
    let own = per_pixel(film, |i| film.moments(i).variance().map(|[r, g, b]| (r + g + b) / 3.0));
    let (sum, known) = sum_and_number(own.iter().flatten().copied());
    if known == 0.0 {
        return per_pixel(film, |i| if film.count(i) == 0 { 0.0 } else { variance_around(film, size, i) });
    }
    let everywhere = sum / known;
    let of = |i: usize| {
        let n = film.count(i);
        if n == 0 {
            return 0.0;
        }
        if let Some(v) = own[i].filter(|v| *v > 0.0) {
            return v / n as f64;
        }
        let (sum, known) = sum_and_number(around(size, i).filter_map(|i| own[i]));
        if known > 0.0 { sum / (known * n as f64) } else { everywhere / n as f64 }
    };
    per_pixel(film, of)
}

/// The indices of the 3x3 pixels around pixel `i`.
pub(crate) fn around([width, height]: [usize; 2], i: usize) -> impl Iterator<Item = usize> + Clone {
    let (x, y) = (i % width, i / width);
    let rows = y.saturating_sub(1)..(y + 2).min(height);
    rows.flat_map(move |y| (x.saturating_sub(1)..(x + 2).min(width)).map(move |x| y * width + x))
}

/// The variance of the means of the 3x3 pixels around pixel `i`, averaged over the channels.
fn variance_around(film: &Film, size: [usize; 2], i: usize) -> f64 {
    let of_channel = |c: usize| {
        let near = around(size, i).filter(|&i| film.count(i) > 0).map(|i| film.mean(i)[c]);
        let (sum, number) = sum_and_number(near.clone());
        let (squares, _) = sum_and_number(near.map(|x| (x - sum / number) * (x - sum / number)));
        if number > 1.0 { squares / (number - 1.0) } else { f64::INFINITY }
    };
    (0..3).map(of_channel).sum::<f64>() / 3.0
}

fn sum_and_number(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((0.0, 0.0), |(sum, number), value| (sum + value, number + 1.0))
}

/// The mean and the variance of the mean of every pixel. Pixels without samples take those of Gaussians around them; they
/// are black if no sample is within 27 pixels. Unknown variances are 0.
pub(crate) fn filled_means(film: &Film) -> (Vec<[f64; 3]>, Vec<f64>) {
    let size = film.frame().size().map(|n| n as usize);
    let variances = variances_of_means(film);
    let of = |i: usize| {
        let [r, g, b] = film.mean(i);
        let variance = if variances[i].is_finite() { variances[i] } else { 0.0 };
        if film.count(i) > 0 { [r, g, b, variance, 1.0] } else { [0.0; 5] }
    };
    let mut known = per_pixel(film, of);
    for sigma in [1.0, 3.0, 9.0] {
        if known.iter().all(|values| values[4] > 0.0) {
            break;
        }
        let sums = convolve(size, &gaussian_taps(sigma), &known);
        for (values, sum) in known.iter_mut().zip(sums) {
            if values[4] == 0.0 && sum[4] > 0.0 {
                *values = sum.map(|value| value / sum[4]);
            }
        }
    }
    known.into_iter().map(|[r, g, b, variance, _]| ([r, g, b], variance)).unzip()
}

/// Computes a value for every pixel, in parallel.
pub(crate) fn per_pixel<T: Send>(film: &Film, f: impl Fn(usize) -> T + Sync + Send) -> Vec<T> {
    (0..film.frame().pixels()).into_par_iter().with_min_len(1024).map(f).collect()
}

/// The number of first samples per pixel in effect: `wanted`, within the bounds of each pixel's count and the mean budget.
pub(crate) fn first_samples(seen: &Feedback<'_>, wanted: u32) -> u32 {
    let mean = saturating_u32(seen.budget.total / seen.pixels() as u64);
    wanted.max(seen.budget.min_spp).min(seen.budget.max_spp).min(mean)
}

/// Plans the samples that pixels lack of a uniform pilot, as [`plan_first`] does with [`first_samples`].
pub(crate) fn plan_pilot(seen: &Feedback<'_>, wanted: u32, plan: &mut Plan) -> bool {
    plan_first(seen, first_samples(seen, wanted), plan)
}

/// Requests the samples that pixels lack of the first `samples` per pixel. Returns `true` if any are missing and the budget
/// suffices; otherwise the counts of `plan` stay 0.
pub(crate) fn plan_first(seen: &Feedback<'_>, samples: u32, plan: &mut Plan) -> bool {
    for (i, count) in plan.counts.iter_mut().enumerate() {
        *count = samples.saturating_sub(saturating_u32(seen.film.count(i)));
    }
    let is_missing = plan.total() > 0 && plan.total() <= seen.budget.left();
    if !is_missing {
        plan.counts.fill(0);
    }
    is_missing
}

/// The number of samples of the next round, if the budget beyond `first` samples per pixel is divided into `rounds` equal
/// steps.
pub(crate) fn next_step(seen: &Feedback<'_>, first: u32, rounds: u32) -> u64 {
    let budget = seen.budget;
    let first = (u64::from(first) * seen.pixels() as u64).min(budget.total);
    let step = |k: u32| first + (u128::from(budget.total - first) * u128::from(k) / u128::from(rounds.max(1))) as u64;
    let target = (1..=rounds).map(step).find(|&target| target > budget.spent).unwrap_or(budget.total);
    target.min(budget.total).saturating_sub(budget.spent)
}

/// Cuts the planned counts at each pixel's ceiling, and spreads what is cut evenly over pixels below it.
pub(crate) fn within_ceiling(seen: &Feedback<'_>, mut planned: Vec<u32>) -> Result<Vec<u32>, Error> {
    let most = seen.budget.max_spp;
    let now = |i: usize| saturating_u32(seen.film.count(i));
    let mut beyond = 0;
    for (i, count) in planned.iter_mut().enumerate() {
        let room = most.saturating_sub(now(i));
        beyond += u64::from(count.saturating_sub(room));
        *count = (*count).min(room);
    }
    with_extra(seen, planned, beyond)
}

/// Adds `extra` samples to the planned counts, such that all pixels' counts become as equal as their ceilings allow.
pub(crate) fn with_extra(seen: &Feedback<'_>, planned: Vec<u32>, extra: u64) -> Result<Vec<u32>, Error> {
    if extra == 0 {
        return Ok(planned);
    }
    let now = |i: usize| saturating_u32(seen.film.count(i));
    let floors: Vec<u32> = planned.iter().enumerate().map(|(i, count)| now(i) + count).collect();
    let total = floors.iter().map(|&n| u64::from(n)).sum::<u64>() + extra;
    let counts = allocate(&vec![1.0; floors.len()], &floors, seen.budget.max_spp, total)?.counts;
    Ok(counts.iter().enumerate().map(|(i, count)| count - now(i)).collect())
}
