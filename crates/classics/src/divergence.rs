//! Sample counts by divergences and entropies of a pixel's samples.

mod scores;

pub use scores::DivergenceScore;

use crate::method::{MethodSampler, SamplingMethod, WorstFirst, counts_so_far, lacking, total, with_extra};
use crate::recorders::{SampleSums, Singles};
use dapple_core::plan::{Feedback, PilotPolicy, Plan, Stopping, allocate, saturating_u32};
use dapple_core::{Error, Film, FirstHit, Needs, film::Recorder};
use std::mem;
use std::sync::Arc;

dapple_core::options! {
    /// The parameters of [`Divergence`]. All defaults are Dapple's.
    pub struct DivergenceOptions {
        /// Score: f-divergence (kl, chi2, hellinger, gh), entropy of radiance (entropy, tsallis, fuzzy) or of first hits (geometric).
        pub by: DivergenceScore = DivergenceScore::Hellinger => "hellinger";
        /// With by=tsallis: index of the entropy, 0.5, 1 or 2.
        pub q: f64 = 2.0 => "2", |q| [0.5, 1.0, 2.0].contains(&q), "0.5, 1 or 2, whose sums a film records";
        /// With by=fuzzy: deviation of a sample, as a multiple of the mean, at which its membership in the mean is 0.5.
        pub k: f64 = 1.0 => "1", |k| (0.001..=1000.0).contains(&k), "0.001 to 1000";
        /// With by=gh: exponent of the divergence; 0.5 is Hellinger's, 1 the total variation.
        pub a: f64 = 1.0 => "1", |a| a > 0.0 && a <= 1.0, "above 0 and at most 1";
        /// Samples per pixel before counts adapt, 2 to 128; with mode=budget at most half of the mean spp.
        pub pilot: u32 = 8, |pilot| (2..=128).contains(&pilot), "2 to 128 samples";
        /// With mode=threshold: samples per round for each pixel above the threshold.
        pub step: u32 = 8, |step| step != 0, "at least one sample";
        /// With mode=threshold: score above which a pixel is refined; 0 = automatic (kappa times the pilot's mean score).
        pub threshold: f64 = 0.0 => "0", |t| t >= 0.0 && t.is_finite(), "0 or above; 0 chooses";
        /// Factor on the pilot's mean score, used when threshold=0.
        pub kappa: f64 = 1.0 => "1", |kappa| kappa > 0.0 && kappa.is_finite(), "above 0";
        /// Maximum samples per pixel, as a multiple of the mean.
        pub cap: f64 = 8.0 => "8", |cap| cap >= 1.0 && cap.is_finite(), "at least 1";
        /// Stopping rule: budget (counts follow scores, until spent) or threshold (refine pixels above it, within the budget).
        pub mode: Stopping = Stopping::Budget => "budget";
        /// keep: samples used to set counts stay in the image (biased, as published); the only value.
        pub policy: PilotPolicy = PilotPolicy::Keep => "keep",
            |policy| policy == PilotPolicy::Keep, "only keep";
    }
}

/// A sampler that ranks pixels by a divergence, which measures how unequal a pixel's samples are [after Rigau 2003].
///
/// The samples `x_i` of one channel have the fractions `p_i = x_i / sum x`; equal fractions are `1 / n`. [`DivergenceScore`]
/// lists the scores. Most scores are functions of streaming sums, so that no sample is stored. `geometric` reads the first hits
/// of the pilot. `fuzzy` and `gh` read a pixel's first samples: as many as the pilot has, but at most 8.
///
/// With [`Stopping::Threshold`], each pixel gets `step` more samples while its score exceeds the threshold, as published.
/// [`Stopping::Budget`], the default, plans all counts at once from the pilot's scores `s` and counts `n`. It minimises the sum
/// over pixels of `s^2 n` divided by the final count. Every pixel's `s^2 n` is raised to at least 1 % of the mean `s^2 n`.
///
/// *Guarantees*: spends the budget exactly, or at most the budget with [`Stopping::Threshold`]. No pixel gets fewer samples
/// than the pilot. *Bias*: sample counts depend on the samples, and all samples are kept [Kirk and Arvo 1991].
///
/// *Weaknesses*: a score from few samples is as noisy as a variance from few samples, and is not pooled over neighbours. For a
/// small coefficient of variation `c`, all divergences depend on `c` alone: `kl` is about `c^2 / 2` and `hellinger` about `c /
/// sqrt 8`. `hellinger` reacts least to fireflies. Later samples do not change `geometric`, `fuzzy` and `gh`: with
/// [`Stopping::Threshold`], a pixel whose pilot exceeds the threshold is refined up to the cap. The factor `mean / n` of the
/// published score is quoted from memory. In the paper, refinement descends a tree over the image.
pub type Divergence<P> = MethodSampler<P, DivergenceOptions>;

