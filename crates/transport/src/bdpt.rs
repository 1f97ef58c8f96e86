//! Bidirectional path tracing: connects a camera path and a light path in all possible ways [Lafortune and Willems 1993; Veach
//! and Guibas 1994], weighted by the power heuristic [Veach and Guibas 1995].

mod vertex;
mod walk;
mod weights;

use dapple_core::options::Options as _;
use dapple_core::{Draws, Estimate, Integrator, Needs, Worker};
use dapple_renderer::{MakeError, World};
use glam::{Vec2, Vec3};
use vertex::Vertex;
pub(crate) use walk::OF_LIGHT;
use weights::Contribution;

dapple_core::options! {
    /// The parameters of [`Bdpt`].
    pub struct BdptOptions {
        /// Maximum number of scattering events on a path; 0: the scene's limit.
        pub depth: u32 = 0;
        /// 1: light paths also connect to the camera and contribute to other pixels (finds caustics); 0: they do not.
        pub splat: u32 = 1, |splat| splat <= 1, "0 or 1";
    }
}

/// An integrator that traces one path from the camera and one from a light per sample, and connects each vertex of one path
/// with each vertex of the other.
///
/// It is unbiased: it has the same expected value as the path tracer. A sample takes several times as many rays. The extra
/// rays are worthwhile if camera paths rarely reach the light: for lights behind shades, and for caustics.
///
/// Connections of light paths with the camera are splats ([`Worker::splat`]). A pixel's variance does not include the noise
/// of splats, and an adaptive sampler cannot direct splats to a pixel.
///
/// Motion and lenses are supported. Worlds with media or transparency are rejected.
#[derive(Debug)]
pub struct Bdpt<'w> {
    world: &'w World,
    /// The smallest number of scattering events of the light in the estimate.
    pub(crate) least: usize,
    /// The largest number of scattering events.
    depth: u32,
    /// True if light paths are connected with the camera.
    splats: bool,
}

impl<'w> Bdpt<'w> {
    /// Makes the integrator for a world.
    ///
    /// # Errors
    ///
    /// [`MakeError::Scene`], which names the effect, if the world has media or partly transparent surfaces.
    pub fn new(world: &'w World, options: &BdptOptions) -> Result<Self, MakeError> {
        refuse(world).map_err(MakeError::Scene)?;
        let depth = if options.depth == 0 { world.max_depth() } else { options.depth };
        Ok(Self { world, least: 0, depth, splats: options.splat == 1 })
    }

    /// Makes the integrator from the text of its parameters, for the table of integrators.
    pub(crate) fn parse<'a>(parameters: &str, world: &'a World) -> Result<Box<dyn Integrator + 'a>, MakeError> {
        Ok(Box::new(Bdpt::new(world, &BdptOptions::parse(parameters)?)?))
    }

    /// Traces both paths of a sample and connects them. Calls `splat` with light for other positions in the image, in pixels
    /// from the top left corner.
    pub(crate) fn trace(&self, draws: &Draws<'_>, mut splat: impl FnMut(Vec2, Vec3)) -> Estimate {
        let mut estimate = Estimate::new([0.0; 3]).with_cost(0);
        let (mut camera, mut light) = (Vec::with_capacity(8), Vec::with_capacity(8));
        let (time, direct) = self.camera_path(draws, &mut camera, &mut estimate);
        let (mut rays, mut radiance) = (0, Vec3::ZERO);
        self.light_path(draws, time, &mut light, &mut rays);
        for t in 2..=camera.len() {
            let emission = self.of_camera(&camera[..t], &light, (time, &mut rays), &mut radiance);
            if t <= direct {
                estimate.emission = (Vec3::from(estimate.emission) + emission).to_array();
            }
        }
        if self.splats {
            self.seen(draws, &light, (time, &mut rays), |place, s, found| {
                splat(place, self.weighted(&light[..s], &camera[..1], &found));
            });
        }
        estimate.radiance = radiance.to_array();
        estimate.cost += rays;
        estimate
    }

    /// Adds the contributions of all strategies that use the whole camera path to `radiance`. Returns the emission that the
    /// camera path hits by itself.
    fn of_camera(
        &self,
        camera: &[Vertex<'w>],
        light: &[Vertex<'w>],
        (time, rays): (f32, &mut u32),
        radiance: &mut Vec3,
    ) -> Vec3 {
        let (t, last) = (camera.len(), &camera[camera.len() - 1]);
        let mut emission = Vec3::ZERO;
        // The number of scattering events of s + t vertices is s + t - 2.
        if t >= self.least + 2
            && let Some(found) = self.found(camera)
        {
            emission = self.weighted(&[], camera, &found);
            *radiance += emission;
        }
        let least = (self.least + 2).saturating_sub(t);
        let most = (self.depth as usize + 2).saturating_sub(t);
        if most == 0 || !last.connects() || self.world.lights().is_empty() {
            return emission;
        }
        if least <= 1
            && let Some((found, start)) = self.sampled(camera, (time, rays))
        {
            *radiance += self.weighted(&[start], camera, &found);
        }
        for s in least.max(2)..=most.min(light.len()) {
            if light[s - 1].connects()
                && let Some(found) = self.connected(&light[..s], camera, (time, rays))
            {
                *radiance += self.weighted(&light[..s], camera, &found);
            }
        }
        emission
    }

    /// Returns the contribution of a strategy multiplied by its weight.
    fn weighted(&self, light: &[Vertex<'_>], camera: &[Vertex<'_>], found: &Contribution) -> Vec3 {
        found.radiance * self.weight(light, camera, &found.ends)
    }
}

/// Rejects worlds with effects that light paths do not support.
fn refuse(world: &World) -> Result<(), String> {
    use dapple_scene::Effect;
    let lacking = [Effect::AbsorbingMedia, Effect::ScatteringMedia, Effect::Transparency];
    let called = world.effects().called().iter().find(|called| lacking.contains(&called.effect));
    match called {
        Some(called) => Err(format!(
            "{}: the scene has {} ({}), which paths from the lights do not support; use integrator \"path\", or leave the effect out by --without {}",
            called.source, called.effect, called.because, called.effect
        )),
        None if world.has_interfaces() => {
            Err("the scene has interfaces between media, which paths from the lights do not support; use integrator \"path\""
                .into())
        }
        None if world.has_unlit_surfaces() => {
            Err("the scene has unlit surfaces, which paths from the lights do not support; use integrator \"path\"".into())
        }
        None => Ok(()),
    }
}

impl Integrator for Bdpt<'_> {
    fn estimate(&self, draws: &Draws<'_>, worker: &mut Worker) -> Estimate {
        self.trace(draws, |place, radiance| {
            self.world.splat_at(place, |pixel, weight| worker.splat(pixel, (radiance * weight).to_array()));
        })
    }

    fn features_alone(&self, draws: &Draws<'_>) -> Option<Estimate> {
        Some(self.world.features_alone(draws, self.depth))
    }

    fn needs(&self) -> Needs {
        if self.splats { Needs::none().with_splats() } else { Needs::none() }
    }
}
