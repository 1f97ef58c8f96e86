//! The part of a scene's motion during which the camera's shutter is open.

use super::World;
use dapple_geometry::Motion;
use dapple_scene::Scene;

/// The interval of time, within a scene's motion, in which the camera's shutter is open.
pub(super) struct Shutter {
    /// The opening and closing time in `[0, 1]`, where the motion takes place from 0 to 1. Both are 0 if nothing
    /// moves.
    pub(super) open: [f32; 2],
}

impl Shutter {
    /// Returns the interval in which the shutter of a scene is open.
    ///
    /// # Errors
    ///
    /// A message if the scene has motion and its times are not finite or not in order.
    pub(super) fn of(scene: &Scene) -> Result<Self, String> {
        let moves = scene.camera.moves_to.is_some()
            || scene.shapes.iter().any(|shape| shape.moves_to.is_some())
            || scene.instances.iter().any(|instance| instance.moves_to.is_some());
        if !moves {
            return Ok(Self { open: [0.0; 2] });
        }
        let [from, to] = match scene.motion_times {
            [from, to] if from == to => [0.0, 1.0],
            times => times,
        };
        let [opens, closes] = scene.camera.shutter;
        let sound = [from, to, opens, closes].iter().all(|t| t.is_finite());
        if !sound || from > to || opens > closes {
            let at = &scene.camera.source;
            return Err(format!(
                "{at}: the shutter is open from {opens} to {closes} and things move from {from} to {to}; give finite \
                 times, the later one second"
            ));
        }
        Ok(Self { open: [opens, closes].map(|t| ((t - from) / (to - from)).clamp(0.0, 1.0) as f32) })
    }

    /// Returns the motion unchanged, or its constant pose if the shutter opens and closes at the same time.
    pub(super) fn seen(&self, motion: Motion) -> Motion {
        if self.open[0] == self.open[1] { Motion::still(motion.at(self.open[0])) } else { motion }
    }
}

impl World {
    /// Returns a time within the motion, in `[0, 1]`. The random number `u` in `[0, 1)` samples it uniformly from the
    /// interval in which the shutter is open.
    #[inline]
    pub fn time(&self, u: f32) -> f32 {
        let [opens, closes] = self.open;
        (opens + (closes - opens) * u).clamp(0.0, 1.0)
    }
}
