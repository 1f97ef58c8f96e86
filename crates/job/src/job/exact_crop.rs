//! Crops with the bits of the whole image.

use super::{Job, JobMonitor};
use crate::load::{limits, setting};
use crate::{BudgetSpec, JobError, RenderSpec, registry};
use dapple_core::Unfiltered;
use dapple_core::samplers::Uniform;
use dapple_core::{Control, Film, Filter, Frame, Needs, Prepares, Render, Sampler, Snapshot, Status, TrainingData};
use dapple_transport::make_integrator;

/// The frame of the whole image, if `frame` is a crop that must have its bits.
pub(super) fn whole(spec: &RenderSpec, frame: &Frame) -> Option<Frame> {
    let [width, height] = frame.resolution();
    (spec.crop_exact && frame.size() != frame.resolution()).then(|| Frame::new(width, height).ok()).flatten()
}

/// Refuses settings with which the pixels of a crop depend on samples beyond it, other than those of training passes.
///
/// # Errors
///
/// [`JobError::NoExactCrop`] with the reason.
pub(super) fn check(
    (spec, frame): (&RenderSpec, &Frame),
    (sampler, filter): (&dyn Sampler, &dyn Filter),
    (integrator, prepares, needs): (&str, Prepares, Needs),
) -> Result<(), JobError> {
    if whole(spec, frame).is_none() {
        return Ok(());
    }
    let whole_spp = match spec.budget {
        BudgetSpec::Spp(spp) => spp.fract() == 0.0,
        other => other == BudgetSpec::Scene,
    };
    let why = if sampler.name() != "uniform" {
        format!("the sampler \"{}\" plans a pixel from others; use uniform", sampler.name())
    } else if filter.name() != Unfiltered.name() {
        format!("the filter \"{}\" reads other pixels; use none", filter.name())
    } else if !whole_spp {
        "pixels get equal counts only for a whole number of samples per pixel".to_owned()
    } else if needs.splats || prepares != Prepares::Never {
        format!("the integrator \"{integrator}\" traces light for the whole image; use path")
    } else {
        return Ok(());
    };
    Err(JobError::NoExactCrop { why })
}

impl Job {
    /// The training passes of the whole image that a crop must learn from; empty if there is nothing to learn.
    ///
    /// A crop resumed after its training passes learns nothing more.
    pub(super) fn training_of_whole(
        &self,
        snapshot: Option<&Snapshot>,
        monitor: &mut dyn JobMonitor,
    ) -> Result<Vec<TrainingData>, JobError> {
        let Some(frame) = whole(&self.spec, &self.frame) else { return Ok(Vec::new()) };
        let mut integrator = make_integrator(&self.integrator, &self.prepared.world)?;
        if let Some(snapshot) = snapshot {
            snapshot.teach(&mut *integrator);
            if !integrator.wants_training() {
                return Ok(Vec::new());
            }
            integrator = make_integrator(&self.integrator, &self.prepared.world)?;
        }
        let limits = limits(&self.spec, frame);
        let mut sampler = Uniform::new(registry::points(&self.spec.points, setting(&self.spec, frame))?);
        let mut watch = |status: &Status<'_>| -> Control { monitor.training(status) };
        let render = Render::new(frame, &limits).needs(self.needs).monitor(&mut watch);
        render.train(&mut *integrator, &mut sampler)?.ok_or(JobError::StoppedTraining)
    }

    /// The bytes of the film of the whole image that training passes are traced into, and of their plan.
    pub(super) fn memory_of_training(&self) -> u64 {
        let needs = if self.needs.halves { Needs::none().with_halves() } else { Needs::none() };
        whole(&self.spec, &self.frame).map_or(0, |frame| frame.bytes(Film::bytes_per_pixel(&needs) + 8))
    }
}
