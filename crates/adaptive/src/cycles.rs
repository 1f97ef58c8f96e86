//! The adaptive sampler of Blender's Cycles.

use crate::pilot::Pilot;
use dapple_core::options::Options as _;
use dapple_core::plan::{Feedback, PilotPolicy, Plan, Progress, SamplerMemory, Stopping, allocate, saturating_u32};
use dapple_core::{Error, Film, Frame, Limits, Needs, PointSet, Sampler};

dapple_core::options! {
    /// The parameters of [`Cycles`], the adaptive sampling of Blender's Cycles.
    pub struct CyclesOptions {
        /// Noise threshold of Cycles: a pixel stops when its relative error is below 5 times this; 0 = automatic (1/spp, at least 0.001).
        pub threshold: f64 = 0.0 => "0", |t| t >= 0.0 && t.is_finite(), "0 or above; 0 chooses";
        /// Minimum samples per pixel before any pixel stops; 0 = automatic (16 x threshold^-0.3; with mode=budget at most spp/4).
        ///
        /// The automatic minimum is never below 4.
        pub min: u32 = 0, |min| min != 1, "at least 2, one for each half; 0 chooses";
        /// Samples per round for each pixel that has not stopped.
        pub step: u32 = 16, |step| step != 0, "at least one sample";
        /// Stopping rule: budget (the threshold falls until all samples are spent) or threshold (until all pixels have stopped, within the budget).
        ///
        /// With [`Stopping::Budget`], errors are compared with 5 times the threshold or half of the largest error, whichever is
        /// less.
        pub mode: Stopping = Stopping::Budget => "budget";
        /// keep: samples used to set counts stay in the image (biased, as published); the only value.
        pub policy: PilotPolicy = PilotPolicy::Keep => "keep",
            |policy| policy == PilotPolicy::Keep, "only keep";
    }
}

impl CyclesOptions {
    /// The threshold and the minimum number of samples per pixel in effect, for a mean budget of `mean` samples per pixel.
    fn resolved(&self, mean: u64) -> (f64, u32) {
        let Self { threshold, min, mode, .. } = *self;
        let threshold = if threshold > 0.0 { threshold } else { (1.0 / mean.max(1) as f64).max(LEAST_THRESHOLD) };
        if min > 0 {
            return (threshold, min);
        }
        let chosen = (16.0 * threshold.powf(-0.3)).ceil().clamp(4.0, f64::from(u32::MAX)) as u32;
        let most = if mode == Stopping::Budget { saturating_u32(mean / 4).max(4) } else { u32::MAX };
        (threshold, chosen.min(most))
    }
}

/// The factor by which Cycles multiplies the user's threshold before comparing errors with it.
const LOOSENED: f64 = 5.0;
/// The smallest threshold that is chosen automatically.
const LEAST_THRESHOLD: f64 = 1e-3;
/// The number added to the denominator to avoid a division by zero in black pixels.
const BLACK: f64 = 1e-4;

/// The adaptive sampler of Blender's Cycles [Cycles, `kernel/film/adaptive_sampling.h` and `scene/integrator.cpp`;
/// after Dammertz 2010].
///
/// A pixel's error is `(|dR| + |dG| + |dB|) / (1e-4 + N(I))`. `dR`, `dG` and `dB` are the differences between the mean `(R, G,
/// B)` of all samples and the mean of one half. `I` is `R + G + B`, and `N(I)` is `sqrt(I)` for `I < 1` and `I` otherwise.
/// Pixels whose error exceeds five times the threshold, and their eight neighbours, get another `step` samples. The halves here
/// are independent; those of Cycles are not, since it splits one sequence.
///
/// *Guarantees*: spends the budget exactly, or at most the budget with [`Stopping::Threshold`]. No pixel gets fewer than `min`
/// samples if the budget allows it. *Bias*: sample counts depend on the samples, and all samples are kept [Kirk and Arvo 1991].
/// A pixel may stop because its halves agree by chance. *Weaknesses*: the two halves of one pixel are a poor error estimate,
/// one threshold applies to all brightnesses, and fireflies keep a pixel from stopping.
pub struct Cycles<P> {
    points: P,
    options: CyclesOptions,
}

impl<P: PointSet> Cycles<P> {
    /// Creates a sampler that uses this point set, with the default parameters.
    pub fn new(points: P) -> Self {
        Self { points, options: CyclesOptions::default() }
    }

    /// Creates a sampler that uses this point set, with these parameters.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] for the first parameter out of range.
    pub fn with_options(points: P, options: CyclesOptions) -> Result<Self, Error> {
        options.check_ranges()?;
        Ok(Self { points, options })
    }

