//! The stopping rule of Blender's Cycles.

use crate::pilot::{Pilot, clamped};
use dapple_core::{
    Error, Feedback, Film, Frame, Limits, Needs, PilotPolicy, Plan, PointSet, Progress, Sampler, SamplerMemory,
    Stopping, allocate,
};

/// The parameters of [`Cycles`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CyclesOptions {
    /// The user's threshold, of which five times is what errors are compared with; 0 takes 1 over the mean budget, and not
    /// below 0.001.
    pub threshold: f64,
    /// Samples per pixel before anything stops; 0 takes `16 t^-0.3` (4 or more) for threshold `t`, and with
    /// [`Stopping::Budget`] no more than a quarter of the mean budget.
    pub min: u32,
    /// Samples of an open pixel between two looks at it.
    pub step: u32,
    /// What ends it.
    pub mode: Stopping,
}

impl Default for CyclesOptions {
    fn default() -> Self {
        Self { threshold: 0.0, min: 0, step: 16, mode: Stopping::default() }
    }
}

impl CyclesOptions {
    /// The user's threshold and the first samples per pixel, for a mean budget.
    fn resolved(&self, mean: u64) -> (f64, u32) {
        let Self { threshold, min, mode, .. } = *self;
        let threshold = if threshold > 0.0 { threshold } else { (1.0 / mean.max(1) as f64).max(LEAST_THRESHOLD) };
        if min > 0 {
            return (threshold, min);
        }
        let chosen = (16.0 * threshold.powf(-0.3)).ceil().clamp(4.0, f64::from(u32::MAX)) as u32;
        match mode {
            Stopping::Threshold => (threshold, chosen),
            Stopping::Budget => (threshold, chosen.min(clamped(mean / 4)).max(4)),
        }
    }
}

/// Errors are compared with so many times the user's threshold.
const LOOSENED: f64 = 5.0;
/// The least threshold that is chosen for the user; what keeps black pixels from dividing by zero.
const LEAST_THRESHOLD: f64 = 1e-3;
const BLACK: f64 = 1e-4;

/// The adaptive sampling of Blender's Cycles [Cycles, `kernel/film/adaptive_sampling.h` and `scene/integrator.cpp`; after
/// Dammertz 2010].
///
/// *What*: each pixel's mean is compared with that of half of its samples, `(|dR| + |dG| + |dB|) / (1e-4 + N(I))` with
/// `N(I)` the root of `I = R + G + B` below 1 and `I` above; pixels whose error exceeds five times the threshold, and
/// their eight neighbours, get another `step` samples. The halves are two independent sequences, where Cycles splits one,
/// whose parts are no independent estimates. *Guarantees*: the budget exactly, or as a ceiling; no pixel below `min`
/// where the budget allows it. *Bias*: all samples are kept, and decide how many follow [Kirk and Arvo 1991]: a pixel stops
/// when its halves happen to agree. *Weaknesses*: one pixel's two halves say little about its error; the threshold
/// is one for all brightnesses; fireflies keep a pixel open.
pub struct Cycles<P> {
    points: P,
    options: CyclesOptions,
}

impl<P: PointSet> Cycles<P> {
    /// With these points and the default parameters.
    pub fn new(points: P) -> Self {
        Self { points, options: CyclesOptions::default() }
    }

    /// With these points and parameters.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] for a threshold that is negative or not finite, a `min` of 1, and a `step` of 0.
    pub fn with_options(points: P, options: CyclesOptions) -> Result<Self, Error> {
        let out = |name, value: String, allowed| Err(Error::OutOfRange { name, value, allowed });
        if !(options.threshold >= 0.0 && options.threshold.is_finite()) {
            return out("threshold", options.threshold.to_string(), "0 or above; 0 chooses");
        }
        if options.min == 1 {
            return out("min", "1".into(), "each of the two halves needs a sample; 0 chooses");
        }
        if options.step == 0 {
            return out("step", "0".into(), "at least one sample");
        }
        Ok(Self { points, options })
    }

    /// One more step for open pixels, those of the largest error first where not all can have it.
    fn refine(&self, seen: &Feedback<'_>, threshold: f64, plan: &mut Plan) -> Result<(), Error> {
        let errors: Vec<f64> = (0..seen.pixels()).map(|i| half_error(seen.film, i)).collect();
        let mut limit = LOOSENED * threshold;
        if self.options.mode == Stopping::Budget {
            limit = limit.min(0.5 * errors.iter().copied().fold(0.0, f64::max));
        }
        let room: Vec<u32> = (0..seen.pixels())
            .map(|i| seen.budget.max_spp - seen.film.count(i).min(seen.budget.max_spp.into()) as u32)
            .collect();
        let open = with_neighbours(&errors.iter().map(|&e| e > limit).collect::<Vec<_>>(), seen.frame().size());
        let mut order: Vec<usize> = (0..seen.pixels()).filter(|&i| open[i] && room[i] > 0).collect();
        order.sort_by(|&a, &b| errors[b].total_cmp(&errors[a]).then(a.cmp(&b)));
        let mut left = seen.budget.left();
        for i in order {
            plan.counts[i] = self.options.step.min(room[i]).min(clamped(left));
            left -= u64::from(plan.counts[i]);
        }
        if plan.total() == 0 && self.options.mode == Stopping::Budget {
            // Nothing differs, or what differs has all that it may have: the rest is everybody's.
            let now: Vec<u32> = (0..seen.pixels()).map(|i| seen.film.count(i) as u32).collect();
            let total = seen.film.counts().iter().sum::<u64>() + seen.budget.left();
            let shared = allocate(&vec![1.0; now.len()], &now, seen.budget.max_spp, total)?;
            plan.counts = shared.counts.iter().zip(&now).map(|(n, now)| n - now).collect();
        }
        Ok(())
    }
}

/// How much the mean of pixel `i` differs from that of its first half.
fn half_error(film: &Film, i: usize) -> f64 {
    let mean = film.mean(i);
    let half = film.half(0, i).unwrap_or_default().mean;
    let difference: f64 = mean.iter().zip(half).map(|(all, half)| (all - half).abs()).sum();
    let sum: f64 = mean.iter().sum::<f64>().max(0.0);
    let error = difference / (BLACK + if sum < 1.0 { sum.sqrt() } else { sum });
    if error.is_finite() { error } else { 0.0 }
}

/// Open pixels and the eight around each, in two passes.
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
        let CyclesOptions { threshold, min, step, mode } = self.options;
        format!("cycles:threshold={threshold},min={min},step={step},mode={},policy=keep", mode.name())
    }

    fn needs(&self) -> Needs {
        Needs::none().with_halves()
    }

    fn memory(&self, frame: &Frame, _: &Needs, _: &Limits) -> SamplerMemory {
        // Errors, room, what is open and its neighbours, and the order of all where all are.
        SamplerMemory::planning(frame, false, 8 + 4 + 3 + size_of::<usize>())
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
        if !Pilot::new(PilotPolicy::Keep, first).begin(seen, plan).is_missing {
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
        // ALGORITHMS, row 10: 32, 64 and 128 for these thresholds, to the next whole number of 16 t^-0.3.
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
