//! The last phase of a job: filtering, timings and warnings.

use super::{Job, monitor};
use crate::{BudgetSpec, JobError, Warning};
use dapple_core::{Film, Filter, Filtered, Unfiltered, limits::Budget};
use serde::Serialize;
use std::time::Instant;

/// A finished image, and the film from which it was made.
pub struct RenderedImage {
    /// The film.
    pub film: Film,
    /// The filtered image.
    pub filtered: Filtered,
    /// The name and parameters of the filter.
    pub filter: String,
    /// Wall-clock seconds spent on each phase.
    pub seconds: PhaseSeconds,
    /// The number of first-hit rays. The film's number of rays excludes them.
    pub first_hit_rays: u64,
    /// Warnings about the samples, the clusters and the filter.
    pub warnings: Vec<Warning>,
}

/// Wall-clock seconds spent on each phase; 0 for phases that a render does not have.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct PhaseSeconds {
    /// Seconds of reading the scene.
    pub load: f64,
    /// Seconds of building the world.
    pub bvh: f64,
    /// Seconds of clustering.
    pub cluster: f64,
    /// Seconds of tracing first-hit rays.
    pub first_hits: f64,
    /// Seconds of planning, excluding first-hit rays.
    pub plan: f64,
    /// Seconds of tracing.
    pub trace: f64,
    /// Seconds of filtering.
    pub filter: f64,
    /// Seconds of writing files.
    pub write: f64,
}

impl PhaseSeconds {
    /// Wall-clock seconds from clustering to filtering, excluding scene reading, world building and file writing.
    pub fn render(&self) -> f64 {
        self.cluster + self.first_hits + self.plan + self.trace + self.filter
    }
}

impl Job {
    /// Filters a film of this render and returns the image.
    ///
    /// For a stopped render, the image stays unfiltered if the filter would take a second or more.
    ///
    /// # Errors
    ///
    /// [`JobError::Core`] if the film lacks statistics that the filter needs.
    pub fn finish(&self, film: Film) -> Result<RenderedImage, JobError> {
        /// The assumed speed of the filter, in pixels per second and thread.
        const FILTERED_A_SECOND: usize = 125_000;
        let mut warnings = self.clusters_warnings();
        let mut filter: &dyn Filter = &*self.filter;
        let patience = FILTERED_A_SECOND * rayon::current_num_threads();
        if film.record().interrupted && filter.name() != Unfiltered.name() && film.frame().pixels() > patience {
            warnings.push(Warning::NotFiltered { filter: filter.name().to_owned() });
            filter = &Unfiltered;
        }
        let clock = Instant::now();
        let filtered = dapple_core::filter::filled(filter, &film)?;
        let seconds = clock.elapsed().as_secs_f64();
        let described = filter.describe();
        Ok(self.image(film, filtered, described, seconds, warnings))
    }

    /// Combines a film of this render with `filtered`, the image that another filter made from it in `seconds`. `filter`
    /// describes the other filter.
    pub fn finished(&self, film: Film, filtered: Filtered, filter: String, seconds: f64) -> RenderedImage {
        self.image(film, filtered, filter, seconds, self.clusters_warnings())
    }

    fn image(
        &self,
        film: Film,
        filtered: Filtered,
        filter: String,
        seconds: f64,
        mut warnings: Vec<Warning>,
    ) -> RenderedImage {
        let record = film.record();
        if let Some(&first) = film.rejected().first() {
            let (rejected, samples, points) = (record.rejected, record.samples, self.points.clone());
            warnings.push(Warning::RejectedSamples { rejected, samples, first, points });
        }
        if filtered.fireflies.pixels > 0 {
            warnings.push(Warning::Fireflies(filtered.fireflies));
        }
        if let Budget::Error { relmse: goal, .. } = self.limits.budget {
            let predicted = record.filtered_relmse.or_else(|| film.predicted_relmse());
            if !record.interrupted && predicted.is_none_or(|predicted| predicted > goal) {
                warnings.push(Warning::ErrorNotReached { predicted, goal });
            }
        }
        let first_hits = self.first_hits.cost().unwrap_or_default();
        let seconds = PhaseSeconds {
            load: self.prepared.loaded.seconds,
            bvh: self.prepared.build_seconds,
            cluster: self.cluster_seconds,
            first_hits: first_hits.seconds,
            // First-hit rays are traced when the first round is planned.
            plan: (record.plan_seconds() - first_hits.seconds).max(0.0),
            trace: record.trace_seconds(),
            filter: seconds,
            write: 0.0,
        };
        if let BudgetSpec::Seconds(limit) = self.spec.budget {
            let first = (film.record(), self.limits.min_spp);
            warnings.extend(monitor::exceeded(limit, seconds.render(), seconds.filter, first));
        }
        RenderedImage { film, filtered, filter, seconds, first_hit_rays: first_hits.rays, warnings }
    }

    /// Warnings about a clustering grid that is too coarse, and about first-hit rays that hit a NaN or infinite position.
    fn clusters_warnings(&self) -> Vec<Warning> {
        let report = self.clusters().and_then(|clusters| clusters.report()).filter(|report| report.is_degenerate());
        let degenerate = report.map(|report| {
            let (voxels, fullest, triangles) = (report.requested(), report.fullest, report.triangles);
            Warning::DegenerateClusters { voxels, fullest, triangles }
        });
        let rejected =
            Some(self.first_hits.rejected()).filter(|rejected| *rejected > 0).map(Warning::RejectedFirstHits);
        degenerate.into_iter().chain(rejected).collect()
    }
}

impl RenderedImage {
    /// The mean number of samples per pixel.
    pub fn spp(&self) -> f64 {
        self.film.record().samples as f64 / self.film.frame().pixels() as f64
    }

    /// The number of rays traced, first-hit rays included.
    pub fn rays(&self) -> u64 {
        self.film.record().rays + self.first_hit_rays
    }
}
