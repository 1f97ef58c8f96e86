//! Transmission of rays through media, alpha-masked surfaces and interfaces between media.

use super::super::code::ROULETTE_FROM;
use super::{LastScatter, LightSelector, Part, Path, PathTracer, VertexLight};
use crate::blocks;
use crate::camera::Lens;
use crate::light::{LightSample, Target};
use crate::material::Surface;
use crate::medium::{HenyeyGreenstein, MediumEvent};
use crate::shading::power_heuristic_over_pdf;
use crate::world::{Interaction, MOST_PASSED, PassedThrough};
use dapple_core::Draws;
use dapple_geometry::{PrimitiveId, Ray, SurfacePoint, spawn_ray};
use glam::Vec3;

/// The outcome of tracing a path segment through a medium.
pub(super) enum MediumEnd {
    /// The path reaches the surface ahead, or infinity.
    Crossed,
    /// The path scatters in the medium and continues from the scattering point.
    Scattered,
    /// The path ends in the medium.
    Absorbed,
}

impl<'w, L: Lens, S: LightSelector, const E: u32, G: VertexLight> PathTracer<'w, L, S, E, G> {
    /// Returns the material of the surface at a hit. Returns `None` if the ray passes the surface, in which case the path
    /// continues behind it.
    #[inline(always)]
    pub(super) fn surface_at(
        &self,
        draws: &Draws<'_>,
        path: &mut Path<S::Place, G::State>,
        at: &Interaction<'w>,
    ) -> Option<&'w Surface> {
        if Self::HAS_RARE_EFFECTS && at.part.passable {
            return self.passable_surface_at(draws, path, at);
        }
        Some(&self.world.surfaces[at.part.material as usize])
    }

    #[inline(never)]
    fn passable_surface_at(
        &self,
        draws: &Draws<'_>,
        path: &mut Path<S::Place, G::State>,
        at: &Interaction<'w>,
    ) -> Option<&'w Surface> {
        let u = || {
            let [opacity, choice, ..] = draws.block(blocks::surface(path.segments));
            [opacity, choice]
        };
        match self.world.surface_met(at, u) {
            Ok(surface) => return Some(surface),
            Err(PassedThrough::Unlit(surface)) if path.depth == 0 => return Some(surface),
            Err(PassedThrough::Hole | PassedThrough::Unlit(_)) => {}
            Err(PassedThrough::Interface) => path.medium = at.medium_beyond(path.ray.direction, path.medium),
        }
        self.pass(path, at);
        None
    }

    /// Continues the path behind a hit in the same direction. Zeroes the throughput if the path has too many segments.
    fn pass(&self, path: &mut Path<S::Place, G::State>, at: &Interaction<'_>) {
        path.ray = spawn_ray(&at.point, path.ray.direction);
        if path.segments > MOST_PASSED {
            path.throughput = Vec3::ZERO;
        }
    }

    /// Returns the transmittance per color channel along a shadow ray that starts in `medium`. Returns `None` if the
    /// ray is occluded.
    #[inline(always)]
    pub(super) fn transmittance(
        &self,
        ray: Ray,
        target: &Target,
        path: &mut Path<S::Place, G::State>,
        medium: u32,
    ) -> Option<Vec3> {
        if Self::HAS_RARE_EFFECTS {
            let (share, rays) = self.world.transmittance(ray, target, path.time, medium);
            path.rays += rays;
            return (share != Vec3::ZERO).then_some(share);
        }
        path.rays += 1;
        (!self.world.geometry.occluded(&ray)).then_some(Vec3::ONE)
    }

    /// Moves the path through its medium towards a surface at `distance` (infinity for none). Returns the outcome.
    #[inline(never)]
    pub(super) fn cross_medium(
        &self,
        draws: &Draws<'_>,
        path: &mut Path<S::Place, G::State>,
        distance: f32,
    ) -> MediumEnd {
        let world = self.world;
        let medium = world.media.medium(path.medium);
        if !medium.scatters() {
            path.throughput *= medium.transmittance(distance);
            return if path.throughput == Vec3::ZERO { MediumEnd::Absorbed } else { MediumEnd::Crossed };
        }
        let u = draws.block(blocks::medium(path.segments));
        match medium.sample(distance, u[0], u[1], path.throughput) {
            MediumEvent::Pass { weight } => {
                path.throughput *= weight;
                MediumEnd::Crossed
            }
            MediumEvent::Scatter { t, weight } => {
                path.throughput *= weight;
                if path.depth >= world.max_depth || path.throughput == Vec3::ZERO {
                    return MediumEnd::Absorbed;
                }
                self.scatter_in_medium(draws, path, t, [u[2], u[3]])
            }
        }
    }

    fn scatter_in_medium(
        &self,
        draws: &Draws<'_>,
        path: &mut Path<S::Place, G::State>,
        t: f32,
        u: [f32; 2],
    ) -> MediumEnd {
        let (world, lights) = (self.world, &self.world.lights);
        let position = path.ray.at(t);
        let phase = world.media.medium(path.medium).phase();
        let roulette = path.depth >= ROULETTE_FROM;
        let chooses = lights.len() > 1 || roulette;
        let choices = if chooses { draws.block(blocks::choose(path.depth)) } else { [0.0; 4] };
        path.begins_indirect();
        if !lights.is_empty() {
            let on_light = draws.block(blocks::scatter(path.depth));
            if let Some(light) = lights.sample(position, choices[0], [on_light[0], on_light[1]]) {
                let direct = self.direct_in_medium(path, position, phase, &light);
                path.radiance += path.throughput * direct;
            }
        }
        if roulette && !self.survives(path, choices[2]) {
            return MediumEnd::Absorbed;
        }
        let sample = phase.sample(path.ray.direction, u);
        if G::ACTIVE {
            self.vertex_light.scattered_in_medium(&mut path.gathered);
        }
        if path.part == Part::First {
            path.part = Part::Once;
        }
        path.last = Some(LastScatter { position, place: S::NOWHERE, pdf: sample.pdf });
        path.ray = Ray::new(position, sample.wi);
        path.depth += 1;
        MediumEnd::Scattered
    }

    fn direct_in_medium(
        &self,
        path: &mut Path<S::Place, G::State>,
        position: Vec3,
        phase: &HenyeyGreenstein,
        light: &LightSample,
    ) -> Vec3 {
        // A point in a medium has no rounding error and no side.
        let from = SurfacePoint { position, error: Vec3::ZERO, normal: Vec3::ZERO, primitive: PrimitiveId::NONE };
        let medium = path.medium;
        let ray = light.shadow_ray(&from);
        let Some(share) = self.transmittance(ray, &light.target, path, medium) else { return Vec3::ZERO };
        // The phase function is normalised, so its value is also the sampling density.
        let pdf = phase.evaluate(path.ray.direction, light.wi);
        let weight = if light.delta { light.pdf.recip() } else { power_heuristic_over_pdf(light.pdf, pdf) };
        share * light.radiance * (pdf * weight)
    }
}
