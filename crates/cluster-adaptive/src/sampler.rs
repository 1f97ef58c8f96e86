//! The sampler of [Lan 2016]: sample counts from geometry alone.

use crate::{
    ClusterHit, ClusterSize, ClusterThesisOptions, Error, FirstHitRay, FirstHitSurface, FirstHits, FirstHitsCost,
    Importance, Placement, TraceVisibility,
};
use crate::{first_hits, importance, visibility_variances};
use dapple_clustering::Cluster;
use dapple_core::options::Options as _;
use dapple_core::plan::{Feedback, Plan, Progress, SamplerMemory, share};
use dapple_core::{Clock, Frame, Limits, Needs, PointSet, Sampler};
use std::sync::{Arc, Mutex, PoisonError};

/// The caller's function that traces a first-hit ray and returns its first hit, if any. It must be pure.
pub type TraceFirstHit = Arc<dyn Fn(FirstHitRay) -> Option<FirstHitSurface> + Send + Sync>;

/// The inputs for a sampler that traces its first-hit rays before the first plan: labels, clusters and a ray tracer.
#[derive(Clone)]
pub struct FirstHitSource {
    /// The cluster number of each primitive.
    pub labels: Arc<[u32]>,
    /// The clusters to which the labels refer.
    pub clusters: Arc<[Cluster]>,
    /// The function that traces a first-hit ray and returns its first hit.
    pub shoot: TraceFirstHit,
    /// The placement of each pixel's first-hit rays.
    pub placement: Placement,
    /// The clustering parameters for [`ClusterThesis`]'s description, for example `k=9,clamp=32`; may be empty.
    pub described: String,
}

/// A handle to the first-hit rays of a sampler and to their cost. It remains usable after the sampler is boxed. The default
/// handle belongs to a sampler without first-hit rays.
#[derive(Clone, Debug, Default)]
pub struct FirstHitsHandle(Vec<Arc<Mutex<Option<Arc<FirstHits>>>>>);

impl FirstHitsHandle {
    /// Joins the handles of several samplers into one handle, with the samplers of `self` before those of `others`.
    #[must_use]
    pub fn joined(mut self, others: Self) -> Self {
        self.0.extend(others.0);
        self
    }

    /// The first-hit rays that the sampler traced last; `None` before the first plan. For [joined](FirstHitsHandle::joined)
    /// samplers, the rays of the first sampler that has traced any.
    pub fn first_hits(&self) -> Option<Arc<FirstHits>> {
        self.each().next()
    }

    /// The cost of the first-hit rays that the sampler traced last, summed over joined samplers; `None` before the first
    /// plan.
    pub fn cost(&self) -> Option<FirstHitsCost> {
        let add = |a: FirstHitsCost, b: FirstHitsCost| FirstHitsCost {
            rays: a.rays + b.rays,
            seconds: a.seconds + b.seconds,
        };
        self.each().map(|first_hits| first_hits.cost()).reduce(add)
    }

    /// The number of rejected hits ([`FirstHits::rejected`]), summed over joined samplers; 0 before the first plan.
    pub fn rejected(&self) -> u64 {
        self.each().map(|first_hits| first_hits.rejected()).sum()
    }

    fn each(&self) -> impl Iterator<Item = Arc<FirstHits>> {
        self.0.iter().filter_map(|slot| slot.lock().unwrap_or_else(PoisonError::into_inner).clone())
    }

    fn set(&self, first_hits: &Arc<FirstHits>) {
        for slot in &self.0 {
            *slot.lock().unwrap_or_else(PoisonError::into_inner) = Some(first_hits.clone());
        }
    }
}

/// The sampling weights of all pixels of one frame.
struct Prior {
    frame: Frame,
    weights: Vec<f64>,
}

impl Prior {
    fn new(frame: Frame, importance: Importance) -> Self {
        Self { frame, weights: importance.per_pixel.into_iter().map(f64::from).collect() }
    }
}

