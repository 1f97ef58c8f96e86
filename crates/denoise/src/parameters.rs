//! Needs, clusters and descriptions that several filters share.

pub(crate) use dapple_core::BACKGROUND;
use dapple_core::{FirstHit, Needs, Options};
use std::sync::Arc;

/// A function from a first hit to its cluster; `None` for the background.
pub type ClusterLookup = Arc<dyn Fn(&FirstHit) -> Option<u32> + Send + Sync>;

/// A filter's description: its name, its parameters and those of its clusters, if any.
pub(crate) fn describe(name: &str, options: &impl Options, clusters: &str) -> String {
    let comma = if clusters.is_empty() { "" } else { "," };
    format!("{name}:{}{comma}{clusters}", options.describe())
}

/// The statistics that a filter reads besides halves and variance.
#[derive(Clone, Default)]
pub(crate) struct Reads {
    /// Without features, every pixel counts as a miss.
    pub(crate) without_features: bool,
    /// The cluster of each first hit, by this function.
    pub(crate) label: Option<ClusterLookup>,
    /// The description of the clusters.
    pub(crate) described: String,
}

impl Reads {
    /// The statistics that the film records, but for first hits. Films without emission are filtered too.
    pub(crate) fn recorded(&self) -> Needs {
        let recorded = Needs::none().with_variance().with_halves().with_emission();
        if self.without_features { recorded } else { recorded.with_features() }
    }

    /// The description of a filter that reads these statistics.
    pub(crate) fn describe(&self, name: &str, options: &impl Options) -> String {
        describe(name, options, &self.described) + if self.without_features { ",features=none" } else { "" }
    }
}
