//! The time interval of a motion in which the shutter is open.

use super::World;
use dapple_geometry::Motion;
use dapple_scene::Scene;

/// The time interval of a motion in which the shutter is open.
pub(super) struct Shutter {
    /// Opening and closing time in `[0, 1]`, equal if nothing moves visibly.
    pub(super) open: [f32; 2],
}

impl Shutter {
    /// Returns the shutter of a scene.
    ///
    /// # Errors
    ///
    /// A message if anything moves and the times are not finite or not in order.
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

    /// Returns the motion unchanged, or its pose at that time if the shutter's interval has length 0.
    pub(super) fn seen(&self, motion: Motion) -> Motion {
        if self.open[0] == self.open[1] { Motion::still(motion.at(self.open[0])) } else { motion }
    }
}

impl World {
    /// Returns a time within the motion, in `[0, 1]`, sampled uniformly while the shutter is open by `u` in `[0, 1)`.
    #[inline]
    pub fn time(&self, u: f32) -> f32 {
        let [opens, closes] = self.open;
        (opens + (closes - opens) * u).clamp(0.0, 1.0)
    }
}
