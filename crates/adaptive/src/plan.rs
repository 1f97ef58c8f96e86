//! Planning of sample counts from a film's statistics, without side effects.

use crate::pool::{pooled_variance, ratios_over_windows};
use crate::similar_pool::{Surfaces, likeness};
use crate::{Adaptive, AdaptiveOptions, PoolShape, Pooling, Sources};
use dapple_core::plan::{BudgetLeft, Feedback, Ladder, PilotPolicy, Plan, saturating_u32};
use dapple_core::{Error, Film, PointSet, film::RgbMoments, parallel};

/// The largest sample count `n` for which a table stores `n^-exponent`.
const TABLE: u32 = 4096;

/// The divisor of the mean count that gives the minimum number of samples per pixel after a discarded pilot: a quarter of the
/// mean.
const FLOOR: u64 = 4;

/// The samples per pixel below which the pool is wider. At 480x270 the filtered image then has 0.71 of the error at 2 spp and
/// 0.94 at 4 (eight scenes, two seeds); at 8 and 16 spp it would have 1.05 (six scenes, one seed).
const FEW: u64 = 4;

/// The smallest score of a pixel, as a fraction of the mean score.
const SCORE_FLOOR: f64 = 0.01;

/// The estimates that determine counts, one per pixel.
struct Scores {
    /// The width of the image.
    width: usize,
    /// The relative variance of one sample.
    errors: Vec<f64>,
    /// The cost per sample, relative to the cheapest pixel; `None` if costs are ignored.
    costs: Option<Vec<f64>>,
}

impl<P: PointSet> Adaptive<P> {
    /// The exponent at which errors are assumed to fall: the option's value, but at most 1 for independent samples.
    fn exponent(&self) -> f64 {
        if self.points.is_independent() { self.options.exponent.min(1.0) } else { self.options.exponent }
    }

    /// Returns each pixel's scores. `moments` returns a pixel's sample statistics.
    fn scores(&self, film: &Film, moments: impl Fn(usize) -> RgbMoments + Sync + Send) -> Result<Scores, Error> {
        let sources = self.sources(film);
        let AdaptiveOptions { pool, prior, power, epsilon, cost, .. } = self.options;
        let radius = self.radius(film);
        let pooling = Pooling { pool, radius, prior, power, epsilon, sources };
        let [width, height] = film.frame().size().map(|n| n as usize);
        let reads = self.reads_surfaces();
        let surfaces = |rows| if reads { Surfaces::of_rows(film, rows) } else { None };
        let is_single = (0..width * height).all(|i| moments(i).count == 1);
        let mut scores = if is_single {
            let like = |pixels| if reads { likeness(film, pixels) } else { 1.0 };
            let pairs = paired(&moments, [width, height], like);
            pooled_variance(|i| pairs[i], [width, height], &pooling, &surfaces)
        } else {
            pooled_variance(&moments, [width, height], &pooling, &surfaces)
        };
        raise_to_floor(&mut scores, width);
        if let Some(map) = &self.errors {
            let errors = (map.of)(film)?;
            if errors.len() != scores.len() {
                let (found, pixels) = (errors.len(), scores.len());
                let what = format!("{found} values for {pixels} pixels; return one value per pixel");
                return Err(Error::Mismatch { who: map.name.clone(), what });
            }
            self.blend_errors(&errors, film, &mut scores);
        }
        let costs = (cost == 1).then(|| relative_costs(film, radius, sources));
        Ok(Scores { width, errors: scores, costs })
    }

    /// The radius of the pool. It is doubled while pixels have fewer than [`FEW`] samples.
    fn radius(&self, film: &Film) -> u32 {
        let AdaptiveOptions { pool, radius, .. } = self.options;
        let is_few = || (0..film.frame().pixels()).any(|i| film.count(i) + film.discarded(i).count < FEW);
        if pool == PoolShape::Similar && is_few() { 2 * radius } else { radius }
    }

    /// Returns `true` if weights depend on the pixels' features. Films record no features per half.
    pub(crate) fn reads_surfaces(&self) -> bool {
        self.options.pool == PoolShape::Similar && self.options.policy != PilotPolicy::Cross
    }

    /// Returns the pixels whose samples count in a score, in the round that follows the samples of `film`.
    ///
    /// With [`PilotPolicy::Neighbours`], the first round after the pilot reads the other colour of a chessboard, and the second
    /// round reads the pixel's own colour. The counts of the own colour depend only on the pilot of the other colour, so no
    /// chain of decisions leads from a pixel's samples back to its counts.
    fn sources(&self, film: &Film) -> Sources {
        if self.options.policy != PilotPolicy::Neighbours {
            return Sources::All;
        }
        let first = film.count(0);
        if (0..film.frame().pixels()).all(|i| film.count(i) == first) { Sources::Odd } else { Sources::Even }
    }