/// The sampler of [Lan 2016]: few samples for large clusters, many for small ones.
///
/// First-hit rays find the cluster that each pixel sees. The pixel's importance (see [`importance()`]) depends on the ratio
/// of the pixel's area to the cluster's projected area. Every pixel gets a minimum. The rest of the budget is distributed in
/// proportion to importance, up to a maximum; the excess is redistributed to the other pixels ([`share`]).
///
/// *Guarantees*: the budget is spent exactly. Counts depend on geometry alone, not on radiance, and first-hit rays never
/// contribute to the image. The image is thus unbiased for every budget, or sequence of budgets, that is known beforehand.
/// (Under an error limit, the samples decide when the render stops, which has a bias of its own.) A raised budget keeps the
/// proportions as far as the samples already spent allow. Equal importance gives counts that differ by at most 1.
///
/// *Weaknesses*: equal samples per cluster do not minimise the error; light, texture and gloss are ignored. If most of the
/// error lies in large clusters, such as a textured floor, the published parameters give up to `mean / minimum` times the MSE
/// of uniform counts. As in the thesis, counts are not rounded to those at which the point set is well stratified.
pub struct ClusterThesis<P> {
    points: P,
    size: ClusterSize,
    options: ClusterThesisOptions,
    placement: Placement,
    source: Option<FirstHitSource>,
    visible: Option<TraceVisibility>,
    handle: FirstHitsHandle,
    prior: Option<Prior>,
}

impl<P: PointSet> ClusterThesis<P> {
    /// Creates the sampler with the size measure and parameters of [Lan 2016]. It plans from `first_hits`, and works only for
    /// the frame of these rays.
    ///
    /// # Errors
    ///
    /// [`Error::NoCluster`] if a first-hit ray has a cluster that is not in `clusters`.
    pub fn published(points: P, first_hits: &FirstHits, clusters: &[Cluster]) -> Result<Self, Error> {
        Self::with_options(points, first_hits, clusters, ClusterSize::ProjectedBox, ClusterThesisOptions::default())
    }

    /// Creates the sampler with any size measure and parameters. It plans from `first_hits`, and works only for the frame of
    /// these rays.
    ///
    /// # Errors
    ///
    /// [`Error::NoCluster`] if a first-hit ray has a cluster that is not in `clusters`; [`Error::OutOfRange`] for a weight
    /// below 0, a maximum below the minimum, or shadow rays, which need [`ClusterThesis::tracing`].
    pub fn with_options(
        points: P,
        first_hits: &FirstHits,
        clusters: &[Cluster],
        size: ClusterSize,
        options: ClusterThesisOptions,
    ) -> Result<Self, Error> {
        if options.lights > 0 {
            return Err(Error::range("lights", options.lights, "0, or 2 to 1024 with ClusterThesis::tracing"));
        }
        let importance = importance(first_hits, clusters, &size, &options)?;
        let prior = Some(Prior::new(*first_hits.frame(), importance));
        let (placement, handle) = (first_hits.placement(), FirstHitsHandle::default());
        Ok(Self { points, size, options, placement, source: None, visible: None, handle, prior })
    }

    /// Creates the sampler with any size measure and parameters, for any frame. The first plan for a frame traces the first-hit
    /// rays; [`ClusterThesis::handle`] reports their cost.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] for a weight below 0, a maximum below the minimum, or 0 or more than 256 first-hit rays per pixel.
    /// Wrong labels and clusters are errors of the first plan.
    pub fn tracing(
        points: P,
        source: FirstHitSource,
        size: ClusterSize,
        options: ClusterThesisOptions,
    ) -> Result<Self, Error> {
        options.check()?;
        let placement = source.placement;
        if !(1..=256).contains(&placement.per_pixel()) {
            return Err(Error::range("rays", placement, "centre, or 1 to 256 per pixel"));
        }
        let handle = FirstHitsHandle(vec![Arc::default()]);
        Ok(Self { points, size, options, placement, source: Some(source), visible: None, handle, prior: None })
    }

    /// Sets the function that traces shadow rays. Without it, the first plan fails if [`ClusterThesisOptions::lights`] > 0.
    #[must_use]
    pub fn with_visibility(self, visible: TraceVisibility) -> Self {
        Self { visible: Some(visible), ..self }
    }

    /// A handle to the first-hit rays that the sampler traces. It stays empty if the first-hit rays were passed in.
    pub fn handle(&self) -> FirstHitsHandle {
        self.handle.clone()
    }

    /// The sampling weights of the frame's pixels. Traces the frame's first-hit rays first if necessary.
    fn weights(&mut self, frame: &Frame) -> Result<&[f64], Error> {
        if self.prior.as_ref().is_none_or(|p| p.frame != *frame) {
            let Some(source) = &self.source else {
                let name = |f: &Frame| {
                    let ([w, h], [x, y], [full_w, full_h]) = (f.size(), f.origin(), f.resolution());
                    format!("{w}x{h} pixels at ({x}, {y}) of an image of {full_w}x{full_h}")
                };
                let of = self.prior.as_ref().map_or_else(String::new, |p| name(&p.frame));
                return Err(Error::OtherFrame { of, wanted: name(frame) });
            };
            self.prior = Some(self.prior_of(frame, source)?);
        }
        Ok(self.prior.as_ref().map_or(&[], |p| &p.weights))
    }

