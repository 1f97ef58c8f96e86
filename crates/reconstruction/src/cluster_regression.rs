//! First-order regression on features and clusters, twice, and a choice among what it and others make.

use crate::averaging::guide;
use crate::cluster_gaussian::Label;
use crate::error_map::{Pair, filtered, relative_weight, select};
use crate::nl_means::{NEEDS, NlMeans, out};
use crate::planes::{Inputs, Plane, box_mean};
use crate::regression::regress;
use crate::tile::{FeatureScales, Guide, Likeness};
use dapple_core::{Error, Film, Filter, Filtered, Needs};
use std::fmt;

/// How far the filter goes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Passes {
    /// One pass of regression.
    One,
    /// Two, NL-means, and the choice among them: the default.
    #[default]
    Two,
}

/// Regression on first-hit features, in windows that follow clusters, features and colours.
///
/// # What it does
///
/// 1. Around every second pixel of every second row a plane is fitted to the radiance of 15x15 pixels, over normal, albedo
///    and position [after Bitterli 2016, Moon 2014]. A pixel's weight is its sample count times
///    `exp(-max(0, d_colour)) exp(-max(0, d_features))`, times `outside` in another cluster. What the windows
///    predict for a pixel is averaged with the same weights. Colours are compared in the other half than the one that is
///    filtered [after Rousselle 2012], over 7x7 pixels.
/// 2. The result, [`NlMeans`] with features, and no filter at all are compared in each pixel by their estimated error
///    over 5x5 pixels; the best ones, blended, guide a second pass.
/// 3. The picture is the mean of the first pass, the second, and the choice among all four over 7x7 pixels.
///
/// The recipe and its settings are those of a feasibility study (FEASIBILITY 4, steps 5, 6 and 9).
///
/// # What it promises
///
/// Bias vanishes as samples are added: what differs by more than noise does not mix. Without clusters the factor is 1;
/// where first hits are missing only colours count. [`Filtered::error`] is an estimate of the whole squared error, bias
/// included, from the halves; [`planning_weights`](crate::planning_weights) makes weights for counts of it.
#[derive(Clone, Default)]
pub struct ClusterRegression {
    passes: Passes,
    label: Option<Label>,
    outside: Option<f64>,
    described: String,
}

impl ClusterRegression {
    /// The weight of a pixel of another cluster, relative to one of the same, unless given (FEASIBILITY 4, step 6).
    pub const DEFAULT_OUTSIDE: f64 = 0.2;

    /// Without clusters.
    pub fn new() -> Self {
        Self::default()
    }

    /// The same with one pass or two.
    pub fn with_passes(self, passes: Passes) -> Self {
        Self { passes, ..self }
    }

    /// The same, pixels whose first sample lies in another cluster weighing `outside` of what they would in the first pass;
    /// `described` says how clusters are made, as further parameters.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] unless `outside` is in `[0, 1]`.
    pub fn with_clusters(self, label: Label, outside: f64, described: String) -> Result<Self, Error> {
        if !(0.0..=1.0).contains(&outside) {
            return out("outside", outside, "0 (nothing crosses a border) to 1 (clusters do not matter)");
        }
        Ok(Self { label: Some(label), outside: Some(outside), described, ..self })
    }

    fn outside(&self) -> f64 {
        self.outside.unwrap_or(1.0)
    }

    /// Both halves through the first pass.
    fn first(&self, inputs: &Inputs, beside: &Pair) -> Pair {
        let guides = [0, 1].map(|half| guide(inputs, half, true, false));
        let t = tune("T1", [3.0, 1.0, 1.2, 1e-2, 2e-3]);
        let features = FeatureScales { bandwidth: t[2], floors: [t[3], t[4]] };
        let like = Likeness { patch: t[0] as usize, colour: t[1], features: Some(features), outside: self.outside() as f32 };
        Pair(regress(inputs, &guides, &like, beside, tune("T5", [0.5; 5])[0]))
    }

