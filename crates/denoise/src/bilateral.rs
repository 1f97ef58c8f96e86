//! The cross-bilateral filter: near, of a similar surface, of a similar colour.

use crate::averaging::{VANISHING, Window, average, guide, memory};
use crate::cluster_gaussian::ClusterLookup;
use crate::error_map::{Pair, filtered};
use crate::nl_means::{NEEDS, bandwidth, out, radius};
use crate::planes::Inputs;
use crate::tile::{FeatureScales, Likeness, REACH};
use dapple_core::{Error, Film, Filter, FilterMemory, Filtered, Frame, Needs};
use std::fmt;

/// The cross-bilateral filter [after Eisemann and Durand 2004; Petschnigg 2004], with first-hit features and clusters.
///
/// A pixel's weight is a Gaussian of its distance, times `exp(-max(0, d))` for the differences of features (the largest of
/// those of normal, albedo and depth, in `features` standard deviations) and of colours (over 3x3 pixels, in `colour`
/// standard deviations), their noise taken off as in [`NlMeans`](crate::NlMeans), times `outside` where clusters differ.
/// Colours are compared without their albedo, in the other half than the one that is filtered. Colour makes it
/// consistent: what differs by more than noise does not mix, however many samples show it.
///
/// [`Filtered::error`] is an estimate of the whole squared error, bias included, from the halves.
#[derive(Clone)]
pub struct Bilateral {
    window: usize,
    falloff: f64,
    colour: f64,
    features: f64,
    outside: f64,
    label: Option<ClusterLookup>,
    described: String,
}

impl Default for Bilateral {
    fn default() -> Self {
        let described = String::new();
        Self { window: REACH, falloff: 0.03, colour: 0.8, features: 1.0, outside: 1.0, label: None, described }
    }
}

impl Bilateral {
    /// Windows of `window` pixels to each side, the spatial weight `exp(-falloff r^2)`.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] unless `window <= 7` and `falloff` is in `0 ..= 100`.
    pub fn new(window: usize, falloff: f64) -> Result<Self, Error> {
        if !(0.0..=100.0).contains(&falloff) {
            return out("falloff", falloff, "0 (a flat window) to 100, per square pixel");
        }
        Ok(Self { window: radius("window", window, REACH)?, falloff, ..Self::default() })
    }

    /// The same, differences of colours and of features measured in so many standard deviations.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] unless both are in `0.001 ..= 1000`.
    pub fn with_bandwidths(self, colour: f64, features: f64) -> Result<Self, Error> {
        bandwidth("colour", colour)?;
        bandwidth("features", features)?;
        Ok(Self { colour, features, ..self })
    }

    /// The same, pixels whose first sample lies in another cluster weighing `outside` of what they would; what follows the
    /// comma describes how clusters are made.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] unless `outside` is in `[0, 1]`.
    pub fn with_clusters(self, label: ClusterLookup, outside: f64, described: String) -> Result<Self, Error> {
        if !(0.0..=1.0).contains(&outside) {
            return out("outside", outside, "0 (nothing crosses a border) to 1 (clusters do not matter)");
        }
        Ok(Self { label: Some(label), outside, described, ..self })
    }

    /// What a regression begins with: as good there as the default, and at a third of its cost.
    pub(crate) fn candidate() -> Self {
        Self { window: 4, falloff: 0.06, colour: 0.75, features: 1.25, ..Self::default() }
    }

    /// Both halves of a film filtered.
    pub(crate) fn pair(&self, inputs: &Inputs) -> Pair {
        let guides = [0, 1].map(|half| guide(inputs, half, true, true));
        let window = Window { radius: self.window, cut: VANISHING, falloff: self.falloff as f32 };
        let values = [0, 1].map(|h: usize| &guides[h].colour);
        let mut pair = Pair(average(inputs, values, &guides, &self.likeness(), &window));
        pair.modulate(inputs);
        pair
    }

    fn likeness(&self) -> Likeness {
        let features = FeatureScales { bandwidth: self.features as f32, floors: [1e-2, 2e-2] };
        Likeness { patch: 1, colour: self.colour as f32, features: Some(features), outside: self.outside as f32 }
    }
}

impl fmt::Debug for Bilateral {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Bilateral({})", self.describe())
    }
}

impl Filter for Bilateral {
    fn name(&self) -> &str {
        "bilateral"
    }

    fn describe(&self) -> String {
        let Self { window, falloff, colour, features, outside, described, .. } = self;
        let comma = if described.is_empty() { "" } else { "," };
        format!(
            "bilateral:window={window},falloff={falloff},colour={colour},features={features},outside={outside}{comma}{described}"
        )
    }

    fn needs(&self) -> Needs {
        if self.label.is_some() && self.outside < 1.0 { NEEDS.with_first_hits(1) } else { NEEDS }
    }

    fn memory(&self, frame: &Frame, needs: &Needs) -> FilterMemory {
        memory(frame, self.label.is_some() && needs.first_hits > 0, &self.likeness(), true)
    }

    fn apply(&self, film: &Film) -> Result<Filtered, Error> {
        film.require(self.name(), &self.needs())?;
        let inputs = Inputs::new(film, self.label.as_ref());
        Ok(filtered(&inputs, &self.pair(&inputs)))
    }
}