    fn prior_of(&self, frame: &Frame, source: &FirstHitSource) -> Result<Prior, Error> {
        let mut first_hits = first_hits(frame, source.placement, &self.points, &source.labels, &*source.shoot)?;
        let mut importance = importance(&first_hits, &source.clusters, &self.size, &self.options)?;
        let (rays, clock) = (self.options.lights, Clock::of_machine());
        if rays > 0 {
            let lacks =
                || Error::range("lights", rays, "0, or 2 to 1024 shadow rays with ClusterThesis::with_visibility");
            let visible = self.visible.as_ref().ok_or_else(lacks)?;
            let clusters = source.clusters.len();
            importance
                .raise(&first_hits, &visibility_variances(&first_hits, clusters, &self.points, rays, &**visible)?);
            // Each shadow ray needs a first-hit ray too.
            let seen = first_hits.class_counts(clusters)?[..clusters].iter().filter(|&&n| n > 0).count() as u64;
            first_hits.add_cost(2 * u64::from(rays) * seen, clock.seconds());
        }
        self.handle.set(&Arc::new(first_hits));
        Ok(Prior::new(*frame, importance))
    }
}

impl<P: PointSet> Sampler for ClusterThesis<P> {
    fn name(&self) -> &str {
        "cluster-thesis"
    }

    fn describe(&self) -> String {
        let clusters = self.source.as_ref().map(|p| p.described.as_str()).filter(|d| !d.is_empty());
        let (placement, size, options) = (self.placement, self.size.name(), self.options.describe());
        let published = format!("cluster-thesis:rays={placement},size={size},{options},policy=a-priori");
        clusters.map_or(published.clone(), |clusters| format!("{published},{clusters}"))
    }

    fn a_priori(&self) -> bool {
        true
    }

    fn memory(&self, frame: &Frame, _: &Needs, _: &Limits) -> SamplerMemory {
        let k = self.placement.per_pixel() as usize;
        // The first plan, with rates and terms of importance, is computed before anything is written to the film, whose counts
        // and means use 32 bytes. Later plans hold counts, floors, and the weights, fractions and counts of the allocation.
        let sorted = if self.options.lights > 0 { 4 * k } else { 0 };
        let first = (8 * k + 24 + 8).max(4 + sorted).saturating_sub(32);
        let later = 4 + 4 + 8 + 8 + 4;
        SamplerMemory::planning(frame, first.max(later)).with_state(frame, size_of::<ClusterHit>() * k + 8)
    }

    fn points(&self) -> &dyn PointSet {
        &self.points
    }

    fn next_round(&mut self, seen: &Feedback<'_>, plan: &mut Plan) -> Result<Progress, dapple_core::Error> {
        let budget = seen.budget;
        if budget.left() == 0 {
            return Ok(Progress::Done);
        }
        let pixels = seen.pixels();
        let now: Vec<u32> = (0..pixels).map(|i| u32::try_from(seen.film.count(i)).unwrap_or(u32::MAX)).collect();
        let total = now.iter().map(|&n| u64::from(n)).sum::<u64>() + budget.left();
        let [min, max] = self.options.bounds(total as f64 / pixels as f64);
        let base = min.max(budget.min_spp);
        let ceiling = if self.options.max > 0 { max } else { max.max(base) }.min(budget.max_spp);
        // The bounds of the table adapt to the budget. The user's bounds are kept, or an error is returned.
        let asked = self.options.min.max(budget.min_spp);
        if asked > ceiling {
            let allowed = "at least the minimum number of samples per pixel";
            return Err(dapple_core::Error::OutOfRange { name: "max", value: ceiling.to_string(), allowed });
        }
        let needed = pixels as u64 * u64::from(asked);
        if needed > total {
            return Err(dapple_core::Error::BudgetTooSmall { budget: total, needed, pixels });
        }
        let most = pixels as u64 * u64::from(ceiling);
        if total > most && seen.round == 0 {
            return Err(dapple_core::Error::BudgetTooLarge { budget: total, most, pixels });
        }
        let floors: Vec<u32> = now.iter().map(|&n| n.max(asked)).collect();
        let weights = self.weights(seen.frame())?;
        let wanted = share(weights, base, &floors, ceiling, total)?.counts;
        for ((count, wanted), now) in plan.counts.iter_mut().zip(wanted).zip(now) {
            *count = wanted - now;
        }
        // No samples are added if every pixel is at its ceiling.
        Ok(if plan.total() == 0 { Progress::Done } else { Progress::Trace })
    }
}