    /// Both halves again, led by a picture that has less noise.
    fn second(&self, inputs: &Inputs, led_by: &Pair) -> Pair {
        let t = tune("T2", [1.0, 2.0, 1.2, 1e-2, 2e-2]);
        let features = FeatureScales { bandwidth: t[2], floors: [t[3], t[4]] };
        // Clusters have said what they know in the first pass.
        let outside = if self.label.is_some() { 0.5f32.max(self.outside() as f32) } else { 1.0 };
        let like = Likeness { patch: t[0] as usize, colour: t[1], features: Some(features), outside };
        Pair(regress(inputs, &residual_guides(inputs, led_by), &like, led_by, tune("T5", [0.5; 5])[1]))
    }

    fn pair(&self, inputs: &Inputs) -> Pair {
        let t = tune("T3", [0.0, 0.0, 0.02, 1.0, 0.8]);
        let means = if t[0] > 0.0 {
            NlMeans::new(7, t[0] as usize, f64::from(t[3])).and_then(|f| f.with_features(f64::from(t[4]))).unwrap_or_default().pair(inputs)
        } else {
            crate::Bilateral::new(7, f64::from(t[2])).and_then(|f| f.with_bandwidths(f64::from(t[3]), f64::from(t[4]))).unwrap_or_default().pair(inputs)
        };
        let first = self.first(inputs, &means);
        if self.passes == Passes::One {
            return first;
        }
        let unfiltered = Pair::unfiltered(inputs);
        let weight = relative_weight(inputs, &first);
        let chosen = select(inputs, &[&first, &means, &unfiltered], &weight, 2);
        let second = self.second(inputs, &chosen);
        let chosen = select(inputs, &[&first, &means, &second, &unfiltered], &weight, 3);
        match std::env::var("TUNE").as_deref() {
            Ok("sel2") => return chosen,
            Ok("z") => return second,
            Ok("nl") => return means,
            _ => {}
        }
        let third = vec![1.0 / 3.0; inputs.pixels()];
        Pair::mixed(&[&chosen, &second, &first], &[third.clone(), third.clone(), third])
    }
}

/// Guides of the second pass: filtered halves without their albedo, and the noise that is left in them, from their
/// difference over 3x3 pixels.
fn residual_guides(inputs: &Inputs, picture: &Pair) -> [Guide; 2] {
    let mut demodulated = picture.clone();
    demodulated.demodulate(inputs);
    let [a, b] = &demodulated.0;
    let difference = |i: usize| (0..3).map(|c| 0.5 * (a[c][i] - b[c][i]) * (a[c][i] - b[c][i])).sum::<f32>();
    let all: Plane = (0..inputs.pixels()).map(difference).collect();
    // The floor under the variance, as in the first pass: consistent, and not 0.
    let floor = |i: usize| 3.0 * 4e-4 / (inputs.halves[0].count[i] + inputs.halves[1].count[i]).max(1.0);
    let noise = box_mean(&all, inputs.size, 1);
    let variance: Plane = noise.iter().enumerate().map(|(i, v)| v + floor(i)).collect();
    let Pair([a, b]) = demodulated;
    [Guide { colour: a, variance: vec![variance.clone()] }, Guide { colour: b, variance: vec![variance] }]
}

impl fmt::Debug for ClusterRegression {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "ClusterRegression({})", self.describe())
    }
}

impl Filter for ClusterRegression {
    fn name(&self) -> &str {
        "cluster-regression"
    }

    fn describe(&self) -> String {
        let passes = if self.passes == Passes::One { 1 } else { 2 };
        let comma = if self.described.is_empty() { "" } else { "," };
        format!("cluster-regression:passes={passes},outside={}{comma}{}", self.outside(), self.described)
    }

    fn needs(&self) -> Needs {
        if self.label.is_some() && self.outside() < 1.0 { NEEDS.with_first_hits(1) } else { NEEDS }
    }

    fn apply(&self, film: &Film) -> Result<Filtered, Error> {
        film.require(self.name(), &self.needs())?;
        let inputs = Inputs::new(film, self.label.as_deref());
        Ok(filtered(&inputs, &self.pair(&inputs)))
    }
}

fn tune(name: &str, mut of: [f32; 5]) -> [f32; 5] {
    if let Ok(words) = std::env::var(name) {
        for (value, word) in of.iter_mut().zip(words.split(',')) {
            *value = word.parse().unwrap_or(*value);
        }
    }
    of
}
