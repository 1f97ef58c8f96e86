//! Features of the first rough surface that a path meets behind mirrors, glass and smooth coats.
//!
//! They ride along with the path: no rays and no random numbers of their own. Where a surface both reflects and
//! refracts, or shows its base through a coat, they follow the lobe that the path samples.

use super::{LightSelector, Path, PathTracer, VertexLight};
use crate::camera::Lens;
use dapple_core::{Estimate, SurfaceFeatures};
use glam::Vec3;

impl<L: Lens, S: LightSelector, const E: u32, G: VertexLight> PathTracer<'_, L, S, E, G> {
    /// Returns the share of light that the surfaces and media of the path so far pass on to the camera.
    #[inline(always)]
    pub(super) fn tint(path: &Path<S::Place, G::State>) -> Vec3 {
        // The radiance scaling of refraction and the weights of roulette are taken out again.
        let scale = if Self::HAS_TRANSMISSION { path.eta_squared * path.survival } else { path.survival };
        path.throughput * scale
    }
}

/// Returns the length of the path up to the last surface that was recorded.
pub(super) fn length(estimate: &Estimate) -> f32 {
    let first = estimate.first_hit.map_or(0.0, |hit| hit.depth);
    estimate.features.map_or(first, |features| features.depth)
}

/// Returns the features of a path that leaves the scene after mirrors, glass or smooth coats: the normal is 0, as for
/// the background. Position and depth are those of the last surface.
#[inline(never)]
pub(super) fn of_background(estimate: &Estimate, tint: Vec3, rare: bool) -> Option<SurfaceFeatures> {
    let last = estimate.features.or_else(|| estimate.first_hit.as_ref().map(SurfaceFeatures::from))?;
    let features = SurfaceFeatures::new(last.position, [0.0; 3], last.depth).with_rare(rare);
    Some(features.with_albedo(tint.min(Vec3::ONE).to_array()))
}