    /// Replaces each score by a weighted geometric mean of the score and the predicted error. Multiplying the error by
    /// `n^exponent` first turns it into the error of one sample.
    fn blend_errors(&self, errors: &[f32], film: &Film, scores: &mut [f64]) {
        let of_one = |(i, &e): (usize, &f32)| {
            let e = if e.is_finite() { f64::from(e.max(0.0)) } else { 0.0 };
            e * (film.count(i).max(1) as f64).powf(self.exponent())
        };
        let mut errors: Vec<f64> = errors.iter().enumerate().map(of_one).collect();
        let width = film.frame().size()[0] as usize;
        raise_to_floor(&mut errors, width);
        let (level, scale) = (mean(&errors, width), mean(scores, width));
        if !(level > 0.0 && scale > 0.0) {
            return;
        }
        let mix = self.options.mix;
        for (score, error) in scores.iter_mut().zip(errors) {
            *score = (error / level).powf(mix) * (*score / scale).powf(1.0 - mix);
        }
    }

    /// Returns the samples to add to the counts `now`. The final counts minimise the error given by the scores, sum to `total`
    /// and are at least `floors`. With costs, they minimise the error for a given number of rays.
    fn more(
        &self,
        scores: &Scores,
        [now, floors]: [&[u32]; 2],
        (total, ceiling): (u64, u32),
        ladder: Ladder,
    ) -> Result<Vec<u32>, Error> {
        let Scores { width, errors, costs } = scores;
        let per_ray: Option<Vec<f64>> =
            costs.as_ref().map(|costs| errors.iter().zip(costs).map(|(error, cost)| error / cost).collect());
        let scores = per_ray.as_ref().unwrap_or(errors);
        let (mean, exponent) = (total as f64 / floors.len() as f64, self.exponent());
        let cap = (self.options.cap * mean).ceil().min(f64::from(ceiling)) as u32;
        let mut shared = ladder.allocate(scores, floors, cap, total, exponent)?;
        if shared.unspent > 0 {
            // The floors leave too little room below the cap, so only the user's ceiling applies.
            shared = ladder.allocate(scores, floors, ceiling, total, exponent)?;
        }
        let left = |n: f64| n.max(1.0).powf(-exponent);
        // Most images have more pixels than distinct counts, so powers are tabulated per count.
        let known: Vec<f64> = (0..=cap.min(TABLE)).map(|n| left(f64::from(n))).collect();
        let left_of = |&n: &u32| known.get(n as usize).copied().unwrap_or_else(|| left(f64::from(n)));
        let sum = |value: &dyn Fn(usize) -> f64| sum_by_rows(*width, errors.len(), value);
        let promised = sum(&|k| errors[k] * left_of(&shared.counts[k]));
        let same = |costs: &Vec<f64>| sum(&|k| f64::from(shared.counts[k]) * costs[k]) / sum(&|k| costs[k]);
        let same = costs.as_ref().map_or(mean, same);
        let uniform = sum(&|k| errors[k]) * left(same);
        if promised > self.options.gain * uniform {
            let alike = vec![1.0; errors.len()];
            shared = ladder.allocate(&alike, floors, ceiling, total, exponent)?;
        }
        Ok(shared.counts.iter().zip(now).map(|(n, now)| n - now).collect())
    }

