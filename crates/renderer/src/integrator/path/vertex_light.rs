//! Light that reaches the vertices of a path by other means than the path itself, such as photons.

use crate::shading::{Bsdf, ShadingFrame};
use crate::world::Interaction;
use dapple_core::integrator::{Pass, PreparationCost, Prepares};
use dapple_core::{Draws, Frame, Worker};
use glam::Vec3;

/// A source of light at the vertices of a path tracer's paths. It takes the place of a part of what paths find.
///
/// It is a type parameter of [`PathTracer`](super::PathTracer), so that path tracers without one have no code for it.
/// The defaults are those of no light.
pub trait VertexLight: Sync {
    /// True if paths have code for this light.
    const ACTIVE: bool;
    /// The state of a path, in which the light notes what it has added.
    type State: Copy + Default;

    /// Returns the radiance that this light adds towards the previous vertex, at a surface that is not a mirror or clear
    /// glass, and the number of rays traced.
    fn gather(
        &self,
        _state: &mut Self::State,
        _vertex: &GatherPoint<'_>,
        _draws: &Draws<'_>,
        _worker: &mut Worker,
    ) -> (Vec3, u32) {
        (Vec3::ZERO, 0)
    }

    /// Returns true if the path samples a light at the vertex at which this light is gathered next.
    fn samples_lights(&self, _state: &Self::State, _vertex: &GatherPoint<'_>) -> bool {
        true
    }

    /// Returns the share of light that the path carries on from a surface by its lobes that are not specular, 0 to 1. The rest
    /// was added at earlier vertices. Emission of the surface counts in full.
    fn share(&self, _state: &Self::State, _vertex: &GatherPoint<'_>) -> f32 {
        1.0
    }

    /// Notes that the path goes on from a surface, by a specular lobe or another one.
    fn scattered(&self, _state: &mut Self::State, _specular: bool) {}

    /// Notes that the path was scattered by a medium.
    fn scattered_in_medium(&self, _state: &mut Self::State) {}

    /// Returns true if this light stands for the emission of light number `light` that a path hits. The path then does not
    /// count it. `u32::MAX` is the environment. `specular` is true if the last scattering event was specular.
    fn replaces(&self, _state: &Self::State, _light: u32, _specular: bool) -> bool {
        false
    }

    /// Returns true if the path ends at the surface that it hits, after its emission. `specular` is true for a mirror and
    /// clear glass.
    fn ends(&self, _state: &Self::State, _specular: bool) -> bool {
        false
    }

    /// As [`Integrator::prepares`](dapple_core::Integrator::prepares).
    fn prepares(&self) -> Prepares {
        Prepares::Never
    }

    /// As [`Integrator::prepare`](dapple_core::Integrator::prepare).
    fn prepare(&mut self, _pass: &Pass<'_>) -> PreparationCost {
        PreparationCost::default()
    }

    /// As [`Integrator::memory`](dapple_core::Integrator::memory).
    fn memory(&self, _frame: &Frame) -> u64 {
        0
    }
}

/// A vertex of a path at which a [`VertexLight`] adds light.
#[derive(Clone, Copy, Debug)]
pub struct GatherPoint<'a> {
    /// The surface point.
    pub at: &'a Interaction<'a>,
    /// The surface's scattering.
    pub bsdf: &'a Bsdf<'a>,
    /// The shading frame of the scattering.
    pub frame: &'a ShadingFrame,
    /// The unit direction towards the previous vertex, in the shading frame.
    pub wo: Vec3,
    /// The unit direction towards the previous vertex, in the renderer's space.
    pub back: Vec3,
    /// The number of scattering events before this one.
    pub depth: u32,
}

/// No light at vertices: a path tracer by itself.
#[derive(Clone, Copy, Debug)]
pub struct NoVertexLight;

impl VertexLight for NoVertexLight {
    const ACTIVE: bool = false;
    type State = ();
}
