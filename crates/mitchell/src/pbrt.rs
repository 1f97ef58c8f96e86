//! The `adaptive` sampler of pbrt-v2.

use crate::extrema::{Extrema, deviation};
use crate::two_rates::{Rates, Rule, TwoRates};
use dapple_core::options::Options as _;
use dapple_core::plan::{PilotPolicy, Retention, Stopping};
use dapple_core::{Error, Film, FirstHit, Needs, film::luminance};

/// The test that determines which pixels [`MitchellPbrt`] refines.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PbrtTest {
    /// A sample's luminance deviates from the mean of the pilot samples (pbrt-v2's `contrast`).
    #[default]
    Contrast,
    /// Two consecutive pilot samples hit different shapes or primitives, or only one of them hits anything (pbrt-v2's
    /// `shapeid`).
    ShapeId,
    /// Two consecutive pilot samples hit different shapes, or only one of them hits anything. Unlike [`PbrtTest::ShapeId`],
    /// edges within a mesh do not count.
    Shape,
}

dapple_core::choices!(PbrtTest { Contrast = "contrast", ShapeId = "shapeid", Shape = "shape" });

dapple_core::options! {
    /// The parameters of [`MitchellPbrt`], the `adaptive` sampler of pbrt-v2.
    pub struct MitchellPbrtOptions {
        /// Samples per pixel before refinement, rounded up to a power of two.
        pub min: u32 = 4, |min| min >= 2, "at least 2";
        /// Samples per refined pixel, rounded up to a power of two.
        ///
        /// If rounding makes `min` and `max` equal, `max` is doubled.
        pub max: u32 = 32;
        /// Refinement threshold: the deviation of a pilot sample's luminance from the pilot's mean, as a fraction of the mean.
        pub threshold: f64 = 0.5, |t| t > 0.0 && t.is_finite(), "a relative deviation above 0";
        /// Stopping rule: budget (largest deviation first, until spent) or threshold (pixels above threshold, within budget).
        ///
        /// The rule works as in [`MitchellOptions::mode`](crate::MitchellOptions::mode), with deviation instead of contrast.
        pub mode: Stopping = Stopping::Budget => "budget";
        /// Pilot samples: keep (biased), refined (as published: lost in refined pixels; more biased) or discard (unbiased).
        pub policy: PilotPolicy = PilotPolicy::Refined => "refined",
            |policy| !matches!(policy, PilotPolicy::Cross | PilotPolicy::Neighbours), "refined, keep or discard";
        /// Test for refinement: pilot samples differ in contrast (luminance), shape (object) or shapeid (object or triangle).
        ///
        /// With shape and shapeid, the threshold has no effect. Pixels are ranked by how often successive samples differ.
        pub test: PbrtTest = PbrtTest::Contrast => "contrast";
    }
}

/// The `adaptive` sampler of pbrt-v2 with its tests `contrast` and `shapeid` [pbrt-v2, `src/samplers/adaptive.cpp`].
///
/// Each pixel gets `min` pilot samples. If the luminance `Y` of any pilot sample has `|Y - mean| / mean > threshold`,
/// then `max` new samples replace the pilot samples. With [`Stopping::Threshold`] and [`PilotPolicy::Refined`] this is the
/// published rule. [`Stopping::Budget`], the default, refines the largest deviation first until the budget is spent. With
/// [`PilotPolicy::Keep`] the pilot samples stay in the image and count towards `max`.
///
/// [`PbrtTest::ShapeId`] refines a pixel if two consecutive pilot samples hit different shapes or primitives. If two shapes
/// cover fractions `a` and `1 - a` of a pixel, four pilot samples refine it with probability `1 - a^4 - (1 - a)^4`.
///
/// *Guarantees*: the budget is spent exactly, or is an upper bound. If the budget allows it, every pixel has at least `min`
/// samples.
///
/// *Weaknesses*: the published rule is biased. For a pilot of two samples that are 1 with probability `p`, else 0, a pixel's
/// expected value is `3 p^2 - 2 p^3` (see [`PilotPolicy`]). A black pilot has no deviation, so its pixel is never refined. Each
/// pixel is judged alone. The published form has no budget. `shapeid` refines every pixel of a mesh whose triangles are smaller
/// than pixels, and ignores shadows and reflections.
///
/// Invalid options ([`Error::OutOfRange`]): `min` below 2 or above 2^30, or above 128 with `shape` or `shapeid`; `max` below
/// `min` or above 2^31; a threshold that is not a finite number above 0.
pub type MitchellPbrt<P> = TwoRates<P, MitchellPbrtOptions>;

