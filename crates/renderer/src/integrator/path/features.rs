//! Features of the first non-specular surface behind mirrors, glass and smooth coats, and the emission of lights that are
//! directly visible on the way.
//!
//! They are recorded while a path is traced, without additional rays or random numbers. Where a surface both reflects and
//! refracts, or shows its base through a coat, the features follow the sampled lobe.

use super::transmission::MediumEnd;
use super::{LightSelector, NoVertexLight, Path, PathTracer, VertexLight, code};
use crate::World;
use crate::blocks;
use crate::camera::{General, Lens};
use crate::integrator::FixedSelector;
use crate::material::Surface;
use crate::shading::Bsdf;
use crate::world::{Interaction, NO_LIGHT, NO_MEDIUM};
use dapple_core::integrator::{CERTAIN_LOBE, RARE_LOBE};
use dapple_core::{Draws, Estimate, SurfaceFeatures};
use dapple_geometry::spawn_ray;
use glam::Vec3;

/// The path tracer with code for all effects, used to trace paths for their features only.
type AnyPath<'w> = PathTracer<'w, General, FixedSelector, { code::ALL }>;

impl World {
    /// Returns a sample's first hit, features and cost in rays, with radiance 0. [`Estimate::emission`] holds the emission of
    /// directly visible lights if [`Draws::wants_emission`] is true. First hits and features have the same distribution as in a
    /// path tracer with at most `depth` scattering events.
    #[inline(never)]
    pub fn features_alone(&self, draws: &Draws<'_>, depth: u32) -> Estimate {
        AnyPath::new(self, NoVertexLight).follow(draws, depth)
    }
}

impl<'w> AnyPath<'w> {
    /// Traces a path through at most `depth` mirrors, glass surfaces and smooth coats to the first non-specular surface.
    fn follow(&self, draws: &Draws<'_>, depth: u32) -> Estimate {
        let mut path = self.begin(draws);
        let mut estimate = Estimate::new([0.0; 3]);
        loop {
            path.rays += 1;
            path.segments += 1;
            let ray = path.ray;
            let hit = self.closest_hit(&ray, path.time);
            if path.medium != NO_MEDIUM {
                let distance = hit.as_ref().map_or(f32::INFINITY, |at| at.hit.t);
                if !matches!(self.cross_medium(draws, &mut path, distance), MediumEnd::Crossed) {
                    break;
                }
                path.is_direct = false;
            }
            let Some(at) = hit else {
                if path.is_direct {
                    estimate.emission = (path.throughput * self.environment(&path)).to_array();
                }
                if path.depth > 0 {
                    estimate.features = of_background(&estimate, Self::tint(&path), path.is_rare);
                }
                break;
            };
            let Some(surface) = self.surface_at(draws, &mut path, &at) else {
                if path.throughput == Vec3::ZERO {
                    break;
                }
                continue;
            };
            if at.part.light != NO_LIGHT && path.is_direct {
                let light = path.throughput * self.emitted(&path, &at);
                estimate.emission = (Vec3::from(estimate.emission) + light).to_array();
            }
            if surface.unlit && path.is_direct {
                estimate.emission = self.shown(&path, &at, surface).to_array();
            }
            if path.depth == 0 {
                estimate.first_hit = Some(self.world.first_hit_of(ray, at, surface));
            } else {
                let features = self.world.features_of(ray, at, surface, Self::tint(&path), length(&estimate));
                estimate.features = Some(features.with_rare(path.is_rare));
            }
            if path.depth >= depth || !self.passes_on(draws, &mut path, &at, surface) {
                break;
            }
            path.depth += 1;
        }
        estimate.cost = path.rays;
        estimate
    }

    /// Samples the next ray as for a complete sample. Returns false if the path ends at this surface, or if the sampled lobe is
    /// neither specular nor narrow.
    fn passes_on(&self, draws: &Draws<'_>, path: &mut Path<(), ()>, at: &Interaction<'w>, surface: &Surface) -> bool {
        let world = self.world;
        if surface.black {
            return false;
        }
        let bsdf = world.bsdf_of(at, surface);
        if matches!(bsdf, Bsdf::Diffuse { .. }) {
            return false;
        }
        let frame = world.frame_of(at, surface);
        let wo = bsdf.local(&frame, -path.ray.direction);
        let [u, choices] = draws.two_blocks([blocks::scatter(path.depth), blocks::choose(path.depth)]);
        let smooth = bsdf.is_specular() || bsdf.samples_narrow_lobe(wo, choices[1]);
        if !smooth && !surface.several_lobes {
            return false;
        }
        let Some(sample) = bsdf.sample(wo, [u[2], u[3]], choices[1]) else { return false };
        if !sample.specular && !smooth {
            return false;
        }
        let wi = frame.to_world(sample.wi);
        let (normal, outside) = (at.point.normal, -at.point.normal.dot(path.ray.direction));
        if (normal.dot(wi) * outside > 0.0) != (sample.wi.z * wo.z > 0.0) {
            return false;
        }
        path.throughput *= sample.weight;
        path.is_direct &= sample.specular && sample.pdf >= CERTAIN_LOBE;
        path.is_rare |= sample.specular && sample.pdf < RARE_LOBE && bsdf.transmits();
        path.eta_squared *= sample.eta * sample.eta;
        path.ray = spawn_ray(&at.point, wi);
        path.medium = at.medium_beyond(wi, path.medium);
        path.throughput.max_element() > 0.0
    }
}

impl<L: Lens, S: LightSelector, const E: u32, G: VertexLight> PathTracer<'_, L, S, E, G> {
    /// Returns the fraction of light that the path's surfaces and media so far transmit to the camera.
    #[inline(always)]
    pub(super) fn tint(path: &Path<S::Place, G::State>) -> Vec3 {
        // The radiance scaling of refraction and the weights of roulette are taken out again.
        let scale = if Self::HAS_TRANSMISSION { path.eta_squared * path.survival } else { path.survival };
        path.throughput * scale
    }
}

/// Returns the length of the path from the camera to the last recorded surface.
pub(super) fn length(estimate: &Estimate) -> f32 {
    let first = estimate.first_hit.map_or(0.0, |hit| hit.depth);
    estimate.features.map_or(first, |features| features.depth)
}

/// Returns the features of a path that leaves the scene after mirrors, glass or smooth coats. The normal is 0, as for the
/// background; position and depth are those of the last surface.
#[inline(never)]
pub(super) fn of_background(estimate: &Estimate, tint: Vec3, rare: bool) -> Option<SurfaceFeatures> {
    let last = estimate.features.or_else(|| estimate.first_hit.as_ref().map(SurfaceFeatures::from))?;
    let features = SurfaceFeatures::new(last.position, [0.0; 3], last.depth).with_rare(rare);
    Some(features.with_albedo(tint.min(Vec3::ONE).to_array()))
}
