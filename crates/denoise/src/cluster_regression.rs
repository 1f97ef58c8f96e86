//! First-order regression on features and clusters, twice, and a choice among what it and others make.

use crate::averaging::guide;
use crate::bilateral::Bilateral;
use crate::cluster_gaussian::ClusterLookup;
use crate::error_map::{Pair, filtered, relative_weight, select};
use crate::nl_means::{NEEDS, out};
use crate::planes::{Inputs, Plane, box_mean};
use crate::prefilter::prefilter;
use crate::regression::{bytes, regress};
use crate::tile::{FeatureScales, Guide, Likeness};
use dapple_core::{Error, Film, Filter, FilterMemory, Filtered, Frame, ImagePlanes, Needs};
use rayon::prelude::*;
use std::fmt;

/// The weight of what stands beside a regression, where a pixel at its window's centre has 1: 0.1 to 2 measured alike.
const BESIDE: f32 = 0.5;

/// How far the filter goes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Passes {
    /// One pass of regression.
    One,
    /// Two, and the choice among them, the bilateral image and no filter: the default.
    #[default]
    Two,
}

/// Regression on first-hit features, in windows that follow clusters, features and colours.
///
/// # What it does
///
/// 1. Features are averaged over 9x9 pixels where they are alike but for their noise [after Rousselle 2013]: noise that lens,
///    shutter and geometry finer than pixels leave in them is that of the radiance too, which would be regressed on it.
/// 2. [`Bilateral`], over 9x9 pixels, makes an image to begin with.
/// 3. Around every second pixel of every second row a plane is fitted to the radiance of 13x13 pixels, over normal, albedo
///    and position [after Bitterli 2016; Moon 2014]. A pixel's weight grows with its samples and is
///    `exp(-max(0, d_colour)) exp(-max(0, d_features))`, times `outside` in another cluster. What the windows
///    predict for a pixel is averaged with the same weights; the first image counts a little, and stands in where no
///    window fits. Colours are compared in the other half than the one that is filtered [after Rousselle 2012], over
///    3x3 pixels.
/// 4. The two images and no filter at all are compared in each pixel by their estimated error over 5x5 pixels; the
///    best ones, blended, guide a second pass, with albedo taken off and the noise that is left judged by the halves: one
///    guide for both, so that their windows share weights and normal equations.
/// 5. The image is the choice among all four by estimated error over 7x7 pixels.
///
/// The recipe is that of a feasibility study (FEASIBILITY 4, steps 5, 6 and 9), with five changes that measured better
/// on the bundled scenes (`docs/results/filters.md`): the cross-bilateral image instead of NL-means, the choice itself
/// instead of its mean with two candidates, 3x3 patches, wider bandwidths for features in the second pass, and its one guide.
///
/// # What it promises
///
/// Bias vanishes as samples are added: what differs by more than noise does not mix. Without clusters the factor is 1;
/// where first hits are missing only colours count. [`Filtered::error`] is an estimate of the whole squared error, bias
/// included, from the halves; [`relative_errors`](crate::relative_errors) makes of it what counts can follow.
#[derive(Clone, Default)]
pub struct ClusterRegression {
    passes: Passes,
    label: Option<ClusterLookup>,
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
    pub fn with_clusters(self, label: ClusterLookup, outside: f64, described: String) -> Result<Self, Error> {
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
        let features = FeatureScales { bandwidth: 1.5, floors: [1e-2, 2e-3] };
        let like = Likeness { patch: 1, colour: 2.0, features: Some(features), outside: self.outside() as f32 };
        Pair(regress(inputs, &guides, &like, beside, BESIDE))
    }

    /// Both halves again, led by an image that has less noise.
    fn second(&self, inputs: &Inputs, led_by: &Pair) -> Pair {
        let features = FeatureScales { bandwidth: 5.0, floors: [1e-2, 2e-2] };
        // Clusters have said most of what they know in the first pass.
        let outside = self.outside().max(0.5) as f32;
        let like = Likeness { patch: 1, colour: 1.5, features: Some(features), outside };
        Pair(regress(inputs, &[residual_guide(inputs, led_by)], &like, led_by, BESIDE))
    }

    fn pair(&self, inputs: &Inputs) -> Pair {
        let averaged = Bilateral::candidate().pair(inputs);
        let first = self.first(inputs, &averaged);
        if self.passes == Passes::One {
            return first;
        }
        let unfiltered = Pair::unfiltered(inputs);
        let weight = relative_weight(inputs, &first);
        let chosen = select(inputs, &[&first, &averaged, &unfiltered], &weight, 2);
        let second = self.second(inputs, &chosen);
        select(inputs, &[&first, &averaged, &second, &unfiltered], &weight, 3)
    }
}

/// The guide of the second pass: the filtered image without its albedo, and the noise that is left in it, from the halves'
/// difference over 5x5 pixels (of either half: that of the image itself, a quarter as much, measured worse). One for both
/// halves, since what it keeps of a half's noise is little, and costs half as much.
fn residual_guide(inputs: &Inputs, image: &Pair) -> Guide {
    let Pair([a, b]) = image;
    let demodulated = |plane: &Plane, c: usize, i: usize| plane[i] / inputs.divisor(c, i);
    let difference = |i: usize| {
        let apart = |c: usize| demodulated(&a[c], c, i) - demodulated(&b[c], c, i);
        0.5 * (apart(0) * apart(0) + apart(1) * apart(1) + apart(2) * apart(2))
    };
    let all: Plane = (0..inputs.pixels()).into_par_iter().with_min_len(1024).map(difference).collect();
    // The floor under the variance, as in the first pass: consistent, and not 0.
    let floor = |i: usize| 3.0 * 4e-4 / (inputs.halves[0].count[i] + inputs.halves[1].count[i]).max(1.0);
    let noise = box_mean(&all, inputs.size, 2);
    let variance: Plane = noise.iter().enumerate().map(|(i, v)| v + floor(i)).collect();
    let colour = std::array::from_fn(|c| {
        let mean = |i: usize| image.combined(inputs, c, i) / inputs.divisor(c, i);
        (0..inputs.pixels()).into_par_iter().with_min_len(1024).map(mean).collect()
    });
    Guide { colour, variance: vec![variance] }
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

    fn memory(&self, frame: &Frame, needs: &Needs) -> FilterMemory {
        let [kept, making] = Inputs::bytes_per_pixel(self.label.is_some() && needs.first_hits > 0);
        let pair = 4 * 6;
        // The first pass has the bilateral pair beside it. The second has that, the first, the unfiltered and the chosen one,
        // and a plane of weights: more than the choice among all of them takes.
        let at_most = match self.passes {
            Passes::One => frame.bytes(kept + pair).saturating_add(bytes(frame, 2)),
            Passes::Two => frame.bytes(kept + 4 * pair + 4).saturating_add(bytes(frame, 1)),
        };
        FilterMemory::new(frame, making, ImagePlanes::RadianceAndError).at_least(at_most)
    }

    fn apply(&self, film: &Film) -> Result<Filtered, Error> {
        film.require(self.name(), &self.needs())?;
        let mut inputs = Inputs::new(film, self.label.as_ref());
        prefilter(&mut inputs);
        Ok(filtered(&inputs, &self.pair(&inputs)))
    }
}