    /// Plans the next round of a render that keeps all samples. The budget after the pilot is divided into equal steps, one per
    /// round.
    pub(crate) fn plan_kept(&self, (seen, pilot): (&Feedback<'_>, u32), plan: &mut Plan) -> Result<(), Error> {
        let BudgetLeft { spent, total, min_spp, max_spp, .. } = seen.budget;
        let scores = self.scores(seen.film, |i| seen.film.moments(i))?;
        let now: Vec<u32> = seen.film.counts().into_iter().map(saturating_u32).collect();
        let floors: Vec<u32> = now.iter().map(|&n| n.max(min_spp)).collect();
        let needed = sum(&floors);
        let first = (u64::from(pilot) * seen.pixels() as u64).min(total);
        let rounds = u64::from(self.options.rounds_after_pilot());
        let step = |k: u64| first + ((total - first) as u128 * u128::from(k) / u128::from(rounds)) as u64;
        let target = (1..=rounds).map(step).find(|&t| t > spent && t >= needed).unwrap_or(total);
        plan.counts = self.more(&scores, [&now, &floors], (target, max_spp), Ladder::of(seen.film.needs()))?;
        Ok(())
    }

    /// Plans the samples of the image, using the scores of a discarded pilot.
    pub(crate) fn plan_after_discarding(&self, seen: &Feedback<'_>, plan: &mut Plan) -> Result<(), Error> {
        let BudgetLeft { min_spp, max_spp, .. } = seen.budget;
        let ladder = Ladder::of(seen.film.needs());
        let scores = self.scores(seen.film, |i| seen.film.discarded(i))?;
        let now: Vec<u32> = seen.film.counts().into_iter().map(saturating_u32).collect();
        let total = sum(&now) + seen.budget.left();
        let mean = total / seen.pixels() as u64;
        let share = if self.preset.is_some() { 0 } else { ladder.floor(saturating_u32(mean / FLOOR)) };
        let wanted = share.max(min_spp.max(1)).min(max_spp);
        let least = saturating_u32(mean).min(wanted);
        let floors: Vec<u32> = now.iter().map(|&n| n.max(least)).collect();
        let floors = if sum(&floors) <= total { floors } else { now.clone() };
        plan.counts = self.more(&scores, [&now, &floors], (total, max_spp), ladder)?;
        Ok(())
    }

    /// Plans each half's counts from the other half's samples. Each half spends half of the budget if floors and ceilings allow
    /// it; an odd sample goes to the first half.
    pub(crate) fn plan_across(&self, seen: &Feedback<'_>, plan: &mut Plan) -> Result<(), Error> {
        let BudgetLeft { total, min_spp, max_spp, .. } = seen.budget;
        let moments = |half: usize, i: usize| seen.film.half(half, i).unwrap_or_default();
        let now = [0, 1]
            .map(|half| -> Vec<u32> { (0..seen.pixels()).map(|i| saturating_u32(moments(half, i).count)).collect() });
        let least = [min_spp - min_spp / 2, min_spp / 2];
        let most = [max_spp - max_spp / 2, max_spp / 2];
        let floors = [0, 1].map(|half| -> Vec<u32> { now[half].iter().map(|&n| n.max(least[half])).collect() });
        let needed = [0, 1].map(|half| sum(&floors[half]));
        let room = seen.pixels() as u64 * u64::from(most[1]);
        let second = (total / 2).min(room).min(total.saturating_sub(needed[0])).max(needed[1]);
        let planned = |half: usize, total: u64| {
            let scores = self.scores(seen.film, |i| moments(1 - half, i))?;
            self.more(&scores, [&now[half], &floors[half]], (total, most[half]), Ladder::Whole)
        };
        plan.counts = planned(0, total.saturating_sub(second))?;
        plan.second_half = Some(planned(1, second)?);
        Ok(())
    }
}

/// The moments of pixels with one sample each, which have no variance on their own. Each pixel is paired with its most similar
/// diagonal neighbour. Diagonal neighbours have the pixel's own colour on the chessboard of [`Sources`], so pairs never mix the
/// two colours.
fn paired(
    single: impl Fn(usize) -> RgbMoments + Sync,
    [width, height]: [usize; 2],
    likeness: impl Fn([usize; 2]) -> f64 + Sync,
) -> Vec<RgbMoments> {
    let mut pairs = vec![RgbMoments::default(); width * height];
    parallel::fill(&mut pairs, |i| {
        let (x, y) = (i % width, i / width);
        let beside = [(-1, -1), (1, -1), (-1, 1), (1, 1)].into_iter().filter_map(|(dx, dy)| {
            let column = x.checked_add_signed(dx).filter(|column| *column < width)?;
            let row = y.checked_add_signed(dy).filter(|row| *row < height)?;
            Some(row * width + column)
        });
        let beside = beside.map(|other| (other, likeness([i, other])));
        let mut moments = single(i);
        if let Some((other, _)) = beside.max_by(|(_, a), (_, b)| a.total_cmp(b)) {
            moments.merge(&single(other));
        }
        moments
    });
    pairs
}

/// The rays per sample of each pixel, pooled over a window, relative to the cheapest pixel: 1 or above.
///
/// The window is `2 radius + 1` pixels wide and high. Only the samples of `sources` count, so that a pixel's own paths do not
/// affect its counts where its own values must not. A sample costs at least one ray. Equal costs give exactly 1.
fn relative_costs(film: &Film, radius: u32, sources: Sources) -> Vec<f64> {
    let size = film.frame().size().map(|n| n as usize);
    let parts = |i: usize| {
        let samples = film.count(i) + film.discarded(i).count;
        [film.cost(i).unwrap_or(samples) as f64, samples as f64]
    };
    let mut costs = ratios_over_windows(size, (radius as usize, sources), parts);
    costs.iter_mut().for_each(|cost| *cost = cost.max(1.0));
    let least = costs.iter().copied().fold(f64::INFINITY, f64::min);
    costs.iter_mut().for_each(|cost| *cost /= least);
    costs
}

/// Raises every score to at least 1 % of the mean, because zero variance in few samples does not prove convergence.
fn raise_to_floor(scores: &mut [f64], width: usize) {
    let floor = SCORE_FLOOR * mean(scores, width);
    scores.iter_mut().for_each(|s| *s = s.max(floor));
}

/// The mean of the finite values.
fn mean(values: &[f64], width: usize) -> f64 {
    let finite = |k: usize| if values[k].is_finite() { values[k] } else { 0.0 };
    sum_by_rows(width, values.len(), finite) / values.len() as f64
}

/// The sum over all pixels: first of each row from left to right, then of the rows from top to bottom.
fn sum_by_rows(width: usize, pixels: usize, value: impl Fn(usize) -> f64) -> f64 {
    // Starting from 0 is required, since an empty sum of floats is -0.
    let add = |sum: f64, value: f64| sum + value;
    let row = |row: usize| (row * width..(row + 1) * width).map(&value).fold(0.0, add);
    (0..pixels / width).map(row).fold(0.0, add)
}

fn sum(counts: &[u32]) -> u64 {
    counts.iter().map(|&n| u64::from(n)).sum()
}
