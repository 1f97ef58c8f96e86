//! Needs and descriptions that several filters share.

use dapple_core::{Needs, Options};

/// The statistics that the film must record for a filter over halves and features.
pub(crate) const NEEDS: Needs = Needs::none().with_variance().with_halves().with_features();

/// The statistics that the film records for such a filter. Films without emission are filtered too.
pub(crate) const RECORDED: Needs = NEEDS.with_emission();

/// A filter's description: its name, its parameters and those of its clusters, if any.
pub(crate) fn describe(name: &str, options: &impl Options, clusters: &str) -> String {
    let comma = if clusters.is_empty() { "" } else { "," };
    format!("{name}:{}{comma}{clusters}", options.describe())
}

/// The statistics that the film records for a filter over halves, and over features if it reads them.
pub(crate) const fn recorded(features: bool) -> Needs {
    if features { RECORDED } else { Needs::none().with_variance().with_halves().with_emission() }
}

/// The end of the description of a filter that reads no features.
pub(crate) fn featureless(without: bool) -> &'static str {
    if without { ",features=none" } else { "" }
}
