//! A sampler and a filter that work together.

use crate::{Filter, Needs, Sampler, film::Recorder};
use std::sync::Arc;

/// A sampler and a filter that work together, for a [`Session`](crate::Session).
///
/// ```
/// # use dapple_core::{PointSet, SampleId};
/// # struct Centre;
/// # impl PointSet for Centre {
/// #     fn describe(&self) -> String { "centre".into() }
/// #     fn block(&self, _: SampleId, _: u32) -> [f32; 4] { [0.5; 4] }
/// # }
/// use dapple_core::samplers::Uniform;
/// use dapple_core::{Methods, Unfiltered};
///
/// let unfiltered = Methods::from(Uniform::new(Centre));
/// let methods = Methods::from((Uniform::new(Centre), Unfiltered));
/// # assert!(unfiltered.filter.is_none() && methods.filter.is_some());
/// ```
pub struct Methods<'a> {
    /// The sampler, which holds its point set.
    pub sampler: Box<dyn Sampler + 'a>,
    /// The filter; with `None`, each pixel is the mean of its own samples.
    pub filter: Option<Box<dyn Filter + 'a>>,
    /// The statistics that the film records in addition to the needs of sampler and filter.
    pub needs: Needs,
    /// The recorders of the film besides those of the sampler.
    pub recorders: Vec<Arc<dyn Recorder>>,
}

impl<'a> Methods<'a> {
    /// Sets the filter.
    #[must_use]
    pub fn with_filter(self, filter: impl Filter + 'a) -> Self {
        Self { filter: Some(Box::new(filter)), ..self }
    }

    /// Adds the statistics that the filter needs.
    pub(super) fn with_filter_needs(mut self) -> Self {
        if let Some(filter) = &self.filter {
            self.needs = self.needs.and(filter.needs());
            self.recorders.extend(filter.recorders());
        }
        self
    }

    /// Adds statistics that the film must record in addition to the needs of sampler and filter.
    #[must_use]
    pub fn with_needs(self, needs: Needs) -> Self {
        Self { needs: self.needs.and(needs), ..self }
    }

    /// Adds recorders, such as those of a filter that is applied later.
    #[must_use]
    pub fn with_recorders(mut self, recorders: impl IntoIterator<Item = Arc<dyn Recorder>>) -> Self {
        self.recorders.extend(recorders);
        self
    }
}

impl<'a, S: Sampler + 'a> From<S> for Methods<'a> {
    fn from(sampler: S) -> Self {
        Self { sampler: Box::new(sampler), filter: None, needs: Needs::none(), recorders: Vec::new() }
    }
}

impl<'a, S: Sampler + 'a, F: Filter + 'a> From<(S, F)> for Methods<'a> {
    fn from((sampler, filter): (S, F)) -> Self {
        Methods::from(sampler).with_filter(filter)
    }
}
