//! Ambient occlusion: the cosine-weighted fraction of the hemisphere above a surface that is not blocked by other
//! surfaces.

use super::MakeError;
use crate::World;
use crate::blocks;
use crate::shading::{ShadingFrame, warp};
use dapple_core::options::Options as _;
use dapple_core::{Draws, Estimate, Integrator, Worker};
use dapple_geometry::spawn_ray;

dapple_core::options! {
    /// The parameters of [`AmbientOcclusion`].
    pub struct AmbientOcclusionOptions {
        /// Maximum distance of an occluder, in units of the scene file.
        pub distance: f64 = f64::INFINITY => "inf", |distance| distance > 0.0, "above 0";
    }
}

/// An integrator for ambient occlusion. Its value is the cosine-weighted fraction of directions from the camera ray's
/// first hit in which nothing lies within a given distance.
///
/// The value is 1 for an open surface, and 0 for an enclosed one or where the camera ray hits nothing. Lights and materials
/// are ignored; holes cut by alpha count as solid.
#[derive(Clone, Copy, Debug)]
pub struct AmbientOcclusion<'w> {
    world: &'w World,
    /// The largest distance of an occluder, in the renderer's units.
    distance: f32,
}

impl<'w> AmbientOcclusion<'w> {
    /// Makes the integrator. Surfaces within `distance`, in units of the scene file, count as occluders; with infinity, all
    /// surfaces do.
    pub fn new(world: &'w World, distance: f64) -> Self {
        Self { world, distance: (distance * world.space().scale()) as f32 }
    }

    /// Makes the integrator from the text of its parameters, for the table of integrators.
    pub(super) fn parse<'a>(parameters: &str, world: &'a World) -> Result<Box<dyn Integrator + 'a>, MakeError> {
        let options = AmbientOcclusionOptions::parse(parameters)?;
        Ok(Box::new(AmbientOcclusion::new(world, options.distance)))
    }
}

impl Integrator for AmbientOcclusion<'_> {
    fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
        let world = self.world;
        let (ray, time) = world.camera_ray(draws);
        let Some(at) = world.closest_hit(&ray, time) else {
            let mut estimate = Estimate::new([0.0; 3]);
            if draws.wants_trajectory() {
                estimate.trajectory = world.background_trajectory(&ray, time);
            }
            return estimate;
        };
        let [.., u, v] = draws.block(blocks::scatter(0));
        // The side of the surface from which the camera ray comes.
        let normal = at.point().normal;
        let frame = ShadingFrame::from_normal(if normal.dot(ray.direction) > 0.0 { -normal } else { normal });
        let mut probe = spawn_ray(at.point(), frame.to_world(warp::cosine_hemisphere([u, v])));
        probe.tmax = self.distance;
        // Directions are sampled with cosine density, so the fraction is the mean of the values 0 and 1.
        let open = if world.occluded(&probe, time) { 0.0 } else { 1.0 };
        let first_hit = draws.wants_first_hit().then(|| world.first_hit(&ray, &at, 0.0));
        let mut estimate = Estimate::new([open; 3]).with_first_hit(first_hit).with_cost(2);
        if draws.wants_trajectory() {
            estimate.trajectory = world.trajectory(&at);
        }
        estimate
    }
}
