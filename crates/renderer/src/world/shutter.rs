//! Which part of a motion the shutter sees.

use super::World;
use crate::scene::Scene;
use dapple_geometry::Motion;

/// The part of the motion during which the shutter is open.
pub(super) struct Shutter {
    /// In `[0, 1]`, the same twice if nothing is seen to move.
    pub(super) open: [f32; 2],
}

impl Shutter {
    /// The scene's.
    ///
    /// # Errors
    /// Times that are none, where something moves.
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
                "{at}: the shutter is open from {opens} to {closes} and things move from {from} to {to}: give finite \
                 times, the later one second"
            ));
        }
        Ok(Self { open: [opens, closes].map(|t| ((t - from) / (to - from)).clamp(0.0, 1.0) as f32) })
    }

    /// A motion as the shutter sees it: at rest, if it is open for no time.
    pub(super) fn seen(&self, motion: Motion) -> Motion {
        if self.open[0] == self.open[1] { Motion::still(motion.at(self.open[0])) } else { motion }
    }
}

impl World {
    /// The time, as a share of the motion, that `u` in `[0, 1)` draws uniformly while the shutter is open.
    #[inline]
    pub(crate) fn time(&self, u: f32) -> f32 {
        let [opens, closes] = self.open;
        (opens + (closes - opens) * u).clamp(0.0, 1.0)
    }
}
