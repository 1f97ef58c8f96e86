//! The part of a motion during which the shutter is open.

use super::World;
use dapple_geometry::Motion;
use dapple_scene::Scene;

/// The part of the motion during which the shutter is open.
pub(super) struct Shutter {
    /// In `[0, 1]`, the same twice if nothing moves visibly.
    pub(super) open: [f32; 2],
}

impl Shutter {
    /// The shutter of a scene.
    ///
    /// # Errors
    ///
    /// For times that are not finite or not in order, where something moves.
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

    /// A motion while the shutter is open: at rest, if it is open for no time.
    pub(super) fn seen(&self, motion: Motion) -> Motion {
        if self.open[0] == self.open[1] { Motion::still(motion.at(self.open[0])) } else { motion }
    }
}

impl World {
    /// A time within the motion, in `[0, 1]`, sampled by `u` in `[0, 1)` uniformly while the shutter is open.
    #[inline]
    pub fn time(&self, u: f32) -> f32 {
        let [opens, closes] = self.open;
        (opens + (closes - opens) * u).clamp(0.0, 1.0)
    }
}
