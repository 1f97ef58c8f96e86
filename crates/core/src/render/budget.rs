//! Conversion of time and error limits into numbers of samples, and the measurement of a render's time.

use super::feature_samples::Turn;
use super::filtered_error::Prediction;
use crate::{Clock, Error, Film, Filter, Frame, Limits, Needs, limits::Budget, plan::BudgetLeft};
use std::ops::Range;

/// Computes the sample budget of each plan from the user's budget, and extends it when it is spent.
pub(super) struct Meter {
    budget: Budget,
    pixels: u64,
    min_spp: u32,
    max_spp: u32,
    total: u64,
    /// The seconds of a time limit that are reserved for the filter; `None` before they are measured.
    pub(super) filter_seconds: Option<f64>,
}

/// The fraction of the remaining time that the plan after the first round reserves for a last round, when the sampling
/// rate is known better.
const RESERVE: f64 = 0.1;
/// The minimum remaining time for which another round is planned, as a fraction of the time limit.
const ENOUGH: f64 = 0.03;

/// The minimum ordinary samples per pixel within a time limit that has feature-only samples. Other values were not measured.
const BESIDE_FEATURES: u64 = 4;
/// The assumed number of rays per pixel for feature-only samples, from which a time limit reserves their time. Pixels get 4
/// to 12 such samples; this is the mean.
const FEATURE_RAYS: u64 = 8;

impl Meter {
    pub(super) fn new(limits: &Limits, frame: &Frame) -> Result<Self, Error> {
        let Limits { min_spp, max_spp, .. } = *limits;
        if min_spp > max_spp || max_spp == 0 {
            let value = format!("{min_spp} .. {max_spp}");
            let allowed = "a minimum up to the maximum, and a maximum of at least 1";
            return Err(Error::OutOfRange { name: "samples per pixel", value, allowed });
        }
        let out = |name, value: f64, allowed| Err(Error::OutOfRange { name, value: value.to_string(), allowed });
        let pixels = frame.pixels() as u64;
        let total = match &limits.budget {
            Budget::PerPixel(spp) if !(spp.is_finite() && *spp > 0.0) => {
                return out("samples per pixel", *spp, "a number above zero");
            }
            Budget::Samples(_) | Budget::PerPixel(_) => limits.budget.samples(frame).unwrap_or(0),
            Budget::Seconds(s) if !(s.is_finite() && *s > 0.0) => return out("seconds", *s, "a time above zero"),
            Budget::Error { relmse, .. } if !(relmse.is_finite() && *relmse > 0.0) => {
                return out("relmse", *relmse, "an error above zero");
            }
            // One sample per pixel shows the cost of samples; four in two halves show their error.
            Budget::Seconds(_) => pixels * u64::from(min_spp.max(1)),
            Budget::Open => pixels * u64::from(min_spp.max(4)),
            Budget::Error { at_most, .. } => (pixels * u64::from(min_spp.max(4))).min(*at_most),
        };
        let (needed, most) = (pixels * u64::from(min_spp), pixels * u64::from(max_spp));
        if total < needed || total == 0 {
            return Err(Error::BudgetTooSmall { budget: total, needed: needed.max(1), pixels: frame.pixels() });
        }
        if total > most && limits.budget.is_of_samples() {
            return Err(Error::BudgetTooLarge { budget: total, most, pixels: frame.pixels() });
        }
        Ok(Self { budget: limits.budget, pixels, min_spp, max_spp, total, filter_seconds: None })
    }

    pub(super) fn needs(&self) -> Needs {
        Needs { halves: self.goal().is_some(), ..Needs::none() }
    }

    /// The relMSE of an error limit; `None` for other limits.
    pub(super) fn goal(&self) -> Option<f64> {
        if let Budget::Error { relmse, .. } = self.budget { Some(relmse) } else { None }
    }

    pub(super) fn seconds(&self) -> Option<f64> {
        if let Budget::Seconds(seconds) = self.budget { Some(seconds) } else { None }
    }

    /// Returns when feature-only samples are taken. With a time limit, the first round measures the cost of samples. The
    /// second round begins with features if the limit allows enough samples.
    pub(super) fn features(&self, round: u32) -> Turn {
        match round {
            _ if self.seconds().is_none() => Turn::First,
            1 if self.total >= BESIDE_FEATURES * self.pixels => Turn::Now,
            _ => Turn::Never,
        }
    }

    /// Restores the budget from a snapshot. A time or error limit continues with the snapshot's sample total.
    pub(super) fn restore(&mut self, total: u64, planned: u64) -> Result<(), Error> {
        if !self.budget.is_of_samples() {
            self.total = total;
        }
        if self.total < planned {
            let what =
                format!("{planned} samples are traced or planned already; raise the budget of {} samples", self.total);
            return Err(Error::OtherRender { what });
        }
        Ok(())
    }

    /// The budget of the last plan; its `spent` is the number of samples traced up to now.
    pub(super) fn left(&self, film: &Film) -> BudgetLeft {
        let spent = film.record().samples;
        BudgetLeft { spent, total: self.total, min_spp: self.min_spp, max_spp: self.max_spp }
    }

    /// Returns the budget for planning round `round`, after `seconds` of rendering.
    pub(super) fn show(&mut self, film: &Film, round: u32, seconds: f64) -> BudgetLeft {
        if let (Some(limit), 1) = (self.seconds(), round) {
            // The first round showed the cost of samples: plan the rest at once.
            let left = (limit - self.filter_seconds.unwrap_or(0.0) - seconds) * (1.0 - RESERVE);
            let all = self.affordable(film, left);
            let features = self.samples_for_features(film);
            let enough = all >= features.saturating_add(BESIDE_FEATURES * self.pixels);
            let most = BESIDE_FEATURES * self.pixels - 1;
            let all = if enough { all - features } else { all.min(most) };
            self.total = self.total.max(all.min(self.pixels * u64::from(self.max_spp)));
        }
        self.left(film)
    }