impl DivergenceOptions {
    /// The score of each pixel, 0 or above.
    fn scores(&self, film: &Film) -> Result<Vec<f64>, Error> {
        let Self { by, q, k, a, pilot, .. } = *self;
        match by {
            DivergenceScore::Geometric => Ok(geometric_scores(film)),
            DivergenceScore::Fuzzy => scores::of_samples(film, pilot, |samples| scores::fuzzy(samples, k)),
            DivergenceScore::Gh => scores::of_samples(film, pilot, |x| scores::generalised_hellinger(x, a)),
            _ => scores::of_sums(by, q, film),
        }
    }

    /// Plans all counts from the current scores.
    fn plan_budget(&self, seen: &Feedback<'_>, scores: &[f64], plan: &mut Plan) -> Result<(), Error> {
        let budget = seen.budget;
        let now = counts_so_far(seen);
        let total = total(&now) + budget.left();
        let errors = scores.iter().zip(&now).map(|(s, &n)| (s * s * f64::from(n)).min(f64::MAX));
        let mut errors: Vec<f64> = errors.collect();
        let least = SCORE_FLOOR * errors.iter().map(|e| e / errors.len() as f64).sum::<f64>();
        errors.iter_mut().for_each(|e| *e = e.max(least));
        let floors: Vec<u32> = now.iter().map(|&n| n.max(budget.min_spp)).collect();
        let cap = (self.cap * total as f64 / now.len() as f64).ceil().min(f64::from(budget.max_spp)) as u32;
        let mut shared = allocate(&errors, &floors, cap, total)?;
        if shared.unspent > 0 {
            shared = allocate(&errors, &floors, budget.max_spp, total)?;
        }
        plan.counts = lacking(&shared.counts, &now);
        Ok(())
    }

    /// Plans `step` samples for each pixel above the threshold. If no threshold is set, it is chosen after the pilot.
    fn plan_threshold(
        &self,
        seen: &Feedback<'_>,
        mut scores: Vec<f64>,
        chosen: &mut Option<f64>,
        plan: &mut Plan,
    ) -> Result<(), Error> {
        let Self { threshold, kappa, step, cap, mode, .. } = *self;
        let mean = scores.iter().map(|s| s / scores.len() as f64).sum::<f64>();
        let threshold = if threshold > 0.0 { threshold } else { *chosen.get_or_insert(kappa * mean) };
        if threshold > 0.0 {
            scores.iter_mut().for_each(|s| *s /= threshold);
            WorstFirst { mode, step, cap }.plan(seen, &scores, plan)?;
        }
        Ok(())
    }
}

/// The smallest product of squared score and count, as a fraction of the mean product.
const SCORE_FLOOR: f64 = 0.01;

impl SamplingMethod for DivergenceOptions {
    const NAME: &'static str = "divergence";
    // A score per pixel; then the pixel's error, count so far, floor, and the memory of `allocate`.
    const PLANNING: usize = 8 + 28;

    fn needs(&self) -> Needs {
        match self.by {
            DivergenceScore::Chi2 => Needs::none().with_variance(),
            DivergenceScore::Tsallis if self.q > 1.0 => Needs::none().with_variance(),
            DivergenceScore::Geometric => Needs::none().with_first_hits(self.pilot as u8),
            _ => Needs::none(),
        }
    }

    fn recorders(&self) -> Vec<Arc<dyn Recorder>> {
        match self.by {
            DivergenceScore::Fuzzy | DivergenceScore::Gh => Singles::First.list(),
            by => scores::sums(by, self.q).map_or(Vec::new(), SampleSums::list),
        }
    }

    fn pilot_and_rounds(&self, mean: u64) -> (u32, Option<u32>) {
        match self.mode {
            Stopping::Threshold => (self.pilot, None),
            Stopping::Budget => (self.pilot.min(saturating_u32(mean / 2)).max(2), None),
        }
    }

    fn refine(&self, seen: &Feedback<'_>, _: u32, chosen: &mut Option<f64>, plan: &mut Plan) -> Result<(), Error> {
        let scores = self.scores(seen.film)?;
        match self.mode {
            Stopping::Threshold => self.plan_threshold(seen, scores, chosen, plan)?,
            Stopping::Budget if scores.iter().all(|&s| s == 0.0) => {
                plan.counts = with_extra(seen, mem::take(&mut plan.counts), seen.budget.left())?;
            }
            Stopping::Budget => self.plan_budget(seen, &scores, plan)?,
        }
        Ok(())
    }
}

