//! Features of camera paths for filters, and emission seen directly, as the path tracer reports them.

use super::vertex::{Kind, Vertex};
use dapple_core::{Draws, Estimate, SurfaceFeatures};
use dapple_geometry::Ray;
use dapple_renderer::{CERTAIN_LOBE, Interaction, RARE_LOBE, World};
use glam::Vec3;

/// The part of a camera path that mirrors, glass and smooth coats show.
pub(super) struct Seen {
    wants_first_hit: bool,
    wants_trajectory: bool,
    /// The number of surfaces so far.
    surfaces: u32,
    /// True while features are wanted and all scattering so far was smooth.
    is_smooth: bool,
    /// True if glass scattered the path by a lobe of less than [`RARE_LOBE`] of the light.
    is_rare: bool,
    /// True while all scattering so far was specular with a probability of at least [`CERTAIN_LOBE`].
    is_direct: bool,
    /// The number of vertices, the camera included, whose emission is seen directly.
    pub(super) direct: usize,
}

impl Seen {
    pub(super) fn new(draws: &Draws<'_>) -> Self {
        Self {
            wants_first_hit: draws.wants_first_hit(),
            wants_trajectory: draws.wants_trajectory(),
            surfaces: 0,
            is_smooth: draws.wants_features(),
            is_rare: false,
            is_direct: draws.wants_emission(),
            direct: if draws.wants_emission() { 2 } else { 0 },
        }
    }

    /// Records a path that leaves the scene along a ray at a time. `tint` is the share of light that the surfaces so far
    /// pass on.
    pub(super) fn background(&self, world: &World, at: (&Ray, f32), tint: Vec3, estimate: &mut Estimate) {
        if self.surfaces == 0 && self.wants_trajectory {
            estimate.trajectory = world.background_trajectory(at.0, at.1);
        }
        if !self.is_smooth || self.surfaces == 0 {
            return;
        }
        let last = estimate.features.or_else(|| estimate.first_hit.as_ref().map(SurfaceFeatures::from));
        estimate.features = last.map(|last| {
            let features = SurfaceFeatures::new(last.position, [0.0; 3], last.depth).with_rare(self.is_rare);
            features.with_albedo(tint.min(Vec3::ONE).to_array())
        });
    }

    /// Records a surface that a ray hits. `mix` selects the material of a mix.
    pub(super) fn surface(
        &mut self,
        world: &World,
        (ray, at, mix): (&Ray, &Interaction<'_>, f32),
        tint: Vec3,
        estimate: &mut Estimate,
    ) {
        if self.surfaces == 0 && self.wants_first_hit {
            estimate.first_hit = Some(world.first_hit(ray, at, mix));
            if self.wants_trajectory {
                estimate.trajectory = world.trajectory(at);
            }
        } else if self.surfaces > 0 && self.is_smooth {
            let first = estimate.first_hit.map_or(0.0, |hit| hit.depth);
            let length = estimate.features.map_or(first, |features| features.depth);
            let features = world.surface_features(ray, at, mix, tint, length);
            estimate.features = Some(features.with_rare(self.is_rare));
        }
        self.surfaces += 1;
    }

    /// Records that the path scattered at a vertex, by the lobe that `lobe` in `[0, 1)` selected with a `density`.
    pub(super) fn scattered(&mut self, vertex: &Vertex<'_>, density: f32, lobe: f32) {
        let Kind::Surface { bsdf, frame, .. } = &vertex.kind else { return };
        if self.is_smooth {
            self.is_smooth = vertex.specular || bsdf.samples_narrow_lobe(frame.to_local(vertex.wo), lobe);
            self.is_rare |= vertex.specular && density < RARE_LOBE && bsdf.transmits();
        }
        self.is_direct &= vertex.specular && density >= CERTAIN_LOBE;
        self.direct += usize::from(self.is_direct);
    }
}
