//! Queries for integrators about media, and about rays that pass surfaces without scattering.

use super::{Interaction, NO_MEDIUM, World};
use crate::light::Target;
use crate::material::{self, Surface};
use crate::shading::{Bsdf, ShadingFrame};
use dapple_geometry::Ray;
use glam::Vec3;

/// The largest number of surfaces that a ray passes before it is dropped. Even nested interfaces and foliage rarely
/// reach 100.
pub(crate) const MOST_PASSED: u32 = 10_000;

/// The reason why a ray passes a surface without scattering.
pub(crate) enum PassedThrough<'w> {
    Hole,
    /// A boundary between media.
    Interface,
    /// A surface that only the camera sees.
    Unlit(&'w Surface),
}

impl World {
    /// Returns the BSDF at a hit and its shading frame. Returns `None` if the ray passes the surface: through a hole, or
    /// because the surface only separates media or is unlit. `u` returns random numbers in `[0, 1)` for the opacity and for
    /// the selection of a mixed material; it is called only if one is needed.
    pub fn scattering(&self, at: &Interaction<'_>, u: impl FnOnce() -> [f32; 2]) -> Option<(Bsdf<'_>, ShadingFrame)> {
        let surface = self.surface_met(at, u).ok()?;
        Some((self.bsdf_of(at, surface), self.frame_of(at, surface)))
    }

    /// Returns the material at a hit, or the reason why the ray passes the surface. `u` is as for [`Self::scattering`].
    #[inline(always)]
    pub(crate) fn surface_met(
        &self,
        at: &Interaction<'_>,
        u: impl FnOnce() -> [f32; 2],
    ) -> Result<&Surface, PassedThrough<'_>> {
        let surface = &self.surfaces[at.part.material as usize];
        if !at.part.passable {
            return Ok(surface);
        }
        let alpha = self.alpha(at);
        let partial = alpha > 0.0 && alpha < 1.0;
        let u = if partial || surface.mixes { u() } else { [0.0; 2] };
        if u[0] >= alpha {
            return Err(PassedThrough::Hole);
        }
        let surface = self.surface(at, u[1]);
        match surface {
            Surface { interface: true, .. } => Err(PassedThrough::Interface),
            Surface { unlit: true, .. } => Err(PassedThrough::Unlit(surface)),
            _ => Ok(surface),
        }
    }

    /// Returns the index of the medium around the camera; `u32::MAX` for vacuum.
    pub fn camera_medium(&self) -> u32 {
        self.camera_medium
    }

    /// Returns the index of the medium that a ray enters when it leaves a hit along `direction`; `u32::MAX` for vacuum. At
    /// a surface that does not separate media, returns `medium`, through which the ray arrived.
    pub fn medium_beyond(&self, at: &Interaction<'_>, direction: Vec3, medium: u32) -> u32 {
        at.medium_beyond(direction, medium)
    }

    /// Returns the transmittance of a medium over a distance, per channel. It is 1 for vacuum.
    pub fn medium_transmittance(&self, medium: u32, distance: f32) -> Vec3 {
        if medium == NO_MEDIUM { Vec3::ONE } else { self.media.medium(medium).transmittance(distance) }
    }

    /// Returns the transmittance per channel along a shadow ray to `target` (0 if the ray is blocked), and the number of rays
    /// traced. The ray starts in `medium`.
    #[inline(always)]
    pub fn transmittance(&self, ray: Ray, target: &Target, time: f32, medium: u32) -> (Vec3, u32) {
        if self.has_passable_surfaces {
            return self.transmittance_past_surfaces(ray, target, time, medium);
        }
        let share = match self.occluded(&ray, time) {
            true => Vec3::ZERO,
            false => self.medium_transmittance(medium, ray.tmax * ray.direction.length()),
        };
        (share, 1)
    }

    /// Returns the result of [`Self::transmittance`] in scenes with passable surfaces.
    #[inline(never)]
    fn transmittance_past_surfaces(&self, mut ray: Ray, target: &Target, time: f32, mut medium: u32) -> (Vec3, u32) {
        let mut share = Vec3::ONE;
        for rays in 1..=MOST_PASSED {
            let hit = self.closest_hit(&ray, time);
            let end = hit.as_ref().map_or(ray.tmax, |at| at.hit.t);
            if medium != NO_MEDIUM {
                share *= self.media.medium(medium).transmittance(end * ray.direction.length());
            }
            let Some(at) = hit else { return (share, rays) };
            let part = at.part;
            if !part.passable {
                return (Vec3::ZERO, rays);
            }
            let surface = &self.surfaces[part.material as usize];
            let alpha = self.alpha(&at);
            // A mixed material transmits the fraction of its interfaces, and an unlit material all light.
            let empty =
                material::passed_share(&self.surfaces, part.material, &self.textures, || self.texture_point(&at));
            let through = 1.0 - alpha + alpha * empty;
            share *= through;
            if share == Vec3::ZERO {
                return (share, rays);
            }
            if surface.interface {
                medium = at.medium_beyond(ray.direction, medium);
            }
            ray = target.ray_from(&at.point, ray.direction);
        }
        (Vec3::ZERO, MOST_PASSED)
    }
}
