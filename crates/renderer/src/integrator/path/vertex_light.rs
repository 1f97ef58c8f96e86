//! Light at path vertices from other sources than the path itself, such as photon maps.

use crate::shading::{Bsdf, ShadingFrame};
use crate::world::Interaction;
use dapple_core::integrator::{Pass, PreparationCost, Prepares};
use dapple_core::{Draws, Frame, Worker};
use glam::Vec3;

/// A source of light at the vertices of a path tracer's paths, such as a photon map. Paths leave out the light that this
/// source adds in their place; see [`share`](Self::share) and [`replaces`](Self::replaces).
///
/// It is a type parameter of [`PathTracer`](super::PathTracer), so that path tracers without such a source have no code for
/// it. The default methods add no light.
pub trait VertexLight: Sync {
    /// True if the path tracer needs code for this source.
    const ACTIVE: bool;
    /// The state of a path, which records the light that this source has added.
    type State: Copy + Default;

    /// Returns the radiance that this source adds towards the previous vertex, and the number of rays traced. The surface at
    /// the vertex is neither a mirror nor clear glass.
    fn gather(
        &self,
        _state: &mut Self::State,
        _vertex: &GatherPoint<'_>,
        _draws: &Draws<'_>,
        _worker: &mut Worker,
    ) -> (Vec3, u32) {
        (Vec3::ZERO, 0)
    }

    /// Returns true if the path tracer samples a light at this vertex too, before it calls [`gather`](Self::gather).
    fn samples_lights(&self, _state: &Self::State, _vertex: &GatherPoint<'_>) -> bool {
        true
    }

    /// Returns the fraction of light, 0 to 1, that the path still adds from this surface's non-specular lobes. The rest was
    /// added at earlier vertices. The surface's own emission is not reduced.
    fn share(&self, _state: &Self::State, _vertex: &GatherPoint<'_>) -> f32 {
        1.0
    }

    /// Records that the path was scattered at a surface, by a specular lobe or by another one.
    fn scattered(&self, _state: &mut Self::State, _specular: bool) {}

    /// Records that the path was scattered by a medium.
    fn scattered_in_medium(&self, _state: &mut Self::State) {}

    /// Returns true if this source already includes the emission of light number `light` that a path hits, so that the path
    /// must not add it. `u32::MAX` is the environment. `specular` is true if the last scattering event was specular.
    fn replaces(&self, _state: &Self::State, _light: u32, _specular: bool) -> bool {
        false
    }

    /// Returns true if the path ends at the surface that it hits, after adding the surface's emission. `specular` is true for
    /// a mirror or clear glass.
    fn ends(&self, _state: &Self::State, _specular: bool) -> bool {
        false
    }

    /// See [`Integrator::prepares`](dapple_core::Integrator::prepares).
    fn prepares(&self) -> Prepares {
        Prepares::Never
    }

    /// See [`Integrator::prepare`](dapple_core::Integrator::prepare).
    fn prepare(&mut self, _pass: &Pass<'_>) -> PreparationCost {
        PreparationCost::default()
    }

    /// See [`Integrator::memory`](dapple_core::Integrator::memory).
    fn memory(&self, _frame: &Frame) -> u64 {
        0
    }
}

/// A vertex of a path at which a [`VertexLight`] adds light.
#[derive(Clone, Copy, Debug)]
pub struct GatherPoint<'a> {
    /// The surface point.
    pub at: &'a Interaction<'a>,
    /// The BSDF of the surface.
    pub bsdf: &'a Bsdf<'a>,
    /// The shading frame, in which the BSDF's directions are given.
    pub frame: &'a ShadingFrame,
    /// The unit direction towards the previous vertex, in the shading frame.
    pub wo: Vec3,
    /// The unit direction towards the previous vertex, in the renderer's space.
    pub back: Vec3,
    /// The number of scattering events before this vertex.
    pub depth: u32,
}

/// No additional light at vertices: the path tracer by itself.
#[derive(Clone, Copy, Debug)]
pub struct NoVertexLight;

impl VertexLight for NoVertexLight {
    const ACTIVE: bool = false;
    type State = ();
}
