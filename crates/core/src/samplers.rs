//! The uniform sampler.

use crate::plan::{Feedback, Plan, Progress, Retention, SamplerMemory, allocate, saturating_u32};
use crate::{Error, Frame, Limits, Needs, PointSet, Sampler};

/// Uniform sampling: the same number of samples for every pixel.
///
/// If the budget is not a multiple of the number of pixels, a hash of the pixel's index picks the pixels that get one more.
///
/// *Guarantees*: unbiased, the exact budget, counts that do not depend on samples. *Weaknesses*: spends as much on a
/// constant wall as on its shadow.
///
/// ```
/// # use dapple_core::{PointSet, SampleId};
/// # struct Centre;
/// # impl PointSet for Centre {
/// #     fn describe(&self) -> String { "centre".into() }
/// #     fn block(&self, _: SampleId, _: u32) -> [f32; 4] { [0.5; 4] }
/// # }
/// use dapple_core::samplers::Uniform;
/// use dapple_core::{Block, Draws, Estimate, Frame, Integrator, Limits, Render, Worker};
///
/// struct Grey;
/// impl Integrator for Grey {
///     fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
///         Estimate::new([draws.block(Block::new(0))[0]; 3])
///     }
/// }
///
/// // Two samples per pixel, and one more for two of the six.
/// let frame = Frame::new(3, 2)?;
/// let film = Render::new(frame, &Limits::samples(14)).run(&mut Grey, &mut Uniform::new(Centre))?;
/// assert_eq!(film.counts().iter().filter(|&&n| n == 3).count(), 2);
/// # Ok::<(), dapple_core::Error>(())
/// ```
pub struct Uniform<P> {
    points: P,
}

impl<P: PointSet> Uniform<P> {
    /// A uniform sampler that uses this point set.
    pub fn new(points: P) -> Self {
        Self { points }
    }
}

impl<P: PointSet> Sampler for Uniform<P> {
    fn name(&self) -> &str {
        "uniform"
    }

    fn a_priori(&self) -> bool {
        true
    }

    fn memory(&self, frame: &Frame, _: &Needs, limits: &Limits) -> SamplerMemory {
        // Bytes per pixel: floor, count, score and its copy, hash and index. With a budget known in samples, the only
        // plan is made before anything is written to the film, which takes more.
        let once = limits.budget.samples(frame).is_some();
        SamplerMemory::planning(frame, if once { 0 } else { 40 })
    }

    fn points(&self) -> &dyn PointSet {
        &self.points
    }

    fn next_round(&mut self, seen: &Feedback<'_>, plan: &mut Plan) -> Result<Progress, Error> {
        if seen.budget.left() == 0 {
            return Ok(Progress::Done);
        }
        plan.retention = Retention::Keep;
        // After a raised budget, counts may already differ by one: level them to the new total.
        let mut wanted = level(seen, seen.budget.total)?;
        let now: Vec<u32> = (0..seen.pixels()).map(|i| saturating_u32(seen.film.count(i))).collect();
        let is_uneven = |wanted: &[u32]| wanted.iter().zip(&now).any(|(wanted, now)| wanted < now);
        if seen.budget.spent != sum(&now) || is_uneven(&wanted) {
            // After rounds of another sampler, which may have discarded samples: pixels above the level keep theirs.
            let total = sum(&now) + seen.budget.left();
            wanted = allocate(&vec![1.0; now.len()], &now, seen.budget.max_spp, total)?.counts;
        }
        for ((count, wanted), now) in plan.counts.iter_mut().zip(wanted).zip(now) {
            *count = wanted - now;
        }
        // Nothing is left to add if every pixel is at its ceiling.
        Ok(if plan.total() == 0 { Progress::Done } else { Progress::Trace })
    }
}

fn sum(counts: &[u32]) -> u64 {
    counts.iter().map(|&n| u64::from(n)).sum()
}

/// Returns counts per pixel that sum to `total` and differ by at most one. A hash of the pixel's index picks the pixels
/// that get the remainder.
fn level(seen: &Feedback<'_>, total: u64) -> Result<Vec<u32>, crate::Error> {
    let pixels = seen.pixels();
    let floors = vec![seen.budget.min_spp.min(saturating_u32(total / pixels as u64)); pixels];
    Ok(allocate(&vec![1.0; pixels], &floors, seen.budget.max_spp, total)?.counts)
}