/// The largest pilot whose first hits a film keeps, a power of two.
const MOST_HITS: u32 = 128;

impl Rule for MitchellPbrtOptions {
    const NAME: &str = "mitchell-pbrt";
    const SCORING: usize = size_of::<f64>();

    fn checked(self) -> Result<Self, Error> {
        let out = |name, value: u32, allowed| Err(Error::OutOfRange { name, value: value.to_string(), allowed });
        self.check_ranges()?;
        let Self { min, max, .. } = self;
        if max < min {
            return out("max", max, "at least min");
        }
        if max > 1 << 31 || min > 1 << 30 {
            return out("max", max, "at most 2^31, and at most 2^30 for min");
        }
        if self.test != PbrtTest::Contrast && min > MOST_HITS {
            return out("min", min, "at most 128 with test=shapeid or shape, which record all first hits");
        }
        let min = min.next_power_of_two();
        Ok(Self { min, max: max.next_power_of_two().max(2 * min), ..self })
    }

    fn modes(&self) -> (Stopping, PilotPolicy) {
        (self.mode, self.policy)
    }

    fn needs(&self) -> Needs {
        match self.test {
            PbrtTest::Contrast => Needs::none(),
            PbrtTest::ShapeId | PbrtTest::Shape => Needs::none().with_first_hits(self.min.min(MOST_HITS) as u8),
        }
    }

    fn reads_extrema(&self) -> bool {
        self.test == PbrtTest::Contrast
    }

    fn least(&self) -> u32 {
        2
    }

    fn rates(&self, _: u64) -> Rates {
        Rates { initial: self.min, additional: self.max - self.min }
    }

    fn scores(&self, film: &Film) -> Result<Vec<f64>, Error> {
        match self.test {
            PbrtTest::Contrast => self.deviations(film),
            PbrtTest::ShapeId => Ok(self.changes(film, |hit| [hit.shape, hit.primitive])),
            PbrtTest::Shape => Ok(self.changes(film, |hit| [hit.shape, 0])),
        }
    }
}

impl MitchellPbrtOptions {
    /// One more than the number of consecutive pilot samples whose first hits differ in `name`, per pixel; 0 if none differ.
    fn changes(&self, film: &Film, name: impl Fn(&FirstHit) -> [u32; 2]) -> Vec<f64> {
        let score = |i| {
            let taken = match self.policy {
                PilotPolicy::Discard => film.discarded(i).count,
                _ => film.count(i),
            };
            // Entries of samples that were not traced hold no hit.
            let hits = film.first_hits(i);
            let taken = usize::try_from(taken).unwrap_or(usize::MAX).min(self.min as usize).min(hits.len());
            let differ = |pair: &[Option<FirstHit>]| pair[0].as_ref().map(&name) != pair[1].as_ref().map(&name);
            match hits[..taken].windows(2).filter(|pair| differ(pair)).count() {
                0 => 0.0,
                changes => 1.0 + changes as f64,
            }
        };
        (0..film.frame().pixels()).map(score).collect()
    }

    /// The largest relative deviation of a pixel's samples, divided by the threshold, per pixel.
    fn deviations(&self, film: &Film) -> Result<Vec<f64>, Error> {
        let extrema = Extrema::of(film, "mitchell-pbrt")?;
        let score = |i| {
            let (retention, moments) = match self.policy {
                PilotPolicy::Discard => (Retention::Discard, film.discarded(i)),
                _ => (Retention::Keep, film.moments(i)),
            };
            let range = extrema.of_pixel(retention, i).map(|range| range.map(|v| v[3]));
            range.map_or(0.0, |range| deviation(range, luminance(moments.mean)) / self.threshold)
        };
        Ok((0..film.frame().pixels()).map(score).collect())
    }
}
