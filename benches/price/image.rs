//! A bundled image for repeated renders.

use super::{Effort, Error, Result};
use dapple_core::samplers::Uniform;
use dapple_core::{Film, Frame, Limits, Monitor, Needs, NoMonitor, Render, Schedule};
use dapple_low_discrepancy::Sobol;
use dapple_renderer::{World, integrator};
use dapple_scene::Scene;
use dapple_scene::bundled;
use std::time::Instant;

/// The bundled scene of this name.
pub(crate) fn scene(name: &'static str) -> Result<Scene> {
    let wrong = |why: String| Error::Scene { name, why };
    let bundle = bundled::files(name).ok_or_else(|| wrong("there is none".into()))?;
    bundle.read().map_err(|e| wrong(e.to_string()))
}

/// The bundled scene, ready for rays.
pub(crate) fn world(name: &'static str, resolution: [u32; 2]) -> Result<World> {
    World::with_resolution(&scene(name)?, resolution).map_err(|e| Error::Scene { name, why: e.to_string() })
}

/// The Cornell box: its samples are the cheapest of all bundled scenes, so that parts weigh the most.
pub(crate) struct Image {
    world: World,
    pub(crate) frame: Frame,
    pub(crate) spp: u64,
}

impl Image {
    pub(crate) const NAME: &str = "cornell";

    pub(crate) fn new(effort: Effort) -> Result<Self> {
        let (side, spp) = match effort {
            Effort::Quick => (48, 4),
            Effort::Full => (192, 8),
        };
        Ok(Self { world: world(Self::NAME, [side; 2])?, frame: Frame::new(side, side)?, spp })
    }

    pub(crate) fn world(&self) -> &World {
        &self.world
    }

    pub(crate) fn sampler() -> Uniform<Sobol> {
        Uniform::new(Sobol::new(7))
    }

    pub(crate) fn samples(&self) -> u64 {
        self.spp * self.frame.pixels() as u64
    }

    /// Limits with two slices, so that a render has a middle.
    pub(crate) fn limits(&self) -> Limits {
        Limits::samples(self.samples()).with_schedule(Schedule::default().with_slice_spp((self.spp / 2) as u32))
    }

    pub(crate) fn render(&self, needs: Needs, monitor: &mut dyn Monitor) -> Result<Film> {
        let mut integrator = integrator(&self.world);
        Ok(Render::new(self.frame, &self.limits())
            .needs(needs)
            .monitor(monitor)
            .run(&mut *integrator, &mut Self::sampler())?)
    }

    /// Seconds of a whole render.
    pub(crate) fn seconds(&self, needs: Needs) -> Result<f64> {
        let start = Instant::now();
        std::hint::black_box(self.render(needs, &mut NoMonitor)?);
        Ok(start.elapsed().as_secs_f64())
    }

    /// The image's description for the table.
    pub(crate) fn describe(&self) -> String {
        let [width, height] = self.frame.size();
        format!("rendering {} ({width}x{height}, {} spp, one thread)", Self::NAME, self.spp)
    }
}