    /// Raises the sample total after the sampler is done, if the budget allows. Returns `true` if another plan may follow.
    /// `predicted` is the predicted error, for an error limit.
    pub(super) fn extend(&mut self, film: &Film, seconds: f64, predicted: Option<Prediction>) -> bool {
        let spent = film.record().samples;
        let before = self.total;
        match &self.budget {
            Budget::Samples(_) | Budget::PerPixel(_) => return false,
            Budget::Seconds(limit) => {
                let left = limit - self.filter_seconds.unwrap_or(0.0) - seconds;
                if left < ENOUGH * limit {
                    return false;
                }
                self.total = self.affordable(film, left);
                // A few samples are not worth another round.
                if self.total < spent + self.pixels.div_ceil(8) {
                    return false;
                }
            }
            Budget::Open => self.total = spent.saturating_mul(2),
            Budget::Error { relmse, at_most } => {
                let predicted = predicted.unwrap_or(Prediction { relmse: f64::INFINITY, fall: 1.0, confirmed: true });
                if predicted.relmse <= *relmse && predicted.confirmed || spent >= *at_most {
                    return false;
                }
                // At most twice the samples. An unconfirmed error gets enough new samples to confirm it.
                let least = if predicted.confirmed { 1.125 } else { 1.5 };
                let growth = (predicted.relmse / relmse).powf(1.0 / predicted.fall).clamp(least, 2.0);
                self.total = ((spent as f64 * growth) as u64).min(*at_most);
            }
        }
        // A sampler that stops by a threshold needs no more.
        self.total = self.total.min(self.pixels * u64::from(self.max_spp));
        spent >= before && self.total > spent
    }

    /// The number of samples that take as many rays as the feature-only samples of all pixels; 0 if the film records no
    /// features.
    fn samples_for_features(&self, film: &Film) -> u64 {
        let record = film.record();
        let rays = if film.needs().features { FEATURE_RAYS * self.pixels } else { 0 };
        (rays as f64 * record.samples as f64 / record.rays.max(1) as f64) as u64
    }

    /// The total number of samples that `left` more seconds allow, at the mean rate of the rounds so far. The time to
    /// measure the filter is not part of any round.
    fn affordable(&self, film: &Film, left: f64) -> u64 {
        let spent = film.record().samples;
        let seconds: f64 = film.record().rounds.iter().map(|round| round.plan_seconds + round.trace_seconds).sum();
        let rate = spent as f64 / seconds.max(1e-6);
        spent.saturating_add((rate * left.max(0.0)) as u64)
    }
}

/// A stopwatch for wall-clock time, without the time in the monitor.
pub(super) struct Stopwatch {
    pub(super) clock: Clock,
    /// The clock's reading when the stopwatch showed 0, plus the time left out since.
    zero: f64,
}

impl Stopwatch {
    /// Starts a stopwatch that shows `seconds` now.
    pub(super) fn start(clock: Clock, seconds: f64) -> Self {
        Self { zero: clock.seconds() - seconds, clock }
    }

    pub(super) fn seconds(&self) -> f64 {
        self.clock.seconds() - self.zero
    }

    /// Subtracts the time since the stopwatch showed `seconds`.
    pub(super) fn leave_out_since(&mut self, seconds: f64) {
        self.zero += self.seconds() - seconds;
    }
}

/// The divisor of the image's rows that gives the number of rows on which a filter is timed.
const PART: u32 = 16;
/// The minimum number of pixels on which a filter is timed; smaller images are filtered whole. A larger number would take
/// much of a short time limit.
const LEAST: u32 = 1 << 12;

/// The rows of the window, in the middle of the image, on which a filter is timed.
pub(super) fn timed_rows(frame: &Frame) -> Range<u32> {
    let [width, height] = frame.size();
    let rows = (height / PART).max(LEAST.div_ceil(width)).min(height);
    let top = (height - rows) / 2;
    top..top + rows
}

/// The reserved time over the estimate. Large images take more time per row, and times vary by a fifth from run to run.
const MARGIN: f64 = 1.2;

/// Estimates the wall-clock seconds that a filter takes on an image of `height` rows: the line through its times on the
/// rows in `part` and on a quarter of them, and a margin. Returns 0 if the filter fails.
///
/// The quarter is filtered twice, and the shorter time counts, since the first run may start threads or load a library.
/// Each further row counts at least half of a row of `part`, since times vary.
pub(super) fn time_of(filter: &dyn Filter, part: &Film, height: u32, clock: &Clock) -> f64 {
    let rows = part.frame.size()[1];
    let least = rows.div_ceil(4);
    let time = |part: &Film| {
        let began = clock.seconds();
        filter.apply(part).ok().map(|_| clock.seconds() - began)
    };
    let times = || {
        let quarter = part.of_rows(0..least).ok()?;
        Some((time(&quarter)?.min(time(&quarter)?), time(part)?))
    };
    let Some((few, all)) = times() else { return 0.0 };
    let mean = all / f64::from(rows);
    let each = ((all - few) / f64::from((rows - least).max(1))).clamp(0.5 * mean, mean);
    MARGIN * (all + each * f64::from(height - rows))
}

/// The filter's time for a film with `more` times as many samples, relative to its time for `spp` samples per pixel.
pub(super) fn growth(filter: &dyn Filter, needs: &Needs, spp: f64, more: f64) -> f64 {
    let runs = |spp: f64| f64::from(filter.runs(needs, spp).max(1));
    runs(spp * more.max(1.0)) / runs(spp)
}
