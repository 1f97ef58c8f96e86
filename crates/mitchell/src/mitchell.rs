//! Mitchell's adaptive sampler: contrast in a neighbourhood determines sample counts, after Mitchell 1987.

use crate::extrema::{Extrema, NOTHING, contrast, windowed};
use crate::two_rates::{Rates, Rule, TwoRates};
use dapple_core::options::Options as _;
use dapple_core::plan::{PilotPolicy, Retention, Stopping};
use dapple_core::{Error, Film};

dapple_core::options! {
    /// The parameters of [`Mitchell`], the contrast-adaptive sampler.
    pub struct MitchellOptions {
        /// Samples per pixel before refinement; if this and `additional` are 0, both are automatic: they rise with spp (after Lan's table 4-2).
        ///
        /// [`Rates::for_mean`] returns the values of this table. The rates change when the budget per pixel has doubled.
        pub initial: u32 = 0;
        /// Additional samples per refined pixel; see initial.
        pub additional: u32 = 0;
        /// Contrast of red above which a pixel is refined.
        ///
        /// The three thresholds differ because the eye sees green best and blue worst [after Mitchell 1987].
        pub red: f64 = 0.4, |red| red > 0.0 && red <= 1.0, "above 0 and at most 1";
        /// Contrast of green above which a pixel is refined.
        pub green: f64 = 0.3, |green| green > 0.0 && green <= 1.0, "above 0 and at most 1";
        /// Contrast of blue above which a pixel is refined.
        pub blue: f64 = 0.6, |blue| blue > 0.0 && blue <= 1.0, "above 0 and at most 1";
        /// Radius in pixels of the window in which contrast is measured.
        ///
        /// 1 is Mitchell's neighbourhood of 3x3 pixels; 0 is the pixel alone.
        pub radius: u32 = 1, |radius| radius <= 64, "at most 64 pixels";
        /// Stopping rule: budget (highest contrast first, until spent) or threshold (pixels above threshold, within budget).
        ///
        /// With [`Stopping::Budget`], pixels are refined in the order of their contrast, even below the threshold. Once all
        /// are refined, each further pass adds `additional` samples per pixel in the same order. If all pixels have equal
        /// contrast, the budget is spread evenly instead. With [`Stopping::Threshold`], each pixel above the threshold is
        /// refined once. Where the budget runs out, one pixel gets only part of its samples.
        pub mode: Stopping = Stopping::Budget => "budget";
        /// Pilot samples: keep (biased), refined (discarded in refined pixels; more biased) or discard (unbiased).
        pub policy: PilotPolicy = PilotPolicy::Keep => "keep",
            |policy| !matches!(policy, PilotPolicy::Cross | PilotPolicy::Neighbours), "keep, refined or discard";
    }
}

impl Rule for MitchellOptions {
    const NAME: &str = "mitchell";
    // The ranges of pixels, of the rows of windows, and of windows.
    const SCORING: usize = 3 * size_of::<[[f32; 3]; 2]>();

    fn checked(self) -> Result<Self, Error> {
        let out = |name, value: u32, allowed| Err(Error::OutOfRange { name, value: value.to_string(), allowed });
        self.check_ranges()?;
        match (self.initial, self.additional) {
            (0, 0) => {}
            (0, _) => return out("initial", 0, "1 or more if additional is set; 0 for both chooses by the budget"),
            (_, 0) => return out("additional", 0, "1 or more if initial is set; 0 for both chooses by the budget"),
            (1, _) if self.radius == 0 => {
                return out("initial", 1, "2 or more, or 1 with a radius above 0, as a single sample has no contrast");
            }
            (initial, additional) if initial.checked_add(additional).is_none() => {
                return out("additional", additional, "at most 2^32 - 1 together with initial");
            }
            _ => {}
        }
        Ok(self)
    }

    fn modes(&self) -> (Stopping, PilotPolicy) {
        (self.mode, self.policy)
    }

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

    /// The largest ratio of contrast to threshold over the channels, per pixel. Pixels above 1 are refined.
    fn scores(&self, film: &Film) -> Result<Vec<f64>, Error> {
        let extrema = Extrema::of(film, "mitchell")?;
        let retention = if self.policy == PilotPolicy::Discard { Retention::Discard } else { Retention::Keep };
        let colours = |range: [[f32; 4]; 2]| range.map(|[r, g, b, _]| [r, g, b]);
        let range = |i| extrema.of_pixel(retention, i).map_or(NOTHING, colours);
        let ranges: Vec<_> = (0..film.frame().pixels()).map(range).collect();
        let windows = match self.radius {
            0 => ranges,
            radius => windowed(&ranges, film.frame().size(), radius),
        };
        let ratio = |window| {
            let each = contrast(window).into_iter().zip([self.red, self.green, self.blue]);
            each.map(|(contrast, threshold)| contrast / threshold).fold(0.0, f64::max)
        };
        Ok(windows.into_iter().map(ratio).collect())
    }
}

/// Mitchell's adaptive sampler: two sampling rates, selected by contrast [after Mitchell 1987].
///
/// After a first round, the contrast `(max - min) / (max + min)` of each channel is computed over the samples of 3x3 pixels.
/// Pixels in which a channel exceeds its threshold are refined to a second rate. Pixels are ranked by the largest ratio of
/// contrast to threshold; ties are broken by a hash of the pixel's index. The staged reconstruction of the paper is not
/// included.
///
/// *Guarantees*: the budget is spent exactly, or is an upper bound ([`Stopping`]). If the budget allows it, every pixel has at
/// least `initial` samples; a smaller budget is spent evenly.
///
/// *Bias*: see [`PilotPolicy`]. The default keeps the pilot and is biased.
///
/// *Weaknesses*: black and lit samples together have contrast 1, and contrast never falls as samples are added. Under Monte
/// Carlo noise nearly every pixel is therefore refined, and the ranking has many ties. A light that the pilots of a whole
/// neighbourhood miss has contrast 0 and is never found. There are only two rates.
///
/// Invalid options ([`Error::OutOfRange`]): `initial` or `additional` is 0 and the other is not; `initial` is 1 and `radius` is
/// 0; `initial + additional` is above 2^32 - 1; a threshold is outside (0, 1]; `radius` is above 64.
pub type Mitchell<P> = TwoRates<P, MitchellOptions>;
