//! Contrast in a neighbourhood, after Mitchell 1987.

use crate::Rates;
use crate::contrast::{NOTHING, contrast, windowed};
use crate::two_rates::TwoRates;
use dapple_core::{
    Error, Feedback, Film, Frame, Limits, Needs, PilotPolicy, Plan, PointSet, Progress, Sampler, SamplerMemory,
    Stopping,
};

/// The parameters of [`Mitchell`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MitchellOptions {
    /// Samples that every pixel gets, and that decide. 0, only together with `additional`, chooses by
    /// [`Rates::for_mean`], and anew where the budget is raised to twice what it was.
    pub initial: u32,
    /// Samples that a refined pixel has besides; 0 as above.
    pub additional: u32,
    /// Contrast of red, green and blue above which a pixel asks to be refined, in `(0, 1]`: the eye
    /// sees green best and blue worst (after Mitchell 1987).
    pub thresholds: [f64; 3],
    /// Contrast is taken over `2 radius + 1` pixels squared, at most 64 pixels: 1 is the paper's
    /// neighbourhood, 0 the pixel alone.
    pub radius: u32,
    /// What ends the refinement.
    pub mode: Stopping,
    /// What becomes of the pilot.
    pub policy: PilotPolicy,
}

impl Default for MitchellOptions {
    fn default() -> Self {
        Self {
            initial: 0,
            additional: 0,
            thresholds: [0.4, 0.3, 0.6],
            radius: 1,
            mode: Stopping::Budget,
            policy: PilotPolicy::Keep,
        }
    }
}

impl MitchellOptions {
    /// Samples of one pixel that have a contrast.
    fn least(&self) -> u32 {
        if self.radius == 0 { 2 } else { 1 }
    }

    fn rates(&self, mean: u64) -> Rates {
        if self.initial > 0 {
            return Rates { initial: self.initial, additional: self.additional };
        }
        let rates = Rates::for_mean(mean);
        Rates { initial: rates.initial.max(self.least()), ..rates }
    }

    /// The largest ratio of contrast to threshold, per pixel: above 1 it asks.
    fn scores(&self, film: &Film) -> Vec<f64> {
        let discards = self.policy == PilotPolicy::Discard;
        let range = |i| if discards { film.discarded_range(i) } else { film.range(i) };
        let ranges: Vec<_> = (0..film.frame().pixels()).map(|i| range(i).unwrap_or(NOTHING)).collect();
        let windows = match self.radius {
            0 => ranges,
            radius => windowed(&ranges, film.frame().size(), radius),
        };
        let ratio = |window| {
            let each = contrast(window).into_iter().zip(self.thresholds);
            each.map(|(contrast, threshold)| contrast / threshold).fold(0.0, f64::max)
        };
        windows.into_iter().map(ratio).collect()
    }
}

/// Two rates by contrast, after Mitchell 1987.
///
/// *What*: a base round; the contrast `(max - min) / (max + min)` of each channel over the samples of
/// 3x3 pixels; pixels where one exceeds its threshold are refined to a second rate. Pixels are ranked
/// by the largest ratio of contrast to threshold, ties by a hash of their number. The staged
/// reconstruction of the paper is a filter's business and not part of this.
/// *Guarantees*: the budget exactly, or as a ceiling ([`Stopping`]); where the budget is at least `initial`
/// per pixel, no pixel below that; below, it is spent evenly. What bias there is, [`PilotPolicy`] says; the
/// default keeps the pilot and is biased.
/// *Weaknesses*: the contrast of dark noise is 1, and contrast never falls as samples are added, so
/// that under Monte Carlo noise nearly every pixel asks and the ranking ties; a light that the whole
/// neighbourhood's pilot misses has contrast 0 and is never searched for; two rates only.
pub struct Mitchell<P> {
    points: P,
    options: MitchellOptions,
    two_rates: TwoRates,
}

impl<P: PointSet> Mitchell<P> {
    /// With these points and the default parameters.
    pub fn new(points: P) -> Self {
        Self { points, options: MitchellOptions::default(), two_rates: TwoRates::default() }
    }

    /// With these points and parameters.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] when only one of the rates is chosen by itself (0), when one sample shall
    /// have a contrast (`initial` 1 with `radius` 0), when the rates add up to more than 2^32 - 1, for a
    /// threshold outside (0, 1] and for a radius above 64.
    pub fn with_options(points: P, options: MitchellOptions) -> Result<Self, Error> {
        let out = |name, value: String, allowed| Err(Error::OutOfRange { name, value, allowed });
        let o = options;
        if (o.initial == 0) != (o.additional == 0) {
            let (name, allowed) = match o.initial {
                0 => ("initial", "1 or more beside additional; 0 for both chooses by the budget"),
                _ => ("additional", "1 or more beside initial; 0 for both chooses by the budget"),
            };
            return out(name, "0".into(), allowed);
        }
        if o.initial == 1 && o.radius == 0 {
            return out("initial", "1".into(), "one sample alone has no contrast: 2 or more, or a radius above 0");
        }
        if o.initial.checked_add(o.additional).is_none() {
            return out("additional", o.additional.to_string(), "with initial at most 2^32 - 1");
        }
        for (name, threshold) in ["red", "green", "blue"].into_iter().zip(o.thresholds) {
            if !(threshold > 0.0 && threshold <= 1.0) {
                return out(name, threshold.to_string(), "a threshold of contrast lies in (0, 1]");
            }
        }
        if o.radius > 64 {
            return out("radius", o.radius.to_string(), "at most 64 pixels");
        }
        Ok(Self { points, options, two_rates: TwoRates::new(o.mode, o.policy) })
    }
}

impl<P: PointSet> Sampler for Mitchell<P> {
    fn name(&self) -> &str {
        "mitchell"
    }

    fn describe(&self) -> String {
        let MitchellOptions { initial, additional, thresholds: [r, g, b], radius, mode, policy } = self.options;
        let (mode, policy) = (mode.name(), policy.name());
        format!(
            "mitchell:initial={initial},additional={additional},red={r},green={g},blue={b},radius={radius},mode={mode},policy={policy}"
        )
    }

    fn needs(&self) -> Needs {
        Needs::none().with_extrema()
    }

    fn points(&self) -> &dyn PointSet {
        &self.points
    }

    fn next_round(&mut self, seen: &Feedback<'_>, plan: &mut Plan) -> Result<Progress, Error> {
        seen.film.require(self.name(), &self.needs())?;
        let options = self.options;
        let rates = |mean| options.rates(mean);
        self.two_rates.next_round(seen, plan, rates, options.least(), |film| options.scores(film))
    }

    fn memory(&self, frame: &Frame, needs: &Needs, limits: &Limits) -> SamplerMemory {
        // Ranges, those of rows and those of windows.
        self.two_rates.memory(frame, needs, limits, 3 * size_of::<[[f32; 3]; 2]>())
    }

    fn save(&self) -> Vec<u8> {
        self.two_rates.save()
    }

    fn restore(&mut self, saved: &[u8]) -> Result<(), Error> {
        self.two_rates.restore(saved)
    }
}