/// The contrast `1 - H / ln n` of each pixel's first hits, which are weighted by `cos(theta) / d^2` [Rigau 2003, GI]. Misses
/// have weight 0. The contrast is 0 for pixels without hits or with fewer than two samples.
fn geometric_scores(film: &Film) -> Vec<f64> {
    let eye = eye(film);
    let score = |i: usize| {
        let hits = film.first_hits(i);
        // Entries of samples that were not traced hold no hit.
        let taken = hits.len().min(usize::try_from(film.count(i)).unwrap_or(usize::MAX));
        contrast(hits[..taken].iter().map(|hit| hit.as_ref().map_or(0.0, |hit| projected(hit, eye))))
    };
    (0..film.frame().pixels()).map(score).collect()
}

/// The contrast of non-negative values.
fn contrast(values: impl Iterator<Item = f64>) -> f64 {
    let (mut count, mut sum, mut logs) = (0.0, 0.0, 0.0);
    for value in values {
        count += 1.0;
        sum += value;
        logs += if value > 0.0 { value * libm::log(value) } else { 0.0 };
    }
    if count < 2.0 || sum <= 0.0 {
        return 0.0;
    }
    let divergence = logs / sum - libm::log(sum / count);
    if divergence > 1e-12 { divergence / libm::log(count) } else { 0.0 }
}

/// `cos(theta) / d^2` of a hit, seen from `eye`. If `eye` is `None`, the cosine is taken as 1.
fn projected(hit: &FirstHit, eye: Option<[f64; 3]>) -> f64 {
    let depth = f64::from(hit.depth).max(1e-9);
    let cosine = eye.map_or(1.0, |eye| {
        let (mut dot, mut square) = (0.0, 0.0);
        for ((eye, position), normal) in eye.into_iter().zip(hit.position).zip(hit.geometric_normal) {
            let d = eye - f64::from(position);
            dot += d * f64::from(normal);
            square += d * d;
        }
        if square > 0.0 { (dot.abs() / square.sqrt()).clamp(1e-3, 1.0) } else { 1.0 }
    });
    cosine / (depth * depth)
}

/// The camera's position: the point whose distances from all first hits are their depths. `None` if the hits do not determine
/// it, because all lie in a plane.
///
/// `|p - e|^2 = d^2` is linear in `e` and `|e|^2`, and is solved by least squares.
fn eye(film: &Film) -> Option<[f64; 3]> {
    let hits = || (0..film.frame().pixels()).flat_map(|i| film.first_hits(i)).flatten();
    let (mut count, mut centre) = (0.0, [0.0; 3]);
    for hit in hits() {
        count += 1.0;
        (0..3).for_each(|c| centre[c] += f64::from(hit.position[c]));
    }
    let centre = centre.map(|sum| sum / f64::max(count, 1.0));
    // Rows of the normal equations, with the right-hand side last.
    let mut rows = [[0.0; 5]; 4];
    for hit in hits() {
        let p: [f64; 3] = std::array::from_fn(|c| f64::from(hit.position[c]) - centre[c]);
        let square = p[0] * p[0] + p[1] * p[1] + p[2] * p[2];
        let row = [2.0 * p[0], 2.0 * p[1], 2.0 * p[2], -1.0, square - f64::from(hit.depth).powi(2)];
        for k in 0..4 {
            (0..5).for_each(|c| rows[k][c] += row[k] * row[c]);
        }
    }
    let [x, y, z, _] = solved(rows)?;
    Some([x + centre[0], y + centre[1], z + centre[2]])
}

/// Solves four linear equations by Gaussian elimination with pivots; `None` if they are nearly dependent.
fn solved(mut rows: [[f64; 5]; 4]) -> Option<[f64; 4]> {
    let largest = [0, 1, 2, 3].map(|k| rows[k][k].abs());
    for k in 0..4 {
        let pivot = (k..4).max_by(|&a, &b| rows[a][k].abs().total_cmp(&rows[b][k].abs()))?;
        rows.swap(k, pivot);
        if !rows[k][k].is_finite() || rows[k][k].abs() <= 1e-9 * largest[k] {
            return None;
        }
        for below in k + 1..4 {
            let factor = rows[below][k] / rows[k][k];
            let pivot = rows[k];
            rows[below].iter_mut().zip(pivot).skip(k).for_each(|(value, pivot)| *value -= factor * pivot);
        }
    }
    let mut solution = [0.0; 4];
    for k in (0..4).rev() {
        let known: f64 = (k + 1..4).map(|c| rows[k][c] * solution[c]).sum();
        solution[k] = (rows[k][4] - known) / rows[k][k];
    }
    solution.iter().all(|x| x.is_finite()).then_some(solution)
}