    /// Plans `step` more samples for each open pixel (one that has not converged). If the budget is too small for all, the
    /// pixels with the largest errors come first.
    fn refine(&self, seen: &Feedback<'_>, threshold: f64, plan: &mut Plan) -> Result<(), Error> {
        let errors: Vec<f64> = (0..seen.pixels()).map(|i| half_error(seen.film, i)).collect();
        let mut limit = LOOSENED * threshold;
        if self.options.mode == Stopping::Budget {
            limit = limit.min(0.5 * errors.iter().copied().fold(0.0, f64::max));
        }
        let most = seen.budget.max_spp;
        let now: Vec<u32> = seen.film.counts().into_iter().map(saturating_u32).collect();
        let open = with_neighbours(&errors.iter().map(|&e| e > limit).collect::<Vec<_>>(), seen.frame().size());
        let mut order: Vec<usize> = (0..seen.pixels()).filter(|&i| open[i] && now[i] < most).collect();
        order.sort_by(|&a, &b| errors[b].total_cmp(&errors[a]).then(a.cmp(&b)));
        let mut left = seen.budget.left();
        for i in order {
            plan.counts[i] = self.options.step.min(most - now[i]).min(saturating_u32(left));
            left -= u64::from(plan.counts[i]);
        }
        if plan.total() == 0 && self.options.mode == Stopping::Budget {
            // No pixel is open, or all open pixels are at their ceiling, so the rest is spread evenly.
            let total = seen.film.counts().iter().sum::<u64>() + seen.budget.left();
            let shared = allocate(&vec![1.0; now.len()], &now, most, total)?;
            plan.counts = shared.counts.iter().zip(&now).map(|(n, now)| n - now).collect();
        }
        Ok(())
    }
}

/// The relative difference between the mean of pixel `i` and the mean of its first half.
fn half_error(film: &Film, i: usize) -> f64 {
    let mean = film.mean(i);
    let half = film.half(0, i).unwrap_or_default().mean;
    let difference: f64 = mean.iter().zip(half).map(|(all, half)| (all - half).abs()).sum();
    let sum: f64 = mean.iter().sum::<f64>().max(0.0);
    let error = difference / (BLACK + if sum < 1.0 { sum.sqrt() } else { sum });
    if error.is_finite() { error } else { 0.0 }
}

/// Marks the open pixels (those that have not converged) and the eight neighbours of each.
fn with_neighbours(open: &[bool], [w, h]: [u32; 2]) -> Vec<bool> {
    let (w, h) = (w as usize, h as usize);
    let near = |at: usize, end: usize| at.saturating_sub(1)..(at + 2).min(end);
    let wide: Vec<bool> = (0..open.len()).map(|i| near(i % w, w).any(|x| open[i / w * w + x])).collect();
    (0..open.len()).map(|i| near(i / w, h).any(|y| wide[y * w + i % w])).collect()
}

impl<P: PointSet> Sampler for Cycles<P> {
    fn name(&self) -> &str {
        "cycles"
    }

    fn describe(&self) -> String {
        format!("cycles:{}", self.options.describe())
    }

    fn needs(&self) -> Needs {
        Needs::none().with_halves()
    }

    fn memory(&self, frame: &Frame, _: &Needs, _: &Limits) -> SamplerMemory {
        // Per pixel: the error, the room below the ceiling, three flags for open pixels and their neighbours, and an index in
        // the order.
        SamplerMemory::planning(frame, 8 + 4 + 3 + size_of::<usize>())
    }

    fn points(&self) -> &dyn PointSet {
        &self.points
    }

    fn next_round(&mut self, seen: &Feedback<'_>, plan: &mut Plan) -> Result<Progress, Error> {
        seen.film.require(self.name(), &self.needs())?;
        if seen.budget.left() == 0 {
            return Ok(Progress::Done);
        }
        let (threshold, min) = self.options.resolved(seen.budget.total / seen.pixels() as u64);
        let first = min.max(seen.budget.min_spp).min(seen.budget.max_spp);
        if !Pilot::new(self.options.policy, first).begin(seen, plan).is_missing {
            self.refine(seen, threshold, plan)?;
        }
        Ok(if plan.total() == 0 { Progress::Done } else { Progress::Trace })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_open_pixel_opens_its_eight_neighbours_and_no_others() {
        for (at, expected) in [([2, 2], 9), ([0, 0], 4), ([4, 1], 6)] {
            let mut open = vec![false; 5 * 4];
            open[at[1] * 5 + at[0]] = true;
            let found = with_neighbours(&open, [5, 4]);
            let wrong = (0..20).filter(|i| found[*i] != ((i % 5).abs_diff(at[0]) <= 1 && (i / 5).abs_diff(at[1]) <= 1));
            assert_eq!((found.iter().filter(|open| **open).count(), wrong.count()), (expected, 0), "{at:?}");
        }
        assert_eq!(with_neighbours(&[true], [1, 1]), [true]);
    }

    #[test]
    fn least_samples_are_those_of_cycles() {
        // 16 t^-0.3, rounded up.
        let of = |threshold, mode| {
            let options = CyclesOptions { threshold, mode, ..CyclesOptions::default() };
            options.resolved(4096).1
        };
        assert_eq!([0.1, 0.01, 0.001].map(|t| of(t, Stopping::Threshold)), [32, 64, 128]);
        assert_eq!(of(0.1, Stopping::Budget), 32);
        assert_eq!(
            [8, 32, 64].map(|mean| CyclesOptions::default().resolved(mean)),
            [(0.125, 4), (1.0 / 32.0, 8), (1.0 / 64.0, 16)]
        );
    }
}
